"""Units of measured quantities as people write them, turned into SI.

A frequency counts cycles: 1 Hz is one cycle, 2 pi radians, per second. For pint alone the radian is a pure
number, so that 1 Hz would be 1 rad/s and 60 rpm 6.28 Hz; here the angle is watched and the 2 pi put in.
"""

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import pint

from ident.errors import InputError, Problem
from ident.text import quoted
from ident.units import in_base_units, parse_unit, registry

NMM_PER_DEG = 1e-3 * 180 / math.pi
"""One newton millimetre per degree of joint rotation [N m/rad]."""

RADIANS_PER_CYCLE = 2 * math.pi
"""Angle of one cycle [rad]."""


@dataclass(frozen=True)
class Quantity:
    """A physical quantity that input may carry.

    Attributes:
        si: symbol of its SI unit.
        expected: which units are right, for messages.
    """

    si: str
    expected: str


QUANTITIES = {
    "angle": Quantity("rad", "an angle unit such as deg or rad"),
    "length": Quantity("m", "a length unit such as mm"),
    "mass": Quantity("kg", "a mass unit such as kg"),
    "force": Quantity("N", "a force unit such as N"),
    "frequency": Quantity("Hz", "a frequency unit: Hz, kHz, rpm or rad/s"),
    "time": Quantity("s", "a time unit such as s or ms"),
    "acceleration": Quantity("m/s^2", "an acceleration unit such as m/s^2"),
    "damping_ratio": Quantity("1", "1, % or an empty cell"),
}
"""The quantities by name."""

_FRACTIONS = {"": 1.0, "1": 1.0, "-": 1.0, "%": 0.01, "percent": 0.01}


@lru_cache(maxsize=256)
def si_factor(unit: str, quantity: str) -> float:
    """Returns the number of SI units in one `unit`.

    Args:
        unit: the unit as written, `mm`, `deg`, `rpm`.
        quantity: a name in `QUANTITIES`.

    Returns:
        The factor, `value_in_si = factor * value`.

    Raises:
        InputError: the unit is unknown, or is none of this quantity.
    """
    unit = unit.strip()
    factor = _FRACTIONS.get(unit) if quantity == "damping_ratio" else _pint_factor(unit, quantity)
    if factor is None:
        raise InputError(_wrong_unit(unit, quantity))
    return factor


def to_si(value: float, unit: str, quantity: str) -> float:
    """Converts a value to the SI unit of its quantity; `frequency` to Hz.

    Raises:
        InputError: the unit is unknown, or is none of this quantity.
    """
    return value * si_factor(unit, quantity)


def stiffness_from_nmm_per_deg(stiffness: float) -> float:
    """Converts a joint stiffness from N mm/deg to N m/rad."""
    return stiffness * NMM_PER_DEG


def stiffness_to_nmm_per_deg(stiffness: float) -> float:
    """Converts a joint stiffness from N m/rad to N mm/deg."""
    return stiffness / NMM_PER_DEG


def _pint_factor(text: str, quantity: str) -> float | None:
    unit = parse_unit(text)
    if unit is None:
        return None
    factor, base = in_base_units(unit)
    if quantity == "frequency":
        return _cycles(unit, factor, base)
    _, expected = in_base_units(registry().Unit(QUANTITIES[quantity].si))
    return factor if base == expected else None


def _cycles(unit: pint.Unit, factor: float, base: Any) -> float | None:
    if base == registry().Unit("rad/s"):
        return factor / RADIANS_PER_CYCLE
    named = str(unit).endswith("hertz") and str(unit).isalpha()
    return factor if named else None


def _wrong_unit(text: str, quantity: str) -> Problem:
    unit = parse_unit(text)
    if quantity == "frequency" and unit is not None and unit.dimensionality == {"[time]": -1}:
        remedy = "write Hz for cycles or rad/s for radians per second"
        return Problem("", f"the ambiguous {quoted(text)}", QUANTITIES[quantity].expected, remedy)
    return Problem("", quoted(text), QUANTITIES[quantity].expected, "correct the unit")
