"""The arm held at a posture under a load: N rigid bodies on N bushings, all axes parallel to the base frame."""

from typing import Any

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ident.arm.arm import Arm, Body, Joint
from ident.arm.rotations import identity, matmul, matvec, outer, transpose, turn_about
from ident.errors import ModelError


class Loads(eqx.Module):
    """What hangs on the arm besides its own weight.

    Attributes:
        payload: (n_payloads, *batch) [-] how much of each payload is there, 0 or 1.
        mass: (n_points, *batch) [kg] point mass at each named point.
        force: (3, n_points, *batch) [N] force on each named point, constant in the base frame.
    """

    payload: Float[Array, "n_payloads *#batch"]
    mass: Float[Array, "n_points *#batch"]
    force: Float[Array, "3 n_points *#batch"]


def no_loads(arm: Arm, batch: tuple[int, ...] = ()) -> Loads:
    """Return the load case of the arm's own weight."""
    points = len(arm.points)
    return Loads(
        jnp.zeros((len(arm.payloads), *batch)), jnp.zeros((points, *batch)), jnp.zeros((3, points, *batch))
    )


class Chain(eqx.Module):
    """An arm whose pins are held: body j is everything between bushing j and bushing j + 1.

    At zero elastic rotation every body's axes are parallel to the base frame, so that `phi` `(3, N, *batch)`, the
    bushings' rotation vectors, has its components along the base axes too. `frame` turns them into the shafts'.

    Attributes:
        offset: (3, N, *batch) [m] from bushing j - 1 (the base origin for the first) to bushing j.
        mass: (N, *batch) [kg]
        moment: (3, N, *batch) [kg m] first moment of mass about bushing j.
        second: (3, 3, N, *batch) [kg m^2] second moment of mass, the integral of r r' dm, about bushing j.
        bend: (3, 3, N, *batch) [N m/rad] bending part of the stiffness of bushing j.
        tors: (3, 3, N, *batch) [N m/rad] torsional part of it.
        damping: (3, 3, N, *batch) [N m s/rad] damping of bushing j.
        position: (3, P, *batch) [m] named points from the bushing of their body.
        force: (3, P, *batch) [N] force on each named point.
        gravity: (3,) [m/s^2]
        frame: (3, 3, N, *batch) axes of shaft j, columns, in the base frame.
        carrier: body that carries each named point.
    """

    offset: Float[Array, "3 N *#batch"]
    mass: Float[Array, "N *#batch"]
    moment: Float[Array, "3 N *#batch"]
    second: Float[Array, "3 3 N *#batch"]
    bend: Float[Array, "3 3 N *#batch"]
    tors: Float[Array, "3 3 N *#batch"]
    damping: Float[Array, "3 3 N *#batch"]
    position: Float[Array, "3 P *#batch"]
    force: Float[Array, "3 P *#batch"]
    gravity: Float[Array, "3"]
    frame: Float[Array, "3 3 N *#batch"]
    carrier: tuple[int, ...] = eqx.field(static=True)

    @property
    def stiffness(self) -> Float[Array, "3 3 N *#batch"]:
        """Stiffness of the bushings [N m/rad]."""
        return self.bend + self.tors


def hold(arm: Arm, posture: Float[Array, "driven *#batch"], loads: Loads | None = None) -> Chain:
    """Hold the arm's pins at a posture [rad] under its own weight and the given loads.

    Numbers of the arm may carry batch dimensions too (see `Arm.replace`); they broadcast against the posture's.

    Raises:
        ModelError: the posture has not one angle per driven joint.
    """
    posture = jnp.asarray(posture)
    if posture.shape[:1] != (len(arm.driven),):
        raise ModelError(f"the posture has {posture.shape[0]} angles; {arm.name} has {len(arm.driven)} joints")
    rank = posture.ndim - 1
    loads = no_loads(arm, (1,) * rank) if loads is None else loads
    before, after = _frames(arm, posture)
    bodies = [_body(arm, index, before[index], after[index], loads) for index in range(len(arm.joints))]
    links = [identity(3, rank), *after[:-1]]
    carrier = tuple([joint.name for joint in arm.joints].index(point.joint) for point in arm.points)
    springs = [_bushing(joint, frame) for joint, frame in zip(arm.joints, before, strict=True)]
    return Chain(
        offset=_stack([matvec(F, _lift(j.offset, 1, rank)) for j, F in zip(arm.joints, links, strict=True)], 1),
        mass=_stack([body[0] for body in bodies], 0),
        moment=_stack([body[1] for body in bodies], 1),
        second=_stack([body[2] for body in bodies], 2),
        bend=_stack([spring[0] for spring in springs], 2),
        tors=_stack([spring[1] for spring in springs], 2),
        damping=_stack([spring[2] for spring in springs], 2),
        position=_points(arm, carrier, after, rank),
        force=loads.force,
        gravity=arm.gravity,
        frame=_stack(before, 2),
        carrier=carrier,
    )


