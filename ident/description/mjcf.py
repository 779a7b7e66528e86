"""Import of a serial arm from MJCF, read and placed by MuJoCo itself; its bushings are not in the file.

Positions are MuJoCo's own, at zero posture: every hinge at MuJoCo's angle 0.
"""

import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import repeat
from os import PathLike
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
from jaxtyping import Float

from ident.arm.arm import Arm, check_size
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
    own_name,
    own_names,
    renamed_note,
    serial_chain,
    unclear_branch,
)
from ident.errors import InputError, Problem, placed, refusal, refuse, require
from ident.text import NAME_RULE, by_key, one_line, read_bytes

ENDS = ("tors", "bend_1", "bend_2")
"""Suffixes of a bushing's hinges: about the joint's axis, and about two directions across it."""
PLACED = {"body", "inertial", "joint", "frame", "site", "geom", "option", "compiler", "mesh", "replicate"}
NUMBERS = {"pos", "quat", "axis", "axisangle", "xyaxes", "zaxis", "euler", "fromto", "size", "mass", "density", "ref"}
NUMBERS |= {"diaginertia", "fullinertia", "gravity", "scale", "offset", "boundmass", "boundinertia", "settotalmass"}
"""Elements and attributes with masses and their positions."""


def read_mjcf(
    path: str | PathLike[str], *, stiffness: Pairs, damping: Pairs = (0.0, 0.0), tip: str | None = None
) -> Arm:
    """Return a serial arm from an MJCF file.

    Hinges become driven joints with an empty shaft, except those of bushings from `ident export`; three of these
    without a driven hinge are an undriven joint. Bodies welded to one another are one link. Joints off the way to the
    tip, such as those of a gripper, are held at zero, and their bodies belong to the link before them; `ident.read_arm`
    lists them. MuJoCo's world frame is the base frame; everything fixed to it is omitted. Stiffness, damping, friction
    and armature of a hinge belong to its motor, which holds the joint, and are ignored. Geoms are read only where a
    body's inertia follows from them.

    Args:
        path: the MJCF file.
        stiffness: (k_bend, k_tors) [N m/rad] of every joint by name, or one pair for all.
        damping: (tau_bend, tau_tors) [s] of every joint by name, or one pair for all.
        tip: body or site at the end of the arm, whose origin becomes the point `tip`; by default the only site of the
            last link, otherwise the origin of its body. For several arms it selects one.

    Raises:
        InputError: the file is not MJCF, the robot is not a serial arm of hinges, or a joint lacks a value.
    """
    read_bytes(path, "a robot description (MJCF)")
    robot = mjcf_robot(str(path), tip)
    return robot.arm(robot.bushings(stiffness, damping))


def mjcf_robot(path: str, tip: str | None = None) -> Robot:
    """Return the robot of an MJCF file.

    Args:
        path: the file.
        tip: the body or site at the end of the arm; None for the end of the chain.

    Raises:
        InputError: MuJoCo is not installed or can't read the file, or the robot is not a serial arm of hinges.
    """
    where = one_line(path)
    model, data, ties = at_zero(path, where)
    tip = tip and own_name(tip)
    tree = _Tree.of(model, ties, tip, where, data.qpos)
    check_size(len(tree.joints), where)
    names = body_names(names_of_bodies(model), map(tree.name, tree.joints), "body")
    pins, place, notes = [], np.zeros(3), [*ties.renamed, *tree.notes(names)]
    for link in tree.links:
        for joint in link:
            bodies = tuple(_bodies(tree, data, joint, names)) if joint == link[-1] else ()
            pins.append(_pin(tree, data, joint, bodies, place))
            place = data.xanchor[joint]
    name = one_line(model.names.split(b"\0", 1)[0].decode("utf-8", "replace")) or "arm"
    return Robot(name, where, tuple(pins), tree.point(data, tip), model.opt.gravity.copy(), tuple(notes))


def load_spec(path: str, where: str) -> Any:
    """Return MuJoCo's specification of a file, which can be changed before compilation.

    Raises:
        InputError: MuJoCo is not installed, or can't read the file.
    """
    try:
        import mujoco
    except ImportError:
        got, remedy = "an MJCF file without the package mujoco", "pip install mujoco"
        raise refusal(where, got, "mujoco to read it", remedy) from None
    with _silent():
        try:
            return mujoco.MjSpec.from_file(path)
        except ValueError as error:
            raise _unread(where, error) from None


