"""Style of ident's figures: colours, rows, headings, ticks.

Texts from files are drawn literally: a `$` in a name is no formula (`parse_math=False`).
"""

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.colorbar import Colorbar
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.legend import Legend
from matplotlib.lines import Line2D
from matplotlib.text import Text
from matplotlib.ticker import FuncFormatter, Locator, LogLocator, MaxNLocator, NullLocator

from ident.errors import refusal
from ident.text import within

if TYPE_CHECKING:
    from ident.arm.modes import Label

BLUE, ORANGE, GREEN, PINK = "#0072B2", "#D55E00", "#009E73", "#CC79A7"
"""Colours that a colour-blind reader tells apart (Okabe and Ito, 2002)."""
GREY, PALE, PALE_BLUE = "#555555", "#B8C4CE", "#A8D0E8"
NEAR = 0.5
"""Share of a limit that the data must reach for the limit to be drawn; elsewhere it would flatten the curves."""

Style = Mapping[str, Any]
NAME_STYLES: dict[str, Style] = {
    "vertical bending": {"color": BLUE, "marker": "o"},
    "lateral torsion": {"color": ORANGE, "marker": "s"},
    "lateral bending": {"color": GREEN, "marker": "^"},
    "vertical torsion": {"color": PINK, "marker": "D"},
}
"""Style of a mode, by the first two words of its name."""
FILLED: Style = {"marker": "o", "color": BLUE, "markersize": 6}
HOLLOW: Style = {"marker": "o", "color": GREY, "markersize": 6, "markerfacecolor": "white"}


def rows(axes: Axes, labels: Sequence[str], *, side: str = "left") -> None:
    """Make one row for each label, from the top down; labels on the left or the right."""
    axes.set(ylim=(len(labels) - 0.4, -0.6))
    axes.set_yticks(range(len(labels)), labels, parse_math=False, fontsize=8)
    axes.tick_params(axis="y", length=0)
    if side == "left":
        axes.grid(axis="y", color="#EEEEEE", linewidth=0.8)
    plain(axes, left=False)


def titled(
    size: tuple[float, float], title: str, pads: tuple[float, float] = (0.08, 0.06), wspace: float = 0.02
) -> Figure:
    """Return an empty figure of a size [inch] under a title, with the pads of matplotlib's constrained layout.

    Inside `drawn_into` the first figure stands for the axes given there.
    """
    if waiting := WAITING.get():
        return _Panel(waiting.pop(), title)  # type: ignore[return-value]
    figure = Figure(figsize=size, layout=ConstrainedLayoutEngine(w_pad=pads[0], h_pad=pads[1], wspace=wspace))
    figure.suptitle(title, parse_math=False, fontsize=12, fontweight="bold")
    return figure


WAITING: ContextVar[list[Axes]] = ContextVar("WAITING", default=[])  # noqa: B039  (never appended to)
"""Axes of a user that the next figure is drawn into."""


@contextmanager
def drawn_into(axes: Axes) -> Iterator[None]:
    """Draw the first figure that is made inside this context into given axes.

    Raises:
        InputError: it has several panels, or there is none.
    """
    with within(WAITING, waiting := [axes]):
        yield
    if waiting:
        raise _not_one_panel()


def _not_one_panel() -> Exception:
    return refusal("ax", "axes", "none, as the main figure does not have one panel", "call figures() without them")


class _Panel:
    """Stands for a figure of one panel, drawn into given axes: title and key are put around these."""

    def __init__(self, axes: Axes, title: str):
        self.axes, self.title = axes, title

    def __getattr__(self, name: str) -> Any:
        raise _not_one_panel()

    def subplots(self, rows: int = 1, columns: int = 1, *, squeeze: bool = True, **_: Any) -> Any:
        if rows * columns > 1:
            raise _not_one_panel()
        self.axes.set_title(self.title, parse_math=False, fontsize=10, fontweight="bold")
        return self.axes if squeeze else np.array([[self.axes]])

    def add_subplot(self, rows: int = 1, columns: int = 1, number: int = 1) -> Axes:
        axes: Axes = self.subplots(rows, columns)
        return axes

    def colorbar(self, drawn: Any, **more: Any) -> Colorbar:
        return self.axes.figure.colorbar(drawn, **more)

    def align_ylabels(self, axes: Any) -> None:
        pass

    def legend(self, handles: Sequence[Any], **look: Any) -> Legend:
        below: dict[str, Any] = {"loc": "upper center", "bbox_to_anchor": (0.5, -0.16)}
        key = Legend(self.axes, handles, [each.get_label() for each in handles], **(look | below))
        self.axes.add_artist(key).set_clip_on(False)
        return key


