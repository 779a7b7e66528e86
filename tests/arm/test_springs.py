"""Springs that are no straight line: against curves integrated by SciPy on MuJoCo's gravity, and closed forms."""

from dataclasses import replace
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from arms import random_arm
from conformance import agrees
from engines import MujocoArm, stiffness
from potential import of_springs, potential_energy
from scipy.interpolate import PPoly
from scipy.linalg import eigh
from scipy.optimize import brentq, root

from ident.arm.arm import Arm
from ident.arm.chain import Chain, at_posture
from ident.arm.mechanics import (
    equilibrium,
    flat,
    potential_derivatives,
    second_variations,
    system,
    unflatten,
)
from ident.arm.modes import modes, natural_frequencies
from ident.arm.parts import Body, CubicSpring, Curves, Drive, Joint, Point, Servo, Spring, bends
from ident.errors import InputError

NUMBERS = {"ratio2": 1.6, "ratio3": 2.3, "torque1": 4.0, "torque2": 11.0}
SEEDS = 12
POSTURE = np.array([0.4, -0.9, 1.3])


def curved_arm(seed: int = 0) -> Arm:
    """A soft random arm that hangs in all pieces of its curves: broken lines, a cubic, and straight springs."""
    rng = np.random.default_rng(seed)
    arm = random_arm(rng, 3)
    joints = tuple(
        replace(j, k_bend=jnp.array(rng.uniform(1500, 3000)), k_tors=jnp.array(rng.uniform(1500, 3000)))
        for j in arm.joints
    )

    def broken(name: str, joint: str, direction: str, ratio2: float) -> Spring:
        first = np.exp(rng.uniform(0.0, 3.5))
        return Spring(name, joint, direction, ratio2=ratio2, ratio3=2.3, torque1=first, torque2=2.75 * first)

    springs = (
        broken("s0", "j0", "bending", 1.6),
        CubicSpring("s1", "j1", "torsion", 4e7),
        broken("s2", "j2", "torsion", 0.7),
        broken("s3", "j1", "bending", 1.6),
    )
    return replace(arm, joints=joints, springs=springs)


def bent_arm() -> Arm:
    """One of them whose broken lines all bend under its weight: at T1, beyond T2, between the two."""
    loads = {"s0": (17.0, 40.0), "s2": (0.5, 1.2), "s3": (6.0, 30.0)}
    each = loads.items()
    return curved_arm().replace({f"{s}.torque{n + 1}": load[n] for s, load in each for n in (0, 1)})


def torque_of(spring, k: float):
    """Torque over the angle's size, anew: the tangent's pieces as polynomials, integrated by SciPy."""
    if isinstance(spring, CubicSpring):
        return lambda x: k * x + float(spring.cubic) * x**3
    k1, k2, k3 = k, k * float(spring.ratio2), k * float(spring.ratio3)
    x1 = float(spring.torque1) / k1
    x2 = x1 + float(spring.torque2 - spring.torque1) / k2
    ends = [0, 0.75 * x1, 1.25 * x1, 0.75 * x2, 1.25 * x2, 1.0]
    assert (np.diff(ends) > 0).all()
    flat_parts, pieces = iter((k1, k2, k3)), []
    for (low, high), (a, b) in zip(((k1, k2), (k2, k3)), ((ends[1], ends[2]), (ends[3], ends[4])), strict=True):
        pieces.append([0, 0, 0, next(flat_parts)])
        width = b - a
        pieces.append([-2 * (high - low) / width**3, 3 * (high - low) / width**2, 0, low])
    pieces.append([0, 0, 0, next(flat_parts)])
    return PPoly(np.array(pieces).T, ends).antiderivative()


def springs_gradient(arm: Arm, frames: list[np.ndarray]):
    """Moments of all bushings by their rotation vectors in base axes."""
    by_place = {(s.joint, s.direction): s for s in arm.springs}

    def law(name: str, direction: str, k: float):
        spring = by_place.get((name, direction))
        return torque_of(spring, k) if spring else (lambda x: k * x)

    laws = [
        (law(j.name, "bending", float(j.k_bend)), law(j.name, "torsion", float(j.k_tors)), F @ np.asarray(j.axis))
        for j, F in zip(arm.joints, frames, strict=True)
    ]

    def gradient(x: np.ndarray) -> np.ndarray:
        moments = []
        for (bend, tors, axis), phi in zip(laws, x.reshape(-1, 3), strict=True):
            along = phi @ axis
            across = phi - along * axis
            r = np.linalg.norm(across)
            moments.append(bend(r) * across / r + np.sign(along) * tors(abs(along)) * axis)
        return np.concatenate(moments)

    return gradient


