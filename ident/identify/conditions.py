"""A campaign bound to an arm: under which conditions each value was measured, as arrays."""

from collections.abc import Iterator, Sequence

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Bool, Float, Int

from ident.arm.arm import Arm
from ident.arm.chain import Loads
from ident.arm.labels import parse_label
from ident.errors import InputError, Problem
from ident.identify.mode_assignment import Named, name_modes
from ident.inference.parameters import AnyArray
from ident.measure import Campaign, Load, Measurement
from ident.text import did_you_mean

BY_MODE = ("frequency", "damping_ratio")
State = tuple[tuple[float, ...], Load]


class Unnamed(eqx.Module):
    """Measured frequencies without a label: in ascending order, the lowest modes that no label of their state takes.

    Attributes:
        rows: (n,) their places in the campaign.
        states: (n,) state of each.
        ordinals: (n,) place among those of its state, from 1.
        last: (n,) whether it is the last one of its state, so that the next mode was not measured.
        highest: largest of these places, 0 for none.
    """

    rows: Int[AnyArray, "n"]
    states: Int[AnyArray, "n"]
    ordinals: Int[AnyArray, "n"]
    last: Bool[AnyArray, "n"]
    highest: int = eqx.field(static=True)


class Readings(eqx.Module):
    """Measured deflections, and their differences.

    Attributes:
        rows: (n,) their places in the campaign.
        states: (n,) state of each.
        references: (n,) state that a difference is counted from; -1 for none.
        points: (n,) point that was read.
        direction: (3, n) unit vector along which it was read.
    """

    rows: Int[AnyArray, "n"]
    states: Int[AnyArray, "n"]
    references: Int[AnyArray, "n"]
    points: Int[AnyArray, "n"]
    direction: Float[AnyArray, "3 n"]


class Conditions(eqx.Module):
    """The states (posture and load case) in which an arm was measured, and what was read in each.

    Rows, states and places are arrays, so that another campaign of the same sizes, kinds and names of modes finds its
    program compiled; `padded` makes few of these sizes.

    Attributes:
        posture: (joints, S) [rad]
        loads: load cases, batch (S).
        named: values of modes that have a label.
        unnamed: frequencies without.
        readings: deflections, and their differences.
        order: (D,) place of each of the campaign's values among the named, the unnamed and the readings in turn.
    """

    posture: Float[AnyArray, "joints S"]
    loads: Loads
    named: Named
    unnamed: Unnamed
    readings: Readings
    order: Int[AnyArray, "D"]

    def padded(self) -> tuple["Conditions", np.ndarray]:
        """Return the conditions of a larger campaign, of one of few sizes, that repeats values and states of this one.

        Its values come by kind, so that their order is the same for all campaigns of a size.

        Returns:
            Also the value that each of its values repeats; the first that does stands for it.
        """
        named, unnamed, readings = jax.device_get((self.named, self.unnamed, self.readings))
        state = _repeated(np.arange(self.posture.shape[1]))
        label = _repeated(*np.split(np.arange(len(named.rows)), [named.frequencies]))
        other, difference = _repeated(np.arange(len(unnamed.rows))), readings.references >= 0
        reading = _repeated(np.flatnonzero(~difference), np.flatnonzero(difference))
        source = np.concatenate([named.rows[label], unnamed.rows[other], readings.rows[reading]])
        rows = np.split(np.arange(len(source)), np.cumsum([len(label), len(other)]))
        ratios = int((label >= named.frequencies).sum())
        more = Conditions(
            np.asarray(self.posture)[:, state],
            jax.tree.map(lambda x: np.asarray(x)[..., state], self.loads),
            Named(
                rows[0],
                named.states[label],
                named.ordinals[label],
                named.words[label],
                named.places[label],
                named.asked[:, state],
                ratios,
                named.patterns,
                named.top,
            ),
            Unnamed(rows[1], unnamed.states[other], unnamed.ordinals[other], unnamed.last[other], unnamed.highest),
            Readings(
                rows[2],
                readings.states[reading],
                readings.references[reading],
                readings.points[reading],
                readings.direction[:, reading],
            ),
            np.arange(len(source)),
        )
        return more, source


