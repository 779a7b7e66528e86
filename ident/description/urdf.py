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
from ident.arm.checks import check_size, massless_joint
from ident.arm.parts import Body, Joint, Point
from ident.description.urdf_chain import Segment, chain, parse, refusal
from ident.errors import InputError, Problem
from ident.text import did_you_mean, one_line, read_bytes

Pair = tuple[float, ...]
"""Two numbers, across the axis and about it; their number is checked when the file is read."""


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
    where = one_line(str(path))
    robot = parse(read_bytes(path, "a robot description (URDF)"), where)
    segments = chain(robot, where)
    check_size(len(segments), where)
    names = [segment.joint.name for segment in segments]
    problems: list[Problem] = []
    k = _by_joint(stiffness, names, "stiffness", problems)
    tau = _by_joint(damping, names, "damping", problems)
    if problems:
        raise InputError(problems)
    joints, place = [], np.zeros(3)
    for segment in segments:
        joints.append(_joint(segment, place, k[segment.joint.name], tau[segment.joint.name], where))
        place = segment.origin
    if massless := massless_joint(joints):
        last, got, expected = massless
        remedy = f"give the {'last ' * (last == len(joints) - 1)}link an <inertial>"
        raise refusal(f"{where}, joint {names[last]}", got, expected, remedy)
    return Arm(robot.name or Path(path).stem, tuple(joints), (_tip(segments, tip, where),))


def _joint(segment: Segment, place: Any, k: Pair, tau: Pair, where: str) -> Joint:
    """Return a segment as a joint; `place` is the origin of the segment before."""
    urdf = segment.joint
    axis = segment.pose[:3, :3] @ urdf.axis if np.shape(urdf.axis) == (3,) else np.zeros(3)
    if not 1e-9 < np.linalg.norm(axis) < np.inf:
        raise refusal(f"{where}, joint {urdf.name}", f"axis {urdf.axis}", "a direction", "correct the axis")
    return Joint(
        urdf.name,
        axis=axis / np.linalg.norm(axis),
        offset=segment.origin - place,
        k_bend=k[0],
        k_tors=k[1],
        tau_bend=tau[0],
        tau_tors=tau[1],
        link=tuple(_body(name, *body, segment.origin, where) for name, body in segment.bodies.items()),
        limits=_limits(urdf, where),
    )


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


def _tip(segments: list[Segment], tip: str | None, where: str) -> Point:
    """Return the named link's origin, or the one end of the chain, or the last moving link's origin."""
    last = segments[-1]
    if tip is None:
        tip = last.ends[0] if len(last.ends) == 1 else last.joint.child
    for segment in segments:
        if tip in segment.links:
            return Point("tip", segment.joint.name, segment.links[tip][:3, 3] - segment.origin)
    known = [link for segment in segments for link in segment.links]
    remedy = did_you_mean(tip, known, f"one of {', '.join(known)}")
    raise refusal(where, f"the tip {tip!r}", "a moving link of this robot", remedy)


def _by_joint(
    values: Mapping[str, Pair] | Pair, names: list[str], what: str, problems: list[Problem]
) -> Mapping[str, Pair]:
    """Return a pair for every joint; add what is missing, unknown or out of range to the problems."""
    given = values if isinstance(values, Mapping) else dict.fromkeys(names, values)
    for name in names:
        if name not in given:
            problems.append(Problem(f"joint {name}", f"no {what}", "a pair (bending, torsion)", f"add its {what}"))
    for name, pair in given.items():
        if name not in names:
            remedy = did_you_mean(name, names, "leave it out")
            problems.append(Problem(f"{what} of {name}", "no such joint", f"one of {', '.join(names)}", remedy))
        elif not _in_range(pair, what):
            least = "> 0 N m/rad" if what == "stiffness" else ">= 0 s"
            problems.append(Problem(f"joint {name}", f"{what} {pair}", f"two numbers {least}", "correct it"))
    return given


def _in_range(pair: Any, what: str) -> bool:
    try:
        numbers = np.asarray(pair, dtype=float)
    except (TypeError, ValueError):
        return False
    least = np.finfo(float).tiny if what == "stiffness" else 0.0
    return numbers.shape == (2,) and bool(np.all(np.isfinite(numbers) & (numbers >= least)))
