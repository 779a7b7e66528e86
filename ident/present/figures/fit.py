"""Figures of a fit, and figures as files. With `style` and the `..._figure` modules the only ones with matplotlib.

Figures are made without pyplot, so that nothing global is touched.
"""

import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.gridspec import SubplotSpec

from ident.identify.fit import CampaignFit
from ident.inference.cross_prediction import contradicting
from ident.inference.information import WEAK_ABOVE, Direction
from ident.inference.parameters import Parameter
from ident.present.figures.style import (
    BLUE,
    FILLED,
    GREEN,
    HOLLOW,
    ORANGE,
    PALE,
    PALE_BLUE,
    PINK,
    Style,
    engineering,
    heading,
    note,
    plain,
    ratio_axis,
    rows,
    titled,
)
from ident.present.text.agreement import chance
from ident.present.text.assumptions import in_words
from ident.present.text.fit import why_no_interval
from ident.present.text.units import MM, in_read_unit, is_length, read_unit
from ident.present.text.words import cut, direction_name, short

KIND_STYLES: dict[str, Style] = {
    "frequency": {"color": BLUE, "marker": "o"},
    "deflection": {"color": ORANGE, "marker": "s"},
    "deflection_difference": {"color": PINK, "marker": "D"},
    "rotation": {"color": ORANGE, "marker": "v"},
    "rotation_difference": {"color": PINK, "marker": "P"},
    "twist": {"color": ORANGE, "marker": "<"},
    "twist_difference": {"color": PINK, "marker": ">"},
    "damping_ratio": {"color": GREEN, "marker": "^"},
    "shape": {"color": GREEN, "marker": "*"},
}
RIMMED: Style = {"markersize": 8, "markeredgecolor": "black", "markeredgewidth": 1.8}
"""What lies too far from the fit."""
ROW, PANEL = 0.27, 1.15
"""Height of one row, and of a panel's heading and axis [inch]."""
LABEL, LETTER = 52, 0.063
"""Longest label of a measurement, and the width of a letter [inch]."""
DENSE = 60
"""Measurements above which the rows are numbered instead of described."""
MANY = 400
"""Measurements above which each is a dot only."""
REACH = 30.0
"""Factor beyond the fitted values at which the frame cuts an interval off."""


def fit_figure(fit: CampaignFit) -> Figure:
    """Draw a fit at one glance: parameters, what the data fix, measured against predicted, contradictions.

    Filled markers are what the data support, hollow ones what they leave open.
    """
    items = fit.problem.parameters.items
    own = [i for i, item in enumerate(items) if not item.nuisance]
    moved = [i for i in own if not items[i].positive and is_length(items[i].name)]
    scaled = [i for i in own if i not in moved]
    notes = list(_notes(fit))
    left = [len(group) for group in (scaled, moved, fit.information.directions) if group]
    right = [min(len(fit.campaign), DENSE), 0.8 * len(notes)]
    heights = [[PANEL + ROW * count for count in column] for column in (left, right)]
    total = max(map(sum, heights))
    heights[1][1] = total - heights[1][0]
    title = f"Fit of {cut(fit.arm.name, 50)} to {cut(fit.campaign.name, 50) or 'measurements'}"
    figure = titled((_width(fit), total + 0.5), title, (0.1, 0.06), wspace=0.04)
    columns = figure.add_gridspec(1, 2)
    *values, directions = _stack(figure, columns[0], heights[0])
    for axes, group in zip(values, filter(None, (scaled, moved)), strict=True):
        _values(axes, fit, group, shift=group is moved)
    _directions(directions, fit)
    residuals, words = _stack(figure, columns[1], heights[1])
    _residuals(residuals, fit)
    _write(words, notes)
    return figure


def _width(fit: CampaignFit) -> float:
    """Return the width [inch] that leaves room for the panels beside what is written in the rows."""
    known = fit.information
    left = max(len(direction_name(direction, known.names, known.sd)) for direction in _shown(fit))
    right = max(len(cut(short(m), LABEL)) for m in fit.campaign)
    return 8.6 + LETTER * (max(left, 20) + max(right, 20) + 20)


