"""Static compliance at a point: closed forms, Pinocchio, a small force on the full nonlinear statics, servos, draws."""

from dataclasses import replace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from arms import lcd_arm, posture_of, random_arm
from conformance import agrees
from engines import PinocchioArm, rates, settled, stiffness

from ident.arm.arm import Arm
from ident.arm.chain import Loads, at_posture, no_loads
from ident.arm.compliance import point_twists
from ident.arm.linalg import inverse_cholesky_factor
from ident.arm.mechanics import point_positions, point_rotations, static_equilibrium, system
from ident.arm.parts import Body, Drive, Joint, Point, Servo
from ident.errors import InputError
from ident.identify.binding import loads_of
from ident.identify.compliance import tool_compliance
from ident.identify.modal_analysis import modal_analysis
from ident.measure import Load

LEVER, BEND, TORS, MASS, G = 0.8, 5e3, 2e4, 30.0, 9.81


def lever(direction: str, gravity: float = G, **servo: float) -> Arm:
    """One joint about z with a massive lever along x or z."""
    end = LEVER * np.eye(3)["xyz".index(direction)]
    body = Body("link", MASS, end, 0.1 * np.eye(3))
    joint = Joint("j1", offset=np.zeros(3), axis=np.array([0.0, 0, 1]), k_bend=BEND, k_tors=TORS, link=(body,))
    drives = (Drive("d", "j1", ratio=50.0),) if servo else ()
    servos = (Servo("s", "j1", **servo),) if servo else ()
    arm = Arm("lever", (joint,), (Point("tip", "j1", end),), (), jnp.array([0.0, 0, -gravity]))
    return replace(arm, drives=drives, servos=servos)


@eqx.filter_jit
def compliance(arm, posture, loads=None, servo=None):
    """Compliance of all points, with the equilibrium."""
    chain = at_posture(arm, posture, loads, servo)
    phi = static_equilibrium(chain).phi
    moved = point_twists(chain, phi, inverse_cholesky_factor(system(chain, phi)[2]))
    return jnp.einsum("ni...,nj...->ij...", moved, moved), phi, point_positions(chain, phi), point_rotations(chain, phi)


def test_a_lever_on_a_spring_gives_its_length_squared_over_the_stiffness():
    C = compliance(lever("x", gravity=0.0), np.zeros(1))[0][:, :, 0]
    expected = np.diag([0, LEVER**2 / TORS, LEVER**2 / BEND, 1 / BEND, 1 / BEND, 1 / TORS])
    expected[1, 5] = expected[5, 1] = LEVER / TORS
    expected[2, 4] = expected[4, 2] = -LEVER / BEND
    what = "compliance of a lever on a spring, all of 6 x 6"
    agrees(C, expected, "statics", what, "l^2 / k, l / k, 1 / k", rtol=1e-7, atol=1e-12 / BEND, unit="m/N")


def test_its_weight_makes_an_inverted_pendulum_softer_and_a_hanging_one_stiffer():
    """By geometric stiffness: l^2 / (k - m g l), not J K^-1 J' = l^2 / k."""
    for sign in (1, -1):
        C = compliance(lever("z", gravity=sign * G), np.zeros(1))[0][:, :, 0]
        softer = LEVER**2 / (BEND - sign * MASS * G * LEVER)
        what, source = "compliance under its weight, standing and hanging", "l^2 / (k -/+ m g l)"
        agrees([C[0, 0], C[1, 1]], softer, "statics", what, source, rtol=1e-12, unit="m/N")
        assert abs(softer / (LEVER**2 / BEND) - 1) > 0.04


def test_its_slope_by_the_stiffness_is_exact():
    arm = lever("z")
    slope = jax.jacfwd(lambda k: compliance(arm.replace({"j1.k_bend": k}), np.zeros(1))[0][0, 0, 0])(BEND)
    expected, what = -(LEVER**2) / (BEND - MASS * G * LEVER) ** 2, "slope of the compliance by the stiffness"
    agrees(slope, expected, "statics", what, "-l^2 / (k - m g l)^2", rtol=1e-10)


