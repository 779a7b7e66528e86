"""The command `ident each`: another command for each robot of a folder, on the engine of `ident fleet`."""

import json
import textwrap
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ident.cli import running
from ident.cli.command import SHORT, OutOption, command
from ident.cli.output import output
from ident.errors import InputError, Problem
from ident.files import replace_file
from ident.studies.fleet import EngineOptions, robots_in
from ident.text import did_you_mean, one_line

if TYPE_CHECKING:
    from ident.cli.words import Words

NOT_FOR_EACH = ("each", "fleet", "new", "compare", "modal", "show", "rerun")
"""Commands that are about no single robot, or about no campaign and arm."""
WIDTH = 100
FOLDED: dict[str, Any] = {"subsequent_indent": " " * 35, "break_long_words": False, "break_on_hyphens": False}


@command(EngineOptions)
def each_command(
    robots: Annotated[Path, typer.Argument(help="folder with a CSV file, or a folder with one, for each robot")],
    words: Annotated[list[str], typer.Argument(help="-- and then a command with its flags, without the robot's files")],
    options: EngineOptions,
    arm: Annotated[
        Path | None, typer.Option("--arm", help="arm of robots whose folder has none; default: arm.toml beside them")
    ] = None,
    out: OutOption = Path("out"),
) -> None:
    """Run a command for each robot of a fleet, as ident each ROBOTS -- sample --ess 1000.

    The command gets the robot's campaign and arm, or its arm alone; {name} in its flags is the robot's name. What it
    writes and prints goes into ROBOTS.COMMAND/NAME in the folder given by --out, the main numbers of all robots into
    ROBOTS.COMMAND.json. A robot that is done is not done again. Exit status 3 where it failed for a robot.
    """
    from ident.cli.words import Words
    from ident.studies.fleet_engine import Engine

    label = f"{robots.absolute().name}.{words[0]}"
    tasks = [Words(*files, tuple(words), out / label) for files in sorted(robots_in(robots, arm))]
    _check(tasks[0])
    ended: dict[str, tuple[int, str, str]] = {}
    steps = running.progress("robots", len(tasks))(range(len(tasks)))
    try:
        with Engine(options) as engine:
            for _, (task, reason) in zip(steps, engine.done(tasks), strict=True):
                ended[task.name] = task.read() or (SHORT, reason or "its result can not be read", "{}")
    except KeyboardInterrupt:
        typer.echo(f"stopped; kept {out / label}: the same command goes on from there", err=True)
        raise typer.Exit(130) from None
    rows = [_row(task.name, *ended[task.name]) for task in tasks]
    output().document = lambda: {"robots": rows}
    _say(rows)
    kept = out / f"{label}.json"
    replace_file(kept, lambda file: file.write(json.dumps(rows, indent=1).encode("utf-8")), make_folders=True)
    output().wrote(kept)
    output().say(f"kept {out / label}: what is done is not done again")
    if any(row["status"] for row in rows):
        raise typer.Exit(SHORT)


def _check(task: "Words") -> None:
    """Refuse words that are no command for a robot, before any work.

    Raises:
        InputError: no such command, or not its flags.
    """
    from ident.cli.words import commands

    first, known = task.words[0], sorted({*commands()} - {*NOT_FOR_EACH})
    if first not in known:
        raise InputError(Problem("", f"'{first}'", "a command for one robot", did_you_mean(first, known, "see --help")))
    own = {"--out", "-o", "--arm", "--json", "--quiet"}
    for word in task.words:
        if word.partition("=")[0] in own:
            raise InputError(Problem("", f"{word} of {first}", "what is each robot's", "leave it out"))
    try:
        commands()[first].make_context(first, task.line[1:])
    except Exception as error:
        if not (said := getattr(error, "format_message", None)):  # of typer's own click, or another one's
            raise
        raise InputError(Problem(f"ident {first}", said(), "its flags", f"see ident {first} --help")) from None


def _row(name: str, status: int, error: str, document: str) -> dict[str, Any]:
    try:
        whole = json.loads(document)
    except ValueError:
        whole = {}
    return {**whole, "robot": name, "status": status, "error": error}


def _say(rows: list[dict[str, Any]]) -> None:
    failed = sum(bool(row["status"]) for row in rows)
    output().say(f"{len(rows)} robots" + (f", {failed} of them with a status other than 0" if failed else ""))
    for row in rows:
        line = f"  {one_line(row['robot'])[:30]:30s}  {row['status']}  {row['error'] or _main(row)}"
        output().say(textwrap.fill(line, WIDTH, **FOLDED).rstrip())


def _main(row: dict[str, Any]) -> str:
    """Return the main numbers that are but numbers or words."""
    plain = {k: v for k, v in row.get("summary", {}).items() if isinstance(v, bool | int | float | str)}
    return "; ".join(f"{name} {_short(value)}" for name, value in plain.items())


def _short(value: bool | int | float | str) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value).replace("\n", " ")
