"""Repeated changes and simulations of an arm, with one compiled program whichever numbers change."""

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, NamedTuple, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from ident.arm.arm import Arm
from ident.arm.chain import Loads, at_posture
from ident.arm.mechanics import deflection, static_equilibrium
from ident.arm.modes import lowest_eigenpairs, to_hertz
from ident.errors import ModelError
from ident.programs import AnyArray, Progress, cores, in_batches, jit
from ident.vibrate.fast import (
    Fast,
    FastMethod,
    Linearised,
    Numbers,
    Sets,
    at_once,
    each_arm,
    for_sets,
    in_shares,
    numbers_of,
    on_device,
    refuse_collapse,
    step_for,
    vibrations,
)
from ident.vibrate.linear import TimeIntervals, some_at_a_time
from ident.vibrate.motion import Motion
from ident.vibrate.response import Response
from ident.vibrate.simulate import (
    RATE,
    Amplitude,
    Superposition,
    amplitude,
    fast_method,
    largest_over_phases,
    parts_of,
    rms_over_phases,
    sets_of,
    simulate,
    superposition,
)
from ident.vibrate.variable import Variable, apply

# -------- End states
# The arm at both ends of a motion: effects of a change other than vibration.


class EndState(NamedTuple):
    """First natural frequency and static deflection, the worse of both ends; NaN where the arm collapses.

    Attributes:
        frequency: (*batch) [Hz]
        deflection: (*batch) [m] distance of the end point from its position on rigid joints.
    """

    frequency: Float[AnyArray, "*batch"]
    deflection: Float[AnyArray, "*batch"]


def ends(motion: Motion) -> Float[AnyArray, "driven 2"]:
    """Return the postures [rad] at both ends of a motion."""
    return motion(motion.breaks[np.array([0, -1])])[0]


@jit
def worst_state(arm: Arm, posture: Float[AnyArray, "driven ends"], loads: Loads | None) -> EndState:
    """Return the worse of the arm's states at some postures [rad]. Differentiable once."""
    chain = at_posture(arm, posture.reshape((*posture.shape, *(1,) * len(arm.batch))), loads)
    at = static_equilibrium(chain)
    frequency = to_hertz(lowest_eigenpairs(chain, at, count=1)[0])[0]
    moved = deflection(chain, at.phi)[:, -1]
    return EndState(frequency.min(0), jnp.sqrt((moved**2).sum(0)).max(0))


# -------- Slopes
# Exact slopes of an amplitude by numbers of an arm: three programs for an arm, a motion, a measure, its unknown phases.

WIDTH = 3
"""Forward derivatives computed together: with more variables the same program runs several times."""


def directions_of(numbers: Numbers, variables: Sequence[Variable]) -> Numbers:
    """Return the derivatives of an arm's numbers by each variable `(WIDTH, P)`; zero for padding."""
    ways = np.zeros((WIDTH, len(numbers.paths)))
    for way, variable in zip(ways, variables, strict=False):
        for path in variable.paths:
            place = numbers.paths.index(path)
            way[place] = 1.0 if variable.shifted else numbers.values[place]
    return Numbers(numbers.paths, ways)


LinearisedPair = tuple[Linearised, Linearised]
"""Linearised equations, and how they change along each of some directions."""


@jit
def linear_along(arm: Arm, values: Numbers, directions: Numbers, solve: FastMethod) -> LinearisedPair:
    """Return an arm's linearised equations, and how they change along directions, pushed forward together."""

    def some(grid: TimeIntervals) -> LinearisedPair:
        def along(direction: Numbers) -> LinearisedPair:
            return jax.jvp(lambda now: solve.linearised_within(now.set_in(arm), grid), (values,), (direction,))

        return jax.vmap(along, out_axes=(None, 1))(directions)

    linear, changing = some_at_a_time(some, solve.grid)
    return linear, jax.tree.map(lambda x: jnp.moveaxis(x, 1, 0), changing)


