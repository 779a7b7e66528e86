"""Kinematics of an arm whose pins are driven: the motors' command, how pins and pulleys turn, where bodies are.

Coordinates y are flat: joint by joint the rotation vector phi_j of its bushing along the axes of its shaft, then for
each elastic belt the deviation xi of the pin that it drives from its command. No angle is taken as small.
"""

from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ident.arm.mechanics import Phi, inboard, unflatten
from ident.arm.multibody import Multibody
from ident.arm.rotations import (
    acceleration_map,
    cross,
    left_jacobian,
    left_jacobian_rate,
    matmul,
    matvec,
    rotated,
    rotation_by,
    total,
    transpose,
    turn_about,
    turned,
)
from ident.jit import AnyArray

Joints = Float[Array, "N *#batch"]


class Command(NamedTuple):
    """The command of the motors: angles of the driven joints and their rates.

    Attributes:
        q: (driven, *batch) [rad]
        qd: (driven, *batch) [rad/s]
        qdd: (driven, *batch) [rad/s^2]
    """

    q: Float[AnyArray, "driven *#batch"]
    qd: Float[AnyArray, "driven *#batch"]
    qdd: Float[AnyArray, "driven *#batch"]


class Turning(NamedTuple):
    """An angle and its rates at each joint, `(N, *batch)` [rad, rad/s, rad/s^2]."""

    angle: Joints
    rate: Joints
    acceleration: Joints


def at_rest(angle: Joints) -> Turning:
    """Return angles that do not change."""
    return Turning(angle, jnp.zeros_like(angle), jnp.zeros_like(angle))


class Pins(eqx.Module):
    """How pins and pulleys turn.

    Attributes:
        pin: of the link against the shaft, kinematic error included.
        pulley: of the pulley against the shaft.
        slope: (N, *batch) [-] turn of the pin for one of the wave generator divided by the ratio.
        error: (N, *batch) [rad] kinematic error.
    """

    pin: Turning
    pulley: Turning
    slope: Joints
    error: Joints


def pins(model: Multibody, command: Command, xi: Turning) -> Pins:
    """Turn pins and pulleys by the command and the deviations xi from it."""
    q, qd, qdd = (_spread(part, model) + own for part, own in zip(command, xi, strict=True))
    drives, error, slope = model.drives, jnp.zeros_like(q), jnp.ones_like(q)
    if model.transmission_error:
        argument = 2 * drives.ratio * q + drives.error_phase
        error = drives.error * jnp.sin(argument)
        slope = 1 + 2 * drives.ratio * drives.error * jnp.cos(argument)
    pin = Turning(q + error, slope * qd, slope * qdd - 4 * drives.ratio**2 * error * qd * qd)
    return Pins(pin, Turning(drives.ratio * q, drives.ratio * qd, drives.ratio * qdd), slope, error)


def transmission_error(model: Multibody, turning: Pins) -> Turning:
    """Return by how much the pins deviate from their wave generators: the kinematic error and its rates."""
    exact = [part / model.drives.ratio for part in turning.pulley]
    return Turning(*(pin - wave for pin, wave in zip(turning.pin, exact, strict=True)))


def bushing_rotations(model: Multibody, y: Array) -> Phi:
    """Return the bushings' part of the coordinates as `(3, N, *batch)`."""
    return unflatten(y[: 3 * model.joints])


def deviations(model: Multibody, y: Array) -> Joints:
    """Return how far each pin deviates from its command, `(N, *batch)`."""
    none = jnp.zeros_like(y[0])
    own = {joint: y[3 * model.joints + k] for k, joint in enumerate(model.belt_driven)}
    return jnp.stack([own.get(joint, none) for joint in range(model.joints)])


def end_point(model: Multibody, q: Joints, phi: Phi | None = None) -> Float[Array, "3 *#batch"]:
    """Return the last named point in the base frame [m], from it inwards joint by joint.

    Args:
        model: the multibody model of the arm under its load.
        q: (N, *batch) [rad] angles of all pins.
        phi: (3, N, *batch) [rad] rotations of all bushings; none when None.
    """
    r = tuple(model.position[:, -1])
    for joint in range(model.carrier[-1], -1, -1):
        r = turned(r, model.axis[:, joint], q[joint])
        r = r if phi is None else rotated(r, phi[:, joint])
        r = tuple(x + start for x, start in zip(r, model.offset[:, joint], strict=True))
    return jnp.stack(jnp.broadcast_arrays(*r))


