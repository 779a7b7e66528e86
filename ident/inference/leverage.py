"""Which measurements matter: what each one tells, and what would be lost without it."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from ident.inference.information import RANK_TOLERANCE, information

EMPTY = 0.02
"""Share of an average measurement's information below which one counts as carrying none."""
ALONE = 0.9
"""Leverage above which one measurement dominates: nine tenths of what is known of some direction come from it."""
REPLACEABLE = 0.5
"""Leverage below which nothing much is lost: no standard deviation grows by more than 1.4 without it."""


@dataclass(frozen=True)
class Leverage:
    """The part that each measurement has in what the data tell.

    Attributes:
        leverage: (D,) share of the measurement in what is known of the direction that it tells most of; the diagonal
            of J (J'J)^-1 J', J = d(predicted / sigma)/d(theta). They sum to the rank.
        sees: (D,) place of the parameter that moves it most, in sigmas; -1 if none does.
        opened: (D,) number of directions that nothing would be known of without it.
        lost: (D,) parameters that would no longer be identifiable without it.
    """

    leverage: Float[np.ndarray, "D"]
    sees: tuple[int, ...]
    opened: tuple[int, ...]
    lost: tuple[tuple[str, ...], ...]

    @property
    def share(self) -> Float[np.ndarray, "D"]:
        """Share of each measurement in all information."""
        return self.leverage / max(self.leverage.sum(), 1e-300)

    @property
    def empty(self) -> Bool[np.ndarray, "D"]:
        """Which carry no information."""
        return self.share < EMPTY / len(self.leverage)

    @property
    def dominant(self) -> Bool[np.ndarray, "D"]:
        """Which dominate: something is known by them alone, or hardly by anything else."""
        needed = [bool(opened or lost) for opened, lost in zip(self.opened, self.lost, strict=True)]
        return np.array(needed, bool) | (self.leverage > ALONE)


def leverage_of(
    jacobian: Float[np.ndarray, "D P"], names: tuple[str, ...], groups: Int[np.ndarray, "D"] | None = None
) -> Leverage:
    """Drop each measurement in turn and see what is lost, by the Jacobian alone; a group of them is dropped whole.

    Args:
        jacobian: d(predicted / sigma)/d(theta), made independent, zero for values that are not fitted.
        names: of the parameters.
        groups: number of the group of values whose errors are correlated, -1 for none; its leverage is shared evenly.

    References:
        Belsley, Kuh, Welsch, "Regression Diagnostics", 1980, section 2.1.
    """
    U, s, _ = np.linalg.svd(jacobian, full_matrices=False)
    leverage = (U[:, s > RANK_TOLERANCE * max(s[0], 1e-300)] ** 2).sum(1)
    alone = np.arange(len(jacobian)) + len(jacobian)
    units = alone if groups is None else np.where(groups < 0, alone, groups)
    sees = tuple(int(np.argmax(np.abs(row))) if row.any() else -1 for row in jacobian)
    none = np.full(len(names), np.inf)
    whole = information(jacobian, none, names)
    opened, lost = [0] * len(jacobian), [()] * len(jacobian)
    for unit in np.unique(units[leverage > REPLACEABLE]):
        rest = information(jacobian[units != unit], none, names)
        gone = tuple(np.array(names)[whole.supported & ~rest.supported].tolist())
        for i in np.flatnonzero(units == unit):
            opened[i], lost[i] = max(whole.rank - rest.rank, 0), gone
    _, place, count = np.unique(units, return_inverse=True, return_counts=True)
    leverage = (np.bincount(place, leverage) / count)[place]
    return Leverage(leverage, sees, tuple(opened), tuple(lost))
