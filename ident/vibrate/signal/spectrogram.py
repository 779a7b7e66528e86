"""Amplitude over time and frequency: how a vibration wanders and grows while the arm moves."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float
from numpy.typing import ArrayLike
from scipy.signal import ShortTimeFFT

from ident.errors import Problem
from ident.vibrate.signal.series import SHORTEST, Samples, refuse, samples
from ident.vibrate.signal.windows import averaging_words, noise_bandwidth, overlap_problems, window_samples


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


def spectrogram(
    time: ArrayLike, values: ArrayLike, *, window: str = "hann", segment_seconds: float, overlap: float = 0.75
) -> Spectrogram:
    """Return the amplitudes of a trace in short segments, corrected for the window's coherent gain.

    Only segments that lie wholly in the trace count, so the first and last half segment have no column of their own.
    Each segment's mean is taken off. A sine whose frequency runs by r Hz/s is spread over r segment_seconds, and
    shows lower than it is as soon as that exceeds the bandwidth: no segment length shows both exactly.

    Args:
        time: (T,) [s] uniform, see `series.samples`.
        values: (T, ...) [any].
        window: hann, or another of `windows.WINDOWS`.
        segment_seconds: [s] duration of a segment, rounded to whole samples; the resolution is its inverse.
        overlap: [-] share of a segment that the next one has in common with it.

    Returns:
        The spectrogram, in the values' own unit.

    References:
        Brandt, "Noise and Vibration Analysis", 2nd ed., 2023, section 11.1. Heinzel et al., 2002, section 8.
    """
    trace = samples(time, values)
    refuse([*_length_problems(trace, segment_seconds), *overlap_problems(overlap)])
    length = round(segment_seconds * trace.rate)
    hop = max(1, length - int(overlap * length))
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


def _length_problems(trace: Samples, seconds: float) -> Iterator[Problem]:
    shortest, longest = SHORTEST * trace.step, len(trace.time) * trace.step / 2
    if not shortest <= seconds <= longest * (1 + 1e-9):
        expected = f"{shortest:.3g} s ({SHORTEST} samples) to {longest:.4g} s (half the trace)"
        remedy = "a second or two tells vibrations of some Hz apart"
        yield Problem("segment_seconds", f"{seconds:g} s", expected, remedy)
