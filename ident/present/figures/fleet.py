"""The figure of a fleet: each robot's own and shrunk estimates beside the population, a panel a stiffness."""

import math

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from ident.identify.fleet import Fleet
from ident.inference.population import Population
from ident.present.figures.style import BLUE, GREY, ORANGE, PALE, PALE_BLUE, key_below, note, plain, power_of, titled
from ident.present.text.units import in_shown_unit
from ident.present.text.words import cut

COLUMNS = 3
FLEET_PANEL = (3.9, 2.7)
"""Width and height of a panel [inch]."""
WIDEST = 1.0
"""Standard deviation in theta above which an own estimate is not drawn: its data leave it open."""
MOST = 300
"""Robots that are drawn, of more those that are farthest off, in the order of their names."""


def fleet_figure(fleet: Fleet) -> Figure:
    """Draw a panel for each stiffness; robots in the order of their names."""
    population = fleet.population
    if population is None:
        return titled((6.0, 1.6), "No population: too few robots could be fitted")
    count = len(fleet.names)
    columns = min(COLUMNS, count)
    height = FLEET_PANEL[1] * math.ceil(count / columns) + 1.1
    figure = titled((FLEET_PANEL[0] * columns, height), f"A fleet of {len(fleet.robots)} robots")
    axes = np.atleast_1d(figure.subplots(math.ceil(count / columns), columns, squeeze=False)).ravel()
    shown = _fleet_shown(fleet)
    for i, panel in enumerate(axes):
        if i < count:
            _panel(panel, fleet, population, i, shown)
        else:
            panel.set_visible(False)
    key_below(
        figure, _handles(), "robots from left to right by name; own fits that leave a stiffness open are not drawn"
    )
    return figure


def stiffness_figure(fleet: Fleet, population: Population, i: int) -> Figure:
    """Draw one stiffness of all robots."""
    figure = titled((6.4, 3.6), "")
    _panel(figure.subplots(), fleet, population, i, _fleet_shown(fleet))
    key_below(figure, _handles(), "")
    return figure


def _fleet_shown(fleet: Fleet) -> np.ndarray:
    judged = fleet.deviations
    least = judged.p.min(1) if judged else np.zeros(0)
    return np.sort(np.argsort(least, kind="stable")[:MOST])


def _handles() -> list[Artist]:
    return [
        Patch(color=PALE_BLUE, alpha=0.5, linewidth=0, label="95 % of healthy robots"),
        Line2D([], [], color=PALE, marker="_", linestyle="", markersize=8, label="own fit, 95 %"),
        Line2D([], [], color=BLUE, marker="o", linestyle="", markersize=4, label="shrunk, 95 %"),
        Line2D([], [], color=ORANGE, marker="o", linestyle="", markersize=4, label="stands out"),
    ]


def _panel(axes: Axes, fleet: Fleet, population: Population, i: int, shown: np.ndarray) -> None:
    """Draw one stiffness of the shown members."""
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
    axes.set_ylim(*np.exp(_limits(shrunk, sd, middle, spread)) * scale)
    axes.set_xlim(-1, len(shown))
    axes.set_xticks([])
    axes.set_title(f"{cut(fleet.names[i], 24)} [{unit}]", fontsize=9, parse_math=False)
    plain(axes)


def _limits(shrunk: np.ndarray, sd: np.ndarray, middle: float, spread: float) -> tuple[float, float]:
    """Return the ends of the axis in theta: population and shrunk intervals lie within, own ones may be cut."""
    low = min(float((shrunk - 2 * sd).min()), middle - 3 * spread)
    high = max(float((shrunk + 2 * sd).max()), middle + 3 * spread)
    return low - 0.05 * (high - low), high + 0.05 * (high - low)
