"""Exact equations of motion of an arm whose pins are driven, no angle taken as small.

Coordinates y are flat: joint by joint the rotation vector phi_j of its bushing along the axes of its shaft, then for
each elastic belt the deviation xi of the pin that it drives from its command. Notation: w angular velocity, p_j centre
of bushing j, both in base axes.
"""

from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ident.arm.mechanics import Phi, flat, unflatten
from ident.arm.rotations import (
    axial,
    left_jacobian,
    matmul,
    matvec,
    outer,
    rotation_by,
    skew,
    slide,
    total,
    transpose,
    turn_about,
)
from ident.vibrate.belts import belt_forces
from ident.vibrate.machine import Machine, Moments
from ident.vibrate.motion import Motion

Joints = Float[Array, "N *#batch"]


class Command(NamedTuple):
    """What the motors are told: angles of the driven joints and their rates.

    Attributes:
        q: (driven, *batch) [rad]
        qd: (driven, *batch) [rad/s]
        qdd: (driven, *batch) [rad/s^2]
    """

    q: Float[Array, "driven *#batch"]
    qd: Float[Array, "driven *#batch"]
    qdd: Float[Array, "driven *#batch"]


def command(machine: Machine, motion: Motion, times: Float[Array, "T"]) -> Command:
    """Return what the motors are told at times [s], with singleton axes for the machine's sets."""
    ones = tuple(range(2, machine.offset.ndim - 1))
    return Command(*(jnp.expand_dims(part, ones) for part in motion(times)))


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


def pins(machine: Machine, command: Command, xi: Turning) -> Pins:
    """Turn pins and pulleys by the command and the deviations xi from it."""
    q, qd, qdd = (_spread(part, machine) + own for part, own in zip(command, xi, strict=True))
    drives = machine.drives
    argument = 2 * drives.ratio * q + drives.error_phase
    error = drives.error * jnp.sin(argument)
    slope = 1 + 2 * drives.ratio * drives.error * jnp.cos(argument)
    pin = Turning(q + error, slope * qd, slope * qdd - 4 * drives.ratio**2 * error * qd * qd)
    return Pins(pin, Turning(drives.ratio * q, drives.ratio * qd, drives.ratio * qdd), slope, error)


def residual(machine: Machine, command: Command, y: Array, yd: Array, ydd: Array) -> Float[Array, "n *#batch"]:
    """Return M(y) d2y/dt2 + h(y, dy/dt, t): zero where the equations of motion hold [N m].

    By Newton and Euler's equations of every body, from the base outwards and back. Differentiable.

    Args:
        machine: the arm under its load.
        command: what the motors are told at this moment.
        y: (n, *batch) coordinates [rad]
        yd: (n, *batch) their rates [rad/s]
        ydd: (n, *batch) their accelerations [rad/s^2]

    References:
        Featherstone, "Rigid Body Dynamics Algorithms", 2008, section 5.3 (recursive Newton-Euler).
    """
    xi = Turning(*(deviations(machine, part) for part in (y, yd, ydd)))
    turning = pins(machine, command, xi)
    phi, v, a = (bushings(machine, part) for part in (y, yd, ydd))
    moment, pin, pulley = _inverse_dynamics(machine, turning, phi, v, a)
    moment = moment + matvec(machine.stiffness, phi) + matvec(machine.damping, v)
    force = turning.slope * pin + machine.drives.ratio * pulley
    if machine.loose:
        on_bushings, on_pins = belt_forces(machine, phi, v, xi.angle, xi.rate, turning.error)
        moment, force = moment + on_bushings, force + on_pins
        on_pins = jnp.broadcast_to(force, (machine.joints, *moment.shape[2:]))[np.asarray(machine.loose)]
        return jnp.concatenate([flat(moment), on_pins])
    return flat(moment)


def drive_torques(machine: Machine, command: Command, y: Array, yd: Array, ydd: Array) -> Joints:
    """Return the torque at each pin [N m] by which motors and belts make the arm follow its command.

    It is the torque at the wave generator times the ratio.
    """
    xi = Turning(*(deviations(machine, part) for part in (y, yd, ydd)))
    turning = pins(machine, command, xi)
    _, pin, pulley = _inverse_dynamics(machine, turning, *(bushings(machine, part) for part in (y, yd, ydd)))
    return turning.slope * pin + machine.drives.ratio * pulley


def bushings(machine: Machine, y: Array) -> Phi:
    """Return the bushings' part of the coordinates as `(3, N, *batch)`."""
    return unflatten(y[: 3 * machine.joints])


def deviations(machine: Machine, y: Array) -> Joints:
    """Return how far each pin deviates from its command, `(N, *batch)`."""
    none = jnp.zeros_like(y[0])
    loose = {joint: y[3 * machine.joints + k] for k, joint in enumerate(machine.loose)}
    return jnp.stack([loose.get(joint, none) for joint in range(machine.joints)])


def positions(machine: Machine, q: Joints, phi: Phi) -> Float[Array, "3 P *#batch"]:
    """Return the named points in the base frame [m]; q are the angles of all pins, phi those of all bushings."""
    _, _, after, centre = _frames(machine, q, phi, left_jacobian(phi))
    body = np.asarray(machine.carrier, dtype=int)
    return centre[:, body] + matvec(after[:, :, body], machine.position)


def _spread(driven: Array, machine: Machine) -> Joints:
    none = jnp.zeros_like(driven[0])
    return jnp.stack([driven[machine.driven.index(j)] if j in machine.driven else none for j in range(machine.joints)])


