"""How the vibration depends on one or two numbers of the arm, or on its speed."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise, product

import numpy as np
from jaxtyping import Bool, Float

from ident.arm.arm import Arm, check_drives
from ident.arm.fields import COMPONENTS, SPEED, STIFFNESS, field_of
from ident.errors import refusal, refuse
from ident.programs import Progress, cores
from ident.vibrate.evaluator import WIDTH, Evaluator
from ident.vibrate.motion import FASTEST
from ident.vibrate.study import DIRECTIONS
from ident.vibrate.variable import (
    Extents,
    Paths,
    Variable,
    apply,
    check,
    check_path,
    is_shifted,
    outside,
    refuse_factor,
)


@dataclass(frozen=True)
class Axis(Paths):
    """A number that is swept, see `Variable`.

    Attributes:
        values: (K,) of the first of the numbers [SI], or [%]
        present: as it is [SI or %]
    """

    values: Float[np.ndarray, "K"]
    present: float

    @property
    def variable(self) -> Variable:
        """The same as what may be changed."""
        return Variable(self.paths, float(self.values.min()), float(self.values.max()))


@dataclass(frozen=True)
class Sweep:
    """Amplitudes over a grid.

    Attributes:
        axes: one or two.
        measure: of the vibration, see `simulate.MEASURES`.
        amplitude: (3, *grid) [m] of the arm itself.
        present: (3,) [m] as the arm is.
        draws: (3, *grid, D) [m] of draws; None without.
    """

    axes: tuple[Axis, ...]
    measure: str
    amplitude: Float[np.ndarray, "3 *grid"]
    present: Float[np.ndarray, "3"]
    draws: Float[np.ndarray, "3 *grid D"] | None = None

    @property
    def band(self) -> Float[np.ndarray, "2 3 *grid"]:
        """5 and 95 % quantiles over the draws [m]."""
        assert self.draws is not None
        return np.quantile(self.draws, (0.05, 0.95), axis=-1)

    def exceeds(self, limit: float) -> Float[np.ndarray, "*grid"]:
        """Return the share of draws that exceed a limit [m] in any direction."""
        assert self.draws is not None
        return (self.draws > limit).any(0).mean(-1)


def sweep(evaluator: Evaluator, axes: Sequence[Axis], progress: Progress = iter) -> Sweep:
    """Simulate a motion at every point of a grid, and for every draw, by the fast method.

    A number is changed by a factor or a difference, which is that of every draw. At another speed the same path is
    passed on another clock, pauses included, and sampled as often.

    Args:
        evaluator: arm, motion and measure; it changes nothing by itself.
        axes: one or two, of which one may be the speed.
        progress: shows how far it is, over batches of simulations.

    Raises:
        InputError: see `simulate`; axes that share a number.
        ModelError: the arm has no stable equilibrium at some point of the grid, which is named.
    """
    _check(evaluator.arm, axes)
    if len(axes) > 2:
        raise refusal("axes", f"{len(axes)} of them", "one or two", "drop one")
    turning = [axis for axis in axes if not axis.is_speed]
    points = list(product(*(axis.values for axis in turning)))
    places = np.array(points).reshape((len(points), len(turning)))
    evaluator = replace(evaluator, variables=tuple(axis.variable for axis in turning))
    ratios = [value / axis.present for axis in axes if axis.is_speed for value in axis.values]
    changes = _changes(evaluator, places)
    if ratios:
        present, whole = _at_speeds(evaluator, changes, ratios, progress)
    else:
        present, whole = np.split(evaluator.amplitudes(np.vstack([0 * changes[:1], changes]), progress), [1], 1)
    order = [axis for axis in axes if axis.is_speed] + turning
    whole = whole.reshape((3, *(len(axis.values) for axis in order), -1))
    whole = np.moveaxis(whole, [1 + order.index(axis) for axis in axes], range(1, 1 + len(axes)))
    own = whole[..., 1:] if evaluator.draws else None
    return Sweep(tuple(axes), evaluator.measure, whole[..., 0], present[:, 0, 0], own)


def sweeps(evaluator: Evaluator, axes: Sequence[Axis], progress: Progress = iter) -> tuple[Sweep, ...]:
    """Sweep several numbers one by one, the others as they are; all but the speed in one batch. See `sweep`."""
    _check(evaluator.arm, axes)
    turning = [axis for axis in axes if not axis.is_speed]
    by_name: dict[str, Sweep] = {axis.name: sweep(evaluator, [axis], progress) for axis in axes if axis.is_speed}
    if turning:
        evaluator = replace(evaluator, variables=tuple(axis.variable for axis in turning))
        as_it_is = np.array([axis.present for axis in turning])
        places = [np.where(np.arange(len(turning)) == k, x, as_it_is) for k, a in enumerate(turning) for x in a.values]
        whole = evaluator.amplitudes(_changes(evaluator, np.array([as_it_is, *places])), progress)
        ends = np.cumsum([1, *(len(axis.values) for axis in turning)])
        for axis, first, end in zip(turning, ends, ends[1:], strict=False):
            part = whole[:, first:end]
            own = part[..., 1:] if evaluator.draws else None
            by_name[axis.name] = Sweep((axis,), evaluator.measure, part[..., 0], whole[:, 0, 0], own)
    return tuple(by_name[axis.name] for axis in axes)


def _at_speeds(
    evaluator: Evaluator, changes: np.ndarray, ratios: Sequence[float], progress: Progress
) -> tuple[Float[np.ndarray, "3 1 D"], Float[np.ndarray, "3 places D"]]:
    """Simulate as it is and at several speeds, with as many samples and steps at each as at the slowest."""
    slowest = min(ratios)
    step = evaluator.step or replace(evaluator, motion=evaluator.motion.at_speed(100 * slowest)).step_for(changes)

    def run(ratio: float, changes: np.ndarray) -> Float[np.ndarray, "3 G D"]:
        clock, moved = ratio / slowest, evaluator.motion.at_speed(100 * ratio)
        return replace(evaluator, motion=moved, rate=evaluator.rate * clock, step=step / clock).amplitudes(changes)

    parts = [run(ratios[k], changes) for k in progress(range(len(ratios)))]
    return run(1.0, 0 * changes[:1]), np.concatenate(parts, 1)


def _changes(evaluator: Evaluator, places: Float[np.ndarray, "G V"]) -> Float[np.ndarray, "G V"]:
    pairs = zip(evaluator.variables, places.T, strict=True)
    columns = [np.asarray(variable.change(evaluator.arm, column)) for variable, column in pairs]
    return np.stack(columns, 1) if columns else np.zeros((len(places), 0))


def _check(arm: Arm, axes: Sequence[Axis]) -> None:
    """Refuse axes that share a number, and values that it can't have."""
    paths = [path for axis in axes for path in axis.paths]
    twice = next((path for path in paths if paths.count(path) > 1), None)
    if not axes or twice:
        got = f"{twice} twice" if twice else "nothing"
        raise refusal("axes", got, "different numbers", "drop one" if twice else "name one")
    for axis in axes:
        for end in () if axis.is_speed else (axis.values[0], axis.values[-1]):
            variable = axis.variable
            check_drives(arm.replace(apply(arm.numbers(), [variable], [variable.change(arm, end)])))


