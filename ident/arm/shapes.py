"""Shapes of modes that can be differentiated, and how they move the arm's points."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Complex, Float

from ident.arm.chain import Chain
from ident.arm.linalg import Square
from ident.arm.modes import Linearized, Modes, all_damped_modes
from ident.arm.motors import point_motion
from ident.arm.rotations import matmul, transpose

APART = 1e-8
"""Relative distance of eigenvalues below which their shapes no longer turn into each other: there they have none."""


@jax.custom_jvp
def turning_shapes(H: Square, M: Square, eigenvalues: Array, shapes: Square) -> Square:
    """Return all mass-normalised shapes V (n, n, *batch) of H v = l M v, once differentiable by H and M.

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


@jax.custom_jvp
def damped_shapes(system: Linearized) -> Complex[Array, "n n *#batch"]:
    """Return for each undamped mode, ascending, the shape x of (s^2 M + s C + H + i L) x = 0 nearest to it.

    Once differentiable, but for a factor of each shape, over all 2n eigenvalues b with their left eigenvectors y:

        dx_a = -sum_{b /= a} x_b y_b' (dH + i dL + s_a dC + s_a^2 dM) x_a / (s_a - s_b).

    References:
        Adhikari, "Rates of change of eigenvalues and eigenvectors in damped dynamic systems", AIAA J. 37, 1999.
    """
    _, x, _, own = all_damped_modes(system)
    return jnp.take_along_axis(x, own[None], 1)


@damped_shapes.defjvp
def _damped_shapes_jvp(primals: tuple[Linearized], tangents: tuple[Linearized]) -> tuple[Array, Array]:
    s, x, y, own = all_damped_modes(primals[0])
    _, dM, dC, dH, dL = tangents[0]
    value, mine = jnp.take_along_axis(s, own, 0), jnp.take_along_axis(x, own[None], 1)
    dK = dH if dL is None else dH + 1j * dL
    pushed = matmul(dK, mine) + matmul(dC, mine) * value + matmul(dM, mine) * value**2
    gap = value[None] - s[:, None]
    turn = matmul(jnp.swapaxes(y, 0, 1), pushed) * jnp.conj(gap) / (jnp.abs(gap) ** 2 + (APART * jnp.abs(value)) ** 2)
    return mine, -matmul(x, turn)


def moving_points(chain: Chain, linear: Linearized, modes: Modes) -> Float[Array, "3 P n *batch"]:
    """Return the displacement of the named points [m/sqrt(kg m^2)] in each of all modes; once differentiable."""
    eigenvalues, shapes = jax.lax.stop_gradient(((2 * jnp.pi * modes.frequency) ** 2, modes.shape))
    return _moved(chain, linear, turning_shapes(linear.H, linear.M, eigenvalues, shapes))


def moving_points_damped(chain: Chain, linear: Linearized) -> Complex[Array, "3 P n *batch"]:
    """Return likewise the displacement in the damped mode nearest to each undamped one, up to a factor of each."""
    shapes = damped_shapes(linear)
    return _moved(chain, linear, shapes.real) + 1j * _moved(chain, linear, shapes.imag)


def _moved(chain: Chain, linear: Linearized, shapes: Float[Array, "n n *batch"]) -> Float[Array, "3 P n *batch"]:
    columns = jnp.moveaxis(shapes, 1, -1)
    return jax.vmap(lambda v: point_motion(chain, linear.phi, v), in_axes=-1, out_axes=2)(columns)
