"""Natural frequencies and modes of a chain at a posture about its static equilibrium."""

import re
from dataclasses import dataclass
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Complex, Float, Inexact, Int

from ident.arm.chain import Chain
from ident.arm.linalg import Square, inverse_cholesky_factor, lowest_modes, lowest_modes_whitened
from ident.arm.mechanics import (
    Phi,
    StaticEquilibrium,
    mass_matrix,
    mode_count,
    point_motion,
    servo_energy,
    static_equilibrium,
    structural,
    system,
    tangents,
    unflatten,
    variations,
)
from ident.arm.rotations import identity, matmul, matvec, transpose


class Linearized(NamedTuple):
    """Matrices of M d2x/dt2 + C dx/dt + H x = 0 about the equilibrium, x = phi - phi_s and the turns of the motors.

    Attributes:
        phi: (3, N, *batch) [rad] the equilibrium phi_s.
        M: (n, n, *batch) [kg m^2] mass matrix; n is 3N and the number of motors that servos hold (`Chain.motors`).
        C: (n, n, *batch) [N m s/rad] damping matrix.
        H: (n, n, *batch) [N m/rad] Hessian of the potential energy.
        L: (n, n, *batch) [N m/rad] structural damping: H + i L stands for H in harmonic motion; None for none.
    """

    phi: Phi
    M: Float[Array, "n n *#batch"]
    C: Float[Array, "n n *#batch"]
    H: Float[Array, "n n *#batch"]
    L: Float[Array, "n n *#batch"] | None = None


def linearize(chain: Chain, at: StaticEquilibrium | None = None) -> Linearized:
    """Linearize the exact equations about the static equilibrium, which may be known; differentiable."""
    phi = (static_equilibrium(chain) if at is None else at).phi
    return Linearized(phi, *system(chain, phi), structural(chain))


@eqx.filter_custom_jvp
def lowest_eigenpairs(
    chain: Chain, at: StaticEquilibrium, *, count: int
) -> tuple[Float[Array, "count *#batch"], Float[Array, "n count *#batch"]]:
    """Return the lowest eigenvalues of H v = lambda M v, ascending, and mass-normalised vectors.

    The eigenvalues are once differentiable, forward and reverse, by d lambda = d(v' H v - lambda v' M v) at constant v
    and lambda, with no derivative of a matrix formed. At a repeated eigenvalue each derivative depends on the basis
    that the solver picked, their sum over the cluster does not; none is NaN. The vectors have no derivative there and
    are constants to differentiation everywhere.

    References:
        Lancaster, "On eigenvalues of matrices dependent on a parameter", Numer. Math. 6, 1964.
    """
    if chain.motors is None:
        return lowest_modes_whitened(at.W, mass_matrix(chain, at.phi), count)
    M, _, H = system(chain, at.phi)
    return lowest_modes(H, M, count)


@lowest_eigenpairs.def_jvp
def _lowest_eigenpairs_jvp(
    primals: tuple[Chain, StaticEquilibrium], tangents: tuple[Chain, StaticEquilibrium], *, count: int
) -> tuple:
    (chain, at), (chain_dot, at_dot) = primals, tangents
    values, vectors = lowest_eigenpairs(chain, at, count=count)

    def gap(chain: Chain, phi: Phi, value: Array, shape: Array) -> Array:
        H, M = variations(chain, phi, shape)
        return H - value * M

    def change(value: Array, shape: Array) -> Array | None:
        _, by_chain = eqx.filter_jvp(lambda c: gap(c, at.phi, value, shape), (chain,), (chain_dot,))
        if at_dot.phi is None:  # nothing that the equilibrium depends on is differentiated
            return by_chain
        # one reverse pass, the same for all directions of differentiation
        slope = jax.grad(lambda phi: gap(chain, phi, value, shape).sum())(at.phi)
        by_phi = (slope * at_dot.phi).sum((0, 1))
        return by_phi if by_chain is None else by_chain + by_phi

    return (values, vectors), (jax.vmap(change, in_axes=(0, 1))(values, vectors), None)


def natural_frequencies(chain: Chain, count: int) -> Float[Array, "count *#batch"]:
    """Return the lowest undamped natural frequencies [Hz], ascending; differentiable."""
    return to_hertz(lowest_eigenpairs(chain, static_equilibrium(chain), count=count)[0])


def to_hertz(eigenvalues: Float[Array, "*#batch"]) -> Float[Array, "*#batch"]:
    """Return the natural frequencies [Hz] of eigenvalues omega^2."""
    return jnp.sqrt(eigenvalues) / (2 * jnp.pi)


