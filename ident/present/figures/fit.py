"""Figures of fits, comparisons, profiles and validations.

Figures are made without pyplot, so that nothing global is touched.
"""

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.gridspec import SubplotSpec
from matplotlib.lines import Line2D

from ident.inference.change import LEVEL
from ident.inference.information import WEAK_ABOVE, Direction, p_in_words
from ident.inference.optima import Ending
from ident.inference.profile import Profile, threshold
from ident.present.figures.style import (
    BLUE,
    FILLED,
    GREEN,
    GREY,
    HOLLOW,
    ORANGE,
    PALE,
    PALE_BLUE,
    PINK,
    Style,
    heading,
    key_below,
    note,
    plain,
    ratio_axis,
    rows,
    titled,
)
from ident.present.fit import fit_sections, why_no_interval
from ident.present.profile import level_in_words, span_text
from ident.present.report import cut, written
from ident.present.words import MM, direction_name, is_length, lowered, percent, read_unit, short

if TYPE_CHECKING:
    from ident.identify.compare import Comparison, Validation
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
"""What lies too far from the fit."""
ROW, PANEL = 0.27, 1.15
"""Height of one row, and of a panel's heading and axis [inch]."""
LABEL, LETTER = 80, 0.063
"""Longest label of a measurement, and the width of a letter [inch]."""
DENSE = 60
"""Measurements above which the rows are numbered instead of described."""
MANY = 400
"""Measurements above which each is a dot only."""
REACH = 30.0
"""Factor beyond the fitted values at which the frame cuts an interval off."""


def fit_figure(fit: "CampaignFit") -> Figure:
    """Draw a fit at one glance: values, the combinations that the data determine, residuals; the verdict is its title.

    Filled markers are what the data determine, hollow ones what they do not.
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
    widths = [4.3 + LETTER * count for count in letters]  # a panel, and letters in its rows
    figure = titled((sum(widths), total + 0.5), title, (0.1, 0.06), wspace=0.04)
    columns = figure.add_gridspec(1, 2, width_ratios=widths)
    *values, directions = _stack(figure, columns[0], left)
    for axes, group in zip(values, filter(None, (scaled, moved)), strict=True):
        _values(axes, fit, group, shift=group is moved)
    _directions(directions, fit)
    (residuals,) = _stack(figure, columns[1], [total])  # nested as the left column is: else labels take its width
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
    reasons = {
        True: "not reported, as the fit is in doubt: by data and prior",
        False: "not determined by the data alone: with the prior",
    }
    hollow = "\n".join(reasons[hidden] for hidden in dict.fromkeys(word == "not reported" for word in why if word))
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
    centre = float(item.start)
    return [MM * (x - centre) if shift else x / centre if centre else math.nan for x in map(float, numbers)]


def _ratio_span(drawn: Sequence[Sequence[float]]) -> tuple[float, float]:
    """Return limits with all values, and with the intervals' ends as far as they are within reach."""
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
    """Draw the std. error of each combination; undetermined ones, and all where the fit is in doubt, have none."""
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
        style = HOLLOW if is_open else {**FILLED, "markerfacecolor": PALE_BLUE} if direction.weak else FILLED
        place = direction.sd if drawn else edge
        axes.plot([place], [y], linestyle="", **style)
        word = "" if is_open else ("weak" if direction.weak else "") if drawn else "not reported"
        note(axes, word, (place, y), (7, 0), va="center", color="black")
    ticks = {WEAK_ABOVE: f"factor {math.exp(WEAK_ABOVE):.2g}"}
    for power in range(-1, -9, -1):
        if math.log(min(ticks) / 10.0**power) > 0.17 * math.log(4 * edge / left) and 10.0**power > left:
            ticks[10.0**power] = f"{10.0 ** (power + 2):g} %"
    axes.set_xticks(list(ticks), list(ticks.values()))
    axes.set_xticks([], minor=True)
    axes.set(xlabel="std. error of ln(value) [-]")
    fixed = [i < len(fit.combinations) for i in range(len(directions))]
    keys = _key(fixed, "determined by the data", "by the prior alone")
    heading(axes, f"Combinations determined: {known.fixed} of {len(directions)}", keys)


def _shown(fit: "CampaignFit") -> tuple[Direction, ...]:
    """Return the directions as they are shown: those that the data fix, then those that they leave open."""
    return (*fit.combinations, *(direction for direction in fit.information.directions if direction.open))


def _key(filled: Sequence[bool], solid: str, hollow: str) -> dict[str, Style]:
    """Explain the markers that are there."""
    return {text: style for text, style in ((solid, FILLED), (hollow, HOLLOW)) if (style is FILLED) in filled}


