"""What a simulation gives: how the end point vibrates, how the joints are loaded, and measures of it."""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from ident.arm.arm import Arm
from ident.arm.chain import Loads
from ident.arm.linalg import solve_positive
from ident.arm.multibody import (
    Command,
    Multibody,
    at_rest,
    bushing_rotations,
    deviations,
    drive_torques,
    end_point,
    kinematics,
    mass_and_forces,
    multibody,
    of_joints,
    pins,
    stretch,
    tensions,
)
from ident.arm.rotations import matvec
from ident.errors import refusal
from ident.programs import AnyArray, concrete, in_batches, jit, library
from ident.vibrate.linear import quasi_static_deflection
from ident.vibrate.motion import Motion, command

Vibration = Float[AnyArray, "3 T *batch"]


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
        gear_error: (3, T, *batch) [m] the part of it that the transmission error makes at rest, at any speed.
        method: how it was computed.
    """

    model: Multibody
    motion: Motion
    time: Float[AnyArray, "T"]
    y: Float[AnyArray, "n T *batch"]
    yd: Float[AnyArray, "n T *batch"]
    path: Float[AnyArray, "3 T"]
    displacement: Vibration
    quasi_static: Vibration
    gear_error: Vibration
    method: str = eqx.field(static=True)

    @property
    def vibration(self) -> Vibration:
        """(3, T, *batch) [m] displacement of the end point from its quasi-static position, as its gears err at rest."""
        return self.measured - self.gear_error

    @property
    def measured(self) -> Vibration:
        """(3, T, *batch) [m] displacement from the quasi-static deflection, as a sensor sees it."""
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
        """Moments by stiffness and damping times, along the shafts' axes [N m]; those by loss factors are left out."""
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
    def pulley(self) -> tuple[Float[AnyArray, "driven T"], Float[AnyArray, "driven T"]]:
        """Angles [rad] and turning frequencies [Hz], counted positive, of the pulleys, `(driven, T)` each."""
        q, qd, _ = concrete(command(self.model, self.motion, self.time))
        ratio = concrete(self.model.drives.ratio)[np.asarray(self.model.driven)]
        angle, rate = ratio * q, ratio * qd
        first_of_batch = (..., *(0,) * (angle.ndim - 2))
        return angle[first_of_batch], library(rate).abs(rate[first_of_batch]) / (2 * np.pi)

    def after(self, time: float) -> Vibration:
        """Return the vibration from a time on."""
        return self.vibration[:, int(np.searchsorted(np.asarray(self.time), time - 1e-9)) :]


def peak(vibration: Vibration) -> Float[AnyArray, "3 *batch"]:
    """Return the largest magnitude in each direction [m]."""
    return library(vibration).abs(vibration).max(1)


def rms(vibration: Vibration) -> Float[AnyArray, "3 *batch"]:
    """Return the root mean square in each direction [m]."""
    return library(vibration).sqrt((vibration**2).mean(1))


@jit
def gear_error(arm: Arm, postures: Float[AnyArray, "driven T"]) -> Float[Array, "3 T"]:
    """Return how far transmission errors move the end point of the resting arm [m], with their worst phases."""
    model = multibody(arm, rank=1)
    q, amplitude = of_joints(model, jnp.asarray(postures)), jnp.abs(jnp.stack(model.drives.error)).sum(0)
    each = [end_point(model, q.at[joint].add(amplitude[joint])) for joint in range(model.joints)]
    return jnp.abs(jnp.stack(each) - end_point(model, q)).sum(0)


# -------- Belt tension
# The tension of the belts while the arm moves.

BATCH = 256
"""Times whose accelerations are computed together."""
TOGETHER = 4 * BATCH
"""Times that one call takes."""


def belt_tension(response: Response) -> Float[np.ndarray, "2 B T"]:
    """Return the tension of upper and lower span of each belt [N]; a single response, without batch axes.

    That of an elastic belt follows from its stretch and is never below zero. That of a rigid one is what it has to
    carry: the torque at the pulley that it drives, of the arm behind the harmonic drive and of the belts further out.
    Below zero, which no belt can do, the model does not hold.
    """
    model, count = response.model, len(response.time)
    if not model.belts.ends:
        return np.zeros((2, 0, count))
    of = _of_elastic_belts if model.belt_driven else _of_rigid_belts
    commanded = command(model, response.motion, response.time)
    states = concrete((commanded, response.y, response.yd))
    return np.asarray(in_batches(lambda some: of(model, *some), states, TOGETHER))


