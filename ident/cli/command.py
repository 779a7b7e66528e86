"""Turn studies into commands: flags follow from the study's inputs and options, error messages name the flags."""

import inspect
import json
import os
import re
import textwrap
import tomllib
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from copy import copy
from dataclasses import Field
from functools import partial
from pathlib import Path
from types import NoneType, UnionType
from typing import Annotated, Any, TypeVar, get_args, get_origin

import typer
from typer.core import TyperCommand

from ident.cli import running
from ident.cli.output import (
    FOLDED,
    SHORT,
    DetailsOption,
    JsonOption,
    QuietOption,
    VerboseOption,
    app,
    output,
    speaking,
    tell,
)
from ident.errors import InputError, Problem, refusal
from ident.files import keep_earlier, together
from ident.studies.following import kept_in
from ident.studies.handout import check_pdf, hand_over
from ident.studies.options import Options, Spec, flag_of, renamed, specs
from ident.studies.result import Result, other_inputs
from ident.text import did_you_mean, one_line, quoted, read_text
from ident.units import in_si, width

# -------- Defaults
# Defaults of flags from `ident.toml` in the folder of the campaign, or the arm. The command line overrides the file,
# the file overrides ident's own defaults.
#
# starts = 8              # a flag of any command, without its dashes
# out = "results"         # a path counts from the folder of the file
# [fit]
# prior-sd = 0.5          # for one command only
# fix = ["joint1.k_bend", "joint2.k_bend"]

FILE = "ident.toml"
WITHOUT = ("new", "rerun", "bind")
"""Commands without defaults: a new file has none, a repetition has its own."""
TYPES: dict[type, tuple[Any, str]] = {
    bool: (bool, "true or false"),
    int: (int, "a whole number"),
    float: (int | float, "a number"),
    str: (str | int | float, "text in quotes"),
    Path: (str, "a path in quotes"),
}
"""Accepted types in the file for each type of flag, and their description."""
LONGEST_SHOWN = 90
"""Longest value repeated in a message [characters]."""
NO_DEFAULTS = ("help_all", "help", "json", "quiet", "verbose", "restart", "force", "watch")
"""Flags that a file can't set: they apply to one call."""


def with_defaults(context: typer.Context, values: dict[str, Any], kinds: Mapping[str, Any]) -> dict[str, Any]:
    """Return a command's values, completed from the file, if there is one.

    Args:
        context: of the command line.
        values: by parameter.
        kinds: type of each parameter.

    Raises:
        InputError: unknown keys, and values that their flags do not accept; all are listed.
    """
    name, own = str(context.info_name), _flags(context.command)
    path = _main(context, values)
    if name in WITHOUT or path is None or not os.path.isfile(file := path.parent / FILE):
        return values
    where, document = one_line(str(file)), _read(file)
    problems = [*_unknown(context, document, where)]
    taken: dict[str, Any] = {}
    of_all = {key: value for key, value in document.items() if not isinstance(value, dict)}
    of_this = document.get(name)
    for key, value in {**of_all, **(of_this if isinstance(of_this, dict) else {})}.items():
        parameter = own.get(_plain(key))
        source = parameter and context.get_parameter_source(parameter.name)
        if parameter is None or (source and source.name == "COMMANDLINE"):
            continue
        try:
            taken[parameter.name] = _cast(kinds[parameter.name], value, file.parent)
        except (ValueError, OverflowError) as error:
            expected = str(error) if isinstance(error, ValueError) else "a number that is not beyond all others"
            problems.append(Problem(where, quoted(str(value)), expected, f"see ident {name} --help", key))
    if problems:
        raise InputError(problems)
    if taken:
        shown = ", ".join(f"{key.replace('_', '-')} = {_shown(value)}" for key, value in taken.items())
        output().say(textwrap.fill(f"defaults from {where}: {shown}", 100, **FOLDED))
    return {**values, **taken}


def _shown(value: Any) -> str:
    text = json.dumps(value, default=str)
    return text if len(text) <= LONGEST_SHOWN else text[:LONGEST_SHOWN] + "…"


