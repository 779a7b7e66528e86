"""An arm carries out a motion: the one function that runs it and samples what happens."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache, partial
from typing import Any

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Bool, Float, Int

from ident.arm.arm import Arm, nominal
from ident.arm.chain import Loads
from ident.arm.multibody import Multibody, exciting_orders, has_transmission_error, multibody
from ident.errors import refusal
from ident.programs import RUNS_ONCE, AnyArray, concrete, jit, library
from ident.text import no_such
from ident.vibrate import exact, fast
from ident.vibrate.fast import (
    FastMethod,
    Solution,
    each_of,
    numbers_of,
    refuse_collapse,
    refuse_curved,
    samples_of,
    vibrations,
)
from ident.vibrate.linear import TURN, TURN_WITH_ERROR, filled_up, jumps_of, step_weights, time_intervals
from ident.vibrate.motion import Motion
from ident.vibrate.response import Response, peak, rms

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
        step: longest time step [s], which the exact method halves as needed; see `fast.step_for` when None.

    Raises:
        InputError: no such method, a rate or step out of range, an arm without a named point, the exact method for
            a batch, a motion whose speed jumps, or by the fast method curved springs that leave their tangents.
        ModelError: the arm collapses, or the tolerance cannot be met.
    """
    if method not in ("fast", "exact"):
        raise refusal("method", f"'{method}'", "fast or exact", "choose one")
    if method == "exact" and arm.batch:
        raise refusal("method", "exact for several sets", "one set", "simulate them one by one")
    _check(arm, rate, step)
    time, batch = sample_times(motion, rate), arm.batch
    if method == "exact":
        setup = partial(fast_method, arm, motion, loads, elastic_belts, rate)
        solution = exact.integrate(arm, motion, setup, min(step or np.inf, fast.step_for(arm, motion) / 2))
    else:
        solution = _whole(arm, batch, fast_method(arm, motion, loads, elastic_belts, rate, step))
        refuse_collapse(motion, solution.displacement)
        refuse_curved(arm, solution.missed)
    model = _multibody(arm, loads, 1 + len(batch), elastic_belts, has_transmission_error(arm))
    path = solution.path.reshape((3, len(time), -1))[..., 0]
    return Response(model, motion, time, *solution[:2], path, *solution[3:6], method)


def _whole(arm: Arm, batch: tuple[int, ...], solve: FastMethod) -> Solution:
    """Solve for an arm, and for each of its batch, whose axes come last."""
    numbers, xp = numbers_of(arm), library(arm)
    flat = {path: (xp.broadcast_to(x, batch) if batch else xp.asarray(x)).reshape(-1) for path, x in numbers.items()}
    if batch:
        solve = replace(solve, samples=samples_of(concrete(solve.motion), solve.samples.wanted, fast.FEW))
    solutions = each_of(nominal(arm) if batch else arm, flat, solve, FastMethod.solution)
    return jax.tree.map(lambda x: x.reshape((*x.shape[:-2], *batch)), solutions)


def fast_method(
    arm: Arm, motion: Motion, loads: Loads | None, elastic: bool, rate: float, step: float | None
) -> FastMethod:
    """Set up the fast method for a motion."""
    _check(arm, rate, step)
    refuse_jumps(arm, motion)
    time = sample_times(motion, rate)
    error, still = has_transmission_error(arm), arm if library(arm) is np else jax.lax.stop_gradient(arm)
    longest = fast.step_for(still, motion) if step is None else step  # which the grid does not depend on smoothly
    _refuse_short(float(time[-1] - time[0]), longest, step is None)
    breaks, c = (np.asarray(x, float) for x in (motion.breaks, motion.coefficients))
    known = _method(breaks.tobytes(), c.tobytes(), c.shape, rate, longest, error)
    return replace(known, loads=loads, elastic=elastic)


@lru_cache(maxsize=16)
def _method(
    breaks: bytes, coefficients: bytes, shape: tuple[int, ...], rate: float, step: float, error: bool
) -> FastMethod:
    """Set up the fast method for a motion by its numbers, once for all arms, without load and elastic belts."""
    motion = Motion("motion", np.frombuffer(breaks), np.frombuffer(coefficients).reshape(shape))
    time = sample_times(motion, rate)
    grid = time_intervals(motion, time[-1], step, turn=TURN_WITH_ERROR if error else TURN)
    padded = filled_up(motion), None, samples_of(motion, time), grid.filled_up(), step_weights(int(grid.steps))
    known = FastMethod(*padded, elastic=False, transmission_error=error)
    return fast.on_device(known)


