"""An arm is changed and simulated: the same few numbers over and over, by one compiled program."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ident.arm.arm import Arm, stiffness_paths
from ident.arm.chain import Loads
from ident.errors import ModelError
from ident.jit import jit
from ident.vibrate.motion.motion import Motion
from ident.vibrate.redesign.end_states import EndState, end_states
from ident.vibrate.redesign.variable import Variable, apply
from ident.vibrate.response.amplitude import Amplitude, amplitude
from ident.vibrate.response.exact import Progress
from ident.vibrate.response.fast import step_for
from ident.vibrate.response.simulate import RATE, FastMethod, by_chunk, fast_method, vibration_of, vibrations

BATCH = 64
"""Sets between two steps of progress."""
WIDTH = 6
"""Derivatives that are pushed forward together: with more variables the same program runs several times."""

Draws = Mapping[str, Float[np.ndarray, "D"]]


@dataclass(frozen=True)
class Evaluator:
    """What is simulated again and again.

    Sets are numbered place by place, at each the arm itself first, then its draws.

    Attributes:
        arm: as it is.
        motion: what the motors are told.
        variables: what is changed.
        measure: of the vibration, see `amplitude.MEASURES`.
        draws: of some of the arm's numbers, by path; a change acts on each draw, see `Variable`.
        also: further numbers that the program takes as given from outside: trials that have the same ones, of
            variables, draws and these together, share it.
        loads: the load case.
        elastic_belts: whether belts stretch.
        rate: samples a second.
        step: longest time step [s]; that of the stiffest set when None.
    """

    arm: Arm
    motion: Motion
    variables: tuple[Variable, ...]
    measure: str = "peak"
    draws: Draws = field(default_factory=dict)
    also: tuple[str, ...] = ()
    loads: Loads | None = None
    elastic_belts: bool = False
    rate: float = RATE
    step: float | None = None

    @property
    def size(self) -> int:
        """Number of sets at a place."""
        return 1 + (len(next(iter(self.draws.values()))) if self.draws else 0)

    @property
    def alone(self) -> "Evaluator":
        """The same trial of the arm itself, without draws."""
        return replace(self, draws={}, also=(*self.also, *self.draws))

    @property
    def bounds(self) -> Float[np.ndarray, "2 V"]:
        """The changes of the variables at their lower and at their upper bounds."""
        return np.array([variable.span(self.arm) for variable in self.variables]).T

    @property
    def amplitude(self) -> Amplitude:
        """The measure for the motion as it is sampled.

        Raises:
            InputError: no such measure, or none that the motion has.
        """
        return amplitude(self.measure, self.motion, self.rate)

    def sets(self, changes: Float[np.ndarray, "G V"]) -> dict[str, Float[np.ndarray, "sets"]]:
        """Return the numbers of each set after changes."""
        present = self.arm.numbers()
        own = {path: np.append(float(present[path]), values)[None] for path, values in self.draws.items()}
        given = {path: np.asarray(present[path]) for path in self.also or stiffness_paths(self.arm)[:1]}
        values = given | own | apply(present | own, self.variables, list(changes.T[..., None]))
        shape = len(changes), self.size
        return {path: np.broadcast_to(np.asarray(value), shape).ravel() for path, value in values.items()}

    def changed(self, changes: Float[np.ndarray, "G V"]) -> Arm:
        """Return the arm of all sets after changes."""
        return self.arm.replace({path: jnp.asarray(values) for path, values in self.sets(changes).items()})

    def amplitudes(self, changes: Float[np.ndarray, "G V"], progress: Progress = iter) -> Float[np.ndarray, "3 G D"]:
        """Return the amplitudes [m] after changes: at each place that of the arm itself, then those of the draws.

        Raises:
            ModelError: the arm has no stable equilibrium at some place, which is named.
        """
        sets, measured = self.sets(changes), self.amplitude
        count = len(next(iter(sets.values())))
        step = self.step or self.step_for(changes)
        how: dict[str, Any] = {"loads": self.loads, "elastic_belts": self.elastic_belts, "rate": self.rate}

        def run(first: int) -> np.ndarray:
            values = {path: jnp.asarray(column[first : first + BATCH]) for path, column in sets.items()}
            return np.asarray(measured(vibrations(self.arm.replace(values), self.motion, step=step, **how)))

        starts = range(0, count, BATCH)
        try:
            found = [run(starts[k]) for k in progress(range(len(starts)))]
        except ModelError as error:
            raise ModelError(self._collapse(changes) or str(error)) from None
        return np.concatenate(found, 1).reshape((3, len(changes), self.size))

    def step_for(self, changes: Float[np.ndarray, "G V"]) -> float:
        """Return the time step [s] that the stiffest of these sets asks for."""
        return step_for(self.changed(changes), self.motion)

    def slopes(
        self, change: Float[np.ndarray, "V"], which: slice = slice(None)
    ) -> tuple[Float[np.ndarray, "3 W sets"], Float[np.ndarray, "V 3 W sets"]]:
        """Return the parts of which an amplitude is the largest, and their exact derivatives by the changes.

        Args:
            change: where.
            which: of the sets; the first is the arm itself.
        """
        sets = {path: values[which] for path, values in self.sets(change[None]).items()}
        step = self.step or self.step_for(change[None])
        solve = fast_method(self.arm, self.motion, self.loads, self.elastic_belts, self.rate, step)
        measured, found, slopes = self.amplitude, np.zeros(0), []
        for first in range(0, len(self.variables), WIDTH):
            given = sets, self._directions(sets, self.variables[first : first + WIDTH])
            pair = by_chunk(lambda given: _pushed(self.arm, given, solve, measured), given, chunk=1)
            found, pushed = (np.moveaxis(np.asarray(part), 0, -1) for part in pair)
            slopes.append(pushed)
        if not np.isfinite(found).all():
            raise ModelError(self._collapse(change[None]) or f"no response to {self.motion.name}: the arm collapses")
        return found, np.concatenate(slopes)[: len(self.variables)]

    @staticmethod
    def _directions(
        sets: Mapping[str, np.ndarray], variables: Sequence[Variable]
    ) -> dict[str, Float[np.ndarray, "sets WIDTH"]]:
        """Return how the numbers of each set change with each variable; not at all with those that fill up."""
        directions = {path: np.zeros((len(values), WIDTH)) for path, values in sets.items()}
        for k, variable in enumerate(variables):
            for path in variable.paths:
                directions[path][:, k] = 1.0 if variable.shifted else sets[path]
        return directions

    def end_states(self, changes: Float[np.ndarray, "G V"]) -> EndState:
        """Return how the arm itself stands after changes."""
        return end_states(self.alone.changed(changes), self.motion, self.loads)

    def values(self, changes: Float[np.ndarray, "V"]) -> dict[str, float]:
        """Return the numbers of the arm itself after changes, by path."""
        each = [np.asarray(change) for change in changes]
        return {path: float(value) for path, value in apply(self.arm.numbers(), self.variables, each).items()}

    def _collapse(self, changes: Float[np.ndarray, "G V"]) -> str:
        """Name the first place at which the arm does not stand; empty if it does everywhere."""
        if not self.variables:
            return ""
        for place in np.flatnonzero(~(np.asarray(self.end_states(changes).frequency) > 0)):
            values = self.values(changes[place])
            told = ", ".join(f"{v.name} = {values[v.paths[0]]:.4g}" for v in self.variables)
            return f"the arm collapses at {told}: no stable equilibrium; narrow the range"
        return ""


@jit
def _pushed(
    arm: Arm, given: tuple[dict[str, Array], dict[str, Array]], solve: FastMethod, measured: Amplitude
) -> tuple[Float[Array, "S 3 W"], Float[Array, "S V 3 W"]]:
    """Return parts and slopes, set by set; the directions of each are pushed forward together."""

    def one(pair: tuple[dict[str, Array], dict[str, Array]]) -> tuple[Array, Array]:
        values, directions = pair
        found, push = jax.linearize(lambda now: measured.parts(vibration_of(solve(arm.replace(now)))), values)
        return found, jax.vmap(push)(directions)

    return jax.lax.map(one, given)
