"""Whatever a file has over time as traces: directions of the base frame, or else the channels of a recording."""

from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np

from ident.errors import InputError, require
from ident.measure.recordings import ENDINGS, Channel, Recording, read_recording
from ident.measure.samples import NONE, Columns
from ident.measure.trace import TRACE_ROWS_MIN, NoDirectionError, Trace, read_trace
from ident.text import one_line
from ident.units import sensor_factor

MOTIONS = {"acceleration": "acceleration", "velocity": "velocity", "displacement": "length"}
"""What a channel may be of, and the quantity of its unit, in the order in which spectra take one."""


def read_signals(path: str | Path, columns: Columns = NONE) -> tuple[Trace, ...]:
    """Read a trace; or else the channels over time of a recording of any format, by their own names.

    Channels of the first quantity of acceleration, velocity, displacement, or else of the first channel's unit, that
    have one clock are the first trace; each other one is a trace of its own. Of triggered blocks the first is read.

    Args:
        path: the file.
        columns: headers by names of the file, see `read_trace`.

    Raises:
        InputError: the file can't be read, or has neither.
    """
    if ENDINGS.get(Path(path).suffix.lower(), "csv_columns") != "csv_columns":
        return _signals(read_recording(path, columns))
    try:
        return (read_trace(path, columns),)
    except NoDirectionError:
        with suppress(InputError):  # else the message of the trace, with its row
            return _signals(read_recording(path, columns))
        raise


def _signals(recording: Recording) -> tuple[Trace, ...]:
    each = [made for channel in recording.channels if (made := _signal(recording, channel)) is not None]
    got = next((channel.flaw for channel in recording.channels if channel.flaw), "no channel over time")
    remedy = "export time records, or read the folder of a test: ident modal FOLDER --init"
    require(each, one_line(recording.path), got, f"at least {TRACE_ROWS_MIN} even samples", remedy)
    first = min(each, key=lambda trace: [*MOTIONS, trace.kind].index(trace.kind))
    drawn = {id(trace) for trace in each if trace.kind == first.kind and np.array_equal(trace.time, first.time)}
    values = {name: values for trace in each if id(trace) in drawn for name, values in trace.values.items()}
    notes = tuple(dict.fromkeys(note for trace in each for note in trace.notes))
    return replace(first, values=values, notes=notes), *(trace for trace in each if id(trace) not in drawn)


def _signal(recording: Recording, channel: Channel) -> Trace | None:
    """Return a channel over time in SI, or in its own unit; None for another."""
    block = channel.values[0]
    flawed = channel.flaw or channel.reference or np.iscomplexobj(block) or not np.isfinite(block).all()
    if flawed or not channel.step or len(block) < TRACE_ROWS_MIN:
        return None
    start = channel.start[0] if isinstance(channel.start, tuple) else channel.start
    factors = ((kind, sensor_factor(channel.unit, quantity)) for kind, quantity in MOTIONS.items())
    kind, factor = next(((kind, f) for kind, f in factors if f), (channel.unit or "no unit", 1.0))
    time, values = start + channel.step * np.arange(len(block)), {channel.name: factor * block.astype(float)}
    blocks = (f"read: the first of {len(channel.values)} blocks",) * (len(channel.values) > 1)
    about = (kind, values, (), (*channel.remarks, *blocks), channel.step_error, channel.band)
    return Trace(recording.path, recording.sha256, time, *about)
