"""MJCF with the bushings of an arm: three passive hinges before each driven one, in the body that it moves.

Stiffness on the driven hinge itself would pull the motor's axis back to zero. An elastic base consists of such hinges
only, in a body around the whole arm.

Three hinges in series are not exactly the rotation vector of ident's bushing. Natural frequencies agree for an unloaded
arm; under weight their relative error is below the deflection angle [rad] of a bushing. At a single posture they agree
under weight too, with the tangent springs of that posture.
"""

from collections.abc import Iterator, Mapping
from typing import Any
from xml.etree import ElementTree
from xml.parsers import expat

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ident.arm.arm import Arm, on_soft_base
from ident.arm.chain import at_posture
from ident.arm.fields import ALPHA, LOSS
from ident.arm.mechanics import equilibrium
from ident.arm.parts import Body, Joint
from ident.arm.rotations import matmul, rotation, rotation_vector
from ident.description.mjcf import ENDS, Tree, names_of_bodies, numbers, own_masses, tree_of, wrapped
from ident.description.rewriting import changed_bodies, changed_numbers
from ident.description.robot import body_names
from ident.errors import refusal, require
from ident.programs import jit
from ident.text import one_line, read_bytes

# -------- Tangents for MJCF
# Springs that MuJoCo's hinges have in place of a bushing about one working point, exact there.
#
# The energy of a bushing, phi' K phi / 2 of its rotation vector, has in the angles x of three hinges one after
# another terms of third order, k_tors x_1 x_2 x_3 / 2 first, which no stiffness of theirs has. About the equilibrium
# of one posture it is g'd + d'H d / 2: three springs along the eigenvectors of H, each a tendon over the three
# hinges.

STEPS = 8
"""Of Newton's method from a rotation vector to the angles of three hinges, which are equal but for its square."""


def tendons(turns: Mapping[str, Any], arm: Arm, posture: tuple[float, ...]) -> Any:
    """Return tendons over the hinges of all bushings that are tangent to them where the arm's weight holds a posture.

    Args:
        turns: (3, 3) axes of each joint's hinges, columns, in the base frame at zero posture, by the joint's name.
        arm: the arm.
        posture: [rad] of its driven joints.

    Raises:
        InputError: the arm has no stable equilibrium there.
    """
    phi, frame = (np.asarray(x) for x in _working_point(arm, jnp.asarray(posture)))
    got, expected = "no stable equilibrium under the arm's weight", "a posture in which the arm stands"
    require(np.isfinite(phi).all(), "posture", got, expected, "choose another one")
    section = ElementTree.Element("tendon")
    for n, joint in enumerate(arm.joints):
        if joint.k_bend is None or joint.k_tors is None:
            got, remedy = f"springs tangent at a posture, and {joint.name} rigid", "leave the posture out"
            raise refusal("posture", got, "stiffnesses at every joint", remedy)
        k = np.array([joint.k_tors, joint.k_bend, joint.k_bend])
        own = turns[joint.name].T @ frame[:, :, n].T @ phi[:, n]
        at = own.copy()  # the angles of the hinges there
        for _ in range(STEPS):
            vector, by_angles = (np.asarray(x) for x in _vector_and_slope(jnp.asarray(at)))
            at = at - np.linalg.solve(by_angles, vector - own)
        slope, stiffness = (np.asarray(x) for x in _derivatives(jnp.asarray(at), jnp.asarray(k)))
        values, ways = np.linalg.eigh(stiffness)
        for place, (value, way) in enumerate(zip(values, ways.T, strict=True), 1):
            spring = {"stiffness": numbers([value]), "springlength": numbers([way @ at - way @ slope / value])}
            name = f"{joint.name}_tangent_{place}"
            tendon = ElementTree.SubElement(section, "fixed", {"name": name, **spring, **PLAIN})
            for end, share in zip(ENDS, way, strict=True):
                coef = numbers([share])
                ElementTree.SubElement(tendon, "joint", {"joint": f"{joint.name}_{end}", "coef": coef})
    return section


PLAIN = {"damping": "0", "frictionloss": "0", "armature": "0", "limited": "false", "actuatorfrclimited": "false"}
"""What such a tendon has none of, whatever the file's defaults for tendons are."""


def _vector(angles: Float[Array, "3"]) -> Float[Array, "3"]:
    """Return the rotation vector of three turns one after another, in the axes of the first, second and third."""
    one, two, three = (rotation(angle * jnp.eye(3)[n]) for n, angle in enumerate(angles))
    return rotation_vector(matmul(matmul(one, two), three))


def _energy(angles: Float[Array, "3"], k: Float[Array, "3"]) -> Float[Array, ""]:
    return (k * _vector(angles) ** 2).sum() / 2


_vector_and_slope = jit(lambda angles: (_vector(angles), jax.jacfwd(_vector)(angles)))
_derivatives = jit(lambda angles, k: (jax.grad(_energy)(angles, k), jax.hessian(_energy)(angles, k)))