def test_a_servo_is_in_series_with_its_joint_and_a_brake_is_rigid():
    arm = lever("x", gravity=0.0, k_servo=4.0, tau=1e-3)
    own, series = 1 / TORS, 1 / TORS + 1 / (4.0 * 50.0**2)
    for servo, expected in ((None, own), (np.array(0.0), own), (np.array(1.0), series)):
        C = compliance(arm, np.array([0.4]), None, servo)[0][:, :, 0]
        what, source = "compliance with a servo, and with a brake", "springs in series, 1 / k + 1 / (k_s N^2)"
        agrees(C[5, 5], expected, "statics", what, source, rtol=1e-10, unit="rad/(N m)")
        assert C[3, 3] == pytest.approx(1 / BEND, rel=1e-10)


def test_a_rigid_direction_is_the_limit_of_a_stiff_one():
    arm, posture = lcd_arm(), np.array([0.5, -1.0, 0.5])
    joint = arm.joints[1]
    rigid = replace(arm, joints=(arm.joints[0], replace(joint, k_tors=None), arm.joints[2]))
    stiff = arm.replace({"joint2.k_tors": 1e13})
    one, other = (np.asarray(compliance(each, posture)[0]) for each in (rigid, stiff))
    what, source = "compliance with a rigid direction", "limit of a stiff spring"
    agrees(one, other, "statics", what, source, rtol=1e-7, largest=1e-8)


@pytest.mark.parametrize("seed", range(4))
def test_it_is_pinocchios(seed):
    """Its analytic derivatives of gravity and its Jacobian, about the equilibrium that MINPACK finds with them."""
    rng = np.random.default_rng(seed)
    arm = random_arm(rng, 3, undriven=(1,))
    posture = np.asarray(posture_of(arm, rng))
    engine = PinocchioArm(arm, posture)
    K = stiffness(arm, engine)

    x = settled(engine, K)
    J = jacobian(engine, x)
    expected = J @ np.linalg.solve(engine.gravity_hessian(x) + K, J.T)
    C, _, place, turn = compliance(arm, posture)
    source = "Pinocchio's Jacobian and derivatives of gravity"
    agrees(C[:, :, -1], expected, "statics", "compliance of the end point", source, rtol=1e-7, largest=1e-8)
    what = "place of the loaded end point"
    agrees(place[:, -1], engine.point(x), "statics", what, "Pinocchio", rtol=1e-7, atol=1e-9, unit="m")
    tool = tool_compliance(modal_analysis(arm, tuple(posture)), frame="tool")
    np.testing.assert_allclose(tool.axes, engine.end_axes(x), atol=1e-9)
    T = np.kron(np.eye(2), engine.end_axes(x))
    in_tool, least = T.T @ expected @ T, float(1e-8 * np.abs(expected).max())
    agrees(tool.matrix, in_tool, "statics", "compliance in the tool's frame", source, rtol=1e-7, atol=least)
    assert np.abs(turn[:, :, -1] - np.eye(3)).max() > 1e-5


def jacobian(engine, x):
    """Pinocchio's Jacobian of the end point by x, in base axes."""
    import pinocchio as pin

    J = pin.computeJointJacobian(engine.model, engine.data, engine._q(x), engine.end_joint)
    R = engine.end_axes(x)
    moved = R @ (J[:3] - np.cross(engine.end[:, None], J[3:], axis=0))
    return np.concatenate([moved, R @ J[3:]])[:, engine.v_ball] @ rates(engine.frames(), x)


