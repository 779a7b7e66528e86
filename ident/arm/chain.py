"""The arm at a posture under a load: N rigid bodies on N bushings, all axes parallel to the base frame."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ident.arm.arm import Arm
from ident.arm.belts import pin_shares
from ident.arm.fields import DAMPING, LOSS, STIFFNESS
from ident.arm.parts import DIRECTIONS, STIFFNESS_OF, CubicSpring, CurvedSprings, Curves, Spring, bends
from ident.arm.rotations import axes_before, chained, identity, matmul, matvec, outer, total, transpose, turn_about
from ident.errors import ModelError
from ident.programs import AnyArray

# -------- Assembly
# What every model of an arm is assembled of: loads, moments of mass, bushings, named points.

STRAIGHT = {"ratio2": 1.0, "ratio3": 1.0, "torque1": 1.0, "torque2": 1.0}
"""Numbers of a `Spring` that is a straight line."""

Square = Float[Array, "3 3 N *#batch"]


class Loads(eqx.Module):
    """A load case: what the arm carries besides its own weight.

    Attributes:
        payload: (n_payloads, *batch) [-] how much of each payload is there, 0 or 1.
        mass: (n_points, *batch) [kg] point mass at each named point.
        force: (3, n_points, *batch) [N] force on each named point, constant in the base frame.
        moment: (3, n_points, *batch) [N m] moment on the body that carries each named point; None where there is none.
    """

    payload: Float[Array, "n_payloads *#batch"]
    mass: Float[Array, "n_points *#batch"]
    force: Float[Array, "3 n_points *#batch"]
    moment: Float[Array, "3 n_points *#batch"] | None = None

    def lifted(self, rank: int) -> "Loads":
        """Return them with so many batch axes at least."""
        moment = None if self.moment is None else lift(self.moment, 2, rank)
        return Loads(lift(self.payload, 1, rank), lift(self.mass, 1, rank), lift(self.force, 2, rank), moment)


def no_loads(arm: Arm) -> Loads:
    """Return the load case of the arm's own weight."""
    points = len(arm.points)
    return Loads(jnp.zeros(len(arm.payloads)), jnp.zeros(points), jnp.zeros((3, points)))


class Moments(eqx.Module):
    """Moments of mass about a bushing, per joint.

    Attributes:
        mass: (N, *batch) [kg]
        first: (3, N, *batch) [kg m]
        second: (3, 3, N, *batch) [kg m^2] the integral of r r' dm.
    """

    mass: Float[Array, "N *#batch"]
    first: Float[Array, "3 N *#batch"]
    second: Square

    def along(self, axes: Square) -> "Moments":
        """Return the moments in another frame, in which these are the axes of each joint."""
        second = matmul(matmul(axes, self.second), transpose(axes))
        return Moments(self.mass, matvec(axes, self.first), second)


def moments(arm: Arm, loads: Loads, rank: int) -> tuple[Moments, Moments]:
    """Return the moments of all before each pin along the shaft's axes, and behind it, with loads, along the link's.

    A point mass is a body of 1 kg scaled by its share, like a payload.

    Args:
        arm: the arm.
        loads: the load case, with `rank` batch axes.
        rank: number of batch axes.

    Raises:
        ModelError: the arm has no mass, or a number of it has more batch axes.
    """
    names = [joint.name for joint in arm.joints]
    n = len(names)
    parts = [(j, body) for j, joint in enumerate(arm.joints) for body in joint.shaft]
    parts += [(n + j, body) for j, joint in enumerate(arm.joints) for body in joint.link]
    fixed = jnp.ones((len(parts), *(1,) * rank))
    parts += [(n + names.index(payload.joint), payload.body) for payload in arm.payloads]
    carrier, bodies = zip(*parts, strict=True) if parts else ((), ())
    carrier += tuple(n + names.index(point.joint) for point in arm.points)
    if not carrier:
        raise ModelError(f"{arm.name} has no mass")

    loaded = jnp.concatenate([loads.payload, loads.mass])
    share = jnp.concatenate([jnp.broadcast_to(fixed, (len(fixed), *loaded.shape[1:])), loaded])
    m = share * stack([*(body.mass for body in bodies), *(1.0 for _ in arm.points)], 0, rank)
    r = stack([*(body.com for body in bodies), *(point.position for point in arm.points)], 1, rank)
    inertia = share * stack([*(b.inertia for b in bodies), *(np.zeros((3, 3)) for _ in arm.points)], 2, rank)
    half_trace = (inertia[0, 0] + inertia[1, 1] + inertia[2, 2]) / 2
    second = m * outer(r, r) - inertia + half_trace * identity(3, rank + 1)

    def carried(first: int) -> Moments:
        on = np.equal.outer(np.arange(first, first + n), np.array(carrier))
        return Moments(total(on, m, 0), total(on, m * r, 1), total(on, second, 2))

    return carried(0), carried(n)


