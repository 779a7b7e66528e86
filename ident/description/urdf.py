"""Import of a serial arm from URDF, completed with what URDF cannot say: bushing stiffness and damping.

URDF turns each link's frame as it likes; ident's frames are all parallel to the base frame in the zero
posture. Offsets, axes, mass centres and inertias are therefore taken from the base frame at zero posture.
"""

from collections.abc import Mapping
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from ident.arm.arm import Arm
from ident.arm.checks import check_size
from ident.arm.parts import Body
from ident.description.robot import Pair, Pin, Robot, refusal
from ident.description.urdf_chain import Segment, chain, parse
from ident.errors import InputError
from ident.text import one_line, read_bytes


def read_urdf(
    path: str | PathLike[str],
    *,
    stiffness: Mapping[str, Pair] | Pair,
    damping: Mapping[str, Pair] | Pair = (0.0, 0.0),
    tip: str | None = None,
) -> Arm:
    """Return a serial arm from a URDF file.

    Revolute and continuous joints become driven joints with an empty shaft; links behind fixed joints belong
    to the link before them. Meshes are not read. The root link's frame is the base frame; what is fixed to it
    is left out.

    Args:
        path: the URDF file.
        stiffness: (k_bend, k_tors) [N m/rad] of every joint by name, or one pair for all.
        damping: (tau_bend, tau_tors) [s] of every joint by name, or one pair for all.
        tip: URDF link whose frame's origin becomes the point `tip`; by default the end of the chain.

    Raises:
        InputError: the file is no URDF, the robot no serial arm of such joints, or a joint lacks a value.
    """
    robot = urdf_robot(read_bytes(path, "a robot description (URDF)"), str(path))
    return robot.arm(robot.bushings(stiffness, damping), tip)


def urdf_robot(data: bytes, path: str) -> Robot:
    """Return the robot that a URDF file describes; the path names it in errors, and a robot without a name.

    Raises:
        InputError: the file is no URDF, or the robot no serial arm of turning joints.
    """
    where = one_line(path)
    robot = parse(data, where)
    segments = chain(robot, where)
    check_size(len(segments), where)
    pins, place = [], np.zeros(3)
    for segment in segments:
        pins.append(_pin(segment, place, where))
        place = segment.origin
    frames = {link: (each.joint.name, at[:3, 3] - each.origin) for each in segments for link, at in each.links.items()}
    last = segments[-1]
    end = last.ends[0] if len(last.ends) == 1 else last.joint.child
    return Robot(robot.name or Path(path).stem, where, tuple(pins), frames, end, "link", "an <inertial>")


def _pin(segment: Segment, place: Any, where: str) -> Pin:
    """Return a segment as a pin; `place` is the origin of the segment before."""
    urdf = segment.joint
    axis = segment.pose[:3, :3] @ urdf.axis if np.shape(urdf.axis) == (3,) else np.zeros(3)
    if not 1e-9 < np.linalg.norm(axis) < np.inf:
        raise refusal(f"{where}, joint {urdf.name}", f"axis {urdf.axis}", "a direction", "correct the axis")
    link = tuple(_body(name, *body, segment.origin, where) for name, body in segment.bodies.items())
    return Pin(urdf.name, axis / np.linalg.norm(axis), segment.origin - place, link, _limits(urdf, where))


def _body(name: str, inertial: Any, pose: Any, origin: Any, where: str) -> Body:
    """Return a link's inertial, seen from a frame at `origin` that is parallel to the base frame."""
    place = f"{where}, link {name}"
    if inertial.mass is None or inertial.inertia is None:
        raise refusal(place, "an <inertial> that is not complete", "<mass> and <inertia>", "add them")
    at = pose if inertial.origin is None else pose @ inertial.origin
    turn = at[:3, :3]
    inertia = turn @ inertial.inertia @ turn.T
    try:
        return Body(name, inertial.mass, at[:3, 3] - origin, (inertia + inertia.T) / 2)
    except InputError as error:
        problem = error.problems[0]
        raise refusal(place, problem.got, problem.expected, problem.remedy) from None


def _limits(urdf: Any, where: str) -> tuple[float, float]:
    if urdf.type == "continuous" or urdf.limit is None:
        return (-np.inf, np.inf)
    lower, upper = urdf.limit.lower or 0.0, urdf.limit.upper or 0.0
    if not lower <= upper:
        place = f"{where}, joint {urdf.name}"
        raise refusal(place, f"limits {lower:g}, {upper:g}", "lower <= upper", "swap or correct them")
    return (lower, upper)
