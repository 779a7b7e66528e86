"""The vibration of the end point along a motion, and the contribution of each drive."""

from collections.abc import Iterator, Mapping
from itertools import cycle

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from ident.report.report import cut
from ident.report.style import (
    BLUE,
    GREEN,
    GREY,
    NEAR,
    ORANGE,
    PALE,
    PALE_BLUE,
    PINK,
    Style,
    as_written,
    key_below,
    note,
    plain,
    titled,
)
from ident.report.words import MM
from ident.studies.basis import motion_title
from ident.studies.working.simulation import Simulation, joined
from ident.vibrate.study import DIRECTIONS

OURS: Style = {"color": BLUE, "linewidth": 1.3}
THEIRS: Style = {"color": ORANGE, "linewidth": 0.8, "zorder": 2.5}
PARTS: tuple[Style, ...] = tuple(
    {"color": color, "linestyle": line, "linewidth": 1.1}
    for color, line in ((BLUE, "-"), (ORANGE, "-"), (GREEN, "--"), (PINK, "-."), (GREY, ":"), ("black", "-"))
)
"""Styles of joints, spans and pulleys; the third differs in its line pattern, as symmetric pulleys coincide."""


def simulate_figure(simulation: Simulation) -> Figure:
    """Draw the vibration of the end point in x, y and z over time, with bands of draws and a measured trace."""
    compared = simulation.comparisons or {}
    figure, grid = _panels(motion_title(f"Vibration of {simulation.point}", simulation.basis), len(DIRECTIONS))
    for i, (axes, direction) in enumerate(zip(grid, DIRECTIONS, strict=True)):
        _direction(axes, simulation, i)
        if direction in compared:  # the measured trace, about the simulation's mean over the common time
            trace, ours = compared[direction].measured.trace, compared[direction].simulated.trace
            factor = 1.0 if _by_acceleration(simulation, direction) else MM
            axes.plot(trace.time, factor * (trace.values + (ours.values.mean() - trace.values.mean())), **THEIRS)
        _arrival(axes, simulation, labelled=i == 0)
    figure.align_ylabels(grid)
    key_below(figure, list(_entries(simulation)), "\n".join(_notes(simulation)))
    return figure


def drives_figure(simulation: Simulation) -> Figure:
    """Draw joint rotations, belt tensions and the pulleys' turning frequencies over time."""
    panels = list(_drive_panels(simulation))
    figure, grid = _panels(motion_title("Joints, belts and pulleys", simulation.basis), len(panels))
    for i, (axes, (label, lines)) in enumerate(zip(grid, panels, strict=True)):
        for (name, values), style in zip(lines.items(), cycle(PARTS), strict=False):
            axes.plot(simulation.time, values, label=cut(name, 24), **style)
        axes.set(ylabel=label)
        key = axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False, fontsize=8)
        as_written(key.get_texts())
        _arrival(axes, simulation, labelled=i == 0)
    notes = ["rotations about the axes of each joint's shaft; the quasi-static deflection is part of them"]
    if simulation.arm.belts and simulation.tension.min() <= 0:
        notes.append("a belt goes slack: see the report")
    figure.align_ylabels(grid)
    key_below(figure, [], "\n".join(notes))
    return figure


def _panels(title: str, count: int) -> tuple[Figure, list[Axes]]:
    figure = titled((8.0, 1.9 * count + 1.2), title, (0.08, 0.05))
    grid = list(figure.subplots(count, 1, squeeze=False, sharex=True)[:, 0])
    for axes in grid:
        plain(axes, grid=True)
    grid[-1].set(xlabel="time [s]")
    return figure, grid


def _by_acceleration(simulation: Simulation, direction: str) -> bool:
    comparison = (simulation.comparisons or {}).get(direction)
    return comparison is not None and comparison.measured.trace.quantity == "acceleration"


