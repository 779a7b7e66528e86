"""Pictures of an arm at work: the way of its end point, and the moving arm, its vibration drawn larger than it is."""

from collections.abc import Sequence
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from matplotlib.animation import FuncAnimation
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from ident.arm.arm import Arm
from ident.arm.chain import Loads
from ident.arm.multibody import Multibody
from ident.arm.multibody_kinematics import at_rest, bushings, deviations, kinematics, pins
from ident.arm.rotations import matvec
from ident.errors import InputError, Problem
from ident.jit import jit
from ident.present.figures.style import BLUE, GREY, ORANGE, Style, heading, plain
from ident.present.text.units import MM
from ident.present.text.words import cut
from ident.vibrate.motion.command import command
from ident.vibrate.motion.motion import Motion
from ident.vibrate.response.quasi_static import quasi_static_deflection
from ident.vibrate.response.response import Response

VIEWS = (("from the side", 0, 2), ("from above", 0, 1))
"""Views of the arm: name, horizontal and vertical axis of the base frame."""
WIDTH = 8.0
"""Width of a figure [inch]."""
PALEST = "#C8C8C8"


class Outline(NamedTuple):
    """An arm at some moments, as a line from bushing to bushing and to the end point.

    Attributes:
        time: (F,) [s]
        rest: (3, K, F) [m] where the sagging arm would be.
        drawn: (3, K, F) [m] the arm with its vibration, times the factor.
        factor: () [-] by which the vibration is drawn larger than it is.
    """

    time: Float[np.ndarray, "F"]
    rest: Float[np.ndarray, "3 K F"]
    drawn: Float[np.ndarray, "3 K F"]
    factor: float


def outline(
    arm: Arm, response: Response, times: Sequence[float] | np.ndarray, *, factor: float, loads: Loads | None = None
) -> Outline:
    """Return the arm at some moments of its response, its vibration about the sagging arm made larger.

    Args:
        arm: the arm that was simulated, without sets.
        response: its response.
        times: (F,) [s] moments; the nearest samples are taken.
        factor: () [-] of the vibration, above 0.
        loads: the load case that was simulated.

    Raises:
        InputError: the response is of several sets, a moment is outside it, or the factor can't be.
    """
    clock, asked = np.asarray(response.time), np.asarray(times, float)
    if response.y.ndim > 2:
        raise InputError(Problem("response", f"{response.y.shape[2:]} sets", "one set", "simulate one arm"))
    slack = clock[1] - clock[0]
    if asked.ndim != 1 or not len(asked) or asked.min() < clock[0] - slack or asked.max() > clock[-1] + slack:
        expected = f"moments from {clock[0]:.4g} to {clock[-1]:.4g} s"
        raise InputError(Problem("times", "moments outside the response, or none", expected, "choose others"))
    if not 0 < factor < np.inf:
        raise InputError(Problem("factor", f"{factor:g}", "a factor above 0", "1 draws the vibration as it is"))
    at = np.clip(np.round((asked - clock[0]) / slack).astype(int), 0, len(clock) - 1)
    found = _lines(arm, response.model, response.motion, jnp.asarray(clock[at]), response.y[:, at], loads)
    rest, moved = (np.asarray(line) for line in found)
    return Outline(clock[at], rest, rest + factor * (moved - rest), float(factor))


def path_figure(response: Response, shown: Outline) -> Figure:
    """Draw the way of the end point, its vibration made larger, and the arm at some moments, in two views.

    Args:
        response: of one set.
        shown: the arm at the moments to draw; the factor is taken from it.
    """
    path = np.asarray(response.path + response.quasi_static)
    way = path + shown.factor * np.asarray(response.vibration)
    figure, panels = _panels(np.concatenate([way, shown.rest.reshape(3, -1)], 1))
    for axes, (_, across, up) in zip(panels, VIEWS, strict=True):
        for k in range(len(shown.time)):
            _arm(axes, shown.rest[[across, up], :, k], {"color": PALEST, "linewidth": 2.5})
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


def motion_animation(response: Response, shown: Outline, *, fps: float = 10.0, dpi: float = 64.0) -> FuncAnimation:
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
        rest = axes.plot([], [], color=PALEST, linewidth=4.0, marker="o", markersize=6, solid_joinstyle="round")[0]
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
        axes.set_ylabel(f"{'xyz'[up]} [m]", fontsize=9)
        plain(axes)
    panels[-1].set_xlabel("x [m]", fontsize=9)
    return figure, panels


def _arm(axes: Axes, line: Float[np.ndarray, "2 K"], style: Style) -> None:
    axes.plot(*line, solid_joinstyle="round", marker="o", markersize=5, **style)


@jit
def _lines(
    arm: Arm, machine: Multibody, motion: Motion, times: Float[Array, "F"], y: Array, loads: Loads | None
) -> tuple[Float[Array, "3 K F"], Float[Array, "3 K F"]]:
    """Return bushing centres and end point of the arm at rest in the posture of the moment, and as it vibrates [m]."""
    told = command(machine, motion, times)

    def line(y: Array, error: float) -> Array:
        phi = bushings(machine, y)
        turning = pins(machine, told, at_rest(deviations(machine, y)))
        angle = turning.pin.angle - (1 - error) * turning.error
        at = kinematics(machine, at_rest(angle), phi, jnp.zeros_like(phi), jnp.zeros_like(phi))
        body = machine.carrier[-1]
        end = at.centre[:, body] + matvec(at.link[:, :, body], machine.position[:, -1])
        return jnp.concatenate([at.centre, end[:, None]], 1)

    return line(quasi_static_deflection(arm, machine, told.q, loads), 0.0), line(y, 1.0)
