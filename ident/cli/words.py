"""A command for one robot as a task of the fleet's engine."""

from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass
from io import StringIO
from pathlib import Path
from typing import Any

import typer

from ident.cli.app import app
from ident.cli.defaults import FILE
from ident.errors import IdentError, InputError
from ident.files import replace_file
from ident.studies.fleet_tasks import Task, digest, hashed


@dataclass(frozen=True)
class Words(Task):
    """A command for one robot.

    Attributes:
        name: the robot's.
        campaign: its measurements.
        arm: its description.
        words: command and flags, without what the robot is.
        out: folder of the robots' results.
    """

    name: str
    campaign: Path
    arm: Path
    words: tuple[str, ...]
    out: Path

    @property
    def folder(self) -> Path:  # type: ignore[override]
        """Where it is noted what is done."""
        return self.out / ".done"

    @property
    def file(self) -> Path:
        """What is noted of this one: named by the command line, the files that it reads and the program."""
        from ident.programs import environment  # it imports jax

        beside = [path.parent / FILE for path in (self.campaign, self.arm)]
        named = [Path(part) for word in self.line for part in (word, word.partition("=")[2]) if part]
        digests = [digest(path) for path in (self.campaign, self.arm, *beside, *named)]
        return self.folder / f"{hashed([self.name, str(self.out), *self.line, digests, environment()])}.json"

    @property
    def line(self) -> list[str]:
        """The command line."""
        first, *rest = (word.replace("{name}", self.name) for word in self.words)
        own = [str(self.campaign), "--arm", str(self.arm)] if "campaign" in arguments(first) else [str(self.arm)]
        kept = ["--out", str(self.out / self.name)] if "out" in arguments(first) else []
        return [first, *own, *rest, *kept, "--json"]

    def read(self) -> tuple[Any, ...] | None:
        """Return what was noted, if what was printed is still there."""
        return super().read() if (self.out / self.name / "report.txt").is_file() else None

    def results(self) -> tuple[int, str, str]:
        """Run the command; return its status, what was wrong, and its document as JSON."""
        import ident.cli  # noqa: F401  (on a worker no command hangs on the app yet)

        words, document = StringIO(), StringIO()
        status, wrong = 0, ""
        try:
            with redirect_stdout(document), redirect_stderr(words):
                status = app(self.line, standalone_mode=False) or 0
        except IdentError as error:
            status, wrong = 2 if isinstance(error, InputError) else 1, str(error)
        report, text = self.out / self.name / "report.txt", (words.getvalue() + wrong).encode("utf-8")
        replace_file(report, lambda file: file.write(text), make_folders=True)
        return status, wrong, document.getvalue()


def arguments(name: str) -> set[str]:
    """Return the parameters of a command."""
    known = commands()
    return {each.name for each in known[name].params} if name in known else set()


def commands() -> dict[str, Any]:
    """Return all commands, by name."""
    return dict(getattr(typer.main.get_command(app), "commands", {}))