def _direction(axes: Axes, simulation: Simulation, i: int) -> None:
    """Draw one direction in mm, or as the measured acceleration."""
    direction = DIRECTIONS[i]
    if _by_acceleration(simulation, direction):
        trace = (simulation.comparisons or {})[direction].simulated.trace
        axes.plot(trace.time, trace.values, zorder=3, **OURS)
        axes.set(ylabel=f"{direction.upper()}: acceleration\n[m/s$^2$]")
        return
    if simulation.phases is not None:
        high = MM * simulation.phases.envelope[i]
        axes.fill_between(simulation.time, -high, high, color=PALE, linewidth=0, zorder=0.5)
    if simulation.draws is not None:
        low, high = MM * simulation.draws.band[:, i]
        axes.fill_between(simulation.time, low, high, color=PALE_BLUE, linewidth=0, zorder=1)
    axes.plot(simulation.time, MM * simulation.vibration[i], zorder=3, **OURS)
    if _near_limit(simulation, i):
        for side in (-1, 1):
            axes.axhline(side * MM * (simulation.limit or 0.0), color=GREY, linewidth=0.8, linestyle=":")
    axes.set(ylabel=f"{direction.upper()}: vibration\n[mm]")


def _near_limit(simulation: Simulation, i: int) -> bool:
    """Whether a direction comes near enough to the limit to draw it; elsewhere it would flatten the curve."""
    sizes = [simulation.sizes.peak[i], *([] if simulation.draws is None else simulation.draws.sizes.peak[i])]
    sizes += [] if simulation.phases is None else [simulation.phases.worst[i]]
    return simulation.limit is not None and bool(max(sizes) > NEAR * simulation.limit)


def _arrival(axes: Axes, simulation: Simulation, *, labelled: bool) -> None:
    """Mark the arrival of the arm, and the start of the late peak's window."""
    marks = [("arrival", simulation.response.motion.arrival)]
    marks += [] if simulation.at is None else [(f"late peak from {simulation.at:g} s on", simulation.at)]
    axes.set(xlim=(simulation.time[0], simulation.time[-1]))
    for name, time in marks:
        if simulation.time[0] < time < simulation.time[-1]:
            axes.axvline(time, color=GREY, linewidth=0.8, linestyle="--", zorder=2)
            if labelled:
                note(axes, name, (time, 1.0), (0, 2), xycoords=axes.get_xaxis_transform(), ha="center")


def _entries(simulation: Simulation) -> Iterator[Line2D | Patch]:
    name = "simulated" if simulation.draws is None else "simulated, by the medians of the draws"
    if simulation.draws is not None and simulation.basis.fit is not None:
        name = "simulated, by the fitted values"
    yield Line2D([], [], label=name, **OURS)
    if simulation.draws is not None:
        yield Patch(color=PALE_BLUE, label=f"5 to 95 % of {simulation.draws.vibration.shape[2]} draws")
    if simulation.phases is not None:
        yield Patch(color=PALE, label="worst case over the imbalance phases")
    if simulation.comparisons:
        yield Line2D([], [], label="measured", **THEIRS)
    if any(_near_limit(simulation, i) for i in range(len(DIRECTIONS))):
        limit = simulation.limit or 0.0
        yield Line2D([], [], color=GREY, linewidth=0.8, linestyle=":", label=f"limit, {MM * limit:g} mm")


def _notes(simulation: Simulation) -> Iterator[str]:
    yield "displacement of the end point from its quasi-static position; scales differ"
    if simulation.comparisons:
        low, high = next(iter(simulation.comparisons.values())).measured.trace.time[[0, -1]]
        yield f"measured: from {low:.4g} to {high:.4g} s, drawn behind, its mean set to the simulation's"
    if any(_by_acceleration(simulation, direction) for direction in DIRECTIONS):
        yield "where an acceleration was measured: the simulated displacement differentiated twice; no bands"


def _drive_panels(simulation: Simulation) -> Iterator[tuple[str, Mapping[str, np.ndarray]]]:
    """Yield label and lines by name of each panel."""
    names = [joint.name for joint in simulation.arm.joints]
    for axis, rotations in zip("xyz", np.degrees(simulation.phi), strict=True):
        yield f"rotation\nabout {axis} [deg]", dict(zip(names, rotations, strict=True))
    if simulation.arm.belts:
        tensions = {
            f"{belt.name}, {span}": simulation.tension[s, b]
            for b, belt in enumerate(simulation.arm.belts)
            for s, span in enumerate(("upper", "lower"))
        }
        yield "belt tension\n[N]", tensions
    if simulation.pulleys:
        yield "pulleys turn\n[Hz]", joined({name: frequency for name, (_, frequency) in simulation.pulleys.items()})
