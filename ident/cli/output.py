"""The program's app, and its output: for people, or as one JSON document."""

import json
import logging
import os
import shutil
import sys
import textwrap
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer.core import TyperGroup

from ident import __version__
from ident.errors import ConvergenceError, IdentError, InputError, one_line
from ident.studies import MODULES

if TYPE_CHECKING:
    from ident.studies.result import Reported

# -------- App
# The program `ident` itself: commands register with `app`.

LABELS = {
    "look": "Look at an arm",
    "measuring": "Measure",
    "stiffness": "Stiffness of the joints",
    "working": "Vibration at work",
    "cause": "Its cause",
    "cure": "Its cure",
    "": "Else",
}
"""Heads of the commands in `ident --help`, by the folder of their study."""
PLACES = {**{name: module.split(".")[2] for name, module in MODULES.items()}, "new": "look"}
"""The folder of each command's study; of `new`, which has no report, too."""


class ByStep(TyperGroup):
    """The commands by the steps of a user's way."""

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """Write a section for each step, and one for commands without a study of their own."""
        rows = [(name, each.get_short_help_str(formatter.width)) for name, each in self.commands.items()]
        for step, label in LABELS.items():
            with formatter.section(label):
                formatter.write_dl([row for row in rows if PLACES.get(row[0], "") == step])


app = typer.Typer(
    cls=ByStep,
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


# -------- Output
# Output of a command: words for people, or one JSON document for programs.
#
# Words go to standard output; with `--json` they go to standard error, and with `--quiet` nowhere. Errors always go
# to standard error; with `--json` they are a document as well.

FOLDED: dict[str, Any] = {"subsequent_indent": "    ", "break_long_words": False, "break_on_hyphens": False}
JsonOption = Annotated[bool, typer.Option("--json", help="print the result as JSON; words go to standard error")]
DetailsOption = Annotated[bool, typer.Option("--details", help="print all that there is to say, not one screen")]
QuietOption = Annotated[bool, typer.Option("--quiet", help="print no words but errors")]
VerboseOption = Annotated[
    bool, typer.Option("--verbose", "-v", help="log what is read, compiled and written, with times, to standard error")
]
SHORT = 3
"""Exit status if a computation missed its own criterion or, with `--strict`, the data contradict each other."""


def status_of(error: IdentError) -> int:
    """Return the exit status of an error."""
    return 2 if isinstance(error, InputError) else SHORT if isinstance(error, ConvergenceError) else 1


@dataclass
class Output:
    """Output mode of one command, and its document for programs.

    Attributes:
        json: whether a document is printed at the end.
        quiet: whether words are suppressed.
        details: whether reports are printed with their details.
        force: whether existing files are always replaced.
        document: the result for programs, made on request.
        written: files.
    """

    json: bool = False
    quiet: bool = False
    details: bool = False
    force: bool = False
    document: Callable[[], Mapping[str, Any]] = dict
    written: list[str] = field(default_factory=list)

    def say(self, text: str = "", *, nl: bool = True) -> None:
        """Print words."""
        if not self.quiet:
            typer.echo(text, nl=nl, err=self.json)

    def wrote(self, path: Path) -> None:
        """Print the path of a written file."""
        self.written.append(str(path))
        self.say(f"wrote {one_line(str(path))}")


SPOKEN: ContextVar[Output] = ContextVar("SPOKEN")
"""Output mode of the present command."""


def output() -> Output:
    """Return the output mode of the present command."""
    return SPOKEN.get(Output())


@contextmanager
def speaking(
    *, as_json: bool, quiet: bool, details: bool = False, verbose: bool = False, force: bool = False
) -> Iterator[None]:
    """Set the output mode inside this context; at the end, for any exit status, print the document if requested."""
    log, lines = logging.getLogger("ident"), logging.StreamHandler()
    level = log.level
    lines.setFormatter(logging.Formatter("%(asctime)s %(name)s: %(message)s"))
    if verbose:
        log.addHandler(lines)
        log.setLevel(logging.INFO)
    spoken = Output(as_json, quiet, details, force)
    token = SPOKEN.set(spoken)
    end: typer.Exit | None = None
    try:
        yield
    except typer.Exit as stop:
        end = stop
    except IdentError as error:
        if as_json:
            typer.echo(json.dumps({"error": str(error).splitlines(), "status": status_of(error)}))
        raise
    finally:
        SPOKEN.reset(token)
        log.removeHandler(lines)
        log.setLevel(level)
    if as_json:
        document = {**spoken.document(), "written": spoken.written, "status": end.exit_code if end else 0}
        typer.echo(json.dumps(document, allow_nan=False))
    if end:
        raise end


def tell(result: "Reported") -> None:
    """Print notes on differences between arm and robot description, and a result's report at terminal width.

    The result also becomes the command's document for programs.
    """
    spoken = output()
    terminal = (sys.stderr if spoken.json else sys.stdout).isatty()
    width = max(60, min(100, shutil.get_terminal_size().columns)) if terminal else 100
    shown = result.notes if spoken.details else result.notes[:1]
    more = f" (and {len(result.notes) - 1} more: --details)" if len(shown) < len(result.notes) else ""
    for note in shown:
        spoken.say(textwrap.fill(f"NOTE: {one_line(note)}{more}", width, **FOLDED))
    colour = terminal and not os.environ.get("NO_COLOR")
    spoken.say(result.report(details=spoken.details, width=width, colour=colour), nl=False)
    spoken.document = result.document
