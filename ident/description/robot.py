"""A robot description, URDF or MJCF: an arm without its bushings, and the arm completed with them."""

import hashlib
import re
from collections.abc import Callable, Container, Hashable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar
from xml.etree import ElementTree

import equinox as eqx
import numpy as np
import tomlkit
from jaxtyping import Float
from pydantic import Field

from ident.arm.arm import GRAVITY, Arm, massless_joints, on_soft_base
from ident.arm.fields import ALPHA, LARGEST
from ident.arm.parts import Body, Joint, Payload, Point
from ident.description.problems import Source, load_toml
from ident.description.rewriting import (
    bushing_text,
    changed_numbers,
    place_damping,
    set_inertias,
    set_numbers,
    with_first,
)
from ident.description.schema import BUSHING, BushingTable, Damped, Origin, PayloadTable, PointTable
from ident.errors import InputError, Problem, placed, refusal, refuse, require
from ident.text import NAME, NAME_RULE, decode, did_you_mean, one_line, read_bytes

Pair = tuple[float, ...]
"""Two numbers, across the axis and about it; their number is checked when the file is read."""
Pairs = Mapping[str, Pair] | Pair
"""A pair for each joint by name, or one for all."""
TIP = "tip"
"""Name of the end point."""
HEAVY = 0.05
"""Largest share of the moving mass for a held link that follows a joint of the arm: fingers have less."""
MOST_NAMED = 8
"""Most names in a line of a message."""
Node = TypeVar("Node", bound=Hashable)


def own_name(name: str) -> str:
    """Return a valid name for an arm: `panda/joint.1` becomes `panda_joint_1`; an empty name stays."""
    plain = re.sub(r"[^A-Za-z0-9_-]", "_", name)
    return plain if re.fullmatch(NAME, plain) or not plain else f"x{plain}"


def own_names(names: Iterable[str], where: str) -> tuple[dict[str, str], tuple[str, ...]]:
    """Return the new names of a file's invalid names, and the note on them.

    Raises:
        InputError: two new names would be the same.
    """
    every = [name for name in dict.fromkeys(names) if name]
    own = {name: new for name in every if (new := own_name(name)) != name}
    notes, several = [], f" and {len(own) - 1} more names" if len(own) > 1 else ""
    for name, new in own.items():
        got = f"the name {name!r}, which {new} would stand for here as for another"
        require([*own.values(), *every].count(new) == 1, where, got, NAME_RULE, "rename one of them")
        notes.append(f"{where}: {one_line(name)} is called {new} here{several}: {NAME_RULE}")
    return own, tuple(notes[:1])


def robot_root(data: bytes, where: str) -> Any:
    """Return the root element of a robot description: robot of URDF, mujoco of MJCF.

    Raises:
        InputError: it is not XML, or has another root.
    """
    try:
        root = ElementTree.fromstring(data)
    except (ElementTree.ParseError, LookupError, ValueError) as error:
        refuse_xacro(data, None, where)
        (line, column), expected = getattr(error, "position", (1, 0)), "a robot description (URDF or MJCF)"
        got = f"no XML ({one_line(str(error).partition(':')[0])})"
        raise refusal(f"{where}:{line}", got, expected, "correct it", f"column {column + 1}") from None
    refuse_xacro(data, root, where)
    got, remedy = f"<{one_line(root.tag)}>", "give a URDF or MJCF file, not xacro or SDF"
    require(root.tag in ("robot", "mujoco"), f"{where}:1", got, "<robot> or <mujoco>", remedy)
    return root


