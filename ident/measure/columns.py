"""Rules for the cells of each column, and the one reader that enforces them."""

import math
import re
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

from ident.errors import InputError, Problem, refusal, refuse, require
from ident.measure.table import (
    Findings,
    Record,
    decimal_mark,
    doubled,
    fitting,
    name_and_unit,
    parse_number,
    records_of,
)
from ident.text import LONGEST_QUOTE, nearest, one_line, quoted
from ident.units import QUANTITIES, sensor_factor, si_factor

P = ParamSpec("P")
T = TypeVar("T")

ANGLE = re.compile(r"q[1-9][0-9]{0,2}")
"""Name of a joint angle's column."""
EXAMPLES = {"time": "s", "angle": "deg", "length": "mm", "acceleration": "m/s^2", "moment": "N*m", "frequency": "Hz"}
"""Example unit of each quantity in a header, for messages."""
LISTED = 8
"""Columns of a file that a message lists."""
ABOVE_0 = math.ulp(0.0)
"""The least number above 0."""
UNSET: Any = ...
"""Default of a column without one: its empty cells are read like any other."""

# -------- Rules


@dataclass(frozen=True)
class Number:
    """Cells with a number in a range.

    Attributes:
        expected: the number in words, for messages.
        remedy: for a number outside the range.
        least: lower limit.
        most: upper limit.
        in_percent: expectation and remedy for a number in percent; none where percent is not read as a number.
    """

    expected: str
    remedy: str = "correct it"
    least: float = -math.inf
    most: float = math.inf
    in_percent: tuple[str, str] | None = None

    def __call__(self, text: str, decimal: str = ".") -> float:
        """Read a number and refuse one outside the range."""
        if self.in_percent and text.endswith("%"):
            raise refusal("", quoted(text), *self.in_percent)
        value = parse_number(text, decimal)
        if not self.least <= value <= self.most:
            raise refusal("", quoted(text), self.expected, self.remedy)
        return value


@dataclass(frozen=True)
class Word:
    """Cells with one of a few words, in either case.

    Attributes:
        words: in lower case.
        otherwise: remedy for a text unlike any of them.
        suggestion: remedy for a text close to one of them.
        of: the thing that the words describe, for messages.
    """

    words: Sequence[str]
    otherwise: str = "correct it"
    suggestion: str = "did you mean {}?"
    of: str = ""

    def __call__(self, text: str, decimal: str = ".") -> str:
        """Return the word in lower case."""
        if (word := text.lower()) not in self.words:
            near = nearest(text, self.words)
            remedy = self.suggestion.format(near) if near and self.suggestion else self.otherwise
            raise refusal("", quoted(text), f"one of {', '.join(self.words)}{self.of}", remedy)
        return word


@dataclass(frozen=True)
class Rule:
    """The rule of a column.

    Attributes:
        name: in the header, in either case.
        read: reads a cell, given the decimal mark; None to keep the text.
        empty: value of an empty cell or a missing column.
        needed: the missing item, for messages on an empty cell; blank for an optional cell.
        quantities: those allowed for the unit in the header; none for a column without unit.
        unit: default without one in the header; blank where the header must have one.
        unit_is: expectation and remedy where the header has another unit; units are not converted.
        required: whether the header must have the column.
        alias: other names that instruments and controllers give the column, as a regular expression.
    """

    name: str
    read: Callable[[str, str], Any] | None = None
    empty: Any = UNSET
    needed: str = ""
    quantities: tuple[str, ...] = ()
    unit: str = ""
    unit_is: tuple[str, str] | None = None
    required: bool = False
    alias: str = ""


ANGLES = Rule("q1", parse_number, quantities=("angle",))
"""The rule of all joint angles, `q1 [deg]`, `q2 [deg]`, ..."""


# -------- Reader


@dataclass(frozen=True)
class Unit:
    """The unit of a column of convertible numbers.

    Attributes:
        written: as in the header.
        quantity: its dimension, a name in `QUANTITIES`.
        factor: SI units per unit.
    """

    written: str
    quantity: str
    factor: float