def compiled(spec: Any, where: str) -> Any:
    """Return the model of a specification.

    Raises:
        InputError: MuJoCo refuses it.
    """
    light = [body.name for body in spec.bodies if body.joints and not _is_heavy(body)]
    with _silent():
        try:
            return spec.compile()
        except ValueError as error:
            if light and "mjMINVAL" in str(error):
                got, expected = f"no mass, or no inertia, on {listed(light)}", "both on every moving body"
                raise refusal(where, got, expected, "give each an <inertial> with mass and diaginertia") from None
            raise _unread(where, error) from None


def _is_heavy(body: Any) -> bool:
    """Whether a body, or another body fixed to it, has mass and inertia."""
    if body.explicitinertial:
        own = body.mass > 0 and bool(np.nansum(np.abs([*body.inertia, *body.fullinertia])) > 0)
    else:
        own = bool(body.geoms)
    return own or any(_is_heavy(each) for each in body.bodies if not each.joints)


@contextmanager
def _silent() -> Iterator[None]:
    """Keep MuJoCo's warnings off the terminal, and its log file out of the user's folder."""
    import mujoco

    before = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(lambda message: None)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    finally:
        mujoco.set_mju_user_warning(before)


def _unread(where: str, error: ValueError) -> InputError:
    said = " ".join(str(error).split())
    return refusal(where, f"a model that MuJoCo can't read ({said})", "a valid MJCF", "correct it")


def at_zero(path: str, where: str) -> tuple[Any, Any, "Ties"]:
    """Return the model, its data at zero posture, and its equality constraints; shapes are dropped where possible.

    Raises:
        InputError: MuJoCo is not installed or can't read the file, or a number in it is impossible for a robot.
    """
    spec = load_spec(path, where)
    import mujoco

    refuse(_not_sane(Path(path), where))
    refuse(_wrong_numbers(spec, where))
    ties = Ties.of(spec, where)
    _drop_shapes(spec)
    model = compiled(spec, where)
    data = mujoco.MjData(model)
    scalar = np.isin(model.jnt_type, (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE))
    data.qpos[model.jnt_qposadr[scalar]] = 0
    for name, leader in ties.joints.items():  # where they are while the others are at zero
        own, other = (model.jnt_qposadr[model.joint(each).id] for each in (name, leader or name))
        by = ties.polynomials[name](data.qpos[other] - model.qpos0[other]) if leader else ties.polynomials[name](0.0)
        data.qpos[own] = model.qpos0[own] + by
    with _silent():
        mujoco.mj_kinematics(model, data)
    for body in range(1, model.nbody):
        numbers = (model.body_mass[body], *model.body_inertia[body], *data.xpos[body], *data.ximat[body])
        finite, place = np.isfinite([*numbers, *data.xipos[body]]).all(), f"{where}, body {_body_name(model, body)}"
        require(finite, place, "a place or inertia that is not finite", "finite numbers", "correct it")
    return model, data, ties


@dataclass(frozen=True)
class Ties:
    """The equality constraints of a file, and joint ranges of zero width.

    Attributes:
        joints: following joints by name, with their leader; empty for a constant position.
        polynomials: of the followers, in the leader's position.
        bodies: pairs of tied bodies or sites, by name, and whether they are sites.
        others: joints of a constraint of another kind; None if unknown.
        ranges: equal limits of joints, by name.
        renamed: the note on changed names.
    """

    joints: Mapping[str, str]
    polynomials: Mapping[str, Any]
    bodies: Sequence[tuple[str, str, bool]]
    others: Sequence[frozenset[str] | None]
    ranges: Mapping[str, str]
    renamed: tuple[str, ...]

    @classmethod
    def of(cls, spec: Any, where: str) -> "Ties":
        """Return the constraints of a specification; remove them from it, with equal limits and invalid names."""
        import mujoco

        parts = [*spec.bodies[1:], *spec.joints, *spec.sites]
        renamed = own_names((part.name for part in parts), where)[1]
        kinds, joints, polynomials, bodies, others = mujoco.mjtEq, dict[str, str](), {}, [], []
        for each in list(spec.equalities):
            if not each.active:
                pass
            elif each.type == kinds.mjEQ_JOINT:
                joints[own_name(each.name1)] = own_name(each.name2)
                polynomials[own_name(each.name1)] = np.polynomial.Polynomial(np.array(each.data[:5]))
            elif each.type in (kinds.mjEQ_CONNECT, kinds.mjEQ_WELD):
                names = own_name(each.name1), own_name(each.name2)
                bodies.append((*names, each.objtype == mujoco.mjtObj.mjOBJ_SITE))
            elif each.type == kinds.mjEQ_TENDON:
                wraps = [wrap for t in spec.tendons if t.name in (each.name1, each.name2) for wrap in t.path]
                fixed = all(wrap.type == mujoco.mjtWrap.mjWRAP_JOINT for wrap in wraps)
                others.append(frozenset(own_name(wrap.target.name) for wrap in wraps) if fixed else None)
            else:
                others.append(None)
            spec.delete(each)
        # elements that refer to them by name do not matter for an arm at rest
        users = spec.actuators, spec.sensors, spec.tendons, spec.pairs, spec.excludes, spec.keys, spec.skins
        for user in [each for kind in (*users, spec.cameras, spec.lights) for each in kind]:
            spec.delete(user)
        for part in parts:
            part.name = own_name(part.name)
        ranges = {}
        for joint in spec.joints:
            low, high = joint.range
            if low == high and (low != 0 or joint.limited == mujoco.mjtLimited.mjLIMITED_TRUE):
                ranges[joint.name], joint.limited = f"range {low:g}, {high:g}", mujoco.mjtLimited.mjLIMITED_FALSE
        return cls(joints, polynomials, bodies, others, ranges, renamed)


