"""Cures that need no new part: the same path at other speeds, by other profiles, or shaped, side by side."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from jaxtyping import Float

from ident.arm.parts import Stroke
from ident.assess.remedies import CONFIDENT, keeping
from ident.assess.scenario import Basis, over_phases
from ident.vibrate.evaluator import BinomialEstimate, Draws, Evaluator, binomial_estimate
from ident.vibrate.exact import Progress
from ident.vibrate.motion import PROFILES, Motion, stroke
from ident.vibrate.replay import replay
from ident.vibrate.response import Response
from ident.vibrate.schedule import MotionLimits, Schedule, Scheduling
from ident.vibrate.shaping import shaped, shapers
from ident.vibrate.simulate import Superposition, simulate

RATE = 125.0
"""Samples a second at which motions are compared: 15 in a period of 8 Hz, whose peak is then met within 2 %."""
SLOWER = 0.95
"""Factor from one lower speed to the next that is tried, down to `SLOWEST` of the present one."""
SLOWEST = 0.2
TOUCHED = 0.05
"""Share of the vibration that the motion itself must make for shapers to be tried."""
TIGHTENED = 4
"""Times that the limit is tightened for the search, until the schedule keeps it by exact equations and draws."""
MARGIN = 0.98
"""Factor by which a limit is tightened besides."""


@dataclass(frozen=True)
class Candidate:
    """A motion along the path, and how far the arm vibrates with it.

    Attributes:
        name: in words.
        kind: `as it is`, `speed`, `profile`, `shaper` or `along the path`.
        motion: of all driven joints, without dwell.
        peaks: (K,) [m] largest of the three directions, by draws of what is unknown: the phases, and the posterior.
        worst: [m] largest over the phases, of the nominal arm.
        left: [m] the same after the arrival.
        acceleration: [rad/s^2] largest of any joint.
    """

    name: str
    kind: str
    motion: Motion
    peaks: Float[np.ndarray, "K"]
    worst: float
    left: float
    acceleration: float

    @property
    def time(self) -> float:
        """From start to arrival [s]."""
        return float(self.motion.arrival - self.motion.breaks[0])

    def keeps(self, limit: float) -> BinomialEstimate:
        """Return with which probability a limit [m] is kept."""
        return binomial_estimate(self.peaks <= limit)


@dataclass(frozen=True)
class MotionVerification:
    """The proposed motion by the exact equations, and by draws that it was not chosen by.

    Attributes:
        response: with the worst phases, as the fast method finds them.
        keeps: probability of keeping the limit by fresh draws; None without a posterior.
    """

    response: Response
    keeps: BinomialEstimate | None

    @property
    def largest(self) -> float:
        """Largest vibration of the three directions [m]."""
        return float(np.abs(np.asarray(self.response.vibration)).max())


@dataclass(frozen=True)
class MotionStudy:
    """Motions along one path, and which is proposed.

    Attributes:
        basis: the arm, its motion as it is, and where their numbers come from.
        scheduling: the search for speeds along the path.
        limit: [m]
        before: vibration of the motion as it is, over the unknown phases.
        after: of the speeds along the path.
        candidates: as it is, the others, and the speeds along the path last.
        schedule: the speeds along the path.
        verification: of these.
        frequencies: (2, 101) [Hz] lowest natural frequencies along the path.
    """

    basis: Basis
    scheduling: Scheduling
    limit: float
    before: Superposition
    after: Superposition
    candidates: tuple[Candidate, ...]
    schedule: Schedule
    verification: MotionVerification

    @property
    def share_of_motion(self) -> float:
        """Share of the worst vibration that the motion itself makes, and no drive [-]."""
        return share_of_motion(self.before)

    def met(self, candidate: Candidate) -> bool:
        """Tell whether a candidate keeps the limit with confidence; that along the path by its verification too."""
        if candidate.kind != "along the path":
            return candidate.keeps(self.limit).share >= CONFIDENT
        checked, fresh = self.verification, self.verification.keeps
        return checked.largest <= self.limit and (fresh is None or fresh.share >= CONFIDENT)

    @property
    def recommended(self) -> Candidate | None:
        """The candidate that keeps the limit in the least time; None where none does."""
        good = [each for each in self.candidates if self.met(each)]
        return min(good, key=lambda each: (each.time, each.kind != "as it is")) if good else None


def scheduling_of(basis: Basis, stroke_of: Stroke, *, segments: int, dwell: float, retract: bool) -> Scheduling:
    """Return the search for the speeds along a stroke, none higher than the motion's, over what is not known."""
    arm = basis.arm.replace(basis.unknown.highest)
    evaluator = Evaluator(arm, basis.motion, (), loads=basis.loads, rate=RATE, unknown=basis.unknown.phases)
    speed = float(stroke_of.speed) * basis.percent / 100
    limits = MotionLimits(speed, float(stroke_of.acceleration), float(stroke_of.jerk))
    return Scheduling(evaluator, stroke_of, limits, segments, dwell, retract)


def share_of_motion(whole: Superposition) -> float:
    """Return the share of the worst vibration that no drive makes, but the motion itself [-]."""
    known, *driven = whole.division[:, int(whole.worst.argmax())]
    return float(known / max(known + sum(driven), 1e-15))


