"""From a table of runs to the sources of an arm, their certainty, and the prediction of other runs."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from jaxtyping import Complex, Float
from scipy.stats import chi2

from ident.arm.arm import Arm, stiffness_paths
from ident.arm.chain import Loads
from ident.arm.multibody import IMBALANCE, ExcitingOrder, possible_orders, refuse_moments
from ident.arm.plausibility import reach_of
from ident.errors import InputError, placed, refusal
from ident.identify.binding import loads_of
from ident.measure import Log, read_log
from ident.measure.runs import RunRow, Runs, Trace
from ident.vibrate.clock import Clock, find_clock
from ident.vibrate.motion import Motion, beyond_limits, stroke
from ident.vibrate.replay import replay
from ident.vibrate.source_causes import Causes, check_peak, compared
from ident.vibrate.source_identification import (
    LAGS,
    Identification,
    clock_offsets,
    explained,
    gain,
    identified,
    least_told,
    with_further,
)
from ident.vibrate.source_problem import CLOCK_SD, LEVEL, Channel, Prior, SourceProblem, Trial, slow_columns
from ident.vibrate.triage import MovingTrace
from ident.vibrate.unit_response import UNITS, Run, Sensor, masses_of

RARE = 1e-3
"""Probability of a test below which runs contradict each other; assumed."""
TURNS = 20.0
"""Least number of turns of the fastest pulley common to a trace and its motion; assumed."""
LONGEST_DWELL = 5.0
"""Time [s] after arrival up to which a trace counts: the vibration has mostly decayed by then; assumed."""
GAINS = (0.5, 1.5)
"""Range of the gain, the share of the computed vibration in the measured one; outside, the model is not that of the
run. Noise alone does not shift the gain; assumed."""
COMMON = 0.5
"""Common share of a trace and of its motion below which a note is printed; assumed."""
FARTHEST = 4.0
"""Prior standard deviations by which a stiffness, a damping, a clock's rate or a direction may shift; assumed."""
MISSED = 0.2
"""Share of a left-out run's mean square by which its prediction may be wrong beyond noise; assumed."""
RATES = np.linspace(-5e-3, 5e-3, 21)
"""Relative clock errors tried if a left-out run is not predicted; assumed."""
CLOCK = 0.05
"""Clock error [s] if none is fitted; assumed."""
LARGEST = 0.05
"""Largest vibration of an arm, as a share of its reach; above it, suspect a wrong unit; assumed."""
QUICKEST = 25.0
"""Highest frequency [Hz] that drives excite, which bounds velocity and acceleration, too; assumed."""
FURTHER = (5.0, 7.0, 10.0, 14.0, 20.0)
"""Speeds [%] of the runs that are tried if some source is not determined; assumed."""
TESTED = 100
"""Draws for the prediction of a run."""

HEAVIEST = (0.01, 20.0, 0.05)
"""Largest imbalance of a trial mass: in kg m, as a multiple of the drive's own, and as an eccentricity [m] of its
eccentric mass; the largest of the three counts; assumed."""
CONTRADICTED = 0.01
"""Probability below which a trial mass does not act as stated, or trial masses contradict each other; assumed."""
NEAR = 0.05
"""Deviation of a trial mass's factor that counts as none: the correction would leave this share; assumed."""
TOLD_WITHIN = 0.25
"""Half width of a trial mass's 95 % region above which acting as stated verifies nothing: this share of the imbalance
could remain; assumed."""


