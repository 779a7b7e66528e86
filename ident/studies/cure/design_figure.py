"""Changes of a design, their effect, and the sensitivities of the vibration."""

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import NullLocator

from ident.report.report import cut
from ident.report.style import (
    BLUE,
    GREEN,
    GREY,
    NEAR,
    ORANGE,
    PINK,
    Style,
    as_written,
    key_below,
    note,
    plain,
    rows,
    titled,
)
from ident.report.words import MM, value_in_words
from ident.studies.basis import motion_title
from ident.studies.cure.design_report import UNSURE
from ident.studies.cure.design_study import DesignStudy, unchanged
from ident.vibrate.study import DIRECTIONS
from ident.vibrate.sweep import NEARBY

if TYPE_CHECKING:
    from ident.vibrate.design import Design, Place, Verification
    from ident.vibrate.sweep import Sensitivities

WIDTH = 8.0
"""Width of a figure [inch]."""
COLORS = (BLUE, ORANGE, GREEN, PINK, "#E69F00", "#56B4E9", "black", GREY)
MARKS: dict[str, Style] = {
    "present": {"marker": "o", "color": GREY, "markersize": 8},
    "minimum change": {"marker": "D", "color": GREEN, "markersize": 7},
    "best": {"marker": "*", "color": ORANGE, "markersize": 13},
}
BEFORE: Style = {"color": GREY, "linewidth": 0.9}
AFTER: Style = {"color": BLUE, "linewidth": 1.3}
LIMIT: Style = {"color": "black", "linewidth": 0.9, "linestyle": ":"}


def trade_off_figure(study: DesignStudy) -> Figure:
    """Draw the least maximum amplitude over the change norm, and the changes at each norm."""
    design = study.design
    if design is None:
        raise ValueError("no design to draw")
    figure = titled((WIDTH, 7.0), motion_title("How quiet the arm can be made", study.basis), (0.08, 0.1))
    top, below = figure.subplots(2, 1, height_ratios=[1.25, 1.0])
    for axes in (top, below):
        plain(axes, grid=True)
    _curve(top, study, design)
    _bars(below, design)
    return figure


def before_after_figure(study: DesignStudy) -> Figure:
    """Draw the vibration before and after over time, by the exact method."""
    checks = study.verification
    if checks is None:
        raise ValueError("a design that was not verified has no vibration to draw")
    figure = titled((WIDTH, 7.0), motion_title(f"Vibration of {study.basis.point} before and after", study.basis))
    grid = figure.subplots(3, 1, sharex=True)
    limits = [_before_after(axes, study, checks, i) for i, axes in enumerate(grid)]
    grid[-1].set(xlim=(checks.before.time[0], checks.before.time[-1]), xlabel="time [s]")
    figure.align_ylabels(grid)
    handles = [Line2D([], [], label="as it is", **BEFORE), Line2D([], [], label="after the best change", **AFTER)]
    handles += [Line2D([], [], label=f"limit, {MM * (study.limit or 0):g} mm", **LIMIT)] if any(limits) else []
    handles.append(Line2D([], [], color=GREY, linewidth=0.8, linestyle="--", label="arrival"))
    note = "exact equations; displacement of the end point from where the arm, sagging, would be at rest; scales differ"
    key_below(figure, handles, note)
    return figure


def _before_after(axes: Axes, study: DesignStudy, checks: "Verification", i: int) -> bool:
    """Draw one direction, and return whether the limit was drawn: elsewhere it would flatten the curves."""
    plain(axes, grid=True)
    for check, style in ((checks.before, BEFORE), (checks.after, AFTER)):
        axes.plot(check.time, MM * check.vibration[i], **style)
    largest = max(float(np.abs(check.vibration[i]).max()) for check in (checks.before, checks.after))
    shows_limit = study.limit is not None and largest > NEAR * study.limit
    for sign in (-1, 1) if shows_limit else ():
        axes.axhline(sign * MM * (study.limit or 0), **LIMIT)
    axes.set(ylabel=f"{DIRECTIONS[i].upper()}: vibration\n[mm]")
    sizes = (MM * checks.before.amplitude[i], MM * checks.after.amplitude[i])
    words = f"{study.evaluator.measure} {sizes[0]:.3g} mm before, {sizes[1]:.3g} mm after"
    axes.set_title(words, fontsize=9, loc="right", color=GREY)
    axes.axvline(study.basis.motion.arrival, color=GREY, linewidth=0.8, linestyle="--")
    return shows_limit


