"""The traces of moving arms beside what the drives make of them, and the order map: what may make a vibration."""

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from ident.present.figures.style import BLUE, GREEN, ORANGE, PALE, PINK, Style, heading, key_below, note, plain, titled
from ident.present.figures.vibration import amplitude_figure
from ident.present.report import cut

if TYPE_CHECKING:
    from ident.assess.balance import Balance, Rotor
    from ident.assess.source import SourceStudy
    from ident.vibrate.orders import Spectrogram
    from ident.vibrate.triage import Finding, Triage

SIZE = (9.0, 5.6)
"""Width and height [inch]."""
LOOK: dict[str, Style] = {
    "drive": {"color": ORANGE, "linestyle": (0, (6, 2))},
    "mode": {"color": GREEN, "linestyle": "-"},
    "kicks": {"color": GREEN, "linestyle": "-"},
    "unexplained": {"color": BLUE, "linestyle": (0, (6, 2, 1.5, 2))},
    "line": {"color": PINK, "linestyle": (0, (1.5, 1.5))},
}
"""Colours and lines by kind; thin for what was compared, thick for what was found."""


def triage_figure(
    triage: "Triage",
    spectrogram: "Spectrogram",
    *,
    trace: int = 0,
    title: str = "What vibrates: order map",
    upto: float = 20.0,
    kind: str = "displacement",
) -> Figure:
    """Draw the amplitude of a trace over time and frequency, with tracks of drives, modes and lines.

    Args:
        triage: what was compared and found.
        spectrogram: of the trace, amplitudes (F, B) [m] or [m/s^2].
        trace: number of the trace.
        title: heading, such as the trace's name and direction.
        upto: [Hz] upper end of the axis.
        kind: `displacement`, drawn in mm, or `acceleration`.
    """
    figure, axes = amplitude_figure(SIZE, spectrogram, title, upto, kind)
    found = {finding.track for finding in triage.findings}
    for number, each in enumerate(triage.hypotheses):
        if each.frequency and (each.kind in ("drive", "mode") or number in found):
            look: Style = {"linewidth": 2.2, "alpha": 1.0} if number in found else {"linewidth": 0.9, "alpha": 0.65}
            axes.plot(triage.time[trace], each.frequency[trace], **LOOK[each.kind], **look)
            _name(axes, triage, number, trace)
    for rank, finding in enumerate(triage.findings, start=1):
        if finding.track is not None and finding.trace == trace:
            _mark(axes, triage, finding, rank)
    key_below(figure, list(_entries(triage)), "\n".join(_notes(triage, spectrogram)), columns=2)
    return figure


def _name(axes: Axes, triage: "Triage", number: int, trace: int) -> None:
    """Write what a track is: a mode at its end, a drive where it is highest, each a bit lower than the one before."""
    each, time = triage.hypotheses[number], triage.time[trace]
    track, top = each.frequency[trace], axes.get_ylim()[1]
    left, right = axes.get_xlim()
    if each.drives:
        k = int(np.where((track <= (0.96 - 0.07 * (number % 4)) * top) & (time < right), track, -1.0).argmax())
        text, align = _drives(each.drives[:1]), "center"
    else:
        k = int(np.flatnonzero(time <= right)[-1])
        text, align = cut(triage.labels[trace][each.mode or 0], 24), "right"
    if each.kind != "line" and 0 < track[k] < 0.97 * top:
        box = {"facecolor": "white", "edgecolor": "none", "alpha": 0.7, "pad": 0.5}
        at = (max(float(time[k]), left), float(track[k]))
        note(axes, text, at, (-2, 2), color=LOOK[each.kind]["color"], bbox=box, ha=align, va="bottom")


def _mark(axes: Axes, triage: "Triage", finding: "Finding", rank: int) -> None:
    """Put the number of a finding where it is strongest."""
    track = triage.hypotheses[finding.track or 0].frequency[finding.trace]
    frequency = float(np.interp(finding.time, triage.time[finding.trace], track))
    box = {"boxstyle": "circle,pad=0.25", "facecolor": "white", "edgecolor": LOOK[finding.kind]["color"]}
    low, high = axes.get_xlim()
    time = min(max(finding.time, low), high)
    note(axes, f"{rank}", (time, frequency), (0, 0), bbox=box, ha="center", va="center", color="black", zorder=6)


def _entries(triage: "Triage") -> Iterator[Line2D]:
    for rank, finding in enumerate(triage.findings, start=1):
        if finding.track is not None:
            yield Line2D([], [], label=f"{rank}: {_words(finding)}", linewidth=2.2, **LOOK[finding.kind])


def _words(finding: "Finding") -> str:
    what = f"line at {finding.frequency[0]:.4g} Hz" if finding.kind == "line" else ", ".join(finding.modes)
    what = _drives(finding.drives) if finding.drives else what
    return f"{cut(what, 44)}, {100 * finding.share:.0f} %" + ("" if finding.told else " (cannot tell)")


def _drives(drives: tuple[tuple[str, float], ...]) -> str:
    return " or ".join(name + (f" x {order:.3g}" if order != 1 else "") for name, order in drives)


