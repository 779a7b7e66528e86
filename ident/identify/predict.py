"""The one function that all inference calls: from an arm's numbers to what a campaign would measure."""

from collections.abc import Hashable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cached_property, partial
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from ident.arm.arm import Arm
from ident.arm.chain import Chain, at_posture
from ident.arm.mechanics import (
    StaticEquilibrium,
    deflection,
    equilibrium,
    modal_mass,
    mode_count,
    point_positions,
    point_rotations,
    static_equilibrium,
)
from ident.arm.modes import Modes, lowest_eigenpairs, modes_about, to_hertz
from ident.arm.rotations import identity, matmul, matvec, rotation, rotation_vector, transpose
from ident.errors import refusal
from ident.identify.conditions import Conditions, Readings, by_definition, defined, lifted, read_shapes, with_hysteresis
from ident.identify.mode_matching import AT_FIRST, label_costs, most_probable, overlap, rms_log_error
from ident.identify.padding import Parts as ConditionsInParts
from ident.identify.padding import in_parts, padded
from ident.identify.unknowns import SETUP, is_of_readings, with_numbers
from ident.inference.parameters import AnyArray, Parameter
from ident.inference.problem import Choice, Choosing, Data, Growing, Parts
from ident.measure import Campaign, Measurement
from ident.measure.kinds import POSITIONS
from ident.programs import jit
from ident.text import by_key

# -------- Mode choice
# Mode of each measured value, as a one-hot matrix, and selection by it.


def mode_choice(
    conditions: Conditions, modes: Modes, chosen: Float[AnyArray, "m R *batch"] | None = None
) -> tuple[Float[Array, "m R *batch"], Float[Array, "m n *batch"]]:
    """Return 1 for the mode of each named value, and for the mode of each unnamed one.

    Args:
        conditions: from `bind`.
        modes: all modes of all states.
        chosen: 1 for the mode of each named value; by default from the labels alone.
    """
    if chosen is None:
        values = conditions.named
        chosen = most_probable(values, modes, None, 0.0) if len(values.states) else jnp.zeros((len(modes.frequency), 0))
    return jnp.asarray(chosen), lowest_left(conditions, jnp.asarray(chosen))


def lowest_left(
    conditions: Conditions, chosen: Float[Array, "m R *batch"], beyond: int = 0
) -> Float[Array, "m n *batch"]:
    """Return 1 for the mode of each unnamed value: the lowest modes without a label in the same state.

    With `beyond`, for the mode that many places higher among these.
    """
    named, unnamed, first = conditions.named, conditions.unnamed, conditions.named.frequencies
    none = jnp.zeros((len(chosen), 1, *chosen.shape[2:]))
    own = jnp.concatenate([chosen[:, :first], none], 1)
    free = (own[:, named.at].sum(1) == 0)[:, unnamed.states]
    ordinal = jnp.reshape(unnamed.ordinals + beyond, (-1,) + (1,) * (chosen.ndim - 2))
    return (free & (jnp.cumsum(free, 0) == ordinal)).astype(float)


def picked(values: Float[Array, "m D *batch"], choice: Float[Array, "m D *batch"]) -> Float[Array, "D *batch"]:
    """Return the chosen one of each value's modes; NaN if there is none."""
    return jnp.where(choice.sum(0) > 0, (values * choice).sum(0), jnp.nan)


# -------- Readings
# Readings of an arm at rest: deflections, positions, rotations, twists, alone or relative to another load.


