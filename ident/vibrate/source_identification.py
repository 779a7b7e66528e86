"""Identify the excitation of a moving arm from vibration traces: imbalance and transmission error of each drive.

A sensor's trace is linear in the two components of each source. It is nonlinear in stiffnesses, damping, the clock and
the direction of the sensor, which have priors. Gauss-Newton steps estimate all of them jointly, and solve for the
linear ones at each step (variable projection, Golub and Pereyra 1973). Content below `SLOW` (drift and the slow motion)
is removed. Errors are modelled as stationary and coloured: an autoregressive model of each channel's residual whitens
residual and slopes (generalised least squares). So model errors reduce the weight only in their own band. The search of
`ident.inference` does not fit here: it has no unknowns solved for at each step, and no weights that change between
steps.

The fit works in time, not by orders: sources with a common order, or with crossing orders, need no extra separation,
runs through resonances are not averaged over blocks, and white noise is used efficiently. Whether a source explains the
vibration wherever it should is tested along the motion and widens its interval, see `consistency`.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.linalg import cho_factor, cho_solve
from scipy.optimize import minimize_scalar
from scipy.stats import chi2

from ident.arm.multibody import ExcitingOrder
from ident.vibrate.binomial import HALF_WIDTH
from ident.vibrate.source_problem import (
    CLOCK_SD,
    LAGS,
    LARGEST,
    STEP,
    TILT_SD,
    Channel,
    Place,
    SourceProblem,
    Whitening,
    slow_columns,
    taken_out,
    whitening_filter,
)
from ident.vibrate.unit_response import Response, Run, excited_by

APART, THINNED = 5e-3, 4
"""Step [s] of the trial clock offsets before the search, a tenth of a period at 20 Hz; and the downsampling used there.
"""
MOST_ROUNDS = 12
"""Most Gauss-Newton rounds; three or four suffice."""
RECOLOURED = 5
"""Rounds with an update of the noise model: later it stays fixed, so that the search ends."""
NOISE_PASSES = 5
"""Most passes between noise model and step in a round; two or three suffice."""
SETTLED = 0.5
"""Step of each unknown, in standard deviations, that ends the search; assumed. A step of 0.26 was followed by 0.004."""
ALIKE = 0.02
"""Change of the step, in standard deviations, below which two noise models count as the same."""
RIDGE = 1e-13
"""Added to the unit diagonal of normal equations: their rounding."""
BLOCK = 1.0
"""Length [s] of the blocks that test a source: some periods of the excitation."""
CHANCE_OF_SPREAD = 0.05
"""Probability above which a spread between blocks counts as chance."""
FAINT = 0.02
"""Share of a source's information below which a block is not informative."""
WIDE = 0.5
"""Half a 95 % interval, relative to the amplitude, beyond which a source is not determined."""
UNSEEN = 100.0
"""Standard deviation [units] of a source's parts beyond which it is not observed at all, as with a drive at standstill:
the arm then keeps its number."""


@dataclass(frozen=True)
class Whitened:
    """Residual and slopes of all channels at a point of the search, whitened.

    Attributes:
        residual: (C,) of each channel, (T,) measured minus computed.
        columns: (C,) of each channel, (T, n) slopes by the unknowns.
    """

    residual: tuple[np.ndarray, ...]
    columns: tuple[np.ndarray, ...]

    @classmethod
    def of(cls, wholes: Iterable[np.ndarray]) -> "Whitened":
        """Split each channel's array (T, 1 + n) into residual (first column) and slopes."""
        return cls(*zip(*((whole[:, 0], whole[:, 1:]) for whole in wholes), strict=True))


