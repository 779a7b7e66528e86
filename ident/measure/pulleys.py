"""Pulleys in a CSV file of a trace: turning frequency and angle over time, as `ident simulate` writes them."""

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float

from ident.errors import InputError
from ident.measure.series import parse_series
from ident.measure.table import Findings, read_table
from ident.measure.trace import TRACE_ROWS_MIN, Trace
from ident.text import LARGEST_SAMPLES, NAME

FIELDS = {"frequency": "frequency", "angle": "angle"}
"""Columns of a pulley, `drive1.frequency [Hz]` and `drive1.angle [rad]`, and the quantity of each."""

_COLUMN = re.compile(rf"(?P<name>(?P<pulley>{NAME})\.(?P<field>{'|'.join(FIELDS)}))\s*\[.*\]")


@dataclass(frozen=True)
class Pulley:
    """How a pulley turns, at the times of the trace beside it.

    Attributes:
        frequency: (T,) [Hz] of turning; None where the file has no such column.
        angle: (T,) [rad] unwrapped; None where the file has no such column.
    """

    frequency: Float[np.ndarray, " T"] | None = None
    angle: Float[np.ndarray, " T"] | None = None


def read_pulleys(path: str | Path, trace: Trace) -> Mapping[str, Pulley]:
    """Read the pulleys in the file of a trace, by name; mostly none if it was measured.

    Args:
        path: the file.
        trace: what `read_trace` has read from it.

    Returns:
        The pulleys, in the order of the file.
    """
    there = [match for match in map(_COLUMN.fullmatch, trace.ignored) if match]
    if not there:
        return {}
    findings = Findings()
    wanted = {match["name"]: (FIELDS[match["field"]],) for match in there}
    series = parse_series(read_table(path, LARGEST_SAMPLES), path, wanted, TRACE_ROWS_MIN, findings)
    if findings:
        raise InputError(findings)
    return {
        name: Pulley(**{field: series[f"{name}.{field}"] for field in _fields(name, wanted)})
        for name in dict.fromkeys(match["pulley"] for match in there)
    }


def _fields(pulley: str, columns: Mapping[str, tuple[str, ...]]) -> Iterator[str]:
    return (field for field in FIELDS if f"{pulley}.{field}" in columns)
