"""Columns of numbers over time, each with its unit in the header: what logs and traces have in common."""

import hashlib
import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from jaxtyping import Float

from ident.errors import Problem, refusal, refuse, require
from ident.measure.columns import EXAMPLES, Header, Rule, read_header
from ident.measure.recordings.sampling import UNEVEN, odd_interval
from ident.measure.table import (
    Findings,
    decimal_mark,
    fitting,
    grouped,
    name_and_unit,
    parse_number,
    read_table,
    records_of,
)
from ident.text import LARGEST_SAMPLES, NAME, quoted
from ident.units import to_si

TIME = "time"
"""Name of the column that every such file has."""

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
    """

    file: str
    sha256: str
    header: Header
    where: tuple[str, ...]
    columns: Mapping[str, Float[np.ndarray, " T"]]
    at_fault: frozenset[str]

    def __contains__(self, name: str) -> bool:
        return name in self.columns

    def __getitem__(self, name: str) -> Float[np.ndarray, " T"]:
        return self.columns[name]


def parse_series(data: bytes, path: str | Path, rules: Sequence[Rule], rows: int, findings: Findings) -> Series:
    """Read time and the wanted columns from the bytes of a CSV file, and check that time increases.

    Args:
        data: the bytes; UTF-8, columns separated by comma, semicolon or tab, comments after `#`.
        path: names the file in messages.
        rules: of the wanted columns; further ones are ignored.
        rows: the fewest rows that will do.
        findings: where problems are put; reading goes on.

    Returns:
        What could be read.
    """
    is_column = lambda name: name_and_unit(name)[0].lower() == TIME or name.endswith("]")  # noqa: E731
    file, delimiter, records = records_of(data, path, is_column, findings, "time", "check the file")
    wanted, faults, misfits = [Rule(TIME, quantities=("time",), required=True), *rules], Findings(), Findings()
    header = read_header(records[0], wanted, "", faults)
    at_fault = frozenset(problem.column for problem in faults)
    rows_read = fitting(records[1:], len(header.names), delimiter, misfits)
    findings += [*faults, *counted(misfits)]
    places = {rule.name: header.names.index(rule.name) for rule in wanted if rule.name in header.units}
    decimal = decimal_mark(delimiter, (cells[place] for _, cells in rows_read for place in places.values()))
    columns = dict[str, np.ndarray]()
    for name in [name for name in places if name not in at_fault]:
        mine, place, factor = Findings(), places[name], header.units[name].factor
        values = [mine.attempt(row, name, _number, cells[place], decimal, factor) for row, cells in rows_read]
        columns[name] = np.array(values, float)
        findings += counted(mine)
    sha256, where = hashlib.sha256(data).hexdigest(), tuple(row for row, _ in rows_read)
    series = Series(file, sha256, header, where, columns, at_fault)
    findings += counted(_time_problems(series))
    given = len(records) - 1
    if given < rows:
        got = f"{given} row{'s' if given > 1 else ''}"
        findings.append(Problem(file, got, f"at least {rows}", "give a longer recording"))
    return series


def counted(problems: Iterable[Problem]) -> Iterator[Problem]:
    """Yield the first problem of each kind, and in which rows the others are: a column of bad cells is one mistake."""
    for first, *more in grouped(problems, lambda each: (each.column, each.expected, each.remedy)).values():
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


# -------- Log
# A joint path as a robot controller logs it: time and joint angles, from CSV into SI units.

FEWEST_ROWS = 4
"""Fewest rows of a log."""

FASTEST = 100.0
"""Joint speed [rad/s] above which angle or time must be in another unit than the header says, or an outlier;
assumed."""

FARTHEST = 10 * 2 * math.pi
"""Angle [rad] beyond which a column marked rad must be in degrees."""

RADIANS = ("rad", "radian", "radians")
"""Names of the radian; mrad and others are nobody's mistake."""

WRAP_SPEED = 10.0
"""Joint speed [rad/s] above which a step of a whole turn is a wrap, if what remains of it is slower; assumed."""

JUDGED_ROWS_MIN = 50
"""Fewest rows, and changes of the angles, by which clock and rate of a log are judged: a list of points has fewer."""

HELD_STEP = 4
"""Steps of the last digit by which held angles change at once; those of a slow encoder change by one or two."""

