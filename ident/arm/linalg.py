"""Linear algebra of small symmetric matrices, batch last, in straight-line code.

Why our own: two concurrent batched LAPACK calls in one jax 0.10 program can wait for each other for ever, and
XLA vectorises these loops over the batch. The matrices are 3N x 3N for an arm of N joints. An indefinite matrix
gives NaN, which the callers at the border turn into a sentence.
"""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ident.arm.rotations import identity, matmul, matvec, outer, transpose

Square = Float[Array, "n n *#batch"]

BISECTIONS = 54
"""Halvings that close any bracket: one more than the bits of a double."""
HALVINGS = 8
"""Before Newton's method is tried. With this and the next two the paper's arm needs 20 passes, by halving alone 54."""
EVERY = 8
"""A turn of so many halves the bracket whatever Newton's method says."""
BEYOND = 2.0**-14
"""By which share of itself Newton's step goes beyond the root that it foresees."""
TINY = 1e-300
"""Stands in for a pivot that is exactly zero."""


def inverse_cholesky_factor(A: Square) -> Square:
    """Return the lower triangular W with W A W' = 1, the inverse of the Cholesky factor; NaN where there is none.

    Gaussian elimination of the rows (A, 1) leaves (D L', L^-1), where A = L D L', L with a unit diagonal.
    """
    n, row = A.shape[0], _indices(A)

    def eliminate(k: Array, rest: Array) -> Array:
        pivot_row = jax.lax.dynamic_index_in_dim(rest, k, 0, keepdims=False)
        pivot = jax.lax.dynamic_index_in_dim(pivot_row, k, 0, keepdims=False)
        return rest - outer(jnp.where(row > k, pivot_row[:n] / pivot, 0.0), pivot_row)

    unit = jnp.broadcast_to(identity(n, A.ndim - 2), A.shape)
    rest = jax.lax.fori_loop(0, n, eliminate, jnp.concatenate([A, unit], 1))
    return rest[:, n:] / jnp.sqrt(_diagonal(rest))[:, None]


def solve_positive(A: Square, b: Float[Array, "n *#batch"]) -> Float[Array, "n *#batch"]:
    """Return the solution x of A x = b, A positive definite."""
    W = inverse_cholesky_factor(A)
    return matvec(transpose(W), matvec(W, b))


def inverse_unpivoted(A: Square) -> Square:
    """Return the inverse by Gauss-Jordan elimination in place, without row exchanges.

    For matrices whose leading blocks are all well conditioned, such as a mass matrix with small additions.
    """
    n, row = A.shape[0], _indices(A)

    def eliminate(k: Array, rest: Array) -> Array:
        pivot_row = jax.lax.dynamic_index_in_dim(rest, k, 0, keepdims=False)
        column = jax.lax.dynamic_index_in_dim(rest, k, 1, keepdims=False)
        pivot = jax.lax.dynamic_index_in_dim(pivot_row, k, 0, keepdims=False)
        here = row == k
        return rest - outer(jnp.where(here, column - 1, column), jnp.where(here, pivot_row + 1, pivot_row) / pivot)

    return jax.lax.fori_loop(0, n, eliminate, A)


def lowest_modes(
    H: Square, M: Square, count: int
) -> tuple[Float[Array, "count *#batch"], Float[Array, "n count *#batch"]]:
    """Solve H v = lambda M v for the lowest eigenvalues; H and M positive definite.

    With W H W' = 1, the largest eigenvalues of W M W' are the 1/lambda sought, and the most accurate ones.

    Returns:
        lambda `(count, *batch)` ascending, and V `(n, count, *batch)`, a column each, with V' M V = 1.
    """
    return lowest_modes_whitened(inverse_cholesky_factor(H), M, count)


