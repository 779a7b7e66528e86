"""What a number of the arm is: unit, sign, how it is varied, its words. Everything from files to figures reads it here.

What was decided by physics, where tables used to differ:

- A drive's *ratio* may be negative, as the wave generator may turn the other way, but not zero. A factor varies it,
  which keeps its sign.
- *Eccentricity* and *error* are a distance and an amplitude, with an angle of their own (`phase`, `error_phase`), as
  the *amplitudes* of further errors: never negative, and varied by a factor, in a fit as in a sweep. So are a rotor's
  inertia, an eccentric mass, and all of a belt but its height.
- A curved spring's *ratios* and torques are positive; its *cubic* stiffness is not negative: one that softens with the
  cube of the angle would give way.
- A bushing's stiffness and a belt's radii are positive: without them there is no equilibrium, and no belt.
- A component of *inertia* is not negative, but varied by a difference: that of a slender body is zero about its axis,
  and the triangle inequality between the three is linear in them.
- What measures from an origin that one may choose (position, height, angle) has either sign, and varies by a
  difference.
"""

from dataclasses import dataclass
from functools import cache
from typing import Any, Literal

import numpy as np
from jaxtyping import Bool, Float

from ident.units import NMM_PER_DEG

Sign = Literal["positive", "non-negative", "non-zero", "signed"]
EXPECTED: dict[Sign, str] = {
    "positive": "a value > 0",
    "non-negative": "a value >= 0",
    "non-zero": "a value that is not zero",
    "signed": "a finite number",
}
"""What a sign asks for, in a message."""
COMPONENTS = {"x": (0,), "y": (1,), "z": (2,), "xx": (0, 0), "yy": (1, 1), "zz": (2, 2)}
"""Names of vector and tensor components in a parameter's path."""
LARGEST = 1e15
"""Largest magnitude of a number in a file, or of one that is set: squares and products of several stay finite."""
SPEED = "speed"
"""What varies like a number of the arm, though it is none: the speed of the motion [%], which slows its clock."""


@dataclass(frozen=True)
class Field:
    """A number, vector or tensor that a part of an arm has.

    Attributes:
        part: name of the class that has it.
        name: of the attribute, as in the path `joint1.k_bend`.
        unit: SI unit; `-` for a pure number.
        sign: which values are possible; of a tensor, those of its diagonal.
        logarithmic: whether it is fitted as ln(value) and changed by a factor; otherwise by a difference.
        rank: number of component axes: 0 scalar, 1 vector, 2 tensor; any further axes are batch.
        words: what it is called; the name, unless given.
        short: what it is called where stiffness alone is spoken of; `words`, unless given.
        read_unit: unit that people read it in; `unit`, unless given.
        read_size: size of that unit in SI units.
        redesigned: whether a redesign studies its effect by default.
    """

    part: str
    name: str
    unit: str
    sign: Sign
    logarithmic: bool
    rank: int = 0
    words: str = ""
    short: str = ""
    read_unit: str = ""
    read_size: float = 1.0
    redesigned: bool = False

    def __post_init__(self) -> None:
        words = self.words or self.name.replace("_", " ")
        defaults = {"words": words, "short": self.short or words, "read_unit": self.read_unit or self.unit}
        for name, value in defaults.items():
            object.__setattr__(self, name, value)

    @property
    def ends(self) -> dict[str, tuple[int, ...]]:
        """Ends of its paths, as `.x`, with the place of each component; one empty end for a scalar."""
        components = {f".{end}": place for end, place in COMPONENTS.items() if len(place) == self.rank}
        return components if self.rank else {"": ()}

    def allows(self, value: Float[np.ndarray, "*batch"] | float) -> Bool[np.ndarray, "*batch"]:
        """Tell for each value [SI] whether it is finite and of a possible sign."""
        value = np.asarray(value, float)
        signs = {"positive": value > 0, "non-negative": value >= 0, "non-zero": value != 0}
        return np.asarray(np.isfinite(value) & signs.get(self.sign, True))

    def has_factor(self, value: float) -> bool:
        """Tell whether a value [SI] is changed by a factor, and can be: it is possible, and not zero."""
        return self.logarithmic and value != 0 and bool(self.allows(value))


def _length(part: str, name: str, sign: Sign = "signed", logarithmic: bool = False, **more: Any) -> Field:
    return Field(part, name, "m", sign, logarithmic, read_unit="mm", read_size=1e-3, **more)


def _stiffness(name: str, words: str, short: str) -> Field:
    return Field("Joint", name, "N m/rad", "positive", True, 0, words, short, "N mm/deg", NMM_PER_DEG, True)


