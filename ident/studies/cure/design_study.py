"""A design as it is reported: what report, files and figures have in common."""

from dataclasses import dataclass

import numpy as np

from ident.arm.arm import Arm
from ident.studies.scenario import Basis
from ident.vibrate.design import Design, Place, Verification
from ident.vibrate.evaluator import Evaluator
from ident.vibrate.sweep import Sensitivities
from ident.vibrate.variable import Variable

AT_BOUND = 1e-3
"""Distance from a bound, of the way between both, that is none."""
SAME = 1e-3
"""Difference of largest amplitudes, as a share, and of changes, of the way between the bounds, that is none."""


@dataclass(frozen=True)
class DesignStudy:
    """What may be changed, on what, and what came out.

    Attributes:
        basis: the arm as it was simulated, its motion and the draws of the search.
        evaluator: the same with the variables, as it is simulated.
        sensitivities: of the arm as it is.
        design: what is best; None where only the sensitivities are wanted.
        verification: of the best.
        starts: of the search.
    """

    basis: Basis
    evaluator: Evaluator
    sensitivities: Sensitivities
    design: Design | None = None
    verification: Verification | None = None
    starts: int = 1

    @property
    def limit(self) -> float | None:
        """What the amplitude should not exceed [m]."""
        return self.design.limit if self.design else None

    @property
    def draws(self) -> int:
        """Number of draws of the search."""
        return self.evaluator.size - 1


def same(design: Design) -> int:
    """Return how many starts have led to the minimum amplitude."""
    spans = np.array([variable.span(design.evaluator.arm) for variable in design.evaluator.variables])
    width, first = spans[:, 1] - spans[:, 0], design.optima[0]
    return sum(
        one.largest < first.largest * (1 + SAME) and bool((np.abs(one.changes - first.changes) < SAME * width).all())
        for one in design.optima
    )


def bound_of(arm: Arm, variable: Variable, change: float) -> str:
    """Say at which bound a change is; empty if at none, or if nothing is changed."""
    low, high = variable.span(arm)
    near = AT_BOUND * (high - low)
    if abs(change) < near:
        return ""
    return "lower" if change - low < near else "upper" if high - change < near else ""


def unchanged(place: Place) -> bool:
    """Tell whether a design is the arm as it is, but for rounding."""
    return place.change_norm < SAME


def keeps(place: Place, limit: float) -> bool:
    """Tell whether a design keeps a limit."""
    return place.largest <= limit
