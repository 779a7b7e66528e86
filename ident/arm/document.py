"""What `arm.toml` may say: its tables, with unit and origin at every number, and the arm that they describe.

A number is written `mass = { value = 42.0, unit = "kg", origin = "assumed", note = "..." }`. Any unit of the
right dimension will do; angles count as a dimension, so that `N*m` is refused where `N*m/rad` is meant.
"""

from collections.abc import Iterator, Mapping
from typing import Annotated, Any, Generic, Literal, TypeVar

import numpy as np
from pydantic import AfterValidator, BaseModel, ConfigDict, Discriminator, Field, Tag, model_validator
from pydantic_core import PydanticCustomError

from ident.arm.arm import GRAVITY, Arm, Body, Joint, Payload, Point, check_inertia
from ident.errors import InputError
from ident.text import NAME, did_you_mean, quoted
from ident.units import in_base_units, parse_unit

LARGEST = 1e15
"""Largest magnitude of any number: beyond it squares and products would overflow unnoticed."""

Origin = Literal["paper", "assumed", "calibrated", "measured", "derived", "datasheet"]
Loc = tuple[str | int, ...]


def complaint(got: str, expected: str, remedy: str) -> PydanticCustomError:
    """Return the error by which a validator says what is wrong; pydantic adds where."""
    return PydanticCustomError("ident", "{got}", {"got": got, "expected": expected, "remedy": remedy})


def shown(value: Any) -> str:
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
    return np.asarray(value, dtype=float) * in_base_units(parse_unit(unit))[0]


def _checked_unit(*examples: str) -> AfterValidator:
    """Accept units of the dimension of the examples, the first of which is SI."""

    def check(text: str) -> str:
        unit, expected = parse_unit(text), parse_unit(examples[0])
        if unit is None or in_base_units(unit)[1] != in_base_units(expected)[1]:
            got = f"unknown unit {quoted(text)}" if text and unit is None else quoted(text)
            remedy = did_you_mean(text, examples, "write powers and products as in kg*m^2, N*mm/deg")
            raise complaint(got, f"a unit such as {examples[0]}", remedy)
        return text

    return AfterValidator(check)


def _ordered(limits: list[float]) -> list[float]:
    if limits[0] >= limits[1]:
        raise complaint(shown(limits), "lower limit < upper limit", "swap or correct them")
    return limits


def _not_zero(vector: list[float]) -> list[float]:
    if np.abs(vector).max() < 1e-9:
        raise complaint(shown(vector), "a direction, such as [0, 0, 1]", "give the axis of the pin")
    return vector


Name = Annotated[str, Field(pattern=f"^{NAME}$")]
Line = Annotated[str, Field(pattern=r"^[^\x00-\x1f\x7f-\x9f]*$")]
Number = Annotated[float, Field(ge=-LARGEST, le=LARGEST)]
Positive = Annotated[float, Field(gt=0, le=LARGEST)]
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


Mass = Quantity[Annotated[str, _checked_unit("kg", "g")], NonNegative]
Position = Quantity[LengthUnit, Vector]
Stiffness = Quantity[Annotated[str, _checked_unit("N*m/rad", "N*mm/deg")], Positive]
Time = Quantity[Annotated[str, _checked_unit("s", "ms")], NonNegative]
Acceleration = Quantity[Annotated[str, _checked_unit("m/s^2")], Vector]
Limits = Quantity[Annotated[str, _checked_unit("rad", "deg")], Interval]


class Direction(Sourced):
    """A direction of any length but zero."""

    value: Annotated[Vector, AfterValidator(_not_zero)]

    @property
    def number(self) -> Any:
        """The unit vector."""
        return np.asarray(self.value) / np.linalg.norm(self.value)


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


class Lump(Table):
    """A point mass."""

    kind: Literal["point"]

    def tensor(self, mass: float) -> Any:
        """Return zeros, (3, 3) [kg m^2]."""
        return np.zeros((3, 3))


