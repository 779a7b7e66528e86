"""The equations of motion linearised about the quasi-static deflection and integrated interval by interval.

With y = y_r(t) + x, y_r the static equilibrium at the posture of the moment:

    M(t) d2x/dt2 + D(t) dx/dt + K(t) x = f(t),   f = -residual(y_r, dy_r/dt, d2y_r/dt2)

M, D, K are the residual's exact derivatives there, with gyroscopic and centrifugal terms, without rotating unbalance; f
has it as a wave of each pulley's angle, and the transmission error to first order. Neglected terms are of second order
in x and in the excitation. Quantities of the posture alone are smooth and interpolated within each time interval, also
the waves' amplitudes and the method's transition matrices. The integration is Gauss's method of order six, which is
accurate for slow modes and stable for fast ones.

References:
    Hairer, Norsett, Wanner, "Solving Ordinary Differential Equations I", 1993, II.7 (Gauss methods), II.14.
"""

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import cache, partial
from types import MappingProxyType
from typing import Any, NamedTuple, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from ident.arm.arm import Arm
from ident.arm.chain import Loads, at_posture
from ident.arm.modes import natural_frequencies
from ident.arm.multibody import (
    Multibody,
    Turning,
    at_rest,
    balanced,
    beyond_tangent,
    bushing_rotations,
    deviations,
    end_point,
    equations,
    imbalance,
    multibody,
    of_joints,
    orders_of,
    pins,
    transmission_error,
)
from ident.arm.parts import Spring
from ident.arm.rotations import matvec
from ident.errors import InputError, ModelError, Problem
from ident.programs import LONG_LOOPS, AnyArray, concrete, cores, is_traced, jit, library
from ident.vibrate.linear import (
    AT_NODES,
    NODE_PLACES,
    ONCE,
    STAGES,
    STEPS,
    TWICE,
    Linear,
    StepWeights,
    TimeIntervals,
    Times,
    advance,
    between_nodes,
    evaluate,
    fastest,
    in_chunks,
    initial_equilibrium,
    interpolate,
    ladder,
    linearised,
    some_at_a_time,
    weights,
    where,
)
from ident.vibrate.motion import Motion, command
from ident.vibrate.response import Response

# -------- Curved
# Springs that are no straight lines, in motion: where the fast method may take their tangent, and what passes T1.

MISSED = 0.02
"""Largest error of a spring's tangent in the fast method, relative to the bushing's vibration moment; assumed."""


class LeavesTangentError(InputError):
    """A vibration too large for the fast method, as it leaves the tangent of a curved spring."""


@dataclass(frozen=True)
class Passage:
    """A spring whose load passes T1 while the arm moves.

    Attributes:
        spring: name of the spring.
        torque1: [N m] T1.
        low: [N m] least load.
        high: [N m] largest load.
    """

    spring: str
    torque1: float
    low: float
    high: float


def refuse_curved(arm: Arm, missed: AnyArray | None) -> None:
    """Refuse a response by the fast method that leaves the tangents of curved springs; under `jit` it may.

    Args:
        arm: the arm.
        missed: (2 N, T, *batch) of the solution, None without curved springs, see `beyond_tangent`.

    Raises:
        LeavesTangentError: some bushing's moment of vibration is wrong by more than `MISSED` of it at its largest.
    """
    if missed is None or isinstance(missed, jax.core.Tracer):
        return
    off, whole = np.split(np.nan_to_num(np.asarray(missed)).max(1), 2)
    share = np.divide(off, whole, out=np.zeros_like(off), where=whole > 0)
    worst = np.unravel_index(np.argmax(share), share.shape)
    if share[worst] > MISSED:
        name = arm.joints[int(worst[0])].name
        got = f"a vibration by which {name}'s curved spring leaves its tangent by {share[worst]:.2g} of its moment"
        expected = f"{MISSED:g} at most, where springs are taken as straight about the quasi-static deflection"
        remedy = "simulate by the exact method (`method` exact), or take its [[spring]] out"
        raise LeavesTangentError(Problem(arm.name, got, expected, remedy))


