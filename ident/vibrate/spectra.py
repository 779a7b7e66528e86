"""Amplitude spectra of sampled traces, and what every spectrum demands of a trace.

Amplitude spectra in physical units: how large is the vibration, and at which frequency.

References:
    Heinzel, Ruediger, Schilling, "Spectrum and spectral density estimation by the DFT", 2002, sections 8 and 9.
    Brandt, "Noise and Vibration Analysis", 2nd ed., 2023, chapters 9 and 10.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Float
from numpy.typing import ArrayLike

from ident.errors import Problem, refusal, refuse
from ident.text import no_such

# -------- Series
# Sampled traces as they come in: what every spectrum demands of them, checked once.

UNIFORM = 1e-2
"""Largest deviation of a time step from the mean step, relative to it.

Times written with six digits deviate by 0.5 % at 500 samples a second for 10 s, and `ident.measure` admits as much.
As jitter it is noise of 1 % of a sine at a quarter of the sampling rate; as drift it spreads a peak over 1 % of its
frequency.
"""
SHORTEST = 16
"""Samples below which a trace or a segment is too short for a spectrum."""


@dataclass(frozen=True)
class Samples:
    """A trace that is uniformly sampled and has no gaps.

    Attributes:
        time: (T,) [s] ascending, uniform within UNIFORM.
        values: (T, ...) [any] finite.
    """

    time: Float[np.ndarray, "T"]
    values: Float[np.ndarray, "T *D"]

    @property
    def step(self) -> float:
        """Mean time step [s]."""
        return float(self.time[-1] - self.time[0]) / (len(self.time) - 1)

    @property
    def rate(self) -> float:
        """Sampling rate [Hz]."""
        return 1.0 / self.step


def samples(time: ArrayLike, values: ArrayLike) -> Samples:
    """Check a trace.

    Args:
        time: (T,) [s].
        values: (T, ...) [any] one row for each time.

    Returns:
        The trace in double precision.
    """
    t, x = np.asarray(time, float), np.asarray(values, float)
    for problems in (_shape_problems(t, x), _gaps(t, x), _uneven(t)):
        refuse(problems)
    return Samples(t, x)


def band_problems(low: float, high: float) -> Iterator[Problem]:
    """Yield the problems of a frequency band [Hz]."""
    if not 0 <= low < high:
        yield Problem("band", f"{low:g} to {high:g} Hz", "0 <= low < high", "give the lower frequency first")


def _shape_problems(time: np.ndarray, values: np.ndarray) -> Iterator[Problem]:
    if time.ndim != 1:
        yield Problem("time", f"an array of shape {time.shape}", "one dimension", "give one time for each sample")
    elif values.shape[:1] != time.shape:
        got, expected = f"an array of shape {values.shape}", f"{len(time)} samples along the first axis, as in time"
        yield Problem("values", got, expected, "transpose it, or give times and values of the same samples")
    elif len(time) < SHORTEST:
        yield Problem("time", f"{len(time)} samples", f"at least {SHORTEST}", "give a longer trace")


def _gaps(time: np.ndarray, values: np.ndarray) -> Iterator[Problem]:
    for name, array in (("time", time), ("values", values)):
        bad = np.argwhere(~np.isfinite(array))
        if len(bad):
            got = f"{array[tuple(bad[0])]} at sample {bad[0][0]}, {len(bad)} such in all"
            yield Problem(name, got, "finite numbers", "cut the trace where it has a gap, or fill the gap yourself")


def _uneven(time: np.ndarray) -> Iterator[Problem]:
    steps, mean = np.diff(time), (time[-1] - time[0]) / (len(time) - 1)
    worst = int(np.argmax(np.abs(steps - mean)))
    if mean <= 0:
        yield Problem("time", f"a mean step of {mean:.4g} s", "ascending times", "sort the samples by time")
    elif abs(steps[worst] - mean) > UNIFORM * mean:
        got = f"a step of {steps[worst]:.6g} s after sample {worst}"
        yield Problem("time", got, f"uniform steps of {mean:.6g} s", "resample the trace to uniform steps")


# -------- Windows
# Windows by name, with the two numbers that a reader of a spectrum needs: gain and noise bandwidth.

WINDOWS = {
    "boxcar": "rectangular",
    "hann": "Hann",
    "hamming": "Hamming",
    "blackmanharris": "Blackman-Harris",
    "flattop": "flat-top",
}
"""SciPy's names of the windows, and how people write them."""


