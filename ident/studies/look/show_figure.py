"""A picture of an arm: from the side and from above to scale, its first modes in place, and implausible numbers."""

import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, Polygon
from matplotlib.ticker import MaxNLocator
from scipy.optimize import isotonic_regression
from scipy.spatial import ConvexHull, QhullError

from ident.report.report import cut
from ident.report.style import BLUE, GREEN, GREY, ORANGE, PINK, Style, colour_of, note, plain
from ident.report.words import degrees
from ident.studies.look.predict_figure import swing_of
from ident.studies.look.show_report import sums

if TYPE_CHECKING:
    from ident.identify.modal_analysis import ModalAnalysis
    from ident.studies.look.arm_view import ArmView, Hinge, Run, Solid

# -------- Arm drawing
# One view of an arm to scale: bodies with mass centres, joints, points, drives and belts, frames.

COLORS = {"shaft": "#8A96A0", "link": "#A8D0E8", "payload": "#F4C08A"}
HEAVIEST = 11.0
"""Diameter of the heaviest body's mass centre [pt]; the others' areas are in proportion."""
BASE = "#5B3A8E"
"""Colour of the base frame."""
TOWARDS = 0.95
"""Cosine from which a direction counts as pointing at the viewer."""
KEY: dict[str, Style] = {
    "bushing with pin": {"marker": "o", "color": BLUE, "markersize": 6, "markerfacecolor": "white"},
    "bushing alone": {"marker": "s", "color": BLUE, "markersize": 6, "markerfacecolor": "white"},
    "mass centre, area as mass": {"marker": "o", "color": "black", "markersize": 6},
    "point": {"marker": "^", "color": GREEN, "markersize": 7},
    "link": {"marker": "s", "color": COLORS["link"], "markersize": 9},
    "shaft": {"marker": "s", "color": COLORS["shaft"], "markersize": 9},
    "payload": {"marker": "s", "color": COLORS["payload"], "markersize": 9},
    "drive": {"marker": "D", "color": PINK, "markersize": 8, "markerfacecolor": "none"},
    "belt": {"color": PINK, "linestyle": "-", "linewidth": 1.4},
    "dashed: box of the same inertia": {"color": GREY, "linestyle": "--", "linewidth": 0.8},
}
"""Meaning of the signs."""


@dataclass(frozen=True)
class View:
    """A direction of view, and the visible axes.

    Attributes:
        name: `from the side`, `from above`.
        across: index of the base frame's axis that points right.
        up: index of the axis that points up, or down if `falling`.
        falling: whether that axis points down.
    """

    name: str
    across: int
    up: int
    falling: bool = False

    def of(self, places: np.ndarray) -> np.ndarray:
        """Return positions (3, ...) projected to the view (2, ...) [m]."""
        return np.stack([places[self.across], -places[self.up] if self.falling else places[self.up]])

    @property
    def normal(self) -> int:
        """Index of the axis along the line of sight."""
        return 3 - self.across - self.up


def views(view: "ArmView") -> tuple[View, View]:
    """Return the side view, along the longer horizontal axis, and the view from above."""
    low, high = span_of(view)
    wide = (high - low)[:2]
    if wide[1] > 1.05 * wide[0]:
        return View("from the front", 1, 2), View("from above", 1, 0, falling=True)
    return View("from the side", 0, 2), View("from above", 0, 1)


def most_seen(views: Sequence[View], swing: np.ndarray) -> View:
    """Return the view in which a mode moves most."""
    return max(views, key=lambda each: float(np.linalg.norm(each.of(swing))))


def span_of(view: "ArmView") -> tuple[np.ndarray, np.ndarray]:
    """Return the lowest and highest corner (3,) [m] of everything drawn."""
    places = [*(s.corners for s in view.solids), *(h.centre[:, None] for h in view.hinges), np.zeros((3, 1))]
    every = np.concatenate([*places, *(p[:, None] for p in view.points.values())], 1)
    return every.min(1), every.max(1)


def draw_arm(axes: Axes, view: "ArmView", seen: View, size: float) -> None:
    """Draw an arm in a view; `size` [m] is that of the whole picture."""
    heaviest = max((solid.mass for solid in view.solids), default=0.0) or 1.0
    for solid in sorted(view.solids, key=lambda each: each.kind != "payload"):
        draw_solid(axes, solid, seen)
    axes.plot(*seen.of(view.line()), color="#5F6B75", linewidth=1.4, zorder=3)
    for belt in view.belts:
        _draw_belt(axes, belt, seen)
    for hinge in view.hinges:
        _draw_hinge(axes, hinge, seen, size)
    for solid in view.solids:
        diameter = max(HEAVIEST * np.sqrt(solid.mass / heaviest), 2.0)
        axes.plot(*seen.of(solid.centre), marker="o", color="black", markersize=diameter, alpha=0.75, zorder=5)
    for place in view.drives.values():
        axes.plot(*seen.of(place), linestyle="", **{**KEY["drive"], "markersize": 11, "zorder": 6})
    for place in view.points.values():
        axes.plot(*seen.of(place), linestyle="", zorder=7, **KEY["point"])
    draw_frame(axes, np.zeros(3), np.eye(3), seen, 0.07 * size, named=BASE)