def passages(arm: Arm, response: Response) -> tuple[Passage, ...]:
    """Return the springs whose load passes T1 during a response without batch axes."""
    places = {joint.name: place for place, joint in enumerate(arm.joints)}
    found = []
    for spring in arm.springs:
        if isinstance(spring, Spring):
            k = places[spring.joint]
            moment, axis = (np.asarray(x)[:, k] for x in (response.spring_moment, response.model.axis))
            torsion = (moment * axis.reshape(3, 1)).sum(0)
            bending = np.linalg.norm(moment - axis.reshape(3, 1) * torsion, axis=0)
            load, first = np.abs(torsion) if spring.direction == "torsion" else bending, float(spring.torque1)
            if load.min() < first < load.max():
                found.append(Passage(spring.name, first, float(load.min()), float(load.max())))
    return tuple(found)


# -------- Fast

ABSTRACT = 0.005
"""Step for an arm whose first frequency is not known [s]."""
EDGE_VALUES, EDGE_SLOPES = weights(np.array([0.0, 1.0]))[:2]
"""Weights of the nodes for value and slope at both ends of an interval."""


class Fast(NamedTuple):
    """A solution of the linearised equations, step by step.

    Attributes:
        state: (P, S, 2 n) at the start of each step: deviation from the quasi-static deflection [rad], its rate [1/s]
        a: (P, S, STAGES, n) its acceleration at the stages of each step [1/s^2]
        quasi_static: (P, n, m) coordinates at static equilibrium, at the nodes of the intervals.
    """

    state: Float[Array, "P S state"]
    a: Float[Array, "P S stages n"]
    quasi_static: Float[Array, "P n m"]

    def at(self, grid: TimeIntervals, time: Times) -> tuple[Float[Array, "n T"], Float[Array, "n T"]]:
        """Return the coordinates at any times of the intervals, and their rates."""
        k, s, share, h = grid.steps_of(time)
        (x, v), a = jnp.split(self.state[k, s], 2, 1), self.a[k, s]
        once, twice = (evaluate(integral, share)[:, :, None] for integral in (ONCE, TWICE))
        h = h[:, None]
        x, v = x + h * share[:, None] * v + h**2 * (twice * a).sum(1), v + h * (once * a).sum(1)
        y, rate = between_nodes(grid, self.quasi_static, time)
        return y + x.T, rate + v.T


def step_for(arm: Arm, motion: Motion) -> float:
    """Return a step [s] at which the method errs less than the linearisation does, on the paper's arm.

    h = min(1 / (10 f_1), 1 / (3 f)), f_1 the first frequency of the stiffest arm at the stiffer end of the motion, and
    f the fastest excitation: |ratio| times the highest speed of the joint in turns a second, of each drive, times its
    highest order. Accelerations interpolated over a step h = 1/(n f) follow the free way under a force of that
    frequency within (2 pi/n)^5 / 13400 of it: 0.3 % for n = 3. ABSTRACT for an arm that `jit` traces.
    """
    if library(arm) is jnp:
        return ABSTRACT
    ends = np.asarray(motion(np.asarray(motion.breaks)[[0, -1]])[0])
    first = float(np.max(lowest_frequencies(arm, ends.reshape((*ends.shape, *(1,) * len(arm.batch))), None, 1)))
    speed, names = fastest(motion) / (2 * np.pi), [joint.name for joint in arm.driven]
    orders = [each[-1] for each in orders_of(arm).values()]
    ratios = [np.abs(np.asarray(drive.ratio)).max() for drive in arm.drives]
    turning = [speed[names.index(drive.joint)] for drive in arm.drives]
    highest = max((o * r * s for o, r, s in zip(orders, ratios, turning, strict=True)), default=0.0)
    return min(0.1 / first if np.isfinite(first) else ABSTRACT, 1 / (3 * max(highest, 1e-9)))


@jit
def lowest_frequencies(arm: Arm, posture: Float[AnyArray, "driven *t"], loads: Loads | None, count: int) -> Array:
    """Return the lowest natural frequencies at some postures [Hz]."""
    return natural_frequencies(at_posture(arm, posture, loads), count)


