"""Dependence of the vibration on one or two numbers of the arm, or on its speed."""

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
    """A swept number, see `Variable`.

    Attributes:
        values: (K,) of the first of the numbers [SI], or [%]
        present: present value [SI or %]
    """

    values: Float[np.ndarray, "K"]
    present: float

    @property
    def variable(self) -> Variable:
        """The axis as a variable."""
        return Variable(self.paths, float(self.values.min()), float(self.values.max()))


@dataclass(frozen=True)
class Sweep:
    """Amplitudes over a grid.

    Attributes:
        axes: one or two.
        measure: of the vibration, see `simulate.MEASURES`.
        amplitude: (3, *grid) [m] of the arm itself.
        present: (3,) [m] of the present arm.
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

    A number changes by a factor or a difference, the same for every draw. Another speed scales the time of the same
    path, pauses included, with the same number of samples.

    Args:
        evaluator: arm, motion and measure, without variables of its own.
        axes: one or two; one may be the speed.
        progress: shows progress over batches of simulations.

    Raises:
        InputError: see `simulate`; or axes share a number.
        ModelError: the arm has no stable equilibrium at a point of the grid, named in the message.
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
    """Sweep several numbers one at a time, the others fixed; all but the speed in one batch. See `sweep`."""
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
    """Simulate at the present and at several speeds, each with the number of samples and steps of the slowest."""
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
    """Refuse axes that share a number, and impossible values."""
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
# Range of a number for a sweep or a change: given and default bounds.

SWEPT, CHANGED = (0.4, 2.5), (0.5, 2.0)
"""Default range as factors on the present value: of a sweep (also of the speed), and of a change."""
SHARE = 0.2
"""Default range of a mass centre to either side, as a share of its body's extent."""
DISTANCE = 0.1
"""Default range of any other coordinate to either side [m]."""
COUNT, MAP_COUNT = 21, 15
"""Default number of values of a single sweep, and of each axis of a map."""
MOST, MOST_ON_MAP = 500, 10_000
"""Most values of a sweep, and most points of a map."""


@dataclass(frozen=True)
class Bound:
    """A bound of a range.

    Attributes:
        number: SI or %, or a multiple of the present value.
        times: whether the number is a multiple.
    """

    number: float
    times: bool = False

    def of(self, present: float) -> float:
        """Return the bound in SI or %."""
        return self.number * present if self.times else self.number


@dataclass(frozen=True)
class Range(Paths):
    """Range of a number, or of several that change together.

    Attributes:
        bounds: lower and upper; None for the defaults.
        third: number of values of a sweep, or weight of a change; None for the default.
    """

    bounds: tuple[Bound, Bound] | None = None
    third: float | None = None


def axis_of(arm: Arm, interval: Range, percent: float, extents: Extents | None = None, usual: int = COUNT) -> Axis:
    """Return the axis of a sweep over a range.

    Coordinates are spaced evenly, and so is the speed between bounds in %; all else by equal factors.

    Args:
        arm: the present arm.
        interval: the range; its third number is the number of values.
        percent: present speed [%]
        extents: of the arm's bodies; a mass centre stays within.
        usual: default number of values.
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
    """Return the variable of a range.

    Args:
        arm: the present arm.
        interval: the range; its third number is the weight.
        extents: of the arm's bodies; a mass centre stays within.
        softer: whether a stiffness without bounds may also decrease.
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
    """Whether all numbers of a range change by a difference; refuse a mix with factors."""
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
    """Return the ends of a range; by default from factors, or from a share of a body's extent."""
    if interval.bounds is not None:
        low, high = (bound.of(present) for bound in interval.bounds)
        return (high, low) if present < 0 and all(bound.times for bound in interval.bounds) else (low, high)
    if not shifted:
        low, high = sorted(factor * present for factor in factors)
        return low, high
    return _about(interval.paths[0], present, share, extents)


def _about(path: str, present: float, share: float | None, extents: Extents) -> tuple[float, float]:
    """Return default bounds for a change by a difference; a mass centre stays within its body."""
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
# What to change first: percent of amplitude per percent of each number of the arm, and where the sign is uncertain.

NEARBY = 0.1
"""Relative difference of nearby arms in a number, either way; assumed."""
FLAT = 0.002
"""Relative change of an amplitude treated as zero, since peaks are sampled; assumed."""


