"""The arm as a file: `arm.toml` to `Arm`, every number with its unit and its origin.

A number is written `mass = { value = 42.0, unit = "kg", origin = "assumed", note = "..." }`. Any unit of the
right dimension will do; angles count as a dimension, so that `N*m` is refused where `N*m/rad` is meant.
"""

import difflib
import hashlib
import re
import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from os import PathLike
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, get_args

import numpy as np
import tomlkit
from pydantic import BaseModel, ConfigDict, Discriminator, Field, Tag, ValidationError
from pydantic import field_validator as on_field
from pydantic import model_validator as on_model
from pydantic_core import PydanticCustomError

from ident.arm.arm import COMPONENTS, GRAVITY, Arm, Body, Joint, Payload, Point, check_inertia
from ident.errors import InputError, Problem

FORMAT = "ident-arm/1"
LARGEST = 1e15
"""Largest magnitude of any number, in SI: beyond it squares and products would overflow unnoticed."""

Origin = Literal["paper", "assumed", "calibrated", "measured", "derived", "datasheet"]
NAME = r"^[A-Za-z0-9_-]+$"
"""Names of parts: nothing that a path such as `link1.com.x` could confuse."""

Name = Annotated[str, Field(pattern=NAME)]
Line = Annotated[str, Field(pattern=r"^[^\x00-\x1f\x7f-\x9f]*$")]
Positive = Annotated[float, Field(gt=0)]
NonNegative = Annotated[float, Field(ge=0)]
Vector = Annotated[list[float], Field(min_length=3, max_length=3)]
Matrix = Annotated[list[Vector], Field(min_length=3, max_length=3)]
Tensor = Annotated[
    Annotated[Vector, Tag("vector")] | Annotated[Matrix, Tag("matrix")],
    Discriminator(
        lambda v: "matrix" if isinstance(v, list) and any(isinstance(r, list) for r in v) else "vector"
    ),
]
Loc = tuple[str | int, ...]


# -------- units


@cache
def _registry() -> Any:
    import pint

    return pint.UnitRegistry()


@cache
def _base_unit(unit: str) -> tuple[float, str]:
    """Return the factor to SI and the SI base unit, radian included; raises what pydantic reports."""
    registry = _registry()
    try:
        factor, base = registry.get_base_units(registry.parse_units(unit))
    except Exception:  # pint raises half a dozen unrelated types on malformed text
        known = difflib.get_close_matches(
            unit, ("kg", "m", "mm", "s", "deg", "rad", "N*m/rad", "N*mm/deg", "kg*m^2")
        )
        remedy = (
            f"did you mean {' or '.join(known)}?"
            if known
            else "write powers and products as in kg*m^2, N*mm/deg"
        )
        raise _complaint(f"unknown unit {_shown(unit)}", "a unit", remedy) from None
    return float(factor), str(base)


def _complaint(got: str, expected: str, remedy: str) -> PydanticCustomError:
    return PydanticCustomError("ident", "{got}", {"got": got, "expected": expected, "remedy": remedy})


def _shown(value: Any) -> str:
    if isinstance(value, dict):
        return "a table"
    text = str(value).lower() if isinstance(value, bool) else repr(value)
    return text if len(text) <= 60 else f"{text[:57]}..."


def nearest(word: str, known: list[str]) -> str:
    """Return the question whether a known word was meant, or nothing if none is near."""
    near = difflib.get_close_matches(word, known, n=2)
    return f"did you mean {' or '.join(near)}?" if near else ""


# -------- the document


class Table(BaseModel):
    """A TOML table: no unknown keys, no silent conversion, no nan or inf."""

    model_config = ConfigDict(strict=True, extra="forbid", allow_inf_nan=False)


class Sourced(Table):
    """Numbers in one unit from one origin.

    Attributes:
        unit: any unit of the dimension that `SI` has.
        origin: where the numbers come from.
        note: a line of explanation.
    """

    SI: ClassVar[str] = "m"
    unit: str
    origin: Origin
    note: Line = ""

    @on_field("unit")
    @classmethod
    def _of_the_right_dimension(cls, unit: str) -> str:
        if _base_unit(unit)[1] != _base_unit(cls.SI)[1]:
            raise _complaint(
                f"'{unit}'", f"a unit such as {cls.SI}", "write powers and products as in kg*m^2, N*mm/deg"
            )
        return unit

    def si(self, value: Any) -> Any:
        """Return a value of this table in SI units."""
        return np.asarray(value, dtype=float) * _base_unit(self.unit)[0]


