"""How `arm.toml` writes a number: with unit and origin, as a scalar, a vector, an inertia tensor or a shape.

`mass = { value = 42.0, unit = "kg", origin = "assumed", note = "..." }`. Any unit of the right dimension will do;
angles count as a dimension, so that `N*m` is refused where `N*m/rad` is meant.
"""

from typing import Annotated, Any, Generic, Literal, TypeVar

import numpy as np
from pydantic import AfterValidator, BaseModel, ConfigDict, Discriminator, Field, Tag
from pydantic_core import PydanticCustomError

from ident.arm.fields import LARGEST, field_named
from ident.text import NAME, did_you_mean, quoted
from ident.units import in_si, width

Origin = Literal["paper", "assumed", "calibrated", "measured", "derived", "datasheet", "designed"]


def complaint(got: str, expected: str, remedy: str) -> PydanticCustomError:
    """Return the error by which a validator says what is wrong; pydantic adds where."""
    return PydanticCustomError("ident", "{got}", {"got": got, "expected": expected, "remedy": remedy})


def as_written(value: Any) -> str:
    """Return a value for a message, as TOML writes it and on one line."""
    if isinstance(value, dict):
        return "a table"
    text = str(value).lower() if isinstance(value, bool) else repr(value)
    return text if len(text) <= 60 else f"{text[:57]}..."


class Table(BaseModel):
    """A TOML table: no unknown keys, no silent conversion, no nan or inf."""

    model_config = ConfigDict(strict=True, extra="forbid", allow_inf_nan=False)


def si(value: Any, unit: str) -> Any:
    """Return numbers, written in a unit, in SI units."""
    known = in_si(unit)
    assert known, "it was checked when it was read"
    return np.asarray(value, dtype=float) * known[0]


def _range(name: str) -> Any:
    """Accept what a field of the arm can be, by its sign."""
    sign = field_named(name).sign
    if sign == "positive":
        return Field(gt=0, le=LARGEST)
    return Field(ge=0 if sign == "non-negative" else -LARGEST, le=LARGEST)


def _unit(name: str, *others: str) -> AfterValidator:
    """Accept units of the dimension that a field of the arm has; others are shown beside its own."""
    field = field_named(name)
    return _checked_unit(*(unit.replace(" ", "*") for unit in (field.unit, *others, field.read_unit)))


def _checked_unit(*examples: str) -> AfterValidator:
    """Accept units of the dimension of the examples, the first of which is SI."""

    def check(text: str) -> str:
        unit, expected = in_si(text), in_si(examples[0])
        if unit is None or expected is None or unit[1] != expected[1]:
            got = f"unknown unit {quoted(text)}" if text and unit is None else quoted(text)
            remedy = did_you_mean(text, examples, "write powers and products as in kg*m^2, N*mm/deg")
            raise complaint(got, f"a unit such as {examples[0]}", remedy)
        return text

    return AfterValidator(check)


def _ordered(limits: list[float]) -> list[float]:
    if limits[0] >= limits[1]:
        raise complaint(as_written(limits), "lower limit < upper limit", "swap or correct them")
    return limits


def _not_zero(vector: list[float]) -> list[float]:
    if np.abs(vector).max() < 1e-9:
        raise complaint(as_written(vector), "a direction, such as [0, 0, 1]", "give the axis of the pin")
    return vector


def _no_zero(ratio: float) -> float:
    if ratio == 0:
        raise complaint("0", "a ratio that is not zero", "give the turns of the wave generator for one of the joint")
    return ratio