def draw_solid(axes: Axes, solid: "Solid", seen: View) -> None:
    """Draw the outline of a body's box, dashed where only its inertia is known."""
    corners = seen.of(solid.corners).T
    try:
        outline = corners[ConvexHull(corners).vertices]
    except QhullError:  # a plate seen edge-on
        outline = corners[[np.argmin(corners.sum(1)), np.argmax(corners.sum(1))]]
    line = "-" if solid.shaped else "--"
    patch = Polygon(outline, facecolor=COLORS[solid.kind], edgecolor=GREY, linewidth=0.8, linestyle=line)
    patch.set(alpha=0.55 if solid.kind != "payload" else 0.4, zorder=2 if solid.kind == "shaft" else 1)
    axes.add_patch(patch)


def _draw_hinge(axes: Axes, hinge: "Hinge", seen: View, size: float) -> None:
    style = KEY["bushing with pin" if hinge.driven else "bushing alone"]
    axes.plot(*seen.of(hinge.centre), linestyle="", zorder=6, **style)
    if hinge.driven and abs(hinge.axis[seen.normal]) < TOWARDS:
        ends = hinge.centre[:, None] + 0.035 * size * np.outer(hinge.axis, (-1, 1))
        axes.plot(*seen.of(ends), color=BLUE, linewidth=2.2, zorder=4, solid_capstyle="butt")
    elif hinge.driven:
        axes.plot(*seen.of(hinge.centre), marker=".", color=BLUE, markersize=3, zorder=6)
    draw_frame(axes, hinge.centre, hinge.frame, seen, 0.03 * size, named="")


def _draw_belt(axes: Axes, belt: "Run", seen: View) -> None:
    """Draw both spans around the pulleys if these appear as circles, else the plane of the belt as a line."""
    ends = seen.of(belt.ends)
    along = ends[:, 1] - ends[:, 0]
    length = float(np.linalg.norm(along))
    if not length:
        return
    flat = np.ptp(belt.ends[seen.normal]) > 1e-6 or seen.name != "from above"
    across = np.zeros(2) if flat else np.array([-along[1], along[0]]) / length
    for sign in (-1, 1):
        axes.plot(*(ends + sign * across[:, None] * belt.radii), color=PINK, linewidth=1.2, zorder=4)
    for centre, radius in zip(ends.T, belt.radii, strict=True) if not flat else ():
        axes.add_patch(Circle(tuple(centre), float(radius), fill=False, edgecolor=PINK, linewidth=1.2, zorder=4))


def draw_frame(axes: Axes, origin: np.ndarray, frame: np.ndarray, seen: View, size: float, *, named: str) -> None:
    """Draw the axes of a frame that are not seen end-on, as arrows with letters in a colour if it is named."""
    for place, letter in enumerate("xyz"):
        start, end = (seen.of(each) for each in (origin, origin + size * frame[:, place]))
        if abs(frame[seen.normal, place]) > TOWARDS:
            continue
        if named:
            off = 6 * (end - start) / max(float(np.linalg.norm(end - start)), 1e-12)
            note(axes, letter, tuple(end), tuple(off), color=named, ha="center", va="center")
            arrow = {"arrowstyle": "-|>", "color": named, "linewidth": 1.4, "shrinkA": 0, "shrinkB": 0}
            axes.annotate("", tuple(end), tuple(start), arrowprops=arrow, zorder=6)
        else:
            axes.plot(*zip(start, end, strict=True), color="#9C8FA8", linewidth=1.0, zorder=6)


# -------- Arm labels
# Labels next to a drawing, with lines to their objects, without overlap.

PITCH, SLANTED = 0.19, 0.3
"""Least distance between labels [inch]: of lines in a column, and of slanted ones in a row."""
LEADER: Style = {"color": "#9A9A9A", "linewidth": 0.6}


@dataclass(frozen=True)
class Mark:
    """The object of a label.

    Attributes:
        words: the label.
        place: (2,) [m] in the view.
        odd: whether it is implausible.
    """

    words: str
    place: np.ndarray
    odd: bool

    @property
    def color(self) -> str:
        """Colour of the label."""
        return ORANGE if self.odd else "black"


