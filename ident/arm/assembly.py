"""What every model of an arm is assembled of: loads, moments of mass, bushings, named points."""

from collections.abc import Sequence
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ident.arm.arm import Arm
from ident.arm.fields import DAMPING, LOSS, STIFFNESS
from ident.arm.rotations import identity, matmul, matvec, outer, total, transpose
from ident.arm.springs import DIRECTIONS, STIFFNESS_OF, CubicSpring, CurvedSprings, Curves, Spring, bends
from ident.errors import ModelError

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


def no_loads(arm: Arm, batch: tuple[int, ...] = ()) -> Loads:
    """Return the load case of the arm's own weight."""
    points = len(arm.points)
    return Loads(jnp.zeros((len(arm.payloads), *batch)), jnp.zeros((points, *batch)), jnp.zeros((3, points, *batch)))


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

    A mass at a point is a body of 1 kg, a share of which is there, as of a payload.

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
    rank = axis.ndim - 2
    k_bend, k_tors, tau_bend, tau_tors = (
        stack([getattr(joint, field) for joint in arm.joints], 0, rank) for field in (*STIFFNESS, *DAMPING)
    )
    along = outer(axis, axis)
    bend, tors = (-along + identity(3, rank + 1)) * k_bend, along * k_tors
    return bend, tors, bend * tau_bend + tors * tau_tors


def losses(arm: Arm, bend: Square, tors: Square) -> Square | None:
    """Return what bushings of these stiffnesses lose by their loss factors [N m/rad]; None if none has any."""
    if all(getattr(joint, field) is None for joint in arm.joints for field in LOSS):
        return None
    rank = bend.ndim - 3
    eta = (stack([0.0 if (x := getattr(j, field)) is None else x for j in arm.joints], 0, rank) for field in LOSS)
    return bend * next(eta) + tors * next(eta)


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
