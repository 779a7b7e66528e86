"""Import of a serial arm from URDF, completed with bushing stiffness and damping, which URDF lacks.

URDF frames of links have any orientation; ident's frames are all parallel to the base frame in the zero posture.
Offsets, axes, mass centres and inertias are therefore taken from the base frame at zero posture.
"""

import io
import logging
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from itertools import pairwise
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from ident.arm.arm import Arm, check_size
from ident.arm.fields import LARGEST
from ident.arm.parts import Body, Point
from ident.description.robot import (
    TIP,
    Held,
    Pairs,
    Pin,
    Robot,
    body_names,
    carrier,
    held_note,
    is_sane,
    limits_note,
    listed,
    own_names,
    renamed_note,
    robot_root,
    serial_chain,
    unclear_branch,
)
from ident.errors import Problem, every, placed, refusal, refuse, require
from ident.text import NAME_RULE, one_line, read_bytes

# -------- Chain of a URDF file
# The serial chain of a URDF file: its moving parts, in the base frame at zero posture, and the file's problems.

NUMBERS = {"ixx", "ixy", "ixz", "iyy", "iyz", "izz", "xyz", "rpy", "value", "lower", "upper", "effort", "velocity"}
NUMBERS |= {"multiplier", "offset", "damping", "friction", "size", "radius", "length", "scale", "rising", "falling"}
NUMBERS |= {"soft_lower_limit", "soft_upper_limit", "k_position", "k_velocity"}
"""Attributes that hold numbers."""
UNBOUNDED = {"lower", "upper", "effort", "velocity"}
"""Attributes of a limit that may be infinite, for no limit."""
TURNING = ("revolute", "continuous")
"""Types of an arm's joints."""


@dataclass
class Segment:
    """A moving joint and the links that move with it as one body.

    Poses are (4, 4), in the base frame at zero posture.

    Attributes:
        joint: the URDF joint; None for the base.
        pose: pose of the joint.
        links: pose of each fixed link, by name.
        bodies: URDF inertial and pose of each link that moves with it and has one, by name.
        ends: fixed links without further fixed links.
        held: joints beyond it that are not the arm's and are held at zero, with their links.
    """

    joint: Any
    pose: Any
    links: dict[str, Any] = field(default_factory=dict)
    bodies: dict[str, tuple[Any, Any]] = field(default_factory=dict)
    ends: list[str] = field(default_factory=list)
    held: dict[str, Any] = field(default_factory=dict)

    @property
    def origin(self) -> Any:
        """Its place in the base frame at zero posture, (3,) [m]."""
        return self.pose[:3, 3]


def parse(data: bytes, where: str) -> Any:
    """Return yourdfpy's robot; refuse malformed XML first, since yourdfpy would repair it silently."""
    root = robot_root(data, where)
    require(root.tag == "robot", f"{where}:1", f"<{root.tag}>", "<robot>", "give a URDF file")
    refuse(_wild_numbers(root, where))
    try:
        from yourdfpy import URDF
    except ImportError:
        got, remedy = "a URDF file without the package yourdfpy", "pip install yourdfpy"
        raise refusal(where, got, "yourdfpy to read it", remedy) from None
    log = logging.getLogger("yourdfpy")
    was_silent, log.disabled = log.disabled, True
    try:
        return URDF.load(io.BytesIO(data), build_scene_graph=False, load_meshes=False).robot
    except Exception as error:  # yourdfpy lets KeyError, TypeError, ValueError and others of its parser through
        got = f"a robot that yourdfpy cannot read ({type(error).__name__}: {error})"
        raise refusal(where, got, "a valid URDF", "run check_urdf on the file") from None
    finally:
        log.disabled = was_silent


def _wild_numbers(root: Any, where: str) -> Iterator[Problem]:
    """Yield nan, inf and absurdly large numbers, which would make later results meaningless."""
    for part in (*root.iter("link"), *root.iter("joint")):
        for element in part.iter():
            for key in NUMBERS & element.attrib.keys():
                if not all(is_sane(word, bounded=key not in UNBOUNDED) for word in element.get(key).split()):
                    got, place = f"{key}={element.get(key)!r}", f"{where}, {part.tag} {part.get('name')}"
                    yield Problem(place, got, "finite numbers", "correct it", element.tag)


