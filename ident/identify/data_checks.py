"""Data checks: values that no such arm would give, and kinds of data that contradict each other."""

import math
from collections.abc import Collection, Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from typing import Any

import numpy as np
from jaxtyping import Float

from ident.arm.arm import Arm
from ident.arm.labels import parse_label
from ident.errors import InputError, ModelError, Problem
from ident.identify.conditions import BY_MODE
from ident.identify.definitions import MOST_DAMPED
from ident.identify.label_checks import labels_about
from ident.identify.loops import loop_places
from ident.identify.modal_analysis import modal_analysis
from ident.identify.mode_assignment import FAR
from ident.inference.problem import InverseProblem
from ident.inference.verdicts import SUSPICIOUS, farthest
from ident.measure import Campaign, Measurement
from ident.measure.kinds import KINDS, POSITIONS, SHAPES
from ident.text import quoted
from ident.units import QUANTITIES, si_factor

PLAUSIBLE = {
    "frequency": 3.0,
    "damping_ratio": 100.0,
    "deflection": 5.0,
    "deflection_difference": 5.0,
    "rotation": 5.0,
    "rotation_difference": 5.0,
    "twist": 5.0,
    "twist_difference": 5.0,
}
"""Factor by which a value may differ from what the arm file predicts before it is refused."""

AWAY = 0.1
"""Distance [m] by which a position may differ from the arm file's before it is refused."""

ALL = "all"
"""What trusts the values of all rows."""

SLACK = math.radians(0.5)
"""By how much a held angle may lie beyond a joint's limit [rad]: how well it is read."""


def check_values(problem: InverseProblem, campaign: Campaign, arm: Arm, trusted: Collection[str] = ()) -> None:
    """Refuse what the arm as its file has it makes implausible: values far off, labels of no mode, postures off limits.

    Repeated measurements that contradict each other are refused as well. A value counts as far off where it is so by
    more than three of its standard deviations.

    Args:
        problem: of the campaign and the arm.
        campaign: the measurements.
        arm: as its file has it.
        trusted: rows that are right whatever they look like: their numbers in the file, or `all`.

    Raises:
        InputError: lists the values, each with its row; or a trusted row that is not there, or whose label no mode of
            the arm can bear.
    """
    names = row_names(campaign)
    if unknown := [row for row in trusted if row not in {*names, ALL}]:
        expected, remedy = f"rows of the campaign ({names[0]} to {names[-1]}), or {ALL}", "correct the number"
        raise InputError(Problem("trust_values", quoted(unknown[0]), expected, remedy))
    predicted, missing = _by_labels(problem, campaign, names)
    friction = _by_friction(campaign, predicted)
    doubts: list[Problem] = []
    hopeless: list[Problem] = []
    for i, (name, m) in enumerate(zip(names, campaign, strict=True)):
        if m.mode and math.isnan(predicted[i]):
            hopeless += _no_such_mode(m, arm, "or leave it empty: trusted or not, there is nothing to fit it to")
        elif m.of and predicted[i] == 0:
            hopeless += [_too_damped(m)]
        elif name not in trusted:
            doubts += _beyond_limits(m, arm, name)
            remedy = f"leave it empty, or {_right(name)}"
            doubts += _no_such_mode(m, arm, remedy) if i in missing else []
            doubts += _far_off(m, float(predicted[i]), name) if i not in missing | friction else []
    doubts += _contradictions(campaign, names, trusted)
    if hopeless or (doubts and ALL not in trusted):
        raise InputError([*hopeless, *(doubts if ALL not in trusted else ())])


def plausible_beside(campaign: Campaign, predicted: Float[np.ndarray, "D"]) -> bool:
    """Tell whether `check_values` would find nothing in a campaign that differs in its values from one that it passed.

    Args:
        campaign: the measurements.
        predicted: (D,) [SI] what the arm file predicts by the labels.
    """
    names = row_names(campaign)
    each, friction = zip(campaign, predicted.tolist(), names, strict=True), _by_friction(campaign, predicted)
    plausible = not any(problem for i, row in enumerate(each) if i not in friction for problem in _far_off(*row))
    return plausible and not any(contradictory_repeats(campaign))


