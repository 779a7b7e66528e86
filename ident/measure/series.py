"""Columns of numbers over time, each with its unit in the header: what logs and traces have in common."""

import hashlib
import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from jaxtyping import Float

from ident.errors import Problem, refusal
from ident.measure.columns import Header, Rule, read_header
from ident.measure.samples import NONE, TIME, Columns, read_samples
from ident.measure.table import Findings, Record, decimal_mark, fitting, name_and_unit, parse_number
from ident.text import by_key, quoted
from ident.units import sensor_factor

ROWS_NAMED = 4
"""Further rows with the same mistake that are named."""

STEPS = (1e-9, 1e9)
"""Steps of time [s] that a recording can have: a nanosecond to thirty years."""


@dataclass(frozen=True)
class Sampled:
    """What was measured over time.

    Attributes:
        path: the file it was read from.
        sha256: hash of the file's bytes.
        time: (T,) [s] increasing; of traces and joint logs uniform within 1 %.
    """

    path: str
    sha256: str
    time: Float[np.ndarray, " T"]

    @property
    def interval(self) -> float:
        """Mean time [s] between two samples."""
        return float(self.time[-1] - self.time[0]) / (len(self.time) - 1)


@dataclass(frozen=True)
class Series:
    """The columns that could be read; what could not is among the findings.

    Attributes:
        file: the file's name, for messages.
        sha256: hash of the file's bytes.
        header: of the file.
        where: (T,) place of each row.
        columns: (T,) [SI] by name, the time among them; NaN where a cell could not be read.
        at_fault: names of columns whose header cell can't be read, or that are missing or doubled.
        remarks: what was taken from a program's convention.
    """

    file: str
    sha256: str
    header: Header
    where: tuple[str, ...]
    columns: Mapping[str, Float[np.ndarray, " T"]]
    at_fault: frozenset[str]
    remarks: tuple[str, ...] = ()

    def __contains__(self, name: str) -> bool:
        return name in self.columns

    def __getitem__(self, name: str) -> Float[np.ndarray, " T"]:
        return self.columns[name]


def parse_series(
    data: bytes, path: str | Path, rules: Sequence[Rule], rows: int, findings: Findings, columns: Columns = NONE
) -> Series:
    """Read time and the wanted columns from the bytes of a table of samples, and check that time increases.

    Rows without a value of any wanted column are left out, as those of another sensor.

    Args:
        data: the bytes; UTF-8, as `read_samples` takes them.
        path: names the file in messages.
        rules: of the wanted columns; further ones are ignored.
        rows: the fewest rows that will do.
        findings: where problems are put; reading goes on.
        columns: headers by names of the file.

    Returns:
        What could be read.
    """
    table = read_samples(data, path, columns, findings, "time", "check the file")
    file, delimiter, records, remarks = table.file, table.delimiter, table.records, list(table.remarks)
    wanted, faults, misfits = [Rule(TIME, quantities=("time",), required=True), *rules], Findings(), Findings()
    records[0] = _known_by_alias(records[0], rules, faults, remarks)
    header = read_header(records[0], wanted, "", faults)
    at_fault = frozenset(problem.column for problem in faults)
    rows_read = fitting(records[1:], len(header.names), delimiter, misfits)
    findings += [*faults, *counted(misfits)]
    places = {rule.name: header.names.index(rule.name) for rule in wanted if rule.name in header.units}
    own = [place for name, place in places.items() if name != TIME]
    before = len(rows_read)
    rows_read = [row for row in rows_read if not own or any(row[1][p].lower() not in ("", "nan") for p in own)]
    decimal = decimal_mark(delimiter, (cells[place] for _, cells in rows_read for place in places.values()))
    read = dict[str, np.ndarray]()
    for name in [name for name in places if name not in at_fault]:
        mine, place, factor = Findings(), places[name], header.units[name].factor
        values = [mine.attempt(row, name, _number, cells[place], decimal, factor) for row, cells in rows_read]
        read[name] = np.array(values, float)
        findings += counted(mine)
    sha256, where = hashlib.sha256(data).hexdigest(), tuple(row for row, _ in rows_read)
    series = Series(file, sha256, header, where, read, at_fault, tuple(remarks))
    findings += counted(_time_problems(series))
    given = len(records) - 1 - (before - len(rows_read))
    if given < rows:
        got = f"{given} row{'s' if given > 1 else ''}"
        findings.append(Problem(file, got, f"at least {rows}", "give a longer recording"))
    return series


def _known_by_alias(record: Record, rules: Sequence[Rule], faults: Findings, remarks: list[str]) -> Record:
    """Return a header with the names of wanted columns that it has under another name."""
    where, cells = record
    pairs = [name_and_unit(cell) for cell in cells]
    names, taken = {name.lower() for name, _ in pairs}, list[str]()
    for rule in rules:
        if not rule.alias or rule.name.lower() in names:
            continue
        alike = [i for i, (name, _) in enumerate(pairs) if re.fullmatch(rule.alias, name, re.IGNORECASE)]
        known = [i for i in alike if not pairs[i][1] or any(sensor_factor(pairs[i][1], q) for q in rule.quantities)]
        if not known:
            continue
        first, words = known[0], " and ".join(quoted(pairs[i][0]) for i in known)
        if known[1:]:
            remedy = f"name one (`columns`), as {pairs[first][0]}={rule.name}"
            faults.append(Problem(where, words, f"one column that is {rule.name}", remedy, rule.name))
        else:
            taken.append(f"{words} as {rule.name}")
            cells = [*cells[:first], f"{rule.name} [{pairs[first][1]}]", *cells[first + 1 :]]
    if taken:
        remarks.append(f"{where}: {', '.join(taken)}; the option columns can say otherwise")
    return where, cells


def counted(problems: Iterable[Problem]) -> Iterator[Problem]:
    """Yield the first problem of each kind, and in which rows the others are: a column of bad cells is one mistake."""
    for first, *more in by_key(((each.column, each.expected, each.remedy), each) for each in problems).values():
        rows = ", ".join(problem.where.rpartition(":")[2] for problem in more[:ROWS_NAMED])
        rest = f" and {len(more) - ROWS_NAMED} more" if len(more) > ROWS_NAMED else ""
        yield replace(first, got=f"{first.got} (also rows {rows}{rest})" if more else first.got)


def _number(text: str, decimal: str, factor: float) -> float:
    number = parse_number(text, decimal) * factor
    if math.isinf(number):
        raise refusal("", f"'{text}'", "a finite number", "correct the number or its unit")
    return number


def _time_problems(series: Series) -> Iterator[Problem]:
    if TIME not in series:
        return
    time = series[TIME]
    with np.errstate(over="ignore"):
        steps = np.diff(time)
    for row in np.flatnonzero(~((steps >= STEPS[0]) & (steps <= STEPS[1]) | np.isnan(steps))) + 1:
        got = f"{time[row]:.9g} s after {time[row - 1]:.9g} s"
        expected, remedy = f"steps from {STEPS[0]:g} to {STEPS[1]:g} s", "correct the time, or the unit in the header"
        if steps[row - 1] <= 0:
            expected, remedy = "times that increase", "sort the rows or delete the repeated one"
        yield Problem(series.where[row], got, expected, remedy, TIME)
