"""Rotations and 3-vectors, components first and batch last."""

import math
from functools import partial, reduce

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Inexact

Vector = Float[Array, "3 *#batch"]
Matrix = Float[Array, "3 3 *#batch"]
Components = tuple[Array, ...]
"""Of a vector, an array each: what they have in common is computed once, where XLA would do it for each of them."""

CROSS = np.cross(np.eye(3), np.eye(3)[:, None])
"""Entry (i, k) of [v] is CROSS[i, k] . v."""
TERMS = 16
"""Terms of the power series below, a power of two; the first one left out is far below 1e-17 for angles up to 3 rad."""
TINY = 1e-6
"""Squared tangent of half an angle below which three terms of the arc tangent's series are exact to rounding."""
ORDERS = 4
"""Derivatives of the series at hand; differentiation ends there."""


def matmul(a: Inexact[Array, "i k *#batch"], b: Inexact[Array, "k j *#batch"]) -> Inexact[Array, "i j *#batch"]:
    """Return a b. A sum of products: XLA's batched matrix product is far slower on matrices this small."""
    return (a[:, :, None] * b[None]).sum(1)


def matvec(a: Float[Array, "i k *#batch"], v: Float[Array, "k *#batch"]) -> Float[Array, "i *#batch"]:
    """Return a v."""
    return (a * v[None]).sum(1)


def transpose(a: Float[Array, "i k *batch"]) -> Float[Array, "k i *batch"]:
    """Return a', batch untouched."""
    return jnp.swapaxes(a, 0, 1)


def outer(a: Float[Array, "i *#batch"], b: Float[Array, "k *#batch"]) -> Float[Array, "i k *#batch"]:
    """Return a b'."""
    return a[:, None] * b[None]


def total(members: np.ndarray, x: Array, axis: int) -> Array:
    """Return for each entry of `members` `(..., k)` the sum over those of the k items on `axis` of x that it marks."""
    x = jnp.expand_dims(x, tuple(range(axis, axis + members.ndim - 1)))
    batch = x.ndim - axis - members.ndim
    return jnp.where(members.reshape(members.shape + (1,) * batch), x, 0.0).sum(axis + members.ndim - 1)


def identity(n: int, batch_rank: int) -> Float[np.ndarray, "n n *ones"]:
    """Return the unit matrix with singleton batch axes."""
    return np.eye(n).reshape((n, n) + (1,) * batch_rank)


def skew(v: Vector) -> Matrix:
    """Return [v] such that [v] w = v x w."""
    return (CROSS.reshape((3, 3, 3) + (1,) * (v.ndim - 1)) * v).sum(2)


def axial(S: Matrix) -> Vector:
    """Return the sum of a x b over the dyads a b' that S is made of."""
    return -(CROSS.reshape((3, 3, 3) + (1,) * (S.ndim - 2)) * S).sum((1, 2))


def inertia_from_second_moment(S: Matrix) -> Matrix:
    """Return tr(S) 1 - S: the map w -> sum of b x (w x a) over the dyads a b' of S, by the rule of Lagrange."""
    return -S + (S[0, 0] + S[1, 1] + S[2, 2]) * identity(3, S.ndim - 2)


def turn_about(axis: Vector, angle: Float[Array, "*#batch"]) -> Matrix:
    """Return the rotation by any angle [rad] about a unit axis.

    References:
        Rodrigues' formula: Murray, Li, Sastry, "A Mathematical Introduction to Robotic Manipulation", eq. 2.14.
    """
    sine = skew(axis) * jnp.sin(angle)
    return sine + outer(axis, axis) * (1 - jnp.cos(angle)) + identity(3, axis.ndim - 1) * jnp.cos(angle)


def turned(v: Components, axis: Vector, cosine: Float[Array, "*#batch"], sine: Float[Array, "*#batch"]) -> Components:
    """Return v turned about a unit axis by an angle of this cosine and sine, see `turn_about`."""
    along = (1 - cosine) * _dot(axis, v)
    return tuple(x * cosine + y * sine + n * along for x, y, n in zip(v, _cross(axis, v), axis, strict=True))


def rotated(v: Components, phi: Vector) -> Components:
    """Return exp[phi] v, see `rotation`: v + (sin t/t) phi x v + (1 - cos t)/t^2 phi x (phi x v), t = |phi|."""
    size, along = _dot(phi, phi), _dot(phi, v)
    # Horner's rule: faster than `_series` for thousands of times, as here; slower in a prediction
    b, c = (reduce(lambda value, term: value * size + term, row[::-1]) for row in SERIES[:2].tolist())
    once = 1 - c * size
    return tuple(x + once * y + b * (p * along - x * size) for x, y, p in zip(v, _cross(phi, v), phi, strict=True))


def _dot(a: Components | Vector, b: Components | Vector) -> Float[Array, "*batch"]:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _cross(a: Components | Vector, b: Components | Vector) -> Components:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def cross(a: Vector, b: Vector) -> Vector:
    """Return a x b."""
    ahead, behind = (lambda v, k=k: jnp.concatenate([v[k:], v[:k]]) for k in (1, 2))
    return ahead(a) * behind(b) - behind(a) * ahead(b)