# -------- Ranges
# From where to where a number is swept, or may be changed: bounds as they are given, and the usual ones.

SWEPT, CHANGED = (0.4, 2.5), (0.5, 2.0)
"""Factors on the present value between which a number is swept, the speed too, and between which it may be changed."""
SHARE = 0.2
"""Of a body's extent, to either side of the present mass centre, where it is swept."""
DISTANCE = 0.1
"""To either side of any other coordinate [m]."""
COUNT, MAP_COUNT = 21, 15
"""Values of a parameter that is swept alone, and on a map."""
MOST, MOST_ON_MAP = 500, 10_000
"""Values of a parameter, and points of a map."""


@dataclass(frozen=True)
class Bound:
    """A bound of a range.

    Attributes:
        number: SI or %, or a multiple of the present value.
        times: whether it is a multiple.
    """

    number: float
    times: bool = False

    def of(self, present: float) -> float:
        """Return it in SI or %."""
        return self.number * present if self.times else self.number


@dataclass(frozen=True)
class Range(Paths):
    """A number, or several that go together, from where to where.

    Attributes:
        bounds: lower and upper; None for those that suit the number.
        third: how many values it is swept over, or how dear it is to change; None for the usual.
    """

    bounds: tuple[Bound, Bound] | None = None
    third: float | None = None