def _curve(axes: Axes, study: DesignStudy, design: "Design") -> None:
    """Draw the curve, the limit and the named points."""
    amounts, sizes = [place.change_norm for place in design.curve], [MM * place.largest for place in design.curve]
    axes.plot(amounts, sizes, color=BLUE, linewidth=1.4, marker=".", markersize=5, zorder=3)
    handles = []
    for name, place in _named(design):
        words = f"{name}, {MM * place.largest:.3g} mm"
        if name == "best" and study.draws and design.limit:
            words += f" ({100 * place.exceedance:.0f} % of the draws exceed)"
        axes.plot(place.change_norm, MM * place.largest, zorder=4, linestyle="", clip_on=False, **MARKS[name])
        handles.append(Line2D([], [], label=words, linestyle="", **MARKS[name]))
    if design.limit and max(sizes) > NEAR * MM * design.limit:
        axes.axhline(MM * design.limit, **LIMIT)
        handles.append(Line2D([], [], label=f"limit, {MM * design.limit:g} mm", **LIMIT))
    axes.set_xlim(left=0)
    axes.set_ylim(bottom=0)
    axes.set(xlabel="size of change (1: one number at its farther bound)")
    axes.set(ylabel=f"largest {study.evaluator.measure} of X, Y, Z [mm]")
    axes.legend(handles=handles, loc="best", frameon=False, fontsize=9)


def _bars(axes: Axes, design: "Design") -> None:
    """Draw the change of each number at each change norm: as a factor, or as a share of the widest change."""
    variables, places = design.evaluator.variables, list(_changed(design))
    spans = np.array([variable.span(design.evaluator.arm) for variable in variables])
    by_factor = not any(variable.shifted for variable in variables)
    scale = np.ones(len(variables)) if by_factor else np.abs(spans).max(1)
    width = 0.8 / len(variables)
    for v, variable in enumerate(variables):
        heights = [place.changes[v] / scale[v] for _, place in places]
        at = np.arange(len(places)) + (v - (len(variables) - 1) / 2) * width
        label = cut(variable.paths[0], 24) + (f" and {len(variable.paths) - 1} more" if len(variable.paths) > 1 else "")
        axes.bar(at, heights, 0.92 * width, color=COLORS[v % len(COLORS)], label=label, zorder=2)
    axes.axhline(0, color=GREY, linewidth=0.8)
    axes.set_xticks(range(len(places)), [name for name, _ in places])
    axes.set(xlabel="size of change")
    low, high = (spans / scale[:, None]).min(), (spans / scale[:, None]).max()
    axes.set(ylim=(1.06 * low, 1.06 * high))
    if by_factor:  # round factors, 1 among them
        least, most = np.exp(low), np.exp(high)
        fine = (0.25, 0.5, 0.6, 0.7, 0.8, 0.9, 1, 1.2, 1.5, 2, 3, 4)
        factors = (0.1, 0.2, 0.5, 1, 2, 5, 10) if most / least > 10 else fine
        ticks = [factor for factor in factors if least * (1 - 1e-9) <= factor <= most * (1 + 1e-9)]
        axes.set_yticks(np.log(ticks), [f"{f:g}x" for f in ticks])
        axes.yaxis.set_minor_locator(NullLocator())
        axes.set(ylabel="factor")
    else:
        ticks = [share for share in (-1.0, -0.5, 0.0, 0.5, 1.0) if low <= share <= high]
        axes.set_yticks(ticks, [f"{100 * share:+.0f} %" if share else "0 %" for share in ticks])
        axes.set(ylabel="change, of the widest allowed")
    key = axes.legend(loc="lower left", bbox_to_anchor=(0, 1.0), ncols=4, frameon=False, fontsize=8)
    as_written(key.get_texts())


def _named(design: "Design") -> Iterator[tuple[str, "Place"]]:
    yield "present", design.present
    if design.minimum_change is not None and not unchanged(design.minimum_change):
        yield "minimum change", design.minimum_change
    if design.best is not design.minimum_change:
        yield "best", design.best


