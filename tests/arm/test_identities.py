"""What must hold between the quantities of an arm, and closed forms."""

from functools import cache, partial
from itertools import product

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.linalg as sl
from arms import posture_of, random_arm, without_gravity
from conformance import agrees
from engines import EIGHTH_ORDER
from jaxtyping import Array
from potential import potential_energy

from ident.arm.arm import Arm, stiffness_paths
from ident.arm.chain import Chain, Loads, at_posture, no_loads
from ident.arm.mechanics import (
    deflection,
    equilibrium,
    mass_matrix,
    point_positions,
    potential_derivatives,
    potential_gradient,
    second_variations,
    unflatten,
)
from ident.arm.modes import Linearized, damped_eigenvalues, linearize, mac, modes
from ident.arm.parts import Body, Joint, Payload, Point

pytestmark = pytest.mark.slow

G = 9.80665
held = jax.jit(at_posture)
all_modes = jax.jit(modes)
settle = jax.jit(equilibrium)
system_of = jax.jit(linearize)
damped = jax.jit(damped_eigenvalues)
masses = jax.jit(mass_matrix)
slopes = jax.jit(potential_derivatives)
gradient_of = jax.jit(potential_gradient)
places = jax.jit(point_positions)
moved_by = jax.jit(deflection)


@cache
def sample(joints: int = 3, gravity: float = G) -> tuple[Arm, Array]:
    rng = np.random.default_rng(7)
    arm = random_arm(rng, joints, gravity=gravity)
    return arm, posture_of(arm, rng)


def worst(a: Array, b: Array) -> float:
    """Largest difference by the largest entry of b."""
    a, b = np.asarray(a), np.asarray(b)
    return float(np.abs(a - b).max() / np.abs(b).max())


def a_phi(joints: int, seed: int = 8) -> Array:
    return jnp.asarray(np.random.default_rng(seed).normal(size=(3, joints)) * 0.3)


# energies


FORCE, MOMENT = jnp.array([[50.0, 0], [-30, 20], [10, -90]]), jnp.array([[0.0, 4], [20, -30], [0, 50]])


def test_gradient_hessian_and_second_variations_are_those_of_the_energies() -> None:
    """Under payload, masses, forces and moments."""
    arm, posture = sample()
    loads = Loads(jnp.array([1.0]), jnp.array([2.0, 1.0]), FORCE, MOMENT)
    chain, phi, v = held(arm, posture, loads), a_phi(3), a_phi(3, seed=9)
    chain = eqx.tree_at(lambda c: (c.bend, c.tors), chain, (chain.bend * 1e-3, chain.tors * 1e-3))

    @jax.jit
    def derivatives(chain: Chain, x: Array) -> tuple[Array, Array]:
        def energy(x: Array) -> Array:
            return potential_energy(chain, unflatten(x))

        return jax.grad(energy)(x), jax.hessian(energy)(x)

    gradient, hessian = slopes(chain, phi)
    for found, expected in zip((gradient, hessian), derivatives(chain, phi.T.reshape(-1)), strict=True):
        what, source = "gradient and Hessian of the potential", "automatic differentiation of the energy"
        agrees(found, expected, "statics", what, source, largest=1e-13)
    assert worst(gradient_of(chain, phi), gradient) < 1e-15
    flat = v.T.reshape(-1)
    for found, matrix in zip(jax.jit(second_variations)(chain, phi, v), (hessian, masses(chain, phi)), strict=True):
        what, source = "second variations of both energies", "v' H v and v' M v"
        agrees(found, flat @ matrix @ flat, "mechanics", what, source, rtol=1e-12)


# modes


def test_modes_are_mass_normalised_and_orthogonal() -> None:
    chain = held(*sample())
    system, found = system_of(chain), all_modes(chain)
    V, omega = found.shape, 2 * np.pi * found.frequency
    source = "V' M V = 1, V' K V = omega^2"
    agrees(V.T @ system.M @ V, jnp.eye(9), "modal", "modes are orthogonal in the mass", source, atol=1e-11)
    K = V.T @ system.H @ V / omega[:, None] / omega
    agrees(K, jnp.eye(9), "modal", "modes are orthogonal in the stiffness", source, atol=1e-11)