def excited(model: Multibody, motion: Motion, grid: TimeIntervals, at: StepWeights, linear: Linear) -> Fast:
    """Integrate the linearised equations, with what excites the arm, from rest at the first break of the motion.

    Intervals that start at infinity, and steps beyond those of an interval, are skipped: padding to a few standard
    sizes costs no time, and one program serves many motions.

    Args:
        model: the arm's multibody model under its load, gathered with `rank=1`.
        motion: the commanded motion.
        grid: the time intervals; their steps are the method's.
        at: weights for so many steps.
        linear: the equations without excitation, see `linearised`.
    """
    first, chunks = grid.start[0], jax.tree.map(jnp.asarray, (at.within, at.middles, at.in_steps, at.stages))

    def interval(state: tuple[Array, Array], given: tuple[Array, Array, Linear]) -> tuple[tuple, tuple]:
        (z, seam), (start, h, here) = state, given
        first_slope, last_slope = (interpolate(here.quasi_static, EDGE_SLOPES) / (h * at.steps)).T
        push, length = advance(h, model.size)[1], h * at.steps
        waves = _waves(model, motion, here, start + length * NODE_PLACES, length)

        def begin(z: Array) -> Array:
            y, K = (interpolate(part, EDGE_VALUES)[..., 0] for part in (here.quasi_static, here.K))
            return jnp.concatenate([initial_equilibrium(model, motion, y, K) - y, jnp.zeros(model.size)])

        def go_on(z: Array) -> Array:
            return z.at[model.size :].add(seam - first_slope)

        def some_steps(z: Array, given: tuple[tuple[Array, ...], Array]) -> tuple[Array, tuple]:
            (within, middles, in_steps, stages), turned = given
            f = _excitation(model, motion, here, waves, turned, stages, start + h * in_steps, length)
            z, states, a = stepped(here, middles, within < at.steps, push, z, f)
            return z, (states, a)

        z = jax.lax.cond(start == first, begin, go_on, z)
        real = where(lambda given: given[0][0][0] < at.steps, some_steps, *((STEPS, row) for row in rows))
        z, parts = jax.lax.scan(real, z, (chunks, _turned(model, motion, here, at, start, h)))
        return (z, last_slope), tuple(part.reshape((-1, part.shape[-1])) for part in parts)

    rows = 2 * model.size, STAGES * model.size
    times = jnp.asarray(grid.start), jnp.asarray(grid.step)
    rest = jnp.zeros(2 * model.size), jnp.zeros(model.size)
    real = where(lambda given: jnp.isfinite(given[0]), interval, *((at.within.size, row) for row in rows))
    states, a = jax.lax.scan(real, rest, (*times, linear))[1]
    return Fast(states, a.reshape((*a.shape[:2], STAGES, -1)), linear.quasi_static)


def stepped(
    linear: Linear, middles: Float[Array, "m S"], real: Array, push: Array, z: Array, f: Float[Array, "stages S"]
) -> tuple[Array, Float[Array, "S state"], Float[Array, "S stages"]]:
    """Integrate the linearised equations over some steps of an interval, which are real first.

    Args:
        linear: the equations within the interval.
        middles: weights of its nodes for the middles of the steps.
        real: (S,) which steps are.
        push: of the state by the stages' accelerations, see `advance`.
        z: (state,) x and dx/dt at the start of the first step.
        f: what excites at the stages of each step.

    Returns:
        The state at the end of the last real step, that at the start of each, and the accelerations at its stages.
    """
    own = _at_middles(middles, linear.yields @ f)

    def step(z: Array, given: tuple[Array, Array, Array]) -> tuple[Array, Array]:
        share, kick, real = given
        return jnp.where(real, matvec(jnp.tensordot(share, linear.along, 1), z) + kick, z), z

    z, states = jax.lax.scan(step, z, (middles.T, (push @ own).T, real))
    return z, states, (_at_middles(middles, linear.gain @ states.T) + own).T


def _at_middles(middles: Float[Array, "m S"], x: Float[Array, "m k S"]) -> Float[Array, "k S"]:
    """Return of values by each node's matrix what the matrix at the middle of the step gives: their weighted sum."""
    return (x * middles[:, None]).sum(0)


class Waves(NamedTuple):
    """The moments that the motion and the eccentric masses ask for, at the nodes of an interval [N m].

    Attributes:
        sure: (n, m) at any angle of the pulleys: the quasi-static deflection, and the inertia of the eccentric masses.
        cosine: (n, D, m) what each drive's eccentric mass adds times the cosine of its pulley's angle,
        sine: (n, D, m) and times the sine; the mass's phase is in both.
    """

    sure: Float[Array, "n m"]
    cosine: Float[Array, "n D m"]
    sine: Float[Array, "n D m"]