def read(chain: Chain, phi: Float[Array, "3 N S *#batch"], readings: Readings) -> Float[Array, "n *batch"]:
    """Return the readings of a chain with bushing rotations phi: deflections and positions [m], angles [rad].

    A rotation is the component d'log(R R0') of the rotation vector of the point's body, with R0 its axes under the
    reference load, or at phi = 0 without one. So a difference is the rotation from one load case to the other; both are
    in the base frame, right-handed.

    A twist is the component of a bushing's rotation vector along its pin's axis, on which the torsional stiffness acts:
    the link's angle less the motor's angle over the ratio.

    A reading on a ramp of loads lags by half the width of its loop.
    """
    none = jnp.zeros((len(readings.states), *phi.shape[3:]))
    moved = _deflections(deflection(chain, phi), readings) if chain.carrier else none
    if readings.placing is not None:
        at = point_positions(chain, phi)[:, readings.points, readings.states]
        places = (at * _along(readings, at.ndim - 2)).sum(0)
        if readings.datum is not None:  # counted from the origin of each one's frame
            places = places - lifted(readings.datum, places.ndim - jnp.ndim(readings.datum))
        moved = jnp.where(lifted(readings.placing, moved.ndim - 1), places, moved)
    if readings.turning is not None:
        turns = _rotations(point_rotations(chain, phi), readings)
        moved = jnp.where(lifted(readings.turning, moved.ndim - 1), turns, moved)
    if readings.twisting is not None:
        twists = _deflections(matvec(transpose(chain.frame), phi), readings)  # of joints, about their pins' axes
        moved = jnp.where(lifted(readings.twisting, moved.ndim - 1), twists, moved)
    return moved if readings.lag is None else moved + lifted(readings.lag, moved.ndim - jnp.ndim(readings.lag))


def _deflections(moved: Float[Array, "3 P S *batch"], readings: Readings) -> Float[Array, "n *batch"]:
    """Return the displacement of points along their directions, or the rotation of bushings about theirs."""
    rank = moved.ndim - 3
    start = moved[:, readings.points, jnp.maximum(readings.references, 0)]
    start = jnp.where(lifted(readings.references >= 0, rank), start, 0.0)
    return ((moved[:, readings.points, readings.states] - start) * _along(readings, rank)).sum(0)


def _rotations(axes: Float[Array, "3 3 P S *batch"], readings: Readings) -> Float[Array, "n *batch"]:
    """Return the rotation of the points' bodies about the directions."""
    rank = axes.ndim - 4
    start = axes[:, :, readings.points, jnp.maximum(readings.references, 0)]
    start = jnp.where(lifted(readings.references >= 0, rank), start, identity(3, rank + 1))
    turn = rotation_vector(matmul(axes[:, :, readings.points, readings.states], transpose(start)))
    return (turn * _along(readings, rank)).sum(0)


def _along(readings: Readings, rank: int) -> Float[AnyArray, "3 n *batch"]:
    """Return the directions with as many batch axes as the predictions have."""
    return lifted(readings.direction, rank + 2 - jnp.ndim(readings.direction))


@jit
def bushing_moments(arm: Arm, conditions: Conditions) -> Float[Array, "2 N S"]:
    """Return the size of the moment [N m] on each bushing in each state, across its axis and about it."""
    chain = chains(arm, conditions)
    phi = equilibrium(chain)
    moment = matvec(chain.stiffness, phi)
    moment = moment if chain.curved is None else moment + chain.curved.torque(phi)
    axis = jnp.stack([joint.axis for joint in arm.joints], 1)[:, :, None]
    own_axes = matvec(transpose(chain.frame), moment)
    along = (axis * own_axes).sum(0)
    return jnp.stack([jnp.sqrt(((own_axes - axis * along) ** 2).sum(0)), jnp.abs(along)])


# -------- Measurement frames
# Measurement frames, such as a laser tracker's: start of the search, and unknowns.

STEP = 1e-3
"""Unit of theta: 1 mm of a frame's origin, 1 mrad of its orientation."""
FREE_RANK = 1e-6
"""Share of the largest singular value below which readings do not determine a frame's orientation or origin."""
AXES = "xyz"


