"""Read and write campaign CSV: check every cell and report every problem of the file at once."""

import hashlib
import os
import re
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from itertools import count
from pathlib import Path
from typing import Any

from ident.errors import Problem, refuse, require
from ident.files import remove_file, replace_file, together
from ident.measure.campaign import Campaign, Measurement, load_problems, role_problems, value_problems
from ident.measure.columns import ABOVE_0, ANGLE, ANGLES, Header, Number, Row, Rule, Word, read_header, rows_of
from ident.measure.covariance import Covariance, Group, covariance_path, covariance_text, parse_covariance
from ident.measure.frames import NO_SETUPS, Setups, parse_setups, setups_path, setups_text
from ident.measure.kinds import DRIVE_STATES, KINDS
from ident.measure.load import Load, format_direction, parse_direction
from ident.measure.table import (
    BARE,
    Findings,
    Record,
    csv_text,
    format_number,
    parse_fraction,
    parse_number,
    read_table,
    records_of,
)
from ident.text import nearest, one_line
from ident.units import si_factor

# -------- Columns
# The columns of a campaign CSV and its header line.

NO_SHARE = "sigma in the value's unit", "use the column relative_sigma for percent"
NO_STEP = "resolution in the value's unit", "give it in that unit"
SIGMA = Number("a standard deviation above 0", "state how far the value may be off", ABOVE_0, in_percent=NO_SHARE)
RESOLUTION = Number("a resolution above 0", "leave the cell empty", ABOVE_0, in_percent=NO_STEP)
RULES = (
    Rule("kind", Word(tuple(KINDS), "correct the kind", "write {}"), required=True),
    *map(Rule, ("mode", "of", "point")),
    Rule("direction", parse_direction, None),
    Rule("reference_point"),
    Rule("reference_direction", parse_direction, None),
    *map(Rule, ("joint", "setup")),
    *(Rule(name, Load.parse) for name in ("load", "reference_load")),
    *map(Rule, ("ramp", "drives")),
    Rule("value", parse_number, required=True),
    Rule("unit", required=True),
    Rule("sigma", SIGMA, None),
    Rule("relative_sigma"),
    Rule("resolution", RESOLUTION, 0.0),
    *map(Rule, ("repeat", "group", "note")),
)
"""Rules of the columns other than the joint angles `q1 [deg]`, `q2 [deg]`, ..."""

COLUMNS = tuple(rule.name for rule in RULES)
AS_TEXT = tuple(rule.name for rule in RULES if rule.read is None and rule.name != "relative_sigma")
"""Columns stored as text, unparsed."""


def _header(record: Record, findings: Findings) -> tuple[Header, frozenset[str]]:
    """Read the header line and note unknown, duplicate and missing columns.

    Returns:
        The header and its unreadable columns, whose cells would only repeat the header's problems.
    """
    (where, cells), mine = record, Findings()
    is_trace, see = any(re.match(r"time\b", cell.lower()) for cell in cells), "`ident modal`, `ident source`"
    require(not is_trace, where, "a trace (a column time)", "a campaign", f"see `ident spectrum`, {see}")
    header = read_header(record, (*RULES, ANGLES), f"one of q1 [deg], ..., {', '.join(COLUMNS)}", mine, strict=True)
    if not {"sigma", "relative_sigma"} & {*header.names}:
        expected, remedy = "a column sigma or relative_sigma", "state how far each value may be off"
        mine.append(Problem(where, "no such column", expected, remedy, "sigma"))
    findings += mine
    meant = {nearest(name, COLUMNS) for name in header.names if name not in COLUMNS and not ANGLE.fullmatch(name)}
    return header, frozenset({*meant, *(problem.column for problem in mine)} - {""})


# -------- Reading


def read_campaign(path: str | Path) -> Campaign:
    """Read a campaign from a CSV file; `data/README.md` describes the columns.

    Args:
        path: the file; UTF-8, columns separated by comma, semicolon or tab.

    Returns:
        The measurements in SI units with the file's hash. If rows name a group, the correlations of
        `CAMPAIGN.covariance.csv` in the same folder; if they name a setup, the frames of `CAMPAIGN.setups.csv`.

    Raises:
        InputError: the file is unreadable or has errors; all are listed.
    """
    data = read_table(path)
    beside = [read_table(file) if os.path.isfile(file) else None for file in (covariance_path(path), setups_path(path))]
    return parse_campaign(data, path, *beside)


