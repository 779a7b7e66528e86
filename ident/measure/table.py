"""Text into records: comments, delimiter and quoting of a CSV file, each record with its row."""

import csv
import io
import math
import re
import zipfile
from collections import Counter
from collections.abc import Callable, Hashable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import chain, zip_longest
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

from ident.errors import InputError, Problem, refusal, refuse, require
from ident.text import LARGEST_TEXT, decode, one_line, quoted, read_bytes

# -------- Spreadsheet
# An Excel sheet (`.xlsx`) as the text of a CSV file, row by row, so that all checks and row numbers are the same.

LARGEST = 500_000_000
"""Bytes of the unpacked sheets at most: a campaign has fewer."""
FAILED = ("#N/A", "#REF!", "#VALUE!", "#DIV/0!", "#NAME?", "#NUM!", "#NULL!")
"""Values that spreadsheet programs store for failed formulas."""
EXPECTED = "a table as CSV or Excel sheet (.xlsx)"


def sheet_text(data: bytes, file: str) -> str:
    """Return the first sheet as CSV with commas, one line a row; `file` names it in errors.

    Raises:
        InputError: not an Excel sheet, too large, formulas without a computed value, or openpyxl is not installed.
    """
    try:
        from openpyxl import load_workbook
    except ImportError:
        remedy = "pip install openpyxl, or save the sheet as CSV"
        raise refusal(file, "an Excel sheet without the package openpyxl", EXPECTED, remedy) from None
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            size = sum(entry.file_size for entry in archive.infolist())
        got, most = f"{size / 1e6:.0f} MB when unpacked", f"at most {LARGEST / 1e6:.0f} MB"
        require(size <= LARGEST, file, got, most, "keep one sheet, or save it as CSV")
        values, formulas = (
            _rows(load_workbook(io.BytesIO(data), read_only=True, data_only=computed)) for computed in (True, False)
        )
    except InputError:
        raise
    except Exception as error:  # openpyxl lets KeyError, ValueError, zip and XML errors of damaged files through
        got = f"a damaged file, or another archive ({type(error).__name__})"
        raise refusal(file, got, EXPECTED, "save it again") from None
    _check_formulas(values, formulas, file)
    lines = [[_written(value) for value in row] for row in values]
    for cells in lines:
        while cells and not cells[-1]:  # empty cells at the end of a row
            cells.pop()
    width = next((len(cells) for cells in lines if cells and not cells[0].startswith("#")), 0)
    text = io.StringIO()
    for cells in lines:
        if cells and not cells[0].startswith("#"):
            csv.writer(text, lineterminator="\n").writerow([*cells, *[""] * (width - len(cells))])
        else:  # a comment stays a comment, and an empty row becomes an empty line
            text.write(" ".join(filter(None, cells)) + "\n")
    return text.getvalue()


def _rows(book: Any) -> list[tuple[Any, ...]]:
    """Return the cells of the first sheet, without empty rows at its end."""
    sheet = book.worksheets[0]
    sheet.reset_dimensions()  # the file's own size entry is unreliable
    rows = [tuple(row) for row in sheet.iter_rows(values_only=True)]
    while rows and all(cell is None for cell in rows[-1]):
        rows.pop()
    return rows


def _check_formulas(values: list[tuple[Any, ...]], formulas: list[tuple[Any, ...]], file: str) -> None:
    """Refuse failed formulas, and those without a stored value.

    Raises:
        InputError: there are some; each with its row.
    """
    problems = []
    for number, (row, known) in enumerate(zip_longest(formulas, values, fillvalue=()), 1):
        for cell, value in zip_longest(row, known):
            if isinstance(value, str) and value in FAILED:
                problems.append(Problem(f"{file}:{number}", value, "a value", "correct the formula"))
            elif isinstance(cell, str) and cell.startswith("=") and value is None:
                got, remedy = f"the formula {cell[:40]} without its value", "save it in a spreadsheet program"
                problems.append(Problem(f"{file}:{number}", got, "a value", remedy))
    refuse(problems)


def _written(value: Any) -> str:
    """Return a cell on one line; whole numbers without a decimal point."""
    if value is None:
        return ""
    if isinstance(value, float):
        return repr(int(value)) if value.is_integer() and abs(value) < 1e15 else repr(value)
    return " ".join(str(value).split())


