"""A campaign bound to an arm: under which conditions each value was measured, as arrays."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Bool, Float, Int

from ident.arm.arm import Arm
from ident.arm.chain import Loads
from ident.arm.labels import parse_label
from ident.errors import InputError, Problem
from ident.identify.definitions import NotAllUndamped, definitions_of
from ident.identify.loads import in_base_axes, load_columns
from ident.identify.loops import loop_places
from ident.identify.misfits import misfits, too_many
from ident.identify.mode_assignment import Named, name_modes
from ident.identify.repeats import Repeats, repeats, room
from ident.identify.shapes import Shapes, shapes_of
from ident.inference.parameters import AnyArray
from ident.measure import Campaign, Load, Measurement
from ident.measure.kinds import DIFFERENCES, POSITIONS, ROTATIONS, SHAPES, TWISTS

BY_MODE = ("frequency", "damping_ratio", *SHAPES)
State = tuple[tuple[float, ...], Load, str]
"""Posture, load case, and what held the motors."""
MOST = 20000
"""Different values of a campaign at most: a fit of as many takes minutes, and of more nothing is learned."""


class Unnamed(eqx.Module):
    """Measured frequencies without a label: in ascending order, the lowest modes that no label of their state takes.

    Attributes:
        states: (n,) state of each.
        ordinals: (n,) place among those of its state, from 1.
        last: (n,) whether it is the last one of its state, so that the next mode was not measured.
        highest: largest of these places, 0 for none.
    """

    states: Int[AnyArray, "n"]
    ordinals: Int[AnyArray, "n"]
    last: Bool[AnyArray, "n"]
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
            have been turned into it (`setups.in_base_frame`). Directions may have batch axes then.
        datum: (n, *batch) [m] what a position is counted from, along its direction; None likewise.
        loop: (n,) which loop of a ramp it is of, from 1, negative where it was read while loading, 0 for none; None
            where all are of none, or their `lag` is known.
        lag: (n, *batch) [m or rad] by how much it lags behind, half the width of its loop (`loops.with_loops`).
    """

    states: Int[AnyArray, "n"]
    references: Int[AnyArray, "n"]
    points: Int[AnyArray, "n"]
    direction: Float[AnyArray, "3 n *batch"]
    turning: Bool[AnyArray, "n"] | None = None
    twisting: Bool[AnyArray, "n"] | None = None
    placing: Bool[AnyArray, "n"] | None = None
    setup: Int[AnyArray, "n"] | None = None
    datum: Float[AnyArray, "n *batch"] | None = None
    loop: Int[AnyArray, "n"] | None = None
    lag: Float[AnyArray, "n *batch"] | None = None

    def by_kind(self) -> list[Int[np.ndarray, "_"]]:
        """Return the places of deflections, rotations, twists and positions, each by itself and as differences."""
        difference = np.asarray(self.references) >= 0
        what = np.zeros(len(difference), int)
        for code, those in ((1, self.turning), (2, self.twisting), (3, self.placing)):
            what = what if those is None else np.where(those, code, what)
        return [np.flatnonzero((what == code) & (difference == differs)) for code in range(4) for differs in (0, 1)]

    def of(self, places: Int[np.ndarray, "_"]) -> "Readings":
        """Return some of them."""
        own = {name: x[places] for name, x in vars(self).items() if name != "direction" and x is not None}
        return replace(self, direction=self.direction[:, places], **own)


