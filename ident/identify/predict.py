"""The one function that all inference calls: from an arm's numbers to what a campaign would measure."""

from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from ident.arm.arm import Arm
from ident.arm.chain import Chain, at_posture
from ident.arm.equilibrium import StaticEquilibrium, static_equilibrium
from ident.arm.modes import (
    Modes,
    damped_eigenvalues,
    linearize,
    lowest_eigenpairs,
    modes_about,
    to_hertz,
)
from ident.arm.motors import coordinates, modal_mass
from ident.identify.conditions import Conditions, Unnamed
from ident.identify.definitions import NotAllUndamped, by_definition, defined
from ident.identify.loops import with_loops, without_loops
from ident.identify.mode_assignment import AT_FIRST, how_far_off, most_probable, overlap, said_costs
from ident.identify.mode_choice import lowest_left, pick, picked
from ident.identify.parts import Parts as ConditionsInParts
from ident.identify.parts import in_parts
from ident.identify.readings import read
from ident.identify.setups import Frames, in_base_frame, without_frames
from ident.identify.shapes import read_shapes
from ident.identify.uncertain import LOAD, scaled_inertia, scaled_loads
from ident.inference.parameters import AnyArray
from ident.inference.problem import Choice, Choosing, Data, Growing, Parts


class Held(eqx.Module):
    """How labelled values know their modes from one step of a fit to the next.

    Attributes:
        shape: (n, R) mass-normalised shape of each labelled value.
        place: (n, R) one for its place among the modes in ascending order, zero for the others.
        off: by how much the frequencies were off, as a fraction.
        fresh: whether the most probable modes are taken instead.
        in_order: whether the place counts, not the shape.
    """

    shape: Float[AnyArray, "n R"]
    place: Float[AnyArray, "n R"]
    off: Float[AnyArray, ""]
    fresh: Bool[AnyArray, ""]
    in_order: Bool[AnyArray, ""]

    def anew(self) -> "Held":
        """Return what lets the most probable modes be taken at the next point."""
        return replace(self, fresh=np.array(True), in_order=np.array(False))

    def ordered(self) -> "Held":
        """Return what holds places, not shapes."""
        return replace(self, in_order=np.array(True))

    def likened(self) -> "Held":
        """Return what holds shapes, not places."""
        return replace(self, in_order=np.array(False))


class ArmModel(eqx.Module, Choosing, Growing):
    """An arm and the conditions of a campaign, as the model of an `InverseProblem`."""

    arm: Arm
    conditions: Conditions
    scaled: tuple[str, ...] = eqx.field(static=True, default=())
    """Bodies whose inertia goes with their mass."""
    frames: Frames | None = None
    """Where the frames of setups are first; None without."""

    def at(self, parameters: Mapping[str, Any]) -> tuple[Arm, dict[str, Any], Conditions]:
        """Return the arm, its numbers, and the conditions in the base frame, lags of ramps known."""
        arm = scaled_inertia(self.arm, parameters, self.scaled)
        conditions = with_loops(in_base_frame(self.conditions, self.frames, parameters), parameters)
        return arm, without_loops(without_frames(parameters)), conditions

    def __call__(self, parameters: Mapping[str, Any], data: Data | None = None) -> Float[Array, "D *batch"]:
        """Predict the campaign's values [SI] for these numbers of the arm."""
        return predict(*self.at(parameters), data)

    def padded(self) -> tuple["ArmModel", np.ndarray, np.ndarray]:
        """Return a model of one of few sizes, which of its own values each is like, and where each of its own is."""
        conditions, source, places = self.conditions.padded()
        return replace(self, conditions=conditions), source, places

    def in_parts(self) -> Parts | None:
        """Return a model of many states in parts of one size, None for one that stays whole."""
        parts = in_parts(self.conditions)
        if parts is None:
            return None
        source = np.asarray(self.conditions.repeats.first)[parts.values]
        places = parts.places[np.asarray(self.conditions.order)]
        models = tuple(replace(self, conditions=each) for each in parts.conditions)
        return Parts(models, source, places, partial(_split, parts), partial(_joined, parts))

    def unheld(self) -> Held | None:
        """Return what is held before the first step; None where nothing is labelled."""
        count = len(self.conditions.named.states)
        motors = 0 if self.conditions.servo is None else len(self.arm.servos)
        blank, no = np.zeros((3 * len(self.arm.joints) + motors, count)), np.array(False)
        return Held(blank, blank, np.array(AT_FIRST), np.array(True), no) if count else None

    def holding(self, parameters: Mapping[str, Any], data: Data, held: Held) -> tuple[Float[Array, "D"], Choice]:
        """Predict the campaign's values, each label at the mode whose shape it holds."""
        arm, parameters, conditions = self.at(parameters)
        values, chain = conditions.named, chains(arm, parameters, conditions)
        data = self.conditions.repeats.pooled(data)
        at = static_equilibrium(chain)
        modes = modes_about(chain, at)
        table = by_definition(modes.frequency, chain, at, conditions.definitions)
        hertz = defined(table, values.states, self.conditions.labelled)
        wanted = most_probable(values, modes, data, held.off, hertz=hertz)
        shapes, M = modes.shape[:, :, values.states], modal_mass(chain, at.phi)[:, :, values.states]
        likeness = jnp.where(held.in_order, held.place, overlap(shapes, M, held.shape))
        same = (jnp.argmax(likeness, 0) == jnp.arange(len(likeness))[:, None]).astype(float)
        chosen = jax.lax.stop_gradient(jnp.where(held.fresh, wanted, same))
        against = said_costs(values, modes, chosen)
        cost = jnp.pad(against, (0, self.conditions.count - len(against)))[self.conditions.order]
        off, no = how_far_off(values, hertz, data, chosen), jnp.array(False)
        now = Held((shapes * chosen[None]).sum(1), chosen, off, no, held.in_order)
        choice = Choice(now, (chosen == wanted).all(), cost)
        return _values(chain, at, conditions, (modes, table), chosen, data), jax.lax.stop_gradient(choice)


