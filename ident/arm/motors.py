"""Motors that servos hold, as coordinates beside the bushings: masses, dampers and springs of the whole arm.

Coordinates are x = (phi, a): the bushings' rotation vectors joint by joint, then the turn a of each motor, counted as
that of the pin of its own joint. With B the shares of the pins in it (`Motors.share`), pins turn by q = posture + B a.
A rotor turns about its axis by N dq/dt faster than its shaft, whose rate along that axis is s. So, J being a part of
the shaft's inertia already, it adds

    T = J (N dq/dt) s + J (N dq/dt)^2 / 2,        V = k_servo (N a)^2 / 2

The servo's torque in equilibrium is constant (integral action), so that it adds nothing to the stiffness.

References:
    Ours, after Spong, "Modeling and control of elastic joint robots", J. Dyn. Sys. Meas. Control 109, 1987, without his
    assumption that rotors turn about their own axes only. Compared with MuJoCo in tests/arm/test_motors.py.
"""

from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ident.arm.chain import Chain, Motors
from ident.arm.linalg import inverse_cholesky_factor
from ident.arm.mechanics import (
    ForwardKinematics,
    Phi,
    flatten_blocks,
    forward_kinematics,
    inboard,
    mass_matrix,
    point_positions,
    potential_derivatives,
    second_variations,
    unflatten,
)
from ident.arm.rotations import identity, matmul, matvec, total, transpose

Matrix = Float[Array, "n n *#batch"]
Vector = Float[Array, "n *#batch"]

ABOVE = 4.0
"""A motor that a brake holds is a mode of its own, by this factor above the sum of all eigenvalues of the arm."""


def system(chain: Chain, phi: Phi) -> tuple[Matrix, Matrix, Matrix]:
    """Return M, C and H of a chain about its equilibrium; with motors that servos hold, in their coordinates too.

    Where brakes hold the motors nothing is coupled with them, and each is a mode of its own above all others.
    """
    M, H = mass_matrix(chain, phi), potential_derivatives(chain, phi)[1]
    C = flatten_blocks(chain.damping[:, :, :, None] * identity(phi.shape[1], phi.ndim - 2))
    return (M, C, H) if chain.motors is None else _with_motors(chain.motors, phi, M, C, H)


def coordinates(chain: Chain) -> int:
    """Return the number of coordinates of a chain: three of each bushing, one of each motor that a servo holds."""
    return 3 * chain.offset.shape[1] + (len(chain.motors.joint) if chain.motors else 0)


def structural(chain: Chain) -> Matrix | None:
    """Return L of structural damping in the same coordinates; servos have none. None without any."""
    if chain.loss is None:
        return None
    L = flatten_blocks(chain.loss[:, :, :, None] * identity(chain.loss.shape[2], chain.loss.ndim - 3))
    return L if chain.motors is None else _beside(L, jnp.zeros_like(chain.motors.stiffness))


def modal_mass(chain: Chain, phi: Phi) -> Matrix:
    """Return the mass matrix in the coordinates of the modes."""
    return mass_matrix(chain, phi) if chain.motors is None else system(chain, phi)[0]


def variations(chain: Chain, phi: Phi, v: Vector) -> tuple[Float[Array, "*#batch"], Float[Array, "*#batch"]]:
    """Return v' H v and v' M v for one direction of all coordinates; see `second_variations`."""
    motors = chain.motors
    if motors is None:
        return second_variations(chain, phi, unflatten(v))
    v, rest = _coupled(motors, v), _between(phi)
    ways = _ways(motors, v)
    potential, inertia = second_variations(motors.free, rest, ways)
    at, a = forward_kinematics(motors.free, rest), v[-len(motors.joint) :]
    rates = total(inboard(ways.shape[1]), matvec(at.rate, ways), 1)[:, ::2]
    spin = motors.ratio * (motors.share * a[None]).sum(1)
    along = (_pin_axes(motors, at) * rates).sum(0)
    return potential + (motors.stiffness * a * a).sum(0), inertia + (motors.rotor * spin * (2 * along + spin)).sum(0)


def point_motion(chain: Chain, phi: Phi, v: Vector) -> Float[Array, "3 P *#batch"]:
    """Return the displacement of the named points along a direction of all coordinates."""
    return motion_of(point_positions, chain, phi, v)[1]


def motion_of(places: Callable[[Chain, Phi], Array], chain: Chain, phi: Phi, v: Vector) -> tuple[Array, Array]:
    """Return places on a chain, a function of it and its rotation vectors, and their displacement along a direction.

    With motors that servos hold the chain has a bushing in place of each pin, see `Motors.free`.
    """
    motors = chain.motors
    if motors is None:
        return jax.jvp(lambda p: places(chain, p), (phi,), (unflatten(v),))
    return jax.jvp(lambda p: places(motors.free, p), (_between(phi),), (_ways(motors, v),))