def test_shares_sum_to_one() -> None:
    found = all_modes(held(*sample()))
    shares = found.bend.sum(0) + found.tors.sum(0)
    agrees(shares, 1, "modal", "shares of the strain energy", "they sum to 1", atol=1e-14)
    assert found.bend.min() >= 0
    assert found.tors.min() >= 0


def test_frequency_slope_is_the_energy_share() -> None:
    """df/dk = share f / (2 k), by differences of the eighth order; without gravity, which moves the equilibrium."""
    chain = held(*sample(3, 0.0))
    found = all_modes(chain)

    def frequency(name: str, joint: int, change: float) -> Array:
        factors = jnp.ones(3).at[joint].set(1 + change)
        return all_modes(eqx.tree_at(lambda c: getattr(c, name), chain, getattr(chain, name) * factors)).frequency

    slopes = []
    for name, joint in product(("bend", "tors"), range(3)):
        f = partial(frequency, name, joint)
        slopes.append(sum(w * (f(1e-3 * n) - f(-1e-3 * n)) for n, w in EIGHTH_ORDER.items()) / 1e-3)
    by_energy = jnp.concatenate([found.bend, found.tors]) * found.frequency / 2
    source = "Rayleigh: share of the strain energy times f / 2"
    agrees(jnp.stack(slopes), by_energy, "modal", "slope of a frequency by ln stiffness", source, largest=1e-10)


def test_frequencies_scale_with_the_root_of_stiffness() -> None:
    """Exact without gravity, whose own stiffness does not scale."""
    chain = held(*sample(3, 0.0))
    stiff = eqx.tree_at(lambda c: (c.bend, c.tors), chain, (4 * chain.bend, 4 * chain.tors))
    found, expected = all_modes(stiff).frequency, 2 * all_modes(chain).frequency
    what, source = "frequencies of an arm four times as stiff", "root of the stiffness: twice"
    agrees(found, expected, "modal", what, source, largest=1e-12, unit="Hz")


def test_motion_is_how_the_points_move() -> None:
    """Against central differences of the positions, whose cut-off error is 1e-8 of the motion."""
    chain = held(*sample())
    phi, found, h = settle(chain), all_modes(chain), 1e-4
    for i in range(3):
        step = h * unflatten(found.shape[:, i])
        moved = (places(chain, phi + step) - places(chain, phi - step)) / (2 * h)
        what, source = "mode shapes at the points", "central differences of positions"
        agrees(found.motion[:, :, i], moved, "modal", what, source, largest=1e-7)


def test_mac() -> None:
    rng = np.random.default_rng(0)
    a, b = (jnp.asarray(rng.normal(size=(9, 4)) + 1j * rng.normal(size=(9, 4))) for _ in range(2))
    assert jnp.allclose(mac(a, a), 1, rtol=1e-14)
    assert jnp.allclose(mac(a, (2 - 3j) * a), 1, rtol=1e-14)
    assert jnp.allclose(mac(a, b), mac(b, a), rtol=1e-14)
    assert (mac(a, b) < 1).all()
    assert mac(jnp.eye(3)[0], jnp.eye(3)[1]) == 0
    found = mac(jnp.array([1.0, 1.0]), jnp.array([1.0, 0.0]))
    agrees(found, 0.5, "modal", "MAC of shapes at 45 degrees", "cos^2", rtol=1e-7)


# closed forms of one body on one bushing


def pendulum(height: float, tilt: float = 0.0) -> Arm:
    """A rod along z; gravity tilted in the x-z plane."""
    inertia = np.diag([0.5, 0.6, 0.1])
    body = Body("rod", 4.0, (0.0, 0.0, height), inertia)
    down = G * np.array([np.sin(tilt), 0.0, -np.cos(tilt)])
    joint = Joint("j", k_bend=900.0, k_tors=200.0, tau_bend=2e-3, tau_tors=5e-4, link=(body,))
    return Arm("pendulum", (joint,), points=(Point("end", "j", (0.0, 0.0, height)),), gravity=down)


