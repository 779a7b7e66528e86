"""Schema of `arm.toml`: its tables and quantities, and the arm that they describe."""

from collections.abc import Callable, Iterator, Mapping
from functools import cached_property
from typing import Annotated, Any, Generic, Literal, TypeVar

import numpy as np
from pydantic import AfterValidator, BaseModel, ConfigDict, Discriminator, Field, Tag, model_validator
from pydantic_core import PydanticCustomError

from ident.arm.arm import GRAVITY, Arm, Workspace
from ident.arm.fields import DAMPING, LARGEST, LOSS, STIFFNESS, field_named
from ident.arm.parts import (
    Belt,
    Body,
    CubicSpring,
    Drive,
    ErrorOrder,
    Joint,
    MassDamping,
    Payload,
    Point,
    Servo,
    Spring,
    Stroke,
    inertia_problems,
    order_name,
    order_problems,
)
from ident.text import NAME, did_you_mean, quoted
from ident.units import in_si, width

# -------- Quantities
# Numbers in `arm.toml`: with unit and origin, as a scalar, a vector, an inertia tensor or a shape.
#
# `mass = { value = 42.0, unit = "kg", origin = "assumed", note = "..." }`. Any unit of the right dimension will do;
# angles count as a dimension, so that `N*m` is refused where `N*m/rad` is meant.

Origin = Literal["paper", "assumed", "calibrated", "measured", "derived", "datasheet", "designed"]
Part = TypeVar("Part")


def complaint(got: str, expected: str, remedy: str) -> PydanticCustomError:
    """Return the error of a validator; pydantic adds the location."""
    return PydanticCustomError("ident", "{got}", {"got": got, "expected": expected, "remedy": remedy})


def as_written(value: Any) -> str:
    """Return a value for a message, in TOML syntax on one line."""
    if isinstance(value, dict):
        return "a table"
    text = str(value).lower() if isinstance(value, bool) else repr(value)
    return text if len(text) <= 60 else f"{text[:57]}..."


class Table(BaseModel):
    """A TOML table: no unknown keys, no silent conversion, no nan or inf."""

    model_config = ConfigDict(strict=True, extra="forbid", allow_inf_nan=False)

    def part(self, kind: Callable[..., Part], **more: Any) -> Part:
        """Return the part of the arm from the table: each key has the meaning of the part's attribute."""
        given = {key: getattr(self, key) for key in type(self).model_fields if key not in more}
        return kind(**{key: getattr(each, "number", each) for key, each in given.items() if each is not None}, **more)


def si(value: Any, unit: str) -> Any:
    """Convert numbers from a unit to SI."""
    known = in_si(unit)
    assert known, "it was checked when it was read"
    return np.asarray(value, dtype=float) * known[0]


def _range(name: str) -> Any:
    """Accept possible values of a field of the arm, by its sign."""
    sign = field_named(name).sign
    if sign == "positive":
        return Field(gt=0, le=LARGEST)
    return Field(ge=0 if sign == "non-negative" else -LARGEST, le=LARGEST)


def _unit(name: str, *others: str) -> AfterValidator:
    """Accept units of the dimension of a field of the arm; `others` are further examples in messages."""
    field = field_named(name)
    return _checked_unit(*(unit.replace(" ", "*") for unit in (field.unit, *others, field.read_unit)))


def _checked_unit(*examples: str) -> AfterValidator:
    """Accept units of the dimension of the examples; the first example is SI."""

    def check(text: str) -> str:
        unit, expected = in_si(text), in_si(examples[0])
        if unit is None or expected is None or unit[1] != expected[1]:
            got = f"unknown unit {quoted(text)}" if text and unit is None else quoted(text)
            remedy = did_you_mean(text, examples, "write powers and products as in kg*m^2, N*mm/deg")
            raise complaint(got, f"a unit such as {examples[0]}", remedy)
        return text

    return AfterValidator(check)


def _but(wrong: Callable[[Any], Any], expected: str, remedy: str) -> AfterValidator:
    """Refuse some values."""

    def check(value: Any) -> Any:
        if wrong(value):
            raise complaint("0" if value == 0 else as_written(value), expected, remedy)
        return value

    return AfterValidator(check)