def _waves(model: Multibody, motion: Motion, linear: Linear, nodes: Float[Array, "m"], length: Array) -> Waves:
    """Return what an eccentric mass asks for as a wave of its pulley's angle, its amplitudes as smooth as the posture.

    Left out is what goes with twice the angle, the square of an eccentricity times how fast the shaft tilts: 1e-6 of
    the vibration of the paper's arm, 5e-4 at most of three arms of skew axes with 20 mm.
    """
    line = [linear.quasi_static @ W / length**k for k, W in enumerate(AT_NODES)]
    turning = Turning(*(deviations(model, part) for part in line))
    pulley = pins(balanced(model), command(model, motion, nodes), turning).pulley

    def asked(quarters: Array, own: Float[Array, "N"]) -> Float[Array, "n m"]:
        angle = jnp.broadcast_to(quarters * (jnp.pi / 2), pulley.angle.shape)
        forces = imbalance(model, linear.kinematics, pulley._replace(angle=angle))
        alone = jax.tree.map(lambda x: x * own[:, None], forces)
        return equations(model, linear.kinematics, jnp.ones_like(angle), alone)

    each = jnp.eye(model.joints)[np.asarray(model.driven, int)]
    ahead, quarter, back, last = jax.vmap(jax.vmap(asked, (None, 0), 1), (0, None))(jnp.arange(4.0), each)
    sure = linear.residual + (ahead + quarter + back + last).sum(1) / 4
    return Waves(sure, (ahead - back) / 2, (quarter - last) / 2)


def _turned(
    model: Multibody, motion: Motion, linear: Linear, at: StepWeights, start: Array, h: Array
) -> Float[Array, "chunks 2 D places"]:
    """Return cosine and sine of each pulley's angle at all stages: in one loop, XLA computes each once."""
    q = of_joints(model, command(model, motion, start + h * jnp.ravel(jnp.asarray(at.in_steps))).q)
    bent = deviations(model, interpolate(linear.quasi_static, jnp.concatenate([*jnp.asarray(at.stages)[:, 0]], 1)))
    angle = (model.drives.ratio * (q + bent))[np.asarray(model.driven, int)]
    turned = jnp.stack([jnp.cos(angle), jnp.sin(angle)])
    return jnp.moveaxis(turned.reshape((*turned.shape[:2], *at.in_steps.shape)), 2, 0)


def _excitation(
    model: Multibody,
    motion: Motion,
    linear: Linear,
    waves: Waves,
    turned: Float[Array, "2 D places"],
    stages: Float[Array, "3 m places"],
    time: Array,
    length: Array,
) -> Float[Array, "stages S"]:
    """Return f at the stages of some steps, one above the other."""
    sure, cosine, sine = (interpolate(part, stages[0]) for part in waves)
    f = sure + (cosine * turned[0] + sine * turned[1]).sum(1)
    if linear.by_pin:
        line = [interpolate(linear.quasi_static, stages[k]) / length**k for k in range(3)]
        turning = pins(model, command(model, motion, time), Turning(*(deviations(model, part) for part in line)))
        for by_pin, deviation in zip(linear.by_pin, transmission_error(model, turning), strict=True):
            slopes = interpolate(by_pin, stages[0])  # by `matvec` XLA computes a deviation's sines for each row again
            f = sum((slopes[:, pin] * deviation[pin] for pin in range(model.joints)), f)
    return by_stage(-f)


def by_stage(f: Float[Array, "n places"]) -> Float[Array, "stages S"]:
    """Return values at the stages of some steps, in the order of time, with those of a step one above the other."""
    return jnp.concatenate([f[:, stage::STAGES] for stage in range(STAGES)])


# -------- Fast method
# The fast method for one arm, all else given: one compiled program, whatever the motion's length.

TOGETHER = 2048
"""Times at which the response is computed together."""
GROWTH, FEW = 5, 2 * TOGETHER
"""Numbers of times of programs: each is five times the one before. Batches of arms begin at the least: to write zeros
behind 10 s of 200 samples a second takes a sixth of an arm's time."""
LEAST = GROWTH * FEW
"""Where all else begins: 40 s at 500 a second, as the nominal arm's stroke at 10 % takes."""


class Solution(NamedTuple):
    """Coordinates and rates (n, T), path, displacement, quasi-static deflection and gear error of the end point (3, T).

    Where springs are curved, also the size of each bushing's spring moment by which the tangent misses the curve, and
    of that moment's change (2 N, T) [N m], see `beyond_tangent`; None otherwise.
    """

    y: AnyArray
    yd: AnyArray
    path: AnyArray
    displacement: AnyArray
    quasi_static: AnyArray
    gear_error: AnyArray
    missed: AnyArray | None = None


