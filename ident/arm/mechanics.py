"""Exact mechanics of a chain at a posture: forward kinematics, energies, mass matrix, derivatives of the potential.

Coordinates are the bushings' rotation vectors phi `(3, N, *batch)`; no angle is taken as small. Of a rigid direction
phi is zero: with the projectors R on these and P = 1 - R, gradient, Hessian and mass matrix are P grad V, P H P + R k
and P M P. That is the limit of ever stiffer springs itself, without their numbers in any matrix.

Flat vectors and matrices run joint by joint: entry 3 j + a is component a of joint j.

Notation: r a material point, p_j the centre of bushing j, w_j an angular velocity given to bushing j in base axes.

Motors held by servos, as coordinates in addition to the bushings: masses, dampers and springs of the whole arm.

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
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ident.arm.chain import Chain, Motors
from ident.arm.linalg import inverse_cholesky_factor
from ident.arm.rotations import (
    acceleration_map,
    axes_before,
    axial,
    chained,
    curvature,
    identity,
    inertia_from_second_moment,
    left_jacobian,
    left_jacobian_rate,
    matmul,
    matvec,
    outer,
    rotation_by,
    skew,
    total,
    transpose,
)

Phi = Float[Array, "3 N *#batch"]


class ForwardKinematics(eqx.Module):
    """Where the bodies are.

    Attributes:
        centre: (3, N, *batch) [m] bushing centres p_j.
        axes: (3, 3, N, *batch) rotation of body j from its place at phi = 0.
        rate: (3, 3, N, *batch) W_j with w_j = W_j dphi_j/dt.
        before: (3, 3, N, *batch) rotation of the body before bushing j.
    """

    centre: Float[Array, "3 N *#batch"]
    axes: Float[Array, "3 3 N *#batch"]
    rate: Float[Array, "3 3 N *#batch"]
    before: Float[Array, "3 3 N *#batch"]


def forward_kinematics(chain: Chain, phi: Phi) -> ForwardKinematics:
    """Place the bodies of the chain, from the base outwards."""
    J = left_jacobian(phi)
    axes = _axes(phi, J)
    before = axes_before(axes)
    centre = total(inboard(phi.shape[1]), matvec(before, chain.offset), 1)
    return ForwardKinematics(centre, axes, matmul(before, J), before)


@jax.custom_jvp
def _axes(phi: Phi, J: Float[Array, "3 3 N *#batch"]) -> Float[Array, "3 3 N *#batch"]:
    """Return the product of the rotations up to each bushing, J their left Jacobian; its rate is [w_0 + ... + w_j]."""
    return chained(rotation_by(phi, J))


@_axes.defjvp
def _axes_jvp(primals: tuple[Phi, Array], tangents: tuple[Phi, Array]) -> tuple[Array, Array]:
    (phi, J), (phi_dot, _) = primals, tangents
    axes = _axes(phi, J)
    w = total(inboard(phi.shape[1]), matvec(axes_before(axes), matvec(J, phi_dot)), 1)
    return axes, matmul(skew(w), axes)


def point_positions(chain: Chain, phi: Phi) -> Float[Array, "3 P *#batch"]:
    """Return the named points' positions in the base frame [m]."""
    return _points_of(chain, forward_kinematics(chain, phi))


def _points_of(chain: Chain, at: ForwardKinematics) -> Float[Array, "3 P *#batch"]:
    body = np.asarray(chain.carrier, dtype=int)
    return at.centre[:, body] + matvec(at.axes[:, :, body], chain.position)


def point_rotations(chain: Chain, phi: Phi) -> Float[Array, "3 3 P *#batch"]:
    """Return how the body that carries each named point is turned from its place at phi = 0."""
    return forward_kinematics(chain, phi).axes[:, :, np.asarray(chain.carrier, dtype=int)]


def straight_positions(chain: Chain) -> Float[Array, "3 P *#batch"]:
    """Return where the named points are at phi = 0 [m]."""
    outwards = inboard(chain.offset.shape[1])[np.asarray(chain.carrier, dtype=int)]
    return total(outwards, chain.offset, 1) + chain.position


