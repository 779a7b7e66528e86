"""Import of a serial arm from URDF, completed with what URDF cannot say: bushing stiffness and damping.

URDF turns each link's frame as it likes; ident's frames are all parallel to the base frame in the zero
posture. Offsets, axes, mass centres and inertias are therefore taken from the base frame at zero posture.
"""

import io
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from os import PathLike
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

from ident.arm.arm import Arm
from ident.arm.parts import Body, Joint, Point
from ident.description.file import massless_joint
from ident.description.quantities import LARGEST
from ident.errors import InputError, Problem
from ident.text import NAME, NAME_RULE, did_you_mean, one_line, read_bytes

Pair = tuple[float, ...]
"""Two numbers, across the axis and about it; their number is checked when the file is read."""
NUMBERS = {"xyz", "rpy", "value", "ixx", "ixy", "ixz", "iyy", "iyz", "izz"}


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
    robot = _parse(read_bytes(path, "a robot description (URDF)"), where)
    segments = _chain(robot, where)
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
    if got := massless_joint(joints[-1]):
        remedy = "give the last link an <inertial>"
        raise _refusal(f"{where}, joint {names[-1]}", got, "mass beyond every bushing", remedy)
    return Arm(robot.name or Path(path).stem, tuple(joints), (_tip(segments, tip, where),))


@dataclass
class _Segment:
    """A moving joint and the links that move with it as one body.

    Poses are (4, 4), in the base frame at zero posture.

    Attributes:
        joint: the URDF joint; None for what is fixed to the base.
        pose: pose of the joint.
        links: pose of each link, by name.
        bodies: URDF inertial and pose of each link that has one, by name.
        ends: links from which no joint goes on.
    """

    joint: Any
    pose: Any
    links: dict[str, Any] = field(default_factory=dict)
    bodies: dict[str, tuple[Any, Any]] = field(default_factory=dict)
    ends: list[str] = field(default_factory=list)

    @property
    def origin(self) -> Any:
        return self.pose[:3, 3]


def _parse(data: bytes, where: str) -> Any:
    """Return yourdfpy's robot; malformed XML is refused first, since yourdfpy would repair it in silence."""
    try:
        root = ElementTree.fromstring(data)
    except ElementTree.ParseError as error:
        place, column = f"{where}:{error.position[0]}", f"column {error.position[1] + 1}"
        got = str(error).partition(":")[0]
        raise InputError(Problem(place, got, "XML", "correct the syntax", column)) from None
    if root.tag != "robot":
        raise _refusal(f"{where}:1", f"<{root.tag}>", "<robot>", "give a URDF file, not xacro or SDF")
    _check_numbers(root, where)
    try:
        from yourdfpy import URDF
    except ImportError:
        got, remedy = "a URDF file without the package yourdfpy", "pip install 'ident[urdf]'"
        raise _refusal(where, got, "yourdfpy to read it", remedy) from None
    try:
        return URDF.load(io.BytesIO(data), build_scene_graph=False, load_meshes=False).robot
    except Exception as error:  # yourdfpy lets KeyError, TypeError, ValueError and others of its parser through
        got = f"a robot that yourdfpy cannot read ({type(error).__name__}: {error})"
        raise _refusal(where, got, "a valid URDF", "run check_urdf on the file") from None


def _check_numbers(root: Any, where: str) -> None:
    """Refuse nan, inf and absurdly large numbers, from which later steps would only make nonsense."""
    problems = []
    for part in root:
        for element in part.iter():
            for key in NUMBERS & element.attrib.keys():
                if not all(map(_is_sane, element.get(key).split())):
                    got, place = f"{key}={element.get(key)!r}", f"{where}, {part.tag} {part.get('name')}"
                    problems.append(Problem(place, got, "finite numbers", "correct it", element.tag))
    if problems:
        raise InputError(problems)


def _is_sane(word: str) -> bool:
    try:
        return abs(float(word)) < LARGEST
    except ValueError:
        return True  # yourdfpy will say that this is no number


def _chain(robot: Any, where: str) -> list[_Segment]:
    """Return the moving segments from the base outwards."""
    links = {link.name: link for link in robot.links}
    _check_names(robot, where)
    _check_tree(robot, set(links), where)
    children: dict[str, list[Any]] = {}
    for joint in robot.joints:
        children.setdefault(joint.parent, []).append(joint)
    root = next(iter(links.keys() - {joint.child for joint in robot.joints}))
    segments = [_Segment(None, np.eye(4))]
    following = _collect(segments[0], root, segments[0].pose, links, children)
    while following:
        if len(following) > 1:
            names = ", ".join(joint.name for joint, _ in following)
            raise _refusal(where, f"a branch into {names}", "a serial arm", "remove the other arms from the URDF")
        joint, pose = following[0]
        segments.append(_Segment(joint, pose))
        following = _collect(segments[-1], joint.child, pose, links, children)
    reached = {link for segment in segments for link in segment.links}
    if reached != links.keys():
        got = f"links that do not hang on {root}: {', '.join(sorted(links.keys() - reached))}"
        raise _refusal(where, got, "one tree with one root", "open the loop")
    if len(segments) == 1:
        raise _refusal(where, "no moving joint", "a revolute or continuous joint", "check the joint types")
    return segments[1:]