class Quantity(Sourced):
    """A number, or a vector or matrix of them."""

    value: Any

    @on_model(mode="after")
    def _of_sane_size(self) -> "Quantity":
        if not np.all(np.abs(self.number) <= LARGEST):
            raise _complaint(
                _shown(self.value), f"magnitudes up to {LARGEST:.0e} {self.SI}", "check value and unit"
            )
        return self

    @property
    def number(self) -> Any:
        """The value in SI units."""
        return self.si(self.value)


class Mass(Quantity):
    """A mass, zero allowed [kg]."""

    SI: ClassVar[str] = "kg"
    value: NonNegative


class Position(Quantity):
    """A position or offset [m]."""

    value: Vector


class Inertia(Quantity):
    """Principal moments along the frame's axes, or the full tensor, about the mass centre [kg m^2]."""

    SI: ClassVar[str] = "kg*m^2"
    value: Tensor

    def tensor(self, mass: float) -> Any:
        """Return the (3, 3) tensor; the mass is not used."""
        return np.diag(self.number) if self.number.ndim == 1 else self.number


class Stiffness(Quantity):
    """A rotational stiffness [N m/rad]."""

    SI: ClassVar[str] = "N*m/rad"
    value: Positive


class Time(Quantity):
    """Damping per stiffness [s]."""

    SI: ClassVar[str] = "s"
    value: NonNegative


class Acceleration(Quantity):
    """Gravity in the base frame [m/s^2]."""

    SI: ClassVar[str] = "m/s^2"
    value: Vector


class Limits(Quantity):
    """Lower and upper pin angle [rad]."""

    SI: ClassVar[str] = "rad"
    value: Annotated[list[float], Field(min_length=2, max_length=2)]

    @on_model(mode="after")
    def _ordered(self) -> "Limits":
        if self.value[0] >= self.value[1]:
            raise _complaint(_shown(self.value), "lower limit < upper limit", "swap or correct them")
        return self


class Direction(Table):
    """A direction of any length but zero."""

    value: Vector
    origin: Origin
    note: Line = ""

    @on_field("value")
    @classmethod
    def _has_length(cls, value: list[float]) -> list[float]:
        if not 1e-9 < np.abs(value).max() < LARGEST:
            raise _complaint(_shown(value), "a direction, such as [0, 0, 1]", "give the axis of the pin")
        return value

    @property
    def number(self) -> Any:
        """The unit vector."""
        return np.asarray(self.value) / np.linalg.norm(self.value)


class Box(Sourced):
    """A solid box along the frame's axes."""

    kind: Literal["box"]
    size: Annotated[list[NonNegative], Field(min_length=3, max_length=3)]

    def tensor(self, mass: float) -> Any:
        """Return m/12 (|s|^2 1 - diag s^2), (3, 3) [kg m^2]."""
        square = self.si(self.size) ** 2
        return mass / 12 * np.diag(square.sum() - square)


class Cylinder(Sourced):
    """A solid cylinder along one of the frame's axes."""

    kind: Literal["cylinder"]
    radius: NonNegative
    length: NonNegative
    axis: Literal["x", "y", "z"] = "z"

    def tensor(self, mass: float) -> Any:
        """Return m r^2/2 about the axis and m (3 r^2 + l^2)/12 across it, (3, 3) [kg m^2]."""
        radius, length = self.si(self.radius), self.si(self.length)
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

    @on_model(mode="after")
    def _has_one_possible_inertia(self) -> "BodyTable":
        if (self.inertia is None) == (self.shape is None):
            got = "neither inertia nor shape" if self.shape is None else "both inertia and shape"
            raise _complaint(got, "one of them", 'a body without extension has shape = { kind = "point" }')
        try:
            check_inertia(self.name, self.mass.number, self.tensor())
        except InputError as error:
            problem = error.problems[0]
            raise _complaint(problem.got, problem.expected, problem.remedy) from None
        return self

    def tensor(self) -> Any:
        """Return the inertia about the mass centre, (3, 3) [kg m^2]."""
        source = self.inertia or self.shape
        assert source is not None
        return source.tensor(float(self.mass.number))

    def body(self) -> Body:
        """Return the body as a value."""
        return Body(self.name, self.mass.number, self.com.number, self.tensor())


