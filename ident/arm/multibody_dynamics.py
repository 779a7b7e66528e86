"""Exact equations of motion of an arm whose pins are driven, no angle taken as small; coordinates: see `kinematics`."""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ident.arm.belts import belt_forces
from ident.arm.mechanics import Phi, flat
from ident.arm.multibody import Moments, Multibody
from ident.arm.multibody_kinematics import (
    Command,
    Joints,
    Kinematics,
    Pins,
    Turning,
    acceleration_map,
    bushings,
    deviations,
    inboard_of,
    kinematics,
    pins,
    transmission_error,
)
from ident.arm.rotations import axial, cross, matmul, matvec, total, transpose


def residual(machine: Multibody, command: Command, y: Array, yd: Array, ydd: Array) -> Float[Array, "n *#batch"]:
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


def residual_of(machine: Multibody, turning: Pins, y: Array, yd: Array, ydd: Array) -> Float[Array, "n *#batch"]:
    """Return the residual where it is known how pins and pulleys turn; see `residual`."""
    at = kinematics(machine, turning.pin, *(bushings(machine, part) for part in (y, yd, ydd)))
    forces = _sum(_of_bodies(machine, at, turning.pulley), imbalance(machine, at, turning.pulley))
    moved = equations(machine, at, turning.slope, forces)
    phi, v = bushings(machine, y), bushings(machine, yd)
    spring = flat(matvec(machine.stiffness, phi) + matvec(machine.damping, v))
    if not machine.loose:
        return moved + spring
    inexact = transmission_error(machine, turning)
    place, rate = (phi, deviations(machine, y), inexact.angle), (v, deviations(machine, yd), inexact.rate)
    on_bushings, on_pins, on_errors = belt_forces(machine, *(_alike(*parts) for parts in (place, rate)))
    on_pins = on_pins + (turning.slope - 1) * on_errors
    return moved + jnp.concatenate([spring + flat(on_bushings), on_pins[np.asarray(machine.loose)]])


def drive_torques(machine: Multibody, command: Command, y: Array, yd: Array, ydd: Array) -> Joints:
    """Return the torque at each pin [N m] by which motors and belts make the arm follow its command.

    It is the torque at the wave generator times the ratio; zero where there is no pin.
    """
    turning = pins(machine, command, Turning(*(deviations(machine, part) for part in (y, yd, ydd))))
    at = kinematics(machine, turning.pin, *(bushings(machine, part) for part in (y, yd, ydd)))
    forces = _sum(_of_bodies(machine, at, turning.pulley), imbalance(machine, at, turning.pulley))
    torque = _on_pins(machine, at, turning.slope, forces, _outboard_moment(machine, at, forces))
    driven = np.isin(np.arange(machine.joints), machine.driven)
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


def equations(machine: Multibody, at: Kinematics, slope: Joints, forces: Forces) -> Float[Array, "n *#batch"]:
    """Return what forces on the bodies ask of bushings and of the pins that elastic belts drive [N m]."""
    moment = _outboard_moment(machine, at, forces)
    on_bushings = flat(matvec(at.project, moment))
    if not machine.loose:
        return on_bushings
    on_pins = _on_pins(machine, at, slope, forces, moment)
    return jnp.concatenate([on_bushings, on_pins[np.asarray(machine.loose)]])


def _outboard_moment(machine: Multibody, at: Kinematics, forces: Forces) -> Phi:
    """Return the moment about each bushing for all bodies beyond it."""
    outboard = inboard_of(machine).T
    moment = forces.on_link + forces.on_shaft + cross(at.centre, forces.force)
    return total(outboard, moment, 1) - cross(at.centre, total(outboard, forces.force, 1))


def _on_pins(machine: Multibody, at: Kinematics, slope: Joints, forces: Forces, moment: Phi) -> Joints:
    pin = (at.axis * (moment - forces.on_shaft)).sum(0)
    return slope * pin + machine.drives.ratio * forces.on_pulley


def _of_bodies(machine: Multibody, at: Kinematics, pulley: Turning) -> Forces:
    """Return the forces of shafts, links, loads and balanced rotors."""
    f_shaft, n_shaft = _newton_euler(machine.shaft, at.shaft, acceleration_map(at.w, at.alpha), at.acceleration)
    f_link, n_link = _newton_euler(machine.link, at.link, acceleration_map(at.w_link, at.alpha_link), at.acceleration)
    f_points, n_points = _points(machine, at.link)
    spin = machine.drives.rotor * (at.axis * pulley.acceleration + cross(at.w, at.axis * pulley.rate))
    on_pulley = machine.drives.rotor * (pulley.acceleration + (at.axis * at.alpha).sum(0))
    return Forces(f_shaft + f_link + f_points, n_link + n_points, n_shaft + spin, on_pulley)


def _newton_euler(moments: Moments, axes: Array, swing: Array, acceleration: Array) -> tuple[Array, Array]:
    """Return force and moment about the bushing (3, N, *batch) that accelerate the bodies.

    The point at r moves with acceleration + swing r.
    """
    first = matvec(axes, moments.first)
    second = matmul(matmul(axes, moments.second), transpose(axes))
    force = moments.mass * acceleration + matvec(swing, first)
    return force, cross(first, acceleration) + axial(matmul(second, transpose(swing)))


def imbalance(machine: Multibody, at: Kinematics, pulley: Turning) -> Forces:
    """Return the forces of the turning masses, in excess of the same masses at rest on their axes.

    The eccentric mass at h axis + e u turns, the same mass at h axis is taken away from the shaft, whose mass has it.
    """
    drives = machine.drives
    angle = pulley.angle + drives.phase
    u = matvec(at.shaft, drives.across[:, 0] * jnp.cos(angle) + drives.across[:, 1] * jnp.sin(angle))
    spin = at.axis * pulley.rate
    swing = acceleration_map(at.w + spin, at.alpha + at.axis * pulley.acceleration + cross(at.w, spin))
    first = drives.imbalance * u
    # the integral of r x (swing r) with r r' = h (axis u' + u axis') + e u u'
    bob = matvec(swing, drives.height * at.axis + drives.reach * u)
    moment = cross(first, at.acceleration + bob) + cross(drives.height * at.axis, matvec(swing, first))
    return Forces(matvec(swing, first), jnp.zeros_like(moment), moment, (at.axis * moment).sum(0))


def _points(machine: Multibody, link: Array) -> tuple[Array, Array]:
    """Return the reaction (3, N, *batch) to the forces on the named points."""
    body = np.asarray(machine.carrier, dtype=int)
    at = np.equal.outer(np.arange(machine.joints), body)
    arm = matvec(link[:, :, body], machine.position)
    force = jnp.broadcast_to(machine.force, arm.shape)
    return -total(at, force, 1), -total(at, cross(arm, force), 1)


def _alike(phi: Phi, *joints: Joints) -> tuple[Phi, Joints, Joints]:
    """Give all the same batch."""
    batch = jnp.broadcast_shapes(phi.shape[2:], *(part.shape[1:] for part in joints))
    xi, error = (jnp.broadcast_to(part, (part.shape[0], *batch)) for part in joints)
    return jnp.broadcast_to(phi, (*phi.shape[:2], *batch)), xi, error


def _sum(one: Forces, other: Forces) -> Forces:
    return Forces(*(a + b for a, b in zip(one, other, strict=True)))
