"""Saved results: report, numbers, options and texts of their inputs; no class of the program."""

import atexit
import hashlib
import math
import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from shutil import rmtree
from tempfile import mkdtemp
from typing import TYPE_CHECKING, Any

from ident.errors import InputError, Problem, refusal, refuse, require
from ident.report.report import Report, text_of
from ident.studies import STUDIES, options_of
from ident.studies.options import Options
from ident.studies.result import Reported, input_of
from ident.text import by_key, one_line, quoted, study_of

if TYPE_CHECKING:
    from ident.arm.arm import Arm
    from ident.identify.fit import CampaignFit
    from ident.identify.values import Draws, Robot, Values

RECORD = ("name", "standard_errors", "fit", "texts", "report")
"""Content of a file besides the JSON output of the command."""


@dataclass(frozen=True)
class Source:
    """An input of a saved result.

    Attributes:
        path: its file; empty without one.
        sha256: of the file's bytes.
        text: its text; None if the result does not store it.
    """

    path: str
    sha256: str
    text: str | None

    @classmethod
    def read(cls, document: Mapping[str, Any], text: Any) -> "Source":
        """Return an input from a record.

        Raises:
            KeyError, TypeError, ValueError: the record is malformed.
        """
        path, sha256 = document["path"], document["sha256"]
        if not (isinstance(path, str) and isinstance(sha256, str) and isinstance(text, str | None)) or "\0" in path:
            raise TypeError
        if text is not None and Path(path).name in ("", ".."):
            raise ValueError
        return cls(path, sha256, text)


class Saved(Reported):
    """A saved result: its numbers are the stored ones, nothing is computed again.

    It prints like the original; each number of its `summary` is an attribute, as `parameters` of a fit. `fitted` is the
    fit of a saved fit, posterior or diagnosis; everything else of a study comes back by `ident.rerun(path).now`.

    Attributes:
        path: the file.
        record: the complete content.
        inputs: its inputs, by name; None for inputs that were not given.
        moved: differences of its fit when evaluated again; empty before, and without differences.
    """

    def __init__(self, path: str | Path, record: Mapping[str, Any]):
        """Take over the content of a file.

        Raises:
            InputError: it is no record of a result.
        """
        from ident.report.document import report_of

        self.path, self.record, self.moved = Path(path).absolute(), record, tuple[str, ...]()
        self.form, self.study = str(record["format"]), study_of(str(record["format"]))
        with self._read():
            self._report, self.name = report_of(record["report"]), str(record["name"])
            self.summary: Mapping[str, Any] = dict(record["summary"])
            self._rows, texts = [dict(row) for row in record["table"]], dict(record["texts"])
            self._errors = [dict(row) for row in record["standard_errors"]]
            if len(self._errors) not in (0, len(self._rows)):
                raise ValueError
            self.inputs = {
                name: None if source is None else Source.read(source, texts.get(name))
                for name, source in record["inputs"].items()
            }
            for details in (True, False):  # unprintable content is no report
                text_of(self._report, details=details, colour=True)
            self._notes = tuple(map(str, record.get("notes", ())))

    @contextmanager
    def _read(self) -> Iterator[None]:
        try:
            yield
        except InputError:
            raise
        except (LookupError, TypeError, ValueError, AttributeError, OverflowError, StopIteration):
            where, expected = one_line(str(self.path)), f"a result of ident {self.study}"
            raise refusal(where, "other contents", expected, "give the file that ident wrote") from None

    def __getattr__(self, name: str) -> Any:
        """Return a number of the summary."""
        known = vars(self)
        if name in known.get("summary", {}):
            return known["summary"][name]
        raise AttributeError(f"a saved {known.get('study', 'result')} has no {name}: see ident.rerun(path).now")

    def __dir__(self) -> list[str]:
        return [*super().__dir__(), *self.summary]

    @property
    def verdict(self) -> Any:
        """Word of the verdict in the report; of a diagnosis its `verdict`, as the live result has it."""
        return self.summary.get("verdict", super().verdict)

    def sections(self) -> Report:
        """Return the stored report of the result."""
        return self._report

    def table(self) -> list[dict[str, Any]]:
        """Return the main numbers as rows, as `Result.table` did; infinite or undefined ones are None."""
        return [dict(row) for row in self._rows]

    def document(self) -> dict[str, Any]:
        """Return the document for programs, as `Result.document` did."""
        return {name: value for name, value in self.record.items() if name not in RECORD}

    def standard_errors(self) -> list[dict[str, float]]:
        """Return the Monte Carlo standard errors [SI] of the sampled numbers of the table, by row, or none."""
        return [{name: math.inf if value is None else value for name, value in row.items()} for row in self._errors]

    @property
    def notes(self) -> tuple[str, ...]:
        """Differences between the arm and its robot description, and of the fit when evaluated again."""
        return *self._notes, *self.moved

    @cached_property
    def options(self) -> Options:
        """The options of the call.

        Raises:
            InputError: options that this version of ident does not know, or out of its ranges.
        """
        kind: type[Options] = options_of(self.study)
        with self._read():
            try:
                return kind.restored(self.record["options"])
            except InputError as error:
                got, where = str(error.problems[0]), one_line(str(self.path))
                raise refusal(where, got, "options of this version of ident", "update ident") from None

    @cached_property
    def fitted(self) -> "CampaignFit":
        """The fit of the result, or the fit it started from: posed again, and evaluated at the stored values.

        Raises:
            InputError: it has none, or an input is neither on disk nor in the file.
        """
        from ident.identify.stored import MOVED, fit_of, moved
        from ident.studies.shared import ProblemOptions, as_campaign, as_file

        state, options = self.record.get("fit"), self.options
        if state is None or not isinstance(options, ProblemOptions):
            got, expected = f"a result of {quoted(self.study)}", "one of fit, sample or diagnose"
            raise refusal(one_line(str(self.path)), got, expected, "give that")
        with self._read():
            files = files_of(self.inputs, self.path.parent).paths
            arm, campaign = as_file(files["arm"], options.soft_base), as_campaign(files["campaign"])
            fit = fit_of(arm.arm, campaign, options.unknowns_of(arm), state)
            if (change := moved(fit, state)) > MOVED:
                self.moved = (f"{one_line(self.path.name)}: its predictions, evaluated again, differ by {change:.1g}",)
            return fit

    def values_of(self, arm: "Arm") -> "tuple[Values, Robot, float | None]":
        """Return the fitted values [SI] of an arm, see `FitResult.values_of`."""
        from ident.studies.result_values import read_fit

        return read_fit(self.path, arm, self.record)

    def posterior_draws(self) -> "Draws":
        """Return the draws of a posterior, see `SampleResult.posterior_draws`."""
        from ident.studies.result_values import read_posterior

        return read_posterior(self.path)


