"""The arm as a file: `arm.toml`, URDF or MJCF to `Arm` with the origin of every number, and TOML with other numbers."""

import hashlib
import os
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from os import PathLike
from pathlib import Path
from typing import Any

import equinox as eqx
import numpy as np
import tomlkit
from jaxtyping import Float

from ident.arm.arm import Arm, check_arm, check_size, loss_paths, massless_joints, on_soft_base
from ident.arm.parts import Payload, Point
from ident.description.problems import Source, lines_of, load_toml
from ident.description.rewriting import (
    changed_numbers,
    joint_text,
    place_damping,
    set_inertias,
    set_numbers,
    with_first,
)
from ident.description.robot import JointsFile, Robot, beside, check_joints, read_joints, robot_root
from ident.description.schema import BUSHING, SINGLE, ArmDocument, KnobTable, Origin, named, uncertain_numbers
from ident.errors import ARM_FILE, InputError, Problem, refusal, refuse, require
from ident.text import decode, one_line, read_bytes

# -------- Robot file
# An arm from a robot description, URDF or MJCF, and its file of bushings.


def robot_kind(data: bytes, where: str) -> str:
    """Return the name of a robot description's root element: robot for URDF, mujoco for MJCF."""
    return str(robot_root(data, where).tag)


def read_robot(path: str | PathLike[str], tip: str | None = None) -> Robot:
    """Return the robot of a file, up to the link, body or site named as the end of the arm, if any.

    Raises:
        InputError: not a robot description of a serial arm, or the package that reads it is missing.
    """
    data = read_bytes(path, "a robot description (URDF or MJCF)")
    if robot_kind(data, one_line(str(path))) == "robot":
        from ident.description.urdf import urdf_robot

        return urdf_robot(data, str(path), tip)
    from ident.description.mjcf import mjcf_robot

    return mjcf_robot(str(path), tip)


def robot_arm(path: str | PathLike[str], sha256: str) -> "ArmFile":
    """Return the arm of a robot description, with the hash of its bytes; numbers from it have the origin `derived`.

    Raises:
        InputError: the description or the file of bushings has errors.
    """
    file = beside(str(path))
    if not os.path.exists(file):
        got, expected = "no stiffness of its joints", f"{one_line(file.name)} beside it"
        remedy = "write that file, or let `ident new my_robot --robot FILE` guess an arm"
        raise refusal(read_robot(path).where, got, expected, remedy)
    source, document, text = read_joints(file)
    robot = read_robot(path, document.tip)
    check_joints(document, robot, text)
    bushings = {table.name: table.bushing() for table in document.joint}
    points = tuple(each.part(Point) for each in document.point)
    payloads = tuple(Payload(each.joint, each.body()) for each in document.payload)
    arm = eqx.tree_at(lambda a: a.damping, robot.arm(bushings, points, payloads), document.damping.in_arm())
    named_tables: list[Any] = [*document.joint, *document.point, *document.payload]
    written = {each.name: each for each in named_tables} | {"damping": document.damping}
    origins: dict[str, str] = dict.fromkeys(arm.paths(), "derived")
    for number in origins:
        name, field, *_ = number.split(".")
        table = written.get(name)
        if table is not None and (field in BUSHING or table not in document.joint):
            quantity = getattr(table, field)
            origins[number] = quantity.origin if quantity else "derived"
    return ArmFile(arm, str(path), sha256, origins, bushings=source, notes=robot.notes)


# -------- File


@dataclass(frozen=True)
class ArmFile:
    """An arm and its source.

    Attributes:
        arm: the arm.
        path: the file, as given.
        sha256: hexadecimal digest of the file's bytes.
        origins: origin of every number, by its path in the arm.
        extents: lowest and highest corner of each body with a shape, (2, 3) [m] in its joint's axes, by name.
        uncertain: numbers with a standard deviation, by path, written as `5%` or `2mm`.
        bushings: the file of its bushings for URDF or MJCF; None for TOML.
        notes: differences between the arm and its URDF or MJCF: held joints, ignored limits, other names.
        lines: TOML line of each quantity, by its name as `link2.com`.
        knobs: of the controller, by what they scale.
    """

    arm: Arm
    path: str
    sha256: str
    origins: Mapping[str, str]
    extents: Mapping[str, Float[np.ndarray, "2 3"]] = field(default_factory=dict)
    uncertain: Mapping[str, str] = field(default_factory=dict)
    bushings: JointsFile | None = None
    notes: tuple[str, ...] = ()
    lines: Mapping[str, int] = field(default_factory=dict)
    knobs: Mapping[str, KnobTable] = field(default_factory=dict)

    def __str__(self) -> str:
        """Return a short table of the arm, and its file."""
        return f"{self.arm}\nfile: {one_line(self.path)}" if self.path else str(self.arm)

    def placed(self, problem: Problem) -> Problem:
        """Add file and line to a problem of one of the arm's numbers; return any other unchanged."""
        line = self.lines.get(problem.column)
        where = one_line(self.path) + (f":{line}" if line else "")
        return replace(problem, where=where) if problem.where == ARM_FILE and where else problem

    def replace(self, values: Mapping[str, float]) -> "ArmFile":
        """Return the arm with these numbers [SI] at these paths, as `link2.mass`; it is no longer that of a file.

        Raises:
            InputError: a path names no number of the arm, or no arm can have the number.
        """
        check_arm(changed := self.arm.replace(values))
        origins = {path: origin for path, origin in self.origins.items() if path not in values}
        return replace(self, arm=changed, path="", sha256="", origins=origins, bushings=None, lines={})

    @property
    def name(self) -> str:
        """Name for results: the file's, or the arm's if there is no file."""
        return Path(self.path).stem or self.arm.name


