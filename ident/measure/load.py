"""Load cases and directions, and the short text that describes them."""

import math
import re
from collections import defaultdict
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TypeVar

from ident.errors import InputError, Problem, refusal, refuse
from ident.measure.table import format_number, parse_number
from ident.text import NAME, quoted
from ident.units import to_si

Vector = tuple[float, float, float]
Place = TypeVar("Place", str, tuple[str, str, str])
Own = tuple[str, Vector, str, str]
"""`force` [N] or `moment` [N m], its components along the axes of a body, point, body."""

AXES: dict[str, Vector] = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}
AXES |= {f"-{name}": (0.0 - x, 0.0 - y, 0.0 - z) for name, (x, y, z) in AXES.items()}
"""Unit vectors of the base frame by name; a leading `+` is also read."""

LOAD_SYNTAX = (
    "terms joined by ' + ', each like 'glass', '5 kg @ tip', '20 N -z @ tip', '20 N x of hand @ tip' or"
    " '12 N*m about y @ tip'"
)
"""The load syntax in words, for messages."""

_AMOUNT = r"(?P<amount>[+-]?[0-9.,]+(?:[eE][+-]?[0-9]+)?)\s*"
_DIRECTION = rf"(?P<direction>[^@]+?)(?:\sof\s(?P<body>{NAME}))?"
_HUNG = re.compile(rf"{_AMOUNT}(?P<unit>[^\W\d_]+)(?:\s{_DIRECTION})?\s*@\s*(?P<point>{NAME})")
_TURNED = re.compile(rf"{_AMOUNT}(?P<unit>[^@]+?)\s+about\s{_DIRECTION}\s*@\s*(?P<point>{NAME})")


def unit_vector(vector: Iterable[float]) -> Vector:
    """Scale a vector to unit length; a unit vector is left as it is."""
    components = tuple(float(component) for component in vector)
    length = math.hypot(*components)
    if len(components) != 3 or not 0 < length < math.inf:
        got = "the zero vector" if length == 0 else quoted(" ".join(map(str, components)))
        raise refusal("", got, "a direction", "give one of x, -z, ... or three numbers", "direction")
    x, y, z = components if abs(length - 1) < 1e-15 else (component / length for component in components)
    return x, y, z


def parse_direction(text: str, decimal: str = ".") -> Vector:
    """Read a direction in the base frame: `x`, `+x`, `-z`, or three numbers separated by blanks.

    Returns:
        (3,) unit vector.
    """
    axis = AXES.get(text.lower().removeprefix("+"))
    parts = text.split()
    if axis is None and len(parts) != 3:
        expected = "x, -z, ... or three numbers like '0 0.6 -0.8'"
        remedy = "correct the direction; its components are those of the base frame"
        raise refusal("", quoted(text), expected, remedy, "direction")
    return axis or unit_vector(parse_number(part, decimal) for part in parts)


def format_direction(direction: Vector) -> str:
    """Write a direction so that `parse_direction` reads it back."""
    named = (name for name, axis in AXES.items() if axis == direction)
    return next(named, " ".join(map(format_number, direction)))


@dataclass(frozen=True)
class Load:
    """Load of the arm in addition to its own weight; empty for own weight alone.

    Equivalent loads compare equal: terms are sorted, and masses or forces at one point are added up.

    Attributes:
        payloads: names of payloads in the arm file.
        masses: (mass [kg], point name), point masses.
        forces: ((3,) force [N] in the base frame, point name).
        moments: ((3,) moment [N m] in the base frame, right-handed, point whose body it turns).
        own: forces [N] and moments [N m] along the axes of a body as the posture holds it, without elastic rotation.
            They are constant all the same.
    """

    payloads: tuple[str, ...] = ()
    masses: tuple[tuple[float, str], ...] = ()
    forces: tuple[tuple[Vector, str], ...] = ()
    moments: tuple[tuple[Vector, str], ...] = ()
    own: tuple[Own, ...] = ()

    def __post_init__(self) -> None:
        refuse(_load_problems(self))
        masses: dict[str, float] = defaultdict(float)
        for mass, point in self.masses:
            masses[point] += mass
        object.__setattr__(self, "payloads", tuple(sorted(self.payloads)))
        object.__setattr__(self, "masses", tuple((mass, point) for point, mass in sorted(masses.items())))
        object.__setattr__(self, "forces", _summed(self.forces))
        object.__setattr__(self, "moments", _summed(self.moments))
        own = _summed((vector, (kind, point, body)) for kind, vector, point, body in self.own)
        object.__setattr__(self, "own", tuple((kind, vector, point, body) for vector, (kind, point, body) in own))

    def __bool__(self) -> bool:
        return bool(self.payloads or self.masses or self.forces or self.moments or self.own)

    def __str__(self) -> str:
        masses = [f"{format_number(mass)} kg @ {point}" for mass, point in self.masses]
        acting = [*_components(self.forces, "force"), *_components(self.moments, "moment")]
        for kind, vector, point, body in self.own:
            acting += _components([(vector, point)], kind, f" of {body}")
        return " + ".join([*self.payloads, *masses, *acting]) or "own weight"

    @classmethod
    def parse(cls, text: str, decimal: str = ".") -> "Load":
        """Read a load such as `glass + 5 kg @ tip + 20 N -z @ tip + 12 N*m about y @ tip`.

        Blank or `own weight` is the empty load.

        Args:
            text: the load as written; masses, forces and moments may carry any unit of their kind.
            decimal: the decimal mark in use.

        Returns:
            The load.

        Raises:
            InputError: the text doesn't follow the syntax; all bad terms are listed.
        """
        text = " ".join(text.split())
        if text.lower() in ("", "own weight"):
            return cls()
        terms = text.split(" + ")
        turned = [_TURNED.fullmatch(term) for term in terms]
        hung = [None if turns else _HUNG.fullmatch(term) for term, turns in zip(terms, turned, strict=True)]
        payloads = tuple(term for term, *found in zip(terms, turned, hung, strict=True) if not any(found))
        amounts = [match for match in hung if match]
        found = [*(("force", m) for m in amounts if m["direction"]), *(("moment", m) for m in turned if m)]
        acting = [(kind, _vector(m, kind, decimal), m["point"], m["body"]) for kind, m in found]
        masses = tuple((_amount(m, "mass", decimal), m["point"]) for m in amounts if not m["direction"])
        forces, moments = (
            tuple((vector, point) for own, vector, point, body in acting if own == kind and not body)
            for kind in ("force", "moment")
        )
        return cls(payloads, masses, forces, moments, tuple(term for term in acting if term[3]))


