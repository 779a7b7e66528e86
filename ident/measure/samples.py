"""Tables of samples as instruments, phones and controllers write them, with the header that ident writes."""

import csv
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from types import MappingProxyType

from ident.measure.table import DELIMITERS, IS_NUMBER, Findings, Record, csv_line, decimal_mark, records_of, sheet_text
from ident.text import decode, one_line
from ident.units import VOLTAGES, sensor_factor

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
NO_UNIT = ("", "-", "1", "%", "°C", "degC")
"""Cells in a row of units next to columns that have none that is known here."""
LETTERS = "smgGNV°"
"""Units of one letter that a text in round brackets, or after a slash, may be."""
_HEADED = re.compile(r"(?P<name>.*?\S)\s*(?:\((?P<round>.+)\)|/\s*\(?(?P<slash>[^()]+?)\)?)")
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


SLOWEST = 10
"""Longest step [s] of a recording whose times count seconds since 1970; assumed."""
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
        remarks += said
    else:
        text = decode(data, file, by_instrument=by_instrument)
    text = _with_header_first(text, file, remarks)
    is_column = lambda cell: bool(CLOCK.fullmatch(cell) or split_header(cell)[1])  # noqa: E731
    file, delimiter, records = records_of(text, path, is_column, findings, *needed)
    if records:
        where, cells = records[0]
        records[0] = where, list(_spelled(cells, columns, file, remarks))
        mark = decimal_mark(delimiter, (cell for _, cells in records[1:20] for cell in cells))
        records = _since_start(records, mark, remarks)
    return Samples(file, delimiter, records, tuple(remarks))


def split_header(cell: str) -> tuple[str, str]:
    """Split `name [unit]`, `name (unit)` or `name/unit`; the unit may be empty."""
    name, bracket, unit = cell.strip().partition("[")
    if bracket:
        return name.strip(), unit.removesuffix("]").strip()
    found = _HEADED.fullmatch(name.strip())
    unit = (found["round"] or found["slash"] or "").strip() if found else ""
    return (found["name"], unit) if found and _is_unit(unit) else (name.strip(), "")


def _is_unit(text: str) -> bool:
    """Whether a text is a unit; of single letters those that sensors have, for `Re(a)` has no year."""
    fits = len(text) > 1 or text in LETTERS
    return fits and (text in VOLTAGES or any(sensor_factor(text, quantity) is not None for quantity in MEASURED))


# -------- Text
# The header comes first, lines above it and a row of units become comments: the numbers of lines stay.


def _with_header_first(text: str, file: str, remarks: list[str]) -> str:
    """Return the text of a table whose first line without # is its header, if one can be told from its rows."""
    lines = text.splitlines(keepends=True)
    places = [place for place, line in enumerate(lines[:HEAD_MAX]) if line.strip(DELIMITERS + " \r\n\"'")]
    last = next((lines[place] for place in reversed(places) if not lines[place].lstrip().startswith(("#", "%"))), "")
    delimiter = max((*DELIMITERS, " "), key=lambda mark: _numbers(_cells(last, mark)))
    if len(places) < 2 or not (width := len(_cells(last, delimiter))):
        return text
    header, units, count = None, None, _numbers(_cells(last, delimiter))
    for place in reversed(places):
        marked = lines[place].lstrip().startswith(("#", "%"))
        cells = _cells(lines[place].lstrip(" \t#%") if marked else lines[place], delimiter)
        plain = len(cells) == width and not _numbers(cells)
        if header is not None:
            if units is None and plain and _are_units(header[1]):
                header, units = (place, cells), header
            elif not marked and len(cells) == width and _numbers(cells) >= count:
                return text  # rows on both sides: no header but a broken row
        elif plain:
            header = place, cells
        elif not marked and len(cells) != width:
            return text
    if header is None:
        return text
    place, cells = header
    above = [number for number in places if number < place and not lines[number].lstrip().startswith("#")]
    if delimiter != " " and units is None and not above and not lines[place].lstrip().startswith(("#", "%")):
        return text
    if units is not None:
        pairs = [(cell, unit.strip("[]()")) for cell, unit in zip(cells, units[1], strict=True)]
        cells = [cell if unit in NO_UNIT else f"{cell} [{unit}]" for cell, unit in pairs]
    if above := [number for number in above if not lines[number].lstrip().startswith("%")]:
        last = f" to {above[-1] + 1}" if above[1:] else ""
        remarks.append(f"{file}: line{'s' * bool(above[1:])} {above[0] + 1}{last} above the header were not read")
    tab = "\t" if delimiter == " " else delimiter
    rows = lines[place + 1 :] if tab == delimiter else ["\t".join(line.split()) + "\n" for line in lines[place + 1 :]]
    if units is not None:
        rows[units[0] - place - 1] = "#\n"
    return "".join(["#\n"] * place + [csv_line(cells, tab)] + rows)


