"""Text into records: comments, delimiter and quoting of a CSV file, each record with its row."""

import csv
import io
import re
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from itertools import chain
from pathlib import Path
from typing import ParamSpec, TypeVar

from ident.errors import InputError, Problem
from ident.measure.spreadsheet import is_sheet, sheet_text
from ident.text import LARGEST_TEXT, decode, one_line, read_bytes

P = ParamSpec("P")
T = TypeVar("T")

DELIMITERS = ",;\t"
"""Column delimiters that are recognised."""

FOREIGN = {
    **dict.fromkeys((".xlsm", ".xls", ".xlsb", ".ods"), "a spreadsheet"),
    **dict.fromkeys((".uff", ".unv", ".uf", ".bunv"), "a universal file (UFF)"),
    **dict.fromkeys((".mat", ".h5", ".hdf5", ".nc", ".tdms", ".wav", ".npz", ".npy"), "a binary file of samples"),
    **dict.fromkeys((".json", ".html", ".pdf", ".png"), "no table"),
    ".toml": "an arm description",
}
"""What a file is by its ending, if that is no table."""

_DECIMAL_MARK = re.compile(r"(?<![\w.,])[+-]?[0-9]*([.,])[0-9]")

Record = tuple[str, list[str]]
"""The place `file:row` at which a record starts, and its cells without blanks around them."""


class Findings(list[Problem]):
    """The problems that were found so far; reading goes on, so that all are reported."""

    def attempt(self, where: str, column: str, read: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs) -> T | None:
        """Return what `read` returns, or None where it raises InputError, whose problems are noted."""
        try:
            return read(*args, **kwargs)
        except InputError as error:
            self.extend(replace(p, where=where, column=column or p.column) for p in error.problems)
            return None


def read_table(path: str | Path, largest: int = LARGEST_TEXT) -> bytes:
    """Return the bytes of a CSV file, or of an Excel sheet (`.xlsx`).

    Raises:
        InputError: there is no such file, it cannot be read or has more bytes than `largest`, or its ending says that
            it is another kind of file.
    """
    if kind := FOREIGN.get(Path(path).suffix.lower()):
        sheet = " or .xlsx" if kind == FOREIGN[".xls"] else ""
        remedy = f"export it as CSV{sheet}; data/README.md shows the columns"
        if kind == FOREIGN[".toml"]:
            remedy = "name the measurements instead"
        raise InputError(Problem(one_line(str(path)), kind, "a table as CSV", remedy))
    return read_bytes(path, "a readable CSV file", largest)


def table_text(data: bytes, file: str) -> str:
    """Return the bytes of a CSV file as text, or the first sheet of an `.xlsx` file as such text; `file` names it.

    Raises:
        InputError: the bytes are neither.
    """
    return sheet_text(data, file) if is_sheet(file) else decode(data, file)


def sniff_delimiter(text: str, is_column: Callable[[str], bool]) -> str:
    """Return the delimiter that splits the header line into most columns."""
    header = next((line for _, line, _ in _content_lines(text)), "")

    def columns(delimiter: str) -> tuple[int, int]:
        names = [name.strip(' "\t\r\n') for name in header.split(delimiter)]
        return sum(map(is_column, names)), len(names)

    return max(DELIMITERS, key=columns)


def read_records(text: str, delimiter: str, file: str, findings: Findings) -> Iterator[Record]:
    """Yield the header and the rows; what is no well-formed CSV is noted and left out."""
    for number, line, following in _content_lines(text):
        where = f"{file}:{number}"
        reader = csv.reader(chain([line], following), delimiter=delimiter, skipinitialspace=True, strict=True)
        try:
            yield where, [cell.strip() for cell in next(reader)]
        except csv.Error as error:
            remedy = 'close every quoted cell, and double the quotes within one: "a ""b"" c"'
            findings.append(Problem(where, f"a broken row ({error})", "well-formed CSV", remedy))


def misfit(where: str, fields: int, columns: int, delimiter: str) -> Problem:
    """Return the problem of a row that has more or fewer fields than the header."""
    remedy = "quote text that contains the delimiter, and keep a delimiter for every empty cell"
    if delimiter == "," and fields > columns:
        remedy = "if these are decimal commas, write decimal points or separate the columns by semicolons"
    got = f"{fields} fields, so that no cell was read"
    return Problem(where, got, f"{columns}, as in the header", remedy)


def decimal_mark(delimiter: str, numbers: Iterable[str]) -> str:
    """Return the mark that most numbers have; numbers with the other one are refused when they are read."""
    if delimiter == ",":
        return "."
    marks = Counter(mark for number in numbers for mark in _DECIMAL_MARK.findall(number))
    return "," if marks[","] > marks["."] else "."


def _content_lines(text: str) -> Iterator[tuple[int, str, Iterator[str]]]:
    """Yield number and text of each line that starts a record, and the lines that may continue it."""
    numbered = enumerate(io.StringIO(text, newline=""), start=1)
    following = (line for _, line in numbered)
    for number, line in numbered:
        if line.strip(DELIMITERS + " \r\n") and not line.lstrip().startswith("#"):
            yield number, line, following