def _split(parts: ConditionsInParts, held: Held | None) -> list[Held | None]:
    """Give each part its own of what the whole holds."""
    if held is None:
        return [None for _ in parts.conditions]
    own = parts.values[:, : parts.labels]
    return [Held(held.shape[:, i], held.place[:, i], held.off, held.fresh, held.in_order) for i in own]


def _joined(parts: ConditionsInParts, each: list[Held | None]) -> Held | None:
    """Put together what the parts hold; frequencies are off by the mean square of the parts."""
    helds = [held for held in each if held is not None]
    if not helds:
        return None
    part, place = np.divmod(parts.places[: parts.labelled], parts.values.shape[1])
    columns = part * parts.labels + place
    shape, places = (np.concatenate(x, 1)[:, columns] for x in zip(*((h.shape, h.place) for h in helds), strict=True))
    off = np.asarray(np.sqrt(np.mean([held.off**2 for held in helds])))
    return Held(shape, places, off, helds[0].fresh, helds[0].in_order)


def predict(
    arm: Arm, parameters: Mapping[str, Any], conditions: Conditions, data: Data | None = None
) -> Float[Array, "D *batch"]:
    """Predict what the campaign would measure on an arm with these numbers; differentiable.

    Args:
        arm: the arm.
        parameters: numbers by path, `()` or `(*batch)` each, in place of the arm's own.
        conditions: from `bind`.
        data: what was measured: it helps to tell which mode a label means, and which modes are as good as one.

    Returns:
        `(D, *batch)` in the campaign's order: frequencies [Hz], deflections [m], rotations [rad], damping ratios
        [-]. NaN where the arm has no stable equilibrium.
    """
    values, chain = conditions.named, chains(arm, parameters, conditions)
    data = None if data is None else conditions.repeats.pooled(data)
    at = static_equilibrium(chain)
    if not len(values.states):
        return _values(chain, at, conditions, (None, None), None, data)
    modes = modes_about(chain, at)
    table = by_definition(modes.frequency, chain, at, conditions.definitions)
    hertz = defined(table, values.states, conditions.labelled)
    chosen = most_probable(values, modes, data, 0.0, hertz=hertz)
    return _values(chain, at, conditions, (modes, table), chosen, data)


