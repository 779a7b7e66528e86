"""Linear algebra of small symmetric matrices, batch last, in straight-line code.

Why our own: two concurrent batched LAPACK calls in one jax 0.10 program can wait for each other for ever, and
XLA vectorises these loops over the batch. The matrices are 3N x 3N for an arm of N joints. An indefinite matrix
gives NaN, which the callers at the border turn into a sentence.
"""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ident.arm.rotations import outer, transpose

Square = Float[Array, "n n *#batch"]

BISECTIONS = 54
"""Halvings of the bracket: one more than the bits of a double."""
TINY = 1e-300
"""Stands in for a pivot that is exactly zero."""


def cholesky(A: Square) -> Square:
    """Return the lower triangular L with L L' = A; NaN where A is not positive definite."""
    row = _indices(A)

    def column(rest: Square, k: Array) -> tuple[Square, Array]:
        c = jax.lax.dynamic_index_in_dim(rest, k, 1, keepdims=False)
        pivot = jax.lax.dynamic_index_in_dim(c, k, 0, keepdims=False)
        c = jnp.where(row >= k, c / jnp.sqrt(pivot), 0.0)
        return rest - outer(c, c), c

    return transpose(jax.lax.scan(column, A, jnp.arange(A.shape[0]))[1])


def solve_lower(L: Square, B: Float[Array, "n m *#batch"]) -> Float[Array, "n m *#batch"]:
    """Return the solution X of L X = B, L lower triangular; linear and transposable in B."""
    return _substitute(L, B, reverse=False)


def solve_positive(L: Square, b: Float[Array, "n *#batch"]) -> Float[Array, "n *#batch"]:
    """Return the solution x of L L' x = b."""
    y = _substitute(L, b[:, None], reverse=False)
    return _substitute(transpose(L), y, reverse=True)[:, 0]


def lowest_modes(
    H: Square, M: Square, count: int
) -> tuple[Float[Array, "count *#batch"], Float[Array, "n count *#batch"]]:
    """Solve H v = lambda M v for the lowest eigenvalues; H and M positive definite.

    With H = L L', the largest eigenvalues of L^-1 M L'^-1 are the 1/lambda sought, and the most accurate ones.

    Returns:
        lambda `(count, *batch)` ascending, and V `(n, count, *batch)`, a column each, with V' M V = 1.
    """
    L = cholesky(H)
    A = solve_lower(L, transpose(solve_lower(L, M)))
    mu, Y = largest_eigenpairs(A, count)
    return 1 / mu, _substitute(transpose(L), Y / jnp.sqrt(mu), reverse=True)


def largest_eigenpairs(
    A: Square, count: int
) -> tuple[Float[Array, "count *#batch"], Float[Array, "n count *#batch"]]:
    """Return the largest eigenvalues, descending, and orthonormal eigenvectors of symmetric, non-negative A.

    Householder tridiagonalization, bisection on Sturm counts, inverse iteration. Eigenvalues are right to rounding
    times the largest, also where they repeat; vectors of a cluster are made orthogonal within it.

    References:
        Golub, Van Loan, "Matrix Computations", 4th ed., 8.3.1, 8.4.1, 8.2.2.
    """
    d, e, reflectors = _tridiagonalize(A)
    mu = _bisect(d, e, count)
    return mu, _reflect_back(_inverse_iteration(d, e, mu), reflectors)


def _tridiagonalize(A: Square) -> tuple[Array, Array, Array]:
    """Return diagonal (n), off-diagonal (n - 1) and the unit normals (n - 2, n) of the reflections used."""
    n, row = A.shape[0], _indices(A)

    def reflect(A: Square, k: Array) -> tuple[Square, Array]:
        column = jax.lax.dynamic_index_in_dim(A, k, 1, keepdims=False)
        x = jnp.where(row > k, column, 0.0)
        head = jnp.where(row == k + 1, column, 0.0).sum(0)
        length = jnp.sqrt((x * x).sum(0))
        v = x + jnp.where(row == k + 1, jnp.where(head < 0, -length, length), 0.0)
        norm = jnp.sqrt((v * v).sum(0))
        v = v / jnp.where(norm == 0, 1.0, norm)
        p = 2 * (A * v[None]).sum(1)
        w = p - (p * v).sum(0) * v
        return A - outer(v, w) - outer(w, v), v

    A, reflectors = jax.lax.scan(reflect, A, jnp.arange(n - 2))
    return _diagonal(A), _diagonal(A[1:, :-1]), reflectors


