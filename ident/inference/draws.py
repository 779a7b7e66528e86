"""Summaries and predictions from draws of a posterior, and the weight of each optimum."""

import math
from dataclasses import dataclass
from importlib.util import find_spec
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from ident.errors import refusal, require
from ident.inference.information import Direction, alone
from ident.inference.parameters import Parameters
from ident.inference.posterior import Marginal, Posterior, evaluate
from ident.inference.sample import Sample
from ident.programs import jit

# -------- Evidence
# Share of each separated optimum in the posterior's probability, by nested sampling.

LIVE = 500
"""Live points: enough for several in each of a few basins."""

RESAMPLED = 50
"""Resampled runs for the shares' standard deviation."""
LOWEST = -1e100
"""Log likelihood where the model has no solution; dynesty accepts no infinite one."""


@dataclass(frozen=True)
class Weights:
    """Share of each optimum in the posterior's probability.

    Attributes:
        share: (basins,) sums to one.
        sd: (basins,) standard deviation of that, by resampling the strands of the run.
        log_evidence: logarithm of the evidence of model and priors.
    """

    share: Float[np.ndarray, "basins"]
    sd: Float[np.ndarray, "basins"]
    log_evidence: float


def weigh(sample: Sample) -> Weights:
    """Weigh the sampled optima against each other by dynesty's nested sampling from the prior.

    Each of its draws counts for the optimum with the nearest ensembles, in their own covariance. Discrepancy factors
    are integrated out. Ellipsoids about the live points are enlarged by dynesty's fixed factor: estimating the factor
    by resampling takes most of an hour for four narrow optima.

    Raises:
        InputError: a parameter has no prior, so that there is no evidence.

    References:
        Skilling, "Nested sampling for general Bayesian computation", Bayesian Analysis 1(4), 2006.
        Speagle, "dynesty", MNRAS 493(3), 2020.
    """
    import dynesty

    check_weighable(sample.posterior)
    target = Marginal(sample.posterior)
    density, parameters = target.itself, target.parameters

    def from_cube(u: np.ndarray) -> np.ndarray:
        return np.asarray(_from_uniform(parameters, jnp.asarray(u)))

    def log_likelihood(theta: np.ndarray) -> float:
        return max(evaluate(density, theta[None], 1).log_likelihood[0], LOWEST)

    rng = np.random.default_rng(sample.settings.seed)
    sampler = dynesty.NestedSampler(
        log_likelihood, from_cube, len(parameters.items), nlive=LIVE, bootstrap=0, rstate=rng
    )
    sampler.run_nested(print_progress=False)
    run = sampler.results
    nearest, count = _nearest(sample, ~target.integrated, run.samples), len(sample.basins)
    share = np.bincount(nearest, run.importance_weights(), count)
    resampled = []
    for _ in range(RESAMPLED):
        other, which = dynesty.utils.resample_run(run, rng, return_idx=True)
        resampled.append(np.bincount(nearest[which], other.importance_weights(), count))
    return Weights(share, np.std(resampled, axis=0), float(run.logz[-1]))


def check_installed() -> None:
    """Check that dynesty is installed, without importing it.

    Raises:
        InputError: it is not.
    """
    if find_spec("dynesty") is None:
        raise refusal("weights", "optima to weigh without the package dynesty", "it installed", "pip install dynesty")


def check_weighable(posterior: Posterior) -> None:
    """Check that all unknowns have a prior.

    Raises:
        InputError: names the unknowns without one.
    """
    parameters = posterior.parameters
    names = ", ".join(np.array(parameters.names)[~parameters.proper])
    remedy = "give it (`prior`), or leave the optima unweighed"
    require(parameters.proper.all(), "", f"no prior for {names}", "a prior for each unknown", remedy)


_from_uniform = jit(Parameters.from_uniform)


def _nearest(sample: Sample, kept: np.ndarray, draws: np.ndarray) -> np.ndarray:
    """Return the index of the nearest basin for each draw of the kept unknowns."""
    distance = []
    for basin in sample.basins:
        known = sample.draws(basin)[:, kept]
        off = draws - known.mean(0)
        distance.append(np.einsum("np,pq,nq->n", off, np.linalg.inv(np.atleast_2d(np.cov(known.T))), off))
    return np.argmin(distance, 0)


# -------- Posterior predictive
# Predictions by draws of the posterior, and data simulated with their noise.

