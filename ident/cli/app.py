"""The program `ident` itself: its commands hang on `app`."""

from typing import Annotated

import typer

from ident import __version__

app = typer.Typer(
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    help="How stiff is each joint of a robot arm? ident fits joint stiffnesses to measured natural frequencies "
    "and static deflections, and says how far each one can be trusted.",
)


def _print_version(asked: bool) -> None:
    if asked:
        typer.echo(__version__)
        raise typer.Exit


@app.callback()
def _root(
    version: Annotated[
        bool, typer.Option("--version", help="print the version and stop", callback=_print_version, is_eager=True)
    ] = False,
) -> None:
    """Options of the program itself."""
