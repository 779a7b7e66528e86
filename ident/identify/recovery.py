"""Recovery of known truths: campaigns of drawn robots with one's own rows are fitted, and compared with the truth."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from math import log
from typing import Any, ClassVar, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from ident.arm.arm import STIFFER, on_soft_base, stiffness_paths
from ident.errors import require
from ident.identify.assumptions import assumptions
from ident.identify.exchangeable import exchangeable
from ident.identify.fit import FARTHEST, CampaignFit
from ident.identify.hypotheses import SOFT
from ident.identify.problem import Posed, pose
from ident.identify.unknowns import Unknowns
from ident.inference.change import change, power
from ident.inference.fit import FIT_STARTS, Fit
from ident.inference.fit import fit as fit_problem
from ident.inference.information import IMPROBABLE, RARE, half_width, rare
from ident.inference.optima import normal_prior_sd
from ident.inference.problem import InverseProblem
from ident.inference.search import evaluate
from ident.programs import Progress, beside_each_other
from ident.text import by_key

LEVEL = 0.95
"""Of the intervals."""
FALSE_ALARMS = 3 * RARE + IMPROBABLE
"""Largest share of right campaigns in doubt: by their rows, kinds or assumptions, or by chi-squared."""
TIMES = 20
"""Robots with each fault, and robots that change."""
CHANGE, OFF = 0.1, 6.0
"""Relative change of a stiffness; error of the wrong row [sigma]."""
RIGHT, CHANGED = "nothing wrong", f"one stiffness {100 * CHANGE:g} % higher, measured again"
RATES = "unknown", "bias", "standard_error", "held", "intervals", "level", "power"
STARTS = 4
"""Least number of starts of a fit that leaves no doubt; any other has as many as `ident fit`."""


@dataclass(frozen=True)
class Recovery:
    """Fits of campaigns of known robots.

    Attributes:
        fit: to the campaign as measured; its rows, sigmas, correlations and priors are those of the made campaigns.
        truths: `prior` or `posterior`, from which the robots are drawn.
        rates: a row for each unknown: `bias` of theta with its `standard_error`; `intervals`, the number of 95 %
            intervals that the reports show, `held`, the number of those that hold the truth, and `level`, the chance
            that a right one does; for a stiffness `power`, the probability that the same rows, measured again, show a
            change of `CHANGE`.
        noticed: by what is wrong, the number of robots whose report has an alarm, and the number of robots.
        expected: number of changed robots whose change the linear problem expects to be noticed.
    """

    fit: CampaignFit
    truths: str
    rates: tuple[Mapping[str, Any], ...]
    noticed: Mapping[str, tuple[int, int]]
    expected: float

    scopes: ClassVar[tuple[()]] = ()

    @property
    def covered(self) -> int:
        """Number of all intervals that hold the truth."""
        return sum(row["held"] for row in self.rates)

    @cached_property
    def missed(self) -> tuple[str, ...]:
        """Unknowns whose intervals hold the truth too seldom or too often, and `RIGHT` if there are false alarms.

        By binomial tests, corrected for their number.
        """
        from scipy.stats import binomtest

        counts = [(row["held"], row["intervals"], row["level"], "two-sided") for row in self.rates if row["intervals"]]
        chances = [binomtest(*each).pvalue for each in (*counts, (*self.noticed[RIGHT], FALSE_ALARMS, "greater"))]
        names = (*(row["unknown"] for row in self.rates if row["intervals"]), RIGHT)
        return tuple(name for name, is_rare in zip(names, rare(chances), strict=True) if is_rare)


def recover(
    fit: CampaignFit, unknowns: Unknowns, draws: int, seed: int = 0, truths: str = "prior", progress: Progress = iter
) -> Recovery:
    """Draw robots from the prior or the posterior, make the fit's campaign of each, fit it, and compare with the truth.

    Truths of the prior are held by 95 % of right 95 % intervals. Parameters without a prior have their fitted value.
    Truths of the posterior are normal about the fit; how often the intervals hold these is the linear problem's, see
    `_levels`. The search begins at the parameters' starting values and near them; of wrong campaigns and changed
    robots, at the truth.

    Args:
        fit: of the campaign as measured.
        unknowns: of the fit.
        draws: number of robots.
        seed: of robots and errors.
        truths: `prior` or `posterior`, from which the robots are drawn.
        progress: wraps the numbers of the robots, to show a bar.

    Raises:
        InputError: no prior, or one so wide that the checks of a fit use another one.
        ModelError: a campaign has no optimum.
    """
    remedy = "give one (`prior_sd`), or leave `recover` out"
    require(unknowns.with_prior == unknowns, "recover", "no prior, or one wider than 1", "a prior", remedy)
    problem, parameters, rows = fit.problem, fit.problem.parameters, fit.campaign.measurements
    sigma = np.nan_to_num(np.asarray(problem.sigma), posinf=0.0)
    places = [i for i, name in enumerate(parameters.names) if name in stiffness_paths(fit.arm)]
    names, faults = [parameters.names[i] for i in places], _faults(fit, unknowns, sigma)
    ascending = sorted((m.value, i) for i, m in enumerate(rows) if m.kind == "frequency" and not m.mode)
    alike = by_key(((rows[i].posture, rows[i].load, rows[i].drives), i) for _, i in ascending).values()

    def drawn(rng: np.random.Generator) -> np.ndarray:
        if truths == "posterior":
            return rng.multivariate_normal(fit.best.theta, fit.information.covariance)
        uniform = jnp.asarray(rng.uniform(size=len(parameters.items)))
        return np.where(parameters.proper, np.asarray(parameters.from_uniform(uniform)), fit.best.theta)

    def made(values: np.ndarray, rng: np.random.Generator) -> InverseProblem:
        """Return the problem of these values with errors; of frequencies without a label the order counts."""
        values = values + sigma * problem.errors.color(rng.standard_normal(len(values)))
        for own in alike:
            values[own] = np.sort(values[own])
        return replace(problem, measured=jax.device_put(values))

    def fitted(problem: InverseProblem, start: np.ndarray | None = None) -> CampaignFit:
        """Return the fit: in doubt, with more starts; from a given start, kinds are compared only without a doubt."""
        tries = ((STARTS, True), (FIT_STARTS, True)) if start is None else ((1, False), (1, True))
        for starts, checked in tries:
            found = fit_problem(problem, starts=starts, start=start, checked=checked)
            known = {each.name: getattr(found, each.name) for each in fields(found)}
            granted = assumptions(found, Posed(fit.campaign, problem)) if checked and found.best.converged else None
            whole = replace(fit, **known, assumptions=granted)
            if bool(whole.doubts) == (start is not None):
                break
        return whole

    def robot(number: int) -> _Robot:
        """Fit a robot's campaign; of the first `TIMES` robots, also those with a change and with each fault."""
        rng, values, alarms = np.random.default_rng((seed, number)), np.array([np.nan]), dict[str, bool]()
        while not np.isfinite(values).all():
            values = _predicted(problem, truth := drawn(rng))
        first = fitted(made(values, rng))
        if number < TIMES and places:
            changed = truth + log(1 + CHANGE) * (np.arange(len(truth)) == places[number % len(places)])
            # `change` searches from the first's end
            second = replace(first, problem=made(_predicted(problem, changed), rng))
            alarms[CHANGED] = change(first, second, names, singly=False).seen
        for name, wrong in faults.items() if number < TIMES else ():
            if np.isfinite(values := wrong(truth, rng)).all():
                alarms[name] = fitted(made(values, rng), truth).in_doubt
        return _Robot(truth, first, alarms)

    robots = beside_each_other(robot, draws, progress)
    known, fits, changes = np.array([each.truth for each in robots]), [each.fit for each in robots], robots[:TIMES]
    expected = sum(_power(each.fit, places)[i % len(places)] for i, each in enumerate(changes) if places)
    noticed = {RIGHT: (sum(found.in_doubt for found in fits), draws)}
    for name in (CHANGED, *faults):
        alarms = [each.alarms[name] for each in robots if name in each.alarms]
        noticed[name] = sum(alarms), len(alarms)
    off, shown = np.array([each.best.theta for each in fits]) - known, np.array([each.supported for each in fits])
    low, high = np.array([parameters.theta(each.interval(LEVEL)).T for each in fits]).swapaxes(0, 1)
    held = shown & (low <= known) & (known <= high)
    levels = _levels(fit, known) if truths == "posterior" else np.full(len(parameters.names), LEVEL)
    columns = off.mean(0), off.std(0, ddof=1) / draws**0.5, held.sum(0), shown.sum(0), levels
    each_unknown = zip(parameters.names, *(column.tolist() for column in columns), strict=True)
    chances = dict(zip(names, _power(fit, places), strict=True))
    rates = (dict(zip(RATES, (*row, chances.get(row[0])), strict=True)) for row in each_unknown)
    return Recovery(fit, truths, tuple(rates), noticed, expected)


