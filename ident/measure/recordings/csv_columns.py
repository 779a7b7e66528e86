"""A table of samples as CSV: a column for each channel, `name [unit]`, and one of the time."""

from pathlib import Path

import numpy as np

from ident.errors import InputError, Problem
from ident.measure.recordings.recording import Channel, Contents
from ident.measure.recordings.sampling import even_step
from ident.measure.table import Findings, Record, decimal_mark, misfit, read_records, sniff_delimiter, table_text
from ident.measure.text import parse_number
from ident.text import one_line
from ident.units import si_factor

TIME = "time"


def read(path: Path, data: bytes) -> Contents:
    """Return the columns of a CSV file; `time [s]` gives the sampling."""
    file, findings = one_line(str(path)), Findings()
    text = table_text(data, file)
    delimiter = sniff_delimiter(text, lambda name: True)
    records = list(read_records(text, delimiter, file, findings))
    if findings or len(records) < 3:
        few = Problem(file, "no header with two rows of numbers below", "columns of samples", "export it anew")
        raise InputError([*findings] or few)
    (_, header), rows = records[0], records[1:]
    table = _numbers(rows, len(header), delimiter)
    named = [(cell.partition("[")[0].strip(), _unit(cell)) for cell in header]
    step = None
    for (name, unit), column in zip(named, table.T, strict=True):
        if name.lower() == TIME and unit:
            step = even_step(column * si_factor(unit, "time"), file)
    kept = [each for each in zip(named, table.T, strict=True) if not (step and each[0][0].lower() == TIME)]
    channels = tuple(Channel(name, column[None].copy(), unit, step) for (name, unit), column in kept)
    return channels, (), {}


def _unit(cell: str) -> str:
    return cell.partition("[")[2].removesuffix("]").strip()


def _numbers(rows: list[Record], width: int, delimiter: str) -> np.ndarray:
    """Return the cells as numbers (T, C); a cell that says nan is one."""
    for where, cells in rows:
        if len(cells) != width:
            raise InputError(misfit(where, len(cells), width, delimiter))
    mark = decimal_mark(delimiter, (cell for _, cells in rows[:50] for cell in cells))
    texts = [[cell.replace(mark, ".") for cell in cells] for _, cells in rows]
    try:
        return np.array(texts).astype(float)
    except ValueError:
        pass
    findings = Findings()
    for where, cells in rows:
        for cell in cells:
            findings.attempt(where, "", parse_number, cell, mark)
    raise InputError(findings[:1])
