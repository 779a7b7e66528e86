"""Static equilibrium of a chain at a posture and the deflection of its named points."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ident.arm.chain import Chain
from ident.arm.linalg import inverse_cholesky_factor
from ident.arm.mechanics import (
    Phi,
    point_positions,
    potential_derivatives,
    potential_gradient,
    straight_positions,
    unflatten,
)
from ident.arm.rotations import matvec, transpose

MAX_STEPS = 30
"""Newton steps at most; stiff arms need three or four."""
CLOSE = 1e-15
"""Error [rad] at which Newton's method ends."""
LONGEST = 0.5
"""Longest step of one bushing coordinate [rad], so that a soft arm is not thrown over."""


class StaticEquilibrium(NamedTuple):
    """Static equilibrium of a chain at a posture.

    Attributes:
        phi: (3, N, *batch) [rad] the bushings' rotation vectors phi_s.
        W: (3N, 3N, *batch) inverse Cholesky factor of the potential's Hessian H there; a constant to differentiation.
    """

    phi: Phi
    W: Float[Array, "n n *#batch"]


def equilibrium(chain: Chain) -> Phi:
    """Return the phi_s `(3, N, *batch)` [rad] of the static equilibrium; see `static_equilibrium`."""
    return static_equilibrium(chain).phi


def static_equilibrium(chain: Chain) -> StaticEquilibrium:
    """Find where the bushings carry the weights and forces: grad V(phi_s) = 0, by Newton's method.

    NaN where there is no equilibrium near phi = 0, that is, where the arm buckles. Once differentiable, forward and
    reverse, by the implicit function theorem, H dphi_s = -d(grad V): the last Newton step is taken at constant phi and
    H, so that its derivative is just this.

    References:
        Ours; compared with MuJoCo and Pinocchio in tests/arm/test_against_engines.py.
    """
    still = jax.lax.stop_gradient(chain)
    phi = _newton(still)
    W = inverse_cholesky_factor(potential_derivatives(still, phi)[1])
    return StaticEquilibrium(phi - _solve(W, potential_gradient(chain, phi)), W)


def _newton(chain: Chain) -> Phi:
    def unfinished(state: tuple[Phi, Array, Array, Array]) -> Array:
        _, _, error, count = state
        return (count < MAX_STEPS) & jnp.any(error > CLOSE)

    def step(state: tuple[Phi, Array, Array, Array]) -> tuple[Phi, Array, Array, Array]:
        phi, before, _, count = state
        gradient, hessian = potential_derivatives(chain, phi)
        move = _solve(inverse_cholesky_factor(hessian), gradient)
        size = jnp.abs(move).max((0, 1))
        # convergence is quadratic: as this step is to the square of the one before, so the error is to its square
        error = size * (size / before) ** 2
        return phi - move * jnp.minimum(1.0, LONGEST / size), size, error, count + 1

    start = jnp.zeros((3, *_shape(chain)))
    none = jnp.zeros(start.shape[2:])
    phi, _, error, _ = jax.lax.while_loop(unfinished, step, (start, none, none + jnp.inf, jnp.array(0)))
    return jnp.where(error > CLOSE, jnp.nan, phi)


def _solve(W: Array, gradient: Array) -> Phi:
    return unflatten(matvec(transpose(W), matvec(W, gradient)))


def deflection(chain: Chain, phi: Phi) -> Float[Array, "3 P *#batch"]:
    """Return how far each named point lies from its place at phi = 0, in the base frame [m]."""
    return point_positions(chain, phi) - straight_positions(chain)


def _shape(chain: Chain) -> tuple[int, ...]:
    """Return (N, *batch)."""
    return jnp.broadcast_shapes(
        chain.mass.shape, chain.stiffness.shape[2:], (1, *chain.force.shape[2:]), chain.offset.shape[1:]
    )
