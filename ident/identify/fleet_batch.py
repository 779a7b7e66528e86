"""Robots of one arm file that were measured in the same way, fitted together."""

from collections.abc import Collection, Hashable, Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Array, Bool, Float

from ident.arm.arm import Arm
from ident.errors import IdentError
from ident.identify.conditions import shared_error
from ident.identify.fleet import Linear, Robot, SourceFile, Stiffnesses, robot_at
from ident.identify.problem import Posed, check_values, plausible_beside, pose
from ident.identify.unknowns import Unknowns
from ident.inference.information import IMPROBABLE, RANK_TOLERANCE, half_width, row_tests
from ident.inference.optima import SAME
from ident.inference.problem import InverseProblem
from ident.inference.search import OPTIMUM_STEP, SEVERAL, TURNS, UNTIL_REMATCHED, WHOLE, evaluate, search
from ident.measure import Campaign
from ident.measure.load import SHAPES
from ident.programs import jit

# -------- Fit many
# Many problems that differ in their values alone: searches in batches, for those without any objection.
#
# One program searches for all problems of a batch from the same starts. Where the data fit an optimum that several
# starts have reached, and nothing that was met rivals it, that is the fit; what `fit` compares besides, kinds of data
# against each other and the ends of intervals against the cost, is left out. Any other problem is for `fit` alone.

STARTS, SPREAD = 3, 0.3
"""Starts of each problem, the parameters' own among them, and the standard deviation in theta of the others about it:
less than that of a single fit, as robots of one design are alike."""
STEPS = 40
"""Steps of a search at most: all searches of a batch take as many as the longest."""
REACHED = 2
"""Starts that have ended in the best optimum at least; assumed."""


class Values(NamedTuple):
    """What was measured in many problems: measured and sigma, (R, D) each [SI]."""

    measured: Float[np.ndarray, "R D"]
    sigma: Float[np.ndarray, "R D"]


class Many(NamedTuple):
    """Fits of many problems.

    Attributes:
        sound: (R,) whether there is no objection to this one; what else is said of it counts only there.
        theta: (R, P)
        sd: (R, P) standard deviations by data and prior.
        residuals: (R, V) [sigma] of the data; of repeated values that of their mean.
        slope: (R, V, P) their derivative by theta.
    """

    sound: Bool[np.ndarray, "R"]
    theta: Float[np.ndarray, "R P"]
    sd: Float[np.ndarray, "R P"]
    residuals: Float[np.ndarray, "R V"]
    slope: Float[np.ndarray, "R V P"]


class _Ends(NamedTuple):
    """Where searches ended: residuals and their slope with those of the prior, predictions, all of the padded problem.

    `score` is infinite where a search has not ended, or holds what is not the most probable choice.
    """

    theta: Any
    score: Any
    residuals: Any
    slope: Any
    predicted: Any


def fit_many(problem: InverseProblem, values: Values, size: int, seed: int = 0) -> Many:
    """Fit problems that differ in their values alone.

    What comes out for one of them is the same to the last bit where all others are the same, too; how a sum is rounded
    may depend on its place in a vector.

    Args:
        problem: one of them, of few data (`in_parts`).
        values: of each, `size` at most.
        size: problems that the program is for; what is missing is filled up.
        seed: of the starts.
    """
    count = len(values.measured)
    padded, pooled, places = _padded(problem, values)
    fill = np.minimum(np.arange(size), count - 1)
    first = problem.parameters.theta_start
    away = np.random.default_rng(seed).standard_normal((STARTS, len(first))) * SPREAD
    away[0] = 0
    filled = Values(*(part[fill] for part in pooled))
    ends = [_ended(padded, filled, np.tile(first + start, (size, 1))) for start in away]
    every = _Ends(*(np.stack(part)[:, :count] for part in zip(*ends, strict=True)))
    best = _Ends(*(part[every.score.argmin(0), np.arange(count)] for part in every))
    seen = pooled.measured.shape[1]
    data, slope = best.residuals[:, :seen], best.slope[:, :seen]
    off = np.where(np.isfinite(values.sigma), (best.predicted[:, places] - values.measured) / values.sigma, 0.0)
    sound = _agreed(every, best) & _fitting(values, off, slope)
    for r in np.flatnonzero(sound).tolist():
        with np.errstate(invalid="ignore"):  # of what is not fitted both sigmas are infinite
            own = slope[r][places] * np.nan_to_num(pooled.sigma[r][places] / values.sigma[r])[:, None]
        whole = [np.concatenate(part) for part in ((off[r], best.residuals[r, seen:]), (own, best.slope[r, seen:]))]
        sound[r] = not row_tests(_with(problem, values, r), *whole).outliers.any()
    sd = np.full(best.theta.shape, np.nan)
    sd[sound] = np.sqrt(np.linalg.inv(np.swapaxes(best.slope[sound], 1, 2) @ best.slope[sound]).diagonal(0, 1, 2))
    return Many(sound, best.theta, sd, data, slope)