def differences(f, x: np.ndarray, h: float) -> np.ndarray:
    """Jacobian by central differences of order four."""
    steps = h * np.eye(len(x))
    return np.stack([(8 * (f(x + e) - f(x - e)) - f(x + 2 * e) + f(x - 2 * e)) / (12 * h) for e in steps], -1)


held = jax.jit(at_posture)


@jax.jit
def computed(arm: Arm, posture):
    chain = at_posture(arm, posture)
    phi = equilibrium(chain)
    return phi, natural_frequencies(chain, 9), potential_derivatives(chain, phi)[1]


@pytest.mark.parametrize("seed", range(SEEDS))
def test_equilibrium_and_frequencies_are_those_of_mujocos_gravity_on_curves_written_anew(seed):
    arm = curved_arm(seed)
    phi, hertz, H = computed(arm, POSTURE)
    engine = MujocoArm(arm, POSTURE)
    springs = springs_gradient(arm, engine.frames())

    def gradient(x):
        return engine.gravity_gradient(x) + springs(x)

    x = np.asarray(flat(phi))
    solved = root(gradient, x + 1e-4 * np.sin(np.arange(9.0)), tol=1e-15).x
    source = "MuJoCo's gravity, SciPy's PPoly and MINPACK"
    agrees(x, solved, "statics", "equilibrium on curved springs", source, rtol=1e-8, atol=1e-12, unit="rad")
    expected = engine.gravity_hessian(x) + differences(springs, x, 1e-6)
    what = "tangent stiffness on curved springs"
    agrees(H, expected, "statics", what, "MuJoCo's gravity, SciPy's PPoly", rtol=1e-7, largest=1e-7)
    values = eigh((expected + expected.T) / 2, engine.mass_matrix(x), eigvals_only=True)
    frequencies, what = np.sqrt(values) / (2 * np.pi), "natural frequencies on curved springs"
    agrees(hertz, frequencies, "modal", what, "MuJoCo, SciPy's PPoly, LAPACK", rtol=1e-8, unit="Hz")


def test_those_arms_bend_into_all_pieces_of_their_curves():
    pieces = set()
    for seed in range(SEEDS):
        arm = curved_arm(seed)
        phi = np.asarray(computed(arm, POSTURE)[0])
        axes = np.asarray(held(arm, POSTURE).curved.axis)
        along = (axes * phi).sum(0)
        across = np.linalg.norm(phi - axes * along, axis=0)
        for s in (each for each in arm.springs if isinstance(each, Spring)):
            n = int(s.joint[1])
            bending = s.direction == "bending"
            k = float(arm.joints[n].k_bend if bending else arm.joints[n].k_tors)
            ends = torque_of(s, k).x[1:-1]
            pieces.add(int(np.searchsorted(ends, across[n] if bending else abs(along[n]))))
    assert pieces == {0, 1, 2, 3, 4}


@jax.jit
def variations(chain: Chain, phi, v):
    """Gradient and Hessian, the energy's own gradient, and the second variation along v."""
    energy = jax.grad(lambda phi: potential_energy(chain, phi))
    return *potential_derivatives(chain, phi), flat(energy(phi)), second_variations(chain, phi, v)[0]


def test_gradient_hessian_and_second_variation_are_the_energys_derivatives():
    arm, rng = bent_arm(), np.random.default_rng(1)
    chain = held(arm, POSTURE)
    for _ in range(3):
        phi, v = jnp.asarray(rng.normal(size=(2, 3, 3)) * 4e-3)
        gradient, H, slope, along = variations(chain, phi, v)
        what = "moments of curved springs"
        agrees(gradient, slope, "statics", what, "automatic slope of the energy", rtol=1e-9, atol=1e-12, unit="N m")
        hessian = differences(lambda x, v=v: np.asarray(variations(chain, unflatten(x), v)[2]), flat(phi), 1e-6)
        what, least = "Hessian of curved springs", 1e-8 * float(jnp.abs(H).max())
        agrees(H, hessian, "statics", what, "differences of the slope", rtol=1e-6, atol=least)
        np.testing.assert_allclose(along, flat(v) @ H @ flat(v), rtol=1e-10)


