"""The amplitudes of a sweep, one a row: as rows, and as CSV with where they come from."""

import csv
import io
from collections.abc import Iterator, Mapping
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from ident.assess.sweep import SweepStudy
from ident.files import replace_file
from ident.present.text.units import MM, unit_of
from ident.text import one_line
from ident.vibrate.redesign.sweep import Sweep
from ident.vibrate.response.study import DIRECTIONS


def sweep_rows(study: SweepStudy) -> list[dict[str, Any]]:
    """Return a row for each amplitude: value in SI, the speed in %; mm; 5 and 95 % of the draws, NaN without."""
    return [row for sweep in study.sweeps for row in _rows(sweep)]


def write_csv(study: SweepStudy, head: Mapping[str, Any], path: Path) -> None:
    """Write the amplitudes as CSV, with their origin, the head of the result file, above them."""
    basis, rows = study.basis, sweep_rows(study)
    notes = [
        f"{head['format']} {head['created']} ident {head['software']['ident']}",
        f"arm: {one_line(basis.arm_file.path)} sha256 {basis.arm_file.sha256}",
        f"motion: {one_line(basis.motion.name)}; load: {basis.load}; draws: {study.draws}",
        f"amplitude: {study.measure} of the vibration of {basis.point}; bands: 5 and 95 % quantiles of the draws",
    ]
    text = io.StringIO()
    text.writelines(f"# {note}\n" for note in notes)
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(rows[0])
    writer.writerows(map(_cell, row.values()) for row in rows)
    replace_file(path, lambda file: file.write(text.getvalue().encode("utf-8")), make_folders=True)


def _cell(value: Any) -> str:
    """Write a number with ten digits, an undefined one as nothing."""
    text = f"{value:.10g}" if isinstance(value, float) else str(value)
    return "" if text == "nan" else text


def _rows(sweep: Sweep) -> Iterator[dict[str, Any]]:
    parts = [sweep.amplitude, *(() if sweep.draws is None else sweep.band)]
    for place in product(*(range(len(axis.values)) for axis in sweep.axes)):
        values: dict[str, Any] = {}
        for number, axis, k in zip(("", "2"), sweep.axes, place, strict=False):
            names = (f"{name}{number}" for name in ("parameter", "value", "unit"))
            values |= zip(names, (axis.name, float(axis.values[k]), unit_of(axis.paths[0])), strict=True)
        for d, direction in enumerate(DIRECTIONS):
            size, *band = (MM * float(part[(d, *place)]) for part in parts)
            columns = ("direction", "amplitude [mm]", "q05 [mm]", "q95 [mm]")
            yield values | dict(zip(columns, (direction, size, *(band or (np.nan, np.nan))), strict=True))
