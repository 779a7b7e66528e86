"""An arm carries out a motion: the one function that runs it and samples what happens."""

from functools import partial

import jax
import numpy as np
from jaxtyping import Float

from ident.arm.arm import Arm
from ident.arm.chain import Loads
from ident.arm.multibody import Multibody, has_transmission_error, multibody
from ident.errors import InputError, ModelError, Problem
from ident.jit import RUNS_ONCE, AnyArray, jit, library
from ident.vibrate.modal.modes_along_path import nominal
from ident.vibrate.motion.motion import Motion
from ident.vibrate.response import exact, fast
from ident.vibrate.response.curved import refuse_curved
from ident.vibrate.response.each import each_of, numbers_of
from ident.vibrate.response.exact import Progress
from ident.vibrate.response.fast_method import FastMethod, Solution, all_of_it, displacement, repeated
from ident.vibrate.response.few_sizes import filled_up
from ident.vibrate.response.response import Response
from ident.vibrate.response.step_weights import step_weights
from ident.vibrate.response.time_intervals import TURN, TURN_WITH_ERROR, jumps_of, time_intervals

RATE = 500.0
"""Samples a second, unless asked otherwise."""

JUMP = 1e-4
"""Largest jump of a pin's speed [rad/s]: 4 m of arm on a mode of 4 Hz would vibrate by 0.02 mm."""
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
    _check_method(method, arm.batch)
    _check(arm, rate, step)
    response, missed = _by_fast_method(arm, motion, loads, elastic_belts, rate, step)
    if method == "exact":
        return exactly(response, progress)
    refuse_curved(arm, missed)
    return response


def exactly(response: Response, progress: Progress = iter) -> Response:
    """Simulate by the exact method what was simulated by the fast one, from where that starts.

    Args:
        response: by the fast method, without batch axes.
        progress: shows how far it is, section by section.

    Returns:
        The response; where the user interrupts, up to then, which it says.

    Raises:
        InputError: a batch.
        ModelError: the tolerance cannot be met.
    """
    _check_method("exact", response.y.shape[2:])
    model, motion, time = response.model, response.motion, np.asarray(response.time)
    start = np.asarray(response.y[:, 0])
    solved = exact.integrate(model, filled_up(motion), (start, np.zeros_like(start)), time, progress=progress)
    y, count = np.asarray(solved.y), solved.y.shape[1]
    times = repeated(time)
    whole = np.pad(y, ((0, 0), (0, len(times) - count)), mode="edge")
    moved = np.asarray(displacement(model, filled_up(motion), np.minimum(times, time[count - 1]), whole))
    path, displaced, static = (part[:, :count] for part in (response.path, moved, response.quasi_static))
    return Response(model, motion, time[:count], y, solved.yd, path, displaced, static, "exact", solved.interrupted)


def _by_fast_method(
    arm: Arm, motion: Motion, loads: Loads | None, elastic: bool, rate: float, step: float | None
) -> tuple[Response, AnyArray | None]:
    """Simulate by the fast method, and return by how much springs that are curved leave their tangents."""
    time, batch = sample_times(motion, rate), arm.batch
    solution = _whole(arm, fast_method(arm, motion, loads, elastic, rate, step))
    refuse_collapse(motion, solution.displacement)
    model = multibody_of(arm, loads, 1 + len(batch), elastic)
    y, yd, path, displacement, static = solution[:5]
    path = path.reshape((3, len(time), -1))[..., 0]
    return Response(model, motion, time, y, yd, path, displacement, static, "fast"), solution.missed


def _whole(arm: Arm, solve: FastMethod) -> Solution:
    """Solve for an arm, and for each of its batch `(*batch)`, whose axes come last."""
    batch, numbers = arm.batch, numbers_of(arm)
    flat = {path: library(x).broadcast_to(library(x).asarray(x), batch).reshape(-1) for path, x in numbers.items()}
    solutions = each_of(nominal(arm) if batch else arm, flat, solve, all_of_it)
    return jax.tree.map(lambda x: x.reshape((*x.shape[:-2], *batch)), solutions)


def fast_method(
    arm: Arm, motion: Motion, loads: Loads | None, elastic: bool, rate: float, step: float | None
) -> FastMethod:
    """Set up the fast method for a motion."""
    _check(arm, rate, step)
    refuse_jumps(arm, motion)
    time = sample_times(motion, rate)
    longest, error = fast.step_for(_concrete(arm), motion) if step is None else step, has_transmission_error(arm)
    _refuse_short(float(time[-1] - time[0]), longest, step is None)
    grid = time_intervals(motion, time[-1], longest, turn=TURN_WITH_ERROR if error else TURN)
    weights, samples = step_weights(int(grid.steps)), np.asarray(len(time))
    return FastMethod(filled_up(motion), loads, repeated(time), samples, grid.filled_up(), weights, elastic, error)


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


def multibody_of(arm: Arm, loads: Loads | None, rank: int, elastic: bool) -> Multibody:
    """Return what `multibody` gathers, by one program."""
    return _multibody(arm, loads, rank, elastic, has_transmission_error(arm))


@partial(jit, options=RUNS_ONCE)
def _multibody(arm: Arm, loads: Loads | None, rank: int, elastic: bool, error: bool) -> Multibody:
    return multibody(arm, loads, rank=rank, elastic_belts=elastic, transmission_error=error)
