"""Figure of a posture's frequency responses: size and coherence over frequency, a panel for each response."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from ident.assess.identified_modes import IdentifiedModes
from ident.modal.ambient_test import AmbientTest
from ident.modal.estimate import Modes
from ident.modal.modal_test import ModalTest
from ident.present.figures.ambient import ambient_figure
from ident.present.figures.style import BLUE, GREY, ORANGE, PALE, PINK, key_below, plain, titled
from ident.present.text.places import place_in_words
from ident.present.text.words import cut, degrees

WIDTH, PANEL = 9.0, 1.55
"""Width of the figure and height of a row [inch]."""
COLORS = (BLUE, ORANGE, PINK, GREY)
"""Colours of the forces."""
DECADES = 5
"""Decades that a panel shows at most."""
LEFT = -0.12
"""Where the names of upright axes stand, as a share of a panel's width."""


def measured_figure(test: ModalTest | AmbientTest, identified: IdentifiedModes | None = None) -> Figure:
    """Draw what was measured at a posture."""
    return ambient_figure(test, identified) if isinstance(test, AmbientTest) else modal_figure(test, identified)


def modal_figure(test: ModalTest, identified: IdentifiedModes | None = None) -> Figure:
    """Draw accelerance of mean, single hits and identified modes, and coherence, of each response.

    A colour stands for each force.
    """
    frf = test.frf
    count = len(frf.responses)
    rows = -(-count // 2)
    figure = titled((WIDTH, PANEL * 2 * rows + 1.4), f"Frequency responses at {degrees(test.posture)}")
    grid = figure.subplots(2 * rows, 2, sharex=True, squeeze=False, height_ratios=[3, 1] * rows)
    for o in range(2 * rows):
        upper, lower = grid[2 * (o // 2), o % 2], grid[2 * (o // 2) + 1, o % 2]
        if o < count:
            _response(upper, test, o)
            _coherence(lower, test, o)
            if identified and isinstance(identified.modes, Modes):
                _fitted(upper, identified.modes, o)
        else:
            upper.set_visible(False)
            lower.set_visible(False)
    for axes in grid[-1]:
        axes.set_xlabel("frequency [Hz]", fontsize=9)
    handles = [
        Line2D([], [], color=color, label=f"force at {place_in_words(place)}")
        for place, color in zip(frf.references, COLORS, strict=False)
    ]
    handles.append(Line2D([], [], color=PALE, label="single hits"))
    if identified:
        handles.append(Line2D([], [], color="black", linewidth=0.8, linestyle="--", label="identified modes"))
    key_below(figure, handles, _note(test), columns=3)
    return figure


def _response(axes: Axes, test: ModalTest, o: int) -> None:
    frf = test.frf
    axes.set_yscale("log")
    for i, color in zip(range(len(frf.references)), COLORS, strict=False):
        axes.plot(frf.frequency, np.abs(frf.hits[:, o, i]).T, color=PALE, linewidth=0.5, zorder=1)
        axes.plot(frf.frequency, np.abs(frf.mean[o, i]), color=color, linewidth=1.1, zorder=2)
    top = float(np.abs(frf.mean[o]).max())
    bottom = float(np.quantile(np.abs(frf.mean[o]), 0.01))
    axes.set_ylim(max(bottom / 2, top / 10**DECADES), 2 * top)
    axes.set_xlim(0, frf.frequency[-1])
    plain(axes, grid=True)
    axes.set_title(f"response {place_in_words(frf.responses[o])}", fontsize=9, loc="left", parse_math=False)
    _named(axes, "accelerance [1/kg]")


def _fitted(axes: Axes, modes: Modes, o: int) -> None:
    """Draw the responses of the identified modes over the measured ones."""
    axes.plot(modes.frf.frequency, np.abs(modes.fitted[o]).T, color="black", linewidth=0.8, linestyle="--", zorder=3)


def _coherence(axes: Axes, test: ModalTest, o: int) -> None:
    for i, color in zip(range(len(test.frf.references)), COLORS, strict=False):
        axes.plot(test.frf.frequency, test.coherence[o, i], color=color, linewidth=0.9)
    axes.set_ylim(0, 1.05)
    plain(axes)
    _named(axes, "coherence")


def _named(axes: Axes, name: str) -> None:
    """Name the upright axis at a place that all panels share; aligned by their ticks, it takes half of the drawing."""
    axes.set_ylabel(name, fontsize=8)
    axes.yaxis.set_label_coords(LEFT, 0.5)


def _note(test: ModalTest) -> str:
    lines = [f"{cut(str(test.load), 70)}; {len(test.frf.hits)} hits at each point"]
    if test.rejected:
        lines.append(f"rejected: {len(test.rejected)} hit{'s' * (len(test.rejected) > 1)}, see the report")
    return "\n".join(lines)
