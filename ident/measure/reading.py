"""Campaign CSV into a campaign: every cell is checked, and every problem of the file reported at once."""

import hashlib
import os
import re
from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import count
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

from ident.errors import Problem, refusal, refuse
from ident.files import remove_file, replace_file, together
from ident.measure.campaign import Campaign, Measurement, load_problems, role_problems, value_problems
from ident.measure.covariance_and_frames import (
    NO_SETUPS,
    Covariance,
    Group,
    Setups,
    covariance_path,
    covariance_text,
    parse_covariance,
    parse_setups,
    setups_path,
    setups_text,
)
from ident.measure.load import DRIVE_STATES, KINDS, Load, format_direction, parse_direction
from ident.measure.table import (
    BARE,
    Findings,
    Record,
    csv_text,
    decimal_mark,
    fitting,
    format_number,
    parse_fraction,
    parse_number,
    read_table,
    records_of,
)
from ident.text import LONGEST_QUOTE, nearest, one_line, quoted
from ident.units import si_factor

# -------- Columns
# The columns of a campaign CSV, and the header line that names them.

COLUMNS = (
    "kind", "mode", "of", "point", "direction", "reference_point", "reference_direction", "joint", "setup", "load",
    "reference_load", "ramp", "drives", "value", "unit", "sigma", "relative_sigma", "resolution", "repeat", "group",
    "note",
)  # fmt: skip
"""Names of the columns, beside the joint angles `q1 [deg]`, `q2 [deg]`, ..."""

NUMERIC_COLUMNS = (
    "value", "sigma", "relative_sigma", "resolution", "direction", "reference_direction", "load", "reference_load",
)  # fmt: skip
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
    (where, cells), mine = record, Findings()
    if any(re.match(r"time\b", cell.lower()) for cell in cells):
        see = "see `ident spectrum`, `ident modal`, `ident source`"
        raise refusal(where, "a trace (a column time)", "a campaign", see)
    names = [re.sub(r"\s*\[.*", "", cell).lower() if is_column(cell) else cell for cell in cells]
    angles = {
        name: mine.attempt(where, name, _angle_factor, cell) or 1.0
        for name, cell in zip(names, cells, strict=True)
        if _ANGLE_COLUMN.fullmatch(name)
    }
    unknown = [name for name in names if not is_column(name)]
    mine += [_unknown_column(where, name) for name in unknown]
    doubled = sorted({name for name in names if name and names.count(name) > 1})
    twice = "the column twice", "it once", "remove or rename one"
    mine += [Problem(where, *twice, one_line(name[:LONGEST_QUOTE])) for name in doubled]
    mine += [Problem(where, "no such column", *lacking) for lacking in _lacking(names)]
    findings += mine
    meant = {nearest(name, COLUMNS) for name in unknown}
    broken = frozenset(meant | {problem.column for problem in mine}) - {""}
    by_joint = dict(sorted(angles.items(), key=lambda angle: int(angle[0][1:])))
    return Header(where, tuple(names), by_joint, broken)


def _angle_factor(cell: str) -> float:
    unit = cell.partition("[")[2].removesuffix("]").strip()
    if not unit:
        raise refusal("", "no unit", "an angle unit, as in 'q1 [deg]'", "write the unit in square brackets")
    return si_factor(unit, "angle")


def _unknown_column(where: str, name: str) -> Problem:
    suggestion = nearest(name, COLUMNS)
    remedy = f"write {suggestion}" if suggestion else "remove or rename the column"
    expected = f"one of q1 [deg], ..., {', '.join(COLUMNS)}"
    got = f"the unknown column {quoted(name)}" if name else "a column without a name"
    return Problem(where, got, expected, remedy, one_line(name[:LONGEST_QUOTE]))


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


# -------- Reading

AS_TEXT = tuple(name for name in COLUMNS if name not in ("kind", *NUMERIC_COLUMNS))
"""Columns whose text is taken as it is."""
P = ParamSpec("P")
T = TypeVar("T")


def read_campaign(path: str | Path) -> Campaign:
    """Read a campaign from a CSV file; `data/README.md` describes the columns.

    Args:
        path: the file; UTF-8, columns separated by comma, semicolon or tab.

    Returns:
        The measurements in SI units, with the file's hash, delimiter and decimal mark; where rows name a group, also
        the correlations of `CAMPAIGN.covariance.csv` beside it, and where they name a setup, the frames of
        `CAMPAIGN.setups.csv`.

    Raises:
        InputError: the file can't be read, or something in it is wrong; every problem is listed.
    """
    data = read_table(path)
    beside = [read_table(file) if os.path.isfile(file) else None for file in (covariance_path(path), setups_path(path))]
    return parse_campaign(data, path, *beside)


