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
# Which two values, put into each other's row, would make a fit of data that do not fit.

TRIED = 4
"""Swaps that are fitted again: so many of those suspected, and the best ones along a straight line."""

BLOCK = 1000
"""Exchanges whose matrices are in memory at once: of twenty parameters some 20 MB."""

Pair = tuple[int, int]
"""Places of two values."""
Moves = Mapping[int, int]
"""Where the value comes from that a place gets."""


@dataclass(frozen=True)
class Exchange:
    """Two values that may have been taken for each other.

    Attributes:
        rows: their places.
        chi_squared: of the data, fitted again with the two values swapped.
        score: that, what the priors add, and the label cost, as of an `Optimum`.
    """

    rows: Pair
    chi_squared: float
    score: float = math.nan


def exchanges(
    fit: Fit, pairs: Sequence[Pair], suspected: Sequence[Pair], moves: Callable[[Pair], Moves]
) -> tuple[Exchange, ...]:
    """Return the swaps after which no objection to the fit is left, of the least chi-squared first.

    Values change places together with their sigmas, and with what their errors have in common with others. All pairs
    are compared by the least squares of the model along a straight line from the optimum; the best ones are fitted
    again from there, and from the parameters' starting values. It is a hint where to look: two values that were not
    exchanged may look so, where both are wrong.

    Args:
        fit: of data that do not fit.
        pairs: which values might be exchanged.
        suspected: those that are fitted again wherever they come along the line, the first `TRIED` of them.
        moves: of all values that change places where two are exchanged.
    """
    blocks = [pairs[i : i + BLOCK] for i in range(0, len(pairs), BLOCK)]
    costs = np.concatenate([np.zeros(0), *(_costs(fit, [moves(pair) for pair in block]) for block in blocks)])
    nearest = [pairs[i] for i in np.argsort(costs, kind="stable")[:TRIED]]
    starts = fit.best.theta, fit.problem.parameters.theta_start  # the data have led the first one astray
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
    """Tell whether chi-squared, values, kinds and what was said of values all agree with an end, as a verdict asks."""
    if not (np.isfinite(end.cost) and end.choice.settled):
        return False
    from scipy.special import chdtrc

    if not chdtrc(fit.degrees_of_freedom, chi_squared) >= IMPROBABLE:
        return False
    return agrees(problem, *weighed(problem, end))


def _costs(fit: Fit, moves: Sequence[Moves]) -> Float[np.ndarray, "N"]:
    """Return the least cost of each exchange where predictions change along a straight line.

    With r the residuals and S their slope, it is r'r - (S'r)' (S'S)^+ S'r. An exchange changes a few rows of both: a
    value that comes to another row keeps its error, and is compared with that row's prediction. With X = [S, r] in
    sigmas, R the correlation of the errors and D what changes, the squares are (X + D)' R^-1 (X + D).
    """
    problem, R = fit.problem, fit.problem.errors
    residuals, slope = weighed(problem, fit.end)
    measured, sigma = np.asarray(problem.measured), np.asarray(problem.sigma)
    rows = np.concatenate([slope, residuals[:, None]], 1)
    most = max(map(len, moves))  # the first place, unmoved, fills up
    both = np.array([[*each.items(), *[(0, 0)] * (most - len(each))] for each in moves])
    here, there = both[:, :, 0], both[:, :, 1]  # the places, and where their values come from
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
# What a fit predicts of data that it has not seen: groups of values, left out in turn, from the rest.


@dataclass(frozen=True)
class HeldOut:
    """A group of values, predicted by a fit to all others.

    Attributes:
        name: of the group.
        places: (n,) of its values among all.
        measured: (n,) [SI]
        predicted: (n,) [SI]
        covariance: (n, n) [SI^2] of measured less predicted: noise of the group, and what the others leave open; NaN
            where they leave the prediction open.
        ended: whether the fit to the others has ended in an optimum.
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
        """Standard deviation [SI] of what is measured about what is predicted."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def told(self) -> bool:
        """Whether the others tell what to expect."""
        return self.ended and bool(np.isfinite(self.covariance).all())

    @property
    def p_value(self) -> float:
        """Chance of values so far from the prediction, all of the group together; NaN where nothing is predicted."""
        from scipy.special import chdtrc

        if not self.told:
            return np.nan
        return float(chdtrc(len(self.off), self.off @ np.linalg.solve(self.covariance, self.off)))


def held_out(
    fit: Fit, groups: Mapping[str, Sequence[int]], progress: Callable[[Iterable[int]], Iterable[int]] = iter
) -> tuple[HeldOut, ...]:
    """Leave out each group of values, fit the others again, and predict the group.

    What a value belongs to, such as which mode a label means, is taken from the fit to all: it is not what is tested.

    Args:
        fit: a fit to all.
        groups: places of the values by the group's name.
        progress: wraps the numbers of the groups, to show a bar.
    """
    named = list(groups.items())
    return tuple(_held_out(fit, named[k][0], np.asarray(named[k][1], int)) for k in progress(range(len(named))))


def _held_out(fit: Fit, name: str, places: Int[np.ndarray, "n"]) -> HeldOut:
    sigma = np.asarray(fit.problem.sigma).copy()
    noise = sigma[places]
    groups = fit.problem.errors.groups
    sigma[np.isin(groups, groups[places]) & (groups >= 0)] = np.inf  # those that would tell of their errors
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
# Robust weights: values too far off for their sigma count less, by iteratively reweighted least squares.

HUBER = 1.345
"""Sigmas from which on a value counts less: 95 % efficient where errors are normal."""
FREEDOM = 4.0
"""Degrees of freedom of Student's t (Lange, Little, Taylor, JASA 84, 1989)."""
SUSPICIOUS = 0.5
"""Weight below which a value is named; assumed."""
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
        # the root of the mean square of the scaled residuals of each value's unit
        squared = problem.scaled(predicted - np.asarray(problem.measured)) ** 2
        sizes = np.sqrt(np.bincount(units, squared)[units] / count[units])
        before, weights = weights, weigh(sizes)
        if np.abs(weights - before).max() < SETTLED:
            return theta, predicted, weights
        end = solve(weighted(problem, weights), theta)
        theta, predicted = np.asarray(end.theta), np.asarray(end.predicted)
    raise ConvergenceError("the robust weights have not settled; take the other loss, or leave out what is wrong")


def weighted(problem: InverseProblem, weights: Float[np.ndarray, "D"]) -> InverseProblem:
    """Return the problem in which each value counts by its weight."""
    return problem.with_sigma(np.asarray(problem.sigma) / np.sqrt(weights))