@dataclass(frozen=True)
class Header:
    """The header line.

    Attributes:
        where: its place, `file:row`.
        names: of the columns in the file's order, without units; those of ignored columns as written.
        units: of the columns of convertible numbers.
        ignored: names of the columns without a rule, where these are allowed.
    """

    where: str
    names: tuple[str, ...]
    units: Mapping[str, Unit] = field(default_factory=dict)
    ignored: tuple[str, ...] = ()

    @property
    def angles(self) -> list[str]:
        """Names of the joint angles, in the order of the joints."""
        return sorted(filter(ANGLE.fullmatch, self.units), key=lambda name: int(name[1:]))


@dataclass(frozen=True)
class Row:
    """One row.

    Attributes:
        where: its place, `file:row`.
        cells: by column; empty for a column that the file does not have.
        decimal: the decimal mark.
        header: of the file.
        problems: errors in the row.
    """

    where: str
    cells: Mapping[str, str]
    decimal: str
    header: Header
    problems: Findings = field(default_factory=Findings)

    def __getitem__(self, column: str) -> str:
        return self.cells.get(column, "")

    def attempt(self, column: str, read: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs) -> T | None:
        """Return the result of `read`; on InputError note its problems and return None."""
        return self.problems.attempt(self.where, column, read, *args, **kwargs)

    def add(self, got: str, expected: str, remedy: str, column: str = "") -> None:
        """Note a problem."""
        self.problems.append(Problem(self.where, got, expected, remedy, column))

    def need(self, column: str, what: str) -> None:
        """Note a required cell that is empty."""
        if not self[column]:
            self.add("nothing", what, "fill the cell", column)

    def value(self, rule: Rule) -> Any:
        """Return the value of a cell, numbers in SI; if it breaks the rule of its column, note that and return None."""
        text, unit = self[rule.name], self.header.units.get(rule.name)
        if rule.needed:
            self.need(rule.name, rule.needed)
        if not text and rule.empty is not UNSET:
            return rule.empty
        if rule.read is None:
            return text
        value = self.attempt(rule.name, rule.read, text, self.decimal)
        if value is None or unit is None:
            return value
        return tuple(each * unit.factor for each in value) if isinstance(value, tuple) else value * unit.factor

    def values(self, rules: Iterable[Rule]) -> dict[str, Any]:
        """Return the values of the cells, by column."""
        return {rule.name: self.value(rule) for rule in rules}

    @property
    def posture(self) -> tuple[Any, ...]:
        """Joint angles [rad]; None for an unreadable one, which is noted."""
        return tuple(self.value(replace(ANGLES, name=name)) for name in self.header.angles)


