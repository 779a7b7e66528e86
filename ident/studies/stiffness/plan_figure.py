"""Information gain of a further measurement over postures, and the std. errors after a plan."""

from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, MaxNLocator

from ident.identify.candidates import main_joints
from ident.report.report import cut
from ident.report.style import (
    BLUE,
    GREEN,
    ORANGE,
    PALE_BLUE,
    PINK,
    Style,
    colour_bar,
    heading,
    note,
    plain,
    rows,
    set_ticks,
    titled,
)
from ident.report.words import degrees
from ident.studies.stiffness.plan_report import criterion_in_words, experiment_in_words
from ident.text import by_key

if TYPE_CHECKING:
    from ident.identify.plan import CampaignPlan

COLOURS = (BLUE, ORANGE, GREEN, PINK, "#E69F00", "#56B4E9", "#000000")
"""Colours of Okabe and Ito, one for each joint or other part."""
LISTED = 24
"""Number of listed postures up to which each has its own bar."""
DASHES = {"k_bend": "-", "k_tors": (0, (5, 2))}
BADGE: Style = {"marker": "s", "markersize": 10, "markerfacecolor": "white", "color": "black"}
"""Marker of a chosen posture."""
CROSS: Style = {"marker": "x", "markersize": 8, "markeredgewidth": 2.2, "color": ORANGE}
"""Marker of a posture already measured."""


def plan_figure(plan: "CampaignPlan") -> Figure:
    """Draw gain per hour over posture with the chosen experiments, and the standard deviations after each."""
    figure = titled((13.0, 6.2), f"What to measure next on {cut(plan.arm.name, 50)}", (0.12, 0.08), wspace=0.03)
    left, right = figure.subplots(1, 2, width_ratios=(1.25, 1.0))
    _gain_over_posture(figure, left, plan)
    _sd_over_experiments(right, plan)
    return figure


def _gain_over_posture(figure: Figure, axes: Axes, plan: "CampaignPlan") -> None:
    gain, postures, workspace = 60 * plan.gain_over_grid, plan.grid.postures, plan.arm.workspace
    scattered = plan.grid.sampled or bool(workspace.postures)
    listed = bool(workspace.postures) and len(postures) <= LISTED
    shown = main_joints(postures, gain) if workspace.line is None else [int(np.flatnonzero(workspace.line)[0])]
    names = [plan.arm.driven[i].name for i in shown]
    angles = np.rad2deg(postures[:, shown])
    plain(axes)
    if listed:
        places = _bars(axes, plan, gain)
    elif len(shown) == 1:
        places = _curve(axes, plan, angles[:, 0], gain, shown[0])
    else:
        drawn = _map(axes, angles, gain, sampled=scattered)
        colour_bar(figure, axes, drawn, _gain_label(plan)).outline.set_visible(False)
        axes.set_ylabel(f"{cut(names[1], 30)} [deg]", fontsize=10, parse_math=False)
        places = {i: tuple(np.rad2deg(q[shown])) for i, q in enumerate(plan.predictions.postures)}
    if not listed:
        axes.set_xlabel(f"{cut(names[0], 30)} [deg]", fontsize=10, parse_math=False)
        for axis in (axes.xaxis, axes.yaxis)[: len(shown)]:
            axis.set_major_locator(MaxNLocator(9, steps=[1, 1.5, 3, 4.5, 6, 9, 10]))
    _mark(axes, plan, places)
    entries: dict[str, Any] = {"chosen, in this order; from 2 on for what is not yet known then": BADGE}
    if plan.measured.any():
        entries["measured before"] = CROSS
    others = [] if listed else [joint.name for i, joint in enumerate(plan.arm.driven) if i not in shown]
    where = "at any angle" if scattered else "at the best angle"
    rest = f"; {', '.join(cut(name, 20) for name in others)} {where}" if others else ""
    if workspace.line is not None:
        rest = f" on the line ({', '.join(f'{share:g}' for share in workspace.line)})"
    heading(axes, f"Gain of a first experiment over posture{rest}", entries)


def _curve(axes: Axes, plan: "CampaignPlan", angles: np.ndarray, gain: np.ndarray, joint: int) -> dict[int, Any]:
    """Draw the gain over one joint's angle, through measured postures off the grid too; return each point."""
    heights, postures, line = 60 * plan.best_gain, np.array(plan.predictions.postures), plan.arm.workspace.line
    places = dict(enumerate(zip(np.degrees(postures[:, joint]), heights, strict=True)))
    along = postures if line is None else np.outer(postures[:, joint] / line[joint], line)
    beside = [i for i, q in enumerate(postures) if i not in plan.grid.seen and np.allclose(q, along[i])]
    x = np.append(angles, [places[i][0] for i in beside])
    y = np.append(gain, heights[beside])
    order = np.argsort(x)
    axes.plot(x[order], y[order], color=BLUE, marker="o", markersize=4)
    axes.set(ylabel=_gain_label(plan), ylim=(0, 1.12 * float(np.nanmax(y))))
    return places


