"""Doubts worth stating: values that no such arm would give, and kinds of data that contradict each other."""

import math
from dataclasses import dataclass

import equinox as eqx
import numpy as np
from jaxtyping import Float

from ident.errors import InputError, Problem
from ident.identify.fit import Fit, evaluate, fit
from ident.identify.problem import InverseProblem
from ident.measure import Campaign

PLAUSIBLE = {"frequency": 4.0, "damping_ratio": 100.0, "deflection": 30.0, "deflection_difference": 30.0}
"""Factor by which a value may differ from what the arm file predicts before it is questioned."""


def question_values(problem: InverseProblem, campaign: Campaign) -> None:
    """Refuse values that are far from what the arm predicts at its starting stiffnesses, such as rad/s taken for Hz.

    Raises:
        InputError: lists the values, each with its row.
    """
    predicted = np.asarray(evaluate(problem).predicted)
    doubts = []
    for m, expected in zip(campaign, predicted, strict=True):
        ratio = m.value / expected if expected else math.nan
        limit = PLAUSIBLE[m.kind]
        if not 1 / limit < abs(ratio) < limit and math.isfinite(ratio):
            hint = "it looks like rad/s written as Hz: " if 0.8 < ratio / (2 * math.pi) < 1.25 else ""
            hint = hint if m.kind == "frequency" else ""
            remedy = f"{hint}check value and unit, or say that it is right (--trust-values)"
            got = f"{m.value:.4g} (SI), {ratio:.3g} times what the arm file predicts"
            doubts.append(Problem(m.where, got, f"about {expected:.4g}", remedy, "value"))
    if doubts:
        raise InputError(doubts)


@dataclass(frozen=True)
class Tension:
    """What the other kinds of data say about one kind.

    Attributes:
        kind: the kind that was left out of the fit.
        rows: (n,) places of its values in the campaign.
        measured: (n,) [SI]
        predicted: (n,) [SI] by a fit to all other kinds.
        sd: (n,) [SI] standard deviation of measured - predicted, by sigma, data and prior.
    """

    kind: str
    rows: tuple[int, ...]
    measured: Float[np.ndarray, "n"]
    predicted: Float[np.ndarray, "n"]
    sd: Float[np.ndarray, "n"]

    @property
    def z(self) -> Float[np.ndarray, "n"]:
        """Difference between measured and predicted in standard deviations."""
        return (self.measured - self.predicted) / self.sd


def tensions(found: Fit, *, starts: int = 4) -> tuple[Tension, ...]:
    """Predict each kind of measurement from the others, and compare; empty when there is one kind only."""
    problem = found.problem
    kinds = sorted(set(problem.kinds))
    return tuple(_tension(problem, kind, starts) for kind in kinds) if len(kinds) > 1 else ()


def _tension(problem: InverseProblem, kind: str, starts: int) -> Tension:
    others = fit(eqx.tree_at(lambda p: p.sigma, problem, problem.without(kind).sigma), starts=starts)
    rows = tuple(i for i, k in enumerate(problem.kinds) if k == kind)
    index = np.array(rows)
    sigma = np.asarray(problem.sigma)[index]
    return Tension(
        kind,
        rows,
        np.asarray(problem.measured)[index],
        others.predicted[index],
        np.hypot(sigma, others.predicted_sd[index]),
    )