def axis_of(arm: Arm, interval: Range, percent: float, extents: Extents | None = None, usual: int = COUNT) -> Axis:
    """Return the axis of a range that is swept.

    Coordinates are spaced evenly, and so is the speed between bounds in %; all else by equal factors.

    Args:
        arm: as it is.
        interval: the range; its third number is how many values there are.
        percent: present speed [%]
        extents: of the arm's bodies; a mass centre stays within.
        usual: number of values unless the range says it.
    """
    is_speed, bounds = interval.is_speed, interval.bounds
    shifted = _is_shifted(arm, interval)
    present = percent if is_speed else float(arm.get(interval.paths[0]))
    low, high = _ends(interval, present, shifted, SWEPT, SHARE, extents or {})
    count = usual if interval.third is None else interval.third
    if not shifted:
        refuse(refuse_factor(interval.paths[0], present, (low, high)))
    if not (np.isfinite([low, high]).all() and low < high):
        raise refusal("", f"{low:g} to {high:g}", "a lower and a higher bound", "correct them")
    if not 2 <= count <= MOST or count != int(count):
        raise refusal("", f"{count:.12g} values", f"a whole number from 2 to {MOST}", "correct the count")
    most = min(FASTEST, percent * FASTEST / 100)
    if is_speed and high > most * (1 + 1e-12):
        remedy = "start from a higher `speed`" if most < FASTEST else "100 is full speed"
        raise refusal("", f"{high:g} %", f"at most {most:g} %", remedy)
    even = shifted or (is_speed and bounds is not None and not any(bound.times for bound in bounds))
    values = (np.linspace if even else np.geomspace)(low, high, int(count))
    swept = Axis(interval.paths, np.unique(values), present)
    if not is_speed:
        refuse(outside(arm, swept.variable, extents or {}))
    return swept


def variable_of(arm: Arm, interval: Range, extents: Extents | None = None, *, softer: bool = True) -> Variable:
    """Return what may be changed within a range.

    Args:
        arm: as it is.
        interval: the range; its third number is the weight.
        extents: of the arm's bodies; a mass centre stays within.
        softer: whether a stiffness without bounds may fall, too.
    """
    if SPEED in interval.paths:
        raise refusal("", "the speed", "a number of the arm", "sweep it instead (ident sweep)")
    for path in interval.paths:
        check_path(arm, path)
    present, shifted = float(arm.get(interval.paths[0])), is_shifted(interval.paths[0])
    stiffness = getattr(field_of(interval.paths[0]), "name", "") in STIFFNESS
    factors = (1.0, CHANGED[1]) if stiffness and not softer else CHANGED
    low, high = _ends(interval, present, shifted, factors, None, extents or {})
    variable = Variable(interval.paths, low, high, 1.0 if interval.third is None else interval.third)
    check(arm, variable, extents)
    return variable


def _is_shifted(arm: Arm, interval: Range) -> bool:
    """Tell whether all numbers of a range are changed by a difference; refuse those that do not go together."""
    if interval.is_speed:
        return False
    if SPEED in interval.paths:
        raise refusal("", "the speed with others", "it alone", "give it a range of its own")
    for path in interval.paths:
        check_path(arm, path)
    kinds = {is_shifted(path) for path in interval.paths}
    if len(kinds) > 1:
        got, expected = "a coordinate with other numbers", "numbers of one kind"
        raise refusal("", got, expected, "coordinates are changed by a difference, others by a factor")
    return kinds.pop()


def _ends(
    interval: Range, present: float, shifted: bool, factors: tuple[float, float], share: float | None, extents: Extents
) -> tuple[float, float]:
    """Return the ends of a range; where it has none, by factors, or by a share of a body's extent."""
    if interval.bounds is not None:
        low, high = (bound.of(present) for bound in interval.bounds)
        return (high, low) if present < 0 and all(bound.times for bound in interval.bounds) else (low, high)
    if not shifted:
        low, high = sorted(factor * present for factor in factors)
        return low, high
    return _about(interval.paths[0], present, share, extents)