def _notes(triage: "Triage", spectrogram: "Spectrogram") -> Iterator[str]:
    yield "tracks: drives broken, modes solid; thick and numbered where strongest: what makes the vibration, its share"
    if any(finding.track is None for finding in triage.findings):
        yield f"unexplained: {100 * triage.findings[-1].share:.0f} %"
    yield spectrogram.description()


# -------- Traces
# Measured and computed.

MOST = 6
"""Traces that are drawn: of more, those of which most is left unexplained."""
MEASURED: Style = {"color": PALE, "linewidth": 1.6}
COMPUTED: Style = {"color": BLUE, "linewidth": 0.8}
LEFT: Style = {"color": ORANGE, "linewidth": 0.6}
UNITS = ((1e3, "mm"), (1e3, "mm/s"), (1.0, "m/s²"))
"""Of displacement, velocity and acceleration: how many in the SI unit, and the unit."""


def source_figure(study: "SourceStudy") -> Figure:
    """Draw measured and computed traces and what is left between them, the slow part left out."""
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
    handles = [
        Line2D([], [], label=label, **style)
        for label, style in (("measured", MEASURED), ("computed", COMPUTED), ("left unexplained", LEFT))
    ]
    which = f" The {MOST} least explained of {len(problem.channels)} traces." if len(problem.channels) > MOST else ""
    key_below(figure, handles, f"Slower than 0.5 Hz left out.{which}", columns=3)
    return figure


# -------- Balance
# The vibration before and after, and each rotor with its imbalance and its masses.


def balance_figure(balance: "Balance") -> Figure:
    """Draw the vibration before and after in the direction of its peak, and the rotors with what is mounted."""
    shown = [each for each in balance.rotors if each.told]
    figure = titled((8.0, 5.4), f"Balancing the drives: {cut(balance.basis.arm.name, 40)}")
    grid = figure.add_gridspec(2, max(3, len(shown)), height_ratios=(1.0, 1.15))
    axes = figure.add_subplot(grid[0, :])
    way = int(np.abs(balance.before).max(1).argmax())
    axes.plot(balance.time, 1e3 * balance.before[way], **MEASURED)
    axes.plot(balance.time, 1e3 * balance.after[way], **COMPUTED)
    axes.set(xlim=(balance.time[0], balance.time[-1]), xlabel="time [s]", ylabel=f"{'xyz'[way]} [mm]")
    plain(axes, grid=True)
    middle, low, high = 100 * balance.left
    heading(axes, f"vibration: {middle:.0f} % is left (95 %: {low:.0f} to {high:.0f} %)", {})
    for number, rotor in enumerate(shown):
        place = figure.add_subplot(grid[1, number], projection="polar")
        _draw_rotor(place, rotor, mounted=rotor.balanced and balance.gains)
    handles = [
        Line2D([], [], label="before", **MEASURED),
        Line2D([], [], label="after (predicted)", **COMPUTED),
        Line2D([], [], label="imbalance, draws", color=ORANGE, marker="o", linestyle="", markersize=4),
        Line2D([], [], label="mass to mount", color=GREEN, marker="s", linestyle="", markersize=6),
    ]
    key_below(figure, handles, "Rotors as seen with the joint's axis pointing at you, joints at 0.", columns=4)
    return figure


def _draw_rotor(axes: Axes, rotor: "Rotor", *, mounted: bool) -> None:
    """Draw a rotor's imbalance [g mm] with its draws, and the masses against it, with the holes."""
    size, pulley = 1e6 * abs(rotor.found), rotor.pulley
    holes = pulley.first + 2 * np.pi * np.arange(pulley.holes) / max(pulley.holes, 1)
    axes.plot(holes, np.full(len(holes), 1.15 * size), color=PALE, marker="o", linestyle="", fillstyle="none")
    axes.plot(np.angle(rotor.draws), 1e6 * np.abs(rotor.draws), color=ORANGE, marker="o", linestyle="", markersize=3)
    axes.plot([0, float(np.angle(rotor.found))], [0, size], color=ORANGE, linewidth=1.0)
    for body in rotor.bodies if mounted else ():
        axes.plot([body.angle], [1.15 * size], color=GREEN, marker="s", markersize=7, linestyle="")
        right, up = np.cos(body.angle), np.sin(body.angle)
        ha = "center" if abs(right) < 0.3 else "right" if right > 0 else "left"
        va = "center" if abs(up) < 0.3 else "top" if up > 0 else "bottom"
        inwards = (-7 * right, -7 * up)  # clear of the square
        note(axes, f"{1e3 * body.mass:.1f} g", (body.angle, 1.15 * size), inwards, ha=ha, va=va, color=GREEN)
    axes.set_ylim(0, 1.35 * size)
    axes.set_yticks([])
    axes.set_xticks(np.pi / 2 * np.arange(4), ["0", "90", "180", "270 deg"], fontsize=7)
    axes.tick_params(pad=-2)
    words = "" if rotor.balanced else f", {rotor.state}"
    axes.set_title(f"{cut(rotor.drive.name, 20)}: {size:.0f} g mm{words}", fontsize=9)
