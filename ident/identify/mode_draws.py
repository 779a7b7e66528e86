"""Arms that may be the one that was measured: draws of the prior that draw nearer to the modes of all postures."""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float
from scipy.special import logsumexp

from ident.inference.parameters import Parameters

FEWEST = 1 / 8
"""Share of the draws that count at least: else likelihoods are flattened until so many do."""
KERNEL = 0.5
"""Standard deviation of a new draw about an old one, over that of all."""
HALVINGS = 40
"""Steps in which the power is found by which likelihoods are flattened."""
DEFENSIVE = 0.1
"""Share of new draws that come from the prior again."""
NARROW = 1e-3
"""Least standard deviation of all draws along any direction, over the prior's."""


def prior_draws(parameters: Parameters, draws: int, rng: np.random.Generator) -> Float[np.ndarray, "P draws"]:
    """Return draws of the prior as theta; a number without a prior keeps its starting value."""
    uniform = rng.uniform(size=(len(parameters.items), draws))
    start = np.asarray(parameters.theta(parameters.column("start")))[:, None]
    return np.where(parameters.proper[:, None], np.asarray(parameters.from_uniform(jnp.asarray(uniform))), start)


def enough(logs: Float[np.ndarray, "D"]) -> bool:
    """Tell whether so many draws count by their likelihoods that these need not be flattened."""
    return _count(_flattened(logs, 1.0)) >= FEWEST * len(logs)


def shares(logs: Float[np.ndarray, "D"]) -> Float[np.ndarray, "D"]:
    """Return by how much each draw counts: by its likelihood, flattened where too few would count.

    As many count as equal ones would that have the same sum of squares (Kish). Where likelihoods differ by more than a
    few draws can resolve, one of them would decide alone, though by chance it is the nearest.
    """
    low, high = 0.0, 1.0
    if enough(logs):
        return _flattened(logs, 1.0)
    for _ in range(HALVINGS):
        middle = (low + high) / 2
        low, high = (middle, high) if _count(_flattened(logs, middle)) >= FEWEST * len(logs) else (low, middle)
    return _flattened(logs, low)


def nearer(
    parameters: Parameters,
    theta: Float[np.ndarray, "P D"],
    share: Float[np.ndarray, "D"],
    rng: np.random.Generator,
) -> tuple[Float[np.ndarray, "P D"], Float[np.ndarray, "D"]]:
    """Return as many new draws near those that count, and ln of the prior's density over that of drawing each so.

    Kernels about the old draws, shrunk towards their mean so that the whole grows no wider, beside some of the prior.

    References:
        Cappe, Guillin, Marin, Robert, "Population Monte Carlo", J. Comput. Graph. Stat. 13, 2004.
        Liu, West, in "Sequential Monte Carlo methods in practice", 2001 (shrinking).
    """
    moving = parameters.proper
    count = theta.shape[1]
    if not moving.any():
        return theta, np.zeros(count)
    old = theta[moving]
    mean = old @ share
    covariance = (old - mean[:, None]) * share @ (old - mean[:, None]).T
    covariance += np.diag((NARROW * parameters.normal_sd[moving]) ** 2)
    centres = mean[:, None] + np.sqrt(1 - KERNEL**2) * (old - mean[:, None])
    factor = KERNEL * np.linalg.cholesky(covariance)
    about = rng.choice(count, size=count, p=share)
    new = prior_draws(parameters, count, rng)
    near = rng.uniform(size=count) >= DEFENSIVE
    moved = centres[:, about] + factor @ rng.standard_normal(old.shape)
    new[np.ix_(np.flatnonzero(moving), np.flatnonzero(near))] = moved[:, near]
    return new, -_log_density(parameters, new, centres, factor, share)


def _log_density(
    parameters: Parameters,
    new: Float[np.ndarray, "P D"],
    centres: Float[np.ndarray, "p C"],
    factor: Float[np.ndarray, "p p"],
    share: Float[np.ndarray, "C"],
) -> Float[np.ndarray, "D"]:
    """Return ln of the density by which draws are made, over the prior's."""
    off = np.linalg.solve(factor, (new[parameters.proper][:, :, None] - centres[:, None]).reshape(len(factor), -1))
    squared = (off**2).sum(0).reshape(new.shape[1], -1)
    constant = np.log(np.diag(factor)).sum() + len(factor) / 2 * np.log(2 * np.pi)
    with np.errstate(divide="ignore"):
        kernels = logsumexp(np.log(share) - squared / 2, 1) - constant
    over = kernels - _log_prior(parameters, new)
    return np.logaddexp(np.log(1 - DEFENSIVE) + over, np.log(DEFENSIVE))


def _log_prior(parameters: Parameters, theta: Float[np.ndarray, "P D"]) -> Float[np.ndarray, "D"]:
    sd, flat = (np.asarray(parameters.column(field))[parameters.proper] for field in ("prior_sd", "flat"))
    residuals = np.asarray(parameters.prior_residuals(theta)[0])
    return -(residuals**2).sum(0) / 2 - np.log(2 * flat + sd * np.sqrt(2 * np.pi)).sum()


def _flattened(logs: Float[np.ndarray, "D"], power: float) -> Float[np.ndarray, "D"]:
    own = np.where(np.isfinite(logs), power * np.where(np.isfinite(logs), logs, 0.0), -np.inf)
    return np.exp(own - logsumexp(own))


def _count(share: Float[np.ndarray, "D"]) -> float:
    return float(1 / (share**2).sum())
