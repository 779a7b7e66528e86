"""Import of a serial arm from MJCF, read and placed by MuJoCo itself; its bushings are not in the file.

All is taken at zero posture, every hinge at 0 as MuJoCo counts its angle, from MuJoCo's own kinematics.
"""

import re
from collections.abc import Iterator, Mapping
from itertools import repeat
from os import PathLike
from typing import Any

import numpy as np

from ident.arm.arm import Arm
from ident.arm.checks import check_size
from ident.arm.parts import Body
from ident.description.robot import Pair, Pin, Robot, refusal
from ident.errors import InputError, Problem
from ident.text import NAME, NAME_RULE, one_line, read_bytes

ENDS = ("tors", "bend_1", "bend_2")
"""How the hinges of a bushing are called, after the joint: about its axis, and about two directions across it."""


def read_mjcf(
    path: str | PathLike[str],
    *,
    stiffness: Mapping[str, Pair] | Pair,
    damping: Mapping[str, Pair] | Pair = (0.0, 0.0),
    tip: str | None = None,
) -> Arm:
    """Return a serial arm from an MJCF file.

    Hinges become driven joints with an empty shaft, but for those of bushings that `ident export` has written, of which
    three without a driven one are an undriven joint; bodies
    welded to one another are one link. MuJoCo's world frame is the base frame; what is fixed to it is left out. The
    stiffness, damping, friction and armature of a hinge are its motor's, which holds the joint, and are passed over.
    Geoms are read only where a body's inertia follows from them.

    Args:
        path: the MJCF file.
        stiffness: (k_bend, k_tors) [N m/rad] of every joint by name, or one pair for all.
        damping: (tau_bend, tau_tors) [s] of every joint by name, or one pair for all.
        tip: body or site whose origin becomes the point `tip`; by default the only site of the last link, else the
            origin of its body.

    Raises:
        InputError: the file is no MJCF, the robot no serial arm of hinges, or a joint lacks a value.
    """
    read_bytes(path, "a robot description (MJCF)")
    robot = mjcf_robot(str(path))
    return robot.arm(robot.bushings(stiffness, damping), tip)


def mjcf_robot(path: str) -> Robot:
    """Return the robot that an MJCF file describes.

    Raises:
        InputError: MuJoCo is not installed or can't read the file, or the robot is no serial arm of hinges.
    """
    where = one_line(path)
    model, data = placed(path, where)
    links = _links(model, where)
    check_size(sum(map(len, links)), where)
    pins, place = [], np.zeros(3)
    for link in links:
        for joint in link:
            last = joint == link[-1]
            bodies = tuple(_bodies(model, data, joint, where)) if last else ()
            pins.append(_pin(model, data, joint, bodies, place))
            place = data.xanchor[joint]
    name = one_line(mujoco_name(model)) or "arm"
    frames = dict(_frames(model, data, links))
    end = _end(model, links[-1][-1])
    return Robot(name, where, tuple(pins), frames, end, "body or site", "an <inertial>", model.opt.gravity.copy())


def load_spec(path: str, where: str) -> Any:
    """Return MuJoCo's specification of a file, which may be changed before it is compiled.

    Raises:
        InputError: MuJoCo is not installed, or can't read the file.
    """
    try:
        import mujoco
    except ImportError:
        got, remedy = "an MJCF file without the package mujoco", "pip install 'ident[mjcf]'"
        raise refusal(where, got, "mujoco to read it", remedy) from None
    try:
        return mujoco.MjSpec.from_file(path)
    except ValueError as error:
        raise _unread(where, error) from None


def compiled(spec: Any, where: str) -> Any:
    """Return the model of a specification.

    Raises:
        InputError: MuJoCo refuses it.
    """
    try:
        return spec.compile()
    except ValueError as error:
        raise _unread(where, error) from None


def mujoco_name(model: Any) -> str:
    """Return the name that a model has."""
    return str(model.names.split(b"\0", 1)[0].decode("utf-8", "replace"))


def _unread(where: str, error: ValueError) -> InputError:
    said = " ".join(str(error).split())
    return refusal(where, f"a model that MuJoCo can't read ({said})", "a valid MJCF", "correct it")


