"""What a simulation gives: how the end point vibrates, how the joints are loaded, and measures of it."""

from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from ident.arm.multibody import Multibody
from ident.jit import AnyArray, concrete, library
from ident.vibrate.motion.command import command
from ident.vibrate.motion.motion import Motion

Vibration = Float[AnyArray, "3 T *batch"]


class Pulleys(NamedTuple):
    """How the pulleys turn as commanded, `(driven, T)` each.

    Attributes:
        angle: against their shafts [rad]
        frequency: of turning, counted positive [Hz]
    """

    angle: Float[AnyArray, "driven T"]
    frequency: Float[AnyArray, "driven T"]


class Response(eqx.Module):
    """The response of an arm to a motion, sampled uniformly.

    Attributes:
        model: the multibody model of the arm under its load.
        motion: the commanded motion.
        time: (T,) [s]
        y: (n, T, *batch) coordinates, see `kinematics`.
        yd: (n, T, *batch) their rates [1/s]
        path: (3, T) [m] where the end point would be, were the joints rigid.
        displacement: (3, T, *batch) [m] of the end point from that path, in the base frame.
        quasi_static: (3, T, *batch) [m] quasi-static deflection, the part of it at static equilibrium.
        method: how it was computed.
        interrupted: [s] until when it was solved before the user stopped it; None if to the end.
    """

    model: Multibody
    motion: Motion
    time: Float[AnyArray, "T"]
    y: Float[AnyArray, "n T *batch"]
    yd: Float[AnyArray, "n T *batch"]
    path: Float[AnyArray, "3 T"]
    displacement: Vibration
    quasi_static: Vibration
    method: str = eqx.field(static=True)
    interrupted: float | None = eqx.field(static=True, default=None)

    @property
    def vibration(self) -> Vibration:
        """(3, T, *batch) [m] displacement of the end point from its quasi-static deflection."""
        return self.displacement - self.quasi_static

    @property
    def posture(self) -> Float[AnyArray, "driven T"]:
        """Commanded angles [rad]."""
        return self.motion(self.time)[0]

    @property
    def phi(self) -> Float[AnyArray, "3 N T *batch"]:
        """Rotation vectors of the bushings along their shafts' axes [rad]."""
        return self._by_bushing(self.y)

    @property
    def moment(self) -> Float[AnyArray, "3 N T *batch"]:
        """Moments of the bushings, stiffness and damping, along their shafts' axes [N m]."""
        D = concrete(self.model.damping)
        return self.spring_moment + (D * self._by_bushing(self.yd)).sum(1)

    @property
    def spring_moment(self) -> Float[AnyArray, "3 N T *batch"]:
        """The part of it that is stiffness [N m]."""
        straight = (concrete(self.model.stiffness) * self.phi).sum(1)
        if self.model.curved is None:
            return straight
        return straight + concrete(self.model.curved.torque(jnp.asarray(self.phi)))

    def _by_bushing(self, y: Float[AnyArray, "n T *batch"]) -> Float[AnyArray, "3 N T *batch"]:
        return y[: 3 * self.model.joints].reshape((-1, 3, *y.shape[1:])).swapaxes(0, 1)

    @property
    def pulley(self) -> Pulleys:
        """Angles [rad] and turning frequencies [Hz], counted positive, of the pulleys, `(driven, T)` each."""
        q, qd, _ = concrete(command(self.model, self.motion, self.time))
        ratio = concrete(self.model.drives.ratio)[np.asarray(self.model.driven)]
        angle, rate = (_first_of_batch(ratio * part) for part in (q, qd))
        return Pulleys(angle, library(rate).abs(rate) / (2 * np.pi))

    def after(self, time: float) -> Vibration:
        """Return the vibration from a time on."""
        return self.vibration[:, int(np.searchsorted(np.asarray(self.time), time - 1e-9)) :]


def _first_of_batch(x: Any) -> Float[AnyArray, "driven T"]:
    return x[(..., *(0,) * (x.ndim - 2))]


def peak(vibration: Vibration) -> Float[AnyArray, "3 *batch"]:
    """Return the largest magnitude in each direction [m]."""
    return library(vibration).abs(vibration).max(1)


def rms(vibration: Vibration) -> Float[AnyArray, "3 *batch"]:
    """Return the root mean square in each direction [m]."""
    return library(vibration).sqrt((vibration**2).mean(1))


def settling_time(response: Response, tolerance: float) -> Float[np.ndarray, "3 *batch"]:
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
