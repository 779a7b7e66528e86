"""The motor and link of joints over time, for `ident joint`: angles and torques, all counted at the joint."""

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float

from ident.errors import Problem, refuse
from ident.measure.series import (
    FARTHEST,
    TIME,
    TRACE_ROWS_MIN,
    Series,
    missing_column,
    parse_series,
    sampling_problems,
)
from ident.measure.table import Findings, read_table
from ident.text import LARGEST_SAMPLES, NAME
from ident.units import QUANTITIES

CHANNELS = {"motor": "angle", "link": "angle", "torque": "moment", "load": "moment"}
"""Columns of a joint, `joint1.motor [deg]`, and the quantity of each: angles of motor and link, the motor's torque,
and the torque in the joint, of a sensor or a model of the arm."""

LEAST, MOST = 1e-9, 1e9
"""Range of an angle [rad] or a torque [N m] in a log: less does not move a joint, more is no robot's."""

_CHANNEL = re.compile(rf"(?P<name>(?P<joint>{NAME})\.(?P<channel>{'|'.join(CHANNELS)}))\s*(\[.*\])?")


@dataclass(frozen=True)
class JointLog:
    """Joints over time.

    Attributes:
        path: the file it was read from.
        sha256: hash of the file's bytes.
        time: (T,) [s] increasing, uniform within 1 %.
        columns: (T,) [rad or N m] by joint and channel, a name in `CHANNELS`.
    """

    path: str
    sha256: str
    time: Float[np.ndarray, " T"]
    columns: Mapping[str, Mapping[str, Float[np.ndarray, " T"]]]

    @property
    def interval(self) -> float:
        """Mean time [s] between two samples."""
        return float(self.time[-1] - self.time[0]) / (len(self.time) - 1)


def read_joint_log(path: str | Path, *, locked: bool = False) -> JointLog:
    """Read joints from a CSV file: `time [s]` and, of each, `joint1.motor [deg]`, `joint1.link [deg]` and a torque.

    Args:
        path: the file; UTF-8, columns separated by comma, semicolon or tab, in any order; further ones are ignored.
        locked: whether the links were clamped, and need no column.

    Returns:
        The log in SI units.

    Raises:
        InputError: the file can't be read, or something in it is wrong; every problem is listed.
    """
    data, findings = read_table(path, LARGEST_SAMPLES), Findings()
    header = parse_series(data, path, {}, TRACE_ROWS_MIN, Findings())
    there = [match for match in map(_CHANNEL.fullmatch, header.ignored) if match]
    wanted = {match["name"]: (CHANNELS[match["channel"]],) for match in there}
    series = parse_series(data, path, wanted, TRACE_ROWS_MIN, findings)
    names = tuple(dict.fromkeys(match["joint"] for match in there))
    if not names:
        expected = "columns as 'joint1.motor [deg]', 'joint1.link [deg]' and 'joint1.torque [N*m]'"
        findings.append(Problem(series.header, "no joint", expected, "name the columns so"))
    findings += [
        *sampling_problems(series),
        *(each for name in names for each in _channel_problems(series, name, locked)),
    ]
    refuse(findings)
    columns = {n: {c: series[f"{n}.{c}"] for c in CHANNELS if f"{n}.{c}" in series} for n in names}
    return JointLog(str(path), series.sha256, series[TIME], columns)


def _channel_problems(series: Series, joint: str, locked: bool) -> Iterator[Problem]:
    """Yield which channels a joint lacks, and those that do not move or vary."""
    given = {channel: f"{joint}.{channel}" for channel in CHANNELS if f"{joint}.{channel}" in series}
    if series.at_fault or not series.where:
        return
    for channel in ("motor", *(() if locked else ("link",))):
        if channel not in given:
            yield missing_column(series.header, f"{joint}.{channel}", "angle", series.ignored)
    if not {"torque", "load"} & {*given}:
        yield missing_column(series.header, f"{joint}.torque", "moment", series.ignored)
    if locked and "link" in given:
        expected = "none, for the link is `locked`"
        yield Problem(series.header, "a link's angle", expected, "drop one of them", given["link"])
    for channel, name in given.items():
        span = float(np.ptp(series[name]))
        if not LEAST < span < MOST:
            got = f"a range of {span:.3g} {QUANTITIES[CHANNELS[channel]].si}" if span else "one value throughout"
            expected = "a joint that moves" if CHANNELS[channel] == "angle" else "a torque that varies"
            yield Problem(series.where[0], got, expected, "log a motion to and fro, or correct the unit", name)
        elif channel == "link" and series.columns[name].unit == "rad" and span > FARTHEST:
            remedy = f"if it is in degrees, write '{name} [deg]'"
            yield Problem(series.where[0], f"a range of {span:.4g} rad", f"at most {FARTHEST:.3g} rad", remedy, name)