def chains(arm: Arm, parameters: Mapping[str, Any], conditions: Conditions) -> Chain:
    """Hold the arm with these numbers in every state of the campaign; batch `(S, *batch)`."""
    rank = max((jnp.ndim(value) for value in parameters.values()), default=0)

    def lift(x: AnyArray) -> Array:
        return jnp.asarray(x).reshape(x.shape + (1,) * rank)

    loads = jax.tree.map(lift, conditions.loads)
    if LOAD in parameters:
        loads = scaled_loads(loads, parameters[LOAD])
        parameters = {path: value for path, value in parameters.items() if path != LOAD}
    servo = None if conditions.servo is None else lift(conditions.servo)
    return at_posture(arm.replace(parameters), lift(conditions.posture), loads, servo)


def _values(
    chain: Chain,
    at: StaticEquilibrium,
    conditions: Conditions,
    solved: tuple[Modes | None, Float[Array, "K m S *batch"] | None],
    chosen: Array | None,
    data: Data | None,
) -> Float[Array, "D *batch"]:
    """Return all values, given all modes, their frequencies (`by_definition`) and the mode of each labelled value."""
    modes, table = solved
    named, unnamed, readings = conditions.named, conditions.unnamed, conditions.readings
    first = named.frequencies
    values: list[Array] = []
    if chosen is None and unnamed.highest:
        count = min(unnamed.highest + 1, coordinates(chain))
        hertz = to_hertz(lowest_eigenpairs(chain, at, count=count)[0])
        table = by_definition(hertz, chain, at, conditions.definitions)
        own, above = (_nth(table, unnamed, beyond, conditions.unlabelled) for beyond in (0, 1))
        values.append(_counted(own, above, conditions, data))
    if table is not None and chosen is not None:
        values = [picked(defined(table, named.states[:first], conditions.labelled), chosen[:, :first])]
        if named.ratios:
            ratios = slice(first, first + named.ratios)
            values.append(pick(_damping_ratios(chain, at), chosen[:, ratios], named.states[ratios]))
        if conditions.shapes is not None and modes is not None:
            last = slice(first + named.ratios, None)
            values.append(read_shapes(chain, at, modes, conditions.shapes, named.states[last], chosen[:, last]))
        if unnamed.highest:
            nth, next_one = (lowest_left(conditions, chosen, beyond) for beyond in (0, 1))
            hertz = defined(table, unnamed.states, conditions.unlabelled)
            own, above = (picked(hertz, mode) for mode in (nth, next_one))
            values.append(_counted(own, above, conditions, data))
    if len(readings.states):
        values.append(read(chain, at.phi, readings))
    return jnp.concatenate(values)[conditions.order]


def _nth(
    table: Float[Array, "K m S *batch"], unnamed: Unnamed, beyond: int, definitions: NotAllUndamped
) -> Float[Array, "n *batch"]:
    """Return the frequency of each unnamed value's mode, or of the one so many places beyond it."""
    place = unnamed.ordinals - 1 + beyond
    return table[0 if definitions is None else definitions, place, unnamed.states]


def _counted(
    own: Float[Array, "n *batch"], above: Float[Array, "n *batch"], conditions: Conditions, data: Data | None
) -> Float[Array, "n *batch"]:
    """Return the frequencies of the unnamed values, smooth where the highest measured mode and the next one cross.

    The n-th frequency from below, the lesser of two that cross, has a ridge there, on which a search would get stuck.
    Two modes nearer than a standard deviation s of the value are taken for coupled, so that the lower one is pushed
    down by (s - gap)^2 / 4s, at most s/4: a smooth minimum (Quilez, "Smooth minimum", 2013, the quadratic one).
    Between two measured modes none is needed: there the cost is highest on the ridge.
    """
    if data is None:
        return own
    unnamed, before = conditions.unnamed, len(conditions.named.states)
    sigma = data.sigma[before : before + len(own)]
    sigma = jnp.reshape(sigma, sigma.shape + (1,) * (own.ndim - sigma.ndim))
    last = jnp.reshape(unnamed.last, (-1,) + (1,) * (own.ndim - 1)) & jnp.isfinite(sigma)
    s = jnp.where(last, sigma, 1.0)
    short = jnp.where(last & (above - own < s), s - (above - own), 0.0)
    return own - short**2 / (4 * s)


def _damping_ratios(chain: Chain, at: StaticEquilibrium) -> Float[Array, "m S *batch"]:
    s = damped_eigenvalues(linearize(chain, at))
    return -s.real / jnp.abs(s)
