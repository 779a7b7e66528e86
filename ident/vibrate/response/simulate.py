"""An arm carries out a motion: the one function that runs it and samples what happens."""

import os
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from ident.arm.arm import Arm
from ident.arm.chain import Loads
from ident.arm.multibody import Multibody, has_transmission_error, multibody
from ident.arm.multibody_kinematics import at_rest, bushings, deviations, end_point, pins
from ident.errors import InputError, ModelError, Problem
from ident.jit import AnyArray, concrete, jit, library
from ident.vibrate.modal.modes_along_path import nominal
from ident.vibrate.motion.command import command
from ident.vibrate.motion.motion import Motion
from ident.vibrate.response import exact, fast
from ident.vibrate.response.exact import Progress
from ident.vibrate.response.few_sizes import filled_up, ladder, where
from ident.vibrate.response.response import Response
from ident.vibrate.response.time_intervals import TimeIntervals, Times, between_nodes, jumps_of, time_intervals

RATE = 500.0
"""Samples a second, unless asked otherwise."""

JUMP = 1e-4
"""Largest jump of a pin's speed [rad/s]: 4 m of arm on a mode of 4 Hz would vibrate by 0.02 mm."""
CHUNK = 4
"""Arms of a batch that one call solves."""
TOGETHER = 512
"""Times at which the response is computed together."""
LEAST = 4 * TOGETHER
"""Times of the least program."""


def simulate(
    arm: Arm,
    motion: Motion,
    *,
    loads: Loads | None = None,
    method: str = "fast",
    elastic_belts: bool = False,
    rate: float = RATE,
    step: float | None = None,
    progress: Progress = iter,
) -> Response:
    """Simulate an arm from rest through a motion.

    Differentiable in the arm's numbers where the method is fast.

    Args:
        arm: the arm; its numbers may be arrays `(*batch)`, as posterior draws (fast method only).
        motion: the commanded motion, its pauses included.
        loads: what hangs on the arm, constant all the time.
        method: `fast`, linearised about the quasi-static deflection of the moving arm, or `exact`.
        elastic_belts: whether belts stretch; otherwise the pins follow the motors.
        rate: samples a second.
        step: longest time step of the fast method [s]; see `fast.step_for` when None.
        progress: shows progress of the exact method, section by section.

    Raises:
        InputError: no such method, a rate or step out of range, an arm without a named point, the exact method for
            a batch, or a motion whose speed jumps.
        ModelError: the arm collapses, or the tolerance cannot be met.
    """
    batch = arm.batch
    _check_method(method, batch)
    time, solve = sample_times(motion, rate), fast_method(arm, motion, loads, elastic_belts, rate, step)
    solution = concrete(_over_batch(arm, solve, _whole) if batch else solve(arm))
    refuse_collapse(motion, solution.displacement[:, : len(time)])
    model, interrupted = _multibody(arm, loads, 1 + len(batch), elastic_belts), None
    if method == "exact":
        solution, interrupted = _exact(model, solve, solution, time, progress)
        time = time[: solution.y.shape[1]]
    y, yd, path, displacement, static = (part[:, : len(time)] for part in solution)
    path = path[(..., *(0,) * len(batch))]
    return Response(model, motion, time, y, yd, path, displacement, static, method, interrupted)


class Solution(NamedTuple):
    """Coordinates and rates (n, T), path, displacement and quasi-static deflection of the end point (3, T)."""

    y: AnyArray
    yd: AnyArray
    path: AnyArray
    displacement: AnyArray
    quasi_static: AnyArray


def _whole(solution: Solution) -> Solution:
    return solution


def vibration_of(solution: Solution) -> Float[AnyArray, "3 T"]:
    """Return the displacement of the end point from its quasi-static deflection [m]."""
    return solution.displacement - solution.quasi_static


def vibrations(
    arm: Arm, numbers: Mapping[str, Float[Array | np.ndarray, "batch"]], solve: "FastMethod"
) -> Float[AnyArray, "3 T batch"]:
    """Return how the end point vibrates [m] with each of some numbers of the arm, by path; NaN where it collapses."""
    return _of_each(arm, numbers, solve, vibration_of)[:, : int(solve.samples)]


def fast_method(
    arm: Arm, motion: Motion, loads: Loads | None, elastic: bool, rate: float, step: float | None
) -> "FastMethod":
    """Set up the fast method for a motion."""
    _check(arm, rate, step)
    refuse_jumps(arm, motion)
    time = sample_times(motion, rate)
    grid = time_intervals(motion, time[-1], fast.step_for(_concrete(arm), motion) if step is None else step)
    weights, error = fast.places(int(grid.steps)), has_transmission_error(arm)
    samples = np.asarray(len(time))
    return FastMethod(filled_up(motion), loads, _repeated(time), samples, grid.filled_up(), weights, elastic, error)


