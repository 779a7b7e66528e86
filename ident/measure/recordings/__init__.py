"""Recordings of test equipment: one module per file format, one value for all formats."""

import hashlib
import importlib
import warnings
from dataclasses import replace
from pathlib import Path

from ident.errors import LackingError, NoChannelError, Problem, require
from ident.measure.recordings.recording import Channel, Recording, Shape
from ident.measure.samples import NONE, Columns, split_header
from ident.text import LARGEST_BINARY, LARGEST_SAMPLES, one_line, read_bytes

__all__ = [
    "ENDINGS",
    "Channel",
    "LackingError",
    "NoChannelError",
    "Recording",
    "Shape",
    "is_recording",
    "read_recording",
]

ENDINGS = {
    **dict.fromkeys((".uff", ".unv", ".uf", ".bunv"), "universal"),
    ".csv": "csv_columns",
    ".txt": "csv_columns",
    **dict.fromkeys((".db3", ".mcap", ".zip"), "csv_columns"),
    ".mat": "matlab",
    **dict.fromkeys((".h5", ".hdf5", ".hdf"), "hdf5"),
    ".lvm": "labview",
    ".tdms": "tdms",
    ".wav": "wave",
}
"""Module that reads a file, by the ending of its name."""
TEXT = ("csv_columns", "labview")
"""Modules that read text."""


def is_recording(path: Path) -> bool:
    """Whether a file may be a recording, by its ending."""
    return path.suffix.lower() in ENDINGS


def read_recording(path: str | Path, columns: Columns = NONE) -> Recording:
    """Read a recording of a universal (UFF), CSV, MATLAB, LabVIEW (LVM, TDMS), WAV, HDF5, ROS 2 or phyphox format.

    Numbers and units are those of the file; a channel table gives their meaning.

    Args:
        path: the file; its ending gives the format.
        columns: names and units of channels, `name [unit]`, by their names in the file.

    Returns:
        Its channels, finished modes and nodes.

    Raises:
        NoChannelError: the file has none of these.
        InputError: the file is missing, damaged or truncated, or the package that reads it is not installed.
    """
    path = Path(path)
    file = one_line(str(path))
    expected, remedy = f"a recording, one of {', '.join(ENDINGS)}", "export it in one of these formats"
    require(is_recording(path) or path.is_dir(), file, f"the ending '{path.suffix}'", expected, remedy)
    kind = ENDINGS.get(path.suffix.lower(), "")
    data = read_bytes(path, "a recording", LARGEST_SAMPLES if kind in TEXT else LARGEST_BINARY)
    require(data, file, "an empty file", "a recording", "export it again")
    module = importlib.import_module(f"ident.measure.recordings.{kind}")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the readers check for what matters
        if kind == "csv_columns":
            channels, shapes, places = module.read(path, data, columns)
        else:
            channels, shapes, places = module.read(path, data)
            channels = tuple(_renamed(channel, columns) for channel in channels)
    if not channels and not shapes and not places:
        raise NoChannelError(Problem(file, "no channel", "at least one row of numbers", "export it again"))
    for channel in channels:
        got, expected = f"no sample of {one_line(channel.name)}", "at least one sample of each channel"
        require(channel.values.size, file, got, expected, "export it again")
    return Recording(str(path), hashlib.sha256(data).hexdigest(), channels, shapes, places)


def _renamed(channel: Channel, columns: Columns) -> Channel:
    name, unit = split_header(columns.get(channel.name, ""))
    return replace(channel, name=name or channel.name, unit=unit or channel.unit)
