import math

import numpy as np
import pytest
from conformance import agrees

from ident.errors import InputError
from ident.vibrate.compare import second_derivative
from ident.vibrate.spectra import WINDOWS, amplitude_spectrum, band_rms, peaks, spectrogram, trace_band_rms

RATE = 200.0
TIME = np.arange(2000) / RATE
"""Ten seconds: bins 0.1 Hz apart."""
A = 2e-3


def sine(frequency, amplitude=A, phase=0.3, time=TIME):
    return amplitude * np.sin(2 * np.pi * frequency * time + phase)


@pytest.mark.parametrize("window", WINDOWS)
def test_a_sine_on_a_bin_keeps_its_amplitude(window):
    spectrum = amplitude_spectrum(TIME + 7.0, sine(5.0) + 3.0, window=window)
    what = "amplitude of a sine on a bin, every window"
    agrees(spectrum.amplitude[50], A, "vibration", what, "the sine", rtol=1e-9, unit="m")
    assert spectrum.frequency[50] == pytest.approx(5.0)
    assert spectrum.amplitude[0] < 1e-9  # the mean of 3.0 is off


@pytest.mark.parametrize("segments", [1, 4])
def test_a_sine_between_bins_loses_no_more_than_the_scalloping_of_the_window(segments):
    length = 2000 if segments == 1 else 800
    spectrum = amplitude_spectrum(TIME, sine(RATE * 30.5 / length), segments=segments)
    loss = -20 * math.log10(spectrum.amplitude.max() / A)
    what, source = "scalloping loss of a Hann window", "Harris 1978"
    agrees(loss, 1.42, "vibration", what, source, atol=0.01, unit="dB")


@pytest.mark.parametrize("off", [0.0, 0.1, 0.25, 0.4, 0.5])
def test_peaks_are_refined_between_bins(off):
    spectrum = amplitude_spectrum(TIME, sine(5.0 + 0.1 * off))
    (peak,) = peaks(spectrum, 1)
    assert peak.frequency == pytest.approx(5.0 + 0.1 * off, abs=0.02 * spectrum.resolution)
    assert 1 - 1e-6 < peak.amplitude / A < 1.04


def test_peaks_come_by_size_and_within_the_band():
    spectrum = amplitude_spectrum(TIME, sine(4.0) + sine(7.0, 3 * A) + sine(12.0, 2 * A))
    assert [peak.frequency for peak in peaks(spectrum, 3)] == pytest.approx([7.0, 12.0, 4.0], abs=1e-3)
    assert [peak.frequency for peak in peaks(spectrum, 1, between=(3.0, 5.0))] == pytest.approx([4.0], abs=1e-3)
    assert peaks(amplitude_spectrum(TIME, np.zeros(2000)), 3) == ()


def test_the_nyquist_bin_counts_once():
    spectrum = amplitude_spectrum(TIME, A * np.cos(np.pi * np.arange(2000)), window="boxcar")
    assert spectrum.amplitude[-1] == pytest.approx(A)
    assert band_rms(spectrum, 0.0, 1e9) == pytest.approx(A)


@pytest.mark.parametrize("count", [1999, 2000])
def test_parseval_for_each_column(count):
    noise = np.random.default_rng(1).normal(size=(count, 3)) * [1.0, 2.0, 5.0]
    np.testing.assert_allclose(trace_band_rms(TIME[:count], noise, 0.0, 1e9), noise.std(axis=0), rtol=1e-12)
    hann = np.hanning(count + 1)[:-1]
    centred = (noise - noise.mean(axis=0)) * hann[:, None] / np.sqrt(np.mean(hann**2))
    rms = band_rms(amplitude_spectrum(TIME[:count], noise), 0.0, 1e9)
    expected, what = np.sqrt(np.mean(centred**2, axis=0)), "RMS of a spectrum over all bins"
    agrees(rms, expected, "vibration", what, "Parseval, in time", rtol=1e-12)


