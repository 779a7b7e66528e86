"""The report on paper: every text is there and is a text, tables keep their heads, letters have a font."""

import re
from dataclasses import replace
from io import BytesIO

import numpy as np
import pypdfium2
import pytest
from fontTools.fontBuilder import FontBuilder
from fontTools.pens.ttGlyphPen import TTGlyphPen
from fontTools.ttLib import TTFont
from matplotlib.figure import Figure
from pages import HOSTILE, hostile_page, sample_page
from PIL import Image

from ident.errors import InputError
from ident.report.page import Picture, Section, picture
from ident.report.pdf import write_pdf
from ident.report.report import Table
from ident.text import one_line

MOST_BYTES = 1_000_000


def pages_of(path):
    """The text of each page of a PDF, and its size [points]."""
    document = pypdfium2.PdfDocument(path)
    return [(page.get_textpage().get_text_range(), page.get_size()) for page in document]


def written(page, path, **how):
    write_pdf(page, path, **how)
    assert path.stat().st_size < MOST_BYTES
    return pages_of(path)


def of_parts(*parts, **how):
    return replace(sample_page(), sections=(Section("Part", parts, **how),))


def packed(text):
    """A text without what breaking its lines changes."""
    return re.sub(r"[\s\ufffe\x02]", "", text)


def test_all_of_a_page_is_there_in_a4_with_its_own_fonts(tmp_path):
    pages = written(sample_page(), tmp_path / "page.pdf")
    assert {tuple(map(round, size)) for _, size in pages} == {(595, 842)}
    text = " ".join(text for text, _ in pages)
    for words in ("Diagnosis of lcd_arm", "NOT DECIDED", "Slack of joint 2.", "joint11.k_tors", "Provenance"):
        assert words in text
    assert f"1 / {len(pages)}" in pages[0][0]
    data = (tmp_path / "page.pdf").read_bytes()
    assert b"/FontFile2" in data
    assert not re.search(rb"Helvetica|Times|Courier", data)


def test_hostile_texts_are_texts(tmp_path):
    pages = written(hostile_page(), tmp_path / "page.pdf")
    shown = packed("".join(text for text, _ in pages))
    assert all(packed(one_line(text))[:60] in shown for text in HOSTILE)
    assert "\u202e" not in shown
    data = (tmp_path / "page.pdf").read_bytes()
    assert not re.search(rb"/(JavaScript|JS|URI|Launch|AA|EmbeddedFile)\b", data)


@pytest.mark.parametrize("before", range(24, 32))
def test_no_head_of_a_table_stands_without_a_row(tmp_path, before):
    """Where it comes at the foot of the first page, which 30 lines fill."""
    rows = tuple((f"row{i}", "words " * 12, float(i)) for i in range(60))
    table = Table("Caption", ("headname", "what is said", "value [mm]"), rows, ("", "", ".1f"))
    pages = written(of_parts(*(f"line {i}" for i in range(before)), table), tmp_path / "page.pdf")
    with_rows = [text for text, _ in pages if re.search(r"row\d", text)]
    assert len(with_rows) > 1
    for text, _ in pages:
        assert ("headname" in text) == bool(re.search(r"row\d", text)), "each page with rows has the head, no other"
        assert "Caption" not in text or "headname" in text
    assert packed("".join(with_rows)).count("row") == 60


@pytest.mark.parametrize(("columns", "turned"), [(6, False), (16, True), (40, True)])
def test_a_wide_table_is_whole(tmp_path, columns, turned):
    head = ("name", *(f"number {j}" for j in range(1, columns)))
    rows = tuple((f"joint{i}.k_tors", *(f"{i}.{j:03d}" for j in range(1, columns))) for i in range(5))
    drawn = picture(Figure(figsize=(9, 3)), "A figure", "A figure")
    pages = written(of_parts(Table("", head, rows), pictures=(drawn,)), tmp_path / "page.pdf")
    for page in pypdfium2.PdfDocument(tmp_path / "page.pdf"):
        for image in page.get_objects([pypdfium2.raw.FPDF_PAGEOBJ_IMAGE]):
            assert image.get_bounds()[2] < page.get_width()
    assert any(size[0] > size[1] for _, size in pages) == turned
    shown = packed("".join(text for text, _ in pages))
    assert all(cell in shown for row in rows for cell in row[1:])


