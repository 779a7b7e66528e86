"""A measured vibration of the end point: displacement or acceleration over time, from CSV into SI units."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float

from ident.errors import InputError, Problem
from ident.measure.series import EXAMPLES, TIME, Series, parse_series
from ident.measure.table import Findings, read_table
from ident.text import LARGEST_SAMPLES

DIRECTIONS = ("x", "y", "z")
"""Names of the columns: axes of the base frame."""

KINDS = {"length": "displacement", "acceleration": "acceleration"}
"""What a trace may be of, by the quantity of its units."""

TRACE_ROWS_MIN = 16
"""Fewest rows of a trace."""

UNEVEN = 0.01
"""Largest deviation of a sampling interval from the mean one, as a fraction of it."""


@dataclass(frozen=True)
class Trace:
    """A vibration over time, sampled at equal intervals.

    Attributes:
        path: the file it was read from.
        sha256: hash of the file's bytes.
        time: (T,) [s] increasing, uniform within 1 %.
        kind: `displacement` or `acceleration`.
        values: (T,) [m or m/s^2] by direction, `x`, `y` or `z` of the base frame.
        ignored: names of further columns of the file, as written in its header.
    """

    path: str
    sha256: str
    time: Float[np.ndarray, " T"]
    kind: str
    values: Mapping[str, Float[np.ndarray, " T"]]
    ignored: tuple[str, ...] = ()

    @property
    def interval(self) -> float:
        """Mean time [s] between two samples."""
        return float(self.time[-1] - self.time[0]) / (len(self.time) - 1)


def read_trace(path: str | Path) -> Trace:
    """Read a trace from a CSV file with the columns `time [s]` and any of `x [mm]`, `y [mm]`, `z [mm]`.

    The unit tells displacement from acceleration, `x [m/s^2]`; one file has one of the two.

    Args:
        path: the file; UTF-8, columns separated by comma, semicolon or tab, in any order; further ones are ignored.

    Returns:
        The trace in SI units.

    Raises:
        InputError: the file can't be read, or something in it is wrong; every problem is listed.
    """
    return parse_trace(read_table(path, LARGEST_SAMPLES), path)


def parse_trace(data: bytes, path: str | Path) -> Trace:
    """Read a trace from the bytes of a CSV file; `path` names it in messages."""
    findings = Findings()
    series = parse_series(data, path, {direction: tuple(KINDS) for direction in DIRECTIONS}, TRACE_ROWS_MIN, findings)
    findings += [*_kind_problems(series), *_sampling_problems(series)]
    if findings:
        raise InputError(findings)
    given = [direction for direction in DIRECTIONS if direction in series]
    kind = KINDS[series.columns[given[0]].quantity]
    values = {direction: series[direction] for direction in given}
    return Trace(str(path), series.sha256, series[TIME], kind, values, series.ignored)


def _kind_problems(series: Series) -> Iterator[Problem]:
    given = [column for name, column in series.columns.items() if name in DIRECTIONS]
    if not given and not series.at_fault & set(DIRECTIONS):
        expected = f"a column 'x [{EXAMPLES['length']}]', or y or z, or in '{EXAMPLES['acceleration']}'"
        yield Problem(series.header, "no direction", expected, "name the measured directions in the header")
    for column in given:
        kind, first = KINDS[column.quantity], KINDS[given[0].quantity]
        if kind != first:
            expected = f"{first}, as of {given[0].name}"
            remedy = "put displacements and accelerations into two files"
            yield Problem(series.header, f"{kind} in '{column.unit}'", expected, remedy, column.name)


def _sampling_problems(series: Series) -> Iterator[Problem]:
    """Find the interval that differs most from the mean one, once time increases."""
    steps = np.diff(series[TIME]) if TIME in series else np.zeros(0)
    if not steps.size or not (steps > 0).all():
        return
    mean = steps.mean()
    row = int(np.argmax(abs(steps - mean)))
    if abs(steps[row] - mean) > UNEVEN * mean:
        got = f"{steps[row]:.6g} s since the row before"
        expected = f"{mean:.6g} s within 1 %, the mean interval"
        remedy = "resample the trace at equal intervals; if only its times are rounded, write more digits"
        yield Problem(series.where[row + 1], got, expected, remedy, TIME)