def _frames(machine: Machine, q: Joints, phi: Phi, J: Array) -> tuple[Array, Array, Array, Array]:
    """Return axes before each bushing, of each shaft, of each link `(3, 3, N, *batch)`, and the bushings' centres."""
    turn, pin = rotation_by(phi, J), turn_about(machine.axis, q)
    turn, pin = jnp.broadcast_arrays(turn, pin)
    shaft, link = [turn[:, :, 0]], [matmul(turn[:, :, 0], pin[:, :, 0])]
    for j in range(1, machine.joints):
        shaft.append(matmul(link[-1], turn[:, :, j]))
        link.append(matmul(shaft[-1], pin[:, :, j]))
    unit = jnp.broadcast_to(jnp.eye(3).reshape((3, 3) + (1,) * (turn.ndim - 3)), shaft[0].shape)
    before, after = jnp.stack([unit, *link[:-1]], 2), jnp.stack(link, 2)
    return before, jnp.stack(shaft, 2), after, total(_inboard(machine), matvec(before, machine.offset), 1)


def _inverse_dynamics(machine: Machine, pins: Pins, phi: Phi, v: Phi, a: Phi) -> tuple[Phi, Joints, Joints]:
    """Return what inertia and weight ask of the bushings (3, N), of the pins (N) and of the pulleys (N) [N m]."""
    inboard, outboard = _inboard(machine), _inboard(machine).T
    J = left_jacobian(phi)
    along, change = slide(phi, v)
    before, shaft, link, centre = _frames(machine, pins.pin.angle, phi, J)

    u, axis = matvec(before, along), matvec(shaft, machine.axis)
    turn = axis * pins.pin.rate
    w_link = total(inboard, u + turn, 1)
    w = w_link - turn
    bend = matvec(before, change + matvec(J, a)) + _cross(w - u, u)
    twist = axis * pins.pin.acceleration + _cross(w, turn)
    alpha_link = total(inboard, bend + twist, 1)
    swing, swing_link = _swing(w, alpha_link - twist), _swing(w_link, alpha_link)

    reach = matvec(before, machine.offset)[:, 1:]
    gravity = machine.gravity.reshape((3,) + (1,) * (centre.ndim - 1))
    steps = matvec(swing_link[:, :, :-1], reach)
    steps = jnp.concatenate([jnp.zeros((3, 1, *steps.shape[2:])), steps], 1)
    acceleration = total(inboard, steps, 1) - gravity

    f_shaft, n_shaft = _newton_euler(machine.shaft, shaft, swing, acceleration)
    f_link, n_link = _newton_euler(machine.link, link, swing_link, acceleration)
    f_turning, n_turning = _turning(machine, pins.pulley, shaft, axis, w, alpha_link - twist, acceleration)
    f_points, n_points = _points(machine, link)
    f, n = f_shaft + f_link + f_turning + f_points, n_shaft + n_link + n_turning + n_points
    all_f = total(outboard, f, 1)
    all_n = total(outboard, n + _cross(centre, f), 1) - _cross(centre, all_f)
    on_pin = (axis * (all_n - n_shaft - n_turning)).sum(0)
    on_pulley = (axis * (n_turning + machine.drives.rotor * (alpha_link - twist))).sum(0)
    return matvec(transpose(J), matvec(transpose(before), all_n)), on_pin, on_pulley


def _newton_euler(moments: Moments, axes: Array, swing: Array, acceleration: Array) -> tuple[Array, Array]:
    """Return force and moment about the bushing (3, N, *batch) that accelerate the bodies.

    The point at r moves with acceleration + swing r.
    """
    first = matvec(axes, moments.first)
    second = matmul(matmul(axes, moments.second), transpose(axes))
    force = moments.mass * acceleration + matvec(swing, first)
    return force, _cross(first, acceleration) + axial(matmul(second, transpose(swing)))


def _turning(
    machine: Machine, pulley: Turning, shaft: Array, axis: Array, w: Array, alpha: Array, acceleration: Array
) -> tuple[Array, Array]:
    """Return force and moment of what turns with the pulleys, in excess of the same mass at rest on the axis.

    The eccentric mass at h axis + e u turns, the same mass at h axis is taken away from the shaft, whose mass has it.
    """
    drives = machine.drives
    angle = pulley.angle + drives.phase
    u = matvec(shaft, drives.across[:, 0] * jnp.cos(angle) + drives.across[:, 1] * jnp.sin(angle))
    spin = axis * pulley.rate
    swing = _swing(w + spin, alpha + axis * pulley.acceleration + _cross(w, spin))
    first = drives.imbalance * u
    across = outer(axis, u)
    second = drives.imbalance * (drives.height * (across + transpose(across)) + drives.reach * outer(u, u))
    moment = _cross(first, acceleration) + axial(matmul(second, transpose(swing)))
    rotor = drives.rotor * (axis * pulley.acceleration + _cross(w, spin))
    return matvec(swing, first), moment + rotor


def _points(machine: Machine, link: Array) -> tuple[Array, Array]:
    """Return the reaction (3, N, *batch) to the forces on the named points."""
    body = np.asarray(machine.carrier, dtype=int)
    at = np.equal.outer(np.arange(machine.joints), body)
    arm = matvec(link[:, :, body], machine.position)
    force = jnp.broadcast_to(machine.force, arm.shape)
    return -total(at, force, 1), -total(at, _cross(arm, force), 1)


def _swing(w: Array, alpha: Array) -> Array:
    """Return the map from a vector fixed in a body to its second derivative."""
    cross = skew(w)
    return skew(alpha) + matmul(cross, cross)


def _cross(a: Array, b: Array) -> Array:
    return matvec(skew(a), b)


def _inboard(machine: Machine) -> np.ndarray:
    return np.tri(machine.joints, dtype=bool)