class _Robot(NamedTuple):
    """A known robot: theta, the fit to its campaign, and whether each change or fault of it was noticed."""

    truth: Float[np.ndarray, "P"]
    fit: CampaignFit
    alarms: Mapping[str, bool]


def _levels(fit: Fit, truths: Float[np.ndarray, "K P"]) -> Float[np.ndarray, "P"]:
    """Return the chance that a 95 % interval holds truths that are not drawn from the prior, in the linear case.

    With C the covariance by data and prior, P the prior's information and m its centre, the estimate of theta is normal
    about theta - C P (theta - m), with covariance C J'J C.
    """
    from scipy.special import ndtr

    J, C, half = fit.problem.scaled(np.asarray(fit.jacobian)), fit.information.covariance, half_width(LEVEL)
    bias = (fit.problem.parameters.theta_centre - truths) * normal_prior_sd(fit.problem) ** -2 @ C
    sd, spread = fit.information.sd, np.sqrt(np.diag(C @ J.T @ J @ C))
    return (ndtr((half * sd - bias) / spread) - ndtr((-half * sd - bias) / spread)).mean(0)


def _predicted(problem: InverseProblem, theta: np.ndarray) -> np.ndarray:
    return np.asarray(evaluate(problem, theta).predicted)


Wrong = Callable[[np.ndarray, np.random.Generator], np.ndarray]
"""From theta of a robot to the wrong values, without errors; NaN if the robot has no equilibrium."""


