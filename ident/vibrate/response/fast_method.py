"""The fast method for one arm, all else given: one compiled program, whatever the motion's length."""

from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from ident.arm.arm import Arm
from ident.arm.chain import Loads
from ident.arm.multibody import Multibody, balanced, multibody
from ident.arm.multibody_dynamics import beyond_tangent
from ident.arm.multibody_kinematics import at_rest, bushing_rotations, deviations, end_point, pins
from ident.jit import AnyArray, jit
from ident.vibrate.motion.command import command
from ident.vibrate.motion.motion import Motion
from ident.vibrate.response.fast import Fast, excited
from ident.vibrate.response.few_sizes import ladder, where
from ident.vibrate.response.linear import Linear, linearised
from ident.vibrate.response.step_weights import StepWeights
from ident.vibrate.response.time_intervals import TimeIntervals, Times, between_nodes

TOGETHER = 2048
"""Times at which the response is computed together."""
LEAST = 10 * TOGETHER
"""Times of the least program: 40 s at 500 a second, as the nominal arm's stroke at 10 % takes; those behind the samples
cost next to nothing."""


class Solution(NamedTuple):
    """Coordinates and rates (n, T), path, displacement and quasi-static deflection of the end point (3, T).

    Where springs are curved, also the size of each bushing's spring moment by which the tangent misses the curve, and
    of that moment's change (2 N, T) [N m], see `beyond_tangent`; None otherwise.
    """

    y: AnyArray
    yd: AnyArray
    path: AnyArray
    displacement: AnyArray
    quasi_static: AnyArray
    missed: AnyArray | None = None


class Linearised(NamedTuple):
    """The linearised equations, and the quasi-static deflection of the end point at the nodes.

    The same whatever excites the arm.
    """

    equations: Linear
    bent: Float[Array, "P 3 m"]


def vibration_of(solution: Solution) -> Float[AnyArray, "3 T"]:
    """Return the displacement of the end point from its quasi-static deflection [m]."""
    return solution.displacement - solution.quasi_static


class FastMethod(eqx.Module):
    """The fast method for one arm, all else given."""

    motion: Motion
    loads: Loads | None
    time: Times
    samples: Int[AnyArray, ""]
    grid: TimeIntervals
    weights: StepWeights
    elastic: bool = eqx.field(static=True)
    transmission_error: bool = eqx.field(static=True)

    @jit
    def __call__(self, arm: Arm) -> Solution:
        """Simulate an arm without batch axes; what is behind the samples means nothing."""
        linear = self.linearised(arm)
        return self.sampled(arm, linear, self.excited(arm, linear), all_of_it)

    def linearised(self, arm: Arm, within: TimeIntervals | None = None) -> Linearised:
        """Linearise an arm's equations of motion along the motion, or within some of its time intervals."""
        model, grid = self._model(arm), self.grid if within is None else within
        equations = linearised(arm, model, self.motion, grid, self.weights, self.loads)
        y = jnp.moveaxis(equations.quasi_static, 1, 0).reshape((model.size, -1))
        bent = _end_point(balanced(model), self.motion, grid.nodes.ravel(), y)[1]
        return Linearised(equations, jnp.moveaxis(bent.reshape((3, *grid.nodes.shape)), 1, 0))

    def excited(self, arm: Arm, linear: Linearised) -> Fast:
        """Integrate them with what excites the arm."""
        return excited(self._model(arm), self.motion, self.grid, self.weights, linear.equations)

    def sampled(self, arm: Arm, linear: Linearised, solved: Fast, keep: "Callable[[Solution], Any]") -> Any:
        """Return what is kept of the solution at the samples; what is behind them means nothing."""
        model = self._model(arm)
        return _by_time(lambda time: keep(self._at(model, linear, solved, time)), jnp.asarray(self.time))

    def at(self, arm: Arm, linear: Linearised, solved: Fast, time: Times) -> Solution:
        """Return the solution at a few times of the motion."""
        return self._at(self._model(arm), linear, solved, time)

    def _at(self, model: Multibody, linear: Linearised, solved: Fast, time: Times) -> Solution:
        y, yd = solved.at(self.grid, time)
        static = between_nodes(self.grid, linear.bent, time)[0]
        missed = self._missed(model, linear.equations, time, y)
        return Solution(y, yd, *_end_point(model, self.motion, time, y), static, missed)

    def _model(self, arm: Arm) -> Multibody:
        """Gather an arm's equations of motion."""
        return multibody(
            arm, self.loads, rank=1, elastic_belts=self.elastic, transmission_error=self.transmission_error
        )

    def _missed(self, model: Multibody, linear: Linear, time: Times, y: Array) -> Array | None:
        if model.curved is None:
            return None
        rest = between_nodes(self.grid, linear.quasi_static, time)[0]
        return jnp.concatenate(beyond_tangent(model, bushing_rotations(model, rest), bushing_rotations(model, y)))


def all_of_it(solution: Solution) -> Solution:
    """Return a solution as it is."""
    return solution


def _by_time(f: Callable[..., Any], time: Array, *more: Array) -> Any:
    """Return what f gives for times and what belongs to them, some together, none that are repeated."""
    chunks = time.reshape((-1, TOGETHER))
    real = chunks[:, 0] > jnp.concatenate([jnp.full(1, -jnp.inf), chunks[:-1, -1]])
    with_times = [jnp.moveaxis(x.reshape((x.shape[0], *chunks.shape)), 1, 0) for x in more]
    leaves, tree = jax.tree.flatten(jax.eval_shape(f, chunks[0], *(x[0] for x in with_times)))

    def some(none: Any, given: tuple[Array, ...]) -> tuple[Any, tuple[AnyArray, ...]]:
        return none, tuple(jax.tree.leaves(f(*given[1:])))

    some_real = where(lambda given: given[0], some, *(leaf.shape for leaf in leaves))
    parts: tuple[Array, ...] = jax.lax.scan(some_real, None, (real, chunks, *with_times))[1]
    whole = [jnp.moveaxis(part, 0, 1).reshape((part.shape[1], -1)) for part in parts]
    return jax.tree.unflatten(tree, whole)


@jit
def displacement(model: Multibody, motion: Motion, time: Times, y: AnyArray) -> Float[Array, "3 T"]:
    """Return how far the end point is from its path."""

    def at(time: Array, y: Array) -> Array:
        return _end_point(model, motion, time, y)[1]

    moved: Array = _by_time(at, jnp.asarray(time), jnp.asarray(y))
    return moved


def repeated(time: Float[np.ndarray, "T"]) -> Float[np.ndarray, "more"]:
    """Return times with the last one repeated, in one of few numbers."""
    return np.pad(time, (0, ladder(len(time), LEAST) - len(time)), mode="edge")


def _end_point(
    model: Multibody, motion: Motion, time: AnyArray, y: Array
) -> tuple[Float[Array, "3 T"], Float[Array, "3 T"]]:
    """Return path and displacement of the end point."""
    turning = pins(model, command(model, motion, time), at_rest(deviations(model, y)))
    path = end_point(model, turning.pin.angle - turning.error - deviations(model, y))
    return path, end_point(model, turning.pin.angle, bushing_rotations(model, y)) - path
