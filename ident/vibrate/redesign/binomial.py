"""A probability that is counted out of draws."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.stats import binomtest

LEVEL = 0.95
"""Of the interval of a probability."""


@dataclass(frozen=True)
class BinomialEstimate:
    """How many draws do something.

    Attributes:
        count: of draws that do.
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
        low, high = binomtest(self.count, self.draws).proportion_ci(LEVEL, method="exact")
        return float(low), float(high)


def binomial_estimate(done: np.ndarray) -> BinomialEstimate:
    """Return the probability of what some draws do."""
    return BinomialEstimate(int(np.sum(done)), int(np.size(done)))


def binomial_to_json(found: BinomialEstimate) -> dict[str, Any]:
    """Return a probability as JSON knows it, its interval with it."""
    return {"count": found.count, "draws": found.draws, "share": found.share, "interval_95": list(found.interval)}


def binomial_from_json(found: Mapping[str, Any]) -> BinomialEstimate:
    """Return the probability again."""
    return BinomialEstimate(found["count"], found["draws"])
