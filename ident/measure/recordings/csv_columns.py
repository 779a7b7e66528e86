"""A table of samples as CSV: a column for each channel, `name [unit]`, and one of the time; or of finished modes."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from ident.errors import InputError, Problem
from ident.measure.recordings.recording import Channel, Contents, Shape
from ident.measure.recordings.sampling import even_step
from ident.measure.table import Findings, Record, decimal_mark, misfit, read_records, sniff_delimiter, table_text
from ident.measure.text import parse_number
from ident.text import one_line
from ident.units import si_factor

TIME = "time"
MODE = frozenset({"frequency", "damping_ratio"})
"""Columns by which a table is one of finished modes."""
SIGMA, IMAGINARY = "sigma ", "imag "


def read(path: Path, data: bytes) -> Contents:
    """Return the columns of a CSV file; `time [s]` gives the sampling."""
    file, findings = one_line(str(path)), Findings()
    text = table_text(data, file)
    delimiter = sniff_delimiter(text, lambda name: True)
    records = list(read_records(text, delimiter, file, findings))
    if not findings and records and {_name(cell) for cell in records[0][1]} >= MODE:
        return (), modes(records, delimiter), {}
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


def modes(records: list[Record], delimiter: str) -> tuple[Shape, ...]:
    """Return finished modes, one a row.

    Columns are `frequency [Hz]`, `damping_ratio [%]`, and for each channel `NAME` with the real part of its motion and
    `imag NAME` with the imaginary one, which may be left out; each may have a standard deviation, as `sigma NAME`,
    `sigma frequency [Hz]`.
    """
    (where, header), rows = records[0], records[1:]
    factors = [_factor(where, cell) for cell in header]
    table = _numbers(rows, len(header), delimiter) * factors
    names = [_name(cell) for cell in header]
    found = []
    for (place, _), row in zip(rows, table, strict=True):
        if not np.isfinite(row).all():
            raise InputError(Problem(place, "a cell that is no number", "numbers", "leave the mode or the column out"))
        cells = dict(zip(names, map(float, row), strict=True))
        sigma = {name.removeprefix(SIGMA): value for name, value in cells.items() if name.startswith(SIGMA)}
        channels = [name for name in names if not name.startswith((SIGMA, IMAGINARY)) and name not in MODE]
        motion = {name: complex(cells[name], cells.get(IMAGINARY + name, 0.0)) for name in channels}
        _check(place, cells, sigma, motion)
        found.append(Shape(cells["frequency"], cells["damping_ratio"], motion, sigma))
    return tuple(found)


def _check(where: str, cells: Mapping[str, float], sigma: Mapping[str, float], motion: Mapping[str, complex]) -> None:
    """Refuse what no mode can be."""
    if not (cells["frequency"] > 0 and 0 <= cells["damping_ratio"] < 1):
        got = f"{cells['frequency']:g} Hz, damping ratio {cells['damping_ratio']:g}"
        raise InputError(Problem(where, got, "a frequency above 0, a ratio from 0 to 1", "correct the mode"))
    if not any(motion.values()):
        remedy = "add a column for each channel"
        raise InputError(Problem(where, "a mode that moves nothing", "the motion of its channels", remedy))
    for name, value in sigma.items():
        if not value > 0 or name not in {*MODE, *motion}:
            expected = "a standard deviation above 0 of a column of the file"
            raise InputError(Problem(where, f"{value:g}", expected, "correct it", f"{SIGMA}{one_line(name)}"))


def _name(cell: str) -> str:
    return cell.partition("[")[0].strip()


def _factor(where: str, cell: str) -> float:
    """Return SI units per unit of a column; frequencies and damping ratios must have one."""
    quantity = _name(cell).removeprefix(SIGMA)
    if quantity not in MODE:
        return 1.0
    if not _unit(cell):
        expected = f"a unit, as in '{quantity} [{'Hz' if quantity == 'frequency' else '%'}]'"
        raise InputError(Problem(where, "no unit", expected, "write it in square brackets", _name(cell)))
    return si_factor(_unit(cell), quantity)


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
