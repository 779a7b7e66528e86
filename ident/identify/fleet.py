"""Many robots of one design: the likelihood of each, and the population of their stiffnesses."""

from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.special import logsumexp
from scipy.stats import multivariate_t

from ident.arm.arm import Arm
from ident.arm.fields import STIFFNESS, field_of
from ident.errors import InputError, ModelError, Problem, refusal
from ident.files import SourceFile
from ident.identify.fit import CampaignFit, fit_with_poles
from ident.identify.problem import pose
from ident.identify.unknowns import Unknowns
from ident.inference.fit import Fit, fit
from ident.inference.parameters import Parameters
from ident.inference.population import (
    FAULT,
    Deviations,
    Draws,
    Likelihood,
    Population,
    Under,
    deviations,
    population,
    weighed,
)
from ident.inference.posterior import evaluate, posterior
from ident.inference.priors import Prior
from ident.inference.sample import Settings, sample
from ident.measure import Campaign
from ident.text import by_key

FEWEST = 3
"""Least number of robots for a spread."""
WIDEST = 10.0
"""Width in theta of the prior of a population's mean if the robots' own fits have none; wide enough to be
uninformative."""


@dataclass(frozen=True, kw_only=True)
class Robot:
    """One robot: its own fit, and the likelihood of its stiffnesses.

    Attributes:
        name: its file's, or its folder's.
        campaign: the measurements.
        arm: the description.
        error: why it has no fit, a line for each reason; empty if it has one.
        names: (P,) its stiffnesses.
        theta: (P,) logarithms of its own estimates [ln N m/rad].
        sd: (P,) their standard deviations by its data and the interim prior.
        prior_mean: (P,) of that prior, in theta.
        prior_sd: (P,) infinite for none.
        likelihood: of theta, prior divided out.
        measurements: number of them.
        damping_ratio: geometric mean over the measured modes, by the law of its damping; 0 if none was measured.
        doubts: objections to the fit.
    """

    name: str = ""
    campaign: SourceFile = field(default_factory=SourceFile)
    arm: SourceFile = field(default_factory=SourceFile)
    error: str = ""
    names: tuple[str, ...] = ()
    theta: Float[np.ndarray, "P"] = field(default_factory=lambda: np.zeros(0))
    sd: Float[np.ndarray, "P"] = field(default_factory=lambda: np.zeros(0))
    prior_mean: Float[np.ndarray, "P"] = field(default_factory=lambda: np.zeros(0))
    prior_sd: Float[np.ndarray, "P"] = field(default_factory=lambda: np.zeros(0))
    likelihood: Likelihood = field(default_factory=lambda: Likelihood(np.zeros((0, 0)), np.zeros(0)))
    measurements: int = 0
    damping_ratio: float = 0.0
    doubts: tuple[str, ...] = ()

    @property
    def failed(self) -> bool:
        """Whether it has no fit."""
        return bool(self.error)


@dataclass(frozen=True, kw_only=True)
class Fleet:
    """The robots of a fleet and their population.

    Attributes:
        robots: all, by name.
        members: indices of the robots in the population: those with a fit without objections.
        names: (P,) stiffnesses.
        population: of the logarithms of the stiffnesses; None for fewer than three members.
    """

    robots: tuple[Robot, ...]
    members: tuple[int, ...]
    names: tuple[str, ...]
    population: Population | None

    @property
    def failed(self) -> tuple[Robot, ...]:
        """Robots without a fit."""
        return tuple(robot for robot in self.robots if robot.failed)

    @property
    def doubted(self) -> tuple[Robot, ...]:
        """Robots whose data contradict the model or each other: they do not belong to the population."""
        return tuple(robot for robot in self.robots if robot.doubts and not robot.failed)

    @cached_property
    def deviations(self) -> Deviations | None:
        """Deviation of each member from the others; None for fewer than three members."""
        if len(self.members) < FEWEST:
            return None
        return deviations([self.robots[i].likelihood for i in self.members], *self.search_prior)

    @property
    def search_prior(self) -> tuple[Float[np.ndarray, "P"], Float[np.ndarray, "P"]]:
        """Mean and standard deviation in theta at the start of the search for the means: the interim prior's."""
        first = self.robots[self.members[0]]
        return first.prior_mean, np.minimum(first.prior_sd, WIDEST)

    @property
    def standing_out(self) -> Mapping[int, tuple[int, ...]]:
        """Indices of significantly deviating stiffnesses, by the robot's index among the members; clearest first."""
        return {r: tuple(own) for r, own in by_key(self.deviations.named if self.deviations else ()).items()}