@jit
def _of_elastic_belts(model: Multibody, commanded: Command, *state: AnyArray) -> Float[Array, "2 B T"]:
    y, yd = map(jnp.asarray, state)
    error = pins(model, commanded, at_rest(deviations(model, y))).error

    def length(y: Array) -> Array:
        return stretch(model, bushing_rotations(model, y), deviations(model, y), error)

    return tensions(model, *jax.jvp(length, (y,), (yd,)))


@jit
def _of_rigid_belts(model: Multibody, commanded: Command, *state: AnyArray) -> Float[Array, "2 B T"]:
    y, yd = map(jnp.asarray, state)
    by_time = Command(*(part.T for part in commanded)), y.T, yd.T

    def acceleration(now: tuple[Command, Array, Array]) -> Array:
        M, h = mass_and_forces(model, *now)
        return solve_positive(M, -h)

    ydd = jax.lax.map(acceleration, by_time, batch_size=BATCH).T
    torque = list(drive_torques(model, commanded, y, yd, ydd) / model.drives.ratio)
    tension = [jnp.zeros_like(torque[0])] * len(model.belts.ends)
    for b, (driver, driven) in reversed(list(enumerate(model.belts.ends))):
        tension[b] = torque[driven] / model.belts.radius[1, b] / 2
        torque[driver] = torque[driver] + 2 * tension[b] * model.belts.radius[0, b]
    return model.belts.pretension + jnp.stack([jnp.stack(tension), -jnp.stack(tension)])


def slack(time: Float[AnyArray, "T"], tension: Float[AnyArray, "2 B T"]) -> Iterator[tuple[int, str, float, float]]:
    """Yield belt, span (`upper` or `lower`) and the times between which its tension is zero [s]."""
    is_slack, at = np.asarray(tension) <= 0, np.asarray(time)
    for span, belt in np.argwhere(is_slack.any(2)):
        for first, last in runs(is_slack[span, belt]):
            yield int(belt), ("upper", "lower")[span], float(at[first]), float(at[last])


def runs(mask: Bool[np.ndarray, "T"]) -> Iterator[tuple[int, int]]:
    """Yield the first and the last place of each run of true values."""
    ends = np.flatnonzero(np.diff(mask.astype(int), prepend=0, append=0))
    yield from zip(ends[::2].tolist(), (ends[1::2] - 1).tolist(), strict=True)


def refuse_slack(response: Response, names: Sequence[str]) -> None:
    """Refuse a response on elastic belts with a slack span, which the linear equations of the fast method have pull on.

    Args:
        response: a single response.
        names: of the belts.

    Raises:
        InputError: some span is slack.
    """
    first = min(slack(response.time, belt_tension(response)), key=lambda span: span[2], default=None)
    if response.model.elastic and first is not None:
        belt, span, start, _ = first
        got = f"the {span} span of {names[belt]} slack at {start:.4g} s"
        remedy = "simulate it with `method` exact, raise the pretension, or take the belts as rigid"
        raise refusal("elastic_belts", got, "belts under tension, for the fast method", remedy)


# -------- Outline
# The arm at work as a line through its bushings, its vibration made larger than it is.


class Outline(NamedTuple):
    """An arm at some moments, as a line from bushing to bushing and to the end point.

    Attributes:
        time: (F,) [s]
        rest: (3, K, F) [m] where the sagging arm would be.
        drawn: (3, K, F) [m] the arm with its vibration, times the factor.
        factor: () [-] exaggeration of the drawn vibration.
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
        raise refusal("response", f"{response.y.shape[2:]} sets", "one set", "simulate one arm")
    slack = clock[1] - clock[0]
    if moments.ndim != 1 or not len(moments) or moments.min() < clock[0] - slack or moments.max() > clock[-1] + slack:
        expected = f"moments from {clock[0]:.4g} to {clock[-1]:.4g} s"
        raise refusal("times", "moments outside the response, or none", expected, "choose others")
    if not 0 < factor < np.inf:
        raise refusal("factor", f"{factor:g}", "a factor above 0", "1 draws the vibration as it is")
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

    def line(y: Array) -> Array:
        phi = bushing_rotations(model, y)
        angle = pins(model, commanded, at_rest(deviations(model, y))).pin.angle
        at = kinematics(model, at_rest(angle), phi, jnp.zeros_like(phi), jnp.zeros_like(phi))
        body = model.carrier[-1]
        end = at.centre[:, body] + matvec(at.link[:, :, body], model.position[:, -1])
        return jnp.concatenate([at.centre, end[:, None]], 1)

    return line(quasi_static_deflection(arm, model, commanded.q, loads)), line(y_now)
