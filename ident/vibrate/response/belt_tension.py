"""The tension of the belts while the arm moves."""

from collections.abc import Iterator

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ident.arm.belts import stretch, tensions
from ident.arm.multibody import Multibody
from ident.arm.multibody_dynamics import drive_torques
from ident.arm.multibody_kinematics import Command, at_rest, bushings, deviations, pins
from ident.jit import jit
from ident.vibrate.motion.command import command
from ident.vibrate.response.exact import acceleration
from ident.vibrate.response.response import Response

BATCH = 256
"""Moments whose accelerations are found together."""


def belt_tension(response: Response) -> Float[Array, "2 B T"]:
    """Return the tension of upper and lower span of each belt [N]; a response of one set only.

    That of an elastic belt follows from its stretch and is never below zero. That of a rigid one is what it has to
    carry: the torque at the pulley that it drives, of the arm behind the harmonic drive and of the belts further out.
    Below zero, which no belt can do, the model does not hold.
    """
    machine, told = response.machine, command(response.machine, response.motion, response.time)
    of = _of_elastic_belts if machine.loose else _of_rigid_belts
    return of(machine, told, response.y, response.yd) if machine.belts.ends else jnp.zeros((2, 0, len(response.time)))


@jit
def _of_elastic_belts(machine: Multibody, told: Command, y: Array, yd: Array) -> Float[Array, "2 B T"]:
    error = pins(machine, told, at_rest(deviations(machine, y))).error

    def length(y: Array) -> Array:
        return stretch(machine, bushings(machine, y), deviations(machine, y), error)

    return tensions(machine, *jax.jvp(length, (y,), (yd,)))


@jit
def _of_rigid_belts(machine: Multibody, told: Command, y: Array, yd: Array) -> Float[Array, "2 B T"]:
    by_time = Command(*(part.T for part in told)), y.T, yd.T
    ydd = jax.lax.map(lambda now: acceleration(machine, *now), by_time, batch_size=BATCH).T
    torque = list(drive_torques(machine, told, y, yd, ydd) / machine.drives.ratio)
    pull = [jnp.zeros_like(torque[0])] * len(machine.belts.ends)
    for b, (driver, driven) in reversed(list(enumerate(machine.belts.ends))):
        pull[b] = torque[driven] / machine.belts.radius[1, b] / 2
        torque[driver] = torque[driver] + 2 * pull[b] * machine.belts.radius[0, b]
    return machine.belts.pretension + jnp.stack([jnp.stack(pull), -jnp.stack(pull)])


def slack(time: Float[Array, "T"], tension: Float[Array, "2 B T"]) -> Iterator[tuple[int, str, float, float]]:
    """Yield belt, span (`upper` or `lower`) and the times between which it pulls with nothing [s]."""
    loose, at = np.asarray(tension) <= 0, np.asarray(time)
    for span, belt in np.argwhere(loose.any(2)):
        edges = np.flatnonzero(np.diff(np.concatenate([[0], loose[span, belt].astype(int), [0]])))
        for first, end in edges.reshape(-1, 2):
            yield int(belt), ("upper", "lower")[span], float(at[first]), float(at[end - 1])