def _wrong_numbers(spec: Any, where: str) -> Iterator[Problem]:
    """Yield wrong numbers that MuJoCo ignores silently."""
    for body in spec.bodies:
        if body.explicitinertial and not body.mass >= 0:
            yield Problem(f"{where}, body {body.name}", f"mass {body.mass:g}", "a mass >= 0 kg", "correct it")
    for joint in spec.joints:
        low, high = joint.range
        if not low <= high:
            got = f"range {low:g}, {high:g}"
            yield Problem(f"{where}, joint {joint.name}", got, "lower <= upper", "swap or correct them")


def _not_sane(path: Path, where: str) -> Iterator[Problem]:
    """Yield infinite, nan or absurdly large numbers of the text: MuJoCo treats nan as missing."""
    try:
        root = ElementTree.fromstring(path.read_bytes())
    except (OSError, ValueError, LookupError, ElementTree.ParseError):
        return  # MuJoCo could read it
    stack = [(root, "")]
    while stack:
        element, body = stack.pop()
        if element.tag == "include" and (file := element.get("file")):
            yield from _not_sane(path.parent / file, where)
        body = element.get("name", body) if element.tag == "body" else body
        for key in sorted(NUMBERS & element.attrib.keys()) if element.tag in PLACED else ():
            if not all(map(is_sane, element.attrib[key].split())):
                place = f"{where}, body {body}" if body else where
                yield Problem(place, f'{key}="{element.attrib[key]}"', "finite numbers", "correct it", element.tag)
        stack += [(child, body) for child in reversed(element)]


def _drop_shapes(spec: Any) -> None:
    """Remove geoms without mass on moving bodies, and unused meshes, so that their files are not needed."""
    import mujoco

    given = spec.compiler.inertiafromgeom != mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_TRUE
    low, high = spec.compiler.inertiagrouprange
    for geom in list(spec.geoms):
        weighs = geom.mass != 0 and geom.density != 0 and low <= geom.group <= high  # of no mass of its own: nan
        if not weighs or (given and geom.parent.explicitinertial) or not _moves(geom.parent):
            spec.delete(geom)
    for shown in (*spec.geoms, *spec.sites):
        shown.material = ""
    used = {geom.meshname for geom in spec.geoms}
    for mesh in [each for each in spec.meshes if each.name not in used]:
        spec.delete(mesh)
    for unused in (*spec.materials, *spec.textures):
        spec.delete(unused)


def _moves(body: Any) -> bool:
    return body.name != "world" and (bool(body.joints) or _moves(body.parent))


