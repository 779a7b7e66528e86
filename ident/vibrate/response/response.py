"""What a simulation gives: how the end point vibrates, how the joints are loaded, and measures of it."""

from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ident.arm.multibody import Multibody
from ident.arm.multibody_kinematics import bushings
from ident.arm.rotations import matvec
from ident.vibrate.motion.command import command
from ident.vibrate.motion.motion import Motion

Vibration = Float[Array, "3 T *sets"]


class Pulleys(NamedTuple):
    """How the pulleys turn as they are told, `(driven, T)` each.

    Attributes:
        angle: against their shafts [rad]
        frequency: of turning, counted positive [Hz]
    """

    angle: Float[Array, "driven T"]
    frequency: Float[Array, "driven T"]


class Response(eqx.Module):
    """The response of an arm to a motion, sampled uniformly.

    Attributes:
        machine: the arm under its load.
        motion: what the motors were told.
        time: (T,) [s]
        y: (n, T, *sets) coordinates, see `kinematics`.
        yd: (n, T, *sets) their rates [1/s]
        path: (3, T) [m] where the end point would be, were the joints rigid.
        displacement: (3, T, *sets) [m] of the end point from that path, in the base frame.
        sag: (3, T, *sets) [m] the part of it that the arm would have at rest in the posture of the moment.
        method: how it was computed.
    """

    machine: Multibody
    motion: Motion
    time: Float[Array, "T"]
    y: Float[Array, "n T *sets"]
    yd: Float[Array, "n T *sets"]
    path: Float[Array, "3 T"]
    displacement: Vibration
    sag: Vibration
    method: str = eqx.field(static=True)

    @property
    def vibration(self) -> Vibration:
        """(3, T, *sets) [m] displacement of the end point from where the sagging arm would be."""
        return self.displacement - self.sag

    @property
    def posture(self) -> Float[Array, "driven T"]:
        """Angles that the motors are told [rad]."""
        return self.motion(self.time)[0]

    @property
    def phi(self) -> Float[Array, "3 N T *sets"]:
        """Rotation vectors of the bushings along their shafts' axes [rad]."""
        return bushings(self.machine, self.y)

    @property
    def moment(self) -> Float[Array, "3 N T *sets"]:
        """Moments of the bushings, stiffness and damping, along their shafts' axes [N m]."""
        rate = bushings(self.machine, self.yd)
        return matvec(self.machine.stiffness, self.phi) + matvec(self.machine.damping, rate)

    @property
    def pulley(self) -> Pulleys:
        """Angles [rad] and turning frequencies [Hz], counted positive, of the pulleys, `(driven, T)` each."""
        q, qd, _ = command(self.machine, self.motion, self.time)
        ratio = self.machine.drives.ratio[np.asarray(self.machine.driven)]
        angle, rate = (_first_set(ratio * part) for part in (q, qd))
        return Pulleys(angle, jnp.abs(rate) / (2 * jnp.pi))

    def after(self, time: float) -> Vibration:
        """Return the vibration from a time on."""
        return self.vibration[:, int(np.searchsorted(np.asarray(self.time), time - 1e-9)) :]


def _first_set(x: Array) -> Float[Array, "driven T"]:
    return x[(..., *(0,) * (x.ndim - 2))]


def peak(vibration: Vibration) -> Float[Array, "3 *sets"]:
    """Return the largest magnitude in each direction [m]."""
    return jnp.abs(vibration).max(1)


def rms(vibration: Vibration) -> Float[Array, "3 *sets"]:
    """Return the root mean square in each direction [m]."""
    return jnp.sqrt((vibration**2).mean(1))


def settling_time(response: Response, tolerance: float) -> Float[np.ndarray, "3 *sets"]:
    """Return how long after arrival each direction stays beyond the tolerance [m] for the last time [s].

    Infinite where the response ends before it stays within.
    """
    time = np.asarray(response.time)
    late = time >= response.motion.arrival - 1e-9
    if not late.any():
        return np.full(response.vibration.shape[:1] + response.vibration.shape[2:], np.inf)
    beyond = np.abs(np.asarray(response.vibration)[:, late]) > tolerance
    last = beyond.shape[1] - 1 - np.argmax(beyond[:, ::-1], 1)
    after = np.append(time[late], np.inf)[last + 1] - response.motion.arrival
    return np.where(beyond.any(1), after, 0.0)
