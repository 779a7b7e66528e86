"""Scrutiny of a fit: parts of the data predicted from the others, robust weights, and swapped values."""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Float, Int

from ident.errors import ConvergenceError
from ident.inference.fit import Fit, agrees
from ident.inference.information import IMPROBABLE, RANK_TOLERANCE, information
from ident.inference.problem import InverseProblem
from ident.inference.search import End, ended, look, solve, weighed

# -------- Exchange
# Two values whose swap would make contradictory data fit.

TRIED = 4
"""Number of swaps to fit again, among the suspected ones and among the best of the linear model."""

BLOCK = 1000
"""Swaps whose matrices are in memory at once: some 20 MB for twenty parameters."""

Pair = tuple[int, int]
"""Indices of two values."""
Moves = Mapping[int, int]
"""Index of the value that moves into each row."""


@dataclass(frozen=True)
class Exchange:
    """Two values that may have been swapped.

    Attributes:
        rows: their indices.
        chi_squared: of the data, fitted again with the two values swapped.
        score: chi-squared, cost of the priors and label cost, as in an `Optimum`.
    """

    rows: Pair
    chi_squared: float
    score: float = math.nan


def exchanges(
    fit: Fit, pairs: Sequence[Pair], suspected: Sequence[Pair], moves: Callable[[Pair], Moves]
) -> tuple[Exchange, ...]:
    """Return the swaps that leave no objection to the fit, least chi-squared first.

    Values move together with their sigmas and the correlations of their errors. All pairs are compared by least squares
    with the model linearised at the optimum; the best ones are fitted again from there, and from the parameters'
    starting values. The result is only a hint: two values that are both wrong may look swapped.

    Args:
        fit: of data that do not fit.
        pairs: values that might be swapped.
        suspected: pairs to fit again whatever their linear cost, the first `TRIED` of them.
        moves: all values that change rows when two are swapped.
    """
    blocks = [pairs[i : i + BLOCK] for i in range(0, len(pairs), BLOCK)]
    costs = np.concatenate([np.zeros(0), *(_costs(fit, [moves(pair) for pair in block]) for block in blocks)])
    nearest = [pairs[i] for i in np.argsort(costs, kind="stable")[:TRIED]]
    starts = fit.best.theta, fit.problem.parameters.theta_start  # wrong data may have misled the first start
    found = []
    for pair in dict.fromkeys([*suspected[:TRIED], *nearest]):
        problem = _moved(fit.problem, moves(pair))
        for start in starts:
            end = solve(problem, start)
            independent = problem.scaled(end.predicted - np.asarray(problem.measured))
            chi_squared = float(independent @ independent)
            if _fits(fit, problem, end, chi_squared):
                found.append(Exchange(pair, chi_squared, float(end.cost + np.sum(end.choice.cost))))
                break
    return tuple(sorted(found, key=lambda each: each.chi_squared))


def _fits(fit: Fit, problem: InverseProblem, end: End, chi_squared: float) -> bool:
    """Whether an end agrees with chi-squared, values, kinds and labels, as the verdict requires."""
    if not (np.isfinite(end.cost) and end.choice.settled):
        return False
    from scipy.special import chdtrc

    if not chdtrc(fit.degrees_of_freedom, chi_squared) >= IMPROBABLE:
        return False
    return agrees(problem, *weighed(problem, end))


