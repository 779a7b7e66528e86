"""Modes by taps without a force: decays found, modes against the model's poles, amplitude, and what is in doubt.

How often intervals hold the truth is in tests/benchmarks/taps.py.
"""

from dataclasses import replace

import numpy as np
import pytest
from conformance import agrees
from scipy.integrate import solve_ivp
from scipy.stats import binom
from tapped import RATE, as_record, tap_test, tapped

from ident.errors import InputError
from ident.modal.ambient import ambient_tests, decay_correlations
from ident.modal.frf import Processing
from ident.modal.operational import operational_modes, realisations
from ident.modal.taps import free_decays, innovations

SHARP = (0, 1, 3)
"""Modes of the paper's arm that each tap shows."""


@pytest.fixture(scope="module")
def arm():
    return tapped()


@pytest.fixture(scope="module")
def record(arm):
    return arm.record(np.random.default_rng(5))


@pytest.fixture(scope="module")
def modes(record):
    return operational_modes(tap_test(record))


def test_sums_over_free_decays_of_any_sign_place_and_strength_give_the_exact_poles():
    """Three decays of a known system with a close pair: R(k) = C A^k G without noise."""
    rng = np.random.default_rng(2)
    poles = 2 * np.pi * np.array([4.0, 4.1, 11.0]) * (-0.02 + 1j)
    shapes = rng.normal(size=(4, 3)) + 0.1j * rng.normal(size=(4, 3))
    time = np.arange(400) / RATE
    decays = [
        size * (shapes * rng.normal(size=3) @ np.exp(poles[:, None] * time[: 400 - 30 * n])).real
        for n, size in enumerate((1.0, -3.0, 0.2))
    ]
    (found,) = realisations(decay_correlations(decays, (0, 2), 1 / RATE, 100).mean, 1 / RATE, [6])
    order = np.argsort(np.abs(found.pole))
    ours, what = found.pole[order], "frequencies by free decays of any sign, place and strength"
    agrees(np.abs(ours), np.abs(poles), "modal", what, "poles of the made decays", rtol=1e-6, unit="rad/s")
    np.testing.assert_allclose(ours, poles, rtol=1e-6)


def test_decays_begin_after_the_last_contact_and_end_before_the_next():
    """Two modes that never come to rest; the second tap is double, the last one a tenth of a second before the end."""
    rng, count = np.random.default_rng(1), 3000
    force = np.zeros(count)
    for at, size in ((300, 1.0), (900, -0.8), (930, 0.3), (1500, 0.5), (2980, 1.0)):
        force[at : at + 3] = size
    time = np.arange(600) / RATE
    rows = [[1.0, 0.5], [0.4, -1.0]]
    swing = np.exp(-0.5 * time) * np.sin(2 * np.pi * np.array([[5.0], [12.0]]) * time)
    moved = np.array(rows) @ np.array([np.convolve(force, each)[:count] for each in swing])
    left, noise = innovations([moved + 0.002 * rng.normal(size=moved.shape)])
    assert (noise > 0.002).all(), "that of the sensors, amplified by the predictor"
    assert (noise < 0.01).all()
    (ends,) = free_decays(left, noise, round(RATE))
    assert [begin for begin, end in ends if end > begin + 100] == pytest.approx([316, 946, 1516], abs=8)
    assert [end for begin, end in ends if end > begin + 100] == pytest.approx([888, 1488, 2968], abs=8)


def test_modes_are_those_of_the_model_within_their_covariance(arm, modes):
    assert len(modes.test.decays) == modes.blocks == 6
    for i, hertz in enumerate(modes.frequency):
        j = int(np.argmin(np.abs(arm.frequency - hertz)))
        assert abs(hertz - arm.frequency[j]) < 4 * modes.sigma[0, i]
        assert abs(modes.damping[i] - arm.damping[j]) < 4 * modes.sigma[1, i]
    assert all(np.abs(modes.frequency / arm.frequency[k] - 1).min() < 0.01 for k in SHARP)
    poles = 2 * len(modes.frequency)
    assert np.linalg.eigvalsh(modes.covariance[:poles, :poles]).min() > 0
    assert [str(line).partition(" at ")[0] for line in modes.test.harmonics] == ["the mains"]
    assert not modes.doubtful


def test_a_window_of_the_analyser_is_taken_out_again(arm, record):
    """Each tap's decay faded by exp(-0.3 t), as an analyser does: the poles are those without a window."""
    blocks = np.array_split(record, 3, axis=1)
    time = np.arange(record.shape[1]) / RATE
    plain = operational_modes(tap_test(*blocks))
    faded = [each * np.exp(-0.3 * time[: each.shape[1]]) for each in blocks]
    found = operational_modes(tap_test(*faded, decay=0.3))
    for k in (0, 1):
        i, j = (int(np.abs(each.frequency - arm.frequency[k]).argmin()) for each in (found, plain))
        assert abs(found.frequency[i] - plain.frequency[j]) < 3 * np.hypot(found.sigma[0, i], plain.sigma[0, j])
        assert found.damping[i] == pytest.approx(plain.damping[j], abs=2e-3), "0.3 1/s are 0.8 %"


def test_a_short_record_with_taps_is_taken_as_such_and_that_is_said(arm):
    brief = arm.record(np.random.default_rng(7), "yz", gaps=(3.0, 3.1))
    (said,) = [each for each in tap_test(brief, excitation="").remarks if "taken as" in each]
    assert said == "too short for an ambient test: taken as 2 taps (column `excitation`)"
    with pytest.raises(InputError, match=r"got .* s of responses without a force, expected at least 20 s"):
        tap_test(brief, excitation="ambient")
    with pytest.raises(InputError, match=r"got 1 tap in .*; tap again, and wait 2 to 5 s after each tap"):
        tap_test(brief[:, :700], excitation="tap")
    with pytest.raises(InputError, match=r"got 0 taps in 1 s of responses without a force"):
        tap_test(brief[:, :200], excitation="tap")


