"""A report as a PDF in A4, by fpdf2, with embedded fonts; no text is read as markup."""

from collections.abc import Iterator
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path
from typing import Any
from zlib import compress

from fpdf import FPDF
from fpdf.enums import XPos, YPos
from fpdf.fonts import FontFace
from matplotlib import get_data_path
from PIL import Image

from ident.errors import refusal, require
from ident.files import replace_file
from ident.report.page import Page, Picture, Section, columns
from ident.report.report import Table, cut
from ident.report.templates import shown
from ident.text import one_line

WIDTH, HEIGHT, EDGE, FOOT = 210.0, 297.0, 16.0, 18.0
"""Paper, its margins, and the room of the foot [mm]."""
LINE, GAP, PAD, BEGINNING = 1.3, 2.5, 2.8, 45.0
"""Height of a line in letters; gap below a part, space within a cell, room for the beginning of a table [mm]."""
BODY, SMALL, HEADING, TITLE = 9.5, 8.0, 13.0, 18.0
"""Sizes of letters [pt]."""
LAYOUTS = ((8.0, "P"), (7.0, "P"), (6.0, "P"), (8.0, "L"), (7.0, "L"), (6.0, "L"))
"""Size of a table's letters [pt] and turn of its page; the first one that it fits."""
LABELS, WIDEST = 32.0, 70.0
"""Width of a list's labels, and up to which a word widens its column [mm]."""
LINES_MAX, LETTER = 14, 0.5
"""Lines of a cell before it is cut, lest a row is higher than a page; width of a letter, relative to its size."""
RESOLUTIONS, HEAVY = ((200.0, 48), (100.0, 24)), 100_000
"""Dots of a figure [1/inch] and its colours; the second where the first has more bytes than these: traces of noise."""
INK, SOFT, RULE, BAND = "#1b1f24", "#57606a", "#d0d7de", "#f3f5f7"
COLOURS = {"good": ("#0f5323", "#dff5e3"), "caution": ("#6b3d00", "#fff1cc"), "bad": ("#86151b", "#ffe3e1")}
"""Letters and ground of a verdict."""


def write_pdf(page: Page, path: Path, font: str | Path | None = None) -> None:
    """Write a page as a PDF, completely or not at all.

    Args:
        page: the page.
        path: path of the file.
        font: TrueType font for letters that DejaVu Sans lacks.

    Raises:
        InputError: a letter that no font has, or a file that is no font; the file can't be written.
    """
    paper = Paper(cut(page.title, 90), font)
    paper.draw(page)
    known = f"letters of DejaVu Sans{f' or {one_line(Path(font).name)}' if font else ''}"
    got = ", ".join(f"{letter} (U+{ord(letter):04X})" for letter in [*paper.missing][:3])
    require(not got, one_line(path.name), got, known, "give a TrueType font that has it (`font`)")
    with _readable(font):
        data = paper.output()
    replace_file(path, lambda file: file.write(data), make_folders=True)


@contextmanager
def _readable(font: str | Path | None) -> Iterator[None]:
    """Refuse a user's own font if it fails: fontTools raises anything for a damaged file."""
    try:
        yield
    except Exception:
        if font is None:
            raise
        got, expected = "no readable font", "a TrueType font (.ttf)"
        raise refusal(one_line(str(font)), got, expected, "name another (`font`)") from None


