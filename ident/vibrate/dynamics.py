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


def inexactness(machine: Machine, turning: Pins) -> Turning:
    """Return by how much the pins deviate from their wave generators: the kinematic error and its rates."""
    exact = [part / machine.drives.ratio for part in turning.pulley]
    return Turning(*(pin - wave for pin, wave in zip(turning.pin, exact, strict=True)))


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
    return residual_of(machine, pins(machine, command, xi), y, yd, ydd)


def residual_of(machine: Machine, turning: Pins, y: Array, yd: Array, ydd: Array) -> Float[Array, "n *#batch"]:
    """Return the residual where it is known how pins and pulleys turn; see `residual`."""
    at = kinematics(machine, turning.pin, *(bushings(machine, part) for part in (y, yd, ydd)))
    forces = _sum(_of_bodies(machine, at, turning.pulley), imbalance(machine, at, turning.pulley))
    moved = equations(machine, at, turning.slope, forces)
    phi, v = bushings(machine, y), bushings(machine, yd)
    spring = flat(matvec(machine.stiffness, phi) + matvec(machine.damping, v))
    if not machine.loose:
        return moved + spring
    xi, xi_dot = deviations(machine, y), deviations(machine, yd)
    on_bushings, on_pins = belt_forces(machine, phi, v, xi, xi_dot, turning.error)
    return moved + jnp.concatenate([spring + flat(on_bushings), on_pins[np.asarray(machine.loose)]])


def drive_torques(machine: Machine, command: Command, y: Array, yd: Array, ydd: Array) -> Joints:
    """Return the torque at each pin [N m] by which motors and belts make the arm follow its command.

    It is the torque at the wave generator times the ratio.
    """
    turning = pins(machine, command, Turning(*(deviations(machine, part) for part in (y, yd, ydd))))
    at = kinematics(machine, turning.pin, *(bushings(machine, part) for part in (y, yd, ydd)))
    forces = _sum(_of_bodies(machine, at, turning.pulley), imbalance(machine, at, turning.pulley))
    return _on_pins(machine, at, turning.slope, forces, _outboard_moment(machine, at, forces))


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


class Forces(NamedTuple):
    """What accelerating and holding up bodies asks for.

    Attributes:
        force: (3, N, *batch) [N]
        on_link: (3, N, *batch) [N m] moment about the bushing, for what is behind the pin.
        on_shaft: (3, N, *batch) [N m] moment about the bushing, for shaft and pulley.
        on_pulley: (N, *batch) [N m] torque of the pulley about the axis.
    """

    force: Array
    on_link: Array
    on_shaft: Array
    on_pulley: Array


def kinematics(machine: Machine, pin: Turning, phi: Phi, v: Phi, a: Phi) -> Kinematics:
    """Place and move the bodies, from the base outwards; phi, v, a `(3, N, *batch)` move the bushings."""
    inboard = _inboard(machine)
    J = left_jacobian(phi)
    along, change = slide(phi, v)
    before, shaft, link, centre = _frames(machine, pin.angle, phi, J)

    u, axis = matvec(before, along), matvec(shaft, machine.axis)
    turn = axis * pin.rate
    w_link = total(inboard, u + turn, 1)
    w = w_link - turn
    bend = matvec(before, change + matvec(J, a)) + _cross(w - u, u)
    twist = axis * pin.acceleration + _cross(w, turn)
    alpha_link = total(inboard, bend + twist, 1)

    reach = matvec(before, machine.offset)[:, 1:]
    gravity = machine.gravity.reshape((3,) + (1,) * (centre.ndim - 1))
    steps = matvec(_swing(w_link, alpha_link)[:, :, :-1], reach)
    steps = jnp.concatenate([jnp.zeros((3, 1, *steps.shape[2:])), steps], 1)
    return Kinematics(
        shaft=shaft,
        link=link,
        project=matmul(transpose(J), transpose(before)),
        axis=axis,
        centre=centre,
        acceleration=total(inboard, steps, 1) - gravity,
        w=w,
        alpha=alpha_link - twist,
        w_link=w_link,
        alpha_link=alpha_link,
    )


