"""Traces of a moving arm, possible sources of its excitation and priors, as a problem that is linear in the sources.

A sensor's trace is linear in the two components of each source. It is nonlinear in stiffnesses, damping, the clock and
the direction of the sensor, which have priors. See `source_identification` for the search.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.fft import dct
from scipy.linalg import block_diag, solve_toeplitz
from scipy.signal import lfilter

from ident.arm.arm import Arm, stiffness_paths
from ident.arm.fields import ALPHA, DAMPING, LOSS
from ident.arm.multibody import ExcitingOrder
from ident.errors import refusal
from ident.vibrate.binomial import HALF_WIDTH
from ident.vibrate.unit_response import Response, Run, Sensor, changed_responses, masses_of, unit_response

SLOW = 0.5
"""Frequency [Hz] below which a trace is not used: drift, the motion itself; assumed."""
STEP = 1e-4
"""Relative step of finite differences by stiffness and damping: 2 % error at a resonance with quality factor 200."""
DAMPING_SD = 0.7
"""Standard deviation of ln(damping), of bending and torsion each: a factor of two; assumed."""
CLOCK_SD = 1e-4
"""Standard deviation of a clock's relative rate; assumed, ten times that of a quartz."""
TILT_SD = np.deg2rad(2.0)
"""Standard deviation of a sensor's direction [rad] each way; assumed."""
LAGS = 20
"""Order of the autoregressive model: 0.1 s at 200 samples a second, half a period of the lowest modes."""
TIED = 1e-6
"""Least independent share of a variance, even where draws tie numbers together; otherwise no precision exists."""
STIFFNESS_SD = 0.1
"""Standard deviation of ln(stiffness) where no posterior is given; assumed."""
LARGEST = 1000.0
"""Standard deviation [units] of a source's parts a priori: a metre, or a thousand arc seconds."""


@dataclass(frozen=True)
class Channel:
    """A trace of one sensor.

    Attributes:
        name: file and channel, for messages.
        run: number of its run.
        sensor: number of the sensor in that run.
        time: (T,) [s] on the recorder's clock, on which the motion starts near 0.
        values: (T,) [SI] displacement, velocity or acceleration.
    """

    name: str
    run: int
    sensor: int
    time: Float[np.ndarray, "T"]
    values: Float[np.ndarray, "T"]

    @property
    def rate(self) -> float:
        """Samples a second."""
        return (len(self.time) - 1) / float(self.time[-1] - self.time[0])


@dataclass(frozen=True)
class Prior:
    """Prior of the arm's numbers before the runs, as changes from its values: ln(factor).

    Attributes:
        groups: paths with a common change, by the name of the unknown.
        mean: (P,) changes.
        covariance: (P, P) of them.
    """

    groups: Mapping[str, tuple[str, ...]]
    mean: Float[np.ndarray, "P"]
    covariance: Float[np.ndarray, "P P"]

    @classmethod
    def of(cls, arm: Arm, draws: Mapping[str, Float[np.ndarray, "D"]]) -> "Prior":
        """Return the normal distribution of the draws' changes, with the assumed one of all other numbers.

        Args:
            arm: reference for the changes.
            draws: of numbers of the arm, by path; stiffness and damping are used. A stiffness without draws has the
                standard deviation `STIFFNESS_SD`.

        Raises:
            InputError: too few draws for a covariance.
        """
        stiffnesses = stiffness_paths(arm)
        damping = [path for path in arm.paths() if path.endswith((*DAMPING, *LOSS, ALPHA))]
        known = {path: np.asarray(values) for path, values in draws.items() if path in (*stiffnesses, *damping)}
        known = {path: values for path, values in known.items() if np.ptp(values) > 0 and np.min(values) > 0}
        if known and len(next(iter(known.values()))) < len(known) + 2:
            got = f"{len(next(iter(known.values())))} draws of {len(known)} numbers"
            raise refusal("posterior", got, f"at least {len(known) + 2}", "give more draws")
        paths = [*known, *(path for path in stiffnesses if path not in known)]
        groups: dict[str, tuple[str, ...]] = {path: (path,) for path in paths}
        for kind in (*DAMPING, *LOSS, ALPHA):
            damped = tuple(path for path in damping if path.endswith(kind) and float(arm.get(path)) > 0)
            if damped and not set(damped) & set(paths):
                groups[kind] = damped
        sds = np.repeat([STIFFNESS_SD, DAMPING_SD], [len(paths), len(groups) - len(paths)])
        mean, covariance, own = np.zeros(len(groups)), np.diag(sds**2), slice(len(known))
        if known:
            changes = np.stack([np.log(values / float(arm.get(path))) for path, values in known.items()])
            mean[own], covariance[own, own] = changes.mean(1), np.atleast_2d(np.cov(changes))
            covariance[own, own] += TIED * np.diag(np.diag(covariance[own, own]))
        return cls(groups, mean, covariance)

    def numbers(self, arm: Arm, changes: Float[np.ndarray, "P"]) -> dict[str, float]:
        """Return the arm's numbers after changes, by path."""
        own = arm.numbers()
        factors = zip(self.groups.values(), np.exp(changes).tolist(), strict=True)
        return {path: float(own[path]) * factor for paths, factor in factors for path in paths}