def window_samples(window: str, count: int) -> Float[np.ndarray, "N"]:
    """Return the periodic (DFT-even) form of a window, (N,) [-]."""
    from scipy.signal import get_window

    if window not in WINDOWS:
        raise no_such("window", window, WINDOWS, "hann suits most traces")
    return np.asarray(get_window(window, count, fftbins=True))


def noise_bandwidth(weights: Float[np.ndarray, "N"]) -> float:
    """Return a window's equivalent noise bandwidth in bins, N sum(w^2) / sum(w)^2: 1 for boxcar, 1.5 for Hann.

    References:
        Harris, "On the use of windows for harmonic analysis with the DFT", Proc. IEEE 66 (1978), eq. (11).
    """
    return len(weights) * float(np.sum(weights**2)) / float(np.sum(weights)) ** 2


def averaging_words(window: str, segments: str, overlap: float, resolution: float, bandwidth: float) -> str:
    """Say window, segments and resolution on one line, for a figure."""
    overlapping = f", {100 * overlap:.0f} % overlap" if overlap else ""
    widths = f"resolution {_digits(resolution, 2)} Hz, ENBW {_digits(bandwidth, 2)} Hz"
    return f"{WINDOWS[window]} window, {segments} of {_digits(1 / resolution, 3)} s{overlapping}, {widths}"


def _digits(value: float, count: int) -> str:
    return f"{value:#.{count}g}".rstrip(".")


# -------- Spectrum
# Amplitudes in the unit of the trace, by a window, averaged over segments.


OVERLAP = 0.5
"""Share of a segment that the next one has in common with it: suits the Hann window."""


@dataclass(frozen=True)
class Spectrum:
    """A one-sided amplitude spectrum: a sine of amplitude A on a bin shows as A, whatever the window.

    Attributes:
        frequency: (F,) [Hz] from zero to half the sampling rate.
        amplitude: (F, ...) [unit of the values] peak amplitude, not rms.
        resolution: [Hz] spacing of the bins, the inverse of a segment's duration.
        bandwidth: [Hz] equivalent noise bandwidth of the window.
        window: name of the window.
        segments: number of segments that were averaged, in power.
        overlap: [-] share of a segment that the next one has in common with it.
        length: samples of a segment.
    """

    frequency: Float[np.ndarray, "F"]
    amplitude: Float[np.ndarray, "F *D"]
    resolution: float
    bandwidth: float
    window: str
    segments: int
    overlap: float
    length: int

    @property
    def power(self) -> Float[np.ndarray, "F *D"]:
        """(F, ...) [squared unit of the values] mean square of the sine in each bin."""
        return self.amplitude**2 / _square_per_power(self.length).reshape(-1, *[1] * (self.amplitude.ndim - 1))

    def column(self, index: int) -> "Spectrum":
        """Return the spectrum of one of several traces, such as one direction."""
        return replace(self, amplitude=self.amplitude[:, index])

    def description(self) -> str:
        """Say on one line what a reader must know to read the amplitudes."""
        count = f"mean power of {self.segments} segments" if self.segments > 1 else "1 segment"
        overlap = self.overlap if self.segments > 1 else 0.0
        return averaging_words(self.window, count, overlap, self.resolution, self.bandwidth)


@dataclass(frozen=True)
class Peak:
    """A local maximum of a spectrum.

    Attributes:
        frequency: [Hz] between the bins.
        amplitude: [unit of the values].
        frequency_sd: [Hz] standard error, of a peak refined as a line, see `lines.refined`.
        amplitude_sd: [unit of the values].
    """

    frequency: float
    amplitude: float
    frequency_sd: float = np.nan
    amplitude_sd: float = np.nan


def amplitude_spectrum(time: ArrayLike, values: ArrayLike, *, window: str = "hann", segments: int = 1) -> Spectrum:
    """Return the one-sided amplitude spectrum of a trace, corrected for the window's coherent gain.

    A sine of amplitude A on a bin gives A; between two bins a Hann window gives down to 0.85 A (scalloping, 1.42 dB):
    `peaks` mends most of that. Each segment's mean is taken off before the window. Segments are averaged in power:
    that steadies noise, and widens the bins in proportion. What decays within a segment shows lower than its peak.
    They overlap by half. Samples that do not fill the last segment, fewer than there are segments, are left out.

    Args:
        time: (T,) [s] uniform, see `series.samples`.
        values: (T, ...) [any].
        window: hann, or another of `windows.WINDOWS`.
        segments: number of segments.

    Returns:
        The spectrum, in the values' own unit.

    References:
        Welch, IEEE Trans. Audio Electroacoust. 15 (1967). Heinzel et al., 2002, eqs. (19), (23).
    """
    from scipy.signal import welch  # long to import, as all of that: a simulation alone needs none

    trace = samples(time, values)
    length, step = _segment(len(trace.time), segments)
    weights = window_samples(window, length)
    values = trace.values[: length + (segments - 1) * step]
    how: Any = {"window": weights, "noverlap": length - step, "detrend": "constant", "scaling": "spectrum", "axis": 0}
    frequency, power = welch(values, trace.rate, **how)
    ratio = _square_per_power(length).reshape(-1, *[1] * (power.ndim - 1))
    resolution = trace.rate / length
    bandwidth = noise_bandwidth(weights) * resolution
    return Spectrum(
        frequency, np.sqrt(ratio * power), resolution, bandwidth, window, segments, 1 - step / length, length
    )


