"""The arm at work as a line through its bushings, its vibration made larger than it is."""

from collections.abc import Sequence
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ident.arm.arm import Arm
from ident.arm.chain import Loads
from ident.arm.multibody import Multibody
from ident.arm.multibody_kinematics import at_rest, bushing_rotations, deviations, kinematics, pins
from ident.arm.rotations import matvec
from ident.errors import InputError, Problem
from ident.jit import AnyArray, jit
from ident.vibrate.motion.command import command
from ident.vibrate.motion.motion import Motion
from ident.vibrate.response.quasi_static import quasi_static_deflection
from ident.vibrate.response.response import Response


class Outline(NamedTuple):
    """An arm at some moments, as a line from bushing to bushing and to the end point.

    Attributes:
        time: (F,) [s]
        rest: (3, K, F) [m] where the sagging arm would be.
        drawn: (3, K, F) [m] the arm with its vibration, times the factor.
        factor: () [-] by which the vibration is drawn larger than it is.
    """

    time: Float[np.ndarray, "F"]
    rest: Float[np.ndarray, "3 K F"]
    drawn: Float[np.ndarray, "3 K F"]
    factor: float


def outline(
    arm: Arm, response: Response, times: Sequence[float] | np.ndarray, *, factor: float, loads: Loads | None = None
) -> Outline:
    """Return the arm at some moments of its response, its vibration about the sagging arm made larger.

    Args:
        arm: the arm that was simulated, without sets.
        response: its response.
        times: (F,) [s] moments; the nearest samples are taken.
        factor: () [-] of the vibration, above 0.
        loads: the load case that was simulated.
    """
    clock, moments = np.asarray(response.time), np.asarray(times, float)
    if response.y.ndim > 2:
        raise InputError(Problem("response", f"{response.y.shape[2:]} sets", "one set", "simulate one arm"))
    slack = clock[1] - clock[0]
    if moments.ndim != 1 or not len(moments) or moments.min() < clock[0] - slack or moments.max() > clock[-1] + slack:
        expected = f"moments from {clock[0]:.4g} to {clock[-1]:.4g} s"
        raise InputError(Problem("times", "moments outside the response, or none", expected, "choose others"))
    if not 0 < factor < np.inf:
        raise InputError(Problem("factor", f"{factor:g}", "a factor above 0", "1 draws the vibration as it is"))
    at = np.clip(np.round((moments - clock[0]) / slack).astype(int), 0, len(clock) - 1)
    lines = _lines(arm, response.model, response.motion, clock[at], response.y[:, at], loads)
    rest, moved = (np.asarray(line) for line in lines)
    return Outline(clock[at], rest, rest + factor * (moved - rest), float(factor))


@jit
def _lines(
    arm: Arm, model: Multibody, motion: Motion, times: Float[AnyArray, "F"], y: AnyArray, loads: Loads | None
) -> tuple[Float[Array, "3 K F"], Float[Array, "3 K F"]]:
    """Return bushing centres and end point of the arm at rest in the posture of the moment, and as it vibrates [m]."""
    commanded, y_now = command(model, motion, times), jnp.asarray(y)

    def line(y: Array, error: float) -> Array:
        phi = bushing_rotations(model, y)
        turning = pins(model, commanded, at_rest(deviations(model, y)))
        angle = turning.pin.angle - (1 - error) * turning.error
        at = kinematics(model, at_rest(angle), phi, jnp.zeros_like(phi), jnp.zeros_like(phi))
        body = model.carrier[-1]
        end = at.centre[:, body] + matvec(at.link[:, :, body], model.position[:, -1])
        return jnp.concatenate([at.centre, end[:, None]], 1)

    return line(quasi_static_deflection(arm, model, commanded.q, loads), 0.0), line(y_now, 1.0)
