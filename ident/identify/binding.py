"""Checks that every joint, point, payload and label of a campaign exists in the arm, and its load cases as numbers."""

from collections.abc import Iterator, Sequence
from typing import Any

import jax
import numpy as np

from ident.arm.arm import Arm
from ident.arm.chain import Loads, body_axes
from ident.arm.modes import parse_label
from ident.arm.parts import Body
from ident.errors import Problem, refuse
from ident.measure import Campaign, Load, Measurement
from ident.measure.load import named_points
from ident.text import by_key, did_you_mean

# -------- Reference checks


def check_references(arm: Arm, campaign: Campaign) -> None:
    """Refuse a campaign that names what its arm does not have, all rows at once.

    Raises:
        InputError: no row, a posture of the wrong length, an unknown point, joint, payload or mode, or more
            frequencies of a state than the arm has modes.
    """
    named = [
        (m.kind, m.mode, m.point, m.reference_point, m.joint, m.load, m.reference_load, m.drives) for m in campaign
    ]
    each = dict(zip(named, campaign, strict=True))  # rows with the same names are right or wrong together
    wrong = {names for names, m in each.items() if next(_of_row(arm, m), None)}
    rows = (m for names, m in zip(named, campaign, strict=True) if names in wrong)
    problems = [problem for m in rows for problem in _of_row(arm, m)] + [*_of_states(arm, campaign)]
    if len(campaign) and campaign.joints != len(arm.driven):
        got = f"{campaign.joints} joint angle{'s' * (campaign.joints != 1)}"
        expected = f"{len(arm.driven)}, one for each driven joint of {arm.name}"
        problems += [Problem(campaign.measurements[0].where, got, expected, "add or remove q columns", "posture")]
    if not len(campaign):
        problems = [Problem(campaign.path, "no measurement", "at least one", "add a row")]
    refuse(problems)


def _of_row(arm: Arm, m: Measurement) -> Iterator[Problem]:
    """Yield names in a measurement that the arm does not have."""
    points, joints = [point.name for point in arm.points], [joint.name for joint in arm.driven]
    named = ("point", m.point, points), ("reference_point", m.reference_point, points), ("joint", m.joint, joints)
    for column, name, known in named:
        if name is not None and name not in known:
            yield _unknown(m.where, column, name, known)
    for column, load in (("load", m.load), ("reference_load", m.reference_load)):
        yield from _of_load(arm, load, m.where, column)
    if m.kind == "damping_ratio" and not m.mode:
        remedy = "name it: damping ratios do not rise with the modes"
        yield Problem(m.where, "a damping ratio without mode", "the label of its mode", remedy, "mode")
    if m.mode and not points:
        remedy = "add a [[point]] at the arm's end: modes are named by how it moves"
        yield Problem(m.where, f"'{m.mode}'", "no label, as the arm has no point", remedy, "mode")
    if m.mode:
        label = parse_label(m.mode)
        if label is None or label.ordinal > _count(arm, m.drives):
            remedy = "name it so, or leave the field empty to match modes in ascending order"
            yield Problem(m.where, f"'{m.mode}'", "a label such as 'vertical bending 1' or 'torsion 2'", remedy, "mode")


def _of_states(arm: Arm, campaign: Campaign) -> Iterator[Problem]:
    """Yield states with more frequencies than the arm has modes: each unlabelled one belongs to another mode."""
    for (*_, drives), own in by_key(((m.posture, m.load, m.drives), m) for m in campaign.of_kind("frequency")).items():
        modes = _count(arm, drives)
        blank = [m for m in own if not m.mode]
        labels = {label for m in own if (label := parse_label(m.mode or "")) and label.direction and label.kind}
        left = max(modes - len(labels), 0)
        if len(blank) > left:
            got = f"{len(blank)} frequencies without a label at this posture and load"
            expected = f"at most {left}, each of another mode: the arm has {modes}, of which labels take {len(labels)}"
            remedy = "name the modes of repeated ones, or leave out what is no natural frequency"
            yield Problem(blank[left].where, got, expected, remedy, "mode")


def _count(arm: Arm, drives: str) -> int:
    """Return the number of modes, including those of the motors with a servo on."""
    return arm.degrees_of_freedom + (len(arm.servos) if drives == "servo" else 0)


def _of_load(arm: Arm, load: Load, where: str, column: str) -> Iterator[Problem]:
    """Yield points, payloads and bodies of a load case that the arm does not have."""
    points, payloads = [point.name for point in arm.points], [payload.body.name for payload in arm.payloads]
    bodies = [part.name for part in arm.parts() if isinstance(part, Body)]
    turned_with = [body for *_, body in load.own]
    for names, known in ((named_points(load), points), (turned_with, bodies), (load.payloads, payloads)):
        for name in names:
            if name not in known:
                yield _unknown(where, column, name, known)


def _unknown(where: str, column: str, name: str, known: list[str]) -> Problem:
    expected = f"one of {', '.join(known)}" if known else "none, as the arm has none"
    remedy = did_you_mean(name, known, "correct the name, or add it to the arm file")
    return Problem(where, f"'{name}'", expected, remedy, column)


# -------- Loads
# Load cases for the arm's equations: masses on points, and forces in the base frame.


def bind_loads(arm: Arm, loads: Sequence[Load]) -> Loads:
    """Return load cases as the arm's equations need them, batch (S).

    Raises:
        InputError: a payload or point that the arm has not.
    """
    problems = [problem for load in loads for problem in _of_load(arm, load, "", "load")]
    for load in loads if not problems else ():
        for _, _, point, body in load.own:
            remedy = "give it in the base frame: as the arm moves, the body turns"
            problems += [Problem("", f"a load at {point} along the axes of {body}", "a posture", remedy, "load")]
    refuse(problems)
    return load_columns(arm, loads)


def in_base_axes(arm: Arm, posture: Sequence[float], load: Load) -> Load:
    """Return a load with all its forces and moments in the base frame, at a posture [rad]."""
    if not load.own:
        return load
    turned: dict[str, list[tuple[Any, str]]] = {"force": [*load.forces], "moment": [*load.moments]}
    for kind, vector, point, body in load.own:
        turned[kind].append((tuple((body_axes(arm, np.asarray(posture), body) @ vector).tolist()), point))
    return Load(load.payloads, load.masses, tuple(turned["force"]), tuple(turned["moment"]))


def loads_of(arm: Arm, load: Load) -> Loads:
    """Return a load case as the arm's equations need it, without batch.

    Raises:
        InputError: a payload or point that the arm has not.
    """
    return jax.tree.map(lambda x: x[..., 0], bind_loads(arm, [load]))


def load_columns(arm: Arm, cases: Sequence[Load]) -> Loads:
    """Return load cases of names that the arm has, batch (S)."""
    points, payloads = [p.name for p in arm.points], [p.body.name for p in arm.payloads]
    share = np.zeros((len(payloads), len(cases)))
    mass = np.zeros((len(points), len(cases)))
    force, moment = np.zeros((2, 3, len(points), len(cases)))
    for state, case in enumerate(cases):
        for name in case.payloads:
            share[payloads.index(name), state] = 1
        for kilograms, name in case.masses:
            mass[points.index(name), state] += kilograms
        for vector, name in case.forces:
            force[:, points.index(name), state] += vector
        for vector, name in case.moments:
            moment[:, points.index(name), state] += vector
    return Loads(*jax.device_put((share, mass, force, moment if moment.any() else None)))
