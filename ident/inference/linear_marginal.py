"""Nuisances that act almost linearly, integrated out of a posterior and drawn again afterwards."""

import math
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ident.inference.fit import Fit
from ident.inference.information import information
from ident.inference.least_squares import evaluate as fit_at
from ident.inference.optima import Optimum
from ident.inference.parameters import AnyArray, Parameters
from ident.inference.posterior import Posterior
from ident.inference.problem import InverseProblem

TRIED = 8
"""Points of the posterior at which the nuisances' derivatives are computed anew."""
MOVED = 0.1
"""Standard deviations by which that may move the mean of an unknown: beyond, the nuisance is sampled."""


class LinearMarginal(eqx.Module):
    """A posterior without some of its nuisances: as if they scattered the data, with covariance C + G P G'.

    About the optimum the scaled residuals are u + B d, with d the nuisances' distance from where they are there, and u
    the residuals at d = 0 and given other unknowns; their priors cost (d + a)' L (d + a) / 2, L diagonal, zero for one
    without a prior. With A = B' B + L and g = B' u + L a, the integral over d of likelihood times priors is, but for
    constants, exp(-(u'u + a'L a - g' A^-1 g) / 2) (Woodbury), and d given the rest is normal, of mean -A^-1 g and
    covariance A^-1.

    Attributes:
        posterior: the whole posterior.
        names: of the nuisances that are integrated out.
        at: (p,) their theta at the optimum.
        a: (p,) by how much that is off the centres of their priors.
        L: (p,) precision of their priors.
        B: (D, p) derivative of the scaled residuals by them.
        R: (p, p) inverse of the Cholesky factor of A, so that A^-1 = R' R.
    """

    posterior: Posterior
    names: tuple[str, ...] = eqx.field(static=True)
    at: Float[AnyArray, "p"]
    a: Float[AnyArray, "p"]
    L: Float[AnyArray, "p"]
    B: Float[AnyArray, "D p"]
    R: Float[AnyArray, "p p"]

    @property
    def integrated(self) -> np.ndarray:
        """Which of the posterior's unknowns are integrated out."""
        return np.isin(self.posterior.parameters.names, self.names)

    @property
    def parameters(self) -> Parameters:
        """The unknowns that are left."""
        return Parameters(tuple(item for item in self.posterior.parameters.items if item.name not in self.names))

    @property
    def itself(self) -> "LinearMarginal":
        """What is evaluated."""
        return self

    def evaluate(self, theta: Float[Array, "Q batch"]) -> "GivenOthers":
        """Return the density without the nuisances, and what they are drawn from."""
        problem, out = self.posterior.problem, self.integrated
        whole = jnp.zeros((len(out), theta.shape[1])).at[np.flatnonzero(~out)].set(theta)
        at = self.posterior.evaluate(whole.at[np.flatnonzero(out)].set(jnp.asarray(self.at)[:, None]))
        u = problem.scaled(at.predicted - problem.measured[:, None])
        g = self.B.T @ u + (self.L * self.a)[:, None]
        gain = ((self.R @ g) ** 2).sum(0) / 2 + self.constant
        value = jnp.where(jnp.isfinite(at.log_likelihood), at.log_likelihood + gain, -jnp.inf)
        return GivenOthers(value + self.parameters.log_prior(theta), value, g)

    @property
    def constant(self) -> Any:
        """Logarithm of the part of the integral that no other unknown changes."""
        proper = self.L > 0
        width = jnp.where(proper, jnp.log(jnp.where(proper, self.L, 1.0)), math.log(2 * math.pi))
        return (width - self.L * self.a**2).sum() / 2 + jnp.log(jnp.diag(self.R)).sum()

    def columns(self, at: "GivenOthers") -> Float[np.ndarray, "n columns"]:
        """Return the log density, and what `completed` needs, a row for each point."""
        return np.concatenate([at.log_density[None], at.log_likelihood[None], at.g]).T

    def completed(
        self, theta: Float[np.ndarray, "n Q"], known: Float[np.ndarray, "n columns"], rng: np.random.Generator
    ) -> tuple[Float[np.ndarray, "n P"], Float[np.ndarray, "n"]]:
        """Draw the nuisances given the other unknowns; return all unknowns and the log density of the whole posterior.

        The density is that of the linear model, by which they are drawn.
        """
        out, noise = self.integrated, rng.standard_normal((len(theta), len(self.names)))
        R = np.asarray(self.R)
        whole = np.empty((len(theta), len(out)))
        whole[:, ~out], whole[:, out] = theta, np.asarray(self.at) + (noise - known[:, 2:] @ R.T) @ R
        given = -np.log(np.diag(R)).sum() - len(R) * math.log(2 * math.pi) / 2 - (noise**2).sum(1) / 2
        return whole, known[:, 0] + given


