"""An arm carries out a motion: the one function that runs it and samples what happens."""

from collections.abc import Callable, Iterable, Iterator

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ident.arm.arm import Arm
from ident.arm.chain import Loads
from ident.errors import InputError, Problem
from ident.vibrate import exact, fast
from ident.vibrate.dynamics import at_rest, bushings, command, deviations, pins, positions
from ident.vibrate.machine import Machine, machine
from ident.vibrate.motion import Motion
from ident.vibrate.panels import resample
from ident.vibrate.response import Response, Vibration
from ident.vibrate.sag import sag_along

RATE = 500.0
"""Samples a second, unless asked otherwise."""

Progress = Callable[[Iterable[int]], Iterator[int]]


def simulate(
    arm: Arm,
    motion: Motion,
    *,
    loads: Loads | None = None,
    method: str = "fast",
    elastic_belts: bool = False,
    rate: float = RATE,
    step: float = fast.STEP,
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
        step: longest time step of the fast method [s].
        rtol: relative tolerance of the exact method.
        progress: shows progress of the exact method, second by second.

    Raises:
        InputError: an option is not one of those.
        ModelError: the arm collapses, or the tolerance cannot be met.
    """
    _check(arm, motion, method, rate)
    time = sample_times(motion, rate)
    sets = number_of_sets(arm)
    gathered = machine(arm, loads, rank=1 + len(sets), elastic_belts=elastic_belts)
    if method == "fast":
        solved = fast.integrate(arm, gathered, motion, time[-1], loads, step)
        y, yd = resample(solved.time, solved.y, solved.yd, time)
        rest, _ = resample(solved.time, solved.rest, solved.rest_rate, time)
    elif sets:
        raise InputError(Problem("method", "exact for several sets", "one set", "simulate them one by one"))
    else:
        ends, line, rate_of_line = sag_along(arm, gathered, motion, loads, time[-1])
        rest, _ = resample(ends, line, rate_of_line, time)
        start = rest[:, 0], jnp.zeros_like(rest[:, 0])
        y, yd, *_ = exact.integrate(gathered, motion, start, time, rtol=rtol, progress=progress)
        time, rest = time[: y.shape[1]], rest[:, : y.shape[1]]
    path, displacement, sag = _end_point(gathered, motion, time, y, rest)
    return Response(gathered, motion, jnp.asarray(time), y, yd, path, displacement, sag, method)


def sample_times(motion: Motion, rate: float) -> Float[np.ndarray, "T"]:
    """Return uniform times from the first break of a motion to the last [s]."""
    start, end = float(motion.breaks[0]), float(motion.breaks[-1])
    return start + np.arange(int(np.floor((end - start) * rate + 1e-9)) + 1) / rate


def number_of_sets(arm: Arm) -> tuple[int, ...]:
    """Return the batch `(*sets)` that numbers of the arm carry."""
    return jnp.broadcast_shapes(*(jnp.shape(arm.get(path)) for path in arm.paths()))


def _check(arm: Arm, motion: Motion, method: str, rate: float) -> None:
    if method not in ("fast", "exact"):
        raise InputError(Problem("method", f"'{method}'", "fast or exact", "choose one"))
    if not 1.0 <= rate <= 1e6:
        raise InputError(Problem("rate", f"{rate:g} samples a second", "1 to 1e6", "choose a rate as 500"))
    if not arm.points:
        raise InputError(Problem(arm.name, "no named point", "an end point", "add a [[point]] to the arm file"))


@jax.jit
def _end_point(
    machine: Machine, motion: Motion, time: Array, y: Array, rest: Array
) -> tuple[Float[Array, "3 T"], Vibration, Vibration]:
    """Return path, displacement and sag of the end point."""
    told = command(machine, motion, time)

    def end(y: Array, error: float) -> Array:
        turning = pins(machine, told, at_rest(deviations(machine, y)))
        angle = turning.pin.angle - (1 - error) * turning.error
        return positions(machine, angle, bushings(machine, y))[:, -1]

    path = end(jnp.zeros_like(rest), 0.0)
    return path[(..., *(0,) * (path.ndim - 2))], end(y, 1.0) - path, end(rest, 0.0) - path
