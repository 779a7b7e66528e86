"""The arm held at a posture under a load: N rigid bodies on N bushings, all axes parallel to the base frame."""

from collections.abc import Sequence
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ident.arm.arm import Arm
from ident.arm.fields import DAMPING, STIFFNESS
from ident.arm.rotations import identity, matmul, matvec, outer, total, transpose, turn_about
from ident.errors import ModelError


class Loads(eqx.Module):
    """A load case: what the arm carries besides its own weight.

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
    return Loads(jnp.zeros((len(arm.payloads), *batch)), jnp.zeros((points, *batch)), jnp.zeros((3, points, *batch)))


class Chain(eqx.Module):
    """An arm at a posture, its pins fixed: body j is everything between bushing j and bushing j + 1.

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


def at_posture(arm: Arm, posture: Float[Array, "driven *#batch"], loads: Loads | None = None) -> Chain:
    """Fix the arm's pins at a posture [rad] under its own weight and the given loads.

    Numbers of the arm may carry batch dimensions too (see `Arm.replace`), no more than the posture, against which they
    broadcast.

    Raises:
        ModelError: the posture has not one angle per driven joint, or fewer batch dimensions than the arm.
    """
    posture = jnp.asarray(posture)
    if posture.shape[:1] != (len(arm.driven),):
        raise ModelError(f"the posture has {posture.shape[0]} angles; {arm.name} has {len(arm.driven)} joints")
    rank = posture.ndim - 1
    loads = _lifted(no_loads(arm) if loads is None else loads, rank)
    before, after = _frames(arm, posture)
    links = jnp.concatenate([before[:, :, :1], after[:, :, :-1]], 2)
    names = [joint.name for joint in arm.joints]
    carrier = tuple(names.index(point.joint) for point in arm.points)
    mass, moment, second = _moments(arm, before, after, loads)
    bend, tors, damping = _bushings(arm, before)
    return Chain(
        offset=matvec(links, stack([joint.offset for joint in arm.joints], 1, rank)),
        mass=mass,
        moment=moment,
        second=second,
        bend=bend,
        tors=tors,
        damping=damping,
        position=_points(arm, carrier, after),
        force=loads.force,
        gravity=arm.gravity,
        frame=before,
        carrier=carrier,
    )


def _lifted(loads: Loads, rank: int) -> Loads:
    """Give a load case as many batch axes as the postures have, unless it has more of its own."""
    axes = max(rank, loads.mass.ndim - 1)
    return Loads(lift(loads.payload, 1, axes), lift(loads.mass, 1, axes), lift(loads.force, 2, axes))


def _frames(arm: Arm, posture: Array) -> tuple[Array, Array]:
    """Return the axes of all shafts and of all links (3, 3, N, *batch) in the base frame."""
    angles, none = iter(posture), jnp.zeros_like(posture[:1]).sum(0)
    angle = jnp.stack([next(angles) if joint.driven else none for joint in arm.joints])
    turn = turn_about(stack([joint.axis for joint in arm.joints], 1, posture.ndim - 1), angle)
    after = [turn[:, :, 0]]
    for j in range(1, len(arm.joints)):
        after.append(matmul(after[-1], turn[:, :, j]))
    base = jnp.broadcast_to(identity(3, turn.ndim - 3), after[0].shape)
    return jnp.stack([base, *after[:-1]], 2), jnp.stack(after, 2)


def _bushings(arm: Arm, frame: Array) -> tuple[Array, Array, Array]:
    """Return the bending stiffness, torsional stiffness and damping matrices of all bushings in base axes."""
    rank = frame.ndim - 3
    k_bend, k_tors, tau_bend, tau_tors = (
        stack([getattr(joint, field) for joint in arm.joints], 0, rank) for field in (*STIFFNESS, *DAMPING)
    )
    axis = matvec(frame, stack([joint.axis for joint in arm.joints], 1, rank))
    along = outer(axis, axis)
    bend, tors = (-along + identity(3, rank + 1)) * k_bend, along * k_tors
    return bend, tors, bend * tau_bend + tors * tau_tors


def _moments(arm: Arm, before: Array, after: Array, loads: Loads) -> tuple[Array, Array, Array]:
    """Return mass, first and second moment about the bushing of all that moves with each joint.

    A mass at a point is a body of 1 kg, a share of which is there, as of a payload.
    """
    rank, names = before.ndim - 3, [joint.name for joint in arm.joints]
    n = len(names)
    parts = [(j, body) for j, joint in enumerate(arm.joints) for body in joint.shaft]
    parts += [(n + j, body) for j, joint in enumerate(arm.joints) for body in joint.link]
    fixed = jnp.ones((len(parts), *loads.mass.shape[1:]))
    parts += [(n + names.index(payload.joint), payload.body) for payload in arm.payloads]
    place, bodies = zip(*parts, strict=True) if parts else ((), ())
    place += tuple(n + names.index(point.joint) for point in arm.points)
    if not place:
        raise ModelError(f"{arm.name} has no mass")

    share = jnp.concatenate([fixed, loads.payload, loads.mass])
    m = share * stack([*(body.mass for body in bodies), *(1.0 for _ in arm.points)], 0, rank)
    com = stack([*(body.com for body in bodies), *(point.position for point in arm.points)], 1, rank)
    inertia = share * stack([*(b.inertia for b in bodies), *(np.zeros((3, 3)) for _ in arm.points)], 2, rank)

    frame = jnp.concatenate([before, after], 2)[:, :, np.array(place)]
    r, turned = matvec(frame, com), matmul(matmul(frame, inertia), transpose(frame))
    half_trace = (inertia[0, 0] + inertia[1, 1] + inertia[2, 2]) / 2
    second = m * outer(r, r) - turned + half_trace * identity(3, rank + 1)
    on = np.equal.outer(np.arange(n), np.array(place) % n)
    return total(on, m, 0), total(on, m * r, 1), total(on, second, 2)


def _points(arm: Arm, carrier: tuple[int, ...], after: Array) -> Array:
    rank = after.ndim - 3
    if not carrier:
        return jnp.zeros((3, 0) + (1,) * rank)
    return matvec(after[:, :, np.array(carrier)], stack([point.position for point in arm.points], 1, rank))


def lift(x: Any, components: int, rank: int) -> Array:
    """Insert singleton batch axes between the components of x and the batch it may carry already."""
    x = jnp.asarray(x)
    own = x.shape[components:]
    if len(own) > rank:
        raise ModelError(f"a number of the arm has {len(own)} batch axes; give the posture as many, of length 1")
    return x.reshape(x.shape[:components] + (1,) * (rank - len(own)) + own)


def stack(items: Sequence[Any], components: int, rank: int) -> Array:
    """Stack over joints, bodies or points, on the axis between components and batch."""
    return jnp.stack(jnp.broadcast_arrays(*(lift(item, components, rank) for item in items)), components)
