"""The posterior density of the unknowns, and how uncertain the noise itself is."""

import math
from collections.abc import Callable, Iterable, Sequence
from typing import Any, NamedTuple, Protocol, TypeVar, runtime_checkable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ident.errors import InputError, Problem
from ident.inference.parameters import Parameter, Parameters
from ident.inference.problem import InverseProblem
from ident.jit import jit
from ident.text import did_you_mean

PREFIX = "noise."
"""What the names of noise scales begin with; a kind of measurement follows."""
At = TypeVar("At", covariant=True)
NOISE_SD = 1.0
"""Width of the log-normal prior of a noise scale about 1: 95 % within a factor of 7."""


class Posterior(eqx.Module):
    """Density of theta and of the noise scales, given the data.

    Each value is normal about its prediction with standard deviation sigma, times the noise scale of its kind if that
    is unknown; errors may be correlated. theta holds the problem's parameters first, then ln(scale) of each kind in
    `noise`.

    Attributes:
        problem: model, data and priors.
        noise: the noise scales, named `noise.KIND`.
    """

    problem: InverseProblem
    noise: Parameters

    @property
    def parameters(self) -> Parameters:
        """All unknowns, in the order of theta."""
        return Parameters(self.problem.parameters.items + self.noise.items)

    def evaluate(self, theta: Float[Array, "P batch"]) -> "Evaluated":
        """Return likelihood, prior and predictions."""
        problem = self.problem
        sigma, predicted = problem.sigma[:, None], problem.predict(theta[: len(problem.parameters.items)])
        scale, fitted = self.scales(theta), jnp.isfinite(sigma)
        off = problem.scaled((predicted - problem.measured[:, None]) / scale)
        width = jnp.where(fitted, math.sqrt(2 * math.pi) * sigma * scale, 1.0)
        value = -(off**2 / 2 + jnp.log(width)).sum(0)
        if problem.correlation is not None:
            value = value - problem.correlation.log_det
        return Evaluated(
            jnp.where(jnp.isnan(value), -jnp.inf, value), self.parameters.log_prior(theta), predicted, scale
        )

    def scales(self, theta: Float[Array, "P batch"]) -> Float[Array, "D batch"]:
        """Return the factor on sigma of each value."""
        noise = jnp.exp(theta[len(self.problem.parameters.items) :])
        by_kind = {item.name.removeprefix(PREFIX): scale for item, scale in zip(self.noise.items, noise, strict=True)}
        ones, kinds = jnp.ones(theta.shape[1:]), sorted(set(self.problem.kinds))
        return jnp.stack([by_kind.get(kind, ones) for kind in kinds])[np.searchsorted(kinds, self.problem.kinds)]


class Evaluated(NamedTuple):
    """The posterior at some points.

    Attributes:
        log_likelihood: (n,) -inf where the model has no answer.
        log_prior: (n,)
        predicted: (D, n) predictions [SI].
        scale: (D, n) factors on sigma.
    """

    log_likelihood: Any
    log_prior: Any
    predicted: Any
    scale: Any

    @property
    def log_density(self) -> Any:
        """Logarithm of prior times likelihood, `(n,)`."""
        return self.log_likelihood + self.log_prior


def posterior(problem: InverseProblem, noise: Sequence[str] = ()) -> Posterior:
    """Return the posterior of a problem, with the noise of these kinds of measurement known up to a factor.

    Raises:
        InputError: nothing of that kind was measured, or a parameter on which neither prior nor data bear.
    """
    for kind in noise:
        if kind not in problem.kinds:
            remedy = did_you_mean(kind, sorted(set(problem.kinds)), "name a kind of the campaign")
            raise InputError(Problem("", f"the noise of {kind}", "a kind that was measured", remedy))
    scales = tuple(Parameter((PREFIX + kind,), True, 1.0, 1.0, NOISE_SD) for kind in dict.fromkeys(noise))
    whole = Posterior(problem, Parameters(scales))
    return jax.tree.map(lambda x: jax.device_put(x) if eqx.is_array(x) else x, whole)  # once, not at each evaluation


@runtime_checkable
class Density(Protocol[At]):
    """What can be evaluated at a batch of points: a posterior, or one without some of its unknowns."""

    def evaluate(self, theta: Float[Array, "P batch"]) -> At:
        """Return a named tuple of arrays whose last axis is the batch."""


def evaluate(
    density: Density[At], points: Float[np.ndarray, "n P"], batch: int, run: Callable[..., Iterable[Any]] = map
) -> At:
    """Evaluate a posterior at many points, compiled once for this size of batch.

    Args:
        density: the posterior.
        points: where.
        batch: points that are evaluated together.
        run: evaluates the batches; `map`, or a pool's for several at the same time.
    """
    missing = -len(points) % batch
    padded = np.concatenate([points, np.repeat(points[-1:], missing, 0)]).T

    def part(first: int) -> Any:
        return jax.tree.map(np.asarray, _evaluate(density, jnp.asarray(padded[:, first : first + batch])))

    parts = list(run(part, range(0, padded.shape[1], batch)))
    whole: At = jax.tree.map(lambda *same: np.concatenate(same, -1)[..., : len(points)], *parts)
    return whole


@jit
def _evaluate(density: Density[At], points: Float[Array, "P batch"]) -> At:
    return density.evaluate(points)