class Frames(eqx.Module):
    """Measurement frames in the base frame.

    Attributes:
        names: of the frames.
        origin: (3, K) [m]
        axes: (3, 3, K) their axes, columns.
    """

    names: tuple[str, ...] = eqx.field(static=True)
    origin: Float[AnyArray, "3 K"]
    axes: Float[AnyArray, "3 3 K"]

    def at(self, parameters: Mapping[str, Any]) -> tuple[Float[Array, "3 K *batch"], Float[Array, "3 3 K *batch"]]:
        """Return origins and axes with these parameters: origins as given, orientations by a further small rotation."""
        rank = max((jnp.ndim(value) for value in parameters.values()), default=0)
        origin, axes = (jnp.asarray(x).reshape(x.shape + (1,) * rank) for x in (self.origin, self.axes))
        zero = jnp.zeros_like(origin)
        place = _stacked(parameters, self.names, "", origin)
        return place, matmul(rotation(_stacked(parameters, self.names, "turn.", zero)), axes)


def vector_of(m: Measurement) -> Hashable | None:
    """Return the key shared by all rows that are components of one reading in a frame; None for any other row."""
    if m.direction is None or not m.setup:
        return None
    return m.kind, m.posture, m.point, m.setup, m.load, m.reference_load, m.ramp, m.drives, m.repeat


def vectors_of(campaign: Campaign) -> Int[np.ndarray, "D"] | None:
    """Return the number of each row's vector, see `InverseProblem`; None if no vector has several rows."""
    numbers: dict[Hashable, int] = {}
    shared = [vector_of(m) for m in campaign]
    found = [numbers.setdefault(row if each is None else each, len(numbers)) for row, each in enumerate(shared)]
    return np.array(found) if len(numbers) < len(found) else None


def _stacked(parameters: Mapping[str, Any], names: Sequence[str], part: str, known: Array) -> Array:
    """Return each frame's three numbers; those that are not parameters keep their known values."""

    def row(i: int, axis: str) -> Array:
        each = (parameters.get(f"{SETUP}{name}.{part}{axis}", known[i, k]) for k, name in enumerate(names))
        return jnp.stack(jnp.broadcast_arrays(*map(jnp.asarray, each)))

    return jnp.stack(jnp.broadcast_arrays(*(row(i, axis) for i, axis in enumerate(AXES))))


def in_base_frame(conditions: Conditions, frames: Frames | None, parameters: Mapping[str, Any]) -> Conditions:
    """Return the conditions with all readings in the base frame, with these numbers for the measurement frames."""
    readings = conditions.readings
    if frames is None or readings.setup is None:
        return conditions
    origin, axes = frames.at(parameters)
    rank, k = origin.ndim - 2, jnp.maximum(jnp.asarray(readings.setup), 0)
    own = jnp.asarray(readings.direction).reshape(*readings.direction.shape, *(1,) * rank)
    outside = (jnp.asarray(readings.setup) < 0).reshape(-1, *(1,) * rank)
    direction = jnp.where(outside, own, matvec(axes[:, :, k], own))
    datum = jnp.where(outside, 0.0, (origin[:, k] * direction).sum(0))
    return replace(conditions, readings=replace(readings, direction=direction, datum=datum, setup=None))


def setup_parameters(campaign: Campaign, frames: Frames | None) -> tuple[Parameter, ...]:
    """Return the unknowns of the frames: nuisances, with a flat prior if a frame is free.

    Differences and rotations depend on a frame's orientation only; the origin is then no unknown.
    """
    if frames is None:
        return ()
    found = []
    for name, origin in zip(frames.names, np.asarray(frames.origin).T, strict=True):
        setup, placed = campaign.setups[name], any(m.setup == name and m.kind in POSITIONS for m in campaign)
        place_sigma = setup.sigma if placed else 0.0
        for part, sigma, start in (("turn.", setup.turn_sigma, np.zeros(3)), ("", place_sigma, origin)):
            # theta counts mm and mrad, or standard deviations
            scale, sd = (sigma, 1.0) if np.isfinite(sigma) else (STEP, np.inf)
            for axis, value in zip(AXES, start, strict=True) if sigma else ():
                found.append(Parameter((f"{SETUP}{name}.{part}{axis}",), False, value, value, sd, scale, nuisance=True))
    return tuple(found)