@dataclass(frozen=True)
class Sensitivities:
    """Elasticities of the amplitude.

    Attributes:
        paths: the numbers.
        present: (P,) [SI] present values.
        amplitude: (3,) [m] present amplitude.
        elasticity: (P, 3) [-] percent of amplitude per percent of the number, in each direction; 0 where nothing moves.
        unsure: (P, 3) whether the sign differs for nearby arms: with draws, for more than 5 % of them; without, where
            a change of the number by `NEARBY` changes the amplitude the other way.
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
    """Return the nonzero numbers that a redesign may change."""
    redesigned = [path for path in arm.paths() if (field := field_of(path)) and field.redesigned]
    payloads = {payload.body.name for payload in arm.payloads}
    named = [path for path in redesigned if path.split(".")[0] not in payloads]
    return tuple(path for path in named if float(arm.get(path)) != 0)


def sensitivities(evaluator: Evaluator, paths: Sequence[str] | None = None, progress: Progress = iter) -> Sensitivities:
    """Return the sensitivity of an evaluator's amplitude to numbers of the arm, by exact slopes.

    The slope of a peak is that of the largest window. See `Evaluator`.

    With known or drawn phases, a number that changes a pulley's speed also shifts its vibration in time, and a peak
    sampled slightly off its top has a different slope. So slopes by ratios are rough there.

    Args:
        evaluator: arm, motion and measure; its variables are not used.
        paths: the numbers; `changeable` by default.
        progress: shows progress over groups of numbers.
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


def _turning(
    evaluator: Evaluator, paths: Sequence[str], elasticity: Float[np.ndarray, "P 3"]
) -> Bool[np.ndarray, "P 3"]:
    """Whether 10 % more or less of a number changes the amplitude against its slope, or makes the arm collapse."""
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
    """Whether changes are notable and differ in sign from their slope; a collapse counts as such."""
    return ~((np.abs(change) < FLAT) | (np.sign(change) == np.sign(slope)))


def _elasticities(
    arm: Arm, variables: Sequence[Variable], parts: np.ndarray, slopes: np.ndarray
) -> Float[np.ndarray, "P 3 batch"]:
    """Return percent per percent at the largest window of each direction and arm."""
    worst = parts.argmax(1)[:, None]
    amplitude = np.take_along_axis(parts, worst, 1)[:, 0]
    slope = np.take_along_axis(slopes, worst[None], 2)[:, :, 0]
    scale = np.array([variable.present(arm) if variable.shifted else 1.0 for variable in variables])
    still = np.broadcast_to(amplitude == 0, slope.shape)  # a planar arm does not vibrate across its plane
    return np.where(still, 0.0, slope / np.where(amplitude == 0, 1.0, amplitude)) * scale[:, None, None]


# -------- Trend
# Trend of an amplitude over a sweep in a word: falls, rises, minimum or maximum in between, flat.

NOTABLE = 0.05
"""Least change, relative to the largest amplitude in a range; assumed."""
NEAR_FACTOR, NEAR_SHARE = 1.25, 0.15
"""Neighbourhood of the present value: a factor, or a share of the range for a change by a difference."""
LINES = (*DIRECTIONS, "largest")
"""Directions, and the largest of them."""


@dataclass(frozen=True)
class Trend:
    """Trend of a curve.

    Attributes:
        shape: `flat`, `falls`, `rises`, `minimum`, `maximum`, or `wavy` with several of them.
        span: first and last value of the sweep.
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
    """Return the trend of an amplitude with increasing values, without changes below `NOTABLE` of its largest."""
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

    Includes the present value if it lies within the range.
    """
    (axis,) = sweep.axes
    values, amplitude = axis.values, sweep.amplitude
    if has_present(axis) and not np.isclose(values, axis.present, rtol=1e-9, atol=1e-12).any():
        place = int(np.searchsorted(values, axis.present))
        values = np.insert(values, place, axis.present)
        amplitude = np.insert(amplitude, place, sweep.present, axis=1)
    return values, np.vstack([amplitude, amplitude.max(0)])


def trends(sweep: Sweep) -> Iterator[tuple[str, Trend, Trend | None]]:
    """Yield the trend of each direction and of the largest, over the whole range and around the present value."""
    (axis,) = sweep.axes
    values, amplitudes = curve(sweep)
    close = near(axis, values)
    for name, amplitude in zip(LINES, amplitudes, strict=True):
        about = trend(values[close], amplitude[close]) if close.sum() > 1 else None
        yield name, trend(values, amplitude), about


def near(axis: Axis, values: Float[np.ndarray, "K"]) -> np.ndarray:
    """Return which values are near the present one, at least a neighbour on either side; none if it is out of range."""
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
    """Whether the present value lies within the range."""
    slack = 1e-9 * (axis.values[-1] - axis.values[0])
    return bool(axis.values[0] - slack <= axis.present <= axis.values[-1] + slack)


def below(values: Float[np.ndarray, "K"], amplitude: Float[np.ndarray, "K"], limit: float) -> list[tuple[float, float]]:
    """Return the ranges in which an amplitude meets a limit, by linear interpolation."""
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
    """Return the indices of start, turning points and end, with at least a given change between them."""
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
