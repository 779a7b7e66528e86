"""Bind saved results into one page: a first page to sign, the results in the order of the way, their provenance."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from glob import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ident.errors import every, require
from ident.report.report import Report, Table
from ident.studies import MODULES, STEPS
from ident.studies.result import Reported
from ident.studies.saved import Saved, load, reading

if TYPE_CHECKING:
    from ident.report.page import Page, Picture, Section

LABELS = dict(zip(STEPS, ("Arm", "Measured", "Stiffness", "Vibration", "Cause", "Remedy"), strict=True))
"""What a result stands for on the first page, by its step."""
LATER = 60.0
"""Seconds that a figure may be older than its result: both are of one call."""


@dataclass(frozen=True, repr=False, eq=False)
class Bound(Reported):
    """Several saved results as one page.

    Attributes:
        results: in the order of a user's way.
        title: of the page.
        signed: lines of the first page, each with its label; an empty one is filled in by hand.
        logo: above the title.
        details: whether the page has the results' details.
        name: base name of the files.
    """

    results: tuple[Saved, ...]
    title: str
    signed: tuple[tuple[str, str], ...]
    logo: "Picture | None" = None
    details: bool = False
    name: str = "report"

    @property
    def decisive(self) -> Saved:
        """The result whose verdict counts: a diagnosis, or else the last one of the way that judges."""
        judging = [each for each in self.results if each.sections().verdict] or list(self.results)
        return next((each for each in judging if each.study == "diagnose"), judging[-1])

    def sections(self) -> Report:
        """Return the verdict that counts, and a row for each result."""
        rows = tuple((_label(each), _flat(each).subject, _judged(each.sections())) for each in self.results)
        return Report(self.title, self.decisive.sections().verdict, (Table("", ("", "result", "verdict"), rows),))

    def document(self) -> dict[str, Any]:
        """Return for programs the verdict that counts, and the documents of the results."""
        return {**self.sections().judged, "results": [each.document() for each in self.results]}

    def handout(self) -> "Page":
        """Return the page."""
        from ident.report.handout import INPUTS, inputs_table, named_only, summary_of
        from ident.report.page import Page, provenance

        parts = {each: named_only(_flat(each), each.record) for each in self.results}
        decisive, _ = parts[self.decisive]
        rest = ((_label(each), report) for each, (report, _) in parts.items() if report is not decisive)
        others = ((label, f"{report.subject}: {_judged(report)}") for label, report in rest)
        return Page(
            self.title,
            f"{decisive.subject}; {str(self.decisive.record['created'])[:10]}",
            decisive.verdict,
            (*(pair for pair in summary_of(decisive) if pair[0] != "Caution"), *others),
            tuple(section for each, (report, _) in parts.items() for section in self._sections(each, report)),
            Table("Inputs", INPUTS, tuple({row: 0 for _, head in parts.values() for row in inputs_table(head).rows})),
            tuple((each.path.name, ", ".join(map(" ".join, provenance(head)))) for each, (_, head) in parts.items()),
            self.signed,
            self.logo,
        )

    def _sections(self, result: Saved, report: Report) -> "Iterator[Section]":
        """Yield a result: its first screen and figures, and its details."""
        from ident.report.handout import sections_of, summary_of
        from ident.report.page import picture_in

        stem, since = result.path.stem, result.path.stat().st_mtime - LATER
        files = [result.path.with_name(f"{stem}.png"), *sorted(result.path.parent.glob(f"{escape(stem)}.[!0-9]*.png"))]
        figures = [picture_in(file, file.stem) for file in files if file.is_file() and file.stat().st_mtime > since]
        answer, *details = sections_of(replace(report, next=""), figures)
        words = [_judged(report), *(f"{label}: {text}" for label, text in summary_of(report))]
        yield replace(answer, title=report.subject, parts=(*words, *answer.parts))
        yield from details if self.details else ()


def _label(result: Saved) -> str:
    return LABELS[MODULES[result.study].split(".")[2]]


def _flat(result: Saved) -> Report:
    return replace(result.sections(), subject=" ".join(result.sections().subject.split()))


def _judged(report: Report) -> str:
    return f"{report.verdict.word}. {report.verdict.reason}" if report.verdict else "judges nothing"


def bind(
    results: Sequence[str | Path],
    *,
    title: str = "Report",
    signed: Mapping[str, str] | None = None,
    logo: str | Path | None = None,
    details: bool = False,
) -> Bound:
    """Bind saved results into one page to hand over, with the figures in their folders.

    Args:
        results: files of `Result.save` or of commands.
        title: of the page.
        signed: lines of the first page by label, as {"Customer": "ACME"}; an empty one is filled in by hand.
        logo: PNG or JPEG image.
        details: whether the page has the results' details.

    Raises:
        InputError: files that are no results, or no image.
    """
    from ident.report.page import picture_in, provenance

    require(results, "results", "none", "at least one saved result", "name their files")
    ordered = sorted(every(load, dict.fromkeys(map(Path, results))), key=lambda each: list(MODULES).index(each.study))
    for each in ordered:
        with reading(each):
            provenance(each.record)
    mark = picture_in(Path(logo), "Logo", 800) if logo else None
    return Bound(tuple(ordered), title, tuple((signed or {}).items()), mark, details)