class JointTable(Table):
    """A joint with its bodies; the meaning of each key is that of `Joint`'s attribute."""

    name: Name
    axis: Direction | None = None
    offset: Position
    k_bend: Stiffness
    k_tors: Stiffness
    tau_bend: Time | None = None
    tau_tors: Time | None = None
    limits: Limits | None = None
    driven: bool = True
    shaft: list[BodyTable] = []
    link: list[BodyTable] = []

    def joint(self) -> Joint:
        """Return the joint as a value."""
        return Joint(
            self.name,
            axis=self.axis.number if self.axis else (0.0, 0.0, 1.0),
            offset=self.offset.number,
            k_bend=self.k_bend.number,
            k_tors=self.k_tors.number,
            tau_bend=self.tau_bend.number if self.tau_bend else 0.0,
            tau_tors=self.tau_tors.number if self.tau_tors else 0.0,
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
    gravity: Acceleration | None = None
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
            self.gravity.number if self.gravity else GRAVITY,
        )

    def parts(self) -> Iterator[JointTable | BodyTable | PointTable]:
        """Everything that has a name and numbers."""
        for joint in self.joint:
            yield joint
            yield from joint.shaft + joint.link
        yield from self.point
        yield from self.payload

    def origins(self) -> dict[str, str]:
        """Return the origin by path; an inertia from a shape is derived, absent damping is assumed."""
        known = {}
        for part in self.parts():
            for field in type(part).model_fields:
                known[f"{part.name}.{field}"] = getattr(getattr(part, field), "origin", None)
            if getattr(part, "shape", None):
                known[f"{part.name}.inertia"] = "derived"
        return {path: known[".".join(path.split(".")[:2])] or "assumed" for path in self.arm().paths()}


# -------- what is wrong


EXPECTED = {
    "finite_number": "a finite number",
    "float_type": "a number",
    "bool_type": "true or false",
    "string_type": "text in quotes",
    "list_type": "a list",
    "greater_than": "a number > {gt:g}",
    "greater_than_equal": "a number >= {ge:g}",
    "too_short": "at least {min_length} entries",
    "too_long": "at most {max_length} entries",
    "literal_error": "{expected}",
    "union_tag_invalid": "kind {expected_tags}",
    "union_tag_not_found": "kind 'box', 'cylinder' or 'point'",
    "string_pattern_mismatch": "letters, digits, _ and - only",
    "string_too_short": "some text",
}
"""What pydantic's error types mean for the writer of the file."""

ADD = {
    "unit": 'add unit = "..."',
    "origin": f'add origin = "..."; one of {", ".join(get_args(Origin))}',
    "joint": "describe each joint in a table [[joint]]",
    "format": f'begin the file with format = "{FORMAT}"',
}
"""How to add a key that is missing."""

TABLES: dict[str, type[Table]] = {
    "": ArmDocument,
    "joint": JointTable,
    "shaft": BodyTable,
    "link": BodyTable,
    "point": PointTable,
    "payload": PayloadTable,
    "axis": Direction,
}
SHAPES: dict[Any, type[Table]] = {"box": Box, "cylinder": Cylinder, "point": Lump}


@dataclass(frozen=True)
class _Source:
    """The text and its content, which together tell where a thing stands."""

    where: str
    text: str
    raw: dict[str, Any]

    def problem(self, loc: Loc, got: str, expected: str, remedy: str) -> Problem:
        lines = _line_numbers(self.text)
        line = next(lines[loc[:n]] for n in range(len(loc), -1, -1) if loc[:n] in lines)
        return Problem(f"{self.where}:{line}", got, expected, remedy, self.words(loc))

    def explain(self, error: Any) -> Problem:
        """Return one of pydantic's errors as a problem."""
        loc, kind, context = self.real(error["loc"], error["type"]), error["type"], error.get("ctx", {})
        key = str(loc[-1]) if loc else ""
        if kind == "ident":
            return self.problem(loc, context["got"], context["expected"], context["remedy"])
        if kind == "missing":
            return self.problem(loc, "nothing", f"the key {key}", ADD.get(key, f"add {key} = ..."))
        if kind == "extra_forbidden":
            known = self.keys(loc[:-1])
            remedy = nearest(key, known) or "remove it"
            return self.problem(loc, f"unknown key {_shown(key)}", f"one of {', '.join(known)}", remedy)
        if kind in ("model_type", "model_attributes_type"):
            remedy = f'write {key} = {{ value = ..., unit = "...", origin = "..." }}'
            return self.problem(loc, _shown(error["input"]), "a table", remedy)
        expected = EXPECTED.get(kind, error["msg"]).format(**context)
        return self.problem(loc, _shown(error["input"]), expected, "correct it")

    def real(self, loc: Loc, kind: str) -> Loc:
        """Return the location without the names that pydantic gives to the members of a union."""
        node, kept = self.raw, ()  # type: Any, Loc
        for n, step in enumerate(loc):
            there = isinstance(step, int) or (isinstance(node, dict) and step in node)
            if there or (kind == "missing" and n == len(loc) - 1):
                kept += (step,)
                node = _child(node, step)
        return kept

    def keys(self, table: Loc) -> list[str]:
        """Return the keys that a table may have."""
        last = next((str(step) for step in reversed(table) if isinstance(step, str)), "")
        if last == "shape":
            node: Any = self.raw
            for step in table:
                node = _child(node, step)
            return list(SHAPES[node["kind"]].model_fields)
        return list(TABLES.get(last, Quantity).model_fields)

    def words(self, loc: Loc) -> str:
        """Return a location such as `joint[2] 'joint3'.link[1] 'fingers'.mass`."""
        text, node = "", self.raw  # type: str, Any
        for step in loc:
            node = _child(node, step)
            key = step if re.fullmatch(r"[\w-]+", str(step)) else repr(step)
            text += f"[{step}]" if isinstance(step, int) else f".{key}" if text else str(key)
            name = node.get("name") if isinstance(node, dict) and isinstance(step, int) else None
            text += f" {_shown(name)}" if isinstance(name, str) else ""
        return text

    def row(self, problem: Problem) -> int:
        """Return the line of a problem, to sort by."""
        return int(problem.where.rpartition(":")[2])