def parse_campaign(
    data: bytes, path: str | Path, covariance: bytes | None = None, setups: bytes | None = None
) -> Campaign:
    """Read a campaign from the bytes of a CSV file, and of those beside it; `path` names it in messages."""
    findings = Findings()
    needed = "measurement", "see data/README.md for the columns"
    _, delimiter, records = records_of(data, path, is_column, findings, *needed)
    header = read_header(records[0], findings)
    read = [_read_row(row, header) for row in _rows(records[1:], header, delimiter, findings)]
    measurements = _numbered(measurement for measurement in read if measurement is not None)
    findings += _duplicate_problems(measurements) if not header.broken else ()
    refuse(p for p in findings if p.where == header.where or p.column not in header.broken)
    sha256 = hashlib.sha256(data).hexdigest()
    correlated, frames = _covariance(measurements, path, covariance), _setups(measurements, path, setups)
    return Campaign(Path(path).stem, str(path), sha256, measurements, correlated, frames)


def _numbered(measurements: Iterable[Measurement]) -> tuple[Measurement, ...]:
    """Number the rows of each group."""
    places: dict[str, Iterator[int]] = defaultdict(lambda: count(1))
    return tuple(replace(m, member=next(places[m.group])) if m.group else m for m in measurements)


def _covariance(measurements: Iterable[Measurement], path: str | Path, data: bytes | None) -> Covariance | None:
    """Return the correlations of the groups that rows name.

    Raises:
        InputError: rows in groups without that file, or that file without such rows; something in it is wrong.
    """
    sizes, beside = Counter(m.group for m in measurements if m.group), covariance_path(path)
    where = one_line(str(beside))
    if data is not None and not sizes:
        got, remedy = "correlations of no row", "name each row's group in a column group, or remove this file"
        raise refusal(where, got, f"rows of {one_line(Path(path).name)} in groups", remedy)
    if sizes and data is None:
        remedy = "write it (group,i,j,correlation), or empty the column group"
        raise refusal(where, "no such file", "the correlations of the rows in groups", remedy)
    return None if data is None else parse_covariance(data, beside, sizes)


def _setups(measurements: Iterable[Measurement], path: str | Path, data: bytes | None) -> Setups:
    """Return the frames of the setups that rows name.

    Raises:
        InputError: a file of frames without such rows, or something in it is wrong.
    """
    names, beside = {m.setup for m in measurements if m.setup}, setups_path(path)
    if data is None:
        return NO_SETUPS
    if not names:
        got, remedy = "frames of no row", "name each row's setup in a column setup, or remove this file"
        raise refusal(one_line(str(beside)), got, f"rows of {one_line(Path(path).name)} in them", remedy)
    return parse_setups(data, beside, names)


@dataclass(frozen=True)
class _Row:
    """One row: its place, its cells by column, the decimal mark, and where to put problems."""

    where: str
    cells: Mapping[str, str]
    decimal: str
    findings: Findings

    def __getitem__(self, column: str) -> str:
        return self.cells.get(column, "")

    def attempt(self, column: str, read: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs) -> T | None:
        return self.findings.attempt(self.where, column, read, *args, **kwargs)

    def add(self, *problems: Problem) -> None:
        self.findings.extend(replace(problem, where=self.where) for problem in problems)


def _rows(records: list[Record], header: Header, delimiter: str, findings: Findings) -> list[_Row]:
    """Return the rows that fit the header."""
    rows = fitting(records, len(header.names), delimiter, findings)
    table = [(where, dict(zip(header.names, cells, strict=True))) for where, cells in rows]
    numeric = [name for name in header.names if name in header.angles or name in NUMERIC_COLUMNS]
    decimal = decimal_mark(delimiter, (cells[name] for _, cells in table for name in numeric))
    return [_Row(where, cells, decimal, findings) for where, cells in table]


def _read_row(row: _Row, header: Header) -> Measurement | None:
    before = len(row.findings)
    fields = _read_cells(row, header)
    row.add(*_contradictions(row, fields))
    if len(row.findings) > before:
        return None
    return row.attempt("", Measurement, where=row.where, **fields)


