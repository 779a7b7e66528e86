"""Over which values a number is swept: bounds as a user gives them, and what they are when he gives none."""

from dataclasses import dataclass

import numpy as np

from ident.arm.arm import COMPONENTS, Arm
from ident.errors import InputError, Problem
from ident.vibrate.motion.motion import FASTEST
from ident.vibrate.redesign.sweep import SPEED, Axis, axis
from ident.vibrate.redesign.variable import Extents, check_path, is_shifted, outside

FACTORS = (0.4, 2.5)
"""Of the present value, for what is changed by a factor and for the speed."""
SHARE = 0.2
"""Of a body's extent, to either side of the present mass centre."""
DISTANCE = 0.1
"""To either side of a coordinate, unless a share of a body's extent is given [m]."""
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
    """What is swept, from where to where.

    Attributes:
        paths: the numbers that are changed together, or the speed.
        bounds: lower and upper; None for those that suit the number.
        count: of values; None for as many as usual.
    """

    paths: tuple[str, ...]
    bounds: tuple[Bound, Bound] | None = None
    count: int | None = None


def axis_of(arm: Arm, span: Range, percent: float, extents: Extents | None = None, usual: int = COUNT) -> Axis:
    """Return the axis of a range.

    Coordinates are spaced evenly, and so is the speed between bounds in %; all else by equal factors.

    Args:
        arm: as it is.
        span: the range.
        percent: present speed [%]
        extents: of the arm's bodies; a mass centre stays within.
        usual: number of values unless the range says it.

    Raises:
        InputError: no such number, numbers that do not go together, a range that can't be, or a mass centre outside its
            body.
    """
    is_speed = span.paths == (SPEED,)
    shifted = _is_shifted(arm, span)
    present = percent if is_speed else float(arm.get(span.paths[0]))
    if not shifted and not present > 0:
        got, remedy = f"{present:g} at present", "it is changed by a factor: set it first (--set)"
        raise InputError(Problem("", got, "a number above 0", remedy))
    low, high = _ends(arm, span, present, extents or {}, shifted)
    count = usual if span.count is None else span.count
    _check(low, high, count, shifted)
    if is_speed:
        _check_speed(high, percent)
    even = shifted or (is_speed and span.bounds is not None and not any(bound.times for bound in span.bounds))
    swept = axis(arm, span.paths, (np.linspace if even else np.geomspace)(low, high, count), percent)
    if problems := [] if is_speed else list(outside(arm, swept.variable, extents or {})):
        raise InputError(problems)
    return swept


def _is_shifted(arm: Arm, span: Range) -> bool:
    """Tell whether all numbers of a range are changed by a difference; refuse those that do not go together."""
    if span.paths == (SPEED,):
        return False
    if SPEED in span.paths:
        raise InputError(Problem("", "the speed with others", "it alone", "give it a range of its own"))
    for path in span.paths:
        check_path(arm, path)
    kinds = {is_shifted(path) for path in span.paths}
    if len(kinds) > 1:
        got, expected = "a coordinate with other numbers", "numbers of one kind"
        remedy = "coordinates are changed by a difference, others by a factor"
        raise InputError(Problem("", got, expected, remedy))
    return kinds.pop()


def _ends(arm: Arm, span: Range, present: float, extents: Extents, shifted: bool) -> tuple[float, float]:
    if span.bounds is not None:
        low, high = (bound.of(present) for bound in span.bounds)
        return low, high
    if not shifted:
        return FACTORS[0] * present, FACTORS[1] * present
    return about(span.paths[0], present, extents, share=SHARE)


def about(path: str, present: float, extents: Extents, *, share: float | None = None) -> tuple[float, float]:
    """Return bounds to either side of what is changed by a difference.

    Args:
        path: the number.
        present: as it is [SI]
        extents: of the arm's bodies; a mass centre stays within.
        share: of a body's extent, how far its mass centre goes; DISTANCE when None.

    Raises:
        InputError: an inertia, for which no bounds suit.
    """
    body, field, *component = path.split(".")
    if field == "inertia":
        raise InputError(Problem("", "no bounds", "LOW:HIGH for an inertia", "add them, as =1:2 or =0.5x:2x"))
    if field == "com" and body in extents:
        lowest, highest = extents[body][:, COMPONENTS[component[0]][0]]
        half = DISTANCE if share is None else share * (highest - lowest)
        return max(present - half, float(lowest)), min(present + half, float(highest))
    half = np.pi if field.endswith("phase") else DISTANCE
    return present - half, present + half


def _check(low: float, high: float, count: int, shifted: bool) -> None:
    got = f"{low:g} to {high:g}"
    if not (np.isfinite([low, high]).all() and low < high):
        raise InputError(Problem("", got, "a lower and a higher bound", "correct them"))
    if not shifted and not low > 0:
        raise InputError(Problem("", got, "bounds above 0", "it is changed by a factor: correct them"))
    if not 2 <= count <= MOST:
        raise InputError(Problem("", f"{count} values", f"2 to {MOST}", "correct the count"))


def _check_speed(high: float, percent: float) -> None:
    most = min(FASTEST, percent * FASTEST / 100)
    if high > most * (1 + 1e-12):
        remedy = "start from a higher --speed" if most < FASTEST else "100 is full speed"
        raise InputError(Problem("", f"{high:g} %", f"at most {most:g} %", remedy))