@dataclass(frozen=True)
class Prediction:
    """A left-out run with its prediction.

    Attributes:
        run: its name.
        channel: its sensor channel.
        shown: (T,) [SI] measured, without the slow part.
        computed: (T,) [SI] predicted, without the slow part.
        peaks: (D,) [SI] largest magnitude with each of some draws of the sources, all else at the estimate.
        noise: [SI^2] mean square that the used runs leave unexplained, at most.
        rate: relative clock error with which the run would be predicted; 0 for none.
    """

    run: str
    channel: Channel
    shown: Float[np.ndarray, "T"]
    computed: Float[np.ndarray, "T"]
    peaks: Float[np.ndarray, "D"]
    noise: float = 0.0
    rate: float = 0.0

    @property
    def missed(self) -> float:
        """Share of the measured mean square by which the prediction is wrong, beyond noise."""
        return float((np.mean((self.shown - self.computed) ** 2) - self.noise) / np.mean(self.shown**2))

    @property
    def explained(self) -> float:
        """See `source_identification.explained`."""
        return explained(self.shown, self.computed)

    @property
    def gain(self) -> float:
        """See `source_identification.gain`."""
        return gain(self.shown, self.computed)

    @property
    def ratio(self) -> float:
        """Ratio of predicted to measured root mean square."""
        return float(np.linalg.norm(self.computed) / np.linalg.norm(self.shown))


@dataclass(frozen=True)
class Tried:
    """Effect of a mass that was added to a drive for a run: a trial mass, or a mounted correction.

    Attributes:
        run: its name.
        drive: name of the drive.
        stated: [kg m] its imbalance in the table of runs.
        factor: of its effect: 1 if table and model are right.
        draws: (D,) of the factor.
    """

    run: str
    drive: str
    stated: complex
    factor: complex
    draws: Complex[np.ndarray, "D"]

    @property
    def sd(self) -> tuple[float, float]:
        """Standard deviation of the factor's magnitude [-], and of its angle [rad]."""
        off = self.draws / self.factor
        return float(abs(self.factor) * off.real.std()), float(off.imag.std())

    @property
    def chance(self) -> float:
        """Probability of such a deviation of the factor from 1 by chance."""
        off = np.array([self.factor.real - 1, self.factor.imag])
        return float(chi2.sf(off @ np.linalg.solve(self._covariance, off), 2))

    @cached_property
    def _covariance(self) -> Float[np.ndarray, "2 2"]:
        """Covariance of the factor's real and imaginary part; regular for two draws, too."""
        return np.cov(self.draws.real, self.draws.imag, bias=True) + 1e-12 * np.eye(2)

    @property
    def spread(self) -> float:
        """Largest standard deviation of the factor over all directions in the complex plane."""
        return float(np.sqrt(np.linalg.eigvalsh(self._covariance)[-1]))

    @property
    def too_light(self) -> float:
        """Factor by which it is too light to show within `TOLD_WITHIN` how it acts: the error falls with its mass."""
        return self.spread * float(np.sqrt(chi2.isf(0.05, 2))) / TOLD_WITHIN

    @property
    def told(self) -> bool:
        """Whether it is informative: it does not act as stated, or it does within `TOLD_WITHIN`."""
        return self.chance <= CONTRADICTED or self.too_light < 1

    @property
    def right(self) -> bool:
        """Whether it demonstrably acts as stated."""
        return self.told and (abs(self.factor - 1) < NEAR or self.chance > CONTRADICTED)


