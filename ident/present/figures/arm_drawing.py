"""One view of an arm to scale: bodies with mass centres, joints, points, drives and belts, frames."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Circle, Polygon
from scipy.spatial import ConvexHull, QhullError

from ident.assess.arm_view import ArmView, Hinge, Run, Solid
from ident.present.figures.style import BLUE, GREEN, GREY, PINK, Style

COLORS = {"shaft": "#8A96A0", "link": "#A8D0E8", "payload": "#F4C08A"}
HEAVIEST = 11.0
"""Diameter of the heaviest body's mass centre [pt]; the others' areas are in proportion."""
BASE = "#5B3A8E"
"""Colour of the base frame."""
TOWARDS = 0.95
"""Cosine from which a direction counts as pointing at the reader."""
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
"""What the signs mean."""


@dataclass(frozen=True)
class View:
    """A direction in which one looks at an arm, and what of it is seen.

    Attributes:
        name: `from the side`, `from above`.
        across: place of the base frame's axis that points right.
        up: place of the one that points up, or down if `falling`.
        falling: whether that one points down.
    """

    name: str
    across: int
    up: int
    falling: bool = False

    def of(self, places: np.ndarray) -> np.ndarray:
        """Return places (3, ...) as seen (2, ...) [m]."""
        return np.stack([places[self.across], -places[self.up] if self.falling else places[self.up]])

    @property
    def normal(self) -> int:
        """Place of the axis that points at the reader, or away."""
        return 3 - self.across - self.up


def views(view: ArmView) -> tuple[View, View]:
    """Return the side view, along the longer horizontal axis, and the view from above."""
    low, high = span_of(view)
    wide = (high - low)[:2]
    if wide[1] > 1.05 * wide[0]:
        return View("from the front", 1, 2), View("from above", 1, 0, falling=True)
    return View("from the side", 0, 2), View("from above", 0, 1)


def span_of(view: ArmView) -> tuple[np.ndarray, np.ndarray]:
    """Return the lowest and highest corner (3,) [m] of all that is drawn."""
    places = [*(s.corners for s in view.solids), *(h.centre[:, None] for h in view.hinges), np.zeros((3, 1))]
    every = np.concatenate([*places, *(p[:, None] for p in view.points.values())], 1)
    return every.min(1), every.max(1)


def draw_arm(axes: Axes, view: ArmView, seen: View, size: float) -> None:
    """Draw an arm as seen; `size` [m] is that of the whole picture."""
    heaviest = max((solid.mass for solid in view.solids), default=0.0) or 1.0
    for solid in sorted(view.solids, key=lambda each: each.kind != "payload"):
        _draw_solid(axes, solid, seen)
    axes.plot(*seen.of(view.line()), color="#5F6B75", linewidth=1.4, zorder=3)
    for belt in view.belts:
        _draw_belt(axes, belt, seen)
    for hinge in view.hinges:
        _draw_hinge(axes, hinge, seen, size)
    for solid in view.solids:
        diameter = max(HEAVIEST * np.sqrt(solid.mass / heaviest), 2.0)
        axes.plot(*seen.of(solid.centre), marker="o", color="black", markersize=diameter, alpha=0.75, zorder=5)
    _marks(axes, view.drives.values(), seen, {**KEY["drive"], "markersize": 11, "zorder": 6})
    _marks(axes, view.points.values(), seen, {**KEY["point"], "zorder": 7})
    _draw_frame(axes, np.zeros(3), np.eye(3), seen, 0.07 * size, named=True)


def _marks(axes: Axes, places: Iterable[np.ndarray], seen: View, style: Style) -> None:
    for place in places:
        axes.plot(*seen.of(place), linestyle="", **style)


def _draw_solid(axes: Axes, solid: Solid, seen: View) -> None:
    """Draw the outline of a body's box, dashed where only its inertia is known."""
    corners = seen.of(solid.corners).T
    try:
        outline = corners[ConvexHull(corners).vertices]
    except QhullError:  # a plate on its edge
        outline = corners[[np.argmin(corners.sum(1)), np.argmax(corners.sum(1))]]
    line = "-" if solid.shaped else "--"
    patch = Polygon(outline, facecolor=COLORS[solid.kind], edgecolor=GREY, linewidth=0.8, linestyle=line)
    patch.set(alpha=0.55 if solid.kind != "payload" else 0.4, zorder=2 if solid.kind == "shaft" else 1)
    axes.add_patch(patch)


def _draw_hinge(axes: Axes, hinge: Hinge, seen: View, size: float) -> None:
    style = KEY["bushing with pin" if hinge.driven else "bushing alone"]
    centre = seen.of(hinge.centre)
    if hinge.driven and abs(hinge.axis[seen.normal]) < TOWARDS:
        ends = np.stack([hinge.centre - 0.035 * size * hinge.axis, hinge.centre + 0.035 * size * hinge.axis], 1)
        axes.plot(*seen.of(ends), color=BLUE, linewidth=2.2, zorder=4, solid_capstyle="butt")
    axes.plot(*centre, linestyle="", zorder=6, **style)
    if hinge.driven and abs(hinge.axis[seen.normal]) >= TOWARDS:
        axes.plot(*centre, marker=".", color=BLUE, markersize=3, zorder=6)
    _draw_frame(axes, hinge.centre, hinge.frame, seen, 0.03 * size, named=False)


def _draw_belt(axes: Axes, belt: Run, seen: View) -> None:
    """Draw both spans about the pulleys where one sees them as circles, else the plane of the belt as a line."""
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


def _draw_frame(axes: Axes, origin: np.ndarray, frame: np.ndarray, seen: View, size: float, *, named: bool) -> None:
    """Draw the axes of a frame that are not seen end on."""
    for place, letter in enumerate("xyz"):
        start, end = (tuple(seen.of(each).tolist()) for each in (origin, origin + size * frame[:, place]))
        if abs(frame[seen.normal, place]) > TOWARDS:
            continue
        colour = BASE if named else "#9C8FA8"
        arrow = {"arrowstyle": "-|>" if named else "-", "color": colour, "linewidth": 1.4 if named else 1.0}
        axes.annotate("", end, start, arrowprops={**arrow, "shrinkA": 0, "shrinkB": 0}, zorder=6)
        if named:
            way = np.subtract(end, start)
            off = tuple((6 * way / max(float(np.linalg.norm(way)), 1e-12)).tolist())
            axes.annotate(
                letter, end, off, textcoords="offset points", color=BASE, fontsize=8, ha="center", va="center"
            )
