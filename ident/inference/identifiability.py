"""Identifiability before any fit: a verdict for each parameter of any model."""

from dataclasses import dataclass
from typing import Literal, NamedTuple

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.special import chdtrc

from ident.inference.fit import UNMET, moment_sd
from ident.inference.information import (
    OPEN_ABOVE,
    RANK_TOLERANCE,
    Information,
    clear_of,
    half_width,
    information,
    reached,
)
from ident.inference.optima import SAME, Ended, Optimum, distinct, is_tie, unmet
from ident.inference.parameters import Parameter
from ident.inference.problem import InverseProblem
from ident.inference.search import End, Searcher, convergence, evaluate, without_priors

# -------- Leverage
# Influence of each measurement: its information, and the loss without it.

EMPTY = 0.02
"""Share of the average information per measurement below which one counts as uninformative; assumed."""
ALONE = 0.9
"""Leverage above which one measurement dominates: it has nine tenths of the information on some direction."""
REPLACEABLE = 0.5
"""Leverage below which little is lost: no standard deviation grows by more than a factor 1.4 without it."""


@dataclass(frozen=True)
class Leverage:
    """Share of each measurement in the information of the data.

    Attributes:
        leverage: (D,) share of the measurement in the information on the direction that it determines best; the
            diagonal of J (J'J)^-1 J', J = d(predicted / sigma)/d(theta). They sum to the rank.
        sees: (D,) index of the parameter that moves it most, in sigmas; -1 if none does.
        opened: (D,) number of directions that the data would not determine without it.
        lost: (D,) parameters that would not be identifiable without it.
    """

    leverage: Float[np.ndarray, "D"]
    sees: tuple[int, ...]
    opened: tuple[int, ...]
    lost: tuple[tuple[str, ...], ...]

    @property
    def share(self) -> Float[np.ndarray, "D"]:
        """Share of each measurement in all information."""
        return self.leverage / max(self.leverage.sum(), 1e-300)

    @property
    def empty(self) -> Bool[np.ndarray, "D"]:
        """Which measurements carry no information."""
        return self.share < EMPTY / len(self.leverage)

    @property
    def dominant(self) -> Bool[np.ndarray, "D"]:
        """Which measurements dominate: they alone, or almost alone, determine some direction."""
        needed = [bool(opened or lost) for opened, lost in zip(self.opened, self.lost, strict=True)]
        return np.array(needed, bool) | (self.leverage > ALONE)


def leverage_of(
    jacobian: Float[np.ndarray, "D P"], names: tuple[str, ...], groups: Int[np.ndarray, "D"] | None = None
) -> Leverage:
    """Return the loss by dropping each measurement in turn, from the Jacobian alone; groups are dropped whole.

    Args:
        jacobian: d(predicted / sigma)/d(theta), whitened, zero for values that are not fitted.
        names: of the parameters.
        groups: number of the group of values whose errors are correlated, -1 for none; its leverage is shared evenly.

    References:
        Belsley, Kuh, Welsch, "Regression Diagnostics", 1980, section 2.1.
    """
    leverage = (reached(jacobian) ** 2).sum(1)
    alone = np.arange(len(jacobian)) + len(jacobian)
    units = alone if groups is None else np.where(groups < 0, alone, groups)
    sees = tuple(int(np.argmax(np.abs(row))) if row.any() else -1 for row in jacobian)
    none = np.full(len(names), np.inf)
    whole = information(jacobian, none, names)
    opened, lost = [0] * len(jacobian), [()] * len(jacobian)
    for unit in np.unique(units[leverage > REPLACEABLE]):
        rest = information(jacobian[units != unit], none, names)
        gone = tuple(np.array(names)[whole.supported & ~rest.supported].tolist())
        for i in np.flatnonzero(units == unit):
            opened[i], lost[i] = max(whole.rank - rest.rank, 0), gone
    _, place, count = np.unique(units, return_inverse=True, return_counts=True)
    leverage = (np.bincount(place, leverage) / count)[place]
    return Leverage(leverage, sees, tuple(opened), tuple(lost))


# -------- Other solutions
# Whether other parameter values give the same data: a search without any measured value.

