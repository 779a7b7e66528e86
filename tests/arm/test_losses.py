"""Loss factors: poles of the arm against the complex-stiffness eigenproblem and closed forms, and what refuses them."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from arms import first_guess_arm, lcd_arm, random_arm, without_gravity
from scipy.linalg import eig, eigh

from ident.arm.arm import Arm
from ident.arm.chain import Chain, at_posture
from ident.arm.modes import Linearized, damped_eigenvalues, linearize, natural_frequencies
from ident.arm.multibody import multibody
from ident.errors import InputError


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


def ratios(arm: Arm, posture: np.ndarray) -> np.ndarray:
    s = np.asarray(poles(arm, jnp.asarray(posture))[0])
    return -s.real / np.abs(s)


@pytest.mark.parametrize("eta", [0.001, 0.05, 0.3])
def test_one_loss_factor_gives_each_mode_half_of_it_at_any_frequency(eta: float) -> None:
    arm = without_gravity(lossy(lcd_arm(), eta, eta))  # gravity gives without loss
    s, hertz, *_ = poles(arm, jnp.zeros(3))
    np.testing.assert_allclose(-s.real / np.abs(s), np.sin(np.arctan(eta) / 2), rtol=1e-9)
    np.testing.assert_allclose(np.abs(s) / (2 * np.pi), hertz * (1 + eta**2) ** 0.25, rtol=1e-9)


def test_random_arms_are_as_the_complex_stiffness_eigenproblem() -> None:
    """Without dampers lambda = -s^2 solves (H + i L) x = lambda M x, here by LAPACK's QZ."""
    rng = np.random.default_rng(0)
    for _ in range(3):
        arm = lossy(random_arm(rng, 2), 0.05, 0.2)
        s, _, system, _ = poles(arm, jnp.asarray(rng.uniform(-2, 2, 2)))
        M, H, L = (np.asarray(x) for x in (system.M, system.H, system.L))
        expected = np.sort_complex(np.sqrt(eig(H + 1j * L, M, right=False)))
        np.testing.assert_allclose(np.sort_complex(np.asarray(s) / 1j), expected, rtol=1e-8)


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
    np.testing.assert_allclose(ratios(lossy(arm, bend, tors, tau), posture), expected, rtol=2e-3)


def test_an_arm_without_loss_factors_has_neither_paths_nor_a_matrix_of_them() -> None:
    assert not any("loss" in path for path in lcd_arm().paths())
    assert poles(lcd_arm(), jnp.zeros(3))[2].L is None
    with pytest.raises(InputError, match="loss_tors"):
        lcd_arm().replace({"joint1.loss_tors": 0.1})
    assert float(lossy(lcd_arm(), 0.0, 0.1).get("joint2.loss_tors")) == 0.1


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
        np.testing.assert_allclose(slopes[:, i], (both(step)[0] - both(-step)[0]) / 2e-5, atol=1e-7)
    assert (np.abs(slopes).max(0) > 1e-4).all()


def test_motion_in_time_refuses_them() -> None:
    with pytest.raises(InputError, match=r"loss_bend.*tau_bend = loss factor / \(2 pi f\)"):
        multibody(lossy(lcd_arm(), 0.05, 0.05))