class BodyTable(Table):
    """A rigid body; its inertia is given, or follows from mass and shape."""

    name: Name
    mass: Mass
    com: Position
    inertia: Inertia | None = None
    shape: Annotated[Box | Cylinder | Lump, Field(discriminator="kind")] | None = None

    @model_validator(mode="after")
    def _has_one_possible_inertia(self) -> "BodyTable":
        if (self.inertia is None) == (self.shape is None):
            got = "neither inertia nor shape" if self.shape is None else "both inertia and shape"
            raise complaint(got, "one of them", 'a body without extension has shape = { kind = "point" }')
        try:
            check_inertia(self.name, self.mass.number, self._tensor())
        except InputError as error:
            problem = error.problems[0]
            raise complaint(problem.got, problem.expected, problem.remedy) from None
        return self

    def _tensor(self) -> Any:
        source: Any = self.inertia or self.shape
        return source.tensor(float(self.mass.number))

    def body(self) -> Body:
        """Return the body as a value."""
        return Body(self.name, self.mass.number, self.com.number, self._tensor())


# Checked when they are used: the registry of units takes a moment to build.
UNDAMPED = Time.model_construct(value=0.0, unit="s", origin="assumed")
UPRIGHT = Direction.model_construct(value=[0.0, 0.0, 1.0], origin="assumed")
STANDARD = Acceleration.model_construct(value=list(GRAVITY), unit="m/s^2", origin="assumed")


class JointTable(Table):
    """A joint with its bodies; the meaning of each key is that of `Joint`'s attribute."""

    name: Name
    axis: Direction = UPRIGHT
    offset: Position
    k_bend: Stiffness
    k_tors: Stiffness
    tau_bend: Time = UNDAMPED
    tau_tors: Time = UNDAMPED
    limits: Limits | None = None
    driven: bool = True
    shaft: list[BodyTable] = []
    link: list[BodyTable] = []

    def joint(self) -> Joint:
        """Return the joint as a value."""
        quantities = ("axis", "offset", "k_bend", "k_tors", "tau_bend", "tau_tors")
        return Joint(
            self.name,
            **{key: getattr(self, key).number for key in quantities},
            shaft=tuple(body.body() for body in self.shaft),
            link=tuple(body.body() for body in self.link),
            driven=self.driven,
            limits=tuple(self.limits.number.tolist()) if self.limits else (-np.inf, np.inf),
        )


class PointTable(Table):
    """A named point on a joint's link."""

    name: Name
    joint: str
    position: Position


class PayloadTable(BodyTable):
    """A body that a load case may fix to a joint's link."""

    joint: str


class ArmDocument(Table):
    """All that `arm.toml` says."""

    format: Literal["ident-arm/1"]
    name: Annotated[Line, Field(min_length=1)]
    description: str = ""
    gravity: Acceleration = STANDARD
    joint: Annotated[list[JointTable], Field(min_length=1)]
    point: list[PointTable] = []
    payload: list[PayloadTable] = []

    def arm(self) -> Arm:
        """Return the arm as a value, in SI units."""
        return Arm(
            self.name,
            tuple(joint.joint() for joint in self.joint),
            tuple(Point(p.name, p.joint, p.position.number) for p in self.point),
            tuple(Payload(p.joint, p.body()) for p in self.payload),
            self.gravity.number,
        )

    def origins(self) -> dict[str, str]:
        """Return the origin by path; an inertia that follows from a shape is derived."""
        tables = {table["name"]: table for _, table in named(self.model_dump())}
        sources = {path: tables[path.split(".")[0]][path.split(".")[1]] for path in self.arm().paths()}
        return {path: source["origin"] if source else "derived" for path, source in sources.items()}


def named(raw: Mapping[str, Any]) -> Iterator[tuple[Loc, Any]]:
    """Yield every table that should have a name, whatever else may be wrong with the document."""
    for n, joint in _rows(raw, "joint"):
        yield ("joint", n), joint
        for kind in ("shaft", "link"):
            yield from ((("joint", n, kind, m), body) for m, body in _rows(joint, kind))
    for kind in ("point", "payload"):
        yield from (((kind, n), table) for n, table in _rows(raw, kind))


def _rows(table: Mapping[str, Any], key: str) -> list[tuple[int, Any]]:
    rows = table.get(key)
    return [(n, row) for n, row in enumerate(rows) if isinstance(row, dict)] if isinstance(rows, list) else []
