"""A report as one HTML file: no other file, nothing from the network, no script but that of a page within it.

What a page says comes from files that anybody may have written. Every text goes through `shown` and Jinja2's
autoescape, and a content security policy refuses whatever a text might still ask for.
"""

import base64
import re
import warnings
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from io import StringIO
from math import ceil
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float
from jinja2 import Environment, StrictUndefined, Template
from markupsafe import escape
from matplotlib import rc_context
from matplotlib.figure import Figure
from matplotlib.text import Text

from ident.files import replace_file
from ident.present.figures.modes import swing_of
from ident.present.figures.show import MODES, View, most_seen, views
from ident.present.figures.style import colour_of
from ident.text import one_line

if TYPE_CHECKING:
    from ident.assess.show import ArmView
    from ident.identify.modal_analysis import ModalAnalysis
    from ident.present.report import Part, Table, Verdict

NARROW = 32
"""Characters up to which a table's cell stays on one line."""
NUMBER = re.compile(r"\W*\d")
"""How a cell with a number begins."""


@dataclass(frozen=True)
class Picture:
    """A figure as SVG; `picture` makes one.

    Attributes:
        svg: the whole SVG document.
        alt: what can be seen in it, for whoever can't see it.
        caption: what it shows and how to read it.
        readable: [px] width at which its smallest letter is 10 px; in a narrow window it scrolls at this width.
        moving: the same as it moves, for who does not mind; empty where nothing moves.

    Raises:
        ValueError: there is no SVG or no alternative text.
    """

    svg: str
    alt: str
    caption: str
    readable: int = 0
    moving: str = ""

    def __post_init__(self) -> None:
        if "<svg" not in self.svg:
            raise ValueError("a picture that is no SVG")
        if not self.alt.strip():
            raise ValueError("a picture without an alternative text")


@dataclass(frozen=True)
class Frame:
    """A page that computes, within the page: it reaches neither the page about it nor anything else.

    Attributes:
        html: the whole page.
        script: hash of the one script that it may run, as `sha256-...`.
        title: what it is, for whoever can't see it.
        caption: what it shows; on paper, it is left out with the page.
    """

    html: str
    script: str
    title: str
    caption: str


@dataclass(frozen=True)
class Section:
    """A part of the page.

    Attributes:
        title: heading.
        parts: paragraphs and tables.
        pictures: figures, below them.
        frame: a page that computes, below the figures.
    """

    title: str
    parts: tuple["Part", ...]
    pictures: tuple[Picture, ...] = ()
    frame: Frame | None = None


@dataclass(frozen=True)
class Page:
    """A report.

    Attributes:
        title: heading of the page.
        subtitle: what it is about: arm, campaign, date.
        verdict: what the whole comes to.
        summary: what stands with the verdict, each with its label: Cause, Remedy, Caution.
        sections: the parts, in order.
        inputs: what went in, as a table: name, file, hash.
        assumptions: what was assumed, a sentence each.
        provenance: names and values that say how the page came about: versions, options, seeds.
        above: words and relative address of the page that led here; empty for none.
    """

    title: str
    subtitle: str
    verdict: "Verdict"
    summary: tuple[tuple[str, str], ...]
    sections: tuple[Section, ...]
    inputs: "Table"
    assumptions: tuple[str, ...] = ()
    provenance: tuple[tuple[str, str], ...] = ()
    above: tuple[str, str] = ("", "")


def render(page: Page) -> str:
    """Return a page as HTML; the same page gives the same text."""
    scripts = [section.frame.script for section in page.sections if section.frame]
    return template_of("ident.present.html").render(page=page, scripts=scripts) + "\n"


