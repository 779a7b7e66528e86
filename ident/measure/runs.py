"""The table of runs: the motion of each recording, and quantity, point and direction of each of its channels."""

import hashlib
import re
from cmath import rect
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from ident.errors import Problem, noted, refusal, refuse, require
from ident.measure.channels import FRAMES, RECORDED, RecordedChannel, check_new, note_of, recordings_of, write_blank
from ident.measure.columns import ABOVE_0, Number, Row, Rule, Word, read_rows
from ident.measure.grade import clipped
from ident.measure.load import AXES, Load, Vector, parse_direction
from ident.measure.log import Log
from ident.measure.recordings import Channel, read_recording
from ident.measure.recordings.recording import SourceFile
from ident.measure.samples import NONE, Columns
from ident.measure.table import Findings, parse_number, read_table
from ident.measure.trace import Trace as SampledTrace
from ident.text import NAME, did_you_mean, one_line, quoted
from ident.units import to_si

QUANTITIES = {"displacement": "length", "velocity": "velocity", "acceleration": "acceleration"}
"""Quantities that a channel may measure, in order of differentiation of a displacement."""
COMMENTS = (
    "A row for each channel that counts: point (default: the end point), direction (x, -z, 0 0.6 -0.8), frame (base or",
    "body), unit (mm, m/s, m/s^2, g_0; or that of the file), sensitivity (numbers of the file for one unit); how the",
    "arm moved: speed [%] of the stroke, or path (a log with time [s], joint1 [deg], ...), retract (yes or no), load",
    "(glass + 0.2 kg @ tip); delay [s] to add to the file's times, so that motion (or log) starts at 0; blank: found;",
    "group: runs of one group have kept the pulleys' angles between them; trial: masses added to drives for this run,",
    "12 g @ drive2 40 mm 90 deg + ... (radius; angle about the joint's axis at joint angle 0). Displacements and",
    "velocities are of the vibration alone, accelerations have the motion itself in them, and gravity. Rows without",
    "direction are left out.",
)
RATE = 250.0
"""Sampling rate [Hz] to which faster recordings are reduced: drives excite below 25 Hz."""
MOST_ROWS = 100
"""Traces at most: the search holds some 20 MB for each."""
FASTEST = 200.0
"""Speed [%] at most: an override may exceed the file's full speed, a typing error exceeds it by more; assumed."""
SLOWEST = 50.0
"""Lowest sampling rate [Hz]: six samples per period at 8 Hz."""
SHORTEST = 0.125
"""Least duration [s] of a record: one period at 8 Hz."""
_PART = r"([+-]?[0-9.,]+(?:[eE][+-]?[0-9]+)?)\s*([^\W\d_]+)"
_TRIAL = re.compile(rf"{_PART}\s*@\s*({NAME})\s+{_PART}\s+{_PART}")
"""A mass on a drive, as `12 g @ drive2 40 mm 90 deg`."""


@dataclass(frozen=True)
class TrialMass:
    """A mass on a drive's pulley, for a trial run or as a balance correction.

    Attributes:
        drive: its name.
        mass: [kg]
        radius: [m] of its mass centre from the axis.
        angle: [rad] about the joint's axis at joint angle 0, from the origin of the imbalance phases.
    """

    drive: str
    mass: float
    radius: float
    angle: float

    @property
    def imbalance(self) -> complex:
        """Mass times radius [kg m], its argument the angle."""
        return rect(self.mass * self.radius, self.angle)

    @classmethod
    def parse(cls, text: str, decimal: str = ".") -> "tuple[TrialMass, ...]":
        """Read masses such as `12 g @ drive2 40 mm 90 deg + 5 g @ drive3 30 mm -20 deg`; none of a blank text.

        Raises:
            InputError: the text does not follow the syntax.
        """
        found = []
        for term in filter(None, " ".join(text.split()).split(" + ")):
            expected, remedy = "terms like '12 g @ drive2 40 mm 90 deg', joined by ' + '", "correct it"
            if not (match := _TRIAL.fullmatch(term)):
                raise refusal("", quoted(term), expected, remedy)
            mass, of_mass, drive, radius, of_radius, angle, of_angle = match.groups()
            pairs = (mass, of_mass, "mass"), (radius, of_radius, "length"), (angle, of_angle, "angle")
            sizes = [to_si(parse_number(number, decimal), unit, quantity) for number, unit, quantity in pairs]
            require(min(sizes[:2]) > 0, "", quoted(term), "a mass and a radius above 0", remedy)
            found.append(cls(drive, *sizes))
        return tuple(found)


