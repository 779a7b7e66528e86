"""The report of a sweep, its table, and the amplitudes as CSV."""

from collections.abc import Iterator, Mapping
from itertools import pairwise, product
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ident.arm.fields import field_of
from ident.files import write_text
from ident.measure.table import csv_text, guarded
from ident.report.report import Cell, Part, Report, Section, Table, Verdict, by_head, cut, short_power
from ident.report.words import MM, counted, in_shown_unit, percent, unit_of, value_in_words
from ident.studies.basis import all_findings, assumed_section, motion_section, subject
from ident.vibrate.simulate import MEASURES
from ident.vibrate.study import DIRECTIONS
from ident.vibrate.sweep import LINES, NOTABLE, Axis, Sweep, Trend, below, curve, trends

if TYPE_CHECKING:
    from ident.studies.working.sweep_study import SweepStudy
    from ident.vibrate.variable import Variable

# -------- Words
# The varied numbers, and how an amplitude depends on them.


def axis_in_words(axis: Axis, *, brief: bool = False) -> str:
    """Name the varied number: `joint1.k_tors, torsional stiffness of joint1`; of several only the first if brief."""
    if axis.is_speed:
        return "speed, percent of full speed"
    if len(axis.paths) > 1:
        names = f"{axis.paths[0]} and {len(axis.paths) - 1} more" if brief else f"{', '.join(axis.paths)} together"
        return f"{names}, by one {'difference' if axis.shifted else 'factor'}"
    part, name, *component = axis.name.split(".")
    field = field_of(axis.name)
    if field is None or (field.words == name.replace("_", " ") and not field.rank):
        return axis.name
    return f"{axis.name}, {', '.join([f'{field.words} of {part}', *component])}"


def change_in_words(variable: "Variable", change: float) -> str:
    """Write a change as `1.26x` or `+0.05 m`."""
    if variable.shifted:
        return f"{change:+.4g} {unit_of(variable.paths[0])}".removesuffix(" -")
    return f"{np.exp(change):.4g}x"


def mm(value: float) -> str:
    """Write a length [m] in mm."""
    return f"{MM * value:.4f}"


def _short(length: float) -> str:
    """Write a length [m] in mm, with fewer decimals if large."""
    return mm(length) if MM * length < 10 else f"{MM * length:.2f}"


def _value(axis: Axis, value: float) -> str:
    """Write a value of the varied number with its unit."""
    return short_power(value_in_words(axis.paths[0], value))


def _number(axis: Axis, value: float) -> str:
    """Write a value of the varied number without its unit."""
    return short_power(f"{in_shown_unit(axis.paths[0], value)[0]:.4g}")


def _named(axis: Axis) -> str:
    """Name the varied number with its unit: `joint1.k_tors [N m/rad]`."""
    more = f" and {len(axis.paths) - 1} more" if len(axis.paths) > 1 else ""
    unit = in_shown_unit(axis.paths[0], 1.0)[1]
    return f"{axis.paths[0]}{more}" + (f" [{unit}]" if unit != "-" else "")


SHAPES = {
    "flat": "hardly changes",
    "falls": "falls",
    "rises": "rises",
    "minimum": "has a minimum",
    "maximum": "has a maximum",
    "wavy": "rises and falls",
}
"""How an amplitude behaves, by the shape of its trend."""


def _kept_at(sweep: Sweep, limit: float) -> str:
    """Say where the largest amplitude keeps a limit [m]: `from 5.2e5 on`; `nowhere`, or `everywhere`."""
    (axis,) = sweep.axes
    values, amplitudes = curve(sweep)
    spans = below(values, amplitudes[-1], limit)
    if not spans:
        return "nowhere"
    if spans == [(values[0], values[-1])]:
        return "everywhere"
    return ", ".join(_span(axis, values, span) for span in spans)


def _span(axis: Axis, values: np.ndarray, span: tuple[float, float]) -> str:
    start, end = (_number(axis, value) for value in span)
    if span[0] == span[1]:
        return f"at {start}"
    if span[0] == values[0]:
        return f"up to {end}"
    return f"from {start} on" if span[1] == values[-1] else f"{start} to {end}"


# -------- Report

LISTED = 8
"""Parameters on the first screen."""


