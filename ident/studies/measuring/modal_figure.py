"""Figures of a posture: frequency responses and coherence, mode shapes, stabilisation."""

from collections.abc import Sequence
from itertools import chain
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ident.modal.ambient import AmbientTest
from ident.modal.modes import Modes
from ident.modal.parameters import PhasePlane, phase_planes
from ident.report.report import cut
from ident.report.style import BLUE, GREY, ORANGE, PALE, PINK, Style, key_below, lines, note, plain, titled
from ident.report.words import counted, degrees
from ident.studies.measuring.modal_report import place_in_words

if TYPE_CHECKING:
    from ident.arm.modes import Label
    from ident.modal.frf import ModalTest, Place
    from ident.studies.measuring.modal_campaign import IdentifiedModes

# -------- Ambient
# Figure of an ambient test: singular values of the spectral density, with lines of rotating parts.

HARMONIC: Style = {"color": PINK, "linewidth": 1.0, "linestyle": ":"}
"""Style of a rotating part's line."""


def ambient_figure(test: AmbientTest, identified: "IdentifiedModes | None" = None) -> Figure:
    """Draw the singular values of the spectral density matrix, the modes, and the removed harmonics."""
    figure = titled((9.0, 4.4), f"Responses without a force at {degrees(test.posture)}")
    axes = figure.subplots()
    density = test.density
    axes.semilogy(density.frequency, density.singular[1:].T, color=PALE, linewidth=0.6)
    axes.semilogy(density.frequency, density.singular[0], color=BLUE, linewidth=1.0)
    for frequency in identified.modes.frequency if identified else ():
        axes.axvline(frequency, color=ORANGE, linewidth=1.0, zorder=0)
    draw_harmonics(axes, test)
    axes.set(xlim=(0, test.band[1]), xlabel="frequency [Hz]", ylabel="singular value [1/Hz]")
    plain(axes, grid=True)
    entries: dict[str, Style] = {"first singular value": {"color": BLUE}, "others": {"color": PALE}}
    entries |= {"mode": {"color": ORANGE}} if identified else {}
    note = f"{cut(str(test.load), 70)}; {test.correlations.duration:.0f} s; each response in its standard deviations"
    key_below(figure, lines(entries | harmonic_key(test)), note, columns=4)
    return figure


def draw_harmonics(axes: Axes, test: AmbientTest) -> None:
    """Mark the removed lines, numbered as in the key."""
    for number, line in enumerate(test.harmonics, 1):
        axes.axvline(line.frequency, zorder=1, **HARMONIC)
        top: Style = {"xycoords": ("data", "axes fraction"), "ha": "center", "va": "bottom"}
        note(axes, str(number), (line.frequency, 1.0), fontsize=7, color=PINK, **top)


def harmonic_key(test: AmbientTest) -> dict[str, Style]:
    """Return the key of the marked lines."""
    return {f"{number}: {cut(str(line), 36)}": HARMONIC for number, line in enumerate(test.harmonics, 1)}


# -------- Modal

COLORS = (BLUE, ORANGE, PINK, GREY)
"""Colours of the forces, or of the directions at a point, in their order."""


def measured_figure(test: "ModalTest | AmbientTest", identified: "IdentifiedModes | None" = None) -> Figure:
    """Draw the measurement at a posture."""
    return ambient_figure(test, identified) if isinstance(test, AmbientTest) else modal_figure(test, identified)