def _repeated(time: Float[np.ndarray, "T"]) -> Float[np.ndarray, "more"]:
    """Return times with the last one repeated, in one of few numbers."""
    return np.pad(time, (0, ladder(len(time), LEAST) - len(time)), mode="edge")


def _over_batch(arm: Arm, solve: "FastMethod", keep: Callable[[Solution], Any]) -> Any:
    """Solve for each arm of a batch `(*batch)`, one after another on each core, these axes last.

    One arm fills a core better than several side by side, whose intermediate values do not fit its cache. What does not
    depend on the numbers that differ is computed once for all.
    """
    batch, one = arm.batch, nominal(arm)
    varying = {path: value for path, value in arm.numbers().items() if jnp.ndim(value)}
    flat = {path: library(value).broadcast_to(value, batch).reshape(-1) for path, value in varying.items()}
    return jax.tree.map(lambda x: x.reshape((*x.shape[:-1], *batch)), _of_each(one, flat, solve, keep))


def _of_each(
    arm: Arm, numbers: Mapping[str, Array | np.ndarray], solve: "FastMethod", keep: Callable[[Solution], Any]
) -> Any:
    """Solve for an arm with each of these numbers (batch,), by path."""
    chunked = by_chunk(lambda values: _mapped(arm, values, solve, keep), dict(numbers))
    return jax.tree.map(lambda x: library(x).moveaxis(x, 0, -1), chunked)


@cache
def _pool() -> ThreadPoolExecutor:
    """Return the threads that solve: one a core, however many callers there are at once."""
    return ThreadPoolExecutor(os.cpu_count(), "simulate")


def by_chunk(run: Callable[[Any], Any], flat: Any, chunk: int = CHUNK) -> Any:
    """Run some of a batch at a time, which is the first axis of all arrays, as many chunks at once as there are cores.

    The first to come compiles the program, for which jax lets the others wait. Under `jit` or `grad` all at once.
    """
    leaves = jax.tree.leaves(flat)
    if any(isinstance(leaf, jax.core.Tracer) for leaf in leaves):
        return run(flat)
    flat, count = jax.tree.map(np.asarray, flat), len(leaves[0])
    picked = [np.minimum(np.arange(start, start + chunk), count - 1) for start in range(0, count, chunk)]
    chunks = [jax.tree.map(lambda leaf, which=which: leaf[which], flat) for which in picked]
    futures = [_pool().submit(lambda one: jax.block_until_ready(run(one)), one) for one in chunks]
    try:
        parts = [future.result() for future in futures]
    finally:
        for future in futures:
            future.cancel()
    return jax.tree.map(lambda *leaf: np.concatenate(leaf)[:count], *parts)


@jit
def _mapped(arm: Arm, values: dict[str, Array], solve: "FastMethod", keep: Callable[[Solution], Any]) -> Any:
    return jax.lax.map(lambda one: keep(solve(arm.replace(one))), values)


class FastMethod(eqx.Module):
    """The fast method for one arm, all else given."""

    motion: Motion
    loads: Loads | None
    time: Times
    samples: Int[AnyArray, ""]
    grid: TimeIntervals
    weights: fast.Places
    elastic: bool = eqx.field(static=True)
    transmission_error: bool = eqx.field(static=True)

    @jit
    def __call__(self, arm: Arm) -> Solution:
        """Simulate an arm without batch axes; what is behind the samples means nothing."""
        model = multibody(
            arm, self.loads, rank=1, elastic_belts=self.elastic, transmission_error=self.transmission_error
        )
        solved = fast.integrate(arm, model, self.motion, self.grid, self.weights, self.loads)
        nodes, y = self.grid.nodes.ravel(), jnp.moveaxis(solved.quasi_static, 1, 0)
        bent = _end_point(model, self.motion, nodes, y.reshape((model.size, -1)), 0.0)[1]
        bent = jnp.moveaxis(bent.reshape((3, *self.grid.nodes.shape)), 1, 0)

        def at(time: Array) -> tuple[Array, ...]:
            y, yd = solved.at(self.grid, time)
            return y, yd, *_end_point(model, self.motion, time, y), between_nodes(self.grid, bent, time)[0]

        return Solution(*_by_time(at, jnp.asarray(self.time), (model.size, model.size, 3, 3, 3)))


def _by_time(f: Callable[..., tuple[Array, ...]], time: Array, rows: tuple[int, ...], *more: Array) -> list[Array]:
    """Return what f gives for times and what belongs to them, some together, none that are repeated."""
    chunks = time.reshape((-1, TOGETHER))
    real = chunks[:, 0] > jnp.concatenate([jnp.full(1, -jnp.inf), chunks[:-1, -1]])
    with_times = [jnp.moveaxis(x.reshape((x.shape[0], *chunks.shape)), 1, 0) for x in more]

    def turned(none: Any, given: tuple[Array, ...]) -> tuple[Any, tuple[Array, ...]]:
        return none, tuple(part.T for part in f(*given[1:]))

    parts: tuple[Array, ...] = jax.lax.scan(
        where(lambda given: given[0], turned, TOGETHER, rows), None, (real, chunks, *with_times)
    )[1]
    return [part.reshape((-1, part.shape[-1])).T for part in parts]


