"""Fit parameters to a campaign: least squares from several starts, and objections to the result."""

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import jax
import numpy as np
from jaxtyping import Bool, Float

from ident.errors import ConvergenceError, ModelError
from ident.inference.information import (
    IMPROBABLE,
    RANK_TOLERANCE,
    Direction,
    Information,
    RowTests,
    blamed,
    farthest,
    half_width,
    information,
    p_in_words,
    rare,
    reached,
    row_tests,
    sigma_in_words,
    standard_deviations,
)
from ident.inference.optima import Ended, Optimum, distinct, in_order, is_tie, normal_prior_sd, rivals, stretches, unmet
from ident.inference.parameters import Parameter, Parameters
from ident.inference.problem import Choice, InverseProblem
from ident.inference.search import (
    OPTIMUM_STEP,
    End,
    Searcher,
    choosing,
    ended,
    evaluate,
    solve,
    stay,
    step_length,
    weighed,
)

# -------- Cross prediction
# Do the kinds of data contradict each other? Each kind is compared with the other kinds and the prior.

FEW = 6
"""Largest number of values of a kind for which each is also compared by itself; assumed."""
STARTS = 2
"""Random starts for each minimum, in addition to the known optima and the parameters' starting values."""
WIDE = 10.0
"""Factor on the priors' widths when a kind is fitted alone: wide enough for its data, but excluding absurd values."""
WIDER = 2.0
"""Factor on the priors' widths, to test whether a contradiction depends on them."""
SPREAD = 1.0
"""Largest standard deviation in theta of the random starts."""
SAME = 1e-6
"""Relative cost difference, over 1 + cost, treated as equal."""
NOTHING = 1e-3
"""Degrees of freedom below which a kind cannot contradict the others; assumed."""


@dataclass(frozen=True)
class CrossPrediction:
    """Comparison of one kind of data with its prediction from the other kinds and the prior.

    Attributes:
        kind: the kind that was left out of the fit.
        rows: (n,) indices of its values in the campaign.
        measured: (n,) [SI]
        predicted: (n,) [SI] at the optimum of all other kinds.
        z: (n,) [sd] standardised residual of each value alone; None without a contradiction, or for more than `FEW`
            values.
        statistic: minimum over all data, less the minima of the others and of this kind by itself.
        scale, degrees_of_freedom: statistic / scale has a chi-squared distribution if all is right.
        wider: the same p-value with priors twice as wide; NaN without a contradiction.
    """

    kind: str
    rows: tuple[int, ...]
    measured: Float[np.ndarray, "n"]
    predicted: Float[np.ndarray, "n"]
    z: Float[np.ndarray, "n"] | None
    statistic: float
    scale: float
    degrees_of_freedom: float
    wider: float = math.nan

    @property
    def p_value(self) -> float:
        """Chance of a larger statistic if model, sigmas and priors are right."""
        from scipy.special import chdtrc  # takes 0.1 s to import, and fits to one kind of data do not need it

        return float(chdtrc(self.degrees_of_freedom, self.statistic / self.scale))

    @property
    def sd(self) -> float:
        """The same as standard deviations of a single normal value."""
        return standard_deviations(self.p_value)


def contradicting(predictions: Sequence[CrossPrediction]) -> tuple[CrossPrediction, ...]:
    """Return the kinds that contradict the others, corrected for the number of kinds."""
    found = rare([each.p_value for each in predictions])
    return tuple(each for each, contradicts in zip(predictions, found, strict=True) if contradicts)


def contradiction_in_words(predictions: Sequence[CrossPrediction]) -> str:
    """Write which kinds contradict each other, with the p-value."""
    wrong, pair = contradicting(predictions), len(predictions) == 2
    kinds = " and ".join(cross.kind.replace("_", " ") for cross in (predictions if pair else wrong))
    largest = max((cross.sd for cross in wrong), default=0.0)
    return f"{kinds} data contradict {'each other' if pair else 'the others'} ({sigma_in_words(largest)})"


