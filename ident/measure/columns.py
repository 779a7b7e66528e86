"""The columns of a campaign CSV, and the header line that names them."""

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import count

from ident.errors import InputError, Problem
from ident.measure.table import Findings, Record
from ident.text import LONGEST_QUOTE, nearest, one_line, quoted
from ident.units import si_factor

COLUMNS = (
    "kind",
    "mode",
    "of",
    "point",
    "direction",
    "reference_point",
    "reference_direction",
    "joint",
    "setup",
    "load",
    "reference_load",
    "ramp",
    "drives",
    "value",
    "unit",
    "sigma",
    "relative_sigma",
    "resolution",
    "repeat",
    "group",
    "note",
)
"""Names of the columns, beside the joint angles `q1 [deg]`, `q2 [deg]`, ..."""

NUMERIC_COLUMNS = (
    "value",
    "sigma",
    "relative_sigma",
    "resolution",
    "direction",
    "reference_direction",
    "load",
    "reference_load",
)
"""Columns, beside the joint angles, that hold numbers."""

_ANGLE_COLUMN = re.compile(r"(q[1-9][0-9]{0,2})\s*(?:\[([^\]]*)\])?", re.IGNORECASE)


@dataclass(frozen=True)
class Header:
    """The header line.

    Attributes:
        where: its place, `file:row`.
        names: column names in the file's order; the joint angles are q1, q2, ... without their unit.
        angles: radians per unit of each joint angle, in the joints' order.
        broken: columns that can't be read; problems in their cells would only repeat the header's.
    """

    where: str
    names: tuple[str, ...]
    angles: Mapping[str, float]
    broken: frozenset[str]


def is_column(name: str) -> bool:
    """Tell whether a campaign CSV may have a column of this name."""
    return name.lower() in COLUMNS or bool(_ANGLE_COLUMN.fullmatch(name))


def read_header(record: Record, findings: Findings) -> Header:
    """Read the header line and note unknown, doubled and missing columns."""
    where, cells = record
    mine = Findings()
    names = [re.sub(r"\s*\[.*", "", cell).lower() if is_column(cell) else cell for cell in cells]
    angles = {
        name: mine.attempt(where, name, _angle_factor, cell) or 1.0
        for name, cell in zip(names, cells, strict=True)
        if _ANGLE_COLUMN.fullmatch(name)
    }
    unknown = [name for name in names if not is_column(name)]
    mine += [_unknown_column(where, name) for name in unknown]
    mine += [Problem(where, *doubled) for doubled in _doubled(names)]
    mine += [Problem(where, "no such column", *lacking) for lacking in _lacking(names)]
    findings += mine
    meant = {nearest(name, COLUMNS) for name in unknown}
    broken = frozenset(meant | {problem.column for problem in mine}) - {""}
    by_joint = dict(sorted(angles.items(), key=lambda angle: int(angle[0][1:])))
    return Header(where, tuple(names), by_joint, broken)


def _angle_factor(cell: str) -> float:
    unit = cell.partition("[")[2].removesuffix("]").strip()
    if not unit:
        remedy = "write the unit in square brackets"
        raise InputError(Problem("", "no unit", "an angle unit, as in 'q1 [deg]'", remedy))
    return si_factor(unit, "angle")


def _unknown_column(where: str, name: str) -> Problem:
    suggestion = nearest(name, COLUMNS)
    remedy = f"write {suggestion}" if suggestion else "remove or rename the column"
    expected = f"one of q1 [deg], ..., {', '.join(COLUMNS)}"
    got = f"the unknown column {quoted(name)}" if name else "a column without a name"
    return Problem(where, got, expected, remedy, one_line(name[:LONGEST_QUOTE]))


def _doubled(names: list[str]) -> Iterator[tuple[str, str, str, str]]:
    for name in sorted({name for name in names if name and names.count(name) > 1}):
        yield "the column twice", "it once", "remove or rename one", one_line(name[:LONGEST_QUOTE])


def _lacking(names: list[str]) -> Iterator[tuple[str, str, str]]:
    """Yield expectation, remedy and name of each column that is missing."""
    for name in ("kind", "value", "unit"):
        if name not in names:
            yield f"a column {name}", "add the column", name
    if not {"sigma", "relative_sigma"} & set(names):
        yield "a column sigma or relative_sigma", "state how far each value may be off", "sigma"
    joints = {int(name[1:]) for name in names if _ANGLE_COLUMN.fullmatch(name)}
    gap = next(joint for joint in count(1) if joint not in joints)
    if gap <= max(joints, default=1):
        yield "joint angles numbered q1, q2, ... without a gap", "add or renumber the column", f"q{gap}"
