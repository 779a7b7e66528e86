"""What is wrong with what a measurement says: fields that its kind can't have or lacks, numbers that can't be."""

import math
from collections.abc import Iterator, Mapping

from ident.errors import Problem
from ident.measure.kinds import (
    DEFINITIONS,
    DIFFERENCES,
    DRIVE_STATES,
    KINDS,
    POSITIONS,
    RAMPS,
    ROLES,
    ROTATIONS,
    SHAPES,
    TWISTS,
)
from ident.measure.load import Load
from ident.text import nearest, quoted
from ident.units import QUANTITIES

SHARPEST = 1e-6
"""Least standard deviation, as a share of the value: no arm is as constant, and below it searches take minutes."""

ROLE_FIELDS = tuple(dict.fromkeys(name for fields in ROLES.values() for name in fields))
"""Fields that only some kinds have."""
_RANGES = {"frequency": (0.0, math.inf), "damping_ratio": (0.0, 1.0)}


def role_problems(kind: str, given: Mapping[str, str]) -> Iterator[Problem]:
    """Find the fields that a kind can't have or lacks.

    Args:
        kind: a name in `KINDS`.
        given: text of the fields that were given, by field name.

    Yields:
        The problems, with the column and no row.
    """
    for name in ROLE_FIELDS:
        if name in given and name not in ROLES[kind]:
            expected = f"nothing, since a {kind} has no {name}"
            yield Problem("", quoted(given[name]), expected, "empty the cell or correct the kind", name)
    if "point" in ROLES[kind] and "point" not in given:
        read = "whose body turned" if kind in ROTATIONS else "whose motion was read"
        yield Problem("", "nothing", f"the point {read}", "name a point of the arm", "point")
    if kind in TWISTS and "joint" not in given:
        yield Problem("", "nothing", "the joint whose twist was read", "name a driven joint of the arm", "joint")
    for name in ROLES[kind] if kind in SHAPES else ():
        if name not in ("of", "point") and name not in given:
            yield Problem("", "nothing", f"the {name.replace('_', ' ')} of a shape", "fill the cell", name)
    if kind in (*ROTATIONS, *POSITIONS) and "direction" not in given:
        remedy = "give one of x, -z, ... or three numbers"
        axis = "the axis that the rotation is about, right-handed" if kind in ROTATIONS else "the axis that it is along"
        yield Problem("", "nothing", axis, remedy, "direction")


def load_problems(kind: str, load: Load, reference_load: Load) -> Iterator[Problem]:
    """Find a difference between a load and itself."""
    if kind in DIFFERENCES and load == reference_load:
        got = f"{quoted(str(reference_load))}, the load itself"
        remedy = "give the two loads of the difference"
        yield Problem("", got, "a reference load that differs from the load", remedy, "reference_load")


def definition_problems(of: str | None) -> Iterator[Problem]:
    """Find a word for what a frequency is that means nothing."""
    if of and of not in DEFINITIONS:
        remedy = f"write {near}" if (near := nearest(of, DEFINITIONS)) else "correct it, or leave it empty for undamped"
        yield Problem("", quoted(of), f"one of {', '.join(DEFINITIONS)}", remedy, "of")


def drive_state_problems(drives: str) -> Iterator[Problem]:
    """Find a word for what held the motors that means nothing."""
    if drives not in DRIVE_STATES:
        near = nearest(drives, DRIVE_STATES)
        remedy = f"write {near}" if near else f"correct it, or leave it empty for {DRIVE_STATES[0]}"
        yield Problem("", quoted(drives), f"one of {', '.join(DRIVE_STATES)}", remedy, "drives")


def ramp_problems(ramp: str) -> Iterator[Problem]:
    """Find a word for the way of a ramp that means nothing."""
    if ramp and ramp not in RAMPS:
        remedy = f"write {near}" if (near := nearest(ramp, RAMPS)) else "correct it, or leave the cell empty"
        yield Problem("", quoted(ramp), f"one of {', '.join(RAMPS)}", remedy, "ramp")


def value_problems(kind: str, value: float, sigma: float) -> Iterator[Problem]:
    """Find values and standard deviations [SI] that can't be."""
    unit = QUANTITIES[KINDS[kind]].si.removesuffix("1")
    lowest, highest = _RANGES.get(kind, (-math.inf, math.inf))
    if not lowest < value < highest:
        limits = f"between {lowest:g} and {highest:g}" if highest < math.inf else f"above {lowest:g}"
        expected = f"a finite {kind}" + (f" {limits}" if math.isfinite(lowest) else "")
        yield Problem("", f"{value:g} {unit}".strip(), expected, "correct the value or its unit", "value")
    if 0 < sigma < SHARPEST * abs(value) < math.inf:
        expected = f"a standard deviation of {SHARPEST:g} of the value, or more"
        yield Problem("", f"{sigma:g} {unit}".strip(), expected, "state how far the value may be off", "sigma")
    if not 0 < sigma < math.inf:
        expected, remedy = "a finite standard deviation above 0", "state how far the value may be off"
        yield Problem("", f"{sigma:g} {unit}".strip(), expected, remedy, "sigma")


def resolution_problems(resolution: float) -> Iterator[Problem]:
    """Find a resolution [SI] that can't be."""
    if not 0 <= resolution < math.inf:
        remedy = "give the step of the display in the value's unit, or leave the cell empty"
        yield Problem("", f"{resolution:g}", "a resolution above 0", remedy, "resolution")
