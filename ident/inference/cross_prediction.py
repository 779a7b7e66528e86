"""Do the kinds of data contradict each other? Each one against all others, with the prior among these."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import jax
import numpy as np
from jaxtyping import Bool, Float

from ident.inference.convergence import OPTIMUM_STEP, step_length, weighed
from ident.inference.information import RANK_TOLERANCE
from ident.inference.least_squares import End, choosing, evaluate, solve, stay
from ident.inference.parameters import Parameter, Parameters
from ident.inference.problem import InverseProblem
from ident.inference.searcher import Searcher
from ident.inference.verdicts import rare, standard_deviations

FEW = 6
"""Values of a kind up to which each is compared by itself."""
STARTS = 2
"""Starts drawn at random for each minimum, beside the optima that are known and the parameters' starting values."""
WIDE = 10.0
"""How many times wider the priors are when a kind is fitted alone: it then says what it can, and no absurdity."""
WIDER = 2.0
"""Factor on the priors' widths by which a contradiction is tried for its dependence on them."""
SPREAD = 1.0
"""Largest standard deviation in theta of those."""
SAME = 1e-6
"""Difference of costs, relative to one plus the cost, that is none."""
NOTHING = 1e-3
"""Degrees of freedom below which a kind says nothing that the others could contradict."""


