"""A CSV table with one column per channel, `name [unit]`, over time or frequency; or a table of finished modes."""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from ident.errors import InputError, Problem, placed, refusal, refuse, require
from ident.measure.recordings.recording import Channel, Contents, Shape, array_channels, response_and_part
from ident.measure.recordings.sampling import even_step
from ident.measure.table import (
    IS_NUMBER,
    Findings,
    Record,
    decimal_mark,
    doubled,
    misfit,
    parse_number,
    records_of,
    text_in,
)
from ident.text import one_line, quoted
from ident.units import si_factor

TIME = "time"
MODE = frozenset({"frequency", "damping_ratio"})
"""Columns that identify a table of finished modes."""
SIGMA, IMAGINARY = "sigma ", "imag "
_FREQUENCY = re.compile(r"freq(?:s|uency|uencies)?\.?\s*(?:[\[(](?P<unit>[^\])]*)[\])])?", re.IGNORECASE)


def read(path: Path, data: bytes) -> Contents:
    """Return the columns of a CSV file: samples over `time [s]`, or frequency responses over `frequency [Hz]`."""
    findings = Findings()
    text = text_in(data, one_line(str(path)), by_instrument=True)
    file, delimiter, records = records_of(text, path, lambda name: True, findings)
    if not findings and records and {_name(cell) for cell in records[0][1]} >= MODE:
        return (), modes(records, delimiter), {}
    if findings or len(records) < 3:
        few = Problem(file, "no header with two rows of numbers below", "columns of samples", "export it again")
        raise InputError([*findings] or few)
    (where, header), table = records[0], _numbers(records, delimiter)
    named = [(_name(cell), _unit(cell)) for cell in header]
    frequency = _frequency(header, table)
    if frequency is not None:
        return tuple(_over_frequency(where, header, table, frequency)), (), {}
    step, start, clocks = None, 0.0, list[np.ndarray]()
    for (name, unit), column in zip(named, table.T, strict=True):
        if name.lower() == TIME and unit:
            with placed(where, name):
                clocks.append(column * si_factor(unit, "time"))
            step, start = even_step(clocks[0], file), float(clocks[0][0])
    alike = all(np.allclose(each, clocks[0], rtol=1e-6, atol=1e-9) for each in clocks)
    remedy = "put the channels of each into a file of their own"
    require(alike, where, f"{len(clocks)} columns of different times", "one", remedy, TIME)
    kept = [each for each in zip(named, table.T, strict=True) if not (step and each[0][0].lower() == TIME)]
    channels = tuple(Channel(name, column[None].copy(), unit, step, start) for (name, unit), column in kept)
    return channels, (), {}


def _frequency(header: Sequence[str], table: np.ndarray) -> int | None:
    """Return the column of frequencies; None for samples over time."""
    if any(_name(cell).lower() == TIME for cell in header):
        return None
    named = [i for i, cell in enumerate(header) if _FREQUENCY.fullmatch(cell)]
    first = [0] if _unit(header[0]).lower() in ("hz", "khz") else []
    return next((i for i in (*named, *first) if (np.diff(table[:, i]) > 0).all()), None)


def _over_frequency(where: str, header: Sequence[str], table: np.ndarray, frequency: int) -> Iterator[Channel]:
    """Yield the frequency responses with both parts; a column without its other part becomes a flawed channel."""
    parts = [response_and_part(_name(cell)) for cell in header]
    for i, part in enumerate(parts):
        if part in parts[:i]:
            both = f"{quoted(header[parts.index(part)])} and {quoted(header[i])}"
            raise refusal(where, both, "one column for each part of a response", "remove or rename one", part[0])
    said = _FREQUENCY.fullmatch(header[frequency])
    unit = _unit(header[frequency]) or (said["unit"] or "" if said else "")
    axis, others = ("frequency", table[:, frequency], unit), [i for i in range(len(header)) if i != frequency]
    for each in array_channels([axis, *((_name(header[i]), table[:, i], _unit(header[i])) for i in others)]):
        remedy = "write it into the header, as in 'frequency [Hz]'"
        yield each if unit else replace(each, flaw="values over frequencies without a unit", remedy=remedy)


