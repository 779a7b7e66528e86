"""An arm of a robot description, URDF or MJCF, and the file of bushings beside it."""

import os
from os import PathLike
from typing import Any
from xml.etree import ElementTree

from ident.arm.arm import Arm
from ident.arm.parts import Payload, Point
from ident.description.joints_file import (
    BUSHING,
    JointsDocument,
    JointsFile,
    beside,
    check_joints,
    no_joints,
    read_joints,
)
from ident.description.robot import Robot, refusal, refuse_xacro
from ident.text import one_line, read_bytes

REMEDY = "give a URDF or MJCF file, not xacro or SDF"


def is_robot(text: str) -> bool:
    """Tell whether a text is XML, and so no TOML."""
    return text.lstrip().startswith("<")


def robot_kind(data: bytes, where: str) -> str:
    """Return what the root element of a robot description is called: robot of URDF, mujoco of MJCF.

    Raises:
        InputError: it is no XML, or another root.
    """
    try:
        root = ElementTree.fromstring(data)
    except (ElementTree.ParseError, LookupError, ValueError) as error:
        refuse_xacro(data, None, where)
        line, column = getattr(error, "position", (1, 0))
        got, expected = f"no XML ({one_line(str(error))})", "a robot description (URDF or MJCF)"
        raise refusal(f"{where}:{line}, column {column}", got, expected, "correct it") from None
    refuse_xacro(data, root, where)
    if root.tag not in ("robot", "mujoco"):
        raise refusal(f"{where}:1", f"<{one_line(root.tag)}>", "<robot> or <mujoco>", REMEDY)
    return str(root.tag)


def read_robot(path: str | PathLike[str], tip: str | None = None) -> Robot:
    """Return the robot of a file, up to the link, body or site that the arm ends with, if one is named.

    Raises:
        InputError: it is no robot description of a serial arm, or the package that reads it is missing.
    """
    data = read_bytes(path, "a robot description (URDF or MJCF)")
    if robot_kind(data, one_line(str(path))) == "robot":
        from ident.description.urdf import urdf_robot

        return urdf_robot(data, str(path), tip)
    from ident.description.mjcf import mjcf_robot

    return mjcf_robot(str(path), tip)


def robot_arm(
    path: str | PathLike[str],
) -> tuple[Arm, JointsFile, dict[str, str], tuple[str, ...]]:
    """Return the arm of a robot description, where its bushings come from, the origin of every number, and notes.

    What the description says has the origin `derived`. The notes say where the arm is not what the description says.

    Raises:
        InputError: the description or the file of bushings is wrong.
    """
    file = beside(str(path))
    if not os.path.exists(file):
        raise no_joints(file, read_robot(path))
    source, document, text = read_joints(file)
    robot = read_robot(path, document.tip)
    check_joints(document, robot, text)
    bushings = {table.name: table.bushing() for table in document.joint}
    points = tuple(Point(each.name, each.joint, each.position.number) for each in document.point)
    payloads = tuple(Payload(each.joint, each.body()) for each in document.payload)
    arm = robot.arm(bushings, points, payloads)
    return arm, source, _origins(arm, document), robot.notes


def _origins(arm: Arm, document: JointsDocument) -> dict[str, str]:
    written: list[Any] = [*document.joint, *document.point, *document.payload]
    origins: dict[str, str] = dict.fromkeys(arm.paths(), "derived")
    for path in origins:
        name, field, *_ = path.split(".")
        table = next((each for each in written if each.name == name), None)
        if table is not None and (field in BUSHING or table not in document.joint):
            quantity = getattr(table, field)
            origins[path] = quantity.origin if quantity else "derived"
    return origins
