"""What `arm.toml` may say: its tables, and the arm that they describe. How a number is written: `quantities`."""

from collections.abc import Iterator, Mapping
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, model_validator

from ident.arm.arm import GRAVITY, Arm
from ident.arm.drive import Belt, Drive, Servo, Stroke
from ident.arm.fields import LOSS, names_of
from ident.arm.parts import Body, Joint, Payload, Point, check_inertia
from ident.arm.workspace import Workspace
from ident.description.quantities import (
    Acceleration,
    Angle,
    AngleAmplitude,
    AngleRate,
    AngularAcceleration,
    AngularJerk,
    Box,
    Cylinder,
    Direction,
    Eccentricity,
    Force,
    Height,
    Inertia,
    Limits,
    Line,
    LossFactor,
    Lump,
    Mass,
    MassMoment,
    Name,
    NonZero,
    Position,
    Postures,
    Profile,
    Radius,
    ServoStiffness,
    Shares,
    SpanStiffness,
    Stiffness,
    Table,
    Time,
    complaint,
)
from ident.description.spring_tables import CubicSpringTable, SpringTable
from ident.errors import InputError

Loc = tuple[str | int, ...]


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

    def extent(self) -> Any:
        """Return lowest and highest corner, (2, 3) [m], in the joint's axes; None without a shape that extends."""
        if self.shape is None or isinstance(self.shape, Lump):
            return None
        return self.com.number + np.array([[-1.0], [1.0]]) * self.shape.half()


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
    loss_bend: LossFactor | None = None
    loss_tors: LossFactor | None = None
    limits: Limits | None = None
    driven: bool = True
    shaft: list[BodyTable] = Field(default_factory=list)
    link: list[BodyTable] = Field(default_factory=list)

    def joint(self) -> Joint:
        """Return the joint as a value."""
        quantities = ("axis", "offset", "k_bend", "k_tors", "tau_bend", "tau_tors")
        return Joint(
            self.name,
            **{key: getattr(self, key).number for key in quantities},
            **_given(self, LOSS),
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


class DriveTable(Table):
    """A harmonic drive; the meaning of each key is that of `Drive`'s attribute.

    Pulley, wave generator and turning mass are parts of the shaft, whose bodies have their mass and their inertia.
    """

    name: Name
    joint: str
    ratio: NonZero
    rotor_inertia: MassMoment | None = None
    eccentric_mass: Mass | None = None
    eccentricity: Eccentricity | None = None
    height: Height | None = None
    phase: Angle | None = None
    error: AngleAmplitude | None = None
    error_phase: Angle | None = None

    def drive(self) -> Drive:
        """Return the drive as a value; what is not given is zero."""
        return Drive(self.name, self.joint, **_given(self, names_of("Drive")))


class BeltTable(Table):
    """A belt; the meaning of each key is that of `Belt`'s attribute."""

    name: Name
    driver: str
    driven: str
    driver_radius: Radius
    driven_radius: Radius
    pretension: Force
    stiffness: SpanStiffness
    tau: Time | None = None
    height: Height | None = None

    def belt(self) -> Belt:
        """Return the belt as a value."""
        return Belt(self.name, self.driver, self.driven, **_given(self, names_of("Belt")))


class ServoTable(Table):
    """A servo that holds a motor; the meaning of each key is that of `Servo`'s attribute."""

    name: Name
    joint: str
    k_servo: ServoStiffness
    tau: Time | None = None

    def servo(self) -> Servo:
        """Return the servo as a value."""
        return Servo(self.name, self.joint, **_given(self, names_of("Servo")))


class StrokeTable(Table):
    """The straight motion of the hand; the meaning of each key is that of `Stroke`'s attribute."""

    direction: Shares
    profile: Profile | None = None
    folded: Angle
    unfolded: Angle
    speed: AngleRate
    acceleration: AngularAcceleration
    jerk: AngularJerk

    def stroke(self) -> Stroke:
        """Return the stroke as a value."""
        profile = {"profile": self.profile.value} if self.profile else {}
        return Stroke(self.direction.number, **profile, **_given(self, names_of("Stroke")))


class WorkspaceTable(Table):
    """Where the arm may be held; the meaning of each key is that of `Workspace`'s attribute."""

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


def _given(table: Table, fields: tuple[str, ...]) -> dict[str, Any]:
    return {field: quantity.number for field in fields if (quantity := getattr(table, field)) is not None}


class ArmDocument(Table):
    """All that `arm.toml` says."""

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
    workspace: WorkspaceTable = Field(default_factory=WorkspaceTable)

    def arm(self) -> Arm:
        """Return the arm as a value, in SI units."""
        return Arm(
            self.name,
            tuple(joint.joint() for joint in self.joint),
            tuple(Point(p.name, p.joint, p.position.number) for p in self.point),
            tuple(Payload(p.joint, p.body()) for p in self.payload),
            self.gravity.number,
            tuple(drive.drive() for drive in self.drive),
            tuple(belt.belt() for belt in self.belt),
            self.stroke.stroke() if self.stroke else None,
            self.workspace.workspace(),
            tuple(servo.servo() for servo in self.servo),
            (*(each.spring() for each in self.spring), *(each.spring() for each in self.cubic_spring)),
        )

    def extents(self) -> dict[str, Any]:
        """Return the corners of the bodies whose shape is known, (2, 3) [m] by name."""
        bodies = [body for joint in self.joint for body in (*joint.shaft, *joint.link)] + [*self.payload]
        return {body.name: extent for body in bodies if (extent := body.extent()) is not None}

    def origins(self) -> dict[str, str]:
        """Return the origin by path; what follows from a shape is derived, what is left out is assumed to be zero."""
        written = self.model_dump()
        tables = {table["name"]: table for _, table in named(written)} | {"stroke": written["stroke"]}

        def origin(path: str) -> str:
            name, field, *_ = path.split(".")
            source = tables[name][field]
            return source["origin"] if source else "derived" if "shape" in tables[name] else "assumed"

        return {path: origin(path) for path in self.arm().paths()}


def named(raw: Mapping[str, Any]) -> Iterator[tuple[Loc, Any]]:
    """Yield every table that should have a name, whatever else may be wrong with the document."""
    for n, joint in _rows(raw, "joint"):
        yield ("joint", n), joint
        for kind in ("shaft", "link"):
            yield from ((("joint", n, kind, m), body) for m, body in _rows(joint, kind))
    for kind in ("point", "payload", "drive", "belt", "servo", "spring", "cubic_spring"):
        yield from (((kind, n), table) for n, table in _rows(raw, kind))


def _rows(table: Mapping[str, Any], key: str) -> list[tuple[int, Any]]:
    rows = table.get(key)
    return [(n, row) for n, row in enumerate(rows) if isinstance(row, dict)] if isinstance(rows, list) else []