def bushings(arm: Arm, axis: Float[Array, "3 N *#batch"]) -> tuple[Square, Square, Square]:
    """Return bending stiffness, torsional stiffness [N m/rad] and damping [N m s/rad] of the bushings.

    Their components are along the frame in which the pins have these axes.
    """
    k_bend, k_tors, tau_bend, tau_tors = (_of_bushings(arm, field, axis.ndim - 2) for field in (*STIFFNESS, *DAMPING))
    across, along = _projectors(axis)
    bend, tors = across * k_bend, along * k_tors
    return bend, tors, bend * tau_bend + tors * tau_tors


def rigid_directions(arm: Arm, axis: Float[Array, "3 N *#batch"]) -> Square | None:
    """Return the projectors on the directions in which bushings are rigid, likewise; None if none is."""
    if arm.degrees_of_freedom == 3 * len(arm.joints):
        return None
    rigid = ([float(getattr(joint, field) is None) for joint in arm.joints] for field in STIFFNESS)
    across, along = (P * stack(row, 0, axis.ndim - 2) for P, row in zip(_projectors(axis), rigid, strict=True))
    return across + along


def _projectors(axis: Float[Array, "3 N *#batch"]) -> tuple[Square, Square]:
    along = outer(axis, axis)
    return -along + identity(3, axis.ndim - 1), along


def _of_bushings(arm: Arm, field: str, rank: int) -> Float[Array, "N *#batch"]:
    """Return a number of all bushings, zero where it is None."""
    return stack([0.0 if (x := getattr(joint, field)) is None else x for joint in arm.joints], 0, rank)


def losses(arm: Arm, bend: Square, tors: Square) -> Square | None:
    """Return what bushings of these stiffnesses lose by their loss factors [N m/rad]; None if none has any."""
    if all(getattr(joint, field) is None for joint in arm.joints for field in LOSS):
        return None
    eta_bend, eta_tors = (_of_bushings(arm, field, bend.ndim - 3) for field in LOSS)
    return bend * eta_bend + tors * eta_tors


def curved_springs(arm: Arm, axis: Float[Array, "3 N *#batch"]) -> CurvedSprings | None:
    """Return where springs are no straight lines, with these axes of the pins; None if all are."""
    if not arm.springs:
        return None
    return CurvedSprings(axis, *(_curves(arm, direction, axis.ndim - 2) for direction in DIRECTIONS))


def _curves(arm: Arm, direction: str, rank: int) -> Curves | None:
    by_joint = {spring.joint: spring for spring in arm.springs if spring.direction == direction}
    if not by_joint:
        return None
    rises, angles, cubics = [], [], []
    for joint in arm.joints:
        k, spring = getattr(joint, STIFFNESS_OF[direction]), by_joint.get(joint.name)
        k = 1.0 if k is None else k  # no spring bends there
        broken = spring if isinstance(spring, Spring) else Spring("", joint.name, direction, **STRAIGHT)
        rises.append([k * (broken.ratio2 - 1), k * (broken.ratio3 - broken.ratio2)])
        angles.append(bends(broken, k))
        cubics.append(spring.cubic if isinstance(spring, CubicSpring) else np.zeros(()))

    def pair(rows: Sequence[Any]) -> Array:
        return jnp.stack(jnp.broadcast_arrays(*(stack(each, 0, rank) for each in zip(*rows, strict=True))))

    return Curves(pair(rises), pair(angles), stack(cubics, 0, rank))


def axes(arm: Arm, rank: int) -> Float[Array, "3 N *ones"]:
    """Return the axes of the pins along those of their shafts."""
    return stack([joint.axis for joint in arm.joints], 1, rank)


