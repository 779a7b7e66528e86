"""An arm is changed and simulated over and over, whichever of its numbers change by one compiled program."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from ident.arm.arm import Arm
from ident.arm.chain import Loads
from ident.errors import ModelError
from ident.jit import jit
from ident.vibrate.motion.motion import Motion
from ident.vibrate.redesign.end_states import EndState, end_states
from ident.vibrate.redesign.variable import Variable, apply
from ident.vibrate.response.amplitude import Amplitude, amplitude
from ident.vibrate.response.exact import Progress
from ident.vibrate.response.fast import step_for
from ident.vibrate.response.fast_method import FastMethod, vibration_of
from ident.vibrate.response.simulate import RATE, by_chunk, fast_method, refuse_collapse, vibrations
from ident.vibrate.response.superposition import (
    Superposition,
    largest_over_phases,
    members_of,
    numbers_of,
    parts_of,
    rms_over_phases,
    superposition,
)

BATCH = 64
"""Arms between two steps of progress."""
WIDTH = 3
"""Derivatives that are pushed forward together: with more variables the same program runs several times."""

Draws = Mapping[str, Float[np.ndarray, "D"]]


@dataclass(frozen=True)
class Evaluator:
    """The amplitudes of an arm, and of its draws, after changes.

    The arms of a batch are ordered by changes, after each the arm itself first, then its draws. All numbers of the arm
    enter the programs as arguments, so that all evaluators of an arm, a motion and a measure share them.

    Attributes:
        arm: as it is.
        motion: the commanded motion.
        variables: what is changed.
        measure: of the vibration, see `amplitude.MEASURES`.
        draws: of some of the arm's numbers, by path; a change acts on each draw, see `Variable`.
        loads: the load case.
        elastic_belts: whether belts stretch.
        rate: samples a second.
        step: longest time step [s]; that of the stiffest arm when None.
        unknown: phases over which the amplitude of the arm itself is the largest (an RMS is in the mean); each draw has
            its own, and slopes are with those of the arm.
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
        """The same of the arm itself, without draws."""
        return replace(self, draws={})

    @property
    def bounds(self) -> Float[np.ndarray, "2 V"]:
        """The changes of the variables at their lower and at their upper bounds."""
        return np.array([variable.span(self.arm) for variable in self.variables]).T

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

    def changed(self, changes: Float[np.ndarray, "G V"]) -> Arm:
        """Return the arms after changes, as a batch."""
        return self.arm.replace({path: jnp.asarray(values) for path, values in self.batch(changes).items()})

    def changed_arm(self, change: Float[np.ndarray, "V"]) -> Arm:
        """Return the arm itself after a change."""
        return self.arm.replace({path: jnp.asarray(value) for path, value in self.values(change).items()})

    def superposition(self, change: Float[np.ndarray, "V"]) -> Superposition:
        """Return the vibration of the arm itself after a change as a sum over its phases that are not known."""
        return superposition(
            self.changed_arm(change),
            self.motion,
            self.unknown,
            loads=self.loads,
            elastic_belts=self.elastic_belts,
            rate=self.rate,
            step=self.step or self.step_for(change[None]),
        )

    def amplitudes(self, changes: Float[np.ndarray, "G V"], progress: Progress = iter) -> Float[np.ndarray, "3 G D"]:
        """Return the amplitudes [m] after changes: after each that of the arm itself, then those of the draws.

        Raises:
            ModelError: the arm has no stable equilibrium after some change, which is named.
        """
        numbers, solve, count = self.batch(changes), self._solver(changes), len(changes) * self.size
        jobs, whole = list(self._jobs(count)), np.empty((3, count))
        try:
            for k in progress(range(len(jobs))):
                places, unknown = jobs[k]
                whole[:, places] = self._measured({path: x[places] for path, x in numbers.items()}, unknown, solve)
        except ModelError as error:
            raise ModelError(self._collapse(changes) or str(error)) from None
        return whole.reshape((3, len(changes), self.size))

    def step_for(self, changes: Float[np.ndarray, "G V"]) -> float:
        """Return the time step [s] that the stiffest arm after these changes needs, some of them at a time."""
        numbers, count = self.batch(changes), len(changes) * self.size
        picked = [np.minimum(np.arange(first, first + BATCH), count - 1) for first in range(0, count, BATCH)]
        groups = (self.arm.replace({path: values[some] for path, values in numbers.items()}) for some in picked)
        return min(step_for(arms, self.motion) for arms in groups)

    def slopes(
        self, change: Float[np.ndarray, "V"], which: slice = slice(None)
    ) -> tuple[Float[np.ndarray, "3 W batch"], Float[np.ndarray, "V 3 W batch"]]:
        """Return the parts of which an amplitude is the largest, and their exact derivatives by the changes.

        Args:
            change: of each variable.
            which: of the arms; the first is the arm itself.
        """
        numbers = {path: values[which] for path, values in self.batch(change[None]).items()}
        measure, solve = self.amplitude, self._solver(change[None])
        parts, slopes = np.zeros(0), []
        for first in range(0, len(self.variables), WIDTH):
            point = numbers, _directions(numbers, self.variables[first : first + WIDTH])
            pair = by_chunk(lambda point: _pushed(self.arm, point, solve, measure), point, chunk=1)
            parts, pushed = (np.moveaxis(np.asarray(part), 0, -1)[..., : measure.count, :] for part in pair)
            slopes.append(pushed)
        if not np.isfinite(parts).all():
            raise ModelError(self._collapse(change[None]) or f"no response to {self.motion.name}: the arm collapses")
        return parts, np.concatenate(slopes)[: len(self.variables)]

    def end_states(self, changes: Float[np.ndarray, "G V"]) -> EndState:
        """Return the end states of the arm itself after changes."""
        return end_states(self.alone.changed(changes), self.motion, self.loads)

    def values(self, changes: Float[np.ndarray, "V"]) -> dict[str, float]:
        """Return the numbers of the arm itself after changes, by path."""
        each = [np.asarray(change) for change in changes]
        return {path: float(value) for path, value in apply(self.arm.numbers(), self.variables, each).items()}

    def _solver(self, changes: Float[np.ndarray, "G V"]) -> FastMethod:
        step = self.step or self.step_for(changes)
        return fast_method(self.arm, self.motion, self.loads, self.elastic_belts, self.rate, step)

    def _jobs(self, count: int) -> Iterator[tuple[Int[np.ndarray, "some"], tuple[str, ...]]]:
        """Yield places in a batch, some at a time, and over which phases each is: none of draws, which have theirs."""
        places = np.arange(count)
        own = places % self.size == 0 if self.unknown else np.zeros(count, bool)
        for which, unknown in ((places[own], self.unknown), (places[~own], ())):
            together = max(1, BATCH // (1 + 2 * len(unknown)))
            for first in range(0, len(which), together):
                yield which[first : first + together], unknown

    def _measured(
        self, numbers: Mapping[str, np.ndarray], unknown: tuple[str, ...], solve: FastMethod
    ) -> Float[np.ndarray, "3 some"]:
        """Return the amplitudes of some arms over the phases that are not known."""
        members = 1 + 2 * len(unknown)
        each = {path: np.repeat(values, members) for path, values in numbers.items()}
        each |= {path: np.tile(phases, len(each[path]) // members) for path, phases in members_of(unknown).items()}
        vibration = np.asarray(vibrations(self.arm, each, solve))
        refuse_collapse(self.motion, vibration)
        if unknown:
            over = rms_over_phases if self.measure == "rms" else largest_over_phases
            vibration = over(*parts_of(vibration.reshape((*vibration.shape[:2], -1, members))))
        return self.amplitude(vibration)

    def _collapse(self, changes: Float[np.ndarray, "G V"]) -> str:
        """Name the first change after which the arm has no stable equilibrium; empty if there is none."""
        if not self.variables:
            return ""
        for k in np.flatnonzero(~(np.asarray(self.end_states(changes).frequency) > 0)):
            values = self.values(changes[k])
            words = ", ".join(f"{v.name} = {values[v.paths[0]]:.4g}" for v in self.variables)
            return f"the arm collapses at {words}: no stable equilibrium; narrow the range"
        return ""


def _directions(
    numbers: Mapping[str, np.ndarray], variables: Sequence[Variable]
) -> dict[str, Float[np.ndarray, "batch WIDTH"]]:
    """Return how the numbers of each arm change with each variable; zero for those that fill up."""
    directions = {path: np.zeros((len(values), WIDTH)) for path, values in numbers.items()}
    for k, variable in enumerate(variables):
        for path in variable.paths:
            directions[path][:, k] = 1.0 if variable.shifted else numbers[path]
    return directions


@jit
def _pushed(
    arm: Arm, point: tuple[dict[str, Array], dict[str, Array]], solve: FastMethod, measure: Amplitude
) -> tuple[Float[Array, "S 3 W"], Float[Array, "S V 3 W"]]:
    """Return parts and slopes, arm by arm; the directions of each are pushed forward together."""

    def one(pair: tuple[dict[str, Array], dict[str, Array]]) -> tuple[Array, Array]:
        values, directions = pair

        def pushed(direction: dict[str, Array]) -> tuple[Array, Array]:
            return jax.jvp(lambda now: measure.parts(vibration_of(solve(arm.replace(now)))), (values,), (direction,))

        return jax.vmap(pushed, out_axes=(None, 0))(directions)

    return jax.lax.map(one, point)