def sample_times(motion: Motion, rate: float) -> Float[np.ndarray, "T"]:
    """Return uniform times from the first break of a motion to the last [s]."""
    start, end = float(motion.breaks[0]), float(motion.breaks[-1])
    _refuse_samples(motion, steps := np.floor((end - start) * rate + 1e-9), rate)  # of a whole number but for rounding
    return start + np.arange(int(steps) + 1) / rate


def _refuse_samples(motion: Motion, samples: float, rate: float) -> None:
    """Refuse a motion with one sample, or with more than can be computed, by what makes it so long."""
    if samples < 1:
        raise refusal("rate", f"{rate:g} samples a second, one in all", "two samples or more", "choose a higher rate")
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
    raise refusal("", got, f"at most {MOST_SAMPLES:,} samples".replace(",", " "), remedy, column)


def _refuse_short(seconds: float, step: float, needed: bool) -> None:
    """Refuse time steps so small that a motion would need too many of them."""
    if seconds <= MOST_STEPS * step:
        return
    got = f"steps of {step:.3g} s" + (", as its drives and frequencies ask for" if needed else "")
    got += f", {seconds / step:.3g} in all"
    remedy = "correct the arm's ratios and stiffnesses" if needed else "leave it out for one that fits"
    raise refusal("", got, f"at most {MOST_STEPS:,} steps".replace(",", " "), remedy, "" if needed else "step")


def _check(arm: Arm, rate: float, step: float | None) -> None:
    if not 1.0 <= rate <= 1e6:
        raise refusal("rate", f"{rate:g} samples a second", "1 to 1e6", "choose a rate as 500")
    if step is not None and not 0 < step < np.inf:
        raise refusal("step", f"{step:g} s", "a time above 0", "leave it out for one that fits")
    if not arm.points:
        raise refusal(arm.name, "no named point", "an end point", "add a [[point]] to the arm file")


def refuse_jumps(arm: Arm, motion: Motion) -> None:
    """Refuse a motion whose speed jumps, at its start too: no motor does that, and the shock would be missed."""
    first = np.abs(np.asarray(motion.coefficients)[-2:-1, 0])
    jumps = np.vstack([first, jumps_of(motion, 1)])
    piece, joint = np.unravel_index(np.argmax(jumps), jumps.shape)
    if jumps[piece, joint] > JUMP:
        name = arm.driven[joint].name if joint < len(arm.driven) else f"joint {joint + 1}"
        got = f"a jump of {name}'s speed by {np.rad2deg(jumps[piece, joint]):.4g} deg/s at {motion.breaks[piece]:.4g} s"
        remedy = "let a path begin at rest, and smooth a log (`smoothing`)"
        raise refusal(motion.name, got, "a motion from rest without such jumps", remedy)


@partial(jit, options=RUNS_ONCE)
def _multibody(arm: Arm, loads: Loads | None, rank: int, elastic: bool, error: bool) -> Multibody:
    """Return what `multibody` gathers, by one program."""
    return multibody(arm, loads, rank=rank, elastic_belts=elastic, transmission_error=error)


# -------- Amplitude
# How large a vibration is, as one number a direction, and as the largest of many: what sweeps and designs compare.

MEASURES = {
    "peak": "largest magnitude over the motion",
    "rms": "root mean square over the motion",
    "residual": "largest magnitude after arrival",
    "settled": "largest magnitude after the dwell",
}
AFTERWARDS = 2.0
"""Time [s] at the end of a motion that is after the dwell: a beat of two modes half a hertz apart; assumed."""
WINDOW = 0.1
"""Length [s] of the windows whose maxima a peak is the largest of; half a period of 4 to 5 Hz."""