def modal_figure(test: "ModalTest", identified: "IdentifiedModes | None" = None) -> Figure:
    """Draw accelerance of mean, single hits and identified modes, and coherence, of each response.

    A colour stands for each force.
    """
    frf, count = test.frf, len(test.frf.responses)
    rows = -(-count // 2)
    figure = titled((9.0, 3.1 * rows + 1.4), f"Frequency responses at {degrees(test.posture)}")
    grid = figure.subplots(2 * rows, 2, sharex=True, squeeze=False, height_ratios=[3, 1] * rows)
    pairs = list(zip(grid[::2].flat, grid[1::2].flat, strict=True))
    dashed: Style = {"color": "black", "linewidth": 0.8, "linestyle": "--"}
    for o, (upper, lower) in enumerate(pairs[:count]):
        _response(upper, lower, test, o)
        if identified and isinstance(identified.modes, Modes):
            upper.plot(identified.modes.frf.frequency, np.abs(identified.modes.fitted[o]).T, zorder=3, **dashed)
    for axes in chain(*pairs[count:]):
        axes.set_visible(False)
    for axes in grid[-1]:
        axes.set(xlabel="frequency [Hz]")
    entries: dict[str, Style] = {"single hits": {"color": PALE}} | ({"identified modes": dashed} if identified else {})
    forces = zip(frf.references, COLORS, strict=False)
    entries = {f"force at {place_in_words(place)}": {"color": color} for place, color in forces} | entries
    words = f"{cut(str(test.load), 70)}; {len(frf.hits)} hits at each point"
    if test.rejected:
        words += f"\nrejected: {counted(len(test.rejected), 'hit')}, see the report"
    key_below(figure, lines(entries), words, columns=3)
    return figure


def _response(upper: Axes, lower: Axes, test: "ModalTest", o: int) -> None:
    """Draw accelerance in the upper panel and coherence in the lower one."""
    frf, mean = test.frf, np.abs(test.frf.mean[o])
    upper.set_yscale("log")
    for i, color in zip(range(len(frf.references)), COLORS, strict=False):
        upper.plot(frf.frequency, np.abs(frf.hits[:, o, i]).T, color=PALE, linewidth=0.5, zorder=1)
        upper.plot(frf.frequency, mean[i], color=color, linewidth=1.1, zorder=2)
        lower.plot(frf.frequency, test.coherence[o, i], color=color, linewidth=0.9)
    bottom, top = float(np.quantile(mean, 0.01)), float(mean.max())
    upper.set(ylim=(max(bottom / 2, top / 1e5), 2 * top), xlim=(0, frf.frequency[-1]))
    lower.set(ylim=(0, 1.05))
    upper.set_title(f"response {place_in_words(frf.responses[o])}", fontsize=9, loc="left", parse_math=False)
    for axes, name in ((upper, "accelerance [1/kg]"), (lower, "coherence")):
        plain(axes, grid=axes is upper)
        axes.set_ylabel(name, fontsize=8)
        axes.yaxis.set_label_coords(-0.12, 0.5)  # aligned by their ticks, the names would take half of the drawing


# -------- Argand
# Figure of a posture's mode shapes in the complex plane: arrows in phase lie along one line.

ENDS = "os^Dv"
"""Ends of arrows, one a point."""
WITHIN, CIRCLE = 2.4477, np.linspace(0, 2 * np.pi, 61)
"""Half axes of an ellipse that holds 95 %, in standard deviations, and the angles to draw it."""


def argand_figure(test: "ModalTest | AmbientTest", identified: "IdentifiedModes") -> Figure:
    """Draw each mode's motion at the responses as arrows in the complex plane, with ellipses that hold 95 %."""
    planes = phase_planes(identified.modes)
    columns = min(4, len(planes))
    rows = -(-len(planes) // columns)
    size = 2.5 * max(columns, 3) + 0.4, 2.5 * 1.15 * rows + 1.5
    figure = titled(size, f"Mode shapes at {degrees(test.posture)}")
    panels = figure.subplots(rows, columns, squeeze=False).ravel()
    looks = _looks(test.responses)
    modes = zip(panels, planes, identified.modes.frequency, identified.labels.given, strict=False)
    for axes, plane, frequency, label in modes:
        _panel(axes, plane, looks)
        title = f"{frequency:.2f} Hz, {_name(label)}\ncollinearity {plane.collinearity:.3f}"
        axes.set_title(title, fontsize=8, loc="left", parse_math=False)
    for axes in panels[len(planes) :]:
        axes.set_visible(False)
    styles = [{"color": color, "marker": end, "markersize": 4} for color, end in looks]
    entries = dict(zip(map(place_in_words, test.responses), styles, strict=True))
    note = "turned to the real axis and scaled to one at the largest; ellipses hold 95 %"
    key_below(figure, lines(entries), note, columns=6)
    return figure


def _name(label: "Label | None") -> str:
    return cut(str(label), 24) if label else "no certain name"


def _panel(axes: Axes, plane: PhasePlane, looks: Sequence[tuple[str, str]]) -> None:
    around = np.stack([np.cos(CIRCLE), np.sin(CIRCLE)])
    for motion, covariance, (color, end) in zip(plane.shape, plane.covariance, looks, strict=True):
        axes.plot([0, motion.real], [0, motion.imag], color=color, linewidth=1.2, marker=end, markevery=[1], ms=4)
        variances, axis = np.linalg.eigh(covariance)
        ellipse = WITHIN * axis @ (np.sqrt(np.maximum(variances, 0.0))[:, None] * around)
        axes.plot(motion.real + ellipse[0], motion.imag + ellipse[1], color=color, linewidth=0.8)
    axes.axhline(0, color=GREY, linewidth=0.5, zorder=0)
    axes.axvline(0, color=GREY, linewidth=0.5, zorder=0)
    axes.set(xlim=(-1.2, 1.2), ylim=(-1.2, 1.2), aspect="equal")
    plain(axes)
    axes.tick_params(labelsize=7)


def _looks(places: Sequence["Place"]) -> list[tuple[str, str]]:
    """Return colour and end of each response."""
    points = list(dict.fromkeys(place.point for place in places))
    nth = [sum(other.point == place.point for other in places[:o]) for o, place in enumerate(places)]
    ends = [ENDS[points.index(place.point) % len(ENDS)] for place in places]
    return [(COLORS[n % len(COLORS)], end) for n, end in zip(nth, ends, strict=True)]


# -------- Stabilisation
# Figure of the choice of a posture's modes: poles over orders, and the MAC with the arm's modes.


def stabilisation_figure(test: "ModalTest | AmbientTest", identified: "IdentifiedModes") -> Figure:
    """Draw the poles of all orders, the clusters behind the modes, and MAC and names of the modes."""
    figure = titled((9.0, 7.6), f"Modes at {degrees(test.posture)}")
    upper, lower = figure.subplots(2, 1, height_ratios=[3, 2])
    _poles(upper, test, identified)
    _mac(lower, identified)
    ambient, dot = isinstance(test, AmbientTest), {"linestyle": "", "marker": "o", "markersize": 4}
    entries: dict[str, Style] = {
        "other pole": {**dot, "color": PALE},
        "pole of a lasting cluster": {**dot, "color": BLUE},
        "mode" if ambient else "mode, by maximum likelihood": {"color": ORANGE},
        "two first singular values" if ambient else "size of all responses": {"color": GREY},
        **(harmonic_key(test) if isinstance(test, AmbientTest) else {}),
    }
    key_below(figure, lines(entries), "MAC: measured shapes against those of the arm as its file has it", columns=4)
    return figure


def _poles(axes: Axes, test: "ModalTest | AmbientTest", identified: "IdentifiedModes") -> None:
    """Draw the diagram over the magnitude of the responses."""
    diagram = identified.modes.diagram
    lasting = diagram.cluster >= 0
    axes.plot(diagram.frequency[~lasting], diagram.order[~lasting], "o", color=PALE, markersize=3)
    axes.plot(diagram.frequency[lasting], diagram.order[lasting], "o", color=BLUE, markersize=3)
    for frequency in identified.modes.frequency:
        axes.axvline(frequency, color=ORANGE, linewidth=1.0, zorder=0)
    axes.set(xlim=(0, identified.modes.band[1]), ylim=(0, None))
    axes.set(ylabel="states" if isinstance(test, AmbientTest) else "order of the polynomial", xlabel="frequency [Hz]")
    plain(axes)
    size = axes.twinx()
    if isinstance(test, AmbientTest):
        size.semilogy(test.density.frequency, np.sqrt(test.density.singular[:2].T), color=GREY, linewidth=0.7)
        draw_harmonics(axes, test)
    else:
        every = np.sqrt((np.abs(test.frf.mean) ** 2).sum((0, 1)))
        size.semilogy(test.frf.frequency, every, color=GREY, linewidth=0.9)
    size.set_yticks([])
    size.minorticks_off()
    plain(size, left=False)


def _mac(axes: Axes, identified: "IdentifiedModes") -> None:
    """Draw MAC as cells: rows are measured modes with their name or doubt, columns the arm's."""
    labels, modes = identified.labels, identified.modes
    axes.imshow(labels.mac, cmap="Blues", vmin=0, vmax=1, aspect="auto")
    for (row, column), value in np.ndenumerate(labels.mac):
        color = "white" if value > 0.68 else "black"  # on dark and on light blue
        axes.text(column, row, f"{value:.2f}", ha="center", va="center", fontsize=7, color=color)
    names = [f"{hertz:.2f} Hz: {_name(label)}" for hertz, label in zip(modes.frequency, labels.given, strict=True)]
    axes.set_yticks(range(len(names)), names, fontsize=7, parse_math=False)
    shown = [str(label).replace("bending", "bend.").replace("torsion", "tors.") for label in labels.computed]
    axes.set_xticks(range(len(shown)), [text.replace(" ", "\n", 1) for text in shown], fontsize=7, parse_math=False)
    axes.tick_params(length=0)
    for spine in axes.spines.values():
        spine.set_visible(False)
