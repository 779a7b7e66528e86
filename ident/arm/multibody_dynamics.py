"""Exact equations of motion of an arm whose pins are driven, no angle taken as small; coordinates: see `kinematics`."""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ident.arm.assembly import Moments
from ident.arm.belts import belt_forces
from ident.arm.mechanics import Phi, flat, inboard
from ident.arm.multibody import Multibody
from ident.arm.multibody_kinematics import (
    Command,
    Joints,
    Kinematics,
    Pins,
    Turning,
    bushing_rotations,
    deviations,
    kinematics,
    pins,
    transmission_error,
)
from ident.arm.rotations import acceleration_map, axial, cross, matmul, matvec, total, transpose


def residual(model: Multibody, command: Command, y: Array, yd: Array, ydd: Array) -> Float[Array, "n *#batch"]:
    """Return M(y) d2y/dt2 + h(y, dy/dt, t): zero where the equations of motion hold [N m].

    By Newton and Euler's equations of every body, from the base outwards and back. Differentiable.

    Args:
        model: the multibody model of the arm under its load.
        command: of the motors at this moment.
        y: (n, *batch) coordinates [rad]
        yd: (n, *batch) their rates [rad/s]
        ydd: (n, *batch) their accelerations [rad/s^2]

    References:
        Featherstone, "Rigid Body Dynamics Algorithms", 2008, section 5.3 (recursive Newton-Euler).
    """
    xi = Turning(*(deviations(model, part) for part in (y, yd, ydd)))
    return residual_of(model, pins(model, command, xi), y, yd, ydd)


def residual_of(model: Multibody, turning: Pins, y: Array, yd: Array, ydd: Array) -> Float[Array, "n *#batch"]:
    """Return the residual where it is known how pins and pulleys turn; see `residual`."""
    at = kinematics(model, turning.pin, *(bushing_rotations(model, part) for part in (y, yd, ydd)))
    forces = _sum(_of_bodies(model, at, turning.pulley), imbalance(model, at, turning.pulley))
    moved = equations(model, at, turning.slope, forces)
    phi, v = bushing_rotations(model, y), bushing_rotations(model, yd)
    spring = flat(spring_moments(model, phi) + matvec(model.damping, v))
    if not model.belt_driven:
        return moved + spring
    error = transmission_error(model, turning)
    position, rate = (phi, deviations(model, y), error.angle), (v, deviations(model, yd), error.rate)
    on_bushings, on_pins, on_errors = belt_forces(model, *(_alike(*parts) for parts in (position, rate)))
    on_pins = on_pins + (turning.slope - 1) * on_errors
    return moved + jnp.concatenate([spring + flat(on_bushings), on_pins[np.asarray(model.belt_driven)]])


def spring_moments(model: Multibody, phi: Phi) -> Phi:
    """Return the moments of the bushings' springs [N m], along the shafts' axes."""
    moment = matvec(model.stiffness, phi)
    return moment if model.curved is None else moment + model.curved.torque(phi)


def beyond_tangent(model: Multibody, rest: Phi, phi: Phi) -> tuple[Joints, Joints]:
    """Return by how much the springs' moments miss their tangents at rest, and those moments' change by them [N m].

    Each is the size of a vector of each bushing (N, *batch).
    """
    K = model.stiffness if model.curved is None else model.stiffness + sum(model.curved.tangents(rest))
    by_tangent = matvec(K, phi - rest)
    missed = spring_moments(model, phi) - spring_moments(model, rest) - by_tangent
    missed, by_tangent = (jnp.sqrt((x * x).sum(0)) for x in (missed, by_tangent))
    return missed, by_tangent


def drive_torques(model: Multibody, command: Command, y: Array, yd: Array, ydd: Array) -> Joints:
    """Return the torque at each pin [N m] by which motors and belts make the arm follow its command.

    It is the torque at the wave generator times the ratio; zero where there is no pin.
    """
    turning = pins(model, command, Turning(*(deviations(model, part) for part in (y, yd, ydd))))
    at = kinematics(model, turning.pin, *(bushing_rotations(model, part) for part in (y, yd, ydd)))
    forces = _sum(_of_bodies(model, at, turning.pulley), imbalance(model, at, turning.pulley))
    torque = _on_pins(model, at, turning.slope, forces, _outboard_moment(model, at, forces))
    driven = np.isin(np.arange(model.joints), model.driven)
    return jnp.where(driven.reshape((-1,) + (1,) * (torque.ndim - 1)), torque, 0.0)


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


