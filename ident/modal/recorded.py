"""A file of a modal test in SI: force and responses, each with its place from the channel table."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from typing import Any

import numpy as np

from ident.errors import InputError, Problem, every, noted, refusal, refuse, require
from ident.measure.channels import FORCE, IGNORED, QUANTITIES, REFERENCE, RESPONSE, TIME, ChannelRow, ChannelTable
from ident.measure.load import Load
from ident.measure.recordings import Channel, Recording
from ident.measure.recordings.recording import TIMES
from ident.measure.recordings.sampling import even_step
from ident.measure.speeds import Speed
from ident.modal.frf import Place
from ident.text import by_key, did_you_mean, one_line, quoted
from ident.units import GRAVITIES, POUNDS, STANDARD_GRAVITY

# -------- Units
# The numbers of a channel in SI, by the channel table and the file, never by a guess.

_MOTION = "m/s^2, g_0, m/s or mm"
EXAMPLES = {"force": "N", "response": _MOTION, "reference": _MOTION, "time": "s"}


def quantity_and_factor(row: ChannelRow, unit: str) -> tuple[str, float]:
    """Return the quantity of a channel and SI units per number of its file, see `ChannelRow.scale`."""
    possible = (row.quantity,) if row.quantity else QUANTITIES[row.role]
    named = "displacement" if row.quantity == "length" else row.quantity or row.role
    return row.scale(unit, possible, named, EXAMPLES[row.role])


# -------- Sources

ORDER = {"acceleration": 0, "velocity": 1, "length": 2}
"""Number of differentiations from a response to an acceleration."""
SAME = 1e-6
"""Relative difference of two rates treated as equal."""
TOGETHER = 1e-3
"""Delay between two channels, as a share of a step, treated as none; assumed."""
STEPS = (1e-9, 1e3)
"""Plausible sampling intervals [s], or distances of lines [Hz]: a rate of 1 mHz shows no vibration."""


@dataclass(frozen=True)
class Response:
    """One measured response in SI.

    Attributes:
        place: point and direction.
        values: (B, T) [m/s^2, m/s or m] samples; of frequency responses (B, F) [the same / N].
        order: number of differentiations to an acceleration.
        full_scale: [SI] of its input, None if unknown.
        channel: its name in the file.
        late: (B,) [s] delay of its samples after those of the force, less than a step; None for no delay.
    """

    place: Place
    values: np.ndarray
    order: int
    full_scale: float | None
    channel: str
    late: np.ndarray | None = None


@dataclass(frozen=True)
class Recorded:
    """A file, and the state of the arm in it.

    Attributes:
        file: its name, for messages.
        posture: (joints,) [rad]
        load: the load case, sensors included.
        drives: state of the drives.
    """

    file: str
    posture: tuple[float, ...]
    load: Load
    drives: str

    @property
    def state(self) -> tuple[tuple[float, ...], Load, str]:
        """Posture, load and state of the drives."""
        return self.posture, self.load, self.drives


@dataclass(frozen=True)
class Source(Recorded):
    """Records of one file at one state of the arm, excited by one force.

    Attributes:
        decay: [1/s] of a window that the analyser has applied.
        step: [s] between samples, or [Hz] between lines.
        start: [Hz] first line of frequency responses.
        reference: point and direction of the force.
        force: (B, T) [N] samples; None for finished frequency responses.
        full_scale: [N] of the force's input, None if unknown.
        responses: the measured responses.
        remarks: for the report.
    """

    decay: float
    step: float
    start: float
    reference: Place
    force: np.ndarray | None
    full_scale: float | None
    responses: tuple[Response, ...]
    remarks: tuple[str, ...] = ()


def sources(table: ChannelTable, recordings: Mapping[str, Recording]) -> tuple[Source, ...]:
    """Return the records of a test's files, without finished modes; the table's directions are in the base frame.

    Args:
        table: the channel table.
        recordings: by file name.

    Raises:
        InputError: table and files do not match, a unit, a rate or a force is missing, or values are not numbers.
    """
    problems, found = list[Problem](), list[Source]()
    for pattern, row in {row.file: row for row in reversed(table.rows)}.items():
        if not any(fnmatchcase(name, pattern) for name in recordings):
            expected, remedy = "a file of the test", did_you_mean(pattern, recordings, "correct the name")
            problems.append(Problem(row.where, quoted(pattern), expected, remedy, "file"))
    for name, recording in recordings.items():
        rows = rows_of(table, name, recording)
        if not recording.channels:
            problems += _nodes_alone(name, rows, recordings) if not recording.shapes else ()
            continue
        with noted(problems):
            found += _of_file(name, rows, recording) if any(row.counts for row in rows) else ()
    refuse(problems)
    any_test = found or any(map(is_finished, recordings.values()))
    require(any_test, table.path, "no row of a response", "at least one", "fill in the column role", "role")
    return tuple(found)


def rows_of(table: ChannelTable, name: str, recording: Recording) -> list[ChannelRow]:
    """Return the rows of a file; a number that is no name of a channel counts its channels, without clocks."""
    clocks = {each.name for each in recording.channels if TIMES.fullmatch(each.name) or _rises(each.values)}
    known = {str(i): each for i, each in enumerate((n for n in recording.names if n not in clocks), 1)}
    known |= {each: each for each in recording.names}
    rows = (row for row in table.rows if fnmatchcase(name, row.file))
    return [replace(row, channel=known.get(row.channel, row.channel)) for row in rows]


def _rises(values: np.ndarray) -> bool:
    """Whether each sample is above the one before, as of times and counters under any name, and of no vibration."""
    return bool(not np.iscomplexobj(values) and values.shape[-1] > SOME and (np.diff(values) > 0).all())


def _nodes_alone(name: str, rows: list[ChannelRow], recordings: Mapping[str, Recording]) -> Iterator[Problem]:
    """Yield the problem of a row that names a file of nodes only; a pattern may include one along with the records."""
    measured = [other for other, each in recordings.items() if each.names]
    named = [row for row in rows if row.counts and not any(fnmatchcase(other, row.file) for other in measured)]
    if named:
        got, expected = f"nodes and no channel in {quoted(name)}", "samples over time or frequency responses"
        yield Problem(named[0].where, got, expected, "name the file of the records", "file")


def _of_file(name: str, rows: list[ChannelRow], recording: Recording) -> Iterator[Source]:
    check_names(name, rows, recording)
    counting = [row for row in rows if row.counts]
    forces = [row for row in counting if row.role == FORCE]
    for row in counting:
        got, remedy = "a reference in a test with force", "give it the role response"
        require(row.role != REFERENCE, row.where, got, "responses to the force", remedy, "role")
    got, remedy = f"no reference channel of {quoted(name)}", "give the channel of the hammer this role"
    require(forces, counting[0].where, got, "a channel of role force", remedy, "role")
    check_state(counting)
    if len(forces) > 1 and not has_responses(counting, recording):
        got, remedy = f"{len(forces)} forces in {quoted(name)}", "give each force a file of its own, or the role ignore"
        raise refusal(forces[1].where, got, "one force in a file of samples", remedy, "role")
    for force in forces:
        yield _source(name, force, [row for row in counting if row.role == RESPONSE], rows, recording)


def _source(
    name: str, force: ChannelRow, rows: list[ChannelRow], every: list[ChannelRow], recording: Recording
) -> Source:
    """Return the records of a file for one force."""
    finished = has_responses(rows, recording)
    reference = force.channel if finished else ""
    by_name = {each.name: each for each in recording.channels if each.reference == reference}
    rows = [row for row in rows if row.channel in by_name]
    got = f"no response of {quoted(name)} to {quoted(force.channel)}"
    require(rows, force.where, got, "a channel of role response", "add its row to the table", "role")
    used: Sequence[Channel] = ([] if finished else [by_name[force.channel]]) + [by_name[row.channel] for row in rows]
    step = sampling_step(name, every, recording, used, finished)
    used, late = aligned(name, rows if finished else [force, *rows], used, step)
    below = quantity_and_factor(force, used[0].reference_unit)[1] if finished else 1.0
    responses = tuple(_responses(name, rows, used[-len(rows) :], late[-len(rows) :], below))
    pushed, full_scale, start = None, None, used[0].start if finished else 0.0
    assert isinstance(start, float), "a reader gives frequency responses of one start as one channel"
    if not finished:
        pushed = finite(name, used[0]) * quantity_and_factor(force, used[0].unit)[1]
        got = f"{quoted(force.channel)} of {quoted(name)} constant at {pushed.flat[0]:.4g} N"
        require(np.ptp(pushed), force.where, got, "a force with hits", _CABLE, "channel")
        full_scale = _full_scale(force)
    units = {each.name: each.unit for each in used} | ({force.channel: used[0].reference_unit} if finished else {})
    return Source(
        name, *state_of(force), force.decay, step, start, place_of(force), pushed, full_scale, responses,
        tuple(f"{name}: {remark}" for remark in _unit_remarks([force, *rows], units)),
    )  # fmt: skip


_CABLE = "look at the cable of the hammer, and which channel of the file is the force"


def _unit_remarks(rows: Sequence[ChannelRow], units: Mapping[str, str]) -> Iterator[str]:
    """Yield remarks on the file's ambiguous units, such as g or lb, with the meaning used here."""
    meant = {**dict.fromkeys(GRAVITIES, f"standard gravity, {STANDARD_GRAVITY} m/s^2"), **dict.fromkeys(POUNDS, "lbf")}
    for row in rows:
        written = row.unit or units[row.channel]
        if written in meant:
            yield f"{quoted(written)} of {quoted(row.channel)} is read as {meant[written]}"


