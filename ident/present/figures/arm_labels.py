"""Labels beside a drawing, with lines to what they name, none on another."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from scipy.optimize import isotonic_regression

from ident.present.figures.style import ORANGE, Style
from ident.present.text.words import cut

PITCH, SLANTED = 0.19, 0.3
"""Least distance of labels from each other [inch]: of lines in a column, and of slanted ones in a row."""
LEADER: Style = {"color": "#9A9A9A", "linewidth": 0.6}


@dataclass(frozen=True)
class Mark:
    """What a label names.

    Attributes:
        words: the label.
        place: (2,) [m] as seen.
        odd: whether it is one of what looks odd.
    """

    words: str
    place: np.ndarray
    odd: bool

    @property
    def color(self) -> str:
        """Colour of the label."""
        return ORANGE if self.odd else "black"


def spread(places: Sequence[float], pitch: float, low: float, high: float) -> np.ndarray:
    """Return places in the same order, no nearer to each other than a pitch, within bounds, as near as can be.

    Places less their rank times the pitch must not fall: the nearest such are their isotonic regression, clipped
    (Barlow, Bartholomew, Bremner, Brunk, "Statistical inference under order restrictions", 1972).

    Raises:
        ValueError: there is no room for so many.
    """
    last = high - pitch * (len(places) - 1)
    if not places:
        return np.zeros(0)
    if last < low - 1e-9 * pitch:
        raise ValueError(f"no room for {len(places)} labels")
    order, steps = np.argsort(places, kind="stable"), pitch * np.arange(len(places))
    found = np.empty(len(places))
    found[order] = np.clip(isotonic_regression(np.asarray(places)[order] - steps).x, low, max(last, low)) + steps
    return found


def fitting(marks: Sequence[Mark], room: float, pitch: float) -> list[Mark]:
    """Return as many marks as there is room for, those that are odd before the others."""
    count = int(room / pitch + 1e-9) + 1
    kept = sorted(range(len(marks)), key=lambda i: (not marks[i].odd, i))[:count]
    return [marks[i] for i in sorted(kept)]


def label_rows(
    axes: Axes, marks: Sequence[Mark], level: float, scale: float, within: tuple[float, float], *, up: bool
) -> None:
    """Write slanted labels above or below a drawing.

    Args:
        axes: where.
        marks: what is named, as far as there is room.
        level: height [m] of the labels' ends.
        scale: inches a metre.
        within: from where to where [m] they may stand.
        up: whether they stand above.
    """
    sign, pitch = 1 if up else -1, SLANTED / scale
    marks = fitting(marks, within[1] - within[0], pitch)
    style: dict[str, Any] = {"rotation": 32 * sign, "rotation_mode": "anchor", "ha": "left", "va": "center"}
    for mark, x in zip(marks, spread([float(mark.place[0]) for mark in marks], pitch, *within), strict=True):
        axes.plot([mark.place[0], x], [mark.place[1], level], zorder=3, **LEADER)
        at = level + sign * 0.04 / scale
        axes.text(x, at, cut(mark.words, 28), fontsize=8, color=mark.color, parse_math=False, **style)


def label_columns(
    axes: Axes, marks: Sequence[Mark], level: float, scale: float, within: tuple[float, float], *, left: bool
) -> None:
    """Write labels in a column left or right of a drawing; see `label_rows`."""
    sign, align, pitch = (-1, "right", PITCH / scale) if left else (1, "left", PITCH / scale)
    marks = fitting(marks, within[1] - within[0], pitch)
    for mark, y in zip(marks, spread([float(mark.place[1]) for mark in marks], pitch, *within), strict=True):
        axes.plot([mark.place[0], level], [mark.place[1], y], zorder=3, **LEADER)
        at = level + sign * 0.05 / scale
        axes.text(at, y, cut(mark.words, 26), fontsize=8, ha=align, va="center", color=mark.color, parse_math=False)
