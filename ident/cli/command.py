"""A command made of a study: its flags follow from the study's options, its complaints name them."""

import inspect
from collections.abc import Callable
from dataclasses import Field
from pathlib import Path
from typing import Annotated, Any

import typer

from ident.cli.app import app
from ident.cli.running import start
from ident.errors import InputError
from ident.studies.options import Options, Spec, flag_of, renamed, specs
from ident.studies.result import Result

OutOption = Annotated[Path, typer.Option("--out", "-o", help="folder for what is written")]
NoFigureOption = Annotated[bool, typer.Option("--no-figure", help="write no figure")]
ArmArgument = Annotated[Path, typer.Argument(help="arm description, a TOML file (data/README.md)")]
CampaignArgument = Annotated[Path, typer.Argument(help="measurements, a CSV file (data/README.md)")]
ArmOption = Annotated[Path | None, typer.Option("--arm", help="arm description; default: arm.toml beside the campaign")]
PathOption = Annotated[
    Path | None,
    typer.Option(help="joint path to follow instead of the stroke: CSV with time [s], joint1 [deg], ..."),
]
FitOption = Annotated[Path | None, typer.Option(help="result file of ident fit, whose values the arm takes over")]
PosteriorOption = Annotated[
    Path | None, typer.Option(help="posterior of ident sample (.nc): bands of 5 to 95 % by its draws")
]
StrictOption = Annotated[
    bool, typer.Option("--strict", help="exit with status 3 where the data contradict each other, or the model")
]
SHORT = 3
"""Exit status where a computation missed its own criterion, or, if asked for, a verdict speaks against the data."""


def command(kind: type[Options]) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Hang a function on the program: its parameter `options` becomes the flags of this class of options.

    The function's other parameters are the command's arguments and inputs, in typer's words.
    """

    def hang(function: Callable[..., None]) -> Callable[..., None]:
        given = inspect.signature(function).parameters
        own = [p for name, p in given.items() if name != "options"]
        flags = [_parameter(each, spec) for each, spec in specs(kind)]
        first = [p for p in own if p.default is inspect.Parameter.empty]
        after = [p for p in own if p.default is not inspect.Parameter.empty]

        def call(**values: Any) -> None:
            inputs = {p.name: values[p.name] for p in own}
            try:
                options = _options(kind, values)
                start()
                function(**inputs, options=options)
            except InputError as error:
                raise InputError(renamed(kind, problem) for problem in error.problems) from None

        ordered = [p.replace(kind=inspect.Parameter.KEYWORD_ONLY) for p in (*first, *flags, *after)]
        call.__signature__ = inspect.Signature(ordered)  # type: ignore[attr-defined]
        call.__annotations__ = {p.name: p.annotation for p in ordered}
        call.__doc__ = function.__doc__
        app.command(function.__name__.removesuffix("_command"))(call)
        return call

    return hang


def finish(result: Result, out: Path, no_figure: bool) -> None:
    """Print a result's report, and write its files and figures into a folder."""
    typer.echo(result.report())
    for path in result.save(out):
        typer.echo(f"wrote {path}")
    if not no_figure:
        for path in result.save_figures(out):
            typer.echo(f"wrote {path}")


def leave(*, short: bool, doubtful: bool, strict: bool) -> None:
    """End with a status that scripts can read; why, the report has said.

    Args:
        short: whether a computation missed its own criterion.
        doubtful: whether a verdict speaks against the data.
        strict: whether that counts as well.
    """
    if short or (strict and doubtful):
        raise typer.Exit(SHORT)


def _parameter(each: Field[Any], spec: Spec) -> inspect.Parameter:
    """Return the flag of an option as typer wants it."""
    names = [flag_of(each), *([spec.short] if spec.short else [])]
    kind, default = each.type, each.default
    if spec.read:
        kind, default = (list[str] if spec.repeated else str) | None, spec.text or None
    flag = typer.Option(*names, help=spec.help, show_default=bool(spec.text) or not spec.read)
    return inspect.Parameter(
        each.name, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=Annotated[kind, flag]
    )


def _options(kind: type[Options], values: dict[str, Any]) -> Options:
    """Return the options that flags give; what a flag does not give has its default."""
    given: dict[str, Any] = {}
    for each, spec in specs(kind):
        value = values[each.name]
        if not spec.read:
            given[each.name] = value
        elif value is not None:
            given[each.name] = spec.read(value, flag_of(each))
    return kind(**given)