def mass_matrix(chain: Chain, phi: Phi) -> Float[Array, "n n *#batch"]:
    """Return M with T = dphi' M dphi / 2 [kg m^2].

    Block (j, i) is W_j' (tr S - S) W_i with S the integral of (r - p_i)(r - p_j)' over all bodies that both joints
    move: the angular momentum about p_j of the outboard bodies that turn about p_i is the integral of
    (r - p_j) x (w_i x (r - p_i)), and Lagrange's rule for the double cross product does the rest.

    References:
        Ours; compared with MuJoCo and Pinocchio in tests/arm/test_against_engines.py.
    """
    at = forward_kinematics(chain, phi)
    arm = matvec(at.axes, chain.moment)
    second = matmul(matmul(at.axes, chain.second), transpose(at.axes))
    second = second + outer(arm, at.centre) + outer(at.centre, arm) + chain.mass * outer(at.centre, at.centre)
    outboard = inboard(phi.shape[1]).T
    moved = outboard[:, None] & outboard[None]  # of each pair of joints the bodies that both move
    mass = total(moved, jnp.broadcast_to(chain.mass, at.centre.shape[1:]), 0)
    moment = total(moved, chain.mass * at.centre + arm, 1)
    p_j, p_i = at.centre[:, :, None], at.centre[:, None]
    S = total(moved, second, 2) - outer(moment, p_j) - outer(p_i, moment) + mass * outer(p_i, p_j)
    blocks = matmul(matmul(transpose(at.rate)[:, :, :, None], inertia_from_second_moment(S)), at.rate[:, :, None])
    return flatten_blocks(_between_elastic(chain, blocks))


def potential_gradient(chain: Chain, phi: Phi) -> Float[Array, "n *#batch"]:
    """Return the gradient of the potential energy [N m]; see `potential_derivatives`."""
    at = forward_kinematics(chain, phi)
    return _gradient(chain, phi, at, -axial(_virial(chain, at)))


def potential_derivatives(chain: Chain, phi: Phi) -> tuple[Float[Array, "n *#batch"], Float[Array, "n n *#batch"]]:
    """Return gradient [N m] and Hessian [N m/rad] of the potential energy.

    V = -sum_j m_j g.r_j - sum f.r - sum m.a(R) + sum_j phi_j' K_j phi_j / 2, and what curved springs add. A moment m on
    a body that has turned by R works m.a(R), a(R) along the axis of R and as long as its angle's sine: so do two
    crosswise pairs of forces of fixed direction in the plane of m (Ziegler, "Principles of Structural Stability", 1968,
    1.5: semitangential moments).

    With the virial T_j, the sum of (r - p_j) f' over the weights and forces that joint j moves, turning bushing j
    by w_j makes them work w_j . axial(T_j); turning a joint i further in by w_i carries r, and the rate W_j, along,
    and leaves the bilinear form w_j' (tr T_j - T_j') w_i, symmetrised where i = j. The rest is the curvature of the
    map from phi_j to the rotation itself.
    """
    at = forward_kinematics(chain, phi)
    T = _virial(chain, at)
    moment = -axial(T)
    joints, rank = np.arange(phi.shape[1]), phi.ndim - 2
    j, i = (index.reshape(index.shape + (1,) * rank) for index in np.meshgrid(joints, joints, indexing="ij"))
    D = inertia_from_second_moment(T)
    outer_j, outer_i = transpose(D)[:, :, :, None], D[:, :, None]
    D = jnp.where(j > i, outer_j, jnp.where(j < i, outer_i, (outer_j + outer_i) / 2))
    blocks = matmul(matmul(transpose(at.rate)[:, :, :, None], D), at.rate[:, :, None])

    own = curvature(phi, matvec(transpose(at.before), moment)) + tangent(chain, phi)
    blocks = _between_elastic(chain, blocks + jnp.where(j == i, own[:, :, :, None], 0.0))
    if chain.rigid is not None:
        k = jnp.trace(chain.stiffness).sum(0)  # any stiffness of the matrix's size makes it regular
        blocks = blocks + jnp.where(j == i, (k * chain.rigid)[:, :, :, None], 0.0)
    return _gradient(chain, phi, at, moment), flatten_blocks(blocks)


