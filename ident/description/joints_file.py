"""What completes a robot description: `robot.joints.toml` beside it, with the bushing of each joint.

Each number is written as in `arm.toml`, with unit and origin.
"""

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import tomlkit
from pydantic import Field, ValidationError

from ident.arm.fields import LOSS
from ident.description.explanations import TABLES, Source
from ident.description.quantities import LossFactor, Name, Origin, Stiffness, Table, Time, si
from ident.description.robot import Robot
from ident.description.schema import UNDAMPED, PayloadTable, PointTable
from ident.description.toml_text import load_toml
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
    if not path.exists():
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


def joints_text(text: str, values: Mapping[str, float], origin: Origin, where: str) -> str:
    """Return the text of such a file with other numbers and their origin; comments, units and layout stay.

    Args:
        text: a valid file.
        values: numbers [SI] of bushings by path, as `joint1.k_bend`; what the file leaves out is added.
        origin: of these numbers from now on.
        where: names the text in errors.
    """
    document: Any = tomlkit.parse(text)
    tables = {str(table["name"]): table for table in document["joint"]}
    for path, value in values.items():
        name, field = path.split(".")
        entry = tables[name].setdefault(field, tomlkit.inline_table())
        unit = si(1.0, entry["unit"]) if "unit" in entry else 1.0
        entry["value"] = float(f"{value / unit:.12g}")
        if "unit" not in entry and field not in LOSS:
            entry["unit"] = "s"  # of a time; a stiffness is never left out
        entry["origin"] = origin
    JointsDocument.model_validate(load_toml(updated := tomlkit.dumps(document), where))
    return updated


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