def _residuals(axes: Axes, fit: "CampaignFit") -> None:
    """Draw measured minus predicted in its standard deviations, a row for each measurement, sorted by kind.

    Outliers have a black rim; what no other measurement checks is hollow.
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
    if len(order) <= MANY:
        for y, i in enumerate(order):
            style = KIND_STYLES[campaign.measurements[i].kind]
            axes.plot([0.0, z[i]], [y, y], color=style["color"], linewidth=1.2)
            mark = {**style, **({"markerfacecolor": "white"} if unchecked[i] else {})}
            axes.plot([z[i]], [y], linestyle="", **{**mark, **(RIMMED if outliers[i] else {"markersize": 5})})
    else:
        _cloud(axes, [campaign.measurements[i].kind for i in order], z[order], outliers[order])
    axes.set(xlabel="z = (measured - predicted) / its std. deviation [-]; shaded: ±2")
    keys: dict[str, Style] = {kind.replace("_", " "): {**KIND_STYLES[kind], "markersize": 5} for kind in kinds}
    if outliers.any():
        keys["outlier"] = {"marker": "o", "markerfacecolor": "white", **RIMMED}
    if unchecked.any():
        keys["unchecked"] = {**HOLLOW, "markersize": 5}
    heading(axes, "Residuals", keys, columns=3)


def longest_label(measured: Sequence["Measurement"]) -> int:
    """Return how many letters the longest label of these measurements has; none where they are too many for labels."""
    return max(len(cut(short(m), LABEL)) for m in measured) if len(measured) <= DENSE else 0


def measurement_rows(axes: Axes, measured: Sequence["Measurement"], words: str) -> None:
    """Make one row for each measurement; of many, say only in words what the rows are."""
    if len(measured) <= DENSE:
        rows(axes, [cut(short(m), LABEL) for m in measured])
    else:
        plain(axes)
        axes.set(ylim=(len(measured), -1), ylabel=words)


def _cloud(axes: Axes, kinds: Sequence[str], z: np.ndarray, outliers: np.ndarray) -> None:
    """Draw one small marker for each of many values."""
    for kind in dict.fromkeys(kinds):
        for far in (False, True):
            at = np.flatnonzero((np.array(kinds) == kind) & (outliers == far))
            axes.plot(z[at], at, linestyle="", **{**KIND_STYLES[kind], **(RIMMED if far else {"markersize": 1.5})})


# -------- Compare
# The figure of a comparison: the ratio of each stiffness after to before.


def compare_figure(comparison: "Comparison") -> Figure:
    """Draw the ratio of each stiffness after to before, with its 95 % interval; those that have changed are orange."""
    change = comparison.change
    before, after = (cut(name, 24) for name in comparison.names)
    figure = titled((8.0, 0.34 * len(change.names) + 1.9), f"Stiffness, {after} over {before}")
    axes = figure.subplots()
    low, high = np.exp(change.interval).T
    marks = {"changed": {**FILLED, "color": ORANGE}, "not changed": FILLED, "not determined": HOLLOW}
    kinds = np.where(change.open, "not determined", np.where(change.changed, "changed", "not changed")).tolist()
    for i, kind in enumerate(kinds):
        axes.hlines(i, low[i], high[i], color=marks[kind]["color"], linewidth=2.0)
        axes.plot(np.exp(change.change[i]), i, linestyle="", **marks[kind])
    axes.axvline(1.0, color=GREY, linewidth=0.8)
    ratio_axis(axes, min(low.min(), 0.95) / 1.05, max(high.max(), 1.05) * 1.05)
    axes.set(xlabel="ratio after / before [-], with 95 % interval")
    rows(axes, [cut(name, 24) for name in change.names])
    handles = [Line2D([], [], label=kind, linestyle="", **marks[kind]) for kind in marks if kind in kinds]
    verdict = "changed" if change.seen else "no change"
    note = f"all stiffnesses together: {verdict}, {p_in_words(change.p_value)}; changed: p < {percent(LEVEL)} (Holm)"
    key_below(figure, handles, note)
    return figure


# -------- Profile
# The figure of profiles: one panel for each parameter, delta chi-squared beside its linear approximation.

PROFILE_PANEL = (3.7, 2.75)
"""Width and height of a panel [inch]."""


def profile_figure(fit: "CampaignFit", profiles: Sequence[Profile]) -> Figure:
    """Draw profiles: delta chi-squared against each parameter, relative to its fitted value.

    A curve that leaves the panel through its top ends an interval; an arrow at the side means open.
    """
    columns = min(3, len(profiles))
    count = math.ceil(len(profiles) / columns)
    warnings = [f"Use no interval: {lowered(fit.doubts[0])}"] if fit.doubts else []
    if any(profile.beaten for profile in profiles):
        warnings.append("Chi-squared falls below the fit's: the fit is not the best optimum")
    size = (PROFILE_PANEL[0] * columns + 1.0, PROFILE_PANEL[1] * count + 0.9 + 0.2 * len(warnings))
    names = f"{cut(fit.arm.name, 30)} to {cut(fit.campaign.name, 30) or 'measurements'}"
    title = f"Profiles of the fit of {names}" if columns > 1 else f"Profile of the fit of\n{names}"
    figure = titled(size, title, (0.09, 0.08))
    grid = figure.subplots(count, columns, squeeze=False).flat
    bottom = min([0.0, *(float(profile.delta_chi_squared.min()) for profile in profiles)])
    for i, profile in enumerate(profiles):
        _panel(grid[i], profile, bottom)
        if i % columns == 0:
            grid[i].set(ylabel="delta chi-squared [-]")
        if i % columns == columns - 1 or i == len(profiles) - 1:  # the levels, at the right end of their lines
            for interval in profile.intervals:
                end: Any = {"xycoords": ("axes fraction", "data"), "va": "center"}
                level = level_in_words(interval.level)
                note(grid[i], level, (1.0, threshold(interval.level)), (4, 0), **end)
    for axes in list(grid)[len(profiles) :]:
        axes.set_axis_off()
    handles = [Line2D([], [], color=BLUE, linewidth=1.8, label="profile: all others fitted again")]
    if any(math.isfinite(profile.sd) for profile in profiles):
        handles.append(Line2D([], [], color=GREY, linewidth=1.2, linestyle="--", label="linear approximation"))
    key_below(figure, handles, "\n".join(warnings), columns=min(columns, 2)).set(color=ORANGE, fontsize=9)
    return figure


def _panel(axes: Axes, profile: Profile, bottom: float) -> None:
    plain(axes)
    top = threshold(profile.widest.level)
    axes.set(ylim=(bottom - 0.05 * top, 1.35 * top))
    left, right = (float(theta) - profile.optimum for theta in profile.theta[[0, -1]])
    pad = 0.06 * max(right - left, 1e-9)
    left, right = left - pad, right + pad
    if profile.item.positive:
        ratio_axis(axes, math.exp(left), math.exp(right))
        axes.set(xlabel="value / fitted [-]")
    else:
        unit = read_unit(profile.name)[1]
        axes.set_xlim(*map(float, _place(profile, profile.optimum + np.array([left, right]))))
        axes.set(xlabel=f"value - fitted [{unit}]")
    for interval in profile.intervals:
        axes.axhline(threshold(interval.level), color="#D8D8D8", linewidth=0.8, zorder=1)
    # between its points a profile is drawn as pieces of parabolas
    theta = np.union1d(profile.theta, np.linspace(profile.theta[0], profile.theta[-1], 301))
    root = np.interp(
        theta, profile.theta, np.sign(profile.delta_chi_squared) * np.sqrt(np.abs(profile.delta_chi_squared))
    )
    axes.plot(_place(profile, theta), np.sign(root) * root**2, color=BLUE, linewidth=1.8, zorder=3)
    if math.isfinite(profile.sd):
        theta = profile.optimum + np.linspace(left, right, 201)
        parabola = ((theta - profile.optimum) / profile.sd) ** 2
        axes.plot(_place(profile, theta), parabola, color=GREY, linewidth=1.2, linestyle="--", zorder=2)
    axes.plot([_place(profile, profile.optimum)], [0.0], linestyle="", zorder=4, **{**FILLED, "markersize": 5})
    for side in (0, 1):
        _ending(axes, profile, side, top)
    axes.set_title(_title(profile), parse_math=False, fontsize=9)


def _ending(axes: Axes, profile: Profile, side: int, top: float) -> None:
    """Mark where the widest interval ends: a dot on its threshold, an arrow where open, a bar where the model ends."""
    ending, theta = profile.widest.endings[side], (profile.widest.low, profile.widest.high)[side]
    last = (0, -1)[side]
    if ending is Ending.CROSSED:
        axes.plot([_place(profile, theta)], [top], linestyle="", zorder=4, **{**FILLED, "markersize": 4})
        return
    at = (float(_place(profile, profile.theta[last])), float(profile.delta_chi_squared[last]))
    word, marker = ("open", "<>"[side]) if ending is Ending.OPEN else ("model ends", "|")
    style = {**HOLLOW, "color": BLUE, "marker": marker, "markersize": 7 if marker != "|" else 12}
    axes.plot([at[0]], [at[1]], linestyle="", zorder=4, clip_on=False, **style)
    above = at[1] < 0.9 * top
    place = {"ha": ("left", "right")[side], "va": "bottom" if above else "top"}
    note(axes, word, at, (0, 8 if above else -12), color=BLUE, **place)


def _place(profile: Profile, theta: Any) -> Any:
    """Return where a theta stands in the panel: relative to the fitted value, or as a difference from it."""
    off = np.asarray(theta) - profile.optimum
    if profile.item.positive:
        return np.exp(off)
    return off * float(profile.item.scale) / read_unit(profile.name)[0]


def _title(profile: Profile) -> str:
    """Return the name, and below it the fitted value and the widest interval in the unit that people read."""
    ends = [profile.optimum, profile.widest.low, profile.widest.high]
    size, unit = read_unit(profile.name)
    best, low, high = (written(float(value) / size, "#.4g") for value in profile.values(ends))
    words = f"{best} {unit}; {level_in_words(profile.widest.level)}: {span_text(profile.widest, low, high)}"
    return f"{cut(profile.name, 34)}\n{words}"


# -------- Validate
# The figure of a validation: how far each measurement is off its prediction, and whether quantiles are right.

MOST, PART = 60, 44
"""Measurements that are drawn as rows, of more those that are farthest off; and letters of a part's name."""


