"""The channel table of a modal test: what each channel of each file measured, where, along what, in which unit."""

import hashlib
import os
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any

from ident.errors import InputError, Problem, refusal, refuse
from ident.files import replace_file
from ident.measure.campaign import word_problems
from ident.measure.load import DRIVE_STATES, OWN_WEIGHT, Load, Vector, parse_direction
from ident.measure.recordings import Channel, LackingError, NoChannelError, Recording, is_recording, read_recording
from ident.measure.recordings.recording import ONE_NAME
from ident.measure.series import Speed, parse_speeds
from ident.measure.table import (
    Findings,
    Record,
    csv_text,
    decimal_mark,
    fitting,
    guarded,
    header_problems,
    name_and_unit,
    parse_number,
    read_table,
    records_of,
)
from ident.text import did_you_mean, one_line, quoted, which_file
from ident.units import sensor_factor, si_factor

FORCE, RESPONSE, REFERENCE, TIME, IGNORED = "force", "response", "reference", "time", "ignore"
ROLES = (FORCE, RESPONSE, REFERENCE, TIME, IGNORED)
"""What a channel may be for: the force, a response to it, in a test without force a response with which all others are
correlated, the times of the samples, or nothing."""
_MOTION = ("acceleration", "velocity", "length")
QUANTITIES = {FORCE: ("force",), RESPONSE: _MOTION, REFERENCE: _MOTION, TIME: ("time",)}
"""What a channel of each role may measure; a length is a displacement."""
FRAMES = ("base", "body")
"""In which frame a direction has its components: the base's, or that of the body which carries the point."""
REQUIRED = ("file", "channel", "role", "point", "direction", "q1")
_ANGLE = re.compile(r"q[1-9][0-9]{0,2}")


VOLTAGES = {"V": 1.0, "mV": 1e-3, "uV": 1e-6}
VOLTS = re.compile(rf"(?P<number>[-+0-9.,eE]+)\s*(?P<volts>{'|'.join(VOLTAGES)})\s*/\s*(?P<unit>\S.*)")
"""A sensitivity as a sensor's certificate has it."""


@dataclass(frozen=True, kw_only=True)
class ChannelRow:
    """What one channel measured.

    Attributes:
        where: `file:row` of the table.
        file: name of the recording, beside the table; `*` stands for any letters.
        channel: name of the channel, as the recording has it.
        role: one of `ROLES`.
        posture: (joints,) [rad] at which the arm was held.
        point: name of a point of the arm.
        joint: joint on whose body the point lies, where the arm has no such point.
        position: (3,) [m] of that point in the body's frame.
        direction: (3,) [-] along which the force acts or the response counts.
        frame: one of `FRAMES`.
        quantity: what is measured; empty to take what the unit measures.
        unit: of the quantity; empty to take what the file says.
        sensitivity: number of the file for one `unit`; None where the file's numbers are in the unit already.
        in_volts: whether it is a number of volts, whatever voltage the file is in.
        full_scale: [unit] beyond which the input is overloaded; None where the file's largest numbers tell.
        rate: [Hz] of the samples; None where the file says it.
        decay: [1/s] by which the analyser's own exponential window has faded the response.
        load: what the arm carried, sensors included.
        drives: what held the motors.
        harmonics: what turned, and how fast, during a test without force.
    """

    where: str
    file: str
    channel: str
    role: str
    posture: tuple[float, ...]
    point: str = ""
    joint: str = ""
    position: Vector | None = None
    direction: Vector | None = None
    frame: str = FRAMES[0]
    quantity: str = ""
    unit: str = ""
    sensitivity: float | None = None
    in_volts: bool = False
    full_scale: float | None = None
    rate: float | None = None
    decay: float = 0.0
    load: Load = OWN_WEIGHT
    drives: str = DRIVE_STATES[0]
    harmonics: tuple[Speed, ...] = ()

    @property
    def counts(self) -> bool:
        """Whether it is a force or a response."""
        return self.role in (FORCE, RESPONSE, REFERENCE)


COLUMNS = (*(f.name for f in fields(ChannelRow) if f.name not in ("where", "posture", "in_volts")), "note")
"""Names of the columns, beside the joint angles `q1 [deg]`, ...; `position [mm]` has its unit in the header."""


@dataclass(frozen=True)
class ChannelTable:
    """The channels of a modal test.

    Attributes:
        path: the table's file.
        sha256: hash of its bytes.
        rows: in the order of the file.
    """

    path: str
    sha256: str
    rows: tuple[ChannelRow, ...]