def cross_predictions(
    problem: InverseProblem, known: Sequence[Float[np.ndarray, "P"]], *, seed: int = 0
) -> tuple[tuple[CrossPrediction, ...], Float[np.ndarray, "P"]]:
    """Test each kind of measurement against the others, and the prior among these.

    With M the minimum of chi-squared and prior (for k alone, the priors are so wide, `WIDE`, that they hardly count),

        T = M(all) - M(all but k) - M(k alone).

    This is the parameter goodness of fit (Maltoni, Schwetz, "Testing the statistical compatibility of independent data
    sets", Phys. Rev. D 68, 033020, 2003, eq. 9), here with the prior among the others. For a linear model with truths
    drawn from the prior, T is a quadratic form of normal numbers; its mean and variance give a scaled chi-squared
    (Satterthwaite 1946). Without any prior that is chi-squared on rank(k) + rank(others) - rank(all) degrees of
    freedom. A flat prior counts as the normal one of the same mean and variance: T keeps its mean, but its tail is
    shorter, so that there are rather too few alarms.

    Args:
        problem: model, data and unknowns.
        known: starts: the fit's optima, the best one first.
        seed: of the further starts.

    Returns:
        One comparison for each kind that the others predict, none if there is only one kind; and theta of the least
        cost of all data: `known[0]`, or a better optimum met on the way.
    """
    kinds = sorted({k for k, s in zip(problem.kinds, np.asarray(problem.sigma), strict=True) if np.isfinite(s)})
    if len(kinds) < 2:
        return (), known[0]
    widths = moment_sd(problem.parameters)
    start = problem.parameters.theta_start
    noise = np.random.default_rng(seed).standard_normal((STARTS, len(start)))
    starts = [known[0], start, *known[1:2], *(start + noise * np.minimum(widths, SPREAD))]
    minima = _search(problem, widths, kinds, starts)
    if minima is None:
        return (), known[0]
    found = [each for kind in minima.parts if (each := minima.compared(kind)).degrees_of_freedom]
    least = minima.every.theta if minima.better else known[0]
    if not contradicting(found):
        return tuple(found), least
    found = [minima.by_value(each) for each in found]
    wider = _search(problem, WIDER * widths, [each.kind for each in found], [least, start])
    again = {kind: wider.compared(kind).p_value for kind in wider.parts} if wider else {}
    return tuple(replace(each, wider=again.get(each.kind, math.nan)) for each in found), least


def moment_sd(parameters: Parameters) -> Float[np.ndarray, "P"]:
    """Return the priors' own standard deviations in theta; infinite without a prior."""
    s, f = (np.asarray(parameters.column(name)) for name in ("prior_sd", "flat"))
    s_or_0, flank = np.where(np.isfinite(s), s, 0.0), math.sqrt(math.pi / 2)
    second = f**3 / 3 + f**2 * s_or_0 * flank + 2 * f * s_or_0**2 + s_or_0**3 * flank
    return np.sqrt(np.where(np.isfinite(s), second / np.where(np.isfinite(s), f + s_or_0 * flank, 1.0), np.inf))


def quadratic_form(
    jacobian: Float[np.ndarray, "D P"], widths: Float[np.ndarray, "P"], own: Bool[np.ndarray, "D"]
) -> tuple[float, float]:
    """Return scale and degrees of freedom of the chi-squared that T follows in the linear approximation.

    T = e' Q e, where e are the errors of all values and of the priors' centres, each in its standard deviation.

    Args:
        jacobian: d(predicted / sigma)/d(theta).
        widths: the priors' standard deviations, infinite for none.
        own: which values belong to the kind.
    """
    priors = np.diag(1 / widths)[np.isfinite(widths)]
    both, prior = np.vstack([jacobian, priors]), np.ones(len(priors), bool)
    explained, diagonal = [(-1.0, reached(both))], np.ones(len(priors))
    for taking, width in ((np.append(~own, prior), 1.0), (np.append(own, prior), WIDE)):
        narrow = np.append(np.ones(len(jacobian)), np.full(len(priors), 1 / width))[:, None]
        explained.append((1.0, narrow * reached(both * narrow * taking[:, None])))
        diagonal = diagonal - width**-2
    # Q = B S B' + D; only 3 P columns and the diagonal of the priors are nonzero
    B, S = np.hstack([U for _, U in explained]), np.concatenate([np.full(U.shape[1], sign) for sign, U in explained])
    own_sizes = ((B[len(jacobian) :] ** 2) * S).sum(1)
    SG = S[:, None] * (B.T @ B)
    mean = np.trace(SG) + diagonal.sum()
    variance = (SG * SG.T).sum() + 2 * (diagonal * own_sizes).sum() + (diagonal**2).sum()
    return (variance / mean, mean**2 / variance) if mean > NOTHING else (1.0, 0.0)


