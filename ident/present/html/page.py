"""A report as one HTML file: no other file, nothing from the network, no script but that of a page within it.

What a page says comes from files that anybody may have written. Every text goes through `shown` and Jinja2's
autoescape, and a content security policy refuses whatever a text might still ask for.
"""

import base64
import re
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Literal

from jinja2 import Environment, StrictUndefined, Template
from markupsafe import escape

from ident.files import replace_file
from ident.text import one_line

TEMPLATE = "page.html.jinja"
NARROW = 32
"""Characters up to which a table's cell stays on one line."""
NUMBER = re.compile(r"\W*\d")
"""How a cell with a number begins."""
WORDS = {"accept": "Accepted", "warn": "Warning", "reject": "Rejected"}
"""How a page calls its verdict."""


@dataclass(frozen=True)
class Table:
    """Rows under a head; the first cell of a row names it, the others are numbers or a few words.

    Attributes:
        caption: what the table shows.
        head: names of the columns, with units.
        rows: cells, as many in each row as there are columns.
        note: what to know when reading it; may be empty.
        strong: numbers of the rows to emphasise, from 0.
        links: address that the name of each row leads to, relative to the page; none for no links.

    Raises:
        ValueError: a row has another number of cells than the head, an emphasised row is not there, or links are not
            as many as rows.
    """

    caption: str
    head: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    note: str = ""
    strong: tuple[int, ...] = ()
    links: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for i, row in enumerate(self.rows):
            if len(row) != len(self.head):
                raise ValueError(f"row {i} of a table has {len(row)} cells under {len(self.head)} heads")
        if not all(0 <= i < len(self.rows) for i in self.strong):
            raise ValueError(f"strong rows {self.strong} of a table with {len(self.rows)}")
        if self.links and len(self.links) != len(self.rows):
            raise ValueError(f"{len(self.links)} links in a table with {len(self.rows)} rows")


@dataclass(frozen=True)
class Picture:
    """A figure as SVG; `picture.picture` makes one.

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
    """One stage: what it has come to, and why the next one follows.

    Attributes:
        title: heading.
        findings: paragraphs.
        onward: why it goes on, or why not; may be empty.
        tables: tables, below the paragraphs.
        pictures: figures, below the tables.
        frame: a page that computes, below the figures.
    """

    title: str
    findings: tuple[str, ...]
    onward: str = ""
    tables: tuple[Table, ...] = ()
    pictures: tuple[Picture, ...] = ()
    frame: Frame | None = None


@dataclass(frozen=True)
class Verdict:
    """What the whole comes to.

    Attributes:
        kind: colour and word of the box.
        text: one or two sentences.
    """

    kind: Literal["accept", "warn", "reject"]
    text: str


@dataclass(frozen=True)
class Page:
    """A report.

    Attributes:
        title: heading of the page.
        subtitle: what it is about: arm, campaign, date.
        verdict: what the whole comes to.
        summary: paragraphs below the verdict.
        sections: the stages, in order.
        inputs: what went in, as a table: name, file, hash.
        assumptions: what was taken for granted, a sentence each.
        provenance: names and values that say how the page came about: versions, options, seeds.
        above: words and relative address of the page that led here; empty for none.
    """

    title: str
    subtitle: str
    verdict: Verdict
    summary: tuple[str, ...]
    sections: tuple[Section, ...]
    inputs: Table
    assumptions: tuple[str, ...] = ()
    provenance: tuple[tuple[str, str], ...] = ()
    above: tuple[str, str] = ("", "")


def render(page: Page) -> str:
    """Return a page as HTML; the same page gives the same text."""
    scripts = [section.frame.script for section in page.sections if section.frame]
    return _template().render(page=page, words=WORDS, scripts=scripts) + "\n"


@cache
def _template() -> Template:
    environment = Environment(
        autoescape=True, finalize=shown, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    environment.filters |= {"columns": columns, "data_uri": data_uri, "whole": escape}
    return environment.from_string((files("ident.present.html") / TEMPLATE).read_text("utf-8"))


def write_page(page: Page, path: Path) -> None:
    """Write a page as HTML, whole or not at all."""
    text = render(page).encode("utf-8")
    replace_file(path, lambda file: file.write(text), make_folders=True)


def shown(value: object) -> object:
    """Return what a page shows: control characters and those that turn the direction of text become visible.

    What the template itself made of texts stays as it is.
    """
    return value if hasattr(value, "__html__") else one_line(str(value))


def columns(table: Table) -> list[str]:
    """Return how each column is set: `wide` text on several lines, a `number` to the right, or `words`."""
    cells = [[one_line(row[j]) for row in table.rows] for j in range(len(table.head))]
    return [_look(column, names=j == 0) for j, column in enumerate(cells)]


def _look(column: list[str], *, names: bool) -> str:
    if any(len(cell) > NARROW for cell in column):
        return "wide"
    return "number" if not names and any(NUMBER.match(cell) for cell in column) else "words"


def data_uri(svg: str) -> str:
    """Return an SVG document as the address of an image."""
    return "data:image/svg+xml;base64," + base64.b64encode(svg.encode("utf-8", "replace")).decode("ascii")
