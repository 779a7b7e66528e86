"""LabVIEW measurement files (LVM) as text, by lvm_read; each segment is a block."""

from pathlib import Path
from typing import Any

import numpy as np

from ident.errors import InputError, Problem
from ident.measure.recordings.recording import Channel, Contents, damaged, lacking
from ident.text import decode, one_line

KIND = "a LabVIEW measurement file (LVM)"


def read(path: Path, data: bytes) -> Contents:
    """Return the channels of an LVM file.

    The text is handed over, not the file's name: by name lvm_read would load a pickle that lies beside the file.
    """
    try:
        import lvm_read
    except ImportError:
        lacking(path, "lvm-read")
    text = decode(data, one_line(str(path)))
    if not text.endswith("\n"):
        damaged(path, KIND, "its last line has no end")
    try:
        content = lvm_read.read_str(text)
        segments = [content[i] for i in range(content["Segments"])]
        return tuple(_channels(path, segments)), (), {}
    except InputError:
        raise
    except Exception as error:  # lvm_read lets ValueError, KeyError, IndexError and SyntaxError through
        damaged(path, KIND, error)


def _channels(path: Path, segments: list[dict[str, Any]]) -> list[Channel]:
    first = segments[0]
    names, table = [each.strip() for each in first["Channel names"]], [each["data"] for each in segments]
    if any(
        each["Channel names"] != first["Channel names"] or each["data"].shape != table[0].shape for each in segments
    ):
        got, remedy = "segments that differ in channels or length", "put them into files of their own"
        raise InputError(Problem(one_line(str(path)), got, "segments that are alike", remedy))
    _check_rows(path, first, table[0])
    blocks = np.stack(table).transpose(2, 0, 1)  # (columns, blocks, samples)
    kept = [i for i, name in enumerate(names) if name not in ("X_Value", "Comment")]
    steps, units = first["Delta_X"], first.get("Y_Unit_Label", [])
    return [
        Channel(names[i], blocks[i], units[k].strip() if k < len(units) else "", float(steps[k]))
        for k, i in enumerate(kept)
    ]


def _check_rows(path: Path, segment: dict[str, Any], table: np.ndarray) -> None:
    """Refuse fewer rows than the header promises."""
    promised = int(np.nanmax(segment.get("Samples", [0])))
    if len(table) < promised:
        damaged(path, KIND, f"{len(table)} of {promised} samples")