@dataclass(frozen=True, kw_only=True)
class RunRow(RecordedChannel):
    """One channel during a run; without a point it is the end point.

    Attributes:
        direction: (3,) [-] of the measured motion.
        speed: [%] of full speed, or of a path's own; None for a path's own.
        path: file of a joint log, in the table's folder; empty for the arm's stroke.
        retract: whether the stroke goes from unfolded to folded.
        delay: [s] added to the file's times, so that the motion, or the clock of its log, starts at 0; None if the
            table does not state it.
        group: runs of one group share the pulleys' angles; empty for a group of its own.
        trial: masses on the drives during this run.
    """

    direction: Vector
    speed: float | None = None
    path: str = ""
    retract: bool = False
    delay: float | None = None
    group: str = ""
    trial: tuple[TrialMass, ...] = ()

    @property
    def motion(self) -> tuple[Any, ...]:
        """The arm's motion, which all rows of a file must share."""
        return self.speed, self.path, self.retract, self.load, self.delay, self.group, self.trial


POSITIVE = Number("a number above 0", least=ABOVE_0)
SPEED = Number(f"a number above 0, at most {FASTEST:g} % of full speed", least=ABOVE_0, most=FASTEST)
SAY_UNIT = "leave its unit out, and say it in the column unit"
RULES = (
    *RECORDED,
    Rule("point"),
    Rule("direction", parse_direction, required=True),
    Rule("frame", Word(FRAMES), FRAMES[0]),
    Rule("unit"),
    Rule("sensitivity", POSITIVE, None, unit_is=("numbers of the file for one unit", SAY_UNIT)),
    Rule("speed", SPEED, None, unit="%", unit_is=("% of full speed", "convert it")),
    Rule("path"),
    Rule("retract", Word(("no", "yes")), "no"),
    Rule("load", Load.parse),
    Rule("delay", parse_number, None, quantities=("time",), unit="s"),
    Rule("group"),
    Rule("trial", TrialMass.parse),
    Rule("note"),
)
"""Rules of the columns."""
COLUMNS = tuple(rule.name for rule in RULES)
HEAD = tuple(f"{rule.name} [{rule.unit}]" if rule.unit else rule.name for rule in RULES)
"""Header of a table to fill in."""


@dataclass(frozen=True)
class Trace:
    """Samples of a channel, in SI.

    Attributes:
        row: of the table.
        derivative: 0 for displacement, 1 for velocity, 2 for acceleration.
        time: (T,) [s] from the start of the motion, by the recorder's clock.
        values: (T,) [SI]
    """

    row: RunRow
    derivative: int
    time: Float[np.ndarray, "T"]
    values: Float[np.ndarray, "T"]


