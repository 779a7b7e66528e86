"""One search: Levenberg-Marquardt from one start, and the model with its Jacobian at a point."""

from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from ident.inference.gauss_newton import minimum
from ident.inference.parameters import AnyArray
from ident.inference.problem import Choice, InParts, InverseProblem
from ident.jit import jit

WHOLE, NOTHING = np.array(1.0), np.array(0.0)
TO_THE_END, UNTIL_ANEW = np.array(True), np.array(False)
STEEP = 1e-2
"""Gradient of the cost by theta above which a search has not ended in an optimum."""
WORTH = 1e-7
"""Fall of the cost by a whole search that is worth another one."""
TURNS = 6
"""Searches in a row at most, each with another choice of what the values belong to, or more steps."""


class End(NamedTuple):
    """Where one start ended: theta, sum of squares and its gradient, predictions and Jacobian, the model's choice."""

    theta: Any
    cost: Any
    gradient: Any
    predicted: Any
    jacobian: Any
    choice: Choice

    @property
    def score(self) -> float:
        """Minus twice the logarithm of the probability of data, prior and what was said of each value."""
        return float(self.cost + self.choice.cost.sum())


def evaluate(problem: InverseProblem, theta: Float[AnyArray, "P"] | None = None) -> End:
    """Return predictions and their Jacobian at theta, or else at the parameters' starting values.

    No measured value is used: what values belong to is chosen by what was said of them alone. It is a search in which
    nothing counts, so that what was compiled for the fit serves here as well.
    """
    blank = eqx.tree_at(lambda p: p.sigma, without_priors(problem), np.full_like(problem.sigma, np.inf))
    start = problem.parameters.theta(problem.parameters.column("start")) if theta is None else theta
    return _searched(blank, start, None, TO_THE_END, NOTHING)[0]


def look(problem: InverseProblem, theta: Float[AnyArray, "P"], held: Any) -> End:
    """Return what a search would find at theta, with what the model holds, without a step."""
    here = _searched(problem, theta, held, TO_THE_END, NOTHING)[0]
    residuals, slope = (np.asarray(part) for part in problem.weigh(here.predicted, here.jacobian, np.asarray(theta)))
    return here._replace(cost=residuals @ residuals, gradient=2 * slope.T @ residuals)


def looker(problem: InverseProblem) -> Callable[[Float[np.ndarray, "P"], Any], tuple[np.ndarray, np.ndarray, Choice]]:
    """Return what looks at a problem at theta, with what the model holds: predictions, their Jacobian, the choice."""
    large = problem.in_parts()
    if large is not None:
        unheld = (problem if len(large.problems) > 1 else large.problems[0]).unheld()
        return lambda theta, held: _in_parts(large, theta, unheld if held is None else held)
    padded, places, _ = problem.padded()
    unheld = padded.unheld()

    def look(theta: Float[np.ndarray, "P"], held: Any) -> tuple[np.ndarray, np.ndarray, Choice]:
        found = jax.device_get(_with_jacobian(padded, theta, unheld if held is None else held))
        predicted, jacobian, choice = found
        return predicted[places], jacobian[places], choice._replace(cost=choice.cost[places])

    return look


def without_priors(problem: InverseProblem, *, but_nuisances: bool = False) -> InverseProblem:
    """Return the problem in which priors count nothing; those of nuisances too, unless they are to."""
    free = tuple(
        item
        if item.nuisance and but_nuisances
        else eqx.tree_at(lambda q: q.prior_sd, item, np.full_like(item.prior_sd, np.inf))
        for item in problem.parameters.items
    )
    return eqx.tree_at(lambda p: p.parameters.items, problem, free)