# -------- Table

P = ParamSpec("P")
T = TypeVar("T")
Key = TypeVar("Key", bound=Hashable)

DELIMITERS = ",;\t"
"""Recognised column delimiters."""

FOREIGN = {
    **dict.fromkeys((".xlsm", ".xls", ".xlsb", ".ods"), "a spreadsheet"),
    **dict.fromkeys((".uff", ".unv", ".uf", ".bunv"), "a universal file (UFF)"),
    **dict.fromkeys((".mat", ".h5", ".hdf5", ".nc", ".tdms", ".wav", ".npz", ".npy"), "a binary file of samples"),
    **dict.fromkeys((".json", ".html", ".pdf", ".png"), "no table"),
    **dict.fromkeys((".toml", ".urdf", ".xml"), "an arm description"),
}
"""Kinds of files other than tables, by ending."""

_FORMULA = re.compile(r"""(^|[;,\t\r\n])(?=[\s'"]*[=+\-@])""")
_GUARDED = re.compile(r"""(^|[;,\t\r\n])'(?=[\s'"]*[=+\-@])""")
"""Starts of cells, or parts of cells, that a spreadsheet program would compute; and guarded ones."""
_DECIMAL_MARK = re.compile(r"(?<![\w.,])[+-]?[0-9]*([.,])[0-9]")

Record = tuple[str, list[str]]
"""The place `file:row` at which a record starts, and its cells without blanks around them."""


class Findings(list[Problem]):
    """Problems collected while reading goes on, so that all are reported."""

    def attempt(self, where: str, column: str, read: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs) -> T | None:
        """Return the result of `read`; on InputError note its problems and return None."""
        try:
            return read(*args, **kwargs)
        except InputError as error:
            self.extend(replace(p, where=where, column=column or p.column) for p in error.problems)
            return None


def read_table(path: str | Path, largest: int = LARGEST_TEXT) -> bytes:
    """Return the bytes of a CSV file, or of an Excel sheet (`.xlsx`).

    Raises:
        InputError: the file is missing, unreadable or larger than `largest` bytes, or its ending is that of another
            kind of file.
    """
    kind = FOREIGN.get(Path(path).suffix.lower(), "")
    sheet = " or .xlsx" if kind == FOREIGN[".xls"] else ""
    remedy = f"export it as CSV{sheet}; data/README.md shows the columns"
    remedy = "name the measurements, and this as `arm`" if kind == FOREIGN[".toml"] else remedy
    require(not kind, one_line(str(path)), kind, "a table as CSV", remedy)
    return read_bytes(path, "a readable CSV file", largest)


def records_of(
    data: bytes | str, path: str | Path, is_column: Callable[[str], bool], findings: Findings, *needed: str
) -> tuple[str, str, list[Record]]:
    """Return a table's name for messages, its delimiter and its records; note malformed records.

    A header may follow # or %, as NumPy and MATLAB write it.

    Args:
        data: the bytes of the file: CSV, or an `.xlsx` file, whose first sheet counts; or the text of a CSV file.
        path: names it.
        is_column: whether a name may be that of a column; decides on the delimiter.
        findings: takes the problems.
        needed: expectation and remedy for a table without rows; nothing if no rows are fine.

    Raises:
        InputError: not a text, numbers without a header, or too few rows.
    """
    file = one_line(str(path))
    if isinstance(data, bytes):
        data = sheet_text(data, file) if file.lower().endswith(".xlsx") else text_in(data, file)
    text = _uncommented(data)
    delimiter = sniff_delimiter(text, is_column)
    records = list(read_records(text, delimiter, file, findings))
    where, header = records[0] if records else ("", [])
    counts = [[*map(str, range(first, first + len(header)))] for first in (0, 1)]  # as pandas heads what has no names
    named = not _is_numeric(" ".join(header)) or (len(header) > 2 and header in counts)
    got, remedy = f"numbers only: {quoted(delimiter.join(header))}", "write a line above with a name for each column"
    require(named, where, got, "a header", remedy)
    if needed and len(records) < 2:
        (each, remedy), got = needed, "only one row" if records else "no row"
        raise InputError([*findings, Problem(file, got, f"a header and a row for each {each}", remedy)])
    return file, delimiter, records


