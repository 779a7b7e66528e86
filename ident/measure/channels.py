"""The channel table of a modal test: quantity, point, direction and unit of each channel of each file."""

import hashlib
import math
import os
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import Path

from ident.errors import InputError, Problem, refusal, refuse, require
from ident.files import replace_file
from ident.measure.campaign import WORDS
from ident.measure.columns import ABOVE_0, ANGLES, Number, Row, Rule, Word, read_rows
from ident.measure.kinds import DRIVE_STATES
from ident.measure.load import OWN_WEIGHT, Load, Vector, parse_direction
from ident.measure.recordings import Channel, LackingError, NoChannelError, Recording, is_recording, read_recording
from ident.measure.recordings.recording import ONE_NAME
from ident.measure.samples import NONE, Columns
from ident.measure.speeds import Speed, parse_speeds
from ident.measure.table import Findings, csv_text, guarded, parse_number, read_table
from ident.text import by_key, one_line, quoted, which_file
from ident.units import VOLTAGES, sensor_factor

FORCE, RESPONSE, REFERENCE, TIME, IGNORED = "force", "response", "reference", "time", "ignore"
ROLES = (FORCE, RESPONSE, REFERENCE, TIME, IGNORED)
"""Roles of a channel: the force, a response to it, the reference response of a test without force (all others are
correlated with it), the times of the samples, or ignored."""
AMBIENT, TAP, RELEASE = EXCITATIONS = "ambient", "tap", "release"
"""What moves the arm in a test without force: its surroundings, taps, or releases after a pull."""
_MOTION = ("acceleration", "velocity", "length")
QUANTITIES = {FORCE: ("force",), RESPONSE: _MOTION, REFERENCE: _MOTION, TIME: ("time",)}
"""Quantities that a channel of each role may measure; a length is a displacement."""
FRAMES = ("base", "body")
"""Frames of a direction's components: the base's, or that of the body that carries the point."""
VOLTS = re.compile(rf"(?P<number>[-+0-9.,eE]+)\s*(?P<volts>{'|'.join(VOLTAGES)})\s*/\s*(?P<unit>\S.*)")
"""A sensitivity as on a sensor's certificate."""


@dataclass(frozen=True, kw_only=True)
class RecordedChannel:
    """One channel of a recording, as a row of a table describes it.

    Attributes:
        where: `file:row` of the table.
        file: name of the recording, in the table's folder.
        channel: name of the channel in the recording.
        point: name of a point of the arm.
        frame: one of `FRAMES`, the frame of the direction's components.
        unit: of the measured quantity; empty to use the file's.
        sensitivity: file's number per `unit`; None where the file's numbers are in the unit already.
        in_volts: whether the sensitivity is in volts, whatever unit of voltage the file has.
        load: load case of the arm, sensors included.
    """

    where: str
    file: str
    channel: str
    point: str = ""
    frame: str = FRAMES[0]
    unit: str = ""
    sensitivity: float | None = None
    in_volts: bool = False
    load: Load = OWN_WEIGHT

    def scale(self, unit: str, quantities: Iterable[str], named: str, example: str) -> tuple[str, float]:
        """Return the measured quantity, a name in `ident.units.QUANTITIES`, and SI units per number of the file.

        Args:
            unit: of the file; empty if it has none.
            quantities: those the channel may measure.
            named: name of these quantities, for messages.
            example: a unit of these quantities.

        Raises:
            InputError: neither file nor table has a unit, they contradict each other, or it is of another quantity.
        """
        channel, said, quantities = f"channel {quoted(self.channel)}", self.unit or unit, tuple(quantities)
        expected = f"a unit such as {example}: neither the file nor the table has one"
        require(said, self.where, f"no unit of {channel}", expected, "fill the cell", "unit")
        factors = ((quantity, sensor_factor(said, quantity)) for quantity in quantities)
        quantity, factor = next(((q, factor) for q, factor in factors if factor is not None), ("", 0.0))
        expected = f"a unit of {named}, such as {example}"
        remedy = "correct the unit" if self.unit else "write the unit and the sensitivity into the table"
        require(quantity, self.where, f"{quoted(said)} of {channel}", expected, remedy, "unit")
        physical = any(sensor_factor(unit, each) is not None for each in quantities)
        if self.sensitivity is not None:
            got = f"a sensitivity of {channel}, whose file is in {quoted(unit or self.unit)}"
            expected = "numbers of the file for one unit of the table"
            fine = self.unit and not physical
            require(fine, self.where, got, expected, "leave the cell empty", "sensitivity")
            got = f"a sensitivity in volts of {channel}, whose file is in {quoted(unit or 'no unit')}"
            expected, remedy = f"a file in one of {', '.join(VOLTAGES)}", "write the file's number for one unit"
            require(not self.in_volts or unit in VOLTAGES, self.where, got, expected, remedy, "sensitivity")
            return quantity, factor / (self.sensitivity * (1 / VOLTAGES[unit] if self.in_volts else 1.0))
        by_file = sensor_factor(unit, quantity)
        fine = not unit or (by_file is not None and math.isclose(by_file, factor, rel_tol=1e-6))
        remedy = "correct one of them, or leave the cell empty" if physical else "give its sensitivity"
        require(fine, self.where, f"{quoted(said)} of {channel}", f"{quoted(unit)}, as in the file", remedy, "unit")
        return quantity, factor