def agrees(problem: InverseProblem, residuals: Float[np.ndarray, "R"], slope: Float[np.ndarray, "R P"]) -> bool:
    """Whether no value and no kind contradicts an optimum, by the rules for a fit's verdict; kinds by linearisation.

    Args:
        problem: its finite sigmas count.
        residuals: whitened residuals of the data, then those of the priors.
        slope: their Jacobian by theta.
    """
    from scipy.special import chdtrc

    count, kinds = len(problem.kinds), np.array(problem.kinds)
    with np.errstate(divide="ignore"):
        widths = 1 / np.linalg.norm(slope[count:], axis=0)

    def least(values: Bool[np.ndarray, "D"], wide: float) -> float:
        weights = np.append(values, np.full(len(residuals) - count, 1 / wide))
        step, *_ = np.linalg.lstsq(weights[:, None] * slope, -weights * residuals, rcond=RANK_TOLERANCE)
        return float(((weights * (residuals + slope @ step)) ** 2).sum())

    chances, each = [], [kinds == kind for kind in np.unique(kinds[np.isfinite(np.asarray(problem.sigma))])]
    for own in each if len(each) > 1 else ():
        scale, freedom = quadratic_form(slope[:count], widths, own)
        statistic = residuals @ residuals - least(~own, 1.0) - least(own, WIDE)
        chances += [float(chdtrc(freedom, max(statistic, 0.0) / scale))] if freedom else []
    return not (rare(chances).any() or row_tests(problem, residuals, slope).outliers.any())


class _Minima(NamedTuple):
    """Least costs for priors of these widths: of all data, and by kind of the other kinds and of the kind alone.

    Also whether the first is better than the known optimum.
    """

    problem: InverseProblem
    widths: Float[np.ndarray, "P"]
    every: End
    parts: dict[str, tuple[End, End]]
    better: bool

    def compared(self, kind: str) -> CrossPrediction:
        """Compare one kind with the others."""
        (others, alone), every, problem = self.parts[kind], self.every, self.problem
        own = (np.array(problem.kinds) == kind) & np.isfinite(np.asarray(problem.sigma))
        rows, measured = np.flatnonzero(own), np.asarray(problem.measured)
        scale, freedom = quadratic_form(problem.scaled(np.asarray(every.jacobian)), self.widths, own)
        statistic = max(float(every.cost - others.cost - alone.cost), 0.0)
        predicted = others.predicted[rows]
        return CrossPrediction(kind, tuple(rows.tolist()), measured[rows], predicted, None, statistic, scale, freedom)

    def by_value(self, cross: CrossPrediction) -> CrossPrediction:
        """Add z of each value of a small kind: the signed root of its rise of the others' minimum.

        In the linear approximation this is (measured - predicted) / sd of the difference; here the model is nonlinear.
        """
        if len(cross.rows) > FEW:
            return cross
        others, _ = self.parts[cross.kind]
        normal, left = _with_widths(self.problem, self.widths), np.array(self.problem.kinds) != cross.kind
        single = self.every if len(cross.rows) == 1 else None
        ends = [single or _minimum(_fitted(normal, left | (np.arange(len(left)) == i)), [], others) for i in cross.rows]
        added = [max(float(end.cost - others.cost), 0.0) if end else 0.0 for end in ends]
        return replace(cross, z=np.sign(cross.measured - cross.predicted) * np.sqrt(added))


