"""Robust weights: values too far off for their sigma count less, by iteratively reweighted least squares."""

from collections.abc import Callable

import numpy as np
from jaxtyping import Float, Int

from ident.errors import ConvergenceError
from ident.inference.fit import Fit
from ident.inference.least_squares import solve
from ident.inference.problem import InverseProblem

HUBER = 1.345
"""Sigmas from which on a value counts less: 95 % efficient where errors are normal."""
FREEDOM = 4.0
"""Degrees of freedom of Student's t (Lange, Little, Taylor, JASA 84, 1989)."""
SUSPICIOUS = 0.5
"""Weight below which a value is named."""
STEPS, SETTLED = 60, 1e-3
"""Solutions at most, and the change of any weight below which they are the last."""


def robust_weights(fit: Fit, units: Int[np.ndarray, "D"], loss: str) -> Float[np.ndarray, "D"]:
    """Return the weight of each value where weights and optimum agree, from the optimum of a fit.

    With r the size of the scaled residuals of a unit, the root of their mean square, each of its values counts as if
    its variance were sigma^2 / w: for `huber` w = min(1, k / r), which limits what a value may pull; for `t`
    w = (n + 1) / (n + r^2), by which it pulls less and less, as errors of Student's t do. As its optimum may not be the
    only one, that is begun with the weights of `huber`.

    Args:
        fit: the start, whose problem has the sigmas as they were said.
        units: number of the unit of each value: one for the components of a vector.
        loss: `huber` or `t`.

    Raises:
        ConvergenceError: weights and optimum do not agree after many steps.

    References:
        Holland, Welsch, "Robust regression using iteratively reweighted least-squares", Commun. Stat. A6(9), 1977.
    """
    theta, predicted, weights = _settled(fit.problem, fit.best.theta, fit.predicted, units, _huber)
    return weights if loss == "huber" else _settled(fit.problem, theta, predicted, units, _student)[2]


def _settled(
    problem: InverseProblem,
    theta: Float[np.ndarray, "P"],
    predicted: Float[np.ndarray, "D"],
    units: Int[np.ndarray, "D"],
    weigh: Callable[[Float[np.ndarray, "D"]], Float[np.ndarray, "D"]],
) -> tuple[Float[np.ndarray, "P"], Float[np.ndarray, "D"], Float[np.ndarray, "D"]]:
    weights = np.zeros(len(units))
    for _ in range(STEPS):
        before, weights = weights, weigh(_sizes(problem, predicted, units))
        if np.abs(weights - before).max() < SETTLED:
            return theta, predicted, weights
        end = solve(weighted(problem, weights), theta)
        theta, predicted = np.asarray(end.theta), np.asarray(end.predicted)
    raise ConvergenceError("the robust weights have not settled; take the other loss, or leave out what is wrong")


def weighted(problem: InverseProblem, weights: Float[np.ndarray, "D"]) -> InverseProblem:
    """Return the problem in which each value counts by its weight."""
    return problem.with_sigma(np.asarray(problem.sigma) / np.sqrt(weights))


def _sizes(problem: InverseProblem, predicted: np.ndarray, units: np.ndarray) -> Float[np.ndarray, "D"]:
    """Return the root of the mean square of the scaled residuals of each value's unit."""
    squared = problem.scaled(predicted - np.asarray(problem.measured)) ** 2
    total, count = np.bincount(units, squared), np.bincount(units)
    return np.sqrt(total[units] / count[units])


def _huber(r: np.ndarray) -> np.ndarray:
    return HUBER / np.maximum(r, HUBER)


def _student(r: np.ndarray) -> np.ndarray:
    return (FREEDOM + 1) / (FREEDOM + r**2)
