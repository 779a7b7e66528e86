"""An arm carries out a motion: the one function that runs it and samples what happens."""

from collections.abc import Callable, Iterable, Iterator

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ident.arm.arm import Arm
from ident.arm.chain import Loads
from ident.arm.rotations import matvec
from ident.errors import InputError, Problem
from ident.vibrate import exact, fast
from ident.vibrate.belts import stretch, tensions
from ident.vibrate.dynamics import Command, Pins, Turning, bushings, deviations, drive_torques, pins, positions
from ident.vibrate.machine import Machine, machine
from ident.vibrate.motion import Motion
from ident.vibrate.response import Response
from ident.vibrate.sag import sag

RATE = 500.0
"""Samples a second, unless asked otherwise."""

BATCH = 256
"""Moments whose accelerations are found together."""

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
        solved = fast.integrate(arm, gathered, motion, time[0], time[-1], loads, step)
        y, yd = _resample(solved.time, solved.y, solved.yd, time)
    elif sets:
        raise InputError(Problem("method", "exact for several sets", "one set", "simulate them one by one"))
    else:
        first = sag(arm, gathered, motion(time[:1])[0], loads)[:, 0]
        exactly = exact.integrate(gathered, motion, (first, jnp.zeros_like(first)), time, rtol=rtol, progress=progress)
        time, y, yd = time[: exactly.y.shape[1]], exactly.y, exactly.yd
    return _response(arm, gathered, motion, loads, jnp.asarray(time), y, yd, method)


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


def _resample(
    ends: np.ndarray, y: Array, yd: Array, time: np.ndarray
) -> tuple[Float[Array, "n T *sets"], Float[Array, "n T *sets"]]:
    """Return coordinates and rates at other times, by cubic Hermite interpolation of the steps."""
    k = np.clip(np.searchsorted(ends, time, side="right") - 1, 0, len(ends) - 2)
    shape = (1, -1) + (1,) * (y.ndim - 2)
    h = (ends[k + 1] - ends[k]).reshape(shape)
    s = ((time - ends[k]).reshape(shape)) / h
    y0, y1, d0, d1 = y[:, k], y[:, k + 1], h * yd[:, k], h * yd[:, k + 1]
    rise = y1 - y0
    a, b = d0 + d1 - 2 * rise, 3 * rise - 2 * d0 - d1
    return y0 + s * (d0 + s * (b + s * a)), (d0 + s * (2 * b + s * 3 * a)) / h


@eqx.filter_jit
def _response(
    arm: Arm, machine: Machine, motion: Motion, loads: Loads | None, time: Array, y: Array, yd: Array, method: str
) -> Response:
    ones = tuple(range(2, machine.offset.ndim - 1))
    command = Command(*(jnp.expand_dims(part, ones) for part in motion(time)))
    rest = sag(arm, machine, command.q, loads)
    phi, v = bushings(machine, y), bushings(machine, yd)
    turning, still = (pins(machine, command, _deviation(machine, part)) for part in (y, rest))
    straight = pins(machine, command, _deviation(machine, jnp.zeros_like(rest))).pin.angle
    path = _end(machine, straight - turning.error, jnp.zeros_like(phi))
    return Response(
        time=time,
        posture=motion(time)[0],
        path=path[(..., *(0,) * len(ones))],
        displacement=_end(machine, turning.pin.angle, phi) - path,
        sag=_end(machine, still.pin.angle - still.error, bushings(machine, rest)) - path,
        phi=phi,
        moment=matvec(machine.stiffness, phi) + matvec(machine.damping, v),
        pulley=jnp.abs(turning.pulley.rate) / (2 * jnp.pi),
        angle=turning.pulley.angle,
        tension=None if ones else _tensions(machine, command, y, yd, turning),
        arrival=motion.arrival,
        method=method,
    )


def _end(machine: Machine, q: Array, phi: Array) -> Float[Array, "3 T *sets"]:
    return positions(machine, q, phi)[:, -1]


def _deviation(machine: Machine, y: Array, yd: Array | None = None) -> Turning:
    """Return the deviations of the pins from their commands, at rest unless their rates are given."""
    xi = deviations(machine, y)
    return Turning(xi, jnp.zeros_like(xi) if yd is None else deviations(machine, yd), jnp.zeros_like(xi))


def _tensions(machine: Machine, command: Command, y: Array, yd: Array, turning: Pins) -> Float[Array, "2 B T"]:
    """Return the tension of each span: from its stretch, or from the torque that a rigid belt has to carry."""
    if machine.loose:
        phi, xi, v, xi_dot = (part(machine, x) for x in (y, yd) for part in (bushings, deviations))

        def length(phi: Array, xi: Array) -> Array:
            return stretch(machine, phi, xi, turning.error)

        return tensions(machine, *jax.jvp(length, (phi, xi), (v, xi_dot)))
    if not machine.belts.ends:
        return jnp.zeros((2, 0, y.shape[1]))
    ydd = jax.lax.map(lambda now: exact.acceleration(machine, *now), _by_time(command, y, yd), batch_size=BATCH).T
    wanted = list(drive_torques(machine, command, y, yd, ydd) / machine.drives.ratio)
    half = {}
    for b in reversed(range(len(machine.belts.ends))):
        driver, driven = machine.belts.ends[b]
        half[b] = wanted[driven] / machine.belts.radius[1, b] / 2
        wanted[driver] = wanted[driver] + 2 * half[b] * machine.belts.radius[0, b]
    pull = jnp.stack([half[b] for b in range(len(half))])
    return machine.belts.pretension + jnp.stack([pull, -pull])


def _by_time(command: Command, y: Array, yd: Array) -> tuple[Command, Array, Array]:
    return Command(*(part.T for part in command)), y.T, yd.T