def parse_campaign(
    data: bytes, path: str | Path, covariance: bytes | None = None, setups: bytes | None = None
) -> Campaign:
    """Read a campaign from the bytes of its CSV file and of its two companion files; `path` names it in messages."""
    findings = Findings()
    needed = "measurement", "see data/README.md for the columns"
    _, delimiter, records = records_of(data, path, lambda cell: cell.lower() in COLUMNS, findings, *needed)
    header, broken = _header(records[0], findings)
    numeric = {rule.name for rule in RULES if rule.name not in ("kind", *AS_TEXT)} | {*header.angles}
    rows = rows_of(records[1:], header, delimiter, findings, numeric)
    places: dict[str, Iterator[int]] = defaultdict(lambda: count(1))  # of the rows in each group
    read = [m for m in map(_measurement, rows) if m]
    measurements = tuple(replace(m, member=next(places[m.group])) if m.group else m for m in read)
    findings += [problem for row in rows for problem in row.problems]
    findings += _duplicate_problems(measurements) if not broken else ()
    refuse(p for p in findings if p.where == header.where or p.column not in broken)
    sha256 = hashlib.sha256(data).hexdigest()
    correlated, frames = _covariance(measurements, path, covariance), _setups(measurements, path, setups)
    return Campaign(Path(path).stem, str(path), sha256, measurements, correlated, frames)


def _covariance(measurements: Iterable[Measurement], path: str | Path, data: bytes | None) -> Covariance | None:
    """Return the correlations of the groups that rows name.

    Raises:
        InputError: groups without a covariance file, a covariance file without groups, or errors in it.
    """
    sizes, beside = Counter(m.group for m in measurements if m.group), covariance_path(path)
    where, expected = one_line(str(beside)), f"rows of {one_line(Path(path).name)} in groups"
    remedy = "name each row's group in a column group, or remove this file"
    require(sizes or data is None, where, "correlations, but no row has a group", expected, remedy)
    remedy = "write it (group,i,j,correlation), or empty the column group"
    is_there, expected = data is not None or not sizes, "the correlations of the rows in groups"
    require(is_there, where, "no such file", expected, remedy)
    return None if data is None else parse_covariance(data, beside, sizes)


def _setups(measurements: Iterable[Measurement], path: str | Path, data: bytes | None) -> Setups:
    """Return the frames of the setups that rows name.

    Raises:
        InputError: a setups file without rows that name a setup, or errors in it.
    """
    names, beside = {m.setup for m in measurements if m.setup}, setups_path(path)
    if data is None:
        return NO_SETUPS
    where, expected = one_line(str(beside)), f"rows of {one_line(Path(path).name)} in them"
    remedy = "name each row's setup in a column setup, or remove this file"
    require(names, where, "frames, but no row names a setup", expected, remedy)
    return parse_setups(data, beside, names)


def _measurement(row: Row) -> Measurement | None:
    """Return the measurement of a row; None if the row has an error."""
    said = row.values(RULES)
    kind = said["kind"]
    said["sigma"] = _read_sigma(row, said)
    factor = row.attempt("unit", si_factor, row["unit"], KINDS[kind]) if kind else None
    for name in ("value", "sigma", "resolution"):
        said[name] = None if factor is None or said[name] is None else factor * said[name]
    said["posture"] = row.posture
    if kind:
        row.problems.extend(replace(problem, where=row.where) for problem in _contradictions(row, said))
    del said["relative_sigma"]
    return None if row.problems else row.attempt("", Measurement, where=row.where, **said)


def _contradictions(row: Row, said: Mapping[str, Any]) -> Iterator[Problem]:
    kind, loads = said["kind"], (said["load"], said["reference_load"])
    yield from role_problems(kind, {name: text for name, text in row.cells.items() if text})
    if said["value"] is not None:
        any_sigma = min(abs(said["value"]), 1e305) or 1.0  # `Measurement` checks the row's own sigma
        yield from value_problems(kind, said["value"], any_sigma)
    if None not in loads:
        yield from load_problems(kind, *loads)


