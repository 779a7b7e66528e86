"""Measured shapes of modes: how a mode moves points along directions, over how it moves a reference.

Design. A row is the ratio r_i of two motions of a mode, so that neither scale nor sign matters; n rows are what is
known of a shape at n + 1 places, and have n degrees of freedom. The model's own ratio u_i / u_0 runs away where its
mode does not move the reference. So, with y = (1, r) the measured shape and p the multiple of u that is nearest to y,

    predicted = r + (1 + r r') (p - y)_i,    i = 1 ... n,

which is u_i / u_0 up to the square of their difference, and never larger than the measured shape allows: p - y is the
residual in the plane across the model's shape.

The shape of a damped mode (`pole`) is complex. Measured and computed ones are turned by the same rule, so that they
are as real as can be at the places of the shape: by the angle a that makes the sum of (u exp(-i a))^2 positive. Their
real parts are compared; without damping nothing is turned.

Where another mode b has nearly the same frequency both are known as the plane that they span only, and p may leave the
direction of u within it: p is the point of that plane that is nearest to y, a step t b across u counting for
t^2 |u|^2 (g / NEAR)^2, where g is the relative distance of the squared frequencies. So modes far apart are compared as
they are, modes that coincide as a plane, and the prediction is smooth throughout, as shapes turn by 1/g at most.
"""

from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Complex, Float, Inexact, Int

from ident.arm.arm import Arm
from ident.arm.chain import Chain
from ident.arm.equilibrium import StaticEquilibrium
from ident.arm.modes import Modes, linearize
from ident.arm.shapes import moving_points, moving_points_damped
from ident.inference.parameters import AnyArray
from ident.measure import Measurement

NEAR = 0.02
"""Relative distance of squared frequencies at which two modes count half as their plane: 1 % in frequency."""
SHAPE_ROUNDING = 1e-12
"""The square of that distance below which they are taken to coincide."""


class Shapes(eqx.Module):
    """Rows of shapes, each with the whole shape that it is of, so that they may come in any order.

    Attributes:
        own: (n,) which of the places of its shape a row is; the reference is place 0.
        points: (n, K) points of the arm.
        direction: (3, n, K) unit vectors, zero beyond the places that a shape has.
        ratio: (n, K) measured motion over that of the reference, zero likewise.
        damped: (n,) whether it is the shape of the damped mode; None where none is.
    """

    own: Int[AnyArray, "n"]
    points: Int[AnyArray, "n K"]
    direction: Float[AnyArray, "3 n K"]
    ratio: Float[AnyArray, "n K"]
    damped: Bool[AnyArray, "n"] | None = None

    def of(self, places: Int[np.ndarray, "_"]) -> "Shapes":
        """Return some of the rows."""
        damped = None if self.damped is None else self.damped[places]
        return Shapes(self.own[places], self.points[places], self.direction[:, places], self.ratio[places], damped)


def shapes_of(arm: Arm, rows: Sequence[Measurement]) -> Shapes | None:
    """Return rows of shapes as the model needs them; None for none."""
    whole: dict[tuple[object, ...], list[Measurement]] = {}
    for m in rows:
        whole.setdefault(_shape(m), []).append(m)
    if not whole:
        return None
    names, size = [point.name for point in arm.points], 1 + max(map(len, whole.values()))
    own, points = np.empty(len(rows), int), np.zeros((len(rows), size), int)
    direction, ratio = np.zeros((3, len(rows), size)), np.zeros((len(rows), size))
    for i, m in enumerate(rows):
        each = whole[_shape(m)]
        own[i], ratio[i, 0] = 1 + next(place for place, other in enumerate(each) if other is m), 1.0
        points[i, 0], direction[:, i, 0] = names.index(m.reference_point or ""), m.reference_direction or ()
        for place, other in enumerate(each, 1):
            points[i, place], ratio[i, place] = names.index(other.point or ""), other.value
            direction[:, i, place] = other.direction or ()
    damped = np.array([m.of is not None for m in rows])
    return Shapes(own, points, direction, ratio, damped if damped.any() else None)


