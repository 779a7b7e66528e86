"""The arm as a file: `arm.toml`, URDF or MJCF to `Arm` with the origin of every number, and TOML with other numbers."""

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from os import PathLike
from typing import Any

import numpy as np
import tomlkit
from jaxtyping import Float
from pydantic import ValidationError

from ident.arm.arm import Arm
from ident.arm.belt_condition import belt_mismatches
from ident.arm.checks import check_size, massless_joint
from ident.arm.fields import COMPONENTS
from ident.description.explanations import Source
from ident.description.joints_file import JointsFile
from ident.description.quantities import Origin, si
from ident.description.robot_file import is_robot, robot_arm
from ident.description.schema import ArmDocument, named
from ident.description.toml_text import load_toml
from ident.description.uncertainty import uncertain_numbers
from ident.errors import InputError, Problem
from ident.text import decode, one_line, read_bytes


@dataclass(frozen=True)
class ArmFile:
    """An arm and where it comes from.

    Attributes:
        arm: the arm.
        path: the file, as it was named.
        sha256: hexadecimal digest of the file's bytes.
        origins: origin of every number, by its path in the arm.
        extents: lowest and highest corner of each body that has a shape, (2, 3) [m] in its joint's axes, by name.
        uncertain: numbers that are not exactly known, by path, with their standard deviation as `5%` or `2mm`.
        bushings: the file of its bushings, where it is described by URDF or MJCF; None for TOML.
    """

    arm: Arm
    path: str
    sha256: str
    origins: Mapping[str, str]
    extents: Mapping[str, Float[np.ndarray, "2 3"]] = field(default_factory=dict)
    uncertain: Mapping[str, str] = field(default_factory=dict)
    bushings: JointsFile | None = None

    @property
    def warnings(self) -> tuple[str, ...]:
        """What speaks against the arm as it is described, one line each: belts that cannot run."""
        return tuple(map(str, belt_mismatches(self.arm)))


def read_arm(path: str | PathLike[str]) -> ArmFile:
    """Return the arm that a TOML file describes, or URDF or MJCF with a file of bushings beside it.

    The bushings of `robot.urdf`, or `robot.xml`, are in `robot.joints.toml`. Every number has its origin.

    Raises:
        InputError: the file cannot be read or is not such a description; every problem is listed.
    """
    where, expected = one_line(str(path)), "an arm description (TOML, URDF or MJCF)"
    data = read_bytes(path, expected)
    text = decode(data, where)
    if not text.strip():
        raise InputError(Problem(where, "an empty file", expected, "check the path"))
    digest = hashlib.sha256(data).hexdigest()
    if is_robot(text):
        arm, bushings, origins = robot_arm(path)
        return ArmFile(arm, str(path), digest, origins, bushings=bushings)
    document = parse_document(text, where)
    parts = document.arm(), str(path), digest, document.origins(), document.extents()
    return ArmFile(*parts, uncertain_numbers(document))


def parse_arm(text: str, where: str = "arm.toml") -> Arm:
    """Return the arm that a TOML text describes; `where` names the text in errors."""
    return parse_document(text, where).arm()


def parse_document(text: str, where: str = "arm.toml") -> ArmDocument:
    """Return the checked document; `where` names the text in errors."""
    source = Source(where, text, load_toml(text, where))
    joints = source.raw.get("joint")
    check_size(len(joints) if isinstance(joints, list) else 0, where)
    problems = list(source.name_problems())
    try:
        document = ArmDocument.model_validate(source.raw)
    except ValidationError as error:
        problems = [*source.explain(error), *problems]
    else:
        if massless := massless_joint([joint.joint() for joint in document.joint]):
            place, got, expected = massless
            which = "last " * (place == len(document.joint) - 1)
            remedy = f"give the {which}joint a shaft or link of positive mass, with inertia or shape"
            problems.append(source.problem(("joint", place), got, expected, remedy))
        elif not problems:
            problems += _unfit(document, source)
    if problems:
        raise InputError(sorted(problems, key=lambda problem: int(problem.where.rpartition(":")[2])))
    return document


def _unfit(document: ArmDocument, source: Source) -> list[Problem]:
    """Return why the parts do not go together, each problem with its line."""
    try:
        document.arm()
    except InputError as error:
        places = {table["name"]: loc for loc, table in named(source.raw)}
        return [
            source.problem((*places.get(p.where, (p.where,)), *filter(None, (p.column,))), p.got, p.expected, p.remedy)
            for p in error.problems
        ]
    return []


def update_file(text: str, values: Mapping[str, float], *, origin: Origin, where: str = "arm.toml") -> str:
    """Return the TOML text with other numbers and their new origin; comments, units and layout stay.

    Args:
        text: a valid arm description.
        values: numbers in SI by path: as in `Arm.paths()`, and `link1.shape.size.x`, `shaft2.shape.radius`.
        origin: the origin of these numbers from now on; a vector has one origin for all its components.
        where: names the text in errors.
    """
    parse_document(text, where)
    document = tomlkit.parse(text)
    tables = {table["name"]: table for _, table in named(document)} | {"stroke": document.get("stroke", {})}
    for path, value in values.items():
        entry, holder, key = _slot(tables, path, where)
        unit = si(1.0, entry["unit"]) if "unit" in entry else 1.0
        holder[key] = float(f"{value / unit:.12g}")
        entry["origin"] = origin
    updated = tomlkit.dumps(document)
    parse_document(updated, where)
    return updated


def _slot(tables: Mapping[str, Any], path: str, where: str) -> tuple[Any, Any, Any]:
    """Return the quantity's table, and the container and key of the number in it."""
    try:
        name, field, *rest = path.split(".")
        entry = holder = tables[name][field]
        key: Any = rest.pop(0) if field == "shape" else "value"
        index = COMPONENTS[rest[0]] if rest else ()
        if len(index) == 2 and not isinstance(entry[key][0], list):
            index = index[:1]
        for step in index:
            holder, key = holder[key], step
        float(holder[key])
    except (KeyError, IndexError, TypeError, ValueError):
        raise InputError(Problem(where, path, "a number of this file", "see `Arm.paths()`")) from None
    return entry, holder, key