def _are_units(cells: Sequence[str]) -> bool:
    inside = [cell.strip("[]()") for cell in cells]
    return all(cell in NO_UNIT or _is_unit(cell) for cell in inside) and any(map(_is_unit, inside))


def _cells(line: str, delimiter: str) -> list[str]:
    try:
        return [
            cell.strip() for cell in next(csv.reader([line.strip(" \r\n")], delimiter=delimiter, skipinitialspace=True))
        ]
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
            name = "time"
        yield f"{name} [{unit}]" if unit else name
    if columns and not {*columns} & {*names, *cells}:
        remarks.append(f"{file}: has none of the columns {', '.join(columns)} that the option columns names")
    if known and taken:
        words = "; ".join(f"{', '.join(own)} in {unit}" for unit, own in taken.items() if unit)
        remarks.append(f"{file}: {words}, as {known.program} writes them")


def _since_start(records: list[Record], mark: str, remarks: list[str]) -> list[Record]:
    """Return records with dates, and counts since 1970, as seconds since the first row."""
    header = records[0][1]
    place = next((i for i, cell in enumerate(header) if CLOCK.fullmatch(split_header(cell)[0])), None)
    if place is None or len(records) < 2 or len(records[1][1]) <= place:
        return records
    first, unit = records[1][1][place].replace(mark, "."), split_header(header[place])[1]
    counts = not unit and re.fullmatch(r"\d+(?:\.\d+)?", first)
    rate, of = _SINCE_1970.get(len(first.partition(".")[0]), (0, "")) if counts else (0, "")
    start, (whole, part) = _date(first), _count(first)
    # a controller's or an Arduino's counter of 10 digits is in us: its rows are not seconds apart
    slow = rate == 1 and len(records) > 2 and _count(records[2][1][place].replace(mark, "."))[0] - whole > SLOWEST
    if slow or (not rate and start is None):
        return records
    words = f"in {of} since 1970" if rate else "dates"
    remarks.append(f"{records[0][0].rpartition(':')[0]}: times are {words}; they count from the first row here")
    kept = [(records[0][0], [*header[:place], "time [s]", *header[place + 1 :]])]
    for where, cells in records[1:]:
        text, seconds = cells[place].replace(mark, ".") if len(cells) > place else "", None
        if rate and re.fullmatch(r"\d+(?:\.\d+)?", text):
            own = _count(text)
            seconds = ((own[0] - whole) + (own[1] - part)) / rate
        elif start is not None and (date := _date(text)) is not None:
            seconds = (date - start).total_seconds()
        written = cells if seconds is None else [*cells[:place], repr(seconds).replace(".", mark), *cells[place + 1 :]]
        kept.append((where, written))
    return kept


def _count(text: str) -> tuple[int, float]:
    """Return whole and broken part of a number: a float has too few digits for both."""
    whole, _, part = text.partition(".")
    digits = whole.isdecimal() and whole.isascii() and (part or "0").isdecimal() and part.isascii()
    return (int(whole), float(f"0.{part or 0}")) if digits else (0, 0.0)


def _date(text: str) -> datetime | None:
    """Return a date with its time of day; None for another text."""
    if len(text) < 16 or text[4] not in "-/":
        return None
    try:
        date = datetime.fromisoformat(text.replace("/", "-").replace(",", "."))
    except ValueError:
        return None
    return date if date.tzinfo else date.replace(tzinfo=UTC)
