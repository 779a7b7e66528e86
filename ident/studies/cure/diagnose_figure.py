"""Figures of a diagnosis, one a stage."""

import textwrap
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ident.report.report import cut
from ident.report.style import BLUE, plain, ratio_axis, rows, titled
from ident.report.words import MM
from ident.studies.cure.design_figure import sensitivities_drawn
from ident.studies.cure.diagnose_report import change_words
from ident.studies.stiffness.validate_figure import validate_figure
from ident.studies.working.resonance_figure import resonance_figure

if TYPE_CHECKING:
    from ident.studies.cure.diagnosis import Diagnosis

RED = "#C1432B"
"""Colour of the limit."""
WIDTH = 9.0
"""Width of the figures [inch]."""


def diagnose_figures(diagnosis: "Diagnosis") -> dict[str, Figure]:
    """Return the figures of the finished stages, by stage; not every stage has one."""
    drawn = {stage: _FIGURES[stage](diagnosis) for stage in diagnosis.stages if stage in _FIGURES}
    return {stage: figure for stage, figure in drawn.items() if figure is not None}


def _stiffness_figure(diagnosis: "Diagnosis") -> Figure | None:
    """Draw the interval of each number relative to its median; a coordinate near zero has no ratio."""
    low, median, high = diagnosis.identification.quantiles
    above = np.flatnonzero(low > 0)
    if not len(above):
        return None
    names = diagnosis.identification.sampled.fitted.problem.parameters.names
    figure, axes = _rows([names[i] for i in above], "95 % interval of each number, relative to its median")
    places, left, right = np.arange(len(above)), (low / median)[above], (high / median)[above]
    axes.hlines(places, left, right, color=BLUE, linewidth=5, alpha=0.35)
    axes.plot(np.ones(len(above)), places, "o", color=BLUE)
    room = float(right.max() / left.min()) ** 0.04
    ratio_axis(axes, float(left.min()) / room, float(right.max()) * room)
    axes.set(xlabel="value / median")
    return figure


def _resonance_figure(diagnosis: "Diagnosis") -> Figure | None:
    resonance = diagnosis.resonance
    if resonance.branches is None or resonance.excitation is None:
        return None
    title = diagnosis.task.basis.motion.name
    return resonance_figure(resonance.branches, resonance.excitation, resonance.crossings, title=title)


def _vibration_figure(diagnosis: "Diagnosis") -> Figure:
    """Draw the vibration in each direction over time, with the limit."""
    response, limit = diagnosis.vibration.response, MM * diagnosis.vibration.limit
    figure = titled((WIDTH, 5.4), "Vibration of the end point over time; dashed: the limit")
    time, vibration = np.asarray(response.time), MM * np.asarray(response.vibration)
    reach = 1.1 * max(float(np.abs(vibration).max()), limit)
    for i, axes in enumerate(figure.subplots(3, 1, sharex=True, sharey=True)):
        plain(axes)
        axes.plot(time, vibration[i], color=BLUE, linewidth=0.9)
        for side in (-1, 1):
            axes.axhline(side * limit, color=RED, linestyle="--", linewidth=1)
        axes.set(ylabel=f"{'XYZ'[i]} [mm]", ylim=(-reach, reach))
    axes.set(xlim=(time[0], time[-1]), xlabel="time [s]")
    return figure


def _remedies_figure(diagnosis: "Diagnosis") -> Figure:
    """Draw the largest vibration after each remedy against the limit."""
    task, remedies = diagnosis.task, diagnosis.remedies
    title = "Largest vibration after each remedy; dashed: the limit; filled: meets it"
    figure, axes = _rows([f"{rank}. {change_words(remedy)}" for rank, remedy in enumerate(remedies, 1)], title)
    for row, remedy in enumerate(remedies):
        fill = BLUE if remedy.meets_limit else "white"
        axes.barh(row, MM * remedy.largest, color=fill, edgecolor=BLUE, height=0.6)
    axes.axvline(MM * task.limit, color=RED, linestyle="--", linewidth=1.2)
    axes.set(xlim=(0, 1.08 * MM * max(task.limit, *(remedy.largest for remedy in remedies))))
    axes.set(xlabel="expected largest vibration [mm]")
    return figure


def _rows(names: Sequence[str], title: str) -> tuple[Figure, Axes]:
    """Return axes with a named row for each, the first on top."""
    labels = [textwrap.fill(cut(name, 150), 50) for name in names]
    lines = max(label.count("\n") for label in labels) + 1
    row = max(0.34, 0.14 * lines + 0.12)  # all rows are as high as the longest label needs
    figure = titled((WIDTH, 1.4 + row * len(names)), title)
    axes = figure.subplots()
    rows(axes, labels)
    return figure, axes


_FIGURES: Mapping[str, Callable[["Diagnosis"], Figure | None]] = {
    "stiffness": _stiffness_figure,
    "trust": lambda diagnosis: validate_figure(diagnosis.validation) if diagnosis.validation.told else None,
    "resonance": _resonance_figure,
    "vibration": _vibration_figure,
    "sensitivities": lambda diagnosis: sensitivities_drawn(
        diagnosis.sensitivities, "What the vibration depends on", "scales differ"
    ),
    "remedies": _remedies_figure,
}
