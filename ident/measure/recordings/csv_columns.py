"""A CSV table with one column per channel, `name [unit]`, over time or frequency; or a table of finished modes."""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from ident.errors import InputError, Problem, placed, refusal, refuse, require
from ident.measure.recordings.recording import Channel, Contents, Shape, array_channels, response_and_part
from ident.measure.recordings.sampling import JUDGED_MIN, Even, evened
from ident.measure.samples import TIME, Columns, Samples, read_samples, split_header
from ident.measure.table import IS_NUMBER, Findings, Record, decimal_mark, doubled, misfit, parse_number
from ident.text import by_key, one_line, quoted
from ident.units import si_factor

MODE = frozenset({"frequency", "damping_ratio"})
"""Columns that identify a table of finished modes."""
SIGMA, IMAGINARY = "sigma ", "imag "
_FREQUENCY = re.compile(r"freq(?:s|uency|uencies)?\.?\s*(?:[\[(](?P<unit>[^\])]*)[\])])?", re.IGNORECASE)


def read(path: Path, data: bytes, columns: Columns) -> Contents:
    """Return the columns of a CSV file: samples over `time [s]`, or frequency responses over `frequency [Hz]`."""
    findings = Findings()
    table = read_samples(data, path, columns, findings, by_instrument=True)
    file, delimiter, records = table.file, table.delimiter, table.records
    if not findings and records and {split_header(cell)[0] for cell in records[0][1]} >= MODE:
        return (), modes(records, delimiter), {}
    if findings or len(records) < 3:
        few = Problem(file, "no header with two rows of numbers below", "columns of samples", "export it again")
        raise InputError([*findings] or few)
    (where, header), values = records[0], _numbers(records, delimiter)
    frequency = _frequency(header, values)
    if frequency is not None:
        return tuple(_over_frequency(where, header, values, frequency)), (), {}
    cells = [(name, unit, column) for (name, unit), column in zip(map(split_header, header), values.T, strict=True)]
    clocks = list[np.ndarray]()
    for name, unit, column in cells:
        if name.lower() == TIME and unit:
            with placed(where, name):
                clocks.append(column * si_factor(unit, "time"))
    if not clocks:
        return tuple(Channel(name, column[None].copy(), unit) for name, unit, column in cells), (), {}
    alike = all(np.allclose(each, clocks[0], rtol=1e-6, atol=1e-9) for each in clocks)
    remedy = "put the channels of each into a file of their own"
    require(alike, where, f"{len(clocks)} columns of different times", "one", remedy, TIME)
    kept = [(name, unit, column) for name, unit, column in cells if name.lower() != TIME]
    return tuple(_over_time(kept, clocks[0], table)), (), {}


def _over_time(cells: list[tuple[str, str, np.ndarray]], time: np.ndarray, table: Samples) -> Iterator[Channel]:
    """Yield channels over time; those with values in the same rows have one clock."""
    rows = {place: np.isfinite(column) for place, (_, _, column) in enumerate(cells)}
    clocks = by_key((rows[place].tobytes(), place) for place in rows if rows[place].sum() > 1).values()
    of = dict[int, tuple[Even, int]]()
    for places in clocks:
        own = rows[places[0]]
        try:
            even = evened(time[own], np.stack([cells[place][2][own] for place in places]), table.file)
        except InputError:
            if own.all() or own.sum() >= JUDGED_MIN:
                raise
            # in few samples an empty cell is more probable than a clock of its own
            empty, remedy = int(np.argmin(own)), "fill the cell, or delete the rows up to it"
            raise refusal(table.records[1 + empty][0], "nothing", "a number", remedy, cells[places[0]][0]) from None
        of |= {place: (even, number) for number, place in enumerate(places)}
    for place, (even, number) in sorted(of.items()):
        name, unit, _ = cells[place]
        made = Channel(name, even.values[number][None].copy(), unit, even.step, even.start)
        yield replace(made, remarks=(*even.remarks, *table.remarks), step_error=even.error, band=even.band)


def _frequency(header: Sequence[str], table: np.ndarray) -> int | None:
    """Return the column of frequencies; None for samples over time."""
    if any(split_header(cell)[0].lower() == TIME for cell in header):
        return None
    named = [i for i, cell in enumerate(header) if _FREQUENCY.fullmatch(cell)]
    first = [0] if split_header(header[0])[1].lower() in ("hz", "khz") else []
    return next((i for i in (*named, *first) if (np.diff(table[:, i]) > 0).all()), None)


def _over_frequency(where: str, header: Sequence[str], table: np.ndarray, frequency: int) -> Iterator[Channel]:
    """Yield the frequency responses with both parts; a column without its other part becomes a flawed channel."""
    parts = [response_and_part(split_header(cell)[0]) for cell in header]
    for i, part in enumerate(parts):
        if part in parts[:i]:
            both = f"{quoted(header[parts.index(part)])} and {quoted(header[i])}"
            raise refusal(where, both, "one column for each part of a response", "remove or rename one", part[0])
    said = _FREQUENCY.fullmatch(header[frequency])
    unit = split_header(header[frequency])[1] or (said["unit"] or "" if said else "")
    cells = [(name, column, unit) for (name, unit), column in zip(map(split_header, header), table.T, strict=True)]
    axis, others = ("frequency", table[:, frequency], unit), [cell for i, cell in enumerate(cells) if i != frequency]
    for each in array_channels([axis, *others]):
        remedy = "write it into the header, as in 'frequency [Hz]'"
        yield each if unit else replace(each, flaw="values over frequencies without a unit", remedy=remedy)


def modes(records: list[Record], delimiter: str) -> tuple[Shape, ...]:
    """Return finished modes, one a row.

    Columns are `frequency [Hz]`, `damping_ratio [%]`, and for each channel `NAME` with the real part of its motion and
    optionally `imag NAME` with the imaginary part. Each may have a standard deviation, as `sigma NAME`,
    `sigma frequency [Hz]`.
    """
    (where, header), rows = records[0], records[1:]
    names = [split_header(cell)[0] for cell in header]
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


def _factor(where: str, cell: str) -> float:
    """Return SI units per unit of a column; frequencies and damping ratios must have one."""
    quantity = split_header(cell)[0].removeprefix(SIGMA)
    if quantity not in MODE:
        return 1.0
    expected = f"a unit, as in '{quantity} [{'Hz' if quantity == 'frequency' else '%'}]'"
    require(split_header(cell)[1], where, "no unit", expected, "write it in square brackets", split_header(cell)[0])
    with placed(where, split_header(cell)[0]):
        return si_factor(split_header(cell)[1], quantity)


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
    texts = [[cell.replace(mark, ".") or "nan" for cell in cells] for _, cells in rows]
    try:
        return np.array(texts).astype(float)
    except ValueError:
        pass
    every = (
        (where, cell) for where, cells in rows for cell in cells if cell and not IS_NUMBER(cell.replace(mark, "."))
    )
    findings, (where, cell) = Findings(), next(every, (place, ""))
    findings.attempt(where, "", parse_number, cell, mark)
    if where == rows[0][0]:
        remedy = f"{findings[0].remedy}; or begin lines above the header with #"
        findings[0] = replace(findings[0], expected=f"{findings[0].expected} ({above})", remedy=remedy)
    raise InputError(findings)