def read_channels(path: str | Path) -> ChannelTable:
    """Read a channel table from CSV; docs/commands/modal.md has its columns.

    Raises:
        InputError: the file can't be read, or something in it is wrong; every problem is listed.
    """
    data, findings = read_table(path), Findings()
    is_column = lambda name: name_and_unit(name)[0].lower() in COLUMNS  # noqa: E731
    needed = "channel", "see `ident modal --init`, which writes one to fill in"
    _, delimiter, records = records_of(data, path, is_column, findings, *needed)
    names, angles, length = _header(records[0], findings)
    refuse(findings)
    rows = list[ChannelRow]()
    for where, cells in fitting(records[1:], len(names), delimiter, findings):
        cell, mine = dict(zip(names, cells, strict=True)), Findings()
        said = _fields(where, cell, angles, length, decimal_mark(delimiter, cells), mine)
        mine += [replace(problem, where=where) for problem in _lacks(cell, said)]
        rows += [] if mine else [ChannelRow(where=where, **said)]
        findings += mine
    findings += _repeated(rows)
    refuse(findings)
    return ChannelTable(str(path), hashlib.sha256(data).hexdigest(), tuple(rows))


def _repeated(rows: list[ChannelRow]) -> Iterator[Problem]:
    """Yield one problem for each channel that several rows speak of in the same words, one of which counts."""
    by_name: dict[tuple[str, str], list[ChannelRow]] = {}
    for row in rows:
        by_name.setdefault((row.file, row.channel), []).append(row)
    for same in by_name.values():
        if len(same) > 1 and any(row.counts for row in same):
            count = "twice" if len(same) == 2 else f"{len(same)} times"
            got = f"{quoted(same[0].channel)} of {quoted(same[0].file)} {count}"
            yield Problem(same[1].where, got, "each channel once", "keep one row", "channel")


def _header(record: Record, findings: Findings) -> tuple[list[str], dict[str, float], float]:
    """Return the names of the columns, and SI units per unit of the joint angles, in their order, and of `position`."""
    where, cells = record
    named = [(name.lower(), unit) for name, unit in map(name_and_unit, cells)]
    angles, length = dict[str, float](), 1.0
    for name, unit in named:
        if _ANGLE.fullmatch(name):
            angles[name] = findings.attempt(where, name, _factor, unit, name, "angle") or 1.0
        elif name == "position":
            length = findings.attempt(where, name, _factor, unit, name, "length") or 1.0
    names = [name for name, _ in named]
    findings += header_problems(where, names, REQUIRED, (*COLUMNS, *angles), f"{', '.join(COLUMNS)}, q1 [deg], ...")
    joints = sorted(int(name[1:]) for name in angles)
    for joint in sorted(set(range(2, max(joints, default=1))) - set(joints)):
        expected, remedy = "joint angles numbered q1, q2, ... without a gap", "add or renumber the column"
        findings.append(Problem(where, "no such column", expected, remedy, f"q{joint}"))
    return names, {f"q{joint}": angles[f"q{joint}"] for joint in joints}, length


def _factor(unit: str, name: str, quantity: str) -> float:
    if not unit:
        example = f"'{name} [{'deg' if quantity == 'angle' else 'mm'}]'"
        raise refusal("", "no unit", f"a unit, as in {example}", "write the unit in square brackets")
    return si_factor(unit, quantity)