def refuse_xacro(data: bytes, root: Any, where: str) -> None:
    """Refuse a robot description with unexpanded macros; `root` is None if it is not XML.

    Raises:
        InputError: it has a xacro element, or an attribute with `${...}` or `$(...)`.
    """
    if root is None:
        there = re.search(rb"<xacro:\w+", data) is not None
    else:
        there = any(re.match(r"\{[^}]*xacro", str(each.tag)) for each in root.iter())
        there = there or any(re.search(r"\$[{(]", value) for each in root.iter() for value in each.attrib.values())
    path = Path(where)
    made = (path.stem if path.suffix == ".xacro" else "robot").removesuffix(".urdf") + ".urdf"
    made = "expanded.urdf" if made == path.name else made
    require(not there, where, "a xacro file", "a URDF file", f"expand it: xacro {where} > {made}")


def is_sane(word: str, *, bounded: bool = True) -> bool:
    """Whether a word is not a number, or a plausible one: finite and not absurdly large."""
    try:
        number = float(word)
    except ValueError:
        return True  # the reader of the format refuses it
    return abs(number) < LARGEST if bounded else number == number


def listed(names: Iterable[str]) -> str:
    """Return names in a row, only the first ones of a long list."""
    every = list(names)
    more = [f"{len(every) - MOST_NAMED} more"] if len(every) > MOST_NAMED else []
    return ", ".join([*map(one_line, every[:MOST_NAMED]), *more])


def serial_chain(
    after: Mapping[Node, Sequence[Node]],
    root: Node,
    tip: Node | None,
    turns: Callable[[Node], bool],
    is_followed: Callable[[Node], bool],
) -> tuple[list[Node], list[tuple[Node, Node]]]:
    """Return the moving parts of the arm, from the base outwards, and the candidates of an ambiguous branch.

    Each candidate has its first part, and its last part before the next branch.

    The arm leads to the part that carries the tip. Beyond it, or without a named tip, it continues with the only part
    that leads to a turning joint. Several such parts are a hand, where the arm ends, if each has less than half as many
    turning joints as the arm before; so is a single part that others follow, the drive of a gripper.

    Args:
        after: next moving parts on each part, a tree.
        root: the fixed part.
        tip: the part that carries the named end point; None without a name.
        turns: whether the joint of a part can belong to an arm: it turns, on its own.
        is_followed: whether other joints follow that of a part, as in a gripper.
    """
    order, before = [root], dict[Node, Node]()
    for node in order:
        order += after[node]
        before.update(dict.fromkeys(after[node], node))
    depth, plain = dict[Node, int](), dict[Node, bool]()  # turning joints of the longest way outwards
    for node in reversed(order):
        depth[node] = max((depth[each] for each in after[node]), default=0) + (node != root and turns(node))
        plain[node] = len(after[node]) < 2 and all(plain[each] and turns(each) for each in after[node])
    chain = [root] if tip is None else [tip]
    while chain[0] != root:
        chain.insert(0, before[chain[0]])
    while plain[root] or chain[-1] != tip:
        arms = [node for node in after[chain[-1]] if depth[node]]
        is_hand = all(2 * depth[node] < len(chain) - 1 for node in arms)
        if is_hand and (len(arms) != 1 or is_followed(arms[0])):
            break
        if len(arms) > 1:
            return chain[1:], [(node, _end(node, after, depth)) for node in arms]
        chain += arms
    return chain[1:], []


def _end(node: Node, after: Mapping[Node, Sequence[Node]], depth: Mapping[Node, int]) -> Node:
    """Return the last part of a chain, before it branches or ends."""
    while len(further := [each for each in after[node] if depth[each]]) == 1:
        node = further[0]
    return node


def carrier(tip: str | None, carriers: Mapping[str, Node], where: str, kind: str) -> Node | None:
    """Return the part that carries the end point, from the carrier of each moving link or body; None for any.

    Raises:
        InputError: no moving link or body has that name.
    """
    if carriers and tip is not None and tip not in carriers:
        remedy = did_you_mean(tip, carriers, f"one of {listed(carriers)}")
        raise refusal(where, f"the tip {tip!r}", f"a moving {kind} of this robot", remedy)
    return carriers.get(tip or "")


