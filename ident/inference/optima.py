"""Where the starts of a fit ended: which ends are one optimum, in which order, and how well each is known."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from ident.inference.convergence import Convergence
from ident.inference.information import RANK_TOLERANCE, half_width, information
from ident.inference.least_squares import End
from ident.inference.problem import InverseProblem

Ended = tuple[End, Convergence]
"""Where a search ended, and how."""
TIE, DIGITS = 1e-6, 4
"""Relative difference of two costs that is none; decimals of theta, and of a distance, by which ties are ordered."""
SAME = 1e-3
"""Ends nearer to each other than this, in standard deviations of the data or of theta, are one optimum."""


@dataclass(frozen=True)
class Optimum:
    """Where one or several starts ended.

    Attributes:
        values: (P,) parameters [SI].
        theta: (P,) the same, unconstrained.
        cost: sum of squared residuals, data and prior.
        starts: number of starts that ended here.
        converged: whether the next step is negligible, in all directions but the open ones.
        open: (N, P) directions in theta along which the cost stays flat or still falls over several e-folds.
        sd: (P,) standard deviation of each theta by data and prior about here.
        said: minus twice the logarithm of the probability of what was said of the values, such as modes' labels.
    """

    values: Float[np.ndarray, "P"]
    theta: Float[np.ndarray, "P"]
    cost: float
    starts: int
    converged: bool
    open: Float[np.ndarray, "N P"]
    sd: Float[np.ndarray, "P"]
    said: float = 0.0

    @property
    def score(self) -> float:
        """What optima are compared by: the cost, and what speaks against labels."""
        return self.cost + self.said


def rivals(optima: Sequence[Optimum]) -> tuple[Optimum, ...]:
    """Return the further optima that the data do not rule out: of a cost within the 95 % limit of the first one's."""
    limit = optima[0].score + half_width(0.95) ** 2
    return tuple(optimum for optimum in optima[1:] if optimum.converged and optimum.score < limit)


def unmet(optima: Sequence[Optimum]) -> float:
    """Return how many optima are expected beyond the best one and its rivals, by how often each of these was met.

    With w of them met in n starts, w (n - 1) / (n - w - 2) are expected in all, if starts are independent and any
    sizes of the regions that lead to them are equally probable beforehand (Boender & Rinnooy Kan, "Bayesian stopping
    rules for multistart global optimization methods", Math. Programming 37, 1987). A single one that was never beside
    another expects none.
    """
    near = [optima[0], *rivals(optima)]
    n, w = sum(optimum.starts for optimum in near), len(near)
    if w == 1:
        return 0.0
    return w * (n - 1) / (n - w - 2) - w if n > w + 2 else np.inf


def distinct(problem: InverseProblem, ends: list[Ended]) -> tuple[Optimum, ...]:
    """Merge ends that data and prior cannot tell apart: a flat valley is one optimum, however long and curved.

    Ends that are no optimum are dropped, unless it is the best one.
    """
    groups: list[list[Ended]] = []
    prior_sd = normal_prior_sd(problem)
    scaled = problem.scaled  # once: equinox makes a module of a method each time that it is looked up
    for end, how in in_order(problem, ends):
        for group in groups:
            first, _ = group[0]
            step = end.theta - first.theta
            apart = np.concatenate([scaled(np.asarray(first.jacobian @ step)), step / prior_sd])
            near = min(np.linalg.norm(apart), np.abs(step).max()) < SAME * (1 + end.cost) ** 0.5
            level = abs(end.cost - first.cost) < SAME * SAME * (1 + end.cost)
            if near or (level and _is_valley(scaled(np.asarray(first.jacobian)), prior_sd)):
                group.append((end, how))
                break
        else:
            groups.append([(end, how)])
    optima = [group for i, group in enumerate(groups) if i == 0 or any(how.converged for _, how in group)]
    return tuple(_optimum(problem, group) for group in optima)


def in_order(problem: InverseProblem, ends: list[Ended]) -> list[Ended]:
    """Sort ends by score; ties by the distance from the priors' centre, then by theta: the same on any machine."""
    parameters = problem.parameters
    centre, scale = np.asarray(parameters.theta(parameters.column("centre"))), np.minimum(parameters.normal_sd, 1.0)
    ranks: list[tuple[int, float, tuple[float, ...], int]] = []
    scores = [end.score for end, _ in ends]  # once each: ends are ordered after every start
    places = sorted(range(len(ends)), key=scores.__getitem__)
    ends, scores = [ends[place] for place in places], [scores[place] for place in places]
    for i, (end, _) in enumerate(ends):
        level = ranks[-1][0] if i and is_tie(scores[i - 1], scores[i]) else i
        off = (end.theta - centre) / scale
        ranks.append((level, round(float(off @ off), DIGITS), tuple(np.round(end.theta, DIGITS).tolist()), i))
    return [ends[rank[-1]] for rank in sorted(ranks)]


def is_tie(a: float, b: float) -> bool:
    """Tell whether two costs are the same but for rounding and where the searches stopped."""
    return abs(a - b) < TIE * (1 + abs(a))


def _optimum(problem: InverseProblem, group: list[Ended]) -> Optimum:
    first, how = group[0]
    scaled = problem.scaled(np.asarray(first.jacobian))
    return Optimum(
        np.asarray(problem.parameters.values(first.theta)),
        first.theta,
        float(first.cost),
        len(group),
        any(how.converged for _, how in group),
        how.open,
        information(scaled, normal_prior_sd(problem), problem.parameters.names).sd,
        float(first.choice.cost.sum()),
    )


def normal_prior_sd(problem: InverseProblem) -> np.ndarray:
    """Return the priors' standard deviations in theta; infinite for flat ones, whose edges are one-sided."""
    parameters = problem.parameters
    return np.where(np.asarray(parameters.column("flat")) > 0, np.inf, np.asarray(parameters.column("prior_sd")))


def _is_valley(scaled: np.ndarray, prior_sd: np.ndarray) -> bool:
    """Tell whether data and prior together leave a direction open."""
    s = np.linalg.svd(np.vstack([scaled, np.diag(1 / prior_sd)]), compute_uv=False)
    return bool(s[-1] < RANK_TOLERANCE * s[0])