STARTS = 16
"""Least number of starts."""
MOST = 96
"""Largest number of starts, if other solutions are met and more are expected."""
SPREAD = 1.0
"""Standard deviation of the starts in theta, unless the prior is narrower: a factor of e for a stiffness."""


@dataclass(frozen=True)
class OtherSolutions:
    """Other solutions for the data predicted at the starting values.

    Attributes:
        starts: number of starts.
        ended: number of starts that reached an optimum of any cost.
        exact: optima with the same data up to rounding.
        near: optima that data with these sigmas would hardly exclude: chi-squared within the 95 % limit.
    """

    starts: int
    ended: int
    exact: tuple[Optimum, ...]
    near: tuple[Optimum, ...]


def other_solutions(problem: InverseProblem, here: End, *, seed: int = 0) -> OtherSolutions:
    """Look for other values that give the same data as the starting values.

    A full rank of the Jacobian excludes others nearby. Far away there may be some, by symmetry or otherwise (local and
    global identifiability: Walter, Pronzato, "Identification of Parametric Models from Experimental Data", 1997, ch.
    2). Priors are ignored. The search is not exhaustive: finding none does not prove uniqueness.

    Args:
        problem: model, sigmas and unknowns.
        here: predictions at the starting values.
        seed: of the starts.
    """
    free = without_priors(problem, but_nuisances=True)
    exact = eqx.tree_at(lambda p: p.measured, free, jax.device_put(np.asarray(here.predicted)))
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
        if tried >= STARTS and (not optima or unmet(optima) < UNMET):
            break
    others = [optimum for optimum in optima if not _same(exact, optimum, here)]
    exactly = tuple(optimum for optimum in others if is_tie(0.0, optimum.cost))
    near = tuple(o for o in others if not is_tie(0.0, o.cost) and o.cost < half_width(0.95) ** 2)
    return OtherSolutions(tried, len(reached), exactly, near)


def _same(problem: InverseProblem, optimum: Optimum, here: End) -> bool:
    """Whether an optimum is the one at the starting values, by the distance in theta and in the predictions."""
    step = optimum.theta - np.asarray(here.theta)
    moved = problem.scaled(np.asarray(here.jacobian) @ step)
    return bool(is_tie(0.0, optimum.cost) and min(np.linalg.norm(moved), np.abs(step).max()) < SAME)


# -------- Identifiability

Verdict = Literal["identifiable", "weak", "open", "not seen", "unknown"]
POINTS = 8
"""Points in addition to the starting values."""
POINTS_SPREAD = 0.4
"""Standard deviation of the points in theta, unless the prior is narrower: a factor of 1.5 for a stiffness."""
INVISIBLE = 1e-6
"""Columns of the Jacobian below this share of the largest one are rounding."""


@dataclass(frozen=True)
class Check:
    """Identifiability of the parameters, if the truth is near the starting values.

    Attributes:
        problem: the checked problem.
        verdicts: (Q,) of the unknowns of interest, see `check`.
        information: of the data alone at the starting values; None where the model has no solution there.
        leverage: share of each measurement in it; None likewise.
        missing: (D,) values without a prediction or derivative at the starting values.
        data_sd: (points, Q) standard deviation in theta by the data alone, the starting values first.
        supported: (points, Q) whether each parameter is identifiable there.
        tried: number of points, starting values included; points without a solution are not in `data_sd`.
        others: other solutions for the same data; None where some direction is open, so that they always exist.
    """

    problem: InverseProblem
    verdicts: tuple[Verdict, ...]
    information: Information | None
    leverage: Leverage | None
    missing: Bool[np.ndarray, "D"]
    data_sd: Float[np.ndarray, "points Q"]
    supported: Bool[np.ndarray, "points Q"]
    tried: int
    others: OtherSolutions | None = None

    @property
    def items(self) -> tuple[Parameter, ...]:
        """The unknowns of interest."""
        return tuple(item for item in self.problem.parameters.items if not item.nuisance)

    @property
    def answered(self) -> int:
        """Number of points at which the model has a solution."""
        return len(self.data_sd)

    @property
    def blind(self) -> bool:
        """Whether the data depend on no parameter at all."""
        return all(verdict == "not seen" for verdict in self.verdicts)


