"""The figure of order tracking: how much of the vibration turns with a pulley, over time."""

from itertools import cycle

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from ident.assess.spectra import Spectra
from ident.present.figures.spectrum import PANEL, SERIES
from ident.present.figures.style import key_below, plain, titled
from ident.present.text.spectrum import UNITS
from ident.present.text.words import cut


def orders_figure(spectra: Spectra) -> Figure:
    """Draw the amplitude of each pulley's orders over time, a panel for each direction."""
    factor, unit = UNITS[spectra.kind]
    count = len(spectra.directions)
    figure = titled((PANEL[0], PANEL[1] * count + 1.3), "Orders of the pulleys")
    grid = figure.subplots(count, 1, squeeze=False, sharex=True)[:, 0]
    named = [(name, track, o) for name, track in spectra.tracks.items() for o in range(len(track.orders))]
    styled = list(zip(named, cycle(SERIES), strict=False))
    for d, (axes, direction) in enumerate(zip(grid, spectra.directions, strict=True)):
        for (_, track, o), style in styled:
            axes.plot(track.time, factor * track.amplitude[o, :, d], marker="o", markersize=3.5, **style)
        plain(axes)
        axes.set_ylim(bottom=0)
        axes.set_ylabel(f"{direction.upper()}: amplitude, 0-peak [{unit}]", fontsize=9)
    grid[-1].set_xlabel("time [s]", fontsize=9)
    figure.align_ylabels(grid)
    handles = [
        Line2D([], [], marker="o", markersize=3.5, label=f"order {track.orders[o]:g} of {cut(name, 30)}", **style)
        for (name, track, o), style in styled
    ]
    revolutions = next(iter(spectra.tracks.values())).revolutions
    fastest = max(float(np.max(track.frequency)) for track in spectra.tracks.values())
    notes = f"a point for each {revolutions} revolutions; pulleys turn at up to {fastest:.3g} Hz"
    key_below(figure, handles, notes, columns=3)
    return figure