def modes(records: list[Record], delimiter: str) -> tuple[Shape, ...]:
    """Return finished modes, one a row.

    Columns are `frequency [Hz]`, `damping_ratio [%]`, and for each channel `NAME` with the real part of its motion and
    optionally `imag NAME` with the imaginary part. Each may have a standard deviation, as `sigma NAME`,
    `sigma frequency [Hz]`.
    """
    (where, header), rows = records[0], records[1:]
    names = [_name(cell) for cell in header]
    refuse(doubled(where, names))
    factors = [_factor(where, cell) for cell in header]
    require(rows, where, "a header without a row", "a row for each mode", "add the modes")
    table = _numbers(records, delimiter) * factors
    found = []
    for (place, _), row in zip(rows, table, strict=True):
        is_number = np.isfinite(row).all()
        require(is_number, place, "a cell that is no number", "numbers", "leave the mode or the column out")
        cells = dict(zip(names, map(float, row), strict=True))
        sigma = {name.removeprefix(SIGMA): value for name, value in cells.items() if name.startswith(SIGMA)}
        channels = [name for name in names if not name.startswith((SIGMA, IMAGINARY)) and name not in MODE]
        motion = {name: complex(cells[name], cells.get(IMAGINARY + name, 0.0)) for name in channels}
        _check(place, cells, sigma, motion)
        found.append(Shape(cells["frequency"], cells["damping_ratio"], motion, sigma))
    return tuple(found)


def _check(where: str, cells: Mapping[str, float], sigma: Mapping[str, float], motion: Mapping[str, complex]) -> None:
    """Refuse an impossible mode."""
    frequency, ratio = cells["frequency"], cells["damping_ratio"]
    got, expected = f"{frequency:g} Hz, damping ratio {ratio:g}", "a frequency above 0, a ratio from 0 to 1"
    require(frequency > 0 and 0 <= ratio < 1, where, got, expected, "correct the mode")
    got, expected = "a mode that moves nothing", "the motion of its channels"
    require(any(motion.values()), where, got, expected, "add a column for each channel")
    for name, value in sigma.items():
        fine, expected = value > 0 and name in {*MODE, *motion}, "a standard deviation above 0 of a column of the file"
        require(fine, where, f"{value:g}", expected, "correct it", f"{SIGMA}{one_line(name)}")


def _name(cell: str) -> str:
    return cell.partition("[")[0].strip()


def _factor(where: str, cell: str) -> float:
    """Return SI units per unit of a column; frequencies and damping ratios must have one."""
    quantity = _name(cell).removeprefix(SIGMA)
    if quantity not in MODE:
        return 1.0
    expected = f"a unit, as in '{quantity} [{'Hz' if quantity == 'frequency' else '%'}]'"
    require(_unit(cell), where, "no unit", expected, "write it in square brackets", _name(cell))
    with placed(where, _name(cell)):
        return si_factor(_unit(cell), quantity)


def _unit(cell: str) -> str:
    return cell.partition("[")[2].removesuffix("]").strip()


def _numbers(records: list[Record], delimiter: str) -> np.ndarray:
    """Return the cells below the header as numbers (T, C); nan counts as a number.

    Raises:
        InputError: a row that does not fit the header, which is the first line of the file unless that begins with #.
    """
    (place, header), rows = records[0], records[1:]
    number, width = place.rpartition(":")[2], len(header)
    above = f"line {number} was taken for the header: {quoted(delimiter.join(header))}"
    for where, cells in rows:
        if len(cells) != width:
            problem = misfit(where, len(cells), width, delimiter)
            remedy = f"begin lines above the header with #; or {problem.remedy}"
            raise InputError(replace(problem, expected=f"{width}, as in the header ({above})", remedy=remedy))
    mark = decimal_mark(delimiter, (cell for _, cells in rows[:50] for cell in cells))
    texts = [[cell.replace(mark, ".") for cell in cells] for _, cells in rows]
    try:
        return np.array(texts).astype(float)
    except ValueError:
        pass
    every = ((where, cell) for where, cells in rows for cell in cells if not IS_NUMBER(cell.replace(mark, ".")))
    findings, (where, cell) = Findings(), next(every, (place, ""))
    findings.attempt(where, "", parse_number, cell, mark)
    if where == rows[0][0]:
        remedy = f"{findings[0].remedy}; or begin lines above the header with #"
        findings[0] = replace(findings[0], expected=f"{findings[0].expected} ({above})", remedy=remedy)
    raise InputError(findings)
