"""Torque over twist of a joint, measured and by the fitted model."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure

from ident.report.report import cut
from ident.report.style import ORANGE, PALE_BLUE, key_below, lines, plain, titled

if TYPE_CHECKING:
    from ident.identify.joint import JointTwist


def joint_figure(joints: "Sequence[JointTwist]") -> Figure:
    """Draw the twist of each joint over its torque: samples, and the straight line of the stiffness."""
    columns = min(len(joints), 3)
    count = -(-len(joints) // columns)
    figure = titled((3.2 * columns + 1.0, 3.2 * count + 0.6), "Twist of joints over their torque")
    for number, each in enumerate(joints, 1):
        axes = figure.add_subplot(count, columns, number)
        axes.plot(each.torque, 1e3 * each.twist, color=PALE_BLUE, marker=".", markersize=2, linestyle="")
        ends, slope = np.array([each.torque.min(), each.torque.max()]), each.compliance
        for compliance, style in ((slope.value, "-"), (slope.low, "--"), (slope.high, "--")):
            line = each.twist.mean() - compliance * (ends - each.torque.mean())
            axes.plot(ends, 1e3 * line, color=ORANGE, linestyle=style, linewidth=1.2)
        axes.set_title(cut(each.name, 24), fontsize=10, parse_math=False)
        axes.set(xlabel="torque [N m]", ylabel="twist [mrad]")
        plain(axes, grid=True)
    samples = {"color": PALE_BLUE, "marker": ".", "linestyle": ""}
    handles = lines({"samples": samples, "stiffness, with its 95 % interval (broken)": {"color": ORANGE}})
    key_below(figure, handles, "Without zero, delay, friction and the encoder's error.", columns=2)
    return figure