@dataclass(frozen=True)
class SourceStudy:
    """The sources of an arm, and the prediction of left-out runs.

    Attributes:
        found: the identified numbers.
        held: predictions of the left-out runs.
        known: whether stiffnesses come from a posterior.
        further: standard deviations [units] of the sources' amplitudes with a further run, by its speed [%]; empty if
            all are determined, or the arm has no stroke.
        causes: possible causes of the queried peak.
    """

    found: Identification
    held: tuple[Prediction, ...]
    known: bool
    further: Mapping[float, Float[np.ndarray, "S"]] = field(default_factory=dict)
    causes: Causes | None = None

    @property
    def next_run(self) -> tuple[float, list[ExcitingOrder]]:
        """Speed [%] of the most informative further run, and the sources that it would determine; 0 for none."""
        hidden = [(k, each) for k, each in enumerate(self.found.estimates) if not each.told]

        def told(speed: float) -> list[ExcitingOrder]:
            return [each.source for k, each in hidden if each.amplitude > least_told(self.further[speed][k])]

        def worth(speed: float) -> tuple[int, float]:
            return len(told(speed)), -sum(float(self.further[speed][k]) / each.amplitude for k, each in hidden)

        best = max(self.further, key=worth, default=0.0)
        return (best, told(best)) if best and told(best) else (0.0, [])

    def tried(self, count: int = TESTED, seed: int = 0) -> list[Tried]:
        """Return the effects of masses that were added for runs, with draws."""
        problem, factors = self.found.problem, self.found.place.factors @ (1, 1j)
        if not problem.trials:
            return []
        drawn, every = self.found.factors(count, seed) @ (1, 1j), list[Tried]()
        for k, trial in enumerate(problem.trials):
            drive = problem.sources[trial.source].drive
            stated = complex(*trial.parts) * problem.masses[drive] * UNITS[IMBALANCE]
            every.append(Tried(problem.runs[trial.run].name, drive, stated, complex(factors[k]), drawn[:, k]))
        return every

    @property
    def told(self) -> int:
        """Number of sources that the runs determine."""
        return sum(each.told for each in self.found.estimates)

    @property
    def moved(self) -> dict[str, float]:
        """Numbers that the runs shift by more than `FARTHEST` prior standard deviations."""
        return {name: shift for name, shift in self.found.moved.items() if abs(shift) > FARTHEST}

    @property
    def contradicting(self) -> list[ExcitingOrder]:
        """Sources for which the single runs give contradicting estimates."""
        pairs = zip(self.found.problem.sources, self.found.agreement.tolist(), strict=True)
        return [source for source, chance in pairs if chance < RARE / len(self.found.problem.sources)]

    @property
    def poor(self) -> dict[str, float]:
        """Gains of the channels that do not follow the computed vibration, by name."""
        pairs = zip([channel.name for channel in self.found.problem.channels], self.found.gain.tolist(), strict=True)
        return {name: share for name, share in pairs if not GAINS[0] < share < GAINS[1]}

    @property
    def astray(self) -> tuple[Prediction, ...]:
        """Left-out traces with a failed prediction."""
        return tuple(each for each in self.held if each.missed > MISSED)

    @property
    def doubtful(self) -> bool:
        """Whether the runs contradict each other or the model, or their result fails to predict another run."""
        return bool(self.moved or self.contradicting or self.poor or self.astray)

    @property
    def usable(self) -> bool:
        """Whether its estimates may be used."""
        return self.found.settled and not self.doubtful