def _padded(problem: InverseProblem, values: Values) -> tuple[InverseProblem, Values, np.ndarray]:
    """Return a problem of one of few sizes, the values of all that it stands for, and where each is."""
    (model,), (source,), places, *_ = problem.in_parts().parts
    own = (_with(problem, values, r) for r in range(len(values.measured)))
    mean, spread, _ = zip(*(each.pooled(source, places) for each in own), strict=True)
    pooled = Values(np.array(mean), np.array(spread))
    kinds = tuple(problem.kinds[i] for i in source)
    return InverseProblem(model, mean[0], spread[0], problem.parameters, kinds), pooled, places


def _with(problem: InverseProblem, values: Values, r: int) -> InverseProblem:
    """Return the problem with the values of one of many."""
    return replace(problem, measured=values.measured[r], sigma=values.sigma[r], correlation=None)


def _ended(problem: InverseProblem, values: Values, start: np.ndarray) -> _Ends:
    """Search for each problem from its start, again where another choice has become more probable."""
    held = jax.tree.map(lambda x: np.broadcast_to(np.asarray(x), (len(start), *np.shape(x))), problem.first_matching())
    for _ in range(TURNS):
        ends, again, ended = jax.device_get(_search_all(problem, values, start, held))
        if ended.all():
            break
        start, held = ends.theta, again
    fine = ended & np.isfinite(ends.score) & np.isfinite(ends.slope).all((1, 2))
    return ends._replace(score=np.where(fine, ends.score, np.inf))


@jit
def _search_all(problem: InverseProblem, values: Values, starts: Any, held: Any) -> tuple[_Ends, Any, Array]:
    """Return ends, what is held for the next turn, and which need none, as they have ended or have no answer."""

    def one(values: Values, start: Array, held: Any) -> tuple[_Ends, Any, Array]:
        own = eqx.tree_at(lambda p: (p.measured, p.sigma), problem, tuple(values))
        end, finished = search(own, start, held, UNTIL_REMATCHED, WHOLE, steps=STEPS)
        residuals, slope = own.weigh(end.predicted, end.jacobian, end.theta)
        score, choice = end.cost + end.choice.cost.sum(), end.choice
        again = None if choice.held is None else choice.held.rematched()
        over = ~finished | ~jax.numpy.isfinite(end.cost)
        score = jax.numpy.where(over, jax.numpy.inf, score)
        ended = choice.settled | over
        return _Ends(end.theta, score, residuals, slope, end.predicted), again, ended

    return eqx.filter_vmap(one)(values, starts, held)


def _agreed(every: _Ends, best: _Ends) -> np.ndarray:
    """Tell where the best end is an optimum that several starts have reached, and that no other one rivals.

    A direction that data and prior leave open over several e-folds is not looked along (`convergence`): such a problem
    is for `fit` alone.
    """
    known = np.isfinite(best.score)
    slope = np.where(known[:, None, None], best.slope, 0.0)
    U, s, _ = np.linalg.svd(slope, full_matrices=False)
    step = np.linalg.norm(np.einsum("rdp,rd->rp", U, np.where(known[:, None], best.residuals, 0.0)), axis=1)
    optimum = known & (s[:, -1] > 1 / SEVERAL) & (step < OPTIMUM_STEP)
    above = np.where(known, every.score - np.where(known, best.score, 0.0), np.inf)
    apart = np.linalg.norm(np.einsum("rdp,srp->srd", slope, every.theta - best.theta), axis=2)
    near = np.isfinite(above) & (apart < SAME * (1 + np.where(known, best.score, 0.0)) ** 0.5)
    rival = ~near & (above < half_width(0.95) ** 2)
    return optimum & (near.sum(0) >= REACHED) & ~rival.any(0)