class Modes(eqx.Module):
    """The lowest modes of a chain at a posture.

    Attributes:
        frequency: (m, *batch) [Hz] ascending.
        shape: (n, m, *batch) [rad/sqrt(kg m^2)] mass-normalised, V' M V = 1, components along the base axes, then
            those of the motors that servos hold.
        bend: (N, m, *batch) [-] share of the bushings' strain energy in the bending of each joint.
        tors: (N, m, *batch) [-] share in the torsion of each joint, to which the servo of its motor counts; all shares
            of a mode sum to one.
        motion: (3, P, m, *batch) [m/sqrt(kg m^2)] displacement of the named points in each mode.
    """

    frequency: Float[Array, "m *#batch"]
    shape: Float[Array, "n m *#batch"]
    bend: Float[Array, "N m *#batch"]
    tors: Float[Array, "N m *#batch"]
    motion: Float[Array, "3 P m *#batch"]


def modes(chain: Chain, count: int | None = None) -> Modes:
    """Return the lowest `count` modes (all when None); see `modes_about`."""
    return modes_about(chain, static_equilibrium(chain), count)


def modes_about(chain: Chain, at: StaticEquilibrium, count: int | None = None) -> Modes:
    """Return the lowest `count` modes (all when None) about a known equilibrium.

    The frequencies are differentiable; shapes, shares and motions are constants to differentiation.
    """
    own, m = at.W.shape[0], mode_count(chain) if count is None else count
    values, vectors = lowest_eigenpairs(chain, at, count=m)
    still, phi = jax.lax.stop_gradient((chain, at.phi))
    shapes = jnp.moveaxis(vectors, 1, -1)
    by_joint = unflatten(shapes[:own])
    energy = [(by_joint * matvec(K[..., None], by_joint)).sum(0) for K in tangents(still, phi)]
    if (motors := still.motors) is not None:
        energy[1] = energy[1] + jax.vmap(lambda v: servo_energy(motors, v), -1, -1)(shapes)
    total = (energy[0] + energy[1]).sum(0)
    return Modes(
        frequency=to_hertz(values),
        shape=vectors,
        bend=jnp.moveaxis(energy[0] / total, -1, 1),
        tors=jnp.moveaxis(energy[1] / total, -1, 1),
        motion=jax.vmap(lambda v: point_motion(still, phi, v), in_axes=-1, out_axes=2)(shapes),
    )


def in_shaft_axes(chain: Chain, phi: Phi) -> Phi:
    """Return elastic coordinates along the axes of each shaft instead of the base's."""
    return matvec(transpose(chain.frame), phi)


def mac(a: Inexact[Array, "n *#batch"], b: Inexact[Array, "n *#batch"]) -> Float[Array, "*#batch"]:
    """Return the modal assurance criterion |a'b|^2 / (a'a b'b) of two real or complex shapes, between 0 and 1.

    References:
        Allemang, "The modal assurance criterion: twenty years of use and abuse", Sound and Vibration, 2003.
    """
    cross = jnp.abs((jnp.conj(a) * b).sum(0)) ** 2
    return cross / ((jnp.abs(a) ** 2).sum(0) * (jnp.abs(b) ** 2).sum(0))


@jax.custom_jvp
def damped_eigenvalues(system: Linearized) -> Complex[Array, "n *#batch"]:
    """Return for each undamped mode, ascending, the eigenvalue s [rad/s] of (s^2 M + s C + H) x = 0 nearest in shape.

    With structural damping it is that of (s^2 M + s C + H + i L) x = 0 with Im s > 0, the one that decays: a loss
    factor eta of all that gives has the damping ratio sin(atan(eta) / 2), eta / 2 for small ones, at any frequency;
    otherwise the loss factors of a mode's parts count by their strain energy. It is a model of harmonic motion: the
    complex stiffness is no causal law, its poles do not come in conjugate pairs, and their decay is right only as
    far as eta is small against 1.

    Of a conjugate pair it is the one with Im s >= 0. |s| / 2 pi is the natural frequency, -Re s / |s| the damping
    ratio; an overdamped mode has two real s, of which one is returned, with ratio 1. Once differentiable by
    ds = -y' (dH + s dC + s^2 dM) x, y the left eigenvector; infinite only at critical damping.

    References:
        Tisseur, Meerbergen, "The quadratic eigenvalue problem", SIAM Review 43(2), 2001. Neumark, "Concept of complex
        stiffness applied to problems of oscillations with viscous and hysteretic damping", R&M 3269, 1962. Crandall,
        "The role of damping in vibration theory", J. Sound Vib. 11(1), 1970 (causality).
    """
    return _damped_modes(system)[0]


