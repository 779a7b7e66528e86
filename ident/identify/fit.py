"""Fit parameters to a campaign: least squares from several starts, with all that is needed to judge the answer."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
from jaxtyping import Array, Float
from scipy.stats import chi2

from ident.errors import ModelError
from ident.identify.information import Information, information
from ident.identify.problem import Problem

STARTS = 16
"""Starts tried by default, the given one among them."""
SPREAD = 1.0
"""Standard deviation in theta of the further starts about the given one: a factor of e for a stiffness."""
SAME = 1e-3
"""Ends nearer to each other than this, in standard deviations of the data or of theta, are one optimum."""
MAX_STEPS = 200
STATIONARY = 1e-6
"""Gradient of the cost, relative to one plus the cost, below which a point is an optimum."""


@dataclass(frozen=True)
class Optimum:
    """Where one or several starts ended.

    Attributes:
        values: (P,) parameters [SI].
        theta: (P,) the same, unconstrained.
        cost: sum of squared residuals, data and prior.
        starts: number of starts that ended here.
        converged: whether the gradient vanishes here.
    """

    values: Float[np.ndarray, "P"]
    theta: Float[np.ndarray, "P"]
    cost: float
    starts: int
    converged: bool


@dataclass(frozen=True)
class Fit:
    """The best optimum, the others, and what the data tell there.

    Attributes:
        problem: what was fitted.
        optima: distinct optima by ascending cost; the first one is the answer.
        failed: number of starts that reached none.
        predicted: (D,) [SI] at the answer.
        jacobian: (D, P) d(predicted)/d(theta) there.
        information: what data and prior tell there.
    """

    problem: Problem
    optima: tuple[Optimum, ...]
    failed: int
    predicted: Float[np.ndarray, "D"]
    jacobian: Float[np.ndarray, "D P"]
    information: Information

    @property
    def best(self) -> Optimum:
        """The optimum of least cost."""
        return self.optima[0]

    @property
    def parameters(self) -> dict[str, float]:
        """The fitted numbers [SI] by path, ties spelled out."""
        return {k: float(v) for k, v in self.problem.parameters.by_path(jnp.asarray(self.best.values)).items()}

    @property
    def residuals(self) -> Float[np.ndarray, "D"]:
        """(predicted - measured) / sigma."""
        return (self.predicted - np.asarray(self.problem.measured)) / np.asarray(self.problem.sigma)

    @property
    def chi_squared(self) -> float:
        """Sum of the squared residuals of the data."""
        return float(np.sum(self.residuals**2))

    @property
    def degrees_of_freedom(self) -> int:
        """Number of fitted values less the number of directions that they fix."""
        return int(np.isfinite(self.problem.sigma).sum()) - self.information.rank

    @property
    def p_value(self) -> float:
        """Chance of a larger chi-squared if model and sigmas are right; NaN without degrees of freedom."""
        return float(chi2.sf(self.chi_squared, self.degrees_of_freedom)) if self.degrees_of_freedom > 0 else np.nan

    def interval(self, level: float = 0.95) -> Float[np.ndarray, "P 2"]:
        """Return intervals of the parameters [SI] by data and prior, normal in theta."""
        from scipy.stats import norm

        half = norm.ppf(0.5 + level / 2) * self.information.sd
        ends = np.stack([self.best.theta - half, self.best.theta + half], 1)
        return np.asarray(self.problem.parameters.values(jnp.asarray(ends)))

    @property
    def predicted_sd(self) -> Float[np.ndarray, "D"]:
        """Standard deviations [SI] of the predictions by what data and prior tell of the parameters."""
        return np.sqrt(np.einsum("dp,pq,dq->d", self.jacobian, self.information.covariance, self.jacobian))


def fit(
    problem: Problem,
    *,
    starts: int = STARTS,
    spread: float = SPREAD,
    seed: int = 0,
    progress: Callable[[Iterator[int]], Iterator[int]] = iter,
) -> Fit:
    """Fit the parameters by Levenberg-Marquardt from several starts.

    Args:
        problem: model, data and unknowns.
        starts: number of starts: the parameters' own, the others normal about it.
        spread: their standard deviation in theta.
        seed: of the starts.
        progress: wraps the iterator over the starts, to show a bar.

    Raises:
        ModelError: no start reaches an optimum; says whether the model has an answer at the first one.
    """
    first = problem.parameters.theta(problem.parameters.column("start"))
    noise = np.random.default_rng(seed).standard_normal((starts, len(first))) * spread
    noise[0] = 0
    ends = [_solve(problem, first + jnp.asarray(noise[i])) for i in progress(iter(range(starts)))]
    reached = [_End(*(np.asarray(part) for part in end)) for end in ends if np.isfinite(end[1])]
    if not reached:
        raise ModelError(_no_optimum(problem, first))
    best = min(reached, key=lambda end: float(end.cost))
    scaled = best.jacobian / np.asarray(problem.sigma)[:, None]
    known = information(scaled, np.asarray(problem.parameters.column("prior_sd")), problem.parameters.names)
    optima = _distinct(problem, reached, scaled)
    return Fit(problem, optima, starts - len(reached), best.predicted, best.jacobian, known)


class _End(NamedTuple):
    """Where one start ended: theta, sum of squares and its gradient, predictions and their Jacobian."""

    theta: Any
    cost: Any
    gradient: Any
    predicted: Any
    jacobian: Any

    @property
    def converged(self) -> bool:
        return bool(np.abs(self.gradient).max() < STATIONARY * (1 + self.cost))


@eqx.filter_jit
def _solve(problem: Problem, start: Float[Array, "P"]) -> _End:
    """Run Levenberg-Marquardt from one start.

    The solver linearizes the residuals at every step. They are handed over with their Jacobian made already, as an
    affine function of the step, so that the model is compiled once and the last Jacobian comes back with the answer.
    """

    def affine(theta: Array, problem: Problem) -> tuple[Array, _End]:
        predicted, J = _with_jacobian(problem.predict, jax.lax.stop_gradient(theta))
        residuals, slope = problem.weigh(predicted, J, theta)
        end = _End(theta, (residuals**2).sum(), 2 * slope.T @ residuals, predicted, J)
        return residuals + slope @ (theta - jax.lax.stop_gradient(theta)), jax.lax.stop_gradient(end)

    solver = optx.LevenbergMarquardt(rtol=1e-10, atol=1e-10)
    return optx.least_squares(
        affine, solver, start, args=problem, max_steps=MAX_STEPS, throw=False, has_aux=True
    ).aux


def _with_jacobian(f: Callable[[Array], Array], x: Array) -> tuple[Array, Array]:
    def along(direction: Array) -> tuple[Array, Array]:
        return jax.jvp(f, (x,), (direction,))

    return jax.vmap(along, out_axes=(None, -1))(jnp.eye(x.shape[0]))


def _distinct(
    problem: Problem, ends: list[_End], scaled: np.ndarray
) -> tuple[Optimum, ...]:
    """Merge ends that data and prior cannot tell apart: a flat valley is one optimum, however long."""
    groups: list[list[_End]] = []
    prior = 1 / np.asarray(problem.parameters.column("prior_sd"))
    for end in sorted(ends, key=lambda e: float(e.cost)):
        for group in groups:
            step = end.theta - group[0].theta
            apart = np.linalg.norm(np.concatenate([scaled @ step, prior * step]))
            if apart < SAME or np.abs(step).max() < SAME:
                group.append(end)
                break
        else:
            groups.append([end])
    values = [np.asarray(problem.parameters.values(jnp.asarray(group[0].theta))) for group in groups]
    return tuple(
        Optimum(v, g[0].theta, float(g[0].cost), len(g), any(end.converged for end in g))
        for v, g in zip(values, groups, strict=True)
    )


def _no_optimum(problem: Problem, first: Array) -> str:
    predicted = np.asarray(problem.predict(first))
    if np.isfinite(predicted).all():
        return "no start reached an optimum; give other starting values or a prior"
    return (
        f"the model has no answer for {int(np.isnan(predicted).sum())} of {len(predicted)} values at the start: the arm"
        " has no stable equilibrium there, or no mode of that label; raise the starting stiffness or check the labels"
    )
