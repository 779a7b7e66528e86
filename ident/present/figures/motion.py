"""Figure of motions along a path: where the speeds meet resonances, and what vibration they make."""

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from ident.present.figures.style import BLUE, GREY, ORANGE, Style, key_below, motion_title, plain, titled
from ident.present.words import MM

if TYPE_CHECKING:
    from ident.assess.motion import MotionStudy

BEFORE: Style = {"color": GREY, "linewidth": 1.0}
AFTER: Style = {"color": BLUE, "linewidth": 1.5}
MODES: tuple[Style, ...] = ({"color": ORANGE, "linewidth": 1.0}, {"color": ORANGE, "linewidth": 1.0, "linestyle": "--"})
LIMIT: Style = {"color": "black", "linewidth": 0.9, "linestyle": ":"}


def motion_figure(motions: "MotionStudy") -> Figure:
    """Draw the speed over the path with the speeds at which pulleys meet modes; below, the vibration over time."""
    scheduling = motions.scheduling
    figure = titled((8.0, 7.0), motion_title("Speed along the path", motions.basis), (0.08, 0.1))
    top, below = figure.subplots(2, 1)
    direction = np.asarray(scheduling.stroke.direction, float)
    highest = 0.0
    for candidate, style in ((motions.candidates[0], BEFORE), (motions.candidates[-1], AFTER)):
        time = np.linspace(0.0, candidate.motion.arrival, 1001)
        q, qd, _ = (np.asarray(part) for part in candidate.motion(time))
        alpha, rate = (np.degrees(direction @ part) / (direction @ direction) for part in (q, qd))
        top.plot(alpha, np.abs(rate), **style)
        highest = max(highest, float(np.abs(rate).max()))
    along = np.linspace(scheduling.places[0], scheduling.places[-1], 101)
    for order in scheduling.orders():
        for frequencies, style in zip(scheduling.frequencies(along), MODES, strict=True):
            speeds = np.degrees(frequencies / order)
            top.plot(np.degrees(along), np.where(speeds < 1.3 * highest, speeds, np.nan), **style)
    for whole, style in ((motions.before, BEFORE), (motions.after, AFTER)):
        below.plot(whole.time, MM * whole.envelope.max(0), **style)
    below.axhline(MM * motions.limit, **LIMIT)
    for axes in (top, below):
        plain(axes, grid=True)
        axes.set_ylim(bottom=0)
    top.set_xlim(np.degrees(along[[0, -1]]))
    top.set_xlabel("alpha along the stroke [deg]", fontsize=9)
    top.set_ylabel("speed of alpha [deg/s]", fontsize=9)
    below.set_xlim(left=0)
    below.set_xlabel("time [s]", fontsize=9)
    below.set_ylabel("largest vibration over the phases [mm]", fontsize=9)
    handles = [
        Line2D([], [], label="as it is", **BEFORE),
        Line2D([], [], label="speed along the path", **AFTER),
        Line2D([], [], label="a pulley meets mode 1", **MODES[0]),
        Line2D([], [], label="mode 2", **MODES[1]),
        Line2D([], [], label=f"limit, {MM * motions.limit:g} mm", **LIMIT),
    ]
    key_below(figure, handles, "fast method; largest of X, Y, Z", columns=5)
    return figure