def has_responses(rows: Iterable[ChannelRow], recording: Recording) -> bool:
    """Whether the used channels of a file are frequency responses; it may hold samples as well."""
    named = {row.channel for row in rows if row.counts}
    return any(channel.reference for channel in recording.channels if channel.name in named)


def _responses(
    name: str, rows: Sequence[ChannelRow], channels: Iterable[Channel], late: Iterable[Any], below: float = 1.0
) -> Iterator[Response]:
    """Yield the responses in SI; frequency responses are divided by the SI factor of the force."""
    for row, channel, behind in zip(rows, channels, late, strict=True):
        quantity, factor = quantity_and_factor(row, channel.unit)
        values = finite(name, channel) * (factor / below)
        moves = values.any() if np.iscomplexobj(values) else np.ptp(values)
        got = f"{quoted(row.channel)} of {quoted(name)} without any motion"
        remedy = "look at its cable, or give the channel the role ignore"
        require(moves, row.where, got, "a response that moves", remedy, "channel")
        yield Response(place_of(row), values, ORDER[quantity], _full_scale(row), row.channel, behind)


def aligned(
    name: str, rows: Sequence[ChannelRow], channels: Sequence[Channel], step: float
) -> tuple[Sequence[Channel], Sequence[np.ndarray | None]]:
    """Return the channels of a file, cut to their common span unless they start together.

    Args:
        name: the file's.
        rows: C rows of the table, for messages.
        channels: C channels of samples, or of frequency responses to one force.
        step: [s or Hz] of all of them.

    Returns:
        The channels, and for each (B,) [s] the remaining delay of its samples after those of the first channel, from
        minus half a step to half a step; None for no delay.

    Raises:
        InputError: the channels differ in number of blocks or in length, or have no common span or lines.
    """
    where = rows[0].where
    _check_blocks(name, where, channels)
    starts = np.array([np.broadcast_to(each.start, len(each.values)) for each in channels], float)  # (C, B)
    lengths = np.array([[each.values.shape[1]] for each in channels])
    if (starts == starts[0]).all():
        for row, each, length in zip(rows, channels, lengths[:, 0], strict=True):
            counts = f"{lengths[0, 0]} samples of {quoted(channels[0].name)}, {length} of {quoted(each.name)}"
            got, remedy = f"channels of different lengths in {quoted(name)}: {counts}", "export them again together"
            require(length == lengths[0, 0], row.where, got, "the same length", remedy, "channel")
        return channels, [None] * len(channels)
    offset = (starts - starts[0]) / step
    whole = np.rint(offset)
    begin, end = whole.max(0), (whole + lengths).min(0)
    late = np.where(np.abs(offset - whole) > TOGETHER, (offset - whole) * step, 0.0)
    if not (end - begin).min() >= 2 or (channels[0].reference and late.any()):
        raise InputError(_apart(name, where, channels, starts, step))
    count = int((end - begin).min())
    cut, start = list[Channel](), float(starts[0, 0] + begin[0] * step)
    for each, first in zip(channels, (begin - whole).astype(int), strict=True):
        values = np.stack([row[at : at + count] for row, at in zip(each.values, first, strict=True)])
        cut.append(replace(each, values=values, start=start))
    return cut, [row if row.any() else None for row in late]