@dataclass(frozen=True)
class Stiffnesses:
    """Which unknowns of a fit are stiffnesses, and the interim prior of these.

    Attributes:
        names: (P,)
        places: (P,) indices among the unknowns.
        others: indices of the others.
        prior_mean: (P,) in theta.
        prior_sd: (P,) infinite for none.
    """

    names: tuple[str, ...]
    places: list[int]
    others: list[int]
    prior_mean: Float[np.ndarray, "P"]
    prior_sd: Float[np.ndarray, "P"]

    @classmethod
    def of(cls, parameters: Parameters) -> "Stiffnesses":
        """Find them among a fit's parameters."""
        names = parameters.names
        places = [i for i, path in enumerate(names) if (known := field_of(path)) and known.name in STIFFNESS]
        others = [i for i in range(len(names)) if i not in places]
        mean, sd = parameters.theta_centre[places], parameters.normal_sd[places]
        return cls(tuple(names[i] for i in places), places, others, mean, sd)


@dataclass(frozen=True)
class Linear:
    """Residuals and their slope at a fit.

    Attributes:
        theta: (U,) all unknowns.
        sd: (U,) their standard deviations by data and prior.
        residuals: (D,) [sigma] of the data.
        slope: (D, U) their derivative by theta.
    """

    theta: Float[np.ndarray, "U"]
    sd: Float[np.ndarray, "U"]
    residuals: Float[np.ndarray, "D"]
    slope: Float[np.ndarray, "D U"]

    @property
    def normal_equations(self) -> tuple[Float[np.ndarray, "U U"], Float[np.ndarray, "U"]]:
        """Precision of theta by the data alone, and the precision times their estimate."""
        precision = self.slope.T @ self.slope
        return precision, precision @ self.theta - self.slope.T @ self.residuals


def linear(fit: Fit) -> Linear:
    """Return the linearisation of a fit at its optimum."""
    slope = fit.problem.scaled(np.asarray(fit.jacobian))
    residuals = fit.problem.scaled(np.asarray(fit.predicted) - np.asarray(fit.problem.measured))
    return Linear(np.asarray(fit.best.theta), fit.information.sd, residuals, slope)


def robot_of(fit: CampaignFit, name: str, campaign: SourceFile, arm: SourceFile) -> Robot:
    """Return a robot with the likelihood of its stiffnesses; other unknowns are integrated out under their priors."""
    robot = robot_at(linear(fit), fit.problem.parameters, Stiffnesses.of(fit.problem.parameters))
    ratio = float(np.exp(np.nanmean(np.log(fit.damping.predicted)))) if fit.damping else 0.0
    known: dict[str, Any] = {"measurements": len(fit.campaign), "damping_ratio": ratio, "doubts": fit.doubts}
    return replace(robot, name=name, campaign=campaign, arm=arm, **known)


def robot_at(at: Linear, parameters: Parameters, stiffnesses: Stiffnesses) -> Robot:
    """Return a robot without a name, with the likelihood of its stiffnesses from residuals r and slope J at a fit.

    The likelihood is exp(-|r + J (theta - theta_fit)|^2 / 2): it contains no prior, of whatever form, that would have
    to be divided out.
    """
    places, others = stiffnesses.places, stiffnesses.others
    precision, shift = at.normal_equations
    off, prior_slope = (np.asarray(part) for part in parameters.prior_residuals(at.theta))
    precision[others, others] += prior_slope[others] ** 2
    shift[others] += prior_slope[others] ** 2 * at.theta[others] - prior_slope[others] * off[others]
    # the others are integrated out; an unbounded one removes its direction
    A, B, D = (precision[np.ix_(*pair)] for pair in ((places, places), (places, others), (others, others)))
    share = B @ np.linalg.pinv(D, hermitian=True)
    return Robot(
        names=stiffnesses.names,
        theta=at.theta[places],
        sd=at.sd[places],
        prior_mean=stiffnesses.prior_mean,
        prior_sd=stiffnesses.prior_sd,
        likelihood=Likelihood(A - share @ B.T, shift[places] - share @ shift[others]),
    )