def test_adjacent_bands_add_up_and_a_sine_is_in_its_own():
    spectrum = amplitude_spectrum(TIME, sine(5.0) + sine(11.0, 3 * A))
    assert band_rms(spectrum, 4.0, 8.0) == pytest.approx(A / math.sqrt(2), rel=1e-3)
    edge = float(spectrum.frequency[50])
    parts = [band_rms(spectrum, low, high) for low, high in ((0.0, edge), (edge, 8.0), (8.0, 101.0))]
    assert math.hypot(*parts) == pytest.approx(band_rms(spectrum, 0.0, 101.0), rel=1e-12)


@pytest.mark.parametrize("segments", [1, 15])
def test_averaging_steadies_noise_as_welch_says(segments):
    """White noise: relative variance of the power is (1 + 2 c (K-1)/K) / K; Hann at half overlap: c = 1/36."""
    noise = np.random.default_rng(2).normal(size=(64_000, 20))
    spectrum = amplitude_spectrum(np.arange(64_000) / RATE, noise, segments=segments)
    assert spectrum.segments == segments
    power = spectrum.power[2:-2]
    expected = (1 + 2 / 36 * (segments - 1) / segments) / segments
    found, source = np.var(power) / np.mean(power) ** 2, "Welch 1967, (1 + 2 c (K-1)/K) / K"
    agrees(found, expected, "vibration", "variance of an averaged spectrum", source, rtol=0.04)
    # density: 2 sigma^2 / rate, whatever the segments
    density, what = np.mean(power) / spectrum.bandwidth, "density of white noise"
    agrees(density, 2 / RATE, "vibration", what, "2 sigma^2 / rate", rtol=0.01, unit="1/Hz")


def test_the_line_for_the_figure():
    assert (
        amplitude_spectrum(TIME, sine(5.0)).description()
        == "Hann window, 1 segment of 10.0 s, resolution 0.10 Hz, ENBW 0.15 Hz"
    )
    assert (
        amplitude_spectrum(TIME, sine(5.0), segments=3, window="flattop").description()
        == "flat-top window, mean power of 3 segments of 5.00 s, 50 % overlap, resolution 0.20 Hz, ENBW 0.75 Hz"
    )
    assert (
        spectrogram(TIME, sine(5.0), segment_seconds=1.5).description()
        == "Hann window, segments of 1.50 s, 75 % overlap, resolution 0.67 Hz, ENBW 1.0 Hz"
    )


def test_columns():
    both = amplitude_spectrum(TIME, np.stack([sine(5.0), sine(7.0)], axis=1))
    assert peaks(both.column(1), 1)[0].frequency == pytest.approx(7.0, abs=1e-3)


@pytest.mark.parametrize("seconds", [1.0, 1.005, 5.0])
def test_spectrogram_keeps_amplitude_and_time(seconds):
    growing = np.stack([sine(8.0, time=TIME) * TIME, sine(8.0)], axis=1)
    result = spectrogram(TIME + 3.0, growing + 4.0, segment_seconds=seconds)
    row = int(np.argmin(np.abs(result.frequency - 8.0)))
    assert result.amplitude.shape == (len(result.frequency), len(result.time), 2)
    # a linear growth stands at its value in the middle of the segment
    expected, what = A * (result.time - 3.0), "a sine that grows, in a spectrogram"
    agrees(result.amplitude[row, :, 0], expected, "vibration", what, "middle of each segment", rtol=0.01, unit="m")
    np.testing.assert_allclose(result.column(1).amplitude[row], A, rtol=0.005)
    assert result.column(1).amplitude[0].max() < 0.01 * A  # the mean is off
    assert result.time[0] - seconds / 2 >= 3.0 - 1 / RATE
    assert result.time[-1] + seconds / 2 <= 13.0 + 1 / RATE
    assert np.diff(result.time) == pytest.approx(result.step)


