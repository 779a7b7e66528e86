"""Cures without a new part: the same path at other speeds, with other profiles, or shaped, in comparison."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from itertools import chain
from typing import Any

import numpy as np
from jaxtyping import Float

from ident.arm.multibody import exciting_orders
from ident.arm.parts import Stroke
from ident.errors import refusal
from ident.identify.unknowns import is_damping
from ident.programs import Progress
from ident.studies.cure.knobs import settings, typed
from ident.studies.cure.remedies import CONFIDENT, keeping, tolerance_limit
from ident.studies.scenario import Basis, over_phases
from ident.text import one_line
from ident.vibrate.binomial import BinomialEstimate, binomial_estimate
from ident.vibrate.evaluator import Draws, Evaluator, exact_response
from ident.vibrate.motion import PROFILES, Motion, stroke
from ident.vibrate.replay import replay
from ident.vibrate.response import belt_tension, peak, slack
from ident.vibrate.schedule import RATE, Path, Schedule, Scheduling
from ident.vibrate.settling import Poles, free_decay, largest_decay, poles_at, settling_time
from ident.vibrate.shaping import shaped, shapers
from ident.vibrate.simulate import Superposition, sample_times

SPEEDS = 0.95 ** np.arange(32)
"""Tried factors of the present speed, down to a fifth; assumed."""
TRIES = 5
"""Speeds that keep the limit nominally and are judged by draws, at most; assumed."""
LIMITS = ("speed", "acceleration", "jerk")
"""Limited quantities of joints."""
ALLOWED = 1.001
"""Factor by which samples may exceed a limit: their differences stand for the jerk."""
ALONG = 33
"""Points of the path at which frequencies are shown."""
TOUCHED = 0.05
"""Least share of the vibration from the motion itself for which shapers are tried; assumed."""
TIGHTENED = 3
"""Searches at most, each with a tighter limit until exact equations and draws keep the requested one; assumed."""
MARGIN = 0.98
"""Additional factor when a limit is tightened; assumed."""
TIGHTEST = 0.5
"""Least factor by which a search is tightened at once for draws that settle late; assumed."""
SOON = 0.5
"""Time [s] after the arrival within which draws may settle without a tighter search; assumed."""


@dataclass(frozen=True)
class Candidate:
    """A motion along the path, and the vibration of the arm with it.

    Attributes:
        name: in words.
        kind: `as it is`, `speed`, `profile`, `shaper`, `knobs`, `best` for the best of these, or `along the path`.
        motion: of all driven joints, without dwell.
        peaks: (K,) [m] largest of the three directions, by draws of the unknowns: the phases, and the posterior.
        worst: [m] largest over the phases, of the nominal arm.
        left: [m] the same after the arrival.
        acceleration: [rad/s^2] largest of any joint.
        beyond: exceeded limits of the joints: speed, acceleration, jerk.
        settled: (K,) [s] from the start until the end has settled, by the same draws; None if not asked for.
        verification: by the exact equations; None if the motion was not proposed.
        typed: numbers to type into the controller; empty if they are not known.
    """

    name: str
    kind: str
    motion: Motion
    peaks: Float[np.ndarray, "K"]
    worst: float
    left: float
    acceleration: float
    beyond: tuple[str, ...]
    settled: Float[np.ndarray, "K"] | None = None
    verification: "MotionVerification | None" = None
    typed: str = ""

    @property
    def time(self) -> float:
        """Time from start to arrival [s]."""
        return float(self.motion.arrival - self.motion.breaks[0])

    def keeps(self, limit: float) -> BinomialEstimate:
        """Return the probability of keeping a limit [m]."""
        return binomial_estimate(self.peaks <= limit)

    @property
    def ready(self) -> float:
        """Time [s] within which most draws have settled, see `tolerance_limit`; of the arrival if not asked for."""
        if self.verification is not None and self.verification.ready is not None:
            return self.verification.ready
        return self.time if self.settled is None else tolerance_limit(self.settled)


@dataclass(frozen=True)
class MotionVerification:
    """The proposed motion by the exact equations, and by fresh draws.

    Attributes:
        largest: [m] vibration of the three directions with the worst phases, as the fast method determines them.
        keeps: probability of keeping the limit by fresh draws; None without a posterior.
        slack: names of belts with a span that would go slack: modelled as rigid it can't, so nothing is confirmed.
        settled: [s] from the start until the end has settled, by the exact equations; None if not asked for.
        ready: [s] within which most fresh draws have settled; None if not asked for, or without fresh draws.
        tool: [m/s] highest speed of the end point.
    """

    largest: float
    keeps: BinomialEstimate | None
    slack: tuple[str, ...] = ()
    settled: float | None = None
    ready: float | None = None
    tool: float = 0.0


@dataclass(frozen=True)
class Wanted:
    """What the vibration must keep.

    Attributes:
        limit: [m] largest accepted vibration on the way and after it; infinite for none.
        settled: [m] below which it must stay from some time on; None for no such wish.
        ways: directions in which it must settle.
    """

    limit: float
    settled: float | None = None
    ways: tuple[int, ...] = (0, 1, 2)


@dataclass(frozen=True)
class MotionStudy:
    """Motions along one path, and the proposed one.

    Attributes:
        basis: the arm, its present motion, and the sources of their numbers.
        scheduling: the search for speeds along the path.
        wanted: what the vibration must keep.
        share_of_motion: share of the worst vibration that comes from the motion itself, not from drives [-]
        before: vibration of the present motion, over the unknown phases.
        after: of the motion that figures show.
        candidates: the present motion, the others, and the speeds along the path last.
        schedule: the speeds along the path.
        bands: (3, 2, K) [Hz] 5, 50 and 95 % of the draws of the two lowest frequencies at K even points of the path.
    """

    basis: Basis
    scheduling: Scheduling
    wanted: Wanted
    share_of_motion: float
    before: Superposition
    after: Superposition
    candidates: tuple[Candidate, ...]
    schedule: Schedule
    bands: Float[np.ndarray, "3 2 K"]

    @property
    def limit(self) -> float:
        """The limit of the vibration [m]; infinite for none."""
        return self.wanted.limit

    @property
    def verification(self) -> MotionVerification:
        """Verification of the speeds along the path."""
        checks = self.candidates[-1].verification
        assert checks is not None
        return checks

    def met(self, candidate: Candidate) -> bool:
        """Whether a candidate keeps the limit with the worst phases and 95 % of the draws, and the joints' limits.

        Verified ones are judged by the exact equations and by fresh draws; all others by the fast method.
        """
        checks, keeps, largest = candidate.verification, candidate.keeps(self.limit), candidate.worst
        if checks is not None:
            keeps, largest = checks.keeps or keeps, checks.largest
        good = largest <= self.limit and keeps.share >= CONFIDENT and not (checks and checks.slack)
        good = good and bool(np.isfinite(candidate.ready))
        return good and (not candidate.beyond or candidate.kind == "as it is")

    @property
    def best_knobs(self) -> Candidate | None:
        """The best setting of the controller's knobs; None without knobs for a ramp, or if no setting will do."""
        return next((each for each in self.candidates if each.kind == "best"), None)

    @property
    def shown(self) -> Candidate:
        """The motion that figures show: the recommended one, else the speeds along the path."""
        best = self.recommended
        return self.candidates[-1] if best is None or best is self.candidates[0] else best

    @property
    def recommended(self) -> Candidate | None:
        """The candidate that keeps the limit in the least time, or has settled then; None if none does."""
        good = [each for each in self.candidates if self.met(each)]
        return min(good, key=lambda each: (each.ready, each.kind != "as it is")) if good else None


