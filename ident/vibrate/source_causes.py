"""The cause of a vibration peak: imbalance, transmission error, belt mesh, flexible finger or fixed frequency.

Each cause adds columns to the motion itself. Imbalance and transmission error add those of the drives' sources, belt
mesh those of a transmission error at the order of its teeth. A fixed frequency adds a cosine and a sine for each trace.
A finger adds the motion y of a light oscillator at the sensor, driven by the acceleration a there:

    y'' + 2 zeta omega y' + omega^2 y = -a

In a band around the peak, a trace x becomes nearly independent complex samples,

    z_n = sum over t of h(t_n - t) x(t) exp(-2 pi i f t),    with a low pass h.

A set S of causes leaves the residual share u_k(S) of the energy of trace k, by least squares in which clock, stiffness,
damping and tilt may move within their uncertainty. The evidence of a set is its score (`ident.vibrate.hypotheses`) less
p/2 ln n, with p columns and frequencies and n numbers in all. Its prediction of held-out blocks is scored in the same
way, without p. All sets compete. The cause of a peak is the one with the largest share in its set, if evidence and
prediction agree.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property, lru_cache, partial
from itertools import combinations, product
from typing import Any, NamedTuple

import equinox as eqx
import numpy as np
from jaxtyping import Float
from scipy.interpolate import make_interp_spline
from scipy.signal import cont2discrete, firwin, lfilter, upfirdn

from ident.arm.multibody import IMBALANCE, ExcitingOrder, possible_orders
from ident.arm.parts import ORDER_MAX, ErrorOrder
from ident.errors import refusal
from ident.text import quoted
from ident.vibrate.hypotheses import PEAK, probability, score
from ident.vibrate.source_identification import RIDGE, Point, further_run
from ident.vibrate.source_problem import Channel, Place, SourceProblem
from ident.vibrate.unit_response import Response, Run, path_of

CAUSES = ("imbalance", "error", "mesh", "finger", "line")
"""Competing causes."""
WIDTH = 0.15
"""Half width of the band around a peak, relative to its frequency: closer peaks count as one; assumed."""
LENGTH = 3.0
"""Length of the low pass, in periods of half the band: it passes 3 % at a quarter of the band beyond its edges."""
FINE = 8
"""Trial frequencies of a line per resolved step (one over the length of the longest trace)."""
DAMPING = (0.002, 0.006, 0.02)
"""Trial damping ratios of a finger: steel to glued plates; assumed."""
SCANNED = ((WIDTH, 31), (0.01, 7), (0.002, 5))
"""Scans for the frequency of a finger: relative half width and number of trial values, first around the peak, then
around the best value so far. The last are 0.1 % apart, a fifth of a resonance with the least damping of `DAMPING`."""
WIDER = 3.0
"""Factor on the standard deviations of clock, stiffness, damping and tilt: an unknown cause may have biased their fit.
"""
BLOCKS, FOLDS = 8, 4
"""Blocks of each trace, and folds of the cross-validation over them."""
NEEDED = 3.0
"""Least score difference [nat] between competing sets for a discriminating run: odds of 20."""
MOST = 0.5
"""Least share of its set's explained energy for the cause of a peak; assumed."""