class Place(NamedTuple):
    """A point of the search.

    Attributes:
        changes: (P,) of the arm's numbers, see `Prior`.
        clock: (R, 2) offset [s] and relative rate of each run's clock.
        tilt: (C, 2) [rad] of each channel's direction, about two axes across it.
        calibration: (W,) relative error of each sensor's; none where they count as exact.
        factors: (F, 2) on each trial mass, real and imaginary part; 1 if model and table are right.
        parts: (G, S, 2) of the sources in each phase group, in units.
    """

    changes: np.ndarray
    clock: np.ndarray
    tilt: np.ndarray
    calibration: np.ndarray
    factors: np.ndarray
    parts: np.ndarray

    @property
    def flat(self) -> np.ndarray:
        """All unknowns in their order."""
        return np.concatenate([part.ravel() for part in self])

    def moved(self, step: np.ndarray) -> "Place":
        """Return the point after a step of all unknowns, in their order."""
        sizes = np.cumsum([part.size for part in self])[:-1]
        return Place(*(own + part.reshape(own.shape) for own, part in zip(self, np.split(step, sizes), strict=True)))


class Trial(NamedTuple):
    """A trial mass on a drive during a run.

    Attributes:
        run: number of the run.
        source: number of the drive's imbalance among the sources.
        parts: (2,) of the added imbalance in phase with cosine and sine, in units.
    """

    run: int
    source: int
    parts: tuple[float, float]


class Whitening(NamedTuple):
    """Detrending and whitening of a channel, to noise of unit variance.

    Attributes:
        slow: (T, K) orthonormal slow columns.
        filter: (L + 1,) coefficients; the first L results are dropped.
    """

    slow: np.ndarray
    filter: np.ndarray

    def __call__(self, columns: np.ndarray) -> np.ndarray:
        """Return columns (T, ...) after both."""
        return self.filtered(self.rest(columns))

    def rest(self, columns: np.ndarray) -> np.ndarray:
        """Return columns (T, ...) without the slow part."""
        return np.asarray(columns - self.slow @ (self.slow.T @ columns))

    def filtered(self, rest: np.ndarray) -> np.ndarray:
        """Return such columns, made white."""
        return np.asarray(lfilter(self.filter, [1.0], rest, axis=0)[len(self.filter) - 1 :])


def slow_columns(channel: Channel) -> np.ndarray:
    """Return cosines over the trace slower than `SLOW`, a constant and a line, orthonormal.

    Cosines at the middles of even intervals are orthogonal (discrete cosine transform), so no decomposition is needed.
    """
    size = len(channel.time)
    count = int(2 * SLOW * (channel.time[-1] - channel.time[0]))
    share = (np.arange(size) + 0.5) / size - 0.5
    waves = np.sqrt(2 / size) * np.cos(np.pi * np.outer(share + 0.5, np.arange(1, count + 1)))
    line = share - waves @ (waves.T @ share)
    return np.column_stack([np.full(size, size**-0.5), line / np.linalg.norm(line), waves])


