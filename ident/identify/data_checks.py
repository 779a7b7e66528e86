"""Plausibility checks of a campaign's values before any fit, with probable causes."""

import math
from collections.abc import Collection, Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from itertools import combinations, product
from typing import Any, NamedTuple

import equinox as eqx
import numpy as np
from jaxtyping import Float

from ident.arm.arm import Arm
from ident.arm.fields import STIFFNESS
from ident.arm.modes import parse_label
from ident.arm.plausibility import oddities
from ident.errors import ARM_FILE, InputError, ModelError, Problem, refusal
from ident.identify.conditions import BY_MODE, MOST_DAMPED, bind, loop_places
from ident.identify.modal_analysis import modal_analysis
from ident.identify.mode_matching import FAR
from ident.identify.problem import Posed, labels_about
from ident.inference.information import SUSPICIOUS, farthest
from ident.inference.parameters import Parameters
from ident.inference.problem import InverseProblem
from ident.inference.search import evaluate
from ident.measure import Campaign, Measurement
from ident.measure.kinds import DIFFERENCES, KINDS, POSITIONS, SHAPES
from ident.text import by_key, quoted
from ident.units import NMM_PER_DEG, QUANTITIES, STANDARD_GRAVITY, si_factor

READ_AT_REST = ("deflection", "deflection_difference", "rotation", "rotation_difference", "twist", "twist_difference")
PLAUSIBLE = {"frequency": 3.0, **dict.fromkeys(READ_AT_REST, 5.0)}
"""Largest accepted factor between a value and the arm file's prediction."""
MOST_DOUBTS = 3
"""Most doubtful rows to name if the arm file itself looks wrong."""
AWAY = 0.1
"""Largest accepted distance [m] of a position from the arm file's; assumed."""
ALL = "all"
"""Keyword to trust the values of all rows."""
SLACK = math.radians(0.5)
"""Accepted excess [rad] of a posture's angle over a joint's limit: the reading accuracy."""


def check_values(posed: Posed, trusted: Collection[str] = ()) -> None:
    """Refuse what is implausible for the arm file: values far off, labels without a mode, postures beyond limits.

    Contradictory repeated measurements are refused as well. A value counts as far off only by more than three of its
    standard deviations.

    Args:
        posed: the campaign and the arm.
        trusted: rows to accept in any case: their numbers in the file, or `all`.

    Raises:
        InputError: lists the suspicious numbers of the arm, then the values, each with its row; or a trusted row that
            does not exist, or with a label that no mode of the arm can have.
    """
    arm, campaign, names = posed.arm, posed.campaign, row_names(posed.campaign)
    if unknown := [row for row in trusted if row not in {*names, *row_names(posed.ratios), ALL}]:
        rows = f"rows of the campaign ({names[0]} to {names[-1]}), or {ALL}"
        raise refusal("trust_values", quoted(unknown[0]), rows, "correct the number")
    expected, missing = _by_labels(posed.problem, campaign)
    found = list(_in_doubt(posed, expected, missing, trusted))
    doubts, hopeless = ([each for each in found if (each.tag == HOPELESS) == is_so] for is_so in (False, True))
    contradictions = list(_contradictions(campaign, names, trusted))
    if hopeless or ((doubts or contradictions) and ALL not in trusted):
        problems = [] if ALL in trusted else [*_merged(doubts, posed, expected, trusted), *contradictions]
        first, free = "correct the arm file first (`ident show` draws it)", posed.problem.parameters.paths
        odd = [Problem(ARM_FILE, each.got, each.expected, first, each.path) for each in oddities(arm, free=free)]
        if any(problem.where == ARM_FILE for problem in problems):  # a stiffness explains all rows
            odd = [each for each in odd if not each.column.endswith(STIFFNESS)]
        if odd and (more := len(problems) - MOST_DOUBTS) > 0:  # a wrong arm makes every row look wrong
            rest = Problem(campaign.name, f"{more} more rows in doubt", "none", first)
            problems = [*problems[:MOST_DOUBTS], rest]
        raise InputError([*odd, *(each.problem for each in hopeless), *problems])


