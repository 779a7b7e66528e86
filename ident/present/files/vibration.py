"""Rows of predictions, designs, resonances, spectra and sweeps."""

import csv
import io
import math
from collections.abc import Iterator, Mapping, Sequence
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from ident.assess.design import DesignStudy, SweepStudy, bound_of
from ident.assess.predict import Prediction
from ident.assess.spectrum import Spectra
from ident.files import replace_file
from ident.present.text.resonance import grouped
from ident.present.text.words import MM, unit_of
from ident.text import one_line
from ident.vibrate.design import Design
from ident.vibrate.resonance import ResonanceCrossing
from ident.vibrate.study import DIRECTIONS
from ident.vibrate.sweep import Sensitivities, Sweep

# -------- Design
# A design, or sensitivities, as rows, and the arm file with the changed numbers.


def design_rows(study: DesignStudy, design: Design) -> list[dict[str, Any]]:
    """Return a row for each number that may be changed [SI]: as it is, at best, and by the minimum change."""
    return [
        {
            "number": path,
            "unit": unit_of(path),
            "present": float(study.basis.arm.get(path)),
            "best": design.best.values[path],
            "minimum_change": math.nan if design.minimum_change is None else design.minimum_change.values[path],
            "at_bound": bound_of(study.basis.arm, variable, float(change)),
        }
        for variable, change in zip(design.evaluator.variables, design.best.changes, strict=True)
        for path in variable.paths
    ]


def sensitivity_rows(each: Sensitivities) -> list[dict[str, Any]]:
    """Return a row for each number [SI], the strongest first: percent of amplitude per percent of it in x, y and z.

    `unsure` names the directions in which its sign is another for nearby arms.
    """
    return [
        {"number": each.paths[i], "unit": unit_of(each.paths[i]), "present": float(each.present[i])}
        | dict(zip(DIRECTIONS, map(float, each.elasticity[i]), strict=True))
        | {"unsure": "".join(np.array([*DIRECTIONS])[each.unsure[i]])}
        for i in each.order
    ]


def write_arm(text: str, note: str, path: Path) -> None:
    """Write an arm file whole or not at all, with a note above it."""
    whole = f"# {one_line(note)}\n{text}"
    replace_file(path, lambda file: file.write(whole.encode("utf-8")), make_folders=True)


# -------- Predict
# Predictions as rows.


def predict_rows(predictions: Sequence[Prediction]) -> list[dict[str, Any]]:
    """Return a row for each mode at each posture: angles [deg], load, frequency [Hz], label, damping ratio [-].

    Frequencies and damping ratios have quantiles of 5 and 95 %, NaN without draws.
    """
    return [
        {
            **{joint.name: math.degrees(q) for joint, q in zip(analysis.arm.driven, analysis.posture, strict=True)},
            "load": str(analysis.load),
            "mode": i + 1,
            "frequency": float(analysis.modes.frequency[i]),
            "label": str(label),
            "damping_ratio": float(analysis.damping_ratio[i]),
            "frequency_q05": float(each.frequency_band[0, i]),
            "frequency_q95": float(each.frequency_band[1, i]),
            "damping_q05": float(each.damping_band[0, i]),
            "damping_q95": float(each.damping_band[1, i]),
        }
        for analysis, each in ((each.analysis, each) for each in predictions)
        for i, label in enumerate(analysis.labels)
    ]


# -------- Resonance
# Resonance along a motion, as rows.

COLUMNS = (
    *("start", "end", "time", "natural", "excitation", "distance", "relative_distance"),
    *("amplitude", "cycles", "sweep_number", "magnification", "built_up", "probability", "crossing_probability"),
)


def resonance_rows(crossings: Sequence[ResonanceCrossing]) -> list[dict[str, Any]]:
    """Return resonance crossings as rows, numbered as in the report: times [s], frequencies [Hz], amplitude [m]."""
    return [
        _head(crossing, number) | {name: getattr(crossing, name) for name in COLUMNS}
        for number, group in enumerate(grouped(crossings), start=1)
        for crossing in group
    ]


def _head(crossing: ResonanceCrossing, number: int) -> dict[str, Any]:
    source = crossing.source
    return {"number": number, "drive": source.drive, "order": source.order, "label": str(crossing.label)}


# -------- Spectrum
# The peaks of spectra as rows.


def spectrum_rows(spectra: Spectra) -> list[dict[str, Any]]:
    """Return the strongest peaks as rows: frequency [Hz], amplitude [m or m/s^2], and the mode near it."""
    return [
        {
            "trace": name,
            "direction": direction,
            "frequency": peak.frequency,
            "amplitude": peak.amplitude,
            "mode": spectra.mode_near(name, direction, peak.frequency),
        }
        for name in spectra.traces
        for direction in spectra.directions
        for peak in spectra.strongest(name, direction)
    ]


# -------- Sweep
# The amplitudes of a sweep, one a row: as rows, and as CSV with where they come from.


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
