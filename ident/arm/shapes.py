"""Shapes of modes that can be differentiated, and how they move the arm's points."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ident.arm.chain import Chain
from ident.arm.linalg import Square
from ident.arm.mechanics import Phi
from ident.arm.modes import Modes
from ident.arm.motors import point_motion, system
from ident.arm.rotations import matmul, transpose

APART = 1e-8
"""Relative distance of eigenvalues below which their shapes no longer turn into each other: there they have none."""


@jax.custom_jvp
def turning_shapes(H: Square, M: Square, eigenvalues: Array, shapes: Square) -> Square:
    """Return all mass-normalised shapes V (n, n, *batch) of H v = l M v, once differentiable by H and M:

        dv_a = sum_{k /= a} v_k v_k' (dH - l_a dM) v_a / (l_a - l_k) - v_a (v_a' dM v_a) / 2.

    Where two eigenvalues meet shapes turn into each other ever faster; what is made of them must not depend on that
    turn, as the plane that they span does not.

    References:
        Fox, Kapoor, "Rates of change of eigenvalues and eigenvectors", AIAA J. 6, 1968.
    """
    return shapes


@turning_shapes.defjvp
def _turning_shapes_jvp(primals: tuple[Array, ...], tangents: tuple[Array, ...]) -> tuple[Array, Array]:
    _, _, eigenvalues, V = primals
    dH, dM = (matmul(transpose(V), matmul(dA, V)) for dA in tangents[:2])
    gap = eigenvalues[None] - eigenvalues[:, None]
    turn = (dH - eigenvalues[None] * dM) * gap / (gap**2 + (APART * eigenvalues[None]) ** 2)
    own = jnp.eye(len(V)).reshape(V.shape[:2] + (1,) * (V.ndim - 2))
    return V, matmul(V, turn - own * dM / 2)


def moving_points(chain: Chain, phi: Phi, modes: Modes) -> Float[Array, "3 P n *batch"]:
    """Return the displacement of the named points [m/sqrt(kg m^2)] in each of all modes; once differentiable."""
    M, _, H = system(chain, phi)
    eigenvalues, shapes = jax.lax.stop_gradient(((2 * jnp.pi * modes.frequency) ** 2, modes.shape))
    V = jnp.moveaxis(turning_shapes(H, M, eigenvalues, shapes), 1, -1)
    return jax.vmap(lambda v: point_motion(chain, phi, v), in_axes=-1, out_axes=2)(V)