class Band(NamedTuple):
    """Band-pass demodulation of a trace: the content of a band as real and imaginary part of a slow signal.

    Attributes:
        frequency: [Hz] its middle.
        half: [Hz] half its width.
        rate: [Hz] sampling rate of the trace.
    """

    frequency: float
    half: float
    rate: float

    @property
    def step(self) -> int:
        """Samples of the trace per sample of the result."""
        return max(1, int(self.rate / (2 * self.half)))

    def __call__(self, columns: np.ndarray) -> np.ndarray:
        """Return columns (T, ...) as (2 n, ...)."""
        taps = firwin(int(LENGTH * self.rate / self.half) | 1, self.half, fs=self.rate)
        turned = np.exp(-2j * np.pi * self.frequency / self.rate * np.arange(len(columns)))
        found = upfirdn(taps, columns * turned.reshape((-1, *(1,) * (columns.ndim - 1))), down=self.step, axis=0)
        ends = -(-(len(taps) - 1) // self.step)
        inner = found[ends : (len(columns) - 1) // self.step + 1]
        return np.concatenate([inner.real, inner.imag])


@dataclass(frozen=True)
class Cause:
    """A possible cause of a peak.

    Attributes:
        kind: one of `CAUSES`.
        source: the strongest source of its kind; None for a finger or a fixed frequency.
        frequency: [Hz] of a finger or a line; NaN for sources, whose frequency follows the drive.
        share: its share of the band's energy in its set, the best set in which it is the largest cause.
        explained: share of the energy that this set explains.
        predicted: share of the energy of held-out blocks that this set predicts.
        evidence: probability that it is the largest cause, by evidence.
        held_out: probability that it is the largest cause, by prediction.
    """

    kind: str
    source: ExcitingOrder | None
    frequency: float
    share: float
    explained: float
    predicted: float
    evidence: float
    held_out: float

    @property
    def probability(self) -> float:
        """The lower of both probabilities."""
        return min(self.evidence, self.held_out)


@dataclass(frozen=True)
class Causes:
    """The comparison of causes of a peak.

    Attributes:
        peak: [Hz]
        band: [Hz] from, to.
        causes: compared causes, the most probable first.
        untested: why others were not compared, by kind.
        left: residual share of the band's energy with the best set.
        speed: [%] of the run that best discriminates the first two; 0 where none does, or none is needed.
    """

    peak: float
    band: tuple[float, float]
    causes: tuple[Cause, ...]
    untested: Mapping[str, str]
    left: float
    speed: float

    @property
    def explained(self) -> bool:
        """Whether some set explains the peak and predicts held-out blocks."""
        return self.left < 1 - PEAK.seen and max(cause.predicted for cause in self.causes) >= PEAK.seen

    @property
    def told(self) -> bool:
        """Whether the first cause is identified, by evidence and by prediction, and dominates the peak."""
        first = self.causes[0]
        return self.explained and first.share >= MOST * first.explained and first.probability >= PEAK.sure


def check_peak(problem: SourceProblem, peak: float | None, teeth: Mapping[str, float]) -> None:
    """Refuse a peak outside the band of the traces or too low for their length, and teeth of an unknown belt.

    Raises:
        InputError: there is one.
    """
    names = [belt.name for belt in problem.arm.belts]
    for name, count in teeth.items():
        if name not in names:
            raise refusal("teeth", quoted(name), f"one of {', '.join(names)}", "name a belt of the arm")
        if not (1 <= count <= ORDER_MAX and float(count).is_integer()):
            raise refusal("teeth", f"{name}={count:g}", f"a whole number from 1 to {ORDER_MAX}", "correct it")
        if peak is None:
            raise refusal("teeth", f"{name}={count:g} without a peak", "both", "give `peak`, in Hz, too")
    if peak is None:
        return
    for channel in problem.channels:
        highest, seconds = channel.rate / 2 / (1 + WIDTH), len(channel.time) / channel.rate
        lowest = 2 * LENGTH / (WIDTH * seconds)
        if not lowest <= peak <= highest:
            expected = f"from {lowest:.3g} to {highest:.3g}, by the length and the samples of {channel.name}"
            raise refusal("peak", f"{peak:g} Hz", expected, "ask for another, or measure longer or faster")


def compared(
    problem: SourceProblem,
    place: Place,
    covariance: Float[np.ndarray, "n n"],
    peak: float,
    *,
    teeth: Mapping[str, float] | None = None,
    further: Mapping[float, Run] | None = None,
) -> Causes:
    """Compare the possible causes of a peak.

    Args:
        problem: traces, and possible sources of excitation.
        place: result of the search for the sources.
        covariance: of all unknowns there.
        peak: frequency [Hz].
        teeth: of a belt's driving pulley, by the belt's name; without it belt mesh is not tested.
        further: candidate runs, by speed [%], to discriminate between causes.

    Raises:
        InputError: see `check_peak`.
    """
    check_peak(problem, peak, teeth or {})
    meshed, untested = _with_mesh(problem, teeth or {}, peak)
    more = len(meshed.sources) - len(problem.sources)
    place = place._replace(parts=np.pad(place.parts, ((0, 0), (0, more), (0, 0))))
    # calibrations stay fixed: their columns are the traces themselves, so that any set would explain everything
    named = zip(place._fields[:-1], place[:-1], strict=True)
    moving = np.flatnonzero(np.concatenate([np.full(part.size, name != "calibration") for name, part in named]))
    loose = np.linalg.cholesky(WIDER**2 * covariance[np.ix_(moving, moving)])
    bands = [Band(peak, WIDTH * peak, channel.rate) for channel in meshed.channels]
    point = Point(meshed, place, meshed.responses(place), bands)
    kinds = ["imbalance" if each.kind == IMBALANCE else "error" for each in problem.sources] + ["mesh"] * more
    return _Contest.of(point, moving, np.linalg.inv(loose), kinds).judged(peak, untested, further or {})


def _with_mesh(problem: SourceProblem, teeth: Mapping[str, float], peak: float) -> tuple[SourceProblem, dict[str, str]]:
    """Return the problem with the orders of belt mesh, and why belt mesh is not tested otherwise."""
    arm, low = problem.arm, peak * (1 - WIDTH)
    if not teeth:
        return problem, {"mesh": "the belts' numbers of teeth are not given"}
    orders, spans, ends = dict[str, list[float]](), list[float](), [run.motion.breaks for run in problem.runs]
    times = [np.linspace(float(end[0]), float(end[-1]), 400) for end in ends]
    speeds = np.abs(np.concatenate([run.motion(t)[1] for run, t in zip(problem.runs, times, strict=True)], 1)).max(1)
    fastest = dict(zip((joint.name for joint in arm.driven), speeds.tolist(), strict=True))
    for belt in (belt for belt in arm.belts if belt.name in teeth):
        count = float(teeth[belt.name])
        own = {belt.driver: count, belt.driven: count * float(belt.driven_radius) / float(belt.driver_radius)}
        # the belt runs along the driver's link, which turns by q while the pulley turns by ratio q: `multibody.stretch`
        own |= {d.joint: count * (1 - 1 / float(d.ratio)) for d in arm.drives if d.joint == belt.driver}
        for drive in arm.drives:
            taken = [2.0, *(each.order for each in drive.errors), *orders.get(drive.name, [])]
            if drive.joint in own and own[drive.joint] not in taken:
                highest = own[drive.joint] * abs(float(drive.ratio)) * fastest[drive.joint] / (2 * np.pi)
                spans.append(highest)
                if highest > low:
                    orders.setdefault(drive.name, []).append(own[drive.joint])
    if not orders:
        return problem, {"mesh": f"teeth mesh at {max(spans, default=0.0):.3g} Hz at most in these runs"}
    teething = {d.name: [ErrorOrder(d.name, order) for order in orders.get(d.name, [])] for d in arm.drives}
    drives = tuple(replace(drive, errors=(*drive.errors, *teething[drive.name])) for drive in arm.drives)
    meshing = eqx.tree_at(lambda a: a.drives, arm, drives)
    new = [each for each in possible_orders(meshing) if each not in problem.sources]
    added = [each for each in new if each.order in orders.get(each.drive, [])]
    return replace(problem, arm=meshing, sources=(*problem.sources, *added)), {}


def _driving(at: Point) -> Iterator[np.ndarray]:
    """Yield for each channel the acceleration along its sensor (T,) [m/s^2], at the times of its response."""
    arm, paths = at.problem.arm_at(at.place), dict[tuple[int, str], np.ndarray]()
    for channel in at.problem.channels:
        response = at.responses[channel.run]
        weights = np.append(1.0, at.problem.parts_of(channel.run, at.place).ravel())
        point = response.run.sensors[channel.sensor].point
        if (channel.run, point) not in paths:
            paths[channel.run, point] = path_of(arm, response.run, point)
        moved = response.moved[point][:3] @ weights + paths[channel.run, point]
        moved = make_interp_spline(response.time, moved.T, k=5)(response.time, nu=2)
        yield np.einsum("ti,it->t", moved, response.directions[channel.sensor])


def _swinging(
    problem: SourceProblem, place: Place, response: Response, channel: Channel, driving: np.ndarray, how: Any
) -> np.ndarray:
    """Return a sensor's signal (T,) from a light oscillator [rad/s, damping ratio] driven by its point."""
    filtered = lfilter(*_oscillator(*how, round(float(response.time[1] - response.time[0]), 12)), driving)
    swing = make_interp_spline(response.time, filtered, k=5)
    return np.asarray(swing(problem.clock_of(channel, place), nu=response.run.sensors[channel.sensor].derivative))


@lru_cache  # shared by all traces
def _oscillator(omega: float, damping: float, step: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the filter of a light oscillator under an acceleration that is linear within a step [s]."""
    above, below, _ = cont2discrete(([-1.0], [1.0, 2 * damping * omega, omega**2]), step, "foh")
    return np.ravel(above), below


class _Set(NamedTuple):
    """A set of causes.

    Attributes:
        how: frequency [Hz] and damping ratio of each, by kind; NaN where it has none.
        left: (C,) residual share of each trace's energy.
        unseen: (C,) residual share on held-out blocks.
    """

    how: Mapping[str, tuple[float, float]]
    left: np.ndarray
    unseen: np.ndarray


@dataclass(frozen=True)
class _Contest:
    """Competing sets of causes.

    Attributes:
        point: traces and sources at the linearisation point, and the band of each trace.
        values: (n,) all traces, each scaled by its noise, then zeros for the priors.
        columns: (n, m) slopes by the unknowns with priors, common to all sets.
        causes: (n, p) columns of each cause by kind, then by trial frequency [Hz] and damping ratio.
        trace: (n,) number of the trace; -1 for the priors.
        fold: (n,) cross-validation fold; -1 for the priors.
        kinds: cause of each source.
        noise: (C,) [SI] rms residual of each trace after all causes.
        energy: (C,) of each trace, as a displacement.
    """

    point: Point
    values: np.ndarray
    columns: np.ndarray
    causes: Mapping[str, Mapping[tuple[float, float], np.ndarray]]
    trace: np.ndarray
    fold: np.ndarray
    kinds: tuple[str, ...]
    noise: np.ndarray
    energy: np.ndarray

    @classmethod
    def of(cls, point: Point, moving: np.ndarray, loose: np.ndarray, kinds: Sequence[str]) -> "_Contest":
        """Return the contest, with the finger and the line that explain most in addition to all sources.

        Args:
            point: see above.
            moving: indices of the unknowns that may move within their priors.
            loose: (m, m) whitening matrix of these.
            kinds: cause of each source.
        """
        place, peak, whole = point.place, point.whitenings[0].frequency, point.whitened()
        first = sum(part.size for part in place[:-1])
        pairs = zip(whole.residual, whole.columns, strict=True)
        beyond = [residual + columns[:, first:] @ place.parts.ravel() for residual, columns in pairs]  # the motion
        sizes = [len(values) for values in beyond]
        # real and imaginary part of a sample are in the same fold
        turns = [np.tile(np.arange(size // 2) * BLOCKS // (size // 2) % FOLDS, 2) for size in sizes]
        more = np.full(len(loose), -1)
        trace, fold = np.append(np.repeat(np.arange(len(sizes)), sizes), more), np.concatenate([*turns, more])
        swinging = cache(partial(_fingers, point, list(_driving(point))))
        noise = np.array([np.std(values) for values in beyond])
        for again in (True, False):  # weight each trace first by its size, then by its residual after all causes
            weight = np.append(np.repeat(1 / noise, sizes), np.zeros(len(loose)))[:, None]

            def scaled(parts: Sequence[np.ndarray], weight: np.ndarray = weight) -> np.ndarray:
                every = np.concatenate([part.reshape((len(part), -1)) for part in parts])
                return weight * np.concatenate([every, np.zeros((len(loose), every.shape[1]))])

            values, sources = scaled(beyond)[:, 0], scaled([each[:, first:] for each in whole.columns])
            columns = scaled([each[:, moving] for each in whole.columns])
            columns[len(columns) - len(loose) :] = loose
            fingers, lines = dict[tuple[float, float], np.ndarray](), dict[tuple[float, float], np.ndarray]()
            for others in (columns, np.column_stack([columns, sources])):  # sources may resemble a line for a while
                beside, _ = np.linalg.qr(others / _sizes(others))
                rest = values - beside @ (beside.T @ values)

                def gained(how: Any, beside: Any = beside, rest: Any = rest, scaled: Any = scaled) -> Any:
                    block = scaled(swinging(*how))
                    block = block - beside @ (beside.T @ block)
                    own, _ = np.linalg.qr(block / _sizes(block))
                    return np.sum((own.T @ rest) ** 2)

                finger = (peak, DAMPING[1])
                for width, count in SCANNED:
                    ratios = DAMPING[1:2] if width == WIDTH else DAMPING
                    tried = finger[0] * np.linspace(1 - width, 1 + width, count)
                    finger = max(((f, ratio) for f in tried.tolist() for ratio in ratios), key=gained)
                fingers[finger] = scaled(swinging(*finger))
                line = _strongest_line(point, np.split(rest[: sum(sizes)], np.cumsum(sizes)[:-1]))
                lines[line, 0.0] = scaled(_lines(point, line))
            every = np.column_stack([columns, sources, *fingers.values(), *lines.values()])
            left = values - every @ _solved(every, values)
            rms = [(np.std(left[trace == k]), np.std(values[trace == k])) for k in range(len(sizes))]
            if again:
                noise = noise * np.array([np.hypot(own, PEAK.misfit * size) for own, size in rms])
        of_source = np.repeat(np.tile(kinds, place.parts.shape[0]), 2)
        causes = {kind: {(np.nan, np.nan): sources[:, of_source == kind]} for kind in CAUSES[:3] if kind in kinds}
        causes |= {"finger": fingers, "line": lines}
        scale = noise * np.array([own for own, _ in rms])
        orders = [2 * sensor.derivative for sensor in point.problem.measuring]
        energy = [np.sum(own**2) / (2 * np.pi * peak) ** order for own, order in zip(beyond, orders, strict=True)]
        return cls(point, values, columns, causes, trace, fold, tuple(kinds), scale, np.array(energy))

    @cached_property
    def sets(self) -> dict[frozenset[str], "_Set"]:
        """Residuals of each set of causes, with the best-fitting frequencies."""
        found = {}
        for names in (s for count in range(len(self.causes) + 1) for s in combinations(self.causes, count)):
            chosen = [dict(zip(names, how, strict=True)) for how in product(*(self.causes[kind] for kind in names))]
            left = [self._left(self._matrix(each)) for each in chosen]
            best = max(range(len(chosen)), key=lambda k: self._score(left[k]))
            unseen = self._left(self._matrix(chosen[best]), range(FOLDS))
            found[frozenset(names)] = _Set(chosen[best], left[best], unseen)
        return found

    def _matrix(self, chosen: Mapping[str, tuple[float, float]]) -> np.ndarray:
        return np.column_stack([self.columns, *(self.causes[kind][how] for kind, how in chosen.items())])

    def _left(self, matrix: np.ndarray, folds: Sequence[int] = ()) -> np.ndarray:
        """Return the residual energy share of each trace, in sample or on held-out blocks."""
        rest = self.values.copy()
        for fold in folds or (None,):
            used = self.fold != fold
            found = _solved(matrix[used], self.values[used])
            out = ~used if fold is not None else used
            rest[out] = self.values[out] - matrix[out] @ found
        data = self.trace >= 0
        left, energy = (np.bincount(self.trace[data], x[data] ** 2) for x in (rest, self.values))
        return np.asarray(left / np.maximum(energy, 1e-300))

    def _score(self, left: np.ndarray) -> float:
        return score(left, np.bincount(self.trace[self.trace >= 0]), PEAK)

    def evidence(self, chosen: frozenset[str]) -> float:
        """Return the evidence of a set [nat]; a line counts one more parameter for its frequency, a finger two."""
        sizes = [self.causes[kind][how].shape[1] for kind, how in self.sets[chosen].how.items()]
        columns = sum(sizes) + 2 * ("finger" in chosen) + ("line" in chosen)
        return self._score(self.sets[chosen].left) - columns / 2 * float(np.log(np.sum(self.trace >= 0)))

    def shares(self, chosen: frozenset[str]) -> dict[str, float]:
        """Return each cause's share of the energy in a set, part' y / y'y; the shares add up to the set's.

        The energy explained by a cause alone would mislead: at one frequency, imbalance and transmission error can
        replace each other for a while.
        """
        found, data = self._coefficients(chosen), self.trace >= 0
        energy = np.bincount(self.trace[data], self.values[data] ** 2)

        def share(kind: str) -> float:
            made = self.causes[kind][self.sets[chosen].how[kind]] @ found[kind]
            part = np.bincount(self.trace[data], (made * self.values)[data]) / np.maximum(energy, 1e-300)
            return float(self.energy @ part / self.energy.sum())

        return {kind: share(kind) for kind in found}

    def judged(self, peak: float, untested: Mapping[str, str], further: Mapping[float, Run]) -> Causes:
        """Return the ranked causes with their probabilities, and the discriminating run."""
        every = {chosen: self.shares(chosen) for chosen in self.sets if chosen}
        largest = {chosen: max(own, key=lambda kind: own[kind]) for chosen, own in every.items()}
        scores = {chosen: (self.evidence(chosen), self._score(self.sets[chosen].unseen)) for chosen in largest}
        causes, sets = list[Cause](), dict[str, frozenset[str]]()
        for kind in self.causes:
            own, others = ([s for s in scores if (largest[s] == kind) is mine] for mine in (True, False))
            if not own:
                continue
            best = sets[kind] = max(own, key=lambda chosen: scores[chosen])
            odds = [probability(*([scores[s][k] for s in part] for part in (own, others))) for k in (0, 1)]
            shares = [self.energy @ part / self.energy.sum() for part in (self.sets[best].left, self.sets[best].unseen)]
            shown = [float(1 - share) for share in shares]
            source, frequency = self._strongest(kind, best), self.sets[best].how[kind][0]
            causes.append(Cause(kind, source, frequency, every[best][kind], *shown, *odds))
        causes.sort(key=lambda cause: (-cause.evidence, -cause.held_out, -cause.predicted))
        band = (peak * (1 - WIDTH), peak * (1 + WIDTH))
        result = Causes(peak, band, tuple(causes), untested, 1 - max(cause.explained for cause in causes), 0.0)
        if result.told or len(causes) < 2:
            return result
        first, second = causes[0], max(causes[1:], key=lambda cause: max(cause.evidence, cause.held_out))
        gains = {speed: self._apart(sets[first.kind], sets[second.kind], run, peak) for speed, run in further.items()}
        speed = max(gains, key=lambda speed: gains[speed], default=0.0)
        return replace(result, speed=speed if gains and gains[speed] > NEEDED else 0.0)

    def _strongest(self, kind: str, chosen: frozenset[str]) -> ExcitingOrder | None:
        """Return the source with most of the band's energy, for a cause with several sources."""
        if kind not in CAUSES[:3]:
            return None
        parts = self._parts(chosen)
        own = [k for k, each in enumerate(self.kinds) if each == kind]
        (columns,) = self.causes[kind].values()
        columns = columns.reshape((len(self.values), -1, len(own), 2))
        made = np.einsum("ngsi,gsi->sn", columns, parts[:, own])
        return self.point.problem.sources[own[int(np.argmax((made**2).sum(1)))]]

    def _coefficients(self, chosen: frozenset[str]) -> dict[str, np.ndarray]:
        """Return the coefficients of the columns of each cause of a set."""
        how = self.sets[chosen].how
        found = _solved(self._matrix(how), self.values)[self.columns.shape[1] :]
        ends = np.cumsum([self.causes[kind][each].shape[1] for kind, each in how.items()])
        return dict(zip(how, np.split(found, ends[:-1]), strict=True))

    def _parts(self, chosen: frozenset[str]) -> Float[np.ndarray, "G S 2"]:
        """Return the parts of all sources in a set."""
        found, parts = self._coefficients(chosen), np.zeros(self.point.place.parts.shape)
        for kind in set(chosen) & set(CAUSES[:3]):
            own = [k for k, each in enumerate(self.kinds) if each == kind]
            parts[:, own] = found[kind].reshape((len(parts), -1, 2))
        return parts

    def _apart(self, true: frozenset[str], rival: frozenset[str], run: Run, peak: float) -> float:
        """Return the expected score of a true set over a competing set in a further run.

        The run has the sensors of the first run with their noise. The competing set keeps its sources from the measured
        runs; a fixed line may take a new phase.
        """
        channels = self.point.problem.channels
        own = [k for k, channel in enumerate(channels) if channel.run == 0]
        rate = min(channels[k].rate for k in own)
        alone = further_run(self.point.problem, run, [channels[k].sensor for k in own], rate)
        if len(alone.channels[0].time) / rate < 2 * LENGTH / (WIDTH * peak):
            return 0.0
        seen = [self._seen(alone, chosen, Band(peak, WIDTH * peak, rate)) for chosen in (true, rival)]
        gained = 0.0
        for k, number in enumerate(own):
            (here, line), (other, free) = seen[0][k], seen[1][k]
            whole = here + line.sum(1) if line.size else here
            off = whole - other
            if free.size:
                off = off - free @ _solved(free, off)
            noise = self.noise[number] ** 2 * len(off) + PEAK.misfit**2 * float(whole @ whole)
            gained += len(off) / 2 * float(np.log1p(float(off @ off) / noise))
        return gained

    def _seen(self, alone: SourceProblem, chosen: frozenset[str], band: Band) -> list[tuple[np.ndarray, np.ndarray]]:
        """Return for each channel of a run the prediction of a set (n,), and a line's columns (n, 2) if it has one."""
        parts, found, how = self._parts(chosen)[:1], self._coefficients(chosen), self.sets[chosen].how
        place = alone.start._replace(changes=self.point.place.changes, parts=parts)
        at = Point(alone, place, alone.responses(place), [band] * len(alone.channels))
        fingers = _fingers(at, list(_driving(at)), *how["finger"]) if "finger" in chosen else []
        lines, result = _lines(at, how["line"][0]) if "line" in chosen else [], []
        for k in range(len(alone.channels)):
            _, columns, _ = alone.seen(k, at.responses[0], place)
            made = band(columns @ parts[0].ravel())
            if fingers:
                made = made + fingers[k] @ found["finger"][: fingers[k].shape[1]]
            line = np.zeros((len(made), 0))
            if lines:
                size = found["line"].reshape((-1, 2))[k]
                line = lines[k][:, 2 * k : 2 * k + 2] * np.hypot(*size) / np.sqrt(2)
            result.append((made, line))
        return result


def _sizes(columns: np.ndarray) -> np.ndarray:
    """Return the columns' lengths; 1 for a zero column."""
    size = np.linalg.norm(columns, axis=0)
    return np.where(size > 0, size, 1.0)


def _solved(columns: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Return the least-squares coefficients, by normal equations of unit columns."""
    size = _sizes(columns)
    scaled = columns / size
    normal = scaled.T @ scaled + RIDGE * np.eye(len(size))
    return np.asarray(np.linalg.solve(normal, scaled.T @ values) / size)


def _strongest_line(at: Point, rest: Sequence[np.ndarray]) -> float:
    """Return the frequency [Hz] of the line with most energy in the residuals of all traces."""
    longest = max(len(channel.time) / channel.rate for channel in at.problem.channels)
    middle, half, _ = at.whitenings[0]
    tried = np.linspace(-half, half, int(2 * half * longest * FINE) + 2)
    power = np.zeros(len(tried))
    for own, band in zip(rest, at.whitenings, strict=True):
        real, imaginary = np.split(own, 2)
        time = np.arange(len(real)) * band.step / band.rate
        power += np.abs(np.exp(-2j * np.pi * np.outer(tried, time)) @ (real + 1j * imaginary)) ** 2 / len(real)
    return float(middle + tried[power.argmax()])


def _lines(at: Point, frequency: float) -> list[np.ndarray]:
    """Return cosine and sine of a fixed frequency for each trace (n_k, 2 C), with separate columns per trace."""
    found = []
    for k, (channel, band) in enumerate(zip(at.problem.channels, at.whitenings, strict=True)):
        turned = 2 * np.pi * frequency * (channel.time - channel.time[0])
        own = band(np.column_stack([np.cos(turned), np.sin(turned)]))
        found.append(np.zeros((len(own), 2 * len(at.problem.channels))))
        found[-1][:, 2 * k : 2 * k + 2] = own
    return found


def _fingers(at: Point, driving: Sequence[np.ndarray], frequency: float, damping: float) -> list[np.ndarray]:
    """Return the columns of a finger in each trace (n_k, K), one per point and direction of the sensors."""
    ways = [(each.point, each.direction, each.body) for each in at.problem.measuring]
    alike, found, how = list(dict.fromkeys(ways)), [], (2 * np.pi * frequency, damping)
    for channel, way, force, band in zip(at.problem.channels, ways, driving, at.whitenings, strict=True):
        own = band(_swinging(at.problem, at.place, at.responses[channel.run], channel, force, how))
        found.append(np.zeros((len(own), len(alike))))
        found[-1][:, alike.index(way)] = own
    return found