@dataclass(frozen=True)
class CrossPrediction:
    """What the other kinds of data, and the prior, say about one kind.

    Attributes:
        kind: the kind that was left out of the fit.
        rows: (n,) places of its values in the campaign.
        measured: (n,) [SI]
        predicted: (n,) [SI] where all other kinds are fitted best.
        z: (n,) [sd] by how much each value alone is off what the others allow; None where nothing contradicts, or where
            there are more than `FEW`.
        statistic: by how much more the minimum of all is than those of the others and of this kind by itself.
        scale, degrees_of_freedom: statistic / scale has a chi-squared distribution if all is right.
        wider: the same p-value with priors twice as wide; NaN where nothing contradicts.
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
        from scipy.special import chdtrc  # takes a tenth of a second, which fits to one kind of data can spare

        return float(chdtrc(self.degrees_of_freedom, self.statistic / self.scale))

    @property
    def sd(self) -> float:
        """The same as standard deviations of a single normal value."""
        return standard_deviations(self.p_value)


def contradicting(predictions: Sequence[CrossPrediction]) -> tuple[CrossPrediction, ...]:
    """Return the kinds that contradict the others, corrected for the number of kinds."""
    found = rare([each.p_value for each in predictions])
    return tuple(each for each, contradicts in zip(predictions, found, strict=True) if contradicts)


def cross_predictions(
    problem: InverseProblem, known: Sequence[Float[np.ndarray, "P"]], *, seed: int = 0
) -> tuple[tuple[CrossPrediction, ...], Float[np.ndarray, "P"]]:
    """Test each kind of measurement against the others, and the prior among these.

    With M the minimum of chi-squared and prior, and of k alone with priors so wide (`WIDE`) that they hardly count,

        T = M(all) - M(all but k) - M(k alone).

    That is the parameter goodness of fit (Maltoni, Schwetz, "Testing the statistical compatibility of independent data
    sets", Phys. Rev. D 68, 033020, 2003, eq. 9), here with the prior among the others. Where all is linear and truths
    come from the prior, T is a quadratic form of normal numbers, whose mean and variance give a scaled chi-squared
    (Satterthwaite 1946). With no prior at all that is chi-squared on rank(k) + rank(others) - rank(all) degrees of
    freedom. A flat prior counts as the normal one of the same mean and variance: T keeps its mean, and its tail is
    shorter, so that there are rather too few alarms.

    Args:
        problem: model, data and unknowns.
        known: where to begin: the fit's optima, the best one first.
        seed: of the further starts.

    Returns:
        One comparison for each kind that the others tell something of, none where there is one kind only; and where
        the cost of all data is least: `known[0]`, or a better optimum that was met on the way.
    """
    kinds = sorted({k for k, s in zip(problem.kinds, np.asarray(problem.sigma), strict=True) if np.isfinite(s)})
    if len(kinds) < 2:
        return (), known[0]
    widths = moment_sd(problem.parameters)
    start = np.asarray(problem.parameters.theta(problem.parameters.column("start")))
    noise = np.random.default_rng(seed).standard_normal((STARTS, len(start)))
    starts = [known[0], start, *known[1:2], *(start + noise * np.minimum(widths, SPREAD))]
    minima = _search(problem, widths, kinds, starts)
    if minima is None:
        return (), known[0]
    found = [_compared(problem, widths, kind, minima) for kind in minima.parts]
    found = [each for each in found if each.degrees_of_freedom]
    least = minima.every.theta if minima.better else known[0]
    if not contradicting(found):
        return tuple(found), least
    found = [_by_value(problem, widths, each, minima) for each in found]
    return _with_wider(problem, widths, found, [least, start]), least


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
        own: which values are of the kind.
    """
    priors = np.diag(1 / widths)[np.isfinite(widths)]
    both, prior = np.vstack([jacobian, priors]), np.ones(len(priors), bool)
    explained, diagonal = [(-1.0, _reached(both))], np.ones(len(priors))
    for taking, width in ((np.append(~own, prior), 1.0), (np.append(own, prior), WIDE)):
        narrow = np.append(np.ones(len(jacobian)), np.full(len(priors), 1 / width))[:, None]
        explained.append((1.0, narrow * _reached(both * narrow * taking[:, None])))
        diagonal = diagonal - width**-2
    # Q = B S B' + D, of which only 3 P columns and the diagonal of the priors are more than zero
    B, S = np.hstack([U for _, U in explained]), np.concatenate([np.full(U.shape[1], sign) for sign, U in explained])
    own_sizes = ((B[len(jacobian) :] ** 2) * S).sum(1)
    SG = S[:, None] * (B.T @ B)
    mean = np.trace(SG) + diagonal.sum()
    variance = (SG * SG.T).sum() + 2 * (diagonal * own_sizes).sum() + (diagonal**2).sum()
    return (variance / mean, mean**2 / variance) if mean > NOTHING else (1.0, 0.0)


def _reached(A: Float[np.ndarray, "n P"]) -> Float[np.ndarray, "n K"]:
    """Return an orthonormal basis of what steps explain."""
    U, s, _ = np.linalg.svd(A, full_matrices=False)
    return np.asarray(U[:, s > RANK_TOLERANCE * max(s[0], 1e-300)])


class _Minima(NamedTuple):
    """Least costs: of all data, by kind of the others and of its own, and whether the first is better than known."""

    every: End
    parts: dict[str, tuple[End, End]]
    better: bool


def _search(
    problem: InverseProblem, widths: Float[np.ndarray, "P"], kinds: Sequence[str], starts: Sequence[np.ndarray]
) -> _Minima | None:
    """Search all minima for priors of these widths; the first start is the best that is known for all data."""
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
    if better:  # what is less for all data leads to no more for a part of them
        for kind, (others, own) in parts.items():
            near = [_minimum(part, [], every) for part in problems[kind]]
            parts[kind] = _less(others, near[0]), _less(own, near[1])
    return _Minima(every, parts, better)


def _compared(problem: InverseProblem, widths: Float[np.ndarray, "P"], kind: str, minima: _Minima) -> CrossPrediction:
    """Compare one kind with the others."""
    (others, alone), every = minima.parts[kind], minima.every
    sigma = np.asarray(problem.sigma)
    own = (np.array(problem.kinds) == kind) & np.isfinite(sigma)
    rows, measured = np.flatnonzero(own), np.asarray(problem.measured)
    scale, freedom = quadratic_form(problem.scaled(np.asarray(every.jacobian)), widths, own)
    statistic = max(float(every.cost - others.cost - alone.cost), 0.0)
    predicted = others.predicted[rows]
    return CrossPrediction(kind, tuple(rows.tolist()), measured[rows], predicted, None, statistic, scale, freedom)


def _by_value(
    problem: InverseProblem, widths: Float[np.ndarray, "P"], cross: CrossPrediction, minima: _Minima
) -> CrossPrediction:
    """Say by how much each value of a small kind is off: the signed root of what it adds to the others' minimum.

    In the linear approximation that is (measured - predicted) / sd of this difference; it follows the model.
    """
    if len(cross.rows) > FEW:
        return cross
    others, _ = minima.parts[cross.kind]
    normal, left = _with_widths(problem, widths), np.array(problem.kinds) != cross.kind
    single = minima.every if len(cross.rows) == 1 else None
    ends = [single or _minimum(_fitted(normal, left | (np.arange(len(left)) == i)), [], others) for i in cross.rows]
    added = [max(float(end.cost - others.cost), 0.0) if end else 0.0 for end in ends]
    return replace(cross, z=np.sign(cross.measured - cross.predicted) * np.sqrt(added))


def _with_wider(
    problem: InverseProblem,
    widths: Float[np.ndarray, "P"],
    found: Sequence[CrossPrediction],
    starts: Sequence[np.ndarray],
) -> tuple[CrossPrediction, ...]:
    """Add to a contradiction what would be left of it with wider priors."""
    kinds, wider = [each.kind for each in found], WIDER * widths
    minima = _search(problem, wider, kinds, starts)
    if minima is None:
        return tuple(found)
    again = {kind: _compared(problem, wider, kind, minima).p_value for kind in minima.parts}
    return tuple(replace(each, wider=again.get(each.kind, math.nan)) for each in found)


def _ended(problem: InverseProblem, theta: Float[np.ndarray, "P"]) -> End | None:
    """Return a point as the end of a search, without one; None where it is no optimum."""
    end = jax.device_get(evaluate(problem, theta))
    residuals, slope = weighed(problem, end)
    return end._replace(cost=residuals @ residuals) if step_length(residuals, slope) < OPTIMUM_STEP else None


def _minimum(problem: InverseProblem, starts: Sequence[Float[np.ndarray, "P"]], near: End | None = None) -> End | None:
    """Return the best of several searches; None where the model has no answer at any start.

    Args:
        problem: that in which some of the values are fitted.
        starts: theta to begin at. What does not settle on what the values belong to is taken where there is nothing
            else only: it is no minimum.
        near: where more of the values are fitted. From there on the search holds the choice, so that its cost is no
            more than theirs there.
    """
    search = Searcher(problem, choosing)
    ends = [jax.device_get(end) for end in map(search, starts) if np.isfinite(end.cost)]
    held = [jax.device_get(stay(problem, near))] if near else []
    settled = [end for end in held if np.isfinite(end.cost)] + [end for end in ends if end.choice.settled]
    return min(settled or ends, key=lambda end: float(end.cost), default=None)


def _less(known: End, other: End | None) -> End:
    return other if other and other.cost < known.cost else known


def _fitted(problem: InverseProblem, rows: Bool[np.ndarray, "D"]) -> InverseProblem:
    """Return the problem in which only these values are fitted: the same program, whatever the rows."""
    return problem.with_sigma(np.where(rows, np.asarray(problem.sigma), np.inf))


def _with_widths(problem: InverseProblem, widths: Float[np.ndarray, "P"]) -> InverseProblem:
    """Return the problem with normal priors of these widths."""
    items = tuple(
        Parameter(item.paths, item.positive, item.start, item.centre, width, item.scale)
        for item, width in zip(problem.parameters.items, widths, strict=True)
    )
    return replace(problem, parameters=Parameters(items))
