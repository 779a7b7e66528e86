"""The speed along a stroke, chosen: least time that keeps a limit of vibration, or least vibration in a given time.

The path stays: alpha alone goes faster or slower. Between places on it alpha accelerates evenly; moving averages over
one period of each of the two lowest modes at the arrival round that off (`shaping.averaged`) and leave these modes
nearly at rest there, but for their damping. What is chosen is the speed at the places, so that a controller with a
speed for each segment can follow.

The search is a sequence of linear programs: the largest vibration over the phases that are not known, within each bin
of the path, is a smooth function of the speeds, and its logarithm is nearly linear in theirs, even near a resonance.

References:
    Fletcher, Sainz de la Maza, "Nonlinear programming and nonsmooth optimization by successive linear programming",
    Math. Programming 43, 1989 (the trust region).
"""

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.optimize import linprog

from ident.arm.chain import at_posture
from ident.arm.modes import natural_frequencies
from ident.arm.multibody import orders_of
from ident.arm.parts import Stroke
from ident.errors import ModelError, refusal
from ident.programs import AnyArray
from ident.vibrate.evaluator import Evaluator
from ident.vibrate.exact import Progress
from ident.vibrate.motion import Motion
from ident.vibrate.shaping import averaged
from ident.vibrate.simulate import Superposition, superposition

BINS, LATER = 40, 8
"""Bins of the path, and of the time after arrival, in each of which the largest vibration counts on its own."""
SMALL = 1e-7
"""Vibration [m] below which a bin does not matter to the search."""
DIFFERENCE = 0.02
"""Change of ln(speed) over which slopes are taken: a resonance is passed within several times as much."""
REGION, LEAST_REGION, LARGEST_REGION = 0.2, 0.01, 0.5
"""Largest change of ln(speed) in a step of the search: at first, when it ends, and ever."""
GAIN = 0.02
"""Decrease of ln(vibration) that a step must promise, or else the search ends."""
TRIES = 3
"""Linear programs of a step: one, and its corrections by what the vibration turned out to be."""
ITERATIONS = 20
"""Steps of the search at most; assumed."""
BELOW = (0.75, 0.8, 0.85, 0.9, 0.95)
"""Shares of the speed at which a pulley meets the first mode, at which the search may start; assumed."""
ROUNDS = 6
"""Times that are tried for a limit, at most; assumed."""
CLOSE = 0.03
"""Share of a limit by which the vibration may stay below it."""
STEEP = -10.0
"""Slope of ln(least vibration) over ln(time) before it is known: on the paper's arm it is -6 to -12."""
FARTHEST = 0.15
"""Largest change of ln(time) from one round to the next; assumed."""
EXACT, SCALINGS = 1e-9, 100
"""Share of a time by which a schedule may miss it, and how often its speeds are scaled for that at most."""


class MotionLimits(NamedTuple):
    """What alpha may do: speed [rad/s], acceleration [rad/s^2] and jerk [rad/s^3]."""

    speed: float
    acceleration: float
    jerk: float


@dataclass(frozen=True)
class Schedule:
    """Speeds along a stroke.

    Attributes:
        stroke: the path.
        places: (K + 1,) [rad] alpha, from the start to the end.
        speeds: (K + 1,) [rad/s] there, 0 at both ends.
        windows: [s] of the moving averages.
    """

    stroke: Stroke
    places: Float[np.ndarray, "places"]
    speeds: Float[np.ndarray, "places"]
    windows: tuple[float, float]

    @property
    def times(self) -> Float[np.ndarray, "segments"]:
        """Duration of each segment before it is rounded off [s]."""
        return np.asarray(2 * np.abs(np.diff(self.places)) / (self.speeds[1:] + self.speeds[:-1]))

    @property
    def accelerations(self) -> Float[np.ndarray, "segments"]:
        """Acceleration in each segment, which rounding off makes nowhere larger [rad/s^2]."""
        return np.asarray(np.diff(self.speeds**2) / (2 * np.abs(np.diff(self.places))))

    @property
    def duration(self) -> float:
        """Time from start to arrival [s]."""
        return float(self.times.sum()) + sum(self.windows)

    @property
    def motion(self) -> Motion:
        """The motion of all driven joints."""
        way = np.sign(self.places[-1] - self.places[0])
        alpha = np.stack([way * self.accelerations / 2, way * self.speeds[:-1], self.places[:-1]])
        breaks = np.append(0.0, np.cumsum(self.times))
        evenly = Motion("speed along the path", breaks, alpha[..., None] * np.asarray(self.stroke.direction, float))
        return averaged(averaged(evenly, self.windows[0]), self.windows[1])