@dataclass(frozen=True)
class _Tree:
    """The bodies of a model, and the joints of the arm.

    Attributes:
        model: MuJoCo's model.
        where: names the file in errors.
        links: the joints of each moving link, from the base outwards.
        owner: for each body the link's body with which it moves, by number; 0 for the base.
        held: joints that are not the arm's.
        ties: equality constraints.
        places: MuJoCo's qpos at zero posture.
    """

    model: Any
    where: str
    links: list[list[int]]
    owner: list[int]
    held: list[int]
    ties: Ties
    places: Any

    @classmethod
    def of(cls, model: Any, ties: Ties, tip: str | None, where: str, places: Any) -> "_Tree":
        """Return the arm of a model.

        Raises:
            InputError: no arm or several, no such tip, a joint of the arm does not turn on its own, or a bad name.
        """
        import mujoco

        bushings = _passed_over(model)
        own = [n for n in range(model.njnt) if model.joint(n).name not in bushings]
        joints = by_key((int(model.jnt_bodyid[n]), n) for n in own)
        mover, after = [0], {0: list[int](), **{body: [] for body in joints}}
        for body in range(1, model.nbody):
            before = mover[model.body_parentid[body]]
            mover.append(body if body in joints else before)
            if body in joints:
                after[before].append(body)

        def turns(body: int) -> bool:
            hinges = (model.jnt_type[n] == mujoco.mjtJoint.mjJNT_HINGE for n in joints[body])
            return all(hinges) and not any(model.joint(n).name in ties.joints for n in joints[body])

        def is_followed(body: int) -> bool:
            return any(model.joint(n).name in ties.joints.values() for n in joints[body])

        frames = {str(model.site(n).name): int(model.site_bodyid[n]) for n in range(model.nsite) if model.site(n).name}
        frames |= {_body_name(model, n): n for n in range(1, model.nbody)}
        end = carrier(tip, {name: mover[body] for name, body in frames.items() if mover[body]}, where, "body or site")
        kept, unclear = serial_chain(after, 0, end, turns, is_followed)
        if unclear:
            first = (_joint_name(model, joints[body][0]) for body, _ in unclear)
            raise unclear_branch(where, first, (_body_name(model, body) for _, body in unclear))
        owner = [0]
        for body in range(1, model.nbody):
            owner.append(body if body in kept else owner[model.body_parentid[body]])
        held = [n for body in joints if body not in kept for n in joints[body]]
        tree = cls(model, where, [joints[body] for body in kept], owner, held, ties, places)
        tree._check_types()
        return tree

    @property
    def joints(self) -> list[int]:
        """The joints of the arm, from the base outwards."""
        return [joint for link in self.links for joint in link]

    def name(self, joint: int) -> str:
        """Return the name of a joint."""
        return _joint_name(self.model, joint)

    def carried(self, body: int) -> list[int]:
        """Return a link's body and the bodies that move with it."""
        return [n for n in range(1, self.model.nbody) if self.owner[n] == body]

    def point(self, data: Any, tip: str | None) -> Point:
        """Return the end point: the named one, or the only site of the last link, or its body."""
        model, last = self.model, int(self.model.jnt_bodyid[self.links[-1][-1]])
        holders = model.body_weldid[model.site_bodyid]
        sites = [n for n in range(model.nsite) if holders[n] == last and model.site(n).name]
        body, place = last, data.site_xpos[sites[0]] if len(sites) == 1 else data.xpos[last]
        if tip is not None:
            body, place = _frame(model, data, tip)
        joint = next(link[-1] for link in self.links if model.jnt_bodyid[link[-1]] == self.owner[body])
        return Point(TIP, self.name(joint), place - data.xanchor[joint])

    def notes(self, names: Mapping[str, str]) -> Iterator[str]:
        """Yield the differences between arm and file."""
        model, own = self.model, set(map(self.name, self.joints))
        whole = float(sum(model.body_mass[n] for n in range(1, model.nbody) if self.owner[n]))
        for body in (0, *(int(model.jnt_bodyid[link[-1]]) for link in self.links)):
            held = [n for n in self.held if self.owner[model.jnt_bodyid[n]] == body]
            if held:
                others = [n for n in self.carried(body) if model.body_weldid[n] != body] if body else []
                mass = float(sum(model.body_mass[n] for n in others))
                last = next((link[-1] for link in self.links if model.jnt_bodyid[link[-1]] == body), None)
                beside = "" if last is None else self.name(last)
                yield held_note(self.where, list(map(self._told, held)), (mass, whole), beside, own)
        for n in range(1, model.nbody):
            name = _body_name(model, n)
            if names[name] != name and model.body_mass[n] > 0 and self.owner[n]:
                yield renamed_note(self.where, "body", name, names[name])
        joints, ranges = map(self.name, self.joints), self.ties.ranges
        yield from (limits_note(self.where, name, ranges[name]) for name in joints if name in ranges)

    def _told(self, joint: int) -> Held:
        name = self.name(joint)
        shown = name or f"of body {_body_name(self.model, int(self.model.jnt_bodyid[joint]))}"
        at = self.places[self.model.jnt_qposadr[joint]] if name in self.ties.joints else 0.0
        return Held(shown, _type(self.model, joint), self.ties.joints.get(name, ""), float(at))

    def _check_types(self) -> None:
        """Refuse an arm without joints, joints that ident cannot model, and constraints on the arm."""
        import mujoco

        model, where, ties = self.model, self.where, self.ties
        others = listed(str(self._told(each)) for each in self.held)
        got = f"no hinge that turns on its own, but {others}" if others else "no moving joint"
        require(self.links, where, got, "a hinge", "check the joints of the bodies")
        own = {str(model.joint(n).name) for n in self.joints}
        tied = bool(ties.joints.keys() & own) or any(each is None or each & own for each in ties.others)
        for one, other, are_sites in ties.bodies:
            bodies = [self._body(name, is_site=are_sites) for name in (one, other)]
            tied = tied or self.owner[bodies[0]] != self.owner[bodies[1]]
        expected, remedy = "a serial arm whose hinges turn on their own", "remove it, and what it ties to the arm"
        require(not tied, where, "an equality constraint", expected, remedy)
        remedy = "fix this joint, or let the arm end before it (tip)"
        for joint in self.joints:
            place = f"{where}, body {_body_name(model, int(model.jnt_bodyid[joint]))}"
            require(self.name(joint), place, "a joint without a name", NAME_RULE, "name it")
            place, is_hinge = f"{where}, joint {self.name(joint)}", model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_HINGE
            require(is_hinge, place, f"type {_type(model, joint)}", "a hinge", remedy)

    def _body(self, name: str, *, is_site: bool) -> int:
        if not name:
            return 0
        return int(self.model.site_bodyid[self.model.site(name).id] if is_site else self.model.body(name).id)