def _possible_order(order: float) -> float:
    for problem in order_problems("", order):
        raise complaint(problem.got, problem.expected, problem.remedy)
    return order


_ordered = _but(lambda limits: limits[0] >= limits[1], "lower limit < upper limit", "swap or correct them")
_a_way = _but(lambda v: np.abs(v).max() < 1e-9, "a direction, such as [0, 0, 1]", "give the axis of the pin")
TURNS = "give the turns of the wave generator for one of the joint"
_turning = _but(lambda x: x == 0, "a ratio that is not zero", TURNS)
Name = Annotated[str, Field(pattern=f"^{NAME}$")]
Line = Annotated[str, Field(pattern=r"^[^\x00-\x1f\x7f-\x9f]*$")]
Number = Annotated[float, Field(ge=-LARGEST, le=LARGEST)]
NonNegative = Annotated[float, Field(ge=0, le=LARGEST)]
Interval = Annotated[list[Number], Field(min_length=2, max_length=2), _ordered]
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
    """A table with the origin of its numbers, and an optional note of one line."""

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
    """Accept a standard deviation, `2mm` or, where a share makes sense, `5%`."""
    found = width(text, unit)
    if found is None or (found.share and not share):
        expected = f"a standard deviation such as {'5% or ' if share else ''}2{unit}"
        raise complaint(quoted(text), expected, "correct it, or drop `uncertainty`")
    return text


class Mass(Quantity[Annotated[str, _unit("mass", "g")], Annotated[float, _range("mass")]]):
    """A mass with its standard deviation."""

    uncertainty: Annotated[str, AfterValidator(lambda text: _width(text, "kg", share=True))] | None = None


class Position(Quantity[Annotated[str, _unit("com")], Vector]):
    """A position with the standard deviation of its components."""

    uncertainty: Annotated[str, AfterValidator(lambda text: _width(text, "mm", share=False))] | None = None


RIGID = "rigid"
Stiffness = Annotated[
    Annotated[Quantity[Annotated[str, _unit("k_bend")], Annotated[float, _range("k_bend")]], Tag("quantity")]
    | Annotated[Literal["rigid"], Tag("word")],
    Discriminator(lambda v: "word" if isinstance(v, str) else "quantity"),
]
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


class Plain(Sourced, Generic[Value]):
    """A number, or several, without unit."""

    value: Value

    @property
    def number(self) -> Any:
        """The numbers as an array."""
        return np.asarray(self.value)


class Direction(Plain[Annotated[Vector, _a_way]]):
    """A direction of any length but zero."""

    @property
    def number(self) -> Any:
        """The unit vector."""
        return np.asarray(self.value) / np.linalg.norm(self.value)


Shares = Plain[Annotated[list[Number], Field(min_length=1), _a_way]]
"""Shares of the pins in one motion."""
NonZero = Plain[Annotated[Number, _turning]]
Ratio = Plain[Annotated[float, _range("ratio2")]]
PerMass = Quantity[Annotated[str, _checked_unit("1/s")], Annotated[float, _range("alpha")]]
LossFactor = Plain[Annotated[float, _range("loss_bend")]]
Profile = Plain[Literal["s-curve", "trapezoid", "cycloid", "minimum-jerk"]]
"""Speed profile of a stroke."""


class Postures(
    Quantity[Annotated[str, _checked_unit("rad", "deg")], Annotated[list[list[Number]], Field(min_length=1)]]
):
    """Joint angles of several postures."""

    @property
    def number(self) -> Any:
        """The angles of each [rad]."""
        return tuple(tuple(map(float, si(angles, self.unit))) for angles in self.value)


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


# -------- Spring tables
# Nonlinear springs in `arm.toml`: `[[spring]]` and `[[cubic_spring]]`.


class JointPartTable(Table):
    """A part on a joint."""

    name: Name
    joint: str


class SpringTable(JointPartTable):
    """A piecewise linear spring; each key has the meaning of `Spring`'s attribute."""

    direction: Literal["bending", "torsion"]
    ratio2: Ratio
    ratio3: Ratio
    torque1: Torque
    torque2: Torque