class Expected(NamedTuple):
    """Predictions of the arm file (D,) [SI], and margins below and above them for an arm of plausible stiffnesses.

    A static reading is the sum of all joints' contributions, which may nearly cancel: a factor on the sum is no
    measure of its error. So each contribution may be off by 3 sd of its prior, at most by `PLAUSIBLE`, independently.
    """

    value: Float[np.ndarray, "D"]
    below: Float[np.ndarray, "D"]
    above: Float[np.ndarray, "D"]
    label_cost: Float[np.ndarray, "D"]

    @classmethod
    def of(cls, problem: InverseProblem, campaign: Campaign) -> "Expected":
        """Return the predictions and margins at the starting values, with modes matched by labels alone."""
        here, parameters = evaluate(problem), problem.parameters
        most = [1.0 if kind in (*BY_MODE, *POSITIONS) else PLAUSIBLE[kind] for kind in problem.kinds]
        widths = SUSPICIOUS * np.where(parameters.positive, parameters.normal_sd, 0.0)
        factor = np.exp(np.minimum(widths, np.log(most)[:, None]))
        slope, value = np.nan_to_num(np.asarray(here.jacobian)), np.array(here.predicted)
        moves = np.stack([slope * (1 - 1 / factor), slope * (1 - factor)])  # of contributions, by 1 / stiffness
        below, above = (np.linalg.norm((sign * moves).max(0).clip(0.0), axis=1) for sign in (-1, 1))
        loops, sizes = np.abs(loop_places(campaign)).astype(int), np.nan_to_num(np.abs(value))
        largest = np.zeros(loops.max(initial=0) + 1)
        np.maximum.at(largest, loops, sizes)
        friction = (loops > 0) & (sizes < largest[loops] / 2)  # so small that friction may explain them
        below[friction] = above[friction] = np.inf
        return cls(value, below, above, np.asarray(here.choice.cost))


def _by_labels(problem: InverseProblem, campaign: Campaign) -> tuple[Expected, set[int]]:
    """Return the arm file's predictions by the labels alone, and the rows with a label that no mode has.

    If a label has no mode at the file's values, or one far off, an arm nearby may have another one: then the prediction
    there counts, if it is plausible.
    """
    expected = Expected.of(problem, campaign)

    def is_far_off(i: int, value: float) -> bool:
        expected.value[i] = value
        return any(far_off(i, campaign, expected))

    costs, here = expected.label_cost, expected.value.tolist()
    odd = [i for i, m in enumerate(campaign) if m.mode and (costs[i] >= FAR or is_far_off(i, here[i]))]
    if not odd:
        return expected, set()
    nearby, about = labels_about(problem)
    for i in odd:
        fine = [x for x, cost in zip(about[:, i], nearby[:, i], strict=True) if cost < FAR]
        expected.value[i] = next((x for x in fine if not is_far_off(i, x)), here[i])
    return expected, {i for i in odd if (nearby[:, i] >= FAR).all()}


def row_names(campaign: Campaign) -> list[str]:
    """Return the names of the rows: their numbers in the file, or their order if there is no file."""
    return [_row_name(m, i) for i, m in enumerate(campaign)]


def _row_name(m: Measurement, place: int) -> str:
    return m.where.rpartition(":")[2] or str(place + 1)


class _Doubt(NamedTuple):
    """A problem of a row; rows with one mistake share the `tag`; and whether the cause is known."""

    place: int
    problem: Problem
    tag: tuple[object, ...]
    known: bool = False


UNITS = {
    "frequency": "Hz rad/s rpm kHz",
    "length": "m mm cm um in mil",
    "rotation": "rad mrad deg",
    "damping_ratio": "1 %",
}
STIFFNESS_UNITS = {"N mm/deg": NMM_PER_DEG, "N m/deg": 180 / math.pi, "N mm/rad": 1e-3, "N m/arcmin": 10800 / math.pi}
"""Stiffness units often confused with N m/rad."""
HOPELESS = ("hopeless",)
"""Tag of problems that trust cannot override."""


