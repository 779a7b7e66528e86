"""An arm on a base that gives, against the closed form of a rigid body on springs and against MuJoCo."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from arms import lcd_arm, random_arm
from conformance import agrees
from engines import MujocoArm, settled, stiffness
from jaxtyping import Array
from scipy.linalg import eigh

from ident.arm.arm import STIFFER, Arm, on_soft_base
from ident.arm.chain import at_posture
from ident.arm.mechanics import deflection, equilibrium, straight_positions
from ident.arm.modes import natural_frequencies
from ident.arm.parts import Body, Joint, Point
from ident.errors import InputError

pytestmark = pytest.mark.slow


def column(height: float, mass: float, com: float, moment: float) -> Arm:
    """A body of revolution on a bushing a thousand times stiffer than any base of the tests."""
    body = Body("body", mass, (0.0, 0.0, com), np.diag([moment, moment, moment / 2]))
    joint = Joint("joint1", offset=(0.0, 0.0, height), k_bend=1e9, k_tors=1e9, link=(body,))
    return Arm("column", (joint,), (Point("top", "joint1", (0.0, 0.0, 2 * com)),))


@eqx.filter_jit
def seen(arm: Arm, posture: Array) -> tuple[Array, Array]:
    """All frequencies [Hz], and by how much gravity moves each point [m]."""
    chain = at_posture(arm, posture)
    return natural_frequencies(chain, 3 * len(arm.joints)), deflection(chain, equilibrium(chain))


@pytest.mark.parametrize("height", [0.3, 1.0])
def test_a_rigid_body_rocks_on_the_base_as_an_inverted_pendulum_on_a_spring(height):
    mass, com, moment, k = 30.0, 0.6, 4.0, 5e4
    arm = on_soft_base(column(0.2, mass, com, moment), height).replace({"base.k_bend": k, "base.k_tors": 2 * k})
    pedestal = arm.joints[0].link[0]
    low, weight = float(pedestal.com[2]), float(pedestal.mass)
    inertia = moment + mass * (height + com) ** 2 + float(pedestal.inertia[0, 0]) + weight * low**2
    spring = k - 9.80665 * (mass * (height + com) + weight * low)
    rocking = np.sqrt(spring / inertia) / (2 * np.pi)
    turning = np.sqrt(2 * k / (moment / 2 + float(pedestal.inertia[2, 2]))) / (2 * np.pi)
    found = np.asarray(seen(arm, jnp.zeros(1))[0])[:3]
    # the body's own bushing gives 1/20000 and 1/10000 of the compliance
    expected, source = sorted([rocking, rocking, turning]), "inverted pendulum on a spring, closed form"
    agrees(found, expected, "modal", "rigid body rocking on a soft base", source, rtol=2e-4, unit="Hz")


def test_nothing_moves_where_the_base_is_put_under_it():
    arm, posture = lcd_arm(), jnp.array([0.3, -0.6, 0.3])
    based = on_soft_base(arm, 0.7)
    straight = eqx.filter_jit(lambda each: straight_positions(at_posture(each, posture)))
    before, after = map(straight, (arm, based))
    np.testing.assert_allclose(after, before, atol=1e-15)
    assert [joint.name for joint in based.driven] == [joint.name for joint in arm.driven]
    assert float(based.get("base.k_bend")) == STIFFER * float(arm.get("joint1.k_bend"))


@pytest.mark.parametrize("seed", range(3))
def test_frequencies_and_deflection_are_those_of_mujoco(seed):
    rng = np.random.default_rng(seed)
    arm = random_arm(rng, 3)
    arm = on_soft_base(arm, 0.4).replace({"base.k_bend": 2e5, "base.k_tors": 1e5})
    posture = jnp.asarray(rng.uniform(-np.pi, np.pi, 3))
    engine = MujocoArm(arm, posture)
    K = stiffness(arm, engine)
    x = settled(engine, K)
    H = engine.gravity_hessian(x) + K
    inverse = eigh(engine.mass_matrix(x), (H + H.T) / 2, eigvals_only=True)[::-1]
    found, moved = map(np.asarray, seen(arm, posture))
    hertz = 1 / (2 * np.pi * np.sqrt(inverse))
    agrees(found, hertz, "modal", "natural frequencies on a soft base", "MuJoCo, modes by LAPACK", rtol=1e-8, unit="Hz")
    sag, source = engine.point(x) - engine.point(0 * x), "MuJoCo, settled by MINPACK"
    agrees(moved[:, -1], sag, "statics", "deflection on a soft base", source, rtol=1e-9, atol=1e-12, unit="m")


def test_asked_for_twice_it_is_put_there_once():
    arm = on_soft_base(lcd_arm(), 0.5)
    assert on_soft_base(arm, 0.5) is arm


@pytest.mark.parametrize(
    ("arm", "got"),
    [
        (on_soft_base(lcd_arm(), 0.4), "whose first joint base is undriven"),
        (random_arm(np.random.default_rng(0), 2, undriven=(0,)), "whose first joint j0 is undriven"),
        (Arm("clash", (Joint("base", k_bend=1.0, k_tors=1.0, link=(Body("b", 1.0),)),)), "a part base"),
    ],
)
def test_a_second_base_is_refused(arm, got):
    with pytest.raises(InputError, match=got):
        on_soft_base(arm, 0.5)


def test_a_height_in_millimetres_is_taken_for_a_slip():
    with pytest.raises(InputError, match=r"got 500 m, expected a height .* of 48 m at most, 10 times the arm"):
        on_soft_base(lcd_arm(), 500.0)
    assert on_soft_base(lcd_arm(), 5.0).base is not None