def sweep_sections(study: "SweepStudy") -> Report:
    """Return the report of a sweep."""
    names = " by ".join(cut(axis.name, 24) for axis in study.sweeps[0].axes)
    varied = f"map of {names}" if study.is_map else f"{counted(len(study.sweeps), 'parameter')}, one at a time"
    return Report(
        f"Sweep of {subject(study.basis)}: {varied}",
        _verdict(study),
        tuple(_answer(study)),
        tuple(all_findings(study.basis)),
        next="ident design {arm}",
        details=tuple(_details(study)),
    )


def _verdict(study: "SweepStudy") -> Verdict | None:
    """Judge an arm: OK if it keeps the limit, REACHABLE if a value in the ranges does, else NOT REACHABLE.

    MARGINAL if it keeps the limit, but some draws do not. None without a limit.
    """
    if study.limit is None:
        return None
    limit, present, largest = study.limit, study.present, [sweep.amplitude.max(0) for sweep in study.sweeps]
    size = f"{mm(present.max())} mm in {DIRECTIONS[int(present.argmax())]}"
    chances, now = "", _exceeding_now(study)
    if study.draws:
        share = min(float(sweep.exceeds(limit).min()) for sweep in study.sweeps)
        at_present = "" if now is None else f"{percent(now)} at present, "
        at_best = f"{percent(share)} at best ({counted(study.draws, 'draw')})"
        chances = f"; probability of exceeding it: {at_present}{at_best}"
    if present.max() <= limit:
        reason = f"{size} keeps the limit of {MM * limit:g} mm"
        if now:
            return Verdict("MARGINAL", f"{reason}, but not safely{chances}.", "caution")
        return Verdict("OK", f"{reason} in all directions{chances}.", "good")
    exceeds = f"{size} exceeds the limit of {MM * limit:g} mm"
    best = int(np.argmin([each.min() for each in largest]))
    if largest[best].min() > limit:
        least = f"at least {mm(largest[best].min())} mm in these ranges"
        return Verdict("NOT REACHABLE", f"{exceeds}; {least}{chances}.", "bad")
    place = _point(study.sweeps[best], int(largest[best].argmin()))
    return Verdict("REACHABLE", f"{exceeds}; {mm(largest[best].min())} mm with {place}{chances}.", "caution")


def _exceeding_now(study: "SweepStudy") -> float | None:
    """Return the share of draws of the present arm that exceed the limit; None if no sweep contains it."""
    if study.limit is None or not study.draws or study.is_map:
        return None
    for sweep in study.sweeps:
        for value, share in zip(sweep.axes[0].values, sweep.exceeds(study.limit), strict=True):
            if _mark(sweep.axes[0], value):
                return float(share)
    return None


def _answer(study: "SweepStudy") -> Iterator[Part]:
    sizes = ", ".join(f"{d} {mm(size)} mm" for d, size in zip(DIRECTIONS, study.present, strict=True))
    over = "the mean" if study.measure == "rms" else "the largest"
    phases = f", {over} over the unknown imbalance phases" if study.basis.unknown.phases else ""
    yield f"{study.measure.capitalize()} vibration of {cut(study.basis.point, 20)} as the arm is: {sizes}{phases}."
    if study.is_map:
        yield from _map_extremes(study, study.sweeps[0])
        return
    rows = []
    for sweep in study.sweeps[:LISTED]:
        (axis,) = sweep.axes
        last = _kept_at(sweep, study.limit) if study.limit is not None else SHAPES[_trends(sweep)["largest"][0].shape]
        rows.append((_named(axis), _number(axis, axis.present), *_extremes(axis, sweep.amplitude.max(0)), last))
    hidden = len(study.sweeps) - LISTED
    more = f"{counted(hidden, 'more parameter')}: --details. " if hidden > 0 else ""
    last = "trend" if study.limit is None else f"{MM * study.limit:g} mm kept"
    heads = "parameter", "present", "least [mm]", "at", "largest [mm]", "at", last
    yield by_head(heads, rows, note=f"{more}Largest of x, y and z.")


def _extremes(axis: Axis, sizes: np.ndarray) -> list[str]:
    """Return the least and the largest amplitude along an axis, each with its place."""
    return [text for k in (sizes.argmin(), sizes.argmax()) for text in (mm(sizes[k]), _number(axis, axis.values[k]))]


def _trends(sweep: Sweep) -> dict[str, tuple[Trend, Trend | None]]:
    return {name: (whole, about) for name, whole, about in trends(sweep)}


