"""An arm carries out a motion: the one function that runs it and samples what happens."""

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ident.arm.arm import Arm
from ident.arm.chain import Loads
from ident.arm.multibody import Multibody, has_transmission_error, multibody
from ident.arm.multibody_kinematics import at_rest, bushings, deviations, end_point, pins
from ident.errors import InputError, ModelError, Problem
from ident.jit import jit
from ident.vibrate.modal.modes_along_path import nominal
from ident.vibrate.motion.command import command
from ident.vibrate.motion.motion import Motion
from ident.vibrate.response import exact, fast
from ident.vibrate.response.exact import Progress
from ident.vibrate.response.quasi_static import initial_equilibrium, quasi_static_along
from ident.vibrate.response.response import Response
from ident.vibrate.response.time_intervals import NODES, TimeIntervals, Times, between_nodes, jumps_of, time_intervals

RATE = 500.0
"""Samples a second, unless asked otherwise."""

JUMP = 1e-4
"""Largest jump of a pin's speed [rad/s]: 4 m of arm on a mode of 4 Hz would be shaken by 0.02 mm."""
CHUNK = 4
"""Sets that one call solves."""


def simulate(
    arm: Arm,
    motion: Motion,
    *,
    loads: Loads | None = None,
    method: str = "fast",
    elastic_belts: bool = False,
    rate: float = RATE,
    step: float | None = None,
    rtol: float = 1e-7,
    progress: Progress = iter,
) -> Response:
    """Simulate an arm from rest through a motion.

    Differentiable in the arm's numbers where the method is fast.

    Args:
        arm: the arm; its numbers may be arrays `(*sets)`, as fitted values or posterior draws (fast method only).
        motion: what the motors are told; its pauses included.
        loads: what hangs on the arm, constant all the time.
        method: `fast`, linearised about the moving, sagging arm, or `exact`.
        elastic_belts: whether belts stretch; otherwise the pins follow the motors.
        rate: samples a second.
        step: longest time step of the fast method [s]; see `fast.step_for` when None.
        rtol: relative tolerance of the exact method.
        progress: shows progress of the exact method, section by section.

    Raises:
        InputError: no such method, a rate or step out of range, an arm without a named point, the exact method for
            several sets, or a motion whose speed jumps.
        ModelError: the arm collapses, or the tolerance cannot be met.
    """
    sets = arm.sets
    _check_method(method, sets)
    solve = fast_method(arm, motion, loads, elastic_belts, rate, step)
    if method == "exact":
        solution = _exact(arm, solve, rtol, progress)
    else:
        solution = _over_sets(arm, solve, _whole) if sets else solve(arm)
    time = solve.time[: solution.y.shape[1]]
    _refuse_collapse(motion, solution.displacement)
    gathered = _gathered(arm, loads, 1 + len(sets), elastic_belts)
    path = solution.path[(..., *(0,) * len(sets))]
    return Response(
        gathered, motion, jnp.asarray(time), solution.y, solution.yd, path, solution.displacement, solution.sag, method
    )


class Solution(NamedTuple):
    """Coordinates and rates (n, T), path, displacement and sag of the end point (3, T)."""

    y: Array
    yd: Array
    path: Array
    displacement: Array
    sag: Array


def _whole(solution: Solution) -> Solution:
    return solution


def vibration_of(solution: Solution) -> Float[Array, "3 T"]:
    """Return the displacement of the end point from where the sagging arm would be [m]."""
    return solution.displacement - solution.sag


def vibrations(
    arm: Arm,
    motion: Motion,
    *,
    loads: Loads | None = None,
    elastic_belts: bool = False,
    rate: float = RATE,
    step: float | None = None,
) -> Float[Array, "3 T *sets"]:
    """Return how the end point of each of several sets vibrates [m], by the fast method: `simulate`, and no more.

    Arguments and errors: see `simulate`.
    """
    solve = fast_method(arm, motion, loads, elastic_belts, rate, step)
    found = _over_sets(arm, solve, vibration_of)
    _refuse_collapse(motion, found)
    return found