@dataclass(frozen=True)
class Identification:
    """Identified excitation of an arm.

    Attributes:
        problem: traces, possible sources and priors.
        place: result of the search.
        covariance: (n, n) of all unknowns, before `consistency`.
        residual: of each channel (T,) [SI] measured minus computed, without the slow part.
        shown: of each channel (T,) [SI] measured, without the slow part.
        consistency: (S,) variance between blocks of the motion for each source, over that expected from noise; at
            least 1.
        settled: whether the search has converged.
        rounds: number of rounds.
        between: p-value of the differences between runs, by source; NaN with one run.
        makes: (S,) [m] largest vibration from a unit of each source at a sensor's point in any direction.
    """

    problem: SourceProblem
    place: Place
    covariance: np.ndarray
    residual: tuple[np.ndarray, ...]
    shown: tuple[np.ndarray, ...]
    consistency: np.ndarray
    settled: bool
    rounds: int
    between: np.ndarray
    makes: np.ndarray

    def covariance_of(self, k: int) -> Float[np.ndarray, "G 2 G 2"]:
        """Return the covariance of a source's two parts [units] in all phase groups, widened by `consistency`."""
        groups, count = self.place.parts.shape[:2]
        first = sum(part.size for part in self.place[:-1])
        at = (first + 2 * (count * np.arange(groups)[:, None] + k) + np.arange(2)).ravel()
        return self.consistency[k] * self.covariance[np.ix_(at, at)].reshape((groups, 2, groups, 2))

    @cached_property
    def estimates(self) -> "tuple[Estimate, ...]":
        """Estimate of each source."""
        found = []
        for k, source in enumerate(self.problem.sources):
            parts = self.place.parts[:, k]
            sizes, ways = np.hypot(*parts.T), _ways(parts)
            turned = np.stack([-ways[:, 1], ways[:, 0]], 1)
            across = np.einsum("gi,gigj,gj->g", turned, self.covariance_of(k), turned)
            weights, sd, _ = self._pooled[k]
            phases = np.arctan2(parts[:, 1], parts[:, 0])
            phase_sd = across**0.5 / np.maximum(sizes, 1e-300)
            size = float(weights @ sizes)
            found.append(Estimate(source, size, sd, tuple(phases.tolist()), tuple(phase_sd.tolist())))
        return tuple(found)

    @cached_property
    def _pooled(self) -> list[tuple[np.ndarray, float, float]]:
        """For each source: weights of the phase groups in its amplitude, its sd, and the p-value of differences."""
        (groups, count), found = self.place.parts.shape[:2], []
        for k in range(count):
            parts, ways = self.place.parts[:, k], _ways(self.place.parts[:, k])
            precision = np.linalg.inv(np.einsum("gi,gihj,hj->gh", ways, self.covariance_of(k), ways))
            weights, sizes = precision.sum(1) / precision.sum(), np.hypot(*parts.T)
            off = sizes - weights @ sizes
            chance = float(chi2.sf(off @ precision @ off, groups - 1)) if groups > 1 else np.nan
            found.append((weights, float(precision.sum() ** -0.5), chance))
        return found

    @property
    def agreement(self) -> Float[np.ndarray, "S"]:
        """P-value of the differences between runs and phase groups, by source; NaN without a comparison."""
        return np.fmin(self.between, [chance for *_, chance in self._pooled])

    @property
    def gain(self) -> Float[np.ndarray, "C"]:
        """See `gain`, of each channel."""
        return np.array([gain(y, y - r) for y, r in zip(self.shown, self.residual, strict=True)])

    @property
    def explained(self) -> Float[np.ndarray, "C"]:
        """See `explained`, of each channel."""
        return np.array([explained(y, y - r) for y, r in zip(self.shown, self.residual, strict=True)])

    @property
    def moved(self) -> dict[str, float]:
        """Shift of each unknown with a prior (numbers, clocks, sensors), in prior standard deviations."""
        problem, place = self.problem, self.place
        sd = np.sqrt(np.diag(problem.prior.covariance))
        shifts = dict(zip(problem.prior.groups, ((place.changes - problem.prior.mean) / sd).tolist(), strict=True))
        for run, (_, rate) in zip(problem.runs, place.clock.tolist(), strict=True):
            shifts[f"clock of {run.name}"] = rate / CLOCK_SD
        for k, (channel, tilt) in enumerate(zip(problem.channels, np.abs(place.tilt).max(1).tolist(), strict=True)):
            shifts[f"direction of {channel.name}"] = tilt / TILT_SD
            if problem.calibration:
                shifts[f"calibration of {channel.name}"] = (problem.factor(k, place) - 1) / problem.calibration
        return shifts

    def numbers(self, group: int = 0, place: Place | None = None) -> dict[str, float]:
        """Return the arm's numbers as identified, or at another point, by path [SI]: sources, stiffness, damping.

        Amplitudes are those of all phase groups, phases those of one.
        """
        place = self.place if place is None else place
        found, weights = self.problem.prior.numbers(self.problem.arm, place.changes), [own for own, *_ in self._pooled]
        pooled = np.einsum("kg,gk->k", weights, np.linalg.norm(place.parts, axis=2))
        seen = [k for k, each in enumerate(self.estimates) if each.sd < UNSEEN]
        sources, parts = [self.problem.sources[k] for k in seen], pooled[seen, None] * _ways(place.parts[group])[seen]
        weighed = [source.drive for source in sources if not source.of_error]
        masses = {f"{drive}.eccentric_mass": self.problem.masses[drive] for drive in weighed}
        return found | masses | excited_by(sources, parts)

    def draws(self, count: int, seed: int = 0, group: int = 0) -> dict[str, Float[np.ndarray, "D"]]:
        """Return draws of the same numbers, by path [SI], from the normal distribution around the point."""
        drawn = [self.numbers(group, place) for place in self.places(count, seed)]
        found = {path: np.array([each[path] for each in drawn]) for path in drawn[0]}
        middle = self.numbers(group)
        seen = (each for each in self.problem.sources if each.phase in found)
        for source in seen:  # so that half of the phases lie on either side, in spite of the wrap
            turned = found[source.phase] - middle[source.phase]
            found[source.phase] = middle[source.phase] + np.angle(np.exp(1j * turned))
        return found

    def factors(self, count: int, seed: int = 0) -> Float[np.ndarray, "D F 2"]:
        """Return the trial masses' factors with the same draws."""
        return np.stack([place.factors for place in self.places(count, seed)])

    def places(self, count: int, seed: int = 0) -> "list[Place]":
        """Return draws of all unknowns; the sources' own part of the scatter is widened by `consistency`."""
        rng, groups = np.random.default_rng(seed), self.place.parts.shape[0]
        wide, sd = np.ones(len(self.covariance)), np.sqrt(self.consistency)
        of_linear = np.append(sd[np.array([trial.source for trial in self.problem.trials], int)], np.tile(sd, groups))
        wide[-2 * len(of_linear) :] = np.repeat(of_linear, 2)
        factor = wide[:, None] * np.linalg.cholesky(self.covariance)
        return [self.place.moved(factor @ rng.standard_normal(len(factor))) for _ in range(count)]