def _frames(arm: Arm, posture: Array) -> tuple[list[Array], list[Array]]:
    """Return the axes of each shaft and of each link (3, 3, *batch) in the base frame."""
    rank, angles = posture.ndim - 1, iter(posture)
    frame, before, after = identity(3, rank), [], []
    for joint in arm.joints:
        before.append(frame)
        if joint.driven:
            frame = matmul(frame, turn_about(_lift(joint.axis, 1, rank), next(angles)))
        after.append(frame)
    return before, after


def _bushing(joint: Joint, frame: Array) -> tuple[Array, Array, Array]:
    """Return the bending stiffness, torsional stiffness and damping matrices of one bushing in base axes."""
    rank = frame.ndim - 2
    axis = matvec(frame, _lift(joint.axis, 1, rank))
    along = outer(axis, axis)
    bend = (identity(3, rank) - along) * joint.k_bend
    tors = along * joint.k_tors
    return bend, tors, bend * joint.tau_bend + tors * joint.tau_tors


def _body(arm: Arm, index: int, before: Array, after: Array, loads: Loads) -> tuple[Array, Array, Array]:
    """Return mass, first and second moment about the bushing of all that moves with one joint."""
    joint, rank = arm.joints[index], before.ndim - 2
    parts = [_moments(body, before, 1.0) for body in joint.shaft]
    parts += [_moments(body, after, 1.0) for body in joint.link]
    for payload, share in zip(arm.payloads, loads.payload, strict=True):
        if payload.joint == joint.name:
            parts.append(_moments(payload.body, after, share))
    for point, mass in zip(arm.points, loads.mass, strict=True):
        if point.joint == joint.name:
            r = matvec(after, _lift(point.position, 1, rank))
            parts.append((mass, mass * r, mass * outer(r, r)))
    if not parts:
        return jnp.zeros((1,) * rank), jnp.zeros((3,) + (1,) * rank), jnp.zeros((3, 3) + (1,) * rank)
    mass, first, second = (sum(column[1:], column[0]) for column in zip(*parts, strict=True))
    return mass, first, second


def _moments(body: Body, frame: Array, share: Any) -> tuple[Array, Array, Array]:
    rank = frame.ndim - 2
    mass = _lift(body.mass, 0, rank) * share
    r = matvec(frame, _lift(body.com, 1, rank))
    inertia = matmul(matmul(frame, _lift(body.inertia, 2, rank)), transpose(frame)) * share
    trace = inertia[0, 0] + inertia[1, 1] + inertia[2, 2]
    return mass, mass * r, trace / 2 * identity(3, rank) - inertia + mass * outer(r, r)


def _points(arm: Arm, carrier: tuple[int, ...], after: list[Array], rank: int) -> Array:
    placed = [matvec(after[k], _lift(p.position, 1, rank)) for k, p in zip(carrier, arm.points, strict=True)]
    return _stack(placed, 1) if placed else jnp.zeros((3, 0) + (1,) * rank)


def _lift(x: Any, components: int, rank: int) -> Array:
    """Insert singleton batch axes between the components of x and the batch it may carry already."""
    x = jnp.asarray(x)
    own = x.shape[components:]
    return x.reshape(x.shape[:components] + (1,) * (rank - len(own)) + own)


def _stack(items: list[Array], components: int) -> Array:
    """Stack over joints or points, on the axis between components and batch."""
    return jnp.stack(jnp.broadcast_arrays(*items), components)