def fast_method(
    arm: Arm, motion: Motion, loads: Loads | None, elastic: bool, rate: float, step: float | None
) -> "FastMethod":
    """Set up the fast method for a motion."""
    _check(arm, rate, step)
    refuse_jumps(arm, motion)
    time = sample_times(motion, rate)
    grid = time_intervals(motion, time[-1], fast.step_for(_concrete(arm), motion) if step is None else step)
    return FastMethod(_nameless(motion), loads, time, grid, elastic, has_transmission_error(arm))


def _over_sets(arm: Arm, solve: "FastMethod", keep: Callable[[Solution], Any]) -> Any:
    """Solve for an arm of each of the sets `(*sets)`, one after another on each core, these axes last.

    One set fills a core better than several side by side, whose intermediate values do not fit its cache. What does not
    depend on the numbers that differ is computed once for all.
    """
    sets, one = arm.sets, nominal(arm)
    batched = {path: value for path, value in arm.numbers().items() if jnp.ndim(value)}
    flat = {path: jnp.broadcast_to(value, sets).reshape(-1) for path, value in batched.items()}
    found = by_chunk(lambda values: _mapped(one, values, solve, keep), flat)
    return jax.tree.map(lambda x: jnp.moveaxis(x, 0, -1).reshape((*x.shape[1:], *sets)), found)


def by_chunk(run: Callable[[Any], Any], flat: Any, chunk: int = CHUNK) -> Any:
    """Run some sets at a time, which are on the first axis of all arrays, as many chunks at once as there are cores.

    The first to come compiles the program, for which jax lets the others wait. Under `jit` or `grad` all sets at once.
    """
    leaves = jax.tree.leaves(flat)
    if any(isinstance(leaf, jax.core.Tracer) for leaf in leaves):
        return run(flat)
    flat, count = jax.tree.map(np.asarray, flat), len(leaves[0])
    picked = [np.minimum(np.arange(start, start + chunk), count - 1) for start in range(0, count, chunk)]
    chunks = [jax.tree.map(lambda leaf, which=which: leaf[which], flat) for which in picked]
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        found = list(pool.map(lambda one: jax.block_until_ready(run(one)), chunks))
    return jax.tree.map(lambda *parts: jnp.concatenate(parts)[:count], *found)


@jit
def _mapped(arm: Arm, values: dict[str, Array], solve: "FastMethod", keep: Callable[[Solution], Any]) -> Any:
    return jax.lax.map(lambda one: keep(solve(arm.replace(one))), values)


class FastMethod(eqx.Module):
    """The fast method for one set of numbers, all else given."""

    motion: Motion
    loads: Loads | None
    time: Times
    grid: TimeIntervals
    elastic: bool = eqx.field(static=True)
    inexact: bool = eqx.field(static=True)

    @jit
    def __call__(self, arm: Arm) -> Solution:
        """Simulate an arm of one set."""
        gathered = multibody(arm, self.loads, rank=1, elastic_belts=self.elastic, inexact=self.inexact)
        solved = fast.integrate(arm, gathered, self.motion, self.grid, self.loads)
        y, yd = solved.at(self.grid, self.time)
        return Solution(y, yd, *_end_point(gathered, self.motion, self.grid, self.time, y, solved.rest))


def _exact(arm: Arm, asked: FastMethod, rtol: float, progress: Progress) -> Solution:
    motion, loads, time, grid = asked.motion, asked.loads, np.asarray(asked.time), asked.grid
    gathered = _gathered(arm, loads, 1, asked.elastic)
    rest = quasi_static_along(arm, gathered, motion, loads, grid)
    first = initial_equilibrium(gathered, motion, between_nodes(grid, rest, time[:1])[0][:, 0])
    start = first, jnp.zeros_like(first)
    y, yd, *_ = exact.integrate(gathered, motion, start, time, rtol=rtol, progress=progress)
    return Solution(y, yd, *_end_point(gathered, motion, grid, time[: y.shape[1]], y, rest))


