"""What the repetition of a result has shown."""

from collections.abc import Iterator, Sequence
from typing import Any

from ident.assess.repetition import SAME, Difference
from ident.present.text.words import cut, paragraphs

SHOWN = 10
"""Differences that are listed."""


def rerun_report(differences: Sequence[Difference], rows: int, *, sampled: bool) -> str:
    """Return whether the numbers of a result are those of its file.

    Args:
        differences: numbers that are not.
        rows: of its table.
        sampled: whether they may differ by a Monte Carlo error.
    """
    return paragraphs([_verdict(differences, rows, sampled)])


def _verdict(differences: Sequence[Difference], rows: int, sampled: bool) -> Iterator[str]:
    within = "within their Monte Carlo error" if sampled else f"to {SAME:g}"
    if not differences:
        yield f"The same as in the file: {rows} row{'s' * (rows != 1)} of numbers agree {within}."
        return
    count = len(differences)
    yield f"NOT the same as in the file: {count} number{'s do' if count > 1 else ' does'} not agree {within}."
    yield from map(_line, differences[:SHOWN])
    if count > SHOWN:
        yield f"  and {count - SHOWN} more"


def _line(difference: Difference) -> str:
    place = f"row {difference.row + 1}, {cut(difference.column, 24)}"
    return f"  {place:34s} {_cell(difference.before)} in the file, now {_cell(difference.now)}"


def _cell(value: Any) -> str:
    return f"{value:.12g}" if isinstance(value, float) else cut(str(value), 30)
