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
from ident.arm.multibody import Multibody, multibody
from ident.arm.multibody_dynamics import beyond_tangent
from ident.arm.multibody_kinematics import at_rest, bushings, deviations, end_point, pins
from ident.jit import AnyArray, jit
from ident.vibrate.motion.command import command
from ident.vibrate.motion.motion import Motion
from ident.vibrate.response import fast
from ident.vibrate.response.few_sizes import ladder, where
from ident.vibrate.response.step_weights import StepWeights
from ident.vibrate.response.time_intervals import TimeIntervals, Times, between_nodes

TOGETHER = 512
"""Times at which the response is computed together."""
LEAST = 40 * TOGETHER
"""Times of the least program: 40 s at 500 a second, as the nominal arm's stroke at 10 % takes; those behind the samples
cost next to nothing."""
BLOCK = 4 * TOGETHER
"""Times of a program that is called as often as a batch of arms needs: for many arms, times behind the samples cost."""


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


class Integrated(NamedTuple):
    """The solution step by step, and the quasi-static deflection of the end point (P, 3, m) at the nodes."""

    solved: fast.Fast
    bent: Array


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
        model = self.model(arm)
        integrated = self.integrated(arm, model)
        rows = (model.size, model.size, 3, 3, 3) + (() if model.curved is None else (2 * model.joints,))

        def at(time: Array) -> tuple[AnyArray, ...]:
            return tuple(part for part in self.at(model, integrated, time) if part is not None)

        return Solution(*_by_time(at, jnp.asarray(self.time), rows))

    def model(self, arm: Arm) -> Multibody:
        """Gather an arm's equations of motion."""
        return multibody(
            arm, self.loads, rank=1, elastic_belts=self.elastic, transmission_error=self.transmission_error
        )

    def integrated(self, arm: Arm, model: Multibody) -> Integrated:
        """Integrate an arm's equations of motion over the whole of it."""
        solved = fast.integrate(arm, model, self.motion, self.grid, self.weights, self.loads)
        nodes, y = self.grid.nodes.ravel(), jnp.moveaxis(solved.quasi_static, 1, 0)
        bent = _end_point(model, self.motion, nodes, y.reshape((model.size, -1)), 0.0)[1]
        return Integrated(solved, jnp.moveaxis(bent.reshape((3, *self.grid.nodes.shape)), 1, 0))

    def at(self, model: Multibody, integrated: Integrated, time: Times) -> Solution:
        """Return what was integrated at any times."""
        solved, bent = integrated
        y, yd = solved.at(self.grid, time)
        static = between_nodes(self.grid, bent, jnp.asarray(time))[0]
        return Solution(y, yd, *_end_point(model, self.motion, time, y), static, self._missed(model, solved, time, y))

    def _missed(self, model: Multibody, solved: fast.Fast, time: Times, y: Array) -> Array | None:
        if model.curved is None:
            return None
        rest = between_nodes(self.grid, solved.quasi_static, jnp.asarray(time))[0]
        return jnp.concatenate(beyond_tangent(model, bushings(model, rest), bushings(model, y)))

    def blocks(self) -> Float[np.ndarray, "blocks times"]:
        """Return the times of the samples, some at a time, and the last one repeated."""
        count = -(-int(self.samples) // BLOCK) * BLOCK
        return np.asarray(self.time)[:count].reshape(-1, BLOCK)


def _by_time(f: Callable[..., tuple[AnyArray, ...]], time: Array, rows: tuple[int, ...], *more: Array) -> list[Array]:
    """Return what f gives for times and what belongs to them, some together, none that are repeated."""
    chunks = time.reshape((-1, TOGETHER))
    real = chunks[:, 0] > jnp.concatenate([jnp.full(1, -jnp.inf), chunks[:-1, -1]])
    with_times = [jnp.moveaxis(x.reshape((x.shape[0], *chunks.shape)), 1, 0) for x in more]

    def some(none: Any, given: tuple[Array, ...]) -> tuple[Any, tuple[AnyArray, ...]]:
        return none, tuple(f(*given[1:]))

    some_real = where(lambda given: given[0], some, *((row, TOGETHER) for row in rows))
    parts: tuple[Array, ...] = jax.lax.scan(some_real, None, (real, chunks, *with_times))[1]
    return [jnp.moveaxis(part, 0, 1).reshape((part.shape[1], -1)) for part in parts]


@jit
def displacement(model: Multibody, motion: Motion, time: Times, y: AnyArray) -> Float[Array, "3 T"]:
    """Return how far the end point is from its path."""

    def at(time: Array, y: Array) -> tuple[Array]:
        return (_end_point(model, motion, time, y)[1],)

    return _by_time(at, jnp.asarray(time), (3,), jnp.asarray(y))[0]


def repeated(time: Float[np.ndarray, "T"]) -> Float[np.ndarray, "more"]:
    """Return times with the last one repeated, in one of few numbers."""
    return np.pad(time, (0, ladder(len(time), LEAST) - len(time)), mode="edge")


def _end_point(
    model: Multibody, motion: Motion, time: AnyArray, y: Array, error: float = 1.0
) -> tuple[Float[Array, "3 T"], Float[Array, "3 T"]]:
    """Return path and displacement of the end point, with so much of the kinematic error in the latter."""
    turning = pins(model, command(model, motion, time), at_rest(deviations(model, y)))
    path = end_point(model, turning.pin.angle - turning.error - deviations(model, y))
    angle = turning.pin.angle - (1 - error) * turning.error
    return path, end_point(model, angle, bushings(model, y)) - path
