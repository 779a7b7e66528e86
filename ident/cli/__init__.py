"""The command line: reads, calls, writes. Exit code 2 for bad input, 1 when the model has no answer."""

import sys

import typer

from ident.cli import commands  # noqa: F401  (hangs them on the app)
from ident.cli.app import app
from ident.errors import IdentError, InputError


def main() -> None:
    """Run the command line."""
    try:
        app()
    except InputError as error:
        _stop(error, 2)
    except IdentError as error:
        _stop(error, 1)


def _stop(error: IdentError, code: int) -> None:
    for line in str(error).splitlines():
        typer.echo(f"ident: {line}", err=True)
    sys.exit(code)