def chain(robot: Any, where: str, tip: str | None = None) -> list[Segment]:
    """Return the base and the moving segments from there outwards; `tip` is the last link of the arm.

    Raises:
        InputError: links are not a tree, no arm or several, no such tip, or a joint of the arm does not turn.
    """
    links, joints = {link.name: link for link in robot.links}, {joint.name: joint for joint in robot.joints}
    refuse(_names_twice(robot, where))
    refuse(_no_tree(robot, set(links), where))
    children = {name: [joint for joint in robot.joints if joint.parent == name] for name in links}
    root = next(iter(links.keys() - {joint.child for joint in robot.joints}))
    owner, after = _moving(root, children)
    loose = ", ".join(sorted(links.keys() - owner.keys()))
    require(not loose, where, f"links that do not hang on {root}: {loose}", "one tree with one root", "open the loop")
    end = carrier(tip, {name: joint for name, joint in owner.items() if joint}, where, "link")
    followed = {joint.mimic.joint for joint in robot.joints if joint.mimic is not None}

    def turns(name: str) -> bool:
        return joints[name].type in TURNING and joints[name].mimic is None

    kept, unclear = serial_chain(after, "", end, turns, followed.__contains__)
    if unclear:
        raise unclear_branch(where, (first for first, _ in unclear), (joints[last].child for _, last in unclear))
    others = listed(f"{joint.name} ({joint.type})" for joint in robot.joints if joint.type != "fixed")
    got = f"no joint that turns on its own, but {others}" if others else "no moving joint"
    require(kept, where, got, "a revolute or continuous joint", "check the joint types")
    refuse(_other_types([joints[name] for name in kept], where))
    segments, pose = [Segment(None, np.eye(4))], np.eye(4)
    for name, following in zip(["", *kept], [*kept, ""], strict=True):
        if name:
            segments.append(Segment(joints[name], pose))
        pose = _collect(segments[-1], joints[name].child if name else root, following, links, children)
    return segments


def _moving(root: str, children: dict[str, list[Any]]) -> tuple[dict[str, str], dict[str, list[str]]]:
    """Return the moving joint that carries each link, and the next moving joints on each; '' carries the base."""
    owner, after, order = {root: ""}, dict[str, list[str]]({"": []}), [root]
    for link in order:
        for joint in children[link]:
            fixed = joint.type == "fixed"
            owner[joint.child] = owner[link] if fixed else joint.name
            if not fixed:
                after[owner[link]].append(joint.name)
                after[joint.name] = []
            order.append(joint.child)
    return owner, after


def _collect(segment: Segment, link: str, following: str, links: Any, children: Any) -> Any:
    """Add a link and everything that moves with it to a segment; return the pose of the arm's next joint."""
    pose, stack = segment.pose, [(link, segment.pose, False)]
    while stack:
        link, at, is_held = stack.pop()
        if links[link].inertial is not None:
            segment.bodies[link] = links[link].inertial, at
        if not is_held:
            segment.links[link] = at
            if not any(joint.type == "fixed" for joint in children[link]):
                segment.ends.append(link)
        further = []
        for joint in children[link]:
            there = at if joint.origin is None else at @ joint.origin
            if by := _offset(joint):
                there = there @ _moved(joint, by)
            if joint.name == following:
                pose = there
                continue
            moves = joint.type != "fixed"
            if moves:
                segment.held[joint.name] = joint
            further.append((joint.child, there, is_held or moves))
        stack += reversed(further)
    return pose


def _offset(joint: Any) -> float:
    """Return the position of a following joint while its leader is at zero [rad or m]; zero for any other joint."""
    return 0.0 if joint.mimic is None else float(joint.mimic.offset or 0.0)


def _moved(joint: Any, by: float) -> Any:
    """Return the pose (4, 4) of a joint's child in the joint's frame."""
    pose, slides = np.eye(4), joint.type == "prismatic"
    way = by * np.asarray(joint.axis) / max(float(np.linalg.norm(joint.axis)), 1e-9)
    pose[:3, 3], pose[:3, :3] = slides * way, Rotation.from_rotvec((not slides) * way).as_matrix()
    return pose


