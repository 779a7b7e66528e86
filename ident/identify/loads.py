"""Load cases as the arm's equations need them: what hangs on which point, and which forces act in the base frame."""

from collections.abc import Sequence
from typing import Any

import jax
import numpy as np

from ident.arm.arm import Arm
from ident.arm.chain import Loads, body_axes
from ident.errors import InputError, Problem
from ident.identify.misfits import unknown_names
from ident.measure import Load


def bind_loads(arm: Arm, loads: Sequence[Load]) -> Loads:
    """Return load cases as the arm's equations need them, batch (S).

    Raises:
        InputError: a payload or point that the arm has not.
    """
    problems = [problem for load in loads for problem in unknown_names(arm, load, "", "load")]
    for load in loads if not problems else ():
        for _, _, point, body in load.own:
            remedy = "give it in the base frame: as the arm moves, the body turns"
            problems += [Problem("", f"a load at {point} along the axes of {body}", "a posture", remedy, "load")]
    if problems:
        raise InputError(problems)
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
    parts = jax.device_put((share, mass, force, moment if moment.any() else None))
    return Loads(*parts)