def _stack(figure: Figure, cell: SubplotSpec, heights: Sequence[float]) -> list[Axes]:
    """Return axes one above the other."""
    grid = cell.subgridspec(len(heights), 1, height_ratios=heights)
    return [figure.add_subplot(grid[i]) for i in range(len(heights))]


class _Row(NamedTuple):
    """A parameter as it is drawn: relative to the arm file, or as a shift [mm] from it."""

    value: float
    low: float
    high: float
    supported: bool


def _values(axes: Axes, fit: CampaignFit, group: Sequence[int], *, shift: bool) -> None:
    items = fit.problem.parameters.items
    interval, supported = fit.interval(), fit.supported
    drawn = [_row(items[i], float(fit.best.values[i]), interval[i], bool(supported[i]), shift) for i in group]
    left, right = _shift_span(drawn) if shift else _ratio_span(drawn)
    rows(axes, [cut(items[i].name, 30) for i in group])
    if shift:
        axes.set_xlim(left, right)
    else:
        ratio_axis(axes, left, right)
    axes.axvline(0.0 if shift else 1.0, color="black", linewidth=0.8, zorder=1.5)
    for y, row in enumerate(drawn):
        ends = [max(row.low, left), min(row.high, right)]
        line: Style = {"color": BLUE, "linewidth": 2.2} if row.supported else {"color": PALE, "linewidth": 5.0}
        axes.plot(ends, [y, y], solid_capstyle="butt", zorder=2, **line)
        axes.plot([row.value], [y], linestyle="", zorder=3, **(FILLED if row.supported else HOLLOW))
    axes.set_xlabel("fitted - arm file [mm]" if shift else "fitted / arm file [-]", fontsize=9)
    why = [why_no_interval(fit, i) for i in group]
    keys = _key([row.supported for row in drawn], "known, 95 % interval", _hollow(why))
    heading(axes, "Lengths that were freed" if shift else "Parameters", keys)
    texts = [
        _value_text(items[i].name, fit.best.values[i], interval[i], word) for i, word in zip(group, why, strict=True)
    ]
    rows(axes.twinx(), texts, side="right")


def _hollow(why: Sequence[str]) -> str:
    """Say why a value has no interval, and what its bar is all the same."""
    reasons = {
        "withheld": "withheld, as the fit is in doubt: what data and prior would tell",
        "": "no interval by the data; shown with the prior",
    }
    return "\n".join(reasons[word] for word in dict.fromkeys("withheld" * (each == "withheld") for each in why if each))


def _row(item: Parameter, value: float, interval: np.ndarray, supported: bool, shift: bool) -> _Row:
    centre = float(item.start)

    def relative(x: float) -> float:
        return MM * (x - centre) if shift else x / centre if centre else math.nan

    return _Row(relative(value), relative(float(interval[0])), relative(float(interval[1])), supported)


def _ratio_span(drawn: Sequence[_Row]) -> tuple[float, float]:
    """Return limits with all values, and with the intervals' ends as far as they are within reach."""
    values = [1.0, *(row.value for row in drawn if 0 < row.value < math.inf)]
    low, high = min(values), max(values)
    ends = [end for row in drawn for end in (row.low, row.high) if math.isfinite(end)]
    left = min([low, *(max(end, low / REACH) for end in ends)])
    right = max([high, *(min(end, high * REACH) for end in ends)])
    pad = (right / left) ** 0.06 * 1.001
    return left / pad, right * pad


def _shift_span(drawn: Sequence[_Row]) -> tuple[float, float]:
    size = max([1e-3, *(abs(row.value) for row in drawn)])
    ends = [abs(end) for row in drawn for end in (row.low, row.high) if math.isfinite(end)]
    size = 1.1 * max([size, *(min(end, REACH * size) for end in ends)])
    return -size, size