def frames_of(arm: Arm, campaign: Campaign, conditions: Conditions) -> Frames | None:
    """Return the campaign's measurement frames, known or estimated; None without frames.

    Unknown parts of a frame are estimated from triads, readings of one quantity along three directions: first the
    rotation from the triads to the arm file's predictions (Kabsch, "A solution for the best rotation to relate two sets
    of vectors", Acta Cryst. A32, 1976), then the origin. The fit starts from there.

    Args:
        arm: as in its file.
        campaign: the measurements.
        conditions: of the campaign.

    Raises:
        InputError: neither triads nor other data determine a frame's orientation.
    """
    names = tuple(dict.fromkeys(m.setup for m in campaign if m.setup))
    if not names:
        return None
    expected = np.asarray(_expected(arm, conditions))
    place = np.asarray(conditions.order) - (conditions.count - expected.shape[1])
    rows = [(m, expected[:, i]) for m, i in zip(campaign, place, strict=True) if m.setup]
    each = [_frame(campaign, name, [row for row in rows if row[0].setup == name]) for name in names]
    return Frames(names, np.array([origin for origin, _ in each]).T, np.moveaxis(np.array([R for _, R in each]), 0, 2))


@jit
def _expected(arm: Arm, conditions: Conditions) -> Float[Array, "3 n"]:
    """Return each reading as a vector in the base frame: where the point is, how it moves, or how its body turns."""
    readings, chain = conditions.readings, chains(arm, conditions)
    phi = static_equilibrium(chain).phi

    def along(axis: Float[Array, "3"]) -> Float[Array, "n"]:
        direction = jnp.broadcast_to(axis[:, None], readings.direction.shape)
        return read(chain, phi, replace(readings, direction=direction, setup=None, loop=None))

    return jax.vmap(along)(jnp.eye(3))


def _frame(
    campaign: Campaign, name: str, rows: Sequence[tuple[Measurement, np.ndarray]]
) -> tuple[np.ndarray, np.ndarray]:
    """Return origin and axes of one frame."""
    from scipy.spatial.transform import Rotation  # takes 0.1 s to import, and campaigns without frames do not need it

    setup = campaign.setups[name]
    triads = list(_triads(rows))
    placed = np.array([m.kind in POSITIONS for m, _, _ in triads], bool)
    known = None if setup.turn is None else Rotation.from_rotvec(setup.turn).as_matrix()
    R = _aligned(campaign, name, triads, placed) if known is None else known
    if setup.origin is not None or not placed.any():
        return np.array(setup.origin or (0.0, 0.0, 0.0)), R
    own, base = (np.array([each[i] for each in triads])[placed] for i in (1, 2))
    return (base - own @ R.T).mean(0), R


def _aligned(
    campaign: Campaign, name: str, triads: Sequence[tuple[Measurement, np.ndarray, np.ndarray]], placed: np.ndarray
) -> np.ndarray:
    """Return the axes with the best agreement of readings and predictions."""
    from scipy.spatial.transform import Rotation

    own, base = (np.array([each[i] for each in triads]).reshape(-1, 3) for i in (1, 2))
    if placed.any():  # where points are tells how they lie to one another
        own[placed] -= own[placed].mean(0)
        base[placed] -= base[placed].mean(0)
    size = np.maximum(np.linalg.norm(base, axis=1, keepdims=True), 1e-300)
    spread = np.linalg.svd(base, compute_uv=False) if len(base) else np.zeros(3)
    if len(spread) < 2 or spread[1] <= FREE_RANK * spread[0]:
        got = f"the setup {name}, of which it is not known how it is turned, and rows that do not tell"
        expected = "two different vectors at least, each read along three directions"
        where = campaign.setups.path or campaign.path
        raise refusal(where, got, expected, "say how it is turned (data/README.md), or measure more")
    weight = np.where(placed, size.ravel() / size.max(), 1.0)
    own, base = (np.where(placed[:, None], x, x / size) for x in (own, base))
    return Rotation.align_vectors(base, own, weights=np.maximum(weight, 1e-12))[0].as_matrix()


