"""Fit parameters to a campaign: least squares from several starts, and how far the answer can be trusted."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import jax
import numpy as np
from jaxtyping import Array, Float

from ident.errors import ModelError
from ident.inference.information import RANK_TOLERANCE, Information, half_width, information
from ident.inference.least_squares import End, evaluate, solve
from ident.inference.problem import Choice, InverseProblem

STARTS = 16
"""Starts tried at least, the given one among them."""
PATIENCE = 6
"""Starts tried at most, as a multiple of that, until the best optimum has been reached `AGAIN` times."""
AGAIN = 3
SPREAD = 1.0
"""Standard deviation in theta of the further starts about the given one: a factor of e for a stiffness."""
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
        converged: whether the gradient vanishes here.
        sd: (P,) standard deviation of each theta by data and prior about here.
    """

    values: Float[np.ndarray, "P"]
    theta: Float[np.ndarray, "P"]
    cost: float
    starts: int
    converged: bool
    sd: Float[np.ndarray, "P"]


@dataclass(frozen=True)
class Fit:
    """The best optimum, the others, and what the data tell there.

    Attributes:
        problem: what was fitted.
        optima: distinct optima by ascending cost; the first one is the answer.
        failed: number of starts that reached none: no equilibrium, or stuck where a mode changes its label.
        predicted: (D,) [SI] at the answer.
        jacobian: (D, P) d(predicted)/d(theta) there.
        information: what data and prior tell there.
        choice: what the model takes the values for there.
    """

    problem: InverseProblem
    optima: tuple[Optimum, ...]
    failed: int
    predicted: Float[np.ndarray, "D"]
    jacobian: Float[np.ndarray, "D P"]
    information: Information
    choice: Choice

    @property
    def best(self) -> Optimum:
        """The optimum of least cost."""
        return self.optima[0]

    @property
    def parameters(self) -> dict[str, float]:
        """The fitted numbers [SI] by path, ties spelled out."""
        return {k: float(v) for k, v in self.problem.parameters.by_path(self.best.values).items()}

    @property
    def residuals(self) -> Float[np.ndarray, "D"]:
        """(predicted - measured) / sigma."""
        return (self.predicted - np.asarray(self.problem.measured)) / np.asarray(self.problem.sigma)

    @property
    def chi_squared(self) -> float:
        """Sum of the squared residuals of the data."""
        return float(np.sum(self.residuals**2))

    @property
    def degrees_of_freedom(self) -> int:
        """Number of fitted values less the number of directions that they see."""
        return int(np.isfinite(self.problem.sigma).sum()) - self.information.rank

    @property
    def p_value(self) -> float:
        """Chance of a larger chi-squared if model and sigmas are right; NaN without degrees of freedom."""
        if not self.degrees_of_freedom > 0:
            return np.nan
        from scipy.special import chdtrc  # takes a tenth of a second, which fits without degrees of freedom can spare

        return float(chdtrc(self.degrees_of_freedom, self.chi_squared))

    @property
    def rivals(self) -> tuple[Optimum, ...]:
        """Further optima that the data do not rule out: of a cost within the 95 % limit of the best one's."""
        limit = self.best.cost + half_width(0.95) ** 2
        return tuple(optimum for optimum in self.optima[1:] if optimum.converged and optimum.cost < limit)

    @property
    def ties(self) -> int:
        """Number of optima that fit exactly as well as the best one: then the answer is one of several."""
        return sum(optimum.converged and is_tie(optimum.cost, self.best.cost) for optimum in self.optima[1:])

    def interval(self, level: float = 0.95) -> Float[np.ndarray, "P 2"]:
        """Return intervals of the parameters [SI] by data and prior, normal in theta.

        An interval reaches over all optima that the data do not rule out: about each, as far as the cost rises to the
        same height above the best one's.
        """
        height, ends = half_width(level) ** 2, []
        for optimum in (self.best, *self.rivals):
            above = optimum.cost - self.best.cost
            if above < height:
                half = np.sqrt(height - above) * optimum.sd
                ends += [optimum.theta - half, optimum.theta + half]
        reach = np.stack([np.min(ends, 0), np.max(ends, 0)], 1)
        return np.asarray(self.problem.parameters.values(reach))

    @property
    def predicted_sd(self) -> Float[np.ndarray, "D"]:
        """Standard deviations [SI] of the predictions by what data and prior tell of the parameters."""
        return np.sqrt(np.einsum("dp,pq,dq->d", self.jacobian, self.information.covariance, self.jacobian))


