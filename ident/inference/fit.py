"""Fit parameters to a campaign: least squares from several starts, and how far the answer can be trusted."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float

from ident.errors import ConvergenceError, ModelError
from ident.inference.cross_prediction import CrossPrediction, contradicting, cross_predictions
from ident.inference.curvature import stretches
from ident.inference.descent import ended
from ident.inference.information import Direction, Information, half_width, information
from ident.inference.least_squares import End, evaluate, solve
from ident.inference.optima import Ended, Optimum, distinct, in_order, is_tie, normal_prior_sd, rivals, unmet
from ident.inference.problem import Choice, InverseProblem
from ident.inference.score import RowTests, blamed, row_tests
from ident.inference.searcher import Searcher
from ident.inference.verdicts import IMPROBABLE, farthest

FIT_STARTS = 16
"""Starts tried at least, the given one among them."""
PATIENCE = 6
"""Starts tried at most, as a multiple of that, until the best optimum has been reached `AGAIN` times."""
AGAIN = 3
UNMET = 0.5
"""Expected number of rivals that were not met, below which the search may end where it has met one."""
FIT_SPREAD = 1.0
"""Standard deviation in theta of the further starts about the given one: a factor of e for a stiffness."""


@dataclass(frozen=True)
class Fit:
    """The best optimum, the others, and what the data tell there.

    Attributes:
        problem: what was fitted.
        optima: distinct optima by ascending cost; the first one is the answer.
        failed: number of starts that reached none: no equilibrium, or a search that did not end.
        predicted: (D,) [SI] at the answer.
        jacobian: (D, P) d(predicted)/d(theta) there.
        information: what data and prior tell there.
        choice: what the model takes the values for there.
        cross_predictions: each kind of measurement against the others.
        stretch: (P, 2) factor of the halves of each interval, below and above; 1 where the linear one serves.
        beaten: (P,) theta where the cost is less than the answer's, and a search found no better optimum all the same.
        combinations: of parameters that the data fix, with the widths of their profiles, where these were looked for;
            see `ident.inference.curvature.fixed_combinations`.
    """

    problem: InverseProblem
    optima: tuple[Optimum, ...]
    failed: int
    predicted: Float[np.ndarray, "D"]
    jacobian: Float[np.ndarray, "D P"]
    information: Information
    choice: Choice
    cross_predictions: tuple[CrossPrediction, ...] = ()
    stretch: Float[np.ndarray, "P 2"] | None = None
    beaten: Float[np.ndarray, "P"] | None = None
    combinations: tuple[Direction, ...] = ()

    @property
    def best(self) -> Optimum:
        """The optimum of least cost."""
        return self.optima[0]

    @property
    def end(self) -> End:
        """The answer as the end of a search."""
        best = self.best
        return End(best.theta, best.cost, np.zeros_like(best.theta), self.predicted, self.jacobian, self.choice)

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
        """Sum of the squared residuals of the data, independent ones where errors are correlated, and of nuisances."""
        off = np.asarray(self.predicted) - np.asarray(self.problem.measured)
        parameters = self.problem.parameters
        known = np.asarray(parameters.prior_residuals(self.best.theta)[0])[parameters.nuisance]
        return float(np.sum(self.problem.scaled(off) ** 2) + np.sum(known**2))

    @property
    def degrees_of_freedom(self) -> int:
        """Number of fitted values less the number of directions that they see, or are spent on."""
        return int(np.isfinite(self.problem.sigma).sum()) - self.information.rank - self.information.spent

    @property
    def p_value(self) -> float:
        """Chance of a larger chi-squared if model and sigmas are right; NaN without degrees of freedom."""
        if not self.degrees_of_freedom > 0:
            return np.nan
        from scipy.special import chdtrc  # takes a tenth of a second, which fits without degrees of freedom can spare

        return float(chdtrc(self.degrees_of_freedom, self.chi_squared))

    @property
    def improbable(self) -> bool:
        """Whether so large a chi-squared is improbable if model and sigmas are right."""
        return self.p_value < IMPROBABLE

    @property
    def misfits(self) -> bool:
        """Whether chi-squared, or where it says nothing a single value, lies too far from the model to be believed.

        By sigma: without degrees of freedom a standardised residual sets a value against the priors alone, and no other
        optimum would mend that.
        """
        if not np.isnan(self.p_value):
            return self.improbable
        limit = farthest(int(np.isfinite(np.asarray(self.problem.sigma)).sum()))
        return bool((np.abs(self.residuals) > limit).any())

    @property
    def contradictory(self) -> bool:
        """Whether one kind of measurement contradicts the others."""
        return bool(contradicting(self.cross_predictions))

    @cached_property
    def row_tests(self) -> RowTests:
        """Of each measurement, whether it is off by more than its error."""
        return row_tests(self.problem, *self._weighed)

    @property
    def blamed(self) -> tuple[tuple[int, ...], ...]:
        """The measurements, or vectors, any one of which may be wrong: without it no other lies too far off."""
        return blamed(self.problem, *self._weighed)

    @property
    def _weighed(self) -> tuple[np.ndarray, np.ndarray]:
        residuals, slope = self.problem.weigh(self.predicted, np.asarray(self.jacobian), self.best.theta)
        return np.asarray(residuals), np.asarray(slope)

    @property
    def outliers(self) -> Bool[np.ndarray, "D"]:
        """Which measurements lie too far from the fit for so many."""
        return self.row_tests.outliers

    @property
    def doubts(self) -> tuple[str, ...]:
        """Why no interval should be quoted from this fit; empty when nothing speaks against it."""
        count, limit = self.outliers.sum(), self.row_tests.limit
        fitted = int(np.isfinite(np.asarray(self.problem.sigma)).sum())
        reasons = {
            "the search has not ended here, so this is not an optimum": not self.best.converged,
            "the cost is less elsewhere, so there is a better optimum: fit again with more starts": (
                self.beaten is not None
            ),
            "the kinds of measurement contradict each other (see below)": self.contradictory,
            f"{count} of {fitted} measurements lie too far from the fit (standardised residual beyond {limit:.1f})": (
                count > 0
            ),
            f"so large a chi-squared has a chance of {self.p_value:.1g}": self.improbable,
        }
        return tuple(doubt for doubt, holds in reasons.items() if holds)

    @property
    def remarks(self) -> tuple[str, ...]:
        """What is odd about this fit, though it forbids no interval."""
        chi_squared, freedom = self.without_rounding
        if not freedom > 0:
            return ()
        from scipy.special import chdtr

        if not (chance := float(chdtr(freedom, chi_squared))) < IMPROBABLE:
            return ()
        return (f"so small a chi-squared has a chance of {chance:.1g}: are the sigmas too large, or rows copied?",)

    @property
    def without_rounding(self) -> tuple[float, int]:
        """Chi-squared and degrees of freedom without what is small for another reason than sigmas: here nothing."""
        return self.chi_squared, self.degrees_of_freedom

    @property
    def supported(self) -> Bool[np.ndarray, "P"]:
        """Which parameters an interval may be quoted for: none where the fit itself is in doubt.

        That of a nuisance rests on its prior, as it is meant to.
        """
        return (self.information.supported | self.problem.parameters.nuisance) & (not self.doubts)

    @property
    def rivals(self) -> tuple[Optimum, ...]:
        """Further optima that the data do not rule out: of a cost within the 95 % limit of the best one's."""
        return rivals(self.optima)

    @property
    def ties(self) -> int:
        """Number of optima that fit exactly as well as the best one: then the answer is one of several."""
        return sum(optimum.converged and is_tie(optimum.score, self.best.score) for optimum in self.optima[1:])

    def interval(self, level: float = 0.95) -> Float[np.ndarray, "P 2"]:
        """Return intervals of the parameters [SI] by data and prior.

        They are normal in theta; where the cost bends too much for that, those whose parameters the data support reach
        to where the profile of the cost meets the 95 % limit, and those of another level in proportion. An interval
        reaches over all optima that the data do not rule out: about each, as far as the cost rises to the same height
        above the best one's.
        """
        height = half_width(level) ** 2
        stretch = np.ones((len(self.best.theta), 2)) if self.stretch is None else self.stretch
        halves = [
            (each.theta, np.sqrt(height - above) * each.sd[:, None] * (stretch if each is self.best else np.ones(2)))
            for each in (self.best, *self.rivals)
            if (above := each.score - self.best.score) < height
        ]
        low, high = (np.array([theta + (2 * i - 1) * half[:, i] for theta, half in halves]) for i in (0, 1))
        return np.asarray(self.problem.parameters.values(np.stack([low.min(0), high.max(0)], 1)))


