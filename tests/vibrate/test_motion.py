"""Motions: values and derivatives against scipy and JAX, holds, joins, clocks, limits and refusals."""

import math

import equinox as eqx
import hypothesis.extra.numpy as hnp
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from arms import lcd_arm
from hypothesis import given, settings
from hypothesis import strategies as st
from runs import hold_still
from scipy.interpolate import PPoly, make_interp_spline

from ident.errors import InputError
from ident.vibrate.motion import Motion, beyond_limits

BREAKS = np.array([0.5, 1.0, 1.7, 3.0])


def wavy(driven=2, seed=0):
    """A motion whose fourth derivative jumps: a quartic spline through random angles."""
    angles = np.random.default_rng(seed).normal(size=(8, driven))
    return from_spline(make_interp_spline(np.linspace(0.5, 3.0, 8), angles, k=4))


def from_spline(spline):
    breaks = np.unique(spline.t)
    c = [spline(breaks[:-1], nu=n) / math.factorial(n) for n in range(spline.k, -1, -1)]
    return Motion("wavy", breaks, np.stack(c))


def kinked():
    """One joint: a parabola up to 1, its tangent's reverse down to 0; velocity and acceleration jump at 1 s."""
    return Motion("kinked", [0.0, 1.0, 2.0], [[[1.0], [0.0]], [[0.0], [-1.0]], [[0.0], [1.0]]])


def problem(do, *args, **kwargs):
    with pytest.raises(InputError) as caught:
        do(*args, **kwargs)
    (one,) = caught.value.problems
    return one


def test_values_and_derivatives_are_those_of_scipy():
    motion = wavy()
    path = PPoly(np.asarray(motion.coefficients), motion.breaks)
    t = np.concatenate([np.linspace(0.5, 2.999, 400), motion.breaks[:-1]]).reshape(2, -1)
    for n, state in enumerate(motion(t)):
        assert state.shape == (2, *t.shape)
        np.testing.assert_allclose(state, np.moveaxis(path(t, nu=n), -1, 0), rtol=1e-11, atol=1e-11)


def test_derivatives_are_those_of_jax():
    motion, t = wavy(), jnp.linspace(0.0, 3.5, 37)
    for lower, higher in ((0, 1), (1, 2)):
        slope = jax.vmap(jax.jacfwd(lambda t, n=lower: motion(t)[n]), out_axes=-1)(t)
        np.testing.assert_allclose(slope, motion(t)[higher], rtol=1e-11, atol=1e-11)
    assert float(abs(motion(t)[2]).max()) > 1.0


def test_a_call_is_the_same_compiled_and_mapped():
    motion, t = wavy(), jnp.linspace(0.0, 3.5, 29)
    for one, compiled, mapped in zip(
        motion(t), eqx.filter_jit(motion)(t), jax.vmap(motion, out_axes=-1)(t), strict=True
    ):
        np.testing.assert_allclose(compiled, one, rtol=0, atol=1e-12)
        np.testing.assert_allclose(mapped, one, rtol=0, atol=1e-12)


def test_the_angle_is_linear_in_the_coefficients():
    motion = wavy()

    def angles(coefficients):
        return motion_with(motion, coefficients)(jnp.array(1.3))[0]

    slope = jax.jacrev(angles)(motion.coefficients)
    np.testing.assert_allclose(jnp.tensordot(slope, motion.coefficients, 3), angles(motion.coefficients), rtol=1e-12)


def motion_with(motion, coefficients):
    return Motion(motion.name, motion.breaks, coefficients, motion.arrival)


@pytest.mark.parametrize(("t", "expected"), [(-1.0, (0, 0, 0)), (0.0, (0, 0, 2)), (1.0, (1, -1, 0)), (2.0, (0, 0, 0))])
def test_at_a_break_the_values_after_it_hold(t, expected):
    assert [float(state[0]) for state in kinked()(t)] == list(expected)


def test_a_piece_gives_the_values_before_a_break():
    motion = kinked()
    assert [float(state[0]) for state in motion.on_piece(0, 1.0)] == [1.0, 2.0, 2.0]
    assert [float(state[0]) for state in motion.on_piece(1, 1.0)] == [1.0, -1.0, 0.0]
    both = motion.on_piece(jnp.array([0, 1]), jnp.array([1.0, 1.0]))
    assert [state[0].tolist() for state in both] == [[1.0, 1.0], [2.0, -1.0], [2.0, 0.0]]


def test_it_is_held_still_before_and_after():
    motion = wavy()
    for t, end in ((-5.0, 0.5), (9.0, 3.0)):
        q, qd, qdd = motion(t)
        np.testing.assert_allclose(q, PPoly(np.asarray(motion.coefficients), motion.breaks)(end), atol=1e-12)
        assert not qd.any()
        assert not qdd.any()


