"""From where to where a number is swept, or may be changed: bounds as they are given, and the usual ones."""

from dataclasses import dataclass

import numpy as np

from ident.arm.arm import Arm
from ident.arm.fields import COMPONENTS, SPEED
from ident.errors import InputError, Problem
from ident.vibrate.motion.motion import FASTEST
from ident.vibrate.redesign.sweep import Axis, axis
from ident.vibrate.redesign.variable import Extents, Variable, check, check_path, is_shifted, outside, refuse_factor

SWEPT, CHANGED = (0.4, 2.5), (0.5, 2.0)
"""Factors on the present value between which a number is swept, the speed too, and between which it may be changed."""
SHARE = 0.2
"""Of a body's extent, to either side of the present mass centre, where it is swept."""
DISTANCE = 0.1
"""To either side of any other coordinate [m]."""
COUNT, MAP_COUNT = 21, 15
"""Values of a parameter that is swept alone, and on a map."""
MOST, MOST_ON_MAP = 500, 10_000
"""Values of a parameter, and points of a map."""


@dataclass(frozen=True)
class Bound:
    """A bound of a range.

    Attributes:
        number: SI or %, or a multiple of the present value.
        times: whether it is a multiple.
    """

    number: float
    times: bool = False

    def of(self, present: float) -> float:
        """Return it in SI or %."""
        return self.number * present if self.times else self.number


@dataclass(frozen=True)
class Range:
    """A number, or several that go together, from where to where.

    Attributes:
        paths: the numbers that are changed together, or the speed.
        bounds: lower and upper; None for those that suit the number.
        third: how many values it is swept over, or how dear it is to change; None for the usual.
    """

    paths: tuple[str, ...]
    bounds: tuple[Bound, Bound] | None = None
    third: float | None = None


def axis_of(arm: Arm, interval: Range, percent: float, extents: Extents | None = None, usual: int = COUNT) -> Axis:
    """Return the axis of a range that is swept.

    Coordinates are spaced evenly, and so is the speed between bounds in %; all else by equal factors.

    Args:
        arm: as it is.
        interval: the range; its third number is how many values there are.
        percent: present speed [%]
        extents: of the arm's bodies; a mass centre stays within.
        usual: number of values unless the range says it.
    """
    is_speed, bounds = interval.paths == (SPEED,), interval.bounds
    shifted = _is_shifted(arm, interval)
    present = percent if is_speed else float(arm.get(interval.paths[0]))
    low, high = _ends(interval, present, shifted, SWEPT, SHARE, extents or {})
    count = usual if interval.third is None else interval.third
    if problems := [] if shifted else list(refuse_factor(interval.paths[0], present, (low, high))):
        raise InputError(problems)
    _check_range(low, high, count)
    if is_speed:
        _check_speed(high, percent)
    even = shifted or (is_speed and bounds is not None and not any(bound.times for bound in bounds))
    values = (np.linspace if even else np.geomspace)(low, high, int(count))
    swept = axis(arm, interval.paths, values, percent)
    if problems := [] if is_speed else list(outside(arm, swept.variable, extents or {})):
        raise InputError(problems)
    return swept


def variable_of(arm: Arm, interval: Range, extents: Extents | None = None) -> Variable:
    """Return what may be changed within a range.

    Args:
        arm: as it is.
        interval: the range; its third number is the weight.
        extents: of the arm's bodies; a mass centre stays within.
    """
    if SPEED in interval.paths:
        raise InputError(Problem("", "the speed", "a number of the arm", "sweep it instead (ident sweep)"))
    for path in interval.paths:
        check_path(arm, path)
    present, shifted = float(arm.get(interval.paths[0])), is_shifted(interval.paths[0])
    low, high = _ends(interval, present, shifted, CHANGED, None, extents or {})
    variable = Variable(interval.paths, low, high, 1.0 if interval.third is None else interval.third)
    check(arm, variable, extents)
    return variable


def _is_shifted(arm: Arm, interval: Range) -> bool:
    """Tell whether all numbers of a range are changed by a difference; refuse those that do not go together."""
    if interval.paths == (SPEED,):
        return False
    if SPEED in interval.paths:
        raise InputError(Problem("", "the speed with others", "it alone", "give it a range of its own"))
    for path in interval.paths:
        check_path(arm, path)
    kinds = {is_shifted(path) for path in interval.paths}
    if len(kinds) > 1:
        got, expected = "a coordinate with other numbers", "numbers of one kind"
        remedy = "coordinates are changed by a difference, others by a factor"
        raise InputError(Problem("", got, expected, remedy))
    return kinds.pop()


def _ends(
    interval: Range,
    present: float,
    shifted: bool,
    factors: tuple[float, float],
    share: float | None,
    extents: Extents,
) -> tuple[float, float]:
    """Return the ends of a range; where it has none, by factors, or by a share of a body's extent."""
    if interval.bounds is not None:
        low, high = (bound.of(present) for bound in interval.bounds)
        return (high, low) if present < 0 and all(bound.times for bound in interval.bounds) else (low, high)
    if not shifted:
        low, high = sorted(factor * present for factor in factors)
        return low, high
    return _about(interval.paths[0], present, share, extents)


def _about(path: str, present: float, share: float | None, extents: Extents) -> tuple[float, float]:
    """Return bounds to either side of what is changed by a difference; a mass centre stays within its body."""
    body, field, *component = path.split(".")
    if field == "inertia":
        raise InputError(Problem("", "no bounds", "LOW:HIGH for an inertia", "add them, as =1:2 or =0.5x:2x"))
    if field == "com" and body in extents:
        lowest, highest = extents[body][:, COMPONENTS[component[0]][0]]
        half = DISTANCE if share is None else share * (highest - lowest)
        return max(present - half, float(lowest)), min(present + half, float(highest))
    half = np.pi if field.endswith("phase") else DISTANCE
    return present - half, present + half


def _check_range(low: float, high: float, count: float) -> None:
    got = f"{low:g} to {high:g}"
    if not (np.isfinite([low, high]).all() and low < high):
        raise InputError(Problem("", got, "a lower and a higher bound", "correct them"))
    if not 2 <= count <= MOST or count != int(count):
        raise InputError(Problem("", f"{count:.12g} values", f"a whole number from 2 to {MOST}", "correct the count"))


def _check_speed(high: float, percent: float) -> None:
    most = min(FASTEST, percent * FASTEST / 100)
    if high > most * (1 + 1e-12):
        remedy = "start from a higher `speed`" if most < FASTEST else "100 is full speed"
        raise InputError(Problem("", f"{high:g} %", f"at most {most:g} %", remedy))
