"""What the draws of a posterior say: quantiles, how much narrower than the prior they are, known combinations."""

import math
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int

from ident.inference.information import Direction, alone
from ident.inference.parameters import Parameters
from ident.inference.sample import Sample

LEVELS = (0.025, 0.25, 0.5, 0.75, 0.975)
"""Ends of the 95 and 50 % intervals, and the median between."""
LEARNED = 0.5
"""Share of the prior's width above which a posterior says little beyond the prior."""


def draws(sample: Sample, basin: int = 0) -> Float[np.ndarray, "P n"]:
    """Return the draws of all unknowns [SI] about one optimum, burn-in left out."""
    return np.asarray(sample.posterior.parameters.values(jnp.asarray(sample.draws(basin).T)))


def quantiles(sample: Sample, basin: int = 0) -> Float[np.ndarray, "levels P"]:
    """Return the quantiles `LEVELS` of all unknowns [SI] over the draws about one optimum."""
    return np.quantile(draws(sample, basin), LEVELS, axis=1)


class Chains(NamedTuple):
    """Draws of a sample, burn-in left out, every walker a chain: those of the first ensemble come first.

    Attributes:
        values: (P, chains, draws) [SI] all unknowns.
        log_density: (chains, draws) log posterior.
        ensemble: (chains,) to which each belongs.
        optimum: (chains,) about which it is.
    """

    values: Float[np.ndarray, "P chains draws"]
    log_density: Float[np.ndarray, "chains draws"]
    ensemble: Int[np.ndarray, "chains"]
    optimum: Int[np.ndarray, "chains"]


def chains(sample: Sample) -> Chains:
    """Return the draws chain by chain."""
    theta, log_density = sample.theta[sample.burn_in :], sample.log_density[sample.burn_in :]
    steps, ensembles, walkers, count = theta.shape
    flat = np.moveaxis(theta, 3, 0).reshape(count, steps, -1)
    values = np.asarray(sample.posterior.parameters.values(jnp.asarray(flat))).swapaxes(1, 2)
    ensemble = np.repeat(np.arange(ensembles), walkers)
    return Chains(values, log_density.reshape(steps, -1).T, ensemble, np.array(sample.basin)[ensemble])


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

    They are the principal directions of the covariance in theta of the draws about the best optimum; one that is hardly
    more than one parameter is that parameter (`ident.inference.information.alone`).
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


def prior_spread(direction: Direction, parameters: Parameters) -> float:
    """Return the standard deviation in theta along a direction by the priors alone; infinite if one is missing."""
    parts = direction.weights != 0
    return float(np.sqrt(((direction.weights[parts] * parameters.normal_sd[parts]) ** 2).sum()))


def ratio_to_prior(parameters: Parameters, theta: Float[np.ndarray, "P *batch"]) -> Float[np.ndarray, "P *batch"]:
    """Return values as multiples of the centres of their priors; of a length, exp of its distance in theta."""
    centre = np.asarray(parameters.theta(parameters.column("centre")))
    return np.exp(theta - centre.reshape((-1,) + (1,) * (theta.ndim - 1)))
