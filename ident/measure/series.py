"""Columns of numbers over time, each with its unit in the header: what logs and traces have in common."""

import hashlib
import math
import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float

from ident.errors import InputError, Problem
from ident.measure.table import Findings, Record, decimal_mark, misfit, read_records, sniff_delimiter, table_text
from ident.measure.text import parse_number
from ident.text import LONGEST_QUOTE, nearest, one_line
from ident.units import QUANTITIES, si_factor

TIME = "time"
"""Name of the column that every such file has."""

EXAMPLES = {"time": "s", "angle": "deg", "length": "mm", "acceleration": "m/s^2"}
"""A unit of each quantity, for messages."""

MOST = 5
"""Problems of one kind that are listed one by one; a column of bad cells is one mistake, not ten thousand."""

STEPS = (1e-9, 1e9)
"""Steps of time [s] that a recording can have: a nanosecond to thirty years."""

_HEADER = re.compile(r"(?P<name>[^\[\]]*?)\s*(?:\[(?P<unit>[^\]]*)\])?")


@dataclass(frozen=True)
class Column:
    """One column in SI units.

    Attributes:
        name: as it was asked for.
        quantity: the quantity that its unit measures, a name in `QUANTITIES`.
        unit: the unit as written in the header.
        values: (T,) [SI] NaN where a cell could not be read.
    """

    name: str
    quantity: str
    unit: str
    values: Float[np.ndarray, " T"]


@dataclass(frozen=True)
class Series:
    """The columns that could be read; what could not is among the findings.

    Attributes:
        file: the file's name, for messages.
        sha256: hash of the file's bytes.
        header: place of the header, `file:row`.
        where: (T,) place of each row.
        columns: by name, the time among them, in the order they were asked for.
        at_fault: names of columns whose header cell can't be read.
        ignored: names of further columns as written in the header.
    """

    file: str
    sha256: str
    header: str
    where: tuple[str, ...]
    columns: Mapping[str, Column]
    at_fault: frozenset[str]
    ignored: tuple[str, ...]

    def __contains__(self, name: str) -> bool:
        return name in self.columns

    def __getitem__(self, name: str) -> Float[np.ndarray, " T"]:
        return self.columns[name].values


def parse_series(
    data: bytes, path: str | Path, wanted: Mapping[str, tuple[str, ...]], rows: int, findings: Findings
) -> Series:
    """Read time and the wanted columns from the bytes of a CSV file, and check that time increases.

    Args:
        data: the bytes; UTF-8, columns separated by comma, semicolon or tab, comments after `#`.
        path: names the file in messages.
        wanted: the quantities that each column may have, by the column's name, which may be written in either case.
        rows: the fewest rows that will do.
        findings: where problems are put; reading goes on.

    Returns:
        What could be read.
    """
    file = one_line(str(path))
    text = table_text(data, file)
    delimiter = sniff_delimiter(text, lambda name: _split(name)[0].lower() == TIME or name.endswith("]"))
    records = list(read_records(text, delimiter, file, findings))
    if len(records) < 2:
        expected = "a header and a row for each time"
        raise InputError(
            [*findings, Problem(file, "only one row" if records else "no row", expected, "check the file")]
        )
    where, header = records[0]
    places = _places(where, header, {TIME: ("time",), **wanted}, findings)
    fitting = _fitting(records[1:], len(header), delimiter, file, findings)
    columns = _columns(fitting, places, decimal_mark(delimiter, _cells(fitting, places)), file, findings)
    used = {place.index for place in places}
    ignored = tuple(cell for index, cell in enumerate(header) if index not in used)
    at_fault = frozenset(place.name for place in places if place.factor is None)
    sha256, rows_at = hashlib.sha256(data).hexdigest(), tuple(w for w, _ in fitting)
    series = Series(file, sha256, where, rows_at, columns, at_fault, ignored)
    findings += few(_time_problems(series), file)
    given = len(records) - 1
    if given < rows:
        got = f"{given} row{'s' if given > 1 else ''}"
        findings.append(Problem(file, got, f"at least {rows}", "give a longer recording"))
    return series


def missing_column(where: str, name: str, quantity: str, header: Iterable[str]) -> Problem:
    """Return the problem of a column that is not there; a column of like name is suggested."""
    expected = f"a column '{name} [{EXAMPLES[quantity]}]'"
    alike = nearest(name, (_split(cell)[0] for cell in header))
    remedy = f"rename {one_line(alike[:LONGEST_QUOTE])}" if alike else "add the column"
    return Problem(where, "no such column", expected, remedy, name)