def lag_sums(columns: np.ndarray, lags: int) -> Float[np.ndarray, "L"]:
    """Return the lag products of columns (T, K), or of one (T,), summed, by lag in samples."""
    flat, width = columns.ravel(), columns[0].size
    return np.array([flat[: flat.size - k * width] @ flat[k * width :] for k in range(lags + 1)])


def taken_out(
    left: Float[np.ndarray, "T"],
    slow: Float[np.ndarray, "T K"],
    columns: Float[np.ndarray, "T n"],
    covariance: Float[np.ndarray, "n n"],
    lags: int,
) -> Float[np.ndarray, "L"]:
    """Return the lag sums that detrending and fitting have removed from the noise.

    The noise of the slow part has the spectral density of the next band, three times as wide. A fit of columns C with
    covariance V reduces the noise covariance S to S - C V C' on average. A noise model without both corrections is too
    small near the slow part, where arms vibrate: intervals from three runs of 30 s with 20 lags were 3 % too short.
    """
    beside = dct(left, norm="ortho")[slow.shape[1] :][: 3 * slow.shape[1]]
    fitted = columns @ np.linalg.cholesky(covariance)
    return float(np.mean(beside**2)) * lag_sums(slow, lags) + lag_sums(fitted, lags)


def whitening_filter(residual: np.ndarray, lags: int, missing: Float[np.ndarray, "L"] | float = 0.0) -> np.ndarray:
    """Return the filter that whitens a residual, by the Yule-Walker equations.

    Args:
        residual: (T,) of a channel.
        lags: order of the filter.
        missing: added to its lag sums, see `taken_out`.
    """
    covariance = (lag_sums(residual, lags) + missing) / len(residual)
    covariance[0] *= 1 + 1e-9  # a pure tone has a singular matrix
    if not lags:
        return np.array([1.0]) / np.sqrt(covariance[0])
    ahead = solve_toeplitz(covariance[:-1], covariance[1:])
    return np.append(1.0, -ahead) / np.sqrt(covariance[0] - ahead @ covariance[1:])


