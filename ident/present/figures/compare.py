"""The figure of a comparison: the ratio of each stiffness after to before."""

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from ident.identify.compare import Comparison
from ident.present.figures.style import BLUE, FILLED, GREY, HOLLOW, ORANGE, key_below, ratio_axis, rows, titled
from ident.present.text.compare import level_words
from ident.present.text.words import cut

WIDTH, COMPARE_ROW = 8.0, 0.34
"""Width of the figure and height of a row [inch]."""


def compare_figure(comparison: Comparison) -> Figure:
    """Draw the ratio of each stiffness after to before, with its 95 % interval; those that have changed are orange."""
    change = comparison.change
    before, after = (cut(name, 24) for name in comparison.names)
    figure = titled((WIDTH, COMPARE_ROW * len(change.names) + 1.9), f"Stiffness, {after} over {before}")
    axes = figure.subplots()
    low, high = np.exp(change.interval).T
    marks = {"changed": {**FILLED, "color": ORANGE}, "not changed": FILLED, "open": HOLLOW}
    kinds = np.where(change.open, "open", np.where(change.changed, "changed", "not changed")).tolist()
    colours = {"changed": ORANGE, "not changed": BLUE, "open": GREY}
    for i, kind in enumerate(kinds):
        axes.hlines(i, low[i], high[i], color=colours[kind], linewidth=2.0)
        axes.plot(np.exp(change.change[i]), i, linestyle="", **marks[kind])
    axes.axvline(1.0, color=GREY, linewidth=0.8)
    margin = 1.05
    ratio_axis(axes, min(low.min(), 0.95) / margin, max(high.max(), 1.05) * margin)
    axes.set_xlabel("ratio after / before [-], with 95 % interval", fontsize=9)
    rows(axes, [cut(name, 24) for name in change.names])
    handles = [Line2D([], [], label=kind, linestyle="", **marks[kind]) for kind in marks if kind in kinds]
    verdict = "changed" if change.seen else "no change is seen"
    note = f"together: {verdict}, p = {change.p_value:.2g}; changed: p below {level_words()} by Holm's procedure"
    key_below(figure, handles, note)
    return figure
