"""A fit: its values with their intervals, undetermined combinations, and residuals."""

import math
from collections.abc import Sequence
from itertools import product
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.gridspec import SubplotSpec
from matplotlib.ticker import LogLocator

from ident.inference.information import WEAK_ABOVE, Direction
from ident.report.report import cut, written
from ident.report.style import (
    BLUE,
    FILLED,
    GREEN,
    HOLLOW,
    ORANGE,
    PALE,
    PALE_BLUE,
    PINK,
    Style,
    heading,
    note,
    plain,
    ratio_axis,
    rows,
    titled,
)
from ident.report.words import MM, direction_name, is_length, read_unit, short
from ident.studies.stiffness.fit_report import fit_sections, why_no_interval

if TYPE_CHECKING:
    from ident.identify.fit import CampaignFit
    from ident.inference.parameters import Parameter
    from ident.measure import Measurement

KIND_STYLES: dict[str, Style] = {
    "frequency": {"color": BLUE, "marker": "o"},
    "deflection": {"color": ORANGE, "marker": "s"},
    "deflection_difference": {"color": PINK, "marker": "D"},
    "position": {"color": ORANGE, "marker": "h"},
    "rotation": {"color": ORANGE, "marker": "v"},
    "rotation_difference": {"color": PINK, "marker": "P"},
    "twist": {"color": ORANGE, "marker": "<"},
    "twist_difference": {"color": PINK, "marker": ">"},
    "damping_ratio": {"color": GREEN, "marker": "^"},
    "shape": {"color": GREEN, "marker": "*"},
}
RIMMED: Style = {"markersize": 8, "markeredgecolor": "black", "markeredgewidth": 1.8}
"""Marker of an outlier."""
ROW, PANEL = 0.27, 1.15
"""Height of one row, and of a panel's heading and axis [inch]."""
LABEL, LETTER = 80, 0.063
"""Longest label of a measurement [characters], and width of a character [inch]."""
DENSE = 60
"""Measurements above which the rows are numbered instead of described."""
MANY = 400
"""Measurements above which each is only a dot."""
REACH = 30.0
"""Factor from the fitted values at which the frame cuts an interval off."""


def fit_figure(fit: "CampaignFit") -> Figure:
    """Draw a fit on one page: values, parameter combinations, residuals; the title is the verdict.

    Filled markers are determined by the data, hollow ones are not.
    """
    items = fit.problem.parameters.items
    own = [i for i, item in enumerate(items) if not item.nuisance]
    moved = [i for i in own if not items[i].positive and is_length(items[i].name)]
    scaled = [i for i in own if i not in moved]
    left = [PANEL + ROW * len(group) for group in (scaled, moved, fit.information.directions) if group]
    total = max(sum(left), PANEL + ROW * min(len(fit.campaign), DENSE))
    verdict = fit_sections(fit).verdict
    assert verdict is not None
    title = f"Fit of {cut(fit.arm.name, 50)} to {cut(fit.campaign.name, 50) or 'measurements'}: {verdict.word}"
    known = fit.information
    left_label = max(len(direction_name(direction, known.names, known.sd)) for direction in _shown(fit))
    letters = max(left_label, 20) + 24, max(longest_label(fit.campaign.measurements), 20)
    widths = [4.3 + LETTER * count for count in letters]  # a panel, and characters in its rows
    figure = titled((sum(widths), total + 0.5), title, (0.1, 0.06), wspace=0.04)
    columns = figure.add_gridspec(1, 2, width_ratios=widths)
    *values, directions = _stack(figure, columns[0], left)
    for axes, group in zip(values, filter(None, (scaled, moved)), strict=True):
        _values(axes, fit, group, shift=group is moved)
    _directions(directions, fit)
    (residuals,) = _stack(figure, columns[1], [total])  # nested like the left column: else labels take its width
    _residuals(residuals, fit)
    return figure


def _stack(figure: Figure, cell: SubplotSpec, heights: Sequence[float]) -> list[Axes]:
    """Return axes one above the other."""
    grid = cell.subgridspec(len(heights), 1, height_ratios=heights)
    return [figure.add_subplot(grid[i]) for i in range(len(heights))]


