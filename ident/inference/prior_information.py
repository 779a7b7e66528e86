"""What is known of the parameters before a plan is made: points where they may lie, and the information there."""

from collections.abc import Iterable
from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float
from scipy.stats import qmc

from ident.inference.fit import Fit
from ident.inference.least_squares import evaluate
from ident.inference.parameters import Parameters
from ident.inference.problem import InverseProblem

OPEN_SD = 3.0
"""Standard deviation in theta of a parameter without a prior, for planning only: a factor of 20 for a stiffness."""
DRAWS = 8


@dataclass(frozen=True)
class PriorInformation:
    """What is known now, by prior and data.

    A gain is a mean over the points, so that a plan does not hang on one guess of what is unknown. The first point is
    the best estimate; the standard deviations of a plan are quoted there.

    Attributes:
        names: (P,) parameters.
        points: (T, P) theta.
        information: (T, P, P) inverse covariance of theta by prior and data, linearized at each point.
    """

    names: tuple[str, ...]
    points: Float[np.ndarray, "T P"]
    information: Float[np.ndarray, "T P P"]

    @property
    def sd(self) -> Float[np.ndarray, "T P"]:
        """Standard deviation of each theta at each point."""
        return sds(self.information)

    def at(self, chosen: np.ndarray) -> "PriorInformation":
        """Return what is known at some of the points."""
        return PriorInformation(self.names, self.points[chosen], self.information[chosen])


def sds(information: Float[np.ndarray, "*batch P P"]) -> Float[np.ndarray, "*batch P"]:
    """Return the standard deviations that go with inverse covariances."""
    return np.sqrt(np.diagonal(np.linalg.inv(information), axis1=-2, axis2=-1))


def prior_information(parameters: Parameters, *, draws: int = DRAWS, seed: int = 0) -> PriorInformation:
    """Return what the priors say before anything is measured; see `_normal_prior`."""
    centre, sd = _normal_prior(parameters)
    information = np.diag(1 / sd**2)
    points = _spread(centre, np.diag(sd**2), draws, seed)
    return PriorInformation(parameters.names, points, np.repeat(information[None], len(points), 0))


def prior_and_data_information(fit: Fit, *, draws: int = DRAWS, seed: int = 0) -> PriorInformation:
    """Return what a fit says: points about its optimum, the data's Fisher information at each, and the priors'."""
    parameters = fit.problem.parameters
    _, sd = _normal_prior(parameters)
    best, prior = fit.best.theta, np.diag(1 / sd**2)
    scaled = fit.problem.scaled(np.asarray(fit.jacobian))
    points = _spread(best, np.linalg.inv(scaled.T @ scaled + prior), draws, seed)
    return PriorInformation(parameters.names, points, fisher(scaled_jacobians(fit.problem, points)) + prior)


def scaled_jacobians(problem: InverseProblem, points: Iterable[np.ndarray]) -> Float[np.ndarray, "T D P"]:
    """Return d(predicted / sigma)/d(theta) at each point; zero rows where the model has no answer.

    It needs nothing of a problem but what `fit` needs, so any model can be planned for, not only an arm.
    """
    rows = [problem.scaled(np.asarray(evaluate(problem, jnp.asarray(theta)).jacobian)) for theta in points]
    return np.nan_to_num(np.stack(rows))


def fisher(scaled: Float[np.ndarray, "*batch D P"]) -> Float[np.ndarray, "*batch P P"]:
    """Return the Fisher information J'J of rows that are scaled by their sigma."""
    return np.einsum("...dp,...dq->...pq", scaled, scaled)


def _normal_prior(parameters: Parameters) -> tuple[np.ndarray, np.ndarray]:
    """Return means and standard deviations of the normal priors that stand for the parameters' own in a plan.

    A flat prior is replaced by a normal one of about its width, none by one of `OPEN_SD`.
    """
    centre = np.asarray(parameters.theta(parameters.column("centre")))
    return centre, np.where(parameters.proper, parameters.normal_sd, OPEN_SD)


def _spread(mean: np.ndarray, covariance: np.ndarray, draws: int, seed: int) -> np.ndarray:
    """Return the mean, then quasi-random draws about it, which cover a normal law more evenly than random ones."""
    if not draws:
        return mean[None]
    sampler = qmc.MultivariateNormalQMC(np.zeros(len(mean)), rng=np.random.default_rng(seed))
    # whole powers of two keep a Sobol sequence balanced
    z = sampler.random(2 ** int(np.ceil(np.log2(draws))))[:draws]
    return np.vstack([mean, mean + z @ np.linalg.cholesky(covariance).T])
