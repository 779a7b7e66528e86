"""Cures that need no new part: the same path at other speeds, by other profiles, or shaped, side by side."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from jaxtyping import Float

from ident.arm.multibody import exciting_orders
from ident.arm.parts import Stroke
from ident.assess.remedies import CONFIDENT, exact_response, keeping
from ident.assess.scenario import Basis, over_phases
from ident.vibrate.evaluator import BinomialEstimate, Draws, Evaluator, binomial_estimate
from ident.vibrate.exact import Progress
from ident.vibrate.motion import PROFILES, Motion, stroke
from ident.vibrate.replay import replay
from ident.vibrate.response import peak
from ident.vibrate.schedule import MotionLimits, Schedule, Scheduling
from ident.vibrate.shaping import shaped, shapers
from ident.vibrate.simulate import Superposition

RATE = 125.0
"""Samples a second at which motions are compared: 15 in a period of 8 Hz, whose peak is then met within 2 %."""
SLOWER = 0.95
"""Factor from one lower speed to the next that is tried, down to `SLOWEST` of the present one; assumed."""
SLOWEST = 0.2
TRIES = 5
"""Speeds that keep the limit nominally which are judged by draws, at most; assumed."""
ALLOWED = 1.001
"""Factor by which samples may exceed a limit of alpha: differences of them stand for the jerk."""
TOUCHED = 0.05
"""Share of the vibration that the motion itself must make for shapers to be tried; assumed."""
TIGHTENED = 3
"""Searches at most, each for a tighter limit until exact equations and draws keep the one asked for; assumed."""
MARGIN = 0.98
"""Factor by which a limit is tightened besides; assumed."""


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
        allowed: whether alpha keeps its limits of speed, acceleration and jerk.
    """

    name: str
    kind: str
    motion: Motion
    peaks: Float[np.ndarray, "K"]
    worst: float
    left: float
    acceleration: float
    allowed: bool

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
        largest: [m] vibration of the three directions with the worst phases, as the fast method finds them.
        keeps: probability of keeping the limit by fresh draws; None without a posterior.
    """

    largest: float
    keeps: BinomialEstimate | None


@dataclass(frozen=True)
class MotionStudy:
    """Motions along one path, and which is proposed.

    Attributes:
        basis: the arm, its motion as it is, and where their numbers come from.
        scheduling: the search for speeds along the path.
        limit: [m]
        share_of_motion: share of the worst vibration that no drive makes, but the motion itself [-]
        before: vibration of the motion as it is, over the unknown phases.
        after: of the speeds along the path.
        candidates: as it is, the others, and the speeds along the path last.
        schedule: the speeds along the path.
        verification: of these.
    """

    basis: Basis
    scheduling: Scheduling
    limit: float
    share_of_motion: float
    before: Superposition
    after: Superposition
    candidates: tuple[Candidate, ...]
    schedule: Schedule
    verification: MotionVerification

    def met(self, candidate: Candidate) -> bool:
        """Tell whether a candidate keeps the limit, with the worst phases and 95 % of the draws, and its own limits.

        That along the path by the exact equations and by fresh draws, too, all others by the fast method.
        """
        good = candidate.worst <= self.limit and candidate.keeps(self.limit).share >= CONFIDENT
        if candidate.kind == "along the path":
            fresh = self.verification.keeps
            good = self.verification.largest <= self.limit and (good if fresh is None else fresh.share >= CONFIDENT)
        return good and (candidate.allowed or candidate.kind == "as it is")

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


def share_of_motion(scheduling: Scheduling, motion: Motion) -> float:
    """Return the share of the worst vibration that no drive makes, but the motion itself [-].

    The worst is over the phases of all drives: what a known phase makes would count as the motion's.
    """
    phases = tuple(each.phase for each in exciting_orders(scheduling.evaluator.arm))
    whole = replace(scheduling, evaluator=replace(scheduling.evaluator, unknown=phases)).vibration(motion)
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
        InputError: a time out of reach.
    """
    judge = partial(_candidate, basis, scheduling)
    before = scheduling.vibration(basis.motion)
    as_it_is = judge("as it is", "as it is", basis.motion, before)
    share = share_of_motion(scheduling, basis.motion)
    others = [judge(*each) for each in _profiles(basis, scheduling.retract)]
    if share > TOUCHED:
        others += [judge(*each) for each in _shaped(scheduling, basis.motion)]
    others += _slower(scheduling, basis, limit, judge)
    schedule, aim = None, limit
    for _ in range(TIGHTENED):
        if time is not None:
            schedule = scheduling.least_vibration(time, progress)
        else:
            schedule = scheduling.least_time(aim, progress, near=schedule)
        after = scheduling.vibration(schedule.motion)
        found = judge("speed along the path", "along the path", schedule.motion, after)
        checks = _verified(scheduling, schedule.motion, after, fresh, limit)
        every = (as_it_is, *others, found)
        study = MotionStudy(basis, scheduling, limit, share, before, after, every, schedule, checks)
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
    left = float(whole.envelope[:, whole.time >= motion.arrival].max(initial=0.0))
    acceleration, allowed = _kinematics(scheduling, motion)
    return Candidate(name, kind, motion, peaks, float(whole.worst.max()), left, acceleration, allowed)