def _faults(fit: CampaignFit, unknowns: Unknowns, sigma: np.ndarray) -> dict[str, Wrong]:
    """Return the faults that the rows may have."""
    rows, place = fit.campaign.measurements, np.arange(len(sigma))

    def row_off(truth: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        off = rng.choice([-OFF, OFF]) * sigma * (place == rng.choice(np.flatnonzero(sigma)))
        return _predicted(fit.problem, truth) + off

    faults: dict[str, Wrong] = {f"one row {OFF:g} sigma off": row_off}
    pairs = exchangeable(fit.campaign, fit.farthest_off[:FARTHEST])
    pairs = ((i, j) for i, j in pairs if len({rows[i].mode, rows[j].mode, None}) == 3)
    if orders := [np.where(place == i, j, np.where(place == j, i, place)) for i, j in pairs]:
        faults["labels of two modes swapped"] = lambda truth, rng: _predicted(fit.problem, truth)[rng.choice(orders)]
    granted = fit.assumptions
    if granted and fit.arm.base is None and any(item.kind in SOFT for item in granted.items):
        own, arm = unknowns.named(fit.arm), on_soft_base(fit.fitted_arm, granted.height)
        soft = pose(arm, fit.campaign, replace(own, fixed=(*own.fixed, "base.k_*"))).problem
        faults[f"base only {STIFFER:g} times as stiff as joint 1"] = lambda truth, _: _predicted(soft, truth)
    return faults


def _power(fit: Fit, places: Sequence[int]) -> list[float]:
    """Return the probability that the same rows, measured again, show a change of each stiffness."""
    J = fit.problem.scaled(np.asarray(fit.jacobian))[:, list(places)]
    return [power(J.T @ J / 2, log(1 + CHANGE) * one) for one in np.eye(len(places))]
