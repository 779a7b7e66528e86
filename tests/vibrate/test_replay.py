"""Replayed logs: the spline passes the samples, or near them, and noise does not become acceleration."""

import math
import re
from dataclasses import replace

import numpy as np
import pytest
from arms import lcd_arm
from hypothesis import given, settings
from hypothesis import strategies as st

from ident.errors import InputError
from ident.vibrate.replay import MOST_KNOTS, noise_of, replay

NOISE = 1e-5


def cycloid(h=0.002, *, lead=0.2, T=2.0):
    """Time, and angles, velocities and accelerations of two joints that are at rest before and after."""
    t = np.arange(0.0, T + 2 * lead + h / 2, h)
    s = np.clip((t - lead) / T, 0, 1)
    turn = 2 * np.pi * s
    shapes = s - np.sin(turn) / (2 * np.pi), (1 - np.cos(turn)) / T, 2 * np.pi * np.sin(turn) / T**2
    return t, *(np.array([[1.0], [-2.0]]) * shape for shape in shapes)


def noisy(q):
    return q + np.random.default_rng(7).normal(0, NOISE, q.shape)


def rms(x):
    return float(np.sqrt(np.mean(np.square(x))))


def problem(*args, **kwargs):
    with pytest.raises(InputError) as caught:
        replay(*args, **kwargs)
    (one,) = caught.value.problems
    return str(one)


@given(rows=st.sampled_from([4, 5, 30]), seed=st.integers(0, 99), start=st.floats(-100, 100))
@settings(deadline=None, max_examples=20)
def test_the_spline_passes_the_samples(rows, seed, start):
    rng = np.random.default_rng(seed)
    time = start + np.cumsum(rng.uniform(0.5, 1.5, rows))
    angles = rng.normal(size=(3, rows))
    motion = replay(time, angles, name="path")
    assert (motion.name, motion.breaks[0], motion.arrival) == ("path", 0.0, motion.breaks[-1])
    np.testing.assert_allclose(motion(time - time[0])[0], angles, atol=1e-8)


def test_velocity_and_acceleration_are_those_of_the_path():
    t, q, qd, qdd = cycloid()
    _, v, a = replay(t, q)(t)
    assert rms(v - qd) < 1e-6
    assert rms(a - qdd) < 1e-3
    assert rms(qdd) > 1.0


def test_four_derivatives_are_continuous():
    t, q, _, _ = cycloid(0.05)
    motion = replay(t, q)
    c, steps = np.asarray(motion.coefficients), np.diff(motion.breaks)[:, None]
    for n in range(5):
        lower = np.array([math.comb(m, n) for m in range(5, n - 1, -1)])[:, None, None] * c[: 6 - n]
        ends = sum(part * steps**power for power, part in zip(range(5 - n, -1, -1), lower, strict=True))
        np.testing.assert_allclose(ends[:-1], c[5 - n, 1:], atol=1e-6 * abs(c[5 - n]).max())
    assert abs(np.diff(c[0], axis=0)).max() > 0.1


@pytest.mark.parametrize("smoothing", [0.0, NOISE])
def test_it_ends_at_rest_where_the_data_do(smoothing):
    t, q, _, _ = cycloid()
    motion = replay(t, noisy(q) if smoothing else q, smoothing=smoothing)
    for _, qd, qdd in (motion.on_piece(0, 0.0), motion.on_piece(len(motion.breaks) - 2, motion.arrival)):
        assert float(abs(qd).max()) < 1e-9
        assert smoothing or float(abs(qdd).max()) < 1e-6


@pytest.mark.parametrize("smoothing", [0.0, NOISE])
def test_it_moves_where_the_data_do(smoothing):
    t = np.linspace(0.0, 1.0, 200)
    q = np.sin(t + 0.2)[None]
    motion = replay(t, noisy(q) if smoothing else q, smoothing=smoothing)
    ends = [motion.on_piece(0, 0.0)[1], motion.on_piece(len(motion.breaks) - 2, 1.0)[1]]
    np.testing.assert_allclose(np.concatenate(ends), [np.cos(0.2), np.cos(1.2)], rtol=1e-3)


def test_smoothing_keeps_noise_out_of_the_acceleration():
    t, q, qd, qdd = cycloid(0.001)
    rough, smooth = replay(t, noisy(q)), replay(t, noisy(q), smoothing=NOISE)
    assert rms(rough(t)[2] - qdd) > 3 * NOISE / 0.001**2
    assert rms(smooth(t)[2] - qdd) < 0.01 * rms(qdd)
    assert rms(smooth(t)[1] - qd) < 1e-3 * rms(qd)
    assert rms(smooth(t)[0] - noisy(q)) == pytest.approx(NOISE, rel=0.1)
    assert len(smooth.breaks) < len(t) / 10