def _costs(fit: Fit, moves: Sequence[Moves]) -> Float[np.ndarray, "N"]:
    """Return the least cost of each swap in the linear model.

    With r the residuals and S their slope, it is r'r - (S'r)' (S'S)^+ S'r. A swap changes a few rows of both: a value
    that moves to another row keeps its error, and is compared with that row's prediction. With X = [S, r] in sigmas, R
    the correlation of the errors and D the change of X, the squares are (X + D)' R^-1 (X + D).
    """
    problem, R = fit.problem, fit.problem.errors
    residuals, slope = weighed(problem, fit.end)
    measured, sigma = np.asarray(problem.measured), np.asarray(problem.sigma)
    rows = np.concatenate([slope, residuals[:, None]], 1)
    most = max(map(len, moves))  # padded with row 0, unmoved
    both = np.array([[*each.items(), *[(0, 0)] * (most - len(each))] for each in moves])
    here, there = both[:, :, 0], both[:, :, 1]  # rows, and the rows from which their values come
    moved = (fit.predicted[here] - measured[there]) / sigma[there]
    new = np.concatenate([fit.jacobian[here] / sigma[there][:, :, None], moved[:, :, None]], 2)
    whole = np.concatenate([fit.jacobian, (fit.predicted - measured)[:, None]], 1) / sigma[:, None]
    change = new - whole[there]
    cross = np.einsum("nip,niq->npq", change, R.pull_back(np.asarray(R.whiten(whole)))[there])
    own = np.einsum("nip,nij,njq->npq", change, R.inverse_among(there), change, optimize=True)
    squares = rows.T @ rows + cross + cross.swapaxes(1, 2) + own
    A, b, c = squares[:, :-1, :-1], squares[:, :-1, -1], squares[:, -1, -1]
    inverse = np.linalg.pinv(A, rcond=RANK_TOLERANCE, hermitian=True)
    return np.asarray(c - np.einsum("np,npq,nq->n", b, inverse, b))


def _moved(problem: InverseProblem, moves: Moves) -> InverseProblem:
    source = np.arange(len(problem.kinds))
    source[list(moves)] = list(moves.values())
    values = [jax.device_put(np.asarray(x)[source]) for x in (problem.measured, problem.sigma)]
    moved = eqx.tree_at(lambda p: (p.measured, p.sigma), problem, tuple(values))
    if problem.correlation is None:
        return moved
    return eqx.tree_at(lambda p: p.correlation, moved, jax.device_put(problem.correlation.moved(source)))


# -------- Held out
# Cross-validation: each group of values in turn, predicted by a fit to the others.


@dataclass(frozen=True)
class HeldOut:
    """A group of values, predicted by a fit to all others.

    Attributes:
        name: of the group.
        places: (n,) indices of its values among all.
        measured: (n,) [SI]
        predicted: (n,) [SI]
        covariance: (n, n) [SI^2] of measured less predicted: noise of the group, and uncertainty of the prediction; NaN
            if the others do not determine the prediction.
        ended: whether the fit to the others has converged to an optimum.
    """

    name: str
    places: Int[np.ndarray, "n"]
    measured: Float[np.ndarray, "n"]
    predicted: Float[np.ndarray, "n"]
    covariance: Float[np.ndarray, "n n"]
    ended: bool

    @property
    def off(self) -> Float[np.ndarray, "n"]:
        """Measured less predicted [SI]."""
        return self.measured - self.predicted

    @property
    def sd(self) -> Float[np.ndarray, "n"]:
        """Standard deviation [SI] of measured less predicted."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def told(self) -> bool:
        """Whether the others determine a prediction."""
        return self.ended and bool(np.isfinite(self.covariance).all())

    @property
    def p_value(self) -> float:
        """P-value of the group's distance from its prediction, all values together; NaN without a prediction."""
        from scipy.special import chdtrc

        if not self.told:
            return np.nan
        return float(chdtrc(len(self.off), self.off @ np.linalg.solve(self.covariance, self.off)))


def held_out(
    fit: Fit, groups: Mapping[str, Sequence[int]], progress: Callable[[Iterable[int]], Iterable[int]] = iter
) -> tuple[HeldOut, ...]:
    """Leave out each group of values, fit the others again, and predict the group.

    The assignment of values, such as the mode of a label, stays as in the fit to all: it is not tested.

    Args:
        fit: a fit to all.
        groups: indices of the values by the group's name.
        progress: wraps the numbers of the groups, to show a bar.
    """
    named = list(groups.items())
    return tuple(_held_out(fit, named[k][0], np.asarray(named[k][1], int)) for k in progress(range(len(named))))