def _in_doubt(posed: Posed, expected: Expected, missing: Collection[int], trusted: Collection[str]) -> Iterator[_Doubt]:
    """Yield the doubts about each row: its label, its angles, its value."""
    for i, m in enumerate(posed.campaign):
        if m.mode and math.isnan(expected.value[i]):
            remedy = "or leave it empty: trusted or not, there is nothing to fit it to"
            yield from (_Doubt(i, each, HOPELESS) for each in _no_such_mode(m, posed.arm, remedy))
        elif m.of and expected.value[i] == 0:
            got = f"a {m.of} frequency of a mode that has none: it is damped too much in the arm file"
            limit = f"a damping ratio up to {MOST_DAMPED:g}" if m.of != "damped" else "a damping ratio below 1"
            remedy = "give `pole`, or correct the damping of the arm file"
            yield _Doubt(i, Problem(m.where, got, limit, remedy, "of"), HOPELESS)
        elif _row_name(m, i) not in trusted:
            for joint, angle in zip(posed.arm.driven, m.posture, strict=True):
                low, high = joint.limits
                if not low - SLACK <= angle <= high + SLACK:
                    got = f"{joint.name} at {math.degrees(angle):.4g} deg"
                    within = f"{math.degrees(low):.4g} to {math.degrees(high):.4g} deg, its limits in the arm file"
                    odd = Problem(m.where, got, within, "check the angle and its unit", "posture")
                    yield _Doubt(i, odd, ("posture", joint.name))
            if i in missing:
                label = _no_such_mode(m, posed.arm, "leave it empty")
                yield from (_Doubt(i, each, ("mode", m.mode)) for each in label)
            else:
                yield from far_off(i, posed.campaign, expected)


def far_off(i: int, campaign: Campaign, expected: Expected) -> Iterator[_Doubt]:
    """Refuse a value beyond the range of plausible arms, with its sigma allowed for."""
    m, value = campaign.measurements[i], float(expected.value[i])
    if m.kind in POSITIONS and abs(m.value - value) > AWAY + SUSPICIOUS * m.spread:
        about, remedy = f"about {_written(m, value)}, where the arm file has it", "check value, unit, posture and setup"
        yield _Doubt(i, Problem(m.where, _written(m, m.value), about, remedy, "value"), (i,))
    if m.kind in (*POSITIONS, *SHAPES):  # a shape has either sign, and is small near a node
        return
    limit = PLAUSIBLE[m.kind]
    low = min(value / limit, value * limit, value - expected.below[i])
    high = max(value / limit, value * limit, value + expected.above[i])
    if not value or not (m.value + SUSPICIOUS * m.spread < low or m.value - SUSPICIOUS * m.spread > high):
        return
    ratio = m.value / value
    looks = _looks_like(m, ratio)
    times = np.format_float_positional(ratio, precision=3, fractional=False, trim="-")  # `567`, `0.0000042`
    got = f"{_written(m, m.value)}, {times} times what the arm file predicts"
    remedy = f"it looks like {looks}: correct the file" if looks else "check value and unit"
    tag = m.kind, looks or (ratio > 0, round(4 * math.log(abs(ratio) or 1.0)))
    yield _Doubt(i, Problem(m.where, got, f"about {_written(m, value)}", remedy, "value"), tag, bool(looks))


def _looks_like(m: Measurement, ratio: float) -> str:
    """Name the mistake that explains this ratio of a value to its prediction; empty if none is known."""
    if -2 < ratio < -0.5:
        return "a wrong sign or direction"
    with suppress(InputError, ValueError):  # a unit made in code, which is a remark; a negative ratio
        quantity, size = KINDS[m.kind], math.log(ratio)
        own, units = math.log(si_factor(m.unit, quantity)), UNITS[quantity].split()
        factors = {f"{unit} written as {m.unit}": own - math.log(si_factor(unit, quantity)) for unit in units}
        if m.kind in DIFFERENCES:  # readings without a load do not count
            hung = (m.load.masses, -1, "N written as kg"), (m.load.forces, 1, "kg written as N")
            factors |= {f"a load in {words}": way * math.log(STANDARD_GRAVITY) for loads, way, words in hung if loads}
        return " or ".join(words for words, factor in factors.items() if abs(size - factor) < abs(factor) / 12)
    return ""