def _exact(
    model: Multibody, method: FastMethod, solution: Solution, time: Float[np.ndarray, "T"], progress: Progress
) -> tuple[Solution, float | None]:
    """Return the exact solution from where the fast one starts, and until when it was solved if interrupted [s]."""
    start = np.asarray(solution.y[:, 0])
    solved = exact.integrate(model, method.motion, (start, np.zeros_like(start)), time, progress=progress)
    y = np.asarray(solved.y)
    whole = np.pad(y, ((0, 0), (0, len(method.time) - y.shape[1])), mode="edge")
    times = np.minimum(method.time, time[y.shape[1] - 1])
    displacement = np.asarray(_displacement(model, method.motion, times, whole))
    return solution._replace(y=y, yd=np.asarray(solved.yd), displacement=displacement), solved.interrupted


@jit
def _displacement(model: Multibody, motion: Motion, time: Times, y: AnyArray) -> Float[Array, "3 T"]:
    """Return how far the end point is from its path."""

    def at(time: Array, y: Array) -> tuple[Array]:
        return (_end_point(model, motion, time, y)[1],)

    return _by_time(at, jnp.asarray(time), (3,), jnp.asarray(y))[0]


def sample_times(motion: Motion, rate: float) -> Float[np.ndarray, "T"]:
    """Return uniform times from the first break of a motion to the last [s]."""
    start, end = float(motion.breaks[0]), float(motion.breaks[-1])
    return start + np.arange(int(np.floor((end - start) * rate + 1e-9)) + 1) / rate


def _concrete(arm: Arm) -> Arm:
    """Return the arm as it is apart from being differentiated: the grid of time does not depend on it smoothly."""
    return jax.lax.stop_gradient(arm)


def _check_method(method: str, batch: tuple[int, ...]) -> None:
    if method not in ("fast", "exact"):
        raise InputError(Problem("method", f"'{method}'", "fast or exact", "choose one"))
    if method == "exact" and batch:
        raise InputError(Problem("method", "exact for several sets", "one set", "simulate them one by one"))


def _check(arm: Arm, rate: float, step: float | None) -> None:
    if not 1.0 <= rate <= 1e6:
        raise InputError(Problem("rate", f"{rate:g} samples a second", "1 to 1e6", "choose a rate as 500"))
    if step is not None and not 0 < step < np.inf:
        raise InputError(Problem("step", f"{step:g} s", "a time above 0", "leave it out for one that fits"))
    if not arm.points:
        raise InputError(Problem(arm.name, "no named point", "an end point", "add a [[point]] to the arm file"))


def refuse_jumps(arm: Arm, motion: Motion) -> None:
    """Refuse a motion whose speed jumps, at its start too: no motor does that, and the shock would be missed."""
    first = np.abs(np.asarray(motion.coefficients)[-2:-1, 0])
    jumps = np.vstack([first, jumps_of(motion, 1)])
    piece, joint = np.unravel_index(np.argmax(jumps), jumps.shape)
    if jumps[piece, joint] > JUMP:
        name = arm.driven[joint].name if joint < len(arm.driven) else f"joint {joint + 1}"
        got = f"a jump of {name}'s speed by {np.rad2deg(jumps[piece, joint]):.4g} deg/s at {motion.breaks[piece]:.4g} s"
        remedy = "let a path begin at rest, and smooth a log (`smoothing`)"
        raise InputError(Problem(motion.name, got, "a motion from rest without such jumps", remedy))


def refuse_collapse(motion: Motion, displacement: AnyArray) -> None:
    """Refuse a displacement that is NaN; under `jit` or `grad` it may be.

    Raises:
        ModelError: the arm collapses.
    """
    if not isinstance(displacement, jax.core.Tracer) and not np.isfinite(np.asarray(displacement)).all():
        raise ModelError(
            f"no response to {motion.name}: the arm has no stable equilibrium somewhere along it; "
            "check stiffnesses, masses and their units"
        )


@jit
def _multibody(arm: Arm, loads: Loads | None, rank: int, elastic: bool) -> Multibody:
    return multibody(arm, loads, rank=rank, elastic_belts=elastic)


def _end_point(
    model: Multibody, motion: Motion, time: AnyArray, y: Array, error: float = 1.0
) -> tuple[Float[Array, "3 T"], Float[Array, "3 T"]]:
    """Return path and displacement of the end point, with so much of the kinematic error in the latter."""
    turning = pins(model, command(model, motion, time), at_rest(deviations(model, y)))
    path = end_point(model, turning.pin.angle - turning.error - deviations(model, y))
    angle = turning.pin.angle - (1 - error) * turning.error
    return path, end_point(model, angle, bushings(model, y)) - path
