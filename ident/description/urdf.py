"""Import of a serial arm from URDF, completed with what URDF cannot say: bushing stiffness and damping.

URDF turns each link's frame as it likes; ident's frames are all parallel to the base frame in the zero
posture. Offsets, axes, mass centres and inertias are therefore taken from the base frame at zero posture.
"""

from collections.abc import Iterator, Mapping
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from ident.arm.arm import Arm
from ident.arm.checks import check_size
from ident.arm.fields import LARGEST
from ident.arm.parts import Body, Point
from ident.description.robot import (
    TIP,
    Pair,
    Pin,
    Robot,
    body_names,
    held_note,
    limits_note,
    refusal,
    renamed_note,
)
from ident.description.urdf_chain import Segment, chain, parse
from ident.errors import InputError, Problem
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
    to the link before them. Joints that are not on the way to the tip, as those of a gripper, are held at zero, and
    what they carry belongs to the link before them too; `ident.read_arm` says which. Meshes are not read. The root
    link's frame is the base frame; what is fixed to it is left out.

    Args:
        path: the URDF file.
        stiffness: (k_bend, k_tors) [N m/rad] of every joint by name, or one pair for all.
        damping: (tau_bend, tau_tors) [s] of every joint by name, or one pair for all.
        tip: URDF link that the arm ends with, whose frame's origin becomes the point `tip`; by default the end of the
            chain. Of a robot of several arms it names one.

    Raises:
        InputError: the file is no URDF, the robot no serial arm of such joints, or a joint lacks a value.
    """
    robot = urdf_robot(read_bytes(path, "a robot description (URDF)"), str(path), tip)
    return robot.arm(robot.bushings(stiffness, damping))


def urdf_robot(data: bytes, path: str, tip: str | None = None) -> Robot:
    """Return the robot that a URDF file describes; the path names it in errors, and a robot without a name.

    Args:
        data: the file.
        path: where it is.
        tip: the link that the arm ends with; None for the end of the chain.

    Raises:
        InputError: the file is no URDF, or the robot no serial arm of turning joints.
    """
    where = one_line(path)
    robot = parse(data, where)
    base, *segments = chain(robot, where, tip)
    check_size(len(segments), where)
    names = body_names([link.name for link in robot.links], [each.joint.name for each in segments], "link")
    pins, place, problems = [], np.zeros(3), list[Problem]()
    for segment in segments:
        try:
            pins.append(_pin(segment, place, names, where))
        except InputError as error:
            problems += error.problems
        place = segment.origin
    if problems:
        raise InputError(problems)
    last = segments[-1]
    end = tip or (last.ends[0] if len(last.ends) == 1 else last.joint.child)
    carrier = next(each for each in segments if end in each.links)
    point = Point(TIP, carrier.joint.name, carrier.links[end][:3, 3] - carrier.origin)
    notes = tuple(_notes(base, segments, names, where))
    return Robot(robot.name or Path(path).stem, where, tuple(pins), point, notes=notes)


def _notes(base: Segment, segments: list[Segment], names: Mapping[str, str], where: str) -> Iterator[str]:
    """Yield where the arm is not what the file says."""
    for segment in (base, *segments):
        if segment.held:
            held = [f"{name} ({_kind(joint)})" for name, joint in segment.held.items()]
            mass = sum(float(body.mass or 0) for name, (body, _) in segment.bodies.items() if name not in segment.links)
            yield held_note(where, held, mass, segment.joint.name if segment.joint else "")
    for segment in segments:
        for name in segment.bodies:
            if names[name] != name:
                yield renamed_note(where, "link", name, names[name])
        limit = segment.joint.limit
        lower, upper = (limit.lower, limit.upper) if limit is not None else (None, None)
        if segment.joint.type != "continuous" and (lower or 0.0) == (upper or 0.0):
            given = "no limits" if lower is None and upper is None else f"limits {lower or 0:g}, {upper or 0:g}"
            yield limits_note(where, segment.joint.name, given)


def _kind(joint: Any) -> str:
    return f"{joint.type}, follows {joint.mimic.joint}" if joint.mimic is not None else str(joint.type)


def _pin(segment: Segment, place: Any, names: Mapping[str, str], where: str) -> Pin:
    """Return a segment as a pin; `place` is the origin of the segment before, `names` what links are called."""
    urdf = segment.joint
    axis = segment.pose[:3, :3] @ urdf.axis if np.shape(urdf.axis) == (3,) else np.zeros(3)
    if not 1e-9 < np.linalg.norm(axis) < np.inf:
        raise refusal(f"{where}, joint {urdf.name}", f"axis {urdf.axis}", "a direction", "correct the axis")
    link, problems = [], list[Problem]()
    for name, body in segment.bodies.items():
        try:
            link.append(_body(name, names[name], *body, segment.origin, where))
        except InputError as error:
            problems += error.problems
    if problems:
        raise InputError(problems)
    axis, limits = axis / np.linalg.norm(axis), _limits(urdf, where)
    return Pin(urdf.name, axis, segment.origin - place, tuple(link), limits, carrier=f"link {urdf.child}")


def _body(link: str, name: str, inertial: Any, pose: Any, origin: Any, where: str) -> Body:
    """Return a link's inertial as a body, seen from a frame at `origin` that is parallel to the base frame."""
    place = f"{where}, link {link}"
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
    if lower == upper:
        return (-np.inf, np.inf)
    return (lower if lower > -LARGEST else -np.inf, upper if upper < LARGEST else np.inf)