def equations(machine: Machine, at: Kinematics, slope: Joints, forces: Forces) -> Float[Array, "n *#batch"]:
    """Return what forces on the bodies ask of bushings and of the pins that elastic belts drive [N m]."""
    moment = _outboard_moment(machine, at, forces)
    on_bushings = flat(matvec(at.project, moment))
    if not machine.loose:
        return on_bushings
    on_pins = _on_pins(machine, at, slope, forces, moment)
    return jnp.concatenate([on_bushings, on_pins[np.asarray(machine.loose)]])


def _outboard_moment(machine: Machine, at: Kinematics, forces: Forces) -> Phi:
    """Return the moment about each bushing for all bodies beyond it."""
    outboard = _inboard(machine).T
    moment = forces.on_link + forces.on_shaft + _cross(at.centre, forces.force)
    return total(outboard, moment, 1) - _cross(at.centre, total(outboard, forces.force, 1))


def _on_pins(machine: Machine, at: Kinematics, slope: Joints, forces: Forces, moment: Phi) -> Joints:
    pin = (at.axis * (moment - forces.on_shaft)).sum(0)
    return slope * pin + machine.drives.ratio * forces.on_pulley


def _of_bodies(machine: Machine, at: Kinematics, pulley: Turning) -> Forces:
    """Return the forces of shafts, links, loads and balanced rotors."""
    f_shaft, n_shaft = _newton_euler(machine.shaft, at.shaft, _swing(at.w, at.alpha), at.acceleration)
    f_link, n_link = _newton_euler(machine.link, at.link, _swing(at.w_link, at.alpha_link), at.acceleration)
    f_points, n_points = _points(machine, at.link)
    spin = machine.drives.rotor * (at.axis * pulley.acceleration + _cross(at.w, at.axis * pulley.rate))
    on_pulley = machine.drives.rotor * (pulley.acceleration + (at.axis * at.alpha).sum(0))
    return Forces(f_shaft + f_link + f_points, n_link + n_points, n_shaft + spin, on_pulley)


def _newton_euler(moments: Moments, axes: Array, swing: Array, acceleration: Array) -> tuple[Array, Array]:
    """Return force and moment about the bushing (3, N, *batch) that accelerate the bodies.

    The point at r moves with acceleration + swing r.
    """
    first = matvec(axes, moments.first)
    second = matmul(matmul(axes, moments.second), transpose(axes))
    force = moments.mass * acceleration + matvec(swing, first)
    return force, _cross(first, acceleration) + axial(matmul(second, transpose(swing)))


def imbalance(machine: Machine, at: Kinematics, pulley: Turning) -> Forces:
    """Return the forces of the turning masses, in excess of the same masses at rest on their axes.

    The eccentric mass at h axis + e u turns, the same mass at h axis is taken away from the shaft, whose mass has it.
    """
    drives = machine.drives
    angle = pulley.angle + drives.phase
    u = matvec(at.shaft, drives.across[:, 0] * jnp.cos(angle) + drives.across[:, 1] * jnp.sin(angle))
    spin = at.axis * pulley.rate
    swing = _swing(at.w + spin, at.alpha + at.axis * pulley.acceleration + _cross(at.w, spin))
    first = drives.imbalance * u
    # the integral of r x (swing r) with r r' = h (axis u' + u axis') + e u u'
    bob = matvec(swing, drives.height * at.axis + drives.reach * u)
    moment = _cross(first, at.acceleration + bob) + _cross(drives.height * at.axis, matvec(swing, first))
    return Forces(matvec(swing, first), jnp.zeros_like(moment), moment, (at.axis * moment).sum(0))


def _points(machine: Machine, link: Array) -> tuple[Array, Array]:
    """Return the reaction (3, N, *batch) to the forces on the named points."""
    body = np.asarray(machine.carrier, dtype=int)
    at = np.equal.outer(np.arange(machine.joints), body)
    arm = matvec(link[:, :, body], machine.position)
    force = jnp.broadcast_to(machine.force, arm.shape)
    return -total(at, force, 1), -total(at, _cross(arm, force), 1)


def _sum(one: Forces, other: Forces) -> Forces:
    return Forces(*(a + b for a, b in zip(one, other, strict=True)))


def _swing(w: Array, alpha: Array) -> Array:
    """Return the map from a vector fixed in a body to its second derivative."""
    cross = skew(w)
    return skew(alpha) + matmul(cross, cross)


def _cross(a: Array, b: Array) -> Array:
    return matvec(skew(a), b)


def _inboard(machine: Machine) -> np.ndarray:
    return np.tri(machine.joints, dtype=bool)
