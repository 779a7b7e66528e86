"""How much of the posterior's probability each separated optimum holds, by nested sampling."""

from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from ident.errors import InputError, Problem
from ident.identify.parameters import Parameters
from ident.identify.posterior import evaluate
from ident.identify.sample import Sample
from ident.jit import jit

LIVE = 500
"""Live points: enough that several land in each of a handful of basins."""

LOWEST = -1e100
"""Log likelihood where the model has no answer; dynesty takes no infinite one."""


@dataclass(frozen=True)
class Weights:
    """Share of the posterior's probability about each optimum.

    Attributes:
        share: (basins,) sums to one.
        sd: (basins,) standard deviation of that, by the number of independent draws.
        log_evidence: logarithm of the evidence of model and priors.
    """

    share: Float[np.ndarray, "basins"]
    sd: Float[np.ndarray, "basins"]
    log_evidence: float


def weigh(sample: Sample) -> Weights:
    """Weigh the optima that were sampled against each other by dynesty's nested sampling from the prior.

    Each of its draws counts for the optimum whose ensembles are nearest, in their own covariance.

    Raises:
        InputError: a parameter has no prior, so that there is no evidence.

    References:
        Skilling, "Nested sampling for general Bayesian computation", Bayesian Analysis 1(4), 2006.
        Speagle, "dynesty", MNRAS 493(3), 2020.
    """
    import dynesty

    posterior = sample.posterior
    parameters = posterior.parameters
    if not parameters.proper.all():
        names = ", ".join(np.array(parameters.names)[~parameters.proper])
        raise InputError(Problem("", f"no prior for {names}", "a prior for each unknown", "give it (--prior)"))

    def from_cube(u: np.ndarray) -> np.ndarray:
        return np.asarray(_from_uniform(parameters, jnp.asarray(u)))

    def log_likelihood(theta: np.ndarray) -> float:
        return max(evaluate(posterior, theta[None], sample.batch).log_likelihood[0], LOWEST)

    rng = np.random.default_rng(sample.settings.seed)
    sampler = dynesty.NestedSampler(log_likelihood, from_cube, len(parameters.items), nlive=LIVE, rstate=rng)
    sampler.run_nested(print_progress=False)
    found = sampler.results
    return _by_basin(sample, found.samples, found.importance_weights(), float(found.logz[-1]))


_from_uniform = jit(Parameters.from_uniform)


def _by_basin(sample: Sample, draws: np.ndarray, weight: np.ndarray, log_evidence: float) -> Weights:
    distance = []
    for basin in sample.basins:
        known = sample.draws(basin)
        off = draws - known.mean(0)
        distance.append(np.einsum("np,pq,nq->n", off, np.linalg.inv(np.cov(known.T)), off))
    nearest = np.argmin(distance, 0)
    share = np.array([weight[nearest == i].sum() for i in range(len(distance))])
    independent = 1 / (weight**2).sum()
    return Weights(share, np.sqrt(share * (1 - share) / independent), log_evidence)