def test_two_taps_in_one_direction_do_not_tell_close_modes_apart(arm):
    """The same place, obliquely: both of the close modes answer, always in the same proportion."""
    rng = np.random.default_rng(3)
    forces = np.zeros((6, 12000))
    for at, size in ((800, 60.0), (6000, -45.0)):
        forces[1:3, at : at + 24] = size * np.sin(np.pi * np.arange(24) / 24)
    modes = operational_modes(tap_test(arm.heard(rng, arm.moved(forces), 0.3)))
    words = " ".join(modes.remarks)
    assert "one direction of taps only: modes that coincide are seen as one" in words
    assert "WARNING: 2 taps: their scatter hardly tells the standard errors" in words
    assert (np.abs(modes.frequency / 5.7 - 1) < 0.02).sum() == 2
    assert "Hz are not told apart by one direction of taps: tap in a second direction" in words
    assert modes.doubtful
    several = operational_modes(tap_test(arm.record(rng)))
    assert not any("direction" in remark for remark in several.remarks)


def test_files_with_sensors_of_their_own_are_named_each_by_itself(record):
    first = tap_test(record)
    assert not any("no common shape" in remark for remark in first.remarks)
    whole = as_record("a.h5", record)
    parts = [replace(whole, file=f"{n}.h5", responses=whole.responses[n : n + 3], references=(0, 1, 2)) for n in (0, 3)]
    both = ambient_tests(parts, Processing())
    assert [len(test.responses) for test in both] == [3, 3]
    assert all(any("no common shape" in remark for remark in test.remarks) for test in both)
    with pytest.raises(InputError, match=r"another order of sensors than 'a\.h5', expected the same"):
        ambient_tests([whole, replace(whole, file="b.h5", responses=whole.responses[::-1])], Processing())
    with pytest.raises(InputError, match=r"another window than 'a\.h5', expected the same"):
        ambient_tests([whole, replace(whole, file="b.h5", decay=0.05)], Processing())


# -------- Amplitude


def softening(amplitudes, frequency=6.0, ratio=0.01, cubic=-3e4, seconds=6.0):
    """Free decays [m] of one mass whose spring softens with the square of its deflection, integrated in time."""
    omega, time = 2 * np.pi * frequency, np.arange(int(seconds * RATE)) / RATE
    for size in amplitudes:
        decay = solve_ivp(
            lambda _, y: [y[1], -(omega**2) * y[0] * (1 + cubic * y[0] ** 2) - 2 * ratio * omega * y[1]],
            (0, seconds), [size, 0.0], t_eval=time, rtol=1e-9, atol=1e-12,
        )  # fmt: skip
        yield decay.y[0]


def test_frequency_follows_the_amplitude_and_its_trend_widens_the_interval():
    """Backbone of a softening spring: omega (1 + 3/8 c a^2); at 1 mm 1.1 % below, at 0.5 mm 0.3 %."""
    rng = np.random.default_rng(0)
    still = np.zeros(100)
    motion = np.concatenate([np.append(still, each) for each in softening([1e-3, -1.1e-3, 0.9e-3, 1e-3, -1e-3])])
    record = (motion + 2e-5 * rng.normal(size=len(motion)))[None]
    test = replace(tap_test(record, excitation="release"), order=(2,))
    middle = operational_modes(test)
    early, late = 1e3 * middle.trend.amplitude[1:, 0]
    assert 0.3 < late < early < 1.1
    assert any("changes with amplitude" in remark for remark in middle.remarks)
    assert middle.sigma[0, 0] > 0.005, "half the difference between both halves is in it"
    for amplitude in (early, late):
        at = operational_modes(test, amplitude=amplitude / 1e3)
        expected = 6.0 * (1 - 3 / 8 * 3e4 * (amplitude / 1e3) ** 2)
        assert at.frequency[0] == pytest.approx(expected, rel=0.002)
        assert at.sigma[0, 0] < middle.sigma[0, 0]
        assert at.remarks[-1].startswith("1 of 1 modes were measured at the amplitude at work")
    said = operational_modes(test, amplitude=0.01).remarks[-1]
    assert said.startswith("0 of 1 modes were measured at the amplitude at work, 10 mm; those at 5.9")


def test_a_linear_arm_shows_no_trend(modes):
    assert not any("changes with amplitude" in remark for remark in modes.remarks)
    assert (modes.trend.amplitude[0] > modes.trend.amplitude[1]).all()
    assert (modes.trend.amplitude[1] > modes.trend.amplitude[2]).all()


@pytest.mark.slow
def test_intervals_cover_the_truth_as_often_as_they_say(arm):
    """Twenty tests by hand, three modes each: 99.9 % band of 95 %."""
    inside = number = 0
    for seed in range(20):
        modes = operational_modes(tap_test(arm.record(np.random.default_rng(100 + seed))))
        for k in SHARP:
            i = int(np.argmin(np.abs(modes.frequency - arm.frequency[k])))
            off = modes.frequency[i] - arm.frequency[k], modes.damping[i] - arm.damping[k]
            inside += int((np.abs(off) < 1.96 * modes.sigma[:, i]).sum())
            number += 2
    assert binom.ppf(0.0005, number, 0.95) <= inside <= binom.ppf(0.9995, number, 0.95)
