"""Files of an ambient test in SI: responses to forces that nobody measured, as the channel table says."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from fnmatch import fnmatchcase

from ident.errors import InputError, Problem
from ident.measure.channels import FORCE, REFERENCE, ChannelRow, ChannelTable
from ident.measure.load import Load
from ident.measure.recordings import Channel, Recording
from ident.measure.speeds import Speed
from ident.modal.sources import (
    Response,
    aligned,
    check_moves,
    check_names,
    check_state,
    has_responses,
    response_of,
    sampling_step,
)
from ident.modal.units import unit_remark
from ident.text import quoted


@dataclass(frozen=True)
class Record:
    """What one file recorded at one state of the arm, without a force.

    Attributes:
        file: its name, for messages.
        posture: (joints,) [rad]
        load: the load case, sensors included.
        drives: what held the motors.
        step: [s] between samples.
        responses: what was measured.
        references: rows of the responses with which all are correlated.
        speeds: what turned.
        remarks: what a reader should know.
    """

    file: str
    posture: tuple[float, ...]
    load: Load
    drives: str
    step: float
    responses: tuple[Response, ...]
    references: tuple[int, ...]
    speeds: tuple[Speed, ...]
    remarks: tuple[str, ...]

    @property
    def state(self) -> tuple[tuple[float, ...], Load, str]:
        """At what posture, under what load and held by what it was recorded."""
        return self.posture, self.load, self.drives


def ambient_files(table: ChannelTable, recordings: Mapping[str, Recording]) -> frozenset[str]:
    """Return the recordings of samples at states of the arm of which no file has a force."""
    counting = {
        name: [row for row in table.rows if row.counts and fnmatchcase(name, row.file)]
        for name, recording in recordings.items()
        if recording.channels
    }
    counting = {name: rows for name, rows in counting.items() if not has_responses(rows, recordings[name])}
    pushed = {_state(row) for rows in counting.values() for row in rows if row.role == FORCE}
    return frozenset(name for name, rows in counting.items() if rows and _state(rows[0]) not in pushed)


def _state(row: ChannelRow) -> tuple[tuple[float, ...], Load, str]:
    return row.posture, row.load, row.drives


def records(table: ChannelTable, recordings: Mapping[str, Recording]) -> tuple[Record, ...]:
    """Return what files of ambient tests recorded; directions of the table have to be those of the base frame.

    Raises:
        InputError: table and files do not fit together, a unit or a rate is missing, values are no numbers.
    """
    problems: list[Problem] = []
    made: list[Record] = []
    for name, recording in recordings.items():
        try:
            made.append(_record(name, [row for row in table.rows if fnmatchcase(name, row.file)], recording))
        except InputError as error:
            problems += error.problems
    if problems:
        raise InputError(problems)
    return tuple(made)


def _record(name: str, rows: list[ChannelRow], recording: Recording) -> Record:
    check_names(name, rows, recording)
    counting = [row for row in rows if row.counts]
    check_state(counting)
    channels = {each.name: each for each in recording.channels}
    used = [channels[row.channel] for row in counting]
    step = sampling_step(name, rows, recording, used)
    responses = tuple(
        response_of(name, row, channel, late=late)
        for row, channel, late in zip(counting, *aligned(name, counting, used, step), strict=True)
    )
    check_moves(name, counting, responses)
    references = tuple(i for i, row in enumerate(counting) if row.role == REFERENCE)
    speeds = tuple(dict.fromkeys(speed for row in counting for speed in row.harmonics))
    return Record(
        name, *_state(counting[0]), step, responses, references or tuple(range(len(counting))), speeds,
        (*_forces(rows, recording), *_record_unit_remarks(name, counting, channels)),
    )  # fmt: skip


def _record_unit_remarks(name: str, rows: list[ChannelRow], channels: Mapping[str, Channel]) -> Iterator[str]:
    """Yield which units have been read as something that they mean only here."""
    for row in rows:
        if remark := unit_remark(row, channels[row.channel].unit):
            yield remark


def _forces(rows: list[ChannelRow], recording: Recording) -> Iterator[str]:
    """Yield what channel looks like a force, though no row says so."""
    used = {row.channel for row in rows if row.counts}
    for channel in recording.channels:
        if channel.unit in ("N", "kN", "lbf") and channel.name not in used:
            yield f"{quoted(channel.name)} is in {channel.unit}: if that is the hammer, give it the role force"