def _main(context: typer.Context, values: Mapping[str, Any]) -> Path | None:
    """Return the command's main file: its first argument, or else the arm."""
    arguments = [each.name for each in context.command.params if each.param_type_name == "argument"]
    paths = (values.get(str(name)) for name in (*arguments, "arm"))
    return next((path for path in paths if isinstance(path, Path)), None)


def _flags(command: Any) -> dict[str, Any]:
    """Return the parameters of a command by their longest flag, without dashes."""
    options = [each for each in command.params if each.param_type_name == "option" and not each.hidden]
    named = {_plain(max(each.opts, key=len)): each for each in options}
    return {name: each for name, each in named.items() if name not in NO_DEFAULTS}


def _plain(flag: str) -> str:
    return flag.lstrip("-").replace("-", "_")


def _read(file: Path) -> dict[str, Any]:
    where = one_line(str(file))
    try:
        return tomllib.loads(read_text(file, "defaults as TOML"))
    except (ValueError, RecursionError) as error:
        raise refusal(where, str(error).lower(), "defaults as TOML", "correct the syntax") from None


def _unknown(context: typer.Context, document: Mapping[str, Any], where: str) -> Iterator[Problem]:
    """Yield keys of no command, and keys of a table that its command does not have."""
    commands: dict[str, Any] = getattr(context.parent and context.parent.command, "commands", {})
    flags = {name: _flags(command) for name, command in commands.items() if name not in WITHOUT}
    every = sorted({flag for own in flags.values() for flag in own})
    for key, value in document.items():
        if isinstance(value, dict) and key in flags:
            for inner in value:
                if _plain(inner) not in flags[key]:
                    yield _no_such(where, f"{key}.{inner}", inner, sorted(flags[key]))
        elif key in flags and not isinstance(value, str):  # `fit` is a flag of other commands, too
            got, expected = quoted(str(value)), "a table of the command's flags, or as a flag a path in quotes"
            yield Problem(where, got, expected, f"write [{key}] above the flags", key)
        elif isinstance(value, dict) or _plain(key) not in every:
            yield _no_such(where, key, key, [*sorted(flags), *every] if isinstance(value, dict) else every)


def _no_such(where: str, place: str, key: str, known: list[str]) -> Problem:
    remedy = did_you_mean(_plain(key), known, "remove it").replace("_", "-")
    remedy = "give it on the command line" if _plain(key) in NO_DEFAULTS else remedy
    return Problem(where, f"unknown key {quoted(key)}", "a flag of a command, without its dashes", remedy, place)


def _cast(kind: Any, value: Any, folder: Path) -> Any:
    """Return a value of the file in the form of the command line.

    Raises:
        ValueError: it has the wrong type for the flag; says which is right.
    """
    if isinstance(kind, UnionType):
        kind = next(each for each in get_args(kind) if each is not NoneType)
    if get_origin(kind) is list:
        return [_cast(str, each, folder) for each in (value if isinstance(value, list) else [value])]
    wanted, words = TYPES[kind]
    if not isinstance(value, wanted) or (isinstance(value, bool) and kind is not bool):
        raise ValueError(words)
    return folder / value if kind is Path else kind(value)


# -------- Command