def spread(places: Sequence[float], pitch: float, low: float, high: float) -> np.ndarray:
    """Return places in the same order, at least a pitch apart, within bounds, as close as possible to the given ones.

    Places minus rank times pitch must not decrease: the nearest such values are their isotonic regression, clipped
    (Barlow, Bartholomew, Bremner, Brunk, "Statistical inference under order restrictions", 1972).

    Raises:
        ValueError: not enough room.
    """
    last = high - pitch * (len(places) - 1)
    if not places:
        return np.zeros(0)
    if last < low - 1e-9 * pitch:
        raise ValueError(f"no room for {len(places)} labels")
    order, steps = np.argsort(places, kind="stable"), pitch * np.arange(len(places))
    found = np.empty(len(places))
    found[order] = np.clip(isotonic_regression(np.asarray(places)[order] - steps).x, low, max(last, low)) + steps
    return found


def fitting(marks: Sequence[Mark], room: float, pitch: float) -> list[Mark]:
    """Return as many marks as fit, implausible ones first."""
    count = int(room / pitch + 1e-9) + 1
    kept = sorted(range(len(marks)), key=lambda i: (not marks[i].odd, i))[:count]
    return [marks[i] for i in sorted(kept)]


def label(axes: Axes, marks: Sequence[Mark], panel: "Panel", along: int, sign: int) -> None:
    """Write labels next to a drawing: slanted ones below or above it, or in a column left or right of it.

    Args:
        axes: of the drawing.
        marks: objects to label, as far as there is room.
        panel: the view.
        along: index of the axis along which labels are placed: 0 for a row, 1 for a column.
        sign: -1 for below or left, 1 for above or right.
    """
    start, end = float(panel.low[along]), float(panel.high[along]) - (0 if along else LAST / panel.scale)
    level, pitch = (panel.low, panel.high)[sign > 0][1 - along], (SLANTED, PITCH)[along] / panel.scale
    marks = fitting(marks, end - start, pitch)
    style: dict[str, Any] = {"fontsize": 8, "va": "center", "parse_math": False}
    style |= {"ha": "right" if along and sign < 0 else "left", "rotation": 0 if along else 32 * sign}
    for mark, place in zip(marks, spread([float(mark.place[along]) for mark in marks], pitch, start, end), strict=True):
        foot, at = np.array([place, level]), np.array([place, level + sign * 0.045 / panel.scale])
        axes.plot(*np.stack([mark.place, foot[::-1] if along else foot], 1), zorder=3, **LEADER)
        x, y = at[::-1] if along else at
        axes.text(x, y, cut(mark.words, 27), color=mark.color, rotation_mode="anchor", **style)


# -------- Show

WIDTH = 11.0
"""Width of the figure [inch]."""
EDGE, HEAD = 0.55, 1.0
"""Margin for ticks, and room for the title [inch]."""
ABOVE, BESIDE = 0.95, 1.75
"""Room for slanted labels above and below, and for label columns next to a drawing [inch]."""
LAST = 0.3
"""Room behind the last slanted label, for its words [inch]."""
MODES = 4
"""Modes drawn."""
MOST = 8
"""Findings listed in the picture at most."""


@dataclass(frozen=True)
class Panel:
    """A view in the figure: its content, scale, and margins.

    Attributes:
        seen: direction of view.
        low: (2,) [m] lowest corner of the content.
        high: (2,) [m] highest corner.
        scale: inches per metre.
        room: (2,) [inch] margin on each side, across and up.
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
        """Return axes at a position [inch] of the figure, to scale."""
        width, height = figure.get_size_inches()
        own = self.inches
        axes = figure.add_axes((at[0] / width, at[1] / height, own[0] / width, own[1] / height))
        room = np.array(self.room) / self.scale
        (left, bottom), (right, top) = self.low - room, self.high + room
        axes.set(xlim=(left, right), ylim=(bottom, top))
        return axes


def show_figure(view: "ArmView", *, modes: bool = True) -> Figure:
    """Draw an arm from the side and from above to scale, with its implausible numbers.

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
        count = min(MODES, len(view.analysis.labels))
        step, below_them = (WIDTH - 0.5) / count, top - tall - EDGE - room
        for i in range(count):
            place = (0.3 + i * step) / WIDTH, (below_them + 0.3) / height, (step - 0.2) / WIDTH, 1.2 / height
            _draw_mode(figure.add_axes(place), view.analysis, i, views(view))
    look: Style = {"color": ORANGE if view.oddities or view.failure else GREY, "va": "top", "fontsize": 9}
    figure.text(0.02, (below - 0.17) / height, "\n".join(found), parse_math=False, **look)
    key_of(figure, view, (0.995, 1 - 0.05 / height))
    return figure


