"""A joint path as a robot controller logs it: time and joint angles, from CSV into SI units."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float

from ident.errors import InputError, Problem
from ident.measure.series import TIME, Series, missing_column, parse_series
from ident.measure.table import Findings, read_table
from ident.text import LARGEST_SAMPLES

FEWEST_ROWS = 4
"""Fewest rows of a log."""

FASTEST = 100.0
"""Joint speed [rad/s] above which angle or time must be in another unit than the header says, or an outlier."""

FARTHEST = 10 * 2 * math.pi
"""Angle [rad] beyond which a column marked rad must be in degrees."""


@dataclass(frozen=True)
class Log:
    """Joint angles over time.

    Attributes:
        path: the file it was read from.
        sha256: hash of the file's bytes.
        time: (T,) [s] increasing.
        angles: (T,) [rad] by joint, in the order in which the joints were asked for.
        ignored: names of further columns of the file, as written in its header.
    """

    path: str
    sha256: str
    time: Float[np.ndarray, " T"]
    angles: Mapping[str, Float[np.ndarray, " T"]]
    ignored: tuple[str, ...] = ()


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
    series = parse_series(data, path, dict.fromkeys(joints, ("angle",)), FEWEST_ROWS, findings)
    findings += [problem for joint in joints for problem in _joint_problems(series, joint)]
    if findings:
        raise InputError(findings)
    return Log(str(path), series.sha256, series[TIME], {joint: series[joint] for joint in joints}, series.ignored)


def _joint_problems(series: Series, joint: str) -> Iterator[Problem]:
    if joint not in series and joint not in series.at_fault:
        yield missing_column(series.header, joint, "angle", series.ignored)
    elif joint in series:
        yield from _far(series, joint) or _fast(series, joint)


def _far(series: Series, joint: str) -> list[Problem]:
    """Find the first angle that a column marked rad can't have."""
    angles, unit = series[joint], series.columns[joint].unit
    far = np.flatnonzero(abs(angles) > FARTHEST)
    if unit not in ("rad", "radian", "radians") or not far.size:
        return []
    got, expected = f"{angles[far[0]]:.6g} rad", "at most ten turns, 62.8 rad"
    remedy = f"if the angles are in degrees, write '{joint} [deg]' in the header"
    return [Problem(series.where[far[0]], got, expected, remedy, joint)]


def _fast(series: Series, joint: str) -> list[Problem]:
    """Find the first jump of an angle that no joint makes."""
    if TIME not in series:
        return []
    steps, jumps = np.diff(series[TIME]), np.diff(series[joint])
    fast = np.flatnonzero((steps > 0) & (abs(jumps) > FASTEST * steps))
    if not fast.size:
        return []
    row = int(fast[0])
    got = f"a jump of {jumps[row]:.4g} rad within {steps[row]:.4g} s, {abs(jumps[row]) / steps[row]:.4g} rad/s"
    headers = " and ".join(f"'{name} [{series.columns[name].unit}]'" for name in (joint, TIME))
    remedy = f"check the units in {headers}, or remove the outlier"
    return [Problem(series.where[row + 1], got, f"at most {FASTEST:g} rad/s", remedy, joint)]
