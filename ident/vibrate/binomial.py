"""Probabilities from counts of draws, with their intervals; and which draws make the scatter."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.special import betaincinv

LEVEL = 0.95
"""Of the interval of a probability."""
HALF_WIDTH = 1.96
"""Half of a 95 % interval of a normal distribution, in standard deviations."""


@dataclass(frozen=True)
class BinomialEstimate:
    """How many draws have an event.

    Attributes:
        count: of draws that have it.
        draws: in all.
    """

    count: int
    draws: int

    @property
    def share(self) -> float:
        """The estimated probability."""
        return self.count / self.draws

    @property
    def interval(self) -> tuple[float, float]:
        """Its 95 % interval.

        References:
            Clopper and Pearson, "The use of confidence or fiducial limits illustrated in the case of the binomial",
            Biometrika 26 (1934) 404-413.
        """
        events, others, tail = self.count, self.draws - self.count, (1 - LEVEL) / 2
        low = betaincinv(events, others + 1, tail) if events else 0.0
        return float(low), float(betaincinv(events + 1, others, 1 - tail)) if others else 1.0


def share_of_variance(values: Mapping[str, Float[np.ndarray, "K"]], size: Float[np.ndarray, "K"]) -> float:
    """Return the share of a size's variance over draws that some numbers account for; zero where nothing varies.

    By ranks (Iman, Conover, "The use of the rank transform in regression", Technometrics 21, 1979), with the adjusted
    coefficient of determination, as many numbers explain much of a few draws by chance.
    """
    rank, *ranks = (np.unique(x, return_inverse=True)[1] for x in (size, *values.values()))
    columns = {tuple(each) for each in ranks if each.any()}  # tied numbers once
    count, more = len(size), len(columns)
    if not (0 < more < count - 1 and rank.any()):
        return 0.0
    A = np.column_stack([*columns, np.ones(count)])
    left = np.var(rank - A @ np.linalg.lstsq(A, rank)[0])
    return max(0.0, 1 - float(left / np.var(rank)) * (count - 1) / (count - 1 - more))


def binomial_estimate(events: np.ndarray) -> BinomialEstimate:
    """Return the probability of an event that some draws have."""
    return BinomialEstimate(int(np.sum(events)), int(np.size(events)))
