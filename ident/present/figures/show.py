"""A picture of an arm: from the side and from above to scale, its first modes in place, and what looks odd."""

import textwrap
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from ident.assess.arm_view import ArmView
from ident.identify.modal_analysis import ModalAnalysis
from ident.present.figures.arm_drawing import KEY, View, draw_arm, span_of, views
from ident.present.figures.arm_labels import Mark, label_columns, label_rows
from ident.present.figures.predict import NAME_STYLES, SWING
from ident.present.figures.style import GREY, ORANGE, Style, plain
from ident.present.text.show import sums
from ident.present.text.words import cut, degrees

WIDTH = 11.0
"""Width of the figure [inch]."""
EDGE, HEAD = 0.55, 1.0
"""Margin for ticks, and room for the title [inch]."""
ABOVE, BESIDE = 0.95, 1.75
"""Room for slanted labels above and below, and for columns of labels beside a drawing [inch]."""
LAST = 0.3
"""Room behind the last slanted label, for its words [inch]."""
MODES = 4
"""Modes that are drawn."""
MOST = 8
"""Findings that the picture has room for."""


@dataclass(frozen=True)
class Panel:
    """A view on the figure: what is seen, how large, and the room about it.

    Attributes:
        seen: direction.
        low: (2,) [m] lowest corner of what is drawn.
        high: (2,) [m] highest corner.
        scale: inches a metre.
        room: (2,) [inch] on each side, across and up.
    """

    seen: View
    low: np.ndarray
    high: np.ndarray
    scale: float
    room: tuple[float, float]

    @property
    def inches(self) -> tuple[float, float]:
        """Width and height on the figure."""
        across, up = (self.high - self.low) * self.scale
        return float(across) + 2 * self.room[0], float(up) + 2 * self.room[1]

    def place(self, figure: Figure, at: tuple[float, float]) -> Axes:
        """Return axes at a place [inch] of the figure, to scale."""
        width, height = figure.get_size_inches()
        own = self.inches
        axes = figure.add_axes((at[0] / width, at[1] / height, own[0] / width, own[1] / height))
        room = np.array(self.room) / self.scale
        (left, bottom), (right, top) = self.low - room, self.high + room
        axes.set(xlim=(left, right), ylim=(bottom, top))
        return axes


def show_figure(view: ArmView, *, modes: bool = True) -> Figure:
    """Draw an arm from the side and from above to scale, and say what looks odd.

    Args:
        view: the arm.
        modes: whether its first modes are drawn below, over the arm at rest.
    """
    side, above = panels(view)
    stacked = side.room[1] > side.room[0]
    words = textwrap.wrap(sums(view), 125)
    found = _findings(view)
    room, below = (1.85 if view.analysis and modes else 0.0), 0.45 + 0.17 * len(found)
    tall = side.inches[1] + above.inches[1] + EDGE if stacked else max(side.inches[1], above.inches[1])
    figure = Figure(figsize=(WIDTH, HEAD + tall + EDGE + room + below))
    height = float(figure.get_size_inches()[1])
    title = cut(f"{cut(view.arm.name, 40)} at {degrees(view.posture)}", 58)
    figure.text(0.02, 1 - 0.3 / height, title, fontsize=12, fontweight="bold", parse_math=False)
    figure.text(0.02, 1 - 0.55 / height, "\n".join(words), fontsize=9, color=GREY, va="top", parse_math=False)
    top, left = height - HEAD, EDGE + 0.25
    draw_panel(figure, view, side, (left, top - side.inches[1]))
    at = (left, top - tall) if stacked else (WIDTH - above.inches[0] - 0.3, top - above.inches[1])
    draw_panel(figure, view, above, at)
    if view.analysis and modes:
        _draw_modes(figure, view.analysis, views(view), top - tall - EDGE, room)
    for i, line in enumerate(found):
        colour = ORANGE if view.oddities or view.failure else GREY
        figure.text(0.02, (below - 0.3 - 0.17 * i) / height, line, fontsize=9, color=colour, parse_math=False)
    key_of(figure, view, (0.995, 1 - 0.05 / height))
    return figure


def panels(view: ArmView) -> tuple[Panel, Panel]:
    """Return the side view and the view from above, one below the other for a flat arm, else side by side."""
    seen = views(view)
    low, high = span_of(view)
    pad = 0.06 * float((high - low).max() or 1.0)
    corners = [np.sort(each.of(np.stack([low - pad, high + pad], 1)), 1) for each in seen]
    side, above = (corner[:, 1] - corner[:, 0] for corner in corners)
    wide = float(side[0])
    if side[1] < 0.6 * wide:
        scale = min((WIDTH - 2 * EDGE - 1.2) / wide, 6.0 / float(side[1] + above[1]))
        rooms = ((0.35, ABOVE), (0.35, 0.05))
    else:
        scale = min((WIDTH - 3 * EDGE - 2 * BESIDE) / (2 * wide), 5.0 / float(max(side[1], above[1])))
        rooms = ((BESIDE, 0.15), (0.1, 0.15))
    first, second = (
        Panel(each, corner[:, 0], corner[:, 1], scale, room)
        for each, corner, room in zip(seen, corners, rooms, strict=True)
    )
    return first, second


