"""Profile likelihoods, one panel a parameter."""

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ident.inference.optima import Ending
from ident.inference.profile import Profile, threshold
from ident.report.report import cut, written
from ident.report.style import (
    BLUE,
    FILLED,
    GREY,
    HOLLOW,
    ORANGE,
    Style,
    key_below,
    lines,
    note,
    plain,
    ratio_axis,
    titled,
)
from ident.report.words import lowered, read_unit
from ident.studies.stiffness.profile_report import level_in_words, span_text

if TYPE_CHECKING:
    from ident.identify.fit import CampaignFit

PROFILE_PANEL = (3.7, 2.75)
"""Width and height of a panel [inch]."""


def profile_figure(fit: "CampaignFit", profiles: Sequence[Profile]) -> Figure:
    """Draw profiles: delta chi-squared against each parameter, relative to its fitted value.

    A curve that leaves the panel at the top ends an interval; an arrow at the side means open.
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
    entries: dict[str, Style] = {"profile: all others fitted again": {"color": BLUE, "linewidth": 1.8}}
    if any(math.isfinite(profile.sd) for profile in profiles):
        entries["linear approximation"] = {"color": GREY, "linewidth": 1.2, "linestyle": "--"}
    key_below(figure, lines(entries), "\n".join(warnings), columns=min(columns, 2)).set(color=ORANGE, fontsize=9)
    return figure


def _panel(axes: Axes, profile: Profile, bottom: float) -> None:
    plain(axes)
    top = threshold(profile.widest.level)
    axes.set(ylim=(bottom - 0.05 * top, 1.35 * top))
    left, right = (float(theta) - profile.optimum for theta in profile.theta[[0, -1]])
    pad = 0.06 * max(right - left, 1e-9)
    left, right = left - pad, right + pad
    ends = map(float, _place(profile, profile.optimum + np.array([left, right])))
    if profile.item.positive:
        ratio_axis(axes, *ends)
        axes.set(xlabel="value / fitted [-]")
    else:
        axes.set(xlim=tuple(ends), xlabel=f"value - fitted [{read_unit(profile.name)[1]}]")
    for interval in profile.intervals:
        axes.axhline(threshold(interval.level), color="#D8D8D8", linewidth=0.8, zorder=1)
    # between its points a profile is drawn as pieces of parabolas
    theta = np.union1d(profile.theta, np.linspace(profile.theta[0], profile.theta[-1], 301))
    rise = profile.delta_chi_squared
    root = np.interp(theta, profile.theta, np.sign(rise) * np.sqrt(np.abs(rise)))
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
    axes.plot(*at, zorder=4, clip_on=False, **{**HOLLOW, "color": BLUE, "marker": marker, "markersize": 8})
    above = at[1] < 0.9 * top
    place = {"ha": ("left", "right")[side], "va": "bottom" if above else "top"}
    note(axes, word, at, (0, 8 if above else -12), color=BLUE, **place)


def _place(profile: Profile, theta: Any) -> Any:
    """Return where a theta stands in the panel: relative to the fitted value, or as a difference from it."""
    off = np.asarray(theta) - profile.optimum
    return np.exp(off) if profile.item.positive else off * float(profile.item.scale) / read_unit(profile.name)[0]


def _title(profile: Profile) -> str:
    """Return the name, and below it the fitted value and the widest interval in display units."""
    ends = [profile.optimum, profile.widest.low, profile.widest.high]
    size, unit = read_unit(profile.name)
    best, low, high = (written(float(value) / size, "#.4g") for value in profile.values(ends))
    words = f"{best} {unit}; {level_in_words(profile.widest.level)}: {span_text(profile.widest, low, high)}"
    return f"{cut(profile.name, 34)}\n{words}"
