"""Units as people write them, turned into SI: the one place that asks pint. How they are shown: `present.words`.

A frequency counts cycles: 1 Hz is one cycle, 2 pi radians, per second. For pint alone the radian is a pure
number, so that 1 Hz would be 1 rad/s and 60 rpm 6.28 Hz; here the angle is watched and the 2 pi put in.
"""

import math
import re
from collections.abc import Iterable, Sequence
from contextlib import AbstractContextManager
from contextvars import ContextVar
from dataclasses import dataclass
from functools import cache, lru_cache
from typing import TYPE_CHECKING, Any

from ident.errors import InputError, Problem
from ident.text import quoted, within

if TYPE_CHECKING:
    import pint

NMM_PER_DEG = 1e-3 * 180 / math.pi
"""One newton millimetre per degree of joint rotation [N m/rad]."""

USUAL = "N m/rad"
STIFFNESS_UNITS = {USUAL: 1.0, "N mm/deg": NMM_PER_DEG, "N m/arcmin": 60 * 180 / math.pi}
"""Units that stiffnesses of joints may be shown in, by name: one of each [N m/rad]."""
_STIFFNESS_UNIT = ContextVar("_STIFFNESS_UNIT", default=USUAL)

RADIANS_PER_CYCLE = 2 * math.pi
"""Angle of one cycle [rad]."""
ROUND, NEARLY = math.radians(5.0), 0.005
"""Postures are mostly multiples of this angle [rad], of which two decimals are left; assumed."""


def asked_postures(postures: Iterable[Sequence[float]]) -> tuple[str, ...]:
    """Return the question whether postures [rad] that were given in degrees are radians; none where they are not.

    It is asked where several numbers are all round degrees if read as radians: 0.52 and -1.05 are 30 and -60 degrees.
    By chance 1 % of pairs up to 2 pi are.
    """
    degrees = [[math.degrees(angle) for angle in posture if angle] for posture in postures]
    doubtful = [
        " ".join(f"{each:.3g}" for each in angles)
        for angles in degrees
        if len({round(abs(x), 3) for x in angles}) > 1
        and all(ROUND / 2 < abs(x) <= 2 * math.pi and abs(math.remainder(x, ROUND)) < NEARLY for x in angles)
    ]
    more = f" (and {len(doubtful) - 1} more)" if len(doubtful) > 1 else ""
    return tuple(f"angles of {each} deg{more}: if they are radians, convert them" for each in doubtful[:1])


def stiffness_in(unit: str) -> AbstractContextManager[None]:
    """Show stiffnesses in a unit within, one of `STIFFNESS_UNITS`, in every medium."""
    return within(_STIFFNESS_UNIT, unit)


def stiffness_unit() -> tuple[float, str]:
    """Return the size [N m/rad] of the unit that stiffnesses are shown in, and its name."""
    name = _STIFFNESS_UNIT.get()
    return STIFFNESS_UNITS[name], name


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
    "rotation": Quantity("rad", "an angle unit such as mrad or deg, or mm/m"),
    "mass": Quantity("kg", "a mass unit such as kg"),
    "force": Quantity("N", "a force unit such as N"),
    "moment": Quantity("N*m", "a unit of moment such as N*m"),
    "frequency": Quantity("Hz", "a frequency unit: Hz, kHz, rpm or rad/s"),
    "time": Quantity("s", "a time unit such as s or ms"),
    "velocity": Quantity("m/s", "a velocity unit such as m/s"),
    "acceleration": Quantity("m/s^2", "an acceleration unit such as m/s^2"),
    "damping_ratio": Quantity("1", "1, % or an empty cell"),
    "ratio": Quantity("1", "1, % or an empty cell"),
}
"""The quantities by name."""

