"""A report as one HTML file: no other file, nothing from the network, no script.

The texts of a page come from files of unknown authors. Every text goes through `shown` and Jinja2's autoescape, see
`ident.report.templates`; a content security policy refuses any remaining request of a text.
"""

import base64
import re
import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from io import BytesIO
from math import ceil
from pathlib import Path
from typing import TYPE_CHECKING, Any

from matplotlib import rc_context
from matplotlib.figure import Figure
from matplotlib.text import Text
from PIL import Image, ImageOps

from ident.errors import refusal
from ident.files import write_text
from ident.report.templates import template_of
from ident.text import one_line, read_bytes

if TYPE_CHECKING:
    from ident.report.report import Part, Table, Verdict

NARROW = 32
"""Characters up to which a table's cell stays on one line."""
NUMBER = re.compile(r"\W*\d")
"""Beginning of a cell with a number."""


@dataclass(frozen=True)
class Picture:
    """A figure as SVG, for the screen, and as PNG, for paper; `picture` makes one.

    Attributes:
        svg: the whole SVG document; empty if there is only the PNG.
        alt: description for readers who can't see it.
        caption: what it shows and how to read it.
        readable: [px] width at which its smallest letter is 10 px; in a narrow window it scrolls at this width.
        png: the PNG file; empty for a figure that paper leaves out.

    Raises:
        ValueError: there is neither SVG nor PNG, or no alternative text.
    """

    svg: str
    alt: str
    caption: str
    readable: int = 0
    png: bytes = b""

    def __post_init__(self) -> None:
        if "<svg" not in self.svg and not self.png:
            raise ValueError("a picture that is neither SVG nor PNG")
        if not self.alt.strip():
            raise ValueError("a picture without an alternative text")


@dataclass(frozen=True)
class Section:
    """A part of the page.

    Attributes:
        title: heading.
        parts: paragraphs, tables, and HTML of a template (`Markup`).
        pictures: figures, below them.
    """

    title: str
    parts: tuple["Part", ...]
    pictures: tuple[Picture, ...] = ()


@dataclass(frozen=True)
class Page:
    """A report.

    Attributes:
        title: heading of the page.
        subtitle: arm, campaign, date.
        verdict: the overall verdict; None if nothing is judged.
        summary: lines next to the verdict, each with its label: Cause, Remedy, Caution.
        sections: the parts, in order.
        inputs: input files, as a table: name, file, hash.
        provenance: names and values for reproduction: versions, options, seeds.
        signed: lines of a first page, each with its label: customer, date, signature; empty without a first page.
        logo: above the title.
    """

    title: str
    subtitle: str
    verdict: "Verdict | None"
    summary: tuple[tuple[str, str], ...]
    sections: tuple[Section, ...]
    inputs: "Table"
    provenance: tuple[tuple[str, str], ...] = ()
    signed: tuple[tuple[str, str], ...] = ()
    logo: Picture | None = None


def render(page: Page) -> str:
    """Return a page as HTML; the same page gives the same text."""
    template = template_of("ident.report", "page.html.jinja")
    return template.render(page=page, columns=columns, data_uri=data_uri) + "\n"


def write_page(page: Page, path: Path) -> None:
    """Write a page as HTML, completely or not at all."""
    write_text(path, render(page))


def columns(table: "Table") -> list[str]:
    """Return the layout of each column: `wide` text on several lines, a `number` to the right, or `words`."""
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


def data_uri(image: str | bytes) -> str:
    """Return an SVG document, or a PNG file, as the address of an image."""
    kind, data = ("svg+xml", image.encode("utf-8", "replace")) if isinstance(image, str) else ("png", image)
    return f"data:image/{kind};base64,{base64.b64encode(data).decode('ascii')}"


# -------- Picture
# Figures for a page: SVG that looks the same everywhere and is the same every time.

LARGEST = 1_500_000
"""Characters of an SVG above which its data are rasterised."""
SETTINGS: dict[Any, Any] = {"svg.hashsalt": "ident", "svg.fonttype": "path", "path.simplify_threshold": 0.25}
ILLEGAL = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
"""Characters that no XML document may hold."""


def picture(figure: Figure, alt: str, caption: str) -> Picture:
    """Return a figure for a page: letters as outlines, no date; oversized data are rasterised.

    Args:
        figure: the figure.
        alt: description for readers who can't see it.
        caption: what it shows and how to read it.
    """
    svg = _svg(figure)
    if len(svg) > LARGEST:
        for axes in figure.axes:
            for artist in (*axes.lines, *axes.collections, *axes.patches, *axes.images):
                artist.set_rasterized(True)  # drawn data, but not the frame or the words around it
        svg = _svg(figure)
    letters = [text.get_fontsize() for text in figure.findobj(Text) if text.get_text().strip()]
    width = 72 * figure.get_size_inches()[0]
    readable = ceil(10 * width / min(letters)) if letters else 0  # letters of 10 px are legible
    return Picture(svg, alt, caption, readable, png=_drawn(figure, "png", ("Software",)))


def picture_in(path: Path, alt: str, size: int = 0) -> Picture:
    """Return a PNG or JPEG file as a picture, written again as PNG: nothing of the file but its dots goes on a page.

    Args:
        path: the file.
        alt: description.
        size: [px] largest width and height; 0 as the file has them, with the title in it, if any, as description.

    Raises:
        InputError: there is no such file, or it is no such image.
    """
    expected = "a PNG or JPEG image"
    data, again = BytesIO(read_bytes(path, expected)), BytesIO()
    try:
        with Image.open(data, formats=("PNG", "JPEG")) as image:
            image.load()
            title = " ".join(str(image.info.get("Title", "")).split())[:200] if not size else ""
            upright = ImageOps.exif_transpose(image).convert("RGBA")
            upright.thumbnail((size, size) if size else upright.size)
            upright.save(again, "PNG", icc_profile=None)
    except Exception:  # Pillow raises anything for a damaged file
        raise refusal(one_line(str(path)), "no readable image", expected, "name another file") from None
    return Picture("", title or alt, title or alt, png=again.getvalue())


def _svg(figure: Figure) -> str:
    svg = ILLEGAL.sub("", _drawn(figure, "svg", ("Creator", "Date", "Format", "Type")).decode("utf-8"))
    return svg[svg.index("<svg") :]


def _drawn(figure: Figure, form: str, nothing: tuple[str, ...]) -> bytes:
    file = BytesIO()
    with warnings.catch_warnings(), rc_context(SETTINGS):
        warnings.filterwarnings("ignore", "Glyph .* missing from", UserWarning)
        figure.savefig(file, format=form, dpi=200, metadata=dict.fromkeys(nothing))
    return file.getvalue()