def note(axes: Axes, text: str, at: tuple[Any, Any], offset: tuple[float, float] = (0, 0), **more: Any) -> None:
    """Write small letters at a place, offset in points; `more` is as in `Axes.annotate`."""
    style: dict[str, Any] = {"textcoords": "offset points", "fontsize": 8, "color": GREY, "parse_math": False}
    axes.annotate(text, at, xytext=offset, **(style | more))


def colour_of(label: "Label") -> str:
    """Return the colour of a mode."""
    return str(NAME_STYLES[f"{label.direction} {label.kind}"]["color"])


def plain(axes: Axes, *, left: bool = True, grid: bool = False) -> None:
    """Set small letters, remove frame lines without ticks; draw pale horizontal lines if requested."""
    axes.set_axisbelow(True)
    if grid:
        axes.grid(axis="y", color="#EEEEEE", linewidth=0.8)
    axes.tick_params(labelsize=8)
    for axis in (axes.xaxis, axes.yaxis):
        axis.label.set_fontsize(9)
    for spine in ("top", "right") if left else ("top", "right", "left"):
        axes.spines[spine].set_visible(False)


def heading(axes: Axes, title: str, entries: Mapping[str, Style], *, columns: int = 2) -> None:
    """Put heading and key above the axes, where they cover nothing."""
    handles = lines({label: {"linestyle": "", "solid_capstyle": "butt", **style} for label, style in entries.items()})
    place: Style = {"alignment": "left", "loc": "lower left", "bbox_to_anchor": (0.0, 1.0), "borderpad": 0.2}
    look: Style = {"frameon": False, "fontsize": 8, "handletextpad": 1.0, "columnspacing": 1.6}
    legend = axes.legend(handles=handles, title=title, ncols=columns, **place, **look)
    legend.get_title().set(fontweight="bold", fontsize=10, parse_math=False)


def lines(entries: Mapping[str, Style]) -> list[Line2D]:
    """Return the entries of a key, as lines or marks, by label."""
    return [Line2D([], [], label=label, **style) for label, style in entries.items()]


def key_below(figure: Figure, handles: Sequence[Artist], note: str, *, columns: int = 4, left: bool = False) -> Text:
    """Explain lines and bands below the panels, where they cover nothing, under a note, which is returned."""
    side = "left" if left else "center"
    look: Style = {"loc": f"outside lower {side}", "alignment": side, "frameon": False, "fontsize": 9}
    key = figure.legend(handles=handles, title=note, ncols=columns, **look)
    as_written(key.get_texts())
    key.get_title().set(fontsize=8, color=GREY, parse_math=False)
    return key.get_title()


def as_written(texts: Iterable[Text]) -> None:
    """Turn off formulas in texts, so that `$` stays literal."""
    for text in texts:
        text.set_parse_math(False)


def colour_bar(figure: Figure, axes: Axes, drawn: Any, label: str, **more: Any) -> Colorbar:
    """Explain the colours of an artist by a bar next to the axes; `more` is as in `Figure.colorbar`."""
    bar = figure.colorbar(drawn, ax=axes, pad=0.02, **more)
    bar.set_label(label, fontsize=9)
    bar.ax.tick_params(labelsize=8)
    return bar


def set_ticks(axis: Axis, locator: Locator, text: Callable[[float], str]) -> None:
    """Put ticks at a locator's positions, without minor ticks, each with its text."""
    axis.set_major_locator(locator)
    axis.set_minor_locator(NullLocator())
    axis.set_major_formatter(FuncFormatter(lambda x, _: text(x)))


def ratio_axis(axes: Axes, left: float, right: float) -> None:
    """Make the x axis a logarithmic one of ratios with plain numbers as ticks, even if it is narrow."""
    axes.set_xscale("log")
    axes.set(xlim=(left, right))
    steps = (1.0, 2.0, 5.0) if right / left < 1e3 else (1.0,)
    wide = right / left > 5
    locator = LogLocator(subs=steps, numticks=12) if wide else MaxNLocator(6, steps=[1, 2, 5, 10])
    set_ticks(axes.xaxis, locator, "{:.6g}".format)


def power_of(size: float, unit: str) -> tuple[float, str]:
    """Return the power of a thousand for numbers of a size, and the unit with it, as `10⁶ N mm/deg`."""
    power = 3 * math.floor(math.log10(size) / 3)
    if -3 <= power <= 3:
        return 1.0, unit
    raised = str(power).translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"))
    return 10.0**power, f"10{raised} {unit}".removesuffix(" -")