@pytest.mark.parametrize("height", [0.4, -0.4])
def test_pendulum_frequencies(height: float) -> None:
    """Standing, gravity takes m g h from the bending stiffness; hanging, it adds it; torsion does not feel it."""
    about_x, about_y = (900 - 4 * G * height), (900 - 4 * G * height)
    squared = [about_x / (0.5 + 4 * 0.16), about_y / (0.6 + 4 * 0.16), 200 / 0.1]
    found = all_modes(held(pendulum(height), jnp.zeros(1)))
    expected, source = np.sort(np.sqrt(squared)) / (2 * np.pi), "omega^2 = (k -/+ m g h) / I"
    what = "pendulum on a bushing, standing and hanging"
    agrees(found.frequency, expected, "modal", what, source, rtol=1e-13, unit="Hz")


@pytest.mark.parametrize("tilt", [0.3, np.pi / 2])
def test_pendulum_deflection(tilt: float) -> None:
    """k theta = m g h sin(tilt + theta), theta about y."""
    chain = held(pendulum(0.4, tilt), jnp.zeros(1))
    phi = settle(chain)
    theta = float(phi[1, 0])
    assert abs(900 * theta - 4 * G * 0.4 * np.sin(tilt + theta)) < 1e-11
    assert np.abs(phi[::2]).max() < 1e-15
    expected = [0.4 * np.sin(theta), 0.0, 0.4 * (np.cos(theta) - 1)]
    what, source = "deflection of a leaning rod", "k theta = m g h sin(tilt + theta)"
    agrees(moved_by(chain, phi)[:, 0], expected, "statics", what, source, atol=1e-15, unit="m")


# damping


def test_damped_eigenvalues_of_single_modes() -> None:
    """Without gravity C = tau K of each direction: s = -zeta w + i w sqrt(1 - zeta^2), zeta = tau w / 2."""
    s = damped(system_of(held(without_gravity(pendulum(0.4)), jnp.zeros(1))))
    omega = np.sqrt([900 / (0.6 + 0.64), 900 / (0.5 + 0.64), 200 / 0.1])
    zeta = np.array([2e-3, 2e-3, 5e-4]) * omega / 2
    expected = -zeta * omega + 1j * omega * np.sqrt(1 - zeta**2)
    what, source = "damped poles of single modes", "-zeta w + i w sqrt(1 - zeta^2)"
    agrees(s, expected, "modal", what, source, rtol=1e-12, unit="rad/s")


def test_proportional_damping_on_a_whole_arm() -> None:
    arm, posture = sample(3, 0.0)
    tau = {path.replace("k_", "tau_"): 1e-4 for path in stiffness_paths(arm)}
    system = system_of(held(arm.replace(tau), posture))
    s = damped(system)
    omega = 2 * np.pi * all_modes(held(arm, posture)).frequency
    assert np.allclose(jnp.abs(s), omega, rtol=1e-10)
    what, source = "damping ratios of stiffness-proportional damping", "tau omega / 2"
    agrees(-s.real / jnp.abs(s), 1e-4 * omega / 2, "modal", what, source, rtol=1e-9)


def test_damped_eigenvalues_against_the_state_matrix() -> None:
    """The state matrix built without whitening; balanced by SciPy, good to 1e-9 of each eigenvalue here."""
    system = system_of(held(*sample()))
    M, C, H = (np.asarray(x) for x in system[1:4])
    state = np.block([[np.zeros((9, 9)), np.eye(9)], [-sl.solve(M, H), -sl.solve(M, C)]])
    values = sl.eigvals(state)
    found = np.asarray(damped(system))
    assert len(np.unique(found.round(6))) == 9
    nearest = np.array([values[np.abs(values / s - 1).argmin()] for s in found])
    source = "SciPy's eigenvalues of the state matrix"
    agrees(nearest / found, 1, "modal", "damped poles of a whole arm", source, atol=1e-9)