def placed(path: str, where: str) -> tuple[Any, Any]:
    """Return the model, and its data at zero posture; shapes are dropped where inertias are given.

    Raises:
        InputError: MuJoCo is not installed or can't read the file, or what it says is no serial arm of hinges.
    """
    spec = load_spec(path, where)
    import mujoco

    _check_numbers(spec, where)
    if spec.compiler.inertiafromgeom != mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_TRUE:
        _drop_shapes(spec)
    model = compiled(spec, where)
    if model.neq:
        remedy = "remove it, and what it ties to the arm"
        raise refusal(where, "an equality constraint", "a serial arm whose hinges turn on their own", remedy)
    for joint in range(model.njnt):
        if model.jnt_type[joint] != mujoco.mjtJoint.mjJNT_HINGE:
            kind = mujoco.mjtJoint(model.jnt_type[joint]).name.removeprefix("mjJNT_").lower()
            place = f"{where}, joint {_joint_name(model, joint)}"
            raise refusal(place, f"type {kind}", "a hinge", "fix this joint, or leave out what hangs on it")
    data = mujoco.MjData(model)
    data.qpos[:] = 0
    mujoco.mj_kinematics(model, data)
    return model, data


def _check_numbers(spec: Any, where: str) -> None:
    """Refuse what MuJoCo would pass over in silence."""
    problems = [
        Problem(f"{where}, body {body.name}", f"mass {body.mass:g}", "a mass >= 0 kg", "correct it")
        for body in spec.bodies
        if body.explicitinertial and not body.mass >= 0
    ]
    problems += [
        Problem(
            f"{where}, joint {joint.name}",
            f"range {joint.range[0]:g}, {joint.range[1]:g}",
            "lower <= upper",
            "swap or correct them",
        )
        for joint in spec.joints
        if not joint.range[0] <= joint.range[1]
    ]
    if problems:
        raise InputError(problems)


def _drop_shapes(spec: Any) -> None:
    """Remove the geoms of bodies whose inertia is given, and the meshes that then are of no use: they need no file.

    What else refers to them goes before: it is nothing that an arm at rest has.
    """
    for user in (*spec.actuators, *spec.sensors, *spec.tendons, *spec.pairs, *spec.excludes, *spec.keys, *spec.skins):
        spec.delete(user)
    for geom in list(spec.geoms):
        if geom.parent.explicitinertial or geom.parent is spec.worldbody:
            spec.delete(geom)
    for shown in (*spec.geoms, *spec.sites):
        shown.material = ""
    used = {geom.meshname for geom in spec.geoms}
    for mesh in list(spec.meshes):
        if mesh.name not in used:
            spec.delete(mesh)
    for unused in (*spec.lights, *spec.materials, *spec.textures):
        spec.delete(unused)


def _links(model: Any, where: str) -> list[list[int]]:
    """Return the joints of each moving link, from the base outwards.

    Raises:
        InputError: nothing moves, the arm branches, or a joint's name is none.
    """
    links: list[list[int]] = []
    last, bushings = 0, _passed_over(model)
    for body in range(1, model.nbody):
        if not model.body_jntnum[body]:
            continue
        joints = [int(model.body_jntadr[body]) + n for n in range(model.body_jntnum[body])]
        joints = [joint for joint in joints if model.joint(joint).name not in bushings]
        if model.body_weldid[model.body_parentid[body]] != last:
            names = " and ".join(_joint_name(model, joint) for joint in (*links[-1][:1], joints[0]))
            raise refusal(where, f"a branch into {names}", "a serial arm", "remove the other arms and fingers")
        links.append(joints)
        last = body
    if not links:
        raise refusal(where, "no moving joint", "a hinge", "check the joints of the bodies")
    _check_names(model, where)
    return links


def _passed_over(model: Any) -> set[str]:
    """Return the names of the hinges of bushings, as `ident export` writes them; of one without a pin all but one."""
    names = [str(model.joint(joint).name) for joint in range(model.njnt)]
    own = {f"{name}_{end}" for name in names for end in ENDS}
    return own | {f"{name}_{end}" for name in map(_undriven, names, repeat(set(names))) for end in ENDS[1:] if name}


