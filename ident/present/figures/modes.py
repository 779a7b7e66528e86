"""Pictures of an arm's modes at a posture, and of the arm in motion."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float
from matplotlib.animation import FuncAnimation
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from ident.present.figures.style import BLUE, GREY, NAME_STYLES, ORANGE, Style, colour_of, heading, plain
from ident.present.report import cut
from ident.present.words import MM, degrees

if TYPE_CHECKING:
    from ident.assess.predict import Prediction
    from ident.identify.modal_analysis import ModalAnalysis
    from ident.vibrate.response import Outline, Response

# -------- Motion
# Pictures of an arm at work: the way of its end point, and the moving arm, its vibration drawn larger than it is.

VIEWS = (("from the side", 0, 2), ("from above", 0, 1))
"""Views of the arm: name, horizontal and vertical axis of the base frame."""
WIDTH = 8.0
"""Width of a figure [inch]."""
PALEST = "#C8C8C8"
ROUND: Style = {"solid_joinstyle": "round"}


def path_figure(response: "Response", shown: "Outline") -> Figure:
    """Draw the way of the end point, its vibration made larger, and the arm at some moments, in two views.

    Args:
        response: of one set.
        shown: the arm at the moments to draw; the factor is taken from it.
    """
    path = np.asarray(response.path + response.displacement - response.vibration)
    way = path + shown.factor * np.asarray(response.vibration)
    figure, panels = _panels(np.concatenate([way, shown.rest.reshape(3, -1)], 1))
    for axes, (_, across, up) in zip(panels, VIEWS, strict=True):
        for k in range(len(shown.time)):
            axes.plot(*shown.rest[[across, up], :, k], color=PALEST, linewidth=2.5, marker="o", markersize=5, **ROUND)
        axes.plot(*path[[across, up]], color=GREY, linewidth=0.8, zorder=3)
        axes.plot(*way[[across, up]], color=BLUE, linewidth=0.8, zorder=4)
    keys: dict[str, Style] = {
        f"way of the end point, vibration {shown.factor:g} times as large": {"linestyle": "-", "color": BLUE},
        "without vibration": {"linestyle": "-", "color": GREY},
        "arm at rest": {"linestyle": "-", "color": PALEST, "linewidth": 2.5},
    }
    moments = ", ".join(f"{t:.1f}" for t in shown.time)
    heading(panels[0], f"{cut(response.motion.name, 40)}; the arm at {cut(moments, 60)} s", keys, columns=3)
    return figure


def motion_animation(response: "Response", shown: "Outline", *, fps: float = 10.0, dpi: float = 64.0) -> FuncAnimation:
    """Return the moving, vibrating arm as an animation in two views, one picture for each moment of the outline.

    The title tells how much slower than the arm the pictures follow each other.

    Args:
        response: of one set, for the name of its motion and for the vibration that is written.
        shown: the arm at equally spaced moments.
        fps: pictures a second.
        dpi: pixels an inch; at 64 a picture takes some 20 kB.
    """
    figure, panels = _panels(np.concatenate([shown.rest.reshape(3, -1), shown.drawn.reshape(3, -1)], 1))
    figure.set_dpi(dpi)
    FigureCanvasAgg(figure)
    slower = 1 / (fps * float(np.mean(np.diff(shown.time)))) if len(shown.time) > 1 else 1.0
    pace = f"{slower:.2g} times slower" if slower > 1 else f"{1 / slower:.2g} times faster"
    keys: dict[str, Style] = {
        f"vibration {shown.factor:g} times as large": {"linestyle": "-", "color": BLUE, "linewidth": 2.0},
        "without vibration": {"linestyle": "-", "color": PALEST, "linewidth": 4.0},
        "end point until now": {"linestyle": "-", "color": ORANGE},
    }
    heading(panels[0], f"{cut(response.motion.name, 40)}, {pace} than the arm", keys, columns=3)
    lines = []
    for axes, (_, across, up) in zip(panels, VIEWS, strict=True):
        rest = axes.plot([], [], color=PALEST, linewidth=4.0, marker="o", markersize=6, **ROUND)[0]
        moved = axes.plot([], [], color=BLUE, linewidth=2.0, marker="o", markersize=4)[0]
        trail = axes.plot([], [], color=ORANGE, linewidth=1.0)[0]
        lines.append((rest, moved, trail, [across, up]))
    clock = panels[-1].text(0.0, -0.42, "", transform=panels[-1].transAxes, fontsize=9, color=GREY)
    size = MM * np.stack([np.interp(shown.time, response.time, part) for part in np.asarray(response.vibration)])

    def draw(frame: int) -> list:
        for rest, moved, trail, view in lines:
            rest.set_data(*shown.rest[view, :, frame])
            moved.set_data(*shown.drawn[view, :, frame])
            trail.set_data(*shown.drawn[view, -1, : frame + 1])
        x, y, z = size[:, frame]
        clock.set_text(f"{shown.time[frame]:.2f} s    end point: X {x:+.2f}, Y {y:+.2f}, Z {z:+.2f} mm")
        return [clock]

    return FuncAnimation(figure, draw, frames=len(shown.time), interval=1e3 / fps, blit=False)


def _panels(points: Float[np.ndarray, "3 n"]) -> tuple[Figure, np.ndarray]:
    """Return a panel for each view, high enough for these points [m]."""
    low, high = points.min(1), points.max(1)
    pad = 0.04 * float((high - low).max())
    low, high = low - pad, high + pad
    heights = [(high[up] - low[up]) / (high[0] - low[0]) * (WIDTH - 0.9) for _, _, up in VIEWS]
    figure = Figure(figsize=(WIDTH, sum(heights) + 1.7), layout="constrained")
    panels = figure.subplots(len(VIEWS), 1, sharex=True, height_ratios=heights)
    for axes, (view, across, up) in zip(panels, VIEWS, strict=True):
        axes.text(0.01, 0.04, view, transform=axes.transAxes, fontsize=9, color=GREY)
        axes.set(xlim=(low[across], high[across]), ylim=(low[up], high[up]), aspect="equal")
        axes.set(ylabel=f"{'xyz'[up]} [m]")
        plain(axes)
    panels[-1].set(xlabel="x [m]")
    return figure, panels


# -------- Predict
# Pictures of an arm's modes, and of its natural frequencies along postures.

SWING = 0.12
"""Largest displacement that is drawn, as a share of the arm's length."""
VIEW_WIDTH = 5.2
"""Width of one view [inch]."""