def panels(view: "ArmView") -> tuple[Panel, Panel]:
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
    parts = zip(seen, corners, rooms, strict=True)
    first, second = (Panel(each, ends[:, 0], ends[:, 1], scale, room) for each, ends, room in parts)
    return first, second


def draw_panel(figure: Figure, view: "ArmView", panel: Panel, at: tuple[float, float]) -> None:
    """Draw a view; bodies, joints and points are named where they fit."""
    axes = panel.place(figure, at)
    plain(axes)
    draw_arm(axes, view, panel.seen, float((panel.high - panel.low).max()))
    places = panel.seen.across, panel.seen.up
    for axis, place, low, high in zip((axes.xaxis, axes.yaxis), places, panel.low, panel.high, strict=True):
        few = int(np.clip(panel.scale * (high - low) / 0.3, 2, 6))
        ticks = MaxNLocator(few, steps=[1, 2, 5, 10]).tick_values(low, high)
        ticks = ticks[(low <= ticks) & (ticks <= high)]
        down = panel.seen.falling and place == panel.seen.up
        axis.set_ticks(ticks, [f"{-tick + 0.0 if down else tick:.3g}" for tick in ticks])
        axis.set_label_text(f"{'xyz'[place]} [m]", fontsize=8)
    axes.set_title(panel.seen.name, fontsize=9, loc="left", color=GREY)
    axes.spines["left"].set_bounds(float(panel.low[1]), float(panel.high[1]))
    axes.spines["bottom"].set_bounds(float(panel.low[0]), float(panel.high[0]))
    odd = {each.path.partition(".")[0] for each in view.oddities}
    bodies = [Mark(f"{s.name} {s.mass:.3g} kg", panel.seen.of(s.centre), s.name in odd) for s in view.solids]
    others = [Mark(hinge.name, panel.seen.of(hinge.centre), hinge.name in odd) for hinge in view.hinges]
    others += [Mark(name, panel.seen.of(place), name in odd) for name, place in view.points.items()]
    if panel.room[0] > 1 or panel.room[1] > 0.5:
        for sign, marks in ((1, bodies), (-1, others)):
            label(axes, marks, panel, int(panel.room[0] > 1), sign)


def _draw_mode(axes: Axes, analysis: "ModalAnalysis", i: int, views: tuple[View, View]) -> None:
    """Draw a mode in the view in which it moves most, the other end of its swing paler."""
    rest, swing, label = analysis.outline[0], swing_of(analysis, i), analysis.labels[i]
    seen, colour = most_seen(views, swing), colour_of(label)
    axes.plot(*seen.of(rest), color="#C8C8C8", linewidth=4, marker="o", markersize=5)
    axes.plot(*seen.of(rest - swing), color=colour, linewidth=1.0, alpha=0.35)
    axes.plot(*seen.of(rest + swing), color=colour, linewidth=2.0, marker="o", markersize=4)
    axes.set_aspect("equal", adjustable="datalim")
    axes.margins(0.1, 0.15)
    axes.set_axis_off()
    name = f"{i + 1}: {analysis.modes.frequency[i]:.2f} Hz, {label}\n{seen.name}, exaggerated"
    axes.set_title(name, fontsize=8.5, loc="left", color="black")


def _findings(view: "ArmView") -> list[str]:
    """Return the implausible numbers, wrapped."""
    found = [f"no modes: {view.failure}"] if view.failure else []
    found += [str(odd) for odd in view.oddities]
    more = [f"and {len(found) - MOST} more, in the report"] if len(found) > MOST else []
    lines = [line for each in (*found[:MOST], *more) for line in textwrap.wrap(each, 150, subsequent_indent="    ")]
    return ["Numbers that look wrong", *lines] if found else ["All numbers are plausible."]


def key_of(figure: Figure, view: "ArmView", at: tuple[float, float]) -> None:
    """Explain the signs in use; `at` is the key's upper right corner, relative to the figure."""
    kinds = {solid.kind for solid in view.solids}
    there = {
        "bushing alone": any(not hinge.driven for hinge in view.hinges),
        "drive": bool(view.drives),
        "belt": bool(view.belts),
        "point": bool(view.points),
        "dashed: box of the same inertia": any(not solid.shaped for solid in view.solids),
        **{kind: kind in kinds for kind in ("shaft", "link", "payload")},
    }
    shown = [(name, style) for name, style in KEY.items() if there.get(name, True)]
    handles = [Line2D([], [], **{"label": name, "linestyle": "", **style}) for name, style in shown]
    look: Style = {"ncols": 5, "frameon": False, "fontsize": 7.5, "columnspacing": 1.0, "handletextpad": 0.4}
    figure.legend(handles=handles, loc="upper right", bbox_to_anchor=at, **look)