def motions(
    basis: Basis,
    scheduling: Scheduling,
    *,
    limit: float,
    time: float | None,
    fresh: Draws,
    progress: Progress = iter,
) -> MotionStudy:
    """Compare motions along the stroke of an arm, and search the speeds along it.

    Args:
        basis: the arm, its motion without dwell, and the draws that judge.
        scheduling: the search, of `scheduling_of`.
        limit: [m] largest vibration that is accepted.
        time: [s] in which to vibrate least; None for the least time that keeps the limit.
        fresh: draws that nothing was judged by; none without a posterior.
        progress: shows how far it is, over the steps of the search.

    Raises:
        InputError: a limit or a time out of reach.
    """
    judge = partial(_candidate, basis, scheduling)
    before = scheduling.vibration(basis.motion)
    as_it_is = judge("as it is", "as it is", basis.motion, before)
    others = [judge(*each) for each in _profiles(basis, scheduling.retract)]
    if share_of_motion(before) > TOUCHED:
        others += [judge(*each) for each in _shaped(scheduling, basis.motion)]
    if slower := _slower(scheduling, basis.motion, limit):
        others.append(judge(f"{slower * basis.percent / 100:.3g} % speed", "speed", basis.motion.at_speed(slower)))
    schedule, aim = None, limit
    for _ in range(TIGHTENED):
        if time is not None:
            schedule = scheduling.least_vibration(time, progress)
        else:
            schedule = scheduling.least_time(aim, progress, near=schedule)
        after = scheduling.vibration(schedule.motion)
        found = judge("speed along the path", "along the path", schedule.motion, after)
        checks = _verified(scheduling, schedule.motion, after, fresh, limit)
        study = MotionStudy(basis, scheduling, limit, before, after, (as_it_is, *others, found), schedule, checks)
        if time is not None or study.met(found):
            break
        high = float(np.quantile(found.peaks, CONFIDENT))
        aim *= MARGIN * min(1.0, limit / checks.largest, limit / high)
    return study


def _candidate(
    basis: Basis,
    scheduling: Scheduling,
    name: str,
    kind: str,
    motion: Motion,
    whole: Superposition | None = None,
) -> Candidate:
    """Judge a motion by the phases that are unknown, and with a posterior by its draws, each with phases of its own."""
    whole = whole or scheduling.vibration(motion)
    if basis.draws:
        held = motion.dwell(scheduling.dwell)
        each = replace(scheduling.evaluator, arm=basis.arm, motion=held, draws=basis.draws, unknown=())
        peaks = each.amplitudes(np.zeros((1, 0)))[:, 0, 1:].max(0)
    elif whole.unknown:
        peaks = over_phases(whole, basis.unknown).peaks.max(0)
    else:
        peaks = np.array([whole.worst.max()])
    times = np.linspace(float(motion.breaks[0]), motion.arrival, 20 * len(motion.breaks) + 1)
    acceleration = float(np.abs(np.asarray(motion(times)[2])).max())
    left = float(whole.envelope[:, whole.time >= motion.arrival].max())
    return Candidate(name, kind, motion, peaks, float(whole.worst.max()), left, acceleration)


def _profiles(basis: Basis, retract: bool) -> Iterator[tuple[str, str, Motion]]:
    """Yield the other profiles at the same speed."""
    path = basis.arm.stroke
    for profile in PROFILES:
        if path is not None and f", {profile}," not in basis.motion.name:
            yield profile, "profile", stroke(path, percent=basis.percent, profile=profile, retract=retract)


def _slower(scheduling: Scheduling, motion: Motion, limit: float) -> float | None:
    """Return the highest lower speed [% of the motion's] that keeps the limit; None where it keeps it, or none does."""
    factor = 1.0
    while scheduling.vibration(motion.at_speed(100 * factor)).worst.max() > limit:
        factor *= SLOWER
        if factor < SLOWEST:
            return None
    return 100 * factor if factor < 1 else None


def _shaped(scheduling: Scheduling, motion: Motion) -> Iterator[tuple[str, str, Motion]]:
    """Yield the motion shaped for the first mode, and for both of the lowest, along the posture's frequencies."""
    direction = np.asarray(scheduling.stroke.direction, float)
    along = np.linspace(scheduling.places.min(), scheduling.places.max(), 101)
    modes = scheduling.frequencies(along)

    def alpha(time: np.ndarray) -> np.ndarray:
        return direction @ np.asarray(motion(time)[0]) / (direction @ direction)

    def frequency(mode: int) -> Callable[[np.ndarray], np.ndarray]:
        return lambda at: np.interp(at, along, modes[mode])

    each = shapers()
    zv = next(shaper for shaper in each if shaper.name == "ZV")
    for name, steps in [
        *((s.name, ((s, frequency(0)),)) for s in each),
        ("ZV x ZV", ((zv, frequency(0)), (zv, frequency(1)))),
    ]:
        time, shaped_alpha = shaped(alpha, motion.arrival, steps)
        even = np.linspace(0.0, time[-1], 1 + int(np.ceil(time[-1] * RATE)))
        angles = np.interp(even, time, shaped_alpha) * direction[:, None]
        yield f"{name} shaper", "shaper", replay(even, angles, name=name)


def _verified(
    scheduling: Scheduling, motion: Motion, whole: Superposition, fresh: Draws, limit: float
) -> MotionVerification:
    """Simulate a motion by the exact equations with its worst phases, and by fresh draws."""
    each, held = scheduling.evaluator, motion.dwell(scheduling.dwell)
    excited = each.arm.replace(whole.worst_phases()) if whole.unknown else each.arm
    response = simulate(excited, held, loads=each.loads, method="exact", rate=2 * RATE)
    if response.interrupted is not None:
        raise KeyboardInterrupt
    keeps = None
    if fresh:
        drawn = replace(each, motion=held, draws=fresh, unknown=())
        _, keeps = keeping(drawn, np.zeros(0), limit)
    return MotionVerification(response, keeps)