def _triads(rows: Sequence[tuple[Measurement, np.ndarray]]) -> Iterator[tuple[Measurement, np.ndarray, np.ndarray]]:
    """Yield readings along three directions as a vector in the frame, with the predicted vector."""
    blank: dict[str, Any] = {"value": 0.0, "sigma": 1.0, "resolution": 0.0, "group": "", "member": 0, "note": ""}
    same = by_key((replace(m, direction=(1.0, 0.0, 0.0), **blank), (m, vector)) for m, vector in rows)
    for each in same.values():
        directions = np.array([m.direction for m, _ in each])
        if np.linalg.matrix_rank(directions, tol=0.1) == 3:
            values = np.array([m.value for m, _ in each])
            yield each[0][0], np.linalg.lstsq(directions, values, rcond=None)[0], each[0][1]


# -------- Predict


class Matching(eqx.Module):
    """Matching of labelled values to modes, carried from one step of a fit to the next.

    Attributes:
        shape: (n, R) mass-normalised shape of each labelled value.
        place: (m, R) 1 for its order number among the ascending modes, 0 for the others.
        log_error: rms of ln(computed / measured) over the labelled frequencies.
        fresh: whether to take the most probable modes instead.
        in_order: whether to match by order, not by shape.
    """

    shape: Float[AnyArray, "n R"]
    place: Float[AnyArray, "m R"]
    log_error: Float[AnyArray, ""]
    fresh: Bool[AnyArray, ""]
    in_order: Bool[AnyArray, ""]

    def rematched(self) -> "Matching":
        """Return the state that takes the most probable modes at the next point."""
        return replace(self, fresh=np.array(True), in_order=np.array(False))

    def by_place(self) -> "Matching":
        """Return the state that matches by order, not by shape."""
        return replace(self, in_order=np.array(True))

    def by_shape(self) -> "Matching":
        """Return the state that matches by shape, not by order."""
        return replace(self, in_order=np.array(False))


