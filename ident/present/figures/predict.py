"""Pictures of an arm's modes, and of its natural frequencies along postures."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ident.assess.prediction import Prediction
from ident.identify.modal_analysis import ModalAnalysis
from ident.present.figures.style import BLUE, GREEN, ORANGE, PINK, Style, heading, plain
from ident.present.text.words import cut, degrees

NAME_STYLES: dict[str, Style] = {
    "vertical bending": {"color": BLUE, "marker": "o"},
    "lateral torsion": {"color": ORANGE, "marker": "s"},
    "lateral bending": {"color": GREEN, "marker": "^"},
    "vertical torsion": {"color": PINK, "marker": "D"},
}
MODE_VIEWS = (("from the side", 0, 2), ("from above", 0, 1))
"""Views of the arm: name, horizontal and vertical axis of the base frame."""
SWING = 0.12
"""Largest displacement that is drawn, as a share of the arm's length."""
VIEW_WIDTH = 5.2
"""Width of one view [inch]."""


def mode_figure(analysis: ModalAnalysis) -> Figure:
    """Draw the arm at rest in grey, and its lowest modes in colour, from the side and from above.

    A mode's amplitude is arbitrary; it is drawn so large that one sees it, and the title says how large.
    """
    rest, moved = analysis.outline
    length = float(np.linalg.norm(np.diff(rest, axis=1), axis=0).sum())
    shapes = rest[:, :, None] + SWING * length * moved / np.linalg.norm(moved, axis=0).max(0)
    frame = _frame(shapes, 0.05 * length)
    figure, panels = _mode_panels(len(analysis.labels), [high - low for low, high in frame])
    title = f"Modes of {cut(analysis.arm.name, 40)} at {degrees(analysis.posture)}, load: {cut(str(analysis.load), 40)}"
    title += ", servo on" if analysis.drives == "servo" else ""
    note = f"grey: at rest; in colour: the mode, its largest displacement drawn as {SWING * length:.2g} m"
    figure.suptitle(f"{title}\n{note}", parse_math=False, fontsize=11)
    for i, label in enumerate(analysis.labels):
        colour = NAME_STYLES[f"{label.direction} {label.kind}"]["color"]
        for axes, (view, across, up) in zip(panels[i], MODE_VIEWS, strict=True):
            _draw(axes, rest[[across, up]], color="#C8C8C8", size=6.0)
            _draw(axes, shapes[[across, up], :, i], color=colour, size=2.0)
            axes.set(xlim=frame[across], ylim=frame[up], aspect="equal")
            axes.set_ylabel(f"{'xyz'[up]} [m]", fontsize=8)
            axes.set_xlabel(f"{'xyz'[across]} [m]" if i == len(analysis.labels) - 1 else "", fontsize=8)
            doubt = " (a near draw)" if analysis.ambiguous[i] else ""
            name = f"{i + 1}: {label}{doubt}, {analysis.modes.frequency[i]:.2f} Hz, {view}"
            axes.set_title(name, fontsize=9, loc="left")
            plain(axes)
    return figure


def frequency_figure(predictions: Sequence[Prediction], joint: int) -> Figure:
    """Draw natural frequencies against the angle of one joint, by what the modes are.

    Hollow markers are modes that are named by a near draw; bars are bands of a posterior.

    Args:
        predictions: at postures along a motion, all with as many modes.
        joint: place among the driven joints.
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
    beside = at + _apart(angle) * (np.arange(frequency.shape[1]) - (frequency.shape[1] - 1) / 2)
    colours = [NAME_STYLES[words]["color"] for words in name.ravel()]
    axes.vlines(beside.ravel(), low.ravel(), high.ravel(), color=colours, linewidth=2.2, alpha=0.4, zorder=1)
    for words, style in NAME_STYLES.items():
        for chosen, face in ((~unsure, style["color"]), (unsure, "white")):
            here = (name == words) & chosen
            axes.plot(at[here], frequency[here], linestyle="", markersize=4, markerfacecolor=face, **style)
    arm, ends = analyses[0].arm, [degrees(analyses[i].posture) for i in (0, -1)]
    axes.set_ylim(0, None)
    axes.set_xlabel(
        f"angle of {cut(arm.driven[joint].name, 30)} [deg], postures from {ends[0]} to {ends[1]}",
        fontsize=9,
        parse_math=False,
    )
    axes.set_ylabel("natural frequency [Hz]", fontsize=9)
    axes.grid(color="#EEEEEE", linewidth=0.8)
    plain(axes)
    named = {words: style for words, style in NAME_STYLES.items() if (name == words).any()}
    if unsure.any():
        named["hollow: named by a near draw"] = {"color": "black", "marker": "o", "markerfacecolor": "white"}
    if np.isfinite(low).any():
        named["5 to 95 % of the draws, beside its mode"] = {"color": "#888888", "linestyle": "-", "linewidth": 2.2}
    heading(axes, f"Natural frequencies of {cut(arm.name, 40)} along its postures", named, columns=len(named))
    return figure


def _apart(angle: np.ndarray) -> float:
    """Return how far bands of neighbouring modes stand apart [deg], so that none hides another."""
    steps = np.diff(np.unique(angle.round(6)))
    return 0.08 * float(steps.min()) if len(steps) else 0.1


def _mode_panels(count: int, size: list[float]) -> tuple[Figure, np.ndarray]:
    """Return a row of views for each mode, high enough for the arm's extent (3,) [m]."""
    row = max(VIEW_WIDTH * size[up] / size[across] for _, across, up in MODE_VIEWS)
    figure = Figure(figsize=(2 * VIEW_WIDTH + 1, count * (min(row, 4.0) + 0.5) + 0.9), layout="constrained")
    return figure, figure.subplots(count, len(MODE_VIEWS), squeeze=False)


def _frame(shapes: np.ndarray, pad: float) -> list[tuple[float, float]]:
    """Return limits [m] along x, y and z; as much along y as along z, so that both views are equally high."""
    low, high = shapes.min((1, 2)) - pad, shapes.max((1, 2)) + pad
    middle, half = (low + high) / 2, (high - low) / 2
    half[1:] = half[1:].max()
    return [(float(m - h), float(m + h)) for m, h in zip(middle, half, strict=True)]


def _draw(axes: Axes, line: np.ndarray, *, color: str, size: float) -> None:
    """Draw bodies as lines between joints, and the end point as a bar."""
    axes.plot(*line, color=color, linewidth=size, solid_joinstyle="round")
    axes.plot(*line[:, :-1], linestyle="", marker="o", color=color, markersize=size + 3)
    axes.plot(*line[:, -1:], linestyle="", marker="|", color=color, markersize=10, markeredgewidth=size)
