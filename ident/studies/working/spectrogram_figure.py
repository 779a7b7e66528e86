"""Amplitudes of a trace over time and frequency, with the lines of pulleys."""

import re
from collections.abc import Mapping, Sequence
from itertools import cycle
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.colors import Normalize, PowerNorm
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from ident.report.report import cut
from ident.report.style import GREEN, ORANGE, PINK, Style, colour_bar, key_below, plain, titled
from ident.report.words import trace_unit

if TYPE_CHECKING:
    from ident.studies.working.spectra import Spectra
    from ident.vibrate.spectra import Spectrogram

SIZE = (8.0, 4.9)
"""Width and height [inch]."""


def styles(width: float, colours: Sequence[str]) -> tuple[Style, ...]:
    """Return a style for each colour as a solid line, then dashed, then dotted."""
    lines = ("-", "--", ":")
    return tuple({"color": color, "linestyle": line, "linewidth": width} for line in lines for color in colours)


LINES = styles(1.6, (ORANGE, GREEN, "black", PINK))
"""Styles of the pulleys' lines over the blue of a spectrogram."""


def spectrogram_figures(spectra: "Spectra", *, decibel: bool = False) -> dict[str, Figure]:
    """Draw the spectrogram of each direction, with a line for each order of each pulley."""
    time = spectra.traces[spectra.name].time
    lines = {name: (time, frequency) for name, frequency in spectra.lines.items()}
    style: dict[str, Any] = {"upto": spectra.upto, "decibel": decibel, "kind": spectra.kind}
    return {
        re.sub(r"[^\w.+-]+", "_", name): spectrogram_figure(part, lines, title=f"{name}: {spectra.name}", **style)
        for name, part in spectra.spectrograms.items()
    }


def spectrogram_figure(
    spectrogram: "Spectrogram",
    lines: Mapping[str, tuple[Float[np.ndarray, "_"], Float[np.ndarray, "_"]]] | None = None,
    *,
    title: str = "Spectrogram",
    upto: float = 20.0,
    decibel: bool = False,
    kind: str = "displacement",
) -> Figure:
    """Draw the amplitude of a trace over time and frequency, with lines such as a pulley's frequency.

    Args:
        spectrogram: of one trace, amplitudes (F, B) [m].
        lines: times [s] and frequencies [Hz] by name; NaN interrupts a line.
        title: heading, such as direction and motion.
        upto: [Hz] upper end of the axis.
        decibel: colours by 20 log10(amplitude / 1 unit), down to 60 dB below the largest, instead of the unit.
        kind: `displacement` [m], drawn in mm, or another of `trace_unit`.
    """
    figure, axes = amplitude_figure(SIZE, spectrogram, title, upto, kind, decibel)
    handles = []
    for (name, (time, frequency)), style in zip((lines or {}).items(), cycle(LINES), strict=False):
        axes.plot(time, frequency, **style)
        handles.append(Line2D([], [], label=cut(name, 40), **style))
    note = f"{spectrogram.description()}\ngrey: less than half a segment from an end of the trace"
    key_below(figure, handles, note, columns=3)
    return figure


def amplitude_figure(
    size: tuple[float, float], spectrogram: "Spectrogram", title: str, upto: float, kind: str, decibel: bool = False
) -> tuple[Figure, Axes]:
    """Draw the amplitudes, linear between bins and segments, and their colour bar."""
    factor, unit = trace_unit(kind)
    figure = titled(size, cut(title, 70))
    axes = figure.subplots()
    inside = spectrogram.frequency <= upto + spectrogram.resolution
    shown = factor * spectrogram.amplitude[inside]
    top, bottom = float(shown.max()), 0.0
    if decibel:
        shown = 20 * np.log10(np.maximum(shown, np.finfo(float).tiny))
        top, unit = float(shown.max()), f"dB re 1 {unit}"
        bottom = top - 60.0
    # proportional to the root of the amplitude, so that an order is visible next to its resonances
    scale = Normalize(bottom, top or 1.0) if decibel else PowerNorm(0.5, bottom, top or 1.0)
    mesh = axes.pcolormesh(
        spectrogram.time, spectrogram.frequency[inside], shown, cmap="Blues", norm=scale, shading="gouraud"
    )
    colour_bar(figure, axes, mesh, f"amplitude, 0-peak [{unit}]", extend="min" if decibel else "neither")
    axes.set_facecolor("#E4E4E4")
    half = 0.5 / spectrogram.resolution
    axes.set(xlim=(spectrogram.time[0] - half, spectrogram.time[-1] + half), ylim=(0, upto))
    axes.set(xlabel="time [s]", ylabel="frequency [Hz]")
    plain(axes)
    return figure, axes