Named = tuple[str, str, Motion]
"""Name, kind and motion of a candidate."""
Judge = Callable[..., Candidate]
"""Judges a motion by its name, kind and the motion."""


def scheduling_of(
    basis: Basis, along: Stroke | None, *, segments: int, dwell: float, retract: bool = False
) -> Scheduling:
    """Return the search for the speeds along a path, over the unknowns.

    Args:
        basis: the arm and its motion.
        along: the path, with the motion's speed as upper limit; None for the path of the motion itself, limited only by
            the joints.
        segments: of the path.
        dwell: [s] after arrival.
        retract: whether the stroke is from unfolded to folded.

    Raises:
        InputError: no excitation; joints without limits, or a corner of the path.
    """
    arm = basis.arm.replace(basis.unknown.highest)
    if not exciting_orders(arm):
        remedy = "give their eccentric_mass and eccentricity, or --errors; without them no speed matters"
        where, expected = one_line(basis.arm_file.path or arm.name), "imbalance or a transmission error of a [[drive]]"
        raise refusal(where, "no drive that excites", expected, remedy)
    evaluator = Evaluator(arm, basis.motion, (), loads=basis.loads, rate=RATE, unknown=basis.unknown.phases)
    if along is None:
        path = Path.of_motion(basis.arm, basis.motion)
    else:
        path = Path.of_stroke(basis.arm, along, basis.percent, retract=retract)
    return Scheduling(evaluator, path, segments, dwell)


