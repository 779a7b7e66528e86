"""When the end has settled: by the envelope of its free decay after the arrival, followed for as long as it takes.

The held arm is linear: each direction of the vibration is v(t) = c + Re sum over the poles of a e^(s t), t from the
arrival, with the poles s of M s^2 + D s + K at the end posture and c what rests, by the weight of the eccentric masses.
The amplitudes a follow from the samples after the arrival by least squares, which needs some of them, not all of the
decay. The envelope |c| + sum of |a| e^(Re s t) bounds |v| and only falls: the time at which it meets a value does not
jump from one maximum of the vibration to the next.

References:
    Ewins, "Modal Testing", 2nd ed., 2000, section 2.7 (free decay of a system with viscous damping).
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex, Float

from ident.arm.arm import Arm, nominal
from ident.arm.chain import Loads
from ident.arm.multibody import Command, Multibody, balanced, multibody
from ident.programs import AnyArray, in_batches, jit
from ident.vibrate.linear import matrices, quasi_static_deflection
from ident.vibrate.motion import Motion
from ident.vibrate.response import Response
from ident.vibrate.simulate import Superposition

WATCHED = 1.0
"""Least time [s] after the arrival from which a decay is known: four periods of a mode of 4 Hz; assumed."""
BATCH = 16
"""Arms whose poles are computed together."""
HALVINGS = 60
"""Halvings of the time in which the envelope meets a value: to the last digit."""


Poles = Complex[np.ndarray, "modes *arms"]
"""Poles s [rad/s], one of each conjugate pair, NaN for the other."""
Matrices = Float[np.ndarray, "n n K"]


class Decay(NamedTuple):
    """Free vibrations after the arrival, in some directions, and of K arms or phases.

    Attributes:
        rate: (R, *#K) [1/s] at which each mode decays, -Re s.
        size: (3, R, *K) [m] amplitude |a| of each at the arrival.
        rest: (3, *K) [m] magnitude of what stays.
    """

    rate: Float[np.ndarray, "R *#K"]
    size: Float[np.ndarray, "3 R *K"]
    rest: Float[np.ndarray, "3 *K"]

    def envelope(self, time: Float[np.ndarray, "*#K"] | float) -> Float[np.ndarray, "3 *K"]:
        """Return the envelope at times [s] after the arrival [m]."""
        return np.asarray(self.rest + (self.size * np.exp(-self.rate * time)[None]).sum(1))

    def settled(self, value: float) -> Float[np.ndarray, "3 *K"]:
        """Return how long after the arrival the envelope meets a value [m] in each direction [s]; infinite where never.

        Bisected: the envelope falls. Each of R modes is below its share of the value at the upper end.
        """
        room = np.maximum(value - self.rest, 0.0)[:, None]
        with np.errstate(divide="ignore", invalid="ignore"):
            each = np.log(np.maximum(self.size * self.size.shape[1] / room, 1.0)) / self.rate
        high = np.nan_to_num(each, nan=0.0, posinf=np.inf).max(1)
        low, ends = np.zeros_like(high), np.isfinite(high)
        high = np.where(ends, high, 0.0)
        for _ in range(HALVINGS):
            middle = (low + high) / 2
            above = self.rest + (self.size * np.exp(-self.rate * middle[:, None])).sum(1) > value
            low, high = np.where(above, middle, low), np.where(above, high, middle)
        return np.where(self.envelope(0.0) <= value, 0.0, np.where(ends, high, np.inf))


@jit
def _held(model: Multibody, posture: AnyArray, y: AnyArray) -> tuple[Array, Array, Array]:
    """Return M, D, K (n, n, *batch) of an arm that is held in a posture (driven, *#batch), about coordinates y."""
    still = Command(posture, *(jnp.zeros_like(posture),) * 2)
    M, D, K, lost = matrices(balanced(model), still, jnp.asarray(y))
    return M, D if lost is None else D + lost, K


@jit
def _at_rest(arm: Arm, posture: Float[AnyArray, "driven 1"], loads: Loads | None) -> tuple[Array, Array, Array]:
    """Return the same (n, n, K) of K arms that rest in a posture, on rigid belts."""
    model = multibody(arm, loads, rank=1)
    return _held(model, posture, quasi_static_deflection(arm, model, posture, loads))


def poles_at(arm: Arm, motion: Motion, loads: Loads | None = None) -> Poles:
    """Return the poles s [rad/s] of K arms, or of one, where a motion ends, see `poles_of`."""
    posture = np.asarray(motion(motion.breaks[-1:])[0])
    numbers = {path: np.broadcast_to(x, arm.batch or (1,)) for path, x in arm.numbers().items()}
    return poles_of(*in_batches(lambda some: _at_rest(nominal(arm).replace(some), posture, loads), numbers, BATCH))


def poles_of(M: Matrices, D: Matrices, K: Matrices) -> Poles:
    """Return the 2 n poles s [rad/s] of M s^2 + D s + K for each of K sets, ascending in magnitude.

    One of each pair: the other one is NaN. Both of two real ones stay.
    """
    M, D, K = (np.moveaxis(np.asarray(part), -1, 0) for part in (M, D, K))
    unit = np.broadcast_to(np.eye(M.shape[1]), M.shape)
    s = np.linalg.eigvals(np.block([[0 * unit, unit], [-np.linalg.solve(M, K), -np.linalg.solve(M, D)]])).T
    s = np.take_along_axis(s, np.argsort(np.abs(s), 0), 0)
    return np.asarray(np.where(s.imag < 0, np.nan, s))


def amplitudes(
    time: Float[np.ndarray, "T"], vibration: Float[np.ndarray, "3 T *K"], poles: Poles
) -> tuple[Complex[np.ndarray, "3 modes *K"], Float[np.ndarray, "3 *K"]]:
    """Return the amplitudes a of a free decay, and what rests [m], by least squares.

    Poles beyond half of the Nyquist frequency have none: samples do not tell them apart, and they decay at once.

    Args:
        time: [s] uniform, after the arrival.
        vibration: [m] of one arm.
        poles: [rad/s] of that arm, see `poles_of`.
    """
    slow = np.flatnonzero(np.abs(poles) < np.pi / 2 / (time[1] - time[0]))
    wave = np.exp(poles[slow] * time[:, None])
    columns = np.concatenate([wave.real, -wave.imag, np.ones((len(time), 1))], 1)
    sampled = np.moveaxis(vibration, 1, 0)
    found = np.linalg.lstsq(columns, sampled.reshape((len(time), -1)), rcond=None)[0].reshape((-1, *sampled.shape[1:]))
    a = np.zeros((len(poles), *sampled.shape[1:]), complex)
    a[slow] = found[: len(slow)] + 1j * found[len(slow) : -1]
    return np.moveaxis(a, 0, 1), found[-1]


def free_decay(time: np.ndarray, arrival: float, vibration: Float[np.ndarray, "3 T K"], poles: Poles) -> Decay:
    """Return the decay of K arms, each with its poles, from samples of a motion and the time after it.

    Args:
        time: (T,) [s] uniform.
        arrival: [s]; from then on the arm is held.
        vibration: [m]
        poles: [rad/s]
    """
    late = int(np.searchsorted(time, arrival - 1e-9))
    each = [amplitudes(time[late:] - arrival, vibration[:, late:, k], poles[:, k]) for k in range(vibration.shape[2])]
    a, rest = (np.stack(part, -1) for part in zip(*each, strict=True))
    return Decay(_rates(poles), np.abs(a), np.abs(rest))


def _rates(poles: Poles) -> Float[np.ndarray, "modes *arms"]:
    return np.asarray(np.where(np.isnan(poles), 1.0, np.maximum(-poles.real, 0.0)))


def largest_decay(whole: Superposition, arrival: float, poles: Poles) -> Decay:
    """Return the decay of one arm with, for each mode by itself, the phases that make it largest: a bound."""
    late = int(np.searchsorted(whole.time, arrival - 1e-9))
    parts = np.concatenate([whole.sure[None], whole.cosine, whole.sine])[:, :, late:]
    a, rest = amplitudes(whole.time[late:] - arrival, np.moveaxis(parts, 0, -1), poles)
    sure, cosine, sine = (np.moveaxis(x, -1, 0) for x in np.split(a, (1, 1 + len(whole.cosine)), -1))
    turning = (np.abs(cosine + 1j * sine) + np.abs(cosine - 1j * sine)) / 2
    still = np.split(rest, (1, 1 + len(whole.cosine)), -1)
    size, stays = np.abs(sure[0]) + turning.sum(0), np.abs(still[0][:, 0]) + np.hypot(*still[1:]).sum(-1)
    return Decay(_rates(poles)[:, None], size[..., None], stays[..., None])


def decay_of(response: Response) -> Decay | None:
    """Return the decay of a response, its batch on one axis; None where the arm is held for less than `WATCHED`."""
    time, arrival, motion = np.asarray(response.time), response.motion.arrival, response.motion
    if time[-1] < arrival + WATCHED - 1e-9:
        return None
    y, vibration = np.asarray(response.y)[:, -1:], np.asarray(response.vibration)
    posture = np.asarray(motion(time[-1:])[0]).reshape((-1, *(1,) * (y.ndim - 1)))
    found = [np.asarray(part).reshape((*part.shape[:2], -1)) for part in _held(response.model, posture, y)]
    return free_decay(time, arrival, vibration.reshape((*vibration.shape[:2], -1)), poles_of(*found))


def settling_time(response: Response, value: float, damping: float = 1.0) -> Float[np.ndarray, "3 *batch"]:
    """Return the time [s] from the start of a motion until each direction stays below a value [m] for good.

    That of the arrival at the earliest; infinite where what rests is beyond the value, NaN where the arm is held for
    less than `WATCHED`. The decay may count as faster by a factor, with the same vibration at the arrival.
    """
    shape, decay = (3, *response.vibration.shape[2:]), decay_of(response)
    if decay is None:
        return np.full(shape, np.nan)
    after = decay._replace(rate=damping * decay.rate).settled(value)
    return (response.motion.arrival - float(response.time[0]) + after).reshape(shape)