def _about(path: str, present: float, share: float | None, extents: Extents) -> tuple[float, float]:
    """Return bounds to either side of what is changed by a difference; a mass centre stays within its body."""
    body, field, *component = path.split(".")
    if field == "inertia":
        raise refusal("", "no bounds", "LOW:HIGH for an inertia", "add them, as =1:2 or =0.5x:2x")
    if field == "com" and body in extents:
        lowest, highest = extents[body][:, COMPONENTS[component[0]][0]]
        half = DISTANCE if share is None else share * (highest - lowest)
        return max(present - half, float(lowest)), min(present + half, float(highest))
    half = np.pi if field.endswith("phase") else DISTANCE
    return present - half, present + half


# -------- Sensitivity
# What to change first: percent of amplitude per percent of each number of the arm, and where its sign is not sure.

NEARBY = 0.1
"""Share of a number by which nearby arms differ in it, either way; assumed."""
FLAT = 0.002
"""Share of an amplitude below which a change is none: peaks are sampled; assumed."""


@dataclass(frozen=True)
class Sensitivities:
    """Elasticities of the amplitude.

    Attributes:
        paths: the numbers.
        present: (P,) [SI] as they are.
        amplitude: (3,) [m] as it is.
        elasticity: (P, 3) [-] percent of amplitude per percent of the number, in each direction; 0 where nothing moves.
        unsure: (P, 3) whether its sign is another for nearby arms: with draws, for more than 5 % of them; without,
            where `NEARBY` more or less of the number itself changes the amplitude the other way.
        draws: (P, 3, D) of the draws; None without.
    """

    paths: tuple[str, ...]
    present: Float[np.ndarray, "P"]
    amplitude: Float[np.ndarray, "3"]
    elasticity: Float[np.ndarray, "P 3"]
    unsure: Bool[np.ndarray, "P 3"]
    draws: Float[np.ndarray, "P 3 D"] | None = None

    @property
    def band(self) -> Float[np.ndarray, "2 P 3"]:
        """5 and 95 % quantiles over the draws."""
        assert self.draws is not None
        return np.quantile(self.draws, (0.05, 0.95), axis=-1)

    @property
    def order(self) -> list[int]:
        """The numbers by their effect on the largest amplitude, the strongest first."""
        return np.argsort(-np.abs(self.elasticity[:, np.argmax(self.amplitude)])).tolist()


def changeable(arm: Arm) -> tuple[str, ...]:
    """Return the numbers that are studied: those that a redesign may change, and that are not zero."""
    redesigned = [path for path in arm.paths() if (field := field_of(path)) and field.redesigned]
    payloads = {payload.body.name for payload in arm.payloads}
    named = [path for path in redesigned if path.split(".")[0] not in payloads]
    return tuple(path for path in named if float(arm.get(path)) != 0)


def sensitivities(evaluator: Evaluator, paths: Sequence[str] | None = None, progress: Progress = iter) -> Sensitivities:
    """Return how the amplitude of an evaluator changes with numbers of the arm, by exact slopes.

    Where an amplitude is a peak, the slope is that of the largest window. See `Evaluator`.

    With phases that are known, or drawn, a number that changes how fast a pulley turns also shifts its vibration in
    time: a peak that is sampled a little beside its top then has another slope. So slopes by ratios are rough there.

    Args:
        evaluator: arm, motion and measure; its own variables are not used.
        paths: the numbers; `changeable` if none are named.
        progress: shows how far it is, over groups of numbers.
    """
    paths = tuple(paths) if paths else changeable(evaluator.arm)
    for path in paths:
        check_path(evaluator.arm, path)
    together = WIDTH * cores()
    groups = [paths[first : first + together] for first in range(0, len(paths), together)]
    own, drawn = [], []
    for k in progress(range(len(groups))):
        seen = replace(evaluator, variables=tuple(Variable((path,), -np.inf, np.inf) for path in groups[k]))
        nothing = np.zeros(len(groups[k]))
        parts, slopes = seen.slopes(nothing)
        own.append(_elasticities(evaluator.arm, seen.variables, parts, slopes)[..., 0])
        if evaluator.draws:
            drawn.append(_elasticities(evaluator.arm, seen.variables, *seen.slopes_of_draws(nothing)))
    each, draws = np.concatenate(own), np.concatenate(drawn) if drawn else None
    present = np.array([float(evaluator.arm.get(path)) for path in paths])
    found = Sensitivities(paths, present, parts[:, :, 0].max(1), each, np.zeros(each.shape, bool), draws)
    unsure = _turning(evaluator, paths, each) if draws is None else (found.band[0] < 0) & (found.band[1] > 0)
    return replace(found, unsure=unsure)


