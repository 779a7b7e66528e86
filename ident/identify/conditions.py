"""A campaign bound to an arm: the conditions of each measured value, as arrays.

Hysteresis: the lag of an arm's deflection while unloading, compared with loading.

Friction in a drive and play in a bearing make readings depend on the loading path. The readings of one loop are assumed
to lie half its width to either side of the elastic deflection,

    read = springs -/+ width / 2,   - while loading, + while unloading,

with the same width at all loads of the ramp. The width is an unknown of its own, without a prior: rows of both branches
determine stiffnesses by their mean, and the width by their difference. Where the width varies with the load, as near
the turning points of a ramp, data and model contradict each other.

References:
    The loop in the torsion of harmonic drives, and its width: Tuttle, Seering, "A nonlinear model of a harmonic drive
    gear transmission", IEEE Trans. Robot. Autom. 12 (3), 1996; makers' catalogues give it as "hysteresis loss".
"""

from __future__ import annotations

from collections.abc import Hashable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Complex, Float, Inexact, Int

from ident.arm.arm import Arm
from ident.arm.chain import Chain, Loads
from ident.arm.mechanics import StaticEquilibrium
from ident.arm.modes import Modes, damped_eigenvalues, linearize, moving_points, moving_points_damped, parse_label
from ident.identify.binding import in_base_axes, load_columns
from ident.identify.mode_matching import Named, name_modes
from ident.identify.unknowns import LOOP, is_of_loop
from ident.inference.parameters import AnyArray, Parameter
from ident.inference.problem import Data
from ident.measure import DEFINITIONS, Campaign, Load, Measurement
from ident.measure.campaign import ROUNDING
from ident.measure.kinds import DIFFERENCES, POSITIONS, RAMPS, ROTATIONS, SHAPES, TWISTS
from ident.text import by_key

# -------- Definitions
# What a measured frequency is of its damped mode: undamped, of the pole, damped, or of a peak; see `DEFINITIONS`.

MOST_DAMPED = 0.7
"""Damping ratio up to which a mode counts as having a peak; from 0.707 on there is none, and near it it is flat."""

NotAllUndamped = Int[AnyArray, "F"] | None
"""What each frequency is, those with a label first, as places in `DEFINITIONS`; None where all are undamped."""


def frequencies_of_pole(s: Complex[Array, "*shape"]) -> tuple[Float[Array, "*shape"], ...]:
    """Return |s|, Im s and the peaks of receptance and accelerance of a mode alone with the pole s, all [Hz].

    A peak is 0 where there is none, beyond a damping ratio of `MOST_DAMPED`; so is Im s of an overdamped mode. All are
    NaN without a pole.
    """
    hertz = jnp.abs(s) / (2 * jnp.pi)
    squared = 1 - 2 * (s.real / jnp.abs(s)) ** 2
    peaked = ~(squared < 1 - 2 * MOST_DAMPED**2)  # of no pole NaN, not 0
    ratio = jnp.sqrt(jnp.where(peaked, squared, 1.0))
    peaks = (jnp.where(peaked, hertz * ratio, 0.0), jnp.where(peaked, hertz / ratio, 0.0))
    return hertz, s.imag / (2 * jnp.pi), *peaks


def by_definition(
    hertz: Float[Array, "m S *batch"], chain: Chain, at: StaticEquilibrium, definitions: NotAllUndamped
) -> Float[Array, "K m S *batch"]:
    """Return the frequencies of the lowest modes by each definition, from the undamped ones; only these where all are.

    The poles are those of the damped arm, exact for dampers of any distribution.
    """
    if definitions is None:
        return hertz[None]
    poles = damped_eigenvalues(linearize(chain, at))[: len(hertz)]
    return jnp.stack([hertz, *frequencies_of_pole(poles)])


