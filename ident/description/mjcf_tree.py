"""The elements of an MJCF file, changed in place and written as they are otherwise.

What MuJoCo writes has six digits, which would move natural frequencies by 1e-6; so the text of the file is changed.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
from jaxtyping import Float

from ident.description.mjcf import load_spec, placed
from ident.description.robot import refusal

Vector = Float[np.ndarray, "3"]


@dataclass(frozen=True)
class Tree:
    """The elements of a file, and what MuJoCo makes of it.

    Attributes:
        root: the outermost element; included files stand in their places.
        model: MuJoCo's model.
        data: its places and axes at zero posture.
        where: names the file in errors.
    """

    root: Any
    model: Any
    data: Any
    where: str

    def body_of(self, joint: str) -> int:
        """Return the number of the body that a joint turns."""
        return int(self.model.jnt_bodyid[self.model.joint(joint).id])

    def before(self, body: int) -> int:
        """Return the number of the body that holds another one."""
        return int(self.model.body_parentid[body])

    def axes(self, body: int) -> Float[np.ndarray, "3 3"]:
        """Return the axes of a body, columns, in the base frame."""
        return np.array(self.data.xmat[body]).reshape(3, 3)

    def place(self, body: int) -> Vector:
        """Return the origin of a body in the base frame [m]."""
        return np.array(self.data.xpos[body])

    def path(self, tag: str, name: str) -> list[Any]:
        """Return an element of the world, the bodies and frames that hold it before it, outermost first.

        Raises:
            InputError: MuJoCo knows it, though it has no element.
        """
        for world in self.root.iter("worldbody"):
            if found := _path(world, lambda each: each.tag == tag and each.get("name") == name):
                return found
        got, expected = "no element of its own", f"a <{tag}> of that name"
        raise refusal(f"{self.where}, {tag} {name}", got, expected, "write it without <attach> and <replicate>")

    def body_path(self, joint: str) -> list[Any]:
        """Return the path to the body that a joint turns, see `path`."""
        path = self.path("joint", joint)
        while path[-1].tag != "body":
            path.pop()
        return path

    def only(self, path: list[Any], others: Iterable[str]) -> tuple[Any, Any]:
        """Return the body that holds an element, and what it holds of it: the element, or the frame about it.

        Args:
            path: to the element.
            others: tags of what such a frame may not hold besides.

        Raises:
            InputError: it holds such a thing, so that what is done to one would be done to the other.
        """
        place = len(path) - 2
        while path[place].tag == "frame":
            place -= 1
        held = path[place + 1]
        unwanted = {id(each) for tag in others for each in held.iter(tag)} - {id(each) for each in path[-1].iter()}
        if unwanted:
            got, expected = "a <frame> with more in it", f"a <frame> about this {path[-1].tag} alone"
            name = path[-1].get("name", "")
            raise refusal(f"{self.where}, {path[-1].tag} {name}", got, expected, "write it without that frame")
        return path[place], held


def tree_of(path: str, where: str) -> Tree:
    """Return the elements of an MJCF file, and MuJoCo's model of it.

    Raises:
        InputError: MuJoCo is not installed, or can't read the file.
    """
    model, data, _ = placed(path, where)
    return Tree(_elements(Path(path)), model, data, where)


def wrapped(holder: Any, held: Any, wrapper: Any) -> None:
    """Put an element into another one that takes its place."""
    place = list(holder).index(held)
    wrapper.tail, held.tail = held.tail, None
    holder[place] = wrapper
    wrapper.append(held)


def moved(holder: Any, held: Any, way: Vector) -> None:
    """Move an element by a way [m] in the axes of its holder."""
    wrapped(holder, held, ElementTree.Element("frame", {"pos": numbers(way)}))


def numbers(values: Iterable[Any]) -> str:
    """Return numbers as they stand in an attribute, with all digits."""
    return " ".join(repr(float(x)) for x in values)


def own_masses(path: str, where: str) -> None:
    """Refuse a file that gives its bodies other masses than stand there.

    Raises:
        InputError: it is such a file.
    """
    import mujoco

    compiler = load_spec(path, where).compiler
    if compiler.inertiafromgeom == mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_TRUE or compiler.settotalmass > 0:
        got, remedy = "masses by inertiafromgeom or settotalmass", "drop that, or write .toml or .json"
        raise refusal(f"{where}, compiler", got, "masses that the bodies have themselves", remedy)


def _path(element: Any, wanted: Callable[[Any], bool]) -> list[Any]:
    if wanted(element):
        return [element]
    for child in element:
        if found := _path(child, wanted):
            return [element, *found]
    return []


def _elements(path: Path) -> Any:
    """Return the outermost element of a file, with those of included files in the places where they are included."""
    parser = ElementTree.XMLParser(target=ElementTree.TreeBuilder(insert_comments=True))
    root = ElementTree.fromstring(path.read_bytes(), parser)
    for parent in list(root.iter()):
        for place, child in reversed(list(enumerate(parent))):
            if child.tag == "include":
                parent[place : place + 1] = list(_elements(path.parent / child.attrib["file"]))
    return root
