"""Stiffness changes between two campaigns, with their intervals."""

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure

from ident.inference.change import LEVEL
from ident.inference.information import p_in_words
from ident.report.report import cut
from ident.report.style import FILLED, GREY, HOLLOW, ORANGE, key_below, lines, ratio_axis, rows, titled
from ident.report.words import percent

if TYPE_CHECKING:
    from ident.identify.compare import Comparison


def compare_figure(comparison: "Comparison") -> Figure:
    """Draw the ratio after / before of each stiffness, with its 95 % interval; changed ones are orange."""
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
    entries = {kind: {**marks[kind], "linestyle": ""} for kind in marks if kind in kinds}
    verdict = "changed" if change.seen else "no change"
    note = f"all stiffnesses together: {verdict}, {p_in_words(change.p_value)}; changed: p < {percent(LEVEL)} (Holm)"
    key_below(figure, lines(entries), note)
    return figure