def defined(
    table: Float[Array, "K m S *batch"], states: Int[AnyArray, R], definitions: NotAllUndamped
) -> Float[Array, "m R *batch"]:
    """Return the frequencies of each value's state, as the value is defined; undamped from where definitions end."""
    if definitions is None:
        return table[0][:, states]
    own = jnp.pad(jnp.asarray(definitions), (0, len(states) - len(definitions)))
    return jnp.moveaxis(table[own, :, states], 0, 1)


# -------- Hysteresis
# The equations stand at the head of this file.

STEP = 1e-4
"""Size of theta: 0.1 mm, or 0.1 mrad."""


def loop_places(campaign: Campaign) -> list[int]:
    """Return the number of each row's loop, from 1, negative where it was read while loading; 0 for none.

    One loop is of one kind, posture, place that was read and state of the drives; a `repeat` tells ramps apart.
    """
    numbers: dict[Hashable, int] = {}

    def place(m: Measurement) -> int:
        loop = m.kind, m.posture, m.point, m.direction, m.joint, m.setup, m.drives, m.repeat
        return (-1 if m.ramp == RAMPS[0] else 1) * numbers.setdefault(loop, len(numbers) + 1)

    return [place(m) if m.ramp else 0 for m in campaign]


def loop_names(campaign: Campaign) -> dict[int, str]:
    """Return the name of each loop's width, by its number."""
    return {abs(n): f"{LOOP}{abs(n)}:{m.kind}" for m, n in zip(campaign, loop_places(campaign), strict=True) if n}


def loop_parameters(campaign: Campaign) -> tuple[Parameter, ...]:
    """Return the widths of the loops: nuisances without a prior."""
    names = loop_names(campaign).values()
    return tuple(Parameter((name,), False, 0.0, 0.0, np.inf, STEP, nuisance=True) for name in names)


def with_hysteresis(conditions: Conditions, parameters: Mapping[str, Any]) -> Conditions:
    """Return the conditions with the lag of each reading, half the width of its loop."""
    readings = conditions.readings
    if readings.loop is None:
        return conditions
    rank = max((jnp.ndim(value) for value in parameters.values()), default=0)
    own = {int(name.split(":")[1]): jnp.asarray(value) for name, value in parameters.items() if is_of_loop(name)}
    none = jnp.zeros((1,) * rank)
    each = [own.get(number, none) for number in range(max(own, default=0) + 1)]
    widths = jnp.stack(jnp.broadcast_arrays(*(x.reshape(x.shape + (1,) * (rank - x.ndim)) for x in each)))
    side = jnp.sign(jnp.asarray(readings.loop)).reshape(-1, *(1,) * rank) / 2
    return replace(conditions, readings=replace(readings, loop=None, lag=side * widths[jnp.abs(readings.loop)]))


# -------- Repeats
# Which rows of a campaign measured the same thing: it is predicted once, and named by what all of them say.

WIDTH = 8
"""Numbers that are added at once."""


class Repeats(eqx.Module):
    """Sums over the rows of each value.

    Attributes:
        first: (V,) the first row of each value.
        sums: tables of what is added: of rows, then of such sums, until there is one for each value; (C, 8), or (V, 1)
            where nothing was measured twice. One beyond the last stands for nothing.
    """

    first: Int[AnyArray, V]
    sums: tuple[Int[AnyArray, "_ _"], ...]

    def total(self, x: Float[AnyArray, D * batch]) -> Float[Array, V * batch]:
        """Add up what belongs to the rows of each value, in memory and time that grow with the rows alone.

        Not by a scatter: that of XLA on several cores (jax 0.10) does not give the same bits twice.
        """
        for table in self.sums:
            x = jnp.concatenate([x, jnp.zeros((1, *x.shape[1:]))])[table].sum(1)
        return jnp.asarray(x)

    def pooled(self, data: Data) -> Data:
        """Return the mean of the rows of each value, weighted by sigma^-2, and its standard deviation."""
        measured, sigma = (jnp.asarray(x)[self.first] for x in data)
        if self.sums[0].shape[1] == 1:
            return Data(measured, sigma)
        weight = jnp.asarray(data.sigma) ** -2.0
        total = self.total(weight)
        counts = total > 0
        known = jnp.where(counts, total, 1.0)
        mean = self.total(weight * data.measured) / known
        return Data(jnp.where(counts, mean, measured), jnp.where(counts, known**-0.5, jnp.inf))


