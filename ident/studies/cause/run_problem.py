"""From a table of runs to the problem of an arm's sources: motion, load, sensors and added masses of each run."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from ident.arm.arm import Arm
from ident.arm.chain import Loads
from ident.arm.multibody import IMBALANCE, ExcitingOrder, possible_orders, refuse_moments
from ident.arm.sizes import reach_of
from ident.description.file import ArmFile
from ident.errors import InputError, placed, refusal
from ident.identify.binding import loads_of
from ident.measure import Log, read_log
from ident.measure.runs import RunRow, Runs, Trace, read_runs
from ident.measure.samples import Columns
from ident.measure.trace import Trace as SampledTrace
from ident.studies.shared import as_file
from ident.text import one_line
from ident.vibrate.binomial import HALF_WIDTH
from ident.vibrate.clock import Clock, find_clock
from ident.vibrate.motion import QUICKEST, Motion, beyond_limits, stroke
from ident.vibrate.replay import replay
from ident.vibrate.source_problem import CLOCK_SD, LAGS, Channel, Prior, SourceProblem, Trial, slow_columns
from ident.vibrate.unit_response import UNITS, Run, Sensor, masses_of

ARM = "arm.toml"
"""Default arm file, in the folder of the table of runs."""
TURNS = 20.0
"""Least number of turns of the fastest pulley common to a trace and its motion; assumed."""
LONGEST_DWELL = 5.0
"""Time [s] after arrival up to which a trace counts: the vibration has mostly decayed by then; assumed."""
COMMON = 0.5
"""Common share of a trace and of its motion below which a note is printed; assumed."""
CLOCK = 0.05
"""Clock error [s] if none is fitted; assumed."""
LARGEST = 0.05
"""Largest vibration of an arm, as a share of its reach; above it, suspect a wrong unit; assumed."""
HEAVIEST = (0.01, 20.0, 0.05)
"""Largest imbalance of a trial mass: in kg m, as a multiple of the drive's own, and as an eccentricity [m] of its
eccentric mass; the largest of the three counts; assumed."""


def as_runs(runs: Runs | str | Path, columns: Columns) -> Runs:
    """Return a table of runs, read if it is a file; `columns` is as in `ident.read_trace`.

    Raises:
        InputError: an error in the table.
    """
    return runs if isinstance(runs, Runs) else read_runs(runs, columns)


def arm_beside(runs: Runs | SampledTrace, soft_base: float | None) -> ArmFile:
    """Return the arm of a table of runs, or of a trace, from the same folder.

    Raises:
        InputError: no such file, or an error in it.
    """
    path = Path(runs.path).parent / ARM
    if not path.exists():
        raise refusal(one_line(str(path)), "no such file", "the arm of these runs", "name it (`arm`)")
    return as_file(path, soft_base)


def posed(
    arm: Arm, table: Runs, names: Sequence[str] = (), prior: Prior | None = None, *, offset: float
) -> SourceProblem:
    """Return runs as a problem; all runs of the table if none are named.

    Raises:
        InputError: see `studied`; an arm that no drive excites.
    """
    used = list(names or table.names)
    problem = problem_of(arm, table, used, prior or Prior.of(arm, {}), offset)
    for name in used:
        _refuse_alone(table, name, used)
    return problem


def problem_of(arm: Arm, table: Runs, names: Sequence[str], prior: Prior, offset: float) -> SourceProblem:
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


def _loads(arm: Arm, traces: Sequence[Trace]) -> Loads:
    with placed(traces[0].row.where):
        refuse_moments(loads := loads_of(arm, traces[0].row.load))
    return loads


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


def _sensor(arm: Arm, trace: Trace) -> Sensor:
    row, names = trace.row, [point.name for point in arm.points]
    if row.point and row.point not in names:
        remedy = "add it to the arm file, or name another"
        raise refusal(row.where, row.point, f"one of {', '.join(names)}", remedy, "point")
    return Sensor(row.point or names[-1], row.direction, row.frame == "body", trace.derivative)


def _channel(arm: Arm, trace: Trace, motion: Motion, run: int, sensor: int, offset: float) -> Channel:
    """Return a trace within its motion for any clock error."""
    margin = offset + 2 * float(trace.time[1] - trace.time[0]) + CLOCK_SD * HALF_WIDTH * float(motion.breaks[-1])
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
    # as a vibration at the highest frequency, it bounds velocity and acceleration, too
    most = LARGEST * reach_of(arm) * (2 * np.pi * QUICKEST) ** trace.derivative
    if size > most:
        got, expected = f"a vibration of {size:.3g} {unit} in {channel.name}", f"at most {most:.3g} {unit}"
        raise refusal(trace.row.where, got, f"{expected} of this arm", "check the unit", "unit")
    return channel


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


def _log(arm: Arm, table: Runs, path: str) -> Log:
    if path in table.logs:
        return table.logs[path]
    return read_log(table.files[path].path, [joint.name for joint in arm.driven], table.columns)


def _from_start(arm: Arm, table: Runs, traces: Sequence[Trace]) -> tuple[Trace, ...]:
    """Return traces with times from the start of their motion; a log has the same clock."""
    first = _first(arm, table, traces[0].row)
    return tuple(replace(each, time=each.time - first) for each in traces)


def _first(arm: Arm, table: Runs, row: RunRow) -> float:
    """Return the time [s] at which the motion starts on the clock of its log, if it has one."""
    return float(_log(arm, table, row.path).time[0]) if row.path else 0.0


def _refuse_alone(table: Runs, name: str, used: Sequence[str]) -> None:
    """Refuse a trial mass whose group has no run without it: its effect is the difference of both."""
    row = table.of(name)[0].row
    others = [table.of(other)[0].row for other in used if row.group and table.of(other)[0].row.group == row.group]
    for drive in {each.drive for each in row.trial}:
        if all(drive in {each.drive for each in other.trial} for other in others):
            expected = f"a run of the same group without a mass on {drive}"
            raise refusal(row.where, "a trial mass alone", expected, "add one, name its group", "trial")


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


def with_clocks(arm: Arm, table: Runs, offset: float = CLOCK) -> Runs:
    """Return runs with the times of their motion, where the table states no delay and the clock is beyond the offset.

    Raises:
        InputError: the traces do not show the clock of a log's motion, see `find_clock`; of a stroke this is a note.
    """
    clocks, notes = dict[str, Clock](), list(table.notes)
    for name in table.names:
        row = table.of(name)[0].row
        if row.delay is not None:
            continue
        try:
            clock = clock_of(arm, table, name)
        except InputError as error:
            if row.path:
                raise
            notes.append(f"{name}: taken as on the motion's clock, for its traces show {error.problems[0].got}")
            continue
        if abs(clock.offset) > offset:
            clocks[name] = clock
            notes.append(f"{name}: clock found from the motion, {clock}")
    traces = [
        replace(own, time=clocks[own.row.file].on_motion(own.time)) if own.row.file in clocks else own
        for own in table.traces
    ]
    return replace(table, traces=tuple(traces), clocks=clocks, notes=tuple(notes))


def clock_of(arm: Arm, table: Runs, name: str) -> Clock:
    """Return the clock of a run's recorder as its traces show it.

    Raises:
        InputError: they don't, see `find_clock`.
    """
    traces = _from_start(arm, table, table.of(name))
    sensors = tuple(_sensor(arm, each) for each in traces)
    run = Run(name, _motion(arm, table, traces), _loads(arm, traces), sensors)
    with placed(traces[0].row.where):
        clock = find_clock(arm, run, [(each.time, each.values) for each in traces])
    return clock._replace(middle=clock.middle + _first(arm, table, traces[0].row))


def with_notes(arm: Arm, table: Runs) -> Runs:
    """Return runs with notes: repairs of logs, and traces that share little time with their motion."""
    notes = list(table.notes)
    for name in table.names:
        traces = _from_start(arm, table, table.of(name))
        row, motion, (start, end) = traces[0].row, _motion(arm, table, traces), traces[0].time[[0, -1]].tolist()
        notes += _log(arm, table, row.path).notes if row.path else ()
        common = min(end, float(motion.breaks[-1])) - max(start, 0.0)
        if common < COMMON * max(end - start, motion.arrival):
            got = f"{common:.3g} of its {end - start:.3g} s are within the motion, which takes {motion.arrival:.3g} s"
            notes.append(f"{row.where}, {name}: {got}: check speed, path and delay")
    return replace(table, notes=tuple(notes))