_DEGREE = math.pi / 180
_POWERS = {"": "", "^2": " ** 2", "^3": " ** 3"}
_STIFFNESS = "kilogram * meter ** 2 / radian / second ** 2"
COMMON: dict[str, tuple[float, str]] = {
    "m": (1.0, "meter"),
    "mm": (1e-3, "meter"),
    "kg": (1.0, "kilogram"),
    "s": (1.0, "second"),
    "ms": (1e-3, "second"),
    "N": (1.0, "kilogram * meter / second ** 2"),
    "rad": (1.0, "radian"),
    "deg": (_DEGREE, "radian"),
    "mrad": (1e-3, "radian"),
    "arcsec": (4.84813681109536e-06, "radian"),
    "N*m": (1.0, "kilogram * meter ** 2 / second ** 2"),
    "N*m/rad": (1.0, _STIFFNESS),
    "N*mm/deg": (0.057295779513082325, _STIFFNESS),
    "kg*m^2": (1.0, "kilogram * meter ** 2"),
    "N/m": (1.0, "kilogram / second ** 2"),
    "m/s^2": (1.0, "meter / second ** 2"),
    **{f"rad/s{power}": (1.0, f"radian / second{words}") for power, words in _POWERS.items()},
    **{f"deg/s{power}": (_DEGREE, f"radian / second{words}") for power, words in _POWERS.items()},
}
"""Common units, as pint has them to the last bit: asking it takes half a second of every command's start."""


@dataclass(frozen=True)
class Width:
    """A standard deviation as people write it.

    Attributes:
        size: in SI, or as a share of the value.
        share: whether it is a share.
    """

    size: float
    share: bool


_WIDTH = re.compile(r"([0-9]*\.?[0-9]+(?:[eE][+-]?[0-9]+)?)\s*(\S.*)")
_FRACTIONS = {"": 1.0, "1": 1.0, "-": 1.0, "%": 0.01, "percent": 0.01}
_SLOPES = {"mm/m": 1e-3, "um/m": 1e-6}
"""How levels show a rotation [rad]: as a slope, the same to a millionth up to 1.7 mm/m."""
_SPECIAL = {"damping_ratio": _FRACTIONS, "ratio": _FRACTIONS, "rotation": _SLOPES}
VOLTAGES = {"V": 1.0, "mV": 1e-3, "uV": 1e-6}
"""Units of a sensor's voltage [V]."""
STANDARD_GRAVITY = 9.80665
"""One g, as accelerometers are scaled [m/s^2]."""
GRAVITIES = ("g", "G", "gn", "g's", "G's", "gs", "Gs")
"""What equipment writes for standard gravity, where an acceleration is meant; elsewhere g is a gram."""
POUNDS = ("lb", "lbs", "LB", "LBS", "Lb", "lbF", "LBF", "Lbf")
"""What equipment writes for a pound-force, where a force is meant; elsewhere lb is a mass."""
_POUND_FORCE = 4.4482216152605
_LENGTHS = {"m": 1.0, "mm": 1e-3, "cm": 1e-2, "um": 1e-6, "µm": 1e-6, "μm": 1e-6, "in": 0.0254, "ft": 0.3048}
_LENGTH = "(?P<length>" + "|".join(sorted(_LENGTHS, key=len, reverse=True)) + ")"
_POWER, _SECOND = r"(?:\^|\*\*)?", r"\s*s(?:ec)?\s*"
_LABELS = {
    "acceleration": re.compile(
        rf"{_LENGTH}\s*(?:/{_SECOND}{_POWER}\s*[2²]|/{_SECOND}/{_SECOND}|[\s.·*]*{_SECOND}{_POWER}\s*(?:-2|⁻²))"
    ),
    "velocity": re.compile(rf"{_LENGTH}\s*(?:/{_SECOND}|[\s.·*]*{_SECOND}{_POWER}\s*(?:-1|⁻¹))"),
}
"""Labels of equipment that are no units by pint's rules: m/s2, m/s/s, ms-2, which is never per square millisecond."""
_NEWTONS = ("newton", "newtons", "newton(s)")
_RATES = {"hz": "Hz", "khz": "kHz", "cps": "Hz", "cpm": "rpm"}
"""Labels of frequencies in lower case, cycles per second and minute; no MHZ, which may be milli or mega."""
_AMBIGUOUS = {"acceleration": dict.fromkeys(GRAVITIES, STANDARD_GRAVITY), "force": dict.fromkeys(POUNDS, _POUND_FORCE)}
_FACTOR = r"(?:°|[^\W\d]\w*)(?:(?:\^|\*\*)-?[0-9])?"
# Checked before pint sees the text: pint would evaluate numbers, and 9**9**9 takes for ever.
_EXPRESSION = re.compile(rf"(?:1\s*/\s*)?{_FACTOR}(?:\s*[*/ ]\s*{_FACTOR})*")


