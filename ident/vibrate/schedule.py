"""Optimal speed along a path: least time within a vibration limit, or least vibration in a given time.

The path itself stays: only the speed of its parameter alpha changes. Between places on the path alpha has constant
acceleration. Moving averages over one period of each of the two lowest modes at arrival smooth this
(`shaping.averaged`) and leave these modes nearly at rest there, except for the effect of damping. The unknowns are the
speeds at the places, so that a controller with a speed for each segment can follow.

The search is a sequence of linear programs: the largest vibration over the unknown phases, within each bin of the path,
is a smooth function of the speeds, and its logarithm is nearly linear in theirs, even near a resonance. The least time
comes from an exact penalty function: exceeding the limit costs more than any saved time.

References:
    Fletcher, Sainz de la Maza, "Nonlinear programming and nonsmooth optimization by successive linear programming",
    Math. Programming 43, 1989 (trust region and exact penalty).
"""

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.integrate import cumulative_trapezoid
from scipy.interpolate import BSpline, make_interp_spline
from scipy.optimize import linprog

from ident.arm.arm import Arm
from ident.arm.multibody import orders_of
from ident.arm.parts import Stroke
from ident.errors import ModelError, refusal
from ident.programs import AnyArray, Progress, in_batches
from ident.vibrate.evaluator import Evaluator
from ident.vibrate.fast import lowest_frequencies
from ident.vibrate.motion import Motion, lengths
from ident.vibrate.replay import DEGREE
from ident.vibrate.shaping import averaged
from ident.vibrate.simulate import Superposition, superposition

RATE, SHORT = 125.0, 1e-4
"""Pieces per second of a motion along a curved path, and their shortest length [s]."""
KNOTS, TRACED = 200, 20_000
"""Number of equal lengths of a given path, as knots of its spline, and of times that sample it."""
CORNER, STRAY = np.radians(20.0), 1e-3
"""Change of a path's direction [rad] in one of these lengths that counts as a corner, and largest deviation [rad] of
the spline from the path; assumed."""
FINE = 20
"""Places within a segment to check joint limits."""
BINS, LATER = 40, 8
"""Bins of the path, and of the time after arrival; the largest vibration of each bin is a constraint."""
BATCH = 16
"""Postures per batch of natural frequencies."""
SMALL = 1e-7
"""Vibration [m] below which the search ignores a bin."""
DIFFERENCE = 0.02
"""Finite difference of ln(speed) for slopes: a resonance is several times as wide."""
REGION, LEAST_REGION, LARGEST_REGION = 0.2, 0.01, 0.5
"""Largest change of ln(speed) in a step of the search: at first, when it ends, and ever."""
GAIN = 0.02
"""Least predicted decrease of ln(vibration) for a further step; of ln(time) `STEEP` times less."""
TRIES = 3
"""Linear programs of a step: one, and its corrections by the computed vibration."""
ITERATIONS = 20
"""Most steps of the search; assumed."""
BELOW = (0.75, 0.8, 0.85, 0.9, 0.95)
"""Starting speeds of the search, relative to the speed at which a pulley meets the first mode; assumed."""
CLOSE = 0.03
"""Relative margin by which the vibration may stay below its limit."""
STEEP = 10.0
"""Approximate slope of ln(least vibration) against ln(time): on the paper's arm 6 to 12."""
PENALTY = 1.0
"""Cost of ln(vibration) above the limit, in ln(time): several times 1 / `STEEP`, so that exceeding never pays."""
SLOWEST = 1.0
"""Largest decrease of ln(speed) below the start at any place, which ends a search for an impossible limit; assumed."""
EXACT, SCALINGS = 1e-9, 100
"""Relative tolerance on the time of a schedule, and most scalings of its speeds to reach it."""


class Allowed(NamedTuple):
    """Limits of alpha: speed [rad/s] at the inner places, acceleration [rad/s^2] in the segments."""

    speed: Float[np.ndarray, "inner"]
    acceleration: Float[np.ndarray, "segments"]