def _search(
    problem: InverseProblem, widths: Float[np.ndarray, "P"], kinds: Sequence[str], starts: Sequence[np.ndarray]
) -> _Minima | None:
    """Search all minima for priors of these widths; the first start is the best known optimum of all data."""
    place = np.array(problem.kinds)
    normal, wide = _with_widths(problem, widths), _with_widths(problem, WIDE * widths)
    first = _ended(normal, starts[0]) or jax.device_get(solve(normal, starts[0]))
    if not np.isfinite(first.cost):
        return None
    problems = {kind: (_fitted(normal, place != kind), _fitted(wide, place == kind)) for kind in kinds}
    ends = {
        kind: (_minimum(others, starts[1:], first), _minimum(own, starts[1:2], first))
        for kind, (others, own) in problems.items()
    }
    parts = {kind: (others, own) for kind, (others, own) in ends.items() if others and own}
    again = _minimum(normal, [others.theta for others, _ in parts.values()])
    every = again if again and again.choice.settled and again.cost < first.cost else first
    better = bool(every.cost < first.cost - SAME * (1 + first.cost))
    if better:  # start the parts there too: their minima cannot be higher
        for kind, (others, own) in parts.items():
            near = [_minimum(part, [], every) for part in problems[kind]]
            parts[kind] = _less(others, near[0]), _less(own, near[1])
    return _Minima(problem, widths, every, parts, better)


def _ended(problem: InverseProblem, theta: Float[np.ndarray, "P"]) -> End | None:
    """Return a point in the form of a search's end, without a search; None if it is no optimum."""
    end = jax.device_get(evaluate(problem, theta))
    residuals, slope = weighed(problem, end)
    return end._replace(cost=residuals @ residuals) if step_length(residuals, slope) < OPTIMUM_STEP else None


def _minimum(problem: InverseProblem, starts: Sequence[Float[np.ndarray, "P"]], near: End | None = None) -> End | None:
    """Return the best of several searches; None where the model has no solution at any start.

    Args:
        problem: the problem with only some of the values fitted.
        starts: theta to begin at. An end whose mode assignment is not settled is no minimum, and is only the last
            resort.
        near: optimum with more of the values fitted. From there the search holds the assignment, so that its cost does
            not exceed the cost there.
    """
    search = Searcher(problem, choosing)
    ends = [jax.device_get(end) for end in map(search, starts) if np.isfinite(end.cost)]
    held = [jax.device_get(stay(problem, near))] if near else []
    settled = [end for end in held if np.isfinite(end.cost)] + [end for end in ends if end.choice.settled]
    return min(settled or ends, key=lambda end: float(end.cost), default=None)


def _less(known: End, other: End | None) -> End:
    return other if other and other.cost < known.cost else known


def _fitted(problem: InverseProblem, rows: Bool[np.ndarray, "D"]) -> InverseProblem:
    """Return the problem with only these values fitted: one program serves any rows."""
    return problem.with_sigma(np.where(rows, np.asarray(problem.sigma), np.inf))


def _with_widths(problem: InverseProblem, widths: Float[np.ndarray, "P"]) -> InverseProblem:
    """Return the problem with normal priors of these widths."""
    items = tuple(
        Parameter(item.paths, item.positive, item.start, item.centre, width, item.scale)
        for item, width in zip(problem.parameters.items, widths, strict=True)
    )
    return replace(problem, parameters=Parameters(items))


# -------- Fit

FIT_STARTS = 16
"""Least number of starts, the given one included."""
PATIENCE = 6
"""Largest number of starts, as a multiple of the least, until `AGAIN` starts reach the best optimum; assumed."""
AGAIN = 3
UNMET = 0.5
"""Expected number of unseen competing optima below which a search that has met one may end; assumed."""
FIT_SPREAD = 1.0
"""Standard deviation in theta of the further starts about the given one: a factor of e for a stiffness."""