Redraw = Callable[[Sequence[Robot], Under], Sequence[Draws | None]]
"""Draws robots under a population."""


def check_names(names: Sequence[str]) -> None:
    """Refuse robots of one name."""
    if twice := [name for name, times in Counter(names).items() if times > 1]:
        raise refusal(twice[0], "two robots of this name", "a name for each", "rename a file or a folder")


def fleet(robots: Iterable[Robot], *, seed: int = 0, redraw: Redraw | None = None) -> Fleet:
    """Infer the population of the stiffnesses of robots of one design.

    A robot with other stiffness names than most does not belong to the fleet: it counts as failed.

    Args:
        robots: fitted, or failed.
        seed: of the draws.
        redraw: draws robots under a population, each weighted by its data; without it, normal approximations stay.

    Raises:
        InputError: robots of one name.
    """
    robots = tuple(sorted(robots, key=lambda robot: robot.name))
    check_names([robot.name for robot in robots])
    most = Counter(robot.names for robot in robots if not robot.failed).most_common(1)
    names = most[0][0] if most else ()
    robots = tuple(_of_the_fleet(robot, names) for robot in robots)
    members = tuple(i for i, robot in enumerate(robots) if not (robot.failed or robot.doubts))
    found = Fleet(robots=robots, members=members, names=names, population=None)
    if found.deviations is None:
        return found
    known, off = tuple(robots[i].likelihood for i in members), found.deviations.off
    again = (lambda which, under: redraw([robots[members[r]] for r in which], under)) if redraw else None
    return replace(found, population=population(known, *found.search_prior, seed=seed, off=off, redraw=again))


def _of_the_fleet(robot: Robot, names: tuple[str, ...]) -> Robot:
    if robot.failed or robot.names == names:
        return robot
    other = sorted(set(robot.names) ^ set(names))
    got = f"other stiffnesses than most robots of the fleet ({', '.join(other) or 'in another order'})"
    problem = Problem(robot.arm.path, got, "one design", "fit it alone, or give it the same unknowns")
    return replace(robot, error=str(problem))


# -------- Fleet draws
# Likelihood of a robot by draws weighted with the exact model, where a normal approximation may be insufficient.

COUNT, CHUNK = 4000, 64
"""Draws of a robot, and number of draws computed together."""
HEAVY = 5.0
"""Degrees of freedom of the proposal densities: heavier tails than the target; assumed."""
HEALTHY = 0.5
"""Share of draws with all stiffnesses healthy; each of the others has one fault; assumed."""
STARTS = 2
ENOUGH = 1000.0
"""Effective draws of chains."""


class Normal(NamedTuple):
    """A normal density: mean (U,) and covariance (U, U)."""

    mean: Float[np.ndarray, "U"]
    covariance: Float[np.ndarray, "U U"]


def draws_under(
    arm: Arm, campaign: Campaign, unknowns: Unknowns, under: Under, seed: int, *, chains: bool = False
) -> Draws | None:
    """Draw a robot's stiffnesses about its optimum under a population, each weighted by the likelihood of its data.

    All unknowns are drawn, from a mixture of Student's t about the optimum, linearised there: with all stiffnesses
    healthy, and with one after the other faulty. The other unknowns keep their priors. The t are in the reciprocals of
    positive unknowns, as deflections are nearly linear in compliances. If few data allow so wide a region that the
    weights cannot be trusted, chains draw instead.

    Args:
        arm: its stiffnesses have the population's names, in their order.
        campaign: the measurements.
        unknowns: of the robot's own fit.
        under: the population.
        seed: of the draws.
        chains: use chains in any case.

    Returns:
        None if the robot has no optimum there, or the model no solution near it.
    """
    posed = pose(arm, campaign, unknowns)
    own = Stiffnesses.of(posed.problem.parameters)
    priors = {
        name: Prior.log_normal(float(np.exp(mean)), float(sd))
        for name, mean, sd in zip(own.names, under.mean, under.sd, strict=True)
    }
    try:
        unknowns = replace(unknowns, priors={**unknowns.priors, **priors})
        _, _, found = fit_with_poles(arm, campaign, unknowns, partial(fit, starts=STARTS, seed=seed))
        drawn = None if chains else _weighed(found, own, seed)
        return drawn if drawn and weighed(drawn, under).sound else _chains(found, own, under, seed)
    except (InputError, ModelError):
        return None