class CubicSpringTable(JointPartTable):
    """A cubic spring; each key has the meaning of `CubicSpring`'s attribute."""

    direction: Literal["bending", "torsion"]
    cubic: CubicStiffness


# -------- Schema

Loc = tuple[str | int, ...]


class BodyTable(Table):
    """A rigid body; its inertia is given, or computed from mass and shape."""

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
        for problem in inertia_problems(self.name, self.mass.number, self._tensor()):
            raise complaint(problem.got, problem.expected, problem.remedy)
        return self

    def _tensor(self) -> Any:
        source: Any = self.inertia or self.shape
        return source.tensor(float(self.mass.number))

    def body(self) -> Body:
        """Return the body as a value."""
        return Body(self.name, self.mass.number, self.com.number, self._tensor())

    def extent(self) -> Any:
        """Return lowest and highest corner, (2, 3) [m], in the joint's axes; None without an extended shape."""
        if self.shape is None or isinstance(self.shape, Lump):
            return None
        return self.com.number + np.array([[-1.0], [1.0]]) * self.shape.half()


# Validated on use, since the registry of units takes a moment to build.
UNDAMPED = Time.model_construct(value=0.0, unit="s", origin="assumed")
UPRIGHT = Direction.model_construct(value=[0.0, 0.0, 1.0], origin="assumed")
STANDARD = Acceleration.model_construct(value=list(GRAVITY), unit="m/s^2", origin="assumed")


class EachWay(Table, Generic[Value]):
    """A number for bending and one for torsion."""

    bend: Value | None = None
    tors: Value | None = None

    @model_validator(mode="after")
    def _some(self) -> "EachWay[Value]":
        if self.bend is self.tors is None:
            raise complaint("no direction", "bend, tors or both", "give one of them a number")
        return self


ONE_OR_EACH = Discriminator(lambda v: "table" if isinstance(v, dict | EachWay) else "number")
Share = Annotated[float, Field(ge=0, le=1)]
Shared = Annotated[Annotated[Share, Tag("number")] | Annotated[EachWay[Share], Tag("table")], ONE_OR_EACH]
Lost = Annotated[Annotated[NonNegative, Tag("number")] | Annotated[EachWay[NonNegative], Tag("table")], ONE_OR_EACH]


class DampingTable(Table):
    """Damping of one bushing or of all, by one of three keys in each direction.

    Attributes:
        ratio: damping ratio of a lightly damped mode on such bushings alone: half the loss factor.
        loss_factor: share of the strain energy lost per cycle, over 2 pi.
        time: damping per stiffness.
    """

    ratio: Plain[Shared] | None = None
    loss_factor: Plain[Lost] | None = None
    time: Quantity[Annotated[str, _unit("tau_bend", "ms")], Lost] | None = None

    def by_way(self) -> dict[str, tuple[str, str, Any]]:
        """Return for `bend` and `tors` the given key, the field of a joint that it sets, and its quantity."""
        found: dict[str, tuple[str, str, Any]] = {}
        for word, field, factor in (("ratio", "loss", 2.0), ("loss_factor", "loss", 1.0), ("time", "tau", 1.0)):
            value = getattr(given := getattr(self, word), "value", None)
            for way in EachWay.model_fields:
                if (number := getattr(value, way, value)) is not None:
                    check_one_word(found.get(way, (word,))[0], word)
                    found[way] = word, f"{field}_{way}", given.model_copy(update={"value": factor * number})
        return found

    @model_validator(mode="after")
    def _one_word(self) -> "DampingTable":
        self.by_way()
        return self


def check_one_word(one: str, other: str) -> None:
    """Refuse two keys for the damping of a bushing in one direction."""
    if one != other:
        raise complaint(f"{one} and {other}", "one word for the damping of a bushing", f"take {one} or {other} out")


