"""An arm drawn for a window as narrow as a phone's: both views one below the other, the key below them."""

import textwrap

import numpy as np
from matplotlib.figure import Figure

from ident.assess.arm_view import ArmView
from ident.present.figures.arm_drawing import span_of, views
from ident.present.figures.narrow import WIDTH
from ident.present.figures.show import ABOVE, EDGE, Panel, draw_panel, key_of
from ident.present.text.words import cut, degrees

HEAD, KEY, LINE = 0.75, 1.1, 0.17
"""Room for the title, for the key, and for a line of it [inch]."""
BESIDE = 0.1
"""Room on both sides of the arm [inch]."""
TALLEST = 3.0
"""Height of a view of the arm [inch]."""


def narrow_show_figure(view: ArmView) -> Figure:
    """Draw an arm from the side and from above to scale, in the width of a phone; its modes are not drawn."""
    low, high = span_of(view)
    pad = 0.06 * float((high - low).max() or 1.0)
    corners = [np.sort(each.of(np.stack([low - pad, high + pad], 1)), 1) for each in views(view)]
    across, tall = (max(float(corner[i, 1] - corner[i, 0]) for corner in corners) for i in (0, 1))
    scale = min((WIDTH - 2 * EDGE - 2 * BESIDE) / across, TALLEST / tall)
    panels = [
        Panel(each, corner[:, 0], corner[:, 1], scale, (BESIDE, room))
        for each, corner, room in zip(views(view), corners, (ABOVE, BESIDE), strict=True)
    ]
    height = HEAD + KEY + sum(panel.inches[1] + EDGE for panel in panels)
    figure = Figure(figsize=(WIDTH, height))
    title = textwrap.fill(cut(f"{cut(view.arm.name, 40)} at {degrees(view.posture)}", 70), 36)
    figure.text(0.02, 1 - 0.1 / height, title, fontsize=11, fontweight="bold", va="top", parse_math=False)
    top = height - HEAD
    for panel in panels:
        top -= panel.inches[1]
        draw_panel(figure, view, panel, (EDGE + BESIDE, top))
        top -= EDGE
    key_of(figure, view, (0.99, KEY / height), columns=2)
    return figure