def _turning(evaluator: Evaluator, paths: Sequence[str], elasticity: np.ndarray) -> Bool[np.ndarray, "P 3"]:
    """Tell where 10 % more or less of a number changes the amplitude, or makes the arm collapse, against its slope."""
    matters = [k for k, each in enumerate(elasticity) if np.abs(each).max() * NEARBY >= FLAT]
    variables = tuple(Variable((paths[k],), -np.inf, np.inf) for k in matters)
    signs, whole = (1.0, -1.0), replace(evaluator, variables=variables, draws={})
    ends = [[v.change(evaluator.arm, v.present(evaluator.arm) * (1 + s * NEARBY)) for v in variables] for s in signs]
    changes = np.concatenate([np.zeros((1, len(variables))), *(np.diag(np.array(end, float)) for end in ends)])
    stands = np.asarray(whole.end_states(changes).frequency) > 0
    amplitudes = np.full((3, len(changes)), np.nan)
    amplitudes[:, stands] = whole.amplitudes(changes[stands])[:, :, 0]
    more, less = np.split((amplitudes[:, 1:] / amplitudes[:, :1] - 1).T, 2)
    turning = np.zeros(elasticity.shape, bool)
    turning[matters] = _against(more, elasticity[matters]) | _against(-less, elasticity[matters])
    return turning


def _against(change: Float[np.ndarray, "V 3"], slope: Float[np.ndarray, "V 3"]) -> Bool[np.ndarray, "V 3"]:
    """Tell which changes are notable and have not the sign of their slope; a collapse has none."""
    return ~((np.abs(change) < FLAT) | (np.sign(change) == np.sign(slope)))


def _elasticities(
    arm: Arm, variables: Sequence[Variable], parts: np.ndarray, slopes: np.ndarray
) -> Float[np.ndarray, "P 3 batch"]:
    """Return percent per percent at the largest window of each direction and arm."""
    worst = parts.argmax(1)[:, None]
    amplitude = np.take_along_axis(parts, worst, 1)[:, 0]
    slope = np.take_along_axis(slopes, worst[None], 2)[:, :, 0]
    scale = np.array([variable.present(arm) if variable.shifted else 1.0 for variable in variables])
    still = np.broadcast_to(amplitude == 0, slope.shape)  # an arm that moves in a plane: across it nothing vibrates
    return np.where(still, 0.0, slope / np.where(amplitude == 0, 1.0, amplitude)) * scale[:, None, None]


# -------- Trend
# How an amplitude depends on what is swept, in a word: falls, rises, least or largest in between, hardly changed.

NOTABLE = 0.05
"""Part of the largest amplitude in a range that counts as a change; assumed."""
NEAR_FACTOR, NEAR_SHARE = 1.25, 0.15
"""How far about the present value is near: a factor, or a share of the range of what is changed by a difference."""
LINES = (*DIRECTIONS, "largest")
"""Directions, and the largest of them."""


@dataclass(frozen=True)
class Trend:
    """How a curve goes.

    Attributes:
        shape: `flat`, `falls`, `rises`, `minimum`, `maximum`, or `wavy` with several of them.
        span: first and last value of what is swept.
        ends: amplitude at both [m]
        least: value and amplitude of the lowest point.
        largest: value and amplitude of the highest point.
    """

    shape: str
    span: tuple[float, float]
    ends: tuple[float, float]
    least: tuple[float, float]
    largest: tuple[float, float]


