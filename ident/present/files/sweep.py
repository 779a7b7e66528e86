"""The files of a sweep: amplitudes as CSV, one a row, and a summary as JSON, with where they come from."""

import csv
import io
from collections.abc import Iterator, Mapping
from dataclasses import asdict
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from ident.assess.sweep import SweepStudy
from ident.files import replace_file
from ident.present.files import basis
from ident.present.files.document import plain
from ident.present.text.units import MM, unit_of
from ident.text import one_line
from ident.vibrate.redesign.sweep import Axis, Sweep
from ident.vibrate.redesign.trend import below, curve, trends
from ident.vibrate.response.study import DIRECTIONS

FORMAT = "ident-sweep/1"
DIGITS = ".10g"


def origin(sweeping: SweepStudy, options: Mapping[str, Any]) -> dict[str, Any]:
    """Say what a sweep was made from, with what and how."""
    return basis.origin(FORMAT, sweeping.basis, options)


def sweep_document(sweeping: SweepStudy, options: Mapping[str, Any]) -> dict[str, Any]:
    """Describe a sweep in numbers as plain data, all SI but the speed, which is in %."""
    document = origin(sweeping, options) | {
        **basis.motion_document(sweeping.basis),
        "measure": sweeping.measure,
        "direction": list(DIRECTIONS),
        "present": sweeping.present,
        "limit": sweeping.limit,
        "draws": sweeping.draws,
        "sweeps": [_sweep(sweep, sweeping.limit) for sweep in sweeping.sweeps],
        **basis.values_document(sweeping.basis),
    }
    return plain(document)


def write_csv(sweeping: SweepStudy, options: Mapping[str, Any], path: Path) -> None:
    """Write the amplitudes as CSV, one a row: in mm, values in SI, the speed in %; bands are empty without draws.

    Raises:
        InputError: the folder or the file can't be written; what was there before is untouched.
    """
    head = origin(sweeping, options)
    notes = [
        f"{FORMAT} {head['created']} ident {head['software']['ident']}",
        f"arm: {one_line(sweeping.arm_file.path)} sha256 {sweeping.arm_file.sha256}",
        f"motion: {one_line(sweeping.motion.name)}; load: {sweeping.load}; draws: {sweeping.draws}",
        f"amplitude: {sweeping.measure} of the vibration of {sweeping.point}; bands: 5 and 95 % quantiles of the draws",
    ]
    text = io.StringIO()
    text.writelines(f"# {note}\n" for note in notes)
    writer = csv.writer(text, lineterminator="\n")
    several = ("", "2")[: len(sweeping.sweeps[0].axes)]
    columns = [f"{name}{number}" for number in several for name in ("parameter", "value", "unit")]
    writer.writerow([*columns, "direction", "amplitude [mm]", "q05 [mm]", "q95 [mm]"])
    for sweep in sweeping.sweeps:
        writer.writerows(_rows(sweep))
    replace_file(path, lambda file: file.write(text.getvalue().encode("utf-8")), make_folders=True)


def _rows(sweep: Sweep) -> Iterator[list[str]]:
    parts = sweep.amplitude[None] if sweep.draws is None else np.concatenate([sweep.amplitude[None], sweep.band])
    for number, place in enumerate(product(*(range(len(axis.values)) for axis in sweep.axes))):
        told = [
            text
            for axis, k in zip(sweep.axes, place, strict=True)
            for text in (axis.name, f"{axis.values[k]:{DIGITS}}", unit_of(axis.paths[0]))
        ]
        for d, direction in enumerate(DIRECTIONS):
            sizes = parts[:, d].reshape((len(parts), -1))[:, number]
            yield [*told, direction, *(f"{MM * size:{DIGITS}}" for size in sizes), *[""] * (3 - len(sizes))]


def _sweep(sweep: Sweep, limit: float | None) -> dict[str, Any]:
    found: dict[str, Any] = {
        "axes": [_axis(axis) for axis in sweep.axes],
        "amplitude": sweep.amplitude,
        "band": None if sweep.draws is None else {"quantiles": [0.05, 0.95], "amplitude": sweep.band},
    }
    if limit is not None and sweep.draws is not None:
        found["exceeds_in_any"] = sweep.exceeds(limit)
    if len(sweep.axes) == 1:
        found["trend"] = {
            name: {"over_range": asdict(whole), "about_present": asdict(about) if about else None}
            for name, whole, about in trends(sweep)
        }
        values, amplitudes = curve(sweep)
        found["below_limit"] = None if limit is None else below(values, amplitudes[-1], limit)
    else:
        largest = sweep.amplitude.max(0)
        place = np.unravel_index(largest.argmin(), largest.shape)
        found["least"] = {
            "values": [axis.values[k] for axis, k in zip(sweep.axes, place, strict=True)],
            "amplitude": sweep.amplitude[(..., *place)],
        }
    return found


def _axis(axis: Axis) -> dict[str, Any]:
    return {"paths": list(axis.paths), "unit": unit_of(axis.paths[0]), "present": axis.present, "values": axis.values}
