"""How much of the posterior's probability each separated optimum holds, by nested sampling."""

from dataclasses import dataclass
from importlib.util import find_spec

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from ident.errors import InputError, Problem
from ident.inference.marginal import Marginal
from ident.inference.parameters import Parameters
from ident.inference.posterior import Posterior, evaluate
from ident.inference.sample import Sample
from ident.jit import jit

LIVE = 500
"""Live points: enough that several land in each of a handful of basins."""

RESAMPLED = 50
"""Resampled runs from which the shares' standard deviation comes."""
LOWEST = -1e100
"""Log likelihood where the model has no answer; dynesty takes no infinite one."""


@dataclass(frozen=True)
class Weights:
    """Share of the posterior's probability about each optimum.

    Attributes:
        share: (basins,) sums to one.
        sd: (basins,) standard deviation of that, by resampling the strands of the run.
        log_evidence: logarithm of the evidence of model and priors.
    """

    share: Float[np.ndarray, "basins"]
    sd: Float[np.ndarray, "basins"]
    log_evidence: float


def weigh(sample: Sample) -> Weights:
    """Weigh the optima that were sampled against each other by dynesty's nested sampling from the prior.

    Each of its draws counts for the optimum whose ensembles are nearest, in their own covariance. Discrepancy factors
    are integrated out. Ellipsoids about the live points are enlarged by dynesty's fixed factor: to find the factor by
    resampling them costs most of an hour where four optima are narrow.

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
        got, remedy = "optima to weigh without the package dynesty", 'pip install "ident[evidence]"'
        raise InputError(Problem("weights", got, "it installed", remedy))


def check_weighable(posterior: Posterior) -> None:
    """Check that all unknowns have a prior.

    Raises:
        InputError: names those that have none.
    """
    parameters = posterior.parameters
    if not parameters.proper.all():
        names = ", ".join(np.array(parameters.names)[~parameters.proper])
        remedy = "give it (`prior`), or leave the optima unweighed"
        raise InputError(Problem("", f"no prior for {names}", "a prior for each unknown", remedy))


_from_uniform = jit(Parameters.from_uniform)


def _nearest(sample: Sample, kept: np.ndarray, draws: np.ndarray) -> np.ndarray:
    """Return for each draw of the unknowns that are kept the place of the basin that it is nearest to."""
    distance = []
    for basin in sample.basins:
        known = sample.draws(basin)[:, kept]
        off = draws - known.mean(0)
        distance.append(np.einsum("np,pq,nq->n", off, np.linalg.inv(np.atleast_2d(np.cov(known.T))), off))
    return np.argmin(distance, 0)