def rotation(phi: Vector) -> Matrix:
    """Return exp[phi], the rotation by |phi| about phi [rad], for |phi| up to 3 rad. Smooth everywhere.

    References:
        Rodrigues' formula, as in `turn_about`.
    """
    return rotation_by(phi, left_jacobian(phi))


def rotation_vector(R: Matrix) -> Vector:
    """Return phi with R = exp[phi], for angles below half a turn. Smooth everywhere.

    n tan(t/2), n sin t of the skew part of R and 1 + cos t of its trace, is turned into n t.

    References:
        Barfoot, "State Estimation for Robotics", section 7.1.3, where it stands for n sin t.
    """
    half = -axial(R) / (1 + R[0, 0] + R[1, 1] + R[2, 2])
    size = (half * half).sum(0)
    tangent = jnp.sqrt(jnp.where(size > TINY, size, 1.0))
    return half * jnp.where(size > TINY, 2 * jnp.arctan(tangent) / tangent, 2 - size * (2 / 3 - size * 2 / 5))


def rotation_by(phi: Vector, J: Matrix) -> Matrix:
    """Return exp[phi] = 1 + [phi] J of a known left Jacobian J."""
    return matmul(skew(phi), J) + identity(3, phi.ndim - 1)


def left_jacobian(phi: Vector) -> Matrix:
    """Return J with (d/dt exp[phi]) exp[-phi] = [J dphi/dt], for |phi| up to 3 rad. Smooth everywhere.

    References:
        Barfoot, "State Estimation for Robotics", eq. 7.77.
    """
    b, c = _series((phi * phi).sum(0), 0, 2)
    across = skew(phi)
    return b * across + c * matmul(across, across) + identity(3, phi.ndim - 1)


def left_jacobian_rate(phi: Vector, v: Vector) -> tuple[Vector, Vector]:
    """Return J v, J the left Jacobian, and its rate as phi runs along v.

    J v = v + b phi x v + c phi x (phi x v), with b and c functions of phi'phi.
    """
    b, c, b_dash, c_dash = _series((phi * phi).sum(0), 0, 4)
    across, along = skew(phi), (phi * v).sum(0)
    y = matvec(across, v)
    z = matvec(across, y)
    change = 2 * along * (b_dash * y + c_dash * z) + c * ((v * v).sum(0) * phi - along * v)
    return v + b * y + c * z, change


def curvature(phi: Vector, moment: Vector) -> Matrix:
    """Return the symmetric part of d(J(phi)' moment)/dphi at constant moment, J the left Jacobian.

    J' m = m - b phi x m + c phi x (phi x m), with b and c functions of phi'phi.
    """
    c, b_dash, c_dash = _series((phi * phi).sum(0), 1, 4)
    along, size = (phi * moment).sum(0), (phi * phi).sum(0)
    across = matvec(skew(phi), moment)
    slope = -2 * b_dash * outer(across, phi) + 2 * c_dash * outer(phi * along - size * moment, phi)
    slope = slope + c * (along * identity(3, phi.ndim - 1) + outer(phi, moment) - 2 * outer(moment, phi))
    return (slope + transpose(slope)) / 2


def _coefficients() -> np.ndarray:
    """Power series in t^2 of b = (1 - cos t)/t^2 and c = (t - sin t)/t^3, then of their derivatives, a row each."""
    rows = [[(-1) ** n / math.factorial(2 * n + k) for n in range(TERMS + ORDERS)] for k in (2, 3)]
    for _ in range(ORDERS):
        rows += [[n * row[n] for n in range(1, len(row))] for row in rows[-2:]]
    return np.array([row[:TERMS] for row in rows])


SERIES = _coefficients()


@partial(jax.custom_jvp, nondiff_argnums=(1, 2))
def _series(t2: Array, first: int, last: int) -> Array:
    """Evaluate rows first to last - 1 of the series; the derivative of a row is the next but one."""
    powers, top = jnp.ones((1, *t2.shape)), t2
    while len(powers) < TERMS:
        powers, top = jnp.concatenate([powers, powers * top]), top * top
    return (SERIES[first:last].reshape((last - first, TERMS) + (1,) * t2.ndim) * powers).sum(1)


@_series.defjvp
def _series_jvp(first: int, last: int, primals: tuple[Array], tangents: tuple[Array]) -> tuple[Array, Array]:
    wide = _series(*primals, first, last + 2)
    return wide[:-2], wide[2:] * tangents[0]


def acceleration_map(w: Array, alpha: Array) -> Array:
    """Return the map from a vector fixed in a body to its second derivative, by the body's w and alpha."""
    turning = skew(w)
    return skew(alpha) + matmul(turning, turning)


def chained(turn: Float[Array, "3 3 N *#batch"]) -> Float[Array, "3 3 N *#batch"]:
    """Return the products of rotations up to each joint, from the base outwards."""
    after = [turn[:, :, 0]]
    for j in range(1, turn.shape[2]):
        after.append(matmul(after[-1], turn[:, :, j]))
    return jnp.stack(after, 2)


def axes_before(axes: Float[Array, "3 3 N *#batch"]) -> Float[Array, "3 3 N *#batch"]:
    """Return for each joint the axes of the body before it."""
    base = jnp.broadcast_to(identity(3, axes.ndim - 2), axes[:, :, :1].shape)
    return jnp.concatenate([base, axes[:, :, :-1]], 2)
