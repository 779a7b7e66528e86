"""A channel table to fill in: what the files of a test say of their channels, and empty cells for what they do not."""

import csv
import io
import os
import re
from collections.abc import Iterator
from fnmatch import fnmatchcase
from pathlib import Path

from ident.errors import InputError, Problem
from ident.files import replace_file
from ident.measure.channels import FORCE, QUANTITIES, RESPONSE, TIME, ChannelTable
from ident.measure.recordings import Channel, NoChannelError, Recording, is_recording, read_recording
from ident.text import one_line
from ident.units import sensor_factor

COMMENTS = (
    "Fill in for each channel that counts: role (force, response; time where a channel holds the times), point of the",
    "arm (or a new name with joint and position [mm]), direction (x, -z, 0 0.6 -0.8) in the base's frame or the body's",
    "(frame: base, body), unit, posture q1, q2, ... and load, the sensors' mass included (0.2 kg @ tip).",
    "sensitivity: numbers of the file for one unit; rate [Hz] where the file says none; decay [1/s] of an exponential",
    "window that the analyser has applied. A row without role is left out. `*` in a file's name: any letters.",
    "Without any force: a column harmonics for what turned meanwhile (2.25 Hz @ pulley 1 + 1450 rpm @ pump).",
)
LONGEST_LINE = 100_000
"""Characters of a header: a line of a sparse file has no end."""
MEASURED = (FORCE, RESPONSE, TIME)
"""Roles by which a unit may be right, where the file does not tell the role."""
HEAD = ("file", "channel", "role", "point", "direction", "frame", "unit", "sensitivity", "rate", "decay")


def recordings_of(folder: Path, table: ChannelTable | None = None) -> dict[str, Recording]:
    """Return the recordings of a folder by file name; a channel table or campaign beside them is none.

    Args:
        folder: where they are.
        table: names the files that are read: others are listed, without channels. None for all; then a file in which
            nothing was recorded is listed without channels, too.

    Raises:
        InputError: it is no folder, holds none, or some can't be read; each with a line.
    """
    check_folder(folder)
    found: dict[str, Recording] = {}
    problems: list[Problem] = []
    passed: list[Problem] = []
    for path in sorted(folder.iterdir()):
        if not path.is_file() or not is_recording(path) or is_table(path):
            continue
        if table and not any(row.counts and fnmatchcase(path.name, row.file) for row in table.rows):
            found[path.name] = Recording(str(path), "", ())
            continue
        try:
            found[path.name] = read_recording(path)
        except InputError as error:
            sound = table is None and isinstance(error, NoChannelError)
            (passed if sound else problems).extend(error.problems)
            if sound:
                found[path.name] = Recording(str(path), "", (), holds=error.problems[0].got)
    if not problems and (not found or (table is None and not any(each.names for each in found.values()))):
        expected = "recordings: .uff, .unv, .csv, .mat, .lvm, .tdms, .wav, .h5"
        got = "nodes and no channel" if found else "a folder without recordings"
        problems = passed or [Problem(one_line(str(folder)), got, expected, "name another folder")]
    if problems:
        raise InputError(problems)
    return found


def check_folder(folder: Path) -> None:
    """Refuse what is no folder."""
    if not os.path.isdir(folder):
        raise InputError(Problem(one_line(str(folder)), "no such folder", "a folder of recordings", "correct the path"))


def is_table(path: Path) -> bool:
    """Tell whether a CSV file is a channel table or a campaign: its header names none of samples."""
    if path.suffix.lower() not in (".csv", ".txt"):
        return False
    try:
        with path.open(encoding="utf-8-sig", errors="replace") as file:
            every = (line.strip() for line in iter(lambda: file.readline(LONGEST_LINE), ""))
            lines = [next((line for line in every if line and not line.startswith("#")), "")]
    except OSError:  # who reads it says so
        return False
    head = {cell.strip().lower() for cell in re.split("[,;\t]", lines[0])}
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
    recordings = recordings_of(folder)
    rows = [row for name, recording in recordings.items() for row in _rows(name, recording)]
    passed = [f"Passed over: {one_line(name)}, {each.holds}." for name, each in recordings.items() if each.holds]
    text = io.StringIO()
    text.writelines(f"# {line}\n" for line in (*COMMENTS, *passed))
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
        flawed = channel is not None and bool(channel.flaw)
        role = {"force": FORCE, "acceleration": RESPONSE}.get(each.rpartition(" ")[2], "") if not flawed else ""
        said = channel.unit if channel else _force_unit(recording, each)
        unit = said if _is_taken(said, role) else ""
        hint = "" if unit == said or flawed else f"in {one_line(said)!r}: write unit and sensitivity"
        note = [_note(channel) if channel else "", hint, _place(recording, each)]
        yield {"file": name, "channel": each, "role": role, "unit": unit, "note": "; ".join(filter(None, note))}


def _force_unit(recording: Recording, force: str) -> str:
    """Return the unit of a force that frequency responses refer to, empty where they name none."""
    return next((each.reference_unit for each in recording.channels if each.reference == force), "")


def _is_taken(unit: str, role: str) -> bool:
    """Tell whether a row of this role, or of any, may have a unit: volts are none."""
    quantities = QUANTITIES[role] if role else dict.fromkeys(each for role in MEASURED for each in QUANTITIES[role])
    return any(sensor_factor(unit, quantity) is not None for quantity in quantities)


def _note(channel: Channel) -> str:
    if channel.flaw:
        return f"not to be used: {channel.flaw}; {channel.remedy}"
    blocks, samples = channel.values.shape
    step = f" at {1 / channel.step:.6g} Hz" if channel.step and not channel.reference else ""
    return f"{blocks} x {samples} {'lines' if channel.reference else 'samples'}{step}"


def _place(recording: Recording, channel: str) -> str:
    place = recording.places.get(channel.partition(":")[0])
    return f"node at {' '.join(f'{each:g}' for each in place)} in the file" if place else ""