def _merged(doubts: Sequence[_Doubt], posed: Posed, expected: Expected, trusted: Collection[str]) -> list[Problem]:
    """Return a problem for each mistake: a single one in angles or stiffnesses if it explains all, or shared ones."""
    places, campaign = list(dict.fromkeys(each.place for each in doubts)), posed.campaign

    def off(there: Expected) -> Float[np.ndarray, "n"]:
        pairs = [(campaign.measurements[i].value, there.value[i]) for i in places]
        return -np.diff(np.log(np.maximum(np.abs(pairs), 1e-300)))[:, 0]

    if 1 < len(places) <= len(campaign) <= TRIED and not all(each.known for each in doubts):
        before, causes = off(expected), []
        limit = max(COMMON, float(np.abs(before - np.median(before)).mean()))  # residual of a common factor
        for where, column, looks, right in _put_right(posed):
            there = Expected.of(right.problem, right.campaign)
            fine = np.isfinite(there.value).all() and (there.label_cost < FAR).all()
            if fine and not any(_in_doubt(right, there, (), trusted)):
                causes.append((float(np.abs(off(there)).mean()), where, column, looks))
        if causes and min(causes)[0] < limit:
            _, where, column, looks = min(causes)
            rows = ", ".join(_row_name(campaign.measurements[i], i) for i in places)
            remedy = f"{looks}: correct it; {_right(ALL)}"
            return [Problem(where, f"{len(places)} rows in doubt ({rows})", "none", remedy, column)]
    return [_of_all(own, campaign) for own in by_key((each.tag, each) for each in doubts).values()]


def _of_all(doubts: Sequence[_Doubt], campaign: Campaign) -> Problem:
    """Return the problem of the first of some rows, with the others' names."""
    first, m = doubts[0].problem, campaign.measurements[doubts[0].place]
    name, *rows = [_row_name(campaign.measurements[each.place], each.place) for each in doubts]
    hint = ""
    if m.kind == "frequency" and not m.mode and first.column == "value":
        own = (None, m.kind, m.posture, m.load, m.drives)
        alike = sorted(o.value for o in campaign if (o.mode, o.kind, o.posture, o.load, o.drives) == own)
        place = f"number {alike.index(m.value) + 1} of {len(alike)} modes" if alike[1:] else ""
        hint = f"it is taken as {place} without a label there: label repeats, or " * bool(place)
    more = f", and {len(rows)} more like it (row{'s' * (len(rows) > 1)} {', '.join(rows)})" if rows else ""
    return replace(first, got=first.got + more, remedy=f"{hint}{first.remedy}; {_right(ALL if rows else name)}")


def _put_right(posed: Posed) -> Iterator[tuple[str, str, str, Posed]]:
    """Yield the campaign corrected for a mistake in angles or stiffnesses: file, column, words, and posed campaign."""
    campaign, problem, names = posed.campaign, posed.problem, [joint.name for joint in posed.arm.driven]
    one, places = np.eye(len(names)), range(len(names))
    turns = {f"{name} looks like a wrong sign": one - 2 * np.diag(e) for name, e in zip(names, one, strict=True)}
    turns["the angles look like rad written as deg"] = np.degrees(one)
    turns["the angles look like deg written as rad"] = np.radians(one)
    for a, b in combinations(places, 2):
        turns[f"{names[a]} and {names[b]} look swapped"] = one[[{a: b, b: a}.get(i, i) for i in places]]
    for looks, turn in turns.items():
        rows = (replace(m, posture=tuple((turn @ m.posture).tolist())) for m in campaign)
        other = replace(campaign, measurements=tuple(rows))
        right = eqx.tree_at(lambda p: Posed(campaign, p).conditions, problem, bind(posed.arm, other))
        yield campaign.path, "posture", looks, Posed(other, right)
    items = problem.parameters.items
    stiff = [i for i, item in enumerate(items) if item.name.endswith(STIFFNESS)]
    for own, (unit, size), way in product([*([i] for i in stiff), stiff], STIFFNESS_UNITS.items(), (1, -1)):
        moved = (replace(item, start=item.start * size**way) if i in own else item for i, item in enumerate(items))
        looks = "it looks like {} written as {}".format(*(unit, "N m/rad")[::way])
        column = items[own[0]].name if len(own) == 1 else "all stiffnesses"
        yield ARM_FILE, column, looks, Posed(campaign, replace(problem, parameters=Parameters(tuple(moved))))