@dataclass(frozen=True)
class Path:
    """Path of a motion, independent of speed: joint angles over alpha, in even steps through joint space.

    Attributes:
        knots: (K,) [rad] of a B-spline over alpha.
        coefficients: (K - degree - 1, driven) [rad] of the joint angles.
        degree: of the spline: 1 for a stroke, which is a line.
        ends: alpha at start and end [rad].
        limits: (3, driven) [rad/s, rad/s^2, rad/s^3] of each joint's speed, acceleration and jerk.
    """

    knots: Float[np.ndarray, "K"]
    coefficients: Float[np.ndarray, "C driven"]
    degree: int
    ends: tuple[float, float]
    limits: Float[np.ndarray, "3 driven"]

    @classmethod
    def of_stroke(cls, arm: Arm, stroke: Stroke, percent: float, *, retract: bool = False) -> "Path":
        """Return the path of a stroke: joints keep its limits, at a percentage of its speed, and the arm file's."""
        folded, unfolded = float(stroke.folded), float(stroke.unfolded)
        direction, ends = np.asarray(stroke.direction, float), np.sort([folded, unfolded])
        own = np.array([float(stroke.speed) * percent / 100, float(stroke.acceleration), float(stroke.jerk)])
        with np.errstate(invalid="ignore"):
            shares = np.where(direction == 0, np.inf, np.abs(direction) * own[:, None])
        limits = np.minimum(shares, np.array([joint.rates for joint in arm.driven]).T)
        spline = make_interp_spline(ends, ends[:, None] * direction, k=1)
        return cls(spline.t, spline.c, 1, (unfolded, folded) if retract else (folded, unfolded), limits)

    @classmethod
    def of_motion(cls, arm: Arm, motion: Motion) -> "Path":
        """Return the path of a motion: alpha is its length in the space of the joint angles, from its start.

        Raises:
            InputError: joints without limits, a motion that goes nowhere, turns back or has a corner.
        """
        if free := [joint.name for joint in arm.driven if not np.isfinite(joint.rates).all()]:
            remedy = 'add them to each [[joint]], as speed = { value = 90, unit = "deg/s", origin = "datasheet" }'
            got, expected = f"no limits of {', '.join(free)}", "speed, acceleration and jerk of each joint, for a path"
            raise refusal(arm.name, got, expected, remedy)
        time = np.linspace(0.0, motion.arrival, TRACED)
        angles = np.asarray(motion(time)[0])
        way = lengths(angles)
        if not way[-1] > 0:
            raise refusal(motion.name, "a path that goes nowhere", "a motion", "give another path")
        even = np.linspace(0.0, way[-1], KNOTS + 1)
        moving = np.append(True, np.diff(way) > 0)
        at = [np.interp(even, way[moving], angle[moving]) for angle in angles]
        spline = make_interp_spline(even, np.stack(at, 1), k=DEGREE)
        bends = np.linalg.norm(spline(even, 2), axis=1) * even[1]
        strays = np.abs(spline(way) - angles.T).max(1)
        if bends.max() > CORNER or strays.max() > STRAY:  # there alpha would have to stop
            at = np.interp(even[bends.argmax()], way, time) if bends.max() > CORNER else time[strays.argmax()]
            got = f"a path that turns back or has a corner at {at:.4g} s"
            remedy = "split it there, round the corner, or smooth a noisy log (`smoothing`)"
            raise refusal(motion.name, got, "a smooth path", remedy)
        limits = np.array([joint.rates for joint in arm.driven]).T
        return cls(spline.t, spline.c, DEGREE, (0.0, float(way[-1])), limits)

    @cached_property
    def spline(self) -> BSpline:
        """Joint angles [rad] over alpha [rad]."""
        return BSpline(self.knots, self.coefficients, self.degree)

    def angles(self, alpha: Float[np.ndarray, "K"], order: int = 0) -> Float[np.ndarray, "driven K"]:
        """Return the joint angles [rad], or their derivatives of an order by alpha."""
        return np.asarray(self.spline(alpha, order)).T

    def alpha(self, angles: AnyArray) -> Float[np.ndarray, "T"]:
        """Return alpha [rad] for joint angles (driven, T) that follow the path from its start."""
        start, end = self.ends
        steepness = float(np.linalg.norm(self.angles(np.array([start]), 1)))
        return np.asarray(start + np.sign(end - start) * lengths(np.asarray(angles)) / steepness)

    def motion(self, alpha: Motion) -> Motion:
        """Return the motion of all driven joints by that of alpha alone.

        On a curved path, quintic pieces match the angles, speeds and accelerations at their ends (Hermite).
        """
        if self.degree == 1:
            direction = self.angles(np.array(self.ends[:1]), 1)[:, 0]
            return Motion(alpha.name, alpha.breaks, alpha.coefficients * direction, alpha.arrival)
        even = np.linspace(0.0, alpha.arrival, 2 + int(alpha.arrival * RATE))
        t = np.sort(np.concatenate([even, alpha.breaks]))
        t = t[np.append(np.diff(t) > SHORT, True)]
        at, rate, change = (np.asarray(part)[0] for part in alpha(t))
        first, second = self.angles(at, 1), self.angles(at, 2)
        q, v, a = self.angles(at).T, (first * rate).T, (second * rate**2 + first * change).T
        h = np.diff(t)[:, None]
        d = q[1:] - q[:-1] - (v[:-1] + a[:-1] * h / 2) * h
        e, f = (v[1:] - v[:-1] - a[:-1] * h) * h, (a[1:] - a[:-1]) * h**2 / 2
        highest = (6 * d - 3 * e + f) / h**5, (7 * e - 15 * d - 2 * f) / h**4, (10 * d - 4 * e + f) / h**3
        return Motion(alpha.name, t, np.stack([*highest, a[:-1] / 2, v[:-1], q[:-1]]))

    def allowed(self, places: Float[np.ndarray, "places"], windows: tuple[float, float]) -> Allowed:
        """Return the limits of alpha between places that keep the joints within theirs.

        With speed v, acceleration a and jerk j of alpha, and d1, d2, d3 an angle's derivatives by alpha: |d1| v <= V,
        |d2| v^2 + |d1| a <= A, |d3| v^3 + 3 |d2| v a + |d1| j <= J. Curvature may use half of A and J, acceleration the
        rest. Averaged over a window w the jerk is at most 2 a / w; averaged segments keep the tightest limit of them.
        """
        shares = np.linspace(0.0, 1.0, FINE)
        fine = (places[:-1, None] + np.diff(places)[:, None] * shares).ravel()
        first, second, third = (np.abs(self.angles(fine, order)) for order in (1, 2, 3))
        speed, acceleration, jerk = self.limits[..., None]
        with np.errstate(divide="ignore"):
            v = np.minimum(np.sqrt(acceleration / 2 / second), np.cbrt(jerk / 2 / third))
            v = np.minimum(speed / first, v).min(0)
            a = (jerk - third * v**3) / (3 * second * v + 2 * first / max(windows))
            a = np.minimum((acceleration - second * v**2) / first, a).min(0)
        passed = cumulative_trapezoid(1 / v, np.abs(fine - fine[0]), initial=0.0)
        mixed = np.abs(passed[:, None] - passed) <= sum(windows)
        v, a = (np.where(mixed, each, np.inf).min(1).reshape(-1, FINE).min(1) for each in (v, a))
        return Allowed(np.minimum(v[:-1], v[1:]), a)


