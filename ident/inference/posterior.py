"""The posterior density of the unknowns, and how uncertain the noise itself is."""

import math
from collections.abc import Callable, Iterable, Sequence
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ident.errors import require
from ident.inference.fit import Fit
from ident.inference.information import information
from ident.inference.optima import Optimum
from ident.inference.parameters import AnyArray, Parameter, Parameters
from ident.inference.problem import DISCREPANCY_PREFIX, Discrepant, InverseProblem, by_kind
from ident.inference.search import evaluate as fit_at
from ident.programs import jit
from ident.text import did_you_mean

PREFIX = "noise."
"""Prefix of the names of noise scales; the kind of measurement follows."""
NOISE_SD = 1.0
"""Width of the log-normal prior of a noise scale about 1: 95 % within a factor of 7."""


class Posterior(eqx.Module):
    """Density of theta and of the noise scales, given the data.

    Each value is normal about its prediction with standard deviation sigma, times the noise scale of its kind if that
    is unknown; errors may be correlated. theta holds the problem's parameters first, then ln(scale) of each kind in
    `noise`.

    Attributes:
        problem: model, data and priors.
        noise: the noise scales, named `poles.KIND`.
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
        value = -(off**2 / 2 + jnp.log(width)).sum(0) - problem.errors.log_det
        value = jnp.where(jnp.isnan(value), -jnp.inf, value)
        return Evaluated(value, self.parameters.log_prior(theta), predicted, scale)

    def scales(self, theta: Float[Array, "P batch"]) -> Float[Array, "D batch"]:
        """Return the factor on sigma of each value."""
        noise = jnp.exp(theta[len(self.problem.parameters.items) :])
        scales = {item.name.removeprefix(PREFIX): scale for item, scale in zip(self.noise.items, noise, strict=True)}
        return by_kind(scales, self.problem.kinds, theta.shape[1:])


class Evaluated(NamedTuple):
    """The posterior at some points.

    Attributes:
        log_likelihood: (n,) -inf where the model has no solution.
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
        InputError: no measurement of that kind, or a parameter on which neither prior nor data have information.
    """
    for kind in noise:
        remedy = did_you_mean(kind, sorted(set(problem.kinds)), "name a kind of the campaign")
        require(kind in problem.kinds, "", f"the noise of {kind}", "a kind that was measured", remedy)
    scales = tuple(Parameter((PREFIX + kind,), True, 1.0, 1.0, NOISE_SD) for kind in dict.fromkeys(noise))
    whole = Posterior(problem, Parameters(scales))
    return jax.tree.map(lambda x: jax.device_put(x) if eqx.is_array(x) else x, whole)  # once, not at each evaluation


def evaluate(
    density: "Posterior | LinearMarginal | Marginal",
    points: Float[np.ndarray, "n P"],
    batch: int,
    run: Callable[..., Iterable[Any]] = map,
) -> Any:
    """Evaluate a posterior, whole or marginal, at many points, compiled once for this size of batch.

    Args:
        density: the posterior.
        points: of evaluation.
        batch: points evaluated together.
        run: evaluates the batches; `map`, or a pool's `map` for several at the same time.

    Returns:
        The results of its `evaluate`: arrays with the points along the last axis.
    """
    missing = -len(points) % batch
    padded = np.concatenate([points, np.repeat(points[-1:], missing, 0)]).T

    def part(first: int) -> Any:
        return jax.tree.map(np.asarray, _evaluate(density, jnp.asarray(padded[:, first : first + batch])))

    parts = list(run(part, range(0, padded.shape[1], batch)))
    return jax.tree.map(lambda *same: np.concatenate(same, -1)[..., : len(points)], *parts)


@jit
def _evaluate(density: Any, points: Float[Array, "P batch"]) -> Any:
    return density.evaluate(points)


# -------- Linear marginal
# Nuisances with an almost linear effect, integrated out of a posterior and drawn again afterwards.

TRIED = 8
"""Points of the posterior at which the nuisances' derivatives are computed again."""
MOVED = 0.1
"""Largest effect of that on the mean of an unknown [its sd]; beyond it the nuisance is sampled; assumed."""