def second_variations(chain: Chain, phi: Phi, v: Phi) -> tuple[Float[Array, "*#batch"], Float[Array, "*#batch"]]:
    """Return v' H v and v' M v for one direction v of phi, without the matrices: in O(N), cheap to differentiate.

    While phi runs along v at unit rate, points move with velocities dr and accelerations ddr. Then v' M v is the
    integral of |dr|^2 dm, twice the kinetic energy, and v' H v = v' K v - sum f.ddr over all weights and forces.
    """
    at, outwards, v = forward_kinematics(chain, phi), inboard(phi.shape[1]), elastic(chain.rigid, v)
    rate, change = left_jacobian_rate(phi, v)
    u = matvec(at.before, rate)
    w = total(outwards, u, 1)
    turn = skew(w)
    alpha = total(outwards, matvec(at.before, change) + matvec(turn, u), 1)
    A = acceleration_map(w, alpha)
    reach = matvec(at.before, chain.offset)[:, 1:]
    none = jnp.zeros_like(w[:, :1])
    velocity, acceleration = (
        total(outwards, jnp.concatenate([none, matvec(X[:, :, :-1], reach)], 1), 1) for X in (turn, A)
    )

    arm, body = matvec(at.axes, chain.moment), np.asarray(chain.carrier, dtype=int)
    gravity = chain.gravity.reshape((3,) + (1,) * (phi.ndim - 1))
    weights = (gravity * (chain.mass * acceleration + matvec(A, arm))).sum((0, 1))
    point = matvec(at.axes[:, :, body], chain.position)
    forces = (chain.force * (acceleration[:, body] + matvec(A[:, :, body], point))).sum((0, 1))
    if chain.couple is not None:
        forces = forces + (A[:, :, body] * transpose(_crossed(chain, at, chain.couple))).sum((0, 1, 2))
    potential = (v * matvec(tangent(chain, phi), v)).sum((0, 1)) - weights - forces

    local = matvec(transpose(at.axes), w)
    translation = (velocity * (chain.mass * velocity + 2 * matvec(turn, arm))).sum(0)
    return potential, (translation + (local * matvec(inertia_from_second_moment(chain.second), local)).sum(0)).sum(0)


def _gradient(chain: Chain, phi: Phi, at: ForwardKinematics, moment: Phi) -> Float[Array, "n *#batch"]:
    straight = matvec(transpose(at.rate), moment) + matvec(chain.stiffness, phi)
    return flat(elastic(chain.rigid, straight if chain.curved is None else straight + chain.curved.torque(phi)))


def elastic(rigid: Float[Array, "3 3 N *#batch"] | None, x: Phi) -> Phi:
    """Return the part of rotations, or moments, of the bushings in the directions that are not rigid."""
    return x if rigid is None else x - matvec(rigid, x)


def _between_elastic(chain: Chain, blocks: Float[Array, "3 3 N N *batch"]) -> Float[Array, "3 3 N N *batch"]:
    if chain.rigid is None:
        return blocks
    P = -chain.rigid + identity(3, chain.rigid.ndim - 2)
    return matmul(matmul(P[:, :, :, None], blocks), P[:, :, None])


def tangents(chain: Chain, phi: Phi) -> tuple[Float[Array, "3 3 N *#batch"], Float[Array, "3 3 N *#batch"]]:
    """Return bending and torsional stiffness [N m/rad] of the bushings where they are turned by phi."""
    if chain.curved is None:
        return chain.bend, chain.tors
    bend, tors = chain.curved.tangents(phi)
    return chain.bend + bend, chain.tors + tors


def tangent(chain: Chain, phi: Phi) -> Float[Array, "3 3 N *#batch"]:
    """Return the stiffness of the bushings [N m/rad] where they are turned by phi."""
    bend, tors = tangents(chain, phi)
    return bend + tors