def _type(model: Any, joint: int) -> str:
    import mujoco

    return str(mujoco.mjtJoint(model.jnt_type[joint]).name.removeprefix("mjJNT_").lower())


def _frame(model: Any, data: Any, tip: str) -> tuple[int, Any]:
    """Return a body, or the body that carries a site, and the origin of the frame."""
    names = names_of_bodies(model)
    if tip in names:
        return names.index(tip) + 1, data.xpos[names.index(tip) + 1]
    site = model.site(tip).id
    return int(model.site_bodyid[site]), data.site_xpos[site]


def _passed_over(model: Any) -> set[str]:
    """Return the hinge names of bushings written by `ident export`; for a bushing without a pin all but one."""
    names = [str(model.joint(joint).name) for joint in range(model.njnt)]
    own = {f"{name}_{end}" for name in names for end in ENDS}
    return own | {f"{name}_{end}" for name in map(_undriven, names, repeat(set(names))) for end in ENDS[1:] if name}


def _undriven(name: str, names: set[str]) -> str:
    """Return the name of the bushing without a pin whose axial hinge this is; empty for any other hinge."""
    stem = name.removesuffix(f"_{ENDS[0]}")
    return stem if stem != name and stem not in names and {f"{stem}_{end}" for end in ENDS} <= names else ""


def _pin(tree: _Tree, data: Any, joint: int, bodies: tuple[Body, ...], place: Any) -> Pin:
    model = tree.model
    lower, upper = model.jnt_range[joint] if model.jnt_limited[joint] else (-np.inf, np.inf)
    axis, anchor, name = data.xaxis[joint].copy(), data.xanchor[joint], tree.name(joint)
    driven = name == model.joint(joint).name
    limits = (float(lower), float(upper)) if driven else (-np.inf, np.inf)
    carrier = f"body {_body_name(model, int(model.jnt_bodyid[joint]))}"
    return Pin(name, axis, anchor - place, bodies, limits, driven, carrier)


def _bodies(tree: _Tree, data: Any, joint: int, names: Mapping[str, str]) -> Iterator[Body]:
    """Yield the bodies that turn with a joint, in axes parallel to the base's."""
    model = tree.model
    for body in tree.carried(int(model.jnt_bodyid[joint])):
        if model.body_mass[body] == 0:
            continue
        turn = data.ximat[body].reshape(3, 3)
        inertia = turn @ np.diag(model.body_inertia[body]) @ turn.T
        com, name = data.xipos[body] - data.xanchor[joint], _body_name(model, body)
        with placed(f"{tree.where}, body {name}"):
            yield Body(names[name], model.body_mass[body], com, (inertia + inertia.T) / 2)