def gain(measured: Float[np.ndarray, "T"], computed: Float[np.ndarray, "T"]) -> float:
    """Return the regression factor of measured on computed vibration: 1 for a correct model, whatever the noise."""
    return float(measured @ computed / max(computed @ computed, 1e-300))


def explained(measured: Float[np.ndarray, "T"], computed: Float[np.ndarray, "T"]) -> float:
    """Return the share of a measured vibration's mean square that the computed one explains."""
    left = measured - computed
    return 1 - float(left @ left) / float(measured @ measured)


def _ways(parts: Float[np.ndarray, "*k 2"]) -> Float[np.ndarray, "*k 2"]:
    """Return the directions of parts, as unit vectors."""
    return parts / np.maximum(np.linalg.norm(parts, axis=-1, keepdims=True), 1e-300)


@dataclass(frozen=True)
class Estimate:
    """Estimate of a source.

    Attributes:
        source: the source.
        amplitude: in its units, mm or arc seconds.
        sd: standard deviation of the amplitude.
        phase: (G,) [rad] in each phase group.
        phase_sd: (G,) [rad] standard deviation of the phase.
    """

    source: ExcitingOrder
    amplitude: float
    sd: float
    phase: tuple[float, ...]
    phase_sd: tuple[float, ...]

    @property
    def interval(self) -> tuple[float, float]:
        """95 % interval of the amplitude."""
        return max(0.0, self.amplitude - HALF_WIDTH * self.sd), self.amplitude + HALF_WIDTH * self.sd

    @property
    def told(self) -> bool:
        """Whether the runs determine it: half its 95 % interval is less than half of the amplitude."""
        return bool(self.amplitude > least_told(self.sd))


def least_told(sd: Float[np.ndarray, "*S"] | float) -> Float[np.ndarray, "*S"] | float:
    """Return the least determined amplitude at a standard deviation: half its 95 % interval is `WIDE` of it."""
    return sd * HALF_WIDTH / WIDE


