"""Data checks: values that no such arm would give, and kinds of data that contradict each other."""

import math
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from itertools import combinations

import numpy as np
from jaxtyping import Float

from ident.arm.arm import Arm
from ident.errors import InputError, ModelError, Problem
from ident.identify.conditions import BY_MODE
from ident.identify.label_checks import labels_about
from ident.identify.modal_analysis import modal_analysis
from ident.identify.mode_assignment import FAR
from ident.inference.problem import InverseProblem
from ident.measure import Campaign, Measurement

PLAUSIBLE = {"frequency": 3.0, "damping_ratio": 100.0, "deflection": 5.0, "deflection_difference": 5.0}
"""Factor by which a value may differ from what the arm file predicts before it is refused."""

DISAGREE = 3.0
"""Standard deviations of their difference from which two measurements of the same thing contradict each other."""

SLACK = math.radians(0.5)
"""By how much a held angle may lie beyond a joint's limit [rad]: how well it is read."""


def check_values(problem: InverseProblem, campaign: Campaign, arm: Arm) -> None:
    """Refuse what the arm as its file has it makes implausible: values far off, labels of no mode, postures off limits.

    Repeated measurements that contradict each other are refused as well.

    Raises:
        InputError: lists the values, each with its row.
    """
    predicted, missing = _by_labels(problem, campaign)
    doubts = [doubt for m in campaign for doubt in _beyond_limits(m, arm)]
    doubts += _contradictions(campaign)
    for i, (m, expected) in enumerate(zip(campaign, predicted, strict=True)):
        if i in missing:
            doubts += _no_such_mode(m, arm)
            continue
        ratio = m.value / expected if expected else math.nan
        if _is_far_off(m, expected):
            hint = "it looks like rad/s written as Hz: " if 0.8 < ratio / (2 * math.pi) < 1.25 else ""
            hint = hint if m.kind == "frequency" else ""
            remedy = f"{hint}check value and unit, or say that it is right (`trust_values`)"
            got = f"{m.value:.4g} (SI), {ratio:.3g} times what the arm file predicts"
            doubts.append(Problem(m.where, got, f"about {expected:.4g}", remedy, "value"))
    if doubts:
        raise InputError(doubts)


def _by_labels(problem: InverseProblem, campaign: Campaign) -> tuple[Float[np.ndarray, "D"], set[int]]:
    """Return what the arm file predicts by the labels alone, and the rows whose label it never has.

    Where a label's mode is none at the file's values, or far off, it may be another one for an arm nearby: then what is
    predicted there counts, if it is plausible.
    """
    costs, about = labels_about(problem, 0)
    predicted = about[0].copy()
    odd = [i for i, m in enumerate(campaign) if m.mode and (costs[0, i] >= FAR or _is_far_off(m, predicted[i]))]
    if not odd:
        return predicted, set()
    costs, about = labels_about(problem)
    for i in odd:
        fine = [x for x, cost in zip(about[:, i], costs[:, i], strict=True) if cost < FAR]
        predicted[i] = next((x for x in fine if not _is_far_off(campaign.measurements[i], x)), predicted[i])
    return predicted, {i for i in odd if (costs[:, i] >= FAR).all()}


def _is_far_off(m: Measurement, expected: float) -> bool:
    ratio, limit = m.value / expected if expected else math.nan, PLAUSIBLE[m.kind]
    return not 1 / limit < ratio < limit and math.isfinite(ratio)


def contradictory_repeats(campaign: Campaign) -> Iterator[tuple[int, int]]:
    """Yield, for each thing that was measured twice or more, the two rows that contradict each other most, if any do.

    Frequencies without a mode label are never repeats, since those of one posture and load belong to different modes.
    """
    same: dict[Measurement, list[int]] = {}
    for row, m in enumerate(campaign):
        if m.kind not in BY_MODE or m.mode:
            angles = tuple(round(angle, 5) for angle in m.posture)
            same.setdefault(replace(m, posture=angles, value=0.5, sigma=1.0, note=""), []).append(row)
    for rows in same.values():
        apart = {(i, j): _apart(campaign.measurements[i], campaign.measurements[j]) for i, j in combinations(rows, 2)}
        worst = max(apart, key=apart.__getitem__, default=None)
        if worst and apart[worst] > DISAGREE:
            yield worst


def _apart(a: Measurement, b: Measurement) -> float:
    return abs(a.value - b.value) / math.hypot(a.sigma, b.sigma)


def _contradictions(campaign: Campaign) -> Iterator[Problem]:
    for i, j in contradictory_repeats(campaign):
        first, second = campaign.measurements[i], campaign.measurements[j]
        row = first.where.rpartition(":")[2] or str(i + 1)
        got = f"{second.value:.4g} (SI), {_apart(first, second):.2g} sd from row {row}, which measured the same"
        remedy = "drop the wrong one, widen their sigmas, or say that both are right (`trust_values`)"
        yield Problem(second.where, got, f"about {first.value:.4g}", remedy, "value")


def _no_such_mode(m: Measurement, arm: Arm) -> Iterator[Problem]:
    """Name the modes that the arm has there; nothing if it has none because it collapses."""
    with suppress(ModelError):
        names = map(str, modal_analysis(arm, m.posture, m.load, 3 * len(arm.joints)).labels)
        remedy = "correct the label, leave it empty, or say that it is right (`trust_values`)"
        yield Problem(m.where, f"'{m.mode}'", f"a mode of the arm at that posture: {', '.join(names)}", remedy, "mode")


def _beyond_limits(m: Measurement, arm: Arm) -> Iterator[Problem]:
    for joint, angle in zip(arm.driven, m.posture, strict=True):
        low, high = joint.limits
        if not low - SLACK <= angle <= high + SLACK:
            got = f"{joint.name} at {math.degrees(angle):.4g} deg"
            expected = f"{math.degrees(low):.4g} to {math.degrees(high):.4g} deg, its limits in the arm file"
            remedy = "check the angle and its unit, or say that it is right (`trust_values`)"
            yield Problem(m.where, got, expected, remedy, "posture")