@dataclass(frozen=True)
class Scheduling:
    """A search for the speeds along a stroke.

    Attributes:
        evaluator: the arm with the highest transmission errors, its loads, phases that are not known, samples a second.
        stroke: the path.
        limits: of alpha.
        segments: number K of segments.
        dwell: [s] that the arm is held after arrival; its vibration then counts, too.
        retract: whether the stroke is from unfolded to folded.
    """

    evaluator: Evaluator
    stroke: Stroke
    limits: MotionLimits
    segments: int
    dwell: float
    retract: bool = False

    @cached_property
    def places(self) -> Float[np.ndarray, "places"]:
        """Alpha at the ends of the segments, which are shorter towards the ends of the stroke [rad]."""
        start, end = (float(self.stroke.unfolded), float(self.stroke.folded))[:: 1 if self.retract else -1]
        return np.asarray(start + (end - start) * (1 - np.cos(np.linspace(0, np.pi, self.segments + 1))) / 2)

    @cached_property
    def windows(self) -> tuple[float, float]:
        """The periods of the two lowest modes at the arrival [s]."""
        first, second = self.frequencies(self.places[-1:])[:, 0]
        return float(1 / first), float(1 / second)

    @property
    def acceleration(self) -> float:
        """Largest acceleration of a segment [rad/s^2]; averaged over a window w its jerk is at most twice that / w."""
        return min(self.limits.acceleration, self.limits.jerk * max(self.windows) / 2)

    def frequencies(self, alpha: Float[np.ndarray, "K"]) -> Float[np.ndarray, "2 K"]:
        """Return the two lowest natural frequencies along the path [Hz]."""
        posture = alpha * np.asarray(self.stroke.direction, float)[:, None]
        return np.asarray(natural_frequencies(at_posture(self.evaluator.arm, posture, self.evaluator.loads), 2))

    def alpha(self, angles: AnyArray) -> Float[np.ndarray, "T"]:
        """Return alpha [rad] of joint angles (driven, T) along the stroke; likewise its rates of theirs."""
        direction = np.asarray(self.stroke.direction, float)
        return np.asarray(direction @ np.asarray(angles) / (direction @ direction))

    def orders(self) -> Float[np.ndarray, "orders"]:
        """Return the frequencies that excite the arm, over the speed of alpha: cycles a radian."""
        arm = self.evaluator.arm
        share = dict(zip([joint.name for joint in arm.driven], np.asarray(self.stroke.direction), strict=True))
        turns = [(abs(float(d.ratio) * share[d.joint]) / (2 * np.pi), orders_of(arm, d.name)) for d in arm.drives]
        return np.unique([turn * order for turn, orders in turns for order in orders if turn])

    def vibration(self, motion: Motion) -> Superposition:
        """Return the vibration over a motion, and while the arm is held after it."""
        each = self.evaluator
        return superposition(each.arm, motion.dwell(self.dwell), each.unknown, loads=each.loads, rate=each.rate)

    def schedule(self, speeds: Float[np.ndarray, "inner"]) -> Schedule:
        """Return the schedule of speeds within the stroke, none of them higher than the limits allow [rad/s]."""
        reach = 2 * self.acceleration * np.abs(np.diff(self.places))
        squares = np.pad(np.minimum(speeds, self.limits.speed) ** 2, 1)
        for k in range(1, len(squares)):
            squares[k] = min(squares[k], squares[k - 1] + reach[k - 1])
            squares[-k - 1] = min(squares[-k - 1], squares[-k] + reach[-k])
        return Schedule(self.stroke, self.places, np.sqrt(squares), self.windows)

    def by_bins(self, schedule: Schedule) -> Float[np.ndarray, "bins"]:
        """Return ln of the largest vibration [m] over the unknown phases in each bin and direction."""
        motion, rate = schedule.motion, self.evaluator.rate
        envelope = self.vibration(motion).envelope
        time = np.arange(envelope.shape[1]) / rate
        share = (self.alpha(motion(time)[0]) - self.places[0]) / (self.places[-1] - self.places[0])
        later = LATER * (time - motion.arrival) / max(self.dwell, 1 / rate)
        bins = np.where(later >= 0, BINS + np.clip(later, 0, LATER - 1), np.clip(BINS * share, 0, BINS - 1))
        largest = np.full((3, BINS + LATER), SMALL)
        for way in range(3):
            np.maximum.at(largest[way], bins.astype(int), envelope[way])
        return np.log(largest.ravel())

    def least_time(self, limit: float, progress: Progress = iter, near: Schedule | None = None) -> Schedule:
        """Return the schedule of least time that keeps a limit [m] with all phases that are not known.

        The least vibration falls with the time: a few times are tried, each from the schedule found for the last. Where
        none keeps the limit it is the quietest that was found.

        Args:
            limit: [m]
            progress: shows how far it is, over these times.
            near: a schedule to start from; the best of a few when None.
        """
        starts = {float(self.by_bins(each).max()): each for each in ([near] if near else self._starts())}
        aim = float(np.log(limit))
        found = starts[min(starts, key=lambda x: (x > aim, x if x > aim else starts[x].duration))]
        best, quietest = None, (np.inf, found)
        rounds: list[tuple[float, float]] = []
        for _ in progress(range(ROUNDS)):
            found = self._search(found, found.duration, region=REGION / (1 + bool(rounds)))
            excess = float(self.by_bins(found).max()) - aim
            quietest = min(quietest, (excess, found), key=lambda pair: pair[0])
            if excess <= 0 and (best is None or found.duration < best.duration):
                best = found
            if -CLOSE <= excess <= 0:
                break
            rounds.append((np.log(found.duration), excess))
            time = found.duration * np.exp(self._later(rounds))
            found = self.in_time(found, time)
            if found.duration > time * (1 + EXACT) and best is not None:
                break  # no faster motion is allowed
        return best or quietest[1]

    def least_vibration(self, time: float, progress: Progress = iter) -> Schedule:
        """Return the schedule of least vibration that takes a time [s].

        Raises:
            InputError: a time in which the stroke can't be made.
        """
        fastest = self.schedule(np.full(self.segments - 1, np.inf))
        if fastest.duration > time:
            expected = f"at least {fastest.duration:.4g} s, as the limits of speed, acceleration and jerk allow"
            raise refusal("time", f"{time:g} s", expected, "give more time, or a higher `speed`")
        starts = [self.in_time(each, time) for each in self._starts()]
        return self._search(min(starts, key=lambda each: float(self.by_bins(each).max())), time, progress)

    def in_time(self, schedule: Schedule, time: float) -> Schedule:
        """Scale speeds until a time [s] is just kept; where they meet the limits, the others make up for it."""
        time = max(time, self.schedule(np.full(self.segments - 1, np.inf)).duration)
        for _ in range(SCALINGS):
            late = (schedule.duration - sum(self.windows)) / (time - sum(self.windows)) - 1
            if abs(late) < EXACT:
                break
            schedule = self.schedule(schedule.speeds[1:-1] * (1 + late))
        return schedule

    def _later(self, rounds: list[tuple[float, float]]) -> float:
        """Return by how much ln(time) should grow for the limit: by the slope of the last two rounds (secant)."""
        time, excess = rounds[-1]
        slope = STEEP
        if len(rounds) > 1 and (before := rounds[-2])[0] != time:
            slope = float(np.clip((excess - before[1]) / (time - before[0]), 3 * STEEP, STEEP / 3))
        return float(np.clip(-(excess + CLOSE / 2) / slope, -FARTHEST, FARTHEST))

    def _starts(self) -> list[Schedule]:
        """Return where the search may start: as fast as allowed, or an order of the pulleys below the first mode."""
        first = self.frequencies(self.places[1:-1])[0]
        speeds = [np.full(len(first), np.inf), *(below * first / order for order in self.orders() for below in BELOW)]
        return list({each.speeds.tobytes(): each for each in map(self.schedule, speeds)}.values())

    def _search(self, schedule: Schedule, time: float, progress: Progress = iter, region: float = REGION) -> Schedule:
        """Return the schedule of least vibration of all that take a time [s], from one near it.

        By linear programs within a region that grows and shrinks with their success.
        """
        count, now = self.segments - 1, self.by_bins(schedule)
        slopes, exact = None, False
        for _ in progress(range(ITERATIONS)):
            u = np.log(schedule.speeds[1:-1])
            if slopes is None:
                beside = [self.in_time(self.schedule(np.exp(u - DIFFERENCE * each)), time) for each in np.eye(count)]
                slopes, exact = np.stack([(now - self.by_bins(each)) / DIFFERENCE for each in beside], 1), True
            highest = np.clip(np.log(self.limits.speed) - u, 0.0, region)
            bounds = [*((-region, high) for high in highest), (None, None)]
            rows = np.hstack([slopes, -np.ones((len(now), 1))])
            line, most = now, 0.0
            for _ in range(TRIES):
                answer = linprog(np.append(np.zeros(count), 1.0), A_ub=rows, b_ub=-line, bounds=bounds)
                if answer.status:
                    raise ModelError(f"no schedule found: {answer.message}")
                step = answer.x[:count]
                tried = self.in_time(self.schedule(np.exp(u + step)), time)
                then = self.by_bins(tried)
                promised, gained = float(now.max() - (line + slopes @ step).max()), float(now.max() - then.max())
                most = max(most, promised)
                if promised < GAIN or gained > 0.25 * promised:
                    break
                line = then - slopes @ step  # with the curvature that this step has met (second-order correction)
            good, done = gained > 0.25 * promised, most < GAIN or region < LEAST_REGION
            moved = np.log(tried.speeds[1:-1]) - u
            change = then - now
            if gained > 0:
                schedule, now = tried, then
            if done and exact:
                break
            if good and not done:  # Broyden's update saves a simulation for each speed
                slopes = slopes + np.outer(change - slopes @ moved, moved) / float(moved @ moved)
                region = min(1.5 * region, LARGEST_REGION) if gained > 0.7 * promised else region
            else:
                region = region / 2.5 if exact and not done else region
                slopes = slopes if exact and gained <= 0 else None
            exact = exact and gained <= 0
        return schedule
