"""The modes of an arm at a posture, its compliance there, and its natural frequencies over postures."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ident.report.report import cut
from ident.report.style import BLUE, GREEN, NAME_STYLES, ORANGE, Style, colour_of, heading, plain
from ident.report.words import degrees, vector_in_words

if TYPE_CHECKING:
    from ident.identify.compliance import ToolCompliance
    from ident.identify.modal_analysis import ModalAnalysis
    from ident.identify.receptance import Receptance
    from ident.studies.look.prediction import Prediction

VIEWS = (("from the side", 0, 2), ("from above", 0, 1))
"""Views of the arm: name, horizontal and vertical axis of the base frame."""
PALEST = "#C8C8C8"
ROUND: Style = {"solid_joinstyle": "round"}
SWING = 0.12
"""Largest drawn displacement, as a share of the arm's length."""
THIN = 40
"""Draws of a posterior in the picture of a compliance, at most."""
FAINT: Style = {"color": "#4477AA", "linewidth": 0.6, "alpha": 0.4}
VIEW_WIDTH = 5.2
"""Width of one view [inch]."""


def largest_swing(analysis: "ModalAnalysis") -> float:
    """Return the drawn size of a mode's largest displacement [m]."""
    rest, _ = analysis.outline
    return SWING * float(np.linalg.norm(np.diff(rest, axis=1), axis=0).sum())


def swing_of(analysis: "ModalAnalysis", i: int) -> np.ndarray:
    """Return the drawn displacements (3, K) of the i-th mode [m]."""
    moved = analysis.outline[1][:, :, i]
    return np.asarray(largest_swing(analysis) * moved / np.linalg.norm(moved, axis=0).max())


def mode_figure(analysis: "ModalAnalysis") -> Figure:
    """Draw the arm at rest in grey, and its lowest modes in colour, from the side and from above.

    A mode's amplitude is arbitrary; it is drawn visibly large, and the title says how large.
    """
    rest, count, largest = analysis.outline[0], len(analysis.labels), largest_swing(analysis)
    shapes = [rest + swing_of(analysis, i) for i in range(count)]
    # the limits [m]: equal along y and z, so that both views are equally high
    every = np.concatenate(shapes, 1)
    middle, half = (every.max(1) + every.min(1)) / 2, np.ptp(every, 1) / 2 + 0.05 * largest / SWING
    half[1:] = half[1:].max()
    frame = np.stack([middle - half, middle + half], 1).tolist()
    row = min(VIEW_WIDTH * half[1] / half[0], 4.0)
    figure = Figure(figsize=(2 * VIEW_WIDTH + 1, count * (row + 0.5) + 0.9), layout="constrained")
    panels = figure.subplots(count, len(VIEWS), squeeze=False)
    title = f"Modes of {cut(analysis.arm.name, 40)} at {degrees(analysis.posture)}, load: {cut(str(analysis.load), 40)}"
    title += ", servo on" if analysis.drives == "servo" else ""
    note = f"grey: at rest; in colour: the mode, exaggerated to {largest:.2g} m at its largest"
    figure.suptitle(f"{title}\n{note}", parse_math=False, fontsize=11)
    for i, label in enumerate(analysis.labels):
        for axes, (view, across, up) in zip(panels[i], VIEWS, strict=True):
            _draw(axes, rest[[across, up]], color=PALEST, size=6.0)
            _draw(axes, shapes[i][[across, up]], color=colour_of(label), size=2.0)
            axes.set(xlim=frame[across], ylim=frame[up], aspect="equal", ylabel=f"{'xyz'[up]} [m]")
            axes.set(xlabel=f"{'xyz'[across]} [m]" if i == count - 1 else "")
            plain(axes)
            doubt = " (a near draw)" if analysis.ambiguous[i] else ""
            name = f"{i + 1}: {label}{doubt}, {analysis.modes.frequency[i]:.2f} Hz, {view}"
            axes.set_title(name, fontsize=9, loc="left")
    return figure


def compliance_figure(analysis: "ModalAnalysis", tool: "ToolCompliance") -> Figure:
    """Draw the arm at rest and, at the point, where forces of one size in all directions move it: an ellipsoid.

    A posterior's draws are drawn thin. The ellipsoid is drawn visibly large, and the title gives its scale. Below are
    the frequency responses along the axes of the frame.
    """
    rest, (largest, direction, _) = analysis.outline[0], tool.largest
    size, draws = largest_swing(analysis), np.zeros((0, 6, 6)) if tool.draws is None else np.moveaxis(tool.draws, -1, 0)
    figure = Figure(figsize=(2 * VIEW_WIDTH + 1, 8.5 if tool.response else 4.5), layout="constrained")
    title = f"Compliance of {cut(analysis.arm.name, 40)} at {degrees(analysis.posture)}, {cut(tool.point, 20)}"
    title += f", load: {cut(str(analysis.load), 40)}{', servo on' if analysis.drives == 'servo' else ''}"
    note = f"ellipsoid: motion by equal forces of all directions, drawn {size:.2g} m for {1e6 * largest:.4g} um/N"
    note += f" along ({vector_in_words(tool.axes @ direction)}){'; thin: draws, shaded: 5 to 95 %' * bool(len(draws))}"
    figure.suptitle(f"{title}\n{note}", parse_math=False, fontsize=11)
    figure.subplot_mosaic("01;22" if tool.response else "01")
    for axes, (view, across, up) in zip(figure.axes, VIEWS, strict=False):
        _draw(axes, rest[[across, up]], color=PALEST, size=6.0)
        for matrix, style in (*((draw, FAINT) for draw in draws[:THIN]), (tool.matrix, {"color": "black"})):
            outline = size / largest * _shadow(tool.axes @ matrix[:3, :3] @ tool.axes.T, [across, up])
            axes.plot(*(tool.place[[across, up], None] + outline), **style)
        axes.set(aspect="equal", adjustable="datalim", xlabel=f"{'xyz'[across]} [m]", ylabel=f"{'xyz'[up]} [m]")
        axes.set_title(view, fontsize=9, loc="left")
        plain(axes)
    if tool.response:
        _response(figure.axes[2], tool.response, tool.frame)
    return figure


