"""Repeat what a result file records, and say whether the numbers are the same."""

import hashlib
import importlib
import inspect
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ident.assess.repetition import Difference, differences
from ident.errors import InputError, Problem
from ident.present.report import WIDTH, Report
from ident.studies.result import BESIDE, Progress, Reported, Result, load, silent, study_of
from ident.text import one_line


@dataclass(frozen=True, repr=False, eq=False)
class Rerun(Reported):
    """A result and its repetition.

    Attributes:
        before: the result of the file.
        now: the result of the same study, on the same inputs, by the same options.
        differences: numbers that differ by more than rounding or, of chains, by more than their Monte Carlo error.
    """

    before: Result
    now: Result
    differences: tuple[Difference, ...]

    @property
    def same(self) -> bool:
        """Whether all numbers are the same."""
        return not self.differences

    @property
    def notes(self) -> tuple[str, ...]:
        """Where the arm is not what its robot description says."""
        return self.now.notes

    def sections(self) -> Report:
        """Return whether the numbers are the same, and where not."""
        from ident.present.export import rerun_sections

        rows, sampled = len(self.now.table()), bool(self.before.standard_errors())
        return rerun_sections(self.now.sections(), self.differences, rows, sampled=sampled)

    def report(self, *, details: bool = False, width: int = WIDTH, colour: bool = False) -> str:
        """Return the text that `ident rerun` prints: with details the whole repeated report, then the answer."""
        repeated = self.now.report(details=True, width=width, colour=colour) + "\n" if details else ""
        return repeated + super().report(details=details, width=width, colour=colour)

    def document(self) -> dict[str, Any]:
        """Return for programs the repeated result, whether it is the same, and where not."""
        from ident.present.files.document import plain

        return {**self.now.document(), "same": self.same, "differences": plain(list(self.differences))}


def rerun(path: str | Path, *, folder: str | Path | None = None, progress: Progress = silent) -> Rerun:
    """Repeat what a result file records: its study, on its inputs, by its options; and compare the numbers.

    Inputs are found by their hash: where the file says that they were, beside it, or in the present folder.

    Args:
        path: a file of `Result.save` or of a command.
        folder: where long studies keep what is finished, so that a call after an interruption goes on; it stays.
        progress: shows how far it is.

    Raises:
        InputError: no result, or an input of it is not found or has changed.
        ModelError: see the study.
    """
    before = load(path)
    study = study_of(before.form)
    function = getattr(importlib.import_module(f"ident.studies.{study}"), study)
    wanted = inspect.signature(function).parameters
    files = found(before, Path(path).absolute().parent)
    inputs = {name: file for name, file in files.items() if not name.endswith(tuple(f"'s {word}" for word in BESIDE))}
    more: dict[str, Any] = {"progress": progress, "folder": folder}
    more = {name: value for name, value in more.items() if name in wanted}
    now = function(**before.arguments(inputs), options=vars(before)["options"], **more)
    return Rerun(before, now, tuple(differences(before.table(), now.table(), before.standard_errors())))


def found(result: Result, beside: Path) -> dict[str, Path]:
    """Return the files that a result was made from, by the names under which its study takes them.

    Raises:
        InputError: one is not there, or none has the hash that was recorded; all are listed.
    """
    files: dict[str, Path] = {}
    problems = []
    for name, source in result.inputs.items():
        if source is None:
            continue
        places = [Path(source.path), beside / Path(source.path).name, Path(Path(source.path).name)]
        there = [place for place in dict.fromkeys(places) if source.path and os.path.isfile(place)]
        match = next((place for place in there if _sha256(place) == source.sha256), None)
        if match is not None:
            files[name] = match
        else:
            problems.append(_missing(name, source, there))
    if problems:
        raise InputError(problems)
    return files


def _missing(name: str, source: Any, there: Sequence[Path]) -> Problem:
    if not source.path:
        return Problem(name, "a value that came from no file", "a file to repeat it from", "repeat it in Python")
    where, expected = one_line(str(source.path)), f"the file with the SHA-256 {source.sha256[:12]}..."
    if not there:
        return Problem(where, "no such file", f"{expected}, the {name}", "put it there, or beside the result")
    where = one_line(str(there[0]))
    return Problem(where, "a file that has changed since", f"{expected}, the {name}", "put back the one it was")


def _sha256(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()