def peaks(spectrum: Spectrum, count: int, between: tuple[float, float] = (0.0, np.inf)) -> tuple[Peak, ...]:
    """Return the largest local maxima, the largest first, refined by a parabola through three logarithms.

    For a steady sine and a Hann window the frequency is within 0.02 bins, and the amplitude up to 4 % too large midway
    between bins. Side lobes of the window and noise are maxima as well: a maximum far below the first may be either.

    Args:
        spectrum: of a single trace.
        count: largest number of peaks to return; there may be fewer.
        between: [Hz] band in which the refined frequencies lie.

    References:
        Smith, Serra, "PARSHL", Proc. ICMC 1987. Brandt, 2nd ed., section 9.3.
    """
    from scipy.signal import find_peaks

    if spectrum.amplitude.ndim != 1:
        got, remedy = f"amplitudes of shape {spectrum.amplitude.shape}", "choose one with spectrum.column(i)"
        raise refusal("spectrum", got, "a single trace", remedy)
    refuse(band_problems(*between))
    places, _ = find_peaks(spectrum.amplitude)
    outside = np.abs(spectrum.frequency[places] - np.clip(spectrum.frequency[places], *between))
    refined = [_refined(spectrum, int(place)) for place in places[outside <= spectrum.resolution]]
    inside = [peak for peak in refined if between[0] <= peak.frequency <= between[1]]
    return tuple(sorted(inside, key=lambda peak: -peak.amplitude)[:count])


def band_rms(spectrum: Spectrum, low: float, high: float) -> Float[np.ndarray, "*D"]:
    """Return the rms of what lies in a band, low <= f < high: sqrt(sum of the bins' power / noise bandwidth in bins).

    Over all frequencies it is the rms about the mean (Parseval), each sample weighted by the window squared; with
    "boxcar" and one segment exactly that of the trace. Powers of adjacent bands add up. A sine closer to an end of the
    band than the window's main lobe (2 bins with Hann) counts in part.

    Args:
        spectrum: of one or more traces.
        low: [Hz].
        high: [Hz].

    Returns:
        (...) [unit of the values].

    References:
        Heinzel et al., 2002, section 9. Brandt, 2nd ed., section 10.3.
    """
    inside = (spectrum.frequency >= low) & (spectrum.frequency < high)
    refuse(band_problems(low, high))
    if not inside.any():
        expected = f"a band within 0 to {spectrum.frequency[-1]:g} Hz, wider than {spectrum.resolution:.3g} Hz"
        remedy = "widen the band, or take fewer segments or a longer trace"
        raise refusal("band", f"no bin from {low:g} to {high:g} Hz", expected, remedy)
    bins = spectrum.bandwidth / spectrum.resolution
    return np.asarray(np.sqrt(spectrum.power[inside].sum(axis=0) / bins))


def trace_band_rms(time: ArrayLike, values: ArrayLike, low: float, high: float) -> Float[np.ndarray, "*D"]:
    """Return the rms of a trace within a band, all its samples counted alike: `band_rms` without window.

    Without a window a drift or a jump from end to beginning leaks into all bands, in proportion to 1/f.
    """
    return band_rms(amplitude_spectrum(time, values, window="boxcar"), low, high)


def _segment(total: int, segments: int) -> tuple[int, int]:
    """Return length of the segments and step from one to the next, so that they fill the trace."""
    length = int(total / (1 + (max(segments, 1) - 1) * (1 - OVERLAP)))
    if segments < 1:
        raise refusal("segments", f"{segments}", "at least 1", "1 gives the finest resolution")
    if length < SHORTEST:
        got, expected = f"{segments} segments of {length} samples, from {total}", f"at least {SHORTEST} samples in each"
        raise refusal("segments", got, expected, "ask for fewer segments")
    return length, max(1, length - int(OVERLAP * length))