class ArmDampingTable(DampingTable):
    """Damping of all bushings, and proportional to mass: `alpha`, with the meaning of `MassDamping`'s attribute."""

    alpha: PerMass | None = None

    def in_arm(self) -> MassDamping:
        """Return the mass-proportional damping as a value."""
        return MassDamping(alpha=None if self.alpha is None else self.alpha.number)


BUSHING = (*STIFFNESS, *DAMPING, *LOSS)
"""Fields of a joint's bushing."""


class BushingTable(DampingTable):
    """The bushing of a joint; each key has the meaning of `Joint`'s attribute."""

    name: Name
    k_bend: Stiffness
    k_tors: Stiffness
    tau_bend: Time = UNDAMPED
    tau_tors: Time = UNDAMPED
    loss_bend: LossFactor | None = None
    loss_tors: LossFactor | None = None

    @model_validator(mode="after")
    def _loses_nothing_where_rigid(self) -> "BushingTable":
        for key in self.model_fields_set.intersection(BUSHING[2:]):
            if getattr(self, k := f"k_{key.partition('_')[2]}") == RIGID:
                raise complaint(f'{key} and {k} = "rigid"', "damping where it gives", f"take {key} out")
        if not self.fill(self) and (own := self.by_way()):
            word = next(iter(own.values()))[0]
            raise complaint(f"{word} and a rigid bushing", "damping where it gives", f"take {word} out")
        return self

    def fill(self, damping: DampingTable) -> bool:
        """Fill in the default damping of elastic directions without their own; return whether any was filled in."""
        taken = False
        for way, (word, field, number) in damping.by_way().items():
            said = self.model_fields_set.intersection({f"tau_{way}", f"loss_{way}"})
            for key in said if damping is self else ():
                check_one_word(word, key)
            if not said and getattr(self, f"k_{way}") != RIGID:
                setattr(self, field, number)
                taken = True
        return taken

    def bushing(self) -> dict[str, Any]:
        """Return the arguments of `Joint`."""
        quantities = {key: quantity for key in BUSHING if (quantity := getattr(self, key)) is not None}
        return {key: None if quantity == RIGID else quantity.number for key, quantity in quantities.items()}


class JointTable(BushingTable):
    """A joint with its bodies."""

    axis: Direction = UPRIGHT
    offset: Position
    limits: Limits | None = None
    speed: AngleRate | None = None
    acceleration: AngularAcceleration | None = None
    jerk: AngularJerk | None = None
    driven: bool = True
    shaft: list[BodyTable] = Field(default_factory=list)
    link: list[BodyTable] = Field(default_factory=list)

    def joint(self) -> Joint:
        """Return the joint as a value."""
        top = (self.speed, self.acceleration, self.jerk)
        speed, acceleration, jerk = (np.inf if each is None else float(each.number) for each in top)
        limits = tuple(self.limits.number.tolist()) if self.limits else (-np.inf, np.inf)
        shaft, link = (tuple(body.body() for body in bodies) for bodies in (self.shaft, self.link))
        parts, rates = {**self.bushing(), "shaft": shaft, "link": link}, (speed, acceleration, jerk)
        place = {"axis": self.axis.number, "offset": self.offset.number}
        return Joint(self.name, **place, **parts, driven=self.driven, limits=limits, rates=rates)


class PointTable(JointPartTable):
    """A named point on a joint's link."""

    position: Position


class PayloadTable(BodyTable):
    """A body that a load case may fix to a joint's link."""

    joint: str


class ErrorOrderTable(Table):
    """A further transmission error of a drive; each key has the meaning of `ErrorOrder`'s attribute."""

    order: Annotated[float, AfterValidator(_possible_order)]
    amplitude: AngleAmplitude
    phase: Angle | None = None


class DriveTable(JointPartTable):
    """A harmonic drive; each key has the meaning of `Drive`'s attribute.

    Pulley, wave generator and eccentric mass are parts of the shaft, whose bodies include their mass and inertia.
    """

    ratio: NonZero
    rotor_inertia: MassMoment | None = None
    eccentric_mass: Mass | None = None
    eccentricity: Eccentricity | None = None
    height: Height | None = None
    phase: Angle | None = None
    error: AngleAmplitude | None = None
    error_phase: Angle | None = None
    errors: list[ErrorOrderTable] = Field(default_factory=list)

    def drive(self) -> Drive:
        """Return the drive as a value; missing numbers are zero."""
        return self.part(Drive, errors=tuple(each.part(ErrorOrder, drive=self.name) for each in self.errors))


