"""Speeds along a stroke: what the schedules keep, whatever speeds are asked for."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from arms import lcd_arm

from ident.vibrate.evaluator import Evaluator
from ident.vibrate.motion import stroke
from ident.vibrate.schedule import MotionLimits, Scheduling
from ident.vibrate.simulate import refuse_jumps

ARM = lcd_arm()
LIMITS = MotionLimits(np.radians(9.0), np.radians(100.0), np.radians(200.0))
SCHEDULING = Scheduling(Evaluator(ARM, stroke(ARM.stroke, percent=10.0), ()), ARM.stroke, LIMITS, 12, 2.0)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("retract", [False, True])
def test_a_schedule_keeps_path_and_limits_at_ten_times_the_rate(seed, retract):
    speeds = np.radians(np.random.default_rng(seed).uniform(0.5, 20.0, 11))
    scheduling = Scheduling(SCHEDULING.evaluator, ARM.stroke, LIMITS, 12, 2.0, retract)
    schedule = scheduling.schedule(speeds)
    motion = schedule.motion
    refuse_jumps(ARM, motion)
    time = np.arange(0.0, motion.arrival, 4e-4)
    q, qd, qdd = (np.asarray(part) for part in motion(time))
    direction = np.asarray(ARM.stroke.direction)
    np.testing.assert_allclose(q, direction[:, None] * q[0], atol=1e-9)
    ends = np.asarray(motion(motion.breaks[[0, -1]])[0])[0]
    folded, unfolded = float(ARM.stroke.folded), float(ARM.stroke.unfolded)
    np.testing.assert_allclose(ends, (unfolded, folded) if retract else (folded, unfolded), atol=1e-9)
    assert schedule.duration == pytest.approx(motion.arrival)
    assert np.abs(qd[0]).max() <= LIMITS.speed * (1 + 1e-9)
    assert np.abs(qdd[0]).max() <= LIMITS.acceleration * (1 + 1e-9)
    assert np.abs(np.diff(qdd[0])).max() / 4e-4 <= LIMITS.jerk * (1 + 1e-6)


def test_no_schedule_is_faster_than_the_time_optimal_motion():
    """Of the same limits: full speed, acceleration and jerk of the arm file, but the lower speed."""
    path = eqx.tree_at(lambda stroke: stroke.speed, ARM.stroke, jnp.asarray(LIMITS.speed))
    optimal = stroke(path, percent=100.0, profile="s-curve").arrival
    fastest = SCHEDULING.schedule(np.full(11, np.inf)).duration
    assert optimal < fastest < 1.06 * optimal


@pytest.mark.parametrize("time", [18.0, 26.0, 60.0])
def test_a_schedule_is_scaled_to_a_time(time):
    speeds = np.radians(np.random.default_rng(1).uniform(2.0, 9.0, 11))
    assert SCHEDULING.in_time(SCHEDULING.schedule(speeds), time).duration == pytest.approx(time, rel=1e-6)


def test_the_orders_are_cycles_of_the_excitation_for_a_radian_of_alpha():
    np.testing.assert_allclose(SCHEDULING.orders(), [161 / (2 * np.pi), 320 / (2 * np.pi)])