def _check_blocks(name: str, where: str, channels: Sequence[Channel]) -> None:
    """Refuse channels with different numbers of blocks: one label may stand for several sensors."""
    most, fewest = (pick(channels, key=lambda each: len(each.values)) for pick in (max, min))
    if len(most.values) > len(fewest.values):
        got = f"{len(most.values)} blocks of {quoted(most.name)} and {len(fewest.values)} of {quoted(fewest.name)}"
        lines = f" (ID lines: {', '.join(map(quoted, most.notes[:4]))})" if any(most.notes) else ""
        remedy = "where a label stands for several sensors, export each with a name of its own"
        raise refusal(where, f"{got} in {quoted(name)}{lines}", "as many blocks of each channel", remedy, "channel")


def _apart(name: str, where: str, channels: Sequence[Channel], starts: np.ndarray, step: float) -> Problem:
    """Return the problem of channels without a common span, or with different lines."""
    block = int(np.argmax(np.ptp(starts, 0)))
    first, last = int(np.argmin(starts[:, block])), int(np.argmax(starts[:, block]))
    unit = "Hz" if channels[0].reference else "s"
    ends = starts[:, block] + step * (np.array([each.values.shape[1] for each in channels]) - 1)
    spans = (f"{quoted(channels[i].name)} from {starts[i, block]:.6g} to {ends[i]:.6g} {unit}" for i in (first, last))
    expected = "the same lines" if channels[0].reference else "channels that overlap in time"
    remedy = "correct where they start, or export them together"
    return Problem(where, f"{' and '.join(spans)} in {quoted(name)}", expected, remedy, "channel")


