"""Speeds along a stroke: what the schedules keep, whatever speeds are asked for."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from arms import file_with_limits, lcd_arm
from ruckig import InputParameter, Result, Ruckig, Trajectory

from ident.description.file import parse_arm
from ident.errors import InputError
from ident.vibrate.evaluator import Evaluator
from ident.vibrate.motion import stroke
from ident.vibrate.replay import replay
from ident.vibrate.schedule import Path, Scheduling
from ident.vibrate.simulate import refuse_jumps

ARM = lcd_arm()
SPEED, ACCELERATION, JERK = np.radians([9.0, 100.0, 200.0])
EVALUATOR = Evaluator(ARM, stroke(ARM.stroke, percent=10.0), ())
SCHEDULING = Scheduling(EVALUATOR, Path.of_stroke(ARM, ARM.stroke, 10.0), 12, 2.0)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("retract", [False, True])
def test_a_schedule_keeps_path_and_limits_at_ten_times_the_rate(seed, retract):
    speeds = np.radians(np.random.default_rng(seed).uniform(0.5, 20.0, 11))
    scheduling = Scheduling(EVALUATOR, Path.of_stroke(ARM, ARM.stroke, 10.0, retract=retract), 12, 2.0)
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
    assert np.abs(qd[0]).max() <= SPEED * (1 + 1e-9)
    assert np.abs(qdd[0]).max() <= ACCELERATION * (1 + 1e-9)
    assert np.abs(np.diff(qdd[0])).max() / 4e-4 <= JERK * (1 + 1e-6)


def test_no_schedule_is_faster_than_the_time_optimal_motion():
    """Of the same limits: full speed, acceleration and jerk of the arm file, but the lower speed."""
    path = eqx.tree_at(lambda stroke: stroke.speed, ARM.stroke, jnp.asarray(SPEED))
    optimal = stroke(path, percent=100.0, profile="s-curve").arrival
    fastest = SCHEDULING.schedule(np.full(11, np.inf)).duration
    assert optimal < fastest < 1.06 * optimal


def optimal(distance, limits):
    """Least time [s] of one joint from rest to rest within its speed, acceleration and jerk, by ruckig."""
    asked, found = InputParameter(1), Trajectory(1)
    asked.target_position, (asked.max_velocity, asked.max_acceleration, asked.max_jerk) = [distance], limits[:, None]
    assert Ruckig(1).calculate(asked, found) == Result.Working
    return found.duration


def test_along_a_given_path_no_schedule_is_faster_than_the_time_optimal_motion():
    """On a line nearly as fast, with each joint's limits at once; on an arc no faster than joint 1 by itself."""
    along = np.radians([[142.0], [-284.0], [142.0]]) * (1 - np.cos(np.linspace(0, np.pi, 401))) / 2
    rates = RATES * np.array([[0.25], [1.0], [1.0]])
    for angles, slack in ((along, 1.06), (arc(TIME), 2.0)):
        arm, motion = with_rates(rates), replay(TIME, angles, name="path")
        scheduling = Scheduling(Evaluator(arm, motion, ()), Path.of_motion(arm, motion), 12, 2.0)
        fastest = scheduling.schedule(np.full(11, np.inf)).duration
        bounds = [optimal(float(np.ptp(each)), limits) for each, limits in zip(angles, rates.T, strict=True)]
        assert max(bounds) < fastest < slack * max(bounds)


@pytest.mark.parametrize("time", [18.0, 26.0, 60.0])
def test_a_schedule_is_scaled_to_a_time(time):
    speeds = np.radians(np.random.default_rng(1).uniform(2.0, 9.0, 11))
    assert SCHEDULING.in_time(SCHEDULING.schedule(speeds), time).duration == pytest.approx(time, rel=1e-6)


def test_the_orders_are_cycles_of_the_excitation_for_a_radian_of_alpha():
    orders = SCHEDULING.orders(np.array([0.5, 1.0]))
    np.testing.assert_allclose(orders, np.outer([161, 320], [1, 1]) / (2 * np.pi), rtol=1e-9)


RATES = np.radians([[40.0, 80.0, 40.0], [100.0, 200.0, 100.0], [400.0, 800.0, 400.0]])


def with_rates(rates=RATES):
    return parse_arm(file_with_limits(rates))