def solve(problem: InverseProblem, start: Float[AnyArray, "P"], example: End | None = None, choice: Any = None) -> End:
    """Run Levenberg-Marquardt from one start; the cost is NaN where the model has no answer.

    Where the model chooses what its values belong to, a search holds the choice and ends where another one has become
    more probable; there the next one begins. Where that finds no end, one with the choice of an example is made.

    Args:
        problem: model, data and unknowns.
        start: theta.
        example: the best end so far, if any.
        choice: what the model may hold from a point nearby; where it stays the most probable one, that is all. So it is
            where the example's own choice is not the most probable: nothing else belongs to that optimum.
    """
    if choice is not None:
        near = _held(problem, start, choice.likened())
        if (near.choice.settled and np.isfinite(near.cost)) or (example and not example.choice.settled):
            return near
    own = choosing(problem, start)
    if own.choice.settled or not np.isfinite(own.cost):
        return own
    ends = [_held(problem, own.theta, own.choice.held)]
    if example is not None:
        ends += _like(problem, start, example)
    return min(ends, key=lambda end: (not np.isfinite(end.cost), not end.choice.settled, _is_steep(end), end.cost))


def stay(problem: InverseProblem, end: End) -> End:
    """Search from where another search has ended, and hold what it has chosen, whether or not that stays probable."""
    held = end.choice.held
    return _held(problem, end.theta, None if held is None else held.likened())


def _like(problem: InverseProblem, start: Float[AnyArray, "P"], example: End) -> list[End]:
    """Search with the order that an example holds; where that is not the most probable choice, go on from there."""
    first = _held(problem, start, example.choice.held.ordered())
    if np.isfinite(first.cost) and _is_steep(first):  # held apart where two want to change places
        first = _held(problem, first.theta, first.choice.held.likened())
    if first.choice.settled or not np.isfinite(first.cost):
        return [first]
    then = choosing(problem, first.theta)
    return [first, then if then.choice.settled else _held(problem, then.theta, then.choice.held)]


def _is_steep(end: End) -> bool:
    return not np.abs(end.gradient).max() < STEEP


def choosing(problem: InverseProblem, start: Float[AnyArray, "P"], example: End | None = None) -> End:
    """Search, beginning anew wherever another choice is more probable, until one stays so or `TURNS` are over.

    Then it has not ended: its choice is not settled. An example is of no use to it.
    """
    held = None
    for _ in range(TURNS):
        end, finished = _searched(problem, start, held, UNTIL_ANEW)
        if end.choice.settled or not np.isfinite(end.cost):
            return end if finished else _held(problem, end.theta, end.choice.held)
        start, held = end.theta, end.choice.held.anew()
    return end


def _held(problem: InverseProblem, start: Float[AnyArray, "P"], held: Any) -> End:
    """Search with what is held; afresh after running out of steps, as long as that gains something."""
    before = np.inf
    for _ in range(TURNS):
        end, finished = _searched(problem, start, held, TO_THE_END)
        if finished or not before - end.cost > WORTH:
            break
        start, held, before = end.theta, end.choice.held, end.cost
    return end


def _searched(
    problem: InverseProblem, start: Float[AnyArray, "P"], held: Any, to_the_end: np.ndarray, weight: np.ndarray = WHOLE
) -> tuple[End, bool]:
    """Search from and to host arrays, with values that do not count: one program is loaded for starts and data alike.

    Nothing that is held lets the model choose.
    """
    large = problem.in_parts()
    if large is not None:
        return _searched_in_parts(problem, large, np.asarray(start), held, to_the_end, weight)
    padded, places, scatter = problem.padded()
    held = padded.unheld() if held is None else held
    end, finished = jax.device_get(search(padded, np.asarray(start), held, to_the_end, weight))
    choice = end.choice._replace(cost=end.choice.cost[places])
    own = end._replace(predicted=end.predicted[places], jacobian=end.jacobian[places], choice=choice)
    return own._replace(cost=own.cost + weight**2 * scatter) if scatter else own, bool(finished)


