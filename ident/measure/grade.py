"""The grade of a channel by itself: rate, resolution, noise floor, clipping, and the band that can be trusted."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

CLIPPED = 4
"""A run of equal samples at the extreme counts as clipped from this length, and from this multiple of the longest run
elsewhere; assumed."""
SAMPLES_PER_PERIOD = 2.56
"""Sampling rate by the upper end of the band: the margin of a usual anti-alias filter."""
PERIODS_MIN = 2.0
"""Periods within the recording at the lower end of the band."""
STEPPED = 0.1
"""Largest deviation of a difference from a multiple of the resolution, relative to it, in 19 of 20 numbers."""


@dataclass(frozen=True)
class Grade:
    """What a channel is worth.

    Attributes:
        name: of the channel.
        kind: `displacement`, `velocity` or `acceleration` in SI; else the channel's own unit.
        rate: [Hz] sampling rate.
        duration: [s] of the recording.
        resolution: [unit] least step of the numbers; nan where most numbers occur once, or are resampled.
        clipped: longest run of samples at the largest or least value, 0 if not clipped; nan for resampled values,
            whose reader has looked.
        noise: [unit/sqrt(Hz)] noise floor: root of the median of the power spectral density in the band.
        strongest: [Hz] the frequency of the largest bin within the band.
        band: [Hz] lower and upper end of the band that can be trusted; a sensor without an anti-alias filter folds
            what lies above half the rate into it.
    """

    name: str
    kind: str
    rate: float
    duration: float
    resolution: float
    clipped: float
    noise: float
    strongest: float
    band: tuple[float, float]


def grade(
    name: str, kind: str, values: Float[np.ndarray, "T"], step: float, band: tuple[float, float] = (0.0, np.inf)
) -> Grade:
    """Return the grade of a channel.

    The median of a periodogram of Gaussian noise is ln 2 times its mean: lines, few of its bins, do not count.

    Args:
        name: of the channel.
        kind: see `Grade`.
        values: (T,) finite.
        step: [s] between samples.
        band: [Hz] beyond which a filter or resampling (a finite end) has spoilt the values.
    """
    from scipy.signal import welch

    rate, duration = 1 / step, step * len(values)
    low, high = max(band[0], PERIODS_MIN / duration), min(band[1], rate / SAMPLES_PER_PERIOD)
    frequency, power = welch(values, rate, nperseg=len(values))
    inside = (frequency >= low) & (frequency <= high) if low < high else frequency > 0
    noise = float(np.sqrt(np.median(power[inside]) / np.log(2)))
    strongest = float(frequency[inside][np.argmax(power[inside])])
    step, run = (np.nan, np.nan) if np.isfinite(band[1]) else (resolution(values), clipped(values))
    return Grade(name, kind, rate, duration, step, run, noise, strongest, (low, high))


def resolution(values: Float[np.ndarray, "T"]) -> float:
    """Return the least step of which all differences are multiples; nan where most numbers occur once, or for none."""
    levels = np.unique(values)
    steps = np.diff(levels)
    if not 1 < len(levels) <= len(values) / 2:
        return np.nan
    step = float(np.median(steps[steps < 1.5 * steps.min()]))
    return step if (np.abs(steps / step - np.rint(steps / step)) < STEPPED).mean() >= 0.95 else np.nan


def clipped(values: Float[np.ndarray, "T"]) -> int:
    """Return the longest run of samples at the largest or least value if it counts as clipped, otherwise 0.

    Coarse digits repeat everywhere, and somewhat more often at a peak.
    """
    ends = np.flatnonzero(np.diff(values) != 0)
    starts, lengths = np.append(0, ends + 1), np.diff(np.concatenate([[-1], ends, [len(values) - 1]]))
    extreme = np.isin(values[starts], (values.max(), values.min()))
    longest, usual = int(lengths[extreme].max()), int(lengths[~extreme].max(initial=1))
    return longest if CLIPPED <= longest < len(values) and longest > CLIPPED * usual else 0
