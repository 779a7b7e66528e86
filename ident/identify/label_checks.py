"""Which measured modes may be taken for others: names by a near draw, neighbours that nearly cross."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, NamedTuple

import jax
import numpy as np
from jaxtyping import Float

from ident.arm.arm import Arm
from ident.arm.equilibrium import static_equilibrium
from ident.arm.labels import (
    AMBIGUOUS,
    Label,
    is_ambiguous,
    labels_of_shares,
    torsion_share,
    vertical_share,
)
from ident.arm.modes import modes_about
from ident.identify.conditions import Conditions, Unnamed, bind
from ident.identify.mode_assignment import NAMING_SD, Named
from ident.identify.mode_choice import mode_choice
from ident.identify.predict import chains
from ident.inference.least_squares import evaluate
from ident.inference.problem import InverseProblem
from ident.jit import RUNS_ONCE, jit
from ident.measure import Campaign

NEAR = 0.05
"""Relative distance of two frequencies below which their order may change in the fit."""
NEAR_DRAW = -2 * math.log1p(-math.erfc(AMBIGUOUS / NAMING_SD / math.sqrt(2)) / 2)
"""What speaks against a label whose mode is named by a share that is `AMBIGUOUS` from one half."""
POINTS = 16
"""Points about the starting values at which labels are looked at."""
NEARBY, FREE = 0.4, 1.0
"""Their standard deviation in theta, where the prior is not narrower: where values are judged; where labels are."""
ALIKE = 3.0
"""Standard deviations within which two values of different modes may be of one mode that was measured twice."""


@dataclass(frozen=True)
class LabelDoubt:
    """A measurement whose mode is not sure.

    Attributes:
        row: its place in the campaign.
        mode: the mode that it is matched to at the starting values.
        near_draw: whether that mode's name is a near draw, so that a small change may rename it.
        crossing: for values without a label, the neighbouring modes that nearly have the same frequency.
        alike: place of another value without a label that is nearly the same, but matched to another mode; or None.
    """

    row: int
    mode: Label
    near_draw: bool
    crossing: tuple[Label, ...]
    alike: int | None


def label_doubts(arm: Arm, campaign: Campaign) -> tuple[LabelDoubt, ...]:
    """Find measured modes that may be mistaken for others, with the arm as it is.

    A label whose mode is named by a near draw may pick another mode after a small step of the fit. Values without
    label are matched by order, which changes where frequencies cross; and one mode measured twice is taken for two.

    Raises:
        InputError: campaign and arm do not fit together.
    """
    conditions, _, places = bind(arm, campaign).padded()
    values: tuple[Named | Unnamed, ...] = (conditions.named, conditions.unnamed)
    if not any(len(each.states) for each in values) or not arm.points:
        return ()
    states = jax.device_get(_modes_of_states(arm, conditions))
    doubts: dict[int, LabelDoubt] = {}
    rows: dict[int, list[int]] = {}
    for row, place in enumerate(places.tolist()):
        rows.setdefault(place, []).append(row)
    before = 0
    for each, choice in zip(values, states.choice, strict=True):
        own = [rows.get(before + i, []) for i in range(len(each.states))]
        for i, doubt in _doubts(campaign, each, own, states, choice):
            doubts |= {row: replace(doubt, row=row) for row in own[i]}
        before += len(each.states)
    return tuple(doubts[row] for row in sorted(doubts))


def changing_labels(problem: InverseProblem, *, points: int = POINTS, seed: int = 0) -> dict[int, float]:
    """Return at what share of points within the prior each row's label is a near draw, or has no mode; if at any.

    Args:
        problem: of an arm and a campaign.
        points: number of points that are tried.
        seed: of the points.
    """
    costs, _ = labels_about(problem, points, FREE, seed)
    often = (costs > NEAR_DRAW).mean(0) if len(costs) else np.zeros(len(problem.kinds))
    return {int(row): float(often[row]) for row in np.flatnonzero(often)}


def labels_about(
    problem: InverseProblem, points: int = POINTS, spread: float = NEARBY, seed: int = 0
) -> tuple[Float[np.ndarray, "points D"], Float[np.ndarray, "points D"]]:
    """Return what speaks against each label and what is predicted, by labels alone, at the starting values and about.

    Args:
        problem: of an arm and a campaign.
        points: number of points, besides the starting values.
        spread: their standard deviation in theta, where the prior is not narrower.
        seed: of the points.
    """
    parameters = problem.parameters
    start = np.asarray(parameters.theta(parameters.column("start")))
    noise = np.random.default_rng(seed).standard_normal((points, len(start))) * np.minimum(parameters.normal_sd, spread)
    ends = [evaluate(problem, theta) for theta in (start, *(start + noise))]
    stable = [end for end in ends if np.isfinite(end.predicted).all()] or ends[:1]
    return np.array([end.choice.cost for end in stable]), np.array([end.predicted for end in stable])


class _States(NamedTuple):
    """Modes of all states, ascending; whether each is named by a near draw; the choice of each kind of value."""

    frequency: Any
    torsion: Any
    vertical: Any
    near_draw: Any
    choice: Any


@partial(jit, options=RUNS_ONCE)
def _modes_of_states(arm: Arm, conditions: Conditions) -> _States:
    chain = chains(arm, {}, conditions)
    modes = modes_about(chain, static_equilibrium(chain))
    shares = torsion_share(modes), vertical_share(modes)
    return _States(modes.frequency, *shares, is_ambiguous(modes), mode_choice(conditions, modes))


def _doubts(
    campaign: Campaign,
    values: Named | Unnamed,
    rows: Sequence[Sequence[int]],
    states: _States,
    choice: Float[np.ndarray, "m n"],
) -> Iterator[tuple[int, LabelDoubt]]:
    """Yield the place of each value that is in doubt, and the doubt as that of its first row."""
    named, matched = isinstance(values, Named), np.argmax(choice, 0)
    for i in (i for i, own in enumerate(rows) if own):
        state, mode = values.states[i], matched[i]
        hertz = states.frequency[:, state]
        if not (choice[:, i].any() and np.isfinite(hertz).all()):
            continue
        beside = [j for j in (mode - 1, mode + 1) if 0 <= j < len(hertz) and _near(hertz[j], hertz[mode])]
        near = [] if named else beside
        other = None if named else _row_alike(campaign, values, rows, i)
        drawn = named and bool(states.near_draw[mode, state])
        if near or drawn or other is not None:
            names = labels_of_shares(states.torsion[:, state], states.vertical[:, state])
            yield i, LabelDoubt(rows[i][0], names[mode], drawn, tuple(names[j] for j in near), other)


def _near(a: float, b: float) -> bool:
    return bool(abs(a - b) < NEAR * min(a, b))


def _row_alike(campaign: Campaign, values: Named | Unnamed, rows: Sequence[Sequence[int]], i: int) -> int | None:
    """Return the row of the first value without label in the same state that is nearly the same."""
    own = campaign.measurements[rows[i][0]]
    for j in np.flatnonzero(values.states == values.states[i]).tolist():
        other = campaign.measurements[rows[j][0]] if rows[j] and j != i else None
        if other and abs(own.value - other.value) < ALIKE * np.hypot(own.sigma, other.sigma):
            return rows[j][0]
    return None
