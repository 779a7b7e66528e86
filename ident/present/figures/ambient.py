"""Figure of an ambient test: singular values of the spectral density, with lines of what turns."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from ident.assess.identified_modes import IdentifiedModes
from ident.modal.ambient_test import AmbientTest
from ident.present.figures.style import BLUE, GREY, ORANGE, PALE, PINK, Style, key_below, plain, titled
from ident.present.text.words import cut, degrees

SIZE = (9.0, 4.4)
"""Of the figure [inch]."""
HARMONIC: Style = {"color": PINK, "linewidth": 1.0, "linestyle": ":"}
"""Look of a line of something that turns."""


def ambient_figure(test: AmbientTest, identified: IdentifiedModes | None = None) -> Figure:
    """Draw the singular values of the spectral density matrix, the modes, and the harmonics that were taken out."""
    figure = titled(SIZE, f"Responses without a force at {degrees(test.posture)}")
    axes = figure.subplots()
    density = test.density
    axes.semilogy(density.frequency, density.singular[1:].T, color=PALE, linewidth=0.6)
    axes.semilogy(density.frequency, density.singular[0], color=BLUE, linewidth=1.0)
    for frequency in identified.modes.frequency if identified else ():
        axes.axvline(frequency, color=ORANGE, linewidth=1.0, zorder=0)
    draw_harmonics(axes, test)
    axes.set_xlim(0, test.band[1])
    axes.set_xlabel("frequency [Hz]", fontsize=9)
    axes.set_ylabel("singular value [1/Hz]", fontsize=9)
    plain(axes, grid=True)
    handles = [
        Line2D([], [], color=BLUE, label="first singular value"),
        Line2D([], [], color=PALE, label="others"),
        *([Line2D([], [], color=ORANGE, label="mode")] if identified else []),
        *harmonic_key(test),
    ]
    note = f"{cut(str(test.load), 70)}; {test.correlations.duration:.0f} s; each response in its standard deviations"
    key_below(figure, handles, note, columns=4)
    return figure


def draw_harmonics(axes: Axes, test: AmbientTest) -> None:
    """Mark the lines that were taken out, numbered as in the key."""
    for number, line in enumerate(test.harmonics, 1):
        axes.axvline(line.frequency, zorder=1, **HARMONIC)
        axes.annotate(
            str(number), (line.frequency, 1.0), xycoords=("data", "axes fraction"), ha="center", va="bottom",
            fontsize=7, color=PINK,
        )  # fmt: skip


def harmonic_key(test: AmbientTest) -> list[Line2D]:
    """Return what the marks of the lines mean."""
    return [
        Line2D([], [], label=f"{number}: {cut(str(line), 36)}", **HARMONIC)
        for number, line in enumerate(test.harmonics, 1)
    ]


def draw_size(axes: Axes, test: AmbientTest) -> None:
    """Draw the first two singular values as a background."""
    axes.semilogy(test.density.frequency, np.sqrt(test.density.singular[:2].T), color=GREY, linewidth=0.7)