ROUGH = 2.0
"""Times by which the angles are smoother over even steps than over their times where the times are late; assumed."""


@dataclass(frozen=True)
class Log(Sampled):
    """Joint angles over time.

    Attributes:
        angles: (T,) [rad] by joint, in the order in which the joints were asked for.
        ignored: names of further columns of the file, as written in its header.
        notes: what was mended in it, or may be wrong.
    """

    angles: Mapping[str, Float[np.ndarray, " T"]]
    ignored: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()


def read_log(path: str | Path, joints: Sequence[str]) -> Log:
    """Read a log from a CSV file with the columns `time [s]` and, for each joint, `joint1 [deg]`, in any order.

    Args:
        path: the file; UTF-8, columns separated by comma, semicolon or tab, any units of time and angle.
        joints: names of the driven joints; each has a column, further columns are ignored.

    Returns:
        The log in SI units.

    Raises:
        InputError: the file can't be read, or something in it is wrong; every problem is listed.
    """
    return parse_log(read_table(path, LARGEST_SAMPLES), path, joints)


def parse_log(data: bytes, path: str | Path, joints: Sequence[str]) -> Log:
    """Read a log from the bytes of a CSV file; `path` names it in messages."""
    findings = Findings()
    rules = [Rule(joint, quantities=("angle",), required=True) for joint in joints]
    series = parse_series(data, path, rules, FEWEST_ROWS, findings)
    notes, whole = list[str](), not findings
    series = _mended(series, joints, notes) if whole else series
    findings += [problem for joint in joints for problem in _joint_problems(series, joint)]
    if whole and not findings:
        findings += _clock_problems(series, joints)
    refuse(findings)
    angles = {joint: series[joint] for joint in joints}
    return Log(str(path), series.sha256, series[TIME], angles, series.header.ignored, tuple(notes))


def _mended(series: Series, joints: Sequence[str], notes: list[str]) -> Series:
    """Undo wraps of whole turns, and times late by less than half a step; note it, and angles that may be radians."""
    columns, time = dict(series.columns), series[TIME]
    steps = np.diff(time)
    for joint in joints:
        jumps = np.diff(series[joint])
        turns = np.sign(jumps)
        turns *= (abs(jumps) > WRAP_SPEED * steps) & (abs(jumps - 2 * np.pi * turns) <= WRAP_SPEED * steps)
        if turns.any():
            columns[joint] = series[joint] - 2 * np.pi * np.append(0, turns.cumsum())
            where = series.where[int(turns.nonzero()[0][0]) + 1]
            notes.append(f"{where}, {joint}: jumps by a whole turn were undone, {np.count_nonzero(turns)} in all")
    even = np.append(0.0, np.rint(steps / np.median(steps)).cumsum())
    if _smoother(time, np.stack([columns[joint] for joint in joints]), even):
        step, start = np.polyfit(even, time, 1)
        off = f"{1e3 * abs(time - start - step * even).max():.2g} ms off"
        columns[TIME] = start + step * even
        notes.append(f"{series.file}, {TIME}: up to {off} even steps of {1e3 * step:.4g} ms, which were taken instead")
    largest = math.degrees(max(abs(series[joint]).max() for joint in joints))
    if 0 < largest <= 2 * np.pi and not any(series.header.units[joint].written in RADIANS for joint in joints):
        notes.append(f"{series.header.where}: no angle beyond {largest:.3g} deg; for radians write '{joints[0]} [rad]'")
    return replace(series, columns=columns)


def _smoother(time: np.ndarray, angles: np.ndarray, even: np.ndarray) -> bool:
    """Tell whether angles are smoother over even numbers than over times that vary from row to row.

    By second differences, each over the noise that it takes from its three samples: noise alone is alike over both.
    """
    steps, sizes = np.diff(time), list[float]()
    if len(steps) < JUDGED_ROWS_MIN or np.diff(steps).std() <= steps.std() or not (np.diff(even) > 0).all():
        return False
    for t in (time, even):
        before, after = np.diff(t)[:-1], np.diff(t)[1:]
        weights = np.stack([after, -before - after, before]) / np.sqrt(2 * (before**2 + before * after + after**2))
        sizes.append(np.square(sum(weights[k] * angles[:, k : len(t) - 2 + k] for k in range(3))).sum())
    return bool(sizes[0] > ROUGH**2 * sizes[1])


