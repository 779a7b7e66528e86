"""The command line: reads inputs, calls studies, writes results.

Exit status: 0 done, whatever the data say; 1 the model has no answer; 2 bad input; 3 a computation missed its own
criterion, or with `--strict` the data contradict each other or the model; 130 stopped by Ctrl-C.
"""

import sys
import textwrap

import typer

from ident.cli import commands  # noqa: F401  (they register with the app)
from ident.cli.command import app
from ident.cli.output import FOLDED, status_of
from ident.errors import IdentError, one_line


def main() -> None:
    """Run the command line."""
    try:
        app()
    except IdentError as error:
        for line in str(error).splitlines():
            words = f"ident: {one_line(line)}"  # folded for a terminal; for a script, one line per problem
            typer.echo(textwrap.fill(words, 100, **FOLDED) if sys.stderr.isatty() else words, err=True)
        sys.exit(status_of(error))