def unclear_branch(where: str, joints: Iterable[str], ends: Iterable[str]) -> InputError:
    """Return the refusal of a robot with several arms and no named tip; `ends` are the choices for `tip`."""
    beside = one_line(Path(where).with_suffix(".joints.toml").name)
    remedy = f'name what the arm ends with ({listed(ends)}): tip = "..." in {beside}, or ident new --tip'
    return refusal(where, f"a branch into {listed(joints)}", "a serial arm", remedy)


def body_names(names: Sequence[str], joints: Iterable[str], kind: str) -> dict[str, str]:
    """Return the name of each link or body in the arm: as in its file, unless a joint has that name."""
    taken, own = {*joints, TIP}, {}
    for name in names:
        new = name
        while new in taken or (new != name and new in names):
            new += f"_{kind}"
        own[name] = new
    return own


def renamed_note(where: str, kind: str, old: str, new: str) -> str:
    """Return the note on a body that has another name in the arm than in its file."""
    why = "the end point has that name" if old == TIP else "a joint has that name"
    return f"{where}, {kind} {one_line(old)}: called {new} here, as {why}"


@dataclass(frozen=True)
class Held:
    """A joint that the arm does not have.

    Attributes:
        name: name in the file.
        type: type of joint in the file.
        follows: the joint that it follows; empty for none.
        at: [rad or m] its fixed position: that of its constraint with the others at zero.
    """

    name: str
    type: str
    follows: str = ""
    at: float = 0.0

    def __str__(self) -> str:
        follows, at = f", follows {self.follows}" if self.follows else "", f", at {self.at:.4g}" if self.at else ""
        return f"{self.name} ({self.type}{follows}{at})"


def held_note(where: str, held: Sequence[Held], masses: tuple[float, float], joint: str, own: Container[str]) -> str:
    """Return the note on held joints on the link of `joint`, or on the base if it is empty.

    Args:
        where: names the file.
        held: the joints.
        masses: [kg] on them, and of all moving bodies.
        joint: the joint with which they move.
        own: names of the arm's joints.

    Raises:
        InputError: one follows a joint of the arm, and they are too heavy to be held while that joint turns.
    """
    one, (mass, whole) = len(held) == 1, masses
    place = f"{where}, joint{'s' * (not one)} {listed(map(str, held))}"
    if any(each.follows in own for each in held) and mass > HEAVY * whole:
        got = f"{mass:.3g} of {whole:.3g} kg on what turns with another joint"
        raise refusal(place, got, "a serial arm whose joints turn on their own", "fix the joint, or let it turn alone")
    verb, with_them = ("is", "it") if one else ("are", "them")
    what = f"{mass:.4g} kg on {with_them} move with {joint}" if joint else f"what is on {with_them} is left out"
    return f"{place}: {verb} held{'' if any(each.at for each in held) else ' at zero'}; {what}"


def limits_note(where: str, joint: str, limits: str) -> str:
    """Return the note on limits that leave a joint no room."""
    return f"{where}, joint {joint}: {limits}, so that it turns freely here"


@dataclass(frozen=True)
class Pin:
    """A joint without its bushing, and its link; the attributes have the meaning of those of `Joint`."""

    name: str
    axis: Float[np.ndarray, "3"]
    offset: Float[np.ndarray, "3"]
    link: tuple[Body, ...]
    limits: tuple[float, float]
    driven: bool = True
    carrier: str = ""
    """Name in the file of the link or body that turns with it and could have mass."""