def studied(
    arm: Arm,
    table: Runs,
    draws: Mapping[str, Float[np.ndarray, "D"]],
    *,
    offset: float,
    hold_out: Sequence[str] = (),
    peak: float | None = None,
    teeth: Mapping[str, float] | None = None,
    calibration: float = 0.0,
    progress: Any = iter,
) -> SourceStudy:
    """Identify the sources of an arm from a table of runs, and predict the left-out ones.

    Args:
        arm: the arm.
        table: the runs.
        draws: of its stiffnesses, by path; empty without a posterior.
        offset: [s] largest clock error.
        hold_out: files of the runs to predict.
        peak: frequency [Hz] of a peak whose cause is to be found.
        teeth: of the belts' driving pulleys, by the belt's name.
        calibration: standard deviation of the relative error of each sensor's calibration.
        progress: shows the progress of the search.

    Raises:
        InputError: a run that is missing, does not match the arm, or has too few turns; clocks beyond the offset.
    """
    for name in hold_out:
        if name not in table.names:
            raise refusal("hold_out", name, f"one of {', '.join(table.names)}", "correct it")
    used = [name for name in table.names if name not in hold_out]
    if not used:
        raise refusal("hold_out", "all runs held out", "at least one to identify with", "keep one")
    for name in hold_out:
        _same_group(table, name, used)
    prior = Prior.of(arm, draws)
    problem = replace(posed(arm, table, used, prior, offset=offset), calibration=calibration)
    for name in hold_out:
        _posed(arm, table, [name], prior, offset)
    if peak is not None or teeth:
        check_peak(problem, peak, teeth or {})
    found = identified(problem, progress)
    for run, (clock, _) in zip(problem.runs, found.place.clock.tolist(), strict=True):
        if abs(clock) > offset * (1 - 1e-9):
            raise _late(run.name, clock, offset)
    if not SourceStudy(found, (), True).usable:
        _refuse_late(arm, table, used, offset)
    held = [prediction for name in hold_out for prediction in _predicted(found, table, name, used)]
    known = all(path in draws for path in stiffness_paths(arm))
    first, rate, further = problem.runs[0], min(channel.rate for channel in problem.channels), dict[float, Run]()
    if arm.stroke is not None:
        further = {speed: replace(first, motion=stroke(arm.stroke, percent=speed, dwell=1.0)) for speed in FURTHER}
    hidden = not all(each.told for each in found.estimates)
    tells = {speed: with_further(found, run, rate) for speed, run in further.items()} if hidden else {}
    causes = None
    if peak is not None:
        causes = compared(problem, found.place, found.covariance, peak, teeth=teeth, further=further)
    return SourceStudy(found, tuple(held), known, tells, causes)


def _refuse_late(arm: Arm, table: Runs, names: Sequence[str], offset: float) -> None:
    """Refuse a run if its trace shows a clock beyond the offset, though the table states its delay."""
    for name in (name for name in names if table.of(name)[0].row.delay is not None):
        try:
            clock = _clock(arm, table, name)
        except InputError:  # its trace does not show it
            continue
        if abs(clock.offset) > offset:
            raise _late(name, clock.offset, offset)


def with_clocks(arm: Arm, table: Runs, offset: float = CLOCK) -> Runs:
    """Return runs with the times of their motion, where the table states no delay and the clock is beyond the offset.

    Raises:
        InputError: a clock that its trace does not show, see `find_clock`.
    """
    unknown = [name for name in table.names if table.of(name)[0].row.delay is None]
    every = {name: _clock(arm, table, name) for name in unknown}
    clocks = {name: clock for name, clock in every.items() if abs(clock.offset) > offset}
    traces = [
        replace(own, time=clocks[own.row.file].on_motion(own.time)) if own.row.file in clocks else own
        for own in table.traces
    ]
    return replace(table, traces=tuple(traces), clocks=clocks)


def _clock(arm: Arm, table: Runs, name: str) -> Clock:
    traces = _from_start(arm, table, table.of(name))
    sensors = tuple(_sensor(arm, each) for each in traces)
    run = Run(name, _motion(arm, table, traces), _loads(arm, traces), sensors)
    with placed(traces[0].row.where):
        clock = find_clock(arm, run, [(each.time, each.values) for each in traces])
    return clock._replace(middle=clock.middle + _first(arm, table, traces[0].row))


def _late(name: str, clock: float, offset: float) -> InputError:
    got, remedy = f"a clock {1e3 * clock:.0f} ms off the motion's", "check delay and speed, or allow more (`offset`)"
    return refusal(name, got, f"at most {1e3 * offset:.0f} ms", remedy)


def moving_traces(arm: Arm, table: Runs) -> list[MovingTrace]:
    """Return the traces of a table, each with its motion."""
    problem = _posed(arm, table, table.names, Prior.of(arm, {}), CLOCK)
    runs = [problem.runs[each.run] for each in problem.channels]
    each = zip(problem.channels, runs, strict=True)
    return [MovingTrace(own.time, own.values, run.motion, run.loads) for own, run in each]