def validate_figure(validation: "Validation") -> Figure:
    """Draw how far each measurement lies from its prediction, and observed against predicted quantiles."""
    told = validation.told
    count = sum(len(part.places) for part in told)
    height = max(3.6, 0.24 * min(count, MOST) + 1.8)
    title = f"Each part of {cut(validation.fit.campaign.name, 30)}, predicted from the rest"
    wider = LETTER * max(0, max((len(cut(part.name, PART)) for part in told), default=0) - 22)
    figure = titled((10.0 + wider, height), title)
    left, right = figure.subplots(1, 2, width_ratios=(1.5, 1.0))
    _off(left, validation)
    _quantiles(right, validation.z)
    handles = [
        Line2D([], [], color=BLUE, marker="o", linestyle="", label="measured less predicted"),
        Line2D([], [], color=PALE_BLUE, alpha=0.5, linewidth=6, label="95 % interval of the prediction"),
    ]
    if validation.missed:
        handles.append(Line2D([], [], color=ORANGE, marker="o", linestyle="", label="part too far from its prediction"))
    farthest = f"; left: the {MOST} of {count} farthest off" if count > MOST else ""
    key_below(figure, handles, f"std. errors: noise, and what the other data leave undetermined{farthest}")
    return figure


def _off(axes: Axes, validation: "Validation") -> None:
    """Draw a row for each measurement, part by part; of many, those that are farthest off."""
    campaign, missed = validation.fit.campaign.measurements, {part.name for part in validation.missed}
    z, names, colours = [], [], []
    for part in validation.told:
        for place, value in zip(part.places, part.off / part.sd, strict=True):
            m = campaign[place]
            z.append(value)
            names.append(f"{cut(part.name, PART)}  {cut(m.mode or m.point or m.joint or m.kind, 22)}")
            colours.append(ORANGE if part.name in missed else BLUE)
    shown = np.sort(np.argsort(-np.abs(z))[:MOST])
    off, names, colours = np.array(z)[shown], [names[i] for i in shown], [colours[i] for i in shown]
    axes.axvspan(-1.96, 1.96, color=PALE_BLUE, alpha=0.5, linewidth=0)
    axes.axvline(0, color=GREY, linewidth=0.8)
    axes.scatter(off, np.arange(len(off)), c=colours or BLUE, s=26, zorder=3)
    reach = max(3.0, 1.1 * float(np.abs(off).max(initial=0.0)))
    axes.set(xlim=(-reach, reach), xlabel="measured less predicted [std. errors]")
    rows(axes, names)


def _quantiles(axes: Axes, z: np.ndarray) -> None:
    """Draw the share of measurements below each predicted quantile, with where right predictions lie point by point."""
    from scipy.special import ndtr
    from scipy.stats import beta

    count = len(z)
    if count:
        order = np.arange(1, count + 1)
        predicted = np.sort(ndtr(z))
        low, high = (beta.ppf(q, order, count + 1 - order) for q in (0.025, 0.975))
        observed = (order - 0.5) / count
        axes.fill_betweenx(observed, low, high, color=PALE_BLUE, alpha=0.5, linewidth=0)
        axes.plot(predicted, observed, color=BLUE, marker="o", markersize=3.5, linewidth=1.0)
    axes.plot([0, 1], [0, 1], color=GREY, linewidth=0.8)
    axes.set(xlim=(0, 1), ylim=(0, 1), xlabel="predicted quantile [-]", ylabel="share of measurements below [-]")
    plain(axes)