def bind(arm: Arm, campaign: Campaign) -> Conditions:
    """Find the arm's points, payloads and modes that a campaign speaks of.

    Raises:
        InputError: a posture of the wrong length, a point, payload or mode that the arm has not; all at once.
    """
    problems = [*(problem for m in campaign for problem in _misfits(arm, m)), *_too_many(arm, campaign)]
    if not len(campaign):
        problems = [Problem(campaign.path, "no measurement", "at least one", "add a row")]
    if problems:
        raise InputError(problems)
    states: dict[State, int] = {}
    for m in campaign:
        states.setdefault((m.posture, m.load), len(states))
        if m.kind == "deflection_difference":
            states.setdefault((m.posture, m.reference_load), len(states))
    named = _named(campaign, states)
    unnamed, readings = _unnamed(campaign, states), _readings(arm, campaign, states)
    order = np.argsort(np.concatenate([named.rows, unnamed.rows, readings.rows]))
    posture = np.array([posture for posture, _ in states], float).T
    loads = _columns(arm, [load for _, load in states])
    return jax.device_put(Conditions(posture, loads, named, unnamed, readings, order))


def _repeated(*groups: np.ndarray) -> np.ndarray:
    """Return the entries of each group, the first one repeated at its end until their number is one of few."""
    sizes = [roomy(len(group)) for group in groups]
    return np.concatenate(
        [[*g, *[g[0]] * (n - len(g))] if n else g for g, n in zip(groups, sizes, strict=True)]
    ).astype(int)


def roomy(count: int) -> int:
    """Return the next of 0, 4, 8, 16, 24, 32, 48, 64, 96, ...: at most half as many again, where there are many."""
    if not count:
        return 0
    power = max(4, 1 << (count - 1).bit_length())
    return 3 * power // 4 if power > 16 and count <= 3 * power // 4 else power


def bind_loads(arm: Arm, loads: Sequence[Load]) -> Loads:
    """Return load cases as the arm's equations need them, batch (S).

    Raises:
        InputError: a payload or point that the arm has not.
    """
    problems = [problem for load in loads for problem in _unknown_names(arm, load, "", "load")]
    if problems:
        raise InputError(problems)
    return _columns(arm, loads)


def loads_of(arm: Arm, load: Load) -> Loads:
    """Return a load case as the arm's equations need it, without batch.

    Raises:
        InputError: a payload or point that the arm has not.
    """
    bound = bind_loads(arm, [load])
    return Loads(bound.payload[:, 0], bound.mass[:, 0], bound.force[:, :, 0])


def _named(campaign: Campaign, states: dict[State, int]) -> Named:
    found = [(i, m) for kind in BY_MODE for i, m in enumerate(campaign) if m.kind == kind and m.mode]
    labels = [label for _, m in found if (label := parse_label(m.mode or ""))]
    own = [states[m.posture, m.load] for _, m in found]
    ratios = sum(m.kind == "damping_ratio" for _, m in found)
    return name_modes(labels, np.array([i for i, _ in found], int), np.array(own, int), len(states), ratios)


def _unnamed(campaign: Campaign, states: dict[State, int]) -> Unnamed:
    found = [(i, m) for i, m in enumerate(campaign) if m.kind == "frequency" and not m.mode]
    own = np.array([states[m.posture, m.load] for _, m in found], int)
    values = np.array([m.value for _, m in found])
    ascending = np.lexsort((values, own))  # of equal values the earlier row first: they are of two modes all the same
    ordinals = np.empty(len(found), int)
    ordinals[ascending] = 1 + np.arange(len(found)) - np.searchsorted(own[ascending], own[ascending])
    last = ordinals == (own[:, None] == own).sum(1)
    rows = np.array([i for i, _ in found], int)
    return Unnamed(rows, own, ordinals, last, int(ordinals.max(initial=0)))


