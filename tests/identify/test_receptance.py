"""Frequency response at a point: direct solves with the vibration's and Pinocchio's matrices, closed forms, draws."""

from dataclasses import replace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from arms import posture_of, random_arm
from conformance import agrees
from engines import PinocchioArm, settled, stiffness

from ident.arm.arm import Arm
from ident.arm.multibody import Command, balanced, bushing_rotations, end_point, multibody
from ident.arm.parts import Body, Drive, Joint, MassDamping, Point, Servo
from ident.identify.compliance import tool_compliance
from ident.identify.modal_analysis import modal_analysis
from ident.vibrate.linear import matrices, quasi_static_deflection, slope

L, K, TAU, INERTIA, ROTOR, RATIO = 0.8, 2e4, 2e-3, 3.0, 1e-4, 50.0
HERTZ = np.array([0.0, 3.0, 11.0, 40.0])


def direct(M, C, K, J, hertz=HERTZ):
    """Displacement by a force along each column of J."""
    w = 2 * np.pi * hertz[:, None, None]
    x = np.linalg.solve(K + 1j * w * C - w**2 * M, J.T)
    return np.einsum("kn,fnk->kf", J, x)


def lossy(arm: Arm) -> Arm:
    """Loss factors and damping by mass as well as dampers."""
    joints = tuple(replace(j, loss_bend=jnp.array(0.03), loss_tors=jnp.array(0.1)) for j in arm.joints)
    return replace(arm, joints=joints, damping=MassDamping(alpha=jnp.array(0.5)))


@eqx.filter_jit
def at_work(arm, posture):
    """M, C and K of the vibration at rest, and how the end point moves."""
    model = balanced(multibody(arm, rank=1))
    still = Command(posture, *(jnp.zeros_like(posture),) * 2)
    y = quasi_static_deflection(arm, model, posture)
    M, D, K, lost = matrices(model, still, y)
    J = slope(lambda y: end_point(model, posture, bushing_rotations(model, y)), y)
    return jax.tree.map(lambda x: x[..., 0], (M, D + lost, K, J))


def test_it_is_a_direct_solve_with_the_matrices_of_the_vibration_at_work():
    rng = np.random.default_rng(0)
    arm = lossy(random_arm(rng, 2))
    posture = np.asarray(posture_of(arm, rng))
    expected = direct(*map(np.asarray, at_work(arm, jnp.asarray(posture)[:, None])))
    tool = tool_compliance(modal_analysis(arm, tuple(posture)))
    what, source = (
        "frequency response with dampers, loss factors and damping by mass",
        "direct solve with M, C, K at work",
    )
    agrees(tool.arms[0].at(HERTZ), expected, "vibration", what, source, rtol=1e-9, unit="m/N")
    assert np.abs(expected.imag[:, 1:] / expected.real[:, 1:]).max() > 0.01
    found, what, source = tool.response.size[:, 0], "frequency response at 0 Hz", "static compliance"
    agrees(found, np.diag(tool.matrix)[:3], "statics", what, source, rtol=1e-9, unit="m/N")


def test_it_is_a_direct_solve_with_pinocchios_matrices():
    """Its mass matrix, derivatives of gravity and Jacobian, in the tool's frame; dampers from the arm's numbers."""
    rng = np.random.default_rng(1)
    arm = random_arm(rng, 3, undriven=(1,))
    posture = np.asarray(posture_of(arm, rng))
    engine, by_time = PinocchioArm(arm, posture), [replace(j, k_bend=j.k_bend * j.tau_bend) for j in arm.joints]
    by_time = replace(arm, joints=tuple(replace(j, k_tors=j.k_tors * j.tau_tors) for j in by_time))
    K, C = (stiffness(each, engine) for each in (arm, by_time))
    x = settled(engine, K)
    J = engine.end_axes(x).T @ jacobian(engine, x)
    expected = direct(engine.mass_matrix(x), C, K + engine.gravity_hessian(x), J)
    tool = tool_compliance(modal_analysis(arm, tuple(posture)), frame="tool")
    found, source = tool.arms[0].at(HERTZ), "direct solve with Pinocchio's M and K"
    agrees(found, expected, "vibration", "frequency response in the tool's frame", source, rtol=1e-7, unit="m/N")


def jacobian(engine, x):
    """Displacement of the end point by x, by differences of the eighth order."""
    h, weights = 1e-2, {1: 4 / 5, 2: -1 / 5, 3: 4 / 105, 4: -1 / 280}
    moved = [
        sum(w * (engine.point(x + n * h * e) - engine.point(x - n * h * e)) for n, w in weights.items())
        for e in np.eye(len(x))
    ]
    return np.transpose(moved) / h