class ArmModel(eqx.Module, Choosing, Growing):
    """An arm and the conditions of a campaign, as the model of an `InverseProblem`."""

    arm: Arm
    conditions: Conditions
    scaled: tuple[str, ...] = eqx.field(static=True, default=())
    """Bodies whose inertia scales with their mass."""
    frames: Frames | None = None
    """Where the frames of setups are at the start; None without."""

    def applied(self, parameters: Mapping[str, Any]) -> tuple[Arm, Conditions]:
        """Return the arm and the conditions with these numbers in place: inertias, frames, hysteresis and loads.

        Args:
            parameters: `()` or `(*batch)` each; the conditions get as many batch axes of length one.
        """
        rank = max((jnp.ndim(value) for value in parameters.values()), default=0)
        conditions = with_hysteresis(in_base_frame(self.conditions, self.frames, parameters), parameters)
        held = conditions.posture, conditions.loads, conditions.servo
        posture, loads, servo = jax.tree.map(lambda x: lifted(x, rank), held)
        own = {name: x for name, x in parameters.items() if not is_of_readings(name)}
        arm, loads = with_numbers(self.arm, loads, own, self.scaled)
        return arm, replace(conditions, posture=posture, loads=loads, servo=servo)

    def __call__(self, parameters: Mapping[str, Any], data: Data | None = None) -> Float[Array, "D *batch"]:
        """Predict the campaign's values [SI] for these numbers of the arm, see `predict`."""
        arm, conditions = self.applied(parameters)
        values, chain = conditions.named, chains(arm, conditions)
        data = None if data is None else conditions.repeats.pooled(data)
        at = static_equilibrium(chain)
        if not len(values.states):
            return _values(chain, at, conditions, (None, None), None, data)
        modes = modes_about(chain, at)
        table = by_definition(modes.frequency, chain, at, conditions.definitions)
        hertz = defined(table, values.states, conditions.labelled)
        chosen = most_probable(values, modes, data, 0.0, hertz=hertz)
        return _values(chain, at, conditions, (modes, table), chosen, data)

    def in_parts(self) -> Parts:
        """Return a model of many states in parts of one size, any other in one part of one of few sizes."""
        return self._parts

    @cached_property
    def _parts(self) -> Parts:
        parts = in_parts(self.conditions)
        if parts is None:
            conditions, own, places = padded(self.conditions)
            return Parts((replace(self, conditions=conditions),), own[None], places)
        source = np.asarray(self.conditions.repeats.first)[parts.values]
        places = parts.places[np.asarray(self.conditions.order)]
        models = tuple(replace(self, conditions=each) for each in parts.conditions)
        return Parts(models, source, places, partial(_split, parts), partial(_joined, parts))

    def first_matching(self) -> Matching | None:
        """Return the matching before the first step; None without labels."""
        count = len(self.conditions.named.states)
        motors = 0 if self.conditions.servo is None else len(self.arm.servos)
        shape, place = (np.zeros((n + motors, count)) for n in (3 * len(self.arm.joints), self.arm.degrees_of_freedom))
        return Matching(shape, place, np.array(AT_FIRST), np.array(True), np.array(False)) if count else None

    def predict_matched(
        self, parameters: Mapping[str, Any], data: Data, held: Matching
    ) -> tuple[Float[Array, "D"], Choice]:
        """Predict the campaign's values, each label at its matched mode."""
        arm, conditions = self.applied(parameters)
        values, chain = conditions.named, chains(arm, conditions)
        data = self.conditions.repeats.pooled(data)
        at = static_equilibrium(chain)
        modes = modes_about(chain, at)
        table = by_definition(modes.frequency, chain, at, conditions.definitions)
        hertz = defined(table, values.states, self.conditions.labelled)
        wanted = most_probable(values, modes, data, held.log_error, hertz=hertz)
        shapes, M = modes.shape[:, :, values.states], modal_mass(chain, at.phi)[:, :, values.states]
        likeness = jnp.where(held.in_order, held.place, overlap(shapes, M, held.shape))
        same = (jnp.argmax(likeness, 0) == jnp.arange(len(likeness))[:, None]).astype(float)
        chosen = jax.lax.stop_gradient(jnp.where(held.fresh, wanted, same))
        against = label_costs(values, modes, chosen)
        cost = jnp.pad(against, (0, self.conditions.count - len(against)))[self.conditions.order]
        log_error, no = rms_log_error(values, hertz, data, chosen), jnp.array(False)
        now = Matching((shapes * chosen[None]).sum(1), chosen, log_error, no, held.in_order)
        choice = Choice(now, (chosen == wanted).all(), cost)
        return _values(chain, at, conditions, (modes, table), chosen, data), jax.lax.stop_gradient(choice)


def _split(parts: ConditionsInParts, held: Matching | None) -> list[Matching | None]:
    """Split the whole's matching into those of the parts."""
    if held is None:
        return [None for _ in parts.conditions]
    own = parts.values[:, : parts.labels]
    return [Matching(held.shape[:, i], held.place[:, i], held.log_error, held.fresh, held.in_order) for i in own]