def text_in(data: bytes, file: str, *, by_instrument: bool = False) -> str:
    """Return the text of a table, see `decode`, or a robot's or a phone's file as such a text."""
    from ident.measure.robot_logs import is_binary_log, text_of

    return text_of(data, file)[0] if is_binary_log(data) else decode(data, file, by_instrument=by_instrument)


def _uncommented(text: str) -> str:
    """Return the text with # or % removed from a header directly above numbers in as many columns."""
    at, start, marked, line = 0, 0, "", ""
    for line in io.StringIO(text, newline=""):
        if line.lstrip().startswith(("#", "%")):
            start, marked = at, line
        elif line.strip(DELIMITERS + " \r\n"):
            break
        at += len(line)
    header = marked.lstrip(" \t#%")
    delimiter = max(DELIMITERS, key=header.count)
    if header.count(delimiter) != line.count(delimiter) or not _is_numeric(line) or not header or _is_numeric(header):
        return text
    return text[:start].replace("%", "#") + header + text[start + len(marked) :]


def _is_numeric(line: str) -> bool:
    """Whether a line has numbers only."""
    cells = [cell for cell in re.split(r'[,;\s"]+', line) if cell]
    return bool(cells) and all(map(IS_NUMBER, cells))


def fitting(records: list[Record], columns: int, delimiter: str, findings: Findings) -> list[Record]:
    """Return the rows with as many cells as the header, and note the others."""
    findings += [misfit(where, len(cells), columns, delimiter) for where, cells in records if len(cells) != columns]
    return [(where, cells) for where, cells in records if len(cells) == columns]


def doubled(where: str, names: Sequence[str]) -> Iterator[Problem]:
    """Yield the duplicate columns of a header."""
    for name in sorted({name for name in names if names.count(name) > 1}):
        yield Problem(where, "the column twice", "it once", "remove or rename one", name)


def name_and_unit(cell: str) -> tuple[str, str]:
    """Split a header cell `name [unit]`; the unit may be empty."""
    match = re.fullmatch(r"([^\[\]]*?)\s*(?:\[([^\]]*)\])?", cell)
    return (match[1], (match[2] or "").strip()) if match else (cell, "")


def csv_text(columns: Sequence[str], rows: Iterable[Mapping[str, str]], comments: Iterable[str] = ()) -> str:
    """Return rows as CSV under their columns, below comments, without cells of other columns.

    Names come from files of others, so no cell may stay a formula.
    """
    text = io.StringIO()
    text.writelines(f"# {one_line(line)}".rstrip() + "\n" for line in comments)
    writer = csv.DictWriter(text, columns, restval="", extrasaction="ignore", lineterminator="\n")
    writer.writeheader()
    writer.writerows({name: guarded(cell) for name, cell in row.items()} for row in rows)
    return text.getvalue()


def guarded(cell: str) -> str:
    """Return a cell that no spreadsheet program takes for a formula, even if it splits it at another delimiter.

    An apostrophe goes before anything it would compute, except numbers and directions; `read_records` removes it.
    """
    return cell if re.fullmatch(rf"{NUMBER}|[+-][xyz]", cell) else _FORMULA.sub(r"\1'", cell)


def sniff_delimiter(text: str, is_column: Callable[[str], bool]) -> str:
    """Return the delimiter that splits the header line into the most columns."""
    header = next((line for _, line, _ in _content_lines(text)), "")
    cells = {mark: [name.strip(' "\t\r\n') for name in header.split(mark)] for mark in DELIMITERS}
    return max(DELIMITERS, key=lambda mark: (sum(map(is_column, cells[mark])), len(cells[mark])))


