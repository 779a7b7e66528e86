"""Whether other values give the very same data: a search, before any measured value counts."""

from dataclasses import dataclass

import equinox as eqx
import jax
import numpy as np

from ident.inference.convergence import convergence
from ident.inference.fit import UNMET
from ident.inference.information import half_width
from ident.inference.least_squares import End, without_priors
from ident.inference.optima import SAME, Ended, Optimum, distinct, is_tie, unmet
from ident.inference.problem import InverseProblem
from ident.inference.searcher import Searcher

STARTS = 16
"""Starts at least."""
MOST = 96
"""Starts at most, where other solutions are met, and more of them are expected."""
SPREAD = 1.0
"""Their standard deviation in theta, where the prior is not narrower: a factor of e for a stiffness."""


@dataclass(frozen=True)
class OtherSolutions:
    """What fits data as predicted at the starting values, beside these.

    Attributes:
        starts: number of starts that were tried.
        ended: number of them that ended in an optimum of any cost.
        exact: optima that give the same data, but for rounding.
        near: others that data of the given sigmas would hardly rule out: chi-squared within the 95 % limit.
    """

    starts: int
    ended: int
    exact: tuple[Optimum, ...]
    near: tuple[Optimum, ...]


def other_solutions(problem: InverseProblem, here: End, *, starts: int = STARTS, seed: int = 0) -> OtherSolutions:
    """Look for other values that give the same data as the starting values.

    A full rank of the Jacobian says that no others are near. Far away there may be some, by symmetry or else
    (local and global identifiability: Walter, Pronzato, "Identification of Parametric Models from Experimental Data",
    1997, ch. 2). Priors count nothing. What is found is a proof; that nothing is found is none.

    Args:
        problem: model, sigmas and unknowns.
        here: predictions at the starting values.
        starts: number of starts at least.
        seed: of the starts.
    """
    exact = eqx.tree_at(
        lambda p: p.measured, without_priors(problem, but_nuisances=True), jax.device_put(np.asarray(here.predicted))
    )
    start, width = np.asarray(here.theta), np.minimum(problem.parameters.normal_sd, SPREAD)
    noise = np.random.default_rng(seed).standard_normal((MOST, len(start))) * width
    reached: list[Ended] = []
    optima: tuple[Optimum, ...] = ()
    search, tried = Searcher(exact), 0
    for tried, step in enumerate(noise, 1):
        end = jax.device_get(search(start + step))
        how = convergence(exact, end) if np.isfinite(end.cost) else None
        if how and how.converged:
            reached.append((end, how))
            optima = distinct(exact, reached)
        if tried >= starts and (not optima or unmet(optima) < UNMET):
            break
    others = [optimum for optimum in optima if not _same(exact, optimum, here)]
    exactly = tuple(optimum for optimum in others if is_tie(0.0, optimum.cost))
    near = tuple(o for o in others if not is_tie(0.0, o.cost) and o.cost < half_width(0.95) ** 2)
    return OtherSolutions(tried, len(reached), exactly, near)


def _same(problem: InverseProblem, optimum: Optimum, here: End) -> bool:
    """Tell whether an optimum is the one at the starting values, by the distance in theta and in what is predicted."""
    step = optimum.theta - np.asarray(here.theta)
    moved = problem.scaled(np.asarray(here.jacobian) @ step)
    return bool(is_tie(0.0, optimum.cost) and min(np.linalg.norm(moved), np.abs(step).max()) < SAME)