def _response(axes: Axes, response: "Receptance", frame: str) -> None:
    """Draw the size of the response along each axis of a frame over the frequency, with its band."""
    for k, (axis, colour) in enumerate(zip("xyz", (BLUE, ORANGE, GREEN), strict=True)):
        axes.semilogy(response.frequency, 1e6 * response.size[k], color=colour, label=axis, linewidth=1.2)
        axes.fill_between(response.frequency, *1e6 * response.band[:, k], color=colour, alpha=0.25, linewidth=0)
    axes.set(xlim=(0, response.frequency[-1]), xlabel="frequency [Hz]", ylabel="motion along the force [um/N]")
    axes.set_title(f"frequency response along the axes of the {frame}", fontsize=9, loc="left")
    axes.legend(ncols=3, frameon=False, fontsize=8)
    plain(axes, grid=True)


def _shadow(C: np.ndarray, view: list[int]) -> np.ndarray:
    """Return the outline (2, points) [m] of where forces of 1 N in all directions move a point, as seen in a view."""
    axes, half, _ = np.linalg.svd(C[view])  # C maps the unit sphere to an ellipsoid
    angle = np.linspace(0, 2 * np.pi, 181)
    return np.asarray(axes * half @ np.stack([np.cos(angle), np.sin(angle)]))


def frequency_figure(predictions: Sequence["Prediction"], joint: int) -> Figure:
    """Draw natural frequencies against the angle of one joint, by mode name.

    Hollow markers are modes named by a nearby draw; bars are bands of a posterior.

    Args:
        predictions: at postures along a motion, all with as many modes.
        joint: index of the driven joint.
    """
    analyses = [each.analysis for each in predictions]
    frequency = np.array([analysis.modes.frequency for analysis in analyses])
    name = np.array([[f"{label.direction} {label.kind}" for label in analysis.labels] for analysis in analyses])
    unsure = np.array([analysis.ambiguous for analysis in analyses])
    angle = np.degrees([analysis.posture[joint] for analysis in analyses])
    figure = Figure(figsize=(9.0, 5.5), layout="constrained")
    axes = figure.add_subplot()
    axes.plot(angle, frequency, color="#BBBBBB", linewidth=0.8, zorder=1)
    at = np.broadcast_to(angle[:, None], frequency.shape)
    low, high = np.stack([each.frequency_band for each in predictions], 1)
    steps = np.diff(np.unique(angle.round(6)))
    apart = 0.08 * float(steps.min()) if len(steps) else 0.1  # offset of bands [deg], so that none hides another
    beside = at + apart * (np.arange(frequency.shape[1]) - (frequency.shape[1] - 1) / 2)
    colours = [NAME_STYLES[words]["color"] for words in name.ravel()]
    axes.vlines(beside.ravel(), low.ravel(), high.ravel(), color=colours, linewidth=2.2, alpha=0.4, zorder=1)
    for words, style in NAME_STYLES.items():
        for chosen, face in ((~unsure, style["color"]), (unsure, "white")):
            here = (name == words) & chosen
            axes.plot(at[here], frequency[here], linestyle="", markersize=4, markerfacecolor=face, **style)
    arm, ends = analyses[0].arm, [degrees(analyses[i].posture) for i in (0, -1)]
    axes.set(ylim=(0, None))
    words = f"angle of {cut(arm.driven[joint].name, 30)} [deg], postures from {ends[0]} to {ends[1]}"
    axes.set_xlabel(words, fontsize=9, parse_math=False)
    axes.set(ylabel="natural frequency [Hz]")
    axes.grid(color="#EEEEEE", linewidth=0.8)
    plain(axes)
    named = {words: style for words, style in NAME_STYLES.items() if (name == words).any()}
    if unsure.any():
        named["hollow: named by a near draw"] = {"color": "black", "marker": "o", "markerfacecolor": "white"}
    if np.isfinite(low).any():
        named["5 to 95 % of the draws, beside its mode"] = {"color": "#888888", "linestyle": "-", "linewidth": 2.2}
    heading(axes, f"Natural frequencies of {cut(arm.name, 40)} along its postures", named, columns=len(named))
    return figure


def _draw(axes: Axes, line: np.ndarray, *, color: str, size: float) -> None:
    """Draw bodies as lines between joints, and the end point as a bar."""
    axes.plot(*line, color=color, linewidth=size, **ROUND)
    axes.plot(*line[:, :-1], linestyle="", marker="o", color=color, markersize=size + 3)
    axes.plot(*line[:, -1:], linestyle="", marker="|", color=color, markersize=10, markeredgewidth=size)