def _read_sigma(row: Row, said: Mapping[str, Any]) -> float | None:
    """Return sigma in the unit in which the value is written."""
    if bool(row["sigma"]) == bool(row["relative_sigma"]):
        got = "both" if row["sigma"] else "nothing"
        row.add(got, "either sigma or relative_sigma", "fill one of the two cells", "sigma")
        return None
    if not row["relative_sigma"]:
        return said["sigma"]
    fraction = row.attempt("relative_sigma", parse_fraction, row["relative_sigma"], row.decimal, said["kind"] or "")
    if said["value"] == 0:
        row.add("a fraction of the value 0", "an absolute sigma", "give sigma instead", "relative_sigma")
    return None if fraction is None or said["value"] is None else fraction * abs(said["value"])


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
# Write a campaign as CSV that reads back equal.

WRITTEN_UNITS = {"frequency": "Hz", "length": "mm", "rotation": "mrad", "damping_ratio": "1", "ratio": "1"}
"""Unit in which each measured quantity is written."""


def write_campaign(
    campaign: Campaign, path: str | Path, *, header_comments: Iterable[str] = (), relative_sigma: bool = False
) -> None:
    """Write a campaign as CSV: postures in deg, frequencies in Hz, deflections in mm, every digit kept.

    The text is read back first, so that `read_campaign` accepts every file written here. The files appear together or
    not at all. Correlations go into `CAMPAIGN.covariance.csv` in the same folder, frames of setups into
    `CAMPAIGN.setups.csv`. A campaign without them removes such a file of an earlier campaign.

    Args:
        campaign: what to write.
        path: the file; an existing one is replaced.
        header_comments: comment lines at the head of the file, such as the origin of the numbers.
        relative_sigma: whether to write standard deviations as fractions of the value, where they can be.
    """
    text = campaign_text(campaign, header_comments=header_comments, relative_sigma=relative_sigma)
    data, beside = text.encode("utf-8", errors="backslashreplace"), covariance_path(path)
    # groups in the order in which reading numbers them
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
    """Write a companion file of the campaign, or remove that of an earlier campaign."""
    if content is None:
        remove_file(path)
    else:
        replace_file(path, lambda file: file.write(content))


def campaign_text(campaign: Campaign, *, header_comments: Iterable[str] = (), relative_sigma: bool = False) -> str:
    """Return a campaign as CSV text below comment lines, with the columns in use; see `write_campaign`."""
    comments = [line for comment in header_comments for line in comment.splitlines() or [""]]
    return csv_text(*campaign_rows(campaign, relative_sigma=relative_sigma), comments)


def campaign_rows(campaign: Campaign, *, relative_sigma: bool = False) -> tuple[list[str], list[dict[str, str]]]:
    """Return the columns in use and the rows of a campaign."""
    angles = [f"q{joint} [deg]" for joint in range(1, campaign.joints + 1)]
    degree = si_factor("deg", "angle")
    postures = [dict(zip(angles, (_written(angle, degree) for angle in m.posture), strict=True)) for m in campaign]
    rows = [posture | _cells(m, relative_sigma) for posture, m in zip(postures, campaign, strict=True)]
    used = [name for name in COLUMNS if name in ("kind", "value", "unit") or any(row.get(name) for row in rows)]
    return ["kind", *angles, *used[1:]], rows


def _cells(m: Measurement, relative_sigma: bool) -> dict[str, str]:
    """Return the cells of a measurement by column, without its posture."""
    unit = WRITTEN_UNITS[KINDS[m.kind]]
    factor = si_factor(unit, KINDS[m.kind])
    cells = {name: getattr(m, name) or "" for name in ("kind", *AS_TEXT)}
    directions = {"direction": m.direction, "reference_direction": m.reference_direction}
    cells |= {name: format_direction(value) if value else "" for name, value in directions.items()}
    cells |= {name: str(getattr(m, name) or "") for name in ("load", "reference_load")}
    cells |= {"value": _written(m.value, factor), "unit": unit}
    if relative_sigma and m.sigma < abs(m.value) * (BARE if m.kind == "frequency" else 1):  # as it is read
        cells["relative_sigma"] = _written(m.sigma, abs(m.value))
    else:
        cells["sigma"] = _written(m.sigma, factor)
    cells["resolution"] = _written(m.resolution, factor) if m.resolution else ""
    return cells | ({"drives": ""} if m.drives == DRIVE_STATES[0] else {})


def _written(value: float, unit: float) -> str:
    """Return value/unit in the fewest digits (15 or 16) that read back as the same value, otherwise in all digits."""
    exact = value / unit
    short = (float(f"{exact:.{digits}g}") for digits in (15, 16))
    return format_number(next((number for number in short if number * unit == value), exact))