def share_of_motion(scheduling: Scheduling, motion: Motion) -> float:
    """Return the share of the worst vibration that comes from the motion itself, not from drives [-].

    The worst is over the phases of all drives: the effect of a known phase would count as the motion's.
    """
    phases = tuple(each.phase for each in exciting_orders(scheduling.evaluator.arm))
    whole = replace(scheduling, evaluator=replace(scheduling.evaluator, unknown=phases)).vibration(motion)
    known, *driven = whole.division[:, int(whole.worst.argmax())]
    return float(known / max(known + sum(driven), 1e-15))


def motions(
    basis: Basis,
    scheduling: Scheduling,
    *,
    wanted: Wanted,
    time: float | None,
    fresh: Draws,
    progress: Progress = iter,
    others: bool = True,
) -> MotionStudy:
    """Compare motions along a path of an arm, and search the speeds along it.

    Args:
        basis: the arm, its motion without dwell, and the draws for the verdict.
        scheduling: the search, of `scheduling_of`.
        wanted: what the vibration must keep.
        time: [s] in which to minimise the vibration; None for the least time that keeps the limit.
        fresh: draws unused so far; none without a posterior.
        progress: shows progress over the steps of the search.
        others: whether to compare other motions, too.

    Raises:
        InputError: a time out of reach.
    """
    judge, limit = partial(_candidate, basis, scheduling, wanted), wanted.limit
    search = _at_low_damping(basis, scheduling)
    settles = wanted.settled is not None
    poles = poles_at(search.evaluator.arm, basis.motion, basis.loads)[:, 0] if settles else None
    before = scheduling.vibration(basis.motion)
    as_it_is = judge("as it is", "as it is", basis.motion, before)
    own = share_of_motion(scheduling, basis.motion)
    compared: list[Candidate] = []
    if others:
        compared += [judge(*each) for each in _profiles(basis, scheduling)]
        compared += [judge(*each) for each in _shaped(scheduling, basis.motion)] if own > TOUCHED else []
        soonest = partial(_soonest, search, wanted, judge, poles)
        slower = soonest([("", "speed", basis.motion), *_overridden(basis)])
        compared += [slower] if slower and slower.name else []
        compared += _by_knobs(basis, search, judge, soonest)
    schedule, share, studies = None, 1.0, list[MotionStudy]()
    constant = 0.0 if poles is None else float(-1 / poles[np.isfinite(poles)].real.max())
    for _ in range(TIGHTENED):
        if time is not None:
            schedule = scheduling.least_vibration(time, progress)
        else:
            settled = None if wanted.settled is None else (share * _values(wanted), constant)
            schedule = search.least_time(share * limit, progress, schedule, settled)
        after = scheduling.vibration(schedule.motion)
        found = judge("speed along the path", "along the path", schedule.motion, after)
        checks = _verified(basis, scheduling, schedule.motion, after, fresh, wanted)
        found = replace(found, verification=checks)
        every, bands = (as_it_is, *compared, found), _bands(scheduling, basis)
        studies.append(MotionStudy(basis, scheduling, wanted, own, before, after, every, schedule, bands))
        if time is not None or (studies[-1].met(found) and found.ready < found.time + SOON):
            break
        high = float(np.quantile(found.peaks, CONFIDENT))
        share *= MARGIN * min(1.0, limit / checks.largest, limit / high)
        if settles and np.isfinite(found.ready):
            share *= max(TIGHTEST, float(np.exp((found.time - found.ready) / constant)))
    study = studies[-1]
    if settles:
        study = min(studies, key=lambda each: (not each.met(each.candidates[-1]), each.candidates[-1].ready))
    whole = dict[str, Superposition]()
    while best := next((x for x in (study.recommended, study.best_knobs) if x and x.verification is None), None):
        whole[best.name] = scheduling.vibration(best.motion)
        checks = _verified(basis, scheduling, best.motion, whole[best.name], fresh, wanted)
        every = tuple(replace(each, verification=checks) if each is best else each for each in study.candidates)
        study = replace(study, candidates=every)
    return replace(study, after=whole.get(study.shown.name, study.after))


