"""Figures of a diagnosis that no other command has."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ident.assess.remedies import Remedy
from ident.present.figures.style import BLUE, plain, ratio_axis, rows
from ident.present.text.units import MM
from ident.present.text.words import cut
from ident.vibrate.redesign.sensitivity import Sensitivities
from ident.vibrate.response.response import Response

RED = "#C1432B"
"""Colour of the limit."""


def stiffness_figure(
    names: Sequence[str], low: Float[np.ndarray, "P"], middle: Float[np.ndarray, "P"], high: Float[np.ndarray, "P"]
) -> Figure:
    """Draw the interval of each number relative to its median."""
    figure, axes = _rows(names)
    places = np.arange(len(names))
    axes.hlines(places, low / middle, high / middle, color=BLUE, linewidth=5, alpha=0.35)
    axes.plot(np.ones(len(names)), places, "o", color=BLUE)
    ratio_axis(axes, float((low / middle).min()), float((high / middle).max()))
    axes.set_xlabel("value / median", fontsize=9)
    return figure


def vibration_figure(response: Response, limit: float) -> Figure:
    """Draw the vibration in each direction over time, with the limit [m]."""
    figure = Figure(figsize=(9, 5.4), layout="constrained")
    time, vibration = np.asarray(response.time), MM * np.asarray(response.vibration)
    reach = 1.1 * max(float(np.abs(vibration).max()), MM * limit)
    for i, axes in enumerate(figure.subplots(3, 1, sharex=True, sharey=True)):
        plain(axes)
        axes.plot(time, vibration[i], color=BLUE, linewidth=0.9)
        for side in (-1, 1):
            axes.axhline(side * MM * limit, color=RED, linestyle="--", linewidth=1)
        axes.set_ylabel(f"{'XYZ'[i]} [mm]", fontsize=9)
        axes.set_ylim(-reach, reach)
    axes.set_xlim(time[0], time[-1])
    axes.set_xlabel("time [s]", fontsize=9)
    return figure


def sensitivities_figure(found: Sensitivities, order: Sequence[int]) -> Figure:
    """Draw how the largest amplitude depends on the numbers, the strongest on top."""
    figure, axes = _rows([found.paths[i] for i in order])
    values = found.elasticity[list(order), int(np.argmax(found.amplitude))]
    axes.barh(np.arange(len(order)), values, color=BLUE, height=0.6)
    axes.axvline(0, color="black", linewidth=0.8)
    axes.set_xscale("symlog", linthresh=1.0)
    reach = float(np.abs(values).max())
    ticks = [sign * tick for tick in (0.5, 1, 2, 5, 10, 20, 50) if tick <= max(reach, 1) for sign in (-1, 1)]
    axes.set_xticks([0, *ticks], [f"{tick:+g}" if tick else "0" for tick in [0, *ticks]])
    axes.minorticks_off()
    axes.set_xlabel("percent of vibration per percent of the number (beyond 1: logarithmic)", fontsize=9)
    return figure


def remedies_figure(names: Sequence[str], found: Sequence[Remedy], limit: float) -> Figure:
    """Draw the largest vibration after each remedy against the limit [m]."""
    figure, axes = _rows(names)
    for row, remedy in enumerate(found):
        fill = BLUE if remedy.cures else "white"
        axes.barh(row, MM * remedy.largest, color=fill, edgecolor=BLUE, height=0.6)
    axes.axvline(MM * limit, color=RED, linestyle="--", linewidth=1.2)
    axes.set_xlim(0, 1.08 * max(MM * limit, *(MM * remedy.largest for remedy in found)))
    axes.set_xlabel("expected largest vibration [mm]", fontsize=9)
    return figure


def _rows(names: Sequence[str]) -> tuple[Figure, Axes]:
    """Return axes with a named row for each, the first on top."""
    figure = Figure(figsize=(9, 1.1 + 0.34 * len(names)), layout="constrained")
    axes = figure.subplots()
    rows(axes, [cut(name, 60) for name in names])
    return figure, axes