def lowest_modes_whitened(
    W: Square, M: Square, count: int
) -> tuple[Float[Array, "count *#batch"], Float[Array, "n count *#batch"]]:
    """Return what `lowest_modes` does, H given by its inverse Cholesky factor W."""
    mu, Y = largest_eigenpairs(matmul(matmul(W, M), transpose(W)), count)
    return 1 / mu, matmul(transpose(W), Y / jnp.sqrt(mu))


def largest_eigenpairs(A: Square, count: int) -> tuple[Float[Array, "count *#batch"], Float[Array, "n count *#batch"]]:
    """Return the largest eigenvalues, descending, and orthonormal eigenvectors of symmetric, non-negative A.

    Householder tridiagonalization, bisection on Sturm counts, inverse iteration. Eigenvalues are right to rounding
    times the largest, also where they repeat; vectors of a cluster are made orthogonal within it.

    References:
        Golub, Van Loan, "Matrix Computations", 4th ed., 8.3.1, 8.4.1, 8.2.2.
    """
    d, e, reflectors = _tridiagonalize(A)
    mu = _bisect(d, e, count)

    def reflect_back(Y: Array, v: Array) -> tuple[Array, None]:
        return Y - 2 * outer(v, (v[:, None] * Y).sum(0)), None

    return mu, jax.lax.scan(reflect_back, _inverse_iteration(d, e, mu), reflectors, reverse=True)[0]


def _tridiagonalize(A: Square) -> tuple[Array, Array, Array]:
    """Return diagonal (n), off-diagonal (n - 1) and the unit normals (n - 2, n) of the reflections used."""
    n, row = A.shape[0], _indices(A)

    def reflect(A: Square, k: Array) -> tuple[Square, Array]:
        column = jax.lax.dynamic_index_in_dim(A, k, 1, keepdims=False)
        head = jax.lax.dynamic_index_in_dim(column, k + 1, 0, keepdims=False)
        x = jnp.where(row > k, column, 0.0)
        length = jnp.sqrt((x * x).sum(0))
        v = x + jnp.where(row == k + 1, jnp.where(head < 0, -length, length), 0.0)
        norm = jnp.sqrt(2 * length * (length + jnp.abs(head)))
        v = v / jnp.where(norm == 0, 1.0, norm)
        p = 2 * (A * v[None]).sum(1)
        w = p - (p * v).sum(0) * v
        return A - outer(v, w) - outer(w, v), v

    A, reflectors = jax.lax.scan(reflect, A, jnp.arange(n - 2))
    return _diagonal(A), _diagonal(A[1:, :-1]), reflectors


def _bisect(d: Array, e: Array, count: int) -> Array:
    """Return the largest eigenvalues of a non-negative tridiagonal matrix, descending, each within its own bracket.

    The positive pivots q of T - x count the eigenvalues above x; the sum of their q'/q is the logarithmic derivative of
    det(T - x), so that the same pass gives Newton's step. A step that leaves the bracket is replaced by its middle, as
    is every eighth, so that it always closes.
    """
    n, none = d.shape[0], jnp.zeros_like(d[:1])
    left, right = jnp.concatenate([none, jnp.abs(e)]), jnp.concatenate([jnp.abs(e), none])
    top = (d + left + right).max(0)
    squared, wanted = left * left, jnp.arange(count).reshape((-1,) + (1,) * top.ndim)
    width = jnp.finfo(top.dtype).eps * top

    def look(x: Array) -> tuple[Array, Array]:
        """Return whether the eigenvalue lies above x, and Newton's step to where det(T - x) is 0."""
        ratio, total, above = jnp.zeros_like(x), jnp.zeros_like(x), jnp.zeros_like(x)
        slope = -jnp.ones_like(x)
        for i in range(n):
            pivot = d[i] - x - ratio
            inverse = 1 / jnp.where(pivot == 0, TINY, pivot)
            total = total + slope * inverse
            if i + 1 < n:
                ratio = squared[i + 1] * inverse
                slope = ratio * inverse * slope - 1
            above = above + jnp.where(inverse > 0, 1.0, 0.0)
        return above > wanted, -1 / total

    def unfinished(state: tuple[Array, Array, Array, Array]) -> Array:
        low, high, _, turn = state
        return (turn < EVERY * BISECTIONS) & jnp.any(high - low > width)

    def narrow(state: tuple[Array, Array, Array, Array]) -> tuple[Array, Array, Array, Array]:
        low, high, x, turn = state
        higher, step = look(x)
        low, high = jnp.where(higher, x, low), jnp.where(higher, high, x)
        # A little beyond the root, so that it is enclosed from its other side, too.
        guess = x + step * (1 + BEYOND) + jnp.sign(step) * width / 2
        trusted = (turn >= HALVINGS) & (turn % EVERY != EVERY - 1) & (guess > low) & (guess < high)
        return low, high, jnp.where(trusted, guess, (low + high) / 2), turn + 1

    ends = jnp.zeros((count, *top.shape)), jnp.broadcast_to(top, (count, *top.shape))
    low, high, _, _ = jax.lax.while_loop(unfinished, narrow, (*ends, ends[1] / 2, jnp.array(0)))
    return jnp.where(jnp.isnan(top), jnp.nan, (low + high) / 2)


