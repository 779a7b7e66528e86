"""The serial chain of a URDF file: what moves, in the base frame at zero posture, and what is wrong with the file."""

import io
import re
from dataclasses import dataclass, field
from typing import Any
from xml.etree import ElementTree

import numpy as np

from ident.arm.fields import LARGEST
from ident.description.robot import refusal
from ident.errors import InputError, Problem
from ident.text import NAME, NAME_RULE

NUMBERS = {"xyz", "rpy", "value", "ixx", "ixy", "ixz", "iyy", "iyz", "izz"}
"""Attributes that hold numbers."""


@dataclass
class Segment:
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
        """Its place in the base frame at zero posture, (3,) [m]."""
        return self.pose[:3, 3]


def parse(data: bytes, where: str) -> Any:
    """Return yourdfpy's robot; malformed XML is refused first, since yourdfpy would repair it in silence."""
    try:
        root = ElementTree.fromstring(data)
    except ElementTree.ParseError as error:
        place, column = f"{where}:{error.position[0]}", f"column {error.position[1] + 1}"
        got = str(error).partition(":")[0]
        raise InputError(Problem(place, got, "XML", "correct the syntax", column)) from None
    if root.tag != "robot":
        raise refusal(f"{where}:1", f"<{root.tag}>", "<robot>", "give a URDF file, not xacro or SDF")
    _check_numbers(root, where)
    try:
        from yourdfpy import URDF
    except ImportError:
        got, remedy = "a URDF file without the package yourdfpy", "pip install 'ident[urdf]'"
        raise refusal(where, got, "yourdfpy to read it", remedy) from None
    try:
        return URDF.load(io.BytesIO(data), build_scene_graph=False, load_meshes=False).robot
    except Exception as error:  # yourdfpy lets KeyError, TypeError, ValueError and others of its parser through
        got = f"a robot that yourdfpy cannot read ({type(error).__name__}: {error})"
        raise refusal(where, got, "a valid URDF", "run check_urdf on the file") from None


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


def chain(robot: Any, where: str) -> list[Segment]:
    """Return the moving segments from the base outwards."""
    links = {link.name: link for link in robot.links}
    _check_names(robot, where)
    _check_tree(robot, set(links), where)
    children: dict[str, list[Any]] = {}
    for joint in robot.joints:
        children.setdefault(joint.parent, []).append(joint)
    root = next(iter(links.keys() - {joint.child for joint in robot.joints}))
    segments = [Segment(None, np.eye(4))]
    following = _collect(segments[0], root, segments[0].pose, links, children)
    while following:
        if len(following) > 1:
            names = ", ".join(joint.name for joint, _ in following)
            raise refusal(where, f"a branch into {names}", "a serial arm", "remove the other arms from the URDF")
        joint, pose = following[0]
        segments.append(Segment(joint, pose))
        following = _collect(segments[-1], joint.child, pose, links, children)
    reached = {link for segment in segments for link in segment.links}
    if reached != links.keys():
        got = f"links that do not hang on {root}: {', '.join(sorted(links.keys() - reached))}"
        raise refusal(where, got, "one tree with one root", "open the loop")
    if len(segments) == 1:
        raise refusal(where, "no moving joint", "a revolute or continuous joint", "check the joint types")
    return segments[1:]


def _collect(segment: Segment, link: str, pose: Any, links: Any, children: Any) -> list[tuple[Any, Any]]:
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