def _summed(acting: Iterable[tuple[Vector, Place]]) -> tuple[tuple[Vector, Place], ...]:
    """Add up the vectors at each place (a point, or kind, point and body); drop zero sums."""
    sums: dict[Place, Vector] = defaultdict(lambda: (0.0, 0.0, 0.0))
    for vector, place in acting:
        x, y, z = (a + b for a, b in zip(sums[place], vector, strict=True))
        sums[place] = (x, y, z)
    return tuple((vector, place) for place, vector in sorted(sums.items()) if any(vector))


def _components(acting: Iterable[tuple[Vector, str]], kind: str, axes: str = "") -> Iterator[str]:
    """Write forces or moments as terms along the axes."""
    words = "N " if kind == "force" else "N*m about "
    for vector, point in acting:
        for size, axis in zip(vector, "xyz", strict=True):
            if size:
                yield f"{format_number(abs(size))} {words}{'-' if size < 0 else ''}{axis}{axes} @ {point}"


def _amount(term: re.Match[str], quantity: str, decimal: str) -> float:
    with _of_term(term[0]):
        amount = to_si(parse_number(term["amount"], decimal), term["unit"], quantity)
    if amount <= 0:
        raise InputError(_misread(term[0], f"a {quantity} above 0"))
    return amount


def _vector(term: re.Match[str], quantity: str, decimal: str) -> Vector:
    size = _amount(term, quantity, decimal)
    with _of_term(term[0]):
        x, y, z = parse_direction(term["direction"].strip(), decimal)
    return size * x, size * y, size * z


@contextmanager
def _of_term(term: str) -> Iterator[None]:
    """Name the term of an InputError."""
    try:
        yield
    except InputError as error:
        raise InputError(_misread(term, problem.expected) for problem in error.problems) from None


def _misread(term: str, expected: str) -> Problem:
    return Problem("", quoted(term), expected, f"write {LOAD_SYNTAX}", "load")


def _load_problems(load: Load) -> Iterator[Problem]:
    """Find invalid names, impossible sizes, and repeated payloads."""
    names = (*load.payloads, *named_points(load), *(body for *_, body in load.own))
    yield from (_misread(name, "the name of a payload or point") for name in names if not re.fullmatch(NAME, name))
    for mass, point in load.masses:
        if not 0 < mass < math.inf:
            yield _misread(f"{mass} kg @ {point}", "a finite mass above 0")
    own = tuple((vector, point) for _, vector, point, _ in load.own)
    acting = (("force", "N", load.forces), ("moment", "N*m", load.moments), ("force or moment", "", own))
    for quantity, unit, each in acting:
        for vector, point in each:
            if len(vector) != 3 or not all(map(math.isfinite, vector)):
                yield _misread(f"{vector} {unit} @ {point}", f"a finite {quantity} of three components")
    for name in sorted({name for name in load.payloads if load.payloads.count(name) > 1}):
        yield _misread(name, "each payload once")


def named_points(load: Load) -> tuple[str, ...]:
    """Return the points of a load, one for each of its terms."""
    hung = [point for _, point in (*load.masses, *load.forces, *load.moments)]
    return (*hung, *(point for _, _, point, _ in load.own))


OWN_WEIGHT = Load()
"""The empty load."""