def _written(m: Measurement, value: float) -> str:
    """Write a number in the unit of a measurement's entry; in SI if that unit is wrong for its kind."""
    try:
        return f"{value / si_factor(m.unit, KINDS[m.kind]):.4g} {m.unit}".removesuffix(" 1")
    except InputError:  # made in code, where the unit is a remark
        return f"{value:.4g} {QUANTITIES[KINDS[m.kind]].si}".removesuffix(" 1")


def _right(row: str) -> str:
    """Return the remedy for a user who knows that the row is right."""
    return f"if {'they are' if row == ALL else 'it is'} right all the same, say so (`trust_values` {row})"


def contradictory_repeats(campaign: Campaign) -> Iterator[tuple[int, int]]:
    """Yield the two rows of each repeated measurement that contradict each other most, if any do.

    The limit grows with the number of pairs (Bonferroni): the false-alarm probability of a correct campaign stays below
    that of one pair at 3 sd. Frequencies without a mode label are never repeats, since those of one posture and load
    belong to different modes.
    """
    same = repeated(campaign)
    limit = farthest(sum(math.comb(len(rows), 2) for rows in same))
    for rows in same:
        own = [campaign.measurements[row] for row in rows]
        apart = _farthest_apart(np.array([m.value for m in own]), np.array([m.spread for m in own]), limit)
        if apart:
            yield rows[apart[0]], rows[apart[1]]


def repeated(campaign: Campaign) -> list[list[int]]:
    """Return the rows of each measured quantity; frequencies without a label are in none."""
    blank: dict[str, Any] = {"value": 0.5, "sigma": 1.0, "resolution": 0.0, "repeat": "", "note": ""}
    named = [(row, m) for row, m in enumerate(campaign) if m.kind not in BY_MODE or m.mode]
    same = by_key((replace(m, posture=tuple(round(q, 5) for q in m.posture), **blank), row) for row, m in named)
    return [*same.values()]


def _farthest_apart(
    value: Float[np.ndarray, "n"], sigma: Float[np.ndarray, "n"], limit: float
) -> tuple[int, int] | None:
    """Return the pair of values (n,) farthest apart, the first of several, if by more than a limit [sd].

    As hypot(a, b) is at least (a + b) / sqrt(2), a value can be in such a pair only if it is above the lowest
    value + limit sigma / sqrt(2) by as much, or below the highest: few of many values that agree.
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


def _contradictions(campaign: Campaign, names: Sequence[str], trusted: Collection[str]) -> Iterator[Problem]:
    kept = [i for i, name in enumerate(names) if name not in trusted]
    measurements = tuple(campaign.measurements[i] for i in kept)
    for i, j in contradictory_repeats(replace(campaign, measurements=measurements)):
        first, second = measurements[i], measurements[j]
        a, b = names[kept[i]], names[kept[j]]
        apart = abs(first.value - second.value) / math.hypot(first.spread, second.spread)
        same = f"has the label '{first.mode}', too" if first.mode else "measured the same"
        got = f"{_written(second, second.value)}, {apart:.2g} sd from row {a}, which {same}"
        label = "correct one of the labels, " if first.mode else "correct point, posture or load of one, "
        remedy = f"{label}drop the wrong one, or widen their sigmas; if both are right, say so (`trust_values` {b})"
        about, column = f"about {_written(second, first.value)}", "" if first.mode else "value"
        yield Problem(second.where, got, about, remedy, column)


def _no_such_mode(m: Measurement, arm: Arm, remedy: str) -> Iterator[Problem]:
    """Name the modes of the arm there; nothing if it has none as it collapses, or if it has the labelled one."""
    label = parse_label(m.mode or "")
    with suppress(ModelError):
        names = modal_analysis(arm, m.posture, m.load, arm.degrees_of_freedom).labels
        if label and sum(label.admits(name) for name in names) >= label.ordinal:
            return  # another, wrong label has taken its mode
        expected = f"a mode of the arm at that posture: {', '.join(map(str, names))}"
        yield Problem(m.where, f"'{m.mode}'", expected, f"correct the label, {remedy}", "mode")


TRIED, COMMON = 1000, 0.1
"""Most rows for which a common cause is searched; mean |ln factor| it may leave of the doubtful rows; assumed."""
