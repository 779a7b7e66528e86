"""Figures of results; with `mode_figures` the only modules with matplotlib.

Figures are made without pyplot, so that nothing global is touched. Texts from files are drawn as they are: a `$` in a
name is no formula (`parse_math=False`).
"""

import math
import warnings
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.gridspec import SubplotSpec
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator

from ident.identify.campaign_fit import CampaignFit
from ident.identify.fit import Fit
from ident.identify.information import FIXED_BELOW, Direction
from ident.measure import Measurement
from ident.present.files import replace_file
from ident.present.report import NOTABLE, SUSPICIOUS
from ident.present.units import FIELDS, field_of, is_stiffness, nmm_per_deg, shown
from ident.present.words import cut, degrees

BLUE, ORANGE, GREEN, PINK, GREY, PALE = "#0072B2", "#D55E00", "#009E73", "#CC79A7", "#666666", "#B8C4CE"
"""Colours that a colour-blind reader tells apart (Okabe and Ito), and two greys."""
KINDS = {
    "frequency": (BLUE, "o"),
    "deflection": (ORANGE, "s"),
    "deflection_difference": (PINK, "D"),
    "damping_ratio": (GREEN, "^"),
}
ROW = 0.27
"""Height of one row [inch]."""
PANEL = 1.0
"""Height of a panel's heading and axis [inch]."""
DENSE = 60
"""Measurements from which rows are counted instead of described."""
REACH = 30.0
"""Factor beyond the fitted values at which an interval is cut off by the frame."""
DPI = 130


def save(figure: Figure, path: Path) -> None:
    """Write a figure as PNG, whole or not at all.

    Raises:
        InputError: the file can't be written; what was there before is untouched.
    """
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Glyph .* missing from", UserWarning)
        replace_file(path, lambda file: figure.savefig(file, format="png", dpi=DPI))


def fit_figure(result: CampaignFit) -> Figure:
    """Draw a fit at one glance: parameters, measured against predicted, what the data fix, what contradicts.

    Filled markers are what the data support, hollow ones what they leave open.
    """
    notes = list(_notes(result))
    P, D = len(result.fit.information.names), len(result.campaign)
    left = _heights(P, P)
    right = _heights(min(D, DENSE), 0.75 * len(notes) - 1.5)
    height = max(sum(left), sum(right))
    figure = Figure(figsize=(13.5, height + 0.5), layout="constrained")
    figure.get_layout_engine().set(w_pad=0.12, h_pad=0.08)
    title = f"Fit of {cut(result.arm.name, 50)} to {cut(result.campaign.name, 50) or 'a campaign'}"
    figure.suptitle(title, parse_math=False, fontsize=13, fontweight="bold")
    columns = figure.add_gridspec(1, 2)
    _parameters(*_split(figure, columns[0], left, height), result.fit)
    _measurements(*_split(figure, columns[1], right, height), result, notes)
    return figure


def _heights(upper: float, lower: float) -> tuple[float, float]:
    return PANEL + ROW * upper, PANEL + ROW * lower


def _split(figure: Figure, cell: SubplotSpec, heights: tuple[float, float], total: float) -> tuple[Axes, Axes]:
    """Return two axes, one above the other; the lower one takes what is left of the height."""
    grid = cell.subgridspec(2, 1, height_ratios=[heights[0], max(heights[1], total - heights[0])])
    return figure.add_subplot(grid[0]), figure.add_subplot(grid[1])


def _rows(axes: Axes, labels: Sequence[str], side: str = "left") -> None:
    """Make one row for each label, from the top down."""
    axes.set_ylim(len(labels) - 0.4, -0.6)
    axes.set_yticks(range(len(labels)), labels, parse_math=False, fontsize=8)
    axes.tick_params(axis="y", length=0)
    axes.tick_params(axis="x", labelsize=8)
    if side == "left":
        axes.grid(axis="y", color="#EEEEEE", linewidth=0.8)
        axes.set_axisbelow(True)
    for spine in ("top", "right", "left"):
        axes.spines[spine].set_visible(False)


def _key(axes: Axes, title: str, entries: Sequence[tuple[str, dict[str, object]]]) -> None:
    """Put heading and key above the axes, where they hide nothing."""
    handles = [Line2D([], [], label=label, linestyle="", **style) for label, style in entries]
    legend = axes.legend(
        handles=handles,
        title=title,
        alignment="left",
        loc="lower left",
        bbox_to_anchor=(0.0, 1.0),
        ncols=len(handles),
        frameon=False,
        fontsize=8,
        borderaxespad=0.1,
        handletextpad=0.3,
        columnspacing=1.2,
    )
    legend.get_title().set(fontweight="bold", fontsize=10)


FILLED = {"marker": "o", "color": BLUE, "markersize": 6}
HOLLOW = {"marker": "o", "color": GREY, "markersize": 6, "markerfacecolor": "white"}


class _Row(NamedTuple):
    """A parameter as it is drawn, relative to the arm file."""

    value: float
    low: float
    high: float
    supported: bool


def _parameters(upper: Axes, lower: Axes, fit: Fit) -> None:
    _values(upper, fit)
    _directions(lower, fit)


def _values(axes: Axes, fit: Fit) -> None:
    """Draw the fitted parameters relative to the arm file; for lengths, by ten to the power of the shift [m]."""
    known, items = fit.information, fit.problem.parameters.items
    _rows(axes, [cut(item.name, 30) for item in items])
    rows = [
        _Row(*_relative(item, value, *interval), bool(ok))
        for item, value, interval, ok in zip(
            items, fit.best.values, fit.interval(), known.supported, strict=True
        )
    ]
    left, right = _span(rows)
    axes.set_xscale("log")
    axes.set_xlim(left, right)
    axes.axvline(1.0, color="black", linewidth=0.8)
    for i, row in enumerate(rows):
        ends = [max(row.low, left / 10), min(row.high, right * 10)]
        colour, width = (BLUE, 2.2) if row.supported else (PALE, 4.0)
        axes.plot(ends, [i, i], color=colour, linewidth=width, solid_capstyle="butt", zorder=2)
        axes.plot([row.value], [i], **(FILLED if row.supported else HOLLOW), zorder=3, linestyle="")
    _ratio_ticks(axes, left, right)
    axes.set_xlabel("fitted value / arm file's value [-]", fontsize=9)
    entries = [("fitted, 95 % interval", FILLED), ("open: interval is mostly the prior's", HOLLOW)]
    _key(axes, "Parameters: fitted against the arm file", entries)
    words = axes.twinx()
    texts = [
        _value_text(item.name, value, interval, ok)
        for item, value, interval, ok in zip(
            items, fit.best.values, fit.interval(), known.supported, strict=True
        )
    ]
    _rows(words, texts, "right")
