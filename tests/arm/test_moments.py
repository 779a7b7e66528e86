"""Moments as loads: pairs of forces that make them, MuJoCo's torques, and what is read and refused."""

import equinox as eqx
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest
from arms import lcd_arm, random_arm
from conformance import agrees
from engines import MujocoArm, rates

from ident.arm.arm import Arm
from ident.arm.chain import at_posture
from ident.arm.mechanics import potential_gradient, static_equilibrium, unflatten
from ident.arm.parts import Point
from ident.errors import InputError
from ident.identify.binding import loads_of
from ident.measure import Load
from ident.studies.working.simulate import SimulateOptions, simulate

MOMENT = np.array([30.0, -40.0, 60.0])
SIZE = float(np.linalg.norm(MOMENT))
TEXT = "30 N*m about x @ tip + 40 N*m about -y @ tip + 60 N*m about z @ tip"


def test_it_is_two_crosswise_pairs_of_forces_whatever_the_rotation():
    """Forces of fixed direction at the ends of two arms across the moment, on an arm soft enough to turn far."""
    arm = random_arm(np.random.default_rng(3), 3)
    joint = arm.points[-1].joint
    arm = Arm(arm.name, arm.joints, (*arm.points, *(Point(name, joint, np.zeros(3)) for name in "abcd")), arm.payloads)
    soft = arm.replace({path: 0.02 * float(arm.get(path)) for path in arm.paths() if path.endswith(("bend", "tors"))})
    posture = np.array([0.3, -0.8, 1.1])
    turned = at_posture(soft, posture, loads_of(soft, Load(moments=((tuple(MOMENT.tolist()), "tip"),))))
    across = np.linalg.svd(MOMENT[None])[2][1:]  # two directions across the moment, and across one another
    across[1] = np.cross(MOMENT / SIZE, across[0])
    tip = np.asarray(turned.position)[:, [p.name for p in arm.points].index("tip")]
    places = [tip + across[0] / 2, tip - across[0] / 2, tip + across[1] / 2, tip - across[1] / 2]
    pulls = np.array([across[1], -across[1], -across[0], across[0]]) * SIZE / 2
    pulled = at_posture(soft, posture)
    pulled = eqx.tree_at(
        lambda c: (c.position, c.force),
        pulled,
        (pulled.position.at[:, -4:].set(np.transpose(places)), pulled.force.at[:, -4:].set(pulls.T)),
    )
    one, other = map(eqx.filter_jit(static_equilibrium), (turned, pulled))
    assert np.abs(one.phi).max() > 0.03
    what, source = "equilibrium under a moment", "two pairs of forces that make it"
    agrees(one.phi, other.phi, "statics", what, source, rtol=1e-7, atol=1e-13, unit="rad")
    np.testing.assert_allclose(one.W, other.W, rtol=1e-9, atol=1e-12)


@eqx.filter_jit
def gradient(arm, posture, loads, phi):
    return potential_gradient(at_posture(arm, posture, loads), phi)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("size", [1e-7, 1e-4, 1e-2])
def test_it_is_mujocos_torque_of_fixed_direction_up_to_half_the_rotation(seed, size):
    rng = np.random.default_rng(seed)
    arm, posture = random_arm(rng, 3), rng.uniform(-2, 2, 3)
    engine, x = MujocoArm(arm, posture), size * rng.uniform(-1, 1, 9)
    engine._place(x)
    qfrc, body = np.zeros(engine.model.nv), int(engine.model.site("end").bodyid[0])
    mujoco.mj_applyFT(engine.model, engine.data, np.zeros(3), MOMENT, np.zeros(3), body, qfrc)
    expected = rates(engine.frames(), x).T @ qfrc[engine.v_ball]
    phi = unflatten(jnp.asarray(x))
    turned, plain = (gradient(arm, posture, loads_of(arm, load), phi) for load in (Load.parse(TEXT), Load()))
    allowed, what = SIZE * (1e-9 + _half_the_rotation(phi)), "generalised forces of a moment"
    source = "MuJoCo's mj_applyFT, up to half the rotation"
    agrees(plain - turned, expected, "statics", what, source, rtol=1e-7, atol=allowed, unit="N m")
    assert np.abs(expected).max() > 0.3 * SIZE


def _half_the_rotation(phi):
    """Half the angle that the last body turns by, at most."""
    return float(jnp.linalg.norm(phi, axis=0).sum()) / 2


def test_it_is_read_and_written():
    load = Load.parse(TEXT + " + 5 kg @ tip + 2 kN -z @ tip + 500 N mm about 0 0.6 -0.8 @ mid")
    assert load.moments == (((0.0, 0.3, -0.4), "mid"), (tuple(MOMENT.tolist()), "tip"))
    assert load.forces == (((0.0, 0.0, -2000.0), "tip"),)
    assert Load.parse(str(load)) == load
    assert Load.parse("3 N*m about y @ tip + 3 N*m about -y @ tip") == Load()


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("5 kg about y @ tip", "a unit of moment"),
        ("5 N*m about w @ tip", "x, -z"),
        ("-5 N*m about y @ tip", "a moment above 0"),
    ],
)
def test_what_is_no_moment_is_refused(text, words):
    with pytest.raises(InputError, match=words):
        Load.parse(text)


def test_a_moment_in_motion_is_refused():
    with pytest.raises(InputError, match="a moment, expected payloads, masses and forces in motion"):
        simulate(lcd_arm(), SimulateOptions(load="50 N*m about y @ tip"))