class LinearMarginal(eqx.Module):
    """A posterior with some nuisances integrated out: they add to the scatter of the data, covariance C + G P G'.

    Near the optimum the scaled residuals are u + B d, with d the nuisances' offset from their optimum, and u the
    residuals at d = 0 given the other unknowns; their priors cost (d + a)' L (d + a) / 2, L diagonal, zero for one
    without a prior. With A = B' B + L and g = B' u + L a, the integral over d of likelihood times priors is, up to
    constants, exp(-(u'u + a'L a - g' A^-1 g) / 2) (Woodbury); d given the rest is normal with mean -A^-1 g and
    covariance A^-1.

    Attributes:
        posterior: the whole posterior.
        names: of the integrated nuisances.
        at: (p,) their theta at the optimum.
        a: (p,) offset of `at` from the centres of their priors.
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
        """The density to evaluate."""
        return self

    def evaluate(self, theta: Float[Array, "Q batch"]) -> "GivenOthers":
        """Return the density without the nuisances, and the inputs for drawing them."""
        problem, out = self.posterior.problem, self.integrated
        whole = jnp.zeros((len(out), theta.shape[1])).at[np.flatnonzero(~out)].set(theta)
        at = self.posterior.evaluate(whole.at[np.flatnonzero(out)].set(jnp.asarray(self.at)[:, None]))
        u = problem.scaled(at.predicted - problem.measured[:, None])
        g = self.B.T @ u + (self.L * self.a)[:, None]
        proper = self.L > 0
        width = jnp.where(proper, jnp.log(jnp.where(proper, self.L, 1.0)), math.log(2 * math.pi))
        constant = (width - self.L * self.a**2).sum() / 2 + jnp.log(jnp.diag(self.R)).sum()  # whatever the others are
        gain = ((self.R @ g) ** 2).sum(0) / 2 + constant
        value = jnp.where(jnp.isfinite(at.log_likelihood), at.log_likelihood + gain, -jnp.inf)
        return GivenOthers(value + self.parameters.log_prior(theta), value, g)

    def columns(self, at: "GivenOthers") -> Float[np.ndarray, "n columns"]:
        """Return the log density, and the inputs of `completed`, a row for each point."""
        return np.concatenate([at.log_density[None], at.log_likelihood[None], at.g]).T

    def completed(
        self, theta: Float[np.ndarray, "n Q"], known: Float[np.ndarray, "n columns"], rng: np.random.Generator
    ) -> tuple[Float[np.ndarray, "n P"], Float[np.ndarray, "n"]]:
        """Draw the nuisances given the other unknowns; return all unknowns and the log density of the whole posterior.

        The density is that of the linear model, as are the draws.
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
        log_density: (n,) the nuisances integrated out; -inf where the model has no solution.
        log_likelihood: (n,) the same without the priors of the other unknowns.
        g: (p, n) gives the nuisances' means, -A^-1 g.
    """

    log_density: Any
    log_likelihood: Any
    g: Any


def linear_marginal(posterior: Posterior, optimum: Optimum, names: tuple[str, ...]) -> LinearMarginal:
    """Return the posterior without these nuisances, with their derivatives at an optimum of its problem."""
    problem, out = posterior.problem, np.isin(posterior.problem.parameters.names, names)
    parameters = problem.parameters
    centre = parameters.theta_centre[out]
    L = np.asarray(parameters.column("prior_sd"))[out] ** -2.0
    B = _scaled(problem, optimum.theta)[:, out]
    R = np.linalg.inv(np.linalg.cholesky(B.T @ B + np.diag(L)))
    return LinearMarginal(posterior, names, *jax.device_put((optimum.theta[out], optimum.theta[out] - centre, L, B, R)))


def linear_nuisances(fit: Fit, seed: int) -> tuple[str, ...]:
    """Return the nuisances with a nearly linear effect, fit to be integrated out, by draws about a fit's answer."""
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
    """Return how far the nonlinearity of each nuisance would move the mean of an unknown [its sd].

    With G' the derivative by a nuisance at a point of the posterior and dz its offset from the optimum there, the error
    of the linear model is about (G' - G) dz, which moves the others' optimum. The result is the rms of that move over
    the points, for the unknown that moves farthest.

    Args:
        problem: model, data and unknowns.
        optimum: point of linearisation.
        names: of the nuisances to test.
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


# -------- Marginal
# Discrepancy factors integrated out of a posterior, and drawn again afterwards: the marginal is far less thin.

NODES, WEIGHTS = (x[:, None] for x in np.polynomial.hermite.hermgauss(32))
STEPS = 12
"""Gauss-Newton steps, of at most one e-fold each, to the peak of a factor's density."""
GRID = np.linspace(-6.0, 6.0, 81)
"""Abscissae of a factor's tabulated distribution function, in its standard deviations about the peak."""