Name = Annotated[str, Field(pattern=f"^{NAME}$")]
Line = Annotated[str, Field(pattern=r"^[^\x00-\x1f\x7f-\x9f]*$")]
Number = Annotated[float, Field(ge=-LARGEST, le=LARGEST)]
NonNegative = Annotated[float, Field(ge=0, le=LARGEST)]
Interval = Annotated[list[Number], Field(min_length=2, max_length=2), AfterValidator(_ordered)]
Vector = Annotated[list[Number], Field(min_length=3, max_length=3)]
Matrix = Annotated[list[Vector], Field(min_length=3, max_length=3)]
Tensor = Annotated[
    Annotated[Vector, Tag("vector")] | Annotated[Matrix, Tag("matrix")],
    Discriminator(lambda v: "matrix" if isinstance(v, list) and list in map(type, v) else "vector"),
]
LengthUnit = Annotated[str, _checked_unit("m", "mm")]
Unit = TypeVar("Unit", bound=str)
Value = TypeVar("Value")


class Sourced(Table):
    """A table that says where its numbers come from, and may add a note of one line."""

    origin: Origin
    note: Line = ""


class Quantity(Sourced, Generic[Unit, Value]):
    """A number, or a vector or matrix of them, in a unit of the right dimension."""

    value: Value
    unit: Unit

    @property
    def number(self) -> Any:
        """The value in SI units."""
        return si(self.value, self.unit)


def _width(text: str, unit: str, *, share: bool) -> str:
    """Accept a standard deviation, `2mm` or, where shares mean something, `5%`."""
    found = width(text, unit)
    if found is None or (found.share and not share):
        expected = f"a standard deviation such as {'5% or ' if share else ''}2{unit}"
        raise complaint(quoted(text), expected, "correct it, or drop `uncertainty`")
    return text


class Mass(Quantity[Annotated[str, _unit("mass", "g")], Annotated[float, _range("mass")]]):
    """A mass, and how well it is known: its standard deviation."""

    uncertainty: Annotated[str, AfterValidator(lambda text: _width(text, "kg", share=True))] | None = None


class Position(Quantity[Annotated[str, _unit("com")], Vector]):
    """A position, and how well each of its components is known: their standard deviation."""

    uncertainty: Annotated[str, AfterValidator(lambda text: _width(text, "mm", share=False))] | None = None


Stiffness = Quantity[Annotated[str, _unit("k_bend")], Annotated[float, _range("k_bend")]]
Time = Quantity[Annotated[str, _unit("tau_bend", "ms")], Annotated[float, _range("tau_bend")]]
Acceleration = Quantity[Annotated[str, _checked_unit("m/s^2")], Vector]
Limits = Quantity[Annotated[str, _checked_unit("rad", "deg")], Interval]
Angle = Quantity[Annotated[str, _unit("phase", "deg")], Annotated[float, _range("phase")]]
AngleAmplitude = Quantity[Annotated[str, _unit("error", "deg")], Annotated[float, _range("error")]]
AngleRate = Quantity[Annotated[str, _unit("speed", "deg/s")], Annotated[float, _range("speed")]]
AngularAcceleration = Quantity[
    Annotated[str, _unit("acceleration", "deg/s^2")], Annotated[float, _range("acceleration")]
]
AngularJerk = Quantity[Annotated[str, _unit("jerk", "deg/s^3")], Annotated[float, _range("jerk")]]
ServoStiffness = Quantity[Annotated[str, _unit("k_servo")], Annotated[float, _range("k_servo")]]
Height = Quantity[Annotated[str, _unit("height")], Annotated[float, _range("height")]]
Eccentricity = Quantity[Annotated[str, _unit("eccentricity")], Annotated[float, _range("eccentricity")]]
Radius = Quantity[Annotated[str, _unit("driver_radius")], Annotated[float, _range("driver_radius")]]
MassMoment = Quantity[Annotated[str, _unit("rotor_inertia", "kg*mm^2")], Annotated[float, _range("rotor_inertia")]]
Force = Quantity[Annotated[str, _unit("pretension")], Annotated[float, _range("pretension")]]
Torque = Quantity[Annotated[str, _unit("torque1")], Annotated[float, _range("torque1")]]
CubicStiffness = Quantity[Annotated[str, _unit("cubic")], Annotated[float, _range("cubic")]]
SpanStiffness = Quantity[Annotated[str, _unit("stiffness", "N/mm")], Annotated[float, _range("stiffness")]]


