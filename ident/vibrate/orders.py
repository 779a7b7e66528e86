"""Order tracking: how much of a vibration turns with a pulley, whatever its speed at the time."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float
from numpy.typing import ArrayLike
from scipy.interpolate import BSpline, PchipInterpolator, make_interp_spline
from scipy.signal import ShortTimeFFT, get_window

from ident.errors import Problem, refusal, refuse
from ident.vibrate.spectra import SHORTEST, Samples, averaging_words, noise_bandwidth, samples, window_samples

TURNING = 0.05
"""Share of the fastest turning rate below which the pulley counts as at rest; assumed."""
FAITHFUL = 0.5
"""Share of the Nyquist order up to which the interpolation keeps amplitudes to within 0.2 %."""


@dataclass(frozen=True)
class OrderTrack:
    """Amplitudes of orders, multiples of a pulley's turning frequency, over blocks of whole revolutions.

    Attributes:
        orders: (O,) [-].
        amplitude: (O, B, ...) [unit of the values] peak amplitude; NaN above half the Nyquist order.
        time: (B,) [s] when half of the block's revolutions are done.
        frequency: (B,) [Hz] mean turning frequency.
        revolutions: of a block; orders less than 2 / revolutions apart are not resolved.
    """

    orders: Float[np.ndarray, "O"]
    amplitude: Float[np.ndarray, "O B *D"]
    time: Float[np.ndarray, "B"]
    frequency: Float[np.ndarray, "B"]
    revolutions: int


def order_tracking(
    time: ArrayLike, values: ArrayLike, angle: ArrayLike, *, orders: Sequence[float], revolutions: int = 8
) -> OrderTrack:
    """Return the amplitudes of orders of a turning pulley, block by block.

    The trace is resampled to uniform steps of the angle, never coarser than its own steps of time, by a quintic
    spline; a DFT with a Hann window over the block's revolutions then gives a = 2 |sum w x exp(-i k angle)| / sum w.
    Used are the pieces over which the angle runs one way, faster than 5 % of its fastest; blocks follow each other
    without overlap, and what does not fill a block is left out.

    Limits: an order k at turning frequency f is at k f, which must stay below a quarter of the sampling rate; above
    that the amplitude is NaN. A resonance that is passed within a block is averaged over it.

    Args:
        time: (T,) [s] uniform, see `series.samples`.
        values: (T, ...) [any].
        angle: (T,) [rad] of the pulley, unwrapped; in either direction.
        orders: (O,) [-] multiples of the turning frequency; at least 2 / revolutions.
        revolutions: of a block.

    Returns:
        The amplitudes, in the values' own unit.

    References:
        Brandt, "Noise and Vibration Analysis", 2nd ed., 2023, chapter 12. Fyfe, Munck, "Analysis of computed order
        tracking", Mech. Syst. Signal Process. 11 (1997).
    """
    trace, turned = samples(time, values), samples(time, angle).values
    if turned.ndim != 1:
        got = f"an array of shape {turned.shape}"
        raise refusal("angle", got, "the angle of one pulley", "give one column")
    refuse(_order_problems(orders, revolutions))
    pieces = list(_pieces(turned))
    curve = make_interp_spline(trace.time, trace.values, k=5)
    tracked = np.asarray(orders, float)
    blocks = [block for piece in pieces for block in _blocks(trace, curve, turned, piece, tracked, revolutions)]
    if not blocks:
        most = max((abs(turned[p.stop - 1] - turned[p.start]) / (2 * np.pi) for p in pieces), default=0.0)
        remedy = "ask for fewer revolutions in a block, or give a longer motion; the angle is in rad"
        got, expected = f"at most {most:.3g} revolutions one way", f"a whole block of {revolutions}"
        raise refusal("angle", got, expected, remedy)
    amplitude, middle, frequency = zip(*blocks, strict=True)
    return OrderTrack(tracked, np.stack(amplitude, axis=1), np.array(middle), np.array(frequency), revolutions)


def _pieces(angle: np.ndarray) -> Iterator[slice]:
    """Yield the pieces over which the pulley turns one way."""
    steps = np.diff(angle)
    way = np.sign(steps) * (np.abs(steps) > TURNING * np.abs(steps).max())
    ends = np.flatnonzero(np.diff(way)) + 1
    for start, stop in zip([0, *ends], [*ends, len(steps)], strict=True):
        if way[start]:
            yield slice(int(start), int(stop) + 1)


def _blocks(
    trace: Samples, curve: BSpline, angle: np.ndarray, piece: slice, orders: np.ndarray, revolutions: int
) -> Iterator[tuple[np.ndarray, float, float]]:
    """Yield amplitudes, middle and turning frequency of each block of a piece."""
    turned = np.abs(angle[piece] - angle[piece.start])
    rates = np.diff(turned) / (2 * np.pi * trace.step)
    when = PchipInterpolator(turned, trace.time[piece])
    span = 2 * np.pi * revolutions
    for start in np.arange(int(turned[-1] / span)) * span:
        inside = (turned[1:] > start) & (turned[:-1] < start + span)
        slowest, fastest = rates[inside].min(), rates[inside].max()
        steps = revolutions * int(np.ceil(trace.rate / slowest))
        at = start + span * np.arange(steps) / steps
        weights, shown = get_window("hann", steps) / (steps / 2), curve(when(at))
        waves = weights * np.exp(-1j * orders[:, None] * at)
        amplitude = 2 * np.abs(np.tensordot(waves, shown - np.tensordot(weights, shown, 1), 1))
        amplitude[orders > FAITHFUL * trace.rate / 2 / fastest] = np.nan
        begin, middle, end = when([start, start + span / 2, start + span])
        yield amplitude, float(middle), revolutions / float(end - begin)


def _order_problems(orders: Sequence[float], revolutions: int) -> Iterator[Problem]:
    if revolutions < 1:
        yield Problem("revolutions", f"{revolutions}", "at least 1", "8 resolves orders a quarter apart")
    elif not len(orders):
        yield Problem("orders", "none", "one or more", "1 is the turning frequency itself")
    elif min(orders) < 2 / revolutions:
        remedy = "ask for more revolutions in a block, or drop the order"
        yield Problem("orders", f"{min(orders):g}", f"at least 2 / revolutions = {2 / revolutions:g}", remedy)


# -------- Spectrogram
# Amplitude over time and frequency: how a vibration wanders and grows while the arm moves.

OVERLAP = 0.75
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
    trace = samples(time, values)
    shortest, longest = SHORTEST * trace.step, len(trace.time) * trace.step / 2
    if not shortest <= segment_seconds <= longest * (1 + 1e-9):
        expected = f"{shortest:.3g} s ({SHORTEST} samples) to {longest:.4g} s (half the trace)"
        remedy = "a second or two tells vibrations of some Hz apart"
        raise refusal("segment_seconds", f"{segment_seconds:g} s", expected, remedy)
    length = round(segment_seconds * trace.rate)
    hop = max(1, length - int(OVERLAP * length))
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