def _child(node: Any, step: str | int) -> Any:
    if isinstance(node, dict):
        return node.get(step)
    return node[step] if isinstance(node, list) and isinstance(step, int) and step < len(node) else None


@cache
def _line_numbers(text: str) -> dict[Loc, int]:
    """Return the line of every table and key that begins a line; multi-line strings are passed over."""
    plain = re.sub(r"(\"\"\"|''').*?\1", lambda m: "\n" * m[0].count("\n"), text, flags=re.S)
    found: dict[Loc, int] = {(): 1}
    counts: dict[Loc, int] = {}
    table: Loc = ()
    for number, line in enumerate(plain.split("\n"), 1):
        if header := re.match(r"\s*\[(\[?)\s*([\w.\- ]+?)\s*\]", line):
            table = _table_loc(header[2].split("."), counts, new=bool(header[1]))
            found.setdefault(table, number)
        elif key := re.match(r"\s*([\w-]+)\s*=", line):
            found.setdefault((*table, key[1]), number)
    return found


def _table_loc(keys: list[str], counts: dict[Loc, int], *, new: bool) -> Loc:
    """Return where a header's table stands; `counts` remembers how many each array of tables has."""
    loc: Loc = ()
    for n, key in enumerate(keys):
        loc += (key.strip(),)
        if new and n == len(keys) - 1:
            counts[loc] = counts.get(loc, -1) + 1
        if loc in counts:
            loc += (counts[loc],)
    return loc


def _named(raw: Mapping[str, Any]) -> Iterator[tuple[Loc, Any]]:
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


def _name_problems(source: _Source) -> Iterator[Problem]:
    """Yield names that occur twice, and joints that do not exist."""
    seen: dict[str, Loc] = {}
    joints = [str(joint.get("name")) for _, joint in _rows(source.raw, "joint")]
    for loc, table in _named(source.raw):
        name, joint = table.get("name"), table.get("joint")
        if isinstance(name, str) and seen.setdefault(name, loc) != loc:
            remedy = f"rename it or {source.words(seen[name])}"
            yield source.problem((*loc, "name"), f"the name {_shown(name)} again", "unique names", remedy)
        if loc[0] != "joint" and isinstance(joint, str) and joint not in joints:
            remedy = nearest(joint, joints) or "name a joint of this arm"
            yield source.problem((*loc, "joint"), _shown(joint), f"one of {', '.join(joints)}", remedy)


def idle(joint: Joint) -> str:
    """Say why a last joint's equation would be singular: turning it moves no mass. Empty if all is well."""
    inertia, mass = np.zeros((3, 3)), 0.0
    for body in (*joint.shaft, *joint.link):
        c, m = np.asarray(body.com), float(body.mass)
        inertia += np.asarray(body.inertia) + m * (c @ c * np.eye(3) - np.outer(c, c))
        mass += m
    moments = np.linalg.eigvalsh(inertia)
    if mass and moments[0] > 1e-12 * moments[2]:
        return ""
    return "a rotation that moves no mass" if mass else "no mass beyond the bushing"


# -------- reading and revising


@dataclass(frozen=True)
class ArmFile:
    """An arm and where it comes from.

    Attributes:
        arm: the arm.
        path: the file, as it was named.
        sha256: hexadecimal digest of the file's bytes.
        origins: origin of every number, by its path in the arm.
    """

    arm: Arm
    path: str
    sha256: str
    origins: Mapping[str, str]