class Point(NamedTuple):
    """A point of the search.

    Attributes:
        problem: traces, possible sources and priors.
        place: all unknowns.
        responses: the sensors' responses to unit sources there, run by run.
        whitenings: of each channel: removes the slow part and whitens the noise, or another linear operation.
    """

    problem: SourceProblem
    place: Place
    responses: Sequence[Response]
    whitenings: Sequence[Any]

    def sums(self, number: int) -> tuple[np.ndarray, np.ndarray, float]:
        """Return A'A, A'y and y'y, with a channel's unit sources A and its measurement minus the motion itself y."""
        channel = self.problem.channels[number]
        sure, columns, _ = self.problem.seen(number, self.responses[channel.run], self.place)
        both = self.whitenings[number](np.column_stack([channel.values - sure, columns]))
        y, A = both[:, 0], both[:, 1:]
        return A.T @ A, A.T @ y, float(y @ y)

    def fitted(self) -> tuple["Point", float]:
        """Return the point with the best-fitting sources, all else fixed, and its cost, priors included."""
        problem, place, count = self.problem, self.place, self.place.factors.size + self.place.parts.size
        normal, right, total = np.zeros((count, count)), np.zeros(count), 0.0
        for k, channel in enumerate(problem.channels):
            own_normal, own_right, own_total = self.sums(k)
            own = problem.mixing[channel.run]
            normal += own.T @ own_normal @ own
            right += own.T @ own_right
            total += own_total
        found = _solved(normal + np.eye(count) / LARGEST**2, right)
        precision, mean = problem.priors
        off = place._replace(factors=0 * place.factors, parts=0 * place.parts).flat - mean
        factors, parts = np.split(found, [place.factors.size])
        place = place._replace(factors=factors.reshape((-1, 2)), parts=parts.reshape(place.parts.shape))
        return self._replace(place=place), float(total - right @ found + off @ precision @ off)

    def plain(self) -> list[tuple[np.ndarray, np.ndarray]]:
        """Return the residual and the measurement of each channel, without the slow part."""
        found = []
        for k, channel in enumerate(self.problem.channels):
            sure, columns, _ = self.problem.seen(k, self.responses[channel.run], self.place)
            computed = sure + columns @ self.problem.parts_of(channel.run, self.place).ravel()
            rest = self.whitenings[k].rest
            found.append((rest(channel.values - computed), rest(channel.values)))
        return found

    def sized(self) -> "Point":
        """Return the point with whitenings that divide its residuals by their size."""
        pairs = zip(self.whitenings, self.plain(), strict=True)
        return self._replace(whitenings=[old._replace(filter=whitening_filter(r, 0)) for old, (r, _) in pairs])

    def whitened(self) -> Whitened:
        """Return residuals and slopes by all unknowns."""
        return Whitened.of(whitening(whole) for whitening, whole in zip(self.whitenings, self.sloped(), strict=True))

    def sloped(self) -> list[np.ndarray]:
        """Return (T, 1 + n) for each channel: the residual, and slopes by all unknowns."""
        problem, place, slopes = self.problem, self.place, self.problem.slopes(self.place)
        sizes = [part.size for part in place]
        clock_at, tilt_at, sensor_at, linear_at = np.cumsum(sizes)[:4]
        found = []
        for k, channel in enumerate(problem.channels):
            response, parts = self.responses[channel.run], problem.parts_of(channel.run, place).ravel()
            time = problem.clock_of(channel, place)
            sure, units, tilted = problem.seen(k, response, place)
            slope = np.zeros((len(time), sum(sizes)))
            members = slopes[channel.run].along(channel.sensor, time)
            slope[:, : sizes[0]] = (members[:, 1:] - members[:, :1]) / STEP
            rate = response.rate(channel.sensor, time) @ np.append(1.0, parts)
            slope[:, clock_at + 2 * channel.run] = rate
            slope[:, clock_at + 2 * channel.run + 1] = rate * channel.time
            slope[:, tilt_at + 2 * k : tilt_at + 2 * k + 2] = tilted @ np.append(1.0, parts)
            slope[:, :sensor_at] *= problem.factor(k, place)
            if place.calibration.size:
                slope[:, sensor_at + problem.sensors[k]] = (sure + units @ parts) / problem.factor(k, place)
            slope[:, linear_at:] = units @ problem.mixing[channel.run]
            found.append(np.column_stack([channel.values - sure - units @ parts, slope]))
        return found

    def stepped(self, rests: Sequence[np.ndarray]) -> tuple[Whitened, np.ndarray, np.ndarray]:
        """Return whitened parts, precision and Gauss-Newton step.

        Args:
            rests: residuals and slopes without the slow part.
        """
        parts = Whitened.of(whitening.filtered(rest) for whitening, rest in zip(self.whitenings, rests, strict=True))
        precision, mean = (part.copy() for part in self.problem.priors)
        right = precision @ (mean - self.place.flat)
        for residual, columns in zip(parts.residual, parts.columns, strict=True):
            precision += columns.T @ columns
            right += columns.T @ residual
        return parts, precision, _solved(precision, right)

    def recoloured(
        self, rests: Sequence[np.ndarray], precision: np.ndarray, step: np.ndarray
    ) -> tuple["Point", Whitened, np.ndarray, np.ndarray]:
        """Return the point with whitenings for the residuals expected after a step, and the results of `stepped`.

        Whitening and step depend on each other. The slopes predict the residuals after a step, so that both are
        iterated without a simulation.
        """
        found = list(self.whitenings)
        for _ in range(NOISE_PASSES):
            covariance = np.linalg.inv(precision)
            for k, (old, rest) in enumerate(zip(found, rests, strict=True)):
                left, columns = rest[:, 0] - rest[:, 1:] @ step, rest[:, 1:]
                missing = taken_out(left, old.slow, columns, covariance, LAGS)
                found[k] = old._replace(filter=whitening_filter(left, LAGS, missing))
            point = self._replace(whitenings=found)
            before, (parts, precision, step) = step, point.stepped(rests)
            if _small(step - before, precision, ALIKE):
                break
        return point, parts, precision, step

    def descended(self, step: np.ndarray, before: float) -> "Point":
        """Return the point after a step, with the best sources; shorten the step, down to a tenth, until it helps."""
        for share in (1.0, 0.5, 0.25, 0.1):
            tried = self.place.moved(share * step)
            point, left = self._replace(place=tried, responses=self.problem.responses(tried)).fitted()
            if left <= before * (1 + 1e-9):
                break
        return point


