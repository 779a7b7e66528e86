"""The arm along its motion: outlines at several times, and an animation."""

from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float
from matplotlib.animation import FuncAnimation
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from ident.report.report import cut
from ident.report.style import BLUE, GREY, ORANGE, Style, heading, plain
from ident.report.words import MM
from ident.studies.look.predict_figure import PALEST, ROUND, VIEWS

if TYPE_CHECKING:
    from ident.vibrate.response import Outline, Response


WIDTH = 8.0
"""Width of a figure [inch]."""


def path_figure(response: "Response", shown: "Outline") -> Figure:
    """Draw the path of the end point with its vibration exaggerated, and the arm at some times, in two views.

    Args:
        response: of one set.
        shown: the arm at the times to draw; it has the factor of exaggeration.
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
    """Return an animation of the moving, vibrating arm in two views, one frame for each time of the outline.

    The title says how much slower than the arm the animation is.

    Args:
        response: of one set, for the name of its motion and its vibration.
        shown: the arm at equally spaced moments.
        fps: frames per second.
        dpi: pixels per inch; at 64 a frame takes about 20 kB.
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
    """Return a panel for each view, tall enough for these points [m]."""
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
