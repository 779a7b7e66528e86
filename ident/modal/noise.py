"""What scatters in frequency response functions, from the single hits: between channels, lines and along frequency."""

import math
from dataclasses import dataclass

import numpy as np
import scipy.fft
import scipy.linalg
from jaxtyping import Complex, Float
from scipy.ndimage import uniform_filter1d
from scipy.stats import chi2

from ident.errors import InputError, Problem
from ident.modal.frf import Frf

FEWEST_HITS = 3
"""Fewest hits of which a scatter is made."""
SMOOTHED = 100
"""Degrees of freedom that a smoothed variance has at least."""
COURSE = 240
"""Degrees of freedom of the scatter's course over the record, at each of its times."""
STEADY = 1.5
"""Largest variance at a time over the mean one where lines are independent."""
WEIGHED = SMOOTHED / (SMOOTHED - 4)
"""By how much estimates vary more than their nominal variance, as their weights are estimated: E[1/x^2] / E[1/x] of a
chi-squared x."""
FAINTEST = 1e-3
"""Least variance of a part of the record, as a share of the largest."""


@dataclass(frozen=True)
class Noise:
    """The covariance of averaged frequency response functions, as a product of what whitens it.

    The scatter of the hits has a variance for each channel and line, a correlation between channels that is the same
    at all lines, and one between lines that is the same in all channels: a window makes neighbours alike, as noise that
    has a course over the record, which the inverse transform shows. Five hits alone give a covariance matrix of rank
    four: the variances are averages over neighbouring lines, the correlations over all of them, and shrunk to none as
    far as they are uncertain.

    Attributes:
        sd: (K, F) [1/kg] standard deviation of each channel of the average, E|n|^2 = sd^2.
        channels: (K, K) inverse Cholesky factor of the correlation between channels.
        course: (F,) standard deviation over the record, of mean square one.

    References:
        Schäfer, Strimmer, Stat. Appl. Genet. Mol. Biol. 4, 2005, section 2.4, target D (shrinkage).
        Pintelon, Schoukens, "System Identification", 2nd ed. 2012, chapter 2 (sample covariance of averaged spectra).
    """

    sd: Float[np.ndarray, "K F"]
    channels: Complex[np.ndarray, "K K"]
    course: Float[np.ndarray, "F"]

    def by_line(self, values: Complex[np.ndarray, "*rest K F"]) -> Complex[np.ndarray, "*rest K F"]:
        """Return values in their standard deviations, channels independent of each other."""
        return self.channels @ (values * (1 / self.sd))

    def whiten(self, values: Complex[np.ndarray, "*rest K F"]) -> Float[np.ndarray, "*rest N"]:
        """Return real and imaginary parts, in turn, of unit covariance where the values scatter as the averages do."""
        moving = values.any(-1)  # a number of a mode moves few channels: the others need no transform
        rows = values[moving] * np.broadcast_to(math.sqrt(2) / self.sd, values.shape)[moving]
        if np.ptp(self.course):
            rows = scipy.fft.ifft(rows, norm="ortho", overwrite_x=True) * (1 / self.course)
        steady = np.zeros(values.shape, complex)
        steady[moving] = rows
        white = self.channels @ steady
        return white.reshape(*values.shape[:-2], -1).view(float)


def noise_of(frf: Frf) -> Noise:
    """Estimate the covariance of the averaged functions from the scatter of their hits.

    Raises:
        InputError: there are too few hits, or some do not scatter.
    """
    hits, count = channels_of(frf.hits), len(frf.hits)
    if count < FEWEST_HITS:
        remedy = "give the single hits: without their scatter no standard deviation is known"
        raise InputError(Problem("", f"{count} hits", f"{FEWEST_HITS} or more", remedy, "hits"))
    deviations = hits - hits.mean(0)
    raw = (np.abs(deviations) ** 2).sum(0) / (count - 1)
    if not (_average(raw, SMOOTHED) > 0).all():
        raise InputError(Problem("", "hits without scatter", "hits that differ", "give measured hits", "hits"))
    freedom = 2 * (count - 1)
    broad = deviations / np.sqrt(_average(raw, len(raw[0]) // 4))
    variance = smoothed(raw, freedom, alike=float((_course(broad) ** 4).mean()))
    scaled = deviations / np.sqrt(variance) * math.sqrt(count / (count - 1))
    return Noise(np.sqrt(variance / count), _channel_factor(scaled), _course(scaled))


def channels_of(values: Complex[np.ndarray, "*rest O I F"]) -> Complex[np.ndarray, "*rest K F"]:
    """Return responses by references as channels, K = O I."""
    return values.reshape(*values.shape[:-3], -1, values.shape[-1])


def smoothed(raw: Float[np.ndarray, "K F"], freedom: int, alike: float = 1.0) -> Float[np.ndarray, "K F"]:
    """Average variances over neighbouring lines; one that stands out (the mains) keeps its own beside the average.

    Args:
        raw: variances of single lines.
        freedom: degrees of freedom of each.
        alike: number of neighbouring lines that tell as much as one.
    """
    width = math.ceil(SMOOTHED * alike / freedom / 2) * 2 + 1
    average = _average(raw, width)
    stands_out = raw > average * chi2.isf(1e-3 / raw.size, freedom) / freedom
    return np.where(stands_out, raw, average)


def _average(raw: Float[np.ndarray, "K F"], width: int) -> Float[np.ndarray, "K F"]:
    return uniform_filter1d(raw, max(1, min(width, raw.shape[-1])), axis=-1, mode="nearest")


def _channel_factor(scaled: Complex[np.ndarray, "H K F"]) -> Complex[np.ndarray, "K K"]:
    """Return the inverse Cholesky factor of the correlation of channels, shrunk towards none."""
    _, channels, _ = scaled.shape
    rows = np.moveaxis(scaled, 1, 0).reshape(channels, -1)
    count, squared = rows.shape[1], np.abs(rows) ** 2
    correlation = rows @ rows.conj().T / count
    spread = squared @ squared.T / count - np.abs(correlation) ** 2
    size = np.sqrt(np.real(np.diag(correlation)))
    correlation /= size[:, None] * size
    apart = ~np.eye(channels, dtype=bool)
    uncertain = (spread / (size[:, None] * size) ** 2)[apart].sum() / count
    shrunk = np.clip(uncertain / max((np.abs(correlation[apart]) ** 2).sum(), 1e-300), 0.0, 1.0)
    correlation[apart] *= 1 - shrunk
    factor = np.linalg.cholesky(correlation)
    return scipy.linalg.solve_triangular(factor, np.eye(channels), lower=True).astype(complex)


def _course(scaled: Complex[np.ndarray, "H K F"]) -> Float[np.ndarray, "F"]:
    """Return how the scatter goes over the record: the same throughout where lines are independent."""
    power = (np.abs(scipy.fft.ifft(scaled, norm="ortho")) ** 2).mean((0, 1))
    freedom = 2 * (len(scaled) - 1) * scaled.shape[1]
    course = _average(power[None], 2 * math.ceil(COURSE / freedom / 2) + 1)[0]
    if course.max() < STEADY * course.mean():
        return np.ones(len(course))
    course = np.maximum(course, FAINTEST * course.max())
    return np.sqrt(course / course.mean())
