"""From a chance to a verdict: the levels, and the correction for how many values are tested together."""

from collections.abc import Sequence
from statistics import NormalDist

import numpy as np
from jaxtyping import Bool, Float

SUSPICIOUS = 3.0
"""Standard deviations beyond which a single normal value is suspicious; more where many are tested together."""
RARE = 2 * NormalDist().cdf(-SUSPICIOUS)
"""The chance of that: of a false alarm among all values, or all kinds of data, that are tested together."""
IMPROBABLE = 1e-3
"""Chance of so large a chi-squared below which model or sigmas are called wrong; of so small a one, sigmas or rows."""


def rare(chances: Sequence[float] | Float[np.ndarray, "n"]) -> Bool[np.ndarray, "n"]:
    """Tell which of several chances are too small, with one false alarm in 1 / RARE sets of them at most (`holm`)."""
    return holm(chances) < RARE


def holm(chances: Sequence[float] | Float[np.ndarray, "n"]) -> Float[np.ndarray, "n"]:
    """Return chances that hold for all of several tests together.

    Holm, "A simple sequentially rejective multiple test procedure", Scand. J. Statist. 6, 1979: the smallest of n times
    n, the next one times n - 1, none less than those before it.
    """
    single = np.asarray(chances, float)
    order = np.argsort(single)
    stepwise = np.maximum.accumulate(single[order] * np.arange(len(single), 0, -1))
    return np.minimum(stepwise, 1.0)[np.argsort(order)]


def farthest(count: int) -> float:
    """Return the limit [sd] for the farthest of so many normal values."""
    return standard_deviations(RARE / max(count, 1))


def standard_deviations(chance: float) -> float:
    """Return how many standard deviations a normal value exceeds, up or down, with this chance."""
    return -NormalDist().inv_cdf(chance / 2) if chance > 0 else np.inf