def _held_out(fit: Fit, name: str, places: Int[np.ndarray, "n"]) -> HeldOut:
    sigma = np.asarray(fit.problem.sigma).copy()
    noise = sigma[places]
    groups = fit.problem.errors.groups
    sigma[np.isin(groups, groups[places]) & (groups >= 0)] = np.inf  # errors correlated with the group's
    sigma[places] = np.inf
    problem = fit.problem.with_sigma(sigma)
    starts = [fit.best.theta, *(rival.theta for rival in fit.rivals)]
    ends = [ended(problem, solve(problem, theta, fit.end)) for theta in starts]
    end, how = min(ends, key=lambda each: (not np.isfinite(each[0].cost), not each[1].converged, each[0].score))
    held = fit.choice.held
    there = look(problem, end.theta, held.by_shape() if held is not None else None)
    kept, slope = np.isfinite(sigma), np.asarray(there.jacobian)
    unknown = problem.parameters
    known = information(problem.scaled(slope)[kept], unknown.normal_sd, unknown.names)
    with np.errstate(invalid="ignore"):
        open_part = slope[places] @ known.covariance @ slope[places].T
    measured = np.asarray(problem.measured)[places]
    covariance = open_part + np.outer(noise, noise) * fit.problem.errors.matrix(places)
    return HeldOut(name, places, measured, np.asarray(there.predicted)[places], covariance, how.converged)


# -------- Robust
# Robust weights: outliers count less, by iteratively reweighted least squares.

HUBER = 1.345
"""Sigmas beyond which a value counts less: 95 % efficient for normal errors."""
FREEDOM = 4.0
"""Degrees of freedom of Student's t (Lange, Little, Taylor, JASA 84, 1989)."""
SUSPICIOUS = 0.5
"""Weight below which a value is reported; assumed."""
STEPS, SETTLED = 60, 1e-3
"""Most iterations, and the largest change of any weight at which they stop."""


def robust_weights(fit: Fit, units: Int[np.ndarray, "D"], loss: str) -> Float[np.ndarray, "D"]:
    """Return the weight of each value at which weights and optimum agree, from the optimum of a fit.

    With r the rms of the scaled residuals of a unit, the variance of its values becomes sigma^2 / w: for `huber`
    w = min(1, k / r), which limits the pull of a value; for `t` w = (n + 1) / (n + r^2), so that the pull falls with
    distance, as for errors of Student's t. As `t` may have several optima, it starts with the weights of `huber`.

    Args:
        fit: the start; its problem has the stated sigmas.
        units: unit number of each value: the components of a vector share one.
        loss: `huber` or `t`.

    Raises:
        ConvergenceError: weights and optimum do not agree after many steps.

    References:
        Holland, Welsch, "Robust regression using iteratively reweighted least-squares", Commun. Stat. A6(9), 1977.
    """
    start = fit.best.theta, fit.predicted
    theta, predicted, weights = _settled(fit.problem, *start, units, lambda r: HUBER / np.maximum(r, HUBER))
    if loss == "huber":
        return weights
    return _settled(fit.problem, theta, predicted, units, lambda r: (FREEDOM + 1) / (FREEDOM + r**2))[2]


def _settled(
    problem: InverseProblem,
    theta: Float[np.ndarray, "P"],
    predicted: Float[np.ndarray, "D"],
    units: Int[np.ndarray, "D"],
    weigh: Callable[[Float[np.ndarray, "D"]], Float[np.ndarray, "D"]],
) -> tuple[Float[np.ndarray, "P"], Float[np.ndarray, "D"], Float[np.ndarray, "D"]]:
    weights, count = np.zeros(len(units)), np.bincount(units)
    for _ in range(STEPS):
        # rms of the scaled residuals of each value's unit
        squared = problem.scaled(predicted - np.asarray(problem.measured)) ** 2
        sizes = np.sqrt(np.bincount(units, squared)[units] / count[units])
        before, weights = weights, weigh(sizes)
        if np.abs(weights - before).max() < SETTLED:
            return theta, predicted, weights
        end = solve(weighted(problem, weights), theta)
        theta, predicted = np.asarray(end.theta), np.asarray(end.predicted)
    raise ConvergenceError("the robust weights have not settled; take the other loss, or leave out what is wrong")


def weighted(problem: InverseProblem, weights: Float[np.ndarray, "D"]) -> InverseProblem:
    """Return the problem with each value weighted."""
    return problem.with_sigma(np.asarray(problem.sigma) / np.sqrt(weights))