# -------- Closed forms


def lever(**servo: float) -> Arm:
    """One joint about z, without weight, with a lever along x."""
    body = Body("link", 0.0, np.zeros(3), INERTIA * np.eye(3))
    rotor = (Body("rotor", 0.0, np.zeros(3), ROTOR * np.eye(3)),) if servo else ()
    numbers = {"k_bend": K, "k_tors": K, "tau_bend": TAU, "tau_tors": TAU}
    joint = Joint("j1", offset=np.zeros(3), axis=np.array([0.0, 0, 1]), shaft=rotor, link=(body,), **numbers)
    drives = (Drive("d", "j1", ratio=RATIO, rotor_inertia=ROTOR),) if servo else ()
    servos = (Servo("s", "j1", **servo),) if servo else ()
    tip = Point("tip", "j1", np.array([L, 0, 0]))
    return replace(Arm("lever", (joint,), (tip,), (), jnp.zeros(3)), drives=drives, servos=servos)


def oscillator(k):
    """Frequency and size of the peak of a lever on a damped spring."""
    w, ratio = np.sqrt(k / INERTIA), TAU * np.sqrt(k / INERTIA) / 2
    return w / (2 * np.pi) * np.sqrt(1 - 2 * ratio**2), L**2 / k / (2 * ratio * np.sqrt(1 - ratio**2))


def test_a_lever_on_a_damped_spring_has_the_peak_of_an_oscillator():
    tool = tool_compliance(modal_analysis(lever(), (0.0,)))
    frequency, size = tool.response.peaks
    what, source = "peak of a frequency response", "closed form of one mode, 1 / (2 zeta sqrt(1 - zeta^2))"
    agrees(size[1:], oscillator(K)[1], "vibration", what, source, rtol=1e-4, unit="m/N")
    agrees(frequency[1:], oscillator(K)[0], "vibration", "frequency of a response's peak", source, rtol=2e-3, unit="Hz")
    assert tool.response.frequency[-1] == pytest.approx(1.3 * np.sqrt(K / INERTIA) / (2 * np.pi))
    assert np.isnan(tool.response.band).all()


def test_its_bands_are_the_quantiles_of_the_draws():
    k = K * np.exp(0.05 * np.random.default_rng(0).normal(size=101))
    response = tool_compliance(modal_analysis(lever(), (0.0,)), draws={"j1.k_tors": k}).response
    expected = np.quantile(oscillator(k), (0.05, 0.95), axis=1)
    what, source = "5 and 95 % quantiles of the peak", "closed form of one mode, each draw"
    agrees(response.peak_band[:, 1, 1], expected[:, 1], "vibration", what, source, rtol=1e-4, unit="m/N")
    what = "5 and 95 % quantiles of the peak's frequency"
    agrees(response.peak_band[:, 0, 1], expected[:, 0], "vibration", what, source, rtol=2e-3, unit="Hz")
    s = 2j * np.pi * response.frequency[:, None]
    own = np.quantile(np.abs(L**2 / (k + s * TAU * k + s**2 * INERTIA)), (0.05, 0.95), axis=1)
    what = "5 and 95 % quantiles over frequency"
    agrees(response.band[:, 1], own, "vibration", what, source, rtol=1e-9, unit="m/N")


def test_a_servo_adds_its_motor_with_its_own_damping():
    """Coordinates: turn of the joint's bushing, and of the pin, with which the rotor turns N times as fast."""
    tool = tool_compliance(modal_analysis(lever(k_servo=4.0, tau=1e-3), (0.0,), drives="servo"))
    M = INERTIA * np.ones((2, 2)) + ROTOR * np.array([[1, RATIO], [RATIO, RATIO**2]])
    K_own = np.diag([K, 4.0 * RATIO**2])
    expected = direct(M, K_own @ np.diag([TAU, 1e-3]), K_own, np.array([[L, L]]))[0]
    what, source = "frequency response with a servo", "two coordinates, closed form"
    agrees(tool.arms[0].at(HERTZ)[1], expected, "vibration", what, source, rtol=1e-9, unit="m/N")


def test_where_one_mode_has_no_damping_there_is_none():
    lifted = lever().replace({"j1.tau_bend": 0.0, "j1.k_bend": 2 * K})
    assert tool_compliance(modal_analysis(lifted, (0.0,))).response is None, "one mode is not damped"
