"""Figure of how a posture's modes were chosen: poles over orders, and the MAC with the arm's modes."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from ident.assess.identified_modes import IdentifiedModes
from ident.modal.ambient_test import AmbientTest
from ident.modal.modal_test import ModalTest
from ident.present.figures.ambient import draw_harmonics, draw_size, harmonic_key
from ident.present.figures.style import BLUE, GREY, ORANGE, PALE, key_below, plain, titled
from ident.present.text.words import cut, degrees

STABILISATION_SIZE = (9.0, 7.6)
"""Of the figure [inch]."""
HIGH = 0.68
"""MAC from which on its number is written in white."""


def stabilisation_figure(test: ModalTest | AmbientTest, identified: IdentifiedModes) -> Figure:
    """Draw the poles of all orders with the clusters that modes were made of, and MAC and names of the modes."""
    figure = titled(STABILISATION_SIZE, f"Modes at {degrees(test.posture)}")
    upper, lower = figure.subplots(2, 1, height_ratios=[3, 2])
    _poles(upper, test, identified)
    _mac(lower, identified)
    ambient = isinstance(test, AmbientTest)
    handles = [
        Line2D([], [], linestyle="", marker="o", markersize=4, color=PALE, label="other pole"),
        Line2D([], [], linestyle="", marker="o", markersize=4, color=BLUE, label="pole of a lasting cluster"),
        Line2D([], [], color=ORANGE, label="mode" if ambient else "mode, by maximum likelihood"),
        Line2D([], [], color=GREY, label="two first singular values" if ambient else "size of all responses"),
        *(harmonic_key(test) if isinstance(test, AmbientTest) else ()),
    ]
    key_below(figure, handles, "MAC: measured shapes against those of the arm as its file has it", columns=4)
    return figure


def _poles(axes: Axes, test: ModalTest | AmbientTest, identified: IdentifiedModes) -> None:
    """Draw the diagram over the size of the responses."""
    diagram = identified.modes.diagram
    lasting = diagram.cluster >= 0
    axes.plot(diagram.frequency[~lasting], diagram.order[~lasting], "o", color=PALE, markersize=3)
    axes.plot(diagram.frequency[lasting], diagram.order[lasting], "o", color=BLUE, markersize=3)
    for frequency in identified.modes.frequency:
        axes.axvline(frequency, color=ORANGE, linewidth=1.0, zorder=0)
    axes.set_xlim(0, identified.modes.band[1])
    axes.set_ylim(0, None)
    axes.set_ylabel("states" if isinstance(test, AmbientTest) else "order of the polynomial", fontsize=9)
    axes.set_xlabel("frequency [Hz]", fontsize=9)
    plain(axes)
    size = axes.twinx()
    if isinstance(test, AmbientTest):
        draw_size(size, test)
        draw_harmonics(axes, test)
    else:
        every = np.sqrt((np.abs(test.frf.mean) ** 2).sum((0, 1)))
        size.semilogy(test.frf.frequency, every, color=GREY, linewidth=0.9)
    size.set_yticks([])
    size.minorticks_off()
    plain(size, left=False)


def _mac(axes: Axes, identified: IdentifiedModes) -> None:
    """Draw MAC as cells: rows are measured modes with their name or doubt, columns the arm's."""
    labels, modes = identified.labels, identified.modes
    axes.imshow(labels.mac, cmap="Blues", vmin=0, vmax=1, aspect="auto")
    for (row, column), value in np.ndenumerate(labels.mac):
        color = "white" if value > HIGH else "black"
        axes.text(column, row, f"{value:.2f}", ha="center", va="center", fontsize=7, color=color)
    names = [
        f"{frequency:.2f} Hz: {cut(str(label), 24) if label else 'no certain name'}"
        for frequency, label in zip(modes.frequency, labels.given, strict=True)
    ]
    axes.set_yticks(range(len(names)), names, fontsize=7, parse_math=False)
    shown = [str(label).replace("bending", "bend.").replace("torsion", "tors.") for label in labels.computed]
    axes.set_xticks(range(len(shown)), [text.replace(" ", "\n", 1) for text in shown], fontsize=7, parse_math=False)
    axes.tick_params(length=0)
    for spine in axes.spines.values():
        spine.set_visible(False)