def _names_twice(robot: Any, where: str) -> Iterator[Problem]:
    for kind, names in (("link", [x.name for x in robot.links]), ("joint", [x.name for x in robot.joints])):
        for name in dict.fromkeys(names):
            if names.count(name) > 1:
                yield Problem(where, f"two {kind}s {name}", "unique names", "rename one of them")
            if not name:
                yield Problem(where, f"a {kind} without a name", NAME_RULE, "name it")


def _other_types(joints: list[Any], where: str) -> Iterator[Problem]:
    """Yield joints of the arm that ident cannot model."""
    for joint in joints:
        place = f"{where}, joint {joint.name}"
        if joint.type not in TURNING:
            remedy = "fix this joint in the URDF, or let the arm end before it (tip)"
            yield Problem(place, f"type {joint.type}", "revolute, continuous or fixed", remedy)
        if joint.mimic is not None:
            remedy = "remove <mimic>, or fix the joint"
            yield Problem(place, f"a mimic of {joint.mimic.joint}", "joints that turn on their own", remedy)


def _no_tree(robot: Any, links: set[str], where: str) -> Iterator[Problem]:
    """Yield the problems that keep the links from forming one tree."""
    carried = [joint.child for joint in robot.joints]
    for joint in robot.joints:
        place = f"{where}, joint {joint.name}"
        for link in sorted({joint.parent, joint.child} - links):
            yield Problem(place, f"unknown link {link}", "a link of this robot", "correct the name")
        if carried.count(joint.child) > 1:
            got = f"link {joint.child}, which another joint carries too"
            yield Problem(place, got, "one joint per child link", "open the loop")
    roots = sorted(links - set(carried))
    if len(roots) != 1:
        got = f"root links: {', '.join(roots) or 'none'}"
        yield Problem(where, got, "one tree with one root", "remove loops and loose links")


# -------- URDF


def read_urdf(
    path: str | PathLike[str], *, stiffness: Pairs, damping: Pairs = (0.0, 0.0), tip: str | None = None
) -> Arm:
    """Return a serial arm from a URDF file.

    Revolute and continuous joints become driven joints with an empty shaft; links beyond fixed joints belong to the
    link before them. Joints off the way to the tip, such as those of a gripper, are held at zero, and their links
    belong to the link before them too; `ident.read_arm` lists them. Meshes are not read. The root link's frame is the
    base frame; everything fixed to it is omitted.

    Args:
        path: the URDF file.
        stiffness: (k_bend, k_tors) [N m/rad] of every joint by name, or one pair for all.
        damping: (tau_bend, tau_tors) [s] of every joint by name, or one pair for all.
        tip: last URDF link of the arm, whose frame's origin becomes the point `tip`; by default the end of the chain.
            For a robot with several arms it selects one.

    Raises:
        InputError: the file is not URDF, the robot is not a serial arm of such joints, or a joint lacks a value.
    """
    robot = urdf_robot(read_bytes(path, "a robot description (URDF)"), str(path), tip)
    return robot.arm(robot.bushings(stiffness, damping))


def urdf_robot(data: bytes, path: str, tip: str | None = None) -> Robot:
    """Return the robot of a URDF file; the path names it in errors, and is the name of an unnamed robot.

    Args:
        data: the file.
        path: its path.
        tip: last link of the arm; None for the end of the chain.

    Raises:
        InputError: the file is not URDF, or the robot is not a serial arm of turning joints.
    """
    where = one_line(path)
    robot = parse(data, where)
    renamed, notes = own_names([part.name or "" for part in (*robot.links, *robot.joints)], where)
    for part in (*robot.links, *robot.joints, *(each.mimic for each in robot.joints if each.mimic is not None)):
        for key in {"name", "parent", "child", "joint"} & vars(part).keys():
            setattr(part, key, renamed.get(getattr(part, key), getattr(part, key)))
    tip = tip and renamed.get(tip, tip)
    base, *segments = chain(robot, where, tip)
    check_size(len(segments), where)
    names = body_names([link.name for link in robot.links], [each.joint.name for each in segments], "link")
    pins = every(lambda pair: _pin(pair[1], pair[0].origin, names, where), pairwise((base, *segments)))
    last = segments[-1]
    end = tip or (last.ends[0] if len(last.ends) == 1 else last.joint.child)
    carrier = next(each for each in segments if end in each.links)
    point = Point(TIP, carrier.joint.name, carrier.links[end][:3, 3] - carrier.origin)
    notes += tuple(_notes(base, segments, names, where))
    return Robot(robot.name or Path(path).stem, where, tuple(pins), point, notes=notes)