@dataclass(frozen=True)
class Fit:
    """The best optimum, the others, and the information of the data there.

    Attributes:
        problem: the fitted problem.
        optima: distinct optima by ascending cost; the first one is the answer.
        failed: number of starts without an optimum: no equilibrium, or no convergence.
        predicted: (D,) [SI] at the answer.
        jacobian: (D, P) d(predicted)/d(theta) there.
        information: of data and prior there.
        choice: the model's assignment of values to modes there.
        cross_predictions: each kind of measurement against the others.
        stretch: (P, 2) scale of the halves of each interval, below and above; 1 where the linear interval suffices.
        beaten: (P,) theta with a lower cost than the answer's, from which no search reached a better optimum.
        combinations: parameter combinations that the data determine, with the widths of their profiles if computed; see
            `ident.inference.optima.fixed_combinations`.
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
        """Fitted values [SI] by path, ties spelled out."""
        return {k: float(v) for k, v in self.problem.parameters.by_path(self.best.values).items()}

    @property
    def residuals(self) -> Float[np.ndarray, "D"]:
        """(predicted - measured) / sigma."""
        return (self.predicted - np.asarray(self.problem.measured)) / np.asarray(self.problem.sigma)

    @property
    def chi_squared(self) -> float:
        """Sum of squared residuals of the data, whitened if errors are correlated, and of the nuisances' priors."""
        off = np.asarray(self.predicted) - np.asarray(self.problem.measured)
        parameters = self.problem.parameters
        known = np.asarray(parameters.prior_residuals(self.best.theta)[0])[parameters.nuisance]
        return float(np.sum(self.problem.scaled(off) ** 2) + np.sum(known**2))

    @property
    def degrees_of_freedom(self) -> int:
        """Number of fitted values less the number of directions that they determine, or that nuisances take."""
        return int(np.isfinite(self.problem.sigma).sum()) - self.information.rank - self.information.spent

    @property
    def p_value(self) -> float:
        """Probability of a larger chi-squared if model and sigmas are right; NaN without degrees of freedom."""
        if not self.degrees_of_freedom > 0:
            return np.nan
        from scipy.special import chdtrc  # takes 0.1 s to import, and fits without degrees of freedom do not need it

        return float(chdtrc(self.degrees_of_freedom, self.chi_squared))

    @property
    def improbable(self) -> bool:
        """Whether chi-squared is improbably large if model and sigmas are right."""
        return self.p_value < IMPROBABLE

    @property
    def misfits(self) -> bool:
        """Whether chi-squared, or without degrees of freedom a single residual over sigma, rejects the model.

        The residual is relative to sigma: without degrees of freedom a standardised residual compares a value with the
        priors alone, and no other optimum would improve that.
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
        """Outlier tests of each measurement: whether its error is larger than its sigma allows."""
        return row_tests(self.problem, *weighed(self.problem, self.end))

    @property
    def blamed(self) -> tuple[tuple[int, ...], ...]:
        """The measurements, or vectors, any one of which may be wrong: without it there is no other outlier."""
        return blamed(self.problem, *weighed(self.problem, self.end))

    @property
    def outliers(self) -> Bool[np.ndarray, "D"]:
        """Which measurements are outliers, corrected for their number."""
        return self.row_tests.outliers

    @property
    def short(self) -> bool:
        """Whether the best end of the starts has not converged to an optimum."""
        return not self.best.converged

    @property
    def doubts(self) -> tuple[str, ...]:
        """Objections to this fit: with any of them, no interval is reported."""
        count, limit = self.outliers.sum(), self.row_tests.limit
        fitted = int(np.isfinite(np.asarray(self.problem.sigma)).sum())
        reasons = {
            "the search did not converge: this is not an optimum": not self.best.converged,
            "a better optimum exists: fit again with more --starts": (self.beaten is not None),
            contradiction_in_words(self.cross_predictions): self.contradictory,
            f"{count} of {fitted} measurements lie too far from the fit (standardised residual above {limit:.1f})": (
                count > 0
            ),
            f"chi-squared is too large for these sigmas ({p_in_words(self.p_value, 1)})": self.improbable,
        }
        return tuple(doubt for doubt, holds in reasons.items() if holds)

    @property
    def remarks(self) -> tuple[str, ...]:
        """Remarks on this fit that do not suppress intervals."""
        chi_squared, freedom = self.without_rounding
        if not freedom > 0:
            return ()
        from scipy.special import chdtr

        if not (chance := float(chdtr(freedom, chi_squared))) < IMPROBABLE:
            return ()
        return (
            f"chi-squared is too small ({p_in_words(chance, 1)}): check whether sigmas are too large, or rows copied",
        )

    @property
    def without_rounding(self) -> tuple[float, int]:
        """Chi-squared and degrees of freedom without values whose scatter a display's rounding hides; here of all."""
        return self.chi_squared, self.degrees_of_freedom

    @property
    def supported(self) -> Bool[np.ndarray, "P"]:
        """Which parameters get a reported interval: none if there are objections to the fit.

        The interval of a nuisance rests on its prior, as intended.
        """
        return (self.information.supported | self.problem.parameters.nuisance) & (not self.doubts)

    @property
    def rivals(self) -> tuple[Optimum, ...]:
        """Competing optima: those whose cost is within the 95 % limit of the best one's."""
        return rivals(self.optima)

    @property
    def ties(self) -> int:
        """Number of optima that fit exactly as well as the best one: then the answer is one of several."""
        return sum(optimum.converged and is_tie(optimum.score, self.best.score) for optimum in self.optima[1:])

    def interval(self, level: float = 0.95) -> Float[np.ndarray, "P 2"]:
        """Return intervals of the parameters [SI] by data and prior.

        They are normal in theta. Where the cost is not quadratic enough, those of supported parameters end where the
        profile of the cost meets the 95 % limit, and those of another level in proportion. An interval covers all
        competing optima: about each, until the cost has risen to the same level above the best one's.
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
    start: Float[np.ndarray, "P"] | None = None,
    checked: bool = True,
    progress: Callable[[Iterable[int]], Iterable[int]] = iter,
) -> Fit:
    """Fit the parameters by Levenberg-Marquardt from several starts.

    After `starts` starts the search continues, up to `PATIENCE` times as many, until `AGAIN` starts have reached the
    best optimum: an optimum that was met only once may not be the best one. It also continues if the best optimum does
    not fit the data, before the data are blamed; and with competing optima, until fewer than `UNMET` further ones are
    expected. If the cost falls below the best one's on the way to the end of an interval, another search begins there.

    Args:
        problem: model, data and unknowns.
        starts: least number of starts: the first, the others normal about it; 1 for the first alone.
        spread: standard deviation of the starts in theta.
        seed: of the starts.
        start: theta of the first one, by default the parameters' own.
        checked: whether to compare kinds of data, and to scale the intervals.
        progress: wraps the numbers of the starts, to show a bar.

    Raises:
        ConvergenceError: no start reaches an optimum.
        ModelError: none does, and the model has no solution at the first one.
    """
    first = problem.parameters.theta_start if start is None else start
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
    if not checked:
        return _answer(problem, reached, optima)
    lost = tried - len(reached)
    for _ in range(AGAIN):
        found = _explained(problem, reached, lost, seed)
        if found.beaten is None:
            break
        reached.append(ended(problem, solve(problem, found.beaten)))
    return found


def _explained(problem: InverseProblem, reached: list[Ended], lost: int, seed: int) -> Fit:
    """Return the fit of the best end with its checks; a better end met by the checks is added."""
    optima = distinct(problem, reached)
    agreement, least = cross_predictions(problem, [optimum.theta for optimum in optima], seed=seed)
    if least is not optima[0].theta:
        reached.append(ended(problem, solve(problem, least)))
        optima = distinct(problem, reached)
    failed = lost + len(reached) - sum(optimum.starts for optimum in optima)
    found = replace(_answer(problem, reached, optima), failed=failed, cross_predictions=agreement)
    return with_stretch(found)


def with_stretch(fit: Fit) -> Fit:
    """Return the fit with its interval scales computed, whatever other objections there are."""
    fit = replace(fit, stretch=None, beaten=None)
    stretch, beaten = stretches(fit.problem, fit.best, fit.end, fit.supported)
    return replace(fit, stretch=stretch, beaten=beaten)


def _answer(problem: InverseProblem, reached: list[Ended], optima: tuple[Optimum, ...]) -> Fit:
    """Return the fit of the best end, before its checks."""
    best, _ = in_order(problem, reached)[0]
    return Fit(problem, optima, 0, best.predicted, best.jacobian, information_at(problem, best), best.choice)


def information_at(problem: InverseProblem, end: End) -> Information:
    """Return the information of data and prior at the end of a search."""
    scaled, parameters = problem.scaled(np.asarray(end.jacobian)), problem.parameters
    return information(scaled, normal_prior_sd(problem), parameters.names, parameters.nuisance)


def _no_optimum(predicted: Float[np.ndarray, "D"]) -> ModelError:
    missing = int(np.isnan(np.asarray(predicted)).sum())
    if not missing:
        return ConvergenceError("no start reached an optimum; give other starting values or a prior")
    return ModelError(
        f"the model has no answer for {missing} of {len(predicted)} values at the start: the arm has no stable"
        " equilibrium there; raise the starting stiffness, or check loads and masses"
    )