def _kinematics(scheduling: Scheduling, motion: Motion) -> tuple[float, bool]:
    """Return the largest acceleration of a joint [rad/s^2], and whether alpha keeps its limits, by dense samples."""
    step = 0.1 / RATE
    _, qd, qdd = motion(np.arange(0.0, motion.arrival, step))
    speed, acceleration = scheduling.alpha(qd), scheduling.alpha(qdd)
    rates = speed, acceleration, np.diff(acceleration, prepend=0.0, append=0.0) / step
    sizes = zip((float(np.abs(rate).max()) for rate in rates), scheduling.limits, strict=True)
    return float(np.abs(np.asarray(qdd)).max()), all(size <= ALLOWED * limit for size, limit in sizes)


def _profiles(basis: Basis, retract: bool) -> Iterator[tuple[str, str, Motion]]:
    """Yield the other profiles at the same speed."""
    path = basis.arm.stroke
    for profile in PROFILES:
        if path is not None and f", {profile}," not in basis.motion.name:
            yield profile, "profile", stroke(path, percent=basis.percent, profile=profile, retract=retract)


def _slower(scheduling: Scheduling, basis: Basis, limit: float, judge: Callable[..., Candidate]) -> Iterator[Candidate]:
    """Yield the motion at the highest lower speed that keeps the limit; none where it keeps it, or no speed does."""
    factor, tries = 1.0, TRIES
    while factor > SLOWEST and tries:
        motion = basis.motion.at_speed(100 * factor)
        whole = scheduling.vibration(motion)
        if whole.worst.max() <= limit:
            found = judge(f"{factor * basis.percent:.3g} % speed", "speed", motion, whole)
            if found.keeps(limit).share >= CONFIDENT:
                if factor < 1:
                    yield found
                return
            tries -= 1
        factor *= SLOWER


def _shaped(scheduling: Scheduling, motion: Motion) -> Iterator[tuple[str, str, Motion]]:
    """Yield the motion shaped for the first mode, and for both of the lowest, along the posture's frequencies."""
    direction = np.asarray(scheduling.stroke.direction, float)
    along = np.linspace(scheduling.places.min(), scheduling.places.max(), 101)
    modes = scheduling.frequencies(along)

    def alpha(time: np.ndarray) -> np.ndarray:
        return scheduling.alpha(motion(time)[0])

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
    response = exact_response(replace(each, arm=excited, motion=held, rate=2 * RATE))
    keeps = None
    if fresh:
        drawn = replace(each, motion=held, draws=fresh, unknown=())
        _, keeps = keeping(drawn, np.zeros(0), limit)
    return MotionVerification(float(np.max(peak(response.vibration))), keeps)