def _virial(chain: Chain, at: ForwardKinematics) -> Float[Array, "3 3 N *#batch"]:
    gravity = chain.gravity.reshape((3, 1) + (1,) * (at.centre.ndim - 2))
    arm, points = chain.mass * at.centre + matvec(at.axes, chain.moment), _points_of(chain, at)
    weight, force = (jnp.broadcast_to(f, r.shape) for f, r in ((chain.mass * gravity, arm), (chain.force, points)))
    pulls = outer(points, force)
    if chain.couple is not None:
        pulls = pulls + _crossed(chain, at, chain.couple)
    dyads = jnp.concatenate([outer(arm, gravity), pulls], 2)
    joints = np.arange(arm.shape[1])
    moved = np.less_equal.outer(joints, np.concatenate([joints, chain.carrier]))
    return total(moved, dyads, 2) - outer(at.centre, total(moved, jnp.concatenate([weight, force], 1), 1))


def _crossed(chain: Chain, at: ForwardKinematics, couple: Float[Array, "3 P *#batch"]) -> Float[Array, "3 3 P *#batch"]:
    """Return the sum of r f' over the crossed pairs of forces that make the moments, r turning with the body."""
    return matmul(at.axes[:, :, np.asarray(chain.carrier, dtype=int)], -skew(couple) / 2)


def inboard(n: int) -> np.ndarray:
    """Mark for each joint (n, n) those from the base up to it."""
    return np.greater_equal.outer(np.arange(n), np.arange(n))


def flat(x: Phi) -> Float[Array, "n *#batch"]:
    """Return `(3, N, *batch)` as a flat vector, joint by joint."""
    return jnp.swapaxes(x, 0, 1).reshape((-1, *x.shape[2:]))


def unflatten(x: Float[Array, "n *#batch"]) -> Phi:
    """Return a flat vector as `(3, N, *batch)`."""
    return jnp.swapaxes(x.reshape((-1, 3, *x.shape[1:])), 0, 1)


def flatten_blocks(blocks: Float[Array, "3 3 N N *batch"]) -> Float[Array, "n n *#batch"]:
    """Return blocks, one for each pair of joints, as one flat matrix."""
    n = 3 * blocks.shape[2]
    return jnp.moveaxis(blocks, (2, 0, 3, 1), (0, 1, 2, 3)).reshape((n, n, *blocks.shape[4:]))


# -------- Equilibrium
# Static equilibrium of a chain at a posture and the deflection of its named points.

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


# -------- Motors
# Motors held by servos, as coordinates in addition to the bushings: the equations stand at the file's head.

Matrix = Float[Array, "n n *#batch"]
Vector = Float[Array, "n *#batch"]

ABOVE = 4.0
"""A motor that a brake holds is a mode of its own, by this factor above the sum of all eigenvalues of the arm;
assumed."""


def system(chain: Chain, phi: Phi) -> tuple[Matrix, Matrix, Matrix]:
    """Return M, C and H of a chain about its equilibrium; with motors that servos hold, in their coordinates too.

    Where brakes hold the motors nothing is coupled with them, and each is a mode of its own above all others.
    """
    M, H = mass_matrix(chain, phi), potential_derivatives(chain, phi)[1]
    C = block_diagonal(chain.damping)
    if chain.rigid is not None:  # each rigid coordinate is a mode of its own, too
        R = block_diagonal(chain.rigid)
        M = M + R
        H = H + _above_all(M, H) * R
    M, C, H = (M, C, H) if chain.motors is None else _with_motors(chain.motors, phi, M, C, H)
    return M, C if chain.alpha is None else C + chain.alpha * M, H


def block_diagonal(blocks: Float[Array, "3 3 N *#batch"]) -> Matrix:
    """Return the flat matrix of one block for each joint."""
    return flatten_blocks(blocks[:, :, :, None] * identity(blocks.shape[2], blocks.ndim - 3))


def _above_all(M: Matrix, H: Matrix) -> Float[Array, "*#batch"]:
    """Return an eigenvalue above all of H and M, a constant to differentiation."""
    W = inverse_cholesky_factor(jax.lax.stop_gradient(M))
    return ABOVE * (matmul(W, jax.lax.stop_gradient(H)) * W).sum((0, 1))


def mode_count(chain: Chain) -> int:
    """Return the number of modes of a chain: of its elastic coordinates, and one of each motor that a servo holds."""
    return chain.modes + (len(chain.motors.joint) if chain.motors else 0)


