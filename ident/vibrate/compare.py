"""Simulated against measured vibration: sizes, frequencies and spectra of two traces, side by side."""

from dataclasses import dataclass
from fractions import Fraction
from typing import Literal

import numpy as np
from jaxtyping import Float
from numpy.typing import ArrayLike

from ident.errors import refusal, refuse
from ident.vibrate.spectra import (
    SHORTEST,
    Peak,
    Samples,
    Spectrum,
    amplitude_spectrum,
    band_problems,
    peaks,
    samples,
    trace_band_rms,
)

# -------- Derivative
# From displacement to acceleration: the second derivative of a sampled trace, by its spectrum.


def second_derivative(time: ArrayLike, values: ArrayLike) -> Float[np.ndarray, "T *D"]:
    """Return the second time derivative of a trace: each sine of its series times -(2 pi f)^2.

    A sine series alone would bend the trace straight at both ends. So a cubic with the trace's ends and end curvatures
    is taken off first, and its own second derivative, a straight line, put back. Exact up to the Nyquist frequency
    away from the ends; at the ends as good as the curvature of a cubic spline there.

    Args:
        time: (T,) [s] uniform, see `series.samples`.
        values: (T, ...) [m].

    Returns:
        (T, ...) [m/s^2].

    References:
        Lanczos, "Discourse on Fourier Series", 1966, section 16. Brandt, 2nd ed., 2023, section 3.4.
    """
    from scipy.fft import dst, idst
    from scipy.interpolate import CubicSpline

    trace = samples(time, values)
    ends, duration = trace.time[[0, -1]], trace.time[-1] - trace.time[0]
    s = ((trace.time - ends[0]) / duration).reshape(-1, *[1] * (trace.values.ndim - 1))
    first, last = CubicSpline(trace.time, trace.values)(ends, 2)
    bent = duration**2 * (first * (s**2 / 2 - s**3 / 6) + last * s**3 / 6)
    rest = trace.values - bent
    rest = rest - rest[0] - s * (rest[-1] - rest[0])
    frequency = (np.arange(1, len(s) - 1) / (2 * duration)).reshape(-1, *[1] * (trace.values.ndim - 1))
    series = -((2 * np.pi * frequency) ** 2) * dst(rest[1:-1], type=1, axis=0)
    second = first * (1 - s) + last * s
    second[1:-1] += idst(series, type=1, axis=0)
    return second


# -------- Compare

Quantity = Literal["displacement", "acceleration"]


@dataclass(frozen=True)
class Trace:
    """A vibration in one direction.

    Attributes:
        time: (T,) [s] uniform, see `series.samples`.
        values: (T,) [m] or [m/s^2].
        quantity: displacement or acceleration.
    """

    time: Float[np.ndarray, "T"]
    values: Float[np.ndarray, "T"]
    quantity: Quantity = "displacement"


@dataclass(frozen=True)
class Size:
    """How large a vibration is, about its mean over the common time.

    Attributes:
        trace: on the common times.
        peak: [unit] largest deviation from the mean.
        rms: [unit] about the mean.
        band_rms: [unit] within the band, all samples counted alike.
        dominant: largest peak of the spectrum within the band; None where it has none there.
        spectrum: amplitude spectrum.
    """

    trace: Trace
    peak: float
    rms: float
    band_rms: float
    dominant: Peak | None
    spectrum: Spectrum


@dataclass(frozen=True)
class Comparison:
    """Two vibrations as the same quantity, over the same time, at the same sampling.

    Attributes:
        simulated: size of the simulated vibration.
        measured: size of the measured one.
        band: [Hz] the band that was looked at.
    """

    simulated: Size
    measured: Size
    band: tuple[float, float]

    @property
    def peak_ratio(self) -> float:
        """Simulated by measured peak [-]."""
        return self.simulated.peak / self.measured.peak

    @property
    def rms_ratio(self) -> float:
        """Simulated by measured rms [-]."""
        return self.simulated.rms / self.measured.rms

    @property
    def band_rms_ratio(self) -> float:
        """Simulated by measured rms within the band [-]."""
        return self.simulated.band_rms / self.measured.band_rms