def _values(axes: Axes, fit: "CampaignFit", group: Sequence[int], *, shift: bool) -> None:
    items = fit.problem.parameters.items
    interval, supported = fit.interval(), [bool(fit.supported[i]) for i in group]
    drawn = [_as_drawn(items[i], (fit.best.values[i], *interval[i]), shift) for i in group]
    left, right = _shift_span(drawn) if shift else _ratio_span(drawn)
    rows(axes, [cut(items[i].name, 30) for i in group])
    if shift:
        axes.set(xlim=(left, right))
    else:
        ratio_axis(axes, left, right)
    axes.axvline(0.0 if shift else 1.0, color="black", linewidth=0.8, zorder=1.5)
    for y, ((value, start, end), known) in enumerate(zip(drawn, supported, strict=True)):
        line: Style = {"color": BLUE, "linewidth": 2.2} if known else {"color": PALE, "linewidth": 5.0}
        axes.plot([max(start, left), min(end, right)], [y, y], solid_capstyle="butt", zorder=2, **line)
        axes.plot([value], [y], linestyle="", zorder=3, **(FILLED if known else HOLLOW))
    axes.set(xlabel="fitted - arm file [mm]" if shift else "fitted / arm file [-]")
    why = [why_no_interval(fit, i) for i in group]
    undetermined, doubted = "not determined by the data alone: with the prior", "not reported, as the fit is in doubt"
    hollow = f"{doubted}: by data and prior" if "not reported" in why else undetermined
    keys = _key(supported, "known, 95 % interval", hollow)
    heading(axes, "Lengths that were freed" if shift else "Parameters", keys)
    texts = []
    for i, word in zip(group, why, strict=True):
        size, unit = read_unit(items[i].name)
        best, low, high = (written(float(number) / size, "#.4g") for number in (fit.best.values[i], *interval[i]))
        texts.append(f"{word}\n({best} {unit})" if word else f"{best} {unit}\n{low} to {high}")
    rows(axes.twinx(), texts, side="right")


def _as_drawn(item: "Parameter", numbers: Sequence[float], shift: bool) -> list[float]:
    """Return value and ends of an interval relative to the arm file, or as shifts [mm] from it."""
    centre = float(item.start) or math.nan
    return [MM * (x - float(item.start)) if shift else x / centre for x in map(float, numbers)]


def _ratio_span(drawn: Sequence[Sequence[float]]) -> tuple[float, float]:
    """Return limits that hold all values, and the interval ends within reach."""
    values = [1.0, *(value for value, *_ in drawn if 0 < value < math.inf)]
    low, high = min(values), max(values)
    ends = [end for _, *both in drawn for end in both if math.isfinite(end)]
    left = min([low, *(max(end, low / REACH) for end in ends)])
    right = max([high, *(min(end, high * REACH) for end in ends)])
    pad = (right / left) ** 0.06 * 1.001
    return left / pad, right * pad


def _shift_span(drawn: Sequence[Sequence[float]]) -> tuple[float, float]:
    size = max([1e-3, *(abs(value) for value, *_ in drawn)])
    ends = [abs(end) for _, *both in drawn for end in both if math.isfinite(end)]
    size = 1.1 * max([size, *(min(end, REACH * size) for end in ends)])
    return -size, size


def _directions(axes: Axes, fit: "CampaignFit") -> None:
    """Draw the std. error of each combination; undetermined ones, and all of a doubtful fit, have none."""
    known, doubts = fit.information, bool(fit.doubts)
    directions = _shown(fit)
    widths = [d.sd for d in fit.combinations if np.isfinite(d.sd) and not doubts]
    left, edge = min([0.01, *widths]) / 2, 4 * max([2 * WEAK_ABOVE, *widths])
    rows(axes, [direction_name(direction, known.names, known.sd) for direction in directions])
    axes.set_xscale("log")
    axes.set(xlim=(left, 4 * edge))
    axes.axvspan(WEAK_ABOVE, 4 * edge, color="#F3F3F3", zorder=0)
    axes.axvline(WEAK_ABOVE, color="black", linewidth=0.8, linestyle="--")
    for y, direction in enumerate(directions):
        is_open = y >= len(fit.combinations)
        drawn = not is_open and not doubts and np.isfinite(direction.sd)
        weak = bool(direction.weak and not is_open)
        place, style = direction.sd if drawn else edge, HOLLOW if is_open else FILLED
        axes.plot([place], [y], linestyle="", **{**style, **({"markerfacecolor": PALE_BLUE} if weak else {})})
        word = "weak" * weak if drawn or is_open else "not reported"
        note(axes, word, (place, y), (7, 0), va="center", color="black")
    powers = LogLocator(numticks=5).tick_values(left, WEAK_ABOVE / 2)
    ticks = {power: f"{100 * power:g} %" for power in powers if left < power < WEAK_ABOVE / 2}
    ticks[WEAK_ABOVE] = f"factor {math.exp(WEAK_ABOVE):.2g}"
    axes.set_xticks(list(ticks), list(ticks.values()))
    axes.set_xticks([], minor=True)
    axes.set(xlabel="std. error of ln(value) [-]")
    fixed = [i < len(fit.combinations) for i in range(len(directions))]
    keys = _key(fixed, "determined by the data", "by the prior alone")
    heading(axes, f"Combinations determined: {known.fixed} of {len(directions)}", keys)