@dataclass(frozen=True)
class Schedule:
    """Speeds along a path.

    Attributes:
        path: the path.
        places: (K + 1,) [rad] alpha, from the start to the end.
        speeds: (K + 1,) [rad/s] of alpha there, 0 at both ends.
        windows: [s] of the moving averages.
    """

    path: Path
    places: Float[np.ndarray, "places"]
    speeds: Float[np.ndarray, "places"]
    windows: tuple[float, float]

    @property
    def times(self) -> Float[np.ndarray, "segments"]:
        """Duration of each segment before averaging [s]."""
        return np.asarray(2 * np.abs(np.diff(self.places)) / (self.speeds[1:] + self.speeds[:-1]))

    @property
    def accelerations(self) -> Float[np.ndarray, "segments"]:
        """Acceleration in each segment, nowhere increased by averaging [rad/s^2]."""
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
        evenly = Motion("speed along the path", breaks, alpha[..., None])
        return self.path.motion(averaged(averaged(evenly, self.windows[0]), self.windows[1]))


Settling = tuple[Float[np.ndarray, "3"], float]
"""Values [m] below which each direction must settle, infinite for none, and the time constant of the decay [s]."""


@dataclass(frozen=True)
class _Aim:
    """Aim of a search: the least time with ln(vibration) at a level, or the least vibration in a time [s].

    Attributes:
        level: of each bin, or of all.
        weight: of what exceeds it; 0 for no limit.
        time: [s]
        settles: whether the weight of what exceeds it after the arrival is the time that its decay takes.
    """

    level: float | Float[np.ndarray, "bins"] = 0.0
    weight: float | Float[np.ndarray, "bins"] = 1.0
    time: float | None = None
    settles: bool = False

    def excess(self, now: Float[np.ndarray, "bins"]) -> float:
        """Return the largest weighted excess of ln(vibration)."""
        return float((self.weight * (now - self.level)).max())

    @property
    def gain(self) -> float:
        """Least decrease of the cost for a step."""
        return GAIN if self.time else GAIN / STEEP

    def cost(self, schedule: Schedule, now: Float[np.ndarray, "bins"]) -> float:
        """Return the cost to minimise: an exact penalty function."""
        excess = self.excess(now)
        return float(np.log(schedule.duration)) + PENALTY * (excess if self.time else max(0.0, excess))

    def rank(self, schedule: Schedule, now: Float[np.ndarray, "bins"]) -> tuple[bool, float]:
        """Sort schedules within the limit by their time, then the others by their vibration; or all by their cost."""
        if self.settles:
            return False, self.cost(schedule, now)
        excess = self.excess(now) - CLOSE / 2
        keeps = self.time is None and excess <= 0
        return not keeps, schedule.duration if keeps else excess