def _bars(axes: Axes, plan: "CampaignPlan", gain: np.ndarray) -> dict[int, Any]:
    """Draw a bar for each listed posture; return the bar end of each distinct posture."""
    rows(axes, [degrees(posture) for posture in plan.grid.postures])
    axes.barh(range(len(gain)), np.nan_to_num(gain), height=0.5, color=PALE_BLUE)
    axes.set(xlim=(0, 1.15 * float(np.nanmax(gain))), xlabel=_gain_label(plan))
    first = {int(place): row for row, place in reversed(list(enumerate(plan.grid.seen)))}
    return {place: (float(gain[row]), row) for place, row in first.items() if place < len(plan.best_gain)}


def _gain_label(plan: "CampaignPlan") -> str:
    words, unit = criterion_in_words(plan)
    return f"expected gain per hour [{unit}/h]: {cut(words, 60)}"


def _map(axes: Axes, angles: np.ndarray, gain: np.ndarray, *, sampled: bool) -> Any:
    if sampled:
        order = np.argsort(gain)
        return axes.scatter(angles[order, 0], angles[order, 1], c=gain[order], cmap="viridis", s=22, linewidths=0)
    x, y = (np.unique(angles[:, k].round(6)) for k in (0, 1))
    table = np.full((len(y), len(x)), np.nan)
    for (a, b), value in zip(angles.round(6), gain, strict=True):
        i, j = np.searchsorted(y, b), np.searchsorted(x, a)
        table[i, j] = np.fmax(table[i, j], value)
    return axes.pcolormesh(x, y, table, cmap="viridis", shading="nearest")


def _mark(axes: Axes, plan: "CampaignPlan", places: dict[int, Any]) -> None:
    """Mark measured postures and number the chosen ones; several numbers may share a place."""
    for i in set(np.flatnonzero(plan.measured).tolist()) & set(places):
        axes.plot(*places[i], linestyle="", zorder=3, clip_on=False, **CROSS)
    chosen = ((each.place, str(i)) for i, each in enumerate(plan.batch, 1) if each.place in places)  # only listed ones
    numbers = by_key(((round(float(places[i][0]), 3), round(float(places[i][1]), 6)), text) for i, text in chosen)
    for place, texts in numbers.items():
        box = {"boxstyle": "round,pad=0.25", "facecolor": "white", "edgecolor": "black"}
        look: Style = {"ha": "center", "va": "center", "color": "black", "fontsize": 9, "fontweight": "bold"}
        note(axes, ", ".join(texts), place, (13, 13), **look, bbox=box, zorder=4)


def _sd_over_experiments(axes: Axes, plan: "CampaignPlan") -> None:
    """Draw the standard deviations of theta at the best estimate, now and after each experiment."""
    sd, experiments = 100 * plan.sd, range(len(plan.steps) + 1)
    parts = list(dict.fromkeys(name.split(".")[0] for name in plan.known.sought))
    entries: dict[str, Any] = {}
    for i, name in enumerate(plan.known.sought):
        colour = COLOURS[parts.index(name.split(".")[0]) % len(COLOURS)]
        style: Style = {"color": colour, "linestyle": DASHES.get(name.rpartition(".")[2], ":"), "linewidth": 1.8}
        axes.plot(experiments, sd[:, i], marker="o", markersize=4, **style)
        entries[cut(name, 28)] = style
    axes.set_yscale("log")
    top, bottom = sd.max() * 1.3, min(sd.min() * 0.7, 4.0)
    axes.set(ylabel="std. error of ln(value) x 100, at the best estimate", ylim=(bottom, top))
    steps = (1.0, 2.0, 5.0) if top > 10 * bottom else (1.0, 1.2, 1.5, 2.0, 3.0, 5.0, 7.0)
    set_ticks(axes.yaxis, LogLocator(subs=steps, numticks=12), "{:.4g}".format)
    axes.set(xlim=(-0.15, len(plan.steps) + 0.15))
    labels = ["now"] + [
        f"{i}: {cut(experiment_in_words(experiment), 34)}\n{cut(degrees(experiment.posture), 34)}"
        for i, experiment in enumerate(plan.batch, 1)
    ]
    slanted: Style = {"rotation": 30, "ha": "right"} if len(labels) > 3 else {}
    axes.set_xticks(list(experiments), labels, parse_math=False, rotation_mode="anchor", **slanted)
    plain(axes)
    heading(axes, "Expected std. errors", entries, columns=3)
