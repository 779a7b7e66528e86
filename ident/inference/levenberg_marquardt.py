"""The solver of a search: Levenberg-Marquardt by optimistix, with one step more than it would take."""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax.numpy as jnp
import optimistix as optx
from jaxtyping import Array, Bool, Float

from ident.inference.parameters import AnyArray

TOLERANCE = 1e-10
"""Relative and absolute change of theta and of the residuals at which a search ends."""


def damped_minimum(
    residuals: Callable[[Array, Any], Any],
    start: Float[AnyArray, "P"],
    args: Any,
    options: dict[str, Any],
    steps: int,
) -> tuple[Any, Array]:
    """Minimise a sum of squares from a start; return what came with the last residuals, and whether it has ended.

    Args:
        residuals: of theta and the other arguments, and what comes with them.
        start: of theta.
        args: the other arguments: problem, what the model holds, weight.
        options: `to_the_end`: whether it goes on where the model would choose again.
        steps: after which it is given up.
    """
    solver = _OneStepMore(rtol=TOLERANCE, atol=TOLERANCE)  # type: ignore[call-arg]  # it inherits its constructor
    found: Any = optx.least_squares(
        residuals, solver, start, args=args, options=options, max_steps=steps + 1, throw=False, has_aux=True
    )
    return found.aux, found.stats["num_steps"] <= steps


class _Progress(NamedTuple):
    """State of the solver itself, what the model holds, whether it has ended, and whether it had a step before."""

    inner: Any
    held: Any
    ended: Bool[Array, ""]
    ended_before: Bool[Array, ""]


class _OneStepMore(optx.LevenbergMarquardt[Any, Any, Any]):
    """Goes on for one step after the end.

    What a step of optimistix returns beside its point belongs to the point where the step began, so that of the last
    point comes with one step more. Why the search ended is no matter: the gradient tells whether it is an optimum.
    """

    def init(self, fn: Any, y: Any, args: Any, *inputs: Any) -> Any:
        return _Progress(super().init(fn, y, args, *inputs), args[1], jnp.array(False), jnp.array(False))

    def step(self, fn: Any, y: Any, args: Any, options: Any, state: Any, tags: Any) -> tuple[Any, Any, Any]:
        args = args[0], state.held, args[2]
        y, inner, aux = super().step(fn, y, args, options, state.inner, tags)
        ended, result = super().terminate(fn, y, args, options, inner, tags)
        choice = inner.aux.choice  # of the last point that was accepted
        short = jnp.abs(inner.y_eval - y).max() < TOLERANCE * (1 + jnp.abs(y).max())  # else rejected to the last step
        ended |= short | (result != optx.RESULTS.successful) | ~(choice.settled | options["to_the_end"])
        return y, _Progress(inner, choice.held, ended, state.ended), aux

    def terminate(self, fn: Any, y: Any, args: Any, options: Any, state: Any, tags: Any) -> Any:
        return state.ended_before, optx.RESULTS.successful
