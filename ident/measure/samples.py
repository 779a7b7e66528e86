"""Tables of samples as instruments, phones and controllers write them, with the header that ident writes."""

import csv
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from types import MappingProxyType

from ident.measure.table import (
    DELIMITERS,
    IS_NUMBER,
    Findings,
    Record,
    csv_line,
    decimal_mark,
    name_and_unit,
    records_of,
    sheet_text,
)
from ident.text import decode, one_line
from ident.units import VOLTAGES, sensor_factor

TIME = "time"
"""Name of the column of times."""
Columns = Mapping[str, str]
"""Headers by a file's own names of its columns, `{"actual_q_0": "joint1 [rad]"}`: what the option `columns` says."""
NONE: Columns = MappingProxyType({})
"""A file that says all of its columns itself."""

HEAD_MAX = 400
"""Lines in which the header is looked for; assumed."""
CLOCK = re.compile(r"(?:elapsed )?(?:t|times?|time ?stamps?|zeit|seconds|sec|date(?:[ /_-]?time)?)", re.IGNORECASE)
"""Names of the column of times."""
MEASURED = ("time", "angle", "length", "velocity", "acceleration", "force", "moment", "frequency")
"""Quantities by whose units a text in round brackets, or after a slash, is a unit."""
LINEAR = re.compile(r"\blin[eé]a", re.IGNORECASE)
"""Names of linear acceleration, from which a phone has taken gravity by a filter, in the languages of phyphox."""
FILTERED_BELOW = 1.0
"""Frequency [Hz] below which that filter has changed it; assumed."""
FILTERED = f"the phone has filtered linear acceleration: do not trust it below {FILTERED_BELOW:g} Hz"
NO_UNIT = ("", "-", "1", "%", "°C", "degC")
"""Cells in a row of units next to columns that have none that is known here."""
LETTERS = "smgGNV°"
"""Units of one letter that a text in round brackets, or after a slash, may be."""
_HEADED = re.compile(r"(?P<name>.*?\S)\s*(?:\((?P<round>.+)\)|/\s*\(?(?P<slash>[^()]+?)\)?)")
SLOWEST = 10
"""Longest step [s] of a recording whose times count seconds since 1970; assumed."""
_COUNT = re.compile(r"([0-9]+)(\.[0-9]+)?")
_SINCE_1970 = {10: (1, "s"), 13: (1_000, "ms"), 16: (1_000_000, "us"), 19: (1_000_000_000, "ns")}
"""Rate [1/s] and unit of numbers that count since 1970, by their digits: from 2001 to 2286."""


@dataclass(frozen=True)
class Convention:
    """Units that a program leaves out of its header.

    Attributes:
        program: its name.
        mark: a column by which its files are known.
        units: of columns, by their names.
    """

    program: str
    mark: str
    units: Mapping[str, str]


CONVENTIONS = (
    Convention("Klipper", "accel_x", {"time": "s", "accel_[xyz]": "mm/s^2"}),
    Convention(
        "UR's RTDE",
        "(?:actual|target)_q_?0",
        {
            "timestamp": "s",
            r"(?:actual|target)_q_?\d": "rad",
            r"(?:actual|target)_qd_?\d": "rad/s",
            r"actual_tool_accelerometer_?\d": "m/s^2",
        },
    ),
)


@dataclass(frozen=True)
class Samples:
    """Records of a table of samples.

    Attributes:
        file: its name, for messages.
        delimiter: between its cells.
        records: header, with cells `name [unit]`, and rows.
        remarks: what was taken from the convention of a program, or left out.
    """

    file: str
    delimiter: str
    records: list[Record]
    remarks: tuple[str, ...]


def read_samples(
    data: bytes, path: str | Path, columns: Columns, findings: Findings, *needed: str, by_instrument: bool = False
) -> Samples:
    """Return the records of a table of samples.

    Units may stand in square or round brackets, after a slash or in a row of their own; the header may follow lines of
    text, or # or %; cells may be separated by blanks; times may be dates or count since 1970.

    Args:
        data: the bytes.
        path: names the file in messages.
        columns: headers by names of the file, for what it does not say itself.
        findings: takes the problems.
        needed: expectation and remedy for a table without rows.
        by_instrument: see `ident.text.decode`.

    Raises:
        InputError: not a text, numbers without a header, or too few rows.
    """
    from ident.measure.robot_logs import is_binary_log, text_of

    file, remarks = one_line(str(path)), list[str]()
    if file.lower().endswith(".xlsx"):
        text = sheet_text(data, file)
    elif is_binary_log(data):
        text, said = text_of(data, file)
        remarks += [f"{file}: {remark}" for remark in said]
    else:
        text = decode(data, file, by_instrument=by_instrument)
    text = _with_header_first(text, file, remarks)
    file, delimiter, records = records_of(text, path, _is_column, findings, *needed)
    if records:
        where, cells = records[0]
        records[0] = where, list(_spelled(cells, columns, file, remarks))
        mark = decimal_mark(delimiter, (cell for _, cells in records[1:20] for cell in cells))
        records = _since_start(records, mark, remarks)
    return Samples(file, delimiter, records, tuple(remarks))


