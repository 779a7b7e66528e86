"""The Campbell diagram: natural frequencies along a motion against the rotation frequencies of the pulleys."""

from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.transforms import Transform

from ident.arm.modes import Label
from ident.report.report import cut
from ident.report.style import GREY, NAME_STYLES, colour_of, key_below, lines, note, plain, titled
from ident.studies.basis import alike
from ident.studies.working.resonance_report import band_words, grouped, same_lines, sources_words
from ident.vibrate.branches import Branches
from ident.vibrate.resonance import Excitation, ResonanceCrossing

SIZE = (9.0, 6.6)
"""Width and height [inch]."""
SHADE = "#EBCB6B"
"""Shade of near-resonance; light, so that it prints as a light grey."""
DASHES = ((0, (5, 2)), (0, (1.5, 1.5)), (0, (6, 2, 1.5, 2)), (0, (8, 3)))
"""Line patterns of the excitation."""


def resonance_figure(
    branches: Branches, excitation: Excitation, crossings: Sequence[ResonanceCrossing] = (), title: str = ""
) -> Figure:
    """Draw natural frequencies (solid), pulley frequencies (dashed) and where they are near, over time.

    Resonance crossings have the numbers of the report. Below are the joint angles.

    Args:
        branches: natural frequencies along a motion; for draws the median and the band from 5 to 95 %.
        excitation: at the same times.
        crossings: to shade and number, in this order.
        title: heading, such as the name of the motion.
    """
    figure = titled(SIZE, cut(title or "Natural and pulley frequencies", 90), (0.06, 0.05))
    upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=(5, 1))
    top = 1.15 * float(branches.band()[1].max() if branches.batch_size else branches.median.max())
    upper.set(ylim=(0, top), xlim=(branches.time[0], branches.time[-1]))
    _shades(upper, branches, excitation, crossings)
    _branches(upper, branches)
    _pulleys(upper, branches, excitation, top)
    _numbers(upper, crossings)
    _postures(lower, branches)
    upper.set(ylabel="frequency [Hz]")
    lower.set(xlabel="time [s]")
    plain(upper, grid=True)
    plain(lower)
    names = {f"{name.direction} {name.kind}" for b in range(len(branches.labels)) for name, *_ in _spans(branches, b)}
    shown = {words: style["color"] for words, style in NAME_STYLES.items() if words in names}
    shapes = lines({words: {"color": colour, "linewidth": 1.9} for words, colour in shown.items()})
    key_below(figure, shapes, "\n".join(_notes(branches, crossings)), left=True)
    return figure


def _shades(axes: Axes, branches: Branches, excitation: Excitation, crossings: Sequence[ResonanceCrossing]) -> None:
    """Shade the gap between a natural frequency and an excitation while they are near."""
    for crossing in crossings:
        inside = (branches.time > crossing.start) & (branches.time < crossing.end)
        time = np.sort([crossing.start, *branches.time[inside], *crossing.crossings, crossing.end])
        natural = np.interp(time, branches.time, branches.median[crossing.branch])
        line = excitation.frequency[excitation.sources.index(crossing.source)]
        turning = np.interp(time, excitation.time, line)
        axes.fill_between(time, natural, turning, color=SHADE, linewidth=0, zorder=1)


def _branches(axes: Axes, branches: Branches) -> None:
    """Draw each branch in the colours of its names, the last name at its end."""
    starts, ends = (_spread(branches.median[:, k], axes) for k in (0, -1))
    for b, label in enumerate(branches.labels):
        if branches.batch_size:
            axes.fill_between(branches.time, *branches.band()[:, b], color=colour_of(label), alpha=0.16, linewidth=0)
        for name, start, end in _spans(branches, b):
            time = np.unique(np.clip(branches.time, start, end))
            line = np.interp(time, branches.time, branches.median[b])
            axes.plot(time, line, color=colour_of(name), linewidth=1.9, zorder=3, solid_capstyle="butt")
            if start > branches.time[0]:
                axes.plot(time[:1], line[:1], "|", color="black", markersize=8, zorder=4)
            elif name != label:
                _write(axes, f"{name}", (start, starts[b]), colour_of(name), (4, 7))
        _write(axes, f"{label}", (1.0, ends[b]), colour_of(label), (4, 0), axes.get_yaxis_transform())


def _spans(branches: Branches, b: int) -> Iterator[tuple[Label, float, float]]:
    """Yield the names of a branch, each with its first and last time."""
    changes = [change for change in branches.changes if change.branch == b]
    ends = [float(branches.time[0]), *(change.time for change in changes), float(branches.time[-1])]
    names = [branches.label(b, end) for end in ends[:-1]]
    yield from zip(names, ends[:-1], ends[1:], strict=True)