def with_notes(arm: Arm, table: Runs) -> Runs:
    """Return runs with notes: found clocks, repairs of logs, traces that share little time with their motion."""
    notes = list[str]()
    for name in table.names:
        traces = _from_start(arm, table, table.of(name))
        notes += [f"{name}: clock found from the motion, {table.clocks[name]}"] if name in table.clocks else ()
        row, motion, (start, end) = traces[0].row, _motion(arm, table, traces), traces[0].time[[0, -1]].tolist()
        notes += _log(arm, table, row.path).notes if row.path else ()
        common = min(end, float(motion.breaks[-1])) - max(start, 0.0)
        if common < COMMON * max(end - start, motion.arrival):
            got = f"{common:.3g} of its {end - start:.3g} s are within the motion, which takes {motion.arrival:.3g} s"
            notes.append(f"{row.where}, {name}: {got}: check speed, path and delay")
    return replace(table, notes=tuple(notes))


def _loads(arm: Arm, traces: Sequence[Trace]) -> Loads:
    with placed(traces[0].row.where):
        refuse_moments(loads := loads_of(arm, traces[0].row.load))
    return loads


def posed(
    arm: Arm, table: Runs, names: Sequence[str] = (), prior: Prior | None = None, *, offset: float
) -> SourceProblem:
    """Return runs as a problem; all runs of the table if none are named.

    Raises:
        InputError: see `studied`; an arm that no drive excites.
    """
    used = list(names or table.names)
    problem = _posed(arm, table, used, prior or Prior.of(arm, {}), offset)
    for name in used:
        _refuse_alone(table, name, used)
    return problem


def _posed(arm: Arm, table: Runs, names: Sequence[str], prior: Prior, offset: float) -> SourceProblem:
    """Return runs as a problem."""
    if not arm.drives:
        raise refusal(arm.name, "no drive", "drives that excite the arm", "add its [[drive]]")
    runs, channels = [], []
    for number, name in enumerate(names):
        traces = _from_start(arm, table, table.of(name))
        motion = _motion(arm, table, traces)
        runs.append(Run(name, motion, _loads(arm, traces), tuple(_sensor(arm, each) for each in traces)))
        for sensor, trace in enumerate(traces):
            channels.append(_channel(arm, trace, motion, number, sensor, offset))
    words = [table.of(name)[0].row.group or name for name in names]
    order = list(dict.fromkeys(words))
    groups = tuple(order.index(word) for word in words)
    sources, trials = tuple(possible_orders(arm)), list[Trial]()
    for number, name in enumerate(names):
        trials += _trials(arm, sources, number, table.of(name)[0].row)
    return SourceProblem(arm, tuple(runs), groups, tuple(channels), sources, prior, offset, tuple(trials))


def _trials(arm: Arm, sources: Sequence[ExcitingOrder], run: int, row: RunRow) -> Iterator[Trial]:
    """Yield the effect of masses that were added for a run on the imbalance of each drive."""
    masses = masses_of(arm, sources)
    at = {each.drive: k for k, each in enumerate(sources) if each.kind == IMBALANCE}
    if wrong := [each.drive for each in row.trial if each.drive not in at]:
        raise refusal(row.where, wrong[0], f"one of {', '.join(at)}", "name a drive of the arm", "trial")
    for drive in dict.fromkeys(each.drive for each in row.trial):
        added = sum(each.imbalance for each in row.trial if each.drive == drive)
        own = float(arm.get(f"{drive}.eccentric_mass")) * float(arm.get(f"{drive}.eccentricity"))
        if abs(added) > (most := max(HEAVIEST[0], HEAVIEST[1] * own, HEAVIEST[2] * masses[drive])):
            got, remedy = (
                f"an imbalance of {1e6 * abs(added):.4g} g mm on {drive}",
                "check the units of mass and radius",
            )
            raise refusal(row.where, got, f"at most {1e6 * most:.4g} g mm", remedy, "trial")
        parts = added / (masses[drive] * UNITS[IMBALANCE])
        yield Trial(run, at[drive], (parts.real, parts.imag))


