"""Whether parameters have changed between two estimates whose data are not at hand: as if they had nothing in common.

The difference of the means is normal then, with the sum of both covariances, and what `change` says of fits follows
in closed form.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from ident.inference.change import WIDE, Change, chance, moments


@dataclass(frozen=True)
class Estimate:
    """What is known of some parameters where the data behind it are not at hand.

    Attributes:
        theta: (C,) their means: ln of a positive parameter [SI].
        covariance: (C, C) of it.
    """

    theta: Float[np.ndarray, "C"]
    covariance: Float[np.ndarray, "C C"]


def independent_change(names: Sequence[str], first: Estimate, second: Estimate) -> Change:
    """Return what has changed from one estimate to another, as if they had nothing in common.

    Where both hold the same prior it counts twice: what it tells draws them together, and a change looks smaller.

    Args:
        names: (C,) of the parameters, all positive.
        first: the earlier estimate.
        second: the later one.
    """
    apart = second.theta - first.theta
    seen, own = np.linalg.inv(first.covariance + second.covariance), np.eye(len(names)) / WIDE**2

    def cost(change: Float[np.ndarray, "C"]) -> float:
        return float((change - apart) @ seen @ (change - apart) + change @ own @ change)

    covariance = np.linalg.inv(seen + own)
    found = covariance @ seen @ apart

    def alone(k: int) -> float:
        others, one = np.arange(len(names)) != k, np.zeros(len(names))
        one[k] = (seen @ apart)[k] / (seen + own)[k, k]
        left = seen[np.ix_(others, others)] - np.outer(seen[others, k], seen[k, others]) / seen[k, k]
        return chance(cost(one) - cost(found), *moments(left))

    return Change(
        tuple(names),
        np.exp(first.theta),
        np.exp(second.theta),
        found,
        covariance,
        np.sqrt(np.diag(covariance @ seen @ covariance)),
        cost(np.zeros_like(apart)) - cost(found),
        *moments(seen),
        np.array([alone(k) for k in range(len(names))]),
    )