def _full_scale(row: ChannelRow) -> float | None:
    """Return the full scale in SI; it has the unit of the table, which must then be filled in."""
    if row.full_scale is None:
        return None
    require(row.unit, row.where, "a full scale without unit", "the unit that it is in", "fill the cell", "unit")
    return row.full_scale * quantity_and_factor(replace(row, sensitivity=None), "")[1]


def place_of(row: ChannelRow) -> Place:
    """Return point and direction of a force or a response."""
    assert row.direction is not None
    return Place(row.point, row.direction)


def finite(name: str, channel: Channel) -> np.ndarray:
    """Return the values of a channel; refuse any that is not a number."""
    wrong = np.argwhere(~np.isfinite(channel.values))
    if len(wrong):
        where = f"{one_line(name)}, block {wrong[0, 0] + 1}, sample {wrong[0, 1] + 1}"
        remedy = "export it again, or give the channel the role ignore"
        raise refusal(where, f"{len(wrong)} values that are no number", "numbers", remedy, channel.name)
    return channel.values


_USABLE = "samples over time, or complex frequency responses with their frequencies"


def check_names(name: str, rows: list[ChannelRow], recording: Recording) -> None:
    """Refuse rows with channels that are missing in the file, flawed, or repeated."""
    problems = []
    for row in rows:
        if row.channel not in recording.names and row.role != IGNORED:
            remedy = did_you_mean(row.channel, recording.names, f"it has {', '.join(recording.names[:8])}")
            problems.append(Problem(row.where, quoted(row.channel), f"a channel of {quoted(name)}", remedy, "channel"))
    sound = {channel.name for channel in recording.channels if not channel.flaw}
    flawed = {channel.name: channel for channel in recording.channels if channel.flaw and channel.name not in sound}
    for channel, (row, *more) in by_key((row.channel, row) for row in rows).items():
        if more:
            got = f"{quoted(channel)} {'twice' if len(more) == 1 else f'{1 + len(more)} times'}"
            problems.append(Problem(more[0].where, got, "each channel once", "keep one", "channel"))
        if channel in flawed and row.role != IGNORED:
            got = f"{quoted(channel)} of {quoted(name)}: {flawed[channel].flaw}"
            remedy = flawed[channel].remedy or "give the channel the role ignore"
            problems.append(Problem(row.where, got, _USABLE, remedy, "channel"))
    refuse(problems)


SOME = 16
"""Samples in a row of which each is above the one before, in no vibration; assumed."""
STATE = {"posture": "q1", "load": "load", "drives": "drives"}
"""State of the arm: fields of a row, each with its column."""
WINDOW = {**STATE, "decay": "decay"}
"""The same with the decay of the window."""


def check_state(rows: list[ChannelRow], fields: Mapping[str, str] = WINDOW) -> None:
    """Refuse a file whose rows differ in the state of the arm, or in their window."""
    for field, column in fields.items():
        got, remedy = f"another {field} than the file's first row", "a file is of one state of the arm and one test"
        for row in rows:
            require(getattr(row, field) == getattr(rows[0], field), row.where, got, "the same", remedy, column)