def _readings(arm: Arm, campaign: Campaign, states: dict[State, int]) -> Readings:
    found = [(i, m) for i, m in enumerate(campaign) if m.kind not in BY_MODE]
    names, difference = [point.name for point in arm.points], "deflection_difference"
    against = [states[m.posture, m.reference_load] if m.kind == difference else -1 for _, m in found]
    return Readings(
        np.array([i for i, _ in found], int),
        np.array([states[m.posture, m.load] for _, m in found], int),
        np.array(against, int),
        np.array([names.index(m.point or "") for _, m in found], int),
        np.array([m.direction for _, m in found], float).reshape(-1, 3).T,
    )


def _columns(arm: Arm, cases: Sequence[Load]) -> Loads:
    points, payloads = [p.name for p in arm.points], [p.body.name for p in arm.payloads]
    share = np.zeros((len(payloads), len(cases)))
    mass = np.zeros((len(points), len(cases)))
    force = np.zeros((3, len(points), len(cases)))
    for state, case in enumerate(cases):
        for name in case.payloads:
            share[payloads.index(name), state] = 1
        for kilograms, name in case.masses:
            mass[points.index(name), state] += kilograms
        for vector, name in case.forces:
            force[:, points.index(name), state] += vector
    return Loads(*map(jax.device_put, (share, mass, force)))


def _misfits(arm: Arm, m: Measurement) -> Iterator[Problem]:
    if len(m.posture) != len(arm.driven):
        expected = f"{len(arm.driven)}, one for each driven joint of {arm.name}"
        yield Problem(m.where, f"{len(m.posture)} joint angles", expected, "add or remove q columns", "posture")
    points = [point.name for point in arm.points]
    if m.point is not None and m.point not in points:
        yield _unknown(m.where, "point", m.point, points)
    for column, load in (("load", m.load), ("reference_load", m.reference_load)):
        yield from _unknown_names(arm, load, m.where, column)
    if m.kind == "damping_ratio" and not m.mode:
        remedy = "name it: damping ratios do not rise with the modes"
        yield Problem(m.where, "a damping ratio without mode", "the label of its mode", remedy, "mode")
    if m.mode and not points:
        remedy = "add a [[point]] at the arm's end: modes are named by how it moves"
        yield Problem(m.where, f"'{m.mode}'", "no label, as the arm has no point", remedy, "mode")
    if m.mode:
        label = parse_label(m.mode)
        if label is None or label.ordinal > 3 * len(arm.joints):
            remedy = "name it so, or leave the field empty to match modes in ascending order"
            expected = "a label such as 'vertical bending 1' or 'torsion 2'"
            yield Problem(m.where, f"'{m.mode}'", expected, remedy, "mode")


def _too_many(arm: Arm, campaign: Campaign) -> Iterator[Problem]:
    """Refuse more frequencies of a state than the arm has modes: each without a label is of another mode."""
    modes = 3 * len(arm.joints)
    states: dict[State, list[Measurement]] = {}
    for m in campaign.of_kind("frequency"):
        states.setdefault((m.posture, m.load), []).append(m)
    for own in states.values():
        blank = [m for m in own if not m.mode]
        labels = {label for m in own if (label := parse_label(m.mode or "")) and label.direction and label.kind}
        left = max(modes - len(labels), 0)
        if len(blank) > left:
            got = f"{len(blank)} frequencies without a label at this posture and load"
            expected = f"at most {left}, each of another mode: the arm has {modes}, of which labels take {len(labels)}"
            remedy = "name the modes of repeated ones, or leave out what is no natural frequency"
            yield Problem(blank[left].where, got, expected, remedy, "mode")


def _unknown_names(arm: Arm, load: Load, where: str, column: str) -> Iterator[Problem]:
    """Yield what a load case hangs on points, or takes for payloads, that the arm has not."""
    points, payloads = [point.name for point in arm.points], [payload.body.name for payload in arm.payloads]
    for name in (name for _, name in (*load.masses, *load.forces)):
        if name not in points:
            yield _unknown(where, column, name, points)
    for name in load.payloads:
        if name not in payloads:
            yield _unknown(where, column, name, payloads)


def _unknown(where: str, column: str, name: str, known: list[str]) -> Problem:
    expected = f"one of {', '.join(known)}" if known else "none, as the arm has none"
    remedy = did_you_mean(name, known, "correct the name, or add it to the arm file")
    return Problem(where, f"'{name}'", expected, remedy, column)
