"""A figure drawn anew for a window as narrow as a phone's: letters keep their size, panels stand in a column."""

import textwrap

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.gridspec import GridSpec
from matplotlib.legend import Legend
from matplotlib.ticker import MaxNLocator, ScalarFormatter

from ident.present.figures.style import key_below

WIDTH = 3.9
"""Width [inch], of which a phone makes some 340 pixels."""
SQUARE = 3.4
"""Height of a panel that stood beside others and has no rows [inch]."""
ROW, LABEL, WORDS = 0.15, 22, 44
"""Height of a line of a row's label [inch]; letters of a row's label, and of other words, on a line."""


def narrowed(figure: Figure) -> Figure:
    """Redraw a figure for a phone, in place, and return it; its layout must be a constrained one.

    Panels beside each other are put one below the other; titles and labels of rows are folded, keys have one column.
    """
    panels = [axes for axes in figure.axes if axes.get_subplotspec() is not None]
    before = float(figure.get_size_inches()[1])
    lifted = [_fold_rows(axes) for axes in panels]
    height = before + sum(lifted)
    if _across(panels) > 1:
        heights = [before + more if more else SQUARE for axes, more in zip(panels, lifted, strict=True)]
        _stack(figure, panels, heights)
        height = sum(heights)
    figure.set_size_inches(WIDTH, height + _fold_words(figure))
    return figure


def _across(panels: list[Axes]) -> int:
    """Return how many panels stand in a row."""
    return max((axes.get_subplotspec().get_gridspec().ncols for axes in panels), default=1)  # type: ignore[union-attr]


def _folded(text: str, width: int) -> str:
    return "\n".join(textwrap.fill(line, width) for line in text.splitlines())


def _stack(figure: Figure, panels: list[Axes], heights: list[float]) -> None:
    grid = GridSpec(len(panels), 1, figure=figure, height_ratios=heights)
    for i, axes in enumerate(panels):
        axes.set_subplotspec(grid[i])


def _fold_rows(axes: Axes) -> float:
    """Fold the labels of rows and leave fewer ticks; return the height [inch] that it takes."""
    labels = [label.get_text() for label in axes.get_yticklabels()]
    folded = [textwrap.fill(label, LABEL) for label in labels]
    if folded != labels:
        axes.set_yticks(axes.get_yticks(), folded)
    if isinstance(axes.xaxis.get_major_formatter(), ScalarFormatter) and len(axes.get_xticks()):
        axes.xaxis.set_major_locator(MaxNLocator(4))
    axes.set_xlabel(textwrap.fill(axes.get_xlabel(), WORDS))
    return ROW * sum(label.count("\n") for label in folded)


def _fold_words(figure: Figure) -> float:
    """Fold the title and put keys into one column; return the height [inch] that it takes."""
    lines = 0
    if figure.get_suptitle():
        title = _folded(figure.get_suptitle(), 36)
        lines += title.count("\n") - figure.get_suptitle().count("\n")
        figure.suptitle(title, parse_math=False, fontsize=11, fontweight="bold")
    return 0.19 * (lines + sum(_fold_key(figure, key) for key in list(figure.legends)))


def _fold_key(figure: Figure, key: Legend) -> int:
    """Write a key anew in one column, which a legend that is there can't be brought to; return its lines."""
    handles = [handle for handle in key.legend_handles if handle is not None]
    words = [_folded(text.get_text(), WORDS) for text in key.get_texts()]
    for handle, text in zip(handles, words, strict=True):
        handle.set_label(text)
    title = _folded(key.get_title().get_text(), 52)
    key.remove()
    key_below(figure, handles, title, columns=1, side="left")
    return title.count("\n") + sum(text.count("\n") + 1 for text in words)