def _read_cells(row: _Row, header: Header) -> dict[str, Any]:
    """Read a row's cells into a measurement's fields; None is what can't be read."""
    kind = row.attempt("kind", _known_kind, row["kind"])
    value, sigma = _read_number(row, kind)
    return {
        "kind": kind,
        "posture": tuple(
            _scaled(row.attempt(name, parse_number, row[name], row.decimal), factor)
            for name, factor in header.angles.items()
        ),
        "value": value,
        "sigma": sigma,
        "resolution": _read_resolution(row, kind),
        **{
            name: row.attempt(name, parse_direction, row[name], row.decimal) if row[name] else None
            for name in ("direction", "reference_direction")
        },
        **{name: row.attempt(name, Load.parse, row[name], decimal=row.decimal) for name in ("load", "reference_load")},
        **{name: row[name] for name in AS_TEXT},
    }


def _contradictions(row: _Row, fields: Mapping[str, Any]) -> Iterator[Problem]:
    kind, loads = fields["kind"], (fields["load"], fields["reference_load"])
    if kind is None:
        return
    yield from role_problems(kind, {name: text for name, text in row.cells.items() if text})
    if fields["value"] is not None:
        any_sigma = min(abs(fields["value"]), 1e305) or 1.0  # its own is looked at when the measurement is made
        yield from value_problems(kind, fields["value"], any_sigma)
    if None not in loads:
        yield from load_problems(kind, *loads)


def _known_kind(text: str) -> str:
    if text.lower() not in KINDS:
        suggestion = nearest(text, KINDS)
        remedy = f"write {suggestion}" if suggestion else "correct the kind"
        raise refusal("", quoted(text), f"one of {', '.join(KINDS)}", remedy)
    return text.lower()


def _read_number(row: _Row, kind: str | None) -> tuple[float | None, float | None]:
    """Read value and sigma in SI units."""
    value = row.attempt("value", parse_number, row["value"], row.decimal)
    sigma = _read_sigma(row, value)
    factor = row.attempt("unit", si_factor, row["unit"], KINDS[kind]) if kind else None
    return _scaled(value, factor), _scaled(sigma, factor)


def _read_resolution(row: _Row, kind: str | None) -> float | None:
    """Read the resolution in SI units; zero where there is none."""
    if not row["resolution"]:
        return 0.0
    step = row.attempt("resolution", _positive, row["resolution"], row.decimal, "resolution")
    return _scaled(step, row.attempt("unit", si_factor, row["unit"], KINDS[kind]) if kind else None)


def _scaled(number: float | None, factor: float | None) -> float | None:
    return None if number is None or factor is None else number * factor


def _read_sigma(row: _Row, value: float | None) -> float | None:
    """Read sigma in the value's unit as written."""
    if bool(row["sigma"]) == bool(row["relative_sigma"]):
        got = "both" if row["sigma"] else "nothing"
        row.add(Problem("", got, "either sigma or relative_sigma", "fill one of the two cells", "sigma"))
        return None
    if row["sigma"]:
        return row.attempt("sigma", _positive, row["sigma"], row.decimal, "standard deviation")
    fraction = row.attempt("relative_sigma", parse_fraction, row["relative_sigma"], row.decimal, row["kind"].lower())
    if value == 0:
        row.add(Problem("", "a fraction of the value 0", "an absolute sigma", "give sigma instead", "relative_sigma"))
    return _scaled(fraction, None if value is None else abs(value))


def _positive(text: str, decimal: str, what: str) -> float:
    if text.endswith("%"):
        remedy = "give it in that unit" if what == "resolution" else "use the column relative_sigma for percent"
        expected = "resolution in the value's unit" if what == "resolution" else "sigma in the value's unit"
        raise refusal("", quoted(text), expected, remedy)
    number = parse_number(text, decimal)
    if number <= 0:
        remedy = "leave the cell empty" if what == "resolution" else "state how far the value may be off"
        raise refusal("", quoted(text), f"a {what} above 0", remedy)
    return number


def _duplicate_problems(measurements: tuple[Measurement, ...]) -> Iterator[Problem]:
    """Yield the measurements that repeat an earlier one to the last digit."""
    first: dict[Measurement, Measurement] = {}
    for m in measurements:
        earlier = first.setdefault(replace(m, sigma=abs(m.value) or 1.0, resolution=0.0, note=""), m)
        if earlier is not m:
            got = f"a duplicate of row {earlier.where.rpartition(':')[2]}"
            otherwise = "correct one of the labels" if m.mode else "label the modes if two modes share a frequency"
            remedy = f"delete one of them, tell readings apart by a column repeat, or {otherwise}"
            yield Problem(m.where, got, "each measurement once", remedy)


# -------- Writing
# A campaign into CSV that reads back equal.