def _from_start(arm: Arm, table: Runs, traces: Sequence[Trace]) -> tuple[Trace, ...]:
    """Return traces with times from the start of their motion; a log has the same clock."""
    first = _first(arm, table, traces[0].row)
    return tuple(replace(each, time=each.time - first) for each in traces)


def _first(arm: Arm, table: Runs, row: RunRow) -> float:
    """Return the time [s] at which the motion starts on the clock of its log, if it has one."""
    return float(_log(arm, table, row.path).time[0]) if row.path else 0.0


def unmeasured(arm: Arm, table: Runs, rate: float) -> Runs:
    """Return a table of planned runs with traces of zeros, until a second after arrival.

    Raises:
        InputError: a run that the arm can't make.
    """
    traces = list[Trace]()
    for trace in table.traces:
        time = np.arange(0.0, _motion(arm, table, [trace]).arrival + 1.0, 1 / rate)
        time += _first(arm, table, trace.row)
        traces.append(replace(trace, time=time, values=np.zeros(len(time))))
    return replace(table, traces=tuple(traces))


def _log(arm: Arm, table: Runs, path: str) -> Log:
    return read_log(table.files[path].path, [joint.name for joint in arm.driven])


def _motion(arm: Arm, table: Runs, traces: Sequence[Trace]) -> Motion:
    """Return the motion of the arm, with a dwell to the end of the trace."""
    row = traces[0].row
    if row.path:
        log = _log(arm, table, row.path)
        motion = replay(log.time, np.stack(list(log.angles.values())), name=row.path, arm=arm)
        motion = motion if row.speed is None else motion.at_speed(row.speed)
    elif arm.stroke is None:
        remedy = "give a log of the joints in the column path"
        raise refusal(row.where, "no motion", "a stroke of the arm, or a path", remedy, "path")
    else:
        assert row.speed is not None  # the table has a speed where it has no path
        with placed(row.where, "speed"):
            motion = stroke(arm.stroke, percent=row.speed, retract=row.retract)
    beyond_limits(arm, motion)
    end = max(float(trace.time[-1]) for trace in traces)
    return motion.dwell(min(max(0.0, end - motion.arrival), LONGEST_DWELL))


def _sensor(arm: Arm, trace: Trace) -> Sensor:
    row, names = trace.row, [point.name for point in arm.points]
    if row.point and row.point not in names:
        remedy = "add it to the arm file, or name another"
        raise refusal(row.where, row.point, f"one of {', '.join(names)}", remedy, "point")
    return Sensor(row.point or names[-1], row.direction, row.frame == "body", trace.derivative)


def _channel(arm: Arm, trace: Trace, motion: Motion, run: int, sensor: int, offset: float) -> Channel:
    """Return a trace within its motion for any clock error."""
    margin = offset + 2 * float(trace.time[1] - trace.time[0]) + CLOCK_SD * LEVEL * float(motion.breaks[-1])
    inside = (trace.time > float(motion.breaks[0]) + margin) & (trace.time < float(motion.breaks[-1]) - margin)
    time = trace.time[inside]
    ratios = {drive.joint: abs(float(drive.ratio)) for drive in arm.drives}
    turns = 0.0
    if len(time) > LAGS:
        angles = np.asarray(motion(time)[0])
        way = np.abs(np.diff(angles, axis=1)).sum(1) / (2 * np.pi)
        turns = max(ratios.get(joint.name, 0.0) * w for joint, w in zip(arm.driven, way.tolist(), strict=True))
    if turns < TURNS:
        at = f" at speed {trace.row.speed:g} %" if trace.row.speed else ""
        got = f"{turns:.3g} turns of the fastest pulley in common with the motion{at}"
        remedy = "check delay, speed and path; or measure a longer motion"
        raise refusal(trace.row.where, got, f"at least {TURNS:g}", remedy)
    channel = Channel(f"{trace.row.file} {trace.row.channel}", run, sensor, time, trace.values[inside])
    slow, unit = slow_columns(channel), ("m", "m/s", "m/s^2")[trace.derivative]
    size = float(np.abs(channel.values - slow @ (slow.T @ channel.values)).max())
    most = LARGEST * reach_of(arm) * (2 * np.pi * QUICKEST) ** trace.derivative
    if size > most:
        got, expected = f"a vibration of {size:.3g} {unit} in {channel.name}", f"at most {most:.3g} {unit}"
        raise refusal(trace.row.where, got, f"{expected} of this arm", "check the unit", "unit")
    return channel


