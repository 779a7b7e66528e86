"""Figure of sensitivities: by how many percent the amplitude changes with each number, as bars with bands."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from ident.assess.design import DesignStudy
from ident.present.figures.style import BLUE, GREY, ORANGE, rows
from ident.present.text.units import MM, value_in_words
from ident.present.text.words import cut
from ident.vibrate.response.study import DIRECTIONS

WIDTH, ROW = 9.0, 0.24
"""Width of the figure and height of a row [inch]."""
MOST = 16
"""Numbers that are shown."""


def sensitivity_figure(designing: DesignStudy) -> Figure:
    """Draw the sensitivities in x, y and z, the strongest at the top, with 5 to 95 % of the draws."""
    found = designing.sensitivities
    shown = found.order[:MOST]
    figure = Figure(figsize=(WIDTH, ROW * len(shown) + 1.9), layout=ConstrainedLayoutEngine(w_pad=0.06, h_pad=0.08))
    title = f"What the vibration of {designing.point} depends on: {cut(designing.arm.name, 30)}"
    figure.suptitle(
        f"{title}\n{cut(designing.trial.motion.name, 60)}", parse_math=False, fontsize=12, fontweight="bold"
    )
    grid = figure.subplots(1, len(DIRECTIONS), sharey=True)
    names = [f"{cut(found.paths[i], 22)}, {value_in_words(found.paths[i], found.present[i])}" for i in shown]
    for d, axes in enumerate(grid):
        _direction(axes, designing, d, shown)
    rows(grid[0], names)
    for axes in grid[1:]:
        axes.tick_params(axis="y", length=0, labelleft=False)
        axes.grid(axis="y", color="#EEEEEE", linewidth=0.8)
    _key(figure, designing, len(shown))
    return figure


def _direction(axes: Axes, designing: DesignStudy, d: int, shown: list[int]) -> None:
    found = designing.sensitivities
    values, places = found.elasticity[shown, d], np.arange(len(shown))
    axes.barh(places, values, height=0.62, color=np.where(values < 0, BLUE, ORANGE), linewidth=0, zorder=2)
    if designing.draws:
        low, high = found.band[:, shown, d]
        axes.hlines(places, low, high, color="black", linewidth=1.1, zorder=3)
    _numbers(axes, designing, d, shown)
    axes.axvline(0, color=GREY, linewidth=0.8, zorder=1)
    axes.set_axisbelow(True)
    axes.tick_params(labelsize=8)
    for side in ("top", "right", "left"):
        axes.spines[side].set_visible(False)
    axes.set_title(f"{DIRECTIONS[d].upper()}: {MM * found.amplitude[d]:.3g} mm", fontsize=10)
    axes.locator_params(axis="x", nbins=5)
    if d == 1:
        axes.set_xlabel("% of amplitude per % of the number", fontsize=9)


def _numbers(axes: Axes, designing: DesignStudy, d: int, shown: list[int]) -> None:
    """Write each number beyond the end of its bar and band: beside strong ones, weak bars can't be read."""
    found = designing.sensitivities
    values = found.elasticity[shown, d]
    ends = np.stack([values, *(found.band[:, shown, d] if designing.draws else ())])
    for place, value in enumerate(values):
        end = ends[:, place].min() if value < 0 else ends[:, place].max()
        axes.annotate(
            f"{value:+.2f}",
            (end, place),
            xytext=(-3 if value < 0 else 3, 0),
            textcoords="offset points",
            ha="right" if value < 0 else "left",
            va="center",
            fontsize=7,
            color=GREY,
        )
    room = 0.24 * (max(ends.max(), 0.0) - min(ends.min(), 0.0))
    axes.set_xlim(min(ends.min(), 0.0) - room, max(ends.max(), 0.0) + room)


def _key(figure: Figure, designing: DesignStudy, shown: int) -> None:
    handles: list[Patch | Line2D] = [
        Patch(color=BLUE, label="more of it: less vibration"),
        Patch(color=ORANGE, label="more of it: more vibration"),
    ]
    if designing.draws:
        handles.append(Line2D([], [], color="black", linewidth=1.1, label=f"5 to 95 % of {designing.draws} draws"))
    left = len(designing.sensitivities.paths) - shown
    notes = [f"{designing.trial.measure} of the vibration, at the arm as it is; scales differ"]
    notes += [f"{left} weaker ones are not shown"] if left else []
    key = figure.legend(
        handles=handles, title="; ".join(notes), loc="outside lower center", ncols=3, frameon=False, fontsize=9
    )
    key.get_title().set(fontsize=8, color=GREY, parse_math=False)