def _fitting(values: Values, off: np.ndarray, slope: np.ndarray) -> np.ndarray:
    """Tell whose chi-squared is not improbable."""
    from scipy.special import chdtrc

    s = np.linalg.svd(np.nan_to_num(slope), compute_uv=False)
    rank = (s > RANK_TOLERANCE * s[:, :1]).sum(1)
    freedom = np.isfinite(values.sigma).sum(1) - rank
    p = np.where(freedom > 0, chdtrc(np.maximum(freedom, 1), (off**2).sum(1)), 1.0)
    return p >= IMPROBABLE


# -------- Fleet batch


class Given(NamedTuple):
    """A robot's inputs: its name, campaign and arm, with their files."""

    name: str
    campaign: Campaign
    arm: Arm
    campaign_file: SourceFile
    arm_file: SourceFile


def robots_together(
    given: Sequence[Given], unknowns: Unknowns, size: int, *, seed: int = 0, trusted: Collection[str] = ()
) -> Mapping[str, Robot]:
    """Fit robots together, and return those without any objection, by name; each of the others is for itself.

    Together are those of one arm file whose campaigns have the same rows but for their values.

    Args:
        given: robots of different names, `size` at most.
        unknowns: what is unknown of each, and its priors.
        size: robots that the program is for.
        seed: of the starts.
        trusted: rows whose values are right though implausible, see `check_values`.
    """
    groups: dict[Hashable, list[Given]] = {}
    for each in (one._replace(campaign=_ascending(one.campaign)) for one in given):
        way = (tuple(x for name, x in vars(m).items() if name not in MEASURED) for m in each.campaign)
        groups.setdefault((each.arm_file.sha256, *way), []).append(each)
    found: dict[str, Robot] = {}
    for group in groups.values():
        plausible = ((i, posed) for i, one in enumerate(group) if (posed := _plausible(one, unknowns, trusted)))
        leader, posed = next(plausible, (0, None))
        if posed and len(group) > 1:
            found |= _fitted(posed, group[leader:], size, seed)
    return found


MEASURED = ("value", "sigma", "resolution", "group", "member", "unit", "note", "where")
"""What rows that were measured in the same way may differ in."""


def _ascending(campaign: Campaign) -> Campaign:
    """Return a campaign in which modes without a label ascend in each state, as they are told apart by that alone."""
    rows, places = list(campaign.measurements), dict[Hashable, list[int]]()
    for i, m in enumerate(rows):
        if m.kind == "frequency" and not m.mode:
            places.setdefault((m.posture, m.load, m.drives), []).append(i)
    for own in places.values():
        for i, m in zip(own, sorted((rows[i] for i in own), key=lambda m: m.value), strict=True):
            rows[i] = m
    return replace(campaign, measurements=tuple(rows))


def _plausible(given: Given, unknowns: Unknowns, trusted: Collection[str]) -> Posed | None:
    """Pose a robot's campaign; None where it is not plausible, or is for itself."""
    try:
        posed = pose(given.arm, given.campaign, unknowns)
        check_values(posed, trusted)
    except IdentError:
        return None
    bound = len(posed.ratios) or any(m.kind in SHAPES for m in given.campaign)  # to what was measured of one robot
    return posed if posed.problem.in_parts().whole and not bound else None


def _fitted(posed: Posed, group: Sequence[Given], size: int, seed: int) -> dict[str, Robot]:
    """Fit robots like the first one, which is right; one that is right by what is trusted only is for itself."""
    problem = posed.problem
    predicted = evaluate(problem).predicted
    right = [each for each in group if plausible_beside(each.campaign, predicted)]
    if not right:
        return {}
    order = np.asarray(posed.conditions.order)
    every = np.array([[(m.value, m.sigma, m.resolution) for m in each.campaign] for each in right])
    value, sigma, step = np.moveaxis(every, 2, 0)
    shared = np.array([shared_error(order, *each) for each in zip(sigma, step, strict=True)])  # as `pose` has them
    fits = fit_many(problem, Values(value, shared), size, seed)
    stiffnesses = Stiffnesses.of(problem.parameters)
    return {
        each.name: replace(
            robot_at(Linear(*known), problem.parameters, stiffnesses),
            name=each.name,
            campaign=each.campaign_file,
            arm=each.arm_file,
            measurements=len(each.campaign),
        )
        for each, sound, *known in zip(right, *fits, strict=True)
        if sound
    }
