"""Which two values, put into each other's row, would make a fit of data that do not fit."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Float, Int

from ident.inference.fit import Fit
from ident.inference.information import RANK_TOLERANCE
from ident.inference.least_squares import End, solve
from ident.inference.problem import InverseProblem
from ident.inference.score import row_tests
from ident.inference.verdicts import IMPROBABLE

TRIED = 4
"""Exchanges that are fitted anew: so many of those suspected, and the best ones along a straight line."""

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
        chi_squared: of the data, fitted anew with the two values exchanged.
        score: that, what the priors add, and what speaks against the labels, as of an `Optimum`.
    """

    rows: Pair
    chi_squared: float
    score: float = math.nan


def swap(pair: Pair) -> Moves:
    """Return the moves of two values that take each other's place."""
    return {pair[0]: pair[1], pair[1]: pair[0]}


def exchanges(
    fit: Fit, pairs: Sequence[Pair], suspected: Sequence[Pair] = (), moves: Callable[[Pair], Moves] = swap
) -> tuple[Exchange, ...]:
    """Return the exchanges after which nothing speaks against the fit any more, of the least chi-squared first.

    Values change places together with their sigmas, and with what their errors have in common with others. All pairs
    are compared by the least squares of the model along a straight line from the optimum; the best ones are fitted
    again from there, and from the parameters' starting values. It is a hint where to look: two values that were not
    exchanged may look so, where both are wrong.

    Args:
        fit: of data that do not fit.
        pairs: which values might be exchanged.
        suspected: those that are fitted anew wherever they come along the line, the first `TRIED` of them.
        moves: of all values that change places where two are exchanged.
    """
    blocks = [pairs[i : i + BLOCK] for i in range(0, len(pairs), BLOCK)]
    costs = np.concatenate([np.zeros(0), *(_costs(fit, [moves(pair) for pair in block]) for block in blocks)])
    nearest = [pairs[i] for i in np.argsort(costs, kind="stable")[:TRIED]]
    known = fit.problem.parameters
    starts = fit.best.theta, np.asarray(known.theta(known.column("start")))  # the data have led the first one astray
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
    """Tell whether neither chi-squared, nor a value, nor what was said of values speaks against an end."""
    if not (np.isfinite(end.cost) and end.choice.settled):
        return False
    from scipy.special import chdtrc

    if not chdtrc(fit.degrees_of_freedom, chi_squared) >= IMPROBABLE:
        return False
    residuals, slope = problem.weigh(end.predicted, np.asarray(end.jacobian), end.theta)
    return not row_tests(problem, np.asarray(residuals), np.asarray(slope)).outliers.any()


def _costs(fit: Fit, moves: Sequence[Moves]) -> Float[np.ndarray, "N"]:
    """Return the least cost of each exchange where predictions change along a straight line.

    With r the residuals and S their slope, it is r'r - (S'r)' (S'S)^+ S'r. An exchange changes a few rows of both: a
    value that comes to another row keeps its error, and is compared with that row's prediction. With X = [S, r] in
    sigmas, R the correlation of the errors and D what changes, the squares are (X + D)' R^-1 (X + D).
    """
    problem = fit.problem
    residuals, slope = problem.weigh(fit.predicted, np.asarray(fit.jacobian), fit.best.theta)
    measured, sigma = np.asarray(problem.measured), np.asarray(problem.sigma)
    rows = np.concatenate([slope, residuals[:, None]], 1)
    here, there = _aligned(moves)
    moved = (fit.predicted[here] - measured[there]) / sigma[there]
    new = np.concatenate([fit.jacobian[here] / sigma[there][:, :, None], moved[:, :, None]], 2)
    squares = rows.T @ rows
    if problem.correlation is None:
        old = np.concatenate([slope[here], residuals[here][:, :, None]], 2)
        squares = squares + np.einsum("nip,niq->npq", new, new) - np.einsum("nip,niq->npq", old, old)
    else:
        R, off = problem.correlation, fit.predicted - measured
        whole = np.concatenate([fit.jacobian, off[:, None]], 1) / sigma[:, None]
        change = new - whole[there]
        cross = np.einsum("nip,niq->npq", change, R.pull_back(np.asarray(R.whiten(whole)))[there])
        own = np.einsum("nip,nij,njq->npq", change, R.inverse_among(there), change, optimize=True)
        squares = squares + cross + cross.swapaxes(1, 2) + own
    A, b, c = squares[:, :-1, :-1], squares[:, :-1, -1], squares[:, -1, -1]
    inverse = np.linalg.pinv(A, rcond=RANK_TOLERANCE, hermitian=True)
    return np.asarray(c - np.einsum("np,npq,nq->n", b, inverse, b))


def _aligned(moves: Sequence[Moves]) -> tuple[Int[np.ndarray, "N K"], Int[np.ndarray, "N K"]]:
    """Return the places of each exchange and where their values come from; the first place, unmoved, fills up."""
    most = max(map(len, moves))
    both = np.array([[*each.items(), *[(0, 0)] * (most - len(each))] for each in moves])
    return both[:, :, 0], both[:, :, 1]


def _moved(problem: InverseProblem, moves: Moves) -> InverseProblem:
    source = np.arange(len(problem.kinds))
    source[list(moves)] = list(moves.values())
    values = [jax.device_put(np.asarray(x)[source]) for x in (problem.measured, problem.sigma)]
    moved = eqx.tree_at(lambda p: (p.measured, p.sigma), problem, tuple(values))
    if problem.correlation is None:
        return moved
    return eqx.tree_at(lambda p: p.correlation, moved, jax.device_put(problem.correlation.moved(source)))