def repeats(order: Int[np.ndarray, D], first: Int[np.ndarray, V]) -> Repeats:
    """Return how the rows of each value are added up.

    Args:
        order: the value that each row measured.
        first: the first row of each value.
    """
    owner, tables, count = np.asarray(order), list[np.ndarray](), len(first)
    width = 1 if len(owner) == count else WIDTH
    while not tables or len(owner) > count:
        each = np.bincount(owner, minlength=count)
        chunks = -(-each // width)
        ends, ascending = np.cumsum(chunks), np.argsort(owner, kind="stable")
        place = np.arange(len(owner)) - np.repeat(np.cumsum(each) - each, each)
        tables.append(np.full((chunks.sum(), width), len(owner)))
        tables[-1][(ends - chunks)[owner[ascending]] + place // width, place % width] = ascending
        owner = np.repeat(np.arange(count), chunks)
    return Repeats(np.asarray(first), tuple(tables))


def shared_error(
    order: Int[np.ndarray, D], sigma: Float[np.ndarray, D], resolution: Float[np.ndarray, D]
) -> Float[np.ndarray, D]:
    """Return standard deviations that give the mean of repeated readings its correct uncertainty.

    Readings of one value share the error of the display's steps r, so that their mean has the variance

        1 / sum(1 / sigma^2) + r^2 / 12

    (a common error in weighted means: Cowan, "Statistical Data Analysis", 1998, 7.6). Each sigma is raised by the
    factor that gives this; the coarsest r counts. By the same factor counts less what single readings differ by; and
    where they differ by a tenth of r or more, their mean is better than that: both on the safe side.

    Args:
        order: the value that each row measured.
        sigma: [SI] of each row.
        resolution: [SI] of each row; zero for none.
    """
    count = int(order.max(initial=-1)) + 1
    weight, step = np.bincount(order, sigma**-2.0, count), np.zeros(count)
    np.maximum.at(step, order, resolution)
    return np.asarray(sigma * np.sqrt(1 + weight * (ROUNDING * step) ** 2)[order])


# -------- Shapes
# Measured shapes of modes: how a mode moves points along directions, over how it moves a reference.
#
# Design. A row is the ratio r_i of two motions of a mode, so that neither scale nor sign matters; n rows are what is
# known of a shape at n + 1 places, and have n degrees of freedom. The model's own ratio u_i / u_0 runs away where its
# mode does not move the reference. So, with y = (1, r) the measured shape and p the multiple of u that is nearest to y,
#
#     predicted = r + (1 + r r') (p - y)_i,    i = 1 ... n,
#
# which is u_i / u_0 up to the square of their difference, and never larger than the measured shape allows: p - y is
# the residual in the plane across the model's shape.
#
# The shape of a damped mode (`pole`) is complex. Measured and computed ones are turned by the same rule, so that they
# are as real as can be at the places of the shape: by the angle a that makes the sum of (u exp(-i a))^2 positive.
# Their real parts are compared; without damping nothing is turned.
#
# Where another mode b has nearly the same frequency both are known as the plane that they span only, and p may leave
# the direction of u within it: p is the point of that plane that is nearest to y, a step t b across u counting for
# t^2 |u|^2 (g / NEAR)^2, where g is the relative distance of the squared frequencies. So modes far apart are compared
# as they are, modes that coincide as a plane, and the prediction is smooth throughout, as shapes turn by 1/g at most.

NEAR = 0.02
"""Relative distance of squared frequencies at which two modes count half as their plane: 1 % in frequency; assumed."""
SHAPE_ROUNDING = 1e-12
"""The square of that distance below which they are taken to coincide."""


class Shapes(eqx.Module):
    """Rows of shapes, each with the whole shape that it is of, so that they may come in any order.

    Attributes:
        own: (n,) which of the places of its shape a row is; the reference is place 0.
        points: (n, K) points of the arm.
        direction: (3, n, K) unit vectors, zero beyond the places that a shape has.
        ratio: (n, K) measured motion over that of the reference, zero likewise.
        damped: (n,) whether it is the shape of the damped mode; None where none is.
    """

    own: Int[AnyArray, n]
    points: Int[AnyArray, "n K"]
    direction: Float[AnyArray, "3 n K"]
    ratio: Float[AnyArray, "n K"]
    damped: Bool[AnyArray, n] | None = None

    def of(self, places: Int[np.ndarray, _]) -> Shapes:
        """Return some of the rows."""
        damped = None if self.damped is None else self.damped[places]
        return Shapes(self.own[places], self.points[places], self.direction[:, places], self.ratio[places], damped)


def shapes_of(arm: Arm, rows: Sequence[Measurement]) -> Shapes | None:
    """Return rows of shapes as the model needs them; None for none."""
    whole = by_key((_shape(m), m) for m in rows)
    if not whole:
        return None
    names, size = [point.name for point in arm.points], 1 + max(map(len, whole.values()))
    own, points = np.empty(len(rows), int), np.zeros((len(rows), size), int)
    direction, ratio = np.zeros((3, len(rows), size)), np.zeros((len(rows), size))
    for i, m in enumerate(rows):
        each = whole[_shape(m)]
        own[i], ratio[i, 0] = 1 + next(place for place, other in enumerate(each) if other is m), 1.0
        points[i, 0], direction[:, i, 0] = names.index(m.reference_point or ""), m.reference_direction or ()
        for place, other in enumerate(each, 1):
            points[i, place], ratio[i, place] = names.index(other.point or ""), other.value
            direction[:, i, place] = other.direction or ()
    damped = np.array([m.of is not None for m in rows])
    return Shapes(own, points, direction, ratio, damped if damped.any() else None)


def _shape(m: Measurement) -> tuple[object, ...]:
    """Return what rows of one shape have in common."""
    return m.posture, m.load, m.drives, m.mode, m.of, m.reference_point, m.reference_direction, m.repeat


def read_shapes(
    chain: Chain,
    at: StaticEquilibrium,
    modes: Modes,
    shapes: Shapes,
    states: Int[AnyArray, n],
    chosen: Float[AnyArray, "m n *batch"],
) -> Float[Array, n * batch]:
    """Return the readings of the chosen modes' shapes [-]; NaN without a chosen mode.

    Args:
        chain: in all states, batch (S, *batch).
        at: its equilibrium.
        modes: all of its modes.
        shapes: the rows.
        states: of the rows.
        chosen: one for the mode of each row.
    """
    linear = linearize(chain, at)
    motion = moving_points(chain, linear, modes)
    rank = motion.ndim - 4
    each = _seen(motion, shapes, states)
    hertz = modes.frequency[:, states]
    gap = (hertz / (hertz * chosen).sum(0)) ** 2 - 1
    others = jnp.where(chosen > 0, jnp.inf, jnp.abs(gap))
    nearest = jax.lax.stop_gradient(jnp.arange(len(others)).reshape((-1,) + (1,) * (rank + 1)) == jnp.argmin(others, 0))
    u, b = _of_modes(each, chosen), _of_modes(each, nearest)
    weight = (u * u).sum(0) * (((gap * nearest).sum(0) / NEAR) ** 2 + SHAPE_ROUNDING)
    if shapes.damped is not None:
        damped = as_real(_seen(moving_points_damped(chain, linear)[:, :, : len(hertz)], shapes, states))
        u = jnp.where(lifted(shapes.damped, rank), _of_modes(damped, chosen), u)
    read = _compared(jnp.moveaxis(lifted(shapes.ratio, rank), 1, 0), u, b, weight)
    own = jnp.take_along_axis(read, jnp.broadcast_to(lifted(shapes.own, rank), read.shape[1:])[None], 0)[0]
    return jnp.where(chosen.sum(0) > 0, own, jnp.nan)


def _seen(motion: Inexact[Array, "3 P m S *batch"], shapes: Shapes, states: AnyArray) -> Inexact[Array, "n K m *batch"]:
    """Return how the places of each shape move along their directions in all modes."""
    moved = motion[:, jnp.asarray(shapes.points), :, jnp.asarray(states)[:, None]]
    return (moved * jnp.moveaxis(lifted(shapes.direction, motion.ndim - 3), 0, 2)).sum(2)


def _of_modes(each: Float[Array, "n K m *batch"], chosen: AnyArray) -> Float[Array, "K n *batch"]:
    """Return what the chosen mode of each row does."""
    return jnp.moveaxis((each * jnp.moveaxis(chosen, 0, 1)[:, None]).sum(2), 1, 0)


def as_real(shapes: Complex[Array, "n K *batch"]) -> Float[Array, "n K *batch"]:
    """Return the real parts of shapes that are turned so that they are as real as can be."""
    squared = (shapes**2).sum(1, keepdims=True)
    squared = jnp.where(squared == 0, 1.0, squared)  # a mode that moves none of the places
    return (shapes / jnp.sqrt(squared / jnp.abs(squared))).real


def _compared(
    y: Float[AnyArray, "K n *#batch"],
    u: Float[AnyArray, "K n *batch"],
    b: Float[AnyArray, "K n *batch"],
    weight: Float[AnyArray, n * batch],
) -> Float[AnyArray, "K n *batch"]:
    """Return the predicted ratios, of y, u and b (K, n, *batch); that of the reference, which is no row, means nothing.

    A step t b across u counts for t^2 weight (n, *batch).
    """
    length = (u * u).sum(0) + 1e-30
    across = b - u * (u * b).sum(0) / length
    step = (across * y).sum(0) / ((across * across).sum(0) + weight)
    off = u * (u * y).sum(0) / length + across * step - y
    return y + off + y * (y[1:] * off[1:]).sum(0)


def lifted(x: AnyArray, rank: int) -> Array:
    """Give an array as many batch axes as the predictions have."""
    return jnp.asarray(x).reshape(x.shape + (1,) * rank)


# -------- Conditions

BY_MODE = ("frequency", *SHAPES)
State = tuple[tuple[float, ...], Load, str]
"""Posture, load case, and what held the motors."""


class Unnamed(eqx.Module):
    """Measured frequencies without a label: in ascending order, the lowest modes that no label of their state takes.

    Attributes:
        states: (n,) state of each.
        ordinals: (n,) place among those of its state, from 1.
        last: (n,) whether it is the last one of its state, so that the next mode was not measured.
        highest: largest of these places, 0 for none.
    """

    states: Int[AnyArray, n]
    ordinals: Int[AnyArray, n]
    last: Bool[AnyArray, n]
    highest: int = eqx.field(static=True)


class Readings(eqx.Module):
    """Measured deflections, rotations, twists, and differences; what several rows measured is one of them.

    Attributes:
        states: (n,) state of each.
        references: (n,) state that a difference is counted from; -1 for none.
        points: (n,) point that was read; of a twist, the joint.
        direction: (3, n) unit vector along which it was read, or about which it turned; of a twist, the pin's axis in
            the shaft's frame.
        turning: (n,) whether it is a rotation; None where none is.
        twisting: (n,) whether it is a twist; None where none is.
        placing: (n,) whether it is a position, where the point is; None where none is.
        setup: (n,) place of the setup in whose frame it was read, -1 for the base's; None where all are in that, or
            have been turned into it (`predict.in_base_frame`). Directions may have batch axes then.
        datum: (n, *batch) [m] what a position is counted from, along its direction; None likewise.
        loop: (n,) which loop of a ramp it is of, from 1, negative where it was read while loading, 0 for none; None
            where all are of none, or their `lag` is known.
        lag: (n, *batch) [m or rad] by how much it lags behind, half the width of its loop (`with_hysteresis`).
    """

    states: Int[AnyArray, n]
    references: Int[AnyArray, n]
    points: Int[AnyArray, n]
    direction: Float[AnyArray, "3 n *batch"]
    turning: Bool[AnyArray, n] | None = None
    twisting: Bool[AnyArray, n] | None = None
    placing: Bool[AnyArray, n] | None = None
    setup: Int[AnyArray, n] | None = None
    datum: Float[AnyArray, n * batch] | None = None
    loop: Int[AnyArray, n] | None = None
    lag: Float[AnyArray, n * batch] | None = None

    def by_kind(self) -> list[Int[np.ndarray, _]]:
        """Return the places of deflections, rotations, twists and positions, each by itself and as differences."""
        difference = np.asarray(self.references) >= 0
        what = np.zeros(len(difference), int)
        for code, those in ((1, self.turning), (2, self.twisting), (3, self.placing)):
            what = what if those is None else np.where(those, code, what)
        return [np.flatnonzero((what == code) & (difference == differs)) for code in range(4) for differs in (0, 1)]

    def of(self, places: Int[np.ndarray, _]) -> Readings:
        """Return some of them."""
        own = {name: x[places] for name, x in vars(self).items() if name != "direction" and x is not None}
        return replace(self, direction=self.direction[:, places], **own)


class Conditions(eqx.Module):
    """The states (posture and load case) in which an arm was measured, and what was read in each.

    States and places are arrays, so that another campaign of the same sizes, kinds and names of modes finds its
    program compiled; `padding` makes few of these sizes.

    Attributes:
        posture: (joints, S, *ones) [rad]; axes of length one come with `ArmModel.applied`, to loads and servo too
        loads: load cases, batch (S).
        named: values of modes that have a label.
        unnamed: frequencies without.
        readings: deflections, rotations, and differences.
        order: (D,) the value that each row measured: its place among named, unnamed and readings in turn.
        repeats: the rows of each value.
        definitions: what each frequency is, those with a label first.
        servo: (S,) 1 where servos of the arm held its motors, 0 where brakes did; None where they did everywhere.
        shapes: what the named values that are of shapes say; None where none are.
    """

    posture: Float[AnyArray, "joints S ..."]
    loads: Loads
    named: Named
    unnamed: Unnamed
    readings: Readings
    order: Int[AnyArray, D]
    repeats: Repeats
    definitions: NotAllUndamped = None
    servo: Float[AnyArray, "S ..."] | None = None
    shapes: Shapes | None = None

    @property
    def damped(self) -> bool:
        """Whether what was measured depends on damping: frequencies or shapes of damped modes."""
        return self.definitions is not None or (self.shapes is not None and self.shapes.damped is not None)

    @property
    def labelled(self) -> NotAllUndamped:
        """What each frequency with a label is."""
        return None if self.definitions is None else self.definitions[: self.named.frequencies]

    @property
    def unlabelled(self) -> NotAllUndamped:
        """What each frequency without a label is."""
        return None if self.definitions is None else self.definitions[self.named.frequencies :]

    @property
    def count(self) -> int:
        """Number of values, each measured by one or several rows."""
        return len(self.named.states) + len(self.unnamed.states) + len(self.readings.states)


def bind(arm: Arm, campaign: Campaign) -> Conditions:
    """Return the conditions of a campaign whose names are all the arm's (`check_references`)."""
    states: dict[State, int] = {}
    for m in campaign:
        states.setdefault((m.posture, m.load, m.drives), len(states))
        if m.kind in DIFFERENCES:
            states.setdefault((m.posture, m.reference_load, m.drives), len(states))
    loops = loop_places(campaign)
    keys = [_what(arm, i, m, states, loop) for (i, m), loop in zip(enumerate(campaign), loops, strict=True)]
    first = {key: i for i, key in reversed(list(enumerate(keys)))}
    values = sorted(first, key=lambda key: (key[0], first[key]))
    place = {key: i for i, key in enumerate(values)}
    order = np.array([place[key] for key in keys])
    named, unnamed, readings = ([key for key in values if key[0] in groups] for groups in ((0, 1), (2,), (3,)))
    posture, shaped = np.array([posture for posture, *_ in states], float).T, sum(key[0] == 1 for key in named)
    servo = np.array([drives == "servo" for *_, drives in states], float)
    setups = tuple(dict.fromkeys(m.setup for m in campaign if m.setup))
    hertz = [m for key in values if (m := campaign.measurements[first[key]]).kind == "frequency"]
    definitions = [DEFINITIONS.index(m.of or DEFINITIONS[0]) for m in hertz]
    bound = Conditions(
        posture,
        load_columns(arm, [in_base_axes(arm, posture, load) for posture, load, _ in states]),
        name_modes([key[2] for key in named], np.array([key[1] for key in named], int), len(states), shaped),
        _unnamed(unnamed),
        _readings(readings, setups),
        order,
        repeats(order, np.array([first[key] for key in values])),
        np.array(definitions, int) if any(definitions) else None,
        servo if arm.servos and servo.any() else None,  # without a description servos hold as brakes do
        shapes_of(arm, [campaign.measurements[key[3]] for key in named[len(named) - shaped :]]),
    )
    return jax.device_put(bound)


def _what(arm: Arm, row: int, m: Measurement, states: dict[State, int], loop: int) -> tuple[Any, ...]:
    """Return what a row measured: its group, its state, and what else tells it; the same where rows are repeats.

    Frequencies without a label are of different modes. Shapes are no repeats: each has a scale of its own. Readings of
    a ramp are repeats where they are of one loop, and on the same way.
    """
    state = states[m.posture, m.load, m.drives]
    if m.kind in SHAPES:
        return 1, state, parse_label(m.mode or ""), row
    if m.kind in BY_MODE:
        return (0, state, parse_label(m.mode), m.of) if m.mode else (2, state, m.value, row)
    against = states[m.posture, m.reference_load, m.drives] if m.kind in DIFFERENCES else -1
    if m.kind in TWISTS:
        joint = [joint.name for joint in arm.joints].index(m.joint or "")
        return 3, state, against, joint, tuple(np.asarray(arm.joints[joint].axis).tolist()), "twist", "", loop
    point = [point.name for point in arm.points].index(m.point or "")
    what = "turn" if m.kind in ROTATIONS else "place" if m.kind in POSITIONS else "move"
    return 3, state, against, point, m.direction, what, m.setup, loop


def _unnamed(values: Sequence[tuple[Any, ...]]) -> Unnamed:
    own, hertz = np.array([value[1] for value in values], int), np.array([value[2] for value in values])
    ascending = np.lexsort((hertz, own))  # of equal values the earlier row first: they are of two modes all the same
    ordinals = np.empty(len(values), int)
    ordinals[ascending] = 1 + np.arange(len(values)) - np.searchsorted(own[ascending], own[ascending])
    last = ordinals == np.bincount(own)[own] if len(values) else np.zeros(0, bool)
    return Unnamed(own, ordinals, last, int(ordinals.max(initial=0)))


def _readings(values: Sequence[tuple[Any, ...]], setups: Sequence[str]) -> Readings:
    _, state, against, point, direction, what, setup, loop = zip(*values, strict=True) if values else ((),) * 8
    states, references, points = (np.array(each, int) for each in (state, against, point))
    turns, twists, places = (
        np.array([each == word for each in what], bool) if word in what else None for word in ("turn", "twist", "place")
    )
    frames = np.array([setups.index(name) if name else -1 for name in setup], int) if setups else None
    directions = np.array(direction, float).reshape(-1, 3).T
    loops = np.array(loop, int) if any(loop) else None
    return Readings(states, references, points, directions, turns, twists, places, frames, loop=loops)