class BeltTable(Table):
    """A belt; each key has the meaning of `Belt`'s attribute."""

    name: Name
    driver: str
    driven: str
    driver_radius: Radius
    driven_radius: Radius
    pretension: Force
    stiffness: SpanStiffness
    tau: Time | None = None
    height: Height | None = None


class ServoTable(JointPartTable):
    """A servo that holds a motor; each key has the meaning of `Servo`'s attribute."""

    k_servo: ServoStiffness
    tau: Time | None = None


class StrokeTable(Table):
    """The straight motion of the hand; each key has the meaning of `Stroke`'s attribute."""

    direction: Shares
    profile: Profile | None = None
    folded: Angle
    unfolded: Angle
    speed: AngleRate
    acceleration: AngularAcceleration
    jerk: AngularJerk

    def stroke(self) -> Stroke:
        """Return the stroke as a value."""
        return self.part(Stroke, **({"profile": self.profile.value} if self.profile else {}))


class WorkspaceTable(Table):
    """Allowed postures of the arm; each key has the meaning of `Workspace`'s attribute."""

    line: Shares | None = None
    postures: Postures | None = None
    lowest: Height | None = None

    def workspace(self) -> Workspace:
        """Return the workspace as a value."""
        return Workspace(
            tuple(map(float, self.line.number)) if self.line else None,
            self.postures.number if self.postures else (),
            float(self.lowest.number) if self.lowest else -np.inf,
        )


KNOBS = {"time": "%", "speed": "% deg/s", "acceleration": "% deg/s^2", "jerk": "% deg/s^3"}
KNOBS |= {"ramp": "s ms", "jerk time": "s ms"}
"""What a knob of a controller scales, and the units that it may have."""


class KnobTable(Sourced):
    """A number that a controller takes: its name there, what it scales, its unit, range and step."""

    name: Annotated[Line, Field(min_length=1)]
    scales: Literal["time", "speed", "acceleration", "ramp", "jerk", "jerk time"]
    unit: str
    range: Annotated[list[Annotated[float, Field(gt=0, le=LARGEST)]], Field(min_length=2, max_length=2), _ordered]
    step: Annotated[float, Field(gt=0, le=LARGEST)]

    @model_validator(mode="after")
    def _possible(self) -> "KnobTable":
        if self.unit not in (units := KNOBS[self.scales].split()):
            raise complaint(quoted(self.unit), " or ".join(units), f"give that unit to what scales {self.scales}")
        if self.scales == "time" and not self.range[0] <= 100 <= self.range[1]:
            raise complaint(f"{self.range}", "a range with 100 %", "other knobs are set at an override of 100 %")
        return self


class ControllerTable(Table):
    """The knobs of the controller, one for each quantity that it can scale."""

    knob: Annotated[list[KnobTable], Field(min_length=1)]

    @model_validator(mode="after")
    def _one_each(self) -> "ControllerTable":
        scaled = [knob.scales for knob in self.knob]
        for twice in [scales for scales in scaled if scaled.count(scales) > 1][:1]:
            raise complaint(f"several knobs that scale {twice}", "one", "keep the one that is turned")
        return self


class Damped(Table):
    """A file of joints, with the default damping of joints without their own."""

    damping: ArmDampingTable = Field(default_factory=ArmDampingTable)
    joint: Any

    @model_validator(mode="after")
    def _damped(self) -> "Damped":
        filled = [joint.fill(self.damping) for joint in self.joint]
        if self.damping.by_way() and not any(filled):
            word = next(iter(self.damping.by_way().values()))[0]
            expected = "a bushing without damping of its own"
            raise complaint(f"[damping] {word}", expected, "take out the one or the other")
        return self


