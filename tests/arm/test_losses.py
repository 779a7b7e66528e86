"""Loss factors: poles against the complex-stiffness eigenproblem and closed forms, and the damping matrix in time."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from arms import first_guess_arm, lcd_arm, random_arm, without_gravity
from conformance import agrees
from scipy.linalg import eig, eigh, solve_sylvester, sqrtm
from scipy.signal import lsim

from ident.arm.arm import Arm
from ident.arm.chain import Chain, at_posture
from ident.arm.fields import ALPHA
from ident.arm.modes import Linearized, damped_eigenvalues, linearize, natural_frequencies
from ident.arm.structural import structural_damping


def lossy(arm: Arm, bend: float, tors: float, tau: float = 0.0) -> Arm:
    joints = tuple(
        replace(
            j, loss_bend=jnp.array(bend), loss_tors=jnp.array(tors), tau_bend=jnp.array(tau), tau_tors=jnp.array(tau)
        )
        for j in arm.joints
    )
    return replace(arm, joints=joints)


@jax.jit
def poles(arm: Arm, posture: jax.Array) -> tuple[jax.Array, jax.Array, Linearized, Chain]:
    chain = at_posture(arm, posture)
    system = linearize(chain)
    return damped_eigenvalues(system), natural_frequencies(chain, 3 * len(arm.joints)), system, chain


@jax.jit
def in_time(system: Linearized) -> tuple[jax.Array, jax.Array]:
    """The damping matrix of loss factors in time, and the eigenvalues with it."""
    D = structural_damping(system.M, system.H, system.L)
    return D, damped_eigenvalues(system._replace(C=D, L=None))


def ratios(arm: Arm, posture: np.ndarray) -> np.ndarray:
    s = np.asarray(poles(arm, jnp.asarray(posture))[0])
    return -s.real / np.abs(s)


@pytest.mark.parametrize("eta", [0.001, 0.05, 0.3])
def test_one_loss_factor_gives_each_mode_half_of_it_at_any_frequency(eta: float) -> None:
    arm = without_gravity(lossy(lcd_arm(), eta, eta))  # gravity gives without loss
    s, hertz, *_ = poles(arm, jnp.zeros(3))
    ratio, source = np.sin(np.arctan(eta) / 2), "root of k (1 + i eta), closed form"
    agrees(-s.real / np.abs(s), ratio, "modal", "damping ratios of one loss factor", source, rtol=1e-9)
    expected = hertz * (1 + eta**2) ** 0.25
    agrees(np.abs(s) / (2 * np.pi), expected, "modal", "frequencies with a loss factor", source, rtol=1e-9, unit="Hz")


def test_random_arms_are_as_the_complex_stiffness_eigenproblem() -> None:
    """Without dampers lambda = -s^2 solves (H + i L) x = lambda M x, here by LAPACK's QZ."""
    rng = np.random.default_rng(0)
    for _ in range(3):
        arm = lossy(random_arm(rng, 2), 0.05, 0.2)
        s, _, system, _ = poles(arm, jnp.asarray(rng.uniform(-2, 2, 2)))
        M, H, L = (np.asarray(x) for x in (system.M, system.H, system.L))
        expected = np.sort_complex(np.sqrt(eig(H + 1j * L, M, right=False)))
        found, source = np.sort_complex(np.asarray(s) / 1j), "complex-stiffness eigenproblem, LAPACK's QZ"
        agrees(found, expected, "modal", "poles of arms with loss factors", source, rtol=1e-8, unit="rad/s")


def test_small_loss_factors_and_dampers_add_by_their_strain_energy() -> None:
    arm, posture = lcd_arm(), np.deg2rad([40.0, -80.0, 40.0])
    tau, bend, tors = 2e-5, 1e-4, 4e-4
    _, _, system, chain = poles(lossy(arm, bend, tors, tau), jnp.asarray(posture))
    values, V = eigh(np.asarray(system.H), np.asarray(system.M))
    stiff = [np.zeros((9, 9)) for _ in range(2)]
    for j in range(3):
        for K, part in zip(stiff, (chain.bend, chain.tors), strict=True):
            K[3 * j : 3 * j + 3, 3 * j : 3 * j + 3] = part[:, :, j]
    energy = [np.einsum("im,ij,jm->m", V, K, V) for K in stiff]
    omega = np.sqrt(values)
    expected = (bend * energy[0] + tors * energy[1]) / (2 * values) + tau * sum(energy) / (2 * omega)
    found, what = ratios(lossy(arm, bend, tors, tau), posture), "damping ratios of small loss factors and dampers"
    agrees(found, expected, "modal", what, "shares of the strain energy, eigh of SciPy", rtol=2e-3)


def test_an_arm_without_loss_factors_has_neither_paths_nor_a_matrix_of_them() -> None:
    assert not any("loss" in path for path in lcd_arm().paths())
    assert poles(lcd_arm(), jnp.zeros(3))[2].L is None
    assert float(lcd_arm().get("joint1.loss_tors")) == 0
    assert lcd_arm().replace({"joint1.loss_tors": 0.1}).joints[0].loss_tors == 0.1
    assert float(lossy(lcd_arm(), 0.0, 0.1).get("joint2.loss_tors")) == 0.1


def test_damping_by_mass_falls_with_frequency() -> None:
    arm, posture = without_gravity(lossy(lcd_arm(), 0.0, 0.0)).replace({ALPHA: 0.5}), np.deg2rad([40.0, -80.0, 40.0])
    hertz = poles(arm, jnp.asarray(posture))[1]
    expected, what = 0.5 / (4 * np.pi * hertz), "damping ratios of mass-proportional damping"
    agrees(ratios(arm, posture), expected, "modal", what, "alpha / (2 omega)", rtol=1e-9)


