"""A campaign bound to an arm: under which conditions each value was measured, as arrays."""

from collections.abc import Iterator, Sequence

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Array, Float

from ident.arm.arm import Arm
from ident.arm.chain import Loads
from ident.arm.labels import Label, parse_label
from ident.errors import InputError, Problem
from ident.measure import Campaign, Load, Measurement
from ident.text import did_you_mean

BY_MODE = ("frequency", "damping_ratio")


class Modal(eqx.Module):
    """Which mode each value of one kind belongs to.

    Attributes:
        rows: places of the values in the campaign.
        states: state of each value.
        labels: label of each value; None to match those of a state in ascending order.
        ordinals: place among the modes that the label admits, from 1.
    """

    rows: tuple[int, ...] = eqx.field(static=True)
    states: tuple[int, ...] = eqx.field(static=True)
    labels: tuple[Label | None, ...] = eqx.field(static=True)
    ordinals: tuple[int, ...] = eqx.field(static=True)


class Conditions(eqx.Module):
    """The states (posture and load case) in which an arm was measured, and what was read in each.

    Attributes:
        posture: (joints, S) [rad]
        loads: load cases, batch (S).
        frequency: mode of each measured frequency.
        damping: mode of each measured damping ratio.
        deflected: places of the deflections, and of their differences, in the campaign.
        state: state of each deflection.
        reference: state that a difference is counted from; -1 for none.
        point: point that was read.
        direction: (3, n) unit vector along which it was read.
    """

    posture: Float[Array, "joints S"]
    loads: Loads
    frequency: Modal
    damping: Modal
    deflected: tuple[int, ...] = eqx.field(static=True)
    state: tuple[int, ...] = eqx.field(static=True)
    reference: tuple[int, ...] = eqx.field(static=True)
    point: tuple[int, ...] = eqx.field(static=True)
    direction: Float[Array, "3 n"]


def bind(arm: Arm, campaign: Campaign) -> Conditions:
    """Find the arm's points, payloads and modes that a campaign speaks of.

    Raises:
        InputError: a posture of the wrong length, a point, payload or mode that the arm has not; all at once.
    """
    problems = [problem for m in campaign for problem in _misfits(arm, m)]
    if not len(campaign):
        problems = [Problem(campaign.path, "no measurement", "at least one", "add a row")]
    if problems:
        raise InputError(problems)
    states: dict[tuple[tuple[float, ...], Load], int] = {}
    for m in campaign:
        states.setdefault((m.posture, m.load), len(states))
        if m.kind == "deflection_difference":
            states.setdefault((m.posture, m.reference_load), len(states))
    reads = [(i, m) for i, m in enumerate(campaign) if m.kind not in BY_MODE]
    names = [point.name for point in arm.points]
    return Conditions(
        posture=jax.device_put(np.array([posture for posture, _ in states], float).T),
        loads=_columns(arm, [load for _, load in states]),
        frequency=_modal(campaign, "frequency", states),
        damping=_modal(campaign, "damping_ratio", states),
        deflected=tuple(i for i, _ in reads),
        state=tuple(states[m.posture, m.load] for _, m in reads),
        reference=tuple(
            states[m.posture, m.reference_load] if m.kind == "deflection_difference" else -1 for _, m in reads
        ),
        point=tuple(names.index(m.point or "") for _, m in reads),
        direction=jax.device_put(np.array([m.direction for _, m in reads], float).reshape(-1, 3).T),
    )


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


def _modal(campaign: Campaign, kind: str, states: dict[tuple[tuple[float, ...], Load], int]) -> Modal:
    values = [(i, m, states[m.posture, m.load]) for i, m in enumerate(campaign) if m.kind == kind]
    labels = [parse_label(m.mode) if m.mode else None for _, m, _ in values]
    ordinals = []
    for (_, m, state), label in zip(values, labels, strict=True):
        unnamed = sorted(n.value for _, n, other in values if other == state and not n.mode)
        ordinals.append(label.ordinal if label else unnamed.index(m.value) + 1)
    return Modal(tuple(i for i, _, _ in values), tuple(state for _, _, state in values), tuple(labels), tuple(ordinals))


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
