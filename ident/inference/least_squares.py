"""One search: Levenberg-Marquardt from one start, and the model with its Jacobian at a point."""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
from jaxtyping import Array, Bool, Float

from ident.inference.parameters import AnyArray
from ident.inference.problem import InverseProblem
from ident.jit import jit

MAX_STEPS = 200
TOLERANCE = 1e-10
"""Relative and absolute change of theta and of the residuals at which a search ends."""


class End(NamedTuple):
    """Where one start ended: theta, sum of squares and its gradient, predictions and their Jacobian."""

    theta: Any
    cost: Any
    gradient: Any
    predicted: Any
    jacobian: Any


def evaluate(problem: InverseProblem, theta: Float[AnyArray, "P"] | None = None) -> End:
    """Return predictions and their Jacobian at theta, or else at the parameters' starting values.

    It is a fit without data and prior, so that what was compiled for the fit serves here as well.
    """
    blank = eqx.tree_at(lambda p: p.sigma, without_priors(problem), np.full_like(problem.sigma, np.inf))
    start = problem.parameters.theta(problem.parameters.column("start")) if theta is None else theta
    return solve(blank, start)


def without_priors(problem: InverseProblem) -> InverseProblem:
    """Return the problem in which the priors count nothing."""
    free = tuple(
        eqx.tree_at(lambda q: q.prior_sd, item, np.full_like(item.prior_sd, np.inf))
        for item in problem.parameters.items
    )
    return eqx.tree_at(lambda p: p.parameters.items, problem, free)


@jit
def solve(problem: InverseProblem, start: Float[AnyArray, "P"]) -> End:
    """Run Levenberg-Marquardt from one start; the cost is NaN where the model has no answer.

    The solver linearizes the residuals at every step. They are handed over with their Jacobian made already, as an
    affine function of the step, so that the model is compiled once and the last Jacobian comes back with the answer.
    """

    def affine(theta: Array, problem: InverseProblem) -> Any:
        here = jax.lax.stop_gradient(theta)
        predicted, J = _with_jacobian(problem, here)
        residuals, slope = problem.weigh(predicted, J, here)
        end = End(here, (residuals**2).sum(), 2 * slope.T @ residuals, predicted, J)
        return residuals + slope @ (theta - here), end

    solver = _OneStepMore(rtol=TOLERANCE, atol=TOLERANCE)  # type: ignore[call-arg]  # it inherits its constructor
    search: Any = optx.least_squares(
        affine, solver, start, args=problem, max_steps=MAX_STEPS + 1, throw=False, has_aux=True
    )
    return search.aux


@jit
def _with_jacobian(problem: InverseProblem, theta: Array) -> tuple[Array, Array]:
    """Return predictions and their Jacobian; jitted, so that the solver's several looks at it trace it once."""

    def along(direction: Array) -> tuple[Array, Array]:
        return jax.jvp(problem.predict, (theta,), (direction,))

    return jax.vmap(along, out_axes=(None, -1))(jnp.eye(theta.shape[0]))


class _Progress(NamedTuple):
    """State of the solver itself, whether it has ended, and whether it had ended a step before."""

    inner: Any
    ended: Bool[Array, ""]
    ended_before: Bool[Array, ""]


class _OneStepMore(optx.LevenbergMarquardt[Any, Any, Any]):
    """Goes on for one step after the end.

    What a step of optimistix returns beside its point belongs to the point where the step began, so that of the last
    point comes with one step more. Why the search ended is no matter: the gradient tells whether it is an optimum.
    """

    def init(self, *inputs: Any) -> Any:
        return _Progress(super().init(*inputs), jnp.array(False), jnp.array(False))

    def step(self, fn: Any, y: Any, args: Any, options: Any, state: Any, tags: Any) -> tuple[Any, Any, Any]:
        y, inner, aux = super().step(fn, y, args, options, state.inner, tags)
        ended, result = super().terminate(fn, y, args, options, inner, tags)
        return y, _Progress(inner, ended | (result != optx.RESULTS.successful), state.ended), aux

    def terminate(self, fn: Any, y: Any, args: Any, options: Any, state: Any, tags: Any) -> Any:
        return state.ended_before, optx.RESULTS.successful
