"""Joint paths as logged by a robot's controller, and checks for paths that no joint can follow."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from jaxtyping import Float

from ident.errors import Problem, refuse
from ident.measure.columns import Rule
from ident.measure.recordings.sampling import GAP, UNEVEN, held_rows, truer_times
from ident.measure.samples import NONE, TIME, Columns
from ident.measure.series import Sampled, Series, parse_series
from ident.measure.table import Findings, read_table
from ident.text import LARGEST_SAMPLES

FEWEST_ROWS = 4
"""Fewest rows of a log."""
FASTEST = 100.0
"""Joint speed [rad/s] above which the header has the wrong unit of angle or time, or the value is an outlier; assumed.
"""
FARTHEST = 10 * 2 * math.pi
"""Angle [rad] beyond which a column marked rad must be in degrees."""
RADIANS = ("rad", "radian", "radians")
"""Names of the radian; mrad and others are not mistaken for degrees."""
BRIDGED = 0.01
"""Motion across missing rows, as a share of a joint's range, from which the gap is noted; assumed."""
MOSTLY = 0.9
"""Share of even steps from which a log is one with gaps, and no list of points; assumed."""
WRAP_SPEED = 10.0
"""Joint speed [rad/s] above which a step of a whole turn is a wrap, if the rest of the step is slower; assumed."""


@dataclass(frozen=True)
class Log(Sampled):
    """Joint angles over time.

    Attributes:
        angles: (T,) [rad] by joint, in the requested order of the joints.
        ignored: names of further columns of the file, as in its header.
        notes: repairs, possible errors, and what was taken from a program's convention.
    """

    angles: Mapping[str, Float[np.ndarray, " T"]]
    ignored: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()


def read_log(path: str | Path, joints: Sequence[str], columns: Columns = NONE) -> Log:
    """Read a log from a CSV file with the columns `time [s]` and, for each joint, `joint1 [deg]`, in any order.

    Args:
        path: the file; UTF-8, columns separated by comma, semicolon, tab or blanks, any units of time and angle.
        joints: names of the driven joints; each has a column, further columns are ignored.
        columns: headers by names of the file, `{"actual_q_0": "joint1 [rad]"}`, for what it does not say itself.

    Returns:
        The log in SI units.

    Raises:
        InputError: the file is unreadable or has errors; all are listed.
    """
    return parse_log(read_table(path, LARGEST_SAMPLES), path, joints, columns)


def parse_log(data: bytes, path: str | Path, joints: Sequence[str], columns: Columns = NONE) -> Log:
    """Read a log from the bytes of a CSV file; `path` names it in messages."""
    findings = Findings()
    rules = [
        Rule(joint, quantities=("angle",), required=True, alias=rf"(?:actual|target)_q_?{number}")
        for number, joint in enumerate(joints)
    ]
    series = parse_series(data, path, rules, FEWEST_ROWS, findings, columns)
    notes = list[str]()
    series = series if findings else _mended(series, joints, notes)
    findings += [problem for joint in joints for problem in _joint_problems(series, joint)]
    refuse(findings)
    angles = {joint: series[joint] for joint in joints}
    return Log(str(path), series.sha256, series[TIME], angles, series.header.ignored, (*notes, *series.remarks))


def _mended(series: Series, joints: Sequence[str], notes: list[str]) -> Series:
    """Undo held rows, wraps of whole turns and stamps of arrival; note this, and angles that may be in radians."""
    columns, where = dict(series.columns), series.where
    rows = held_rows(np.stack([columns[joint] for joint in joints]))
    if rows is not None:
        notes.append(f"{series.file}: angles repeat; 1 row of {len(where) / len(rows):.3g} is new, and was read")
        columns, where = {name: column[rows] for name, column in columns.items()}, tuple(where[row] for row in rows)
        series = replace(series, columns=columns, where=where)
    time = columns[TIME]
    steps = np.diff(time)
    for joint in joints:
        jumps = np.diff(series[joint])
        turns = np.sign(jumps)
        turns *= (abs(jumps) > WRAP_SPEED * steps) & (abs(jumps - 2 * np.pi * turns) <= WRAP_SPEED * steps)
        if turns.any():
            columns[joint] = series[joint] - 2 * np.pi * np.append(0, turns.cumsum())
            first = series.where[int(turns.nonzero()[0][0]) + 1]
            notes.append(f"{first}, {joint}: jumps by a whole turn were undone, {np.count_nonzero(turns)} in all")
    even = truer_times(time, np.stack([columns[joint] for joint in joints]))
    if even is not None:
        columns[TIME], off = even, abs(time - even).max()
        words = f"even steps of {1e3 * np.median(np.diff(even)):.4g} ms, which were taken instead"
        notes.append(f"{series.file}, {TIME}: up to {1e3 * off:.2g} ms off {words}")
    gaps = _gaps(time, np.stack([columns[joint] for joint in joints]))
    if len(gaps):
        first = f"{time[gaps[0]]:.6g} to {time[gaps[0] + 1]:.6g} s"
        notes.append(f"{series.file}: no row from {first} while the arm moves, {len(gaps)} such in all; bridged")
    largest = math.degrees(max(abs(series[joint]).max() for joint in joints))
    if 0 < largest <= 2 * np.pi and not any(series.header.units[joint].written in RADIANS for joint in joints):
        notes.append(f"{series.header.where}: no angle beyond {largest:.3g} deg; for radians write '{joints[0]} [rad]'")
    return replace(series, columns=columns)


def _gaps(time: np.ndarray, angles: np.ndarray) -> np.ndarray:
    """Return the rows before gaps of an otherwise even log (J, T) in which the arm moves on."""
    steps, ranges = np.diff(time), np.ptp(angles, axis=1)
    usual = float(np.median(steps))
    even = (abs(steps - usual) <= UNEVEN * usual).mean() > MOSTLY
    moved = (abs(np.diff(angles))[ranges > 0] > BRIDGED * ranges[ranges > 0, None]).any(0)
    return np.flatnonzero((steps >= GAP * usual) & moved) if even else np.zeros(0, int)


def _joint_problems(series: Series, joint: str) -> Iterator[Problem]:
    """Yield the first impossible angle of a column in rad, or the first impossible jump of a joint."""
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
