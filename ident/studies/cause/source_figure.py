"""Traces of a moving arm, measured and computed from the identified sources."""

from typing import TYPE_CHECKING

from matplotlib.figure import Figure

from ident.report.report import cut
from ident.report.style import BLUE, ORANGE, PALE, Style, heading, key_below, lines, plain, titled

if TYPE_CHECKING:
    from ident.studies.cause.source_study import SourceStudy

SIZE = (9.0, 5.6)
"""Width and height [inch]."""
MOST = 6
"""Traces drawn at most: those with the largest unexplained share."""
MEASURED: Style = {"color": PALE, "linewidth": 1.6}
COMPUTED: Style = {"color": BLUE, "linewidth": 0.8}
LEFT: Style = {"color": ORANGE, "linewidth": 0.6}
UNITS = ((1e3, "mm"), (1e3, "mm/s"), (1.0, "m/s²"))
"""For displacement, velocity and acceleration: display units per SI unit, and the unit."""


def source_figure(study: "SourceStudy") -> Figure:
    """Draw measured and computed traces and their residuals, without the slow part."""
    found = study.found
    problem, order = found.problem, found.explained.argsort()[:MOST]
    figure = titled((8.0, 1.6 + 1.5 * len(order)), f"Vibration explained by the drives: {cut(problem.arm.name, 40)}")
    grid = figure.subplots(len(order), 1, squeeze=False)[:, 0]
    for axes, number in zip(grid, sorted(order.tolist()), strict=True):
        channel = problem.channels[number]
        size, unit = UNITS[problem.runs[channel.run].sensors[channel.sensor].derivative]
        shown, left = size * found.shown[number], size * found.residual[number]
        axes.plot(channel.time, shown, **MEASURED)
        axes.plot(channel.time, shown - left, **COMPUTED)
        axes.plot(channel.time, left, **LEFT)
        axes.set(xlim=(channel.time[0], channel.time[-1]), ylabel=unit)
        plain(axes, grid=True)
        heading(axes, f"{cut(channel.name, 60)}: {100 * found.explained[number]:.1f} % explained", {})
    grid[-1].set_xlabel("time from the start of the motion [s]", fontsize=9)
    handles = lines({"measured": MEASURED, "computed": COMPUTED, "left unexplained": LEFT})
    which = f" The {MOST} least explained of {len(problem.channels)} traces." if len(problem.channels) > MOST else ""
    key_below(figure, handles, f"Slower than 0.5 Hz left out.{which}", columns=3)
    return figure