def fit(
    problem: InverseProblem,
    *,
    starts: int = FIT_STARTS,
    spread: float = FIT_SPREAD,
    seed: int = 0,
    progress: Callable[[Iterable[int]], Iterable[int]] = iter,
) -> Fit:
    """Fit the parameters by Levenberg-Marquardt from several starts.

    After `starts` of them the search goes on, up to `PATIENCE` times as many, until `AGAIN` starts have ended in the
    best optimum: an optimum that was met once only may not be the best one. Nor may one that data do not fit, so that
    the search goes on there as well, before data are blamed. And where it has met rivals, until
    fewer than `UNMET` further ones are expected. Where the cost falls below the best one's on the way to the end of an
    interval, a search begins there.

    Args:
        problem: model, data and unknowns.
        starts: number of starts at least: the parameters' own, the others normal about it; 1 for that one alone.
        spread: their standard deviation in theta.
        seed: of the starts.
        progress: wraps the numbers of the starts, to show a bar.

    Raises:
        ConvergenceError: no start reaches an optimum.
        ModelError: none does, and the model has no answer at the first one.
    """
    first = problem.parameters.theta(problem.parameters.column("start"))
    noise = np.random.default_rng(seed).standard_normal((starts * PATIENCE, len(first))) * spread
    noise[0] = 0
    reached: list[Ended] = []
    optima: tuple[Optimum, ...] = ()
    search, tried = Searcher(problem), 0
    for tried in progress(range(1, 1 + (starts * PATIENCE if starts > 1 else 1))):
        example = in_order(problem, reached)[0][0] if reached else None
        end = search(first + noise[tried - 1], example)
        if np.isfinite(end.cost):
            reached.append(ended(problem, end))
            optima = distinct(problem, reached)
        met = tried >= starts and optima and optima[0].starts >= AGAIN and unmet(optima) < UNMET
        if met and not _answer(problem, reached, optima).misfits:
            break
    if not reached:
        raise _no_optimum(evaluate(problem).predicted)
    lost = tried - len(reached)
    for _ in range(AGAIN):
        found = _explained(problem, reached, lost, seed)
        if found.beaten is None:
            break
        reached.append(ended(problem, solve(problem, found.beaten)))
    return found