def _map_extremes(study: "SweepStudy", sweep: Sweep) -> Iterator[Part]:
    """Yield the places of least and largest vibration, by direction and overall, and where the limit is kept."""
    largest = sweep.amplitude.max(0)
    rows = []
    for name, table in zip(LINES, [*sweep.amplitude, largest], strict=True):
        row = [name]
        for place in (table.argmin(), table.argmax()):
            places = np.unravel_index(place, table.shape)
            at = [_number(axis, axis.values[k]) for axis, k in zip(sweep.axes, places, strict=True)]
            row += [mm(table.flat[place]), *at]
        rows.append(tuple(row))
    names = [_named(axis) for axis in sweep.axes]
    yield Table("", ("", "least [mm]", *names, "largest [mm]", *names), tuple(rows))
    if study.limit is not None:
        kept = f"The limit is kept at {int((largest <= study.limit).sum())} of {largest.size} points."
        if sweep.draws is not None:
            shares = sweep.exceeds(study.limit)
            surest = int(np.where(shares == shares.min(), largest, np.inf).argmin())  # among equals the least amplitude
            kept += f" Least probability of exceeding it: {percent(float(shares.min()))}, at {_point(sweep, surest)}."
        yield kept


def _point(sweep: Sweep, place: int) -> str:
    places = np.unravel_index(place, sweep.amplitude.shape[1:])
    pairs = zip(sweep.axes, places, strict=True)
    return ", ".join(f"{cut(axis.name, 24)} {_value(axis, axis.values[k])}" for axis, k in pairs)


# -------- Details


def _details(study: "SweepStudy") -> Iterator[Section]:
    speeds = any(axis.is_speed for sweep in study.sweeps for axis in sweep.axes)
    yield motion_section(
        study.basis,
        elastic_belts=study.elastic_belts,
        rate=study.rate,
        method=f"fast. {study.measure.capitalize()}: {MEASURES[study.measure]}",
        more=("At another speed the same path is passed on another clock, pauses included.",) if speeds else (),
        varied=True,
    )
    for sweep in study.sweeps:
        parts = _map_rows(sweep) if study.is_map else _parameter(study, sweep)
        title = " by ".join(axis_in_words(axis) for axis in sweep.axes)
        yield Section(title, (*map(_axis, sweep.axes), *parts))
    yield from assumed_section(study.basis)


def _axis(axis: Axis) -> str:
    """Say how many values there are and their spacing."""
    low, high, count = axis.values[0], axis.values[-1], len(axis.values)
    steps = [b - a for a, b in pairwise(axis.values)]
    spacing = "equal steps" if np.allclose(steps, steps[0]) and count > 2 else "equal factors"
    present = f"{axis.name} at present: {_value(axis, axis.present)}"
    return f"{present}; {count} values from {_value(axis, low)} to {_value(axis, high)}, {spacing}."


def _parameter(study: "SweepStudy", sweep: Sweep) -> Iterator[Part]:
    """Yield amplitudes at each value, with bands and the probability of exceeding the limit; and their trends."""
    (axis,) = sweep.axes
    factor, unit = in_shown_unit(axis.paths[0], 1.0)
    columns: dict[str, list[Cell]] = {f"value [{unit}]|.5g": [float(value) * factor for value in axis.values]}
    if not axis.shifted:
        columns["times|.5g"] = [float(value / axis.present) for value in axis.values]
    columns |= {f"{d} [mm]": list(map(mm, sizes)) for d, sizes in zip(DIRECTIONS, sweep.amplitude, strict=True)}
    note = ""
    if sweep.draws is not None and study.limit is not None:
        columns["exceeds"] = [percent(share) for share in sweep.exceeds(study.limit)]
        note = f"exceeds: probability that {MM * study.limit:g} mm is exceeded in any direction."
    columns[""] = [_mark(axis, value) for value in axis.values]
    yield by_head(columns, zip(*columns.values(), strict=True), note=note)
    if sweep.draws is not None:
        low, high = sweep.band
        rows = [
            (float(value) * factor, *(f"{_short(low[d, k])} to {_short(high[d, k])}" for d in range(3)))
            for k, value in enumerate(axis.values)
        ]
        heads = f"value [{unit}]|.5g", *(f"{d} [mm]" for d in DIRECTIONS)
        yield by_head(heads, rows, f"5 to 95 % of {counted(study.draws, 'draw')}")
    yield _trend_table(sweep)
    if study.limit is not None:
        kept = _kept_at(sweep, study.limit)
        yield f"{_named(axis)} with which the limit of {MM * study.limit:g} mm is kept in all directions: {kept}."