@jit
def solved_along(
    arm: Arm, values: Numbers, directions: Numbers, sets: Sets, linear: LinearisedPair, solve: FastMethod
) -> tuple[tuple[Fast, Fast], Float[Array, "sets 3 T"]]:
    """Return an arm's responses with some sets, how they change along directions, and its vibrations [m]."""

    def one(own: Sets) -> tuple[Fast, Fast]:
        def along(*tangents: Any) -> tuple[Fast, Fast]:
            here = values, linear[0]
            return jax.jvp(lambda now, linear: solve.excited(now.set_in(arm, own), linear), here, tangents)

        pair: tuple[Fast, Fast] = jax.vmap(along, out_axes=(None, 0))(directions, linear[1])
        return pair

    pair = for_sets(one, sets)
    seen = for_sets(lambda own, z: solve.vibration(values.set_in(arm, own), linear[0], z), sets, pair[0], in_turn=True)
    return pair, seen


@jit
def vibration_along(
    arm: Arm,
    values: Numbers,
    directions: Numbers,
    sets: Sets,
    linear: LinearisedPair,
    solved: tuple[Fast, Fast],
    solve: FastMethod,
    places: Int[AnyArray, "3 W"] | None,
) -> tuple[Float[Array, "sets 3 W"], Float[Array, "sets WIDTH 3 W"]]:
    """Return the vibrations at some samples of each direction, or at all, and their slopes along directions [m]."""

    def one(own: Sets, solved: tuple[Fast, Fast]) -> tuple[Array, Array]:
        def seen(now: Numbers, linear: Linearised, solved: Fast) -> Array:
            time = None if places is None else jnp.asarray(solve.samples.time)[jnp.ravel(places)]
            whole = solve.vibration(now.set_in(arm, own), linear, solved, time)
            return whole if places is None else whole.reshape((3, *places.shape))[np.arange(3), np.arange(3)]

        def along(*tangents: Any) -> tuple[Array, Array]:
            return jax.jvp(seen, (values, linear[0], solved[0]), tangents)

        return jax.vmap(along, out_axes=(None, 0))(directions, linear[1], solved[1])

    return for_sets(one, sets, solved, in_turn=True)


def places_of(measure: Amplitude, size: Float[np.ndarray, "3 T"]) -> Int[np.ndarray, "3 more"] | None:
    """Return the sample of the largest peak in each window and direction; None for all samples (an RMS).

    There may be more windows than `measure.count`; the last ones are padding.
    """
    if measure.measure == "rms":
        return None
    first, end = int(measure.first), int(measure.end)
    late = np.roll(size, -first, 1)
    late[:, end - first :] = 0.0
    windows = np.pad(late, ((0, 0), (0, -late.shape[1] % measure.window))).reshape((3, -1, measure.window))
    within = np.arange(windows.shape[1]) * measure.window + windows.argmax(2)
    return np.minimum(first + within, size.shape[1] - 1)


def with_slopes(
    measure: Amplitude, parts: tuple[Any, Any, Any], changing: tuple[Any, Any, Any]
) -> tuple[Float[np.ndarray, "3 W"], Float[np.ndarray, "V 3 W"]]:
    """Return the amplitude over the phases at each of its places, or the RMS, and its slopes.

    Args:
        measure: the amplitude.
        parts: the known part `(3, T)`, and each phase's parts of cosine and sine `(U, 3, T)` there, see `parts_of`.
        changing: their derivatives by each variable, `(V, 3, T)` and `(U, V, 3, T)`.
    """
    sure, cosine, sine = parts
    way, of_cosine, of_sine = changing
    turning = cosine[:, None] * of_cosine + sine[:, None] * of_sine
    if measure.measure == "rms":
        end = int(measure.end)
        mean = np.sqrt((rms_over_phases(*parts) ** 2)[:, :end].mean(1, keepdims=True))
        slope = (sure * way + turning.sum(0) / 2)[..., :end].mean(-1, keepdims=True)
        return mean, slope / np.where(mean > 0, mean, 1.0)
    size = np.hypot(cosine, sine)
    each = turning / np.where(size > 0, size, 1.0)[:, None]
    return largest_over_phases(*parts), np.sign(sure) * way + each.sum(0)


