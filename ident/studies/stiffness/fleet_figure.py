"""The stiffnesses of many robots, and the spread of their population."""

import math
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from ident.report.report import cut
from ident.report.style import BLUE, GREY, ORANGE, PALE, PALE_BLUE, key_below, note, plain, power_of, titled
from ident.report.words import in_shown_unit

if TYPE_CHECKING:
    from ident.identify.fleet import Fleet
    from ident.inference.population import Population

FLEET_PANEL = (3.9, 2.7)
"""Width and height of a panel [inch]."""
WIDEST = 1.0
"""Standard deviation of theta above which an own estimate is not drawn: the robot's data do not determine it."""
MOST = 300
"""Robots drawn at most; of more, the ones farthest from the median, ordered by name."""


def fleet_figure(fleet: "Fleet") -> Figure:
    """Draw a panel for each stiffness; robots ordered by name."""
    population = fleet.population
    if population is None:
        return titled((6.0, 1.6), "No population: too few robots could be fitted")
    count = len(fleet.names)
    columns = min(3, count)
    lines = math.ceil(count / columns)
    size = FLEET_PANEL[0] * columns, FLEET_PANEL[1] * lines + 1.1
    figure = titled(size, f"A fleet of {len(fleet.robots)} robots")
    panels = figure.subplots(lines, columns, squeeze=False).ravel()
    for i, axes in enumerate(panels[:count]):
        _panel(axes, fleet, population, i)
    for axes in panels[count:]:
        axes.set_visible(False)
    handles: list[Artist] = [
        Patch(color=PALE_BLUE, alpha=0.5, linewidth=0, label="95 % of healthy robots"),
        Line2D([], [], color=PALE, marker="_", linestyle="", markersize=8, label="own fit, 95 %"),
        Line2D([], [], color=BLUE, marker="o", linestyle="", markersize=4, label="shrunk, 95 %"),
        Line2D([], [], color=ORANGE, marker="o", linestyle="", markersize=4, label="stands out"),
    ]
    key_below(
        figure, handles, "robots from left to right by name; own fits that do not determine a stiffness are not drawn"
    )
    return figure


def _panel(axes: Axes, fleet: "Fleet", population: "Population", i: int) -> None:
    """Draw one stiffness of all members; of many, the ones farthest from the median."""
    least = fleet.deviations.p.min(1) if fleet.deviations else np.zeros(0)
    shown = np.sort(np.argsort(least, kind="stable")[:MOST])
    scale, unit = in_shown_unit(fleet.names[i], 1.0)
    size, unit = power_of(float(np.exp(population.next_mean[i])) * scale, unit)
    scale /= size
    x = np.arange(len(shown))
    robots = [fleet.robots[fleet.members[r]] for r in shown]
    own, own_sd = (np.array([getattr(robot, name)[i] for robot in robots]) for name in ("theta", "sd"))
    shrunk, sd = population.robot_mean[shown, i], population.robot_sd[shown, i]
    middle, spread = population.next_mean[i], population.next_sd[i]
    axes.axhspan(*np.exp([middle - 1.96 * spread, middle + 1.96 * spread]) * scale, color=PALE_BLUE, alpha=0.5, lw=0)
    axes.axhline(np.exp(middle) * scale, color=GREY, linewidth=0.8)
    drawn = own_sd < WIDEST
    low, high = (np.exp(own + sign * 1.96 * own_sd)[drawn] * scale for sign in (-1, 1))
    axes.vlines(x[drawn] - 0.2, low, high, color=PALE, linewidth=1.2)
    axes.scatter(x[drawn] - 0.2, np.exp(own[drawn]) * scale, color=PALE, marker="_", s=20)
    off = np.array([i in fleet.standing_out.get(int(r), ()) for r in shown])
    for which, colour in ((~off, BLUE), (off, ORANGE)):
        low, high = (np.exp(shrunk + sign * 1.96 * sd)[which] * scale for sign in (-1, 1))
        axes.vlines(x[which], low, high, color=colour, linewidth=1.4)
        axes.scatter(x[which], np.exp(shrunk[which]) * scale, color=colour, s=10, zorder=3)
    for place in np.flatnonzero(off)[:5]:
        note(axes, cut(robots[place].name, 12), (x[place], np.exp(shrunk[place]) * scale), (4, 3))
    # population and shrunk intervals lie within the frame; it may cut own intervals off
    bottom = min(float((shrunk - 2 * sd).min()), middle - 3 * spread)
    top = max(float((shrunk + 2 * sd).max()), middle + 3 * spread)
    room = 0.05 * (top - bottom)
    axes.set_ylim(*np.exp((bottom - room, top + room)) * scale)
    axes.set(xlim=(-1, len(shown)))
    axes.set_xticks([])
    axes.set_title(f"{cut(fleet.names[i], 24)} [{unit}]", fontsize=9, parse_math=False)
    plain(axes)