class Conditions(eqx.Module):
    """The states (posture and load case) in which an arm was measured, and what was read in each.

    States and places are arrays, so that another campaign of the same sizes, kinds and names of modes finds its
    program compiled; `padded` makes few of these sizes.

    Attributes:
        posture: (joints, S) [rad]
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

    posture: Float[AnyArray, "joints S"]
    loads: Loads
    named: Named
    unnamed: Unnamed
    readings: Readings
    order: Int[AnyArray, "D"]
    repeats: Repeats
    definitions: NotAllUndamped = None
    servo: Float[AnyArray, "S"] | None = None
    shapes: Shapes | None = None

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
        """Number of values, each of which one or several rows measured."""
        return len(self.named.states) + len(self.unnamed.states) + len(self.readings.states)

    def padded(self) -> tuple["Conditions", np.ndarray, np.ndarray]:
        """Return the conditions of a campaign of one of few sizes, in which a row stands for each value of this one.

        Its rows come by kind, so that their order is the same for all campaigns of a size.

        Returns:
            Also a row of this campaign that each of its rows is like, and which of its rows each of this campaign is.
        """
        named, unnamed, readings, order = jax.device_get((self.named, self.unnamed, self.readings, self.order))
        state = room(np.arange(self.posture.shape[1]))
        labels = len(named.states)
        read = labels + len(unnamed.states)
        kinds = np.split(np.arange(read), [named.frequencies, labels - named.shapes, labels])
        kinds += [read + own for own in readings.by_kind()]
        values = [room(kind) for kind in kinds]
        label, other = np.concatenate(values[:3]), values[3] - labels
        reading = np.concatenate(values[4:]) - read
        place, rows = np.zeros(self.count, int), np.arange(sum(map(len, values)))
        before = np.cumsum([0, *map(len, values)])
        for kind, start in zip(kinds, before, strict=False):
            place[kind] = start + np.arange(len(kind))
        more = Conditions(
            np.asarray(self.posture)[:, state],
            jax.tree.map(lambda x: np.asarray(x)[..., state], self.loads),
            Named(
                named.states[label],
                named.ordinals[label],
                named.words[label],
                named.places[label],
                named.asked[:, state],
                named.at[:, state],
                len(values[1]),
                named.patterns,
                named.top,
                len(values[2]),
            ),
            Unnamed(unnamed.states[other], unnamed.ordinals[other], unnamed.last[other], unnamed.highest),
            readings.of(reading),
            rows,
            repeats(rows, rows),
            None
            if self.definitions is None
            else self.definitions[np.concatenate([values[0], values[3] - named.others])],
            None if self.servo is None else np.asarray(self.servo)[state],
            None if self.shapes is None else jax.device_get(self.shapes).of(values[2] - (labels - named.shapes)),
        )
        return more, np.asarray(self.repeats.first)[np.concatenate(values)], place[order]


def bind(arm: Arm, campaign: Campaign) -> Conditions:
    """Find the arm's points, payloads and modes that a campaign speaks of.

    Raises:
        InputError: a posture of the wrong length, a point, payload or mode that the arm has not; all at once. Or more
            values than can be fitted.
    """
    problems = [*(problem for m in campaign for problem in misfits(arm, m)), *too_many(arm, campaign)]
    if not len(campaign):
        problems = [Problem(campaign.path, "no measurement", "at least one", "add a row")]
    if problems:
        raise InputError(problems)
    states: dict[State, int] = {}
    for m in campaign:
        states.setdefault((m.posture, m.load, m.drives), len(states))
        if m.kind in DIFFERENCES:
            states.setdefault((m.posture, m.reference_load, m.drives), len(states))
    loops = loop_places(campaign)
    keys = [_what(arm, i, m, states, loop) for (i, m), loop in zip(enumerate(campaign), loops, strict=True)]
    first = {key: i for i, key in reversed(list(enumerate(keys)))}
    values = sorted(first, key=lambda key: (key[0], first[key]))
    if len(values) > MOST:
        got = f"{len(values)} different values in {len(states)} states (posture and load case), {len(keys)} rows"
        remedy = "fit a part of it, or hold the same postures again: repeated rows cost next to nothing"
        raise InputError(Problem(campaign.path, got, f"at most {MOST} different values", remedy))
    place = {key: i for i, key in enumerate(values)}
    order = np.array([place[key] for key in keys])
    named, unnamed, readings = ([key for key in values if key[0] in groups] for groups in ((0, 1, 2), (3,), (4,)))
    posture = np.array([posture for posture, *_ in states], float).T
    setups = tuple(dict.fromkeys(m.setup for m in campaign if m.setup))
    bound = Conditions(
        posture,
        load_columns(arm, [in_base_axes(arm, posture, load) for posture, load, _ in states]),
        _named(named, len(states)),
        _unnamed(unnamed),
        _readings(readings, setups),
        order,
        repeats(order, np.array([first[key] for key in values])),
        definitions_of([campaign.measurements[first[key]] for key in values]),
        _servo(arm, states),
        shapes_of(arm, [campaign.measurements[key[3]] for key in named if key[0] == 2]),
    )
    return jax.device_put(bound)


def _servo(arm: Arm, states: dict[State, int]) -> Float[np.ndarray, "S"] | None:
    """Return where servos held the motors; None where none did, or the arm file describes none: as brakes, then."""
    on = np.array([drives == "servo" for *_, drives in states], float)
    return on if arm.servos and on.any() else None


def _what(arm: Arm, row: int, m: Measurement, states: dict[State, int], loop: int) -> tuple[Any, ...]:
    """Return what a row measured: its group, its state, and what else tells it; the same where rows are repeats.

    Frequencies without a label are of different modes. Shapes are no repeats: each has a scale of its own. Readings of
    a ramp are repeats where they are of one loop, and on the same way.
    """
    state = states[m.posture, m.load, m.drives]
    if m.kind in SHAPES:
        return 2, state, parse_label(m.mode or ""), row
    if m.kind in BY_MODE:
        return (BY_MODE.index(m.kind), state, parse_label(m.mode), m.of) if m.mode else (3, state, m.value, row)
    against = states[m.posture, m.reference_load, m.drives] if m.kind in DIFFERENCES else -1
    if m.kind in TWISTS:
        joint = [joint.name for joint in arm.joints].index(m.joint or "")
        return 4, state, against, joint, tuple(np.asarray(arm.joints[joint].axis).tolist()), "twist", "", loop
    point = [point.name for point in arm.points].index(m.point or "")
    what = "turn" if m.kind in ROTATIONS else "place" if m.kind in POSITIONS else "move"
    return 4, state, against, point, m.direction, what, m.setup, loop


def _named(values: Sequence[tuple[Any, ...]], count: int) -> Named:
    states = np.array([state for _, state, *_ in values], int)
    groups = [group for group, *_ in values]
    return name_modes([label for _, _, label, _ in values], states, count, groups.count(1), groups.count(2))


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
    turns, twists, places = (_where(what, word) for word in ("turn", "twist", "place"))
    frames = np.array([setups.index(name) if name else -1 for name in setup], int) if setups else None
    directions = np.array(direction, float).reshape(-1, 3).T
    loops = np.array(loop, int) if any(loop) else None
    return Readings(states, references, points, directions, turns, twists, places, frames, loop=loops)


def _where(words: Sequence[str], word: str) -> Bool[np.ndarray, "n"] | None:
    """Return where a word stands; None where it stands nowhere."""
    return np.array([each == word for each in words], bool) if word in words else None