@damped_eigenvalues.defjvp
def _damped_eigenvalues_jvp(primals: tuple[Linearized], tangents: tuple[Linearized]) -> tuple[Array, Array]:
    s, x, y = _damped_modes(primals[0])
    _, dM, dC, dH, dL = tangents[0]
    dK = dH if dL is None else dH + 1j * dL
    lead = dK[:, :, None] + s * dC[:, :, None] + s * s * dM[:, :, None]
    change = -(y * (lead * x[None]).sum(1)).sum(0)
    return s, change


def _damped_modes(system: Linearized) -> tuple[Array, Array, Array]:
    """Return s, right and left eigenvectors (columns) for each undamped mode, ascending."""
    s, x, y, nearest = all_damped_modes(system)
    s = jnp.take_along_axis(s, nearest, 0)
    return s, jnp.take_along_axis(x, nearest[None], 1), jnp.take_along_axis(y, nearest[None], 1)


def all_damped_modes(system: Linearized) -> tuple[Array, Array, Array, Array]:
    """Return all 2n eigenvalues s, right and left eigenvectors (columns), and for each undamped mode which is its own.

    Computed in coordinates in which the mass matrix is 1; scaled so that y' (2 s M + C) x = 1.
    """
    n, batch = system.M.shape[0], system.M.shape[2:]
    W = inverse_cholesky_factor(system.M)
    K = system.H if system.L is None else system.H + 1j * system.L
    K, C = (matmul(matmul(W, X), transpose(W)) for X in (K, system.C))
    unit = jnp.broadcast_to(identity(n, len(batch)), (n, n, *batch))
    state = jnp.concatenate([jnp.concatenate([jnp.zeros_like(unit), unit], 1), jnp.concatenate([-K, -C], 1)], 0)
    # one after another: LAPACK must not run twice at the same time under jax 0.10
    one_by_one = jnp.moveaxis(state.reshape((2 * n, 2 * n, -1)), -1, 0)
    s, right, left = (jnp.moveaxis(out, 0, -1).reshape(out.shape[1:] + batch) for out in jax.lax.map(_eig, one_by_one))
    x, y = matmul(transpose(W), right[:n]), matmul(transpose(W), left[n:])
    # for each undamped mode the index of the eigenvalue in whose vector it has the largest share
    shapes = lowest_modes(system.H, system.M, system.M.shape[0])[1]
    share = jnp.abs(matmul(matmul(transpose(shapes), system.M), x)) ** 2
    return s, x, y, jnp.argmax(jnp.where(s.imag < 0, -1.0, share / share.sum(0)), 1)


def _eig(A: Inexact[Array, "k k"]) -> tuple[Array, Array, Array]:
    """Return the eigenvalues by ascending |s|, their right vectors and the dual left vectors, as columns."""
    s, right = jnp.linalg.eig(A)
    left = jnp.linalg.inv(right).T
    order = jnp.argsort(jnp.abs(s))
    return s[order], right[:, order], left[:, order]


# -------- Labels
# Names for modes by what moves: `vertical bending 1`, `lateral torsion 1`, and how a measured name finds its mode.
#
# A mode is `bending` or `torsion` by where most of the bushings' strain energy sits, `vertical` or `lateral` by how
# the arm's end point moves, and numbered in ascending frequency among the modes of the same name.

AMBIGUOUS = 0.1
"""A share this near to one half leaves the name of a mode open; assumed."""


@dataclass(frozen=True)
class Label:
    """What a measurement says of its mode.

    Attributes:
        direction: `vertical`, `lateral`, or None for either.
        kind: `bending`, `torsion`, or None for either.
        ordinal: 1 for the lowest such mode.
    """

    direction: str | None
    kind: str | None
    ordinal: int

    def admits(self, other: "Label") -> bool:
        """Whether what this says of direction and kind is true of the other."""
        return self.direction in (None, other.direction) and self.kind in (None, other.kind)

    def __str__(self) -> str:
        return " ".join(str(part) for part in (self.direction, self.kind, self.ordinal) if part)


def parse_label(text: str) -> Label | None:
    """Read a label such as `vertical bending 1`, `torsion 2` or `lateral 1`; None when it is none."""
    match = re.fullmatch(r"(?:(vertical|lateral)\s*)?(?:(bending|torsion)\s*)?(\d{1,3})", text.strip().lower())
    if not match or int(match[3]) < 1 or not (match[1] or match[2]):
        return None
    return Label(match[1], match[2], int(match[3]))


def torsion_share(modes: Modes) -> Float[Array, "m *batch"]:
    """Return the share of the strain energy in torsion."""
    return modes.tors.sum(0)


def vertical_share(modes: Modes) -> Float[Array, "m *batch"]:
    """Return the share of vertical motion in the end point's squared displacement."""
    squared = modes.motion[:, -1] ** 2
    return squared[2] / squared.sum(0)