def _shape(m: Measurement) -> tuple[object, ...]:
    """Return what rows of one shape have in common."""
    return m.posture, m.load, m.drives, m.mode, m.of, m.reference_point, m.reference_direction, m.repeat


def read_shapes(
    chain: Chain,
    at: StaticEquilibrium,
    modes: Modes,
    shapes: Shapes,
    states: Int[AnyArray, "n"],
    chosen: Float[AnyArray, "m n *batch"],
) -> Float[Array, "n *batch"]:
    """Return what is read of the chosen modes' shapes [-]; NaN where none is chosen.

    Args:
        chain: in all states, batch (S, *batch).
        at: its equilibrium.
        modes: all of its modes.
        shapes: the rows.
        states: of the rows.
        chosen: one for the mode of each row.
    """
    linear = linearize(chain, at)
    motion = moving_points(chain, linear, modes)
    rank = motion.ndim - 4
    each = _seen(motion, shapes, states)
    hertz = modes.frequency[:, states]
    gap = (hertz / (hertz * chosen).sum(0)) ** 2 - 1
    others = jnp.where(chosen > 0, jnp.inf, jnp.abs(gap))
    nearest = jax.lax.stop_gradient(jnp.arange(len(others)).reshape((-1,) + (1,) * (rank + 1)) == jnp.argmin(others, 0))
    u, b = _of_modes(each, chosen), _of_modes(each, nearest)
    weight = (u * u).sum(0) * (((gap * nearest).sum(0) / NEAR) ** 2 + SHAPE_ROUNDING)
    if shapes.damped is not None:
        damped = as_real(_seen(moving_points_damped(chain, linear), shapes, states))
        u = jnp.where(_lifted(shapes.damped, rank), _of_modes(damped, chosen), u)
    read = _compared(jnp.moveaxis(_lifted(shapes.ratio, rank), 1, 0), u, b, weight)
    own = jnp.take_along_axis(read, jnp.broadcast_to(_lifted(shapes.own, rank), read.shape[1:])[None], 0)[0]
    return jnp.where(chosen.sum(0) > 0, own, jnp.nan)


def _seen(motion: Inexact[Array, "3 P m S *batch"], shapes: Shapes, states: AnyArray) -> Inexact[Array, "n K m *batch"]:
    """Return how the places of each shape move along their directions in all modes."""
    moved = motion[:, jnp.asarray(shapes.points), :, jnp.asarray(states)[:, None]]
    return (moved * jnp.moveaxis(_lifted(shapes.direction, motion.ndim - 3), 0, 2)).sum(2)


def _of_modes(each: Float[Array, "n K m *batch"], chosen: AnyArray) -> Float[Array, "K n *batch"]:
    """Return what the chosen mode of each row does."""
    return jnp.moveaxis((each * jnp.moveaxis(chosen, 0, 1)[:, None]).sum(2), 1, 0)


def as_real(shapes: Complex[Array, "n K *batch"]) -> Float[Array, "n K *batch"]:
    """Return the real parts of shapes that are turned so that they are as real as can be."""
    squared = (shapes**2).sum(1, keepdims=True)
    squared = jnp.where(squared == 0, 1.0, squared)  # a mode that moves none of the places
    return (shapes / jnp.sqrt(squared / jnp.abs(squared))).real


def _compared(
    y: Float[AnyArray, "K n *#batch"],
    u: Float[AnyArray, "K n *batch"],
    b: Float[AnyArray, "K n *batch"],
    weight: Float[AnyArray, "n *batch"],
) -> Float[AnyArray, "K n *batch"]:
    """Return the predicted ratios; that of the reference, which is no row, means nothing.

    A step t b across u counts for t^2 weight.
    """
    length = (u * u).sum(0) + 1e-30
    across = b - u * (u * b).sum(0) / length
    step = (across * y).sum(0) / ((across * across).sum(0) + weight)
    off = u * (u * y).sum(0) / length + across * step - y
    return y + off + y * (y[1:] * off[1:]).sum(0)


def _lifted(x: AnyArray, rank: int) -> Array:
    """Give an array as many batch axes as the predictions have."""
    return jnp.asarray(x).reshape(x.shape + (1,) * rank)