@dataclass(frozen=True)
class SourceProblem:
    """Traces of some runs, possible sources of excitation, and priors.

    Attributes:
        arm: the arm.
        runs: the motions, with their sensors.
        groups: number of each run's phase group, within which the pulleys keep their phases.
        channels: the traces.
        sources: possible sources of excitation.
        prior: of the arm's numbers.
        offset: [s] largest error of a clock.
        trials: trial masses, at most one for each source in a run.
        calibration: standard deviation of the relative error of each sensor's calibration, the same in all runs.
    """

    arm: Arm
    runs: tuple[Run, ...]
    groups: tuple[int, ...]
    channels: tuple[Channel, ...]
    sources: tuple[ExcitingOrder, ...]
    prior: Prior
    offset: float
    trials: tuple[Trial, ...] = ()
    calibration: float = 0.0

    @cached_property
    def masses(self) -> dict[str, float]:
        """Eccentric masses [kg] that belong to the eccentricities, by drive."""
        return masses_of(self.arm, self.sources)

    @cached_property
    def measuring(self) -> tuple[Sensor, ...]:
        """Sensor of each channel."""
        return tuple(self.runs[each.run].sensors[each.sensor] for each in self.channels)

    @cached_property
    def sensors(self) -> tuple[int, ...]:
        """Number of each channel's sensor: equal for the same point, direction and quantity."""
        order = list(dict.fromkeys(self.measuring))
        return tuple(order.index(sensor) for sensor in self.measuring)

    @property
    def start(self) -> Place:
        """Where the search begins."""
        shape = (max(self.groups) + 1, len(self.sources), 2)
        clock, tilt = np.zeros((len(self.runs), 2)), np.zeros((len(self.channels), 2))
        right = np.tile([1.0, 0.0], (len(self.trials), 1))
        calibration = np.zeros(max(self.sensors) + 1 if self.calibration else 0)
        return Place(np.zeros(len(self.prior.mean)), clock, tilt, calibration, right, np.zeros(shape))

    @cached_property
    def mixing(self) -> tuple[np.ndarray, ...]:
        """Matrix (2 S, n) of each run: its sources' parts by the n linear unknowns, `factors` and then `parts`.

        Parts a + i b are a complex number, and so is a trial mass's t: it adds f t where its factor is f.
        """
        count, trials = 2 * len(self.sources), len(self.trials)
        every = []
        for run, group in enumerate(self.groups):
            own = np.zeros((count, 2 * trials + count * (max(self.groups) + 1)))
            own[:, 2 * trials + group * count :][:, :count] = np.eye(count)
            for k, trial in enumerate(self.trials):
                a, b = trial.parts
                if trial.run == run:
                    own[2 * trial.source :, 2 * k :][:2, :2] = [[a, -b], [b, a]]
            every.append(own)
        return tuple(every)

    def parts_of(self, run: int, place: Place) -> Float[np.ndarray, "S 2"]:
        """Return the parts of all sources during a run, trial masses included, in units."""
        linear = np.concatenate([place.factors.ravel(), place.parts.ravel()])
        return np.asarray((self.mixing[run] @ linear).reshape((-1, 2)))

    @cached_property
    def priors(self) -> tuple[np.ndarray, np.ndarray]:
        """Prior precision (n, n) and mean (n,) of all unknowns; very wide for the sources."""
        _, _, *sizes = (part.size for part in self.start)
        clock = np.tile([self.offset / HALF_WIDTH, CLOCK_SD], len(self.runs))
        rest = np.append(clock, np.repeat([TILT_SD, self.calibration, LARGEST, LARGEST], sizes))
        precision = block_diag(np.linalg.inv(self.prior.covariance), np.diag(1 / rest**2))
        return precision, np.append(self.prior.mean, np.zeros(len(rest)))

    def arm_at(self, place: Place) -> Arm:
        """Return the arm with its numbers changed."""
        return self.arm.replace(self.prior.numbers(self.arm, place.changes))

    def responses(self, place: Place) -> list[Response]:
        """Return the sensors' responses to unit sources, run by run."""
        arm = self.arm_at(place)
        return [unit_response(arm, run, self.sources) for run in self.runs]

    def slopes(self, place: Place) -> list[Response]:
        """Return the sensors' responses to the current sources, run by run, also with each number changed slightly."""
        steps = STEP * np.vstack([np.zeros(len(place.changes)), np.eye(len(place.changes))])
        numbers = [self.prior.numbers(self.arm, place.changes + step) for step in steps]
        arm = self.arm_at(place)
        pairs = [(run, self.parts_of(k, place)) for k, run in enumerate(self.runs)]
        return [changed_responses(arm, run, self.sources, parts, numbers) for run, parts in pairs]

    def clock_of(self, channel: Channel, place: Place) -> np.ndarray:
        """Return a channel's times on the clock of the motion."""
        offset, rate = place.clock[channel.run]
        return np.asarray(channel.time * (1 + rate) + offset)

    def factor(self, number: int, place: Place) -> float:
        """Return the calibration factor of a channel."""
        return 1 + float(place.calibration[self.sensors[number]]) if self.calibration else 1.0

    def across(self, direction: np.ndarray) -> np.ndarray:
        """Return two directions (T, 2, 3) normal to a sensor's, for its tilts."""
        least = np.eye(3)[np.argmin(np.abs(direction).max(0))]
        first = np.cross(direction, least)
        first /= np.linalg.norm(first, axis=1, keepdims=True)
        return np.stack([first, np.cross(direction, first)], 1)

    def seen(self, number: int, response: Response, place: Place) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return a channel's response to the motion (T,), to unit sources (T, 2 S), and tilts (T, 2, 1 + 2 S)."""
        channel = self.channels[number]
        values, direction = response.at(channel.sensor, self.clock_of(channel, place))
        across = self.across(direction)
        tilted = direction + np.einsum("k,ski->si", place.tilt[number], across)
        columns = self.factor(number, place) * np.einsum("sik,si->sk", values, tilted)
        return columns[:, 0], columns[:, 1:], np.einsum("sik,sji->sjk", values, across)
