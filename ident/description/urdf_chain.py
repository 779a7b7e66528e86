"""The serial chain of a URDF file: what moves, in the base frame at zero posture, and what is wrong with the file."""

import io
import logging
import re
from dataclasses import dataclass, field
from typing import Any
from xml.etree import ElementTree

import numpy as np

from ident.description.robot import is_sane, listed, refusal, refuse_xacro, serial_chain, unclear_branch
from ident.errors import InputError, Problem
from ident.text import NAME, NAME_RULE, did_you_mean

INERTIA = {"ixx", "ixy", "ixz", "iyy", "iyz", "izz"}
NUMBERS = INERTIA | {"xyz", "rpy", "value", "lower", "upper", "effort", "velocity", "multiplier", "offset", "damping"}
NUMBERS |= {
    "friction",
    "size",
    "radius",
    "length",
    "scale",
    "soft_lower_limit",
    "soft_upper_limit",
    "rising",
    "falling",
}
NUMBERS |= {"k_position", "k_velocity"}
"""Attributes that hold numbers."""
UNBOUNDED = {"lower", "upper", "effort", "velocity"}
"""Those of a limit that may be infinite, as where there is none."""
TURNING = ("revolute", "continuous")
"""Types of the joints that an arm may have."""


@dataclass
class Segment:
    """A moving joint and the links that move with it as one body.

    Poses are (4, 4), in the base frame at zero posture.

    Attributes:
        joint: the URDF joint; None for what is fixed to the base.
        pose: pose of the joint.
        links: pose of each link that is fixed to it, by name.
        bodies: URDF inertial and pose of each link that moves with it and has one, by name.
        ends: links to which no other is fixed.
        held: joints beyond it that the arm does not have, held at zero, and their links.
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
    """Return yourdfpy's robot; malformed XML is refused first, since yourdfpy would repair it in silence."""
    try:
        root = ElementTree.fromstring(data)
    except ElementTree.ParseError as error:
        refuse_xacro(data, None, where)
        place, column = f"{where}:{error.position[0]}", f"column {error.position[1] + 1}"
        got = str(error).partition(":")[0]
        raise InputError(Problem(place, got, "XML", "correct the syntax", column)) from None
    refuse_xacro(data, root, where)
    if root.tag != "robot":
        raise refusal(f"{where}:1", f"<{root.tag}>", "<robot>", "give a URDF file, not xacro or SDF")
    _check_numbers(root, where)
    try:
        from yourdfpy import URDF
    except ImportError:
        got, remedy = "a URDF file without the package yourdfpy", "pip install 'ident[urdf]'"
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


def _check_numbers(root: Any, where: str) -> None:
    """Refuse nan, inf and absurdly large numbers, from which later steps would only make nonsense."""
    problems = []
    for part in (*root.iter("link"), *root.iter("joint")):
        for element in part.iter():
            for key in NUMBERS & element.attrib.keys():
                if not all(is_sane(word, bounded=key not in UNBOUNDED) for word in element.get(key).split()):
                    got, place = f"{key}={element.get(key)!r}", f"{where}, {part.tag} {part.get('name')}"
                    problems.append(Problem(place, got, "finite numbers", "correct it", element.tag))
    if problems:
        raise InputError(problems)