def _joined(parts: ConditionsInParts, each: list[Matching | None]) -> Matching | None:
    """Join the matchings of the parts; the rms log error is that of all parts."""
    helds = [held for held in each if held is not None]
    if not helds:
        return None
    part, place = np.divmod(parts.places[: parts.labelled], parts.values.shape[1])
    columns = part * parts.labels + place
    shape, places = (np.concatenate(x, 1)[:, columns] for x in zip(*((h.shape, h.place) for h in helds), strict=True))
    log_error = np.asarray(np.sqrt(np.mean([held.log_error**2 for held in helds])))
    return Matching(shape, places, log_error, helds[0].fresh, helds[0].in_order)


def predict(
    arm: Arm, parameters: Mapping[str, Any], conditions: Conditions, data: Data | None = None
) -> Float[Array, "D *batch"]:
    """Predict what the campaign would measure on an arm with these numbers; differentiable.

    Args:
        arm: the arm.
        parameters: numbers by path, `()` or `(*batch)` each, in place of the arm's own.
        conditions: from `bind`.
        data: measured values, for the matching of labels to modes and for smoothing where modes cross.

    Returns:
        `(D, *batch)` in the campaign's order: frequencies [Hz], deflections [m], rotations [rad], ratios of
        shapes [-]. NaN where the arm has no stable equilibrium.
    """
    return ArmModel(arm, conditions)(parameters, data)


def chains(arm: Arm, conditions: Conditions) -> Chain:
    """Hold an arm in every state of a campaign; batch `(S, *batch)`."""
    return at_posture(arm, conditions.posture, conditions.loads, conditions.servo)


Solved = tuple[Modes | None, Float[Array, "K m S *batch"] | None]
"""All modes of all states, and their frequencies by each definition."""


def _values(
    chain: Chain, at: StaticEquilibrium, conditions: Conditions, solved: Solved, chosen: Array | None, data: Data | None
) -> Float[Array, "D *batch"]:
    """Return all values, given all modes, their frequencies (`by_definition`) and the mode of each labelled value."""
    modes, table = solved
    named, unnamed, readings = conditions.named, conditions.unnamed, conditions.readings
    first = named.frequencies
    values: list[Array] = []
    if chosen is None and unnamed.highest:
        count = min(unnamed.highest + 1, mode_count(chain))
        hertz = to_hertz(lowest_eigenpairs(chain, at, count=count)[0])
        table = by_definition(hertz, chain, at, conditions.definitions)
        which = 0 if conditions.unlabelled is None else conditions.unlabelled
        own, above = (table[which, unnamed.ordinals - 1 + beyond, unnamed.states] for beyond in (0, 1))
        values.append(_counted(own, above, conditions, data))
    if table is not None and chosen is not None:
        values = [picked(defined(table, named.states[:first], conditions.labelled), chosen[:, :first])]
        if conditions.shapes is not None and modes is not None:
            values.append(read_shapes(chain, at, modes, conditions.shapes, named.states[first:], chosen[:, first:]))
        if unnamed.highest:
            nth, next_one = (lowest_left(conditions, chosen, beyond) for beyond in (0, 1))
            hertz = defined(table, unnamed.states, conditions.unlabelled)
            own, above = (picked(hertz, mode) for mode in (nth, next_one))
            values.append(_counted(own, above, conditions, data))
    if len(readings.states):
        values.append(read(chain, at.phi, readings))
    return jnp.concatenate(values)[conditions.order]


def _counted(
    own: Float[Array, "n *batch"], above: Float[Array, "n *batch"], conditions: Conditions, data: Data | None
) -> Float[Array, "n *batch"]:
    """Return the frequencies of the unnamed values, smooth where the highest measured mode and the next one cross.

    The n-th frequency from below, the lesser of two that cross, has a ridge there, on which a search would get stuck.
    Two modes nearer than a standard deviation s of the value count as coupled, so that the lower one is pushed down by
    (s - gap)^2 / 4s, at most s/4: a smooth minimum (Quilez, "Smooth minimum", 2013, the quadratic one). Between two
    measured modes no smoothing is needed: there the cost is highest on the ridge.
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