def _same_group(table: Runs, name: str, used: Sequence[str]) -> str:
    """Return a used run of the phase group of a left-out one: else its pulleys' phases are unknown."""
    row = table.of(name)[0].row
    same = [other for other in used if row.group and table.of(other)[0].row.group == row.group]
    if not same:
        got = f"a run of group {row.group}" if row.group else "a run of no group"
        remedy = "give it the group of a run that is used: its pulleys' phases are not known else"
        raise refusal(row.where, got, "that of a run which is used", remedy, "group")
    return same[0]


def _refuse_alone(table: Runs, name: str, used: Sequence[str]) -> None:
    """Refuse a trial mass whose group has no run without it: its effect is the difference of both."""
    row = table.of(name)[0].row
    others = [table.of(other)[0].row for other in used if row.group and table.of(other)[0].row.group == row.group]
    for drive in {each.drive for each in row.trial}:
        if all(drive in {each.drive for each in other.trial} for other in others):
            expected = f"a run of the same group without a mass on {drive}"
            raise refusal(row.where, "a trial mass alone", expected, "add one, name its group", "trial")


def _predicted(found: Identification, table: Runs, name: str, used: Sequence[str]) -> "list[Prediction]":
    """Return computed and measured channels of a left-out run, with only its clock fitted."""
    known = found.problem
    group = known.groups[list(used).index(_same_group(table, name, used))]
    own = replace(_posed(known.arm, table, [name], known.prior, known.offset), calibration=known.calibration)
    place = own.start._replace(changes=found.place.changes, parts=found.place.parts[group][None])
    if known.calibration:
        of_sensor = dict(zip(known.measuring, found.place.calibration[list(known.sensors)], strict=True))
        for k, sensor in zip(own.sensors, own.measuring, strict=True):
            place.calibration[k] = of_sensor.get(sensor, 0.0)
    responses, parts = own.responses(place), own.parts_of(0, place)
    place = place._replace(clock=clock_offsets(own, responses, place, parts.ravel())[0])
    places = [place._replace(parts=each.parts[group][None]) for each in found.places(TESTED)]
    drawn = np.stack([own.parts_of(0, each).ravel() for each in places], 1)
    left = {sensor: np.mean(r**2) for sensor, r in zip(known.measuring, found.residual, strict=True)}
    result = []
    for k, channel in enumerate(own.channels):
        slow = slow_columns(channel)
        sure, columns, _ = own.seen(k, responses[0], place)
        every = np.column_stack([channel.values, sure + columns @ parts.ravel(), sure[:, None] + columns @ drawn])
        rest = every - slow @ (slow.T @ every)
        noise = float(left.get(own.measuring[k], max(left.values())))
        result.append(Prediction(name, channel, rest[:, 0], rest[:, 1], np.abs(rest[:, 2:]).max(0), noise))
    if not any(each.missed > MISSED for each in result):
        return result
    further = replace(own, offset=own.offset + RATES[-1] * float(own.runs[0].motion.breaks[-1]) / 2)

    def left_with(rate: float) -> float:
        tried = place._replace(clock=np.array([[0.0, rate]]))
        return float(clock_offsets(further, responses, tried, parts.ravel())[1][0])

    rate = min(RATES.tolist(), key=left_with)
    return [replace(each, rate=rate) for each in result] if left_with(rate) < left_with(0.0) / 2 else result
