"""Torque over twist of a joint, measured and by the fitted model."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from ident.report.report import cut
from ident.report.style import (
    ORANGE,
    PALE_BLUE,
    key_below,
    plain,
    titled,
)

if TYPE_CHECKING:
    from ident.identify.joint import JointTwist


def joint_figure(joints: "Sequence[JointTwist]") -> Figure:
    """Draw the twist of each joint over its torque: samples, and the straight line of the stiffness."""
    columns = min(len(joints), 3)
    lines = -(-len(joints) // columns)
    figure = titled((3.2 * columns + 1.0, 3.2 * lines + 0.6), "Twist of joints over their torque")
    for number, each in enumerate(joints, 1):
        axes = figure.add_subplot(lines, columns, number)
        axes.plot(each.torque, 1e3 * each.twist, color=PALE_BLUE, marker=".", markersize=2, linestyle="")
        ends = np.array([each.torque.min(), each.torque.max()])
        middle = float(each.torque.mean()), float(each.twist.mean())
        slope = each.compliance
        for compliance, style in ((slope.value, "-"), (slope.low, "--"), (slope.high, "--")):
            line = middle[1] - compliance * (ends - middle[0])
            axes.plot(ends, 1e3 * line, color=ORANGE, linestyle=style, linewidth=1.2)
        axes.set_title(cut(each.name, 24), fontsize=10, parse_math=False)
        axes.set(xlabel="torque [N m]", ylabel="twist [mrad]")
        plain(axes, grid=True)
    samples = Line2D([], [], label="samples", color=PALE_BLUE, marker=".", linestyle="")
    handles = [samples, Line2D([], [], label="stiffness, with its 95 % interval (broken)", color=ORANGE)]
    key_below(figure, handles, "Without zero, delay, friction and the encoder's error.", columns=2)
    return figure
