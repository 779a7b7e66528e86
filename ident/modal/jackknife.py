"""What the hits themselves say of the covariance: leave-one-hit-out, beside maximum likelihood."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import chi2, t

from ident.modal.frf import Frf
from ident.modal.likelihood import Likelihood, nearby
from ident.modal.noise import Noise

BAND = 0.99
"""Probability of the band that a ratio lies in, where the covariance is right."""


@dataclass(frozen=True)
class Ratio:
    """Variance by leave-one-hit-out over that by maximum likelihood, for poles, pooled.

    Attributes:
        value: [-] pooled over poles (and postures).
        freedom: degrees of freedom: numbers of the poles times one less than hits.
    """

    value: float
    freedom: int

    @property
    def band(self) -> tuple[float, float]:
        """Where the ratio lies with 99 % probability, if the covariance is right."""
        low, high = chi2.interval(BAND, self.freedom)
        return float(low) / self.freedom, float(high) / self.freedom

    @property
    def doubtful(self) -> bool:
        """Whether it lies outside this band."""
        low, high = self.band
        return not low <= self.value <= high

    @property
    def scale(self) -> float:
        """[-] what the covariance is multiplied with: the ratio, and Student's t over the normal at 95 %, squared."""
        return self.value * (float(t.isf(0.025, self.freedom)) / 1.959964) ** 2


def jackknife(frf: Frf, noise: Noise, fit: Likelihood, *, real: bool = False) -> Ratio:
    """Repeat the estimate without each hit in turn and compare the scatter of the poles with the covariance.

    Var = (H - 1) / H sum_h (x_h - mean)^2, as a squared distance in the covariance of all poles, so that close modes,
    whose errors go together, count for what they are.

    References:
        Efron, Tibshirani, "An Introduction to the Bootstrap", 1993, chapter 11.
    """
    count, size = len(frf.hits), fit.model.size
    poles = np.ravel([[r * size, r * size + 1] for r in fit.model.inside(frf.frequency)])
    others = [replace(frf, hits=np.delete(frf.hits, h, 0)) for h in range(count)]
    without = nearby(frf, noise, fit, others, real=real)[:, poles]
    apart = without - without.mean(0)
    precision = np.linalg.inv(fit.covariance[np.ix_(poles, poles)])
    value = (count - 1) / count * (apart @ precision * apart).sum() / len(poles)
    return Ratio(float(value), len(poles) * (count - 1))


def pooled(ratios: Sequence[Ratio]) -> Ratio:
    """Return one ratio of several tests."""
    freedom = sum(ratio.freedom for ratio in ratios)
    return Ratio(float(sum(ratio.value * ratio.freedom for ratio in ratios) / freedom), freedom)