def _clock_problems(series: Series, joints: Sequence[str]) -> Iterator[Problem]:
    """Yield that times are those of arrival, in bursts, or that all angles are held for several rows each."""
    steps, angles = np.diff(series[TIME]), np.stack([series[joint] for joint in joints])
    if _smoother(series[TIME], angles, np.arange(len(steps) + 1.0)):
        got = f"steps from {1e3 * steps.min():.3g} to {1e3 * steps.max():.3g} ms, as data arrive"
        remedy = f"log the controller's own clock; if no row is missing, write steps of {1e3 * steps.mean():.4g} ms"
        yield Problem(series.file, got, "the times at which the angles were measured", remedy, TIME)
    sizes = abs(np.diff(angles))
    changes, least = np.flatnonzero(sizes.any(0)), np.where(sizes > 0, sizes, np.inf).min(1, keepdims=True)
    apart = np.diff(changes, prepend=-len(steps), append=2 * len(steps))
    alone = (np.minimum(apart[:-1], apart[1:]) > 1) & (sizes > HELD_STEP * least)[:, changes].any(0)
    if len(changes) >= JUDGED_ROWS_MIN and alone.mean() > 0.5:
        got, rows = "angles that all joints hold for several rows, and then jump", round(float(np.median(apart)))
        yield Problem(series.file, got, "new angles in each row", f"keep only the rows with new ones, 1 of {rows}")


def _joint_problems(series: Series, joint: str) -> Iterator[Problem]:
    """Yield the first angle that a column marked rad can't have, or jump that no joint makes."""
    if joint in series.at_fault:
        return
    angles, far = series[joint], np.flatnonzero(abs(series[joint]) > FARTHEST)
    if series.header.units[joint].written in RADIANS and far.size:
        got, expected = f"{angles[far[0]]:.6g} rad", "at most ten turns, 62.8 rad"
        remedy = f"if the angles are in degrees, write '{joint} [deg]' in the header"
        yield Problem(series.where[far[0]], got, expected, remedy, joint)
        return
    steps, jumps = np.diff(series[TIME] if TIME in series else 0.0 * angles), np.diff(angles)
    fast = np.flatnonzero((steps > 0) & (abs(jumps) > FASTEST * steps))
    if not fast.size:
        return
    row = int(fast[0])
    got = f"a jump of {jumps[row]:.4g} rad within {steps[row]:.4g} s, {abs(jumps[row]) / steps[row]:.4g} rad/s"
    headers = " and ".join(f"'{name} [{series.header.units[name].written}]'" for name in (joint, TIME))
    remedy = f"check the units in {headers}, or remove the outlier"
    yield Problem(series.where[row + 1], got, f"at most {FASTEST:g} rad/s", remedy, joint)


# -------- Trace
# A measured vibration of the end point: displacement or acceleration over time, from CSV into SI units.

DIRECTIONS = ("x", "y", "z")
"""Names of the columns: axes of the base frame."""

KINDS = {"length": "displacement", "acceleration": "acceleration"}
"""What a trace may be of, by the quantity of its units."""

TRACE_ROWS_MIN = 16
"""Fewest rows of a trace."""


@dataclass(frozen=True)
class Trace(Sampled):
    """A vibration over time, sampled at equal intervals.

    Attributes:
        kind: `displacement` or `acceleration`.
        values: (T,) [m or m/s^2] by direction, `x`, `y` or `z` of the base frame.
        ignored: names of further columns of the file, as written in its header.
    """

    kind: str
    values: Mapping[str, Float[np.ndarray, " T"]]
    ignored: tuple[str, ...] = ()


def read_trace(path: str | Path) -> Trace:
    """Read a trace from a CSV file with the columns `time [s]` and any of `x [mm]`, `y [mm]`, `z [mm]`.

    The unit tells displacement from acceleration, `x [m/s^2]`; one file has one of the two.

    Args:
        path: the file; UTF-8, columns separated by comma, semicolon or tab, in any order; further ones are ignored.

    Returns:
        The trace in SI units.

    Raises:
        InputError: the file can't be read, or something in it is wrong; every problem is listed.
    """
    return parse_trace(read_table(path, LARGEST_SAMPLES), path)


