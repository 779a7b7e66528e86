"""The solver within a compiled program: Levenberg-Marquardt from optimistix' damped Newton descent and trust region."""

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import lineax as lx
import optimistix as optx
from jaxtyping import Array, Bool, Float

from ident.inference.parameters import AnyArray

LEAST_STEP = 1e-10
"""Length of the next step [sd] below which a search has ended, so that repeated fits agree to 1e-9."""
NEARLY = 1e-6
"""Predicted fall of the cost below which a point may be the end: that of a step of 1e-3 sd, without damping."""
ROUNDING = 1e-10
"""Fall of the cost, relative to 1 + cost, that its rounding may hide; and step in theta, relative to 1 + theta."""


class Progress(NamedTuple):
    """State of a search between two evaluations of the model.

    Attributes:
        end: evaluation at the best point so far.
        known: residuals and their Jacobian there.
        there: (P,) next point to evaluate.
        fall: predicted fall of the cost there; infinite before the first evaluation.
        region: state of the trust region.
        size: of that region, the inverse of the damping; infinite before the first evaluation.
        ended: whether the search has ended.
        looks: number of evaluations.
    """

    end: Any
    known: Any
    there: Any
    fall: Any
    region: Any
    size: Any
    ended: Any
    looks: Any


def damped_minimum(
    look: Callable[[Array, Any], tuple[Any, Array, Array]],
    start: Float[AnyArray, "P"],
    held: Any,
    to_the_end: Bool[AnyArray, ""],
    steps: int,
) -> tuple[Any, Array]:
    """Minimise a sum of squares from a start; return the best point's evaluation, and whether the search has ended.

    The trust region compares the fall of the cost with its prediction, accepts the point or not, and sets the damping
    of the next step: (J'J + damping) d = -J'r (Marquardt, J. SIAM 11, 1963). NaN at the start ends the search.

    Args:
        look: evaluates theta with a held assignment: the result with its `choice`, residuals and their slope.
        start: theta.
        held: assignment that the model keeps at the first point.
        to_the_end: whether to continue where the model would choose again.
        steps: at most.
    """
    rule: Any = optx.ClassicalTrustRegion()
    descent: Any = optx.DampedNewtonDescent(linear_solver=lx.QR())

    def going(at: Progress) -> Array:
        return ~at.ended & (to_the_end | at.end.choice.settled | (at.looks == 0)) & (at.looks <= steps)

    def go(at: Progress) -> Progress:
        end, *known = look(at.there, at.end.choice.held)
        now, before = _known(*known), at.known
        size, accepted, _, region = rule.step(at.looks == 0, at.end.theta, at.there, before, now, at.region)
        # gains at rounding level cannot judge a step: steps are then taken as long as each predicts less than the last
        least = ROUNDING * (1 + 2 * before.as_min())
        near = at.fall < jnp.minimum(least, NEARLY)
        accepted |= near & (2 * (now.as_min() - before.as_min()) < least)
        end, now = jax.tree.map(partial(jnp.where, accepted), (end, now), (at.end, before))
        step, _ = descent.step(size, descent.query(end.theta, now, descent.init(end.theta, now)))
        # |r|^2 - |J d + r|^2 without cancellation: from the equation of the step, |J d|^2 + 2 damping |d|^2
        fall = (now.jac.mv(step) ** 2).sum() + 2 * (step**2).sum() / size
        stuck = jnp.abs(step).max() < ROUNDING * (1 + jnp.abs(end.theta).max())
        no_less = (fall >= at.fall) & (size <= at.size)  # with less damping a prediction grows, far from the end too
        ended = ~jnp.isfinite(fall) | (fall < LEAST_STEP**2) | stuck | (near & (~accepted | no_less))
        return Progress(end, now, end.theta + step, fall, region, size, ended, at.looks + 1)

    start, held = jax.tree.map(jnp.asarray, (start, held))
    end, *known = jax.tree.map(lambda x: jnp.zeros(x.shape, x.dtype), jax.eval_shape(look, start, held))
    end = end._replace(choice=end.choice._replace(held=held))
    region, no = rule.init(start, _known(*known)), jnp.array(False)
    inf = jnp.array(jnp.inf)
    first = Progress(end, _known(*known), start, inf, region, inf, no, jnp.array(0))
    at: Progress = jax.lax.while_loop(going, go, first)
    return at.end, at.ended | ~(to_the_end | at.end.choice.settled)


def _known(residuals: Array, slope: Array) -> Any:
    return optx.FunctionInfo.ResidualJac(residuals, lx.MatrixLinearOperator(slope))
