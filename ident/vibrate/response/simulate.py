"""An arm carries out a motion: the one function that runs it and samples what happens."""

from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from functools import cache, partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ident.arm.arm import Arm
from ident.arm.chain import Loads
from ident.arm.multibody import Multibody, has_transmission_error, multibody
from ident.errors import InputError, ModelError, Problem
from ident.jit import RUNS_ONCE, AnyArray, concrete, cores, jit, library
from ident.vibrate.modal.modes_along_path import nominal
from ident.vibrate.motion.motion import Motion
from ident.vibrate.response import exact, fast
from ident.vibrate.response.curved import refuse_curved
from ident.vibrate.response.exact import Progress
from ident.vibrate.response.fast_method import FastMethod, Integrated, Solution, displacement, repeated, vibration_of
from ident.vibrate.response.few_sizes import filled_up
from ident.vibrate.response.response import Response
from ident.vibrate.response.step_weights import step_weights
from ident.vibrate.response.time_intervals import TURN, TURN_WITH_ERROR, Times, jumps_of, time_intervals

RATE = 500.0
"""Samples a second, unless asked otherwise."""

JUMP = 1e-4
"""Largest jump of a pin's speed [rad/s]: 4 m of arm on a mode of 4 Hz would vibrate by 0.02 mm."""
CHUNK = 4
"""Arms of a batch that one call solves."""
MOST_SAMPLES = 1_000_000
"""Samples of a motion: half an hour at the usual rate."""
MOST_STEPS = 10_000_000
"""Time steps of a motion by the fast method."""


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
            a batch, a motion whose speed jumps, or by the fast method curved springs that leave their tangents.
        ModelError: the arm collapses, or the tolerance cannot be met.
    """
    batch = arm.batch
    _check_method(method, batch)
    _check(arm, rate, step)
    time, solve = sample_times(motion, rate), fast_method(arm, motion, loads, elastic_belts, rate, step)
    solution = concrete(_over_batch(arm, solve, _whole) if batch else solve(arm))
    refuse_collapse(motion, solution.displacement[:, : len(time)])
    model, interrupted = multibody_of(arm, loads, 1 + len(batch), elastic_belts), None
    if method == "exact":
        solution, interrupted = _exact(model, solve, solution, time, progress)
        time = time[: solution.y.shape[1]]
    else:
        refuse_curved(arm, solution.missed)
    y, yd, path, displacement, static = (part[:, : len(time)] for part in solution[:5])
    path = path[(..., *(0,) * len(batch))]
    return Response(model, motion, time, y, yd, path, displacement, static, method, interrupted)


def _whole(solution: Solution) -> Solution:
    return solution


def vibrations(
    arm: Arm, numbers: Mapping[str, Float[Array | np.ndarray, "batch"]], solve: "FastMethod"
) -> Float[AnyArray, "3 T batch"]:
    """Return how the end point vibrates [m] with each of some numbers of the arm, by path; NaN where it collapses.

    Raises:
        InputError: vibrations leave the tangents of curved springs, see `refuse_curved`.
    """
    if not arm.springs:
        return _of_each(arm, numbers, solve, vibration_of)
    vibration, missed = _of_each(arm, numbers, solve, _with_missed)
    refuse_curved(arm, missed)
    return vibration


def _with_missed(solution: Solution) -> tuple[AnyArray, AnyArray | None]:
    return vibration_of(solution), solution.missed


def fast_method(
    arm: Arm, motion: Motion, loads: Loads | None, elastic: bool, rate: float, step: float | None
) -> "FastMethod":
    """Set up the fast method for a motion."""
    _check(arm, rate, step)
    refuse_jumps(arm, motion)
    time = sample_times(motion, rate)
    longest, error = fast.step_for(_concrete(arm), motion) if step is None else step, has_transmission_error(arm)
    _refuse_short(float(time[-1] - time[0]), longest, step is None)
    grid = time_intervals(motion, time[-1], longest, turn=TURN_WITH_ERROR if error else TURN)
    weights, samples = step_weights(int(grid.steps)), np.asarray(len(time))
    return FastMethod(filled_up(motion), loads, repeated(time), samples, grid.filled_up(), weights, elastic, error)


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
    """Solve for an arm with each of these numbers (batch,), by path; what is behind the samples is left out."""

    def samples_of(values: Any) -> Any:
        integrated = _integrated(arm, values, solve)
        parts = [concrete(_sampled(arm, values, solve, integrated, time, keep)) for time in solve.blocks()]
        return jax.tree.map(lambda *part: library(part).concatenate(part, -1)[..., : int(solve.samples)], *parts)

    chunked = by_chunk(samples_of, dict(numbers))
    return jax.tree.map(lambda x: library(x).moveaxis(x, 0, -1), chunked)


@cache
def _pool() -> ThreadPoolExecutor:
    """Return the threads that solve: one a core, however many callers there are at once."""
    return ThreadPoolExecutor(cores(), "simulate")


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
def _integrated(arm: Arm, values: dict[str, Array], solve: "FastMethod") -> Integrated:
    def one(values: dict[str, Array]) -> Integrated:
        changed = arm.replace(values)
        return solve.integrated(changed, solve.model(changed))

    return jax.lax.map(one, values)


@jit
def _sampled(
    arm: Arm,
    values: dict[str, Array],
    solve: "FastMethod",
    integrated: Integrated,
    time: Times,
    keep: Callable[[Solution], Any],
) -> Any:
    def one(given: tuple[dict[str, Array], Integrated]) -> Any:
        values, integrated = given
        return keep(solve.at(solve.model(arm.replace(values)), integrated, time))

    return jax.lax.map(one, (values, integrated))


def _exact(
    model: Multibody, method: FastMethod, solution: Solution, time: Float[np.ndarray, "T"], progress: Progress
) -> tuple[Solution, float | None]:
    """Return the exact solution from where the fast one starts, and until when it was solved if interrupted [s]."""
    start = np.asarray(solution.y[:, 0])
    solved = exact.integrate(model, method.motion, (start, np.zeros_like(start)), time, progress=progress)
    y = np.asarray(solved.y)
    whole = np.pad(y, ((0, 0), (0, len(method.time) - y.shape[1])), mode="edge")
    times = np.minimum(method.time, time[y.shape[1] - 1])
    moved = np.asarray(displacement(model, method.motion, times, whole))
    return solution._replace(y=y, yd=np.asarray(solved.yd), displacement=moved), solved.interrupted


def sample_times(motion: Motion, rate: float) -> Float[np.ndarray, "T"]:
    """Return uniform times from the first break of a motion to the last [s]."""
    start, end = float(motion.breaks[0]), float(motion.breaks[-1])
    _refuse_many(motion, (end - start) * rate, rate)
    return start + np.arange(int(np.floor((end - start) * rate + 1e-9)) + 1) / rate


def _refuse_many(motion: Motion, samples: float, rate: float) -> None:
    """Refuse a motion with more samples than can be computed, by what makes it so long."""
    if samples <= MOST_SAMPLES:
        return
    dwell = float(motion.breaks[-1]) - motion.arrival
    moving = samples / rate - dwell
    if max(dwell, moving) * RATE <= MOST_SAMPLES:
        column, got, remedy = "rate", f"{rate:g} samples a second", "choose a rate as 500"
    elif dwell > moving:
        column, got, remedy = "dwell", f"{dwell:.4g} s", "hold the arm for some seconds"
    else:
        column, got, remedy = "speed", f"a motion of {moving:.4g} s", "let it be faster (`speed`)"
    got += f", {samples:.4g} samples in all"
    raise InputError(Problem("", got, f"at most {MOST_SAMPLES:,} samples".replace(",", " "), remedy, column))


def _refuse_short(seconds: float, step: float, needed: bool) -> None:
    """Refuse time steps of which a motion would take more than can be computed."""
    if seconds <= MOST_STEPS * step:
        return
    got = f"steps of {step:.3g} s" + (", as its drives and frequencies ask for" if needed else "")
    got += f", {seconds / step:.3g} in all"
    remedy = "correct the arm's ratios and stiffnesses" if needed else "leave it out for one that fits"
    expected = f"at most {MOST_STEPS:,} steps".replace(",", " ")
    raise InputError(Problem("", got, expected, remedy, "" if needed else "step"))


def _concrete(arm: Arm) -> Arm:
    """Return the arm as it is apart from being differentiated: the grid of time does not depend on it smoothly."""
    return arm if library(arm) is np else jax.lax.stop_gradient(arm)


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


@partial(jit, options=RUNS_ONCE)
def multibody_of(arm: Arm, loads: Loads | None, rank: int, elastic: bool) -> Multibody:
    """Return what `multibody` gathers, by one program."""
    return multibody(arm, loads, rank=rank, elastic_belts=elastic)