def largest_swing(analysis: "ModalAnalysis") -> float:
    """Return how large the largest displacement of a mode is drawn [m]."""
    rest, _ = analysis.outline
    return SWING * float(np.linalg.norm(np.diff(rest, axis=1), axis=0).sum())


def swing_of(analysis: "ModalAnalysis", i: int) -> np.ndarray:
    """Return the displacements (3, K) of the i-th mode as they are drawn [m]."""
    moved = analysis.outline[1][:, :, i]
    return np.asarray(largest_swing(analysis) * moved / np.linalg.norm(moved, axis=0).max())


def mode_figure(analysis: "ModalAnalysis") -> Figure:
    """Draw the arm at rest in grey, and its lowest modes in colour, from the side and from above.

    A mode's amplitude is arbitrary; it is drawn so large that one sees it, and the title says how large.
    """
    rest, count, largest = analysis.outline[0], len(analysis.labels), largest_swing(analysis)
    shapes = [rest + swing_of(analysis, i) for i in range(count)]
    # the limits [m]: as much along y as along z, so that both views are equally high
    every = np.concatenate(shapes, 1)
    pad = 0.05 * largest / SWING
    low, high = every.min(1) - pad, every.max(1) + pad
    middle, half = (low + high) / 2, (high - low) / 2
    half[1:] = half[1:].max()
    frame = [(float(m - h), float(m + h)) for m, h in zip(middle, half, strict=True)]
    size = [end - start for start, end in frame]
    row = min(max(VIEW_WIDTH * size[up] / size[across] for _, across, up in VIEWS), 4.0)
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
            plain(axes)
            axes.set(xlim=frame[across], ylim=frame[up], aspect="equal")
            axes.set_ylabel(f"{'xyz'[up]} [m]", fontsize=8)
            axes.set_xlabel(f"{'xyz'[across]} [m]" if i == count - 1 else "", fontsize=8)
            doubt = " (a near draw)" if analysis.ambiguous[i] else ""
            name = f"{i + 1}: {label}{doubt}, {analysis.modes.frequency[i]:.2f} Hz, {view}"
            axes.set_title(name, fontsize=9, loc="left")
    return figure


def frequency_figure(predictions: Sequence["Prediction"], joint: int) -> Figure:
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
    steps = np.diff(np.unique(angle.round(6)))
    apart = 0.08 * float(steps.min()) if len(steps) else 0.1  # of bands [deg], so that none hides another
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