def fit(
    problem: InverseProblem,
    *,
    starts: int = STARTS,
    spread: float = SPREAD,
    seed: int = 0,
    progress: Callable[[Iterable[int]], Iterable[int]] = iter,
) -> Fit:
    """Fit the parameters by Levenberg-Marquardt from several starts.

    After `starts` of them the search goes on, up to `PATIENCE` times as many, until `AGAIN` starts have ended in the
    best optimum: an optimum that was met once only may not be the best one.

    Args:
        problem: model, data and unknowns.
        starts: number of starts at least: the parameters' own, the others normal about it; 1 for that one alone.
        spread: their standard deviation in theta.
        seed: of the starts.
        progress: wraps the numbers of the starts, to show a bar.

    Raises:
        ModelError: no start reaches an optimum; says whether the model has an answer at the first one.
    """
    first = problem.parameters.theta(problem.parameters.column("start"))
    noise = np.random.default_rng(seed).standard_normal((starts * PATIENCE, len(first))) * spread
    noise[0] = 0
    reached: list[End] = []
    optima: tuple[Optimum, ...] = ()
    tried = 0
    for tried in progress(range(1, 1 + (starts * PATIENCE if starts > 1 else 1))):
        example = min(reached, key=_score, default=None)
        end = solve(problem, first + noise[tried - 1], example)
        if np.isfinite(end.cost):
            reached.append(jax.tree.map(np.asarray, end))
            optima = _distinct(problem, reached)
        if tried >= starts and optima and optima[0].starts >= AGAIN:
            break
    if not reached:
        raise ModelError(_no_optimum(evaluate(problem).predicted))
    best = next(end for end in reached if end.theta is optima[0].theta)
    scaled = best.jacobian / np.asarray(problem.sigma)[:, None]
    known = information(scaled, _prior_sd(problem), problem.parameters.names)
    ended = sum(optimum.starts for optimum in optima)
    return Fit(problem, optima, tried - ended, best.predicted, best.jacobian, known, best.choice)


def _score(end: End) -> float:
    return end.score


def _distinct(problem: InverseProblem, ends: list[End]) -> tuple[Optimum, ...]:
    """Merge ends that data and prior cannot tell apart: a flat valley is one optimum, however long and curved.

    Ends with a gradient are dropped, unless the best one has it.
    """
    groups: list[list[End]] = []
    sigma, prior_sd = np.asarray(problem.sigma), _prior_sd(problem)
    for end in _in_order(problem, ends):
        for group in groups:
            step = end.theta - group[0].theta
            apart = np.concatenate([group[0].jacobian @ step / sigma, step / prior_sd])
            near = min(np.linalg.norm(apart), np.abs(step).max()) < SAME * (1 + end.cost) ** 0.5
            level = abs(end.cost - group[0].cost) < SAME * SAME * (1 + end.cost)
            if near or (level and _is_valley(group[0].jacobian / sigma[:, None], prior_sd)):
                group.append(end)
                break
        else:
            groups.append([end])
    optima = [group for i, group in enumerate(groups) if i == 0 or any(end.converged for end in group)]
    return tuple(_optimum(problem, group) for group in optima)


def _in_order(problem: InverseProblem, ends: list[End]) -> list[End]:
    """Sort ends by cost; exact ties by the distance from the priors' centre, then by theta: the same on any machine.

    Of a parameter without a prior the starting value is the centre.
    """
    parameters = problem.parameters
    ranks: list[tuple[int, float, tuple[float, ...], int]] = []
    centre = np.asarray(parameters.theta(parameters.column("centre")))
    ends = sorted(ends, key=_score)
    for i, end in enumerate(ends):
        level = ranks[-1][0] if i and is_tie(ends[i - 1].score, end.score) else i
        off = (end.theta - centre) / np.minimum(parameters.normal_sd, 1.0)
        ranks.append((level, round(float(off @ off), DIGITS), tuple(np.round(end.theta, DIGITS)), i))
    return [ends[rank[-1]] for rank in sorted(ranks)]


def is_tie(a: float, b: float) -> bool:
    """Tell whether two costs are the same but for rounding and where the searches stopped."""
    return abs(a - b) < TIE * (1 + abs(a))


def _optimum(problem: InverseProblem, group: list[End]) -> Optimum:
    first = group[0]
    scaled = first.jacobian / np.asarray(problem.sigma)[:, None]
    return Optimum(
        np.asarray(problem.parameters.values(first.theta)),
        first.theta,
        float(first.cost),
        len(group),
        any(end.converged for end in group),
        information(scaled, _prior_sd(problem), problem.parameters.names).sd,
    )


def _prior_sd(problem: InverseProblem) -> np.ndarray:
    """Return the priors' standard deviations in theta; infinite for flat ones, whose edges are one-sided."""
    parameters = problem.parameters
    return np.where(np.asarray(parameters.column("flat")) > 0, np.inf, np.asarray(parameters.column("prior_sd")))


def _is_valley(scaled: np.ndarray, prior_sd: np.ndarray) -> bool:
    """Tell whether data and prior together leave a direction open."""
    s = np.linalg.svd(np.vstack([scaled, np.diag(1 / prior_sd)]), compute_uv=False)
    return bool(s[-1] < RANK_TOLERANCE * s[0])


def _no_optimum(predicted: Array) -> str:
    missing = int(np.isnan(np.asarray(predicted)).sum())
    if not missing:
        return "no start reached an optimum; give other starting values or a prior"
    return (
        f"the model has no answer for {missing} of {len(predicted)} values at the start: the arm has no stable"
        " equilibrium there, or no mode of that label; raise the starting stiffness or check the labels"
    )