class Paper(FPDF):
    """A page on paper; `missing` holds the letters that no font has."""

    def __init__(self, title: str, font: str | Path | None):
        super().__init__(format="A4")
        self.set_margins(EDGE, EDGE)
        self.set_auto_page_break(auto=True, margin=FOOT)
        self.own, self.missing = title, dict[str, None]()
        files = Path(get_data_path()) / "fonts" / "ttf"
        self.add_font("body", "", files / "DejaVuSans.ttf")
        self.add_font("body", "B", files / "DejaVuSans-Bold.ttf")
        if font is not None:
            with _readable(font):
                self.add_font("other", "", font)
            self.set_fallback_fonts(["other"], exact_match=False)
        body, bold, other = ({*getattr(self.fonts.get(key), "cmap", ())} for key in ("body", "bodyB", "other"))
        self.letters = (body & bold) | other
        self.set_title(self.words(title))
        self.set_lang("en")
        self.set_draw_color(RULE)
        self.add_page()

    def footer(self) -> None:
        """Draw title and number of a page."""
        self.set_y(self.h - FOOT + 6)
        self.style(7, colour=SOFT)
        self.cell(self.epw - 20, 4, self.words(self.own))
        self.cell(20, 4, f"{self.page_no()} / {{nb}}", align="R")

    def words(self, text: str) -> str:
        """Return a text as it is drawn, without control characters."""
        text = str(shown(text))
        self.missing |= dict.fromkeys(letter for letter in text if ord(letter) not in self.letters)
        return text

    def style(self, size: float, bold: bool = False, colour: str = INK) -> float:
        """Choose letters; return the height of their line [mm]."""
        self.set_font("body", "B" if bold else "", size)
        self.set_text_color(colour)
        return LINE * size * 25.4 / 72

    def text_block(self, text: str, size: float = BODY, *, gap: float = GAP, fill: bool = False, **style: Any) -> None:
        """Draw a paragraph."""
        height = self.style(size, **style)
        below: dict[str, Any] = {"new_x": XPos.LMARGIN, "new_y": YPos.NEXT, "align": "L"}
        self.multi_cell(self.epw, height, self.words(text), fill=fill, padding=2 * fill, **below)
        self.ln(gap)

    def draw(self, page: Page) -> None:
        """Draw the page, its parts one below the other."""
        if page.logo:
            self._image(page.logo, 45.0, 22.0)
        self.text_block(page.title, TITLE, bold=True)
        if page.subtitle:
            self.text_block(page.subtitle, colour=SOFT)
        if page.verdict:
            ink, ground = COLOURS[page.verdict.kind]
            self.set_fill_color(ground)
            self.text_block(page.verdict.word, HEADING, gap=0, fill=True, bold=True, colour=ink)
            self.text_block(page.verdict.reason, fill=True, colour=ink)
            self.set_fill_color(255)
        self._pairs(page.summary)
        if page.signed:
            self._pairs(page.signed, line=2.0)
            self.add_page()
        for section in page.sections:
            self._section(section)
        self._section(Section("Inputs", (page.inputs,)))
        self._section(Section("Provenance", ()))
        self._pairs(page.provenance, SMALL)

    def _section(self, section: Section) -> None:
        self._room(1.5 * BEGINNING)
        self.start_section(self.words(cut(section.title, 90)))
        self.text_block(section.title, HEADING, bold=True)
        for part in section.parts:
            self._table(part) if isinstance(part, Table) else self.text_block(part)
        for picture in section.pictures:
            if picture.png:
                self._image(picture, WIDTH - 2 * EDGE, HEIGHT - 80)
                if picture.caption != picture.alt:  # else it is the title in the figure
                    self.text_block(picture.caption, SMALL, colour=SOFT)

    def _room(self, height: float, turn: str = "P") -> None:
        """Begin a new page where the present one has less than this height [mm], or another turn."""
        if turn != self.cur_orientation.value or (self.will_page_break(height) and self.y > self.t_margin):
            self.add_page(orientation=turn)

    def _image(self, picture: Picture, widest: float, highest: float) -> None:
        with Image.open(BytesIO(picture.png)) as opened:
            above = opened.convert("RGBA")
        image = Image.alpha_composite(Image.new("RGBA", above.size, "white"), above).convert("RGB")
        scale = min(widest / image.width, highest / image.height, 25.4 / 150)
        size = scale * image.width, scale * image.height
        for dots, colors in RESOLUTIONS:
            share = min(1.0, scale * dots / 25.4)
            shrunk = image.resize([max(1, round(share * each)) for each in image.size], Image.Resampling.LANCZOS)
            drawn = shrunk.quantize(colors)
            if len(compress(drawn.tobytes())) < HEAVY:
                break
        self._room(size[1] + 10)
        self.image(drawn, self.l_margin, self.y, *size, alt_text=self.words(picture.alt))
        self.set_y(self.y + size[1] + GAP)

    def _pairs(self, pairs: tuple[tuple[str, str], ...], size: float = BODY, *, line: float = 1.0) -> None:
        """Draw labels, each with its text."""
        named = [("" if i and label == pairs[i - 1][0] else label, text) for i, (label, text) in enumerate(pairs)]
        if named:
            height, bold = line * self.style(size), FontFace(emphasis="BOLD")
            how = {"line_height": height, "borders_layout": "HORIZONTAL_LINES" if line > 1 else "NONE"}
            self._grid(named, [LABELS, self.epw - LABELS], first=bold, **how)

    def _grid(self, rows: Any, widths: list[float], *, strong: Any = (), first: Any = None, **how: Any) -> None:
        """Draw rows of cells."""
        how = {"first_row_as_headings": False, "text_align": "LEFT", "v_align": "TOP", "padding": (0.3, 0.0), **how}
        longest = [int(LINES_MAX * width / LETTER / self.font_size) for width in widths]
        with self.table(col_widths=tuple(widths), width=sum(widths), align="LEFT", **how) as grid:
            for number, row in enumerate(rows):
                drawn = grid.row(style=FontFace(emphasis="BOLD", fill_color=BAND) if number in strong else None)
                for j, cell in enumerate(row):
                    drawn.cell(self.words(cut(cell, longest[j])), style=None if j else first)
        self.ln(GAP)

    def _table(self, table: Table) -> None:
        """Draw a table: its head on each page, never without a row."""
        rows, look = [table.head, *table.texts], columns(table)
        size, turn, widths = self._layout(table, rows, look)
        lines = [[self._width(cell) // each + 2 for cell, each in zip(row, widths, strict=True)] for row in rows[:2]]
        height = self.style(size)
        self._room(max(BEGINNING, height * (2 + sum(min(max(each), 2 * LINES_MAX) for each in lines))), turn)
        if table.caption:
            self.text_block(table.caption, SMALL, gap=0.5, bold=True)
        self.style(size)
        align = tuple("RIGHT" if each == "number" else "LEFT" for each in look)
        how = {"line_height": height, "borders_layout": "HORIZONTAL_LINES", "first_row_as_headings": True}
        self._grid(rows, widths, strong={0, *(i + 1 for i in table.strong)}, text_align=align, **how)
        if table.note:
            self.text_block(table.note, SMALL, colour=SOFT)

    def _width(self, text: str) -> float:
        return self.get_string_width(self.words(text)) + PAD

    def _layout(self, table: Table, rows: list[Any], look: list[str]) -> tuple[float, str, list[float]]:
        """Return size of letters, turn of the page and widths of columns, which have their words whole if they fit."""
        for size, turn in LAYOUTS:
            room = (WIDTH if turn == "P" else HEIGHT) - 2 * EDGE
            self.style(size, bold=True)
            full = [max(map(self._width, column)) for column in zip(*rows, strict=True)]
            least = []
            for head, kind, *cells in zip(table.head, look, *table.texts, strict=True):
                words = [word for cell in cells for word in (cell.split() if kind == "wide" else [cell])]
                least.append(min(max(map(self._width, [*head.replace(" [", "\n[").split("\n"), *words])), WIDEST))
            if sum(least) <= room:
                break
        share = min(1.0, (room - sum(least)) / max(sum(full) - sum(least), 1e-9))
        if share < 0:
            return size, turn, [each * room / sum(least) for each in least]
        return size, turn, [low + share * (high - low) for low, high in zip(least, full, strict=True)]