def arc(time, radius=0.5):
    """A half circle in the space of joints 1 and 3, from rest to rest on a cycloid."""
    s = time / time[-1]
    turn = np.pi * (s - np.sin(2 * np.pi * s) / (2 * np.pi))
    return np.stack([radius * (1 - np.cos(turn)), 0 * turn, radius * np.sin(turn)])


TIME = np.linspace(0.0, 8.0, 401)


@pytest.mark.parametrize("tight", [1.0, 0.1])
@pytest.mark.parametrize("seed", range(2))
def test_joints_keep_their_limits_along_a_bent_path_at_ten_times_the_rate(seed, tight):
    """The less they may accelerate the more the bend matters: of a tenth it sets the speed nearly everywhere."""
    rates = RATES * np.array([1.0, tight, tight])[:, None]
    arm, motion = with_rates(rates), replay(TIME, arc(TIME), name="arc")
    scheduling = Scheduling(Evaluator(arm, motion, ()), Path.of_motion(arm, motion), 10, 2.0)
    assert scheduling.path.ends == pytest.approx((0.0, 0.5 * np.pi), rel=1e-6)
    rng = np.random.default_rng(seed)
    schedule = scheduling.schedule(np.radians(rng.uniform(1.0, 60.0, 9)) if seed else np.full(9, np.inf))
    found = schedule.motion
    refuse_jumps(arm, found)
    step = 4e-4
    q, qd, qdd = (np.asarray(part) for part in found(np.arange(0.0, found.arrival, step)))
    np.testing.assert_allclose(np.hypot(q[0] - 0.5, q[2]), 0.5, atol=1e-6)
    np.testing.assert_allclose(q[:, [0, -1]], [[0.0, 1.0], [0.0, 0.0], [0.0, 0.0]], atol=1e-6)
    parts = zip((qd, qdd, np.diff(qdd) / step), rates, strict=True)
    used = [np.abs(part).max(1) / limit for part, limit in parts]
    assert np.max(used) <= 1 + 1e-3
    assert seed or np.max(used) > 0.55  # the fastest makes use of what the bend leaves


def test_on_an_arc_the_speed_is_that_of_the_centripetal_acceleration():
    """|q''| = 1 / r, half the limit of acceleration is for it: v^2 / r = A / 2 for a joint that has all of it."""
    arm, motion = with_rates(np.array([[9.0] * 3, [0.1] * 3, [9e3] * 3])), replay(TIME, arc(TIME), name="arc")
    path = Path.of_motion(arm, motion)
    places = np.linspace(*path.ends, 201)
    speed = path.allowed(places, (1e-3, 1e-3)).speed
    turn = places[1:-1] / 0.5
    share = np.maximum(np.abs(np.cos(turn)), np.abs(np.sin(turn)))
    middle = np.abs(turn % (np.pi / 2) - np.pi / 4) > 0.1  # elsewhere neighbours tell which joint it is
    np.testing.assert_allclose(speed[middle], np.sqrt(0.1 / 2 * 0.5 / share)[middle], rtol=0.02)


@pytest.mark.parametrize(
    ("angles", "message"),
    [
        (np.stack([1 - np.cos(2 * np.pi * arc(TIME)[0])] * 3), "turns back or has a corner"),
        (np.stack([np.clip(2 * arc(TIME)[0], 0, 1), 0 * TIME, np.clip(2 * arc(TIME)[0] - 1, 0, 1)]), "at 4 s"),
        (np.zeros((3, len(TIME))), "goes nowhere"),
    ],
)
def test_a_path_on_which_alpha_would_have_to_stop_is_refused(angles, message):
    with pytest.raises(InputError, match=message):
        Path.of_motion(with_rates(), replay(TIME, angles, name="log"))


def test_a_path_needs_limits_of_its_joints():
    with pytest.raises(InputError, match=r"no limits of joint1, joint2, joint3, expected .* add them to each"):
        Path.of_motion(ARM, replay(TIME, arc(TIME), name="log"))


def test_a_stroke_keeps_the_limits_of_the_joints_too():
    limits = Path.of_stroke(with_rates(np.full((3, 3), 0.1)), ARM.stroke, 10.0).limits
    np.testing.assert_allclose(limits, [[0.1] * 3, [0.1] * 3, [0.1] * 3])
    assert (Path.of_stroke(with_rates(np.full((3, 3), 99.0)), ARM.stroke, 10.0).limits[0] < 0.4).all()