def servo_energy(motors: Motors, v: Vector) -> Float[Array, "N *#batch"]:
    """Return twice the energy of the servos along a direction, each at the joint of its motor."""
    energy = motors.stiffness * v[-len(motors.joint) :] ** 2
    own = np.equal.outer(np.arange(motors.axis.shape[1]), np.array(motors.joint))
    return total(own, energy, 0)


def _with_motors(motors: Motors, phi: Phi, M: Matrix, C: Matrix, H: Matrix) -> tuple[Array, Array, Array]:
    free, rest, n = motors.free, _between(phi), M.shape[0]
    count = n + len(motors.joint)
    each = jnp.asarray(identity(count, phi.ndim - 2))
    ways = jnp.stack([_flat_ways(motors, each[:, i]) for i in range(count)], 1)
    at = forward_kinematics(free, rest)
    spins = jnp.concatenate([jnp.zeros((motors.share.shape[0], n, *motors.share.shape[2:])), motors.share], 1)
    spins = motors.ratio[:, None] * spins
    along = matmul(_along_axes(motors, at), ways)
    cross = matmul(transpose(along), motors.rotor[:, None] * spins)
    squares = matmul(transpose(spins), motors.rotor[:, None] * spins)
    whole = matmul(matmul(transpose(ways), mass_matrix(free, rest)), ways) + cross + transpose(cross) + squares
    stiffness = matmul(matmul(transpose(ways), potential_derivatives(free, rest)[1]), ways)
    apart = _apart(M, H)
    mass = jnp.where(motors.on > 0, whole, _beside(M, jnp.ones_like(motors.stiffness)))
    servos = _beside(jnp.zeros_like(H), motors.stiffness)
    return (
        mass,
        _beside(C, motors.damping * motors.on),
        jnp.where(motors.on > 0, stiffness + servos, _beside(H, apart * jnp.ones_like(motors.stiffness))),
    )


def _apart(M: Matrix, H: Matrix) -> Float[Array, "*#batch"]:
    """Return an eigenvalue above all of M and H."""
    W = inverse_cholesky_factor(jax.lax.stop_gradient(M))
    return ABOVE * (matmul(W, jax.lax.stop_gradient(H)) * W).sum((0, 1))


def _beside(A: Matrix, diagonal: Float[Array, "A *#batch"]) -> Float[Array, "k k *#batch"]:
    """Return a matrix with further coordinates, coupled with nothing."""
    n, count, batch = A.shape[0], diagonal.shape[0], jnp.broadcast_shapes(A.shape[2:], diagonal.shape[1:])
    own = diagonal[:, None] * identity(count, len(batch))
    upper = jnp.concatenate([jnp.broadcast_to(A, (n, n, *batch)), jnp.zeros((n, count, *batch))], 1)
    lower = jnp.concatenate([jnp.zeros((count, n, *batch)), jnp.broadcast_to(own, (count, count, *batch))], 1)
    return jnp.concatenate([upper, lower], 0)


def _coupled(motors: Motors, v: Vector) -> Vector:
    """Return a direction without the motors that brakes hold."""
    count = len(motors.joint)
    return jnp.concatenate([v[:-count], v[-count:] * motors.on], 0)


def _ways(motors: Motors, v: Vector) -> Float[Array, "3 N2 *#batch"]:
    """Return a direction of all coordinates as that of the bushings and pins, in turn."""
    count = len(motors.joint)
    pins = motors.axis * (motors.share * v[None, -count:]).sum(1)
    pairs = jnp.stack(jnp.broadcast_arrays(unflatten(v[:-count]), pins), 2)
    return pairs.reshape((3, -1, *pairs.shape[3:]))


def _flat_ways(motors: Motors, v: Vector) -> Float[Array, "n2 *#batch"]:
    ways = _ways(motors, v)
    return jnp.swapaxes(ways, 0, 1).reshape((-1, *ways.shape[2:]))


def _between(phi: Phi) -> Float[Array, "3 N2 *#batch"]:
    """Return the rotation vectors of bushings and pins, in turn, the pins at rest."""
    pairs = jnp.stack([phi, jnp.zeros_like(phi)], 2)
    return pairs.reshape((3, -1, *pairs.shape[3:]))


def _pin_axes(motors: Motors, at: ForwardKinematics) -> Float[Array, "3 N *#batch"]:
    """Return the axes of the pins where the bushings are turned."""
    return matvec(at.axes[:, :, ::2], motors.axis)


def _along_axes(motors: Motors, at: ForwardKinematics) -> Float[Array, "N n2 *#batch"]:
    """Return what each coordinate of bushings and pins adds to the rate of each shaft along its axis."""
    before = inboard(at.rate.shape[2])[::2]
    mask = before.reshape(before.shape + (1,) * (at.rate.ndim - 3))
    axis = _pin_axes(motors, at)
    rows = (axis[:, None, :, None] * at.rate[:, :, None]).sum(0) * mask
    rows = jnp.moveaxis(rows, 0, 2)
    return rows.reshape((rows.shape[0], -1, *rows.shape[3:]))
