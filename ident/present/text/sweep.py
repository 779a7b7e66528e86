"""The printed report of a sweep: amplitudes against what is varied, where they are least, and how they go."""

from collections.abc import Iterator
from itertools import pairwise

import numpy as np
from jaxtyping import Float

from ident.arm.fields import field_of
from ident.assess.design import SweepStudy
from ident.assess.scenario import Basis
from ident.present.text.basis import assumed_in_words, basis_in_words, load_in_words, motion_in_words
from ident.present.text.words import MM, in_shown_unit, kept, paragraphs, unit_of, value_in_words
from ident.vibrate.evaluator import Variable
from ident.vibrate.simulate import MEASURES
from ident.vibrate.study import DIRECTIONS
from ident.vibrate.sweep import LINES, NOTABLE, Axis, Sweep, Trend, below, curve, trends

# -------- Amplitude words
# Amplitudes, limits and changes in words: what the reports of sweeps, sensitivities and designs share.


def simulated_in_words(basis: Basis, *, elastic_belts: bool, rate: float) -> Iterator[str]:
    """Say what is moved and how that is simulated."""
    yield from motion_in_words(basis)
    yield f"{load_in_words(basis, elastic_belts, rate)}; fast method"


def present_in_words(
    basis: Basis, measure: str, amplitude: Float[np.ndarray, "3"], limit: float | None, remark: str = ""
) -> Iterator[str]:
    """Tell the amplitudes [m] of the arm as it is, and whether they keep a limit."""
    sizes = ", ".join(f"{d} {mm(size)} mm" for d, size in zip(DIRECTIONS, amplitude, strict=True))
    yield f"Vibration of {basis.point}, {measure}: {MEASURES[measure]}"
    yield f"  as the arm is: {sizes}"
    if limit is not None:
        yield f"  {limit_in_words(amplitude, limit)}{remark}"


def limit_in_words(amplitude: Float[np.ndarray, "3"], limit: float) -> str:
    """Say in which directions amplitudes exceed a limit [m]."""
    beyond = [d for d, size in zip(DIRECTIONS, amplitude, strict=True) if size > limit]
    words = f"exceeded in {', '.join(beyond)}" if beyond else "kept in all directions"
    return f"limit of {MM * limit:g} mm: {words}"


def change_in_words(variable: Variable, change: float) -> str:
    """Write a change as `1.26x` or `+0.05 m`."""
    if variable.shifted:
        return f"{change:+.4g} {unit_of(variable.paths[0])}".removesuffix(" -")
    return f"{np.exp(change):.4g}x"


def mm(value: float) -> str:
    """Write a length in mm."""
    return f"{MM * value:.4f}"


# -------- Sweep words
# What is swept, and how an amplitude goes with it, put into words.


def axis_in_words(axis: Axis, *, brief: bool = False) -> str:
    """Say what is swept: `joint1.k_tors, torsional stiffness of joint1`; of several numbers only the first if brief."""
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


def value_on(axis: Axis, value: float) -> str:
    """Write a value of what is swept with its unit."""
    return value_in_words(axis.paths[0], value)


def trends_in_words(sweep: Sweep) -> Iterator[str]:
    """Say how the amplitudes go, over the whole range and about the present value."""
    (axis,) = sweep.axes
    lines = {name: (whole, about) for name, whole, about in trends(sweep)}
    *each, largest = curve(sweep)[1]
    same = next((name for name, line in zip(DIRECTIONS, each, strict=True) if (line == largest).all()), "")
    for name, (whole, _) in lines.items():
        words = f"that in {same}" if same and name == "largest" else _over_range(axis, whole)
        yield f"  {name + ':':8s} {words}"
    near = {name: about for name, (_, about) in lines.items() if about and not (same and name == "largest")}
    if not near:
        yield "  the present value is outside the range"
        return
    low, high = next(iter(near.values())).span
    span = f"{low:.4g} to {value_on(axis, high)}"
    if not axis.shifted:
        span = f"{low / axis.present:.3g}x to {high / axis.present:.3g}x"
    ways = "; ".join(f"{name} {_about(axis, about)}" for name, about in near.items())
    yield f"  about the present value, {span}: {ways}"