def parse_trace(data: bytes, path: str | Path) -> Trace:
    """Read a trace from the bytes of a CSV file; `path` names it in messages."""
    findings = Findings()
    rules = [Rule(direction, quantities=tuple(KINDS)) for direction in DIRECTIONS]
    series = parse_series(data, path, rules, TRACE_ROWS_MIN, findings)
    findings += [*_kind_problems(series), *sampling_problems(series)]
    refuse(findings)
    values = {direction: series[direction] for direction in DIRECTIONS if direction in series}
    kind = KINDS[series.header.units[next(iter(values))].quantity]
    return Trace(str(path), series.sha256, series[TIME], kind, values, series.header.ignored)


def _kind_problems(series: Series) -> Iterator[Problem]:
    where, given = series.header.where, {name: series.header.units[name] for name in DIRECTIONS if name in series}
    if not given and not series.at_fault & set(DIRECTIONS):
        expected = f"a column 'x [{EXAMPLES['length']}]', or y or z, or in '{EXAMPLES['acceleration']}'"
        yield Problem(where, "no direction", expected, "name the measured directions in the header")
    for name, unit in given.items():
        kind, (other, first) = KINDS[unit.quantity], next(iter(given.items()))
        if unit.quantity != first.quantity:
            got, expected = f"{kind} in '{unit.written}'", f"{KINDS[first.quantity]}, as of {other}"
            yield Problem(where, got, expected, "put displacements and accelerations into two files", name)


def sampling_problems(series: Series) -> Iterator[Problem]:
    """Find the interval that differs most from the median one, once time increases."""
    steps = np.diff(series[TIME]) if TIME in series else np.zeros(0)
    if not steps.size or not (steps > 0).all():
        return
    mean = steps.mean()
    if abs(steps - mean).max() > UNEVEN * mean:
        row, expected, remedy = odd_interval(series[TIME])
        got = f"{steps[row]:.6g} s since the row before"
        yield Problem(series.where[row + 1], got, expected, remedy, TIME)


# -------- Pulleys
# Pulleys in a CSV file of a trace: turning frequency over time, as `ident simulate` writes them.

_COLUMN = re.compile(rf"(?P<name>(?P<pulley>{NAME})\.frequency)\s*\[.*\]")
"""A column such as `drive1.frequency [Hz]`."""


def read_pulleys(path: str | Path, trace: Trace) -> Mapping[str, Float[np.ndarray, " T"]]:
    """Read how pulleys turn from the file of a trace, by name (T,) [Hz]; mostly none if it was measured.

    Args:
        path: the file.
        trace: what `read_trace` has read from it.
    """
    there = [match for match in map(_COLUMN.fullmatch, trace.ignored) if match]
    if not there:
        return {}
    rules, findings = [Rule(match["name"], quantities=("frequency",)) for match in there], Findings()
    series = parse_series(read_table(path, LARGEST_SAMPLES), path, rules, TRACE_ROWS_MIN, findings)
    refuse(findings)
    return {match["pulley"]: series[match["name"]] for match in there}


# -------- Speeds
# What turns at a known speed during a test: pulleys, motors, fans.

SYNTAX = "terms joined by ' + ', each like '2.25 Hz @ pulley 1' or '1450 rpm @ pump'"
_TERM = re.compile(r"(?P<value>[0-9.,]+(?:[eE][+-]?[0-9]+)?)\s*(?P<unit>[^\W\d_]+)\s*@\s*(?P<name>[^@+]+)")


@dataclass(frozen=True)
class Speed:
    """Something that turns.

    Attributes:
        name: what it is.
        frequency: [Hz] revolutions in a second.
    """

    name: str
    frequency: float


def parse_speeds(text: str, decimal: str = ".") -> tuple[Speed, ...]:
    """Read speeds such as `2.25 Hz @ pulley 1 + 1450 rpm @ pump`; blank is none.

    Raises:
        InputError: the text doesn't follow the syntax.
    """
    return tuple(_speed(term, decimal) for term in text.split(" + ")) if text.strip() else ()


def _speed(term: str, decimal: str) -> Speed:
    match, remedy = _TERM.fullmatch(term.strip()), "correct it, or leave the cell empty"
    if not match:
        raise refusal("", quoted(term), SYNTAX, remedy)
    value = to_si(parse_number(match["value"], decimal), match["unit"], "frequency")
    require(value > 0, "", quoted(term), "a speed above 0", remedy)
    return Speed(match["name"].strip(), value)