def _by_friction(campaign: Campaign, predicted: Float[np.ndarray, "D"]) -> set[int]:
    """Return rows of ramps that read so little, beside the largest of their loop, that it may all be friction."""
    loops, sizes = np.abs(loop_places(campaign)).astype(int), np.nan_to_num(np.abs(predicted))
    largest = np.zeros(loops.max(initial=0) + 1)
    np.maximum.at(largest, loops, sizes)
    return set(np.flatnonzero((loops > 0) & (sizes < largest[loops] / 2)).tolist())


def _by_labels(
    problem: InverseProblem, campaign: Campaign, names: Sequence[str]
) -> tuple[Float[np.ndarray, "D"], set[int]]:
    """Return what the arm file predicts by the labels alone, and the rows whose label it never has.

    Where a label's mode is none at the file's values, or far off, it may be another one for an arm nearby: then what is
    predicted there counts, if it is plausible.
    """

    def is_far_off(i: int, expected: float) -> bool:
        return any(_far_off(campaign.measurements[i], float(expected), names[i]))

    costs, about = labels_about(problem, 0)
    predicted = about[0].copy()
    odd = [i for i, m in enumerate(campaign) if m.mode and (costs[0, i] >= FAR or is_far_off(i, predicted[i]))]
    if not odd:
        return predicted, set()
    costs, about = labels_about(problem)
    for i in odd:
        fine = [x for x, cost in zip(about[:, i], costs[:, i], strict=True) if cost < FAR]
        predicted[i] = next((x for x in fine if not is_far_off(i, x)), predicted[i])
    return predicted, {i for i in odd if (costs[:, i] >= FAR).all()}


def row_names(campaign: Campaign) -> list[str]:
    """Return what rows are called: their numbers in the file, or those of their order where they come from none."""
    return [m.where.rpartition(":")[2] or str(i) for i, m in enumerate(campaign, 1)]


def _far_off(m: Measurement, expected: float, row: str) -> Iterator[Problem]:
    """Refuse a value that differs from the prediction by more than a factor, even if its sigma is considered."""
    if m.kind in POSITIONS:
        yield from _far_away(m, expected, row)
    if m.kind in (*POSITIONS, *SHAPES):  # a shape is of either sign, and small where a mode hardly moves a point
        return
    limit = PLAUSIBLE[m.kind]
    low, high = sorted((expected / limit, expected * limit))
    if not expected or not (m.value + SUSPICIOUS * m.spread < low or m.value - SUSPICIOUS * m.spread > high):
        return
    ratio = m.value / expected
    radians = m.kind == "frequency" and 0.8 < ratio / (2 * math.pi) < 1.25
    hint = "it looks like rad/s written as Hz: " if radians else ""
    got = f"{_written(m, m.value)}, {ratio:.3g} times what the arm file predicts"
    yield Problem(
        m.where, got, f"about {_written(m, expected)}", f"{hint}check value and unit, or {_right(row)}", "value"
    )


def _far_away(m: Measurement, expected: float, row: str) -> Iterator[Problem]:
    """Refuse a position that no error of measurement or geometry explains."""
    if abs(m.value - expected) > AWAY + SUSPICIOUS * m.spread:
        got, about = f"{_written(m, m.value)}", f"about {_written(m, expected)}, where the arm file has it"
        yield Problem(m.where, got, about, f"check value, unit, posture and setup, or {_right(row)}", "value")


def _written(m: Measurement, value: float) -> str:
    """Write a number in the unit that a measurement was written in; in SI where that is none of its kind."""
    si = QUANTITIES[KINDS[m.kind]].si
    try:
        return f"{value / si_factor(m.unit, KINDS[m.kind]):.4g} {m.unit}".removesuffix(" 1")
    except InputError:  # made in code, where the unit is a remark
        return f"{value:.4g} {si}".removesuffix(" 1")


def _right(row: str) -> str:
    """Return the remedy of who knows better."""
    return f"say that it is right (`trust_values` {row})"


def contradictory_repeats(campaign: Campaign) -> Iterator[tuple[int, int]]:
    """Yield, for each thing that was measured twice or more, the two rows that contradict each other most, if any do.

    The more pairs there are, the farther apart two values may be by chance (Bonferroni): the chance that any pair of a
    campaign that is right is named stays below that of one pair at 3 sd. Frequencies without a mode label are never
    repeats, since those of one posture and load belong to different modes.
    """
    same = repeated(campaign)
    limit = farthest(sum(math.comb(len(rows), 2) for rows in same))
    for rows in same:
        own = [campaign.measurements[row] for row in rows]
        apart = _farthest_apart(np.array([m.value for m in own]), np.array([m.spread for m in own]), limit)
        if apart:
            yield rows[apart[0]], rows[apart[1]]