def test_an_overdamped_mode_does_not_shift_the_damping_of_the_others() -> None:
    """Two uncoupled oscillators, the lower one overdamped: 5^2 - 4 * 4 > 0; the upper one has zeta = 0.1 / (2 * 10)."""
    M, C, H = jnp.eye(2), jnp.diag(jnp.array([5.0, 0.1])), jnp.diag(jnp.array([4.0, 100.0]))
    s = damped(Linearized(jnp.zeros((3, 1)), M, C, H))
    assert s[0] == pytest.approx(-1.0)
    what = "damping ratio next to an overdamped mode"
    agrees(-s[1].real / abs(s[1]), 0.005, "modal", what, "c / (2 omega)", rtol=1e-6)


# batches


def varied(k: Array) -> Arm:
    return sample()[0].replace({"j0.k_bend": k, "link1.mass": k / 2e4, "link1.com.x": k / 1e5})


def test_batch_equals_one_at_a_time() -> None:
    """Postures over the first of two axes, stiffnesses over the last."""
    postures = jnp.asarray(np.random.default_rng(1).normal(size=(3, 2, 1)))
    chain = held(varied(jnp.linspace(3e4, 9e4, 3)), postures)
    found, moved = all_modes(chain), moved_by(chain, settle(chain))
    assert found.frequency.shape == (9, 2, 3)
    assert found.motion.shape == (3, 2, 9, 2, 3)
    for i, k in enumerate(np.linspace(3e4, 9e4, 3)):
        for j in range(2):
            single = held(varied(k), postures[:, j, 0])
            alone = all_modes(single)
            assert worst(found.frequency[:, j, i], alone.frequency) < 1e-12
            assert worst(found.bend[:, :, j, i], alone.bend) < 1e-10
            assert worst(moved[..., j, i], moved_by(single, settle(single))) < 1e-12


def test_a_batch_can_be_replaced_again() -> None:
    many = varied(jnp.ones(3))
    assert many.paths() == sample()[0].paths()
    assert float(many.replace({"j0.k_bend": 5.0}).get("j0.k_bend")) == 5.0


# loads, collapse


def loaded_at_tip(arm: Arm, posture: Array, payload: float, mass: float, force: Array) -> Chain:
    none = no_loads(arm)
    return held(
        arm,
        posture,
        Loads(none.payload + payload, none.mass.at[-1].set(mass), none.force.at[:, -1].set(force)),
    )


def built_in(arm: Arm, body: Body) -> Arm:
    last = arm.joints[-1]
    return eqx.tree_at(lambda a: a.joints[-1].link, arm, (*last.link, body))


def same_chain(a: Chain, b: Chain) -> bool:
    return all(
        np.allclose(x, y, rtol=1e-13, atol=1e-13) for x, y in zip(jax.tree.leaves(a), jax.tree.leaves(b), strict=True)
    )


def test_payload_is_a_body_of_the_link() -> None:
    arm, posture = sample()
    extra = Body("extra", arm.payloads[0].body.mass, arm.payloads[0].body.com, arm.payloads[0].body.inertia)
    chain = loaded_at_tip(arm, posture, 1.0, 0.0, jnp.zeros(3))
    assert same_chain(chain, held(built_in(arm, extra), posture))
    assert not same_chain(chain, held(arm, posture))


def test_point_mass_is_a_body_of_the_link() -> None:
    arm, posture = sample()
    chain = loaded_at_tip(arm, posture, 0.0, 3.0, jnp.zeros(3))
    assert same_chain(chain, held(built_in(arm, Body("extra", 3.0, arm.points[-1].position)), posture))


@jax.jit
def of_tip(chain: Chain, phi: Array) -> Array:
    """How the tip moves with the coordinates."""
    return jax.jacfwd(lambda x: point_positions(chain, unflatten(x))[:, -1])(phi.T.reshape(-1))