def _trend_table(sweep: Sweep) -> Table:
    """Return the trends of the amplitudes, over the whole range and near the present value."""
    (axis,) = sweep.axes
    lines = _trends(sweep)
    *each, largest = curve(sweep)[1]
    same = next((name for name, line in zip(DIRECTIONS, each, strict=True) if (line == largest).all()), "")
    if same:
        del lines["largest"]
    rows = []
    for name, (whole, about) in lines.items():
        extremes = ((mm(size), _number(axis, value)) for value, size in (whole.least, whole.largest))
        ends = [mm(size) for size in whole.ends]
        rows.append((name, SHAPES[whole.shape], *ends, *next(extremes), *next(extremes), _about(axis, about)))
    head = ("", "trend", "first [mm]", "last [mm]", "least [mm]", "at", "largest [mm]", "at", "near present")
    note = f"hardly changes: by less than {100 * NOTABLE:.0f} % of the largest."
    note += f" Largest of x, y and z: that in {same}." if same else ""
    near = next((about for _, about in lines.values() if about), None)
    if near is None:
        return Table("", head[:-1], tuple(row[:-1] for row in rows), note=f"{note} The present value is out of range.")
    low, high = near.span
    by_factor = f"{low / axis.present:.3g}x to {high / axis.present:.3g}x"
    span = f"{low:.4g} to {_value(axis, high)}" if axis.shifted else by_factor
    return Table("", head, tuple(rows), note=f"{note} near present: {span}.")


def _about(axis: Axis, about: Trend | None) -> str:
    if about is None:
        return ""
    turn = {"minimum": about.least, "maximum": about.largest}.get(about.shape)
    return f"{about.shape} at {_number(axis, turn[0])}" if turn else SHAPES[about.shape]


def _map_rows(sweep: Sweep) -> Iterator[Part]:
    """Yield for each value of the first parameter where the largest amplitude is least and largest."""
    first, second = sweep.axes
    rows = (
        (_number(first, value), *_extremes(second, row), _mark(first, value))
        for value, row in zip(first.values, sweep.amplitude.max(0), strict=True)
    )
    heads = _named(first), "least [mm]", f"at {_named(second)}", "largest [mm]", f"at {_named(second)}", ""
    yield by_head(heads, rows, f"For each {first.name}: least and largest of the largest of x, y and z")


def _mark(axis: Axis, value: float) -> str:
    return "present" if np.isclose(value, axis.present, rtol=1e-9, atol=1e-12) else ""


# -------- Rows


def sweep_rows(study: "SweepStudy") -> list[dict[str, Any]]:
    """Return a row for each amplitude: value in SI, the speed in %; mm; 5 and 95 % of the draws, NaN without."""
    rows, sizes = list[dict[str, Any]](), ("amplitude [mm]", "q05 [mm]", "q95 [mm]")
    for sweep in study.sweeps:
        band = np.full((2, *sweep.amplitude.shape), np.nan) if sweep.draws is None else sweep.band
        for place in product(*(range(len(axis.values)) for axis in sweep.axes)):
            values: dict[str, Any] = {}
            for number, axis, k in zip(("", "2"), sweep.axes, place, strict=False):
                values |= {f"parameter{number}": axis.name, f"value{number}": float(axis.values[k])}
                values[f"unit{number}"] = unit_of(axis.paths[0])
            for d, direction in enumerate(DIRECTIONS):
                parts = (MM * float(part[(d, *place)]) for part in (sweep.amplitude, *band))
                rows.append(values | {"direction": direction} | dict(zip(sizes, parts, strict=True)))
    return rows


def write_csv(study: "SweepStudy", head: Mapping[str, Any], path: Path) -> None:
    """Write the amplitudes as CSV, below a header with their origin, the head of the result file."""
    basis, rows = study.basis, sweep_rows(study)
    notes = [
        f"{head['format']} {head['created']} ident {head['software']['ident']}",
        f"arm: {guarded(basis.arm_file.path)} sha256 {basis.arm_file.sha256}",
        f"motion: {guarded(basis.motion.name)}; load: {guarded(str(basis.load))}; draws: {study.draws}",
        f"amplitude: {study.measure} of the vibration of {basis.point}; bands: 5 and 95 % quantiles of the draws",
    ]
    cells = ({name: _cell(value) for name, value in row.items()} for row in rows)
    write_text(path, csv_text(list(rows[0]), cells, notes))


def _cell(value: Any) -> str:
    """Write a number with ten digits, an undefined one as empty."""
    text = f"{value:.10g}" if isinstance(value, float) else str(value)
    return "" if text == "nan" else text