class GivenOthers(NamedTuple):
    """A posterior without some nuisances at some points.

    Attributes:
        log_density: (n,) the nuisances integrated out; -inf where the model has no answer.
        log_likelihood: (n,) the same without the priors of the other unknowns.
        g: (p, n) of which the nuisances' means are made.
    """

    log_density: Any
    log_likelihood: Any
    g: Any


def linear_marginal(posterior: Posterior, optimum: Optimum, names: tuple[str, ...]) -> LinearMarginal:
    """Return the posterior without these nuisances, with their derivatives at an optimum of its problem."""
    problem, out = posterior.problem, np.isin(posterior.problem.parameters.names, names)
    parameters = problem.parameters
    centre = np.asarray(parameters.theta(parameters.column("centre")))[out]
    L = np.asarray(parameters.column("prior_sd"))[out] ** -2.0
    B = _scaled(problem, optimum.theta)[:, out]
    R = np.linalg.inv(np.linalg.cholesky(B.T @ B + np.diag(L)))
    return LinearMarginal(posterior, names, *jax.device_put((optimum.theta[out], optimum.theta[out] - centre, L, B, R)))


def linear_nuisances(fit: Fit, seed: int) -> tuple[str, ...]:
    """Return the nuisances that act linearly enough to be integrated out, at draws about the answer of a fit."""
    parameters, covariance = fit.problem.parameters, fit.information.covariance
    names = tuple(item.name for item in parameters.items if item.nuisance)
    if not names or not np.isfinite(covariance).all():
        return ()
    noise = np.random.default_rng(seed).standard_normal((TRIED, len(covariance)))
    points = fit.best.theta + noise @ np.linalg.cholesky(covariance).T
    shift = moved(fit.problem, fit.best, names, points)
    return tuple(name for name, far in zip(names, shift, strict=True) if far <= MOVED)


def moved(
    problem: InverseProblem, optimum: Optimum, names: tuple[str, ...], points: Float[np.ndarray, "n P"]
) -> Float[np.ndarray, "names"]:
    """Return how far what is not linear in each nuisance would move the mean of an unknown [its sd].

    With G' the derivative by a nuisance at a point of the posterior and dz how far it is off the optimum there, the
    linear model misses about (G' - G) dz of the data, by which the others' optimum moves; the root mean square of that
    over the points, of the unknown that moves farthest.

    Args:
        problem: model, data and unknowns.
        optimum: where the model is linear.
        names: of the nuisances that are tried.
        points: of the posterior.
    """
    parameters = problem.parameters
    out = np.isin(parameters.names, names)
    J = _scaled(problem, optimum.theta)
    covariance = information(J, parameters.normal_sd, parameters.names).covariance
    spread = np.sqrt(np.diag(covariance))[~out]
    shifts = []
    for point in points:
        missed = (_scaled(problem, point) - J)[:, out] * (point - optimum.theta)[out]
        shifts.append((covariance @ J.T @ missed)[~out] / spread[:, None])
    return np.sqrt((np.array(shifts) ** 2).mean(0)).max(0)


def _scaled(problem: InverseProblem, theta: Float[np.ndarray, "P"]) -> Float[np.ndarray, "D P"]:
    return problem.scaled(np.asarray(fit_at(problem, theta).jacobian))
