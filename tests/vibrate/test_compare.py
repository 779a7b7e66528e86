import math

import numpy as np
import pytest

from ident.errors import InputError
from ident.vibrate.compare import Trace, compare

BAND = (4.0, 8.0)
W = 2 * np.pi * 5.0


def clock(rate, seconds=10.0, start=0.0):
    return start + np.arange(int(rate * seconds)) / rate


def swing(time, amplitude=1e-3, quantity="displacement"):
    return Trace(time, amplitude * np.sin(W * time), quantity)


@pytest.mark.parametrize(("fine", "coarse"), [(1000.0, 200.0), (200.0, 1000.0), (1000.0, 256.0), (441.0, 440.9)])
def test_ratios_whatever_the_sampling(fine, coarse):
    time = clock(coarse, start=0.123)
    offset = Trace(time, swing(time, 2e-3).values + 0.5)
    result = compare(swing(clock(fine)), offset, band=BAND)
    assert result.peak_ratio == pytest.approx(0.5, rel=0.01)
    assert result.rms_ratio == pytest.approx(0.5, rel=0.005)
    assert result.band_rms_ratio == pytest.approx(0.5, rel=0.005)
    assert result.simulated.peak == pytest.approx(1e-3, rel=0.01)
    assert result.measured.rms == pytest.approx(2e-3 / math.sqrt(2), rel=0.01)


def test_both_stand_on_the_coarser_clock_over_the_common_time():
    measured = swing(clock(250.0, start=2.0013))
    result = compare(swing(clock(1000.0)), measured, band=BAND)
    ours, theirs = result.simulated.trace, result.measured.trace
    np.testing.assert_array_equal(ours.time, theirs.time)
    np.testing.assert_allclose(ours.time, measured.time[measured.time <= 9.996], atol=1e-12)
    np.testing.assert_allclose(theirs.values, measured.values[: len(theirs.time)], atol=1e-12)
    np.testing.assert_allclose(ours.values[20:-20], swing(ours.time).values[20:-20], atol=1e-5)
    assert len(ours.time) == len(result.simulated.spectrum.frequency) * 2 - 2 + len(ours.time) % 2


def test_nothing_is_aliased():
    time = clock(1000.0)
    noisy = Trace(time, swing(time).values + 5e-3 * np.sin(2 * np.pi * 95.0 * time))  # 95 Hz would stand at 5 Hz
    result = compare(noisy, swing(clock(100.0)), band=BAND)
    assert result.rms_ratio == pytest.approx(1.0, rel=0.01)
    assert result.simulated.dominant.amplitude == pytest.approx(1e-3, rel=0.01)


def test_a_displacement_is_compared_with_a_measured_acceleration():
    time = clock(1000.0)
    moved = Trace(time, swing(time).values + 0.1 + 0.02 * time)
    result = compare(moved, swing(clock(250.0), -(W**2) * 1e-3, "acceleration"), band=BAND)
    assert result.peak_ratio == pytest.approx(1.0, rel=0.01)
    assert result.rms_ratio == pytest.approx(1.0, rel=2e-3)
    assert result.simulated.trace.quantity == "acceleration"
    np.testing.assert_allclose(
        result.simulated.trace.values[50:-50], result.measured.trace.values[50:-50], atol=1e-3 * W**2 * 1e-3
    )
    # the spectra tell the same: (2 pi f)^2 times that of the displacement
    assert result.simulated.dominant.amplitude == pytest.approx(W**2 * 1e-3, rel=2e-3)


def test_dominant_frequency_is_that_of_the_band():
    time = clock(200.0)
    slow = Trace(time, swing(time).values + 0.01 * np.sin(2 * np.pi * 1.3 * time))
    result = compare(slow, Trace(time, 1e-3 * np.sin(2 * np.pi * 6.2 * time)), band=BAND)
    assert result.simulated.dominant.frequency == pytest.approx(5.0, abs=0.01)
    assert result.measured.dominant.frequency == pytest.approx(6.2, abs=0.01)
    assert result.peak_ratio > 9
    assert result.band_rms_ratio == pytest.approx(1.0, rel=0.1)


def test_a_simulation_at_rest_has_no_dominant_frequency():
    time = clock(200.0)
    result = compare(Trace(time, np.zeros(len(time))), swing(time), band=BAND)
    assert result.simulated.dominant is None
    assert result.peak_ratio == 0


@pytest.mark.parametrize(
    ("simulated", "measured", "band", "text"),
    [
        (
            swing(clock(200.0), 1.0, "acceleration"),
            swing(clock(200.0)),
            BAND,
            "simulated: got an acceleration, expected a displacement, as was measured; "
            "give the simulated displacement: neither trace is integrated",
        ),
        (
            swing(clock(200.0)),
            swing(clock(200.0, start=9.9501)),
            BAND,
            "time: got 0 to 9.995 s and 9.95 to 19.95 s, 9 samples in common, expected at least 16",
        ),
        (
            swing(clock(200.0)),
            Trace(20.0 * np.arange(100), np.sin(np.arange(100))),
            BAND,
            "time: got 0 to 9.995 s and 0 to 1980 s, 1 samples in common, expected at least 16",
        ),
        (
            swing(clock(200.0)),
            Trace(clock(200.0), np.full(2000, 0.3)),
            BAND,
            "measured: got a constant, expected a vibration; choose the direction or the time in which it moves",
        ),
        (swing(clock(200.0)), swing(clock(200.0)), (8.0, 4.0), "band: got 8 to 4 Hz, expected 0 <= low < high"),
    ],
)
def test_what_is_refused_and_how(simulated, measured, band, text):
    with pytest.raises(InputError) as error:
        compare(simulated, measured, band=band)
    assert text in str(error.value)