def _is_column(cell: str) -> bool:
    return bool(CLOCK.fullmatch(cell) or split_header(cell)[1])


def split_header(cell: str) -> tuple[str, str]:
    """Split `name [unit]`, `name (unit)` or `name/unit`; the unit may be empty."""
    name, unit = name_and_unit(cell.strip())
    found = _HEADED.fullmatch(name) if not unit else None
    other = (found["round"] or found["slash"]).strip() if found else ""
    return (found["name"], other) if found and _is_unit(other) else (name, unit)


def _is_unit(text: str) -> bool:
    """Whether a text is a unit; of single letters those that sensors have, for `Re(a)` has no year."""
    fits = len(text) > 1 or text in LETTERS
    return fits and (text in VOLTAGES or any(sensor_factor(text, quantity) is not None for quantity in MEASURED))


# -------- Text
# The header comes first, lines above it and a row of units become comments: the numbers of lines stay.


def _with_header_first(text: str, file: str, remarks: list[str]) -> str:
    """Return the text of a table whose first line without # is its header, if one can be told from its rows."""
    lines = text.splitlines(keepends=True)
    filled = [place for place, line in enumerate(lines[:HEAD_MAX]) if line.strip(DELIMITERS + " \r\n\"'")]
    row = next((lines[place] for place in reversed(filled) if not _is_comment(lines[place])), "")
    delimiter = max((*DELIMITERS, " "), key=lambda mark: _numbers(_cells(row, mark)))
    found = _head([(place, lines[place]) for place in filled], _cells(row, delimiter), delimiter)
    if found is None:
        return text
    head, units = found
    if above := [place for place in filled if place < head and not _is_comment(lines[place])]:
        which = f"lines {above[0] + 1} to {above[-1] + 1}" if above[1:] else f"line {above[0] + 1}"
        remarks.append(f"{file}: left out above the header: {which}")
    cells, rows = _cells(lines[head], delimiter), lines[head + 1 :]
    if units is not None:
        pairs = zip(cells, (unit.strip("[]()") for unit in _cells(lines[units], delimiter)), strict=True)
        cells = [cell if unit in NO_UNIT else f"{cell} [{unit}]" for cell, unit in pairs]
        rows[units - head - 1] = "#\n"
    if delimiter == " ":  # several blanks in a row are one
        delimiter, rows = "\t", ["\t".join(line.split()) + "\n" for line in rows]
    return "".join(["#\n"] * head + [csv_line(cells, delimiter)] + rows)


def _head(lines: Sequence[tuple[int, str]], row: Sequence[str], delimiter: str) -> tuple[int, int | None] | None:
    """Return the number of the last line of names above rows like one of the table, and that of a row of units.

    None without such a line, or with rows on both sides of it.
    """
    head, units, below, count = None, None, list[str](), _numbers(row)
    for place, line in reversed(lines if row else ()):
        cells = _cells(line, delimiter)
        fits, numbers = len(cells) == len(row), _numbers(cells)
        if fits and not numbers and (head is None or (units is None and _are_units(below))):
            head, units, below = place, head, cells
        elif not _is_comment(line) and (not fits if head is None else fits and numbers >= count):
            return None  # no header, but a broken row
    return None if head is None else (head, units)


def _is_comment(line: str) -> bool:
    return line.lstrip().startswith(("#", "%"))


def _are_units(cells: Sequence[str]) -> bool:
    inside = [cell.strip("[]()") for cell in cells]
    return all(cell in NO_UNIT or _is_unit(cell) for cell in inside) and any(map(_is_unit, inside))


