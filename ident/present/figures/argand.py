"""Figure of a posture's mode shapes in the complex plane: arrows in phase lie along one line."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Ellipse

from ident.assess.identified_modes import IdentifiedModes
from ident.modal.ambient_test import AmbientTest
from ident.modal.complexity import PhasePlane, phase_planes
from ident.modal.frf import Place
from ident.modal.modal_test import ModalTest
from ident.present.figures.style import BLUE, GREY, ORANGE, PINK, key_below, plain, titled
from ident.present.text.places import place_in_words
from ident.present.text.words import cut, degrees

COLUMNS, ARGAND_PANEL = 4, 2.5
"""Modes in a row, and size of each [inch]."""
DIRECTION_COLORS = (BLUE, ORANGE, PINK, GREY)
"""Of the directions at a point, in their order."""
ENDS = "os^Dv"
"""Ends of arrows, one a point."""
WITHIN = 2.4477
"""Half axes of an ellipse that holds 95 %, in standard deviations."""


def argand_figure(test: ModalTest | AmbientTest, identified: IdentifiedModes) -> Figure:
    """Draw each mode's motion at the responses as arrows in the complex plane, with ellipses that hold 95 %."""
    planes = phase_planes(identified.modes)
    columns = min(COLUMNS, len(planes))
    rows = -(-len(planes) // columns)
    figure = titled(
        (ARGAND_PANEL * max(columns, 3) + 0.4, ARGAND_PANEL * 1.15 * rows + 1.5),
        f"Mode shapes at {degrees(test.posture)}",
    )
    panels = figure.subplots(rows, columns, squeeze=False).ravel()
    looks = _looks(test.responses)
    for axes, plane, frequency, label in zip(
        panels, planes, identified.modes.frequency, identified.labels.given, strict=False
    ):
        _panel(axes, plane, looks)
        name = cut(str(label), 24) if label else "no certain name"
        title = f"{frequency:.2f} Hz, {name}\ncollinearity {plane.collinearity:.3f}"
        axes.set_title(title, fontsize=8, loc="left", parse_math=False)
    for axes in panels[len(planes) :]:
        axes.set_visible(False)
    handles = [
        Line2D([], [], color=color, marker=end, markersize=4, label=place_in_words(place))
        for place, (color, end) in zip(test.responses, looks, strict=True)
    ]
    note = "turned to the real axis and scaled to one at the largest; ellipses hold 95 %"
    key_below(figure, handles, note, columns=6)
    return figure


def _panel(axes: Axes, plane: PhasePlane, looks: Sequence[tuple[str, str]]) -> None:
    for motion, covariance, (color, end) in zip(plane.shape, plane.covariance, looks, strict=True):
        axes.plot([0, motion.real], [0, motion.imag], color=color, linewidth=1.2, marker=end, markevery=[1], ms=4)
        variances, axis = np.linalg.eigh(covariance)
        width, height = 2 * WITHIN * np.sqrt(np.maximum(variances, 0.0))
        angle = float(np.degrees(np.arctan2(axis[1, 0], axis[0, 0])))
        centre = (float(motion.real), float(motion.imag))
        axes.add_patch(Ellipse(centre, float(width), float(height), angle=angle, fill=False, color=color, lw=0.8))
    axes.axhline(0, color=GREY, linewidth=0.5, zorder=0)
    axes.axvline(0, color=GREY, linewidth=0.5, zorder=0)
    axes.set_xlim(-1.2, 1.2)
    axes.set_ylim(-1.2, 1.2)
    axes.set_aspect("equal")
    plain(axes)
    axes.tick_params(labelsize=7)


def _looks(places: Sequence[Place]) -> list[tuple[str, str]]:
    """Return colour and end of each response."""
    points = list(dict.fromkeys(place.point for place in places))
    nth = [sum(other.point == place.point for other in places[:o]) for o, place in enumerate(places)]
    ends = [ENDS[points.index(place.point) % len(ENDS)] for place in places]
    return [(DIRECTION_COLORS[n % len(DIRECTION_COLORS)], end) for n, end in zip(nth, ends, strict=True)]