CampaignArgument = Annotated[Path, typer.Argument(help="measurements, a CSV file (data/README.md)")]
ArmOption = Annotated[
    Path | None,
    typer.Option("--arm", help="arm description: TOML, URDF or MJCF; default: arm.toml beside the campaign"),
]
PathOption = Annotated[
    Path | None, typer.Option(help="joint path to follow instead of the stroke: CSV with time [s], joint1 [deg], ...")
]
OutOption = Annotated[Path, typer.Option("--out", "-o", help="folder for what is written")]
ForceOption = Annotated[bool, typer.Option("--force", help="keep no earlier result of the same name")]
NoFigureOption = Annotated[bool, typer.Option("--no-figure", help="write no figure")]
FontOption = Annotated[Path | None, typer.Option("--font", help="TrueType font for letters that the PDF's own lacks")]
StrictOption = Annotated[bool, typer.Option("--strict", help="exit with status 3 where the data are contradictory")]
MAIN: Mapping[str, str] = {
    "predict": "posture load set fit modes draws tool frame",
    "check": "fix free soft_base strict",
    "fit": "fix free soft_base discrepancy no_prior strict",
    "profile": "parameter fix free no_prior",
    "sample": "ess steps noise discrepancy weights strict",
    "validate": "leave fix free soft_base",
    "plan": "target count load modes sensors sheet cost",
    "resonance": "speed path fit posterior orders load",
    "simulate": "speed limit settled path fit posterior trace errors",
    "spectrum": "direction upto posture orders spectrogram against",
    "triage": "path delay orders upto",
    "source": "init posterior hold_out offset strict",
    "sweep": "vary grid limit speed fit posterior",
    "motion": "limit settled time speed posterior errors",
    "variants": "limit settled speed load",
    "design": "limit change speed fit posterior",
    "balance": "radius holes height most speed path",
    "joint": "ratio inertia alone locked upto strict",
    "diagnose": "limit settled speed path runs restart",
    "explore": "speed load fit posterior payload",
    "fleet": "workers fix free strict",
    "modal": "init watch channels no_modes reproducibility",
}
"""Main flags by command: its help shows these and `ALWAYS`, and `--help-all` the rest."""
ALWAYS = ("arm", "out", "details", "json", "page", "pdf")
WHOLE = "ident.help_all"
"""Key in a command's context for help with all flags."""


def flag(help: str, *names: str, kind: Any = Path | None) -> Any:
    """Return a flag, in typer's form, for a file or none, or for a value of another kind."""
    return Annotated[kind, typer.Option(*names, help=help)]


def parameter(name: str, annotation: Any, default: Any = inspect.Parameter.empty) -> inspect.Parameter:
    """Return a parameter of a command, in typer's form."""
    return inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=annotation)


FORCE = parameter("force", ForceOption, False)
"""The flag of commands whose options do not contain it."""
PAGES = (
    parameter("page", flag("write the result as one HTML page to hand over", kind=bool), False),
    parameter("pdf", flag("write the same page as a PDF in A4", kind=bool), False),
    parameter("font", FontOption, None),
)
"""Flags of the pages to hand over."""
INPUTS: dict[str, Any] = {
    "arm": Annotated[Path, typer.Argument(help="arm description: TOML, URDF or MJCF (data/README.md)")],
    "campaign": CampaignArgument,
    "path": PathOption,
    "fit": flag("result file of ident fit, whose values the arm takes over"),
    "posterior": flag("posterior of ident sample (.nc): bands of 5 to 95 % by its draws"),
    "trace": flag("measured vibration to compare with: CSV with time [s], x [mm] or x [m/s^2], ..."),
    "against": flag("another trace, drawn over the first, as a measured one"),
}
"""Inputs of studies besides options, by name."""
F = TypeVar("F", bound=Callable[..., Iterator[Result]])


def command(kind: type[Options], *, files: bool = True, pages: bool = True, judged: bool = False) -> Callable[[F], F]:
    """Register a function as a command: its parameter `options` becomes the flags of this class of options.

    The function's other parameters are the command's arguments and inputs, in typer's form. The function itself stays
    unchanged. It yields the result, which is printed and written; then it continues, and may end with an exit status.

    Args:
        kind: class of the options.
        files: whether files are written, besides the printed report and the pages.
        pages: whether the result can be written as a page to hand over.
        judged: whether there is a flag that makes a verdict against the data a failure.
    """

    def hang(function: F) -> F:
        given = inspect.signature(function).parameters
        own, options_of = [p for name, p in given.items() if name != "options"], specs(kind)
        flags = [_parameter(each, spec, hidden=each.name in kind.refuses) for each, spec in options_of]
        first = [p for p in own if p.default is inspect.Parameter.empty]
        after = [p for p in own if p.default is not inspect.Parameter.empty]
        after += [] if "out" in given else [parameter("out", OutOption, Path("out"))]
        after += [parameter("no_figure", NoFigureOption, False)] if files else []
        after += [parameter("strict", StrictOption, False)] if judged else []
        after += PAGES if pages else ()
        if (files or pages) and not any(each.name == "force" for each, _ in options_of):
            after.append(FORCE)

        def call(**values: Any) -> None:
            inputs = {p.name: values[p.name] for p in own}
            with _in_flags(kind):
                options, out = _options(kind, values), values["out"]
                page, pdf = values.get("page", False), values.get("pdf", False)
                check_pdf(pdf, values.get("font"))
                if files or page or pdf:
                    running.check_folder(out)
                if inputs.get("campaign") is None:
                    running.start()
                failed = False
                for result in function(**inputs, options=options):
                    figures = [result.save_figures] * (files and not values["no_figure"])
                    handed = partial(hand_over, result, page=page, pdf=pdf, font=values.get("font"))
                    finish(result, out, figures, [handed] * (page or pdf), files=files)
                    failed = result.short or bool(values.get("strict") and result.doubtful)
                if failed:
                    raise typer.Exit(SHORT)

        call.__doc__ = function.__doc__
        register(function.__name__.removesuffix("_command"), call, [*first, *flags, *after])
        return function

    return hang


