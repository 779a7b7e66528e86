"""What is known of the parameters before a plan is made: points where they may lie, and the information there."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

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
        nuisance: those parameters that are not sought, but not exactly known.
    """

    names: tuple[str, ...]
    points: Float[np.ndarray, "T P"]
    information: Float[np.ndarray, "T P P"]
    nuisance: tuple[str, ...] = ()

    @property
    def sought(self) -> tuple[str, ...]:
        """The other parameters."""
        return tuple(name for name in self.names if name not in self.nuisance)

    @property
    def sd(self) -> Float[np.ndarray, "T sought"]:
        """Standard deviation of each sought theta at each point."""
        return sds(self.of_sought(self.information))

    def of_sought(self, information: Float[np.ndarray, "*batch P P"]) -> Float[np.ndarray, "*batch sought sought"]:
        """Return the inverse covariance of the sought parameters alone, whatever the nuisances are."""
        return marginal(information, [self.names.index(name) for name in self.sought])

    def at(self, chosen: np.ndarray) -> "PriorInformation":
        """Return what is known at some of the points."""
        return replace(self, points=self.points[chosen], information=self.information[chosen])

    def without(self, names: Sequence[str]) -> "PriorInformation":
        """Return what is known of the parameters other than these, whatever these are."""
        kept = [i for i, name in enumerate(self.names) if name not in names]
        return PriorInformation(
            tuple(self.names[i] for i in kept),
            self.points[:, kept],
            marginal(self.information, kept),
            tuple(name for name in self.nuisance if name not in names),
        )


def sds(information: Float[np.ndarray, "*batch P P"]) -> Float[np.ndarray, "*batch P"]:
    """Return the standard deviations that go with inverse covariances."""
    return np.sqrt(np.diagonal(np.linalg.inv(information), axis1=-2, axis2=-1))


def marginal(information: Float[np.ndarray, "*batch P P"], kept: Sequence[int]) -> Float[np.ndarray, "*batch K K"]:
    """Return the inverse covariance of some parameters, those of the others being integrated out."""
    others = [i for i in range(information.shape[-1]) if i not in kept]
    own, between = information[..., kept, :][..., kept], information[..., others, :][..., kept]
    if not others:
        return own
    return own - between.swapaxes(-1, -2) @ np.linalg.solve(information[..., others, :][..., others], between)


def prior_information(parameters: Parameters, *, draws: int = DRAWS, seed: int = 0) -> PriorInformation:
    """Return what the priors say before anything is measured; see `_normal_prior`."""
    centre, sd = _normal_prior(parameters)
    information = np.diag(1 / sd**2)
    points = _spread(centre, np.diag(sd**2), draws, seed)
    return _known(parameters, points, np.repeat(information[None], len(points), 0))


def prior_and_data_information(fit: Fit, *, draws: int = DRAWS, seed: int = 0) -> PriorInformation:
    """Return what a fit says: points about its optimum, the data's Fisher information at each, and the priors'."""
    parameters = fit.problem.parameters
    _, sd = _normal_prior(parameters)
    best, prior = fit.best.theta, np.diag(1 / sd**2)
    scaled = fit.problem.scaled(np.asarray(fit.jacobian))
    points = _spread(best, np.linalg.inv(scaled.T @ scaled + prior), draws, seed)
    return _known(parameters, points, fisher(scaled_jacobians(fit.problem, points)) + prior)


def _known(parameters: Parameters, points: np.ndarray, information: np.ndarray) -> PriorInformation:
    nuisance = tuple(item.name for item in parameters.items if item.nuisance)
    return PriorInformation(parameters.names, points, information, nuisance)


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

    A flat prior is replaced by a normal one of about its width, none by one of `OPEN_SD`; a nuisance without a prior is
    known by the data alone.
    """
    centre = np.asarray(parameters.theta(parameters.column("centre")))
    return centre, np.where(parameters.proper | parameters.nuisance, parameters.normal_sd, OPEN_SD)


def _spread(mean: np.ndarray, covariance: np.ndarray, draws: int, seed: int) -> np.ndarray:
    """Return the mean, then quasi-random draws about it, which cover a normal law more evenly than random ones."""
    if not draws:
        return mean[None]
    from scipy.stats import qmc  # long to import, and seldom needed

    sampler = qmc.MultivariateNormalQMC(np.zeros(len(mean)), rng=np.random.default_rng(seed))
    # whole powers of two keep a Sobol sequence balanced
    z = sampler.random(2 ** int(np.ceil(np.log2(draws))))[:draws]
    return np.vstack([mean, mean + z @ np.linalg.cholesky(covariance).T])