@dataclass(frozen=True)
class Robot:
    """A serial arm from a robot description.

    Attributes:
        name: its name.
        where: names the file in errors.
        pins: from the base outwards.
        tip: the end point.
        gravity: (3,) [m/s^2] in the base frame.
        notes: differences between arm and file: held joints, ignored limits, other names.
    """

    name: str
    where: str
    pins: tuple[Pin, ...]
    tip: Point
    gravity: Any = GRAVITY
    notes: tuple[str, ...] = ()

    @property
    def joints(self) -> list[str]:
        """Names of the joints."""
        return [pin.name for pin in self.pins]

    def arm(
        self, bushings: Mapping[str, dict[str, Any]], points: tuple[Point, ...] = (), payloads: tuple[Payload, ...] = ()
    ) -> Arm:
        """Return the arm.

        Args:
            bushings: stiffness and damping arguments of `Joint`, by joint.
            points: further points.
            payloads: bodies that a load case may add.

        Raises:
            InputError: bushings without mass beyond them, or a repeated name.
        """
        own = ("axis", "offset", "link", "limits", "driven")
        joints = [Joint(p.name, **{key: getattr(p, key) for key in own}, **bushings[p.name]) for p in self.pins]
        refuse(self._massless(joints))
        with placed(self.where):
            return Arm(self.name, tuple(joints), (*points, self.tip), payloads, self.gravity)

    def _massless(self, joints: Sequence[Joint]) -> Iterator[Problem]:
        """Yield joints without mass beyond them, all in one line, and joints whose rotation moves no mass."""
        found = {place: (got, expected) for place, got, expected in massless_joints(joints)}
        empty = sorted(place for place in found if not any(float(body.mass) for body in joints[place].link))
        if empty:
            got, expected = found[empty[-1]]
            names, carriers = ([getattr(self.pins[place], key) for place in empty] for key in ("name", "carrier"))
            one = len(empty) == 1
            where = f"{self.where}, joint{'s' * (not one)} {listed(names)}"
            got = got if one else "no mass on the bushings"
            yield Problem(where, got, expected, f"give {listed(carriers)} an <inertial> with <mass> and <inertia>")
        for place, (got, expected) in sorted(found.items()):
            if place not in empty:
                heavy = listed(body.name for body in joints[place].link if float(body.mass))
                remedy = f"give {heavy} an inertia that is not zero about any axis"
                yield Problem(f"{self.where}, joint {joints[place].name}", got, expected, remedy)

    def bushings(self, stiffness: Pairs, damping: Pairs) -> dict[str, dict[str, float]]:
        """Return stiffness and damping arguments of `Joint` by joint, from pairs for each joint or one for all.

        Raises:
            InputError: a value is missing or out of range, or its joint does not exist.
        """
        k, tau = (x if isinstance(x, Mapping) else dict.fromkeys(self.joints, x) for x in (stiffness, damping))
        refuse([*_wrong_pairs(k, self.joints, "stiffness"), *_wrong_pairs(tau, self.joints, "damping")])
        keys = ("k_bend", "k_tors", "tau_bend", "tau_tors")
        return {name: dict(zip(keys, (*k[name], *tau[name]), strict=True)) for name in self.joints}


def _wrong_pairs(given: Mapping[str, Pair], names: list[str], what: str) -> Iterator[Problem]:
    """Yield missing, unknown and out-of-range pairs of joints."""
    for name in names:
        if name not in given:
            yield Problem(f"joint {name}", f"no {what}", "a pair (bending, torsion)", f"add its {what}")
    for name, pair in given.items():
        if name not in names:
            remedy = did_you_mean(name, names, "leave it out")
            yield Problem(f"{what} of {name}", "no such joint", f"one of {', '.join(names)}", remedy)
        elif not _in_range(pair, what):
            least = "> 0 N m/rad" if what == "stiffness" else ">= 0 s"
            yield Problem(f"joint {name}", f"{what} {pair}", f"two numbers {least}", "correct it")


def _in_range(pair: Any, what: str) -> bool:
    try:
        numbers = np.asarray(pair, dtype=float)
    except (TypeError, ValueError):
        return False
    least = np.finfo(float).tiny if what == "stiffness" else 0.0
    return numbers.shape == (2,) and bool(np.all(np.isfinite(numbers) & (numbers >= least)))


