"""Discrepancy factors integrated out of a posterior, and drawn again afterwards: what is left is far less thin."""

import math
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ident.inference.discrepancy import DISCREPANCY_PREFIX, Discrepant
from ident.inference.parameters import AnyArray, Parameters
from ident.inference.posterior import Posterior

NODES, WEIGHTS = (x[:, None] for x in np.polynomial.hermite.hermgauss(32))
STEPS = 12
"""Gauss-Newton steps, of at most one e-fold each, to the peak of a factor's density."""
GRID = np.linspace(-6.0, 6.0, 81)
"""Where a factor's distribution function is tabulated, in its standard deviations about the peak."""


class Marginal(eqx.Module):
    """A posterior without its discrepancy factors: for each kind, one integral over the logarithm of its factor.

    With u = ln(factor), normal with standard deviation s, the values y of a kind, their predictions m at factor 1 and
    standard deviations sigma, chi-squared is C - 2 B exp(u) + A exp(2 u) with A = sum(m^2 / sigma^2) and
    B = sum(m y / sigma^2). So the density given theta is that at factor 1 times the integral over u of
    exp(-(A (exp(2 u) - 1) - 2 B (exp(u) - 1)) / 2 - u^2 / (2 s^2)): Gauss-Hermite about its peak (Liu, Pierce, "A note
    on Gauss-Hermite quadrature", Biometrika 81(3), 1994). Values of either sign and sigmas of any size are welcome.

    Where errors are correlated, m and y - (the predictions of other kinds) are made independent first. The integrals
    over several factors are then no product, so that several ones are sampled like any other unknown.

    Attributes:
        posterior: the whole posterior.
    """

    posterior: Posterior

    @property
    def integrated(self) -> np.ndarray:
        """Which of the posterior's unknowns are integrated out."""
        problem = self.posterior.problem
        out = np.array([name.startswith(DISCREPANCY_PREFIX) for name in self.posterior.parameters.names])
        separate = problem.correlation is None or out.sum() == 1
        return out & (isinstance(problem.model, Discrepant) and separate)

    @property
    def parameters(self) -> Parameters:
        """The unknowns that are left."""
        items = self.posterior.parameters.items
        return Parameters(tuple(item for item, out in zip(items, self.integrated, strict=True) if not out))

    def evaluate(self, theta: Float[Array, "Q batch"]) -> "Integrated":
        """Return the density without the factors, and what they are drawn from."""
        problem = self.posterior.problem
        whole = jnp.zeros((len(self.integrated), theta.shape[1])).at[np.flatnonzero(~self.integrated)].set(theta)
        at = self.posterior.evaluate(whole)
        sigma = problem.sigma[:, None] * at.scale
        predicted, measured = at.predicted / sigma, problem.measured[:, None] / sigma
        rows = [np.flatnonzero(np.array(problem.kinds) == kind) for kind in self._kinds]
        if problem.correlation is None:
            A = jnp.stack([(predicted[own] ** 2).sum(0) for own in rows])
            B = jnp.stack([(predicted[own] * measured[own]).sum(0) for own in rows])
        else:
            factored = jnp.zeros_like(predicted).at[rows[0]].set(predicted[rows[0]])
            m, y = (problem.correlation.whiten(x) for x in (factored, measured - (predicted - factored)))
            A, B = (m**2).sum(0)[None], (m * y).sum(0)[None]
        gain = jnp.stack([_log_integral(a, b, width) for a, b, width in zip(A, B, self.widths, strict=True)]).sum(0)
        value = jnp.where(jnp.isfinite(at.log_density), at.log_density + gain, -jnp.inf)
        return Integrated(value, value - self.parameters.log_prior(theta), at.log_density, A, B)

    @property
    def itself(self) -> Any:
        """The posterior where nothing is integrated out, whose program is compiled anyway; else this."""
        return self if self.integrated.any() else self.posterior

    @property
    def widths(self) -> list[AnyArray]:
        """Standard deviations of ln(factor)."""
        items = self.posterior.parameters.items
        return [item.prior_sd for item, out in zip(items, self.integrated, strict=True) if out]

    def columns(self, at: Any) -> Float[np.ndarray, "n columns"]:
        """Return the log density and, with factors, what `completed` needs, a row for each point."""
        if not isinstance(at, Integrated):
            return np.asarray(at.log_density)[:, None]
        return np.concatenate([at.log_density[None], at.log_at_one[None], at.A, at.B]).T

    def completed(
        self, theta: Float[np.ndarray, "n Q"], known: Float[np.ndarray, "n columns"], rng: np.random.Generator
    ) -> tuple[Float[np.ndarray, "n P"], Float[np.ndarray, "n"]]:
        """Draw the factors given the other unknowns; return all unknowns and the log density of the whole posterior.

        Args:
            theta: draws without the factors.
            known: what `columns` says of them.
            rng: source of randomness.
        """
        whole, log_density = np.empty((len(theta), len(self.integrated))), known[:, :1].sum(1)
        whole[:, ~self.integrated] = theta
        if self.integrated.any():
            log_density, (A, B) = known[:, 1].copy(), np.split(known[:, 2:].T, 2)
            for place, a, b, sd in zip(np.flatnonzero(self.integrated), A, B, self.widths, strict=True):
                width = float(sd)
                whole[:, place] = u = _draw(a, b, width, rng)
                log_density += _log_integrand(u, a, b, width, np)
        return whole, log_density

    @property
    def _kinds(self) -> list[str]:
        names = np.array(self.posterior.parameters.names)[self.integrated]
        return [str(name).removeprefix(DISCREPANCY_PREFIX) for name in names]


