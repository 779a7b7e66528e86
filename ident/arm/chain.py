"""The arm at a posture under a load: N rigid bodies on N bushings, all axes parallel to the base frame."""

from dataclasses import replace

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ident.arm.arm import Arm
from ident.arm.assembly import (
    Loads,
    Moments,
    axes,
    bushings,
    carriers,
    curved_springs,
    losses,
    moments,
    no_loads,
    offsets,
    positions,
    stack,
)
from ident.arm.belt_condition import pin_shares
from ident.arm.rotations import identity, matmul, matvec, turn_about
from ident.arm.springs import CurvedSprings, Curves
from ident.errors import ModelError
from ident.jit import AnyArray


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
        force: (3, P, *batch) [N] force on each named point, constant in the base frame.
        gravity: (3,) [m/s^2]
        frame: (3, 3, N, *batch) axes of shaft j, columns, in the base frame.
        carrier: body that carries each named point.
        loss: (3, 3, N, *batch) [N m/rad] what bushing j loses by its loss factors, see `Joint`; None without any.
        curved: where springs are no straight lines; None where all are.
        motors: those that servos hold, where some do; else the pins are fixed.
        couple: (3, P, *batch) [N m] moment at phi = 0 on the body of each named point, see `potential_energy`; None
            where there is none.
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
    loss: Float[Array, "3 3 N *#batch"] | None = None
    curved: CurvedSprings | None = None
    motors: "Motors | None" = None
    couple: Float[Array, "3 P *#batch"] | None = None

    @property
    def stiffness(self) -> Float[Array, "3 3 N *#batch"]:
        """Stiffness of the bushings, without what curved springs add to it [N m/rad]."""
        return self.bend + self.tors


class Motors(eqx.Module):
    """Motors that servos hold, each with a coordinate a: by how much it turns the pin of its own joint [rad].

    Attributes:
        free: the arm with a bushing without stiffness in place of each pin: bodies shaft 1, link 1, shaft 2 and so on.
        axis: (3, N, *batch) axes of the pins in the base frame.
        share: (N, A, *batch) [-] by how much each pin turns with each coordinate.
        ratio: (N, *batch) [-] of each joint's drive.
        rotor: (N, *batch) [kg m^2] what turns with its wave generator, a part of the shaft's inertia.
        stiffness: (A, *batch) [N m/rad] of each servo, seen from its coordinate.
        damping: (A, *batch) [N m s/rad] likewise.
        on: (*batch) 1 where servos hold the motors; 0 where brakes do.
        joint: on whose drive each motor sits.
    """

    free: Chain
    axis: Float[Array, "3 N *#batch"]
    share: Float[Array, "N A *#batch"]
    ratio: Float[Array, "N *#batch"]
    rotor: Float[Array, "N *#batch"]
    stiffness: Float[Array, "A *#batch"]
    damping: Float[Array, "A *#batch"]
    on: Float[Array, "*#batch"]
    joint: tuple[int, ...] = eqx.field(static=True)