def few(problems: Iterable[Problem], file: str) -> list[Problem]:
    """Return the first `MOST` problems of one kind, and how many more there are."""
    every = list(problems)
    rest = len(every) - MOST
    if rest <= 0:
        return every
    got = f"{rest} more such row{'s' if rest > 1 else ''}"
    return [*every[:MOST], Problem(file, got, "none", "mend them likewise", every[0].column)]


@dataclass(frozen=True)
class _Place:
    """Where a column is and what its cells mean; the factor is None where the header is at fault."""

    index: int
    name: str
    quantity: str
    unit: str
    factor: float | None


def _split(cell: str) -> tuple[str, str]:
    """Split a header cell into name and unit."""
    match = _HEADER.fullmatch(cell)
    return (match["name"], (match["unit"] or "").strip()) if match else (cell, "")


def _places(where: str, header: list[str], wanted: Mapping[str, tuple[str, ...]], findings: Findings) -> list[_Place]:
    places = []
    for name, quantities in wanted.items():
        indices = [index for index, cell in enumerate(header) if _split(cell)[0].lower() == name.lower()]
        if len(indices) > 1:
            findings.append(Problem(where, f"the column {len(indices)} times", "it once", "remove or rename one", name))
        if indices:
            unit = _split(header[indices[0]])[1]
            measured = findings.attempt(where, name, _measured, unit, name, quantities)
            quantity, factor = measured or (quantities[0], None)
            places += [_Place(index, name, quantity, unit, factor) for index in indices]
        elif name == TIME:
            findings.append(missing_column(where, TIME, "time", header))
    return places


def _measured(unit: str, name: str, quantities: tuple[str, ...]) -> tuple[str, float]:
    """Return which of the quantities a unit measures, and its factor to SI."""
    expected = " or ".join(QUANTITIES[quantity].expected for quantity in quantities)
    if not unit:
        remedy = "write the unit in square brackets"
        raise InputError(Problem("", "no unit", f"{expected}, as in '{name} [{EXAMPLES[quantities[0]]}]'", remedy))
    for quantity in quantities:
        try:
            return quantity, si_factor(unit, quantity)
        except InputError as error:
            refusal = error.problems[0]
    gravity = unit == "g" and "acceleration" in quantities
    remedy = "write g_0 for standard gravity, g is gram" if gravity else refusal.remedy
    raise InputError(Problem("", refusal.got, expected, remedy))


def _fitting(records: list[Record], columns: int, delimiter: str, file: str, findings: Findings) -> list[Record]:
    """Return the rows that fit the header."""
    findings += few((misfit(w, len(cells), columns, delimiter) for w, cells in records if len(cells) != columns), file)
    return [(where, cells) for where, cells in records if len(cells) == columns]


def _cells(records: list[Record], places: list[_Place]) -> Iterator[str]:
    return (cells[place.index] for _, cells in records for place in places)


def _columns(
    records: list[Record], places: list[_Place], decimal: str, file: str, findings: Findings
) -> dict[str, Column]:
    columns = {}
    for place in places:
        if place.factor is not None and place.name not in columns:
            mine = Findings()
            values = [mine.attempt(w, place.name, _number, c[place.index], decimal, place.factor) for w, c in records]
            columns[place.name] = Column(place.name, place.quantity, place.unit, np.array(values, float))
            findings += few(mine, file)
    return columns


def _number(text: str, decimal: str, factor: float) -> float:
    number = parse_number(text, decimal) * factor
    if math.isinf(number):
        raise InputError(Problem("", f"'{text}'", "a finite number", "correct the number or its unit"))
    return number


def _time_problems(series: Series) -> Iterator[Problem]:
    if TIME not in series:
        return
    time = series[TIME]
    with np.errstate(over="ignore"):
        steps = np.diff(time)
    for row in np.flatnonzero(~((steps >= STEPS[0]) & (steps <= STEPS[1]) | np.isnan(steps))) + 1:
        got = f"{time[row]:.9g} s after {time[row - 1]:.9g} s"
        if steps[row - 1] <= 0:
            expected, remedy = "times that increase", "sort the rows or delete the repeated one"
        else:
            expected, remedy = (
                f"steps from {STEPS[0]:g} to {STEPS[1]:g} s",
                "correct the time, or the unit in the header",
            )
        yield Problem(series.where[row], got, expected, remedy, TIME)