def test_derivatives_of_frequencies_and_deflections_are_differences():
    arm = bent_arm()
    paths = ("j0.k_bend", "s0.ratio2", "s0.torque1", "s2.ratio3", "s2.torque2", "s1.cubic", "s3.torque1")
    start = np.log([float(arm.get(path)) for path in paths])

    def quantities(logs):
        chain = at_posture(arm.replace(dict(zip(paths, jnp.exp(logs), strict=True))), POSTURE)
        return jnp.concatenate([natural_frequencies(chain, 9), 1e3 * flat(equilibrium(chain))])

    both = jax.jit(lambda logs: (quantities(logs), jax.jacfwd(quantities)(logs)))
    slopes = np.asarray(both(start)[1])
    expected = differences(lambda logs: both(logs)[0], start, 1e-4)
    what = "slopes of frequencies and sag by spring curves"
    agrees(slopes, expected, "statics", what, "differences of order 4", rtol=1e-6, atol=1e-7)
    assert (np.abs(slopes).max(0) > 1e-3).all()


@pytest.mark.slow
def test_a_batch_of_springs_is_as_one_after_the_other():
    paths = ("j0.k_bend", "s0.torque1", "s2.ratio2", "s1.cubic")
    factors = np.exp(np.random.default_rng(2).uniform(-0.2, 0.2, (len(paths), 3)))
    values = {path: float(bent_arm().get(path)) * factor for path, factor in zip(paths, factors, strict=True)}
    phi, hertz, _ = computed(bent_arm().replace(values), POSTURE[:, None])
    for n in range(3):
        alone = computed(bent_arm().replace({path: value[n] for path, value in values.items()}), POSTURE)
        np.testing.assert_allclose(phi[..., n], alone[0], rtol=1e-10, atol=1e-14)
        np.testing.assert_allclose(hertz[..., n], alone[1], rtol=1e-10)


@pytest.mark.slow
def test_unloaded_and_below_t1_the_springs_are_straight():
    arm = curved_arm()
    far = {f"s{n}.torque{k}": 1e4 * k for n in (0, 2, 3) for k in (1, 2)}
    stiff = arm.replace(far | {"s1.cubic": 0.0})
    straight = replace(stiff, springs=())
    for gravity in (1.0, 0.0):
        one, other = (replace(a, gravity=gravity * arm.gravity) for a in (stiff, straight))
        for x, y in zip(computed(one, POSTURE), computed(other, POSTURE), strict=True):
            what, source = "curved springs below T1", "the arm on straight ones"
            agrees(x, y, "statics", what, source, rtol=1e-12, atol=1e-15)


def test_bending_gives_alike_in_all_directions():
    arm = bent_arm()
    curved = held(arm, POSTURE).curved
    assert curved is not None
    axis = np.asarray(curved.axis)[:, 0]
    across = np.cross(axis, [0.3, 0.5, -0.2])
    across *= 2e-2 / np.linalg.norm(across)
    other = np.cross(axis, across)
    phi = np.zeros((2, 3, 3))
    phi[:, :, 0] = across, np.cos(1.1) * across + np.sin(1.1) * other
    energies, torques = (
        np.asarray(jnp.stack([f(jnp.asarray(p)) for p in phi])) for f in (partial(of_springs, curved), curved.torque)
    )
    np.testing.assert_allclose(energies[0], energies[1], rtol=1e-12)
    sizes = np.linalg.norm(torques[:, :, 0], axis=1)
    np.testing.assert_allclose(sizes[0], sizes[1], rtol=1e-12)
    assert sizes[0] > 0.1


def test_servos_see_the_tangent_as_brakes_do():
    rng = np.random.default_rng(3)
    arm = replace(bent_arm(), drives=(Drive("d", "j1", ratio=50.0),), servos=(Servo("servo", "j1", k_servo=20.0),))
    chain, phi = held(arm, POSTURE), jnp.asarray(rng.normal(size=(3, 3)) * 4e-3)
    H, straight = (jax.jit(potential_derivatives)(each, phi)[1] for each in (chain, replace(chain, curved=None)))
    assert float(jnp.abs(H - straight).max()) > 100
    _, _, on = jax.jit(system)(held(arm, POSTURE, servo=jnp.array(1.0)), phi)
    np.testing.assert_allclose(on[:9, :9], H, rtol=1e-9, atol=1e-6)


def test_a_tangent_lies_between_the_stiffnesses_however_near_t1_and_t2_are():
    rng = np.random.default_rng(5)
    ratio2, ratio3 = np.exp(rng.uniform(-2, 2, (2, 200)))
    first = np.exp(rng.uniform(-2, 2, 200))
    second = first * (1 + np.exp(rng.uniform(-8, 2, 200)))
    spring = Spring("s", "j", "torsion", ratio2=ratio2, ratio3=ratio3, torque1=first, torque2=second)
    rise, angle = jnp.asarray([ratio2 - 1, ratio3 - ratio2]), jnp.stack(bends(spring, 1.0))
    curves = Curves(rise, angle, jnp.zeros(200))
    low, high = (f(1, f(ratio2, ratio3)) for f in (np.minimum, np.maximum))
    tangent_at = jax.jit(lambda s: 1 + curves.secant(s) + curves.steepening(s) * s)
    for share in np.geomspace(1e-3, 10, 400):
        tangent = np.asarray(tangent_at((share * angle[1]) ** 2))
        assert (tangent > low * (1 - 1e-9)).all()
        assert (tangent < high * (1 + 1e-9)).all()


