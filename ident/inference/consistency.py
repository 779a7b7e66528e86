"""Do the data agree among themselves? A linear answer, before any solving."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float
from scipy.special import chdtrc

from ident.inference.cross_prediction import moment_sd
from ident.inference.information import RANK_TOLERANCE
from ident.inference.least_squares import evaluate
from ident.inference.problem import InverseProblem

COARSE = 0.3
"""Relative sigma above which a value may well change its sign, so that its logarithm means nothing."""
STRAIGHT = 1.0
"""Largest error of the straight line, in sigma, at which a chi-squared over all values is worth its name."""


@dataclass(frozen=True)
class Consistency:
    """What the linearised model says of the data among themselves.

    Attributes:
        chi_squared: least sum of squares that any parameters reach, data and prior.
        degrees_of_freedom: number of values and priors less the number of directions they see together.
        bend: largest error of the straight line in sigma, where all data together lead; NaN where the model ends.
    """

    chi_squared: float
    degrees_of_freedom: int
    bend: float

    @property
    def p_value(self) -> float:
        """Chance of a larger chi-squared if all is right; NaN without degrees of freedom or a straight line."""
        meaningful = self.degrees_of_freedom > 0 and self.bend < STRAIGHT
        return float(chdtrc(self.degrees_of_freedom, self.chi_squared)) if meaningful else np.nan


def consistency(problem: InverseProblem) -> Consistency | None:
    """Test the data among themselves with the model linearised at the parameters' starting values.

    Values that depend on positive parameters only are linearised as powers of them, ln(value) in ln(parameter), as
    frequencies and deflections nearly are; other values, and those whose sign is not sure, as they stand. One step
    leads to the parameters that the data ask for. There the model is evaluated once, and every sigma is widened by
    what the straight line was off, so that a bad start makes the test weaker, not wrong. There is no second step.

    Returns:
        None where the model has no answer at the start.
    """
    line = _line(problem)
    if not all(np.isfinite(part).all() for part in (line.value, line.slope)):
        return None
    answer, bend = _widened(problem, line)
    return Consistency(answer.chi_squared, answer.degrees_of_freedom, bend)


class _Line(NamedTuple):
    """The model as a straight line about the start, each value in a scale of its own: moved = slope @ step."""

    start: Float[np.ndarray, "P"]
    value: Float[np.ndarray, "D"]
    measured: Float[np.ndarray, "D"]
    sigma: Float[np.ndarray, "D"]
    power: Bool[np.ndarray, "D"]
    slope: Float[np.ndarray, "D P"]
    centre: Float[np.ndarray, "P"]
    widths: Float[np.ndarray, "P"]

    def moved(self, values: Float[np.ndarray, "D"]) -> Float[np.ndarray, "D"]:
        """Return how far values lie from the start."""
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.where(self.power, np.log(values / self.value), values - self.value)

    def scale(self, values: Float[np.ndarray, "D"]) -> Float[np.ndarray, "D"]:
        """Return the value of one unit of move there."""
        return np.where(self.power, np.abs(values), 1.0)


class _Answer(NamedTuple):
    """The step that the data ask for, and what it leaves unexplained."""

    step: Float[np.ndarray, "P"]
    chi_squared: float
    degrees_of_freedom: int


def _line(problem: InverseProblem) -> _Line:
    end, known = evaluate(problem), problem.parameters
    value, J = np.asarray(end.predicted), np.asarray(end.jacobian)
    measured, sigma = np.asarray(problem.measured), np.asarray(problem.sigma)
    of_positive = ~((J != 0) & ~known.positive).any(1)
    coarse = np.isfinite(sigma) & (sigma > COARSE * np.abs(measured))
    power = of_positive & (value * measured > 0) & ~coarse
    slope = J / np.where(power, value, 1.0)[:, None]
    start, centre = (np.asarray(known.theta(known.column(name))) for name in ("start", "centre"))
    return _Line(start, value, measured, sigma, power, slope, centre, moment_sd(known))


def _widened(problem: InverseProblem, line: _Line) -> tuple[_Answer, float]:
    """Return the answer of all values, sigmas widened by the error of the line, and that error in sigma."""
    spread = line.sigma / line.scale(line.measured)
    first = _answer(line, spread, problem)
    there = np.asarray(evaluate(problem, line.start + first.step).predicted)
    error = np.abs(line.moved(there) - line.slope @ first.step)
    wider = np.hypot(spread, np.nan_to_num(error, nan=np.inf))
    return _answer(line, wider, problem), float((error / spread).max())


def _answer(line: _Line, spread: Float[np.ndarray, "D"], problem: InverseProblem) -> _Answer:
    """Solve; errors are correlated as the problem's are, whatever they have been widened by."""
    weight, prior_slope = 1 / spread, 1 / line.widths
    residual = (line.start - line.centre) * prior_slope
    problem = problem.with_sigma(spread)
    A = np.vstack([problem.scaled(line.slope), np.diag(prior_slope)])
    b = np.concatenate([problem.scaled(line.moved(line.measured)), -residual])
    U, s, Vt = np.linalg.svd(np.vstack([A, np.zeros((A.shape[1], A.shape[1]))]), full_matrices=False)
    seen = s > RANK_TOLERANCE * max(s[0], 1e-300)
    step = (Vt[seen] / s[seen, None]).T @ (U[: len(A), seen].T @ b)
    freedom = int((weight > 0).sum() + (prior_slope > 0).sum() - seen.sum())
    return _Answer(step, float(((b - A @ step) ** 2).sum()), freedom)