FIELDS = (
    Field("Body", "mass", "kg", "non-negative", True, redesigned=True),
    _length("Body", "com", rank=1, words="mass centre", redesigned=True),
    Field("Body", "inertia", "kg m^2", "non-negative", False, rank=2),
    _length("Joint", "offset", rank=1),
    _stiffness("k_bend", "bending stiffness", "bending"),
    _stiffness("k_tors", "torsional stiffness", "torsion"),
    Field("Joint", "tau_bend", "s", "non-negative", True, words="bending damping", redesigned=True),
    Field("Joint", "tau_tors", "s", "non-negative", True, words="torsion damping", redesigned=True),
    Field("Joint", "loss_bend", "-", "non-negative", True, words="bending loss factor"),
    Field("Joint", "loss_tors", "-", "non-negative", True, words="torsion loss factor"),
    Field("MassDamping", "alpha", "1/s", "non-negative", True, words="mass-proportional damping"),
    _length("Point", "position", rank=1),
    Field("Drive", "ratio", "-", "non-zero", True, redesigned=True),
    Field("Drive", "rotor_inertia", "kg m^2", "non-negative", True),
    Field("Drive", "eccentric_mass", "kg", "non-negative", True),
    _length("Drive", "eccentricity", "non-negative", logarithmic=True, redesigned=True),
    _length("Drive", "height"),
    Field("Drive", "phase", "rad", "signed", False),
    Field("Drive", "error", "rad", "non-negative", True),
    Field("Drive", "error_phase", "rad", "signed", False),
    Field("ErrorOrder", "amplitude", "rad", "non-negative", True, words="amplitude of the transmission error"),
    Field("ErrorOrder", "phase", "rad", "signed", False),
    _length("Belt", "driver_radius", "positive", logarithmic=True),
    _length("Belt", "driven_radius", "positive", logarithmic=True),
    Field("Belt", "pretension", "N", "non-negative", True),
    Field("Belt", "stiffness", "N/m", "non-negative", True),
    Field("Belt", "tau", "s", "non-negative", True),
    _length("Belt", "height"),
    Field("Servo", "k_servo", "N m/rad", "positive", True, words="servo stiffness"),
    Field("Servo", "tau", "s", "non-negative", True),
    Field("Spring", "ratio2", "-", "positive", True, words="K2/K1"),
    Field("Spring", "ratio3", "-", "positive", True, words="K3/K1"),
    Field("Spring", "torque1", "N m", "positive", True, words="T1"),
    Field("Spring", "torque2", "N m", "positive", True, words="T2"),
    Field("CubicSpring", "cubic", "N m/rad^3", "non-negative", True, words="cubic stiffness"),
    Field("Stroke", "folded", "rad", "signed", False),
    Field("Stroke", "unfolded", "rad", "signed", False),
    Field("Stroke", "speed", "rad/s", "positive", True),
    Field("Stroke", "acceleration", "rad/s^2", "positive", True),
    Field("Stroke", "jerk", "rad/s^3", "positive", True),
)
"""All numbers of an arm that have a path, in the order of the paths; those of one name are alike but for their part."""

STIFFNESS = ("k_bend", "k_tors")
DAMPING = ("tau_bend", "tau_tors")
LOSS = ("loss_bend", "loss_tors")
"""Loss factors, which most arms have none of: then they have no path either."""
ALPHA = "damping.alpha"
"""Damping in proportion to mass, likewise."""

_BY_NAME = {field.name: field for field in FIELDS}


@cache
def fields_of(part: str) -> tuple[Field, ...]:
    """Return the fields of a class of parts by its name, `Drive`; none if its parts have no numbers."""
    return tuple(field for field in FIELDS if field.part == part)


def fields_in(part: Any) -> tuple[Field, ...]:
    """Return the fields that a part has a number of: a loss factor or alpha only where it has one."""
    return tuple(field for field in fields_of(type(part).__name__) if getattr(part, field.name) is not None)


def names_of(part: str) -> tuple[str, ...]:
    """Return the names of the fields of a class of parts."""
    return tuple(field.name for field in fields_of(part))


def field_named(name: str) -> Field:
    """Return the field of a name.

    Raises:
        KeyError: no part of an arm has it.
    """
    return _BY_NAME[name]


def field_of(path: str) -> Field | None:
    """Return the field of a path `link2.com.x`; None if it is not a path of an arm."""
    _, _, rest = path.partition(".")
    return _BY_NAME.get(rest.partition(".")[0])