def _value_text(name: str, value: float, interval: np.ndarray, why_not: str) -> str:
    size, unit = read_unit(name)
    best, low, high = engineering(*(float(number) / size for number in (value, *interval)))
    return f"{why_not}\n({best} {unit})" if why_not else f"{best} {unit}\n{low} to {high}"


def _directions(axes: Axes, fit: CampaignFit) -> None:
    """Draw the standard deviation of each direction; open ones, and all where the fit is in doubt, have none."""
    known, doubts = fit.information, bool(fit.doubts)
    directions = _shown(fit)
    widths = [d.sd for d in fit.combinations if np.isfinite(d.sd) and not doubts]
    left, edge = min([0.01, *widths]) / 2, 4 * max([2 * WEAK_ABOVE, *widths])
    rows(axes, [direction_name(direction, known.names, known.sd) for direction in directions])
    axes.set_xscale("log")
    axes.set_xlim(left, 4 * edge)
    axes.axvspan(WEAK_ABOVE, 4 * edge, color="#F3F3F3", zorder=0)
    axes.axvline(WEAK_ABOVE, color="black", linewidth=0.8, linestyle="--")
    for y, direction in enumerate(directions):
        is_open = y >= len(fit.combinations)
        drawn = not is_open and not doubts and np.isfinite(direction.sd)
        style = HOLLOW if is_open else {**FILLED, "markerfacecolor": PALE_BLUE} if direction.weak else FILLED
        place = direction.sd if drawn else edge
        axes.plot([place], [y], linestyle="", **style)
        word = "open" if is_open else ("weak" if direction.weak else "") if drawn else "no width"
        note(axes, word, (place, y), (7, 0), va="center", color="black")
    ticks = {WEAK_ABOVE: f"factor {math.exp(WEAK_ABOVE):.2g}"}
    for power in range(-1, -9, -1):
        if math.log(min(ticks) / 10.0**power) > 0.17 * math.log(4 * edge / left) and 10.0**power > left:
            ticks[10.0**power] = f"{10.0 ** (power + 2):g} %"
    axes.set_xticks(list(ticks), list(ticks.values()))
    axes.set_xticks([], minor=True)
    axes.set_xlabel("standard deviation of ln(value) [-]", fontsize=9)
    fixed = [i < len(fit.combinations) for i in range(len(directions))]
    keys = _key(fixed, "seen by the data", "open: only the prior fills it")
    heading(axes, f"Directions: the data fix {known.fixed} of {len(directions)}", keys)


def _shown(fit: CampaignFit) -> tuple[Direction, ...]:
    """Return the directions as they are shown: those that the data fix, then those that they leave open."""
    return (*fit.combinations, *(direction for direction in fit.information.directions if direction.open))


def _key(filled: Sequence[bool], solid: str, hollow: str) -> dict[str, Style]:
    """Explain the markers that are there."""
    return {text: style for text, style in ((solid, FILLED), (hollow, HOLLOW)) if (style is FILLED) in filled}


def _residuals(axes: Axes, fit: CampaignFit) -> None:
    """Draw measured minus predicted in its standard deviations, a row for each measurement, sorted by kind.

    What lies too far off has a black rim; what cannot be checked is hollow.
    """
    campaign, outliers, unchecked = fit.campaign, fit.suspicious, fit.row_tests.unchecked
    kinds = [kind for kind in KIND_STYLES if any(m.kind == kind for m in campaign)]
    order = sorted(range(len(campaign)), key=lambda i: kinds.index(campaign.measurements[i].kind))
    z = -np.nan_to_num(fit.standardised)
    reach = 1.1 * max(3.0, float(np.abs(z).max()))
    if len(order) <= DENSE:
        rows(axes, [cut(short(campaign.measurements[i]), LABEL) for i in order])
    else:
        plain(axes)
        axes.set_ylim(len(order), -1)
        axes.set_ylabel("measurement, sorted by kind [-]", fontsize=9)
    axes.set_xlim(-reach, reach)
    axes.axvspan(-2, 2, color="#EAF1F6", zorder=0)
    axes.axvline(0.0, color="black", linewidth=0.8)
    if len(order) <= MANY:
        for y, i in enumerate(order):
            style = KIND_STYLES[campaign.measurements[i].kind]
            axes.plot([0.0, z[i]], [y, y], color=style["color"], linewidth=1.2)
            mark = {**style, **({"markerfacecolor": "white"} if unchecked[i] else {})}
            axes.plot([z[i]], [y], linestyle="", **{**mark, **(RIMMED if outliers[i] else {"markersize": 5})})
    else:
        _cloud(axes, [campaign.measurements[i].kind for i in order], z[order], outliers[order])
    axes.set_xlabel("(measured - predicted) / its own sd [-]; shaded: within ±2", fontsize=9)
    keys: dict[str, Style] = {kind.replace("_", " "): {**KIND_STYLES[kind], "markersize": 5} for kind in kinds}
    if outliers.any():
        keys["too far off"] = {"marker": "o", "markerfacecolor": "white", **RIMMED}
    if unchecked.any():
        keys["cannot be checked"] = {**HOLLOW, "markersize": 5}
    heading(axes, "Measured against predicted", keys, columns=3)