@dataclass(frozen=True)
class Runs:
    """Traces of the moving arm.

    Attributes:
        path: the table's file.
        sha256: hash of its bytes.
        traces: in the order of the table.
        files: the recordings and logs, by name.
        notes: remarks on them.
        columns: headers by names of the files, for what these do not say themselves.
        logs: joint logs that were given as values, by the name in the column path.
        clocks: found clocks (`vibrate.clock.Clock`) by which times were corrected, by the recording's name.
    """

    path: str
    sha256: str
    traces: tuple[Trace, ...]
    files: Mapping[str, SourceFile]
    notes: tuple[str, ...] = ()
    columns: Columns = field(default_factory=dict)
    logs: Mapping[str, Log] = field(default_factory=dict)
    clocks: Mapping[str, Any] = field(default_factory=dict)

    def of(self, file: str) -> tuple[Trace, ...]:
        """Return the traces of one file."""
        return tuple(trace for trace in self.traces if trace.row.file == file)

    @property
    def name(self) -> str:
        """Name of the table's file, without its ending."""
        return Path(self.path).stem

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the recordings."""
        return tuple(dict.fromkeys(trace.row.file for trace in self.traces))


def read_runs(path: str | Path, columns: Columns = NONE) -> Runs:
    """Read a table of runs and the recordings that it names.

    Args:
        path: the table.
        columns: see `read_recording`.

    Raises:
        InputError: a file is unreadable or has errors; all are listed.
    """
    data, findings = read_table(path), Findings()
    rows = _rows(data, path)
    folder, files, traces, notes = Path(path).parent, dict[str, SourceFile](), list[Trace](), list[str]()
    for name in dict.fromkeys(row.file for row in rows):
        with noted(findings):
            recording = read_recording(folder / name, columns)
            notes += recording.remarks
            files[name] = SourceFile(recording.path, recording.sha256)
            by_name = {channel.name: channel for channel in recording.channels}
            own = [findings.attempt(row.where, "", _trace, row, by_name) for row in rows if row.file == name]
            traces += filter(None, own)
    files |= _logs(rows, folder, findings)
    refuse(findings)
    return Runs(str(path), hashlib.sha256(data).hexdigest(), tuple(traces), files, tuple(notes), columns)


def runs_of(trace: SampledTrace, log: Log, delay: float | None = None) -> Runs:
    """Return the run of one trace of the end point, in axes of the base, and one log of the joints.

    Args:
        trace: each of its directions is a channel.
        log: the joints' angles meanwhile.
        delay: [s] to add to the trace's times for those of the log; None if unknown.

    Raises:
        InputError: clipped samples, or too low a rate.
    """
    findings, traces, derivative = Findings(), list[Trace](), tuple(QUANTITIES).index(trace.kind)
    file, path, step = Path(trace.path).name or "trace", Path(log.path).name or "log", trace.interval
    for name, values in trace.values.items():
        row = RunRow(where=file, file=file, channel=name, direction=AXES[name], path=path, delay=delay)
        findings.attempt(file, name, _check_record, values, step, file)
        values, slower = _slower(values, step)
        time = (delay or 0.0) + trace.time[0] + slower * np.arange(len(values))
        traces.append(Trace(row, derivative, time, values))
    refuse(findings)
    files = {path: SourceFile(log.path, log.sha256)}
    return Runs(trace.path, trace.sha256, tuple(traces), files, trace.notes, logs={path: log})


def planned_runs(path: str | Path) -> Runs:
    """Read a table of planned runs: each trace is two zeros, a second apart.

    Raises:
        InputError: the table or a joint log is unreadable or has errors, such as a missing unit.
    """
    data, findings = read_table(path), Findings()
    rows = _rows(data, path)
    derivatives = [findings.attempt(row.where, "", _measured, row, "") for row in rows]
    files = dict(_logs(rows, Path(path).parent, findings))
    refuse(findings)
    times, zeros = np.array([0.0, 1.0]), np.zeros(2)
    traces = [Trace(row, each[0], times, zeros) for row, each in zip(rows, derivatives, strict=True) if each]
    return Runs(str(path), hashlib.sha256(data).hexdigest(), tuple(traces), files)


def _logs(rows: list[RunRow], folder: Path, findings: Findings) -> Iterator[tuple[str, SourceFile]]:
    """Yield the joint logs by name."""
    for name in dict.fromkeys(row.path for row in rows if row.path):
        data = findings.attempt(name, "", read_table, folder / name)
        if data is not None:
            yield name, SourceFile(str(folder / name), hashlib.sha256(data).hexdigest())


def _rows(data: bytes, path: str | Path) -> list[RunRow]:
    findings = Findings()
    needed = "channel", "see `ident source --init`, which writes one to fill in"
    table = read_rows(data, path, RULES, findings, f"one of {', '.join(HEAD)}", *needed)
    table = [row for row in table if row["direction"]]
    rows = [row for row in map(_row, table) if row]
    findings += [*(problem for row in table for problem in row.problems), *_unequal(rows)]
    file = one_line(str(path))
    if len(rows) > MOST_ROWS:
        remedy = "leave the direction of others blank, or split the table"
        findings.append(Problem(file, f"{len(rows)} rows with a direction", f"at most {MOST_ROWS}", remedy))
    if not rows and not findings:
        findings.append(Problem(file, "no row with a direction", "at least one", "fill in the column direction"))
    refuse(findings)
    return rows


def _row(row: Row) -> RunRow | None:
    """Return the run row; None if it has an error."""
    said = row.values(RULES)
    said["retract"] = said["retract"] == "yes"
    del said["note"]
    return None if row.problems else RunRow(where=row.where, **said)


def _unequal(rows: list[RunRow]) -> Iterator[Problem]:
    """Yield rows whose motion differs from that of the file's first row, or that repeat a channel."""
    first: dict[str, RunRow] = {}
    seen: set[tuple[str, str]] = set()
    for row in rows:
        if row.motion != first.setdefault(row.file, row).motion:
            got, expected = f"another motion of {quoted(row.file)}", f"that of {first[row.file].where}"
            remedy = "give all rows of a file the same speed, path, retract, load, delay, group and trial"
            yield Problem(row.where, got, expected, remedy)
        if (row.file, row.channel) in seen:
            got = f"{quoted(row.channel)} of {quoted(row.file)} twice"
            yield Problem(row.where, got, "each channel once", "keep one row", "channel")
        seen.add((row.file, row.channel))
        if row.speed is None and not row.path:
            yield Problem(row.where, "neither speed nor path", "one of them", "say how the arm moved", "speed")
        if row.path and row.retract:
            yield Problem(row.where, "retract beside a path", "one of them", "drop one", "retract")