class Samples(NamedTuple):
    """When the response is wanted, padded to one of few numbers: one program serves motions of any length.

    Attributes:
        time: (T,) [s] the last one repeated.
        turn: (2, driven, T) cosine and sine of the commanded angles then: within a program they took half of its time.
        number: () of the times that are wanted.
    """

    time: Times
    turn: Float[AnyArray, "2 driven T"]
    number: Int[AnyArray, ""]

    @property
    def wanted(self) -> Float[np.ndarray, "wanted"]:
        """The times that are wanted [s]."""
        return np.asarray(self.time)[: int(self.number)]


NO_SAMPLES = Samples(np.zeros(0), np.zeros((2, 0, 0)), np.asarray(0))


def samples_of(motion: Motion, time: Float[np.ndarray, "wanted"], least: int = LEAST) -> Samples:
    """Return some times of a motion as samples."""
    padding = (0, 0), (0, ladder(len(time), least, GROWTH) - len(time))
    padded, *q = np.pad(np.vstack([time, motion(time)[0]]), padding, mode="edge")
    return Samples(padded, np.stack([np.cos(q), np.sin(q)]), np.asarray(len(time)))


class Linearised(NamedTuple):
    """The linearised equations, and the quasi-static deflection of the end point at the nodes.

    The same whatever excites the arm.
    """

    equations: Linear
    bent: Float[Array, "P 3 m"]


class FastMethod(eqx.Module):
    """The fast method for one arm, all else given; samples, grid and weights belong to the motion.

    What the transmission error does to the arm at rest, at any speed, is no vibration, but a sensor has it in its
    trace: `measured` counts it in.
    """

    motion: Motion
    loads: Loads | None
    samples: Samples
    grid: TimeIntervals
    weights: StepWeights
    elastic: bool = eqx.field(static=True)
    transmission_error: bool = eqx.field(static=True)
    measured: bool = eqx.field(static=True, default=False)

    @property
    def without_samples(self) -> "FastMethod":
        """The same for the equations of motion: one program for any number of samples."""
        return replace(self, samples=NO_SAMPLES)

    def linearised(self, arm: Arm) -> Linearised:
        """Linearise an arm's equations of motion along the motion."""
        return some_at_a_time(partial(self.linearised_within, arm), self.grid)

    def linearised_within(self, arm: Arm, grid: TimeIntervals) -> Linearised:
        """Linearise them within some time intervals."""
        model = self.model(arm)
        equations = linearised(arm, model, self.motion, grid, self.weights, self.loads)
        y = jnp.moveaxis(equations.quasi_static, 1, 0).reshape((model.size, -1))
        bent = end_point_of(balanced(model), self.motion, grid.nodes.ravel(), y)[1]
        return Linearised(equations, jnp.moveaxis(bent.reshape((3, *grid.nodes.shape)), 1, 0))

    def excited(self, arm: Arm, linear: Linearised) -> Fast:
        """Integrate them with what excites the arm."""
        return excited(self.model(arm), self.motion, self.grid, self.weights, linear.equations)

    def vibration(self, arm: Arm, linear: Linearised, solved: Fast, time: Times | None = None) -> Float[Array, "3 T"]:
        """Return the displacement of the end point from its quasi-static position [m].

        Args:
            arm: the arm.
            linear: its linearised equations.
            solved: their solution.
            time: (T,) [s] by default the samples, beyond which the result is padding.
        """
        model = self.model(arm)

        def at(time: Array, turn: Array | None = None) -> Array:
            static = between_nodes(self.grid, linear.bent, time)[0]
            moved = end_point_of(model, self.motion, time, solved.at(self.grid, time)[0], turn)[1] - static
            return moved if self.measured else moved - self._gear_error(model, linear, time)

        return at(jnp.asarray(time)) if time is not None else by_time(at, *self.samples[:2])

    def solution(self, arm: Arm, linear: Linearised, solved: Fast) -> Solution:
        """Return all of the solution at the samples."""
        model = self.model(arm)

        def at(time: Array, turn: Array) -> Solution:
            y, yd = solved.at(self.grid, time)
            static, missed = between_nodes(self.grid, linear.bent, time)[0], self._missed(model, linear, time, y)
            error = self._gear_error(model, linear, time)
            return Solution(y, yd, *end_point_of(model, self.motion, time, y, turn), static, error, missed)

        return by_time(at, *self.samples[:2])

    def vibration_and_missed(self, arm: Arm, linear: Linearised, solved: Fast) -> tuple[Array, Array | None]:
        """Return the vibration at the samples, and by how much curved springs leave their tangents, see `Solution`."""
        model = self.model(arm)

        def missed(time: Array) -> Array | None:
            return self._missed(model, linear, time, solved.at(self.grid, time)[0])

        return self.vibration(arm, linear, solved), by_time(missed, self.samples.time)

    def model(self, arm: Arm) -> Multibody:
        """Gather an arm's equations of motion."""
        return multibody(
            arm, self.loads, rank=1, elastic_belts=self.elastic, transmission_error=self.transmission_error
        )

    def _gear_error(self, model: Multibody, linear: Linearised, time: Array) -> Float[Array, "3 T"]:
        """Return the displacement of the end point at static equilibrium by the transmission error."""
        if not model.transmission_error:
            return jnp.zeros((3, *time.shape))
        rest = between_nodes(self.grid, linear.equations.quasi_static, time)[0]
        erring, exact = (end_point_of(each, self.motion, time, rest)[1] for each in (model, balanced(model)))
        return erring - exact

    def _missed(self, model: Multibody, linear: Linearised, time: Times, y: Array) -> Array | None:
        if model.curved is None:
            return None
        rest = between_nodes(self.grid, linear.equations.quasi_static, time)[0]
        return jnp.concatenate(beyond_tangent(model, bushing_rotations(model, rest), bushing_rotations(model, y)))


