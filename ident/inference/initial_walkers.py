"""Where an ensemble begins: points that are already spread as the posterior is."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from ident.errors import ModelError
from ident.inference.least_squares import solve
from ident.inference.optima import Optimum
from ident.inference.posterior import Posterior, evaluate
from ident.inference.problem import InverseProblem

TRIES = 20
"""Rounds of drawing until the model has an answer at enough points."""
NARROW = 0.1
"""Spread of the noise scales of initial walkers, in widths of their priors."""


def initial_walkers(
    posterior: Posterior, optimum: Optimum, count: int, rng: np.random.Generator, batch: int
) -> Float[np.ndarray, "count P"]:
    """Draw points about an optimum by fitting it again and again to perturbed data and priors.

    Every measured value and every prior's centre is moved by its own uncertainty, and the fit repeated from the
    optimum. For a linear model that draws from the posterior exactly; for a curved, thin one, such as three numbers
    leave of six stiffnesses, the points lie along it, where a normal distribution's would lie off it.

    Args:
        posterior: the posterior.
        optimum: of its problem.
        count: number of points.
        rng: source of randomness.
        batch: size of batch in which the density is computed.

    Raises:
        ModelError: no such point was found.

    References:
        Bardsley, Solonen, Haario, Laine, "Randomize-then-optimize", SIAM J. Sci. Comput. 36(4), 2014.
    """
    walkers = np.zeros((0, len(posterior.parameters.items)))
    for _ in range(TRIES):
        points = np.array([_point(posterior, optimum, rng) for _ in range(count)])
        points = points[np.isfinite(points).all(1)]
        if len(points):
            walkers = np.concatenate([walkers, points[np.isfinite(evaluate(posterior, points, batch).log_density)]])
        if len(walkers) >= count:
            return walkers[:count]
    raise ModelError("no points to start the sampler from: the model has no answer about the optimum")


def _point(posterior: Posterior, optimum: Optimum, rng: np.random.Generator) -> np.ndarray:
    end = solve(_perturbed(posterior.problem, rng), jnp.asarray(optimum.theta))
    scales = [NARROW * float(item.prior_sd) * rng.standard_normal() for item in posterior.noise.items]
    return np.concatenate([np.asarray(end.theta), scales])


def _perturbed(problem: InverseProblem, rng: np.random.Generator) -> InverseProblem:
    """Move data and priors by their own uncertainty; a flat prior counts as a normal one of about its width."""
    sigma, parameters = np.asarray(problem.sigma), problem.parameters
    noise = np.where(np.isfinite(sigma), sigma, 0.0) * problem.correlated(rng.standard_normal(len(sigma)))
    sd = parameters.normal_sd
    shift = np.where(parameters.proper, sd, 0.0) * rng.standard_normal(len(sd))
    centres = parameters.values(parameters.theta(parameters.column("centre")) + shift)
    items = tuple(
        eqx.tree_at(
            lambda item: (item.centre, item.prior_sd, item.flat), item, tuple(map(np.asarray, (centre, s, 0.0)))
        )
        for item, centre, s in zip(parameters.items, centres, sd, strict=True)
    )
    moved = (problem.measured + noise, items)
    return eqx.tree_at(lambda p: (p.measured, p.parameters.items), problem, moved)