def sample_times(motion: Motion, rate: float) -> Float[np.ndarray, "T"]:
    """Return uniform times from the first break of a motion to the last [s]."""
    start, end = float(motion.breaks[0]), float(motion.breaks[-1])
    return start + np.arange(int(np.floor((end - start) * rate + 1e-9)) + 1) / rate


def _nameless(motion: Motion) -> Motion:
    """Return the motion without name and arrival, for each of which the solvers would be compiled anew."""
    return Motion("motion", motion.breaks, motion.coefficients, arrival=float(motion.breaks[0]))


def _concrete(arm: Arm) -> Arm:
    """Return the arm as it is apart from being differentiated: the grid of time does not depend on it smoothly."""
    return jax.lax.stop_gradient(arm)


def _check_method(method: str, sets: tuple[int, ...]) -> None:
    if method not in ("fast", "exact"):
        raise InputError(Problem("method", f"'{method}'", "fast or exact", "choose one"))
    if method == "exact" and sets:
        raise InputError(Problem("method", "exact for several sets", "one set", "simulate them one by one"))


def _check(arm: Arm, rate: float, step: float | None) -> None:
    if not 1.0 <= rate <= 1e6:
        raise InputError(Problem("rate", f"{rate:g} samples a second", "1 to 1e6", "choose a rate as 500"))
    if step is not None and not 0 < step < np.inf:
        raise InputError(Problem("step", f"{step:g} s", "a time above 0", "leave it out for one that fits"))
    if not arm.points:
        raise InputError(Problem(arm.name, "no named point", "an end point", "add a [[point]] to the arm file"))


def refuse_jumps(arm: Arm, motion: Motion) -> None:
    """Refuse a motion whose speed jumps, at its start too: no motor does that, and the blow would not be felt."""
    first = np.abs(np.asarray(motion.coefficients)[-2:-1, 0])
    jumps = np.vstack([first, jumps_of(motion, 1)])
    place, joint = np.unravel_index(np.argmax(jumps), jumps.shape)
    if jumps[place, joint] > JUMP:
        name = arm.driven[joint].name if joint < len(arm.driven) else f"joint {joint + 1}"
        got = f"a jump of {name}'s speed by {np.rad2deg(jumps[place, joint]):.4g} deg/s at {motion.breaks[place]:.4g} s"
        remedy = "let a path begin at rest, and smooth a log (`smoothing`)"
        raise InputError(Problem(motion.name, got, "a motion from rest without such jumps", remedy))


def _refuse_collapse(motion: Motion, displacement: Array) -> None:
    """Raise where there is no answer; under `jit` or `grad` it is NaN."""
    if not isinstance(displacement, jax.core.Tracer) and not np.isfinite(np.asarray(displacement)).all():
        raise ModelError(
            f"no response to {motion.name}: the arm has no stable equilibrium somewhere along it; "
            "check stiffnesses, masses and their units"
        )


@jit
def _gathered(arm: Arm, loads: Loads | None, rank: int, elastic: bool) -> Multibody:
    return multibody(arm, loads, rank=rank, elastic_belts=elastic)


@jit
def _end_point(
    multibody: Multibody, motion: Motion, grid: TimeIntervals, time: Times, y: Array, rest: Float[Array, "P n m"]
) -> tuple[Float[Array, "3 T"], Float[Array, "3 T"], Float[Array, "3 T"]]:
    """Return path, displacement and sag of the end point; the sag from its values at the nodes of the panels."""

    def from_path(time: Times, y: Array, error: float) -> tuple[Array, Array]:
        turning = pins(multibody, command(multibody, motion, time), at_rest(deviations(multibody, y)))
        path = end_point(multibody, turning.pin.angle - turning.error - deviations(multibody, y))
        angle = turning.pin.angle - (1 - error) * turning.error
        return path, end_point(multibody, angle, bushings(multibody, y)) - path

    path, displacement = from_path(jnp.asarray(time), y, 1.0)
    _, sag = from_path(grid.nodes.ravel(), jnp.moveaxis(rest, 1, 0).reshape((y.shape[0], -1)), 0.0)
    return path, displacement, between_nodes(grid, jnp.moveaxis(sag.reshape((3, -1, NODES)), 1, 0), time)[0]