@dataclass(frozen=True, kw_only=True)
class ChannelRow(RecordedChannel):
    """Row of a channel table; `*` in the name of its file stands for any letters.

    Attributes:
        role: one of `ROLES`.
        posture: (joints,) [rad] of the arm.
        joint: joint whose body carries the point, where the arm has no such point.
        position: (3,) [m] of that point in the body's frame.
        direction: (3,) [-] of the force or the response.
        quantity: measured quantity; empty to derive it from the unit.
        full_scale: [unit] overload limit of the input; None to judge by the largest numbers in the file.
        rate: [Hz] sampling rate; None to use the file's.
        decay: [1/s] of the exponential window that the analyser has applied to the response.
        drives: state of the drives.
        harmonics: turning parts and their speeds during a test without force.
        excitation: one of `EXCITATIONS`, of a test without force; empty to judge by the length of the record.
        taps: hits or taps to record in the files of that name, by the row of the force, or else of a response; 0 for
            any number.
    """

    role: str
    posture: tuple[float, ...]
    joint: str = ""
    position: Vector | None = None
    direction: Vector | None = None
    quantity: str = ""
    full_scale: float | None = None
    rate: float | None = None
    decay: float = 0.0
    drives: str = DRIVE_STATES[0]
    harmonics: tuple[Speed, ...] = ()
    excitation: str = ""
    taps: int = 0

    @property
    def counts(self) -> bool:
        """Whether the channel is a force or a response."""
        return self.role in (FORCE, RESPONSE, REFERENCE)


POSITIVE = Number("a number above 0", "correct it, or leave the cell empty", ABOVE_0)


def _position(text: str, decimal: str) -> Vector:
    parts, remedy = text.split(), "give its coordinates in the body's frame, separated by blanks"
    require(len(parts) == 3, "", quoted(text), "three numbers", remedy)
    x, y, z = (parse_number(part, decimal) for part in parts)
    return x, y, z


def _whole(text: str, decimal: str) -> int:
    value = POSITIVE(text, decimal)
    require(value == round(value), "", quoted(text), "a whole number", "correct it, or leave the cell empty")
    return round(value)


def _sensitivity(text: str, decimal: str) -> tuple[float, str | None]:
    """Return the file's number per unit, and the unit if it is in volts as on a certificate: 100 mV/g."""
    volts = VOLTS.fullmatch(text)
    if not volts:
        return POSITIVE(text, decimal), None
    return POSITIVE(volts["number"], decimal) * VOLTAGES[volts["volts"]], volts["unit"].strip("() ")


