"""Units as people write them, turned into SI: the one place that asks pint. How they are shown: `present.text.units`.

A frequency counts cycles: 1 Hz is one cycle, 2 pi radians, per second. For pint alone the radian is a pure
number, so that 1 Hz would be 1 rad/s and 60 rpm 6.28 Hz; here the angle is watched and the 2 pi put in.
"""

import math
import re
from dataclasses import dataclass
from functools import cache, lru_cache
from typing import TYPE_CHECKING, Any

from ident.errors import InputError, Problem
from ident.text import quoted

if TYPE_CHECKING:
    import pint

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
_FACTOR = r"(?:°|[^\W\d]\w*)(?:(?:\^|\*\*)-?[0-9])?"
# Checked before pint sees the text: pint would evaluate numbers, and 9**9**9 takes for ever.
_EXPRESSION = re.compile(rf"(?:1\s*/\s*)?{_FACTOR}(?:\s*[*/ ]\s*{_FACTOR})*")


@cache
def registry() -> "pint.UnitRegistry":
    """Return the one unit registry; it takes a moment to import and to build, and is kept."""
    import pint

    return pint.UnitRegistry()


@lru_cache(maxsize=256)
def parse_unit(text: str) -> "pint.Unit | None":
    """Return the unit that is written as `mm`, `N*mm/deg` or `kg*m^2`; None when it is none."""
    if len(text) > 60 or not _EXPRESSION.fullmatch(text):
        return None
    try:
        return registry().parse_units(text)
    except Exception:  # pint raises many types on bad text, AttributeError and tokenizer errors among them
        return None


@lru_cache(maxsize=256)
def in_base_units(unit: "pint.Unit") -> tuple[float, Any]:
    """Return a unit's factor to SI base units, and these; the radian counts as one, so N m is not N m/rad."""
    factor: Any
    factor, base = registry().get_base_units(unit)
    return float(factor), base


@lru_cache(maxsize=256)
def si_factor(unit: str, quantity: str) -> float:
    """Return the number of SI units in one `unit`.

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
    """Convert a value to the SI unit of its quantity; `frequency` to Hz.

    Raises:
        InputError: the unit is unknown, or is none of this quantity.
    """
    return value * si_factor(unit, quantity)


def _pint_factor(text: str, quantity: str) -> float | None:
    unit = parse_unit(text)
    if unit is None:
        return None
    factor, base = in_base_units(unit)
    if quantity == "frequency":
        return _cycles(unit, factor, base)
    _, expected = in_base_units(registry().Unit(QUANTITIES[quantity].si))
    return factor if base == expected else None


def _cycles(unit: "pint.Unit", factor: float, base: Any) -> float | None:
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
