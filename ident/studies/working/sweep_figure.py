"""Figures of a sweep: amplitudes against each parameter, or a map of two."""

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import FixedLocator, LogLocator, MaxNLocator

from ident.report.report import cut, short_power
from ident.report.style import (
    BLUE,
    GREEN,
    GREY,
    NEAR,
    ORANGE,
    Style,
    colour_bar,
    key_below,
    plain,
    power_of,
    set_ticks,
    titled,
)
from ident.report.words import MM, in_shown_unit
from ident.studies.basis import motion_title
from ident.studies.working.sweep_report import axis_in_words
from ident.vibrate.study import DIRECTIONS
from ident.vibrate.sweep import Axis, Sweep, curve, has_present

if TYPE_CHECKING:
    from ident.studies.working.sweep_study import SweepStudy

WIDTH = 8.0
"""Width of a figure [inch]."""
COLUMN = 4
"""Panels per column."""
DOTTED: Style = {"linewidth": 1.4, "marker": ".", "markersize": 3}
WAYS: tuple[Style, ...] = (
    {**DOTTED, "color": BLUE, "linestyle": "-"},
    {**DOTTED, "color": ORANGE, "linestyle": "-"},
    {**DOTTED, "color": GREEN, "linestyle": "--"},
)
"""Styles of x, y, z."""
WIDE = 3.0
"""Ratio of the ends from which factors get a logarithmic axis."""
DEEPEST = 1e-3
"""Lowest drawn amplitude, as a share of the highest."""


def sweep_figure(study: "SweepStudy") -> Figure:
    """Draw the amplitudes in x, y and z against each parameter, or the largest of them over a map of two."""
    if study.is_map:
        return _map_figure(study)
    figure, grid = _panels(study)
    for axes, sweep in zip(grid, study.sweeps, strict=True):
        _curves(axes, study, sweep)
    _logarithmic(grid[0], study)
    notes = ["one parameter is varied at a time, the others keep their present values"] if len(study.sweeps) > 1 else []
    if study.limit is not None and not _limit(study):
        notes.append(f"the limit of {MM * study.limit:g} mm lies far above")
    key_below(figure, list(_entries(study)), "\n".join(notes), columns=6)
    return figure


def _logarithmic(axes: Axes, study: "SweepStudy") -> None:
    """Make the amplitudes' axis logarithmic, so that the largest direction does not flatten the others."""
    top = MM * max(_largest(study), _limit(study))
    low = MM * min(float(curve(sweep)[1].min()) for sweep in study.sweeps)
    if low <= 0:
        axes.set(ylim=(0, 1.06 * top or None))
        return
    axes.set_yscale("log")
    axes.set(ylim=(0.85 * max(low, DEEPEST * top), 1.18 * top))
    set_ticks(axes.yaxis, LogLocator(subs=(1.0, 2.0, 5.0)), "{:g}".format)


def _panels(study: "SweepStudy") -> tuple[Figure, list[Axes]]:
    count = len(study.sweeps)
    columns = 1 if count <= COLUMN else 2
    lines = -(-count // columns)
    size = (WIDTH * (1 + 0.6 * (columns - 1)), 2.5 * lines + 1.6)
    figure = titled(size, motion_title(f"Vibration of {study.basis.point}", study.basis), (0.08, 0.08))
    grid = list(figure.subplots(lines, columns, squeeze=False, sharey=True).ravel())
    for axes in grid[count:]:
        axes.remove()
    for place, axes in enumerate(grid[:count]):
        plain(axes, grid=True)
        if place % columns == 0:
            axes.set(ylabel=f"{study.measure} [mm]")
    return figure, grid[:count]


def _curves(axes: Axes, study: "SweepStudy", sweep: Sweep) -> None:
    (axis,) = sweep.axes
    values, amplitudes = curve(sweep)
    factor = in_shown_unit(axis.paths[0], 1.0)[0]
    for d, style in enumerate(WAYS):
        if sweep.draws is not None:
            low, high = MM * sweep.band[:, d]
            axes.fill_between(factor * axis.values, low, high, color=style["color"], alpha=0.18, linewidth=0, zorder=1)
        axes.plot(factor * values, MM * amplitudes[d], zorder=3, **style)
        if has_present(axis):
            axes.plot(factor * axis.present, MM * sweep.present[d], "o", color=style["color"], markersize=5, zorder=4)
    if has_present(axis):
        axes.axvline(factor * axis.present, color=GREY, linewidth=0.8, linestyle="--", zorder=2)
    if _limit(study):
        axes.axhline(MM * _limit(study), color=GREY, linewidth=0.8, linestyle=":", zorder=2)
    _scale(axes, axis, "x")
    if not axis.shifted and not axis.is_speed:
        _multiples(axes, axis)


def _multiples(axes: Axes, axis: Axis) -> None:
    """Show above the panel the factor of each value."""
    factor = in_shown_unit(axis.paths[0], axis.present)[0]
    functions: Any = (lambda x: x / factor, lambda x: x * factor)
    above = axes.secondary_xaxis("top", functions=functions)
    low, high = axis.values[[0, -1]] / axis.present
    locator = FixedLocator(_ticks(low, high)) if _is_log(axis) else above.xaxis.get_major_locator()
    set_ticks(above.xaxis, locator, "{:.4g}x".format)
    above.tick_params(labelsize=7, colors=GREY, length=2)
    above.spines["top"].set_visible(False)


def _scale(axes: Axes, axis: Axis, which: str) -> None:
    """Scale and label the x or the y axis: logarithmic for factors, powers of ten in the label."""
    factor, unit = in_shown_unit(axis.paths[0], 1.0)
    low, high = factor * axis.values[[0, -1]]
    size, named = power_of(max(abs(low), abs(high)), unit)
    getattr(axes, f"set_{which}lim")(low, high)
    own = axes.xaxis if which == "x" else axes.yaxis
    if _is_log(axis):
        getattr(axes, f"set_{which}scale")("log")
    locator = FixedLocator(_ticks(low, high)) if _is_log(axis) else MaxNLocator(8, steps=[1, 2, 2.5, 5, 10])
    set_ticks(own, locator, lambda x: short_power(f"{x / size:.4g}"))
    named = "" if named == "-" else f" [{named}]"
    own.set_label_text(f"{cut(axis_in_words(axis, brief=True), 60)}{named}", fontsize=9, parse_math=False)


def _is_log(axis: Axis) -> bool:
    """Whether an axis is logarithmic: positive values by equal factors, over a wide range."""
    return not axis.shifted and not axis.is_speed and bool(axis.values[-1] / axis.values[0] > WIDE)


def _ticks(low: float, high: float) -> list[float]:
    """Return a few round numbers for a logarithmic axis."""
    decades = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)
    for steps in ((1, 1.5, 2, 3, 4, 5, 6, 7, 8), (1, 2, 3, 5), (1, 3), (1,)):
        ticks = [s * 10.0**d for d in decades for s in steps if low * (1 - 1e-9) <= s * 10.0**d <= high * (1 + 1e-9)]
        if len(ticks) <= 9:
            break
    return ticks