class ArmDocument(Damped):
    """The content of `arm.toml`."""

    format: Literal["ident-arm/1"]
    name: Annotated[Line, Field(min_length=1)]
    description: str = ""
    gravity: Acceleration = STANDARD
    joint: Annotated[list[JointTable], Field(min_length=1)]
    point: list[PointTable] = Field(default_factory=list)
    payload: list[PayloadTable] = Field(default_factory=list)
    drive: list[DriveTable] = Field(default_factory=list)
    belt: list[BeltTable] = Field(default_factory=list)
    servo: list[ServoTable] = Field(default_factory=list)
    spring: list[SpringTable] = Field(default_factory=list)
    cubic_spring: list[CubicSpringTable] = Field(default_factory=list)
    stroke: StrokeTable | None = None
    controller: ControllerTable | None = None
    workspace: WorkspaceTable = Field(default_factory=WorkspaceTable)

    @cached_property
    def arm(self) -> Arm:
        """The arm as a value, in SI units."""
        joints, payloads = (each.joint() for each in self.joint), (Payload(p.joint, p.body()) for p in self.payload)
        parts: Any = ((Point, self.point), (Belt, self.belt), (Servo, self.servo), (Spring, self.spring))
        points, belts, servos, springs = (tuple(each.part(kind) for each in tables) for kind, tables in parts)
        springs += tuple(each.part(CubicSpring) for each in self.cubic_spring)
        drives, stroke = tuple(each.drive() for each in self.drive), self.stroke.stroke() if self.stroke else None
        return Arm(
            self.name, tuple(joints), points, tuple(payloads), self.gravity.number, drives, belts, stroke,
            self.workspace.workspace(), servos, springs, self.damping.in_arm(),
        )  # fmt: skip

    def extents(self) -> dict[str, Any]:
        """Return the corners of the bodies with a shape, (2, 3) [m] by name."""
        bodies = [*(body for joint in self.joint for body in (*joint.shaft, *joint.link)), *self.payload]
        return {body.name: extent for body in bodies if (extent := body.extent()) is not None}

    def origins(self) -> dict[str, str]:
        """Return the origin by path: `derived` for numbers from a shape, `assumed` for missing numbers (zero)."""
        written = self.model_dump()
        tables = {name: table for _, name, table in named(written)} | {key: written[key] for key in SINGLE}

        def origin(path: str) -> str:
            name, field, *_ = path.split(".")
            source = tables[name][field]
            return source["origin"] if source else "derived" if "shape" in tables[name] else "assumed"

        return {path: origin(path) for path in self.arm.paths()}


SINGLE = ("stroke", "damping")
"""Tables without a name, which go by their key."""


def named(raw: Mapping[str, Any]) -> Iterator[tuple[Loc, Any, Any]]:
    """Yield every table that needs or gets a name, with that name, even from an otherwise invalid file."""
    for n, joint in _rows(raw, "joint"):
        yield ("joint", n), joint.get("name"), joint
        for kind in ("shaft", "link"):
            yield from ((("joint", n, kind, m), body.get("name"), body) for m, body in _rows(joint, kind))
    for kind in ("point", "payload", "drive", "belt", "servo", "spring", "cubic_spring"):
        for n, table in _rows(raw, kind):
            yield (kind, n), table.get("name"), table
            for m, error in _rows(table, "errors") if kind == "drive" else ():
                order = error.get("order")
                if isinstance(order, int | float):
                    yield ("drive", n, "errors", m), order_name(str(table.get("name")), order), error


def _rows(table: Mapping[str, Any], key: str) -> list[tuple[int, Any]]:
    rows = table.get(key)
    return [(n, row) for n, row in enumerate(rows) if isinstance(row, dict)] if isinstance(rows, list) else []


# -------- Uncertainty
# Standard deviations of the numbers in an arm file.


def uncertain_numbers(document: ArmDocument) -> dict[str, str]:
    """Return the standard deviation of each uncertain number, as written, by path."""
    found: dict[str, str] = {}
    for _, name, table in named(document.model_dump()):
        for key, part in table.items():
            if isinstance(part, dict) and (written := part.get("uncertainty")):
                found |= {f"{name}.{key}{end}": written for end in field_named(key).ends}
    return found