def _bisect(d: Array, e: Array, count: int) -> Array:
    """Return the largest eigenvalues of a non-negative tridiagonal matrix, descending, by bisection."""
    n, none = d.shape[0], jnp.zeros_like(d[:1])
    left, right = jnp.concatenate([none, jnp.abs(e)]), jnp.concatenate([jnp.abs(e), none])
    top = (d + left + right).max(0)
    wanted = jnp.arange(count).reshape((-1,) + (1,) * top.ndim)

    def above(x: Array) -> Array:
        """Count the eigenvalues above x: the positive pivots of T - x."""
        pivot = d[0] - x
        total = (pivot > 0).astype(int)
        for i in range(1, n):
            pivot = d[i] - x - left[i] ** 2 / jnp.where(pivot == 0, TINY, pivot)
            total = total + (pivot > 0)
        return total

    def halve(_: Array, bracket: tuple[Array, Array]) -> tuple[Array, Array]:
        low, high = bracket
        middle = (low + high) / 2
        more = above(middle) > wanted
        return jnp.where(more, middle, low), jnp.where(more, high, middle)

    shape = (count, *top.shape)
    low, high = jax.lax.fori_loop(0, BISECTIONS, halve, (jnp.zeros(shape), jnp.broadcast_to(top, shape)))
    return jnp.where(jnp.isnan(top), jnp.nan, (low + high) / 2)


def _inverse_iteration(d: Array, e: Array, mu: Array) -> Array:
    """Return orthonormal eigenvectors (n, count) of a tridiagonal matrix for its known eigenvalues."""
    n, count = d.shape[0], mu.shape[0]
    start = np.random.default_rng(0).standard_normal((n, count))
    Y = jnp.broadcast_to(start.reshape(start.shape + (1,) * (mu.ndim - 1)), (n, *mu.shape))
    tiny = jnp.finfo(mu.dtype).eps * jnp.max(mu, 0)
    return jax.lax.fori_loop(0, 3, lambda _, Y: _orthonormalize(_solve_shifted(d, e, mu, Y, tiny)), Y)


def _solve_shifted(d: Array, e: Array, mu: Array, B: Array, tiny: Array) -> Array:
    """Solve (T - mu) X = B, near singular, by plane rotations and back substitution."""
    none = jnp.zeros_like(d[:1])
    below, beyond = jnp.concatenate([e, none]), jnp.concatenate([e[1:], none, none])
    next_d, next_B = jnp.concatenate([d[1:], none]), jnp.concatenate([B[1:], jnp.zeros_like(B[:1])])

    def rotate(row: tuple[Array, Array, Array], below: tuple[Array, ...]) -> tuple[tuple, tuple]:
        (a, b, y), (under, diagonal, over, z) = row, below
        r = jnp.sqrt(a * a + under * under)
        r = jnp.where(r < tiny, tiny, r)
        c, s, g = a / r, under / r, diagonal - mu
        return (c * g - s * b, c * over, c * z - s * y), (r, c * b + s * g, s * over, c * y + s * z)

    def substitute(known: tuple[Array, Array], row: tuple[Array, ...]) -> tuple[tuple, Array]:
        (x1, x2), (r, first, second, y) = known, row
        x = (y - first * x1 - second * x2) / r
        return (x, x1), x

    first = (d[0] - mu, jnp.broadcast_to(e[0], mu.shape), B[0])
    rows = jax.lax.scan(rotate, first, (below, next_d, beyond, next_B))[1]
    nothing = jnp.zeros_like(mu)
    return jax.lax.scan(substitute, (nothing, nothing), rows, reverse=True)[1]


def _orthonormalize(Y: Array) -> Array:
    """Modified Gram-Schmidt over the columns, each scaled first so that none overflows."""
    Y = Y / jnp.abs(Y).max(0)
    column = jnp.arange(Y.shape[1]).reshape((-1,) + (1,) * (Y.ndim - 2))

    def project(Y: Array, k: Array) -> tuple[Array, None]:
        y = jax.lax.dynamic_index_in_dim(Y, k, 1, keepdims=True)
        y = y / jnp.sqrt((y * y).sum(0))
        rest = Y - y * (y * Y).sum(0)
        return jnp.where(column > k, rest, jnp.where(column == k, y, Y)), None

    return jax.lax.scan(project, Y, jnp.arange(Y.shape[1]))[0]


def _reflect_back(Y: Array, reflectors: Array) -> Array:
    def reflect(Y: Array, v: Array) -> tuple[Array, None]:
        return Y - 2 * outer(v, (v[:, None] * Y).sum(0)), None

    return jax.lax.scan(reflect, Y, reflectors, reverse=True)[0]


def _indices(A: Square) -> Array:
    return jnp.arange(A.shape[0]).reshape((-1,) + (1,) * (A.ndim - 2))


def _diagonal(A: Square) -> Array:
    return jnp.moveaxis(jnp.diagonal(A, axis1=0, axis2=1), -1, 0)


def _substitute(T: Square, B: Array, *, reverse: bool) -> Array:
    """Solve T X = B for a lower triangular T, or an upper one from the last row up (`reverse`)."""

    def row(rest: Array, k: Array) -> tuple[Array, Array]:
        column = jax.lax.dynamic_index_in_dim(T, k, 1, keepdims=False)
        pivot = jax.lax.dynamic_index_in_dim(column, k, 0, keepdims=False)
        x = jax.lax.dynamic_index_in_dim(rest, k, 0, keepdims=False) / pivot
        return rest - outer(column, x), x

    batch = jnp.broadcast_shapes(T.shape[2:], B.shape[2:])
    rest = jnp.broadcast_to(B, B.shape[:2] + batch)
    return jax.lax.scan(row, rest, jnp.arange(T.shape[0]), reverse=reverse)[1]
