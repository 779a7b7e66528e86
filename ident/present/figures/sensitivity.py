"""Figure of sensitivities: by how many percent the amplitude changes with each number, as bars with bands."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from ident.assess.design import DesignStudy
from ident.present.figures.style import BLUE, GREY, ORANGE, key_below, motion_title, note, plain, rows, titled
from ident.present.text.sensitivity import UNSURE
from ident.present.text.units import MM, value_in_words
from ident.present.text.words import cut
from ident.vibrate.redesign.sensitivity import NEARBY
from ident.vibrate.response.study import DIRECTIONS

SENSITIVITY_WIDTH, ROW = 9.0, 0.24
"""Width of the figure and height of a row [inch]."""
MOST = 16
"""Numbers that are shown."""


def sensitivity_figure(study: DesignStudy) -> Figure:
    """Draw the sensitivities in x, y and z, the strongest at the top, with 5 to 95 % of the draws."""
    each = study.sensitivities
    shown = each.order[:MOST]
    title = motion_title(f"What the vibration of {study.basis.point} depends on", study.basis)
    figure = titled((SENSITIVITY_WIDTH, ROW * len(shown) + 1.9), title, (0.06, 0.08))
    grid = figure.subplots(1, len(DIRECTIONS), sharey=True)
    names = [f"{cut(each.paths[i], 22)}, {value_in_words(each.paths[i], each.present[i])}" for i in shown]
    for d, axes in enumerate(grid):
        _direction(axes, study, d, shown)
    rows(grid[0], names)
    for axes in grid[1:]:
        axes.tick_params(axis="y", length=0, labelleft=False)
        axes.grid(axis="y", color="#EEEEEE", linewidth=0.8)
    _key(figure, study, len(shown))
    return figure


def _direction(axes: Axes, study: DesignStudy, d: int, shown: list[int]) -> None:
    each = study.sensitivities
    values, places = each.elasticity[shown, d], np.arange(len(shown))
    color, unsure = np.where(values < 0, BLUE, ORANGE), each.unsure[shown, d]
    axes.barh(places, values, height=0.62, color=np.where(unsure, "white", color), edgecolor=color, zorder=2)
    if study.draws:
        low, high = each.band[:, shown, d]
        axes.hlines(places, low, high, color="black", linewidth=1.1, zorder=3)
    _numbers(axes, study, d, shown)
    axes.axvline(0, color=GREY, linewidth=0.8, zorder=1)
    plain(axes, left=False)
    axes.set_title(f"{DIRECTIONS[d].upper()}: {MM * each.amplitude[d]:.3g} mm", fontsize=10)
    axes.locator_params(axis="x", nbins=5)
    if d == 1:
        axes.set_xlabel("% of amplitude per % of the number", fontsize=9)


def _numbers(axes: Axes, study: DesignStudy, d: int, shown: list[int]) -> None:
    """Write each number beyond the end of its bar and band: beside strong ones, weak bars can't be read."""
    each = study.sensitivities
    values = each.elasticity[shown, d]
    ends = np.stack([values, *(each.band[:, shown, d] if study.draws else ())])
    for place, value in enumerate(values):
        end = ends[:, place].min() if value < 0 else ends[:, place].max()
        side, align = (-3, "right") if value < 0 else (3, "left")
        mark = f" {UNSURE}" if each.unsure[shown[place], d] else ""
        note(axes, f"{value:+.2f}{mark}", (end, place), (side, 0), ha=align, va="center", fontsize=7)
    room = 0.24 * (max(ends.max(), 0.0) - min(ends.min(), 0.0))
    axes.set_xlim(min(ends.min(), 0.0) - room, max(ends.max(), 0.0) + room)


def _key(figure: Figure, study: DesignStudy, shown: int) -> None:
    handles: list[Patch | Line2D] = [
        Patch(color=BLUE, label="more of it: less vibration"),
        Patch(color=ORANGE, label="more of it: more vibration"),
    ]
    if study.draws:
        handles.append(Line2D([], [], color="black", linewidth=1.1, label=f"5 to 95 % of {study.draws} draws"))
    if study.sensitivities.unsure[study.sensitivities.order[:shown]].any():
        unsure = "of either sign over the draws" if study.draws else f"turns within {100 * NEARBY:g} % of it"
        handles.append(Patch(facecolor="white", edgecolor=GREY, label=f"{UNSURE} {unsure}"))
    left = len(study.sensitivities.paths) - shown
    notes = [f"{study.evaluator.measure} of the vibration, at the arm as it is; scales differ"]
    notes += [f"{left} weaker ones are not shown"] if left else []
    key_below(figure, handles, "; ".join(notes), columns=3)