@jit
def _working_point(arm: Arm, posture: Float[Array, "driven"]) -> tuple[Float[Array, "3 N"], Float[Array, "3 3 N"]]:
    """Return the rotation vectors of the bushings, and the axes of the shafts, in the base frame."""
    chain = at_posture(arm, posture)
    return equilibrium(chain), chain.frame


# -------- XML
# XML as text that stays as written, except for insertions.


def with_comment(data: bytes, lines: list[str]) -> bytes:
    """Return an XML file, which is well formed, with a comment before its root element."""
    start = root_start(data)
    return data[:start] + comment(lines) + data[start:]


def root_start(data: bytes) -> int:
    """Return at which byte the root element of a well-formed XML file starts."""
    starts: list[int] = []
    parser = expat.ParserCreate()
    parser.StartElementHandler = lambda name, attributes: starts.append(parser.CurrentByteIndex)
    parser.Parse(data, True)
    return starts[0]


def comment(lines: list[str]) -> bytes:
    """Return lines as a comment; two dashes, which no comment may have, are set apart."""
    text = "\n".join(f"  {line}".rstrip() for line in lines)
    while "--" in text:
        text = text.replace("--", "- -")
    return f"<!--\n{text}\n-->\n".encode()


# -------- Writing MJCF

HINGE_DEFAULTS = {"type": "hinge", "armature": "0", "frictionloss": "0", "limited": "false"}
HINGE_DEFAULTS |= {"actuatorfrclimited": "false", "ref": "0", "springref": "0", "springdamper": "0 0"}
"""What such a hinge has none of, whatever the file's defaults for joints are."""


def mjcf_with_bushings(
    path: str, before: Arm, arm: Arm, lines: list[str], posture: tuple[float, ...] | None = None
) -> bytes:
    """Return an MJCF file of another arm of the same parts, with its bushings, and a comment before it.

    A hinge of a bushing has the stiffness k [N m/rad] and the damping tau k [N m s/rad]; loss factors have no place
    there, which the comment says. Masses, mass centres, inertias and offsets that differ are written too. Included
    files are written in their places, keyframes get the angle 0 of each new hinge.

    Args:
        path: the file that the arm was read from.
        before: the arm that was read.
        arm: the arm, with the numbers that are written; it may stand on a base that gives.
        lines: the comment.
        posture: [rad] where tangent springs stand for the bushings.

    Raises:
        InputError: the file can no longer be read, has bushings already, or no place for the new elements.
    """
    where, data = one_line(path), read_bytes(path, "a robot description (MJCF)")
    tree, joints = tree_of(path, where), arm.joints[arm.base is not None :]
    _check_free(tree, arm)
    based = before if arm.base is None else on_soft_base(before, float(arm.joints[1].offset[2]))
    turns = {joint.name: _put_bushing(tree, joint, straight=posture is None) for joint in joints}
    _put_bodies(tree, path, before, arm)
    _put_offsets(tree, based, arm)
    if arm.base is not None:
        turns = {arm.base.name: _put_base(tree, arm, straight=posture is None)} | turns
    if posture is not None:
        tree.root.append(tendons(turns, arm, posture))
    added = {joint.name: "0 " * sum(1 for _ in _elastic_hinges(joint)) for joint in arm.joints}
    own = {joint.name for joint in before.joints}
    for key in tree.root.iter("key"):
        for name, starts in (("qpos", tree.model.jnt_qposadr), ("qvel", tree.model.jnt_dofadr)):
            if name in key.attrib:
                named = {int(start): tree.model.joint(n).name for n, start in enumerate(starts)}
                words = enumerate(key.attrib[name].split())
                each = " ".join(added.get(named.get(n, ""), "") * (named.get(n) in own) + word for n, word in words)
                key.set(name, each if arm.base is None else added[arm.base.name] + each)
    lost = [joint.name for joint in joints if any(float(getattr(joint, key) or 0.0) for key in LOSS)]
    lacking = [f"the loss factors of {', '.join(lost)}"] * bool(lost) + ["damping.alpha"] * bool(float(arm.get(ALPHA)))
    more = [f"Not in this file: {' and '.join(lacking)}. MuJoCo has none."] if lacking else []
    head = data[: root_start(data)] + comment([*lines, *more])
    return head + ElementTree.tostring(tree.root, encoding="utf-8") + b"\n"


def _check_free(tree: Tree, arm: Arm) -> None:
    """Refuse a file that has bushings already, or another body of the name that the base needs."""
    names = {tree.model.joint(n).name for n in range(tree.model.njnt)}
    taken = [name for joint in arm.joints for end in ENDS if (name := f"{joint.name}_{end}") in names]
    remedy = "write into the file without them (--arm)"
    require(not taken, tree.where, f"the hinge {''.join(taken[:1])}", "a robot without bushings", remedy)
    bodies = {tree.model.body(n).name for n in range(tree.model.nbody)}
    for body in arm.base.link if arm.base else ():
        got, expected = f"a body {body.name}", "that name for the base that gives"
        require(body.name not in bodies, tree.where, got, expected, "rename the body")


