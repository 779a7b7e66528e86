"""A design as report, files and figures share it."""

from dataclasses import dataclass

import numpy as np

from ident.arm.arm import Arm
from ident.studies.scenario import Basis
from ident.vibrate.design import Design, Place, Verification
from ident.vibrate.evaluator import Evaluator
from ident.vibrate.sweep import Sensitivities
from ident.vibrate.variable import Variable

AT_BOUND = 1e-3
"""Distance from a bound, relative to the range, that counts as at the bound."""
SAME = 1e-3
"""Differences that count as equal: relative, of largest amplitudes; relative to the range, of changes."""


@dataclass(frozen=True)
class DesignStudy:
    """What may be changed, on which arm, and the result.

    Attributes:
        basis: the simulated arm, its motion and the draws of the search.
        evaluator: the same with the variables, as it is simulated.
        sensitivities: of the present arm.
        design: the best design; None if only the sensitivities are wanted.
        verification: of the best design.
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
        """Limit of the amplitude [m]."""
        return self.design.limit if self.design else None

    @property
    def draws(self) -> int:
        """Number of draws of the search."""
        return self.evaluator.size - 1


def same(design: Design) -> int:
    """Return how many starts led to the minimum amplitude."""
    spans = np.array([variable.span(design.evaluator.arm) for variable in design.evaluator.variables])
    width, first = spans[:, 1] - spans[:, 0], design.optima[0]
    return sum(
        one.largest < first.largest * (1 + SAME) and bool((np.abs(one.changes - first.changes) < SAME * width).all())
        for one in design.optima
    )


def bound_of(arm: Arm, variable: Variable, change: float) -> str:
    """Name the bound that a change reaches; empty if none, or if nothing changes."""
    low, high = variable.span(arm)
    near = AT_BOUND * (high - low)
    if abs(change) < near:
        return ""
    return "lower" if change - low < near else "upper" if high - change < near else ""


def unchanged(place: Place) -> bool:
    """Whether a design is the present arm, within rounding."""
    return place.change_norm < SAME


def keeps(place: Place, limit: float) -> bool:
    """Whether a design keeps a limit."""
    return place.largest <= limit