def compare(simulated: Trace, measured: Trace, *, band: tuple[float, float]) -> Comparison:
    """Compare a simulated with a measured vibration.

    Both are brought to the coarser sampling, behind a filter against aliasing, and cut to their common time. A
    simulated displacement is compared with a measured acceleration as acceleration: the simulation is differentiated
    twice, times (2 pi f)^2. The measurement is never integrated: that divides by (2 pi f)^2, so an accelerometer's
    offset, drift and slow noise grow without bound into metres of displacement, and a high-pass against it would
    decide the result. What is compared holds as far as both clocks agree; no time shift is looked for.

    Args:
        simulated: displacement, or what was measured.
        measured: displacement or acceleration.
        band: [Hz] lowest and highest frequency, for the dominant frequency and the rms in the band.

    Returns:
        Sizes of both, and their ratios.
    """
    from scipy.interpolate import make_interp_spline

    if simulated.quantity == "acceleration" and measured.quantity == "displacement":
        remedy = "give the simulated displacement: neither trace is integrated"
        raise refusal("simulated", "an acceleration", "a displacement, as was measured", remedy)
    refuse(band_problems(*band))
    ours, theirs = samples(simulated.time, simulated.values), samples(measured.time, measured.values)
    if simulated.quantity != measured.quantity:
        ours = Samples(ours.time, second_derivative(ours.time, ours.values))
    step = max(ours.step, theirs.step)
    time = _common(ours, theirs, step)
    ours, theirs = _coarser(ours, step), _coarser(theirs, step)
    time = time[time <= min(ours.time[-1], theirs.time[-1]) + 1e-6 * step]  # resampling ends up to a step earlier
    # quintic splines: exact at a trace's own instants, to 0.2 % up to half the Nyquist frequency
    both = (np.asarray(make_interp_spline(x.time, x.values, k=5)(time)) for x in (ours, theirs))
    sizes = [_size(Trace(time, values, measured.quantity), band) for values in both]
    if sizes[1].peak <= 1e-12 * np.abs(sizes[1].trace.values).max():
        remedy = "choose the direction or the time in which it moves"
        raise refusal("measured", "a constant", "a vibration", remedy)
    return Comparison(sizes[0], sizes[1], band)


def _size(trace: Trace, band: tuple[float, float]) -> Size:
    spectrum = amplitude_spectrum(trace.time, trace.values)
    about = trace.values - trace.values.mean()
    largest = peaks(spectrum, 1, band)
    peak, rms = float(np.abs(about).max()), float(np.sqrt(np.mean(about**2)))
    band_rms = float(trace_band_rms(trace.time, trace.values, *band))
    return Size(trace, peak, rms, band_rms, largest[0] if largest else None, spectrum)


def _coarser(trace: Samples, step: float) -> Samples:
    """Bring a trace to a step that is as long or longer, close enough for the rest to be interpolated."""
    from scipy.signal import resample_poly  # long to import, and only a measured trace needs it

    ratio = Fraction(trace.step / step).limit_denominator(1000)
    if ratio == 1:
        return trace
    up, down = ratio.numerator, ratio.denominator
    values = resample_poly(trace.values, up, down, padtype="line")
    return Samples(trace.time[0] + np.arange(len(values)) * trace.step * down / up, values)


def _common(one: Samples, other: Samples, step: float) -> np.ndarray:
    """Return times that both traces cover, at the coarser one's own instants."""
    grid = one if one.step > other.step else other
    start, stop = max(one.time[0], other.time[0]), min(one.time[-1], other.time[-1])
    slack = 1e-6 * step
    time = grid.time[(grid.time >= start - slack) & (grid.time <= stop + slack)]
    if len(time) < SHORTEST:
        spans = " and ".join(f"{x.time[0]:.4g} to {x.time[-1]:.4g} s" for x in (one, other))
        remedy = "shift the clock of one, or choose traces of the same motion"
        raise refusal("time", f"{spans}, {len(time)} samples in common", f"at least {SHORTEST}", remedy)
    return time
