"""What a simulation gives: how the end point vibrates, how joints and belts are loaded, and measures of it."""

from collections.abc import Iterator

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

Vibration = Float[Array, "3 T *sets"]


class Response(eqx.Module):
    """The response of an arm to a motion, sampled uniformly.

    Attributes:
        time: (T,) [s]
        posture: (driven, T) [rad] angles that the motors are told.
        path: (3, T) [m] where the end point would be, were the joints rigid.
        displacement: (3, T, *sets) [m] of the end point from that path, in the base frame.
        sag: (3, T, *sets) [m] the part of it that the arm would have at rest in the posture of the moment.
        phi: (3, N, T, *sets) [rad] rotation vectors of the bushings along their shafts' axes.
        moment: (3, N, T, *sets) [N m] moments of the bushings along their shafts' axes.
        pulley: (N, T) [Hz] turning frequencies of the pulleys, counted positive.
        angle: (N, T) [rad] angles of the pulleys.
        tension: (2, B, T) [N] of upper and lower span of each belt; None where there are several sets.
        arrival: [s] when the motion ends.
        method: how it was computed.
    """

    time: Float[Array, "T"]
    posture: Float[Array, "driven T"]
    path: Float[Array, "3 T"]
    displacement: Vibration
    sag: Vibration
    phi: Float[Array, "3 N T *sets"]
    moment: Float[Array, "3 N T *sets"]
    pulley: Float[Array, "N T"]
    angle: Float[Array, "N T"]
    tension: Float[Array, "2 B T"] | None
    arrival: float = eqx.field(static=True)
    method: str = eqx.field(static=True)

    @property
    def vibration(self) -> Vibration:
        """(3, T, *sets) [m] displacement of the end point from where the sagging arm would be."""
        return self.displacement - self.sag

    def after(self, time: float) -> Vibration:
        """Return the vibration from a time on."""
        return self.vibration[:, int(np.searchsorted(np.asarray(self.time), time - 1e-9)) :]


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
    late = time >= response.arrival - 1e-9
    beyond = np.abs(np.asarray(response.vibration)[:, late]) > tolerance
    last = beyond.shape[1] - 1 - np.argmax(beyond[:, ::-1], 1)
    after = np.append(time[late], np.inf)[last + 1] - response.arrival
    return np.where(beyond.any(1), after, 0.0)


def slack(response: Response) -> Iterator[tuple[int, int, float, float]]:
    """Yield belt, span (0 upper, 1 lower) and the times between which it hangs slack [s]."""
    if response.tension is None:
        return
    loose = np.asarray(response.tension) <= 0
    for span, belt in np.argwhere(loose.any(2)):
        edges = np.flatnonzero(np.diff(np.concatenate([[0], loose[span, belt].astype(int), [0]])))
        for first, end in edges.reshape(-1, 2):
            yield int(belt), int(span), float(response.time[first]), float(response.time[end - 1])