def _searched_in_parts(
    problem: InverseProblem,
    large: InParts,
    start: Float[np.ndarray, "P"],
    held: Any,
    to_the_end: np.ndarray,
    weight: np.ndarray,
) -> tuple[End, bool]:
    """Search among data so many that the model predicts them part by part."""
    weighed: list[tuple[Any, tuple[np.ndarray, np.ndarray]]] = []
    by_problem = problem.weigh  # looked up once: equinox makes a module of a method each time

    def weigh(end: End) -> tuple[np.ndarray, np.ndarray]:
        if not (weighed and weighed[0][0] is end.predicted):  # where a search looks it weighs a second time, to step
            residuals, slope = by_problem(end.predicted, end.jacobian, end.theta)
            weighed[:] = [(end.predicted, (weight * np.asarray(residuals), weight * np.asarray(slope)))]
        return weighed[0][1]

    def look_there(theta: Float[np.ndarray, "P"], held: Any) -> End:
        predicted, jacobian, choice = _in_parts(large, theta, held)
        here = End(theta, np.nan, np.full_like(theta, np.nan), predicted, jacobian, choice)
        residuals, slope = weigh(here)
        return here._replace(cost=residuals @ residuals, gradient=2 * slope.T @ residuals)

    if held is None:
        held = (problem if len(large.problems) > 1 else large.problems[0]).unheld()
    return minimum(look_there, weigh, start, held, bool(to_the_end))


def _in_parts(large: InParts, theta: Float[np.ndarray, "P"], held: Any) -> tuple[np.ndarray, np.ndarray, Choice]:
    """Return predictions, their Jacobian and what they belong to, computed part by part."""
    places, own = large.parts.places, large.parts.split(held)
    each = zip(large.problems, own, strict=True)
    found = [jax.device_get(_with_jacobian(part, theta, held)) for part, held in each]
    predicted, jacobian = (np.concatenate([each[i] for each in found])[places] for i in (0, 1))
    choices = [choice for _, _, choice in found]
    cost = np.concatenate([choice.cost for choice in choices])[places]
    settled = all(choice.settled for choice in choices)
    return predicted, jacobian, Choice(large.parts.joined([choice.held for choice in choices]), settled, cost)


@jit
def search(
    problem: InverseProblem,
    start: Float[AnyArray, "P"],
    held: Any,
    to_the_end: Bool[AnyArray, ""],
    weight: Float[AnyArray, ""],
    steps: int | None = None,
) -> tuple[End, Array]:
    """Run Levenberg-Marquardt from one start, with what the model holds; to the end, or to where it would choose anew.

    Returns also whether it has ended before it ran out of steps (see `minimum`). Residuals count with their weight.

    The solver linearizes the residuals at every step. They are handed over with their Jacobian made already, as an
    affine function of the step, so that the model is compiled once and the last Jacobian comes back with the answer.
    """
    from ident.inference.levenberg_marquardt import (
        damped_minimum as damped_minimum,  # a program that is known needs no solver
    )

    def affine(theta: Array, args: tuple[InverseProblem, Any, Array]) -> Any:
        problem, held, weight = args
        here = jax.lax.stop_gradient(theta)
        predicted, J, choice = _with_jacobian(problem, here, held)
        residuals, slope = (weight * part for part in problem.weigh(predicted, J, here))
        end = End(here, (residuals**2).sum(), 2 * slope.T @ residuals, predicted, J, choice)
        return residuals + slope @ (theta - here), end

    return damped_minimum(affine, start, (problem, held, weight), {"to_the_end": to_the_end}, steps)


@jit
def _with_jacobian(problem: InverseProblem, theta: AnyArray, held: Any) -> tuple[Array, Array, Choice]:
    """Return predictions and their Jacobian; jitted, so that the solver's several looks at it trace it once."""

    def along(direction: Array) -> tuple[Array, Array, Choice]:
        return jax.jvp(lambda theta: problem.holding(theta, held), (theta,), (direction,), has_aux=True)

    return jax.vmap(along, out_axes=(None, -1, None))(jnp.eye(theta.shape[0]))