def reading(result: Reported) -> AbstractContextManager[None]:
    """Refuse the file of a saved result if reading its numbers fails inside this context."""
    return result._read() if isinstance(result, Saved) else nullcontext()


def load(path: str | Path) -> Saved:
    """Return a saved result of a study.

    Args:
        path: a `.json` or `.nc` file of `Result.save` or of a command.

    Raises:
        InputError: no result file, or of another version of ident.
    """
    from ident.report.document import EXPECTED, read_record

    record = read_record(path)
    got, remedy = f"the format {quoted(record['format'])}", "give the file that ident wrote"
    require(study_of(record["format"]) in STUDIES, one_line(str(path)), got, EXPECTED, remedy)
    return Saved(path, record)


# -------- Inputs
# The input files of a result, in their original state.


@dataclass(frozen=True)
class Files:
    """The files to repeat a result.

    Attributes:
        paths: by the name of the input.
        restored: names of files written from the stored texts.
    """

    paths: Mapping[str, Path]
    restored: tuple[str, ...] = ()


def files_of(inputs: Mapping[str, Any], beside: Path) -> Files:
    """Return the input files of a result: with the same contents, or else written from its stored texts.

    They are searched at their recorded paths, in a folder, and in the present one; an input and its companion files in
    one place. Files from stored texts lie in a folder of their own until the process ends.

    Args:
        inputs: with `path` and `sha256`, and perhaps `text`, by name; None for inputs that were not given.
        beside: the folder, usually that of the result.

    Raises:
        InputError: an input is neither on disk nor in the result; all such inputs are listed.
    """
    groups = by_key((input_of(name), (name, source)) for name, source in inputs.items() if source is not None)
    found, restored, problems = dict[str, Path](), list[str](), list[Problem]()
    places = ("", str(beside), ".")
    for group, sources in ((group, dict(own)) for group, own in groups.items()):
        same = [place for place in places if all(_is_there(place, each) for each in sources.values())]
        if same:
            found[group] = _in(same[0], sources[group])
        elif all(getattr(each, "text", None) is not None for each in sources.values()):
            folder = Path(mkdtemp(prefix="ident-"))
            atexit.register(rmtree, folder, ignore_errors=True)
            for each in sources.values():
                (folder / Path(each.path).name).write_bytes(each.text.encode("utf-8"))
            found[group] = folder / Path(sources[group].path).name
            restored.append(group)
        else:
            there = {name for name, each in sources.items() if any(_is_there(place, each) for place in places)}
            problems += [_missing(name, each, places) for name, each in sources.items() if name not in there]
    refuse(problems)
    return Files(found, tuple(restored))


def _in(place: str, source: Any) -> Path:
    return Path(place) / Path(source.path).name if place else Path(source.path)


def _is_there(place: str, source: Any) -> bool:
    path = _in(place, source)
    return bool(source.path) and os.path.isfile(path) and hashlib.sha256(path.read_bytes()).hexdigest() == source.sha256


def _missing(name: str, source: Any, places: Sequence[str]) -> Problem:
    if not source.path:
        return Problem(name, "a value that came from no file", "a file to repeat it from", "repeat it in Python")
    expected = f"the file with the SHA-256 {source.sha256[:12]}..., the {name}"
    there = [path for place in places if os.path.isfile(path := _in(place, source))]
    if there:
        return Problem(one_line(str(there[0])), "a file that has changed since", expected, "put back the one it was")
    return Problem(one_line(str(source.path)), "no such file", expected, "put it there, or beside the result")