def _spread(driven: AnyArray, model: Multibody) -> Joints:
    none = jnp.zeros_like(driven[0])
    return jnp.stack([driven[model.driven.index(j)] if j in model.driven else none for j in range(model.joints)])


def _frames(model: Multibody, q: Joints, phi: Phi, J: Array) -> tuple[Array, Array, Array, Array]:
    """Return axes before each bushing, of each shaft, of each link `(3, 3, N, *batch)`, and the bushings' centres."""
    turn, pin = rotation_by(phi, J), turn_about(model.axis, q)
    turn, pin = jnp.broadcast_arrays(turn, pin)
    shaft, link = [turn[:, :, 0]], [matmul(turn[:, :, 0], pin[:, :, 0])]
    for j in range(1, model.joints):
        shaft.append(matmul(link[-1], turn[:, :, j]))
        link.append(matmul(shaft[-1], pin[:, :, j]))
    unit = jnp.broadcast_to(jnp.eye(3).reshape((3, 3) + (1,) * (turn.ndim - 3)), shaft[0].shape)
    before, after = jnp.stack([unit, *link[:-1]], 2), jnp.stack(link, 2)
    return before, jnp.stack(shaft, 2), after, total(inboard(model.joints), matvec(before, model.offset), 1)


class Kinematics(NamedTuple):
    """Where shafts and links are and how they move, in base axes.

    Attributes:
        shaft: (3, 3, N, *batch) axes of the shafts.
        link: (3, 3, N, *batch) axes of the links.
        project: (3, 3, N, *batch) map from a moment about a bushing to the bushing's coordinates, by virtual work.
        axis: (3, N, *batch) axes of the pins.
        centre: (3, N, *batch) [m] bushing centres.
        acceleration: (3, N, *batch) [m/s^2] of the centres, against free fall.
        w: (3, N, *batch) [rad/s] angular velocities of the shafts.
        alpha: (3, N, *batch) [rad/s^2] angular accelerations of the shafts.
        w_link: (3, N, *batch) [rad/s] angular velocities of the links.
        alpha_link: (3, N, *batch) [rad/s^2] angular accelerations of the links.
    """

    shaft: Array
    link: Array
    project: Array
    axis: Array
    centre: Array
    acceleration: Array
    w: Array
    alpha: Array
    w_link: Array
    alpha_link: Array


def kinematics(model: Multibody, pin: Turning, phi: Phi, v: Phi, a: Phi) -> Kinematics:
    """Return how the bodies move, from the base outwards; phi, v, a `(3, N, *batch)` move the bushings."""
    inward = inboard(model.joints)
    J = left_jacobian(phi)
    rate, change = left_jacobian_rate(phi, v)
    before, shaft, link, centre = _frames(model, pin.angle, phi, J)

    u, axis = matvec(before, rate), matvec(shaft, model.axis)
    turn = axis * pin.rate
    w_link = total(inward, u + turn, 1)
    w = w_link - turn
    bend = matvec(before, change + matvec(J, a)) + cross(w - u, u)
    twist = axis * pin.acceleration + cross(w, turn)
    alpha_link = total(inward, bend + twist, 1)

    reach = matvec(before, model.offset)[:, 1:]
    gravity = model.gravity.reshape((3,) + (1,) * (centre.ndim - 1))
    steps = matvec(acceleration_map(w_link, alpha_link)[:, :, :-1], reach)
    steps = jnp.concatenate([jnp.zeros((3, 1, *steps.shape[2:])), steps], 1)
    return Kinematics(
        shaft=shaft,
        link=link,
        project=matmul(transpose(J), transpose(before)),
        axis=axis,
        centre=centre,
        acceleration=total(inward, steps, 1) - gravity,
        w=w,
        alpha=alpha_link - twist,
        w_link=w_link,
        alpha_link=alpha_link,
    )