def _cloud(axes: Axes, kinds: Sequence[str], z: np.ndarray, outliers: np.ndarray) -> None:
    """Draw one small marker for each of many values."""
    for kind in dict.fromkeys(kinds):
        for far in (False, True):
            at = np.flatnonzero((np.array(kinds) == kind) & (outliers == far))
            axes.plot(z[at], at, linestyle="", **{**KIND_STYLES[kind], **(RIMMED if far else {"markersize": 1.5})})


def _notes(fit: CampaignFit) -> Iterator[tuple[str, bool]]:
    """Yield what must be said in words, each line with whether it is a warning."""
    p = f", p = {fit.p_value:.2g}" if fit.degrees_of_freedom > 0 else ": nothing is left to test the model with"
    yield f"chi-squared {fit.chi_squared:.3g} on {fit.degrees_of_freedom} degrees of freedom{p}", False
    yield from ((f"{doubt[0].upper()}{doubt[1:]}", True) for doubt in fit.doubts if "(see below)" not in doubt)
    if fit.assumptions and fit.assumptions.asked_for and not fit.doubts:
        yield f"The data ask for an assumption to be dropped: {in_words(fit.assumptions.asked_for[0])}", True
    for each in fit.exchanges[:1]:
        one, other = (cut(short(fit.campaign.measurements[row]), 60) for row in each.rows)
        yield f"With two values exchanged chi-squared would be {each.chi_squared:.3g}:", True
        yield f"   {one}", False
        yield f"   {other}", False
    if rivals := len(fit.rivals):
        others = "Another optimum is" if rivals == 1 else f"{rivals} other optima are"
        yield f"{others} not ruled out: each interval reaches over all that were found", True
    if fit.contradictory:
        yield "CONTRADICTION: the kinds disagree; the fit joins them only by implausible values.", True
    elif fit.cross_predictions:
        worst = min(fit.cross_predictions, key=lambda t: t.p_value)
        yield f"The kinds of measurement agree with each other: {chance(worst)} at worst", False
    doubts = contradicting(fit.cross_predictions)
    rows = [(z, t, i) for t in doubts if t.z is not None for i, z in enumerate(np.abs(t.z).tolist())]
    for z, t, i in sorted(rows, key=lambda row: -row[0])[:4]:
        m = fit.campaign.measurements[t.rows[i]]
        value, unit = in_read_unit(m.kind, float(t.predicted[i]))
        yield f"   {cut(short(m), 60)}:", False
        yield f"      the other kinds lead to {value:.3g} {unit}, {z:.1f} sd away", False


def _write(axes: Axes, notes: Sequence[tuple[str, bool]]) -> None:
    """Write lines on empty axes, from the top down."""
    axes.set_axis_off()
    for i, (line, warning) in enumerate(notes):
        style = {"va": "top", "fontsize": 9, "color": ORANGE if warning else "black"}
        note(axes, line, (0.0, 1.0), (-150, -14 * i), xycoords="axes fraction", **style)
