"""A probability that is counted out of draws."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

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


def chance_to_json(found: Chance) -> dict[str, Any]:
    """Return a probability as JSON knows it, its interval with it."""
    return {"count": found.count, "draws": found.draws, "share": found.share, "interval_95": list(found.interval)}


def chance_from_json(found: Mapping[str, Any]) -> Chance:
    """Return the probability again."""
    return Chance(found["count"], found["draws"])
