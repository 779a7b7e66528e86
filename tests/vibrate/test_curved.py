"""Curved springs in motion: a pendulum against SciPy's integration of its own equation, and where tangents end."""

from functools import cache

import numpy as np
import pytest
from conformance import agrees
from scipy.integrate import solve_ivp
from scipy.interpolate import PPoly
from scipy.optimize import brentq

from ident.arm.arm import Arm
from ident.arm.parts import Body, CubicSpring, Joint, Point, Spring
from ident.errors import InputError
from ident.studies.basis import passage_findings
from ident.vibrate.fast import passages
from ident.vibrate.motion import Motion
from ident.vibrate.response import Response
from ident.vibrate.simulate import simulate, superposition

pytestmark = pytest.mark.slow

K1, TAU = 8e3, 2e-4
WEIGHT, INERTIA = 20.0 * 9.80665 * 0.5, 1.6 + 20.0 * 0.25
BROKEN = {"ratio2": 1.6, "ratio3": 2.4, "torque1": 90.0, "torque2": 300.0}


def pendulum(spring: Spring | CubicSpring) -> Arm:
    """A bar of 20 kg on a horizontal pin, at a right angle to gravity: its torsion carries 98 N m."""
    bar = Body("bar", 20.0, (0.5, 0.0, 0.0), np.diag([0.01, 1.6, 1.6]))
    joint = Joint("j", axis=(0.0, 1.0, 0.0), k_bend=2e5, k_tors=K1, tau_bend=1e-4, tau_tors=TAU, link=(bar,))
    return Arm("pendulum", (joint,), (Point("tip", "j", (1.0, 0.0, 0.0)),), springs=(spring,))


def broken_torque(x: np.ndarray) -> np.ndarray:
    """The broken line with its transitions, anew: the tangent's polynomials integrated by SciPy."""
    k1, k2, k3 = K1, K1 * BROKEN["ratio2"], K1 * BROKEN["ratio3"]
    x1 = BROKEN["torque1"] / k1
    x2 = x1 + (BROKEN["torque2"] - BROKEN["torque1"]) / k2
    a, b, c, d = 0.75 * x1, 1.25 * x1, 0.75 * x2, 1.25 * x2
    assert b < c

    def rise(low, high, width):
        return [-2 * (high - low) / width**3, 3 * (high - low) / width**2, 0, low]

    pieces = [[0, 0, 0, k1], rise(k1, k2, b - a), [0, 0, 0, k2], rise(k2, k3, d - c), [0, 0, 0, k3]]
    return np.sign(x) * PPoly(np.array(pieces).T, [0, a, b, c, d, 1.0]).antiderivative()(np.abs(x))


def broken(**changes: float) -> Arm:
    return pendulum(Spring("s", "j", "torsion", **BROKEN | changes))


def lift(angle: float, seconds: float) -> Motion:
    """From rest to rest by a cubic, then half a second held."""
    c = np.array([-2 * angle / seconds**3, 3 * angle / seconds**2, 0.0, 0.0])
    still = np.array([0.0, 0.0, 0.0, angle])
    return Motion("lift", [0.0, seconds, seconds + 0.5], np.stack([c, still], 1)[..., None], seconds)


CUBIC = pendulum(CubicSpring("s", "j", "torsion", 6e7))


def cubic_torque(x: np.ndarray) -> np.ndarray:
    return K1 * x + 6e7 * x**3


@cache
def exact(cubic: bool = False) -> Response:
    return simulate(CUBIC if cubic else broken(), lift(-0.4, 0.25), method="exact")


@pytest.mark.parametrize("cubic", [False, True], ids=["broken", "cubic"])
def test_the_exact_method_follows_the_curve(cubic: bool):
    torque, response = cubic_torque if cubic else broken_torque, exact(cubic)
    motion = response.motion

    def rates(t, state):
        q, _, qdd = (float(part[0]) for part in motion(t))
        x, v = state
        return v, (WEIGHT * np.cos(q + x) - torque(x) - TAU * K1 * v) / INERTIA - qdd

    start = brentq(lambda x: torque(x) - WEIGHT * np.cos(x), 0, 0.1, xtol=1e-15)
    time, state, expected = np.asarray(response.time), (start, 0.0), np.zeros(len(response.time))
    for low, high in ((0.0, 0.25), (0.25, 0.75)):
        solved = solve_ivp(
            rates, (low, high - 1e-12), state, "DOP853", dense_output=True, rtol=1e-11, atol=1e-14, max_step=1e-3
        )
        within = (time >= low) & (time <= high)
        expected[within], state = solved.sol(time[within])[0], tuple(solved.y[:, -1])
    x = np.asarray(response.phi)[1, 0]
    assert np.ptp(expected) > 0.3 * start
    # measured: 8e-9 for the broken line, whose corners cost the order, 2e-9 for the cubic
    curve, source = "cubic" if cubic else "broken line", "SciPy's DOP853 on its own equation"
    what = f"a pendulum on a {curve} in motion"
    agrees(x, expected, "vibration", what, source, rtol=1e-7, largest=1e-7, unit="rad")
    found, what = np.asarray(response.spring_moment)[1, 0], f"torque of a pendulum's {curve}"
    agrees(found, torque(x), "vibration", what, "SciPy's PPoly and closed form", rtol=1e-9, unit="N m")


def test_passing_t1_is_told():
    (passage,) = passages(broken(), exact())
    assert passage.spring == "s"
    assert passage.low < 90.0 < passage.high
    (finding,) = passage_findings([passage])
    assert "the load of s passes T1 = 90 N m" in finding.text
    assert passages(CUBIC, exact(cubic=True)) == ()
    assert passages(broken(torque1=600.0, torque2=900.0), exact()) == ()


def test_the_fast_method_refuses_what_leaves_the_tangent():
    arm, motion = broken(), lift(-0.4, 0.25)
    for run in (lambda: simulate(arm, motion), lambda: superposition(arm, motion, ())):
        with pytest.raises(InputError, match="curved spring leaves its tangent") as refused:
            run()
        assert "\n" not in str(refused.value)


def test_the_fast_method_takes_the_tangent_where_vibration_is_small():
    arm, motion = broken(torque1=20.0, torque2=50.0), lift(-0.004, 0.25)  # beyond T2: it gives 2.4 times less
    fast, exactly = (np.asarray(simulate(arm, motion, method=method).vibration) for method in ("fast", "exact"))
    straight = np.asarray(simulate(broken(ratio2=1.0, ratio3=1.0), motion).vibration)
    peak = np.abs(exactly).max()
    assert np.abs(fast - exactly).max() < 0.02 * peak
    assert np.abs(straight - exactly).max() > 0.5 * peak
    whole = superposition(arm, motion, ())
    np.testing.assert_allclose(whole.sure, fast, atol=1e-6 * peak)
    assert (whole.division[1:] == 0).all(), "an arm without drives"
    assert whole.worst_phases() == {}