def _at_low_damping(basis: Basis, scheduling: Scheduling) -> Scheduling:
    """Return the search with the damping that `CONFIDENT` of its draws exceed: settling hangs on that; if it counts."""
    low = {path: float(np.quantile(x, 1 - CONFIDENT)) for path, x in basis.draws.items() if is_damping(path)}
    arm = scheduling.evaluator.arm.replace(low if basis.unknown.count else {})
    return replace(scheduling, evaluator=replace(scheduling.evaluator, arm=arm))


def _values(wanted: Wanted) -> Float[np.ndarray, "3"]:
    """Return the value below which each direction must settle [m]; infinite for none."""
    return np.where(np.isin(np.arange(3), wanted.ways), float(wanted.settled or np.inf), np.inf)


def _drawn(
    basis: Basis, scheduling: Scheduling, wanted: Wanted, motion: Motion, draws: Draws
) -> tuple[Float[np.ndarray, "K"], Float[np.ndarray, "K"] | None]:
    """Return the largest vibration [m] of each draw, and when it has settled [s] if that is asked for."""
    held = motion.dwell(scheduling.dwell)
    each = replace(scheduling.evaluator, arm=basis.arm, motion=held, draws=draws, unknown=())
    if wanted.settled is None:
        return each.amplitudes(np.zeros((1, 0)))[:, 0, 1:].max(0), None
    vibration, poles = each.drawn_vibration(), poles_at(basis.arm.replace(draws), held, each.loads)
    decay = free_decay(sample_times(held, each.rate), motion.arrival, vibration, poles)
    after = decay.settled(wanted.settled)[list(wanted.ways)].max(0)
    return np.abs(vibration).max((0, 1)), motion.arrival - float(motion.breaks[0]) + after


def _candidate(
    basis: Basis,
    scheduling: Scheduling,
    wanted: Wanted,
    name: str,
    kind: str,
    motion: Motion,
    whole: Superposition | None = None,
) -> Candidate:
    """Judge a motion over the unknown phases, and with a posterior over its draws, each with phases of its own."""
    whole, settled = whole or scheduling.vibration(motion), None
    if basis.draws:
        peaks, settled = _drawn(basis, scheduling, wanted, motion, basis.draws)
    elif whole.unknown:
        peaks = over_phases(whole, basis.unknown).peaks.max(0)
    else:
        peaks = np.array([whole.worst.max()])
    left = float(whole.envelope[:, whole.time >= motion.arrival].max(initial=0.0))
    acceleration, beyond = _kinematics(scheduling, motion)
    return Candidate(name, kind, motion, peaks, float(whole.worst.max()), left, acceleration, beyond, settled)