RECORDED = (
    Rule("file", needed="the file's name", required=True),
    Rule("channel", needed="the channel's name", required=True),
)
"""Rules of the columns that locate a channel: its file and its name there."""
NAMED = (*RECORDED, Rule("role", Word(ROLES), IGNORED, required=True))
"""Rules of the columns that every row fills in."""
DETAILS = (
    Rule("point", required=True),
    Rule("joint"),
    Rule("position", _position, None, quantities=("length",)),
    Rule("direction", parse_direction, None, required=True),
    Rule("frame", Word(FRAMES, suggestion=""), FRAMES[0]),
    Rule("quantity"),
    Rule("unit"),
    Rule("sensitivity", _sensitivity, (None, None)),
    Rule("full_scale", POSITIVE, None),
    Rule("rate", POSITIVE, None),
    Rule("decay", POSITIVE, 0.0),
    Rule("load", Load.parse),
)
"""Rules of the further columns of a row with a role."""
DRIVES, HARMONICS = Rule("drives", WORDS["drives"], DRIVE_STATES[0]), Rule("harmonics", parse_speeds)
EXCITATION, TAPS = Rule("excitation", Word(EXCITATIONS), ""), Rule("taps", _whole, 0)
RULES = (*NAMED, *DETAILS, DRIVES, HARMONICS, EXCITATION, TAPS, Rule("note"))
COLUMNS = tuple(rule.name for rule in RULES)
"""Names of the columns other than the joint angles `q1 [deg]`, ...; `position [mm]` has its unit in the header."""


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
        InputError: the file is unreadable or has errors; all are listed.
    """
    data, findings = read_table(path), Findings()
    needed = "channel", "see `ident modal --init`, which writes one to fill in"
    shown = f"one of {', '.join(COLUMNS)}, q1 [deg], ..."
    table = read_rows(data, path, (*RULES, ANGLES), findings, shown, *needed)
    rows = [row for row in map(_channel, table) if row]
    findings += [*(problem for row in table for problem in row.problems), *_repeated(rows)]
    refuse(findings)
    return ChannelTable(str(path), hashlib.sha256(data).hexdigest(), tuple(rows))


def _channel(row: Row) -> ChannelRow | None:
    """Return the channel of a row; None if the row has an error or a gap."""
    said, role = row.values(NAMED), row["role"].lower()
    if said["role"] == IGNORED:
        return None if row.problems else ChannelRow(where=row.where, posture=(), **said)
    posture = row.posture if role != TIME else ()
    said |= row.values((*DETAILS, HARMONICS, EXCITATION, TAPS))
    said["sensitivity"], own = said["sensitivity"] or (None, None)
    if own is not None and said["unit"] not in ("", own):
        remedy = "leave the cell `unit` empty, or write the same one"
        expected = f"volts for one {quoted(said['unit'])}, as in the column unit"
        row.add(quoted(row["sensitivity"]), expected, remedy, "sensitivity")
    if quantity := "length" if (named := said["quantity"].lower()) == "displacement" else named:
        known = Word(QUANTITIES.get(role, (quantity,)), suggestion="", of=f", of a {role}")
        row.attempt("quantity", known, quantity)
    if role in (FORCE, RESPONSE, REFERENCE):
        said["drives"] = row.value(DRIVES)
        row.need("point", f"a point of the arm for a {role}")
        row.need("direction", f"x, -z, ... or three numbers for a {role}")
        if bool(row["joint"]) != bool(row["position"]):
            row.add("one of joint and position", "both, or neither", "fill the other cell", "position")
    said |= {"quantity": quantity, "unit": said["unit"] if own is None else own, "in_volts": own is not None}
    return None if row.problems else ChannelRow(where=row.where, posture=posture, **said)


def _repeated(rows: list[ChannelRow]) -> Iterator[Problem]:
    """Yield one problem for each channel named by several rows, at least one of which counts."""
    for same in by_key(((row.file, row.channel), row) for row in rows).values():
        if len(same) > 1 and any(row.counts for row in same):
            count = "twice" if len(same) == 2 else f"{len(same)} times"
            got = f"{quoted(same[0].channel)} of {quoted(same[0].file)} {count}"
            yield Problem(same[1].where, got, "each channel once", "keep one row", "channel")


# -------- Channel template
# A channel table to fill in: the information that the files of a test hold, and empty cells for the rest.

COMMENTS = (
    "Fill in for each channel that counts: role (force, response; time where a channel holds the times), point of the",
    "arm (or a new name with joint and position [mm]), direction (x, -z, 0 0.6 -0.8) in the base's frame or the body's",
    "(frame: base, body), unit, posture q1, q2, ... and load, the sensors' mass included (0.2 kg @ tip).",
    "sensitivity: numbers of the file for one unit, or 100 mV/g; rate [Hz] where the file says none; decay [1/s] of an",
    "exponential window that the analyser has applied. A row without role is left out. `*` in a file: any letters.",
    "Without any force: a column harmonics for what turned meanwhile (2.25 Hz @ pulley 1 + 1450 rpm @ pump).",
)
LONGEST_LINE = 100_000
"""Characters of a header at most: a line of a sparse file may never end."""
MEASURED = (FORCE, RESPONSE, TIME)
"""Roles whose units are accepted for a channel of unknown role."""
HEAD = ("file", "channel", "role", "point", "direction", "frame", "unit", "sensitivity", "rate", "decay")


def recordings_of(folder: Path, table: ChannelTable | None = None, columns: Columns = NONE) -> dict[str, Recording]:
    """Return the recordings of a folder by file name, without channel tables and campaigns.

    Args:
        folder: folder of the recordings.
        table: names the files to read; others are listed without channels. None reads all, and lists files in which
            nothing was recorded without channels.
        columns: see `read_recording`.

    Raises:
        InputError: not a folder, no recordings in it, or some are unreadable; one line each.
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
            found[path.name] = read_recording(path, columns)
            again = [each for each in found[path.name].channels if table is None and ONE_NAME in each.flaw]
            for name, each in {each.name: each for each in again}.items():
                problems.append(Problem(one_line(str(path)), each.flaw, "a name for each channel", each.remedy, name))
        except LackingError:  # report it once, not for each file
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
    """Refuse a path that is not a folder."""
    if not os.path.isdir(folder):
        file = os.path.exists(folder)
        remedy = "name the folder of the recordings; a campaign is for `ident fit`" if file else which_file(folder)
        raise refusal(one_line(str(folder)), "a file" if file else "no such folder", "a folder of recordings", remedy)