def _cells(line: str, delimiter: str) -> list[str]:
    """Return the cells of a line, without a mark of comments in front of it."""
    bare = line.lstrip(" \t#%") if _is_comment(line) else line
    try:
        cells = next(csv.reader([bare.strip(" \r\n")], delimiter=delimiter, skipinitialspace=True))
        return [cell.strip() for cell in cells]
    except (csv.Error, StopIteration):
        return []


def _numbers(cells: Sequence[str]) -> int:
    """Return how many cells are numbers or dates."""
    return sum(bool(IS_NUMBER(cell.replace(",", ".")) or _date(cell)) for cell in cells)


# -------- Header and times


def _spelled(cells: Sequence[str], columns: Columns, file: str, remarks: list[str]) -> Iterator[str]:
    """Yield the cells of a header as ident writes them."""
    pairs = [split_header(cell) for cell in cells]
    names = [name for name, _ in pairs]
    known = next((c for c in CONVENTIONS if any(re.fullmatch(c.mark, name) for name in names)), None)
    taken = dict[str, list[str]]()
    clocks = [name for name in names if CLOCK.fullmatch(name)]
    for cell, (name, unit) in zip(cells, pairs, strict=True):
        new, own = split_header(columns.get(name, columns.get(cell, "")))
        if not (own or unit) and known:
            own = next((unit for column, unit in known.units.items() if re.fullmatch(column, name)), "")
            taken.setdefault(own, []).append(name)
        name, unit = new or name, own or unit
        if CLOCK.fullmatch(name) and clocks == [name] and (unit or known):
            name = TIME
        yield f"{name} [{unit}]" if unit else name
    if any(LINEAR.search(name) and sensor_factor(unit, "acceleration") for name, unit in pairs):
        remarks.append(f"{file}: {FILTERED}")
    if columns and not {*columns} & {*names, *cells}:
        remarks.append(f"{file}: has none of the columns {', '.join(columns)} that the option columns names")
    if known and taken:
        words = "; ".join(f"{', '.join(own)} in {unit}" for unit, own in taken.items() if unit)
        remarks.append(f"{file}: {words}, as {known.program} writes them")


def _since_start(records: list[Record], mark: str, remarks: list[str]) -> list[Record]:
    """Return records with dates, and counts since 1970, as seconds since the first row."""
    (where, header), rows = records[0], records[1:]
    place = next((i for i, cell in enumerate(header) if CLOCK.fullmatch(split_header(cell)[0])), None)
    times = [] if place is None else [cells[place].replace(mark, ".") for _, cells in rows if len(cells) > place]
    if not times or place is None:
        return records
    date, (whole, part) = _date(times[0]), _count(times[0]) or (0, 0.0)
    digits = len(times[0].partition(".")[0]) if _count(times[0]) and not split_header(header[place])[1] else 0
    rate, unit = _SINCE_1970.get(digits, (0, ""))
    second = _count(times[1]) if times[1:] else None
    # a counter of 10 digits may as well be one of microseconds: its rows are not seconds apart
    counter = rate == 1 and second is not None and second[0] - whole > SLOWEST
    if counter or (not rate and date is None):
        return records

    def seconds(text: str) -> float | None:
        if rate:
            own = _count(text)
            return None if own is None else ((own[0] - whole) + (own[1] - part)) / rate
        own_date = _date(text)
        return None if own_date is None or date is None else (own_date - date).total_seconds()

    words = f"in {unit} since 1970" if rate else "dates"
    remarks.append(f"{where.rpartition(':')[0]}: times are {words}; they count from the first row here")
    made = [(where, [*header[:place], f"{TIME} [s]", *header[place + 1 :]])]
    for at, cells in rows:
        passed = seconds(cells[place].replace(mark, ".")) if len(cells) > place else None
        if passed is not None:
            cells = [*cells[:place], repr(passed).replace(".", mark), *cells[place + 1 :]]
        made.append((at, cells))
    return made


def _count(text: str) -> tuple[int, float] | None:
    """Return whole and broken part of a plain number, as a float has too few digits for both; None for another."""
    found = _COUNT.fullmatch(text)
    return (int(found[1]), float(f"0{found[2] or ''}")) if found else None


def _date(text: str) -> datetime | None:
    """Return a date with its time of day; None for another text."""
    if len(text) < 16 or text[4] not in "-/":
        return None
    try:
        date = datetime.fromisoformat(text.replace("/", "-").replace(",", "."))
    except ValueError:
        return None
    return date if date.tzinfo else date.replace(tzinfo=UTC)
