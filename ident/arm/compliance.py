"""Static compliance at the named points of a chain: by how much a small further force or moment moves and turns them.

About the equilibrium phi_s of a loaded chain, with the Hessian H of its potential there and the Jacobian J of a
point's displacement and rotation by all elastic coordinates, a small wrench f at the point gives

    d(displacement, rotation) = C f,        C = J H^-1 J'

exactly to first order. H holds the springs' tangents and the geometric stiffness of weights and loads, so that C is
that of the loaded arm: an inverted pendulum of mass m and height l on a spring k gives l^2 / (k - m g l).

References:
    Salisbury, "Active stiffness control of a manipulator in cartesian coordinates", CDC 1980, for C = J K^-1 J';
    Chen, Kao, "Conservative congruence transformation for joint and cartesian stiffness matrices", Int. J. Robotics
    Research 19, 2000, for the geometric part of H.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ident.arm.chain import Chain
from ident.arm.mechanics import Matrix, Phi, Vector, motion_of, point_positions, point_rotations
from ident.arm.rotations import axial, matmul, transpose


def point_twists(chain: Chain, phi: Phi, W: Matrix) -> Float[Array, "n 6 P *#batch"]:
    """Return W J': how the named points move about an equilibrium along each row of W; differentiable.

    Servos that hold motors give way by their stiffness, in series with the joints; motors held by brakes do not. With
    W' W = H^-1 the compliance is the sum over the rows of their products with themselves: symmetric, not negative.

    Args:
        chain: the arm at a posture under its loads.
        phi: (3, N, *batch) [rad] its static equilibrium.
        W: (n, n, *batch) directions of all coordinates, as rows.

    Returns:
        (n, 6, P, *batch), displacement along and rotation about x, y and z of the base [m, rad, per unit of a row].
    """
    return jax.vmap(lambda v: _twist(chain, phi, v))(W)


def _twist(chain: Chain, phi: Phi, v: Vector) -> Float[Array, "6 P *#batch"]:
    """Return displacement and rotation of the named points along a direction of all coordinates."""
    if chain.motors is not None:
        count = len(chain.motors.joint)
        v = jnp.concatenate([v[:-count], v[-count:] * chain.motors.on], 0)  # brakes hold the other motors
    place, moved = motion_of(_placed, chain, phi, v)
    return jnp.concatenate([moved[:, 0], -axial(matmul(moved[:, 1:], transpose(place[:, 1:]))) / 2], 0)


def _placed(chain: Chain, phi: Phi) -> Float[Array, "3 4 P *#batch"]:
    """Return position and rotation of the named points, side by side."""
    return jnp.concatenate([point_positions(chain, phi)[:, None], point_rotations(chain, phi)], 1)
