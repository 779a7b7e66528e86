"""The printed report of a sweep: amplitudes against what is varied, where they are least, and how they go."""

from collections.abc import Iterator
from itertools import pairwise

import numpy as np

from ident.assess.sweep import SweepStudy
from ident.present.text.amplitude_words import mm, present_in_words, simulated_in_words
from ident.present.text.basis import assumed_in_words, basis_in_words
from ident.present.text.sweep_words import axis_in_words, kept_in_words, trends_in_words, value_on
from ident.present.text.units import MM, in_shown_unit
from ident.present.text.words import kept, paragraphs
from ident.vibrate.redesign.sweep import Axis, Sweep
from ident.vibrate.redesign.trend import LINES
from ident.vibrate.response.study import DIRECTIONS


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
