"""The report as a file: its structure, and what hostile texts can do to it."""

import re
from collections import Counter
from html.parser import HTMLParser
from xml.etree import ElementTree

import pytest
from pages import HOSTILE, drawing, hostile_page, sample_page, stops, table, titled

from ident.errors import InputError
from ident.report.page import (
    LARGEST,
    Page,
    Picture,
    columns,
    picture,
    render,
    write_page,
)
from ident.report.report import Table, Verdict
from ident.text import one_line

VOID = {"meta", "img"}


class Outline(HTMLParser):
    """Tags in order, those open at each text, and whether every tag is closed by its own."""

    def __init__(self, text):
        super().__init__()
        self.open, self.tags, self.texts, self.declared = [], [], [], []
        self.feed(text)
        self.close()
        assert not self.open

    def handle_decl(self, decl):
        self.declared.append(decl)

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        if data.strip():
            self.texts.append((self.open[-1], data.strip()))

    def named(self, tag):
        return [attributes for name, attributes in self.tags if name == tag]

    def texts_in(self, tag):
        return [text for name, text in self.texts if name == tag]


@pytest.fixture(scope="module")
def sample():
    return Outline(render(sample_page()))


@pytest.fixture(scope="module")
def hostile():
    return Outline(render(hostile_page()))


def test_the_head_says_language_encoding_and_what_may_load(sample):
    assert sample.declared == ["DOCTYPE html"]
    assert sample.named("html") == [{"lang": "en", "dir": "ltr"}]
    charset, policy, *others = sample.named("meta")
    assert charset == {"charset": "utf-8"}
    assert policy["http-equiv"] == "Content-Security-Policy"
    assert policy["content"].startswith("default-src 'none'; img-src data:; style-src 'unsafe-inline'")
    assert {"name": "viewport", "content": "width=device-width, initial-scale=1"} in others


def test_the_body_is_semantic(sample):
    count = Counter(tag for tag, _ in sample.tags)
    assert [count[tag] for tag in ("h1", "header", "main", "footer", "nav", "script")] == [1, 1, 1, 1, 1, 0]
    assert count["table"] == count["caption"] == 3
    assert count["figure"] == count["figcaption"] == count["img"] == 2
    assert {cell["scope"] for cell in sample.named("th")} == {"col", "row"}
    assert all(image["alt"].strip() for image in sample.named("img"))


def test_headings_follow_the_stages(sample):
    stages = ["1. Noise", "2. Elastic joints"]
    assert sample.texts_in("h2") == [*stages, "Inputs", "Provenance"]
    assert sample.texts_in("a") == sample.texts_in("h2")


def test_every_link_leads_to_a_place_on_the_page(sample):
    ids = [attributes["id"] for _, attributes in sample.tags if "id" in attributes]
    assert len(ids) == len(set(ids))
    assert [link["href"] for link in sample.named("a")] == [f"#{name}" for name in ids]


def test_emphasised_rows_and_columns_of_numbers(sample):
    strong = [i for i, row in enumerate(sample.named("tr")) if row.get("class") == "strong"]
    assert strong == [4, 8]
    assert columns(table()) == ["words"] + 6 * ["number"]
    cells = (("1", "", "-3.2e-4", "none", "x" * 33), ("2", "± 4", "open", "0x", ""))
    assert columns(Table("", tuple("abcde"), cells)) == ["words", "number", "number", "number", "wide"]
    assert columns(Table("", ("a", "b"), ())) == ["words", "words"]


def test_the_verdict_is_a_word_and_a_shape_as_well_as_a_colour():
    shapes = set()
    for kind in ("good", "caution", "bad"):
        page = Outline(render(sample_page(kind)))
        assert {"class": f"verdict {kind}", "aria-label": "Verdict"} in page.named("section")
        assert "NOT DECIDED" in page.texts_in("p")
        shapes.add(tuple(path["d"] for path in page.named("path")))
    assert len(shapes) == 3


def test_what_is_empty_leaves_no_heading():
    bare = Page("Bare", "", Verdict("OK", "Fine.", "good"), (), (), Table("Files", ("file",), ()))
    assert Outline(render(bare)).texts_in("h2") == ["Inputs"]


@pytest.mark.parametrize("page", [sample_page, hostile_page])
def test_nothing_is_fetched(page):
    text = render(page())
    for _, attributes in Outline(text).tags:
        assert not attributes.keys() & {"srcset", "style", "action", "background", "poster", "data"}
        assert not any(name.startswith("on") for name in attributes)
        assert re.match(r"data:image/svg\+xml;base64,[\w+/=]+$|$", attributes.get("src", ""))
        assert re.match(r"#[\w-]+$|$", attributes.get("href", ""))
    style = re.search("<style>(.*?)</style>", text, re.DOTALL)[1]
    assert not re.search(r"url\(|@import|@font-face|//", style)


def test_hostile_texts_are_texts(hostile, sample):
    assert {tag for tag, _ in hostile.tags} == {tag for tag, _ in sample.tags}
    shown = "".join(text for _, text in hostile.texts)
    for text in HOSTILE:
        assert one_line(text).strip() in shown
    assert "{{7*7}}" in shown
    assert "49" not in shown


def test_no_control_character_reaches_the_page():
    text = render(hostile_page())
    assert all(char.isprintable() or char == "\n" for char in text)
    assert "right\\u202eto left\\u2066 \\x00" in text


def test_the_same_page_gives_the_same_bytes(tmp_path):
    for name in ("one", "two"):
        stops.cache_clear()
        write_page(sample_page(), tmp_path / "new" / name)
    assert (tmp_path / "new" / "one").read_bytes() == (tmp_path / "new" / "two").read_bytes()
    assert (tmp_path / "new" / "one").read_text("utf-8") == render(sample_page())


def test_a_page_that_cannot_be_written_is_one_line(tmp_path):
    with pytest.raises(InputError, match="expected a file to write"):
        write_page(sample_page(), tmp_path)


def test_a_figure_is_svg_without_fonts_date_or_addresses():
    svg = picture(drawing(), "A stop", "").svg
    root = ElementTree.fromstring(svg)
    assert not [node for node in root.iter() if node.tag.endswith(("}text", "}metadata", "}date"))]
    used = {value for node in root.iter() for name, value in node.attrib.items() if name.endswith("href")}
    assert all(value.startswith("#") for value in used)
    assert not svg.startswith("<?xml")


def test_a_figure_of_a_hostile_title_is_still_svg():
    ElementTree.fromstring(picture(titled(), "A title", "").svg)


def test_a_figure_of_very_many_points_is_bounded():
    svg = picture(drawing(200_000), "Many points", "").svg
    assert len(svg) < LARGEST
    assert "data:image/png;base64" in svg
    ElementTree.fromstring(svg)


@pytest.mark.parametrize(
    ("make", "what"),
    [
        (lambda: Table("", ("a", "b"), (("1", "2"), ("short",))), "row 1 of a table has 1 cells under 2 heads"),
        (lambda: Table("", ("a",), (("1",),), strong=(1,)), "strong rows"),
        (lambda: Table("", ("a",), (("1",),), strong=(-1,)), "strong rows"),
        (lambda: Picture("", "alt", ""), "neither SVG nor PNG"),
        (lambda: Picture("<svg></svg>", " ", ""), "without an alternative text"),
    ],
)
def test_what_a_page_can_not_show_is_refused(make, what):
    with pytest.raises(ValueError, match=what):
        make()
