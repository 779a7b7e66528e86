"""The report as a reader sees it: in a browser, on a phone, in the dark and on paper."""

import re
from dataclasses import replace

import pytest
from pages import HOSTILE, drawing, hostile_page, sample_page

from ident.report.page import Section, picture, write_page
from ident.text import one_line

PHONE, DESK = (360, 740), (1280, 800)
PAGES = {"sample": sample_page, "hostile": hostile_page}
CONTRAST = """selector => {
  const light = colour => {
    const part = colour.match(/[\\d.]+/g).slice(0, 3).map(v => v / 255)
      .map(v => v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4);
    return 0.2126 * part[0] + 0.7152 * part[1] + 0.0722 * part[2];
  };
  let node = document.querySelector(selector);
  const ink = light(getComputedStyle(node).color);
  while (getComputedStyle(node).backgroundColor === "rgba(0, 0, 0, 0)") node = node.parentElement;
  const paper = light(getComputedStyle(node).backgroundColor);
  return (Math.max(ink, paper) + 0.05) / (Math.min(ink, paper) + 0.05);
}"""
"""Contrast of an element's text on its ground (WCAG 2.2)."""
TEXTS = (
    ".verdict p",
    ".verdict dt",
    ".subtitle",
    "section > p",
    "nav a",
    "tr.strong td",
    ".note",
    "figcaption",
    "footer dt",
    "footer dd",
)


@pytest.fixture(scope="module", params=PAGES)
def path(request, tmp_path_factory):
    path = tmp_path_factory.mktemp("page") / "report.html"
    write_page(PAGES[request.param](), path)
    return path


@pytest.mark.parametrize("size", [PHONE, DESK], ids=["phone", "desk"])
def test_it_opens_alone_and_in_silence(browser_page, path, size):
    with browser_page(path, *size) as opened:
        assert opened.complaints == []
        assert opened.alone
        assert opened.overhang <= 0
        assert opened.broken_images == []
        assert opened.page.evaluate("document.images.length") == 2


def test_hostile_texts_do_not_run_and_can_be_read(browser_page, tmp_path):
    write_page(hostile_page(), tmp_path / "page.html")
    with browser_page(tmp_path / "page.html", *DESK) as opened:
        assert opened.page.evaluate("window.ran") is None
        assert opened.page.evaluate("document.scripts.length + document.querySelectorAll('iframe').length") == 0
        shown = opened.page.inner_text("main")
        assert all(re.sub(" +", " ", one_line(text)) in shown for text in HOSTILE)


def test_a_wide_table_scrolls_in_its_own_box(browser_page, tmp_path):
    write_page(sample_page(), tmp_path / "page.html")
    with browser_page(tmp_path / "page.html", *PHONE) as opened:
        assert opened.page.eval_on_selector(".scroll", "box => box.scrollWidth > box.clientWidth")


@pytest.mark.parametrize(("width", "scrolls"), [(390, True), (1280, False)])
@pytest.mark.parametrize("points", [7, 9])
def test_a_figure_with_letters_too_small_scrolls_in_its_own_box(browser_page, tmp_path, width, scrolls, points):
    figure = drawing()
    figure.axes[0].set_xlabel("time [s]", fontsize=points)
    section = Section("One", (), pictures=(picture(figure, "A stop", "The stop."),))
    write_page(replace(sample_page(), sections=(section,)), tmp_path / "page.html")
    with browser_page(tmp_path / "page.html", width, 800) as opened:
        assert opened.overhang <= 0
        box, image = opened.page.locator("figure .scroll"), opened.page.locator("figure img")
        assert box.evaluate("b => b.scrollWidth > b.clientWidth") == scrolls
        assert opened.page.get_by_text("Scroll the figure sideways").is_visible() == scrolls
        letter = points * image.evaluate("i => i.clientWidth") / (72 * figure.get_size_inches()[0])
        assert letter >= 10 or not scrolls
        assert letter < 11 or not scrolls, "wider than it need be"
        box.evaluate("b => { b.scrollLeft = 1e4; }")
        ends = [each.evaluate("e => e.getBoundingClientRect().right") for each in (image, box)]
        assert ends[0] <= ends[1], "the figure can be seen to its end"


@pytest.mark.parametrize("kind", ["good", "caution", "bad"])
def test_every_text_stands_out_from_its_ground(browser_page, tmp_path, kind):
    write_page(sample_page(kind), tmp_path / "page.html")
    with browser_page(tmp_path / "page.html", *DESK) as opened:
        for scheme in ("light", "dark"):
            opened.page.emulate_media(color_scheme=scheme)
            faint = {text: contrast for text in TEXTS if (contrast := opened.page.evaluate(CONTRAST, text)) < 4.5}
            assert faint == {}, scheme
            ground = opened.page.eval_on_selector("img", "i => getComputedStyle(i).backgroundColor")
            assert ground == "rgb(255, 255, 255)"


@pytest.mark.parametrize("dark", [False, True], ids=["light", "dark"])
def test_on_paper_it_is_black_on_white(browser_page, path, dark):
    with browser_page(path, *DESK, dark=dark) as opened:
        paper = opened.page.pdf(prefer_css_page_size=True)
        assert len(re.findall(rb"/Type\s*/Page\b", paper)) >= 1
        assert re.search(rb"/MediaBox \[0 0 59[45][.\d]* 84[12]", paper)
        opened.page.emulate_media(media="print")
        assert opened.page.eval_on_selector("body", "b => getComputedStyle(b).color") == "rgb(0, 0, 0)"
        assert opened.page.eval_on_selector("body", "b => getComputedStyle(b).backgroundColor") == "rgb(255, 255, 255)"
