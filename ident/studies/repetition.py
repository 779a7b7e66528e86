"""Whether a repeated computation gives the same numbers."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

Rows = Sequence[Mapping[str, Any]]

SAME = 1e-9
"""Relative difference due to rounding."""
SMALL = 1e-3
"""Share of a column's largest number below which differences are taken relative to that share."""
ERRORS = 4.0
"""Difference, in Monte Carlo standard errors, up to which two runs of chains count as the same."""


@dataclass(frozen=True)
class Difference:
    """A number of the table that differs.

    Attributes:
        row: index of the row in the table.
        column: name of the column.
        before: value in the file.
        now: new value; None without one.
    """

    row: int
    column: str
    before: Any
    now: Any


def differences(old: Rows, new: Rows, error: Rows = ()) -> Iterator[Difference]:
    """Yield the numbers that differ by more than rounding, or than their Monte Carlo error.

    Args:
        old: rows of a table.
        new: rows of its repetition.
        error: Monte Carlo standard errors of sampled numbers, row by row; empty without any.
    """
    if len(old) != len(new):
        yield Difference(min(len(old), len(new)), "rows", len(old), len(new))
    largest = _largest(old)
    for row, (one, other) in enumerate(zip(old, new, strict=False)):
        for column in one:
            sampled = ERRORS * math.sqrt(2) * error[row].get(column, 0.0) if error else 0.0
            if not _alike(one[column], other.get(column), sampled, SMALL * largest.get(column, 0.0)):
                yield Difference(row, column, one[column], other.get(column))


def _largest(rows: Sequence[Mapping[str, Any]]) -> dict[str, float]:
    """Return the largest magnitude in each column of numbers."""
    numbers: dict[str, float] = {}
    for row in rows:
        for column, value in row.items():
            if _is_number(value) and math.isfinite(value):
                numbers[column] = max(numbers.get(column, 0.0), abs(float(value)))
    return numbers


def _alike(one: Any, other: Any, sampled: float, small: float) -> bool:
    """Whether two cells are the same; differences of numbers below `small` are taken relative to it."""
    if _is_number(one) and _is_number(other):
        close = math.isclose(one, other, rel_tol=SAME, abs_tol=max(SAME * small, sampled))
        return close or str(one) == str(other)  # not a number is what it was
    return bool(one == other)


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)