def read_header(
    record: Record, rules: Collection[Rule], shown: str, findings: Findings, strict: bool = False
) -> Header:
    """Read the header line, and note unknown, missing and duplicate columns, and invalid units.

    `shown` names all columns in words, blank where others are ignored. If `strict`, a column with a unit that it does
    not need is unknown, too.
    """
    (where, cells), columns = record, list[tuple[str, str, Rule | None]]()
    own, units = {rule.name.lower(): rule for rule in rules if rule is not ANGLES}, dict[str, Unit]()
    for cell in cells:
        name, unit = name_and_unit(cell)
        is_angle = ANGLES in rules and ANGLE.fullmatch(name.lower())
        rule = replace(ANGLES, name=name.lower()) if is_angle else own.get(name.lower())
        if rule is None or (strict and unit and not rule.quantities):
            columns.append((cell if strict or not shown else name, unit, None))
        else:
            columns.append((rule.name, unit, rule))
    names, others = tuple(name for name, _, _ in columns), [name for name, _, rule in columns if rule is None]
    for name, unit, rule in columns:
        if rule and rule.quantities:
            read = findings.attempt(where, name, unit_of, unit or rule.unit, name, *rule.quantities)
            units[name] = read or Unit(unit, rule.quantities[0], 1.0)
        elif rule and rule.unit_is and unit not in ("", rule.unit):
            findings.append(Problem(where, quoted(unit), *rule.unit_is, name))
    for name in others if shown else ():
        near = nearest(name, own)
        remedy = f"write {near}" if strict else f"did you mean {near}?"
        got = f"the unknown column {quoted(name)}" if name else "a column without a name"
        column = one_line(name[:LONGEST_QUOTE]) if strict else ""
        findings.append(Problem(where, got, shown, remedy if near else "remove or rename the column", column))
    bare = {name_and_unit(name)[0].lower() for name in others} if shown else ()
    for rule in rules:
        if rule.required and rule.name not in names and rule.name not in bare:  # one with a unit too many is there
            expected = f"'{rule.name} [{EXAMPLES[rule.quantities[0]]}]'" if rule.quantities else rule.name
            near = "" if shown else nearest(rule.name, (name_and_unit(name)[0] for name in others))
            listed = ", ".join(one_line(name[:LONGEST_QUOTE]) for name in others[:LISTED])
            remedy = "add the column" if shown or not others else f"say which of {listed} it is (`columns`)"
            remedy = f"rename {one_line(near[:LONGEST_QUOTE])}" if near else remedy
            findings.append(Problem(where, "no such column", f"a column {expected}", remedy, rule.name))
    findings += doubled(where, [name for name, _, rule in columns if name and (rule or shown)])
    joints = [int(name[1:]) for name in names if ANGLES in rules and ANGLE.fullmatch(name)]
    for joint in sorted({*range(1, max(joints, default=1) + 1)} - {*joints}) if ANGLES in rules else ():
        expected, remedy = "joint angles numbered q1, q2, ... without a gap", "add or renumber the column"
        findings.append(Problem(where, "no such column", expected, remedy, f"q{joint}"))
    return Header(where, names, units, () if shown else tuple(others))


def unit_of(written: str, name: str, *quantities: str) -> Unit:
    """Return the unit in a column's header, for the first of these quantities that it fits; refuse a header without."""
    expected = " or ".join(QUANTITIES[quantity].expected for quantity in quantities)
    if not written:
        example = f"{expected}, as in '{name} [{EXAMPLES[quantities[0]]}]'"
        raise refusal("", "no unit", example, "write the unit in square brackets")
    for quantity in quantities:
        try:
            return Unit(written, quantity, sensor_factor(written, quantity) or si_factor(written, quantity))
        except InputError as error:
            problem = error.problems[0]
    raise refusal("", problem.got, expected, problem.remedy)


def rows_of(
    records: list[Record], header: Header, delimiter: str, findings: Findings, numeric: Collection[str] = ()
) -> list[Row]:
    """Return the rows that fit the header, and note the others.

    The decimal mark is that of the `numeric` columns of the whole file; without any, that of each row.
    """
    names, rows = header.names, fitting(records, len(header.names), delimiter, findings)
    places = [place for place, name in enumerate(names) if name in numeric]
    mark = decimal_mark(delimiter, (cells[place] for _, cells in rows for place in places))
    return [
        Row(where, dict(zip(names, cells, strict=True)), mark if numeric else decimal_mark(delimiter, cells), header)
        for where, cells in rows
    ]


def read_rows(
    data: bytes,
    path: str | Path,
    rules: Collection[Rule],
    findings: Findings,
    shown: str,
    *needed: str,
    strict: bool = False,
) -> list[Row]:
    """Return the rows of a table, each with its problems.

    Args:
        data: the bytes of the file.
        path: names it in messages.
        rules: of all columns that it may have.
        findings: where problems are put.
        shown: the columns in words, for messages.
        needed: what the rows are for, and what to do where there are none; nothing if that is fine.
        strict: see `read_header`.

    Raises:
        InputError: it is no table, or its header is wrong.
    """
    known = {rule.name for rule in rules}
    is_column = lambda cell: name_and_unit(cell)[0].lower() in known  # noqa: E731
    _, delimiter, records = records_of(data, path, is_column, findings, *needed)
    require(records, one_line(str(path)), "no row", f"a header with {shown}", "write one")
    header = read_header(records[0], rules, shown, findings, strict)
    refuse(findings)
    return rows_of(records[1:], header, delimiter, findings)
