"""Lines of known frequency and amplitude in known noise: within the error, which is the Cramer-Rao bound."""

import numpy as np
import pytest
from conformance import agrees, counted

from ident.vibrate.lines import refined
from ident.vibrate.spectra import amplitude_spectrum, peaks

RATE, COUNT, NOISE = 100.0, 2_000, 0.3
TIME = np.arange(COUNT) / RATE
LENGTH = COUNT / RATE
SQUARE = 1 / 24 - 1 / (4 * np.pi**2)
"""Integral of a Hann window of length 1 times t^2, about its middle."""
HANN = np.sqrt((1 / 32 - 1 / (4 * np.pi**2) + 1 / (64 * np.pi**2)) / SQUARE**2 / 12)
"""Error of a frequency, relative to that without a window: root of the integral of w^2 t^2 by the square of that."""


def lines_of(values, count, window="hann", step_error=0.0):
    spectrum = amplitude_spectrum(TIME, values, window=window)
    return refined(spectrum, values, peaks(spectrum, count, (3 / LENGTH, 40)), step_error)


@pytest.mark.parametrize(("window", "wider"), [("boxcar", (1.0, 1.0)), ("hann", (HANN, np.sqrt(1.5)))])
def test_the_error_is_the_bound_by_the_window(window, wider):
    """Boxcar: sd(A) = s sqrt(2 / N), sd(f) = s sqrt(6 / N) / (pi A T); Hann: by integrals of its powers."""
    off, stated = [], []
    for seed in range(100):
        rng = np.random.default_rng(seed)
        frequency, phase = rng.uniform(3, 12), rng.uniform(0, 2 * np.pi)
        values = 2 * np.sin(2 * np.pi * frequency * TIME + phase) + NOISE * rng.standard_normal(COUNT)
        (line,) = lines_of(values, 1, window)
        off.append([line.frequency - frequency, line.amplitude - 2])
        stated.append([line.frequency_sd, line.amplitude_sd])
    bound = np.multiply(wider, [NOISE * np.sqrt(6 / COUNT) / (np.pi * 2 * LENGTH), NOISE * np.sqrt(2 / COUNT)])
    found, what = np.sqrt(np.square(stated).mean(0)), f"standard errors of a line, {window} window"
    agrees(found, bound, "vibration", what, "Cramer-Rao bound", rtol=0.05)
    for name, count in zip(("frequency", "amplitude"), (np.abs(off) <= 2 * np.array(stated)).sum(0), strict=True):
        what = f"{name} of a line within 2 std. errors, {window} window"
        counted(count, 100, 90, 100, "verdict rates", what, "normal distribution", expected=95.45)
    assert (2 * np.sqrt(np.square(stated).mean(0) / np.square(off).mean(0)) <= 2.5).all()


def test_noise_counts_where_the_line_is():
    """A floor that is twenty times as high above 20 Hz leaves the error of a line at 5 Hz as it is."""
    rng = np.random.default_rng(1)
    quiet = np.sin(2 * np.pi * 5.03 * TIME) + 0.01 * rng.standard_normal(COUNT)
    loud = np.fft.rfft(0.2 * rng.standard_normal(COUNT))
    loud[np.fft.rfftfreq(COUNT, 1 / RATE) < 20] = 0
    (alone,), (beside,) = lines_of(quiet, 1), lines_of(quiet + np.fft.irfft(loud), 1)
    assert beside.frequency_sd == pytest.approx(alone.frequency_sd, rel=0.02)
    assert beside.amplitude == pytest.approx(alone.amplitude, abs=1e-4)


def test_neighbours_do_not_disturb_each_other():
    """Three bins apart, where the parabola through the largest bins is off by more than a tenth of a bin."""
    values = np.sin(2 * np.pi * 5.0 * TIME + 1) + 0.8 * np.sin(2 * np.pi * 5.16 * TIME + 2)
    first, second = lines_of(values, 2)
    found = (first.frequency, first.amplitude, second.frequency, second.amplitude)
    what, source = "two lines three bins apart", "the sines"
    agrees(found, (5.0, 1.0, 5.16, 0.8), "vibration", what, source, rtol=1e-6)


def test_a_line_that_sweeps_has_a_large_error_and_stays_in_its_place():
    """From 4 to 6 Hz: peaks keep their order and a bin's distance at most; a steady line's error is far smaller."""
    values = np.sin(2 * np.pi * (4 * TIME + 0.05 * TIME**2))
    spectrum = amplitude_spectrum(TIME, values)
    found = peaks(spectrum, 5, (3 / LENGTH, 40))
    lines = refined(spectrum, values, found)
    assert len(lines) == len(found)
    for before, after in zip(sorted(p.frequency for p in found), sorted(p.frequency for p in lines), strict=True):
        assert abs(after - before) <= spectrum.resolution * (1 + 1e-9)
    (steady,) = lines_of(np.sin(2 * np.pi * 5 * TIME) + 0.01 * np.random.default_rng(1).standard_normal(COUNT), 1)
    assert all(line.amplitude_sd > 0.2 * line.amplitude for line in lines)
    assert all(line.frequency_sd > 50 * steady.frequency_sd for line in lines)


def test_the_clock_is_an_error_of_the_frequency():
    (line,) = lines_of(np.sin(2 * np.pi * 5 * TIME), 1, step_error=1e-4)
    assert line.frequency_sd == pytest.approx(5e-4, rel=1e-3)


def test_averaged_segments_keep_their_peaks_without_an_error():
    values = np.sin(2 * np.pi * 5 * TIME)
    spectrum = amplitude_spectrum(TIME, values, segments=4)
    (peak,) = peaks(spectrum, 1)
    assert refined(spectrum, values, (peak,)) == (peak,)
    assert np.isnan(peak.frequency_sd)
    assert refined(spectrum, values, ()) == ()


def test_a_flat_top_is_fitted_like_a_hann_window():
    (line,) = lines_of(np.sin(2 * np.pi * 5.012 * TIME), 1, "flattop")
    assert (line.frequency, line.amplitude) == pytest.approx((5.012, 1.0), rel=1e-6)