def equations(model: Multibody, at: Kinematics, slope: Joints, forces: Forces) -> Float[Array, "n *#batch"]:
    """Return what forces on the bodies ask of bushings and of the pins that elastic belts drive [N m]."""
    moment = _outboard_moment(model, at, forces)
    on_bushings = flat(matvec(at.project, moment))
    if not model.belt_driven:
        return on_bushings
    on_pins = _on_pins(model, at, slope, forces, moment)
    return jnp.concatenate([on_bushings, on_pins[np.asarray(model.belt_driven)]])


def _outboard_moment(model: Multibody, at: Kinematics, forces: Forces) -> Phi:
    """Return the moment about each bushing for all bodies beyond it."""
    outboard = inboard(model.joints).T
    moment = forces.on_link + forces.on_shaft + cross(at.centre, forces.force)
    return total(outboard, moment, 1) - cross(at.centre, total(outboard, forces.force, 1))


def _on_pins(model: Multibody, at: Kinematics, slope: Joints, forces: Forces, moment: Phi) -> Joints:
    pin = (at.axis * (moment - forces.on_shaft)).sum(0)
    return slope * pin + model.drives.ratio * forces.on_pulley


def _of_bodies(model: Multibody, at: Kinematics, pulley: Turning) -> Forces:
    """Return the forces of shafts, links, loads and balanced rotors."""
    f_shaft, n_shaft = _newton_euler(model.shaft, at.shaft, acceleration_map(at.w, at.alpha), at.acceleration)
    f_link, n_link = _newton_euler(model.link, at.link, acceleration_map(at.w_link, at.alpha_link), at.acceleration)
    f_points, n_points = _points(model, at.link)
    on_rotor = model.drives.rotor * (at.axis * pulley.acceleration + cross(at.w, at.axis * pulley.rate))
    on_pulley = model.drives.rotor * (pulley.acceleration + (at.axis * at.alpha).sum(0))
    return Forces(f_shaft + f_link + f_points, n_link + n_points, n_shaft + on_rotor, on_pulley)


def _newton_euler(moments: Moments, axes: Array, A: Array, acceleration: Array) -> tuple[Array, Array]:
    """Return force and moment about the bushing (3, N, *batch) that accelerate the bodies.

    The point at r accelerates by acceleration + A r.
    """
    first = matvec(axes, moments.first)
    second = matmul(matmul(axes, moments.second), transpose(axes))
    force = moments.mass * acceleration + matvec(A, first)
    return force, cross(first, acceleration) + axial(matmul(second, transpose(A)))


def imbalance(model: Multibody, at: Kinematics, pulley: Turning) -> Forces:
    """Return the forces of the turning masses, in excess of the same masses centred on their axes.

    The eccentric mass at h axis + e u turns, the same mass at h axis is taken away from the shaft, whose mass has it.
    """
    drives = model.drives
    angle = pulley.angle + drives.phase
    u = matvec(at.shaft, drives.across[:, 0] * jnp.cos(angle) + drives.across[:, 1] * jnp.sin(angle))
    w = at.axis * pulley.rate
    A = acceleration_map(at.w + w, at.alpha + at.axis * pulley.acceleration + cross(at.w, w))
    first = drives.imbalance * u
    # the integral of r x (A r) with r r' = h (axis u' + u axis') + e u u'
    bob = matvec(A, drives.height * at.axis + drives.reach * u)
    moment = cross(first, at.acceleration + bob) + cross(drives.height * at.axis, matvec(A, first))
    return Forces(matvec(A, first), jnp.zeros_like(moment), moment, (at.axis * moment).sum(0))


def _points(model: Multibody, link: Array) -> tuple[Array, Array]:
    """Return the reaction (3, N, *batch) to the forces on the named points."""
    body = np.asarray(model.carrier, dtype=int)
    at = np.equal.outer(np.arange(model.joints), body)
    arm = matvec(link[:, :, body], model.position)
    force = jnp.broadcast_to(model.force, arm.shape)
    return -total(at, force, 1), -total(at, cross(arm, force), 1)


def _alike(phi: Phi, *joints: Joints) -> tuple[Phi, Joints, Joints]:
    """Give all the same batch."""
    batch = jnp.broadcast_shapes(phi.shape[2:], *(part.shape[1:] for part in joints))
    xi, error = (jnp.broadcast_to(part, (part.shape[0], *batch)) for part in joints)
    return jnp.broadcast_to(phi, (*phi.shape[:2], *batch)), xi, error


def _sum(one: Forces, other: Forces) -> Forces:
    return Forces(*(a + b for a, b in zip(one, other, strict=True)))