def check(problem: InverseProblem, *, points: int = POINTS, seed: int = 0) -> Check:
    """Return which parameters the data determine, from predictions and Jacobian: without a fit or measured values.

    The Jacobian at one point may mislead: a derivative may vanish there by symmetry, or two modes may cross nearby.
    So it is evaluated at several points, and the verdict holds for all of them, as any may be the truth:

    - `identifiable`: at every point the data alone give theta a standard deviation below `information.WEAK_ABOVE`;
    - `not seen`: at no point does any value depend on it;
    - `unknown`: the model has no solution at the starting values, or at most of the points;
    - `open`: at no point do the data alone bound it, or only beyond `information.OPEN_ABOVE`, as in a fit: they depend
      on it only in combination with others, or hardly at all;
    - `weak`: otherwise. The data depend on it too little, or not at every point.

    Nuisances add to the scatter of the data, and so reduce their information.

    These verdicts are local; `others` is a search from several starts for distant values with the same data.

    Args:
        problem: model, data and unknowns; priors only narrow the spread of the points.
        points: number of points in addition to the starting values.
        seed: of the points.
    """
    parameters = problem.parameters
    start = parameters.theta_start
    width = np.minimum(parameters.normal_sd, POINTS_SPREAD)
    noise = np.random.default_rng(seed).standard_normal((points, len(start))) * width
    ends = [jax.device_get(evaluate(problem, theta)) for theta in (start, *(start + noise))]
    evaluated = [_scaled_jacobian(problem, end) for end in ends]
    answers = [J for J, missing in evaluated if not missing.any()]
    own = ~parameters.nuisance
    names = tuple(name for name, counts in zip(parameters.names, own, strict=True) if counts)
    known = [information(J, np.full(len(names), np.inf), names) for J in answers]
    here, missing = evaluated[0]
    blank = bool(missing.any())
    sd = np.array([each.data_sd for each in known]).reshape(-1, len(names))
    supported = np.array([each.supported for each in known], bool).reshape(-1, len(names))
    unknown = blank or 2 * len(answers) < len(evaluated)
    verdicts: tuple[Verdict, ...] = tuple("unknown" for _ in names)
    if not unknown:
        size = np.linalg.norm(np.array(answers), axis=1)
        seen = (size > INVISIBLE * size.max(1, keepdims=True)).any(0)
        words = np.where(seen, np.where((sd < OPEN_ABOVE).any(0), "weak", "open"), "not seen")
        verdicts = tuple(np.where(np.all(supported, axis=0), "identifiable", words).tolist())
    closed = not blank and not any(direction.open for direction in known[0].directions)
    return Check(
        problem,
        verdicts,
        None if blank else known[0],
        None if blank else leverage_of(here, names, problem.errors.groups),
        missing,
        sd,
        supported,
        len(evaluated),
        other_solutions(problem, ends[0], seed=seed) if closed else None,
    )


def _scaled_jacobian(problem: InverseProblem, end: End) -> tuple[np.ndarray, np.ndarray]:
    """Return d(predicted / sigma)/d(theta) of the unknowns of interest, and which fitted values have no solution."""
    sigma = np.asarray(problem.sigma)
    J, fitted = np.asarray(end.jacobian), np.isfinite(sigma)
    missing = fitted & ~(np.isfinite(np.asarray(end.predicted)) & np.isfinite(J).all(1))
    scaled, parameters = problem.scaled(np.where(fitted[:, None], J, 0.0)), problem.parameters
    if missing.any() or not parameters.nuisance.any():
        return scaled[:, ~parameters.nuisance], missing
    return clear_of(scaled, parameters.normal_sd, parameters.nuisance), missing


# -------- Consistency
# Do the data agree with each other? A linear test, before any fit.

COARSE = 0.3
"""Relative sigma above which a value's sign is uncertain, so that its logarithm is meaningless; assumed."""
STRAIGHT = 1.0
"""Largest error of the linear model, in sigma, at which chi-squared over all values is valid; assumed."""


