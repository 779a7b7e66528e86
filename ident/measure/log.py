"""Joint paths as logged by a robot's controller, and checks for paths that no joint can follow."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from jaxtyping import Float

from ident.errors import Problem, refuse
from ident.measure.columns import Rule
from ident.measure.series import TIME, Sampled, Series, parse_series
from ident.measure.table import (
    Findings,
    read_table,
)
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
WRAP_SPEED = 10.0
"""Joint speed [rad/s] above which a step of a whole turn is a wrap, if the rest of the step is slower; assumed."""
JUDGED_ROWS_MIN = 50
"""Fewest rows, and changes of the angles, to judge clock and rate of a log: a list of points has fewer."""
HELD_STEP = 4
"""Jump of sample-held angles, in steps of the last digit; a slow encoder's jump is one or two."""
ROUGH = 2.0
"""Smoothness of the angles over even steps, relative to that over their times, from which the times are late; assumed.
"""


@dataclass(frozen=True)
class Log(Sampled):
    """Joint angles over time.

    Attributes:
        angles: (T,) [rad] by joint, in the requested order of the joints.
        ignored: names of further columns of the file, as in its header.
        notes: repairs and possible errors.
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
        InputError: the file is unreadable or has errors; all are listed.
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
    """Undo wraps of whole turns and delays below half a step; note this, and angles that may be in radians."""
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
    """Whether angles are smoother over even steps than over times that vary from row to row.

    Compares second differences, each divided by the noise of its three samples, so that pure noise gives no preference.
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
    """Yield arrival times in bursts, or angles that are all held over several rows."""
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