def _square_per_power(length: int) -> np.ndarray:
    """Return squared amplitude by mean square, (F,): 2 for a sine, 1 at zero and at the Nyquist frequency."""
    ratio = np.full(length // 2 + 1, 2.0)
    ratio[[0, -1] if length % 2 == 0 else 0] = 1.0
    return ratio


def _refined(spectrum: Spectrum, place: int) -> Peak:
    """Return the vertex of the parabola through the logarithms of a bin and its neighbours."""
    around = np.maximum(spectrum.amplitude[place - 1 : place + 2], np.finfo(float).tiny)
    left, middle, right = np.log(around)
    curvature = left - 2 * middle + right
    shift = 0.5 * (left - right) / curvature if curvature < 0 else 0.0
    frequency = spectrum.frequency[place] + shift * spectrum.resolution
    return Peak(float(frequency), float(np.exp(middle - 0.25 * (left - right) * shift)))


# -------- Spectrogram
# Amplitude over time and frequency: how a vibration wanders and grows while the arm moves.

SEGMENT_OVERLAP = 0.75
"""Share of a segment that the next one has in common with it."""


@dataclass(frozen=True)
class Spectrogram:
    """One-sided amplitudes over time: a steady sine of amplitude A on a bin shows as A in every column.

    Attributes:
        time: (B,) [s] middle of each segment, on the trace's own clock.
        frequency: (F,) [Hz] from zero to half the sampling rate.
        amplitude: (F, B, ...) [unit of the values] peak amplitude, not rms.
        step: [s] from one segment to the next.
        resolution: [Hz] spacing of the bins, the inverse of a segment's duration.
        bandwidth: [Hz] equivalent noise bandwidth of the window.
        window: name of the window.
    """

    time: Float[np.ndarray, "B"]
    frequency: Float[np.ndarray, "F"]
    amplitude: Float[np.ndarray, "F B *D"]
    step: float
    resolution: float
    bandwidth: float
    window: str

    def column(self, index: int) -> "Spectrogram":
        """Return the spectrogram of one of several traces, such as one direction."""
        return replace(self, amplitude=self.amplitude[:, :, index])

    def description(self) -> str:
        """Say on one line what a reader must know to read the amplitudes."""
        overlap = 1 - self.step * self.resolution
        return averaging_words(self.window, "segments", overlap, self.resolution, self.bandwidth)


def spectrogram(time: ArrayLike, values: ArrayLike, *, window: str = "hann", segment_seconds: float) -> Spectrogram:
    """Return the amplitudes of a trace in short segments, corrected for the window's coherent gain.

    Only segments that lie wholly in the trace count, so the first and last half segment have no column of their own.
    Each segment's mean is taken off. A sine whose frequency runs by r Hz/s is spread over r segment_seconds, and
    shows lower than it is as soon as that exceeds the bandwidth: no segment length shows both exactly.

    Args:
        time: (T,) [s] uniform, see `series.samples`.
        values: (T, ...) [any].
        window: hann, or another of `windows.WINDOWS`.
        segment_seconds: [s] duration of a segment, rounded to whole samples; the resolution is its inverse.

    Returns:
        The spectrogram, in the values' own unit.

    References:
        Brandt, "Noise and Vibration Analysis", 2nd ed., 2023, section 11.1. Heinzel et al., 2002, section 8.
    """
    from scipy.signal import ShortTimeFFT

    trace = samples(time, values)
    shortest, longest = SHORTEST * trace.step, len(trace.time) * trace.step / 2
    if not shortest <= segment_seconds <= longest * (1 + 1e-9):
        expected = f"{shortest:.3g} s ({SHORTEST} samples) to {longest:.4g} s (half the trace)"
        remedy = "a second or two tells vibrations of some Hz apart"
        raise refusal("segment_seconds", f"{segment_seconds:g} s", expected, remedy)
    length = round(segment_seconds * trace.rate)
    hop = max(1, length - int(SEGMENT_OVERLAP * length))
    weights = window_samples(window, length)
    transform = ShortTimeFFT(weights, hop, trace.rate, fft_mode="onesided2X", scale_to="magnitude")
    # slice p has its middle at sample p hop: from the first to the last that needs no padding
    places = np.arange(-(-(length // 2) // hop), (len(trace.time) - length + length // 2) // hop + 1)
    complex_amplitude = transform.stft_detrend(trace.values, "constant", places[0], places[-1] + 1, axis=0)
    amplitude = np.moveaxis(np.abs(complex_amplitude), -1, 1)
    middles = trace.time[0] + places * hop * trace.step
    resolution = trace.rate / length
    bandwidth = noise_bandwidth(weights) * resolution
    return Spectrogram(middles, transform.f, amplitude, hop * trace.step, resolution, bandwidth, window)
