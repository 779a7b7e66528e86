"""A probability that is counted out of draws."""

from dataclasses import dataclass

import numpy as np
from scipy.stats import binomtest

LEVEL = 0.95
"""Of the interval of a probability."""


@dataclass(frozen=True)
class Chance:
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


def chance(done: np.ndarray) -> Chance:
    """Return the probability of what some draws do."""
    return Chance(int(np.sum(done)), int(np.size(done)))