@contextmanager
def _in_flags(kind: type[Options]) -> Iterator[None]:
    """Let error messages about options inside this context name their flags."""
    try:
        yield
    except InputError as error:
        raise InputError(renamed(kind, problem) for problem in error.problems) from None


def plain(function: Callable[..., None]) -> Callable[..., None]:
    """Register a function that is no study as a command: its parameters are in typer's form."""
    given = list(inspect.signature(function).parameters.values())
    register(function.__name__, _in_flags(Options)(function), given)
    return function


class _Command(TyperCommand):
    """A command whose help shows the main flags, and with `--help-all` all."""

    def format_options(self, ctx: Any, formatter: Any) -> None:
        brief, main = copy(self), MAIN.get(str(self.name))
        if main and WHOLE not in ctx.meta:
            shown = {*main.split(), *ALWAYS, "help_all"}
            brief.params = [each for each in self.params if each.param_type_name == "argument" or each.name in shown]
        super(_Command, brief).format_options(ctx, formatter)


def _show_all(context: typer.Context, asked: bool) -> None:
    if asked:
        context.meta[WHOLE] = True
        typer.echo(context.get_help())
        raise typer.Exit


HelpAllOption = Annotated[
    bool, typer.Option("--help-all", help="show all options and exit", is_eager=True, callback=_show_all)
]


def register(name: str, function: Callable[..., None], parameters: list[inspect.Parameter]) -> None:
    """Register a function as a command, with the flags that all commands have."""

    def call(context: typer.Context, **values: Any) -> None:
        values.pop("help_all", None)
        how = {name: values.pop(name) for name in ("quiet", "details", "verbose")}
        speech = speaking(as_json=values.pop("json"), force=bool(values.get("force")), **how)
        with speech, running.at_work(str(context.info_name)):
            function(**with_defaults(context, values, kinds))

    common = {"details": DetailsOption, "json": JsonOption, "quiet": QuietOption, "verbose": VerboseOption}
    kinds = {each.name: get_args(each.annotation)[0] for each in parameters}
    every = [each.replace(kind=inspect.Parameter.KEYWORD_ONLY) for each in parameters]
    every += [parameter(name, option, False) for name, option in common.items()]
    every += [parameter("help_all", HelpAllOption, False)] if name in MAIN else []
    ordered = [parameter("context", typer.Context), *every]
    call.__signature__ = inspect.Signature(ordered)  # type: ignore[attr-defined]
    call.__annotations__ = {each.name: each.annotation for each in ordered}
    call.__doc__ = function.__doc__
    app.command(name, cls=_Command, context_settings={"max_content_width": 100})(call)


