"""Traces: displacement or acceleration over time, and how pulleys turned meanwhile."""

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float

from ident.errors import InputError, Problem, refuse
from ident.measure.columns import EXAMPLES, Rule
from ident.measure.grade import Grade, grade
from ident.measure.recordings.sampling import Even, evened
from ident.measure.samples import FILTERED, FILTERED_BELOW, NONE, TIME, Columns
from ident.measure.series import Sampled, Series, parse_series
from ident.measure.table import Findings, read_table
from ident.text import LARGEST_SAMPLES, NAME

DIRECTIONS = ("x", "y", "z")
"""Names of the columns: axes of the base frame."""
KINDS = {"length": "displacement", "acceleration": "acceleration"}
"""What a trace may be of, by the quantity of its units."""
ALIAS = r"(?:.*[^a-z])?(?:a|acc)?{0}"
"""What sensors call their measurement along an axis: ax, accel_x, Beschleunigung x."""
TRACE_ROWS_MIN = 16
"""Fewest rows of a trace."""


@dataclass(frozen=True)
class Trace(Sampled):
    """A vibration over time, sampled at equal intervals.

    Attributes:
        kind: `displacement` or `acceleration`; of a recording's channels also `velocity`, or their own unit.
        values: (T,) [SI] by direction, `x`, `y` or `z` of the base frame, or by channel.
        ignored: names of further columns of the file, as written in its header.
        notes: what was done to the times, and taken from a program's convention: the weightiest first.
        step_error: [-] relative standard error of the interval, where it was fitted to stamps that jitter.
        band: [Hz] up to which resampling has kept the amplitudes.
    """

    kind: str
    values: Mapping[str, Float[np.ndarray, " T"]]
    ignored: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    step_error: float = 0.0
    band: float = np.inf

    @property
    def grades(self) -> tuple[Grade, ...]:
        """What each direction is worth by itself."""
        band = FILTERED_BELOW if any(FILTERED in note for note in self.notes) else 0.0, self.band
        return tuple(grade(name, self.kind, values, self.interval, band) for name, values in self.values.items())


class NoDirectionError(InputError):
    """A table of samples without a direction: it may have channels of other names."""


def read_trace(path: str | Path, columns: Columns = NONE) -> Trace:
    """Read a trace from a CSV file with the columns `time [s]` and any of `x [mm]`, `y [mm]`, `z [mm]`.

    The unit tells displacement from acceleration, `x [m/s^2]`; one file has one of the two.

    Args:
        path: the file; UTF-8, columns separated by comma, semicolon, tab or blanks, in any order; further ones are
            ignored. Its clock may jitter, see `ident.measure.recordings.sampling.evened`.
        columns: headers by names of the file, `{"accel_x": "z [mm/s^2]"}`, for what it does not say itself.

    Returns:
        The trace in SI units.

    Raises:
        InputError: the file can't be read, or something in it is wrong; every problem is listed.
    """
    return parse_trace(read_table(path, LARGEST_SAMPLES), path, columns)


def parse_trace(data: bytes, path: str | Path, columns: Columns = NONE) -> Trace:
    """Read a trace from the bytes of a CSV file; `path` names it in messages."""
    findings = Findings()
    rules = [Rule(direction, quantities=tuple(KINDS), alias=ALIAS.format(direction)) for direction in DIRECTIONS]
    series = parse_series(data, path, rules, TRACE_ROWS_MIN, findings, columns)
    findings += _kind_problems(series)
    if findings and not any(direction in series or direction in series.at_fault for direction in DIRECTIONS):
        raise NoDirectionError(findings)
    refuse(findings)
    values = {direction: series[direction] for direction in DIRECTIONS if direction in series}
    kind = KINDS[series.header.units[next(iter(values))].quantity]
    time, values, even = at_even_times(series, values)
    notes = (*even.remarks, *series.remarks)
    return Trace(str(path), series.sha256, time, kind, values, series.header.ignored, notes, even.error, even.band)


def _kind_problems(series: Series) -> Iterator[Problem]:
    where, given = series.header.where, {name: series.header.units[name] for name in DIRECTIONS if name in series}
    if not given and not series.at_fault & set(DIRECTIONS):
        expected = f"a column 'x [{EXAMPLES['length']}]', or y or z, or in '{EXAMPLES['acceleration']}'"
        yield Problem(where, "no direction", expected, "name the measured directions in the header")
    for name, unit in given.items():
        kind, (other, first) = KINDS[unit.quantity], next(iter(given.items()))
        if unit.quantity != first.quantity:
            got, expected = f"{kind} in '{unit.written}'", f"{KINDS[first.quantity]}, as of {other}"
            yield Problem(where, got, expected, "put displacements and accelerations into two files", name)


def at_even_times(series: Series, values: Mapping[str, np.ndarray]) -> tuple[np.ndarray, dict[str, np.ndarray], Even]:
    """Return times and columns with an even clock, and what was done for it; see `evened`."""
    even = evened(series[TIME], np.stack(list(values.values())), series.file)
    if not even.remarks:
        return series[TIME], dict(values), even
    time = even.start + even.step * np.arange(even.values.shape[1])
    return time, dict(zip(values, even.values, strict=True)), even


_COLUMN = re.compile(rf"(?P<name>(?P<pulley>{NAME})\.frequency)\s*\[.*\]")
"""A column such as `drive1.frequency [Hz]`."""


def read_pulleys(path: str | Path, trace: Trace) -> Mapping[str, Float[np.ndarray, " T"]]:
    """Read how pulleys turn from the file of a trace, by name (T,) [Hz]; mostly none if it was measured.

    Args:
        path: the file.
        trace: what `read_trace` has read from it.
    """
    there = [match for match in map(_COLUMN.fullmatch, trace.ignored) if match]
    if not there:
        return {}
    rules, findings = [Rule(match["name"], quantities=("frequency",)) for match in there], Findings()
    series = parse_series(read_table(path, LARGEST_SAMPLES), path, rules, TRACE_ROWS_MIN, findings)
    refuse(findings)
    return {match["pulley"]: series[match["name"]] for match in there}