def _undriven(name: str, names: set[str]) -> str:
    """Return what a bushing without a pin is called of which this is the hinge about its axis; empty for another."""
    stem = name.removesuffix(f"_{ENDS[0]}")
    whole = stem != name and stem not in names and {f"{stem}_{end}" for end in ENDS} <= names
    return stem if whole else ""


def _check_names(model: Any, where: str) -> None:
    parts = [("joint", _joint_name(model, n), int(model.jnt_bodyid[n])) for n in range(model.njnt)]
    heavy = [n for n in range(1, model.nbody) if model.body_mass[n] > 0 and model.body_weldid[n] > 0]
    parts += [("body", _body_name(model, n), int(model.body_parentid[n])) for n in heavy]
    problems = [
        Problem(f"{where}, body {_body_name(model, holder)}", f"the {kind} name {name!r}", NAME_RULE, "rename it")
        for kind, name, holder in parts
        if not re.fullmatch(NAME, name)
    ]
    if problems:
        raise InputError(problems)


def _pin(model: Any, data: Any, joint: int, bodies: tuple[Body, ...], place: Any) -> Pin:
    lower, upper = model.jnt_range[joint] if model.jnt_limited[joint] else (-np.inf, np.inf)
    axis, anchor, name = data.xaxis[joint].copy(), data.xanchor[joint], _joint_name(model, joint)
    driven = name == model.joint(joint).name
    limits = (float(lower), float(upper)) if driven else (-np.inf, np.inf)
    return Pin(name, axis, anchor - place, bodies, limits, driven)


def _bodies(model: Any, data: Any, joint: int, where: str) -> Iterator[Body]:
    """Yield the bodies that turn with a joint, in axes parallel to the base's."""
    for body in _welded(model, joint):
        if model.body_mass[body] == 0:
            continue
        turn = data.ximat[body].reshape(3, 3)
        inertia = turn @ np.diag(model.body_inertia[body]) @ turn.T
        com, name = data.xipos[body] - data.xanchor[joint], _body_name(model, body)
        try:
            yield Body(name, model.body_mass[body], com, (inertia + inertia.T) / 2)
        except InputError as error:
            problem = error.problems[0]
            raise refusal(f"{where}, body {name}", problem.got, problem.expected, problem.remedy) from None


def _welded(model: Any, joint: int) -> list[int]:
    """Return the body of a joint and those that are fixed to it."""
    return [n for n in range(1, model.nbody) if model.body_weldid[n] == model.jnt_bodyid[joint]]


def _frames(model: Any, data: Any, links: list[list[int]]) -> Iterator[tuple[str, tuple[str, Any]]]:
    """Yield bodies and sites by name with the joint that carries them, and their place from it."""
    for joint in (link[-1] for link in links):
        name, anchor = _joint_name(model, joint), data.xanchor[joint]
        bodies = _welded(model, joint)
        for site in _sites(model, bodies):
            yield model.site(site).name, (name, data.site_xpos[site] - anchor)
        for body in bodies:
            yield _body_name(model, body), (name, data.xpos[body] - anchor)


def _end(model: Any, joint: int) -> str:
    """Return the only site of the last link, or its body."""
    sites = _sites(model, _welded(model, joint))
    return str(model.site(sites[0]).name) if len(sites) == 1 else _body_name(model, int(model.jnt_bodyid[joint]))


def _sites(model: Any, bodies: list[int]) -> list[int]:
    return [n for n in range(model.nsite) if model.site_bodyid[n] in bodies and model.site(n).name]


def _joint_name(model: Any, joint: int) -> str:
    """Return the name of a joint; that of a bushing without a pin for the hinge about its axis."""
    name = str(model.joint(joint).name)
    names = {str(model.joint(n).name) for n in range(model.njnt)}
    return _undriven(name, names) or name


def _body_name(model: Any, body: int) -> str:
    """Return the name of a body; one without a name is called by its number."""
    return str(model.body(body).name) or f"body{body}"