def _notes(base: Segment, segments: list[Segment], names: Mapping[str, str], where: str) -> Iterator[str]:
    """Yield the differences between arm and file."""
    own, weights = {each.joint.name for each in segments}, [_weights(each) for each in (base, *segments)]
    whole = sum(fixed + held for fixed, held in weights[1:])
    for segment, (_, mass) in zip((base, *segments), weights, strict=True):
        if segment.held:
            joints = segment.held.values()
            held = [Held(j.name, j.type, j.mimic.joint if j.mimic else "", _offset(j)) for j in joints]
            yield held_note(where, held, (mass, whole), segment.joint.name if segment.joint else "", own)
    for segment in segments:
        yield from (renamed_note(where, "link", name, names[name]) for name in segment.bodies if names[name] != name)
        limit = segment.joint.limit
        lower, upper = (limit.lower, limit.upper) if limit is not None else (None, None)
        if segment.joint.type != "continuous" and (lower or 0.0) == (upper or 0.0):
            given = "no limits" if lower is None and upper is None else f"limits {lower or 0:g}, {upper or 0:g}"
            yield limits_note(where, segment.joint.name, given)


def _weights(segment: Segment) -> tuple[float, float]:
    """Return the masses [kg] fixed to a segment, and those on its held joints."""
    masses = {name: float(body.mass or 0) for name, (body, _) in segment.bodies.items()}
    fixed = sum(mass for name, mass in masses.items() if name in segment.links)
    return fixed, sum(masses.values()) - fixed


def _pin(segment: Segment, place: Any, names: Mapping[str, str], where: str) -> Pin:
    """Return a segment as a pin; `place` is the origin of the previous segment, `names` the names of links."""
    urdf = segment.joint
    axis = segment.pose[:3, :3] @ urdf.axis if np.shape(urdf.axis) == (3,) else np.zeros(3)
    is_direction = 1e-9 < np.linalg.norm(axis) < np.inf
    require(is_direction, f"{where}, joint {urdf.name}", f"axis {urdf.axis}", "a direction", "correct the axis")
    link = every(lambda each: _body(each, names[each], *segment.bodies[each], segment.origin, where), segment.bodies)
    axis, limits = axis / np.linalg.norm(axis), _limits(urdf, where)
    return Pin(urdf.name, axis, segment.origin - place, tuple(link), limits, carrier=f"link {urdf.child}")


def _body(link: str, name: str, inertial: Any, pose: Any, origin: Any, where: str) -> Body:
    """Return a link's inertial as a body, seen from a frame at `origin` that is parallel to the base frame."""
    place = f"{where}, link {link}"
    complete = inertial.mass is not None and inertial.inertia is not None
    require(complete, place, "an <inertial> that is not complete", "<mass> and <inertia>", "add them")
    at = pose if inertial.origin is None else pose @ inertial.origin
    turn = at[:3, :3]
    inertia = turn @ inertial.inertia @ turn.T
    with placed(place):
        return Body(name, inertial.mass, at[:3, 3] - origin, (inertia + inertia.T) / 2)


def _limits(urdf: Any, where: str) -> tuple[float, float]:
    if urdf.type == "continuous" or urdf.limit is None:
        return -np.inf, np.inf
    lower, upper = urdf.limit.lower or 0.0, urdf.limit.upper or 0.0
    place, got = f"{where}, joint {urdf.name}", f"limits {lower:g}, {upper:g}"
    require(lower <= upper, place, got, "lower <= upper", "swap or correct them")
    free = lower == upper
    return -np.inf if free or lower <= -LARGEST else lower, np.inf if free or upper >= LARGEST else upper