def test_an_acceleration_that_no_joint_has_names_the_smoothing_that_mends_it():
    t, q, _, qdd = cycloid()
    q = np.append(q, q[:1], 0)
    coarse = np.round(q / 2e-4) * 2e-4
    said = problem(t, coarse, name="log.csv", arm=lcd_arm())
    found = re.fullmatch(
        r"log\.csv: got (\d+) rad/s\^2 of joint\d at [\d.]+ s, expected at most 100 rad/s\^2; smooth the angles "
        r"by their noise \(`smoothing` ([\d.]+) deg\), or check the units of time and angles, "
        r"or correct the samples there",
        said,
    )
    assert found
    assert float(found[1]) > 100
    smooth = replay(t, coarse, smoothing=math.radians(float(found[2])), arm=lcd_arm())
    assert np.abs(smooth(t)[2]).max() == pytest.approx(np.abs(qdd).max(), rel=0.05)


def test_small_noise_is_no_impossible_acceleration():
    """An encoder of 20 bits at 8 ms; with the arm file's limits, twice as much as they allow."""
    t, q, _, qdd = cycloid(0.008)
    encoder = np.round(np.append(q, q[:1], 0) / 6e-6) * 6e-6
    np.testing.assert_array_equal(*(replay(t, encoder, arm=arm).coefficients for arm in (None, lcd_arm())))

    def limited(most):
        return replace(lcd_arm(), joints=[replace(joint, rates=(9.0, float(most), 99.0)) for joint in lcd_arm().joints])

    replay(t, encoder, arm=limited(np.abs(qdd).max()))
    said = problem(t, encoder, arm=limited(np.abs(qdd).max() / 3))
    assert f"expected at most {np.abs(qdd).max() * 2 / 3:.3g} rad/s^2; check the units of time and angles, or" in said


def test_an_arm_that_stands_still():
    motion = replay(np.arange(8.0), np.full((2, 8), 0.3), smoothing=1e-4)
    np.testing.assert_allclose(motion(3.3), np.array([[0.3, 0.3], [0, 0], [0, 0]]), atol=1e-12)


def test_smoothing_far_below_the_noise_is_refused_in_time():
    t, q, _, _ = cycloid(0.001)
    assert len(t) > 2 * MOST_KNOTS
    assert problem(t, noisy(q), smoothing=NOISE / 3) == (
        "smoothing: got 3.33333e-06 rad, expected at least the noise of the angles; "
        "give a larger one, or 0 to pass all samples"
    )


FOUR = np.arange(4.0)


@pytest.mark.parametrize(
    ("time", "angles", "smoothing", "text"),
    [
        (FOUR[:3], FOUR[None, :3], 0.0, "log, time: got 3 samples, expected at least 4; give a longer log"),
        (FOUR, FOUR[None], 0.1, "log, time: got 4 samples, expected at least 6; give a longer log"),
        (
            FOUR // 2,
            FOUR[None],
            0.0,
            "log, time: got 0 s after 0 s, expected steps of 1e-09 to 1e+09 s; sort the samples, or give the times in s",  # noqa: E501
        ),
        (
            FOUR,
            FOUR[None] * math.nan,
            0.0,
            "log, angles: got a sample that is not finite, expected finite numbers; remove it",
        ),
        (
            np.arange(6.0),
            np.arange(6.0)[None],
            -0.1,
            "smoothing: got -0.1 rad, expected a finite angle of at least 0; "
            "give the noise of the angles, or 0 to pass all samples",
        ),
    ],
)
def test_a_log_that_cannot_be(time, angles, smoothing, text):
    assert problem(time, angles, smoothing=smoothing) == text


@pytest.mark.parametrize(("sd", "digits"), [(1e-5, 12), (0.0, 5), (0.0, 12)])
def test_the_noise_of_a_path_is_told_from_its_motion(sd, digits):
    """White noise by its standard deviation, rounding by its step over the root of twelve; a smooth path has none."""
    time = np.arange(0, 20, 0.008)
    share = time / 20 - np.sin(2 * np.pi * time / 20) / (2 * np.pi)
    angles = np.outer([1.0, -2.0], share) + sd * np.random.default_rng(0).standard_normal((2, len(time)))
    motion = replay(time, np.round(angles, digits))
    noise, commanded = noise_of(motion, 125.0)
    true = np.hypot(sd, 10.0**-digits / np.sqrt(12))
    assert noise == pytest.approx(true, rel=0.1, abs=1e-10)
    # its acceleration up to 25 Hz, of a sine by sine: variance h/pi times the integral of omega^4
    wanted = true * np.sqrt(0.008 / np.pi * (2 * np.pi * 25) ** 5 / 5)
    own = np.diff(angles[1, ::20], 2).std() / 0.16**2
    assert commanded == pytest.approx(wanted / own, rel=0.2, abs=1e-4)
    smoothed = replay(time, np.round(angles, digits), smoothing=1.5 * max(true, 1e-6))
    assert noise_of(smoothed, 125.0)[1] < 0.02
