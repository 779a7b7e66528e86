"""Bytes into records: encoding, comments, delimiter and quoting of a CSV file, each record with its row."""

import csv
import io
from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import chain
from typing import ParamSpec, TypeVar

from ident.errors import InputError, Problem

P = ParamSpec("P")
T = TypeVar("T")

DELIMITERS = ",;\t"
"""Column delimiters that are told apart."""

Record = tuple[str, list[str]]
"""The place `file:row` at which a record starts, and its cells without blanks around them."""


class Findings(list[Problem]):
    """The problems found so far; reading goes on, so that all are reported."""

    def attempt(
        self, where: str, column: str, read: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs
    ) -> T | None:
        """Returns what `read` returns, or None where it raises InputError, whose problems are kept."""
        try:
            return read(*args, **kwargs)
        except InputError as error:
            self.extend(replace(p, where=where, column=column or p.column) for p in error.problems)
            return None


def decode(data: bytes, file: str) -> str:
    """Returns the bytes as text, with or without a byte order mark; no encoding but UTF-8 is guessed.

    Raises:
        InputError: the bytes are not UTF-8.
    """
    if b"\0" in data or data.startswith((b"\xff\xfe", b"\xfe\xff")):
        remedy = "save the table as CSV in UTF-8"
        raise InputError(Problem(file, "UTF-16 or a binary file", "a text file in UTF-8", remedy))
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        before, byte = error.object[: error.start], error.object[error.start]
        line = len((before + b".").splitlines())
        got, remedy = f"the byte 0x{byte:02x}, which is no UTF-8", "save the file as UTF-8"
        raise InputError(Problem(f"{file}:{line}", got, "text in UTF-8", remedy)) from None


def sniff_delimiter(text: str, is_column: Callable[[str], bool]) -> str:
    """Returns the delimiter that splits the header line into most columns."""
    header = next((line for _, line, _ in _content_lines(text)), "")

    def columns(delimiter: str) -> tuple[int, int]:
        names = [name.strip(' "\t\r\n') for name in header.split(delimiter)]
        return sum(map(is_column, names)), len(names)

    return max(DELIMITERS, key=columns)


def read_records(text: str, delimiter: str, file: str, found: Findings) -> Iterator[Record]:
    """Yields the header and the rows; what is no well-formed CSV is noted and left out."""
    for number, line, following in _content_lines(text):
        where = f"{file}:{number}"
        reader = csv.reader(chain([line], following), delimiter=delimiter, skipinitialspace=True, strict=True)
        try:
            yield where, [cell.strip() for cell in next(reader)]
        except csv.Error as error:
            remedy = 'close every quoted cell, and double the quotes within one: "a ""b"" c"'
            found.append(Problem(where, f"a broken row ({error})", "well-formed CSV", remedy))


def _content_lines(text: str) -> Iterator[tuple[int, str, Iterator[str]]]:
    """Yields number and text of each line that starts a record, and the lines that may continue it."""
    numbered = enumerate(io.StringIO(text, newline=""), start=1)
    following = (line for _, line in numbered)
    for number, line in numbered:
        if line.strip(DELIMITERS + " \r\n") and not line.lstrip().startswith("#"):
            yield number, line, following