def offer(
    study: Callable[..., Any], text: str, *, files: bool = True, pages: bool = True, judged: bool = False, **words: Any
) -> None:
    """Register a study as a command: its inputs and options become arguments and flags.

    Args:
        study: the study; its name is the command's.
        text: help of the command.
        files: whether files are written, besides the printed report and the pages.
        pages: whether the result can be written as a page to hand over.
        judged: whether there is a flag that makes a verdict against the data a failure.
        words: inputs that differ from `INPUTS`, in typer's form.
    """
    names = inspect.signature(study).parameters
    kind = get_args(names["options"].annotation)[0]
    main = "campaign" if "campaign" in names else next(iter(names))
    words = INPUTS | ({"arm": ArmOption} if main == "campaign" else {}) | words

    def run(options: Options, **inputs: Any) -> Iterator[Result]:
        if main == "campaign":
            inputs["campaign"], inputs["arm"] = running.read(inputs["campaign"], inputs["arm"])
        shown = {"progress": running.progress} if "progress" in names else {}
        yield study(**inputs, options=options, **shown)

    every = [parameter(name, words[name], *([] if name == main else [None])) for name in names if name in words]
    every.append(parameter("options", kind, None))
    run.__signature__ = inspect.Signature(every)  # type: ignore[attr-defined]
    run.__name__, run.__doc__ = study.__name__, text
    command(kind, files=files, pages=pages, judged=judged)(run)


Save = Callable[[Path], tuple[Path, ...]]
"""Writes files of a result into a folder, and returns their paths."""


def finish(
    result: Any, out: Path, more: Sequence[Save] = (), pages: Sequence[Save] = (), *, files: bool = True
) -> None:
    """Print a result's report, and write its files, and more, into a folder; then its pages, which may still fail."""
    with kept_in(out):
        tell(result)
        output().document = kept_in(out)(result.document)
        if files:
            write(result, out, more)
        if pages:
            write(result, out, pages, files=False)


def write(result: Any, out: Path, more: Sequence[Save] = (), *, files: bool = True) -> None:
    """Write a result's files into a folder, all or none, and print their paths.

    Files of the same name are replaced. If somebody has changed them, or they took long and have other inputs, they get
    a number instead.

    Args:
        result: the result.
        out: the folder.
        more: write further files there.
        files: whether its own files are written.
    """
    with together() as written:
        other = other_inputs(result, out) if files else ""
        own = result.save(out / f"{result.name}{result.suffix}") if files else ()
        paths = (*own, *(path for each in more for path in each(out)))
        kept = keep_earlier(written, out, result.name, False if output().force else bool(other) or None)
    if kept:
        reason = f"a result of other inputs ({other})" if other else "not known to be as ident wrote it"
        output().say(f"kept what was there as {one_line(str(out / kept))}.*: {reason}")
    for path in paths:
        output().wrote(path)


UNIT = re.compile(r"\[(m|mm|s|Hz|deg|%)\]|\bpercent\b")
"""Unit of a number in the help of its flag."""


def _parameter(each: Field[Any], spec: Spec, *, hidden: bool) -> inspect.Parameter:
    """Return the flag of an option in typer's form; help does not offer a hidden one."""
    names = [flag_of(each), *([spec.short] if spec.short else [])]
    kind, default = each.type, each.default
    if spec.read:
        kind, default = (list[str] if spec.repeated else str) | None, spec.text or None
    unit, how = UNIT.search(spec.help), dict[str, Any]()
    if unit and not spec.read and float in (kind, *get_args(kind)):
        how = {"parser": lambda text: _measured(text, names[0], unit[1] or "%"), "metavar": "FLOAT"}
    flag = typer.Option(*names, help=spec.help, show_default=bool(spec.text) or not spec.read, hidden=hidden, **how)
    return parameter(each.name, Annotated[kind, flag], default)


def _measured(text: Any, flag: str, unit: str) -> float:
    """Return a number in a flag's unit, from a text that may have another unit of the same quantity: `0.5mm`."""
    try:
        return float(text)
    except ValueError:
        found = width(text, unit)
    if found is None or found.share != (unit == "%"):
        raise refusal(flag, quoted(text), f"a number [{unit}], or one with another unit", "correct it") from None
    return found.size / (in_si(unit) or (0.01,))[0]


def _options(kind: type[Options], values: dict[str, Any]) -> Options:
    """Return the options from flags; a missing flag means its default."""
    given: dict[str, Any] = {}
    for each, spec in specs(kind):
        value = values[each.name]
        if not spec.read:
            given[each.name] = value
        elif value is not None:
            given[each.name] = spec.read(value, flag_of(each))
    return kind(**given)