def _kinematics(scheduling: Scheduling, motion: Motion) -> tuple[float, tuple[str, ...]]:
    """Return the largest acceleration of a joint [rad/s^2], and the limits that joints exceed, by dense samples."""
    step = 0.1 / RATE
    _, qd, qdd = (np.asarray(part) for part in motion(np.arange(0.0, motion.arrival, step)))
    still = np.zeros((len(qdd), 1))
    rates = qd, qdd, np.diff(qdd, prepend=still, append=still) / step
    sizes = np.array([np.abs(rate).max(1) for rate in rates])
    within = np.all(sizes <= ALLOWED * scheduling.path.limits, axis=1)
    return float(sizes[1].max()), tuple(name for name, kept in zip(LIMITS, within, strict=True) if not kept)


def _profiles(basis: Basis, scheduling: Scheduling) -> Iterator[Named]:
    """Yield the other profiles at the same speed; along a given path at the highest allowed everywhere."""
    (start, end), own, percent = scheduling.path.ends, basis.arm.stroke, basis.percent
    if basis.log is None and own is not None:
        speed, acceleration, jerk = (float(each) for each in (own.speed, own.acceleration, own.jerk))
    else:
        speed, acceleration = (float(each.min()) for each in scheduling.allowed)
        jerk, percent = 2 * acceleration / max(scheduling.windows), 100.0
    alone = Stroke([1.0], folded=start, unfolded=end, speed=speed, acceleration=acceleration, jerk=jerk)
    for profile in PROFILES:
        if f", {profile}," not in basis.motion.name:
            yield profile, "profile", scheduling.path.motion(stroke(alone, percent=percent, profile=profile))


def _soonest(
    scheduling: Scheduling, wanted: Wanted, judge: Judge, poles: Poles | None, tried: Iterable[Named]
) -> Candidate | None:
    """Return the first motion, of some by their time, that keeps what is wanted: with any phases, then by its draws."""
    found: list[tuple[float, str, str, Motion]] = []
    for name, kind, motion in tried:
        if len(found) >= TRIES and motion.arrival >= found[TRIES - 1][0]:
            break
        whole, ready = scheduling.vibration(motion), motion.arrival
        if poles is not None and wanted.settled is not None:
            after = largest_decay(whole, motion.arrival, poles).settled(wanted.settled)
            ready += float(after[list(wanted.ways)].max())
        if whole.worst.max() <= wanted.limit:
            found = sorted([*found, (ready, name, kind, motion)], key=lambda each: each[0])
    judged = (judge(*each) for _, *each in found[:TRIES])
    return next((each for each in judged if each.keeps(wanted.limit).share >= CONFIDENT), None)


def _overridden(basis: Basis) -> Iterator[Named]:
    """Yield the motion at lower speeds, on a slower clock; where a knob stretches time, at those that it takes."""
    knob = basis.arm_file.knobs.get("time")
    for factor in SPEEDS[1:]:
        name, share = f"{factor * basis.percent:.3g} % speed", float(factor)
        if knob:
            name, share = typed(knob, factor * basis.percent / 100, 1.0)
            share *= 100 / basis.percent
        if share < 1:
            yield name, "speed", basis.motion.at_speed(100 * share)


def _by_knobs(
    basis: Basis, scheduling: Scheduling, judge: Judge, soonest: Callable[..., Candidate | None]
) -> Iterator[Candidate]:
    """Yield the shortest ramp of whole periods without and with a jerk time, and the best setting of all."""
    own, knobs = None if basis.log else basis.arm.stroke, basis.arm_file.knobs
    how: Any = knobs, own, scheduling.path, basis.percent, scheduling.windows, SPEEDS[::2].tolist()
    every = list(settings(*how)) if own else []
    words = {name: text for name, text, _ in every}
    firsts = ([each for each in every if ("jerk" in each[0]) == jerk][:1] for jerk in (False, True))
    for name, text, motion in chain(*firsts):
        yield replace(judge(name, "knobs", motion), typed=text)
    within = [(name, "best", motion) for name, _, motion in every if not _kinematics(scheduling, motion)[1]]
    if best := soonest(sorted(within, key=lambda each: each[2].arrival)):
        yield replace(best, typed=words[best.name], name="best knobs")