def _shown(fit: "CampaignFit") -> tuple[Direction, ...]:
    """Return the combinations in display order: determined ones, then undetermined ones."""
    return (*fit.combinations, *(direction for direction in fit.information.directions if direction.open))


def _key(filled: Sequence[bool], solid: str, hollow: str) -> dict[str, Style]:
    """Return the legend of the markers in use."""
    return {text: style for text, style in ((solid, FILLED), (hollow, HOLLOW)) if (style is FILLED) in filled}


def _residuals(axes: Axes, fit: "CampaignFit") -> None:
    """Draw measured minus predicted in standard deviations, a row for each measurement, sorted by kind.

    Outliers have a black rim; values that no other measurement checks are hollow.
    """
    campaign, outliers, unchecked = fit.campaign, fit.suspicious, fit.row_tests.unchecked
    kinds = [kind for kind in KIND_STYLES if any(m.kind == kind for m in campaign)]
    order = sorted(range(len(campaign)), key=lambda i: kinds.index(campaign.measurements[i].kind))
    z = -np.nan_to_num(fit.standardised)
    reach = 1.1 * max(3.0, float(np.abs(z).max()))
    measurement_rows(axes, [campaign.measurements[i] for i in order], "measurement, sorted by kind [-]")
    axes.set(xlim=(-reach, reach))
    axes.axvspan(-2, 2, color="#EAF1F6", zorder=0)
    axes.axvline(0.0, color="black", linewidth=0.8)
    of_kind, many = np.array([campaign.measurements[i].kind for i in order]), len(order) > MANY
    for kind, far, alone in product(kinds, (False, True), (False, True)):
        at = np.flatnonzero((of_kind == kind) & (outliers[order] == far) & (unchecked[order] == alone))
        look = {**KIND_STYLES[kind], **({"markerfacecolor": "white"} if alone else {})}
        axes.plot(z[order][at], at, linestyle="", **{**look, **(RIMMED if far else {"markersize": 1.5 if many else 5})})
        axes.hlines([] if many else at, 0.0, [] if many else z[order][at], color=look["color"], linewidth=1.2)
    axes.set(xlabel="z = (measured - predicted) / its std. deviation [-]; shaded: ±2")
    keys: dict[str, Style] = {kind.replace("_", " "): {**KIND_STYLES[kind], "markersize": 5} for kind in kinds}
    if outliers.any():
        keys["outlier"] = {"marker": "o", "markerfacecolor": "white", **RIMMED}
    if unchecked.any():
        keys["unchecked"] = {**HOLLOW, "markersize": 5}
    heading(axes, "Residuals", keys, columns=3)


def longest_label(measured: Sequence["Measurement"]) -> int:
    """Return the length of the longest label of these measurements; zero if they are too many for labels."""
    return max(len(cut(short(m), LABEL)) for m in measured) if len(measured) <= DENSE else 0


def measurement_rows(axes: Axes, measured: Sequence["Measurement"], words: str) -> None:
    """Draw one row for each measurement; for many, print only a caption of the rows."""
    if len(measured) <= DENSE:
        rows(axes, [cut(short(m), LABEL) for m in measured])
    else:
        plain(axes)
        axes.set(ylim=(len(measured), -1), ylabel=words)