def _explained(problem: InverseProblem, reached: list[Ended], lost: int, seed: int) -> Fit:
    """Return the fit of the best end, with how far it can be trusted; a better end that is met thereby is added."""
    optima = distinct(problem, reached)
    agreement, least = cross_predictions(problem, [optimum.theta for optimum in optima], seed=seed)
    if least is not optima[0].theta:
        reached.append(ended(problem, solve(problem, least)))
        optima = distinct(problem, reached)
    failed = lost + len(reached) - sum(optimum.starts for optimum in optima)
    found = replace(_answer(problem, reached, optima), failed=failed, cross_predictions=agreement)
    return with_stretch(found)


def with_stretch(fit: Fit) -> Fit:
    """Return a fit whose intervals end where the cost has risen enough, for all that speaks against it otherwise."""
    fit = replace(fit, stretch=None, beaten=None)
    stretch, beaten = stretches(fit.problem, fit.best, fit.end, fit.supported)
    return replace(fit, stretch=stretch, beaten=beaten)


def _answer(problem: InverseProblem, reached: list[Ended], optima: tuple[Optimum, ...]) -> Fit:
    """Return the fit of the best end, before it is asked how far it can be trusted."""
    best, _ = in_order(problem, reached)[0]
    scaled = problem.scaled(np.asarray(best.jacobian))
    parameters = problem.parameters
    known = information(scaled, normal_prior_sd(problem), parameters.names, parameters.nuisance)
    return Fit(problem, optima, 0, best.predicted, best.jacobian, known, best.choice)


def _no_optimum(predicted: Float[np.ndarray, "D"]) -> ModelError:
    missing = int(np.isnan(np.asarray(predicted)).sum())
    if not missing:
        return ConvergenceError("no start reached an optimum; give other starting values or a prior")
    return ModelError(
        f"the model has no answer for {missing} of {len(predicted)} values at the start: the arm has no stable"
        " equilibrium there; raise the starting stiffness, or check loads and masses"
    )