def sampling_step(
    name: str, rows: list[ChannelRow], recording: Recording, used: Iterable[Channel], finished: bool = False
) -> float:
    """Return the common step of a file's channels, from the file, or from the table if the file has none."""
    said = {channel.step for channel in used if channel.step}
    times = [row for row in rows if row.role == TIME]
    if times:
        channel = next(each for each in recording.channels if each.name == times[0].channel)
        factor = quantity_and_factor(times[0], channel.unit)[1]
        said.add(even_step(channel.values[0] * factor, one_line(name), channel.name))
        for each in used:
            count, samples = channel.values.shape[1], each.values.shape[1]
            got, remedy = f"{count} times for {samples} samples of {quoted(each.name)}", "export them again together"
            require(count == samples, times[0].where, got, "a time for each sample", remedy, "channel")
    given = [row for row in rows if row.rate]
    if not finished:
        said |= {1 / row.rate for row in given if row.rate}
    where = (given or rows)[0].where
    remedy = "give the column rate [Hz], or the role time to the channel that holds the times"
    require(said, where, f"no sampling rate of {quoted(name)}", "one: the file says none", remedy, "rate")
    for step in said:
        what, unit = ("lines", "Hz") if finished else ("samples", "s")
        got, expected = f"{what} of {quoted(name)} {step:.4g} {unit} apart", f"{STEPS[0]:g} to {STEPS[1]:g} {unit}"
        remedy = "correct the sampling of the file, or its unit"
        require(STEPS[0] <= step <= STEPS[1], where, got, expected, remedy, "rate")
    if max(said) > min(said) * (1 + SAME):
        got = f"sampling of {1 / max(said):.6g} and of {1 / min(said):.6g} Hz for {quoted(name)}"
        remedy = "correct the table, or export the channels with one sampling"
        raise refusal(where, got, "one sampling", remedy, "rate")
    return min(said)


# -------- Records
# Files of an ambient test in SI: responses to unmeasured forces, described by the channel table.


@dataclass(frozen=True)
class Record(Recorded):
    """Record of one file at one state of the arm, without a force.

    Attributes:
        step: [s] between samples.
        responses: the measured responses.
        references: indices of the reference responses, for the correlation with all others.
        speeds: turning parts and their speeds.
        remarks: for the report.
        excitation: as the table says it.
        decay: [1/s] of a window that the analyser has applied.
    """

    step: float
    responses: tuple[Response, ...]
    references: tuple[int, ...]
    speeds: tuple[Speed, ...]
    remarks: tuple[str, ...]
    excitation: str = ""
    decay: float = 0.0


def ambient_files(table: ChannelTable, recordings: Mapping[str, Recording]) -> frozenset[str]:
    """Return the recordings of samples at those states of the arm without a force in any file."""
    counting = {}
    for name, recording in recordings.items():
        rows = [row for row in rows_of(table, name, recording) if row.counts]
        if recording.channels and not has_responses(rows, recording):
            counting[name] = rows
    pushed = {state_of(row) for rows in counting.values() for row in rows if row.role == FORCE}
    return frozenset(name for name, rows in counting.items() if rows and state_of(rows[0]) not in pushed)


def state_of(row: ChannelRow) -> tuple[tuple[float, ...], Load, str]:
    """Return posture [rad], load and state of the drives."""
    return row.posture, row.load, row.drives


def records(table: ChannelTable, recordings: Mapping[str, Recording]) -> tuple[Record, ...]:
    """Return the records of ambient tests; directions of the table must be in the base frame.

    Raises:
        InputError: table and files do not match, a unit or a rate is missing, or values are not numbers.
    """
    return tuple(every(lambda name: _record(name, table, recordings[name]), recordings))


def _record(name: str, table: ChannelTable, recording: Recording) -> Record:
    rows = rows_of(table, name, recording)
    check_names(name, rows, recording)
    counting = [row for row in rows if row.counts]
    check_state(counting, {**WINDOW, "excitation": "excitation"})
    channels = {each.name: each for each in recording.channels}
    used = [channels[row.channel] for row in counting]
    step = sampling_step(name, rows, recording, used)
    responses = tuple(_responses(name, counting, *aligned(name, counting, used, step)))
    references = tuple(i for i, row in enumerate(counting) if row.role == REFERENCE)
    others = [each for each in recording.channels if each.name not in {row.channel for row in counting}]
    look_like_one = [each for each in others if each.unit in ("N", "kN", "lbf")]
    hint = "if that is the hammer, give it the role force"
    forces = [f"{quoted(each.name)} is in {each.unit}: {hint}" for each in look_like_one]
    speeds = tuple(dict.fromkeys(speed for row in counting for speed in row.harmonics))
    return Record(
        name, *state_of(counting[0]), step, responses, references or tuple(range(len(counting))), speeds,
        (*forces, *_unit_remarks(counting, {each.name: each.unit for each in used})),
        counting[0].excitation, counting[0].decay,
    )  # fmt: skip


def is_finished(recording: Recording) -> bool:
    """Whether a file has modes only; if it has functions too, these are identified again."""
    return bool(recording.shapes) and not recording.channels
