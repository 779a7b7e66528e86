"""LabVIEW's binary files (TDMS), by npTDMS."""

import io
import logging
from pathlib import Path
from typing import Any

import numpy as np

from ident.measure.recordings.recording import Channel, Contents, damaged, lacking, over

UNITS = ("unit_string", "NI_UnitDescription", "Unit")
"""Properties with the unit of a channel."""
KIND = "a LabVIEW file (TDMS)"
LEAD_IN = 28
"""Bytes before the first segment: npTDMS reads a shorter file as one without channels."""


def read(path: Path, data: bytes) -> Contents:
    """Return the channels of a TDMS file, by `group/channel`."""
    try:
        from nptdms import TdmsFile
        from nptdms.log import log_manager
    except ImportError:
        lacking(path, "npTDMS")
    log_manager.set_level(logging.ERROR)  # it prints warnings of problems that are refused here
    if len(data) < LEAD_IN:
        damaged(path, KIND, f"{len(data)} bytes")
    try:
        file = TdmsFile.read(io.BytesIO(data))
        named = ((group.name, channel) for group in file.groups() for channel in group.channels())
        every = [(name, channel, np.asarray(channel[:])) for name, channel in named]
        sampled = [each for each in every if each[2].dtype.kind in "iuf" and each[2].size > 1]
        times = [channel.properties.get("wf_start_time") for _, channel, _ in sampled]
        dated = [time for time in times if isinstance(time, np.datetime64) and not np.isnat(time)]
        first = min(dated) if dated and len(dated) == len(times) else None  # the earliest clock, if all channels say it
        found = tuple(_channel(*each, first) for each in sampled)
    except Exception as error:  # npTDMS lets ValueError, struct and EOF errors of damaged files through
        damaged(path, KIND, error)
    if file.file_status.incomplete_final_segment:
        damaged(path, KIND, "its last segment is cut off")
    return found, (), {}


def _channel(group: str, channel: Any, values: np.ndarray, first: np.datetime64 | None) -> Channel:
    """Return a channel; its start counts from the earliest clock of the file."""
    said = channel.properties
    unit = next((str(said[name]) for name in UNITS if said.get(name)), "")
    step, start, later = said.get("wf_increment"), float(said.get("wf_start_offset") or 0.0), 0.0
    if first is not None:
        start_time, zero = (time.astype("datetime64[us]") for time in (said["wf_start_time"], first))
        later = float((start_time - zero) / np.timedelta64(1, "s"))
    name, samples = f"{group}/{channel.name}", values[None].astype(float)
    made = Channel(name, samples, unit, float(step) if step else None, start)
    return over(made, str(said.get("wf_xunit_string") or ""), "time", later)
