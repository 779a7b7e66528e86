"""What the posterior says of data: predictions, and data simulated with their noise."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from ident.inference.posterior import evaluate
from ident.inference.sample import Sample

COUNT = 2000
"""Draws, at most, for which data are predicted."""


class PosteriorPredictive(NamedTuple):
    """Data as a sample of the posterior has them, all SI.

    Attributes:
        theta: (n, P) the draws, picked at random from all chains.
        predicted: (n, D) predictions.
        simulated: (n, D) the same with noise.
    """

    theta: Float[np.ndarray, "n P"]
    predicted: Float[np.ndarray, "n D"]
    simulated: Float[np.ndarray, "n D"]


def posterior_predictive(sample: Sample, basin: int = 0, count: int = COUNT) -> PosteriorPredictive:
    """Predict and simulate the data for some of the draws about one optimum; reproducible by the sample's seed."""
    draws, rng = sample.draws(basin), np.random.default_rng([sample.settings.seed, 1])
    theta = draws[np.sort(rng.choice(len(draws), min(count, len(draws)), replace=False))]
    at = evaluate(sample.posterior, theta, sample.batch)
    noise = rng.standard_normal((len(theta), len(at.predicted)))
    problem = sample.posterior.problem
    noise, sigma = problem.correlated(noise.T).T, np.asarray(problem.sigma)
    width = np.where(np.isfinite(sigma), sigma, 0.0) * at.scale.T
    return PosteriorPredictive(theta, at.predicted.T, at.predicted.T + width * noise)