@dataclass(frozen=True)
class Consistency:
    """Consistency of the data with each other, by the linearised model.

    Attributes:
        chi_squared: least sum of squares that any parameters reach, data and prior.
        degrees_of_freedom: number of values and priors less the number of directions that they determine together.
        bend: largest error of the linear model in sigma at its optimum for all data; NaN where the model ends.
    """

    chi_squared: float
    degrees_of_freedom: int
    bend: float

    @property
    def p_value(self) -> float:
        """Probability of a larger chi-squared if all is right; NaN without degrees of freedom or a linear model."""
        meaningful = self.degrees_of_freedom > 0 and self.bend < STRAIGHT
        return float(chdtrc(self.degrees_of_freedom, self.chi_squared)) if meaningful else np.nan


def consistency(problem: InverseProblem) -> Consistency | None:
    """Test the consistency of the data with the model linearised at the parameters' starting values.

    Values that depend on positive parameters only are linearised as powers of them, ln(value) in ln(parameter), as
    frequencies and deflections nearly are; other values, and those of uncertain sign, are linearised directly. One step
    leads to the optimum of the linear model. There the model is evaluated once, and every sigma is widened by the error
    of linearisation, so that a bad start makes the test weaker, not wrong. There is no second step.

    Returns:
        None where the model has no solution at the start.
    """
    line = _line(problem)
    if not all(np.isfinite(part).all() for part in (line.value, line.slope)):
        return None
    spread = line.sigma / line.scale(line.measured)
    step, *_ = _answer(line, spread, problem)
    there = np.asarray(evaluate(problem, line.start + step).predicted)
    error = np.abs(line.moved(there) - line.slope @ step)
    wider = np.hypot(spread, np.nan_to_num(error, nan=np.inf))
    _, chi_squared, freedom = _answer(line, wider, problem)
    return Consistency(chi_squared, freedom, float((error / spread).max()))


class _Line(NamedTuple):
    """The model linearised at the start, with a scale for each value: moved = slope @ step."""

    start: Float[np.ndarray, "P"]
    value: Float[np.ndarray, "D"]
    measured: Float[np.ndarray, "D"]
    sigma: Float[np.ndarray, "D"]
    power: Bool[np.ndarray, "D"]
    slope: Float[np.ndarray, "D P"]
    centre: Float[np.ndarray, "P"]
    widths: Float[np.ndarray, "P"]

    def moved(self, values: Float[np.ndarray, "D"]) -> Float[np.ndarray, "D"]:
        """Return the distance of values from the start."""
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.where(self.power, np.log(values / self.value), values - self.value)

    def scale(self, values: Float[np.ndarray, "D"]) -> Float[np.ndarray, "D"]:
        """Return the value of one unit of move there."""
        return np.where(self.power, np.abs(values), 1.0)


def _line(problem: InverseProblem) -> _Line:
    end, known = evaluate(problem), problem.parameters
    value, J = np.asarray(end.predicted), np.asarray(end.jacobian)
    measured, sigma = np.asarray(problem.measured), np.asarray(problem.sigma)
    of_positive = ~((J != 0) & ~known.positive).any(1)
    coarse = np.isfinite(sigma) & (sigma > COARSE * np.abs(measured))
    power = of_positive & (value * measured > 0) & ~coarse
    slope = J / np.where(power, value, 1.0)[:, None]
    return _Line(known.theta_start, value, measured, sigma, power, slope, known.theta_centre, moment_sd(known))


def _answer(
    line: _Line, spread: Float[np.ndarray, "D"], problem: InverseProblem
) -> tuple[Float[np.ndarray, "P"], float, int]:
    """Return the step to the linear model's optimum, chi-squared after it, and the degrees of freedom.

    Errors keep the problem's correlation, whatever their widening.
    """
    weight, prior_slope = 1 / spread, 1 / line.widths
    residual = (line.start - line.centre) * prior_slope
    problem = problem.with_sigma(spread)
    A = np.vstack([problem.scaled(line.slope), np.diag(prior_slope)])
    b = np.concatenate([problem.scaled(line.moved(line.measured)), -residual])
    U, s, Vt = np.linalg.svd(np.vstack([A, np.zeros((A.shape[1], A.shape[1]))]), full_matrices=False)
    seen = s > RANK_TOLERANCE * max(s[0], 1e-300)
    step = (Vt[seen] / s[seen, None]).T @ (U[: len(A), seen].T @ b)
    freedom = int((weight > 0).sum() + (prior_slope > 0).sum() - seen.sum())
    return step, float(((b - A @ step) ** 2).sum()), freedom