def _largest(study: "SweepStudy") -> float:
    """Return the largest drawn amplitude [m]."""
    bands = [float(sweep.band[1].max()) for sweep in study.sweeps if sweep.draws is not None]
    return max([*bands, *(float(curve(sweep)[1].max()) for sweep in study.sweeps)])


def _limit(study: "SweepStudy") -> float:
    """Return the limit [m] if an amplitude comes near enough to draw it; elsewhere it would flatten the curves."""
    limit = study.limit or 0.0
    return limit if _largest(study) > NEAR * limit else 0.0


def _entries(study: "SweepStudy") -> Iterator[Line2D | Patch]:
    for direction, style in zip(DIRECTIONS, WAYS, strict=True):
        yield Line2D([], [], label=direction.upper(), **style)
    if any(has_present(axis) for sweep in study.sweeps for axis in sweep.axes):
        yield Line2D([], [], color=GREY, linewidth=0.8, linestyle="--", marker="o", markersize=5, label="present")
    if study.draws:
        yield Patch(color=GREY, alpha=0.18, linewidth=0, label=f"5 to 95 % of {study.draws} draws")
    if _limit(study):
        label = f"limit, {MM * _limit(study):g} mm"
        yield Line2D([], [], color=GREY, linewidth=0.8, linestyle=":", label=label)


def _map_figure(study: "SweepStudy") -> Figure:
    """Draw filled contours of the largest amplitude over x, y and z."""
    (sweep,) = study.sweeps
    figure = titled((WIDTH, 6.4), motion_title(f"Vibration of {study.basis.point}", study.basis), (0.08, 0.08))
    axes = figure.subplots()
    plain(axes)
    first, second = (in_shown_unit(axis.paths[0], 1.0)[0] * axis.values for axis in sweep.axes)
    largest = MM * sweep.amplitude.max(0)
    levels = np.asarray(MaxNLocator(12, steps=[1, 2, 2.5, 5, 10]).tick_values(largest.min(), largest.max()))
    levels = levels if len(levels) > 1 else np.array([levels[0], levels[0] + 1.0])  # all amplitudes are equal
    filled = axes.contourf(first, second, largest.T, levels=levels, cmap="viridis")
    label = f"largest {study.measure} of X, Y and Z [mm]"
    colour_bar(figure, axes, filled, label).outline.set_visible(False)
    for axis, which in zip(sweep.axes, "xy", strict=True):
        _scale(axes, axis, which)
    key_below(figure, list(_marks(axes, study, sweep)), "", columns=6)
    return figure


def _marks(axes: Axes, study: "SweepStudy", sweep: Sweep) -> Iterator[Line2D]:
    """Mark present design, best point and limit, and yield their handles for the key."""
    largest = sweep.amplitude.max(0)
    scales = [in_shown_unit(axis.paths[0], 1.0)[0] for axis in sweep.axes]
    best = np.unravel_index(largest.argmin(), largest.shape)
    marks = [(f"present, {MM * sweep.present.max():.3g} mm", "o", [axis.present for axis in sweep.axes])]
    marks = marks if all(has_present(axis) for axis in sweep.axes) else []
    least = [axis.values[k] for axis, k in zip(sweep.axes, best, strict=True)]
    for label, marker, place in (*marks, (f"least, {MM * largest.min():.3g} mm", "s", least)):
        style: Style = {"marker": marker, "markersize": 8, "markerfacecolor": "white", "markeredgecolor": "black"}
        x, y = (scale * value for scale, value in zip(scales, place, strict=True))
        axes.plot([x], [y], linestyle="", clip_on=False, zorder=5, **style)
        yield Line2D([], [], linestyle="", label=label, **style)
    if study.limit is not None and largest.min() < study.limit < largest.max():
        first, second = (scale * axis.values for scale, axis in zip(scales, sweep.axes, strict=True))
        axes.contour(first, second, largest.T, levels=[study.limit], colors="white", linewidths=1.8)
        axes.contour(first, second, largest.T, levels=[study.limit], colors=ORANGE, linewidths=1.2, linestyles="--")
        yield Line2D([], [], color=ORANGE, linestyle="--", label=f"limit, {MM * study.limit:g} mm")