def read_arm(path: str | PathLike[str]) -> ArmFile:
    """Return the arm of a TOML file, or of a URDF or MJCF file with a file of bushings in the same folder.

    The bushings of `robot.urdf`, or `robot.xml`, are in `robot.joints.toml`. Every number has its origin.

    Raises:
        InputError: the file is unreadable or not such a description; all problems are listed.
    """
    where, expected = one_line(str(path)), "an arm description (TOML, URDF or MJCF)"
    data = read_bytes(path, expected)
    text = decode(data, where)
    require(text.strip(), where, "an empty file", expected, "check the path")
    digest = hashlib.sha256(data).hexdigest()
    if text.lstrip().startswith("<"):  # XML, and so no TOML
        return robot_arm(path, digest)
    document = parse_document(text, where)
    parts = document.arm, str(path), digest, document.origins(), document.extents()
    knobs: Any = {knob.scales: knob for knob in document.controller.knob} if document.controller else {}
    return ArmFile(*parts, uncertain_numbers(document), lines=lines_of(text), knobs=knobs)


def parse_arm(text: str, where: str = "arm.toml") -> Arm:
    """Return the arm of a TOML text; `where` names the text in errors."""
    return parse_document(text, where).arm


def parse_document(text: str, where: str = "arm.toml") -> ArmDocument:
    """Return the checked document; `where` names the text in errors."""
    source = Source(where, text, load_toml(text, where))
    joints = source.raw.get("joint")
    check_size(len(joints) if isinstance(joints, list) else 0, where)
    document, problems = source.read()
    if document is not None:
        for place, got, expected in massless_joints([joint.joint() for joint in document.joint]):
            which = "last " * (place == len(document.joint) - 1)
            remedy = f"give the {which}joint a shaft or link of positive mass, with inertia or shape"
            problems.append(source.problem(("joint", place), got, expected, remedy))
        try:
            if not problems:
                _ = document.arm  # whether the parts go together
        except InputError as error:
            places = {name: loc for loc, name, _ in named(source.raw)}
            for p in error.problems:
                loc = *places.get(p.where, (p.where,)), *filter(None, (p.column,))
                problems.append(source.problem(loc, p.got, p.expected, p.remedy))
    refuse(sorted(problems, key=lambda problem: int(problem.where.rpartition(":")[2])))
    return document


def update_file(text: str, values: Mapping[str, float], *, origin: Origin, where: str = "arm.toml") -> str:
    """Return the TOML text with other numbers and their new origin; comments, units and layout stay.

    Args:
        text: a valid arm description.
        values: numbers in SI by path: as in `Arm.paths()`, and `link1.shape.size.x`, `shaft2.shape.radius`.
        origin: the new origin of these numbers; a vector has one origin for all its components.
        where: names the text in errors.
    """
    before, document = parse_arm(text, where), tomlkit.parse(text)
    lossy = before.replace({path: values[path] for path in loss_paths(before) if path in values})
    place_damping(document, _tables(document), lossy, values)
    set_numbers(_tables(document), values, origin, where)
    updated = tomlkit.dumps(document)
    parse_document(updated, where)
    return updated


def update_arm(text: str, arm: Arm, *, origin: Origin, where: str = "arm.toml") -> str:
    """Return the TOML text of another arm with the same parts, with the origin of the changed numbers.

    A shape stays if its inertia is that of the arm; otherwise the inertia replaces it. An elastic base is written
    before the first joint, with the origin `assumed`.

    Args:
        text: a valid arm description.
        arm: the arm to describe.
        origin: the new origin of these numbers.
        where: names the text in errors.

    Raises:
        InputError: the file has no place for a number of that arm.
    """
    before = parse_arm(text, where)
    if arm.base is not None and before.base is None:
        based = on_soft_base(before, float(arm.joints[1].offset[2]))
        text = with_first("joint", text, joint_text(based.joints[0], "assumed"), where)
        lowered = {path: based.get(path) for path in changed_numbers(parse_arm(text, where), based)}
        text = update_file(text, {path: float(value) for path, value in lowered.items()}, origin="assumed", where=where)
        before = based
    text = update_file(text, changed_numbers(before, arm), origin=origin, where=where)
    document = tomlkit.parse(text)
    set_inertias(_tables(document), parse_arm(text, where), arm, origin)
    updated = tomlkit.dumps(document)
    parse_document(updated, where)
    return updated


def _tables(document: Any) -> dict[str, Any]:
    tables = {name: table for _, name, table in named(document)}
    return tables | {key: document.get(key, {}) for key in SINGLE}