COUNT = 2000
"""Most draws for which data are predicted."""


class PosteriorPredictive(NamedTuple):
    """Data predicted by draws of the posterior, all SI.

    Attributes:
        theta: (n, P) draws picked at random from all chains.
        predicted: (n, D) predictions.
        simulated: (n, D) the same with noise.
    """

    theta: Float[np.ndarray, "n P"]
    predicted: Float[np.ndarray, "n D"]
    simulated: Float[np.ndarray, "n D"]


def posterior_predictive(sample: Sample, count: int = COUNT) -> PosteriorPredictive:
    """Predict and simulate the data for some of the draws about the best optimum; reproducible by the sample's seed."""
    draws, rng = sample.draws(), np.random.default_rng([sample.settings.seed, 1])
    theta = draws[np.sort(rng.choice(len(draws), min(count, len(draws)), replace=False))]
    at = evaluate(sample.posterior, theta, sample.batch)
    noise = rng.standard_normal((len(theta), len(at.predicted)))
    problem = sample.posterior.problem
    noise, sigma = problem.errors.color(noise.T).T, np.asarray(problem.sigma)
    width = np.where(np.isfinite(sigma), sigma, 0.0) * at.scale.T
    return PosteriorPredictive(theta, at.predicted.T, at.predicted.T + width * noise)


# -------- Posterior summary
# Summaries of a posterior's draws: quantiles, width relative to the prior, well-determined combinations.

LEVELS = (0.025, 0.25, 0.5, 0.75, 0.975)
"""Ends of the 95 and 50 % intervals, and the median between."""
LEARNED = 0.5
"""Ratio of posterior to prior width above which the data add little to the prior; assumed."""


def draws(sample: Sample, basin: int = 0) -> Float[np.ndarray, "P n"]:
    """Return the draws of all unknowns [SI] about one optimum, without burn-in."""
    return np.asarray(sample.posterior.parameters.values(jnp.asarray(sample.draws(basin).T)))


def quantiles(sample: Sample, basin: int = 0) -> Float[np.ndarray, "levels P"]:
    """Return the quantiles `LEVELS` of all unknowns [SI] over the draws about one optimum."""
    return np.quantile(draws(sample, basin), LEVELS, axis=1)


def prior_intervals(parameters: Parameters) -> Float[np.ndarray, "P 2"]:
    """Return the ends in theta of the priors' 95 % intervals; NaN without a prior."""
    return np.asarray(parameters.from_uniform(jnp.asarray([[LEVELS[0], LEVELS[-1]]] * len(parameters.names))))


def share_of_prior(sample: Sample, basin: int = 0) -> Float[np.ndarray, "P"]:
    """Return the width of the 95 % intervals in theta as a share of the prior's; 0 without a prior."""
    parameters = sample.posterior.parameters
    prior = np.ptp(prior_intervals(parameters), axis=1)
    own = np.ptp(np.quantile(sample.draws(basin), (LEVELS[0], LEVELS[-1]), axis=0), axis=0)
    return np.where(parameters.proper, own / np.where(parameters.proper, prior, 1.0), 0.0)


def combinations(sample: Sample) -> tuple[Direction, ...]:
    """Return the combinations of the unknowns of interest, best known first, each with its spread over the draws.

    They are the principal directions of the covariance in theta of the draws about the best optimum; one dominated by
    a single parameter becomes that parameter (`ident.inference.information.alone`).
    """
    parameters = sample.fit.problem.parameters
    own = np.flatnonzero(~parameters.nuisance)
    covariance = np.atleast_2d(np.cov(sample.draws()[:, own].T))
    found = []
    for vector in np.linalg.eigh(covariance)[1].T:
        main = alone(vector * np.sign(vector[np.argmax(np.abs(vector))]))
        weights = np.zeros(len(parameters.items))
        weights[own] = main
        found.append(Direction(weights, math.sqrt(main @ covariance @ main)))
    return tuple(sorted(found, key=lambda direction: direction.sd))


def ratio_to_prior(parameters: Parameters, theta: Float[np.ndarray, "P *batch"]) -> Float[np.ndarray, "P *batch"]:
    """Return values as multiples of the centres of their priors; for a length, exp of its distance in theta."""
    return np.exp(theta - parameters.theta_centre.reshape((-1,) + (1,) * (theta.ndim - 1)))
