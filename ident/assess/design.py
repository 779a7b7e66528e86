"""A design as it is reported: all that the report, the files and the figures have in common."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ident.arm.arm import Arm
from ident.description.file import ArmFile
from ident.identify.values import Values
from ident.measure import Load, Log
from ident.present.text.units import unit_of
from ident.vibrate.redesign.design import Design, Place
from ident.vibrate.redesign.evaluator import Evaluator
from ident.vibrate.redesign.sensitivity import Sensitivities
from ident.vibrate.redesign.variable import Variable
from ident.vibrate.redesign.verify import Verification

AT_BOUND = 1e-3
"""Distance from a bound, of the way between both, that is none."""
SAME = 1e-3
"""Difference of largest amplitudes, as a share, and of changes, of the way between the bounds, that is none."""


@dataclass(frozen=True)
class DesignStudy:
    """What was asked, of what, and what came out.

    Attributes:
        arm_file: the arm as its file has it.
        trial: the arm as it was simulated, its motion, variables and draws.
        load: the load case.
        sensitivities: of the arm as it is.
        design: what was found; None where only the sensitivities are wanted.
        verification: of the best.
        starts: of the search.
        log: the joint path, if one was replayed.
        fit: values of a fit that the arm has taken over.
        posterior: draws of a posterior, used in the search.
        fresh: how many others the verification had.
        changed: numbers that the user has set, by path.
    """

    arm_file: ArmFile
    trial: Evaluator
    load: Load
    sensitivities: Sensitivities
    design: Design | None = None
    verification: Verification | None = None
    starts: int = 1
    log: Log | None = None
    fit: Values | None = None
    posterior: Values | None = None
    fresh: int = 0
    changed: Mapping[str, float] | None = None

    @property
    def arm(self) -> Arm:
        """The arm as it was simulated."""
        return self.trial.arm

    @property
    def point(self) -> str:
        """Name of the end point."""
        return self.arm.points[-1].name

    @property
    def draws(self) -> int:
        """Number of draws of the search."""
        return self.trial.size - 1

    @property
    def own(self) -> dict[str, float]:
        """Numbers that the arm has not from its file: fitted, medians of draws, set by the user."""
        values = self.fit or self.posterior
        return (values.medians if values else {}) | dict(self.changed or {})


def same(design: Design) -> int:
    """Return how many starts have led to the quietest."""
    spans = np.array([variable.span(design.evaluator.arm) for variable in design.evaluator.variables])
    width, first = spans[:, 1] - spans[:, 0], design.optima[0]
    return sum(
        one.largest < first.largest * (1 + SAME) and bool((np.abs(one.changes - first.changes) < SAME * width).all())
        for one in design.optima
    )


def bound_of(arm: Arm, variable: Variable, change: float) -> str:
    """Say at which bound a change is; empty if at none."""
    low, high = variable.span(arm)
    near = AT_BOUND * (high - low)
    return "lower" if change - low < near else "upper" if high - change < near else ""


def keeps(place: Place, limit: float) -> bool:
    """Tell whether a design keeps a limit, but for rounding."""
    return place.largest <= limit * (1 + SAME)


def change_in_words(variable: Variable, change: float) -> str:
    """Write a change as `1.26x` or `+0.05 m`."""
    if variable.shifted:
        return f"{change:+.4g} {unit_of(variable.paths[0])}".removesuffix(" -")
    return f"{np.exp(change):.4g}x"