def _fields(
    where: str, cell: Mapping[str, str], angles: Mapping[str, float], length: float, decimal: str, mine: Findings
) -> dict[str, Any]:
    def number(name: str) -> float | None:
        return mine.attempt(where, name, _positive, cell[name], decimal) if cell.get(name) else None

    role = cell["role"].lower()
    if role == IGNORED or not role:
        return {"file": cell["file"], "channel": cell["channel"], "role": IGNORED, "posture": ()}
    direction, position, quantity = cell["direction"], cell.get("position", ""), cell.get("quantity", "").lower()
    volts = VOLTS.fullmatch(cell.get("sensitivity", ""))
    sensitivity, unit = None if volts else number("sensitivity"), cell.get("unit", "")
    if volts:
        sensitivity, unit = mine.attempt(where, "sensitivity", _volts, volts, unit, decimal) or (None, unit)
    return {
        **{name: cell.get(name, "") for name in ("file", "channel", "point", "joint")},
        "role": role,
        "posture": tuple(
            (mine.attempt(where, name, parse_number, cell[name], decimal) or 0.0) * factor
            for name, factor in angles.items()
            if role != TIME
        ),
        "position": mine.attempt(where, "position", _position, position, decimal, length) if position else None,
        "direction": mine.attempt(where, "direction", parse_direction, direction, decimal) if direction else None,
        "frame": cell.get("frame", "").lower() or FRAMES[0],
        "quantity": "length" if quantity == "displacement" else quantity,
        "unit": unit,
        "sensitivity": sensitivity,
        **{name: number(name) for name in ("full_scale", "rate")},
        "in_volts": volts is not None,
        "decay": number("decay") or 0.0,
        "load": mine.attempt(where, "load", Load.parse, cell.get("load", ""), decimal=decimal),
        "drives": cell.get("drives", "").lower() or DRIVE_STATES[0],
        "harmonics": mine.attempt(where, "harmonics", parse_speeds, cell.get("harmonics", ""), decimal) or (),
    }


def _positive(text: str, decimal: str) -> float:
    value = parse_number(text, decimal)
    if not value > 0:
        raise refusal("", quoted(text), "a number above 0", "correct it, or leave the cell empty")
    return value


def _volts(match: re.Match[str], unit: str, decimal: str) -> tuple[float, str]:
    """Return volts for one unit, and the unit, of a sensitivity as a sensor's certificate has it: 100 mV/g."""
    own = match["unit"].strip("() ")
    if unit and unit != own:
        remedy = "leave the cell `unit` empty, or write the same one"
        raise refusal("", quoted(match[0]), f"volts for one {quoted(unit)}, as in the column unit", remedy)
    return _positive(match["number"], decimal) * VOLTAGES[match["volts"]], own


def _position(text: str, decimal: str, length: float) -> Vector:
    parts = text.split()
    if len(parts) != 3:
        remedy = "give its coordinates in the body's frame, separated by blanks"
        raise refusal("", quoted(text), "three numbers", remedy)
    x, y, z = (parse_number(part, decimal) * length for part in parts)
    return x, y, z


def _lacks(cell: Mapping[str, str], said: Mapping[str, Any]) -> Iterator[Problem]:
    """Yield what a row lacks, or says of no meaning."""
    role, frame, quantity = said["role"], said.get("frame", FRAMES[0]), said.get("quantity", "")
    for name in ("file", "channel"):
        if not cell[name]:
            yield Problem("", "nothing", f"the {name}'s name", "fill the cell", name)
    if role not in ROLES:
        yield Problem("", quoted(role), f"one of {', '.join(ROLES)}", did_you_mean(role, ROLES, "correct it"), "role")
        return
    if frame not in FRAMES:
        yield Problem("", quoted(frame), f"one of {', '.join(FRAMES)}", "correct it", "frame")
    if quantity and quantity not in QUANTITIES[role]:
        expected = f"one of {', '.join(QUANTITIES[role])}, of a {role}"
        yield Problem("", quoted(quantity), expected, "correct it", "quantity")
    if role in (FORCE, RESPONSE, REFERENCE):
        yield from word_problems("drives", said["drives"])
        for name, example in (("point", "a point of the arm"), ("direction", "x, -z, ... or three numbers")):
            if not cell[name]:
                yield Problem("", "nothing", f"{example}, of a {role}", "fill the cell", name)
        if bool(cell.get("joint")) != bool(cell.get("position")):
            yield Problem("", "one of joint and position", "both, or neither", "fill the other cell", "position")


# -------- Channel template
# A channel table to fill in: what the files of a test say of their channels, and empty cells for what they do not.

