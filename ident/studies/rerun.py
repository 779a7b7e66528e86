"""Repeat the study of a result file, and report whether the numbers are the same."""

import inspect
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ident.report.report import WIDTH, Report
from ident.studies import module_of
from ident.studies.repetition import Difference, differences
from ident.studies.result import Progress, Reported, Result, silent
from ident.studies.saved import Saved, files_of, load, reading
from ident.text import one_line


@dataclass(frozen=True, repr=False, eq=False)
class Rerun(Reported):
    """A result and its repetition.

    Attributes:
        before: the result in the file.
        now: the result of the same study, with the same inputs and options.
        differences: numbers that differ by more than rounding or, for chains, by more than their Monte Carlo error.
        restored: missing or changed inputs, taken from the texts in the file.
    """

    before: Saved
    now: Result
    differences: tuple[Difference, ...]
    restored: tuple[str, ...] = ()

    @property
    def same(self) -> bool:
        """Whether all numbers are the same."""
        return not self.differences

    @property
    def notes(self) -> tuple[str, ...]:
        """Changed or missing inputs, and differences between the arm and its robot description."""
        inputs = (self.before.inputs[name] for name in self.restored)
        paths = (one_line(source.path) for source in inputs if source)
        return *(f"{path} is not as it was: repeated from its text in the result" for path in paths), *self.now.notes

    def sections(self) -> Report:
        """Return whether the numbers are the same, and the differences."""
        from ident.studies.rerun_report import rerun_sections

        rows, sampled = len(self.now.table()), bool(self.before.standard_errors())
        return rerun_sections(self.now.sections(), self.differences, rows, sampled=sampled)

    def report(self, *, details: bool = False, width: int = WIDTH, colour: bool = False) -> str:
        """Return the text that `ident rerun` prints: with details the whole repeated report, then the answer."""
        repeated = self.now.report(details=True, width=width, colour=colour) + "\n" if details else ""
        return repeated + super().report(details=details, width=width, colour=colour)

    def document(self) -> dict[str, Any]:
        """Return for programs the repeated result, whether it is the same, and the differences."""
        from ident.report.document import plain

        return {**self.now.document(), "same": self.same, "differences": plain(list(self.differences))}


def rerun(path: str | Path, *, folder: str | Path | None = None, progress: Progress = silent) -> Rerun:
    """Repeat the study of a result file with its inputs and options, and compare the numbers.

    Inputs are found by their hash: at their recorded path, in the folder of the file, or in the present folder; missing
    or changed arms and campaigns are taken from the texts in the file.

    Args:
        path: a file of `Result.save` or of a command.
        folder: long studies store finished parts here, so that a call after an interruption resumes; it stays.
        progress: shows progress.

    Raises:
        InputError: no result, or an input is missing or has changed.
        ModelError: see the study.
    """
    from ident.report.document import plain

    before = load(path)
    module = module_of(before.study)
    kind: type[Result] = getattr(module, f"{before.study.capitalize()}Result")
    function = getattr(module, before.study)
    wanted = inspect.signature(function).parameters
    more: dict[str, Any] = {"progress": progress, "folder": folder}
    more = {name: value for name, value in more.items() if name in wanted}
    files = files_of(before.inputs, Path(path).absolute().parent)
    with reading(before):
        inputs = kind.arguments(files.paths, before.summary)
        inspect.signature(function).bind(**inputs)
    now: Result = function(**inputs, options=before.options, **more)
    with reading(before):
        different = tuple(differences(before.table(), plain(now.table()), before.standard_errors()))
    return Rerun(before, now, different, files.restored)