def identified(problem: SourceProblem, progress: Any = iter) -> Identification:
    """Identify the excitation of an arm.

    Args:
        problem: traces, possible sources and priors.
        progress: shows progress of the search, round by round.

    Raises:
        InputError: see `simulate`.
        ModelError: the arm collapses.
    """
    place = problem.start._replace(changes=problem.prior.mean.copy())
    responses, whitenings = problem.responses(place), [Whitening(slow_columns(c), np.ones(1)) for c in problem.channels]
    place = place._replace(clock=clock_offsets(problem, responses, place)[0])
    # start without sources, each channel scaled by its own size
    point = Point(problem, place, responses, whitenings).sized().fitted()[0].sized()
    settled, rounds, coloured = False, 0, False
    for rounds in progress(range(1, MOST_ROUNDS + 1)):
        here, pairs = point.place, zip(point.whitenings, point.sloped(), strict=True)
        rests = [whitening.rest(whole) for whitening, whole in pairs]
        parts, precision, step = point.stepped(rests)
        small = _small(step, precision, SETTLED)
        settled = small and coloured
        if rounds < RECOLOURED and (small or rounds > 1):  # wrong stiffnesses dominate the first residuals
            point, parts, precision, step = point.recoloured(rests, precision, step)
            coloured = True
        point, before = point.fitted()
        point = point.descended(step, before)
        if settled:
            break
    place, taken = point.place, point.place.flat - here.flat
    left = tuple(r - own @ taken for r, own in zip(parts.residual, parts.columns, strict=True))
    parts, covariance = Whitened(left, parts.columns), np.linalg.inv(precision)
    residual, shown = zip(*point.plain(), strict=True)
    consistency, between = _consistency(problem, parts), _between(problem, parts)
    every = [moved[:3] for each in point.responses for moved in each.moved.values()]
    makes = np.max([np.hypot(moved[:, :, 1::2], moved[:, :, 2::2]).max((0, 1)) for moved in every], 0)
    return Identification(problem, place, covariance, residual, shown, consistency, settled, rounds, between, makes)