@cache
def template_of(package: str) -> Template:
    """Return the template `page.html.jinja` of a package."""
    environment = Environment(
        autoescape=True, finalize=shown, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    environment.filters |= {"columns": columns, "data_uri": data_uri, "whole": escape}
    return environment.from_string((files(package) / "page.html.jinja").read_text("utf-8"))


def write_page(page: Page, path: Path) -> None:
    """Write a page as HTML, whole or not at all."""
    text = render(page).encode("utf-8")
    replace_file(path, lambda file: file.write(text), make_folders=True)


def shown(value: object) -> object:
    """Return what a page shows: control characters and those that turn the direction of text become visible.

    What the template itself made of texts stays as it is.
    """
    return value if hasattr(value, "__html__") else one_line(str(value))


def columns(table: "Table") -> list[str]:
    """Return how each column is set: `wide` text on several lines, a `number` to the right, or `words`."""
    looks = []
    for j in range(len(table.head)):
        cells = [one_line(row[j]) for row in table.texts]
        look = "number" if j > 0 and any(map(NUMBER.match, cells)) else "words"
        looks.append("wide" if any(len(cell) > NARROW for cell in cells) else look)
    return looks


def provenance(head: Mapping[str, Any]) -> tuple[tuple[str, str], ...]:
    """Return format, date, versions and options of a result file, by name."""
    options = {f"option {name}": value for name, value in head["options"].items() if value not in (None, [], {}, "")}
    values = {"format": head["format"], "created": head["created"], **head["software"], **options}
    return tuple((name, str(value)) for name, value in values.items())


def data_uri(svg: str) -> str:
    """Return an SVG document as the address of an image."""
    return "data:image/svg+xml;base64," + base64.b64encode(svg.encode("utf-8", "replace")).decode("ascii")


# -------- Moving modes
# The first modes of an arm as a picture that moves: SVG without a script, still for who wants no motion.

WIDTH, HEIGHT, MODE_WORDS, ROOM = 340.0, 150.0, 44.0, 18.0
"""Size of a mode's picture, the height of its words, and the room about the arm [px]."""
PERIOD = 2.0
"""Duration of a swing [s]: all modes are shown at the same pace, far too slow."""
READABLE = 567
"""Width of the whole at which its smallest letters, of 12 px, are 10 px [px]."""
STYLE = (
    "text{font:13px system-ui,sans-serif;fill:#1b1f24}.soft{fill:#57606a;font-size:12px}"
    "polyline{fill:none;stroke-linejoin:round;stroke-linecap:round}.still{display:none}"
)
STILL = ".moving{display:none}.still{display:inline}"
"""Rules of a still picture."""


def moving_modes(view: "ArmView", *, still: bool = False) -> str:
    """Return the first modes as an SVG document in which each swings, largest displacements alike.

    Args:
        view: an arm whose modes are known.
        still: whether nothing moves, for a page whose reader wants no motion: an image in it does not know of that.
    """
    assert view.analysis is not None
    analysis = view.analysis
    count = min(MODES, len(analysis.labels))
    columns = min(2, count)
    size = columns * WIDTH, -(-count // columns) * (HEIGHT + MODE_WORDS)
    modes = "".join(
        f'<g transform="translate({i % columns * WIDTH:g} {i // columns * (HEIGHT + MODE_WORDS):g})">{mode}</g>'
        for i, mode in enumerate(_modes(analysis, count, views(view)))
    )
    # browsers apply the rule for who wants no motion where a moving picture is opened by itself
    rules = STYLE + (STILL if still else f"@media (prefers-reduced-motion:reduce),print{{{STILL}}}")
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {size[0]:g} {size[1]:g}" width="{size[0]:g}" '
        f'height="{size[1]:g}"><style>{rules}</style><rect width="100%" height="100%" fill="#fff"/>{modes}</svg>\n'
    )


def _modes(analysis: "ModalAnalysis", count: int, seen: tuple[View, View]) -> Iterator[str]:
    for i, label in enumerate(analysis.labels[:count]):
        swing = swing_of(analysis, i)
        view = most_seen(seen, swing)
        words = f"{i + 1}: {analysis.modes.frequency[i]:.2f} Hz, {label}"
        yield (
            f'<text x="{ROOM:g}" y="20">{escape(words)}</text>'
            f'<text class="soft" x="{ROOM:g}" y="37">{escape(view.name)}, exaggerated, slowed down</text>'
            + _swinging(view.of(analysis.outline[0]), view.of(swing), colour_of(label))
        )


def _swinging(rest: Float[np.ndarray, "2 K"], swing: Float[np.ndarray, "2 K"], colour: str) -> str:
    """Draw the arm at rest, and moving between both ends of its swing; still, it is drawn at both ends."""
    every = np.concatenate([rest, rest + swing, rest - swing], 1)
    low, high = every.min(1), every.max(1)
    scale = min((WIDTH - 2 * ROOM) / max(high[0] - low[0], 1e-9), (HEIGHT - 2 * ROOM) / max(high[1] - low[1], 1e-9))
    middle = (low + high) / 2

    def points(places: Float[np.ndarray, "2 K"]) -> str:
        x = WIDTH / 2 + scale * (places[0] - middle[0])
        y = MODE_WORDS + HEIGHT / 2 - scale * (places[1] - middle[1])
        return " ".join(f"{a:.1f},{b:.1f}" for a, b in zip(x, y, strict=True))

    ends = points(rest + swing), points(rest - swing)
    pace = f'dur="{PERIOD:g}s" repeatCount="indefinite" calcMode="spline" keyTimes="0;0.5;1"'
    sine = 'keySplines="0.37 0 0.63 1;0.37 0 0.63 1"'
    return (
        f'<polyline points="{points(rest)}" stroke="#c8c8c8" stroke-width="5"/>'
        f'<polyline class="moving" points="{ends[0]}" stroke="{colour}" stroke-width="2.5">'
        f'<animate attributeName="points" values="{ends[0]};{ends[1]};{ends[0]}" {pace} {sine}/></polyline>'
        f'<g class="still"><polyline points="{ends[1]}" stroke="{colour}" stroke-width="1" opacity="0.4"/>'
        f'<polyline points="{ends[0]}" stroke="{colour}" stroke-width="2.5"/></g>'
    )


# -------- Picture
# Figures for a page: SVG that looks the same everywhere and comes out the same every time.

LARGEST = 1_500_000
"""Characters of an SVG above which its data are drawn as pixels."""
SETTINGS: dict[Any, Any] = {"svg.hashsalt": "ident", "svg.fonttype": "path", "path.simplify_threshold": 0.25}
ILLEGAL = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
"""Characters that no XML document may hold."""


def picture(figure: Figure, alt: str, caption: str) -> Picture:
    """Return a figure for a page: letters as outlines, no date; what would be too large becomes pixels.

    Args:
        figure: what to draw.
        alt: what can be seen in it, for whoever can't see it.
        caption: what it shows and how to read it.
    """
    svg = _svg(figure)
    if len(svg) > LARGEST:
        for axes in figure.axes:
            for artist in (*axes.lines, *axes.collections, *axes.patches, *axes.images):
                artist.set_rasterized(True)  # what is drawn from data, and not the frame or the words about it
        svg = _svg(figure)
    letters = [text.get_fontsize() for text in figure.findobj(Text) if text.get_text().strip()]
    width = 72 * figure.get_size_inches()[0]
    return Picture(svg, alt, caption, ceil(10 * width / min(letters)) if letters else 0)  # letters of 10 px are read


def _svg(figure: Figure) -> str:
    text = StringIO()
    with warnings.catch_warnings(), rc_context(SETTINGS):
        warnings.filterwarnings("ignore", "Glyph .* missing from", UserWarning)
        nothing = dict.fromkeys(("Creator", "Date", "Format", "Type"))
        figure.savefig(text, format="svg", dpi=200, metadata=nothing)
    svg = ILLEGAL.sub("", text.getvalue())
    return svg[svg.index("<svg") :]
