"""Rules of columns: what the cells of a column may say, and the one reader that refuses what breaks a rule."""

import math
import re
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, ParamSpec, TypeVar

from ident.errors import Problem, refusal
from ident.measure.table import Findings, Record, decimal_mark, fitting, header_problems, name_and_unit, parse_number
from ident.text import LONGEST_QUOTE, nearest, one_line, quoted
from ident.units import si_factor

P = ParamSpec("P")
T = TypeVar("T")

ANGLE = re.compile(r"q[1-9][0-9]{0,2}")
"""Name of a joint angle's column."""
EXAMPLES = {"time": "s", "angle": "deg", "length": "mm", "acceleration": "m/s^2", "moment": "N*m"}
"""A unit of each quantity that a header may state, for messages."""
ABOVE_0 = math.ulp(0.0)
"""The least number above 0."""
UNSET: Any = ...
"""Of a column whose empty cells say nothing of their own: they are read like any other."""

# -------- Rules


@dataclass(frozen=True)
class Number:
    """Cells that hold a number of a range.

    Attributes:
        expected: what the number is called.
        remedy: what to do where it is none of the range.
        least: the least that it may be.
        most: the most.
        in_percent: what was expected, and what to do, where it is written in percent; none where that is no number.
    """

    expected: str
    remedy: str = "correct it"
    least: float = -math.inf
    most: float = math.inf
    in_percent: tuple[str, str] | None = None

    def __call__(self, text: str, decimal: str = ".") -> float:
        """Read a number, refused outside the range."""
        if self.in_percent and text.endswith("%"):
            raise refusal("", quoted(text), *self.in_percent)
        value = parse_number(text, decimal)
        if not self.least <= value <= self.most:
            raise refusal("", quoted(text), self.expected, self.remedy)
        return value


@dataclass(frozen=True)
class Word:
    """Cells that hold one of a few words, in either case.

    Attributes:
        words: in lower case.
        otherwise: what to do where none of them is meant.
        suggestion: what to do where one of them is.
        of: what the words are of, for messages.
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
        name: in the header, in lower case.
        read: reads a cell, given the decimal mark; None for text that is taken as it is.
        empty: what an empty cell says, or one that the file has no column for.
        needed: what is missing where a cell is empty that must be filled; blank where it need not be.
        quantity: of the unit in the header, in which the numbers are; blank where the header needs none.
        unit: that is meant where the header has none; blank where it must have one.
        unit_is: what was expected, and what to do, where the header has another unit, as none is converted.
        required: whether the header must have the column.
    """

    name: str
    read: Callable[[str, str], Any] | None = None
    empty: Any = UNSET
    needed: str = ""
    quantity: str = ""
    unit: str = ""
    unit_is: tuple[str, str] | None = None
    required: bool = False


ANGLES = Rule("q1", parse_number, quantity="angle")
"""The rule of all joint angles, `q1 [deg]`, `q2 [deg]`, ..."""


# -------- Reader


@dataclass(frozen=True)
class Header:
    """The header line.

    Attributes:
        where: its place, `file:row`.
        names: of the columns in the file's order, without units.
        factors: SI units per unit of the columns whose numbers are converted.
    """

    where: str
    names: tuple[str, ...]
    factors: Mapping[str, float] = field(default_factory=dict)

    @property
    def angles(self) -> list[str]:
        """Names of the joint angles, in the order of the joints."""
        return sorted(filter(ANGLE.fullmatch, self.factors), key=lambda name: int(name[1:]))