def _over_range(axis: Axis, whole: Trend) -> str:
    least, largest = (f"{mm(size)} mm at {value_on(axis, value)}" for value, size in (whole.least, whole.largest))
    start, end = (mm(size) for size in whole.ends)
    return {
        "flat": f"is hardly changed (by less than {100 * NOTABLE:.0f} %)",
        "falls": f"falls from {start} to {end} mm",
        "rises": f"rises from {start} to {end} mm",
        "minimum": f"has a minimum, {least}",
        "maximum": f"has a maximum, {largest}",
        "wavy": f"goes up and down, from {start} to {end} mm; largest {largest}",
    }[whole.shape]


def _about(axis: Axis, about: Trend) -> str:
    return {
        "flat": "is hardly changed",
        "falls": "falls",
        "rises": "rises",
        "minimum": f"has a minimum at {value_on(axis, about.least[0])}",
        "maximum": f"has a maximum at {value_on(axis, about.largest[0])}",
        "wavy": "goes up and down",
    }[about.shape]


def kept_in_words(sweep: Sweep, limit: float) -> str:
    """Say where the largest amplitude keeps a limit [m]."""
    (axis,) = sweep.axes
    values, amplitudes = curve(sweep)
    spans = below(values, amplitudes[-1], limit)
    if not spans:
        return "kept nowhere in the range"
    if spans == [(values[0], values[-1])]:
        return "kept in the whole range"
    return f"kept {', '.join(_span(axis, values, span) for span in spans)}"


def _span(axis: Axis, values: np.ndarray, span: tuple[float, float]) -> str:
    start, end = (value_on(axis, value) for value in span)
    if span[0] == span[1]:
        return f"at {start}"
    if span[0] == values[0]:
        return f"up to {end}"
    return f"from {start} on" if span[1] == values[-1] else f"from {start} to {end}"


# -------- Sweep


def sweep_report(study: SweepStudy) -> str:
    """Return the report: motion, the present amplitude, a table and the trend of each parameter, what is assumed."""
    one = _map if study.is_map else _parameter
    remark = " by the arm itself" if study.draws else ""
    present = present_in_words(study.basis, study.measure, study.present, study.limit, remark)
    sections = [_heading(study), present, *(one(study, sweep) for sweep in study.sweeps)]
    return paragraphs([*sections, assumed_in_words(study.basis)])


def _heading(study: SweepStudy) -> Iterator[str]:
    yield from simulated_in_words(study.basis, elastic_belts=study.elastic_belts, rate=study.rate)
    if any(axis.is_speed for sweep in study.sweeps for axis in sweep.axes):
        yield "  at another speed the same path is passed on another clock, pauses included"
    yield from basis_in_words(study.basis, changed_draws=True)


def _parameter(study: SweepStudy, sweep: Sweep) -> Iterator[str]:
    (axis,) = sweep.axes
    yield axis_in_words(axis)
    yield f"  at present {value_on(axis, axis.present)}; {_values(axis)}"
    yield from _table(study, sweep)
    yield from trends_in_words(sweep)
    place = sweep.amplitude.argmin(1)
    ways = zip(DIRECTIONS, sweep.amplitude.min(1), axis.values[place], strict=True)
    least = (kept(f"{d} {mm(size)} mm at {value_on(axis, value)}") for d, size, value in ways)
    yield f"  least: {'; '.join(least)}"
    if study.limit is not None:
        words = kept_in_words(sweep, study.limit)
        yield f"  limit of {MM * study.limit:g} mm, in all directions: {words}"


def _table(study: SweepStudy, sweep: Sweep) -> Iterator[str]:
    """Yield head and rows: value, amplitudes with bands [mm], probability that the limit is exceeded."""
    (axis,) = sweep.axes
    drawn, limit = sweep.draws is not None, study.limit
    factor, unit = in_shown_unit(axis.paths[0], 1.0)
    times, narrow = (8, 7) if drawn else (12, 11)
    head = f"{f'[{unit}]':>12s}" + ("" if axis.shifted else f"{'times':>{times}s}")
    head += "".join(f"{d + ' [mm]':>{narrow}s}" + ("     5 to 95 %" if drawn else "") for d in DIRECTIONS)
    yield head + (" exceeds" if drawn and limit is not None else "")
    shares = sweep.exceeds(limit) if drawn and limit is not None else None
    for k, value in enumerate(axis.values):
        row = f"{value * factor:12.5g}" + ("" if axis.shifted else f"{value / axis.present:{times}.5g}")
        for d in range(3):
            row += f"{_short(sweep.amplitude[d, k]) if drawn else mm(sweep.amplitude[d, k]):>{narrow}s}"
            row += f"{'-'.join(map(_short, sweep.band[:, d, k])):>14s}" if drawn else ""
        yield row + ("" if shares is None else f"{shares[k]:8.0%}") + _mark(axis, value)
    if shares is not None:
        yield f"  exceeds: probability that {MM * (limit or 0):g} mm is exceeded in any direction"