def _shaped(scheduling: Scheduling, motion: Motion) -> Iterator[Named]:
    """Yield the motion shaped for the first mode, for both lowest ones, and between them, at the posture's frequencies.

    One ZVD at the root of the product of two close frequencies nearly acts like the shaper for both.
    """
    along = np.linspace(scheduling.places.min(), scheduling.places.max(), 101)
    first, second = scheduling.frequencies(along)

    def alpha(time: np.ndarray) -> np.ndarray:
        return scheduling.path.alpha(motion(time)[0])

    def frequency(mode: Float[np.ndarray, "K"]) -> Callable[[np.ndarray], np.ndarray]:
        return lambda at: np.interp(at, along, mode)

    each = {shaper.name: shaper for shaper in shapers()}
    for name, steps in {
        **{name: ((shaper, frequency(first)),) for name, shaper in each.items()},
        "ZV x ZV": ((each["ZV"], frequency(first)), (each["ZV"], frequency(second))),
        "mid-mode ZVD": ((each["ZVD"], frequency(np.sqrt(first * second))),),
    }.items():
        time, shaped_alpha = shaped(alpha, motion.arrival, steps)
        even = np.linspace(0.0, time[-1], 1 + int(np.ceil(time[-1] * RATE)))
        angles = scheduling.path.angles(np.interp(even, time, shaped_alpha))
        yield f"{name} shaper", "shaper", replay(even, angles, name=name)


def _bands(scheduling: Scheduling, basis: Basis) -> Float[np.ndarray, "3 2 K"]:
    """Return quantiles over the draws of the two lowest frequencies along the path [Hz]."""
    along, draws = np.linspace(*scheduling.path.ends, ALONG), basis.draws or {}
    count = len(next(iter(draws.values()), [0]))
    arms = (basis.arm.replace({path: float(x[k]) for path, x in draws.items()}) for k in range(count))
    return np.quantile([scheduling.frequencies(along, arm) for arm in arms], (0.05, 0.5, 0.95), axis=0)


def _verified(
    basis: Basis, scheduling: Scheduling, motion: Motion, whole: Superposition, fresh: Draws, wanted: Wanted
) -> MotionVerification:
    """Simulate a motion by fresh draws, and by the exact equations with the worst phases, after arrival or ever."""
    each, held, keeps, settled, ready = scheduling.evaluator, motion.dwell(scheduling.dwell), None, None, None
    first = 0 if np.isfinite(wanted.limit) else int(np.searchsorted(whole.time, motion.arrival - 1e-9))
    excited = each.arm.replace(whole.worst_phases(first)) if whole.unknown else each.arm
    response = exact_response(replace(each, arm=excited, motion=held, rate=2 * RATE))
    if wanted.settled is not None:
        settled = float(settling_time(response, wanted.settled)[list(wanted.ways)].max())
    if fresh and wanted.settled is not None:
        peaks, times = _drawn(basis, scheduling, wanted, motion, fresh)
        keeps, ready = binomial_estimate(peaks <= wanted.limit), tolerance_limit(np.asarray(times))
    elif fresh:
        drawn = replace(each, motion=held, draws=fresh, unknown=())
        keeps = keeping(drawn, np.zeros(0), wanted.limit)[1]
    spans = slack(response.time, belt_tension(response))
    belts = tuple(sorted({excited.belts[number].name for number, *_ in spans}))
    tool = 2 * RATE * float(np.linalg.norm(np.diff(np.asarray(response.path), axis=1), axis=0).max())
    return MotionVerification(float(np.max(peak(response.vibration))), keeps, belts, settled, ready, tool)
