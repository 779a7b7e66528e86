"""What completes a robot description: `robot.joints.toml` beside it, with the bushing of each joint.

Each number is written as in `arm.toml`, with unit and origin.
"""

import hashlib
import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import equinox as eqx
import tomlkit
from pydantic import Field, ValidationError

from ident.arm.arm import Arm
from ident.arm.base import on_soft_base
from ident.arm.fields import LOSS
from ident.arm.parts import Payload
from ident.description.explanations import TABLES, Source
from ident.description.quantities import LossFactor, Name, Origin, Stiffness, Table, Time
from ident.description.rewriting import changed_numbers, set_inertias, set_numbers
from ident.description.robot import Robot
from ident.description.schema import UNDAMPED, PayloadTable, PointTable
from ident.description.toml_text import load_toml
from ident.description.writing import bushing_text, with_first_joint
from ident.errors import InputError, Problem
from ident.text import decode, did_you_mean, one_line, read_bytes

SUFFIX = ".joints.toml"
BUSHING = ("k_bend", "k_tors", "tau_bend", "tau_tors", *LOSS)
"""What belongs to a bushing."""


class BushingTable(Table):
    """The bushing of a joint; the meaning of each key is that of `Joint`'s attribute."""

    name: Name
    k_bend: Stiffness
    k_tors: Stiffness
    tau_bend: Time = UNDAMPED
    tau_tors: Time = UNDAMPED
    loss_bend: LossFactor | None = None
    loss_tors: LossFactor | None = None

    def bushing(self) -> dict[str, Any]:
        """Return what `Joint` takes."""
        return {key: quantity.number for key in BUSHING if (quantity := getattr(self, key)) is not None}


class JointsDocument(Table):
    """All that such a file says."""

    format: Literal["ident-joints/1"]
    tip: str | None = None
    joint: Annotated[list[BushingTable], Field(min_length=1)]
    point: list[PointTable] = Field(default_factory=list)
    payload: list[PayloadTable] = Field(default_factory=list)


@dataclass(frozen=True)
class JointsFile:
    """Where the bushings of a robot come from.

    Attributes:
        path: the file, as it was named.
        sha256: hexadecimal digest of the file's bytes.
    """

    path: str
    sha256: str


def beside(path: str) -> Path:
    """Return where the bushings of a robot description are: `robot.joints.toml` beside `robot.urdf`."""
    return Path(path).with_suffix(SUFFIX)


def read_joints(path: Path, robot: Robot) -> tuple[JointsFile, JointsDocument]:
    """Return the bushings of a robot's joints.

    Raises:
        InputError: no such file, or it is wrong, or its joints are not the robot's; every problem is listed.
    """
    where = one_line(str(path))
    if not os.path.exists(path):
        got, expected = "no stiffness of its joints", f"{one_line(path.name)} beside it"
        remedy = "write that file, or let `ident new my_robot --robot FILE` guess an arm"
        raise InputError(Problem(robot.where, got, expected, remedy))
    data = read_bytes(path, "the bushings of a robot (TOML)")
    text = decode(data, where)
    source = Source(where, text, load_toml(text, where), TABLES | {"": JointsDocument, "joint": BushingTable})
    problems = list(source.name_problems())
    try:
        document = JointsDocument.model_validate(source.raw)
    except ValidationError as error:
        problems = [*source.explain(error), *problems]
    else:
        problems += _strangers(document, robot, source)
    if problems:
        raise InputError(problems)
    return JointsFile(str(path), hashlib.sha256(data).hexdigest()), document


def joints_text(text: str, before: Arm, arm: Arm, origin: Origin, where: str) -> str:
    """Return the text of such a file with the numbers of another arm, and their origin; comments, units, layout stay.

    What the robot description says of that arm is left out, what the file leaves out is added.

    Args:
        text: a valid file.
        before: the arm of this file and its robot description.
        arm: the arm that it is to be the file of; on a base that gives, that is the first joint, of the origin
            `assumed` where it was not fitted.
        origin: of these numbers from now on.
        where: names the text in errors.
    """
    if arm.base is not None and before.base is None:
        before = on_soft_base(before, float(arm.joints[1].offset[2]))
        text = with_first_joint(text, bushing_text(before.joints[0], "assumed"), where)
    document: Any = tomlkit.parse(text)
    joints = {str(table["name"]): table for table in document["joint"]}
    others = {str(table["name"]): table for kind in ("point", "payload") for table in document.get(kind, ())}
    values = changed_numbers(before, arm)
    for path, value in values.items():
        name, field, *_ = path.split(".")
        if name in joints and field in BUSHING and field not in joints[name]:
            joints[name][field] = tomlkit.inline_table()
            joints[name][field].update({"value": value} | ({} if field in LOSS else {"unit": "s"}))
    own = {path: value for path, value in values.items() if _is_of(path, joints, others)}
    set_numbers(joints | others, own, origin, where)
    written = JointsDocument.model_validate(load_toml(tomlkit.dumps(document), where))
    payloads = tuple(Payload(each.joint, each.body()) for each in written.payload)
    set_inertias(others, eqx.tree_at(lambda arm: arm.payloads, before, payloads), arm, origin)
    JointsDocument.model_validate(load_toml(updated := tomlkit.dumps(document), where))
    return updated


def _is_of(path: str, joints: Mapping[str, Any], others: Mapping[str, Any]) -> bool:
    name, field, *_ = path.split(".")
    return name in others or (name in joints and field in BUSHING)


def _strangers(document: JointsDocument, robot: Robot, source: Source) -> list[Problem]:
    """Return what the file and the robot do not have in common."""
    named, known = [table.name for table in document.joint], robot.joints
    got, expected = f"no such joint in {robot.where}", f"one of {', '.join(known)}"
    problems = [
        source.problem(("joint", n, "name"), got, expected, did_you_mean(name, known, "remove it"))
        for n, name in enumerate(named)
        if name not in known
    ]
    missing = [name for name in known if name not in named]
    if missing:
        got, remedy = f"no joint {', '.join(missing)}", "add a table [[joint]] for each"
        problems.append(source.problem((), got, f"all joints of {robot.where}", remedy))
    return problems