def test_force_does_virtual_work_at_its_point() -> None:
    arm, posture = sample()
    force, phi = jnp.array([40.0, -20.0, 70.0]), a_phi(3)
    loaded, bare = (loaded_at_tip(arm, posture, 0.0, 0.0, f) for f in (force, 0 * force))

    jacobian = of_tip(bare, phi)
    difference = gradient_of(loaded, phi) - gradient_of(bare, phi)
    # the springs' moments, 1e5 N m, cancel in the difference
    what, source = "generalised forces of a load at a point", "virtual work, -J' F"
    agrees(difference, -jacobian.T @ force, "statics", what, source, largest=1e-11)


def test_weight_as_a_force_sags_like_a_point_mass() -> None:
    arm, posture = sample()
    by_mass = loaded_at_tip(arm, posture, 0.0, 3.0, jnp.zeros(3))
    by_force = loaded_at_tip(arm, posture, 0.0, 0.0, 3.0 * arm.gravity)
    what, source = "equilibrium under a point mass", "its weight as a force"
    agrees(settle(by_mass), settle(by_force), "statics", what, source, largest=1e-12, unit="rad")
    assert all_modes(by_mass).frequency[0] < all_modes(by_force).frequency[0]


def test_small_force_moves_the_tip_by_the_compliance() -> None:
    """Reciprocity: the tip compliance J H^-1 J' is symmetric and its column is the deflection per newton."""
    arm, posture = sample()
    system = system_of(loaded_at_tip(arm, posture, 0.0, 0.0, jnp.zeros(3)))
    bare = loaded_at_tip(arm, posture, 0.0, 0.0, jnp.zeros(3))
    J = of_tip(bare, system.phi)
    compliance = J @ jnp.linalg.solve(system.H, J.T)
    moved = []
    for force in np.eye(3):
        ends = []
        for sign in (1, -1):
            chain = loaded_at_tip(arm, posture, 0.0, 0.0, sign * jnp.asarray(force))
            ends.append(places(chain, settle(chain))[:, -1])
        moved.append((ends[0] - ends[1]) / 2)
    what, source = "compliance of the tip by nonlinear statics", "J H^-1 J', reciprocity"
    agrees(jnp.stack(moved, 1), compliance, "statics", what, source, largest=1e-7, unit="m/N")


def test_equilibrium_is_nan_where_the_arm_buckles_and_leaves_the_others_of_a_batch_alone() -> None:
    """m g h = 15.69 N m: a softer bushing cannot hold the rod upright."""
    k = jnp.array([17.0, 15.0, 900.0])
    chain = held(pendulum(0.4).replace({"j.k_bend": k}), jnp.zeros((1, 1)))
    frequency = all_modes(chain).frequency
    np.testing.assert_array_equal(np.isfinite(settle(chain)).all((0, 1)), [True, False, True])
    assert np.isnan(frequency[:, 1]).all()
    assert np.isfinite(frequency[:, [0, 2]]).all()
    alone = all_modes(held(pendulum(0.4), jnp.zeros(1))).frequency
    assert worst(frequency[:, 2], alone) < 1e-13


def test_integers_are_taken_as_numbers() -> None:
    """A coordinate given as an int must not round what replaces it."""
    arm = Arm("i", (Joint("j", k_bend=9, k_tors=2, offset=(0, 0, 1), link=(Body("b", 1, (0, 0, 1)),)),))
    assert float(arm.replace({"j.offset.x": 0.5}).get("j.offset.x")) == 0.5
    assert float(arm.replace({"b.com.z": 0.5}).get("b.com.z")) == 0.5


def test_payload_off_by_default() -> None:
    arm, posture = sample()
    heavy = Arm("h", arm.joints, arm.points, (Payload("j2", Body("weight", 500.0)),), arm.gravity)
    assert same_chain(held(heavy, posture), held(arm, posture))