@cache
def registry() -> "pint.UnitRegistry":
    """Return the one unit registry; it takes a moment to import and to build, and is kept."""
    import pint

    units: pint.UnitRegistry = pint.UnitRegistry(on_redefinition="ignore")
    units.define("@alias thou = mil = mils")  # of dial gauges; pint's own is an angle of artillery
    return units


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
def in_si(text: str) -> tuple[float, str] | None:
    """Return a unit's factor to SI base units, and these in words; None when it is no unit.

    The radian counts as a base unit, so N m is not N m/rad.
    """
    if text in COMMON:
        return COMMON[text]
    unit = parse_unit(text)
    if unit is None:
        return None
    factor: Any
    factor, base = registry().get_base_units(unit)
    return float(factor), str(base)


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
    unit, special = unit.strip(), _SPECIAL.get(quantity, {})
    factor = special.get(unit)
    if factor is None and special is not _FRACTIONS:
        factor = _factor(unit, quantity)
    if factor is None:
        factor = _labelled(unit, quantity)
    if factor is None:
        raise InputError(_wrong_unit(unit, quantity))
    return factor


def sensor_factor(unit: str, quantity: str) -> float | None:
    """Return the number of SI units in one `unit` of a force, acceleration, ... sensor; None where it is none.

    Other than `si_factor` it takes g for standard gravity and lb for a pound-force.
    """
    try:
        return _AMBIGUOUS.get(quantity, {}).get(unit.strip()) or (si_factor(unit, quantity) if unit else None)
    except InputError:
        return None


def to_si(value: float, unit: str, quantity: str) -> float:
    """Convert a value to the SI unit of its quantity; `frequency` to Hz.

    Raises:
        InputError: the unit is unknown, or is none of this quantity.
    """
    return value * si_factor(unit, quantity)


def _factor(text: str, quantity: str) -> float | None:
    found = in_si(text) if text != "Hz" else (RADIANS_PER_CYCLE, "radian / second")
    if found is None:
        return None
    factor, base = found
    if quantity != "frequency":
        expected = in_si(QUANTITIES[quantity].si)
        return factor if expected and base == expected[1] else None
    if base == "radian / second":
        return factor / RADIANS_PER_CYCLE
    named = str(parse_unit(text))
    return factor if named.endswith("hertz") and named.isalpha() else None


def _labelled(text: str, quantity: str) -> float | None:
    """Return SI units in what equipment writes for a unit of a quantity, in capitals too; None where it is none."""
    if quantity == "force":
        return 1.0 if text.lower() in _NEWTONS else None
    if quantity in ("time", "frequency"):
        spelt = _RATES.get(text.lower(), text.lower())
        return _factor(spelt, quantity) if spelt != text else None
    label = _LABELS[quantity].fullmatch(text) if quantity in _LABELS else None
    return _LENGTHS[label["length"]] if label else None


def _wrong_unit(text: str, quantity: str) -> Problem:
    unit = parse_unit(text)
    if quantity == "frequency" and unit is not None and unit.dimensionality == {"[time]": -1}:
        remedy = "write Hz for cycles or rad/s for radians per second"
        return Problem("", f"the ambiguous {quoted(text)}", QUANTITIES[quantity].expected, remedy)
    return Problem("", quoted(text), QUANTITIES[quantity].expected, "correct the unit")


def width(text: str, unit: str = "") -> Width | None:
    """Return a standard deviation, `5%` or `2mm`; None for what is none, is not above zero or of another dimension.

    Args:
        text: number and unit.
        unit: of the dimension that one which is no share must have; empty where only a share will do.
    """
    found = _WIDTH.fullmatch(text.strip())
    number = float(found[1]) if found else 0.0
    if not found or not (math.isfinite(number) and number > 0):
        return None
    if found[2] == "%":
        return Width(number / 100, share=True)
    given, own = in_si(found[2]), in_si(unit.replace(" ", "*")) if unit else None
    return Width(number * given[0], share=False) if given and own and given[1] == own[1] else None
