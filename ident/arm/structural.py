"""Loss factors in time: the damping matrix that takes from every mode what they take from it.

A complex stiffness K + i L is a law of harmonic motion: in time it is not causal. With S = (M^-1/2 K M^-1/2)^1/2,

    D = 2 M^1/2 X M^1/2,    S X + X S = M^-1/2 L M^-1/2

is a damping matrix that is. On modes v_i, mass-normalised, of angular frequencies w_i it is v_i' D v_j = 2 v_i' L v_j /
(w_i + w_j): a light mode has the damping ratio v' L v / 2 w^2, as by the complex stiffness, at any frequency, and
L = eta K gives every mode eta / 2. D is never negative where L is not. Only sums of frequencies occur, so that it is
smooth where modes cross; nothing asks which mode is which.

References:
    Crandall, "The role of damping in vibration theory", J. Sound Vib. 11(1), 1970 (causality). Woodhouse, "Linear
    damping models for structural vibration", J. Sound Vib. 215(3), 1998. The matrix is ours; compared with SciPy
    and modal superposition in tests/arm/test_losses.py, in motion in tests/vibrate/test_structural.py.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ident.arm.linalg import inverse_cholesky_factor, largest_eigenpairs
from ident.arm.rotations import matmul, transpose

Square = Float[Array, "n n *#batch"]


def structural_damping(M: Square, K: Square, L: Square) -> Square:
    """Return the damping matrix D of what an arm loses by its loss factors. Differentiable once.

    Args:
        M: mass matrix, positive definite.
        K: stiffness matrix, positive definite.
        L: hysteretic damping: the sum of loss factors times their stiffness matrices.
    """
    W = inverse_cholesky_factor(M)
    C = matmul(M, transpose(W))  # W M W' = 1, so that M = C C'
    K, L = (matmul(matmul(W, X), transpose(W)) for X in (K, L))
    return 2 * matmul(matmul(C, _between_roots(K, L)), transpose(C))


@jax.custom_jvp
def _between_roots(A: Square, B: Square) -> Square:
    """Return X with S X + X S = B, S the root of symmetric, positive A."""
    return _solved(*_roots(A), B)


@_between_roots.defjvp
def _between_roots_jvp(primals: tuple[Square, Square], tangents: tuple[Square, Square]) -> tuple[Array, Array]:
    (A, B), (dA, dB) = primals, tangents
    roots = _roots(A)
    X, dS = _solved(*roots, B), _solved(*roots, dA)  # S dS + dS S = dA
    return X, _solved(*roots, dB - matmul(dS, X) - matmul(X, dS))


def _roots(A: Square) -> tuple[Float[Array, "n *#batch"], Square]:
    """Return the roots of the eigenvalues, and the eigenvectors."""
    values, Q = jax.lax.stop_gradient(largest_eigenpairs(A, A.shape[0]))
    return jnp.sqrt(values), Q


def _solved(w: Float[Array, "n *#batch"], Q: Square, B: Square) -> Square:
    """Return X with S X + X S = B, S having these eigenvalues and eigenvectors."""
    own = matmul(matmul(transpose(Q), B), Q) / (w[:, None] + w[None])
    return matmul(matmul(Q, own), transpose(Q))
