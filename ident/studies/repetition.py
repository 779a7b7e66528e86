"""Whether a repeated computation has come to the same numbers."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

Rows = Sequence[Mapping[str, Any]]

SAME = 1e-9
"""Relative difference that rounding makes."""
SMALL = 1e-3
"""Share of the largest number of its column below which a number's difference is relative to that."""
ERRORS = 4.0
"""Monte Carlo standard errors of a difference up to which two runs of chains count as the same."""


@dataclass(frozen=True)
class Difference:
    """A number of the table that has come out otherwise.

    Attributes:
        row: place of the row in the table.
        column: name of the column.
        before: what the file has.
        now: what has come out; None where there is no such number.
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
        error: Monte Carlo standard errors of the numbers that were sampled, row by row; nothing where none was.
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
    """Tell whether two cells are the same; numbers smaller than `small` are compared to that."""
    if _is_number(one) and _is_number(other):
        if not (math.isfinite(one) and math.isfinite(other)):
            return str(one) == str(other)
        return bool(abs(one - other) <= max(SAME * max(abs(one), abs(other), small), sampled))
    return bool(one == other)


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)