def check_new(path: Path, remedy: str) -> None:
    """Refuse an existing file, so that none is overwritten."""
    require(not os.path.exists(path), one_line(str(path)), "a file that is there", "none", remedy)


def is_table(path: Path) -> bool:
    """Whether a CSV file is a channel table or a campaign, not samples, by its header."""
    if path.suffix.lower() not in (".csv", ".txt"):
        return False
    try:
        with path.open(encoding="utf-8-sig", errors="replace") as file:
            every = (line.strip() for line in iter(lambda: file.readline(LONGEST_LINE), ""))
            header = next((line for line in every if line and not line.startswith("#")), "")
    except OSError:  # the reader reports it
        return False
    head = {cell.strip().lower() for cell in re.split("[,;\t]", header)}
    return {"file", "channel"} <= head or {"kind", "value"} <= head


def write_template(folder: Path, path: Path, joints: int) -> int:
    """Write the channel table of a folder's recordings, and return its number of channels.

    Args:
        folder: folder of the recordings.
        path: file of the table.
        joints: number of joint angles in a posture.

    Raises:
        InputError: see `recordings_of`; or the file exists already.
    """
    check_new(path, "move it away, or name another by --channels")
    recordings = recordings_of(folder)
    rows = [row for name, recording in recordings.items() for row in _rows(name, recording)]
    passed = [f"Passed over: {guarded(name)}, {each.holds}." for name, each in recordings.items() if each.holds]
    angles = [f"q{i} [deg]" for i in range(1, joints + 1)]
    write_blank(path, [*COMMENTS, *passed], [*HEAD, *angles, "load", "note"], rows)
    return len(rows)


def write_blank(path: Path, comments: Iterable[str], columns: Sequence[str], rows: Iterable[Mapping[str, str]]) -> None:
    """Write a table to fill in, below comment lines that explain how."""
    replace_file(path, lambda file: file.write(csv_text(columns, rows, comments).encode()), make_folders=True)


def _rows(name: str, recording: Recording) -> Iterator[dict[str, str]]:
    by_name = {channel.name: channel for channel in recording.channels}
    for each in recording.names:
        channel = by_name.get(each)
        flawed = channel is not None and bool(channel.flaw)
        role = {"force": FORCE, "acceleration": RESPONSE}.get(each.rpartition(" ")[2], "") if not flawed else ""
        of_force = (own.reference_unit for own in recording.channels if own.reference == each)
        said = channel.unit if channel else next(of_force, "")
        possible = QUANTITIES[role] if role else (each for role in MEASURED for each in QUANTITIES[role])
        unit = said if any(sensor_factor(said, quantity) is not None for quantity in possible) else ""
        hint = "" if unit == said or flawed else f"in {one_line(said)!r}: write unit and sensitivity"
        place = recording.places.get(each.partition(":")[0])
        where = f"node at {' '.join(f'{x:g}' for x in place)} in the file" if place else ""
        note = [note_of(channel) if channel else "", hint, where]
        yield {"file": name, "channel": each, "role": role, "unit": unit, "note": "; ".join(filter(None, note))}


def note_of(channel: Channel) -> str:
    """Return the size and rate of a channel's data, or why it cannot be used."""
    if channel.flaw:
        return f"not to be used: {channel.flaw}; {channel.remedy}"
    blocks, samples = channel.values.shape
    step = f" at {1 / channel.step:.6g} Hz" if channel.step and not channel.reference else ""
    return f"{blocks} x {samples} {'lines' if channel.reference else 'samples'}{step}"
