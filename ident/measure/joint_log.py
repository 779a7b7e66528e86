"""The motor and link of joints over time, for `ident joint`: angles and torques, all counted at the joint."""

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float

from ident.errors import Problem, refuse
from ident.measure.columns import Rule
from ident.measure.log import FARTHEST
from ident.measure.samples import NONE, Columns
from ident.measure.series import Sampled, Series, parse_series
from ident.measure.table import Findings, read_table
from ident.measure.trace import TRACE_ROWS_MIN, at_even_times
from ident.text import LARGEST_SAMPLES, NAME, by_key
from ident.units import QUANTITIES

CHANNELS = {"motor": "angle", "link": "angle", "torque": "moment", "load": "moment"}
"""Columns of a joint, `joint1.motor [deg]`, and the quantity of each: angles of motor and link, the motor's torque,
and the torque in the joint, of a sensor or a model of the arm."""

LEAST, MOST = 1e-9, 1e9
"""Range of an angle [rad] or a torque [N m] in a log: less does not move a joint, more is no robot's."""

_CHANNEL = re.compile(rf"(?P<name>(?P<joint>{NAME})\.(?P<channel>{'|'.join(CHANNELS)}))\s*(\[.*\])?")


@dataclass(frozen=True)
class JointLog(Sampled):
    """Joints over time.

    Attributes:
        columns: (T,) [rad or N m] by joint and channel, a name in `CHANNELS`.
        notes: what was taken from a program's convention, and done to the times.
    """

    columns: Mapping[str, Mapping[str, Float[np.ndarray, " T"]]]
    notes: tuple[str, ...] = ()


def read_joint_log(path: str | Path, *, locked: bool = False, columns: Columns = NONE) -> JointLog:
    """Read joints from a CSV file: `time [s]` and, of each, `joint1.motor [deg]`, `joint1.link [deg]` and a torque.

    Args:
        path: the file; UTF-8, columns separated by comma, semicolon or tab, in any order; further ones are ignored.
        locked: whether the links were clamped, and need no column.
        columns: headers by names of the file, `{"q": "joint1.motor [rad]"}`, for what it does not say itself.

    Returns:
        The log in SI units.

    Raises:
        InputError: the file can't be read, or something in it is wrong; every problem is listed.
    """
    data, findings = read_table(path, LARGEST_SAMPLES), Findings()
    header = parse_series(data, path, (), TRACE_ROWS_MIN, Findings(), columns).header
    matches = [match for match in map(_CHANNEL.fullmatch, header.ignored) if match]
    joints, rules = by_key((match["joint"], match) for match in matches), list[Rule]()
    for joint, given in joints.items():  # the link unless it is locked, and one torque
        needed = {"motor"} if locked else {"motor", "link"}
        needed |= set() if any(match["channel"] == "load" for match in given) else {"torque"}
        rules += [Rule(f"{joint}.{c}", quantities=(of,), required=c in needed) for c, of in CHANNELS.items()]
    series = parse_series(data, path, rules, TRACE_ROWS_MIN, findings, columns)
    if not joints:
        expected = "columns as 'joint1.motor [deg]', 'joint1.link [deg]' and 'joint1.torque [N*m]'"
        findings.append(Problem(header.where, "no joint", expected, "name the columns so"))
    for rule in rules:
        read = series.where and rule.name in series and np.isfinite(series[rule.name]).all()
        findings += _motion_problems(series, rule, locked) if read else ()
    refuse(findings)
    time, values, even = at_even_times(series, {rule.name: series[rule.name] for rule in rules if rule.name in series})
    own = {n: {c: values[f"{n}.{c}"] for c in CHANNELS if f"{n}.{c}" in values} for n in joints}
    return JointLog(str(path), series.sha256, time, own, (*even.remarks, *series.remarks))


def _motion_problems(series: Series, rule: Rule, locked: bool) -> Iterator[Problem]:
    """Yield a channel that does not move or vary, and the angle of a link that is locked."""
    name, channel, unit = rule.name, rule.name.rpartition(".")[2], series.header.units[rule.name]
    if locked and channel == "link":
        yield Problem(series.header.where, "a link's angle", "none, for the link is `locked`", "drop one of them", name)
    span = float(np.ptp(series[name]))
    if not LEAST < span < MOST:
        got = f"a range of {span:.3g} {QUANTITIES[unit.quantity].si}" if span else "one value throughout"
        expected = "a joint that moves" if unit.quantity == "angle" else "a torque that varies"
        yield Problem(series.where[0], got, expected, "log a motion to and fro, or correct the unit", name)
    elif channel == "link" and unit.written == "rad" and span > FARTHEST:
        remedy = f"if it is in degrees, write '{name} [deg]'"
        yield Problem(series.where[0], f"a range of {span:.4g} rad", f"at most {FARTHEST:.3g} rad", remedy, name)