def by_time(f: Callable[..., Any], time: Times, *more: Float[AnyArray, "*rows T"]) -> Any:
    """Return what f gives for times and what else is given then, some together, none that are repeated."""
    chunks, *each = (jnp.moveaxis(jnp.reshape(x, (*x.shape[:-1], -1, TOGETHER)), -2, 0) for x in (time, *more))
    real = chunks[:, 0] > jnp.concatenate([jnp.full(1, -jnp.inf), chunks[:-1, -1]])
    whole = in_chunks(f, (chunks, *each), real)
    return jax.tree.map(lambda part: jnp.moveaxis(part, 0, 1).reshape((part.shape[1], -1)), whole)


def end_point_of(
    model: Multibody, motion: Motion, time: AnyArray, y: Array, turn: Float[AnyArray, "2 driven T"] | None = None
) -> tuple[Float[Array, "3 T"], Float[Array, "3 T"]]:
    """Return path and displacement of the end point.

    Args:
        model: the arm's multibody model.
        motion: the commanded motion.
        time: (T,) [s]
        y: (n, T) the coordinates then.
        turn: cosine and sine of the commanded angles then, where they are known.
    """
    commanded, phi = command(model, motion, time), bushing_rotations(model, y)
    q = of_joints(model, commanded.q)
    known = None if turn is None else (of_joints(model, turn[0], still=1.0), of_joints(model, turn[1]))
    path = end_point(model, q, turn=known)
    if not (model.belt_driven or model.transmission_error):
        return path, end_point(model, q, phi, known) - path
    angle = pins(model, commanded, at_rest(deviations(model, y))).pin.angle
    return path, end_point(model, angle, phi) - path


# -------- Each
# The fast method for each of some arms, and for each of some sets of phases of what excites them, on all cores.


OWN = np.nan
"""Filled in by `each_of` for a number that a set lacks, which is then the arm's own."""


class Numbers(eqx.Module):
    """Numbers of an arm in one array: a program's call takes one transfer, and not one for each of them.

    Attributes:
        paths: of the numbers.
        values: (P,) [SI], or (K, P) of some sets of them.
    """

    paths: tuple[str, ...] = eqx.field(static=True)
    values: Float[AnyArray, "*K P"]

    @classmethod
    def of(cls, numbers: Mapping[str, Any]) -> "Numbers":
        """Gather numbers by path."""
        return cls(tuple(numbers), np.array(list(numbers.values()), float))

    def set_in(self, arm: Arm, own: Mapping[str, AnyArray] = MappingProxyType({})) -> Arm:
        """Return an arm with these numbers, and with those of `own` that are not `OWN`."""
        values = dict(zip(self.paths, self.values, strict=True))
        return arm.replace({**values, **{path: jnp.where(jnp.isnan(x), values[path], x) for path, x in own.items()}})


def each_arm(numbers: Mapping[str, Float[AnyArray, "batch"]]) -> list[Numbers]:
    """Return the numbers of each of some arms."""
    return [Numbers(tuple(numbers), values) for values in np.stack([*numbers.values()], 1).astype(float)]