class Integrated(NamedTuple):
    """A posterior without its factors at some points.

    Attributes:
        log_density: (n,) the factors integrated out; -inf where the model has no answer.
        log_likelihood: (n,) the same without the priors of the other unknowns.
        log_at_one: (n,) log density of the whole posterior with all factors 1.
        A: (K, n) sum of squared predictions over sigma, for each kind.
        B: (K, n) sum of predictions times values over sigma squared.
    """

    log_density: Any
    log_likelihood: Any
    log_at_one: Any
    A: Any
    B: Any


def _log_integrand(u: AnyArray, A: AnyArray, B: AnyArray, width: Any, xp: Any) -> Any:
    rise = xp.expm1(u)
    return (B - A * (rise / 2 + 1)) * rise - (u / width) ** 2 / 2


def _peak(A: AnyArray, B: AnyArray, width: Any, xp: Any) -> tuple[Any, Any]:
    """Return where the integrand is largest, and the standard deviation of the normal that is tangent there."""
    alike = B > 0
    weight = xp.where(alike, B**2 / A, 0.0)  # of the data's own ln(factor), as the prior's is width^-2
    u = xp.where(alike, xp.log(xp.where(alike, B / A, 1.0)), 0.0) * weight / (weight + width**-2)
    for _ in range(STEPS):
        e = xp.exp(u)
        u = u - xp.clip((A * e**2 - B * e + u / width**2) / (A * e**2 + width**-2), -1.0, 1.0)
    return u, (A * xp.exp(2 * u) + xp.maximum(1 - u, 0.1) / width**2) ** -0.5


def _log_integral(A: Array, B: Array, width: Any) -> Array:
    u, sd = _peak(A, B, width, jnp)
    values = _log_integrand(u + math.sqrt(2) * sd * NODES, A, B, width, jnp) + NODES**2
    return jax.scipy.special.logsumexp(values, axis=0, b=WEIGHTS) + jnp.log(math.sqrt(2) * sd)


def _draw(A: np.ndarray, B: np.ndarray, width: float, rng: np.random.Generator) -> np.ndarray:
    """Draw ln(factor) by inverting its distribution function, linear between the points of `GRID`."""
    u, sd = _peak(A, B, width, np)
    values = _log_integrand(u[:, None] + sd[:, None] * GRID, A[:, None], B[:, None], width, np)
    density = np.exp(values - values.max(1, keepdims=True))
    below = np.cumsum((density[:, 1:] + density[:, :-1]) / 2, 1)
    wanted = rng.uniform(size=len(u)) * below[:, -1]
    place = np.minimum((below < wanted[:, None]).sum(1), len(GRID) - 2)
    rows = np.arange(len(u))
    before = np.where(place > 0, below[rows, place - 1], 0.0)
    share = (wanted - before) / (below[rows, place] - before)
    return u + sd * (GRID[place] + share * (GRID[1] - GRID[0]))