def names_of_bodies(model: Any) -> list[str]:
    """Return the names of all bodies but the world, in their order."""
    return [_body_name(model, n) for n in range(1, model.nbody)]


def _joint_name(model: Any, joint: int) -> str:
    """Return the name of a joint; for the axial hinge of a bushing without a pin, the bushing's name."""
    name = str(model.joint(joint).name)
    return _undriven(name, {str(model.joint(n).name) for n in range(model.njnt)}) or name


def _body_name(model: Any, body: int) -> str:
    """Return the name of a body; its number if it has no name."""
    return str(model.body(body).name) or f"body{body}"


# -------- Tree of an MJCF file
# The elements of an MJCF file, changed in place and otherwise written unchanged.
#
# MuJoCo writes six digits, which would shift natural frequencies by 1e-6; so the text of the file is edited instead.

Vector = Float[np.ndarray, "3"]


@dataclass(frozen=True)
class Tree:
    """The elements of a file, and MuJoCo's model of it.

    Attributes:
        root: the outermost element; included files stand in their places.
        model: MuJoCo's model.
        data: positions and axes at zero posture.
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
        """Return the path to an element: the bodies and frames around it, outermost first, then the element.

        Raises:
            InputError: MuJoCo has it, but the file has no element for it.
        """
        for world in self.root.iter("worldbody"):
            if found := _path(world, lambda each: each.tag == tag and own_name(each.get("name", "")) == name):
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
        """Return the body that holds an element, and its child: the element, or the frame around it.

        Args:
            path: to the element.
            others: tags not allowed in such a frame in addition to the element.

        Raises:
            InputError: the frame holds such an element, so that an edit would affect both.
        """
        place = len(path) - 2
        while path[place].tag == "frame":
            place -= 1
        held = path[place + 1]
        unwanted = {id(each) for tag in others for each in held.iter(tag)} - {id(each) for each in path[-1].iter()}
        tag, name = path[-1].tag, path[-1].get("name", "")
        where, expected = f"{self.where}, {tag} {name}", f"a <frame> about this {tag} alone"
        require(not unwanted, where, "a <frame> with more in it", expected, "write it without that frame")
        return path[place], held


def tree_of(path: str, where: str) -> Tree:
    """Return the elements of an MJCF file, and MuJoCo's model of it.

    Raises:
        InputError: MuJoCo is not installed, or can't read the file.
    """
    model, data, _ = at_zero(path, where)
    return Tree(_elements(Path(path)), model, data, where)


def wrapped(holder: Any, held: Any, wrapper: Any) -> None:
    """Wrap an element in another one, at the same place."""
    place = list(holder).index(held)
    wrapper.tail, held.tail = held.tail, None
    holder[place] = wrapper
    wrapper.append(held)


def numbers(values: Iterable[Any]) -> str:
    """Return numbers as text for an attribute, with all digits."""
    return " ".join(repr(float(x)) for x in values)


def own_masses(path: str, where: str) -> None:
    """Refuse a file with settings that override the masses of its bodies.

    Raises:
        InputError: the file has such a setting.
    """
    import mujoco

    compiler, by_geom = load_spec(path, where).compiler, mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_TRUE
    got, remedy = "masses by inertiafromgeom or settotalmass", "drop that, or write .toml or .json"
    own = compiler.inertiafromgeom != by_geom and compiler.settotalmass <= 0
    require(own, f"{where}, compiler", got, "masses that the bodies have themselves", remedy)


def _path(element: Any, wanted: Callable[[Any], bool]) -> list[Any]:
    if wanted(element):
        return [element]
    for child in element:
        if found := _path(child, wanted):
            return [element, *found]
    return []


def _elements(path: Path) -> Any:
    """Return the outermost element of a file, with included files inserted at their places."""
    parser = ElementTree.XMLParser(target=ElementTree.TreeBuilder(insert_comments=True))
    root = ElementTree.fromstring(path.read_bytes(), parser)
    for parent in list(root.iter()):
        for place, child in reversed(list(enumerate(parent))):
            if child.tag == "include":
                parent[place : place + 1] = list(_elements(path.parent / child.attrib["file"]))
    return root