@dataclass(frozen=True)
class Row:
    """One row.

    Attributes:
        where: its place, `file:row`.
        cells: by column; a column that the file has not is empty.
        decimal: the decimal mark.
        header: of the file.
        problems: what was found wrong in it.
    """

    where: str
    cells: Mapping[str, str]
    decimal: str
    header: Header
    problems: Findings = field(default_factory=Findings)

    def __getitem__(self, column: str) -> str:
        return self.cells.get(column, "")

    def attempt(self, column: str, read: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs) -> T | None:
        """Return what `read` returns, or None where it raises InputError, whose problems are noted."""
        return self.problems.attempt(self.where, column, read, *args, **kwargs)

    def add(self, got: str, expected: str, remedy: str, column: str = "") -> None:
        """Note a problem."""
        self.problems.append(Problem(self.where, got, expected, remedy, column))

    def need(self, column: str, what: str) -> None:
        """Note that a cell is empty that must be filled."""
        if not self[column]:
            self.add("nothing", what, "fill the cell", column)

    def value(self, rule: Rule) -> Any:
        """Return what a cell says, numbers in SI; None where it breaks the rule of its column, which is noted."""
        text, factor = self[rule.name], self.header.factors.get(rule.name)
        if rule.needed:
            self.need(rule.name, rule.needed)
        if not text and rule.empty is not UNSET:
            return rule.empty
        if rule.read is None:
            return text
        value = self.attempt(rule.name, rule.read, text, self.decimal)
        if value is None or factor is None:
            return value
        return tuple(each * factor for each in value) if isinstance(value, tuple) else value * factor

    def values(self, rules: Iterable[Rule]) -> dict[str, Any]:
        """Return what the cells say, by column."""
        return {rule.name: self.value(rule) for rule in rules}

    @property
    def posture(self) -> tuple[Any, ...]:
        """Joint angles [rad]; None for one that cannot be read, which is noted."""
        return tuple(self.value(replace(ANGLES, name=name)) for name in self.header.angles)


def read_header(
    record: Record, rules: Collection[Rule], shown: str, findings: Findings, strict: bool = False
) -> Header:
    """Read the header line, and note unknown, missing and doubled columns, and units that are none.

    `shown` are all columns in words; if `strict`, one that has a unit without need is an unknown one, too.
    """
    (where, cells), columns = record, list[tuple[str, str, Rule | None]]()
    own, factors = {rule.name: rule for rule in rules if rule is not ANGLES}, dict[str, float]()
    for cell in cells:
        name, unit = name_and_unit(cell)
        rule = ANGLES if ANGLES in rules and ANGLE.fullmatch(name.lower()) else own.get(name.lower())
        if strict and not (rule and (rule.quantity or not unit)):
            name, rule = cell, None
        columns.append((name.lower() if rule else name, unit, rule))
    for name, unit, rule in columns:
        if rule and rule.quantity:
            factors[name] = findings.attempt(where, name, unit_factor, unit or rule.unit, name, rule.quantity) or 1.0
        elif rule and rule.unit_is and unit not in ("", rule.unit):
            findings.append(Problem(where, unit, *rule.unit_is, name))
    names = tuple(name for name, _, _ in columns)
    for name in (name for name, _, rule in columns if rule is None):
        near = nearest(name, own)
        remedy = f"write {near}" if strict else f"did you mean {near}?"
        got = f"the unknown column {quoted(name)}" if name else "a column without a name"
        column = one_line(name[:LONGEST_QUOTE]) if strict else ""
        findings.append(Problem(where, got, shown, remedy if near else "remove or rename the column", column))
    findings += header_problems(where, [*filter(None, names)], [rule.name for rule in rules if rule.required])
    findings += angle_problems(where, names) if ANGLES in rules else ()
    return Header(where, names, factors)


def unit_factor(unit: str, name: str, quantity: str, expected: str = "a unit") -> float:
    """Return SI units per unit of a column, which its header must state."""
    if not unit:
        example = f"{expected}, as in '{name} [{EXAMPLES[quantity]}]'"
        raise refusal("", "no unit", example, "write the unit in square brackets")
    return si_factor(unit, quantity)


def angle_problems(where: str, names: Collection[str]) -> Iterator[Problem]:
    """Yield the joint angles that a header leaves out, from `q1` on."""
    joints = [int(name[1:]) for name in names if ANGLE.fullmatch(name)]
    for joint in sorted({*range(1, max(joints, default=1) + 1)} - {*joints}):
        expected, remedy = "joint angles numbered q1, q2, ... without a gap", "add or renumber the column"
        yield Problem(where, "no such column", expected, remedy, f"q{joint}")


def rows_of(
    records: list[Record], header: Header, delimiter: str, findings: Findings, numeric: Collection[str] = ()
) -> list[Row]:
    """Return the rows that fit the header; the others are noted.

    The decimal mark is that of the `numeric` columns of the whole file, or else that of each row.
    """
    names, rows = header.names, fitting(records, len(header.names), delimiter, findings)
    places = [place for place, name in enumerate(names) if name in numeric]
    mark = decimal_mark(delimiter, (cells[place] for _, cells in rows for place in places))
    return [
        Row(where, dict(zip(names, cells, strict=True)), mark if numeric else decimal_mark(delimiter, cells), header)
        for where, cells in rows
    ]