def pendulum(**springs) -> Arm:
    """A bar of 20 kg that a horizontal pin holds at a right angle to gravity; its torsion carries 98 N m."""
    bar = Body("bar", 20.0, (0.5, 0.0, 0.0), np.diag([0.01, 1.6, 1.6]))
    joint = Joint("j", axis=(0.0, 1.0, 0.0), k_bend=1e9, k_tors=8e3, link=(bar,))
    spring = (Spring("s", "j", "torsion", **springs),) if springs else ()
    return Arm("pendulum", (joint,), (Point("tip", "j", (1.0, 0.0, 0.0)),), springs=spring)


def test_a_pendulum_sees_the_chord_at_rest_and_the_tangent_in_its_frequency():
    k1, r2, r3, t1, t2 = 8e3, 1.5, 2.5, 20.0, 60.0
    arm = pendulum(ratio2=r2, ratio3=r3, torque1=t1, torque2=t2)
    weight, x2 = 20.0 * 9.80665 * 0.5, t1 / k1 + (t2 - t1) / (k1 * r2)
    # the third piece of the catalogue's broken line
    angle = brentq(lambda x: t2 + r3 * k1 * (x - x2) - weight * np.cos(x), x2, 0.1, xtol=1e-16)
    phi, hertz = (np.asarray(x) for x in computed_pendulum(arm))
    what, source = "pendulum on a broken line", "catalogue's third piece, SciPy's brentq"
    agrees(phi.ravel(), [0, angle, 0], "statics", what, source, rtol=1e-7, atol=1e-9, unit="rad")
    omega2 = (r3 * k1 + weight * np.sin(angle)) / (1.6 + 20.0 * 0.25)
    expected, what = np.sqrt(omega2) / (2 * np.pi), "frequency of a pendulum on a broken line"
    agrees(hertz[0], expected, "modal", what, "(k3 + m g l sin) / I", rtol=1e-8, unit="Hz")
    chord = weight * np.cos(angle) / angle
    assert k1 * 1.3 < chord < 0.7 * r3 * k1


@jax.jit
def computed_pendulum(arm: Arm):
    chain = at_posture(arm, np.zeros(1))
    return equilibrium(chain), modes(chain).frequency


def test_stiffness_in_bushings_axes_is_that_of_the_engines():
    """What the tests above add to the engines' gravity is their own stiffness where nothing is curved."""
    arm = replace(curved_arm(), springs=())
    engine = MujocoArm(arm, POSTURE)
    x = 1e-3 * np.sin(np.arange(9.0))
    np.testing.assert_allclose(springs_gradient(arm, engine.frames())(x), stiffness(arm, engine) @ x, rtol=1e-10)


@pytest.mark.parametrize(
    ("springs", "words"),
    [
        ((Spring("s", "j9", "torsion", **NUMBERS),), "'j9'"),
        ((Spring("s", "j1", "twist", **NUMBERS),), "bending or torsion"),
        ((Spring("s", "j1", "torsion", **NUMBERS), CubicSpring("t", "j1", "torsion", 1.0)), "a second spring of j1"),
        ((Spring("s", "j1", "torsion", **NUMBERS | {"torque2": 4.0}),), "more than T1 = 4 N m"),
        ((Spring("s", "j1", "torsion", **NUMBERS | {"ratio2": 0.0}),), "a value > 0"),
        ((CubicSpring("s", "j1", "torsion", -1.0),), "a value >= 0"),
        ((Spring("j1", "j1", "torsion", **NUMBERS),), "unique names"),
    ],
)
def test_springs_that_no_arm_can_have(springs, words):
    with pytest.raises(InputError, match=words) as refused:
        replace(curved_arm(), springs=springs)
    assert "\n" not in str(refused.value)


def test_a_curved_spring_has_no_loss_factor():
    arm = curved_arm()
    lossy = tuple(replace(j, loss_tors=jnp.array(0.01)) for j in arm.joints)
    with pytest.raises(InputError, match="loss_tors out"):
        replace(arm, joints=lossy)
    replace(arm, joints=lossy, springs=(arm.springs[0],))
