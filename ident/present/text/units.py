"""How numbers are shown: in the units that people read. What a number of the arm is: `ident.arm.fields`."""

from ident.arm.fields import SPEED, STIFFNESS, field_of
from ident.identify.loops import is_of_loop, kind_of
from ident.identify.setups import PREFIX
from ident.measure.kinds import KINDS as MEASURED
from ident.units import QUANTITIES, stiffness_unit

KINDS = {
    "frequency": (1.0, "Hz"),
    "deflection": (1e3, "mm"),
    "deflection_difference": (1e3, "mm"),
    "rotation": (1e3, "mrad"),
    "rotation_difference": (1e3, "mrad"),
    "twist": (1e3, "mrad"),
    "twist_difference": (1e3, "mrad"),
    "shape": (1.0, ""),
}
SETUP, TURN = PREFIX, ".turn."
"""What the numbers of a setup's frame are told by: its place, and how it is turned."""
MM = 1e3
"""mm in a metre."""


def in_read_unit(kind: str, value: float) -> tuple[float, str]:
    """Return a measured or predicted SI value in the unit that its kind is read in, and the unit."""
    factor, unit = KINDS.get(kind, (100.0, "%"))
    return value * factor, unit


def unit_of(path: str) -> str:
    """Return the SI unit of a parameter; `-` for factors, and for parameters of a model that is no arm."""
    field = field_of(path)
    if path.startswith(SETUP):
        return "rad" if TURN in path else "m"
    if is_of_loop(path):
        return QUANTITIES[MEASURED[kind_of(path)]].si
    return field.unit if field else "%" if path == SPEED else "-"


def is_stiffness(path: str) -> bool:
    """Tell whether a path names a bushing stiffness."""
    field = field_of(path)
    return field is not None and field.name in STIFFNESS


def is_length(path: str) -> bool:
    """Tell whether a path names a length, which people read in mm."""
    field = field_of(path)
    own = (path.startswith(SETUP) or is_of_loop(path)) and unit_of(path) == "m"
    return own or (field is not None and field.read_unit == "mm")


def read_unit(path: str) -> tuple[float, str]:
    """Return the size in SI units of the unit that people read a parameter in, and the unit.

    Of a stiffness it is the one that was chosen, see `ident.units.stiffness_in`.
    """
    field = field_of(path)
    if is_stiffness(path):
        return stiffness_unit()
    if path.startswith(SETUP):
        return (1e-3, "mrad") if TURN in path else (1e-3, "mm")
    if is_of_loop(path):
        return (1e-3, "m" + unit_of(path))
    return (field.read_size, field.read_unit) if field else (1.0, unit_of(path))


def in_shown_unit(path: str, value: float) -> tuple[float, str]:
    """Return a value and its unit: of a stiffness in the one that was chosen, else in SI, as it is given."""
    if not is_stiffness(path):
        return value, unit_of(path)
    size, unit = stiffness_unit()
    return value / size, unit


def value_in_words(path: str, value: float) -> str:
    """Write a value with its unit, as `3.598e+05 N m/rad`."""
    number, name = in_shown_unit(path, value)
    return f"{number:.4g} {name}".removesuffix(" -")