def trend(values: Float[np.ndarray, "K"], amplitude: Float[np.ndarray, "K"]) -> Trend:
    """Return how an amplitude goes with growing values; ups and downs below `NOTABLE` of its largest do not count."""
    turns = _turns(amplitude, NOTABLE * float(amplitude.max()))
    ups = [bool(amplitude[b] > amplitude[a]) for a, b in pairwise(turns)]
    names = {(): "flat", (True,): "rises", (False,): "falls", (False, True): "minimum", (True, False): "maximum"}

    def point(place: np.intp) -> tuple[float, float]:
        return float(values[place]), float(amplitude[place])

    span, ends = (float(values[0]), float(values[-1])), (float(amplitude[0]), float(amplitude[-1]))
    shape = names.get(tuple(ups), "wavy")
    return Trend(shape, span, ends, point(amplitude.argmin()), point(amplitude.argmax()))


def curve(sweep: Sweep) -> tuple[Float[np.ndarray, "K"], Float[np.ndarray, "4 K"]]:
    """Return the values of a sweep of one axis, and amplitudes in x, y, z and the largest of them [m].

    The present value is among them, if it lies within the range.
    """
    (axis,) = sweep.axes
    values, amplitude = axis.values, sweep.amplitude
    if has_present(axis) and not np.isclose(values, axis.present, rtol=1e-9, atol=1e-12).any():
        place = int(np.searchsorted(values, axis.present))
        values = np.insert(values, place, axis.present)
        amplitude = np.insert(amplitude, place, sweep.present, axis=1)
    return values, np.vstack([amplitude, amplitude.max(0)])


def trends(sweep: Sweep) -> Iterator[tuple[str, Trend, Trend | None]]:
    """Yield the trend of each direction and of the largest, over the whole range and about the present value."""
    (axis,) = sweep.axes
    values, amplitudes = curve(sweep)
    close = near(axis, values)
    for name, amplitude in zip(LINES, amplitudes, strict=True):
        about = trend(values[close], amplitude[close]) if close.sum() > 1 else None
        yield name, trend(values, amplitude), about


def near(axis: Axis, values: Float[np.ndarray, "K"]) -> np.ndarray:
    """Return which values are near the present one, a neighbour on either side at least; none if it is not within."""
    if not has_present(axis):
        return np.zeros(len(values), bool)
    if not axis.shifted:
        inside = np.abs(np.log(values / axis.present)) <= np.log(NEAR_FACTOR) * (1 + 1e-9)
    else:
        inside = np.abs(values - axis.present) <= NEAR_SHARE * (values[-1] - values[0]) * (1 + 1e-9)
    place = int(np.abs(values - axis.present).argmin())
    inside[max(place - 1, 0) : place + 2] = True
    return inside


def has_present(axis: Axis) -> bool:
    """Tell whether the present value lies within the range."""
    slack = 1e-9 * (axis.values[-1] - axis.values[0])
    return bool(axis.values[0] - slack <= axis.present <= axis.values[-1] + slack)


def below(values: Float[np.ndarray, "K"], amplitude: Float[np.ndarray, "K"], limit: float) -> list[tuple[float, float]]:
    """Return the ranges in which an amplitude meets a limit, straight between the values."""
    meets, ranges = amplitude <= limit, []

    def crossing(k: int) -> float:
        share = (limit - amplitude[k]) / (amplitude[k + 1] - amplitude[k])
        return float(values[k] + share * (values[k + 1] - values[k]))

    for k in map(int, np.flatnonzero(meets)):
        if k == 0 or not meets[k - 1]:
            start = float(values[0]) if k == 0 else crossing(k - 1)
            ranges.append([start, float(values[-1])])
        if k + 1 < len(values) and not meets[k + 1]:
            ranges[-1][1] = crossing(k)
    return [(start, end) for start, end in ranges]


def _turns(amplitude: np.ndarray, least: float) -> list[int]:
    """Return the places of start, turning points and end, between which it changes by at least so much."""
    turns: list[int] = []
    way = low = high = 0
    for k in range(len(amplitude)):
        low = k if amplitude[k] < amplitude[low] else low
        high = k if amplitude[k] > amplitude[high] else high
        if way != 1 and amplitude[k] - amplitude[low] >= least and k > low:
            turns.append(low)
            way, high = 1, k
        elif way != -1 and amplitude[high] - amplitude[k] >= least and k > high:
            turns.append(high)
            way, low = -1, k
    return [*turns, {0: 0, 1: high, -1: low}[way]]