def read_arm(path: str | PathLike[str]) -> Arm:
    """Return the arm that a TOML file describes.

    Raises:
        InputError: the file cannot be read or is not such a description; every problem is listed.
    """
    return read_arm_file(path).arm


def read_arm_file(path: str | PathLike[str]) -> ArmFile:
    """Return the arm that a TOML file describes, with the origin of every number.

    Raises:
        InputError: the file cannot be read or is not such a description; every problem is listed.
    """
    where = str(path)
    data = read_bytes(path, "an arm description (TOML)")
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        got = f"byte 0x{data[error.start]:02x}, which is not UTF-8"
        raise InputError(Problem(f"{where}:{line}", got, "text in UTF-8", "save the file as UTF-8")) from None
    document = parse_document(text, where)
    return ArmFile(document.arm(), where, hashlib.sha256(data).hexdigest(), document.origins())


def read_bytes(path: str | PathLike[str], expected: str) -> bytes:
    """Return the bytes of a file that is not empty.

    Raises:
        InputError: there is no such file, it cannot be read, or it is empty.
    """
    try:
        data = Path(path).read_bytes()
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise InputError(Problem(str(path), reason.lower(), expected, "check the path")) from None
    if not data.strip():
        raise InputError(Problem(str(path), "an empty file", expected, "check the path"))
    return data


def parse_arm(text: str, where: str = "arm.toml") -> Arm:
    """Return the arm that a TOML text describes; `where` names the text in errors.

    Raises:
        InputError: the text is no such description; every problem is listed.
    """
    return parse_document(text, where).arm()


def parse_document(text: str, where: str = "arm.toml") -> ArmDocument:
    """Return the checked document; `where` names the text in errors.

    Raises:
        InputError: the text is no such description; every problem is listed.
    """
    source = _Source(where, text, _toml(text, where))
    problems = list(_name_problems(source))
    try:
        document = ArmDocument.model_validate(source.raw)
    except ValidationError as error:
        details = error.errors(include_url=False)
        raise InputError(sorted([*map(source.explain, details), *problems], key=source.row)) from None
    if got := idle(document.joint[-1].joint()):
        remedy = "give the last joint a shaft or link of positive mass, with inertia or shape"
        loc = ("joint", len(document.joint) - 1)
        problems.append(source.problem(loc, got, "mass beyond every bushing", remedy))
    if problems:
        raise InputError(sorted(problems, key=source.row))
    return document


def revise(text: str, values: Mapping[str, float], *, origin: Origin, where: str = "arm.toml") -> str:
    """Return the TOML text with other numbers and their new origin; comments, units and layout stay.

    Args:
        text: a valid arm description.
        values: numbers in SI by path: as in `Arm.paths()`, and `link1.shape.size.x`, `shaft2.shape.radius`.
        origin: the origin of these numbers from now on; a vector has one origin for all its components.
        where: names the text in errors.

    Raises:
        InputError: a path names no number that is written in the text, or the revised text is not valid.
    """
    parse_document(text, where)
    document = tomlkit.parse(text)
    tables = {table["name"]: table for _, table in _named(document)}
    for path, value in values.items():
        entry, holder, key = _slot(tables, path, where)
        holder[key] = float(f"{value / _base_unit(entry['unit'])[0]:.12g}")
        entry["origin"] = origin
    revised = tomlkit.dumps(document)
    parse_document(revised, where)
    return revised


def _slot(tables: Mapping[str, Any], path: str, where: str) -> tuple[Any, Any, Any]:
    """Return the quantity's table, and the container and key of the number in it."""
    name, field, *rest = [*path.split("."), ""]
    rest = [step for step in rest if step]
    key: Any
    try:
        entry = tables[name][field]
        key = rest.pop(0) if field == "shape" else "value"
        holder = entry
        index = COMPONENTS[rest[0]] if rest else ()
        if len(index) == 2 and not isinstance(entry[key][0], list):
            index = index[:1]
        for step in index:
            holder, key = holder[key], step
        float(holder[key])
    except (KeyError, IndexError, TypeError, ValueError):
        raise InputError(Problem(where, path, "a number of this file", "see `Arm.paths()`")) from None
    return entry, holder, key


def _toml(text: str, where: str) -> dict[str, Any]:
    try:
        return tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        found = re.search(r"^(.*) \(at line (\d+), column (\d+)\)$", str(error), re.S)
        what, line, column = found.groups() if found else (str(error), "", "")
        if not line and "end of document" in what:
            line = str(text.count("\n") + 1)
        place = f"{where}:{line}" if line else where
        problem = Problem(
            place, what.lower(), "TOML", "correct the syntax", f"column {column}" if column else ""
        )
        raise InputError(problem) from None