def mode_labels(modes: Modes) -> list[Label]:
    """Name the modes of one chain (no batch), ascending."""
    return labels_of_shares(np.asarray(torsion_share(modes)), np.asarray(vertical_share(modes)))


def labels_of_shares(torsion: Float[np.ndarray, "m"], vertical: Float[np.ndarray, "m"]) -> list[Label]:
    """Name modes, ascending, by their shares of torsion and of vertical motion."""
    names = [
        ("vertical" if v > 0.5 else "lateral", "torsion" if t > 0.5 else "bending")
        for t, v in zip(torsion, vertical, strict=True)
    ]
    return [Label(*name, names[: i + 1].count(name)) for i, name in enumerate(names)]


def is_ambiguous(modes: Modes) -> Bool[Array, "m *batch"]:
    """Tell which modes are named by a near draw, so that a small change may rename them."""
    return (jnp.abs(torsion_share(modes) - 0.5) < AMBIGUOUS) | (jnp.abs(vertical_share(modes) - 0.5) < AMBIGUOUS)


# -------- Shapes
# Shapes of modes that can be differentiated, and how they move the arm's points.

APART = 1e-8
"""Relative distance of eigenvalues below which their shapes no longer turn into each other: there they have none."""


@jax.custom_jvp
def turning_shapes(H: Square, M: Square, eigenvalues: Array, shapes: Array) -> Float[Array, "n m *#batch"]:
    """Return all mass-normalised shapes V (n, m, *batch) of H v = l M v, once differentiable by H and M.

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
    own = jnp.eye(V.shape[1]).reshape((V.shape[1],) * 2 + (1,) * (V.ndim - 2))
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


def moving_points(chain: Chain, linear: Linearized, modes: Modes) -> Float[Array, "3 P m *batch"]:
    """Return the displacement of the named points [m/sqrt(kg m^2)] in each of all modes; once differentiable."""
    eigenvalues, shapes = jax.lax.stop_gradient(((2 * jnp.pi * modes.frequency) ** 2, modes.shape))
    return _moved(chain, linear, turning_shapes(linear.H, linear.M, eigenvalues, shapes))


def moving_points_damped(chain: Chain, linear: Linearized) -> Complex[Array, "3 P n *batch"]:
    """Return likewise the displacement in the damped mode nearest to each undamped one, up to a factor of each."""
    shapes = damped_shapes(linear)
    return _moved(chain, linear, shapes.real) + 1j * _moved(chain, linear, shapes.imag)


def _moved(chain: Chain, linear: Linearized, shapes: Float[Array, "n m *batch"]) -> Float[Array, "3 P m *batch"]:
    columns = jnp.moveaxis(shapes, 1, -1)
    return jax.vmap(lambda v: point_motion(chain, linear.phi, v), in_axes=-1, out_axes=2)(columns)


# -------- Likeness
# Which modes of a batch are which known ones, by the MAC of their shapes.


def follow(
    reference: Float[np.ndarray, "n B K"], mass: Float[np.ndarray, "n n K"], shape: Float[np.ndarray, "n m K S"]
) -> tuple[Int[np.ndarray, "B K S"], Float[np.ndarray, "B K S"]]:
    """Tell which mode of each arm is which branch, by the likeness of its own shapes to the branch's at each posture.

    Args:
        reference: (n, B, K) shapes of the branches.
        mass: (n, n, K) [kg m^2] the weight of the MAC.
        shape: (n, m, K, S) shapes of the batch's modes in the same axes, m >= B.

    Returns:
        Modes of the batch and their MAC with the branch.
    """
    weighted = np.einsum("nok,obk->nbk", mass, reference)
    cross = np.einsum("nbk,nmks->bmks", weighted, shape) ** 2
    own = np.einsum("nmks,nok,omks->mks", shape, mass, shape, optimize=True)
    likeness = cross / own / np.einsum("nbk,nbk->bk", weighted, reference)[:, None, :, None]
    place = likeness.argmax(1)
    shared = (np.diff(np.sort(place, axis=0), axis=0) == 0).any(0)  # two branches are most like the same mode
    for k, s in np.argwhere(shared):
        place[:, k, s] = assigned(likeness[:, :, k, s])
    return place, np.take_along_axis(likeness, place[:, None], 1)[:, 0]


def assigned(likeness: np.ndarray) -> np.ndarray:
    """Return for each row the column that is its own, so that they are most alike in all."""
    from scipy.optimize import linear_sum_assignment  # takes longer to import than a prediction to compute

    columns: np.ndarray = linear_sum_assignment(likeness, maximize=True)[1]
    return columns