def _changed(design: "Design") -> Iterator[tuple[str, "Place"]]:
    """Yield the points whose changes are drawn, ascending, each with its label."""
    _, *named = _named(design)
    places = [("", one) for one in design.curve[1:-1] if all(one is not place for _, place in named)] + named
    if abs(design.curve[-1].change_norm - design.best.change_norm) > 1e-9:
        places.append(("minimum\namplitude", design.curve[-1]))
    for name, place in sorted(places, key=lambda pair: pair[1].change_norm):
        yield f"{place.change_norm:.3g}\n{name}".rstrip(), place


# -------- Sensitivity
# Figure of sensitivities: percent of amplitude per percent of each number, as bars with bands.

MOST = 16
"""Numbers shown at most."""


def sensitivity_figure(study: DesignStudy) -> Figure:
    """Draw the sensitivities in x, y and z, the strongest at the top, with 5 to 95 % of the draws."""
    title = motion_title(f"What the vibration of {study.basis.point} depends on", study.basis)
    words = f"{study.evaluator.measure} of the vibration, at the arm as it is; scales differ"
    return sensitivities_drawn(study.sensitivities, title, words, study.draws)


def sensitivities_drawn(each: "Sensitivities", title: str, words: str, draws: int = 0) -> Figure:
    """Draw sensitivities, with a title and a note below, and with 5 to 95 % of the draws if there are any."""
    shown = each.order[:MOST]
    figure = titled((9.0, 0.24 * len(shown) + 1.9), title, (0.06, 0.08))
    grid = figure.subplots(1, len(DIRECTIONS), sharey=True)
    for d, axes in enumerate(grid):
        _direction(axes, each, d, shown, draws)
    rows(grid[0], [f"{cut(each.paths[i], 22)}, {value_in_words(each.paths[i], each.present[i])}" for i in shown])
    for axes in grid[1:]:
        axes.tick_params(axis="y", length=0, labelleft=False)
        axes.grid(axis="y", color="#EEEEEE", linewidth=0.8)
    handles: list[Patch | Line2D] = [
        Patch(color=BLUE, label="more of it: less vibration"),
        Patch(color=ORANGE, label="more of it: more vibration"),
    ]
    if draws:
        handles.append(Line2D([], [], color="black", linewidth=1.1, label=f"5 to 95 % of {draws} draws"))
    if each.unsure[shown].any():
        unsure = "of either sign over the draws" if draws else f"turns within {100 * NEARBY:g} % of it"
        handles.append(Patch(facecolor="white", edgecolor=GREY, label=f"{UNSURE} {unsure}"))
    left = len(each.paths) - len(shown)
    key_below(figure, handles, words + f"; {left} weaker ones are not shown" * (left > 0), columns=3)
    return figure


def _direction(axes: Axes, each: "Sensitivities", d: int, shown: list[int], draws: int) -> None:
    """Draw bars with bands, each number beyond the end of both: weak bars next to strong ones can't be read."""
    values, places = each.elasticity[shown, d], np.arange(len(shown))
    color, unsure = np.where(values < 0, BLUE, ORANGE), each.unsure[shown, d]
    axes.barh(places, values, height=0.62, color=np.where(unsure, "white", color), edgecolor=color, zorder=2)
    band = each.band[:, shown, d] if draws else np.stack([values, values])
    if draws:
        axes.hlines(places, *band, color="black", linewidth=1.1, zorder=3)
    ends = np.stack([values, *band])
    for place, value in enumerate(values):
        end = ends[:, place].min() if value < 0 else ends[:, place].max()
        side, align = (-3, "right") if value < 0 else (3, "left")
        note(
            axes,
            f"{value:+.2f}{f' {UNSURE}' * bool(unsure[place])}",
            (end, place),
            (side, 0),
            ha=align,
            va="center",
            fontsize=7,
        )
    low, high = min(ends.min(), 0.0), max(ends.max(), 0.0)
    room = 0.24 * (high - low) or 1.0  # a direction without vibration
    axes.set(xlim=(low - room, high + room))
    axes.axvline(0, color=GREY, linewidth=0.8, zorder=1)
    plain(axes, left=False)
    axes.set_title(f"{DIRECTIONS[d].upper()}: {MM * each.amplitude[d]:.3g} mm", fontsize=10)
    axes.locator_params(axis="x", nbins=5)
    if d == 1:
        axes.set(xlabel="% of amplitude per % of the number")