def draw_panel(figure: Figure, view: ArmView, panel: Panel, at: tuple[float, float]) -> None:
    """Draw a view; bodies, joints and points are named where there is room for it."""
    axes = panel.place(figure, at)
    draw_arm(axes, view, panel.seen, float((panel.high - panel.low).max()))
    names = "xyz"
    for axis, place, low, high in (
        (axes.xaxis, panel.seen.across, panel.low[0], panel.high[0]),
        (axes.yaxis, panel.seen.up, panel.low[1], panel.high[1]),
    ):
        ticks = [
            tick
            for tick in MaxNLocator(_few(panel.scale * (high - low)), steps=[1, 2, 5, 10]).tick_values(low, high)
            if low <= tick <= high
        ]
        down = panel.seen.falling and place == panel.seen.up
        axis.set_ticks(ticks, [f"{-tick + 0.0 if down else tick:.3g}" for tick in ticks])
        axis.set_label_text(f"{names[place]} [m]", fontsize=8)
    axes.set_title(panel.seen.name, fontsize=9, loc="left", color=GREY)
    plain(axes)
    axes.spines["left"].set_bounds(float(panel.low[1]), float(panel.high[1]))
    axes.spines["bottom"].set_bounds(float(panel.low[0]), float(panel.high[0]))
    odd = {each.path.partition(".")[0] for each in view.oddities}
    bodies = [Mark(f"{s.name} {s.mass:.3g} kg", panel.seen.of(s.centre), s.name in odd) for s in view.solids]
    others = [Mark(hinge.name, panel.seen.of(hinge.centre), hinge.name in odd) for hinge in view.hinges]
    others += [Mark(name, panel.seen.of(place), name in odd) for name, place in view.points.items()]
    if panel.room[0] > 1:
        within = float(panel.low[1]), float(panel.high[1])
        label_columns(axes, bodies, panel.high[0], panel.scale, within, left=False)
        label_columns(axes, others, panel.low[0], panel.scale, within, left=True)
    elif panel.room[1] > 0.5:
        within = float(panel.low[0]), float(panel.high[0]) - LAST / panel.scale
        label_rows(axes, bodies, panel.high[1], panel.scale, within, up=True)
        label_rows(axes, others, panel.low[1], panel.scale, within, up=False)


def _few(length: float) -> int:
    """Return how many ticks at most stand on an axis of a length [inch]."""
    return int(np.clip(length / 0.3, 2, 6))


def _draw_modes(figure: Figure, analysis: ModalAnalysis, seen: tuple[View, View], top: float, room: float) -> None:
    """Draw the first modes over the arm at rest, below a height of the figure [inch]."""
    count = min(MODES, len(analysis.labels))
    width, height = figure.get_size_inches()
    step = (WIDTH - 0.5) / count
    for i in range(count):
        place = (0.3 + i * step) / width, (top - room + 0.3) / height, (step - 0.2) / width, 1.2 / height
        _draw_mode(figure.add_axes(place), analysis, i, seen)


def _draw_mode(axes: Axes, analysis: ModalAnalysis, i: int, views: tuple[View, View]) -> None:
    """Draw a mode in the view in which it moves most, the other end of its swing paler."""
    rest, moved = analysis.outline
    length = float(np.linalg.norm(np.diff(rest, axis=1), axis=0).sum())
    swing = SWING * length * moved[:, :, i] / np.linalg.norm(moved[:, :, i], axis=0).max()
    motion = [float(np.linalg.norm(each.of(swing))) for each in views]
    seen = views[int(np.argmax(motion))]
    label = analysis.labels[i]
    colour = NAME_STYLES[f"{label.direction} {label.kind}"]["color"]
    axes.plot(*seen.of(rest), color="#C8C8C8", linewidth=4, marker="o", markersize=5)
    axes.plot(*seen.of(rest - swing), color=colour, linewidth=1.0, alpha=0.35)
    axes.plot(*seen.of(rest + swing), color=colour, linewidth=2.0, marker="o", markersize=4)
    axes.set_aspect("equal", adjustable="datalim")
    axes.margins(0.1, 0.15)
    axes.set_axis_off()
    name = f"{i + 1}: {analysis.modes.frequency[i]:.2f} Hz, {label}\n{seen.name}"
    axes.set_title(name, fontsize=8.5, loc="left", color="black")


def _findings(view: ArmView) -> list[str]:
    """Return what looks odd, folded."""
    found = [f"no modes: {view.failure}"] if view.failure else []
    found += [str(odd) for odd in view.oddities]
    more = [f"and {len(found) - MOST} more, in the report"] if len(found) > MOST else []
    lines = [line for each in (*found[:MOST], *more) for line in textwrap.wrap(each, 150, subsequent_indent="    ")]
    return ["What looks odd", *lines] if found else ["Nothing looks odd."]


def key_of(figure: Figure, view: ArmView, at: tuple[float, float]) -> None:
    """Explain the signs that occur; `at` is the key's upper right corner as shares of the figure."""
    kinds = {solid.kind for solid in view.solids}
    there = {
        "bushing alone": any(not hinge.driven for hinge in view.hinges),
        "drive": bool(view.drives),
        "belt": bool(view.belts),
        "point": bool(view.points),
        "dashed: box of the same inertia": any(not solid.shaped for solid in view.solids),
        **{kind: kind in kinds for kind in ("shaft", "link", "payload")},
    }
    entries: Mapping[str, Style] = {name: style for name, style in KEY.items() if there.get(name, True)}
    handles = [Line2D([], [], **{"label": name, "linestyle": "", **style}) for name, style in entries.items()]
    figure.legend(
        handles=handles,
        loc="upper right",
        bbox_to_anchor=at,
        ncols=5,
        frameon=False,
        fontsize=7.5,
        columnspacing=1.0,
        handletextpad=0.4,
    )