def _pulleys(axes: Axes, branches: Branches, excitation: Excitation, top: float) -> None:
    """Draw the excitation, coinciding lines as one, each named at its maximum within the axis."""
    names: list[tuple[float, float]] = []
    for i, same in enumerate(same_lines(excitation)):
        line = excitation.frequency[same[0]]
        axes.plot(excitation.time, line, color="black", linestyle=DASHES[i % len(DASHES)], linewidth=1.2, zorder=3)
        if not line.any():
            continue
        k = _free(excitation.time, line, top, names)
        names.append((excitation.time[k], line[k]))
        others = [*branches.median, *(f for j, f in enumerate(excitation.frequency) if j not in same)]
        apart = np.array([other[k] - line[k] for other in others] or [np.inf])
        above = apart[apart >= 0].min(initial=np.inf) >= -apart[apart < 0].max(initial=-line[k])  # more room there
        name = sources_words([excitation.sources[j] for j in same])
        side = (0, 8 if above else -8)
        _write(axes, name, (excitation.time[k], line[k]), "black", side, align="center")


def _free(time: np.ndarray, line: np.ndarray, top: float, names: Sequence[tuple[float, float]]) -> int:
    """Return the index on a line where its name is far from the existing names."""
    span = time[-1] - time[0]
    shares = (0.93, 0.86, 0.79, 0.72, 0.65, 0.58)
    places = [_highest(line, share * top, along) for along in (0.5, 0.03, 0.97) for share in shares]
    far = (k for k in places if all(abs(time[k] - t) > 0.2 * span or abs(line[k] - f) > 0.05 * top for t, f in names))
    return next(far, places[0])


def _highest(line: Float[np.ndarray, "T"], top: float, along: float) -> int:
    """Return an index in the first interval in which a line is highest, but not above `top`."""
    seen = np.where(line <= top, line, 0.0)
    high = np.flatnonzero(seen >= 0.998 * seen.max())
    first = np.split(high, np.flatnonzero(np.diff(high) > 1) + 1)[0]
    return int(first[round(along * (len(first) - 1) + 0.01)])


def _numbers(axes: Axes, crossings: Sequence[ResonanceCrossing]) -> None:
    """Number the resonance crossings above the panel, each with a line down to the closest approach."""
    low, high = axes.get_xlim()
    width, taken = (high - low) * 0.25 / SIZE[0], list[tuple[float, int]]()
    numbered = [(n, group[0]) for n, group in enumerate(grouped(crossings), start=1)]
    for number, crossing in sorted(numbered, key=lambda pair: pair[1].time):
        used = {row for time, row in taken if abs(time - crossing.time) < width}
        row = next(row for row in range(len(used) + 1) if row not in used)
        taken.append((crossing.time, row))
        above = (crossing.time, 1.03 + 0.05 * row)
        place: Any = {"textcoords": axes.get_xaxis_transform(), "ha": "center", "va": "center", "zorder": 2}
        box = {"boxstyle": "circle,pad=0.2", "facecolor": SHADE, "edgecolor": GREY, "linewidth": 0.6}
        line = {"arrowstyle": "-", "color": GREY, "linewidth": 0.6, "shrinkA": 0, "shrinkB": 0}
        at = (crossing.time, crossing.natural)
        note(axes, f"{number}", at, above, color="black", bbox=box, arrowprops=line, **place)


def _postures(axes: Axes, branches: Branches) -> None:
    """Draw the joint angles, identical ones as one line."""
    angles = np.degrees(branches.posture)
    groups = alike(range(len(angles)), lambda i, j: np.allclose(angles[i], angles[j], atol=1e-6))
    at = angles[[g[0] for g in groups]]
    axes.margins(y=0.15)
    axes.plot(branches.time, at.T, color=GREY, linewidth=1.2)
    first = np.where(np.ptp(at, axis=1) > 0, at[:, 0], at[:, -1])
    for group, value in zip(groups, _spread(first, axes), strict=True):
        name = ", ".join(f"q{j + 1}" for j in group)
        _write(axes, name, (0.0, value), GREY, (4, 0), axes.get_yaxis_transform())
    axes.set(ylabel="angle [deg]")


def _spread(values: Float[np.ndarray, "n"], axes: Axes) -> Float[np.ndarray, "n"]:
    """Move values apart until their names do not overlap."""
    low, high = axes.get_ylim()
    gap = (high - low) * 0.15 / 4.2  # the upper panel is about 4.2 inches tall
    order, moved = np.argsort(values), np.array(values, float)
    for _ in range(20):
        for i, j in pairwise(order):
            lack = max(gap - (moved[j] - moved[i]), 0.0)
            moved[i] -= lack / 2
            moved[j] += lack / 2
    return moved


def _write(
    axes: Axes,
    text: str,
    at: tuple,
    colour: str,
    shift: tuple[int, int],
    coords: str | Transform = "data",
    align: str = "left",
) -> None:
    box = {"facecolor": "white", "edgecolor": "none", "pad": 0.5}
    place: Any = {"xycoords": coords, "ha": align, "va": "center", "annotation_clip": False, "bbox": box, "zorder": 5}
    note(axes, text, at, shift, color=colour, **place)


def _notes(branches: Branches, crossings: Sequence[ResonanceCrossing]) -> Iterator[str]:
    yield "solid: natural frequencies of the arm held at each posture; dashed: turning frequencies of pulleys"
    if crossings:
        yield "shaded: the two are near; numbered as in the report, the line leads to the closest approach"
    if branches.batch_size:
        yield f"solid lines are medians, bands {band_words(branches)}"
    if branches.changes:
        yield "tick on a line: the mode changes its shape, and its name"
