"""Sweeps are simulations at the points of a grid."""

from dataclasses import replace

import numpy as np
import pytest
from arms import lcd_arm
from runs import swing
from swept import axis

from ident.errors import InputError
from ident.vibrate.evaluator import Evaluator
from ident.vibrate.response import peak
from ident.vibrate.simulate import simulate
from ident.vibrate.sweep import _elasticities, sweep, sweeps
from ident.vibrate.variable import Variable

pytestmark = pytest.mark.slow

RATE, STEP = 100.0, 0.01
MOTION = swing(2.0)
ARM = lcd_arm()
STIFF, SOFT = (float(ARM.get(f"joint{n}.k_tors")) for n in (1, 2))
DRAWS = {"joint1.k_tors": STIFF * np.array([0.9, 1.2])}
TRIAL = Evaluator(ARM, MOTION, (), draws=DRAWS, rate=RATE, step=STEP)
FIRST = axis(ARM, ["joint1.k_tors"], STIFF * np.array([0.5, 1.0, 2.0]), 10.0)
SECOND = axis(ARM, ["fingers.com.x"], np.array([1.2, 1.9]), 10.0)
SPEED = axis(ARM, ["speed"], np.array([8.0, 12.0]), 10.0)


def one(values, ratio=1.0, slowest=1.0):
    """Peaks of a single simulation [m]."""
    clock, motion = ratio / slowest, MOTION.at_speed(100 * ratio)
    arm = ARM.replace({path: np.asarray(value) for path, value in values.items()})
    return np.asarray(peak(simulate(arm, motion, rate=RATE * clock, step=STEP / clock).vibration))


def close(found, expected):
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-6 * np.abs(expected).max())


@pytest.fixture(scope="module")
def both():
    return sweeps(TRIAL, [FIRST, SECOND])


@pytest.fixture(scope="module")
def over():
    """Speed first, then a stiffness."""
    return sweep(replace(TRIAL, draws={}), [SPEED, FIRST])


def test_a_sweep_is_single_simulations(both):
    stiffness, centre = both
    close(stiffness.amplitude, np.stack([one({"joint1.k_tors": value}) for value in FIRST.values], 1))
    close(centre.amplitude, np.stack([one({"fingers.com.x": value}) for value in SECOND.values], 1))
    for found in both:
        close(found.present, one({}))


def test_a_change_acts_on_every_draw(both):
    stiffness, centre = both
    assert stiffness.draws.shape == (3, 3, 2)
    close(stiffness.draws[:, 2, 1], one({"joint1.k_tors": 2 * 1.2 * STIFF}))
    close(centre.draws[:, 1, 0], one({"joint1.k_tors": 0.9 * STIFF, "fingers.com.x": 1.9}))
    low, high = stiffness.band
    np.testing.assert_allclose(high - low, 0.9 * np.ptp(stiffness.draws, -1))
    limit = float(stiffness.draws[1].mean())
    np.testing.assert_array_equal(stiffness.exceeds(limit), (stiffness.draws.max(0) > limit).mean(-1))


def test_factors_and_differences_of_draws():
    draws = {"joint2.k_tors": np.array([1.0, 3.0]), "bracket.com.x": np.array([0.1, 0.3])}
    factor, shift = Variable(("joint2.k_tors", "joint3.k_tors"), 1.0, 2.0), Variable(("bracket.com.x",), 0.0, 0.2)
    sets = replace(TRIAL, draws=draws, variables=(factor, shift)).batch(np.array([[np.log(2), 0.05], [0, 0]]))
    np.testing.assert_allclose(sets["joint2.k_tors"], [2 * SOFT, 2, 6, SOFT, 1, 3])
    np.testing.assert_allclose(sets["joint3.k_tors"], float(ARM.get("joint3.k_tors")) * np.array([2, 2, 2, 1, 1, 1]))
    np.testing.assert_allclose(sets["bracket.com.x"], [0.195, 0.15, 0.35, 0.145, 0.1, 0.3])


def test_another_speed_is_the_motion_on_another_clock(over):
    for k, percent in enumerate(SPEED.values):
        close(over.amplitude[:, k, 1], one({}, percent / 10, 0.8))
        close(over.amplitude[:, k, 2], one({"joint1.k_tors": 2 * STIFF}, percent / 10, 0.8))
    close(over.present, one({}, 1.0, 0.8))


def test_the_order_of_axes_is_that_of_the_grid(over):
    turned = sweep(replace(TRIAL, draws={}), [FIRST, SPEED])
    assert (over.amplitude.shape, turned.amplitude.shape) == ((3, 2, 3), (3, 3, 2))
    np.testing.assert_allclose(turned.amplitude, over.amplitude.transpose(0, 2, 1), rtol=1e-12)
    grid = sweep(TRIAL, [SECOND, FIRST])
    assert grid.draws.shape == (3, 2, 3, 2)
    close(grid.amplitude[:, 1, 0], one({"fingers.com.x": 1.9, "joint1.k_tors": 0.5 * STIFF}))


def test_a_sweep_of_the_speed_alone(over):
    (found,) = sweeps(replace(TRIAL, draws={}), [SPEED])
    close(found.amplitude, over.amplitude[:, :, 1])


@pytest.mark.parametrize(
    ("axes", "words"),
    [
        ([FIRST, SECOND, SPEED], "got 3 of them, expected one or two"),
        ([FIRST, FIRST], "got joint1.k_tors twice"),
        ([], "got nothing"),
    ],
)
def test_axes_that_are_no_grid(axes, words):
    with pytest.raises(InputError, match=words):
        sweep(TRIAL, axes)


def test_a_direction_without_vibration_depends_on_nothing():
    """An arm that moves in a plane has none across it: percent of nothing are no number."""
    parts = np.array([[1.0, 2.0], [0.0, 0.0], [3.0, 1.0]])[..., None]
    slopes = np.array([[[0.5, 1.0], [np.nan, 0.0], [6.0, 0.0]]])[..., None]
    variable = Variable(("joint1.k_tors",), -np.inf, np.inf)
    np.testing.assert_array_equal(_elasticities(lcd_arm(), [variable], parts, slopes)[..., 0], [[0.5, 0.0, 2.0]])