class Direction(Sourced):
    """A direction of any length but zero."""

    value: Annotated[Vector, AfterValidator(_not_zero)]

    @property
    def number(self) -> Any:
        """The unit vector."""
        return np.asarray(self.value) / np.linalg.norm(self.value)


class Shares(Sourced):
    """Shares of the pins in one motion, without unit."""

    value: Annotated[list[Number], Field(min_length=1), AfterValidator(_not_zero)]

    @property
    def number(self) -> Any:
        """The shares."""
        return np.asarray(self.value)


class Profile(Sourced):
    """How a stroke goes from end to end."""

    value: Literal["s-curve", "trapezoid", "cycloid"]


class Postures(
    Quantity[Annotated[str, _checked_unit("rad", "deg")], Annotated[list[list[Number]], Field(min_length=1)]]
):
    """Joint angles of several postures."""

    @property
    def number(self) -> Any:
        """The angles of each [rad]."""
        return tuple(tuple(map(float, si(angles, self.unit))) for angles in self.value)


class NonZero(Sourced):
    """A ratio, without unit."""

    value: Annotated[Number, AfterValidator(_no_zero)]

    @property
    def number(self) -> Any:
        """The ratio."""
        return np.asarray(self.value)


class Ratio(Sourced):
    """A ratio of stiffnesses, without unit."""

    value: Annotated[float, _range("ratio2")]

    @property
    def number(self) -> Any:
        """The ratio."""
        return np.asarray(self.value)


class LossFactor(Sourced):
    """A loss factor, without unit."""

    value: Annotated[float, _range("loss_bend")]

    @property
    def number(self) -> Any:
        """The factor."""
        return np.asarray(self.value)


class Inertia(Quantity[Annotated[str, _checked_unit("kg*m^2", "kg*mm^2")], Tensor]):
    """Principal moments along the frame's axes, or the full tensor, about the mass centre [kg m^2]."""

    def tensor(self, mass: float) -> Any:
        """Return the (3, 3) tensor; the mass is not used."""
        return np.diag(self.number) if self.number.ndim == 1 else self.number


class Box(Sourced):
    """A solid box along the frame's axes."""

    kind: Literal["box"]
    unit: LengthUnit
    size: Annotated[list[NonNegative], Field(min_length=3, max_length=3)]

    def tensor(self, mass: float) -> Any:
        """Return m/12 (|s|^2 1 - diag s^2), (3, 3) [kg m^2]."""
        square = si(self.size, self.unit) ** 2
        return mass / 12 * np.diag(square.sum() - square)

    def half(self) -> Any:
        """Return half the edges, (3,) [m]."""
        return si(self.size, self.unit) / 2


class Cylinder(Sourced):
    """A solid cylinder along one of the frame's axes."""

    kind: Literal["cylinder"]
    unit: LengthUnit
    radius: NonNegative
    length: NonNegative
    axis: Literal["x", "y", "z"] = "z"

    def tensor(self, mass: float) -> Any:
        """Return m r^2/2 about the axis and m (3 r^2 + l^2)/12 across it, (3, 3) [kg m^2]."""
        radius, length = si([self.radius, self.length], self.unit)
        moments = np.full(3, (3 * radius**2 + length**2) / 12)
        moments["xyz".index(self.axis)] = radius**2 / 2
        return mass * np.diag(moments)

    def half(self) -> Any:
        """Return half the edges of the box about it, (3,) [m]."""
        radius, length = si([self.radius, self.length], self.unit)
        edges = np.full(3, radius)
        edges["xyz".index(self.axis)] = length / 2
        return edges


class Lump(Table):
    """A point mass."""

    kind: Literal["point"]

    def tensor(self, mass: float) -> Any:
        """Return zeros, (3, 3) [kg m^2]."""
        return np.zeros((3, 3))