Sets = dict[str, Any]
"""Numbers of what excites an arm by path, for each of some sets."""
T = TypeVar("T")
Keep = Callable[[FastMethod, Arm, Linearised, Fast], Any]
"""Selects the results to keep from a solution."""


def numbers_of(arm: Arm) -> dict[str, AnyArray]:
    """Return the numbers of an arm by path, but for those of its stroke, which is a motion already."""
    own = "" if arm.stroke is None else f"{arm.stroke.name}."
    return {path: x for path, x in arm.numbers().items() if not (own and path.startswith(own))}


def on_device(tree: T) -> T:
    """Return the same with its arrays where programs take them from without a transfer."""
    arrays, rest = eqx.partition(tree, eqx.is_array)
    with jax.ensure_compile_time_eval():  # no part of a program that is being traced
        return eqx.combine(jax.device_put(arrays), rest)


def refuse_collapse(motion: Motion, displacement: AnyArray) -> None:
    """Refuse a displacement that is NaN; under `jit` or `grad` it may be.

    Raises:
        ModelError: the arm collapses.
    """
    if not isinstance(displacement, jax.core.Tracer) and not np.isfinite(np.asarray(displacement)).all():
        raise ModelError(
            f"no response to {motion.name}: the arm has no stable equilibrium somewhere along it; "
            "check stiffnesses, masses and their units"
        )


def vibrations(
    arm: Arm,
    numbers: Mapping[str, Float[Array | np.ndarray, "batch"]],
    solve: FastMethod,
    sets: Sequence[Mapping[str, float]] = ({},),
    measure: Callable[[Float[np.ndarray, "3 T sets"]], np.ndarray] | None = None,
) -> Float[AnyArray, "*shape batch"]:
    """Return how the end point vibrates [m] with each of some numbers of the arm, by path; NaN where it collapses.

    Args:
        arm: the arm.
        numbers: all of it, see `numbers_of`: one program serves whichever differ.
        solve: the fast method.
        sets: numbers of what excites the arm, by path: with each of them instead, see `each_of`.
        measure: of an arm's vibrations with all sets `(3, T, sets)`; when None themselves, arms on a further axis.

    Raises:
        InputError: vibrations leave the tangents of curved springs, see `refuse_curved`.
    """

    def gather(of_sets: Any) -> Any:
        vibration, missed = of_sets if arm.springs else (of_sets, None)
        refuse_curved(arm, missed)
        return vibration if measure is None else measure(vibration)

    return each_of(
        arm, numbers, solve, FastMethod.vibration_and_missed if arm.springs else FastMethod.vibration, sets, gather
    )


def each_of(
    arm: Arm,
    numbers: Mapping[str, Array | np.ndarray],
    solve: FastMethod,
    keep: Keep,
    sets: Sequence[Mapping[str, float]] = ({},),
    gather: Callable[[Any], Any] = lambda of_sets: of_sets,
) -> Any:
    """Solve for an arm with each of these numbers (batch,), the last axis, and each of these sets, the one before.

    Arms one after another on each core: several side by side, whose intermediate values do not fit its cache, gain
    nothing. The linearised equations of an arm serve all sets, which are integrated side by side: their matrices are
    the same, which saves a third of that. What is behind the samples is left out.

    Args:
        arm: the arm.
        numbers: all of it, by path.
        solve: the fast method.
        keep: returns the results to keep at the samples, arrays of rows and times, as `FastMethod.vibration` does.
        sets: numbers of what excites the arm, by path, the height of eccentric masses too: the linearised equations are
            without these. What a set lacks is the arm's own.
        gather: reduces the results of an arm's sets, which are on the last axis.
    """
    samples, count, equations = int(solve.samples.number), len(next(iter(numbers.values()))), solve.without_samples
    if is_traced(jax.tree.leaves((arm, numbers, solve))):
        turned = [{path: np.asarray(x) for path, x in own.items()} for own in sets]
        solved = [_traced(arm, dict(numbers), solve, keep, own) for own in turned]
        whole = jax.tree.map(lambda *x: jnp.stack(x, -1)[..., :samples, :], *solved)
        arms = [gather(jax.tree.map(lambda x, k=k: x[k], whole)) for k in range(count)]
        return jax.tree.map(lambda *x: jnp.stack(x, -1), *arms)
    each = each_arm(numbers)
    arm = on_device(arm) if count > cores() else arm  # for few it takes longer than it saves
    shares = in_shares(sets, 1 if count >= cores() else cores())

    def solved_with(values: Numbers, linear: Linearised, share: tuple[int, Sets]) -> Any:
        some, turned = share
        response = _excited(arm, values, turned, equations, linear)
        kept = concrete(sampled_for(arm, values, turned, solve, linear, response, keep))
        return jax.tree.map(lambda x: np.moveaxis(x[:some, ..., :samples], 0, -1), kept)

    def gathered(of_shares: Sequence[Any]) -> Any:
        return gather(jax.tree.map(lambda *x: np.concatenate(x, -1), *of_shares))

    def all_sets(values: Numbers) -> Any:
        return gathered([solved_with(values, linearised_for(arm, values, equations), *shares)])

    if count >= cores():
        found = at_once([partial(all_sets, values) for values in each])
    else:
        pairs = [(values, linearised_for(arm, values, equations)) for values in each]
        done = at_once([partial(solved_with, *pair, share) for pair in pairs for share in shares])
        found = [gathered(done[first : first + len(shares)]) for first in range(0, len(done), len(shares))]
    return jax.tree.map(lambda *x: np.stack(x, -1), *found)