def read_records(text: str, delimiter: str, file: str, findings: Findings) -> Iterator[Record]:
    """Yield the header and the rows; note and skip malformed CSV."""
    for number, line, following in _content_lines(text):
        where = f"{file}:{number}"
        reader = csv.reader(chain([line], following), delimiter=delimiter, skipinitialspace=True, strict=True)
        try:
            cells = [cell.strip() for cell in next(reader)]
            yield where, [_GUARDED.sub(r"\1", cell) if "'" in cell else cell for cell in cells]
        except csv.Error as error:
            remedy = 'close every quoted cell, and double the quotes within one: "a ""b"" c"'
            findings.append(Problem(where, f"a broken row ({error})", "well-formed CSV", remedy))


def misfit(where: str, fields: int, columns: int, delimiter: str) -> Problem:
    """Return the problem of a row with more or fewer fields than the header."""
    remedy = "quote text that contains the delimiter, and keep a delimiter for every empty cell"
    if delimiter == "," and fields > columns:
        remedy = "if these are decimal commas, write decimal points or separate the columns by semicolons"
    return Problem(where, f"{fields} fields, so that no cell was read", f"{columns}, as in the header", remedy)


def decimal_mark(delimiter: str, numbers: Iterable[str]) -> str:
    """Return the mark of most numbers; numbers with the other one are refused on reading."""
    if delimiter == ",":
        return "."
    marks = Counter(mark for number in numbers for mark in _DECIMAL_MARK.findall(number))
    return "," if marks[","] > marks["."] else "."


def _content_lines(text: str) -> Iterator[tuple[int, str, Iterator[str]]]:
    """Yield number and text of each line that starts a record, and its possible continuation lines."""
    numbered = enumerate(io.StringIO(text, newline=""), start=1)
    following = (line for _, line in numbered)
    for number, line in numbered:
        if line.strip(DELIMITERS + " \r\n") and not line.lstrip().startswith("#"):
            yield number, line, following


# -------- Text
# Read one cell of text as a number.

BARE = 0.2
"""Fraction of a frequency from which a number without % sign means percent: 0.5 for 0.5 %; assumed."""
NUMBER = r"[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?"
"""Regular expression of a plain number with a decimal point."""
IS_NUMBER = re.compile(rf"{NUMBER}|[+-]?(?:nan|inf|infinity)", re.IGNORECASE).fullmatch
"""Whether a text is a number; nan is one."""


def format_number(value: float) -> str:
    """Write a number with all its digits and no trailing `.0`; it reads back as the same float."""
    return repr(float(value)).removesuffix(".0")


def parse_number(text: str, decimal: str = ".") -> float:
    """Read a finite number.

    Args:
        text: the number as written, without blanks around it.
        decimal: the decimal mark in use, `.` or `,`; the other mark is refused.

    Returns:
        The number.
    """
    plain = text.replace(",", ".") if decimal == "," else text
    if not re.fullmatch(NUMBER, plain) or (decimal == "," and "." in text):
        raise refusal("", quoted(text), *_not_a_number(text, decimal))
    number = float(plain)
    if math.isinf(number):
        raise refusal("", quoted(text), "a finite number", "correct the number")
    return number


def parse_fraction(text: str, decimal: str = ".", kind: str = "") -> float:
    """Read a fraction between 0 and 1, exclusive: `0.005` or `0.5%`; of a frequency, below `BARE` without the sign."""
    percent = text.endswith("%")
    fraction = parse_number(text.removesuffix("%").rstrip(), decimal) / (100 if percent else 1)
    most = BARE if kind == "frequency" and not percent else 1
    remedy = f"write {'2%' if percent else text + '%'} if percent is meant, or give an absolute sigma"
    require(0 < fraction < most, "", quoted(text), f"a fraction between 0 and {most:g}", remedy)
    return fraction


def _not_a_number(text: str, decimal: str) -> tuple[str, str]:
    """Return expectation and remedy."""
    if text.lower().lstrip("+-") in ("nan", "inf", "infinity"):
        return "a finite number", "give the number or delete the row"
    if not text:
        return "a number", "fill the cell"
    if "." in text and "," in text:
        return "a number with at most one decimal mark", "remove the thousands separators"
    name, other = ("point", ",") if decimal == "." else ("comma", ".")
    if other in text:
        remedy = f"write the decimal {name} throughout the file, and no thousands separators"
        return f"a number with a decimal {name}", remedy
    return "a number", f"write a plain number such as 12{decimal}5 or 1e-3"
