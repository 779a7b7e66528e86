"""LabVIEW's binary files (TDMS), by npTDMS."""

import io
import logging
from pathlib import Path
from typing import Any

import numpy as np

from ident.measure.recordings.recording import Channel, Contents, damaged, lacking

UNITS = ("unit_string", "NI_UnitDescription", "Unit")
"""Properties that say the unit of a channel."""


KIND = "a LabVIEW file (TDMS)"
LEAD_IN = 28
"""Bytes before the first segment: npTDMS takes fewer for a file without channels."""


def read(path: Path, data: bytes) -> Contents:
    """Return the channels of a TDMS file, by `group/channel`."""
    try:
        from nptdms import TdmsFile
        from nptdms.log import log_manager
    except ImportError:
        lacking(path, "npTDMS")
    log_manager.set_level(logging.ERROR)  # it prints warnings of what is refused here
    if len(data) < LEAD_IN:
        damaged(path, KIND, f"{len(data)} bytes")
    try:
        file = TdmsFile.read(io.BytesIO(data))
        found = [_channel(group.name, channel) for group in file.groups() for channel in group.channels()]
    except Exception as error:  # npTDMS lets ValueError, struct and EOF errors of damaged files through
        damaged(path, KIND, error)
    if file.file_status.incomplete_final_segment:
        damaged(path, KIND, "its last segment is cut off")
    return tuple(each for each in found if each is not None), (), {}


def _channel(group: str, channel: Any) -> Channel | None:
    values = np.asarray(channel[:])
    if values.dtype.kind not in "iuf" or values.size < 2:
        return None
    unit = next((str(channel.properties[name]) for name in UNITS if channel.properties.get(name)), "")
    step = channel.properties.get("wf_increment")
    return Channel(f"{group}/{channel.name}", values[None].astype(float), unit, float(step) if step else None)
