"""What a robot's data say by draws that the exact model weighs, where a normal approximation may not do."""

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.special import logsumexp
from scipy.stats import multivariate_t

from ident.arm.arm import Arm
from ident.errors import InputError, ModelError
from ident.identify.build_problem import build_problem
from ident.identify.fleet import WIDEST, Linear, Stiffnesses, linear, robot_at
from ident.identify.unknowns import Unknowns
from ident.inference.fit import Fit, fit
from ident.inference.parameters import Parameters
from ident.inference.population import weighed
from ident.inference.population_chains import FAULT, Draws, Under
from ident.inference.posterior import evaluate, posterior
from ident.inference.priors import Prior
from ident.inference.sample import Settings, sample
from ident.measure import Campaign

COUNT, CHUNK = 4000, 64
"""Draws of a robot, and how many of them are computed together."""
HEAVY = 5.0
"""Degrees of freedom of the densities that are drawn from: their tails shall be above those of what is drawn."""
HEALTHY = 0.5
"""Share of the draws that takes all stiffnesses for healthy; in each of the others one is off."""
STARTS = 2
ENOUGH = 1000.0
"""Effective draws of chains."""


class Normal(NamedTuple):
    """A normal density: mean (U,) and covariance (U, U)."""

    mean: Float[np.ndarray, "U"]
    covariance: Float[np.ndarray, "U U"]


def draws_under(arm: Arm, campaign: Campaign, unknowns: Unknowns, under: Under, seed: int) -> Draws | None:
    """Draw a robot's stiffnesses about its optimum under a population, each weighed by the likelihood of its data.

    Drawn are all unknowns, from a mixture of Student's t about the optimum, linearised there: the stiffnesses as the
    population's healthy ones, and one after the other off. The others keep their priors. The t are in the reciprocals
    of what is positive: deflections are nearly linear in compliances. Where data so few leave so wide an area that the
    weights can't be trusted, chains draw instead.

    Args:
        arm: its stiffnesses are named as the population's, in their order.
        campaign: the measurements.
        unknowns: of the robot's own fit.
        under: the population.
        seed: of the draws.

    Returns:
        None where the robot has no optimum there, or the model no answer about it.
    """
    own = Stiffnesses.of(build_problem(arm, campaign, unknowns).parameters)
    priors = {
        name: Prior.log_normal(float(np.exp(mean)), float(sd))
        for name, mean, sd in zip(own.names, under.mean, under.sd, strict=True)
    }
    try:
        problem = build_problem(arm, campaign, replace(unknowns, priors={**unknowns.priors, **priors}))
        found = fit(problem, starts=STARTS, seed=seed)
        drawn = _weighed(found, own, seed)
        return drawn if weighed(drawn, under).sound else _chains(found, own, under, seed)
    except (InputError, ModelError):
        return None


def _weighed(found: Fit, own: Stiffnesses, seed: int) -> Draws:
    """Draw from a mixture, and weigh by the exact model.

    Raises:
        ModelError: it has no answer for any draw.
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
    """Return the posteriors by linearised data: of a healthy robot, and with one stiffness after the other off."""
    precision = at.slope.T @ at.slope
    shift = precision @ at.theta - at.slope.T @ at.residuals
    centre = np.asarray(parameters.theta(np.asarray(parameters.column("centre"))))
    healthy = np.minimum(parameters.normal_sd, WIDEST)
    widths = [healthy, *(np.where(np.arange(len(healthy)) == i, FAULT, healthy) for i in stiffnesses)]
    covariances = [np.linalg.inv(precision + np.diag(width**-2.0)) for width in widths]
    means = (c @ (shift + centre / width**2) for c, width in zip(covariances, widths, strict=True))
    return [Normal(*each) for each in zip(means, covariances, strict=True)]


def _shares(parts: list[Normal]) -> np.ndarray:
    return np.array([HEALTHY, *[(1 - HEALTHY) / (len(parts) - 1)] * (len(parts) - 1)])


def _drawn(parts: list[Normal], positive: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Draw from the mixture, `(n, U)`; a draw of which a reciprocal is not positive is left out."""
    counts = rng.multinomial(COUNT, _shares(parts))
    each = zip(parts, counts, strict=True)
    theta = [_theta(_student(part).rvs(n, random_state=rng).reshape(n, -1), part, positive) for part, n in each]
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


def _theta(away: np.ndarray, part: Normal, positive: np.ndarray) -> np.ndarray:
    """Return theta of steps 1 - exp(mean - theta) in the reciprocals of positive unknowns; NaN where there is none."""
    with np.errstate(invalid="ignore", divide="ignore"):
        return part.mean + np.where(positive, -np.log1p(-np.where(positive, away, 0.0)), away)


def _student(part: Normal) -> Any:
    return multivariate_t(np.zeros(len(part.mean)), part.covariance, df=HEAVY)