def chain(robot: Any, where: str, tip: str | None = None) -> list[Segment]:
    """Return the base and the moving segments from there outwards; `tip` is the link that the arm ends with.

    Raises:
        InputError: no tree of links, no arm in it or several, no such tip, or a joint of the arm that does not turn.
    """
    links, joints = {link.name: link for link in robot.links}, {joint.name: joint for joint in robot.joints}
    _check_unique(robot, where)
    _check_tree(robot, set(links), where)
    children: dict[str, list[Any]] = {name: [] for name in links}
    for joint in robot.joints:
        children[joint.parent].append(joint)
    root = next(iter(links.keys() - {joint.child for joint in robot.joints}))
    owner, after = _moving(root, children)
    if owner.keys() != links.keys():
        got = f"links that do not hang on {root}: {', '.join(sorted(links.keys() - owner.keys()))}"
        raise refusal(where, got, "one tree with one root", "open the loop")
    moving = [name for name in owner if owner[name]]
    if moving and tip is not None and tip not in moving:
        remedy = did_you_mean(tip, moving, f"one of {listed(moving)}")
        raise refusal(where, f"the tip {tip!r}", "a moving link of this robot", remedy)
    followed = {joint.mimic.joint for joint in robot.joints if joint.mimic is not None}
    end = owner[tip] if moving and tip is not None else None
    kept, unclear = serial_chain(after, "", end, lambda name: _turns(joints[name]), followed.__contains__)
    if unclear:
        raise unclear_branch(where, (first for first, _ in unclear), (joints[last].child for _, last in unclear))
    if not kept:
        others = listed(f"{joint.name} ({joint.type})" for joint in robot.joints if joint.type != "fixed")
        got = f"no joint that turns on its own, but {others}" if others else "no moving joint"
        raise refusal(where, got, "a revolute or continuous joint", "check the joint types")
    _check_types([joints[name] for name in kept], where)
    segments, pose = [Segment(None, np.eye(4))], np.eye(4)
    for name, following in zip(["", *kept], [*kept, ""], strict=True):
        if name:
            segments.append(Segment(joints[name], pose))
        pose = _collect(segments[-1], joints[name].child if name else root, following, links, children)
    _check_names(segments, where)
    return segments


def _moving(root: str, children: dict[str, list[Any]]) -> tuple[dict[str, str], dict[str, list[str]]]:
    """Return which moving joint carries each link, and which move next on each; the base is carried by ''."""
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


def _turns(joint: Any) -> bool:
    return joint.type in TURNING and joint.mimic is None


def _collect(segment: Segment, link: str, following: str, links: Any, children: Any) -> Any:
    """Add a link and all that moves with it to a segment; return the pose of the joint that follows in the arm."""
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
            if joint.name == following:
                pose = there
                continue
            moves = joint.type != "fixed"
            if moves:
                segment.held[joint.name] = joint
            further.append((joint.child, there, is_held or moves))
        stack += reversed(further)
    return pose


def _check_unique(robot: Any, where: str) -> None:
    problems = []
    for kind, names in (("link", [x.name for x in robot.links]), ("joint", [x.name for x in robot.joints])):
        for name in dict.fromkeys(names):
            if names.count(name) > 1:
                problems.append(Problem(where, f"two {kind}s {name}", "unique names", "rename one of them"))
            if not name:
                problems.append(Problem(where, f"a {kind} without a name", NAME_RULE, "name it"))
    if problems:
        raise InputError(problems)


def _check_names(segments: list[Segment], where: str) -> None:
    names = [("joint", segment.joint.name) for segment in segments[1:]]
    names += [("link", name) for segment in segments[1:] for name in segment.bodies]
    problems = [
        Problem(where, f"the {kind} name {name!r}", NAME_RULE, "rename it")
        for kind, name in names
        if not re.fullmatch(NAME, name)
    ]
    if problems:
        raise InputError(problems)


def _check_types(joints: list[Any], where: str) -> None:
    """Refuse joints of the arm that ident has no equation for."""
    problems = []
    for joint in joints:
        place = f"{where}, joint {joint.name}"
        if joint.type not in TURNING:
            remedy = "fix this joint in the URDF, or let the arm end before it (tip)"
            problems.append(Problem(place, f"type {joint.type}", "revolute, continuous or fixed", remedy))
        if joint.mimic is not None:
            remedy = "remove <mimic>, or fix the joint"
            problems.append(Problem(place, f"a mimic of {joint.mimic.joint}", "joints that turn on their own", remedy))
    if problems:
        raise InputError(problems)


def _check_tree(robot: Any, links: set[str], where: str) -> None:
    """Refuse links that do not form one tree."""
    problems, carried = [], [joint.child for joint in robot.joints]
    for joint in robot.joints:
        place = f"{where}, joint {joint.name}"
        for link in sorted({joint.parent, joint.child} - links):
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