def repeated(campaign: Campaign) -> list[list[int]]:
    """Return the rows of each thing that was measured; frequencies without a label are in none."""
    same: dict[Measurement, list[int]] = {}
    for row, m in enumerate(campaign):
        if m.kind not in BY_MODE or m.mode:
            angles = tuple(round(angle, 5) for angle in m.posture)
            blank: dict[str, Any] = {"value": 0.5, "sigma": 1.0, "resolution": 0.0, "repeat": "", "note": ""}
            same.setdefault(replace(m, posture=angles, **blank), []).append(row)
    return [*same.values()]


def _farthest_apart(
    value: Float[np.ndarray, "n"], sigma: Float[np.ndarray, "n"], limit: float
) -> tuple[int, int] | None:
    """Return the first of the pairs that are farthest apart, if by more than a limit [sd].

    As hypot(a, b) is (a + b) / sqrt(2) at least, a value is in such a pair only where it is above the lowest of
    value + limit sigma / sqrt(2) by as much, or below the highest: of many values that agree few.
    """
    way = limit * sigma / math.sqrt(2)
    high, low = value - way, value + way
    near = np.flatnonzero((high > low.min()) | (low < high.max()))
    worst, found = limit, None
    for place, i in enumerate(near[:-1]):
        others = near[place + 1 :]
        apart = np.abs(value[others] - value[i]) / np.hypot(sigma[others], sigma[i])
        if apart.max() > worst:
            worst, found = float(apart.max()), (int(i), int(others[np.argmax(apart)]))
    return found


def _apart(a: Measurement, b: Measurement) -> float:
    return abs(a.value - b.value) / math.hypot(a.spread, b.spread)


def _contradictions(campaign: Campaign, names: Sequence[str], trusted: Collection[str]) -> Iterator[Problem]:
    kept = [i for i, name in enumerate(names) if name not in trusted]
    measurements = tuple(campaign.measurements[i] for i in kept)
    for i, j in contradictory_repeats(replace(campaign, measurements=measurements)):
        first, second = measurements[i], measurements[j]
        a, b = names[kept[i]], names[kept[j]]
        same = f"has the label '{first.mode}', too" if first.mode else "measured the same"
        got = f"{_written(second, second.value)}, {_apart(first, second):.2g} sd from row {a}, which {same}"
        label = "correct one of the labels, " if first.mode else "correct point, posture or load of one, "
        remedy = f"{label}drop the wrong one, widen their sigmas, or say that both are right (`trust_values` {b})"
        yield Problem(
            second.where, got, f"about {_written(second, first.value)}", remedy, "" if first.mode else "value"
        )


def _no_such_mode(m: Measurement, arm: Arm, remedy: str) -> Iterator[Problem]:
    """Name the modes that the arm has there; nothing if it has none because it collapses, or has the one."""
    label = parse_label(m.mode or "")
    with suppress(ModelError):
        names = modal_analysis(arm, m.posture, m.load, 3 * len(arm.joints)).labels
        if label and sum(label.admits(name) for name in names) >= label.ordinal:
            return  # a wrong label beside it has taken its mode
        expected = f"a mode of the arm at that posture: {', '.join(map(str, names))}"
        yield Problem(m.where, f"'{m.mode}'", expected, f"correct the label, {remedy}", "mode")


def _too_damped(m: Measurement) -> Problem:
    got = f"a {m.of} frequency of a mode that has none: it is damped too much in the arm file"
    limit = f"a damping ratio up to {MOST_DAMPED:g}" if m.of != "damped" else "a damping ratio below 1"
    return Problem(m.where, got, limit, "give `pole`, or correct the damping of the arm file", "of")


def _beyond_limits(m: Measurement, arm: Arm, row: str) -> Iterator[Problem]:
    for joint, angle in zip(arm.driven, m.posture, strict=True):
        low, high = joint.limits
        if not low - SLACK <= angle <= high + SLACK:
            got = f"{joint.name} at {math.degrees(angle):.4g} deg"
            expected = f"{math.degrees(low):.4g} to {math.degrees(high):.4g} deg, its limits in the arm file"
            remedy = f"check the angle and its unit, or {_right(row)}"
            yield Problem(m.where, got, expected, remedy, "posture")