def structural(chain: Chain) -> Matrix | None:
    """Return L of structural damping in the same coordinates; servos have none. None without any."""
    if chain.loss is None:
        return None
    L = block_diagonal(chain.loss)
    return L if chain.motors is None else _beside(L, jnp.zeros_like(chain.motors.stiffness))


def modal_mass(chain: Chain, phi: Phi) -> Matrix:
    """Return the mass matrix in the coordinates of the modes."""
    return mass_matrix(chain, phi) if chain.motors is None else system(chain, phi)[0]


def variations(chain: Chain, phi: Phi, v: Vector) -> tuple[Float[Array, "*#batch"], Float[Array, "*#batch"]]:
    """Return v' H v and v' M v for one direction of all coordinates; see `second_variations`."""
    motors = chain.motors
    if motors is None:
        return second_variations(chain, phi, unflatten(v))
    count = len(motors.joint)
    v, rest = jnp.concatenate([v[:-count], v[-count:] * motors.on], 0), _between(phi)  # brakes hold the other motors
    ways = _ways(motors, v)
    potential, inertia = second_variations(motors.free, rest, ways)
    at, a = forward_kinematics(motors.free, rest), v[-count:]
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
        return jax.jvp(lambda p: places(chain, p), (phi,), (elastic(chain.rigid, unflatten(v)),))
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
    ways = jnp.stack([flat(_ways(motors, each[:, i])) for i in range(count)], 1)
    at = forward_kinematics(free, rest)
    spins = jnp.concatenate([jnp.zeros((motors.share.shape[0], n, *motors.share.shape[2:])), motors.share], 1)
    spins = motors.ratio[:, None] * spins
    along = matmul(_along_axes(motors, at), ways)
    cross = matmul(transpose(along), motors.rotor[:, None] * spins)
    squares = matmul(transpose(spins), motors.rotor[:, None] * spins)
    whole = matmul(matmul(transpose(ways), mass_matrix(free, rest)), ways) + cross + transpose(cross) + squares
    stiffness = matmul(matmul(transpose(ways), potential_derivatives(free, rest)[1]), ways)
    apart = _above_all(M, H)
    if free.rigid is not None:
        R = _beside(block_diagonal(free.rigid[:, :, ::2]), jnp.zeros_like(motors.stiffness))
        whole, stiffness = whole + R, stiffness + apart * R
    mass = jnp.where(motors.on > 0, whole, _beside(M, jnp.ones_like(motors.stiffness)))
    servos = _beside(jnp.zeros_like(H), motors.stiffness)
    return (
        mass,
        _beside(C, motors.damping * motors.on),
        jnp.where(motors.on > 0, stiffness + servos, _beside(H, apart * jnp.ones_like(motors.stiffness))),
    )


def _beside(A: Matrix, diagonal: Float[Array, "A *#batch"]) -> Float[Array, "k k *#batch"]:
    """Return a matrix with further coordinates, coupled with nothing."""
    n, count, batch = A.shape[0], diagonal.shape[0], jnp.broadcast_shapes(A.shape[2:], diagonal.shape[1:])
    own = diagonal[:, None] * identity(count, len(batch))
    upper = jnp.concatenate([jnp.broadcast_to(A, (n, n, *batch)), jnp.zeros((n, count, *batch))], 1)
    lower = jnp.concatenate([jnp.zeros((count, n, *batch)), jnp.broadcast_to(own, (count, count, *batch))], 1)
    return jnp.concatenate([upper, lower], 0)


def _ways(motors: Motors, v: Vector) -> Float[Array, "3 N2 *#batch"]:
    """Return a direction of all coordinates as that of the bushings and pins, in turn."""
    count = len(motors.joint)
    pins = motors.axis * (motors.share * v[None, -count:]).sum(1)
    rigid = motors.free.rigid
    bushings = elastic(None if rigid is None else rigid[:, :, ::2], unflatten(v[:-count]))
    pairs = jnp.stack(jnp.broadcast_arrays(bushings, pins), 2)
    return pairs.reshape((3, -1, *pairs.shape[3:]))


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