def _inverse_iteration(d: Array, e: Array, mu: Array) -> Array:
    """Return orthonormal eigenvectors (n, count) of a tridiagonal matrix for its known eigenvalues.

    Those of a cluster leave the iteration dependent to some 1e-6 at worst: a second pass makes them orthogonal.

    References:
        Giraud, Langou, Rozloznik, Comput. Math. Appl. 50, 2005: twice is enough, unless dependent to rounding.
    """
    n, count = d.shape[0], mu.shape[0]
    start = np.random.default_rng(0).standard_normal((n, count))
    Y = jnp.broadcast_to(start.reshape(start.shape + (1,) * (mu.ndim - 1)), (n, *mu.shape))
    tiny = jnp.finfo(mu.dtype).eps * jnp.max(mu, 0)
    # the shifts: an eigenvalue itself where it is alone, else one a little above its cluster
    close, no = mu[:-1] - mu[1:] < n * tiny, jnp.zeros(mu[:1].shape, bool)
    follows, leads = jnp.concatenate([no, close]), jnp.concatenate([close, no])
    highest = jax.lax.cummin(jnp.where(follows, jnp.inf, mu))
    shift = jnp.where(follows | leads, highest + n / 2 * tiny, mu)
    Y = jax.lax.fori_loop(0, 3, lambda _, Y: _orthonormalize(_solve_shifted(d, e, shift, Y, tiny)), Y)
    return _orthonormalize(Y)


def _solve_shifted(d: Array, e: Array, mu: Array, B: Array, tiny: Array) -> Array:
    """Solve (T - mu) X = B, near singular, by plane rotations and back substitution."""
    none = jnp.zeros_like(d[:1])
    below, beyond = jnp.concatenate([e, none]), jnp.concatenate([e[1:], none, none])
    next_d, next_B = jnp.concatenate([d[1:], none]), jnp.concatenate([B[1:], jnp.zeros_like(B[:1])])

    def rotate(row: tuple[Array, Array, Array], below: tuple[Array, ...]) -> tuple[tuple, tuple]:
        (a, b, y), (under, diagonal, over, z) = row, below
        r = jnp.sqrt(a * a + under * under)
        singular, r = r < tiny, jnp.maximum(r, tiny)
        c, s, g = jnp.where(singular, 1.0, a / r), jnp.where(singular, 0.0, under / r), diagonal - mu
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


def _indices(A: Square) -> Array:
    return jnp.arange(A.shape[0]).reshape((-1,) + (1,) * (A.ndim - 2))


def _diagonal(A: Float[Array, "n m *batch"]) -> Float[Array, "n *batch"]:
    unit = np.eye(A.shape[0], A.shape[1]).astype(bool).reshape(A.shape[:2] + (1,) * (A.ndim - 2))
    return jnp.where(unit, A, 0.0).sum(1)