def offsets(arm: Arm, rank: int) -> Float[Array, "3 N *#batch"]:
    """Return the bushings' centres in the axes of the link before [m]."""
    return stack([joint.offset for joint in arm.joints], 1, rank)


def positions(arm: Arm, rank: int) -> Float[Array, "3 P *#batch"]:
    """Return the named points along the axes of their link [m]."""
    return stack([p.position for p in arm.points], 1, rank) if arm.points else jnp.zeros((3, 0) + (1,) * rank)


def carriers(arm: Arm) -> tuple[int, ...]:
    """Return the joint that carries each named point."""
    names = [joint.name for joint in arm.joints]
    return tuple(names.index(point.joint) for point in arm.points)


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


# -------- Chain


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
        alpha: (*batch) [1/s] damping per mass; None without any.
        curved: where springs are no straight lines; None where all are.
        motors: motors held by servos; without any, the pins are fixed.
        couple: (3, P, *batch) [N m] moment at phi = 0 on the body of each named point, which turns along by half the
            body's rotation (semitangential; one that keeps its direction has no potential); None where there is none.
        rigid: (3, 3, N, *batch) projectors on the directions in which bushings are rigid; None where all give.
        modes: number of elastic coordinates: 3 N less those directions.
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
    alpha: Float[Array, "*#batch"] | None = None
    curved: CurvedSprings | None = None
    motors: "Motors | None" = None
    couple: Float[Array, "3 P *#batch"] | None = None
    rigid: Float[Array, "3 3 N *#batch"] | None = None
    modes: int = eqx.field(static=True, default=0)

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
        ModelError: the posture does not have one angle per driven joint, or has fewer batch dimensions than the arm.
    """
    posture = jnp.asarray(posture)
    if posture.shape[:1] != (len(arm.driven),):
        raise ModelError(f"the posture has {posture.shape[0]} angles; {arm.name} has {len(arm.driven)} joints")
    rank = posture.ndim - 1
    loads = no_loads(arm) if loads is None else loads
    loads = loads.lifted(max(rank, loads.mass.ndim - 1))
    before, after = _frames(arm, posture)
    links = jnp.concatenate([before[:, :, :1], after[:, :, :-1]], 2)
    shaft, link = moments(arm, loads, loads.mass.ndim - 1)
    shaft, link = shaft.along(before), link.along(after)
    axis = matvec(before, axes(arm, rank))
    bend, tors, damping = bushings(arm, axis)
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
        alpha=arm.damping.alpha,
        couple=loads.moment,
        curved=curved_springs(arm, axis),
        rigid=rigid_directions(arm, axis),
        modes=arm.degrees_of_freedom,
    )
    if servo is None or not arm.servos:
        return held
    return replace(held, motors=_motors(arm, _unpinned(held, shaft, link), axis, servo))


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

    curved = held.curved
    return replace(
        held,
        curved=curved and CurvedSprings(both(curved.axis, curved.axis, 1), curves(curved.bend), curves(curved.tors)),
        offset=at_bushings(held.offset, 1),
        mass=both(shaft.mass, link.mass, 0),
        moment=both(shaft.first, link.first, 1),
        second=both(shaft.second, link.second, 2),
        bend=at_bushings(held.bend, 2),
        tors=at_bushings(held.tors, 2),
        damping=at_bushings(held.damping, 2),
        loss=None if held.loss is None else at_bushings(held.loss, 2),
        frame=both(held.frame, held.frame, 2),
        rigid=None if held.rigid is None else at_bushings(held.rigid, 2),
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


def link_axes(arm: Arm, posture: Float[AnyArray, "driven *batch"]) -> Float[Array, "3 3 N *batch"]:
    """Return the axes of all links, columns, in the base frame, at a posture [rad] without elastic rotation."""
    return _frames(arm, jnp.asarray(posture, float))[1]


def _frames(arm: Arm, posture: Array) -> tuple[Array, Array]:
    """Return the axes of all shafts and of all links (3, 3, N, *batch) in the base frame."""
    angles, none = iter(posture), jnp.zeros_like(posture[:1]).sum(0)
    angle = jnp.stack([next(angles) if joint.driven else none for joint in arm.joints])
    after = chained(turn_about(axes(arm, posture.ndim - 1), angle))
    return axes_before(after), after