def in_shares(sets: Sequence[Mapping[str, float]], count: int) -> list[tuple[int, Sets]]:
    """Divide sets into so many shares at most, of one size: one program serves all.

    Returns:
        Of each share how many sets are real, and their numbers by path, filled up with those of its first set.
    """
    most, paths = -(-len(sets) // count), dict.fromkeys(path for own in sets for path in own)
    shares = [sets[first : first + most] for first in range(0, len(sets), most)]
    filled = [[*some, *[some[0]] * (most - len(some))] for some in shares]
    numbers = [{path: np.array([own.get(path, OWN) for own in every]) for path in paths} for every in filled]
    return list(zip(map(len, shares), numbers, strict=True))


@cache
def _pool() -> ThreadPoolExecutor:
    """Return the threads that solve: one a core, however many callers there are at once."""
    return ThreadPoolExecutor(cores(), "simulate")


def at_once(jobs: Sequence[Callable[[], Any]]) -> list[Any]:
    """Return what the jobs return, as many at once as there are cores; none of them may call this.

    The first to come compiles a program, for which the others wait.
    """
    futures = [_pool().submit(lambda job: jax.block_until_ready(job()), job) for job in jobs]
    try:
        return [future.result() for future in futures]
    finally:
        for future in futures:
            future.cancel()


@jit
def _traced(arm: Arm, numbers: dict[str, Any], solve: FastMethod, keep: Keep, own: Sets) -> Any:
    """Return the kept results of each arm, arms first, all by one program: for tracing and differentiation."""

    def one(values: dict[str, Any]) -> Any:
        changed = arm.replace(values | own)
        linear = solve.linearised(changed)
        return keep(solve, changed, linear, solve.excited(changed, linear))

    return jax.lax.map(one, numbers)


@jit
def linearised_for(arm: Arm, values: Numbers, solve: FastMethod) -> Linearised:
    """Return the linearised equations of an arm with these numbers."""
    return solve.linearised(values.set_in(arm))


@jit
def _excited(arm: Arm, values: Numbers, sets: Sets, solve: FastMethod, linear: Linearised) -> Fast:
    """Return the response of an arm with each of some sets, the first axis; one alone is not batched."""
    return for_sets(lambda own: solve.excited(values.set_in(arm, own), linear), sets)


@partial(jit, options=LONG_LOOPS)
def sampled_for(
    arm: Arm, values: Numbers, sets: Sets, solve: FastMethod, linear: Linearised, solved: Fast, keep: Keep
) -> Any:
    """Return the kept results of each set, on the first axis: computed in turn, as the values of one fill the cache."""
    return for_sets(lambda own, z: keep(solve, values.set_in(arm, own), linear, z), sets, solved, in_turn=True)


def for_sets(f: Callable[..., Any], sets: Sets, *more: Any, in_turn: bool = False) -> Any:
    """Return what f gives for each of some sets and what else is given for it; one alone, or in turn: not batched."""
    given = sets, *more
    if all(len(x) == 1 for x in sets.values()):
        return jax.tree.map(lambda x: x[None], f(*jax.tree.map(lambda x: x[0], given)))
    return jax.lax.map(lambda each: f(*each), given) if in_turn else jax.vmap(f)(*given)