@pytest.mark.parametrize("load", ["glass", "glass + 300 N -y @ tip + 5 kg @ tip"])
def test_a_tenth_of_a_newton_on_the_nonlinear_statics_moves_it_so(load):
    """Forces at the tip, and pairs of them a metre apart, which make moments."""
    arm, posture = lcd_arm(), np.array([0.5, -1.0, 0.5])
    tip = arm.points[-1]
    further = (Point(axis, tip.joint, tip.position + np.eye(3)[i]) for i, axis in enumerate("xyz"))
    arm = replace(arm, points=(*arm.points, *further))
    count, of_tip = len(arm.points), len(arm.points) - 4
    loads = loads_of(arm, Load.parse(load))
    C, _, place, turn = compliance(arm, posture, loads)
    extra = np.zeros((3, count, 6))
    for i in range(3):
        extra[i, of_tip, i] = 0.1
        k = (i + 1) % 3  # a force along i a metre away along k makes a moment
        extra[i, of_tip + 1 + k, 3 + i], extra[i, of_tip, 3 + i] = 0.1, -0.1
    wide = jax.tree.map(lambda x: jnp.broadcast_to(x[..., None], (*x.shape, 6)), loads)
    more = Loads(wide.payload, wide.mass, wide.force + extra)
    _, _, places, turns = compliance(arm, np.broadcast_to(posture[:, None], (3, 6)), more)
    places, turns, place, turn = (np.asarray(x) for x in (places, turns, place, turn))
    moment = np.cross((place - place[:, [of_tip]])[:, :, None], extra, axis=0).sum(1)
    wrench = np.concatenate([extra.sum(1), moment])
    expected = np.asarray(C)[:, :, of_tip] @ wrench
    for n in range(6):
        relative = turns[:, :, of_tip, n] @ turn[:, :, of_tip].T
        spin = np.array(
            [relative[2, 1] - relative[1, 2], relative[0, 2] - relative[2, 0], relative[1, 0] - relative[0, 1]]
        )
        moved = np.concatenate([places[:, of_tip, n] - place[:, of_tip], spin / 2])
        for part in (slice(0, 3), slice(3, 6)):
            size = np.linalg.norm(expected[part, n])
            what, source = "moves under small forces and moments", "nonlinear statics, 0.1 N"
            agrees(moved[part], expected[part, n], "statics", what, source, rtol=1e-7, atol=float(1e-5 * size))


def test_it_is_symmetric_and_positive():
    rng = np.random.default_rng(3)
    arm = random_arm(rng, 3)
    C = np.asarray(compliance(arm, posture_of(arm, rng), no_loads(arm))[0])[:, :, -1]
    np.testing.assert_array_equal(C, C.T)
    assert np.linalg.eigvalsh(C / np.sqrt(np.outer(np.diag(C), np.diag(C)))).min() > 1e-6


# -------- One point, in a frame, with draws


def test_the_tools_frame_turns_with_its_link():
    analysis = modal_analysis(lever("x", gravity=0.0), (np.pi / 2,))
    both = [tool_compliance(analysis, frame=frame) for frame in ("base", "tool")]
    assert [each.response for each in both] == [None, None], "no damping, no frequency response"
    base, tool = (each.matrix for each in both)
    assert base[0, 0] == pytest.approx(LEVER**2 / TORS, rel=1e-12)
    assert tool[1, 1] == pytest.approx(LEVER**2 / TORS, rel=1e-12)
    assert abs(tool[0, 0]) < 1e-15


def test_the_largest_has_its_direction():
    value, direction, band = tool_compliance(modal_analysis(lever("x", gravity=0.0), (0.0,))).largest
    assert value == pytest.approx(LEVER**2 / BEND, rel=1e-12)
    np.testing.assert_allclose(direction, [0, 0, 1], atol=1e-12)
    assert np.isnan(band).all()


def test_a_draw_is_computed_as_if_alone_and_collapsed_ones_are_left_out():
    analysis = modal_analysis(lever("z"), (0.0,))
    k = BEND * np.exp(0.05 * np.random.default_rng(0).normal(size=101))
    k[7] = 0.9 * MASS * G * LEVER
    tool = tool_compliance(analysis, draws={"j1.k_bend": k})
    expected = LEVER**2 / (np.delete(k, 7) - MASS * G * LEVER)
    what = "compliance of each draw of a posterior"
    agrees(tool.draws[0, 0], expected, "statics", what, "l^2 / (k - m g l)", rtol=1e-10, unit="m/N")
    low, high = tool.band[:, 0, 0]
    assert np.mean((low <= expected) & (expected <= high)) == 0.9
    np.testing.assert_allclose([low, high], np.quantile(expected, (0.05, 0.95)), rtol=1e-10)


def test_a_point_that_the_arm_does_not_have_is_refused():
    with pytest.raises(InputError, match="point: got 'tipp', expected one of tip; did you mean tip"):
        tool_compliance(modal_analysis(lever("x"), (0.0,)), "tipp")