def _collect(segment: _Segment, link: str, pose: Any, links: Any, children: Any) -> list[tuple[Any, Any]]:
    """Add a link and all that is fixed to it to a segment; return the joints that move next, with poses."""
    segment.links[link] = pose
    if links[link].inertial is not None:
        segment.bodies[link] = links[link].inertial, pose
    if link not in children:
        segment.ends.append(link)
    following = []
    for joint in children.get(link, ()):
        there = pose if joint.origin is None else pose @ joint.origin
        if joint.type == "fixed":
            following += _collect(segment, joint.child, there, links, children)
        else:
            following.append((joint, there))
    return following


def _check_names(robot: Any, where: str) -> None:
    problems = []
    for kind, names in (("link", [x.name for x in robot.links]), ("joint", [x.name for x in robot.joints])):
        for name in dict.fromkeys(names):
            if not re.fullmatch(NAME, name):
                got = f"the {kind} name {name!r}"
                problems.append(Problem(where, got, NAME_RULE, "rename it"))
            if names.count(name) > 1:
                problems.append(Problem(where, f"two {kind}s {name}", "unique names", "rename one of them"))
    if problems:
        raise InputError(problems)


def _check_tree(robot: Any, links: set[str], where: str) -> None:
    """Refuse joints that ident has no equation for, and links that do not form one tree."""
    problems, carried = [], [joint.child for joint in robot.joints]
    for joint in robot.joints:
        place = f"{where}, joint {joint.name}"
        if joint.type not in ("revolute", "continuous", "fixed"):
            remedy = "fix this joint in the URDF, or leave out what hangs on it"
            problems.append(Problem(place, f"type {joint.type}", "revolute, continuous or fixed", remedy))
        if joint.mimic is not None:
            remedy = "remove <mimic>, or fix the joint"
            problems.append(Problem(place, f"a mimic of {joint.mimic.joint}", "joints that turn on their own", remedy))
        for link in {joint.parent, joint.child} - links:
            problems.append(Problem(place, f"unknown link {link}", "a link of this robot", "correct the name"))
        if carried.count(joint.child) > 1:
            got = f"link {joint.child}, which another joint carries too"
            problems.append(Problem(place, got, "one joint per child link", "open the loop"))
    roots = sorted(links - set(carried))
    if len(roots) != 1:
        got = f"root links: {', '.join(roots) or 'none'}"
        problems.append(Problem(where, got, "one tree with one root", "remove loops and loose links"))
    if problems:
        raise InputError(problems)


def _joint(segment: _Segment, place: Any, k: Pair, tau: Pair, where: str) -> Joint:
    """Return a segment as a joint; `place` is the origin of the segment before."""
    urdf = segment.joint
    axis = segment.pose[:3, :3] @ urdf.axis if np.shape(urdf.axis) == (3,) else np.zeros(3)
    if not 1e-9 < np.linalg.norm(axis) < np.inf:
        raise _refusal(f"{where}, joint {urdf.name}", f"axis {urdf.axis}", "a direction", "correct the axis")
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
        raise _refusal(place, "an <inertial> that is not complete", "<mass> and <inertia>", "add them")
    at = pose if inertial.origin is None else pose @ inertial.origin
    turn = at[:3, :3]
    inertia = turn @ inertial.inertia @ turn.T
    try:
        return Body(name, inertial.mass, at[:3, 3] - origin, (inertia + inertia.T) / 2)
    except InputError as error:
        problem = error.problems[0]
        raise _refusal(place, problem.got, problem.expected, problem.remedy) from None


def _limits(urdf: Any, where: str) -> tuple[float, float]:
    if urdf.type == "continuous" or urdf.limit is None:
        return (-np.inf, np.inf)
    lower, upper = urdf.limit.lower or 0.0, urdf.limit.upper or 0.0
    if not lower <= upper:
        place = f"{where}, joint {urdf.name}"
        raise _refusal(place, f"limits {lower:g}, {upper:g}", "lower <= upper", "swap or correct them")
    return (lower, upper)


def _tip(segments: list[_Segment], tip: str | None, where: str) -> Point:
    """Return the named link's origin, or the one end of the chain, or the last moving link's origin."""
    last = segments[-1]
    if tip is None:
        tip = last.ends[0] if len(last.ends) == 1 else last.joint.child
    for segment in segments:
        if tip in segment.links:
            return Point("tip", segment.joint.name, segment.links[tip][:3, 3] - segment.origin)
    known = [link for segment in segments for link in segment.links]
    remedy = did_you_mean(tip, known, f"one of {', '.join(known)}")
    raise _refusal(where, f"the tip {tip!r}", "a moving link of this robot", remedy)


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


def _refusal(where: str, got: str, expected: str, remedy: str) -> InputError:
    return InputError(Problem(where, got, expected, remedy))