def test_second_derivative_against_closed_form():
    w, v = 2 * np.pi * 3.0, 2 * np.pi * 7.3
    values = np.stack([np.cos(w * TIME + 1) + 0.2 * np.sin(v * TIME) + 1 + TIME, TIME**3], axis=1)
    exact = np.stack([-(w**2) * np.cos(w * TIME + 1) - 0.2 * v**2 * np.sin(v * TIME), 6 * TIME], axis=1)
    size = np.abs(exact).max(axis=0)
    found, exact = second_derivative(TIME, values) / size, exact / size
    error = np.abs(found - exact)
    assert error.max() < 0.01
    what = "second derivative of a trace, over its peak"
    agrees(found[20:-20], exact[20:-20], "vibration", what, "closed form", atol=1e-5)
    assert error[:, 1].max() < 1e-6


GAP = np.where(np.arange(2000) == 17, np.nan, 0.0)


@pytest.mark.parametrize(
    ("call", "text"),
    [
        (
            lambda: amplitude_spectrum(np.where(TIME > 5, TIME + 0.01, TIME), sine(5.0)),
            "time: got a step of 0.015 s after sample 1000, expected uniform steps of 0.005005 s; "
            "resample the trace to uniform steps",
        ),
        (lambda: amplitude_spectrum(TIME[::-1], sine(5.0)), "got a mean step of -0.005 s, expected ascending times"),
        (lambda: amplitude_spectrum(TIME, GAP), "values: got nan at sample 17, 1 such in all, expected finite"),
        (lambda: amplitude_spectrum(TIME + GAP, sine(5.0)), "time: got nan at sample 17"),
        (lambda: amplitude_spectrum(TIME[:-1], sine(5.0)), "values: got an array of shape (2000,), expected 1999"),
        (lambda: amplitude_spectrum(np.ones((9, 2)), np.ones(9)), "time: got an array of shape (9, 2)"),
        (lambda: amplitude_spectrum(TIME[:15], TIME[:15]), "time: got 15 samples, expected at least 16"),
        (lambda: amplitude_spectrum(TIME, TIME, window="han"), "window: got 'han', expected one of boxcar, hann"),
        (lambda: amplitude_spectrum(TIME, TIME, window="han"), "did you mean hann?"),
        (lambda: amplitude_spectrum(TIME, TIME, segments=0), "segments: got 0, expected at least 1"),
        (lambda: amplitude_spectrum(TIME, TIME, segments=300), "got 300 segments of 13 samples, from 2000"),
        (lambda: peaks(amplitude_spectrum(TIME, np.ones((2000, 2))), 1), "choose one with spectrum.column(i)"),
        (lambda: peaks(amplitude_spectrum(TIME, TIME), 1, (8.0, 4.0)), "band: got 8 to 4 Hz, expected 0 <= low < high"),
        (lambda: band_rms(amplitude_spectrum(TIME, TIME), 4.01, 4.09), "band: got no bin from 4.01 to 4.09 Hz"),
        (lambda: band_rms(amplitude_spectrum(TIME, TIME), 200, 300), "expected a band within 0 to 100 Hz, wider than"),
        (lambda: spectrogram(TIME, TIME, segment_seconds=0.05), "segment_seconds: got 0.05 s, expected 0.08 s"),
        (lambda: spectrogram(TIME, TIME, segment_seconds=6.0), "to 5 s (half the trace)"),
    ],
)
def test_what_is_refused_and_how(call, text):
    with pytest.raises(InputError) as error:
        call()
    assert text in str(error.value)


def test_steps_may_differ_by_one_percent():
    """Amplitudes of what is sampled at the uneven times hold; beyond that it is refused."""
    uneven = TIME + 0.0049 * 0.005 * np.random.default_rng(0).uniform(-1, 1, 2000)
    for frequency in (5.0, 50.0):
        sampled = A * np.sin(2 * np.pi * frequency * uneven)
        spectrum = amplitude_spectrum(uneven, sampled)
        on_it = np.isclose(spectrum.frequency, frequency, atol=0.2)
        assert spectrum.amplitude.max() == pytest.approx(A, rel=1e-4)
        assert spectrum.amplitude[~on_it].max() < 1e-3 * A
    with pytest.raises(InputError, match=r"expected uniform steps of 0\.005"):
        amplitude_spectrum(TIME + 0.011 * 0.005 * (np.arange(2000) == 1000), sine(5.0))
