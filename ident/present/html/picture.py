"""Figures for a page: SVG that looks the same everywhere and comes out the same every time."""

import re
import warnings
from io import StringIO
from math import ceil
from typing import Any

from matplotlib import rc_context
from matplotlib.artist import Artist
from matplotlib.figure import Figure
from matplotlib.text import Text

from ident.present.html.page import Picture

LARGEST = 1_500_000
"""Characters of an SVG above which its data are drawn as pixels."""
DPI = 200
"""Pixels an inch of what is drawn as pixels."""
LETTER = 10
"""Pixels of the smallest letter that can be read."""
SETTINGS: dict[Any, Any] = {"svg.hashsalt": "ident", "svg.fonttype": "path", "path.simplify_threshold": 0.25}
NOTHING = dict.fromkeys(("Creator", "Date", "Format", "Type"))
ILLEGAL = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
"""Characters that no XML document may hold."""
PROLOGUE = re.compile(r"^.*?(?=<svg)", re.DOTALL)


def picture(figure: Figure, alt: str, caption: str) -> Picture:
    """Return a figure for a page: letters as outlines, no date; what would be too large becomes pixels.

    Args:
        figure: what to draw.
        alt: what can be seen in it, for whoever can't see it.
        caption: what it shows and how to read it.
    """
    svg = _bounded(figure)
    letters = [text.get_fontsize() for text in figure.findobj(Text) if text.get_text().strip()]
    width = 72 * figure.get_size_inches()[0]
    return Picture(svg, alt, caption, ceil(LETTER * width / min(letters)) if letters else 0)


def _bounded(figure: Figure) -> str:
    svg = _svg(figure)
    if len(svg) > LARGEST:
        for artist in _data(figure):
            artist.set_rasterized(True)
        svg = _svg(figure)
    return svg


def _svg(figure: Figure) -> str:
    text = StringIO()
    with warnings.catch_warnings(), rc_context(SETTINGS):
        warnings.filterwarnings("ignore", "Glyph .* missing from", UserWarning)
        figure.savefig(text, format="svg", dpi=DPI, metadata=NOTHING)
    return PROLOGUE.sub("", ILLEGAL.sub("", text.getvalue()))


def _data(figure: Figure) -> list[Artist]:
    """Return what is drawn from data, and not the frame or the words about it."""
    return [
        artist
        for axes in figure.axes
        for artists in (axes.lines, axes.collections, axes.patches, axes.images)
        for artist in artists
    ]