# -------- Evaluator

BATCH = 64
"""Arms between two steps of progress."""
Draws = Mapping[str, Float[np.ndarray, "D"]]


@dataclass(frozen=True)
class Evaluator:
    """The amplitudes of an arm, and of its draws, after changes.

    The arms of a batch are ordered by changes, after each the arm itself first, then its draws. All numbers of the arm
    enter the programs as arguments, so that all evaluators of an arm, a motion and a measure share them.

    Attributes:
        arm: the present arm.
        motion: the commanded motion.
        variables: the changed numbers.
        measure: of the vibration, see `simulate.MEASURES`.
        draws: of some of the arm's numbers, by path; a change acts on each draw, see `Variable`. Where no drive of the
            arm has a transmission error, none of a draw has.
        loads: the load case.
        elastic_belts: whether belts stretch.
        rate: samples a second.
        step: longest time step [s]; that of the stiffest arm when None.
        unknown: phases over which the amplitude of the arm itself is the largest (an RMS is in the mean); each draw has
            its own.
    """

    arm: Arm
    motion: Motion
    variables: tuple[Variable, ...]
    measure: str = "peak"
    draws: Draws = field(default_factory=dict)
    loads: Loads | None = None
    elastic_belts: bool = False
    rate: float = RATE
    step: float | None = None
    unknown: tuple[str, ...] = ()

    @property
    def size(self) -> int:
        """Number of arms after each change: itself and its draws."""
        return 1 + (len(next(iter(self.draws.values()))) if self.draws else 0)

    @property
    def alone(self) -> "Evaluator":
        """The evaluator of the arm itself, without draws."""
        return replace(self, draws={})

    @property
    def bounds(self) -> Float[np.ndarray, "2 V"]:
        """The changes of the variables at their lower and at their upper bounds."""
        return np.array([variable.span(self.arm) for variable in self.variables]).T

    @property
    def how(self) -> dict[str, Any]:
        """Arguments of a simulation other than arm and motion."""
        return {"loads": self.loads, "elastic_belts": self.elastic_belts, "rate": self.rate, "step": self.step}

    @property
    def amplitude(self) -> Amplitude:
        """The measure for the motion as it is sampled."""
        return amplitude(self.measure, self.motion, self.rate)

    def batch(self, changes: Float[np.ndarray, "G V"]) -> dict[str, Float[np.ndarray, "batch"]]:
        """Return all numbers of the arms after changes, by path."""
        present = numbers_of(self.arm)
        drawn = {path: np.append(present[path], values)[None] for path, values in self.draws.items()}
        values = present | drawn | apply(present | drawn, self.variables, list(changes.T[..., None]))
        shape = len(changes), self.size
        return {path: np.broadcast_to(np.asarray(value), shape).ravel() for path, value in values.items()}

    def changed_arm(self, change: Float[np.ndarray, "V"]) -> Arm:
        """Return the arm itself after a change."""
        return self.arm.replace(self.values(change))

    def superposition(self, change: Float[np.ndarray, "V"]) -> Superposition:
        """Return the vibration of the arm itself after a change as a sum over its phases that are not known."""
        step = self.step or self.step_for(change[None])
        return superposition(self.changed_arm(change), self.motion, self.unknown, **self.how | {"step": step})

    def amplitudes(self, changes: Float[np.ndarray, "G V"], progress: Progress = iter) -> Float[np.ndarray, "3 G D"]:
        """Return the amplitudes [m] after changes: after each that of the arm itself, then those of the draws.

        Raises:
            ModelError: the arm has no stable equilibrium after some change, which is named.
        """
        numbers, solve, count = self.batch(changes), self._solver(changes), len(changes) * self.size
        every, whole = np.arange(count), np.empty((3, count))
        own = every % self.size == 0 if self.unknown else np.zeros(count, bool)
        # over which phases each is: none of draws, which have theirs
        parts = ((every[own], self.unknown), (every[~own], ()))
        jobs = [(some[k : k + BATCH], unknown) for some, unknown in parts for k in range(0, len(some), BATCH)]
        try:
            for k in progress(range(len(jobs))):
                places, unknown = jobs[k]
                whole[:, places] = self._measured({path: x[places] for path, x in numbers.items()}, unknown, solve)
        except ModelError as error:
            raise ModelError(self._collapse(changes) or str(error)) from None
        return whole.reshape((3, len(changes), self.size))

    def drawn_vibration(self) -> Float[np.ndarray, "3 T D"]:
        """Return the vibration of each draw [m]."""
        nothing = np.zeros((1, len(self.variables)))
        numbers = {path: values[1:] for path, values in self.batch(nothing).items()}
        return np.asarray(vibrations(self.arm, numbers, self._solver(nothing)))[:, :, 0]

    def step_for(self, changes: Float[np.ndarray, "G V"]) -> float:
        """Return the time step [s] that the stiffest arm after these changes needs, some of them at a time."""
        numbers, count = self.batch(changes), len(changes) * self.size
        picked = [np.minimum(np.arange(first, first + BATCH), count - 1) for first in range(0, count, BATCH)]
        groups = (self.arm.replace({path: values[some] for path, values in numbers.items()}) for some in picked)
        return min(step_for(arms, self.motion) for arms in groups)

    def slopes(self, change: Float[np.ndarray, "V"]) -> tuple[Float[np.ndarray, "3 W 1"], Float[np.ndarray, "V 3 W 1"]]:
        """Return the parts whose maximum is the amplitude, and their exact derivatives by the changes.

        A part is the largest sample of a window, at the phases that maximise that sample; the slopes are those at these
        phases (Danskin, "The theory of max-min", 1967). An RMS is one part.

        Args:
            change: of each variable.
        """
        return self._slopes(change, slice(1), sets_of(self.unknown))

    def slopes_of_draws(
        self, change: Float[np.ndarray, "V"]
    ) -> tuple[Float[np.ndarray, "3 W D"], Float[np.ndarray, "V 3 W D"]]:
        """Return the same for each draw, with its own phases."""
        return self._slopes(change, slice(1, None), ({},))

    def _slopes(
        self, change: np.ndarray, which: slice, sets: Sequence[Mapping[str, float]]
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return parts and slopes of some of the arms, over the phases that some sets determine, see `sets_of`."""
        measure, solve, arm = self.amplitude, self._solver(change[None]), on_device(self.arm)
        arms = each_arm(self.batch(change[None]))[which]
        groups = [self.variables[first : first + WIDTH] for first in range(0, len(self.variables), WIDTH)]
        ways = [(values, directions_of(values, variables)) for variables in groups for values in arms]
        shares = in_shares(sets, cores())

        def gathered(of_shares: Sequence[np.ndarray]) -> np.ndarray:
            real = [x[:some] for x, (some, _) in zip(of_shares, shares, strict=True)]
            return np.moveaxis(np.concatenate(real), 0, -1)

        def one(values: Numbers, along: Numbers, run: Callable[[Any], list[Any]]) -> Any:
            linear = linear_along(arm, values, along, solve.without_samples)
            solved = run([partial(solved_along, arm, values, along, own, linear, solve) for _, own in shares])
            vibration = gathered(jax.device_get([x for _, x in solved]))
            places = places_of(measure, largest_over_phases(*parts_of(vibration)))
            jobs = [
                partial(vibration_along, arm, values, along, own, linear, pair, solve, places)
                for (_, own), (pair, _) in zip(shares, solved, strict=True)
            ]
            seen, changing = map(gathered, zip(*jax.device_get(run(jobs)), strict=True))
            return with_slopes(measure, parts_of(seen), parts_of(changing))

        if len(ways) > 1:
            done = at_once([partial(one, *way, lambda jobs: [job() for job in jobs]) for way in ways])
        else:
            done = [one(*ways[0], at_once)]
        count = len(arms)
        parts = np.stack([pair[0] for pair in done[:count]], -1)[:, : measure.count]
        by_group = [np.stack([pair[1] for pair in done[k : k + count]], -1) for k in range(0, len(done), count)]
        if not np.isfinite(parts).all():
            raise ModelError(self._collapse(change[None]) or f"no response to {self.motion.name}: the arm collapses")
        return parts, np.concatenate(by_group)[: len(self.variables), :, : measure.count]

    def end_states(self, changes: Float[np.ndarray, "G V"]) -> EndState:
        """Return the end states of the arm itself after changes, by one program for any number of them."""

        def states(some: np.ndarray) -> EndState:
            return worst_state(self.arm.replace(self.alone.batch(some.T)), ends(self.motion), self.loads)

        return in_batches(states, changes.T, BATCH)

    def values(self, changes: Float[np.ndarray, "V"]) -> dict[str, float]:
        """Return the numbers of the arm itself after changes, by path."""
        each = [np.asarray(change) for change in changes]
        return {path: float(value) for path, value in apply(self.arm.numbers(), self.variables, each).items()}

    def _solver(self, changes: Float[np.ndarray, "G V"]) -> FastMethod:
        step = self.step or self.step_for(changes)
        return fast_method(self.arm, self.motion, self.loads, self.elastic_belts, self.rate, step)

    def _measured(
        self, numbers: Mapping[str, np.ndarray], unknown: tuple[str, ...], solve: FastMethod
    ) -> Float[np.ndarray, "3 some"]:
        """Return the amplitudes of some arms over the unknown phases."""

        def measured(vibration: Float[np.ndarray, "3 T sets"]) -> Float[np.ndarray, "3"]:
            refuse_collapse(self.motion, vibration)
            over = rms_over_phases if self.measure == "rms" else largest_over_phases
            return self.amplitude(over(*parts_of(vibration)) if unknown else vibration[..., 0])

        return np.asarray(vibrations(self.arm, numbers, solve, sets_of(unknown), measured))

    def _collapse(self, changes: Float[np.ndarray, "G V"]) -> str:
        """Name the first change after which the arm has no stable equilibrium; empty if there is none."""
        if not self.variables:
            return ""
        for k in np.flatnonzero(~(np.asarray(self.end_states(changes).frequency) > 0)):
            values = self.values(changes[k])
            words = ", ".join(f"{v.name} = {values[v.paths[0]]:.4g}" for v in self.variables)
            return f"the arm collapses at {words}: no stable equilibrium; narrow the range"
        return ""


def exact_response(of: Evaluator) -> Response:
    """Simulate the motion of an evaluator's arm by the exact equations."""
    return simulate(of.arm, of.motion, method="exact", **of.how)


# -------- Side by side
# Jobs that do not depend on each other, on a thread a core.

T = TypeVar("T")


def side_by_side(jobs: Sequence[Callable[[], T]], progress: Progress = iter) -> list[T]:
    """Return what the jobs return, in their order; after an interrupt none begins any more.

    Args:
        jobs: the longest first.
        progress: shows how far it is, over the jobs.
    """
    pool = ThreadPoolExecutor(cores())
    try:
        pending = [pool.submit(job) for job in jobs]
        return [pending[k].result() for k in progress(range(len(jobs)))]
    finally:
        pool.shutdown(wait=False, cancel_futures=True)
