"""An arm is changed and simulated over and over, whichever of its numbers change by one compiled program."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int

from ident.arm.arm import Arm
from ident.arm.chain import Loads
from ident.errors import ModelError
from ident.vibrate.motion.motion import Motion
from ident.vibrate.redesign.end_states import EndState, end_states
from ident.vibrate.redesign.slopes import WIDTH, directions_of, linear_along, parts_along
from ident.vibrate.redesign.variable import Variable, apply
from ident.vibrate.response.amplitude import Amplitude, amplitude
from ident.vibrate.response.each import at_once, numbers_of, vibrations
from ident.vibrate.response.exact import Progress
from ident.vibrate.response.fast import step_for
from ident.vibrate.response.fast_method import FastMethod
from ident.vibrate.response.simulate import RATE, fast_method, refuse_collapse
from ident.vibrate.response.superposition import (
    Superposition,
    largest_over_phases,
    parts_of,
    rms_over_phases,
    sets_of,
    superposition,
)

BATCH = 64
"""Arms between two steps of progress."""
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
        draws: of some of the arm's numbers, by path; a change acts on each draw, see `Variable`. Where no drive of the
            arm has a kinematic error, none of a draw has.
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
        self, change: Float[np.ndarray, "V"], sets: Sequence[Mapping[str, float]] = ({},)
    ) -> tuple[Float[np.ndarray, "3 W sets"], Float[np.ndarray, "V 3 W sets"]]:
        """Return the parts of which an amplitude is the largest, and their exact derivatives by the changes.

        Args:
            change: of each variable.
            sets: phases of what excites the arm, by path: with each of them instead of its own.
        """
        numbers = self.batch(change[None])
        return self._slopes(change, [{path: values[0, ...] for path, values in numbers.items()}], sets)

    def slopes_of_draws(
        self, change: Float[np.ndarray, "V"]
    ) -> tuple[Float[np.ndarray, "3 W D"], Float[np.ndarray, "V 3 W D"]]:
        """Return the same of each of the draws."""
        numbers = self.batch(change[None])
        each = [{path: values[k, ...] for path, values in numbers.items()} for k in range(1, self.size)]
        return self._slopes(change, each, ({},))

    def _slopes(
        self, change: np.ndarray, arms: Sequence[Mapping[str, np.ndarray]], sets: Sequence[Mapping[str, float]]
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return parts and slopes of each of some arms with each of some sets, one after the other on the last axis."""
        measure, solve = self.amplitude, self._solver(change[None])
        groups = [self.variables[first : first + WIDTH] for first in range(0, len(self.variables), WIDTH)]
        ways = [(dict(values), directions_of(values, variables)) for variables in groups for values in arms]
        turned = [{path: np.asarray(x) for path, x in own.items()} for own in sets]

        def one(values: dict[str, Any], along: dict[str, Any], linear: Any, own: dict[str, Any]) -> Any:
            return jax.device_get(parts_along(self.arm, values | own, along, linear, solve, measure))

        def all_sets(values: dict[str, Any], along: dict[str, Any]) -> list[Any]:
            linear = linear_along(self.arm, values, along, solve)
            return [one(values, along, linear, own) for own in turned]

        if len(ways) > 1:
            done = [pair for pairs in at_once([partial(all_sets, *way) for way in ways]) for pair in pairs]
        else:
            linear = linear_along(self.arm, *ways[0], solve)
            done = at_once([partial(one, *ways[0], linear, own) for own in turned])
        count = len(arms) * len(sets)
        parts = np.stack([pair[0] for pair in done[:count]], -1)[:, : measure.count]
        by_group = [np.stack([pair[1] for pair in done[k : k + count]], -1) for k in range(0, len(done), count)]
        if not np.isfinite(parts).all():
            raise ModelError(self._collapse(change[None]) or f"no response to {self.motion.name}: the arm collapses")
        return parts, np.concatenate(by_group)[: len(self.variables), :, : measure.count]

    def end_states(self, changes: Float[np.ndarray, "G V"]) -> EndState:
        """Return the end states of the arm itself after changes, by one program for any number of them."""
        filled = np.pad(changes, ((0, -len(changes) % BATCH), (0, 0)), mode="edge")
        some = [filled[first : first + BATCH] for first in range(0, len(filled), BATCH)]
        states = [end_states(self.alone.changed(each), self.motion, self.loads) for each in some]
        return EndState(*(np.concatenate(part)[: len(changes)] for part in zip(*states, strict=True)))

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
            for first in range(0, len(which), BATCH):
                yield which[first : first + BATCH], unknown

    def _measured(
        self, numbers: Mapping[str, np.ndarray], unknown: tuple[str, ...], solve: FastMethod
    ) -> Float[np.ndarray, "3 some"]:
        """Return the amplitudes of some arms over the phases that are not known."""

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