WRITTEN_UNITS = {"frequency": "Hz", "length": "mm", "rotation": "mrad", "damping_ratio": "1", "ratio": "1"}
"""Unit in which each measured quantity is written."""


def write_campaign(
    campaign: Campaign,
    path: str | Path,
    *,
    header_comments: Iterable[str] = (),
    relative_sigma: bool = False,
) -> None:
    """Write a campaign as CSV: postures in deg, frequencies in Hz, deflections in mm, every digit kept.

    The text is read back before it is written, so that no file is made that `read_campaign` would refuse. The
    files appear together or not at all. Correlations go into `CAMPAIGN.covariance.csv` beside it, frames of setups into
    `CAMPAIGN.setups.csv`; without any, such a file of an earlier campaign there is removed.

    Args:
        campaign: what to write.
        path: the file; an existing one is replaced.
        header_comments: comment lines for the head of the file, such as the origin of the numbers.
        relative_sigma: whether standard deviations are written as fractions of the value, where they are any.
    """
    text = campaign_text(campaign, header_comments=header_comments, relative_sigma=relative_sigma)
    data, beside = text.encode("utf-8", errors="backslashreplace"), covariance_path(path)
    # the groups of the campaign's rows as they are numbered when they are read again
    names = dict.fromkeys(m.group for m in campaign if m.group)
    several = {campaign.measurements[places[0]].group: matrix for places, matrix in campaign.correlated}
    groups = [Group(name, several.get(name, ((1.0,),))) for name in names]
    correlations = covariance_text(groups, Path(path).name).encode() if groups else None
    frames = setups_text(campaign.setups.each, Path(path).name).encode() if campaign.setups.each else None
    parse_campaign(data, path, correlations, frames)
    with together():
        _write_beside(beside, correlations)
        _write_beside(setups_path(path), frames)
        replace_file(Path(path), lambda file: file.write(data))


def _write_beside(path: Path, content: bytes | None) -> None:
    """Write a file that belongs to the campaign, or remove an earlier campaign's."""
    if content is None:
        remove_file(path)
    else:
        replace_file(path, lambda file: file.write(content))


def campaign_text(campaign: Campaign, *, header_comments: Iterable[str] = (), relative_sigma: bool = False) -> str:
    """Return a campaign as CSV text under comment lines, with the columns that are in use; see `write_campaign`."""
    comments = [line for comment in header_comments for line in comment.splitlines() or [""]]
    return csv_text(*campaign_rows(campaign, relative_sigma=relative_sigma), comments)


def campaign_rows(campaign: Campaign, *, relative_sigma: bool = False) -> tuple[list[str], list[dict[str, str]]]:
    """Return the columns of a campaign that are in use, and its rows."""
    angles = [f"q{joint} [deg]" for joint in range(1, campaign.joints + 1)]
    degree = si_factor("deg", "angle")
    postures = [dict(zip(angles, (_written(angle, degree) for angle in m.posture), strict=True)) for m in campaign]
    rows = [posture | _cells(m, relative_sigma) for posture, m in zip(postures, campaign, strict=True)]
    used = [name for name in COLUMNS if name in ("kind", "value", "unit") or any(row.get(name) for row in rows)]
    return ["kind", *angles, *used[1:]], rows


def _cells(m: Measurement, relative_sigma: bool) -> dict[str, str]:
    """Return the cells of a measurement by column, but for its posture."""
    unit = WRITTEN_UNITS[KINDS[m.kind]]
    factor = si_factor(unit, KINDS[m.kind])
    cells = {name: getattr(m, name) or "" for name in ("kind", *AS_TEXT)}
    for name in ("direction", "reference_direction"):
        cells[name] = format_direction(getattr(m, name)) if getattr(m, name) else ""
    for name in ("load", "reference_load"):
        cells[name] = str(getattr(m, name)) if getattr(m, name) else ""
    cells |= {"value": _written(m.value, factor), "unit": unit}
    if relative_sigma and m.sigma < abs(m.value) * (BARE if m.kind == "frequency" else 1):  # as it is read
        cells["relative_sigma"] = _written(m.sigma, abs(m.value))
    else:
        cells["sigma"] = _written(m.sigma, factor)
    cells["resolution"] = _written(m.resolution, factor) if m.resolution else ""
    return cells | ({"drives": ""} if m.drives == DRIVE_STATES[0] else {})


def _written(value: float, unit: float) -> str:
    """Return value/unit in the fewest digits, 15 at least, that read back as the same value; else in all."""
    exact = value / unit
    short = (float(f"{exact:.{digits}g}") for digits in (15, 16))
    return format_number(next((number for number in short if number * unit == value), exact))