def _trace(row: RunRow, channels: Mapping[str, Channel]) -> Trace:
    """Return the samples of a row's channel, in SI, at `RATE` at most.

    Raises:
        InputError: the channel is missing, has no unit or clock, gaps, clipped samples, or too low a rate.
    """
    channel = channels.get(row.channel)
    if channel is None:
        names = tuple(channels)
        remedy = did_you_mean(row.channel, names, "name one of them")
        raise refusal("", quoted(row.channel), f"one of {', '.join(map(one_line, names[:8]))}", remedy, "channel")
    fine = not (channel.flaw or channel.reference or np.iscomplexobj(channel.values) or len(channel.values) != 1)
    got, remedy = channel.flaw or "no single record over time", channel.remedy or "export the time record"
    require(fine, "", got, "samples over time", remedy, "channel")
    if not channel.step:
        raise refusal("", "no sampling rate in the file", "a column 'time [s]'", "export it with its times")
    values = np.asarray(channel.values[0], float)
    derivative, factor = _measured(row, channel.unit)
    _check_record(values, channel.step, one_line(row.file))
    start = channel.start[0] if isinstance(channel.start, tuple) else channel.start
    values, step = _slower(values, channel.step)
    return Trace(row, derivative, (row.delay or 0.0) + start + step * np.arange(len(values)), values * factor)


def _check_record(values: Float[np.ndarray, "T"], step: float, file: str) -> None:
    """Refuse an impossible record; report only the first problem, as it may cause others."""
    rate, duration, missing = 1 / step, len(values) * step, np.count_nonzero(~np.isfinite(values))
    remedy = "cut the record, or export it again"
    require(not missing, "", f"{missing} samples missing", "a record without gaps", remedy, "channel")
    remedy = "check the sensor and its cable, or leave the row out"
    require(np.ptp(values) > 0, "", f"{values[0]:g} in all samples", "a record that varies", remedy, "channel")
    longest, expected = clipped(values), "a record within the sensor's range"
    got = f"{longest} samples in a row at the largest value: clipped"
    require(not longest, "", got, expected, "measure again, less amplified", "channel")
    in_ms = "; or are its times in ms? then write time [ms]" if 1e3 * rate >= SLOWEST else ""
    got, remedy = f"{rate:.4g} samples a second in {file}", f"measure again, sampled faster{in_ms}"
    require(rate >= SLOWEST, "", got, f"at least {SLOWEST:g}", remedy, "channel")
    got, remedy = f"{duration:.3g} s in {file}", "record the whole motion, or check the unit of the times"
    require(duration >= SHORTEST, "", got, f"at least {SHORTEST:g} s", remedy, "channel")


def _measured(row: RunRow, unit: str) -> tuple[int, float]:
    """Return the order of differentiation of the displacement, and SI units per number of the file."""
    quantities = tuple(QUANTITIES.values())
    quantity, factor = row.scale(unit, quantities, "a motion", "mm, m/s, m/s^2 or g_0")
    return quantities.index(quantity), factor


def _slower(values: Float[np.ndarray, "T"], step: float) -> tuple[Float[np.ndarray, "S"], float]:
    """Return samples at `RATE` [Hz] at most, after an anti-aliasing filter, and their step [s]."""
    from scipy.signal import resample_poly

    down = int(np.ceil(1 / (step * RATE) - 1e-9))
    return (values, step) if down <= 1 else (resample_poly(values, 1, down, padtype="line"), step * down)


def write_runs(folder: str | Path, path: str | Path) -> int:
    """Write a table of a folder's recordings to fill in, and return its number of channels.

    Raises:
        InputError: no recordings, or the file exists already.
    """
    check_new(Path(path), "move it away, or name another")
    recordings = recordings_of(Path(folder))
    rows = [
        {"file": name, "channel": channel.name, "unit": channel.unit, "note": note_of(channel)}
        for name, recording in recordings.items()
        for channel in recording.channels
    ]
    write_blank(Path(path), COMMENTS, HEAD, rows)
    return len(rows)