@dataclass(frozen=True)
class Scheduling:
    """A search for the speeds along a path.

    Attributes:
        evaluator: the arm with the highest transmission errors, its loads, unknown phases and sampling rate.
        path: the path.
        segments: number K of segments.
        dwell: [s] at rest after arrival; its vibration then counts, too.
    """

    evaluator: Evaluator
    path: Path
    segments: int
    dwell: float

    @cached_property
    def places(self) -> Float[np.ndarray, "places"]:
        """Alpha at the ends of the segments, which are shorter towards the ends of the path [rad]."""
        start, end = self.path.ends
        return np.asarray(start + (end - start) * (1 - np.cos(np.linspace(0, np.pi, self.segments + 1))) / 2)

    @cached_property
    def windows(self) -> tuple[float, float]:
        """The periods of the two lowest modes at the arrival [s]."""
        first, second = self.frequencies(self.places[-1:])[:, 0]
        return float(1 / first), float(1 / second)

    @cached_property
    def allowed(self) -> Allowed:
        """Limits of alpha."""
        return self.path.allowed(self.places, self.windows)

    def frequencies(self, alpha: Float[np.ndarray, "K"], arm: Arm | None = None) -> Float[np.ndarray, "2 K"]:
        """Return the two lowest natural frequencies along the path [Hz], of the evaluator's arm or another."""
        arm, loads = self.evaluator.arm if arm is None else arm, self.evaluator.loads
        angles = self.path.angles(alpha)
        return np.asarray(in_batches(lambda some: lowest_frequencies(arm, some, loads, 2), angles, BATCH))

    def orders(self, alpha: Float[np.ndarray, "K"]) -> Float[np.ndarray, "orders K"]:
        """Return the excitation frequencies along the path over the speed of alpha, in cycles per radian."""
        arm = self.evaluator.arm
        share = dict(zip([joint.name for joint in arm.driven], self.path.angles(alpha, 1), strict=True))
        orders = orders_of(arm)
        turns = [(np.abs(float(d.ratio) * share[d.joint]) / (2 * np.pi), orders[d.name]) for d in arm.drives]
        each = [turn * order for turn, orders in turns for order in orders if turn.any()]
        return np.unique(np.reshape(each, (len(each), len(alpha))).round(9), axis=0)

    def vibration(self, motion: Motion) -> Superposition:
        """Return the vibration over a motion and the dwell after it."""
        each = self.evaluator
        return superposition(each.arm, motion.dwell(self.dwell), each.unknown, loads=each.loads, rate=each.rate)

    def schedule(self, speeds: Float[np.ndarray, "inner"]) -> Schedule:
        """Return the schedule of these speeds [rad/s], reduced to the limits where they exceed them."""
        reach = 2 * self.allowed.acceleration * np.abs(np.diff(self.places))
        squares = np.pad(np.minimum(speeds, self.allowed.speed) ** 2, 1)
        for k in range(1, len(squares)):
            squares[k] = min(squares[k], squares[k - 1] + reach[k - 1])
            squares[-k - 1] = min(squares[-k - 1], squares[-k] + reach[-k])
        return Schedule(self.path, self.places, np.sqrt(squares), self.windows)

    def by_bins(self, schedule: Schedule) -> Float[np.ndarray, "bins"]:
        """Return ln of the largest vibration [m] over the unknown phases in each bin and direction."""
        motion, rate = schedule.motion, self.evaluator.rate
        envelope = self.vibration(motion).envelope
        time = np.arange(envelope.shape[1]) / rate
        share = (self.path.alpha(motion(time)[0]) - self.places[0]) / (self.places[-1] - self.places[0])
        later = LATER * (time - motion.arrival) / max(self.dwell, 1 / rate)
        bins = np.where(later >= 0, BINS + np.clip(later, 0, LATER - 1), np.clip(BINS * share, 0, BINS - 1))
        largest = np.full((3, BINS + LATER), SMALL)
        for way in range(3):
            np.maximum.at(largest[way], bins.astype(int), envelope[way])
        return np.log(largest.ravel())

    def least_time(
        self, limit: float, progress: Progress = iter, near: Schedule | None = None, settled: Settling | None = None
    ) -> Schedule:
        """Return the schedule of least time within a limit [m] for all values of the unknown phases.

        If none keeps the limit, return the quietest schedule of the search. With `settled` the time until the vibration
        stays below a value: what exceeds the value after the arrival by a factor r costs the time constant times ln r.

        Args:
            limit: [m]; infinite for none.
            progress: shows progress over the steps of the search.
            near: a schedule to start from; the best of a few when None.
            settled: the values, and the time constant.
        """
        level, weight = np.full((3, BINS + LATER), limit), np.full((3, BINS + LATER), 1.0)
        if settled:
            level[:, BINS:] = settled[0][:, None]
            weight[:, BINS:] = settled[1] / PENALTY / float(self.evaluator.motion.arrival)
        free = np.isinf(level)
        level, weight = np.where(free, 1.0, level), np.where(free, 0.0, weight)
        aim = _Aim(np.log(level).ravel() - CLOSE / 2, weight.ravel(), settles=settled is not None)
        return self._search([near] if near else self._starts(), aim, progress)

    def least_vibration(self, time: float, progress: Progress = iter) -> Schedule:
        """Return the schedule of least vibration in a time [s].

        Raises:
            InputError: the time is too short for the path.
        """
        fastest = self.schedule(np.full(self.segments - 1, np.inf))
        if fastest.duration > time:
            expected = f"at least {fastest.duration:.4g} s, as the limits of speed, acceleration and jerk allow"
            raise refusal("time", f"{time:g} s", expected, "give more time, or a higher `speed`")
        return self._search([self.in_time(each, time) for each in self._starts()], _Aim(time=time), progress)

    def in_time(self, schedule: Schedule, time: float) -> Schedule:
        """Scale speeds to just keep a time [s]; where some meet their limits, scale the others more."""
        time = max(time, self.schedule(np.full(self.segments - 1, np.inf)).duration)
        for _ in range(SCALINGS):
            late = (schedule.duration - sum(self.windows)) / (time - sum(self.windows)) - 1
            if abs(late) < EXACT:
                break
            schedule = self.schedule(schedule.speeds[1:-1] * (1 + late))
        return schedule

    def _starts(self) -> list[Schedule]:
        """Return starts of the search: the highest speed, or an order of the pulleys below the first mode."""
        first, orders = self.frequencies(self.places[1:-1])[0], self.orders(self.places[1:-1])
        with np.errstate(divide="ignore"):
            speeds = [np.full(len(first), np.inf), *(below * first / order for order in orders for below in BELOW)]
        return list({each.speeds.tobytes(): each for each in map(self.schedule, speeds)}.values())

    def _search(self, starts: list[Schedule], aim: "_Aim", progress: Progress) -> Schedule:
        """Return the best schedule for an aim, from the best of some starts.

        Uses linear programs within a trust region that grows and shrinks with their success.
        """

        def reached(speeds: Float[np.ndarray, "inner"]) -> Schedule:
            found = self.schedule(speeds)
            return found if aim.time is None else self.in_time(found, aim.time)

        every = [(each, self.by_bins(each)) for each in starts]
        schedule, now = best = min(every, key=lambda each: aim.rank(*each))
        floor = np.log(schedule.speeds[1:-1]) - SLOWEST
        count, region, slopes, exact = self.segments - 1, REGION, None, False
        for _ in progress(range(ITERATIONS)):
            u = np.log(schedule.speeds[1:-1])
            beside = [reached(np.exp(u - DIFFERENCE * each)) for each in np.eye(count)]
            slower = np.log([schedule.duration / each.duration for each in beside]) / DIFFERENCE
            if slopes is None:
                slopes, exact = np.stack([(now - self.by_bins(each)) / DIFFERENCE for each in beside], 1), True
            highest = np.clip(np.log(self.allowed.speed) - u, 0.0, region)
            lowest = np.clip(floor - u, -region, 0.0)
            bounds = [*zip(lowest, highest, strict=True), (None if aim.time else 0.0, None)]
            weight = np.broadcast_to(aim.weight, now.shape)
            rows = np.hstack([weight[:, None] * slopes, -np.ones((len(now), 1))])
            costs = np.append(slower, PENALTY)
            cost, line, most = aim.cost(schedule, now), now, 0.0
            for _ in range(TRIES):
                answer = linprog(costs, A_ub=rows, b_ub=weight * (aim.level - line), bounds=bounds)
                if answer.status:
                    raise ModelError(f"no schedule found: {answer.message}")
                step = answer.x[:count]
                tried = reached(np.exp(u + step))
                then = self.by_bins(tried)
                promised = cost - (np.log(schedule.duration) + costs @ answer.x)
                gained = cost - aim.cost(tried, then)
                most = max(most, promised)
                if promised < aim.gain or gained > 0.25 * promised:
                    break
                line = then - slopes @ step  # with the curvature along this step (second-order correction)
            good, done = gained > 0.25 * promised, most < aim.gain or region < LEAST_REGION
            moved, change = np.log(tried.speeds[1:-1]) - u, then - now
            if gained > 0:
                schedule, now = tried, then
                best = min(best, (tried, then), key=lambda each: aim.rank(*each))
            if done and exact:
                break
            if good and not done:  # Broyden's update saves a simulation for each speed
                slopes = slopes + np.outer(change - slopes @ moved, moved) / float(moved @ moved)
                region = min(1.5 * region, LARGEST_REGION) if gained > 0.7 * promised else region
            else:
                region = region / 2.5 if exact and not done else region
                slopes = slopes if exact and gained <= 0 else None
            exact = exact and gained <= 0
        return best[0]
