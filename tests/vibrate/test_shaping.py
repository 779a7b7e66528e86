"""Input shapers and moving averages, against closed forms, dense samples and an oscillator that follows them."""

import numpy as np
import pytest
from arms import lcd_arm
from conformance import agrees
from scipy.integrate import solve_ivp

from ident.vibrate.motion import stroke
from ident.vibrate.shaping import TOLERATED, Shaper, averaged, shaped, shapers

EACH = {shaper.name: shaper for shaper in shapers()}
RATIOS = np.linspace(0.5, 1.5, 41)


@pytest.mark.parametrize(
    ("name", "form"),
    [
        ("ZV", lambda r: abs(np.cos(np.pi * r / 2))),
        ("ZVD", lambda r: np.cos(np.pi * r / 2) ** 2),
        ("MZV", lambda r: abs(np.sqrt(2) + 2 * np.cos(0.75 * np.pi * r)) / (2 + np.sqrt(2))),
        ("EI", lambda r: abs((1 - TOLERATED) / 2 + (1 + TOLERATED) / 2 * np.cos(np.pi * r))),
    ],
)
def test_residuals_are_the_closed_forms(name, form):
    found, what = EACH[name].residual(5.0 * RATIOS, 5.0), f"residual of the {name} shaper by frequency"
    agrees(found, form(RATIOS), "vibration", what, "closed form of the literature", rtol=1e-7, atol=1e-12)


def test_two_humps_touch_the_tolerated_residual_and_hold_over_a_wider_band():
    left = EACH["2HEI"].residual(np.linspace(0.7, 1.3, 601), 1.0)
    inside = np.abs(np.linspace(0.7, 1.3, 601) - 1) < 0.275
    what, source = "two humps of the 2HEI shaper", "tolerated residual"
    agrees(left[inside].max(), TOLERATED, "vibration", what, source, rtol=0.02)
    assert (EACH["EI"].residual(np.array([0.75, 1.25]), 1.0) > TOLERATED).all()


@pytest.mark.parametrize("name", ["ZV", "ZVD", "MZV"])
@pytest.mark.parametrize("damping", [0.0, 0.01, 0.1])
def test_nothing_is_left_of_the_expected_mode(name, damping):
    shaper = next(each for each in shapers(damping) if each.name == name)
    damped = 5.0 * np.sqrt(1 - damping**2)
    assert shaper.amplitudes.sum() == pytest.approx(1.0)
    left, what = shaper.residual(5.0, damped, damping), f"what {name} leaves of its own mode"
    agrees(left, 0, "vibration", what, "nothing, by its design", atol=1e-12)
    assert Shaper("none", np.zeros(1), np.ones(1)).residual(5.0, damped, damping) == pytest.approx(1.0)


def test_two_shapers_leave_nothing_of_either_mode():
    zv = EACH["ZV"]
    times = (zv.cycles[:, None] / 4.0 + zv.cycles / 7.0).ravel()
    both = Shaper("ZV x ZV", times, np.outer(zv.amplitudes, zv.amplitudes).ravel())
    np.testing.assert_allclose(both.residual(np.array([4.0, 7.0]), 1.0), 0.0, atol=1e-12)


def ramp(time):
    return np.clip(time, 0.0, 1.0)


def test_with_one_frequency_it_is_the_convolution_of_the_literature():
    zvd = EACH["ZVD"]
    time, alpha = shaped(ramp, 1.0, ((zvd, lambda at: np.full_like(at, 4.0)),))
    expected = sum(a * ramp(time - c / 4.0) for a, c in zip(zvd.amplitudes, zvd.cycles, strict=True))
    what, source = "a shaped command", "convolution with the impulses"
    agrees(alpha, expected, "vibration", what, source, rtol=1e-7, atol=2e-3)
    assert time[-1] == pytest.approx(1.25, abs=2e-3)


@pytest.mark.parametrize("follows", [True, False])
def test_a_mode_whose_frequency_follows_the_posture_is_left_at_rest(follows):
    """An oscillator whose base moves by alpha from 0 to 1, its frequency falling from 7 to 4 Hz."""

    def frequency(alpha):
        return (7.0 - 3.0 * alpha) if follows else np.full_like(alpha, 5.5)

    def smooth(t):
        s = np.clip(t / 1.5, 0, 1)
        return s - np.sin(2 * np.pi * s) / (2 * np.pi)

    time, alpha = shaped(smooth, 1.5, ((EACH["ZVD"], frequency),))

    def left(time, alpha):
        def rates(t, y):
            at = np.interp(t, time, alpha)
            return y[1], -((2 * np.pi * (7.0 - 3.0 * at)) ** 2) * (y[0] - at)

        y = solve_ivp(rates, (0.0, time[-1] + 1.0), [0.0, 0.0], rtol=1e-8, atol=1e-10, max_step=0.01)
        after = y.t > time[-1]
        return np.abs(y.y[0][after] - 1.0).max()

    even = np.linspace(0.0, 1.5, 1501)
    before = left(even, smooth(even))
    share = left(time, alpha) / before
    assert share < 0.1 if follows else share > 0.1


def test_the_mean_over_a_window_is_that_of_dense_samples_and_exceeds_no_limit():
    motion = stroke(lcd_arm().stroke, percent=100.0, profile="trapezoid")
    mean, window = averaged(motion, 0.25), 0.25
    fine = np.arange(-window, motion.arrival + window, 1e-4)
    q = np.asarray(motion(fine)[0])
    whole = np.concatenate([np.zeros((3, 1)), np.cumsum((q[:, 1:] + q[:, :-1]) / 2 * 1e-4, 1)], 1)
    expected = (whole[:, 2500:] - whole[:, :-2500]) / window
    what, source = "moving average of a command", "mean of dense samples"
    agrees(mean(fine[2500:])[0], expected, "vibration", what, source, rtol=1e-7, atol=1e-7, unit="rad")
    assert mean.arrival == pytest.approx(motion.arrival + window)
    for own, before in zip(mean(fine)[1:], motion(fine)[1:], strict=True):
        assert (np.abs(np.asarray(own)).max(1) <= np.abs(np.asarray(before)).max(1) * (1 + 1e-9)).all()
