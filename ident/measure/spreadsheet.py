"""An Excel sheet (`.xlsx`) as the text of a CSV file, row by row, so that all checks and row numbers are the same."""

import csv
import io
import zipfile
from typing import Any

from ident.errors import InputError, Problem

LARGEST = 500_000_000
"""Bytes that the unpacked sheets may have: more is no campaign."""
FAILED = ("#N/A", "#REF!", "#VALUE!", "#DIV/0!", "#NAME?", "#NUM!", "#NULL!")
"""What a spreadsheet program stores as the value of a formula that failed."""
EXPECTED = "a table as CSV or Excel sheet (.xlsx)"


def is_sheet(file: str) -> bool:
    """Tell by its name whether a file is an Excel sheet."""
    return file.lower().endswith(".xlsx")


def sheet_text(data: bytes, file: str) -> str:
    """Return the first sheet as CSV with commas, one line a row; `file` names it in errors.

    Raises:
        InputError: no Excel sheet, one too large, formulas that were never computed, or openpyxl is not installed.
    """
    try:
        from openpyxl import load_workbook
    except ImportError:
        remedy = "pip install 'ident[xlsx]', or save the sheet as CSV"
        raise InputError(Problem(file, "an Excel sheet without the package openpyxl", EXPECTED, remedy)) from None
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            size = sum(entry.file_size for entry in archive.infolist())
        if size > LARGEST:
            got, most = f"{size / 1e6:.0f} MB when unpacked", f"at most {LARGEST / 1e6:.0f} MB"
            raise InputError(Problem(file, got, most, "keep one sheet, or save it as CSV"))
        values, formulas = (
            _rows(load_workbook(io.BytesIO(data), read_only=True, data_only=computed)) for computed in (True, False)
        )
    except InputError:
        raise
    except Exception as error:  # openpyxl lets KeyError, ValueError, zip and XML errors of damaged files through
        got = f"a damaged file, or another archive ({type(error).__name__})"
        raise InputError(Problem(file, got, EXPECTED, "save it anew")) from None
    _check_formulas(values, formulas, file)
    lines = [_cells(row) for row in values]
    width = next((len(cells) for cells in lines if cells and not cells[0].startswith("#")), 0)
    return "".join(_line(cells, width) for cells in lines)


def _rows(book: Any) -> list[tuple[Any, ...]]:
    """Return the cells of the first sheet, empty rows at its end left out."""
    sheet = book.worksheets[0]
    sheet.reset_dimensions()  # what the file says of its size may be anything
    rows = [tuple(row) for row in sheet.iter_rows(values_only=True)]
    while rows and all(cell is None for cell in rows[-1]):
        rows.pop()
    return rows


def _check_formulas(values: list[tuple[Any, ...]], formulas: list[tuple[Any, ...]], file: str) -> None:
    """Refuse formulas that failed, and those whose value no spreadsheet program has stored.

    Raises:
        InputError: with the row of each.
    """
    problems = []
    for number, row in enumerate(formulas, 1):
        known = values[number - 1] if number <= len(values) else ()
        for place, cell in enumerate(row):
            value = known[place] if place < len(known) else None
            if isinstance(value, str) and value in FAILED:
                problems.append(Problem(f"{file}:{number}", value, "a value", "correct the formula"))
            elif isinstance(cell, str) and cell.startswith("=") and value is None:
                got, remedy = f"the formula {cell[:40]} without its value", "save it in a spreadsheet program"
                problems.append(Problem(f"{file}:{number}", got, "a value", remedy))
    if problems:
        raise InputError(problems)


def _cells(row: tuple[Any, ...]) -> list[str]:
    """Return the cells of a row as text, empty ones at its end left out."""
    cells = [_written(value) for value in row]
    while cells and not cells[-1]:
        cells.pop()
    return cells


def _line(cells: list[str], width: int) -> str:
    """Return a row as a line of CSV, as wide as the header; a comment stays one, and an empty row is an empty line."""
    if not cells:
        return "\n"
    if cells[0].startswith("#"):
        return " ".join(filter(None, cells)) + "\n"
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerow([*cells, *[""] * (width - len(cells))])
    return text.getvalue()


def _written(value: Any) -> str:
    """Return a cell on one line; whole numbers without a decimal point."""
    if value is None:
        return ""
    if isinstance(value, float):
        return repr(int(value)) if value.is_integer() and abs(value) < 1e15 else repr(value)
    return " ".join(str(value).split())