# -------- Joints file
# The completion of a robot description: `robot.joints.toml` in its folder, with the bushing of each joint.
#
# Each number is written as in `arm.toml`, with unit and origin.

SUFFIX = ".joints.toml"


class JointsDocument(Damped):
    """The content of such a file."""

    format: Literal["ident-joints/1"]
    tip: str | None = None
    joint: Annotated[list[BushingTable], Field(min_length=1)]
    point: list[PointTable] = Field(default_factory=list)
    payload: list[PayloadTable] = Field(default_factory=list)


@dataclass(frozen=True)
class JointsFile:
    """Source of a robot's bushings.

    Attributes:
        path: the file, as given.
        sha256: hexadecimal digest of the file's bytes.
    """

    path: str
    sha256: str


def beside(path: str) -> Path:
    """Return the path of a robot's bushings: `robot.joints.toml` in the folder of `robot.urdf`."""
    return Path(path).with_suffix(SUFFIX)


def read_joints(path: Path) -> tuple[JointsFile, JointsDocument, Source]:
    """Return the bushings of a robot's joints, and their text.

    Raises:
        InputError: the file is unreadable or has errors; all are listed.
    """
    where = one_line(str(path))
    data = read_bytes(path, "the bushings of a robot (TOML)")
    text = decode(data, where)
    source = Source(where, text, load_toml(text, where), JointsDocument)
    document, problems = source.read()
    refuse(problems)
    return JointsFile(str(path), hashlib.sha256(data).hexdigest()), document, source


def check_joints(document: JointsDocument, robot: Robot, source: Source) -> None:
    """Refuse bushings that do not match a robot's joints.

    Raises:
        InputError: unknown or missing joints; all are listed.
    """
    named, known = [table.name for table in document.joint], robot.joints
    got, expected = f"no such joint in {robot.where}", f"one of {', '.join(known)}"
    problems = [
        source.problem(("joint", n, "name"), got, expected, did_you_mean(name, known, "remove it"))
        for n, name in enumerate(named)
        if name not in known
    ]
    missing = [name for name in known if name not in named]
    if missing:
        got, remedy = f"no joint {', '.join(missing)}", "add a table [[joint]] for each"
        problems.append(source.problem((), got, f"all joints of {robot.where}", remedy))
    refuse(problems)


def joints_text(text: str, before: Arm, arm: Arm, origin: Origin, where: str) -> str:
    """Return the text of such a file with the numbers of another arm, and their origin; comments, units, layout stay.

    Omits numbers that the robot description has, and adds numbers that the file lacks.

    Args:
        text: a valid file.
        before: the arm of this file and its robot description.
        arm: the arm for the new file; an elastic base is its first joint, of the origin `assumed` unless fitted.
        origin: the new origin of these numbers.
        where: names the text in errors.
    """
    if arm.base is not None and before.base is None:
        before = on_soft_base(before, float(arm.joints[1].offset[2]))
        text = with_first("joint", text, bushing_text(before.joints[0], "assumed"), where)
    document: Any = tomlkit.parse(text)
    joints = {str(table["name"]): table for table in document["joint"]}
    others = {str(table["name"]): table for kind in ("point", "payload") for table in document.get(kind, ())}
    own = {}
    for path, value in changed_numbers(before, arm).items():
        name, field, *_ = path.split(".")
        if path != ALPHA and name not in others and not (name in joints and field in BUSHING):
            continue
        own[path] = value
    place_damping(document, joints, arm, own)
    set_numbers(joints | others | {"damping": document.get("damping", {})}, own, origin, where)
    written = JointsDocument.model_validate(load_toml(tomlkit.dumps(document), where))
    payloads = tuple(Payload(each.joint, each.body()) for each in written.payload)
    set_inertias(others, eqx.tree_at(lambda arm: arm.payloads, before, payloads), arm, origin)
    JointsDocument.model_validate(load_toml(updated := tomlkit.dumps(document), where))
    return updated