def test_a_dwell_holds_the_end():
    motion = wavy()
    held = motion.dwell(2.0)
    assert (held.duration, held.arrival, held.breaks[-1]) == (motion.duration + 2.0, 3.0, 5.0)
    t = jnp.linspace(0.0, 6.0, 50)
    for one, other in zip(motion(t), held(t), strict=True):
        np.testing.assert_allclose(other, one, atol=1e-12)
    assert motion.dwell(0.0) is motion


@pytest.mark.parametrize("seconds", [-1.0, math.nan, math.inf])
def test_a_dwell_that_cannot_be(seconds):
    assert str(problem(wavy().dwell, seconds)) == (
        f"dwell: got {seconds:g} s, expected a finite time of at least 0 s; correct the time"
    )


@given(percent=st.floats(1, 1000), t=st.floats(-1, 4))
@settings(deadline=None, max_examples=40)
def test_another_clock(percent, t):
    motion, s = wavy(), percent / 100
    slowed = motion.at_speed(percent)
    np.testing.assert_allclose(slowed.duration, motion.duration / s, rtol=1e-14)
    near = abs(np.asarray(motion.breaks) - t).min() < 1e-9
    for n, (one, other) in enumerate(zip(motion(t), slowed(t / s), strict=True)):
        if not near:
            np.testing.assert_allclose(other, one * s**n, rtol=1e-9, atol=1e-9 * s**n)


@pytest.mark.parametrize("percent", [0.0, -5.0, 1001.0, math.nan])
def test_a_percentage_that_cannot_be(percent):
    assert str(problem(wavy().at_speed, percent)) == (
        f"percent: got {percent:g} %, expected above 0 and at most 1000 %; 100 is full speed, 10 a tenth of it"
    )


@given(q=hnp.arrays(float, 3, elements=st.floats(-3, 3, allow_subnormal=False)), t=st.floats(-9, 9))
@settings(deadline=None, max_examples=20)
def test_a_held_pose(q, t):
    still = hold_still(q, 4.0)
    assert (float(still.duration), still.arrival) == (4.0, 0.0)
    np.testing.assert_array_equal(np.stack(still(t)), np.stack([q, 0 * q, 0 * q]))


FLAT = np.zeros((1, 3, 2))
JUMP = np.array([[[0.0, 0.0], [0.0, 0.0], [0.0, 2e-9]]])


@pytest.mark.parametrize(
    ("breaks", "c", "arrival", "got"),
    [
        ([0.5, 1.0, 1.7], FLAT, None, "3 breaks and coefficients (1, 3, 2)"),
        ([0.5, 1.0, 1.0, 3.0], FLAT, None, "a break at 1 s after 1 s"),
        ([0.5, 1.0, math.inf, 3.0], FLAT, None, "a break or coefficient that is not finite"),
        (BREAKS, FLAT * math.nan, None, "a break or coefficient that is not finite"),
        (BREAKS, JUMP, None, "a jump of 2e-09 rad of q2 at 1.7 s"),
        (BREAKS, FLAT, 3.1, "arrival at 3.1 s"),
    ],
)
def test_a_motion_that_cannot_be(breaks, c, arrival, got):
    found = problem(Motion, "bad", breaks, c, arrival)
    assert (found.where, found.got) == ("bad", got)


def test_a_jump_of_rounding_is_none():
    assert Motion("good", BREAKS, JUMP / 4).breaks[-1] == 3.0


def test_a_motion_within_the_limits():
    path = np.array([[[-90.0, 180.0, -90.0]], [[0.0, 0.0, 0.0]]])
    beyond_limits(lcd_arm(), Motion("good", [0.0, 1.0], np.deg2rad(path)))


def test_a_motion_beyond_the_limits_between_its_breaks():
    """The lowest angle of 40 - 1400 t + 1400 t^2 deg is -310 deg, in the middle of the one piece."""
    path = np.zeros((3, 1, 3))
    path[:, 0, 1] = np.deg2rad([1400.0, -1400.0, 40.0])
    found = problem(beyond_limits, lcd_arm(), Motion("dip", [0.0, 1.0], path))
    assert str(found) == (
        "dip: got a motion beyond the joint limits: joint2 at -310 deg at 0.5 s, expected -300 to 300 deg, its limits "
        "in the arm file; shorten the path, or correct the limits"
    )


def test_all_joints_beyond_their_limits_are_named():
    with pytest.raises(InputError) as caught:
        beyond_limits(lcd_arm(), hold_still(np.deg2rad([151.0, 0.0, -152.0]), 1.0))
    assert ["joint1 at 151 deg" in str(p) or "joint3 at -152 deg" in str(p) for p in caught.value.problems] == [
        True
    ] * 2
    assert problem(beyond_limits, lcd_arm(), hold_still([0.0], 1.0)).got == "1 joint angles"
