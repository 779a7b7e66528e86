"""The report of a repetition: which numbers differ."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from ident.report.report import Finding, Report, Section, Table, Verdict, cut, short_power
from ident.report.words import counted
from ident.studies.repetition import SAME, Difference

SHOWN_OF_RERUN = 10
"""Differences on the first screen, at most."""


def rerun_sections(repeated: Report, differences: Sequence[Difference], rows: int, *, sampled: bool) -> Report:
    """Return whether the numbers of a result agree with its file.

    Args:
        repeated: report of the repetition itself.
        differences: numbers that differ.
        rows: of its table.
        sampled: whether they may differ by a Monte Carlo error.
    """
    within = "within their Monte Carlo error" if sampled else f"to {short_power(f'{SAME:g}')}"
    subject = f"Repeated: {repeated.subject}"
    if not differences:
        reason = f"{counted(rows, 'row')} of numbers agree{'s' * (rows == 1)} with the file {within}."
        return Report(subject, Verdict("SAME", reason, "good"))
    count = len(differences)
    reason = f"{counted(count, 'number')} do{'es' * (count == 1)} not agree with the file {within}."
    cells = tuple((str(each.row + 1), each.column, _cell(each.before), _cell(each.now)) for each in differences)
    every, hidden = Table("", ("row", "column", "in the file", "now"), cells), count - SHOWN_OF_RERUN
    table = replace(every, rows=cells[:SHOWN_OF_RERUN])
    return Report(
        subject,
        Verdict("DIFFERENT", reason, "bad"),
        (table, *([f"{hidden} more numbers differ."] if hidden > 0 else [])),
        (Finding("inputs and options are those of the file", "compare the versions under `software` in the file"),),
        details=(Section("All differences", (every,)),) if hidden > 0 else (),
    )


def _cell(value: Any) -> str:
    return f"{value:.12g}" if isinstance(value, float) else cut(str(value), 30)