def _put_bushing(tree: Tree, joint: Joint, straight: bool) -> Any:
    """Put hinges before a driven one, and return their axes, columns, in the base frame at zero posture."""
    holder, held = tree.only(tree.path("joint", joint.name), ("joint", "freejoint", "body"))
    number, place = tree.model.joint(joint.name).id, list(holder).index(held)
    turn = _triad(np.array(tree.model.jnt_axis[number]))
    hinges = _hinges(joint, turn, tree.model.jnt_pos[number], straight)
    for hinge in hinges:
        hinge.tail = holder[place - 1].tail if place else holder.text
    holder[place:place] = hinges
    return tree.axes(tree.body_of(joint.name)) @ turn


def _put_base(tree: Tree, arm: Arm, straight: bool) -> Any:
    """Put the whole arm into a body on passive hinges, and return their axes in the base frame."""
    base, first = arm.joints[:2]
    holder, held = tree.only(tree.body_path(first.name), ("body", "geom", "site", "camera", "light"))
    number = tree.before(tree.body_of(first.name))
    axes, place = tree.axes(number), tree.place(number)
    turn, anchor = _triad(np.asarray(base.axis)), np.asarray(base.offset)
    (body,) = base.link
    wrapper = ElementTree.Element("body", {"name": body.name})
    wrapper.extend(_hinges(base, axes.T @ turn, axes.T @ (anchor - place), straight))
    wrapper.append(_inertial(body, axes, anchor - place))
    wrapped(holder, held, wrapper)
    return turn


def _put_bodies(tree: Tree, path: str, before: Arm, arm: Arm) -> None:
    """Write mass, mass centre and inertia of the bodies that differ."""
    changed = {body.name for joint in before.joints for body in joint.link}
    changed &= {body.name for body in changed_bodies(before, arm)}
    if changed:
        own_masses(path, tree.where)
    joints = [joint.name for joint in before.joints]
    written = {new: old for old, new in body_names(names_of_bodies(tree.model), joints, "body").items()}
    for joint in before.joints:
        own = {body.name: body for each in arm.joints if each.name == joint.name for body in each.link}
        for name in (body.name for body in joint.link if body.name in changed):
            element, number = tree.path("body", written[name])[-1], tree.model.body(written[name]).id
            anchor = np.array(tree.data.xanchor[tree.model.joint(joint.name).id])
            for old in element.findall("inertial"):
                element.remove(old)
            element.insert(0, _inertial(own[name], tree.axes(number), anchor - tree.place(number)))


def _put_offsets(tree: Tree, before: Arm, arm: Arm) -> None:
    """Move the bodies whose bushings have another offset."""
    changed, base = changed_numbers(before, arm), before.joints[0].name if before.base is not None else ""
    ways = {
        joint.name: np.array([changed.get(path := f"{joint.name}.offset.{axis}", before.get(path)) for axis in "xyz"])
        - np.asarray(joint.offset)
        for joint in before.joints
    }
    shift = ways.pop(base, np.zeros(3))  # the base's hinges use the fixed axes, and the arm moves with them
    for name, way in ways.items():
        way, shift = way + shift, np.zeros(3)
        if not way.any():
            continue
        body = tree.body_of(name)
        holder, held = tree.only(tree.body_path(name), ("body", "geom", "site", "camera", "light"))
        way = tree.axes(tree.before(body)).T @ way  # in the axes of the holder
        wrapped(holder, held, ElementTree.Element("frame", {"pos": numbers(way)}))


def _triad(axis: Any) -> Any:
    """Return right-handed axes, columns: of a pin, and two across it."""
    axis = axis / np.linalg.norm(axis)
    across = np.linalg.svd(axis[None])[2][1]
    return np.stack([axis, across, np.cross(axis, across)], 1)


def _hinges(joint: Joint, turn: Any, anchor: Any, straight: bool) -> list[Any]:
    """Return the hinges of a bushing, in the axes of its body."""
    hinges = []
    for n, k, tau in _elastic_hinges(joint):
        end, axis = ENDS[n], turn.T[n]
        own = {"axis": axis, "pos": anchor, "stiffness": [k if straight else 0.0], "damping": [k * tau]}
        written = {key: numbers(value) for key, value in own.items()}
        hinges.append(ElementTree.Element("joint", {"name": f"{joint.name}_{end}", **HINGE_DEFAULTS, **written}))
    return hinges


def _elastic_hinges(joint: Joint) -> Iterator[tuple[int, Any, Any]]:
    """Yield place, stiffness and damping time of a bushing's hinges, about its axis, twice across: of none rigid."""
    tors, bend = (joint.k_tors, joint.tau_tors), (joint.k_bend, joint.tau_bend)
    yield from ((n, k, tau) for n, (k, tau) in enumerate((tors, bend, bend)) if k is not None)


def _inertial(body: Body, axes: Any, anchor: Any) -> Any:
    """Return the mass of a body that hangs on an anchor, in the axes of its element [columns in the base frame]."""
    inertia = axes.T @ np.asarray(body.inertia) @ axes
    full = [inertia[i, k] for i, k in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))]
    place = axes.T @ (anchor + np.asarray(body.com))
    return ElementTree.Element(
        "inertial", {"mass": numbers([body.mass]), "pos": numbers(place), "fullinertia": numbers(full)}
    )