class Marginal(eqx.Module):
    """A posterior without its discrepancy factors: for each kind, one integral over the logarithm of its factor.

    With u = ln(factor), normal with standard deviation s, the values y of a kind, their predictions m at factor 1 and
    standard deviations sigma, chi-squared is C - 2 B exp(u) + A exp(2 u) with A = sum(m^2 / sigma^2) and
    B = sum(m y / sigma^2). So the density given theta is that at factor 1 times the integral over u of
    exp(-(A (exp(2 u) - 1) - 2 B (exp(u) - 1)) / 2 - u^2 / (2 s^2)): Gauss-Hermite about its peak (Liu, Pierce, "A note
    on Gauss-Hermite quadrature", Biometrika 81(3), 1994). Values may have either sign and sigmas any size.

    If errors are correlated, m and y - (the predictions of other kinds) are whitened first. The integrals over several
    factors then do not factorise, so that several factors are sampled like any other unknown.

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
        """Return the density without the factors, and the inputs for drawing them."""
        problem = self.posterior.problem
        whole = jnp.zeros((len(self.integrated), theta.shape[1])).at[np.flatnonzero(~self.integrated)].set(theta)
        at = self.posterior.evaluate(whole)
        sigma = problem.sigma[:, None] * at.scale
        predicted, measured = at.predicted / sigma, problem.measured[:, None] / sigma
        factors = np.array(self.posterior.parameters.names)[self.integrated]
        kinds = [str(name).removeprefix(DISCREPANCY_PREFIX) for name in factors]
        rows = [np.flatnonzero(np.array(problem.kinds) == kind) for kind in kinds]
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
        """The posterior if nothing is integrated out, as its program is compiled anyway; else this marginal."""
        return self if self.integrated.any() else self.posterior

    @property
    def widths(self) -> list[AnyArray]:
        """Standard deviations of ln(factor)."""
        items = self.posterior.parameters.items
        return [item.prior_sd for item, out in zip(items, self.integrated, strict=True) if out]

    def columns(self, at: Any) -> Float[np.ndarray, "n columns"]:
        """Return the log density and, with factors, the inputs of `completed`, a row for each point."""
        if not isinstance(at, Integrated):
            return np.asarray(at.log_density)[:, None]
        return np.concatenate([at.log_density[None], at.log_at_one[None], at.A, at.B]).T

    def completed(
        self, theta: Float[np.ndarray, "n Q"], known: Float[np.ndarray, "n columns"], rng: np.random.Generator
    ) -> tuple[Float[np.ndarray, "n P"], Float[np.ndarray, "n"]]:
        """Draw the factors given the other unknowns; return all unknowns and the log density of the whole posterior.

        Args:
            theta: draws without the factors.
            known: `columns` at these draws.
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


class Integrated(NamedTuple):
    """A posterior without its factors at some points.

    Attributes:
        log_density: (n,) the factors integrated out; -inf where the model has no solution.
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
    """Return the peak of the integrand, and the standard deviation of its normal approximation there."""
    alike = B > 0
    weight = xp.where(alike, B**2 / A, 0.0)  # precision of ln(factor) by the data; the prior's is width^-2
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