def clock_offsets(
    problem: SourceProblem, responses: Sequence[Response], place: Place, known: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Return clocks with the offsets of least residual (R, 2), and the residual share of each run's energy (R,).

    Trials are run by run, with separate sources for each run, or with known ones (2 S,).
    """
    thin = [replace(each, time=each.time[::THINNED], values=each.values[::THINNED]) for each in problem.channels]
    problem, clock, shares = replace(problem, channels=tuple(thin)), place.clock.copy(), np.ones(len(problem.runs))
    point = Point(problem, place, responses, [Whitening(slow_columns(channel), np.ones(1)) for channel in thin])
    for number in range(len(problem.runs)):
        own = [k for k, channel in enumerate(thin) if channel.run == number]

        def left(offset: float, number: int = number, own: Sequence[int] = tuple(own)) -> float:
            tried = place._replace(clock=place.clock.copy())
            tried.clock[number, 0] = offset
            sums = [point._replace(place=tried).sums(k) for k in own]
            normal = np.sum([each[0] / each[2] for each in sums], 0)
            right = np.sum([each[1] / each[2] for each in sums], 0)
            parts = _solved(normal, right) if known is None else known
            return float(len(own) - 2 * right @ parts + parts @ normal @ parts)

        count = 2 * int(np.ceil(problem.offset / APART)) + 1
        best = float(min(np.linspace(-problem.offset, problem.offset, count), key=left))
        refined = minimize_scalar(left, bounds=(best - APART, best + APART), method="bounded", options={"maxiter": 12})
        clock[number, 0] = np.clip(refined.x, -problem.offset, problem.offset)
        shares[number] = left(clock[number, 0]) / len(own)
    return clock, shares


def _solved(normal: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Solve normal equations, scaled to a unit diagonal."""
    scale = np.sqrt(np.maximum(np.diag(normal), 1e-300))
    factor = cho_factor(normal / np.outer(scale, scale) + RIDGE * np.eye(len(scale)))
    return np.asarray(cho_solve(factor, right / scale) / scale)


def _small(step: np.ndarray, precision: np.ndarray, share: float) -> bool:
    """Whether a step is shorter than a share of the standard deviation of each unknown."""
    return bool((np.abs(step) < share * np.sqrt(np.diag(np.linalg.inv(precision)))).all())


def _blocks(problem: SourceProblem, parts: Whitened, k: int) -> list[tuple[int, np.ndarray, np.ndarray]]:
    """Return for each block of each channel its run, and information (2, 2) and score (2,) of a source's parts."""
    first, count, found = sum(part.size for part in problem.start[:-1]), 2 * len(problem.sources), []
    for channel, residual, columns in zip(problem.channels, parts.residual, parts.columns, strict=True):
        at = first + problem.groups[channel.run] * count + 2 * k
        own, size = columns[:, at : at + 2], max(4, round(BLOCK * channel.rate))
        for start in range(0, len(residual) - size + 1, size):
            here = slice(start, start + size)
            found.append((channel.run, own[here].T @ own[here], own[here].T @ residual[here]))
    return found


def _consistency(problem: SourceProblem, parts: Whitened) -> Float[np.ndarray, "S"]:
    """Return the variance between blocks of the motion for each source, over that expected from noise.

    For each block that is informative about a source, score' information^-1 score is chi-squared with two degrees of
    freedom if the model is right. Returns their mean over 2, or 1 where chance reaches it in one of twenty cases.
    """
    found = np.ones(len(problem.sources))
    for k in range(len(problem.sources)):
        blocks = _blocks(problem, parts, k)
        whole = sum(np.trace(information) for _, information, _ in blocks)
        telling = [
            float(score @ np.linalg.solve(information, score))
            for _, information, score in blocks
            if np.trace(information) > FAINT * whole and np.linalg.cond(information) < 1e6
        ]
        if chi2.sf(sum(telling), 2 * len(telling)) < CHANCE_OF_SPREAD:
            found[k] = float(np.mean(telling)) / 2
    return found


def _between(problem: SourceProblem, parts: Whitened) -> Float[np.ndarray, "S"]:
    """Return the p-value of the differences between the runs' own estimates of each source; NaN with one run."""
    found = np.full(len(problem.sources), np.nan)
    for k in range(len(problem.sources)):
        tried = sum(trial.source == k for trial in problem.trials)  # a trial run's own factor takes up its difference
        freedom = 2 * (len(problem.runs) - max(problem.groups) - 1 - tried)
        if not freedom:
            continue
        information, score = np.zeros((len(problem.runs), 2, 2)), np.zeros((len(problem.runs), 2))
        for run, own, its in _blocks(problem, parts, k):
            information[run] += own
            score[run] += its
        statistic = sum(float(s @ np.linalg.solve(i, s)) for i, s in zip(information, score, strict=True))
        found[k] = chi2.sf(statistic, freedom)
    return found


def with_further(found: Identification, run: Run, rate: float) -> Float[np.ndarray, "S"]:
    """Return the expected standard deviation [units] of each source's amplitude with a further run.

    The run is in the first phase group, with the sensors of the first run and their noise.

    Args:
        found: identification without the run.
        run: the run.
        rate: [Hz] sampling rate.
    """
    problem, place = found.problem, found.place
    own = [k for k, channel in enumerate(problem.channels) if channel.run == 0]
    alone = further_run(problem, run, [problem.channels[k].sensor for k in own], rate)
    here = alone.start._replace(changes=place.changes, parts=place.parts[:1])
    columns = noisy_columns(alone, here, [float(np.std(found.residual[k])) for k in own])
    told, known = shared_information(alone, columns), shared_unknowns(place)
    count = place.changes.size
    covariance = np.linalg.inv(np.linalg.inv(found.covariance[np.ix_(known, known)]) + told)[count:, count:]
    return np.sqrt(found.consistency) * amplitude_sd(covariance, place.parts[0])


def amplitude_sd(covariance: Float[np.ndarray, "P P"], parts: Float[np.ndarray, "S 2"]) -> Float[np.ndarray, "S"]:
    """Return standard deviations of amplitudes from the covariance of the parts of one phase group, P = 2 S.

    Taken along the parts; a zero amplitude has no direction, and gets the root mean square of both.
    """
    blocks = [covariance[2 * k : 2 * k + 2, 2 * k : 2 * k + 2] for k in range(len(parts))]
    squares = [p @ b @ p / (p @ p) if p.any() else np.trace(b) / 2 for p, b in zip(parts, blocks, strict=True)]
    return np.sqrt(np.array(squares))


def further_run(problem: SourceProblem, run: Run, sensors: Sequence[int], rate: float) -> SourceProblem:
    """Return the problem of a planned run with some of its sensors, with the same arm and sources."""
    time = np.arange(float(run.motion.breaks[0]) + 0.1, float(run.motion.breaks[-1]) - 0.1, 1 / rate)
    channels = tuple(Channel("", 0, sensor, time, np.zeros(len(time))) for sensor in sensors)
    return replace(problem, runs=(run,), groups=(0,), channels=channels, trials=())


def noisy_columns(problem: SourceProblem, place: Place, noise: Sequence[float]) -> tuple[np.ndarray, ...]:
    """Return columns (T, n) of each channel by all unknowns, over white noise of these standard deviations [SI]."""
    pairs = zip(problem.channels, noise, strict=True)
    whitenings = [Whitening(slow_columns(each), np.array([1 / sd])) for each, sd in pairs]
    return Point(problem, place, problem.responses(place), whitenings).whitened().columns


def shared_unknowns(place: Place) -> np.ndarray:
    """Return indices of unknowns shared with a further run of the first phase group: arm's numbers, sources' parts."""
    first = sum(part.size for part in place[:-1])
    return np.r_[0 : place.changes.size, first : first + place.parts[0].size]


def shared_information(alone: SourceProblem, columns: Sequence[np.ndarray]) -> Float[np.ndarray, "K K"]:
    """Return the information of a run about the shared unknowns; its clock and sensor errors are its own.

    Args:
        alone: the run.
        columns: of its channels, or of some of them.
    """
    sizes, precision = [part.size for part in alone.start], sum(each.T @ each for each in columns)
    shared = np.r_[0 : sizes[0], sum(sizes[:4]) : sum(sizes)]
    rest = np.arange(sizes[0], sum(sizes[:4]))
    across = precision[np.ix_(rest, shared)]
    own = precision[np.ix_(rest, rest)] + np.diag(np.diag(alone.priors[0])[rest])
    return np.asarray(precision[np.ix_(shared, shared)] - across.T @ np.linalg.solve(own, across))