def _map(study: SweepStudy, sweep: Sweep) -> Iterator[str]:
    """Yield what a map says: present values, extremes, and the best of each row."""
    first, second = sweep.axes
    for axis in sweep.axes:
        yield axis_in_words(axis)
        yield f"  at present {value_on(axis, axis.present)}; {_values(axis)}"
    largest = sweep.amplitude.max(0)
    yield f"  For each {first.name}: least and largest of what is the largest over x, y and z [mm], and where"
    names = [f"{axis.name} [{in_shown_unit(axis.paths[0], 1.0)[1]}]" for axis in (first, second, second)]
    widths = [max(len(name), 12) for name in names]
    heads = (f"{name:>{width}s}" for name, width in zip(names, widths, strict=True))
    yield f"  {next(heads)}      least at {next(heads)}    largest at {next(heads)}"
    for value, row in zip(first.values, largest, strict=True):
        number = f"{in_shown_unit(first.paths[0], value)[0]:.5g}"
        parts = [
            f"{mm(row[k]):>11s} at {f'{in_shown_unit(second.paths[0], second.values[k])[0]:.5g}':>{width}s}"
            for k, width in zip((row.argmin(), row.argmax()), widths[1:], strict=True)
        ]
        yield f"  {number:>{widths[0]}s}{parts[0]}{parts[1]}{_mark(first, value)}"
    for name, table in zip(LINES, [*sweep.amplitude, largest], strict=True):
        least, most = (_where(sweep, table, int(place)) for place in (table.argmin(), table.argmax()))
        yield f"  {name + ':':8s} least {least}; largest {most}"
    if study.limit is not None:
        below = int((largest <= study.limit).sum())
        yield f"  limit of {MM * study.limit:g} mm, in all directions: kept at {below} of {largest.size} points"
        if sweep.draws is not None:
            share, place = _surest(sweep, study.limit)
            yield f"    least probability of exceeding it: {share:.0%}, at {place}"


def _where(sweep: Sweep, table: np.ndarray, place: int) -> str:
    return f"{mm(table.flat[place])} mm at {_point(sweep, place)}"


def _point(sweep: Sweep, place: int) -> str:
    places = np.unravel_index(place, sweep.amplitude.shape[1:])
    pairs = zip(sweep.axes, places, strict=True)
    return ", ".join(f"{axis.name} {value_on(axis, axis.values[k])}" for axis, k in pairs)


def _surest(sweep: Sweep, limit: float) -> tuple[float, str]:
    """Return the least probability of exceeding a limit and where it is: among equals, where the amplitude is least."""
    shares, largest = sweep.exceeds(limit), sweep.amplitude.max(0)
    place = int(np.where(shares == shares.min(), largest, np.inf).argmin())
    return float(shares.min()), _point(sweep, place)


def _values(axis: Axis) -> str:
    """Say how many values there are and how they are spaced."""
    low, high, count = axis.values[0], axis.values[-1], len(axis.values)
    steps = [b - a for a, b in pairwise(axis.values)]
    even = np.allclose(steps, steps[0]) and count > 2
    start, end = (kept(value_on(axis, value)) for value in (low, high))
    return f"{count} values from {start} to {end}, {'even' if even else 'equal factors'}"


def _mark(axis: Axis, value: float) -> str:
    return "  present" if np.isclose(value, axis.present, rtol=1e-9, atol=1e-12) else ""


def _short(length: float) -> str:
    """Write a length [m] in mm, with fewer decimals where it is large."""
    return mm(length) if MM * length < 10 else f"{MM * length:.2f}"