def test_ratios_are_differentiable_in_loss_factors() -> None:
    arm, paths = (
        lossy(first_guess_arm(), 0.02, 0.06, 1e-3),
        ("joint1.loss_tors", "joint2.loss_bend", "joint1.k_tors", "link2.mass"),
    )

    def damping(x: jax.Array) -> jax.Array:
        values = {path: arm.get(path) * jnp.exp(each) for path, each in zip(paths, x, strict=True)}
        s = damped_eigenvalues(linearize(at_posture(arm.replace(values), jnp.zeros(3))))
        return -s.real / jnp.abs(s)

    both = jax.jit(lambda x: (damping(x), jax.jacfwd(damping)(x)))
    slopes = np.asarray(both(jnp.zeros(4))[1])
    for i, step in enumerate(1e-5 * np.eye(4)):
        expected, what = (both(step)[0] - both(-step)[0]) / 2e-5, "slopes of damping ratios by loss factors"
        agrees(slopes[:, i], expected, "modal", what, "central differences", rtol=1e-7, atol=1e-7)
    assert (np.abs(slopes).max(0) > 1e-4).all()


def direct(M: np.ndarray, K: np.ndarray, L: np.ndarray) -> np.ndarray:
    """The damping matrix by SciPy's square roots and its solver of Sylvester's equation."""
    half = sqrtm(M)
    inverse = np.linalg.inv(half)
    root = sqrtm(inverse @ K @ inverse)
    return 2 * half @ solve_sylvester(root, root, inverse @ L @ inverse) @ half


@pytest.mark.parametrize("alpha", [0.0, 40.0, 46.0, 65.0])
def test_the_damping_matrix_in_time_is_scipys_and_gives_the_ratios_of_the_complex_stiffness(alpha: float) -> None:
    """Modes 3 and 4 veer at 46 deg, 1 and 2 cross at 65; with ten times the loss factors ratios differ by 2e-3."""
    s, _, system, _ = poles(lossy(lcd_arm(), 0.001, 0.003), jnp.deg2rad(alpha * jnp.array([1.0, -2.0, 1.0])))
    D, s_in_time = in_time(system)
    expected = direct(*map(np.asarray, (system.M, system.H, system.L)))
    what, source = "damping matrix of loss factors in time", "SciPy's sqrtm and solve_sylvester"
    agrees(D, expected, "modal", what, source, rtol=1e-7, atol=float(1e-10 * abs(D).max()))
    assert np.linalg.eigvalsh(D)[0] > 0
    found, expected = s_in_time.real / abs(s_in_time), s.real / abs(s)
    what, source = "damping ratios of loss factors in time", "complex-stiffness eigenproblem"
    agrees(found, expected, "modal", what, source, rtol=1e-4)


def test_its_slopes_are_finite_where_frequencies_are_equal() -> None:
    K, L = np.diag([4.0, 4.0, 9.0]), np.array([[1.0, 0.5, 0.2], [0.5, 2.0, 0.3], [0.2, 0.3, 3.0]])
    along = np.array([[1.0, 0.7, 0.1], [0.7, -0.4, 0.2], [0.1, 0.2, 0.5]])
    slope = jax.jit(jax.jacfwd(lambda x: structural_damping(jnp.eye(3), K + x * along, L + x * along)))(0.0)
    there, back = (direct(np.eye(3), K + x * along, L + x * along) for x in (1e-5, -1e-5))
    what, source = (
        "slope of the damping matrix at equal frequencies",
        "differences of SciPy's sqrtm and solve_sylvester",
    )
    agrees(slope, (there - back) / 2e-5, "modal", what, source, rtol=1e-7, atol=1e-8)


@pytest.mark.parametrize("rate", [0.1, 1.0])
def test_a_swept_force_passes_a_resonance_as_modal_superposition_has_it(rate: float) -> None:
    """At a held posture, 1 % in all modes, a force on the last bushing swept from 3 to 6 Hz [Hz/s]."""
    *_, system, _ = poles(without_gravity(lossy(lcd_arm(), 0.02, 0.02)), jnp.zeros(3))
    M, K = np.asarray(system.M), np.asarray(system.H)
    D = np.asarray(in_time(system)[0])
    time = np.arange(0.0, 3 / rate, 1e-3)
    pull = np.outer(np.sin(2 * np.pi * (3 * time + rate * time**2 / 2)), np.arange(1.0, 10.0))
    zero, one = np.zeros_like(M), np.eye(9)
    A = np.block([[zero, one], [-np.linalg.solve(M, K), -np.linalg.solve(M, D)]])
    whole = lsim((A, np.vstack([zero, np.linalg.inv(M)]), np.hstack([one, zero]), zero), pull, time)[1]
    values, V = eigh(K, M)
    w = np.sqrt(values)
    modal = [lsim(([1.0], [1.0, 0.02 * w[i], w[i] ** 2]), pull @ V[:, i], time)[1] for i in range(9)]
    expected = np.array(modal).T @ V.T
    largest, what = np.abs(whole).max(0), "swept force through a resonance, loss factors"
    agrees(largest, np.abs(expected).max(0), "vibration", what, "SciPy's lsim of each mode", rtol=1e-9, unit="m")
    assert np.abs(whole[:, 0]).max() > 5 * np.abs(whole[: len(time) // 10, 0]).max()  # the resonance lies within
