"""MJCF with the bushings of an arm: three passive hinges before each driven one, in the body that it moves.

Stiffness on the driven hinge itself would pull the motor's axis back to zero. The file is changed as text: what MuJoCo
writes has six digits, which would move natural frequencies by 1e-6.

Three hinges one after another are not quite the rotation vector of ident's bushing: natural frequencies are the same
where nothing bends the arm, and under its weight but for a share below the angle [rad] by which a bushing gives.
"""

from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

from ident.arm.arm import Arm
from ident.arm.parts import Joint
from ident.description.mjcf import ENDS, load_spec
from ident.description.robot import refusal
from ident.description.xml_text import comment, root_start
from ident.text import one_line, read_bytes

PLAIN = {
    "type": "hinge",
    "armature": "0",
    "frictionloss": "0",
    "limited": "false",
    "actuatorfrclimited": "false",
    "ref": "0",
    "springref": "0",
    "springdamper": "0 0",
}
"""What such a hinge has none of, whatever the file's defaults for joints are."""


def mjcf_with_bushings(path: str, arm: Arm, lines: list[str]) -> bytes:
    """Return an MJCF file with the bushings of its arm, and a comment before it.

    A hinge of a bushing has the stiffness k [N m/rad] and the damping tau k [N m s/rad]; loss factors have no place
    there. Included files are written in their places, keyframes get the angle 0 of each new hinge.

    Args:
        path: the file that the arm was read from.
        arm: the arm, with the numbers that are written.
        lines: the comment.

    Raises:
        InputError: the file can't be read any more, has bushings already, or a joint is not written as an element.
    """
    where, data = one_line(path), read_bytes(path, "a robot description (MJCF)")
    spec, root = load_spec(path, where), _tree(Path(path))
    _check_free(spec, arm, where)
    for joint in arm.joints:
        holder, place = _place(root, joint.name, where)
        turns = _turns(joint, spec.joint(joint.name))
        hinges = [_hinge(joint, end, *turn) for end, turn in zip(ENDS, turns, strict=True)]
        for hinge in hinges:
            hinge.tail = holder[place - 1].tail if place else holder.text
        holder[place:place] = hinges
    for key in root.iter("key"):
        for name in {"qpos", "qvel"} & key.attrib.keys():
            key.set(name, " ".join(f"0 0 0 {number}" for number in key.attrib[name].split()))
    return data[: root_start(data)] + comment(lines) + ElementTree.tostring(root, encoding="utf-8") + b"\n"


def _check_free(spec: Any, arm: Arm, where: str) -> None:
    """Refuse a file that has bushings already."""
    taken = [name for joint in arm.joints for end in ENDS if spec.joint(name := f"{joint.name}_{end}")]
    if taken:
        got, remedy = f"the hinge {taken[0]}", "write into the file without them (--arm)"
        raise refusal(where, got, "a robot without bushings", remedy)


def _tree(path: Path) -> Any:
    """Return the elements of a file, those of included files in the places where they are included."""
    parser = ElementTree.XMLParser(target=ElementTree.TreeBuilder(insert_comments=True))
    root = ElementTree.fromstring(path.read_bytes(), parser)
    return _expanded(root, path.parent)


def _expanded(root: Any, folder: Path) -> Any:
    for parent in list(root.iter()):
        for place, child in reversed(list(enumerate(parent))):
            if child.tag == "include":
                parent[place : place + 1] = list(_tree(folder / child.attrib["file"]))
    return root


def _turns(joint: Joint, written: Any) -> list[tuple[Any, Any, float, float]]:
    """Return axis, anchor, stiffness and damping of the hinges of a bushing, in the axes of the joint's element."""
    axis = np.asarray(written.axis) / np.linalg.norm(written.axis)
    across = np.linalg.svd(axis[None])[2][1:]
    bend = (float(joint.k_bend), float(joint.k_bend * joint.tau_bend))
    tors = (float(joint.k_tors), float(joint.k_tors * joint.tau_tors))
    return [(axis, written.pos, *tors), *((each, written.pos, *bend) for each in across)]


def _hinge(joint: Joint, end: str, axis: Any, anchor: Any, stiffness: float, damping: float) -> Any:
    numbers = {"axis": axis, "pos": anchor, "stiffness": [stiffness], "damping": [damping]}
    texts = {key: " ".join(repr(float(x)) for x in value) for key, value in numbers.items()}
    return ElementTree.Element("joint", {"name": f"{joint.name}_{end}", **PLAIN, **texts})


def _place(root: Any, name: str, where: str) -> tuple[Any, int]:
    """Return the element that holds a joint, and the joint's place in it."""
    for holder in (each for world in root.iter("worldbody") for each in world.iter()):
        for place, child in enumerate(holder):
            if child.tag == "joint" and child.get("name") == name:
                return holder, place
    got, expected = "no element of its own", "a <joint> of that name"
    raise refusal(f"{where}, joint {name}", got, expected, "write it without <attach> and <replicate>")