class Amplitude(eqx.Module):
    """A measure of vibrations that are sampled at known times.

    Attributes:
        measure: a name in MEASURES.
        first: number of the sample from which on it counts.
        end: number of samples.
        window: samples of a window.
    """

    measure: str = eqx.field(static=True)
    first: Int[AnyArray, ""]
    end: Int[AnyArray, ""]
    window: int = eqx.field(static=True)

    def __call__(self, vibration: Float[np.ndarray, "3 T *batch"]) -> Float[np.ndarray, "3 *batch"]:
        """Return the amplitude in each direction [m]."""
        late = vibration[:, int(self.first) : int(self.end)]
        return np.asarray((rms if self.measure == "rms" else peak)(late))

    @property
    def count(self) -> int:
        """Number W of windows."""
        return 1 if self.measure == "rms" else -(-int(self.end - self.first) // self.window)


def amplitude(measure: str, motion: Motion, rate: float) -> Amplitude:
    """Return a measure for a motion sampled at a rate."""
    if measure not in MEASURES:
        raise no_such("", measure, MEASURES, "choose one of them", "measure")
    time, first = sample_times(motion, rate), 0
    if measure == "residual":
        first = int(np.searchsorted(time, motion.arrival - 1e-9))
        if first > len(time) - 2:
            raise refusal("", "a motion that ends at its arrival", "time after it", "hold the arm (`dwell`)", "measure")
    elif measure == "settled":
        first = int(np.searchsorted(time, float(motion.breaks[-1]) - AFTERWARDS - 1e-9))
    return Amplitude(measure, np.asarray(first), np.asarray(len(time)), max(1, round(WINDOW * rate)))


# -------- Superposition
# The vibration as a sum over what excites it, so that it is known for all phases of the imbalances at once.
#
# The fast method is linear: M d2x/dt2 + D dx/dt + K x = f (see `fast`), M, D and K without what excites. f is a sum of
#
# - what the motion itself asks for: -residual(y_r, dy_r/dt, d2y_r/dt2) without excitation;
# - the forces of each eccentric mass, linear in m e u(theta + psi) = m e (u(theta) cos psi + u(theta + pi/2) sin psi);
# - for each drive, `by_pin` times the deviation e sin(2 theta + chi) = e (sin 2 theta cos chi + cos 2 theta sin chi) of
#   its pin and its two rates, each of which is linear in e; likewise at its other orders.
#
# So the vibration is v = v0 + sum over the phases that are not known of c cos psi + s sin psi. U of them are
# determined by 2 U + 1 simulations: with all at 0, and with each alone at 90 and at 180 degrees. What is left out of
# the sum is the end point's arc, of x^2 over the length of the arm: 1e-4 of the vibration and less.
#
# The fast method itself neglects, for any phases, terms of second order:
#
# - of m e^2 what goes with twice the angle; the moment of inertia about the axis is there, as part of v0;
# - in the error's slope s = dq_pin/dtheta ratio = 1 + 2 ratio e cos(2 theta + chi), the square of s - 1 in centrifugal
#   terms, which is e [rad] of the term of the acceleration, 4 ratio^2 e (dq/dt)^2 (of another order, o for 2 and o^2
#   for 4); and M, D, K at the deviated pin;
# - with elastic belts, (s - 1) times the torque at the pin: by the slope alone it would turn the belt. With rigid ones
#   the pin's torque is the motor's, and nothing of first order is left out.

TOGETHER = 256
"""Times at which the vibration is computed together."""

Phases = Float[np.ndarray, "U *K"]
"""Phases [rad] of some drives' imbalance or transmission error."""


@dataclass(frozen=True)
class Superposition:
    """The vibration of the end point as a sum over what excites it.

    Attributes:
        time: (T,) [s]
        unknown: paths of the U phases of imbalance and transmission error that are not known.
        of_error: (U,) which of them are a transmission error's.
        sure: (3, T) [m] whatever they are: by the motion itself, and by what excites with known phases.
        cosine: (U, 3, T) [m] what each adds with its phase at 0,
        sine: (U, 3, T) [m] and at 90 degrees.
    """

    time: Float[np.ndarray, "T"]
    unknown: tuple[str, ...]
    of_error: Bool[np.ndarray, "U"]
    sure: Float[np.ndarray, "3 T"]
    cosine: Float[np.ndarray, "U 3 T"]
    sine: Float[np.ndarray, "U 3 T"]

    def since(self, first: int) -> "Superposition":
        """Return the same from a sample on."""
        parts = {name: getattr(self, name)[..., first:] for name in ("time", "sure", "cosine", "sine")}
        return replace(self, **parts)

    @cached_property
    def envelope(self) -> Float[np.ndarray, "3 T"]:
        """The largest magnitude over all phases at each time [m]: of each there are phases that reach it."""
        return np.asarray(largest_over_phases(self.sure, self.cosine, self.sine))

    @property
    def worst(self) -> Float[np.ndarray, "3"]:
        """The largest peak over all phases in each direction [m]."""
        return self.envelope.max(1)

    @property
    def division(self) -> Float[np.ndarray, "3 3"]:
        """What is sure, imbalance and transmission error (first axis) make of the worst in each direction [m]."""
        each = np.hypot(self.cosine, self.sine)
        parts = np.stack([np.abs(self.sure), each[~self.of_error].sum(0), each[self.of_error].sum(0)])
        return np.take_along_axis(parts, self.envelope.argmax(1)[None, :, None], 2)[..., 0]

    def peaks(
        self, phases: Float[np.ndarray, "U K"], factors: Float[np.ndarray, "U K"] | None = None
    ) -> Float[np.ndarray, "3 K"]:
        """Return the peak in each direction with each of some phases, and responses multiplied by factors [m].

        Times come in the order of what the vibration can be there, and end where it cannot be a peak.
        """
        factors = np.ones_like(phases) if factors is None else factors
        turns = np.concatenate([np.cos(phases) * factors, np.sin(phases) * factors])
        bounds = np.abs(self.sure) + np.tensordot(np.abs(factors).max(1), np.hypot(self.cosine, self.sine), 1)
        bounds = np.nan_to_num(bounds, nan=np.inf)  # first in order, and in the peak
        peaks = np.zeros((3, phases.shape[1]))
        for way in range(3):
            order, parts = np.argsort(-bounds[way]), np.concatenate([self.cosine[:, way], self.sine[:, way]])
            for first in range(0, len(order), TOGETHER):
                some = order[first : first + TOGETHER]
                if bounds[way, some[0]] < peaks[way].min():
                    break
                vibration = self.sure[way, some, None] + parts[:, some].T @ turns
                peaks[way] = np.maximum(peaks[way], np.abs(vibration).max(0))
        return peaks

    def worst_phases(self, first: int = 0, direction: int | None = None) -> dict[str, float]:
        """Return phases, by path, with which the worst peak is reached [rad].

        Args:
            first: number of the sample from which on it counts.
            direction: of the peak; that of the largest when None.
        """
        late = self.envelope[:, first:]
        way = int(late.max(1).argmax()) if direction is None else direction
        place = first + int(late[way].argmax())
        sign = 1.0 if self.sure[way, place] >= 0 else -1.0
        cosine, sine = (sign * part[:, way, place] for part in (self.cosine, self.sine))
        return dict(zip(self.unknown, np.arctan2(sine, cosine).tolist(), strict=True))


def superposition(
    arm: Arm,
    motion: Motion,
    unknown: Sequence[str],
    *,
    loads: Loads | None = None,
    elastic_belts: bool = False,
    rate: float = RATE,
    step: float | None = None,
    measured: bool = False,
) -> Superposition:
    """Return the vibration over a motion by what excites it, with the fast method.

    Args:
        arm: the arm, without batch axes.
        motion: the commanded motion, its pauses included.
        unknown: paths of the phases of imbalance and transmission error that are not known.
        loads: what hangs on the arm.
        elastic_belts: whether belts stretch.
        rate: samples a second.
        step: longest time step [s]; see `fast.step_for` when None.
        measured: whether what the transmission error does to the arm at rest counts, as for a sensor.

    Raises:
        InputError: see `simulate`.
        ModelError: the arm collapses.
    """
    solve = replace(fast_method(arm, motion, loads, elastic_belts, rate, step), measured=measured)
    numbers = {path: np.asarray(x)[None] for path, x in numbers_of(arm).items()}
    members = np.asarray(vibrations(arm, numbers, solve, sets_of(unknown)))[..., 0]
    refuse_collapse(motion, members)
    errors = {each.phase for each in exciting_orders(arm) if each.of_error}
    of_error = np.array([path in errors for path in unknown], bool)
    return Superposition(solve.samples.wanted, tuple(unknown), of_error, *parts_of(members))


def sets_of(unknown: Sequence[str]) -> list[dict[str, float]]:
    """Return the phases [rad] of the simulations that determine a sum: all at 0, then each alone at 90, at 180 degrees.

    Without unknown phases it is the arm as it is.
    """
    alone = [dict.fromkeys(unknown, 0.0) | {path: turn} for turn in (np.pi / 2, np.pi) for path in unknown]
    return [dict.fromkeys(unknown, 0.0), *alone]


def parts_of(members: Float[np.ndarray, "*shape members"]) -> tuple[Any, Any, Any]:
    """Return the known part `(*shape)`, and each phase's parts of cosine and sine `(U, *shape)`, see `sets_of`."""
    count = (members.shape[-1] - 1) // 2
    first, quarter, half = (np.moveaxis(x, -1, 0) for x in np.split(members, (1, 1 + count), -1))
    cosine = (first - half) / 2
    return first[0] - cosine.sum(0), cosine, quarter - first + cosine


def largest_over_phases(sure: Any, cosine: np.ndarray, sine: np.ndarray) -> Any:
    """Return the envelope of a `Superposition`."""
    return np.abs(sure) + np.hypot(cosine, sine).sum(0)


def rms_over_phases(sure: Any, cosine: np.ndarray, sine: np.ndarray) -> Any:
    """Return the root mean square over the phases at each time."""
    return np.sqrt(sure**2 + (cosine**2 + sine**2).sum(0) / 2)
