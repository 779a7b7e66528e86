"""Each kind of data predicted from all others: do they contradict each other?"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from ident.inference.fit import fit
from ident.inference.problem import InverseProblem


@dataclass(frozen=True)
class CrossPrediction:
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


def cross_predictions(problem: InverseProblem, *, starts: int = 4) -> tuple[CrossPrediction, ...]:
    """Predict each kind of measurement from the others, and compare; empty when there is one kind only."""
    kinds = sorted(set(problem.kinds))
    return tuple(_cross_prediction(problem, kind, starts) for kind in kinds) if len(kinds) > 1 else ()


def _cross_prediction(problem: InverseProblem, kind: str, starts: int) -> CrossPrediction:
    others = fit(problem.without(kind), starts=starts)
    rows = tuple(i for i, k in enumerate(problem.kinds) if k == kind)
    index = np.array(rows)
    measured, sigma = np.asarray(problem.measured)[index], np.asarray(problem.sigma)[index]
    sd = np.hypot(sigma, others.predicted_sd[index])
    return CrossPrediction(kind, rows, measured, others.predicted[index], sd)