def at_posture(
    arm: Arm,
    posture: Float[AnyArray, "driven *#batch"],
    loads: Loads | None = None,
    servo: Float[AnyArray, "*#batch"] | None = None,
) -> Chain:
    """Fix the arm's pins at a posture [rad] under its own weight and the given loads.

    Numbers of the arm may carry batch dimensions too (see `Arm.replace`), no more than the posture, against which they
    broadcast.

    Args:
        arm: the arm.
        posture: [rad] angles at which the pins are held.
        loads: the load case.
        servo: 1 where the arm's servos hold the motors, 0 where brakes do; brakes everywhere when None.

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
    shaft, link = moments(arm, loads, loads.mass.ndim - 1)
    shaft, link = shaft.along(before), link.along(after)
    bend, tors, damping = bushings(arm, matvec(before, axes(arm, rank)))
    carrier = carriers(arm)
    held = Chain(
        offset=matvec(links, offsets(arm, rank)),
        mass=shaft.mass + link.mass,
        moment=shaft.first + link.first,
        second=shaft.second + link.second,
        bend=bend,
        tors=tors,
        damping=damping,
        position=matvec(after[:, :, np.array(carrier, int)], positions(arm, rank)),
        force=loads.force,
        gravity=arm.gravity,
        frame=before,
        carrier=carrier,
        loss=losses(arm, bend, tors),
        couple=loads.moment,
        curved=curved_springs(arm, matvec(before, axes(arm, rank))),
    )
    if servo is None or not arm.servos:
        return held
    return replace(held, motors=_motors(arm, _unpinned(held, shaft, link), matvec(before, axes(arm, rank)), servo))


def _unpinned(held: Chain, shaft: Moments, link: Moments) -> Chain:
    """Return the chain with a bushing without stiffness in place of each pin, a body before it and one behind."""

    def both(x: Array, y: Array, axis: int) -> Array:
        pairs = jnp.stack(jnp.broadcast_arrays(x, y), axis + 1)
        return pairs.reshape((*pairs.shape[:axis], -1, *pairs.shape[axis + 2 :]))

    def at_bushings(x: Array, axis: int) -> Array:
        return both(x, jnp.zeros_like(x), axis)

    def curves(x: Curves | None) -> Curves | None:
        if x is None:
            return None
        return Curves(at_bushings(x.rise, 1), both(x.angle, x.angle, 1), at_bushings(x.cubic, 0))

    def with_pins(x: CurvedSprings | None) -> CurvedSprings | None:
        return None if x is None else CurvedSprings(both(x.axis, x.axis, 1), curves(x.bend), curves(x.tors))

    return replace(
        held,
        curved=with_pins(held.curved),
        offset=at_bushings(held.offset, 1),
        mass=both(shaft.mass, link.mass, 0),
        moment=both(shaft.first, link.first, 1),
        second=both(shaft.second, link.second, 2),
        bend=at_bushings(held.bend, 2),
        tors=at_bushings(held.tors, 2),
        damping=at_bushings(held.damping, 2),
        frame=both(held.frame, held.frame, 2),
        carrier=tuple(2 * body + 1 for body in held.carrier),
    )


def _motors(arm: Arm, free: Chain, axis: Float[Array, "3 N *#batch"], on: Float[AnyArray, "*#batch"]) -> Motors:
    rank, drives = axis.ndim - 2, {drive.joint: drive for drive in arm.drives}
    by_servo = [pin_shares(arm, servo.joint) for servo in arm.servos]
    shares = [stack([each.get(joint.name, 0.0) for joint in arm.joints], 0, rank) for each in by_servo]
    ratio, rotor = (
        stack([getattr(drives[j.name], field) if j.name in drives else 0.0 for j in arm.joints], 0, rank)
        for field in ("ratio", "rotor_inertia")
    )
    stiffness = stack([servo.k_servo * drives[servo.joint].ratio ** 2 for servo in arm.servos], 0, rank)
    joint = tuple([each.name for each in arm.joints].index(servo.joint) for servo in arm.servos)
    return Motors(
        free=free,
        axis=axis,
        share=jnp.stack(jnp.broadcast_arrays(*shares), 1),
        ratio=ratio,
        rotor=rotor,
        stiffness=stiffness,
        damping=stiffness * stack([servo.tau for servo in arm.servos], 0, rank),
        on=jnp.asarray(on, float),
        joint=joint,
    )


def _lifted(loads: Loads, rank: int) -> Loads:
    """Give a load case as many batch axes as the postures have, unless it has more of its own."""
    return loads.lifted(max(rank, loads.mass.ndim - 1))


def body_axes(arm: Arm, posture: Float[AnyArray, "driven"], body: str) -> Float[np.ndarray, "3 3"]:
    """Return the axes of a body, columns, in the base frame, at a posture [rad] without elastic rotation.

    Raises:
        KeyError: the arm has no such body.
    """
    before, after = (np.asarray(each) for each in _frames(arm, jnp.asarray(posture, float)))
    carried = {payload.body.name: payload.joint for payload in arm.payloads}
    for j, joint in enumerate(arm.joints):
        if body in {each.name for each in joint.shaft}:
            return before[:, :, j]
        if body in {each.name for each in joint.link} or carried.get(body) == joint.name:
            return after[:, :, j]
    raise KeyError(body)


def _frames(arm: Arm, posture: Array) -> tuple[Array, Array]:
    """Return the axes of all shafts and of all links (3, 3, N, *batch) in the base frame."""
    angles, none = iter(posture), jnp.zeros_like(posture[:1]).sum(0)
    angle = jnp.stack([next(angles) if joint.driven else none for joint in arm.joints])
    turn = turn_about(axes(arm, posture.ndim - 1), angle)
    after = [turn[:, :, 0]]
    for j in range(1, len(arm.joints)):
        after.append(matmul(after[-1], turn[:, :, j]))
    base = jnp.broadcast_to(identity(3, turn.ndim - 3), after[0].shape)
    return jnp.stack([base, *after[:-1]], 2), jnp.stack(after, 2)
