"""Each rotor with its imbalance and its balancing masses."""

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ident.report.report import cut
from ident.report.style import GREEN, ORANGE, PALE, Style, heading, key_below, lines, note, plain, titled
from ident.studies.cause.source_figure import COMPUTED, MEASURED

if TYPE_CHECKING:
    from ident.studies.cure.balance_study import Balance, Rotor


def balance_figure(balance: "Balance") -> Figure:
    """Draw the vibration before and after in the direction of its peak, and the rotors with their masses."""
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
    draws: Style = {"color": ORANGE, "marker": "o", "linestyle": "", "markersize": 4}
    mass: Style = {"color": GREEN, "marker": "s", "linestyle": "", "markersize": 6}
    entries = {"before": MEASURED, "after (predicted)": COMPUTED, "imbalance, draws": draws, "mass to mount": mass}
    key_below(figure, lines(entries), "Rotors as seen with the joint's axis pointing at you, joints at 0.")
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
