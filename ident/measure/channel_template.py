"""A channel table to fill in: what the files of a test say of their channels, and empty cells for what they do not."""

import csv
import io
import os
from collections.abc import Iterator
from pathlib import Path

from ident.errors import InputError, Problem
from ident.files import replace_file
from ident.measure.channels import FORCE, RESPONSE
from ident.measure.recordings import Channel, Recording, is_recording, read_recording
from ident.text import one_line

COMMENTS = (
    "Fill in for each channel that counts: role (force, response; time where a channel holds the times), point of the",
    "arm (or a new name with joint and position [mm]), direction (x, -z, 0 0.6 -0.8) in the base's frame or the body's",
    "(frame: base, body), unit, posture q1, q2, ... and load, the sensors' mass included (0.2 kg @ tip).",
    "sensitivity: numbers of the file for one unit; rate [Hz] where the file says none; decay [1/s] of an exponential",
    "window that the analyser has applied. A row without role is left out. `*` in a file's name: any letters.",
    "Without any force: a column harmonics for what turned meanwhile (2.25 Hz @ pulley 1 + 1450 rpm @ pump).",
)
HEAD = ("file", "channel", "role", "point", "direction", "frame", "unit", "sensitivity", "rate", "decay")


def recordings_of(folder: Path) -> dict[str, Recording]:
    """Return the recordings of a folder by file name; a channel table or campaign beside them is none.

    Raises:
        InputError: it is no folder, holds none, or some can't be read; each with a line.
    """
    if not os.path.isdir(folder):
        raise InputError(Problem(one_line(str(folder)), "no such folder", "a folder of recordings", "correct the path"))
    found: dict[str, Recording] = {}
    problems: list[Problem] = []
    for path in sorted(folder.iterdir()):
        if path.is_file() and is_recording(path) and not is_table(path):
            try:
                found[path.name] = read_recording(path)
            except InputError as error:
                problems += error.problems
    if not found and not problems:
        expected = "recordings: .uff, .unv, .csv, .mat, .lvm, .tdms, .wav, .h5"
        problems = [Problem(one_line(str(folder)), "a folder without recordings", expected, "name another folder")]
    if problems:
        raise InputError(problems)
    return found


def is_table(path: Path) -> bool:
    """Tell whether a CSV file is a channel table or a campaign: its header names none of samples."""
    if path.suffix.lower() not in (".csv", ".txt"):
        return False
    lines = (line for line in path.read_text("utf-8", "replace").splitlines() if line and not line.startswith("#"))
    head = {cell.strip().lower() for cell in next(lines, "").replace(";", ",").split(",")}
    return {"file", "channel"} <= head or {"kind", "value"} <= head


def write_template(folder: Path, path: Path, joints: int) -> int:
    """Write the table of a folder's recordings, and return how many channels it has.

    Args:
        folder: of the recordings.
        path: where the table goes.
        joints: number of joint angles in a posture.

    Raises:
        InputError: see `recordings_of`; or there is such a file, which is not overwritten.
    """
    if os.path.exists(path):
        remedy = "move it away, or name another by --channels"
        raise InputError(Problem(one_line(str(path)), "a file that is there", "none", remedy))
    rows = [row for name, recording in recordings_of(folder).items() for row in _rows(name, recording)]
    text = io.StringIO()
    text.writelines(f"# {line}\n" for line in COMMENTS)
    angles = [f"q{i} [deg]" for i in range(1, joints + 1)]
    writer = csv.DictWriter(text, [*HEAD, *angles, "load", "note"], lineterminator="\n", restval="")
    writer.writeheader()
    writer.writerows(rows)
    replace_file(path, lambda file: file.write(text.getvalue().encode()), make_folders=True)
    return len(rows)


def _rows(name: str, recording: Recording) -> Iterator[dict[str, str]]:
    by_name = {channel.name: channel for channel in recording.channels}
    for each in recording.names:
        channel = by_name.get(each)
        role = {"force": FORCE, "acceleration": RESPONSE}.get(each.rpartition(" ")[2], "")
        note = [_note(channel) if channel else "", _place(recording, each)]
        unit = channel.unit if channel else ""
        yield {"file": name, "channel": each, "role": role, "unit": unit, "note": "; ".join(filter(None, note))}


def _note(channel: Channel) -> str:
    blocks, samples = channel.values.shape
    step = f" at {1 / channel.step:.6g} Hz" if channel.step and not channel.reference else ""
    return f"{blocks} x {samples} {'lines' if channel.reference else 'samples'}{step}"


def _place(recording: Recording, channel: str) -> str:
    place = recording.places.get(channel.partition(":")[0])
    return f"node at {' '.join(f'{each:g}' for each in place)} in the file" if place else ""
