"""Mode labels that become ambiguous on a nearby arm, or on another arm within the prior."""

import math
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

import jax
import numpy as np

from ident.arm.arm import Arm
from ident.arm.mechanics import static_equilibrium
from ident.arm.modes import AMBIGUOUS, Label, is_ambiguous, labels_of_shares, modes_about, torsion_share, vertical_share
from ident.identify.conditions import Conditions
from ident.identify.mode_matching import NAMING_SD
from ident.identify.padding import padded
from ident.identify.predict import chains, mode_choice
from ident.identify.problem import FREE, POINTS, Posed, labels_about
from ident.inference.problem import InverseProblem
from ident.programs import RUNS_ONCE, jit
from ident.text import by_key

NEAR = 0.05
"""Relative distance of two frequencies below which their order may change in the fit; assumed."""
NEAR_DRAW = -2 * math.log1p(-math.erfc(AMBIGUOUS / NAMING_SD / math.sqrt(2)) / 2)
"""Label cost of a mode whose naming share is `AMBIGUOUS` away from one half."""
ALIKE = 3.0
"""Standard deviations within which two values of different modes may be one mode measured twice; assumed."""


@dataclass(frozen=True)
class LabelDoubt:
    """A measurement with an uncertain mode.

    Attributes:
        row: its index in the campaign.
        mode: its matched mode at the starting values.
        near_draw: whether that mode's name is ambiguous, so that a small change may rename it.
        crossing: for values without a label, the neighbouring modes with nearly the same frequency.
        alike: index of another unlabelled value that is nearly equal, but matched to another mode; or None.
    """

    row: int
    mode: Label
    near_draw: bool
    crossing: tuple[Label, ...]
    alike: int | None


def label_doubts(posed: Posed) -> tuple[LabelDoubt, ...]:
    """Return measured modes that may be mistaken for others, on the arm as in its file.

    A label with an ambiguous mode name may match another mode after a small step of the fit. Values without label are
    matched by order, which changes where frequencies cross; and one mode measured twice counts as two.
    """
    conditions, _, places = padded(posed.conditions)
    named, unnamed = conditions.named, conditions.unnamed
    labels, m = len(named.states), posed.campaign.measurements
    rows = dict(sorted(by_key((place, row) for row, place in enumerate(places.tolist())).items()))
    rows = {place: own for place, own in rows.items() if place < labels + len(unnamed.states)}
    if not rows or not posed.arm.points:
        return ()
    modes, doubts = jax.device_get(_modes_of_states(posed.arm, conditions)), dict[int, LabelDoubt]()
    state = np.concatenate([named.states, unnamed.states])
    choice = np.concatenate(modes.choice, 1)
    for place, own in rows.items():
        hertz, mode = modes.frequency[:, state[place]], int(np.argmax(choice[:, place]))
        if not (choice[:, place].any() and np.isfinite(hertz).all()):
            continue
        near_draw, near, alike = False, [], None
        if place < labels:
            near_draw = bool(modes.near_draw[mode, state[place]])
        else:
            beside = [j for j in (mode - 1, mode + 1) if 0 <= j < len(hertz)]
            near = [j for j in beside if abs(hertz[j] - hertz[mode]) < NEAR * min(hertz[j], hertz[mode])]
            others = [rows[p][0] for p in rows if p >= labels and p != place and state[p] == state[place]]
            a = m[own[0]]
            close = (i for i in others if abs(a.value - m[i].value) < ALIKE * math.hypot(a.sigma, m[i].sigma))
            alike = next(close, None)
        if near_draw or near or alike is not None:
            names = labels_of_shares(modes.torsion[:, state[place]], modes.vertical[:, state[place]])
            crossing = tuple(names[j] for j in near)
            doubts |= {row: LabelDoubt(row, names[mode], near_draw, crossing, alike) for row in own}
    return tuple(doubts[row] for row in sorted(doubts))


def changing_labels(problem: InverseProblem, *, points: int = POINTS, seed: int = 0) -> dict[int, float]:
    """Return the share of points within the prior at which each row's label is ambiguous or has no mode; if any.

    Args:
        problem: of an arm and a campaign.
        points: number of points.
        seed: of the points.
    """
    costs, _ = labels_about(problem, points, FREE, seed)
    often = (costs > NEAR_DRAW).mean(0) if len(costs) else np.zeros(len(problem.kinds))
    return {int(row): float(often[row]) for row in np.flatnonzero(often)}


class _States(NamedTuple):
    """Modes of all states, ascending; whether each name is ambiguous; the choice of each kind of value."""

    frequency: Any
    torsion: Any
    vertical: Any
    near_draw: Any
    choice: Any


@partial(jit, options=RUNS_ONCE)
def _modes_of_states(arm: Arm, conditions: Conditions) -> _States:
    chain = chains(arm, conditions)
    modes = modes_about(chain, static_equilibrium(chain))
    shares = torsion_share(modes), vertical_share(modes)
    return _States(modes.frequency, *shares, is_ambiguous(modes), mode_choice(conditions, modes))