def _weighed(found: Fit, own: Stiffnesses, seed: int) -> Draws:
    """Draw from a mixture, and weight by the exact model.

    Raises:
        ModelError: it has no solution for any draw.
    """
    at, problem = linear(found), found.problem
    positive, parts = problem.parameters.positive, _parts(at, problem.parameters, own.places)
    theta = _drawn(parts, positive, np.random.default_rng(seed))
    whole = evaluate(posterior(problem), theta, CHUNK)
    others = np.asarray(problem.parameters.prior_residuals(theta.T)[0])[own.others]
    log_prior = _log_density(parts, positive, theta) - np.asarray(whole.log_likelihood) + (others**2).sum(0) / 2
    known = np.isfinite(log_prior)
    if not known.any():
        raise ModelError("no answer about the optimum")
    return Draws(theta[known][:, own.places], log_prior[known], robot_at(at, problem.parameters, own).likelihood)


def _chains(found: Fit, own: Stiffnesses, under: Under, seed: int) -> Draws:
    """Draw by emcee, under the population of healthy stiffnesses."""
    theta = sample(found, posterior(found.problem), Settings(target_ess=ENOUGH, seed=seed)).draws()[:, own.places]
    theta = theta[:: max(len(theta) // int(ENOUGH), 1)]
    log_prior = -(((theta - under.mean) / under.sd) ** 2).sum(1) / 2
    return Draws(theta, log_prior, robot_at(linear(found), found.problem.parameters, own).likelihood)


def _parts(at: Linear, parameters: Parameters, stiffnesses: list[int]) -> list[Normal]:
    """Return the posteriors by linearised data: of a healthy robot, and with one stiffness after the other faulty."""
    (precision, shift), centre = at.normal_equations, parameters.theta_centre
    healthy = np.minimum(parameters.normal_sd, WIDEST)
    widths = [healthy, *(np.where(np.arange(len(healthy)) == i, FAULT, healthy) for i in stiffnesses)]
    covariances = [np.linalg.inv(precision + np.diag(width**-2.0)) for width in widths]
    means = (c @ (shift + centre / width**2) for c, width in zip(covariances, widths, strict=True))
    return [Normal(*each) for each in zip(means, covariances, strict=True)]


def _shares(parts: list[Normal]) -> np.ndarray:
    return np.array([HEALTHY, *[(1 - HEALTHY) / (len(parts) - 1)] * (len(parts) - 1)])


def _drawn(parts: list[Normal], positive: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Draw from the mixture, `(n, U)`, without draws that have a nonpositive reciprocal."""
    counts = rng.multinomial(COUNT, _shares(parts))
    theta = []
    for part, n in zip(parts, counts, strict=True):
        away = _student(part).rvs(n, random_state=rng).reshape(n, -1)  # 1 - exp(mean - theta) if positive
        with np.errstate(invalid="ignore", divide="ignore"):
            theta.append(part.mean + np.where(positive, -np.log1p(-np.where(positive, away, 0.0)), away))
    whole = np.concatenate(theta)
    return whole[np.isfinite(whole).all(1)]


def _log_density(parts: list[Normal], positive: np.ndarray, theta: np.ndarray) -> np.ndarray:
    """Return the logarithm of the mixture's density in theta."""
    each = []
    for part in parts:
        step = theta - part.mean
        away = np.where(positive, -np.expm1(-np.where(positive, step, 0.0)), step)
        rise = np.where(positive, step, 0.0).sum(1)
        each.append(np.atleast_1d(_student(part).logpdf(away)) - rise)
    return np.asarray(logsumexp(each, axis=0, b=_shares(parts)[:, None]))


def _student(part: Normal) -> Any:
    return multivariate_t(np.zeros(len(part.mean)), part.covariance, df=HEAVY)