def test_names_of_300_letters_and_cells_of_many_words_have_room(tmp_path):
    rows = tuple((f"{i}" + "w" * 300, "many words " * 90, "x" * 300, "1.0") for i in range(4))
    pages = written(of_parts(Table("", ("W" * 300, "b", "c", "d"), rows)), tmp_path / "page.pdf")
    assert all(f"{i}www" in packed("".join(text for text, _ in pages)) for i in range(4))


def test_a_transparent_ground_is_paper(tmp_path):
    mark = BytesIO()
    Image.new("RGBA", (20, 10), (0, 0, 0, 0)).save(mark, "PNG")
    page = replace(sample_page(), logo=Picture("", "Logo", "Logo", png=mark.getvalue()))
    written(page, tmp_path / "page.pdf")
    first = pypdfium2.PdfDocument(tmp_path / "page.pdf")[0].render().to_pil()
    assert first.crop((48, 48, 58, 53)).convert("L").getextrema() == (255, 255)


def test_a_figure_of_noise_is_small_enough(tmp_path):
    figure, noise = Figure(figsize=(9, 10)), np.random.default_rng(0).normal(size=(8, 4000))
    for axes, trace in zip(figure.subplots(8), noise, strict=True):
        axes.plot(trace, linewidth=0.5)
    drawn = picture(figure, "Noise", "Noise")
    written(of_parts(pictures=(drawn,) * 4), tmp_path / "page.pdf")


def font_of(letter, path):
    """Write a font that has one letter."""
    pen = TTGlyphPen(None)
    for move, *places in ((pen.moveTo, (0, 0)), (pen.lineTo, (0, 700)), (pen.lineTo, (500, 0))):
        move(*places)
    pen.closePath()
    glyph, builder = pen.glyph(), FontBuilder(1000, isTTF=True)
    builder.setupGlyphOrder([".notdef", "one"])
    builder.setupCharacterMap({ord(letter): "one"})
    builder.setupGlyf({".notdef": glyph, "one": glyph})
    builder.setupHorizontalMetrics({".notdef": (600, 0), "one": (600, 0)})
    builder.setupHorizontalHeader(ascent=800, descent=-200)
    builder.setupNameTable({"familyName": "One", "styleName": "Regular"})
    builder.setupOS2(sTypoAscender=800, usWinAscent=800, usWinDescent=200)
    builder.setupPost()
    builder.save(path)
    return path


def test_a_letter_without_a_font_is_refused_before_anything_is_written(tmp_path):
    page, path = of_parts("the robot 中 of the hall"), tmp_path / "page.pdf"
    with pytest.raises(InputError, match=r"^page.pdf: got 中 \(U\+4E2D\), expected letters of DejaVu Sans; give a Tru"):
        write_pdf(page, path)
    assert not path.exists()
    pages = written(page, path, font=font_of("中", tmp_path / "one.ttf"))
    assert "中" in pages[0][0]
    with pytest.raises(InputError, match=r"got 文 \(U\+6587\), expected letters of DejaVu Sans or one.ttf"):
        write_pdf(of_parts("文"), path, font=tmp_path / "one.ttf")


@pytest.mark.parametrize("content", [b"no font", b"", b"\0\1\0\0" + bytes(60)])
def test_a_file_that_is_no_font_is_one_line(tmp_path, content):
    (tmp_path / "bad.ttf").write_bytes(content)
    with pytest.raises(
        InputError, match=r"bad.ttf: got no readable font, expected a TrueType font \(.ttf\); name another"
    ):
        write_pdf(sample_page(), tmp_path / "page.pdf", tmp_path / "bad.ttf")
    with pytest.raises(InputError, match=r"none.ttf: got no readable font"):
        write_pdf(sample_page(), tmp_path / "page.pdf", tmp_path / "none.ttf")
    assert not (tmp_path / "page.pdf").exists()


def test_a_font_whose_letters_are_damaged_is_one_line(tmp_path):
    """Its tables are read, and the letter is one of them; drawing it fails."""
    font = font_of("中", tmp_path / "bad.ttf")
    data = bytearray(font.read_bytes())
    with TTFont(font) as whole:
        start, length = whole.reader.tables["glyf"].offset, whole.reader.tables["glyf"].length
    data[start : start + length] = b"\xee" * length
    font.write_bytes(data)
    with pytest.raises(InputError, match=r"bad.ttf: got no readable font"):
        write_pdf(of_parts("中"), tmp_path / "page.pdf", font)
    assert not (tmp_path / "page.pdf").exists()