COMMENTS = (
    "Fill in for each channel that counts: role (force, response; time where a channel holds the times), point of the",
    "arm (or a new name with joint and position [mm]), direction (x, -z, 0 0.6 -0.8) in the base's frame or the body's",
    "(frame: base, body), unit, posture q1, q2, ... and load, the sensors' mass included (0.2 kg @ tip).",
    "sensitivity: numbers of the file for one unit, or 100 mV/g; rate [Hz] where the file says none; decay [1/s] of an",
    "exponential window that the analyser has applied. A row without role is left out. `*` in a file: any letters.",
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
            again = [each for each in found[path.name].channels if table is None and ONE_NAME in each.flaw]
            for name, each in {each.name: each for each in again}.items():
                problems.append(Problem(one_line(str(path)), each.flaw, "a name for each channel", each.remedy, name))
        except LackingError:  # said once, not for each file
            raise
        except InputError as error:
            sound = table is None and isinstance(error, NoChannelError)
            (passed if sound else problems).extend(error.problems)
            if sound:
                found[path.name] = Recording(str(path), "", (), holds=error.problems[0].got)
    if not problems and (not found or (table is None and not any(each.names for each in found.values()))):
        expected = "recordings: .uff, .unv, .csv, .mat, .lvm, .tdms, .wav, .h5"
        got = "nodes and no channel" if found else "a folder without recordings"
        problems = passed or [Problem(one_line(str(folder)), got, expected, "name another folder")]
    refuse(problems)
    return found


def check_folder(folder: Path) -> None:
    """Refuse what is no folder."""
    if not os.path.isdir(folder):
        file = os.path.exists(folder)
        remedy = "name the folder of the recordings; a campaign is for `ident fit`" if file else which_file(folder)
        raise refusal(one_line(str(folder)), "a file" if file else "no such folder", "a folder of recordings", remedy)


def is_table(path: Path) -> bool:
    """Tell whether a CSV file is a channel table or a campaign: its header names none of samples."""
    if path.suffix.lower() not in (".csv", ".txt"):
        return False
    try:
        with path.open(encoding="utf-8-sig", errors="replace") as file:
            every = (line.strip() for line in iter(lambda: file.readline(LONGEST_LINE), ""))
            header = next((line for line in every if line and not line.startswith("#")), "")
    except OSError:  # who reads it says so
        return False
    head = {cell.strip().lower() for cell in re.split("[,;\t]", header)}
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
        raise refusal(one_line(str(path)), "a file that is there", "none", remedy)
    recordings = recordings_of(folder)
    rows = [row for name, recording in recordings.items() for row in _rows(name, recording)]
    passed = [f"Passed over: {guarded(name)}, {each.holds}." for name, each in recordings.items() if each.holds]
    angles = [f"q{i} [deg]" for i in range(1, joints + 1)]
    write_blank(path, [*COMMENTS, *passed], [*HEAD, *angles, "load", "note"], rows)
    return len(rows)


def write_blank(path: Path, comments: Iterable[str], columns: Sequence[str], rows: Iterable[Mapping[str, str]]) -> None:
    """Write a table to fill in, below lines that say how."""
    text = csv_text(columns, rows, comments)
    replace_file(path, lambda file: file.write(text.encode()), make_folders=True)


def _rows(name: str, recording: Recording) -> Iterator[dict[str, str]]:
    by_name = {channel.name: channel for channel in recording.channels}
    for each in recording.names:
        channel = by_name.get(each)
        flawed = channel is not None and bool(channel.flaw)
        role = {"force": FORCE, "acceleration": RESPONSE}.get(each.rpartition(" ")[2], "") if not flawed else ""
        of_force = (own.reference_unit for own in recording.channels if own.reference == each)
        said = channel.unit if channel else next(of_force, "")
        unit = said if _is_taken(said, role) else ""
        hint = "" if unit == said or flawed else f"in {one_line(said)!r}: write unit and sensitivity"
        note = [note_of(channel) if channel else "", hint, _place(recording, each)]
        yield {"file": name, "channel": each, "role": role, "unit": unit, "note": "; ".join(filter(None, note))}


def _is_taken(unit: str, role: str) -> bool:
    """Tell whether a row of this role, or of any, may have a unit: volts are none."""
    quantities = QUANTITIES[role] if role else dict.fromkeys(each for role in MEASURED for each in QUANTITIES[role])
    return any(sensor_factor(unit, quantity) is not None for quantity in quantities)


def note_of(channel: Channel) -> str:
    """Say what a file holds of a channel, or why it cannot be used."""
    if channel.flaw:
        return f"not to be used: {channel.flaw}; {channel.remedy}"
    blocks, samples = channel.values.shape
    step = f" at {1 / channel.step:.6g} Hz" if channel.step and not channel.reference else ""
    return f"{blocks} x {samples} {'lines' if channel.reference else 'samples'}{step}"


def _place(recording: Recording, channel: str) -> str:
    place = recording.places.get(channel.partition(":")[0])
    return f"node at {' '.join(f'{each:g}' for each in place)} in the file" if place else ""
