"""What the explorer shows beside its numbers: readings at their modes, the payload, its keys, a sheet of paper."""

import re

import numpy as np
import pytest
from arms import lcd_arm, random_arm

from ident.measure import Campaign, Measurement
from ident.studies.explore import ExploreOptions, explore

pytestmark = pytest.mark.slow

ROWS = "[...document.querySelectorAll('#modes tr')].map((row) => [...row.cells].map((c) => c.textContent.trim()))"
DRAWN = """(style) => {
    const path = document.querySelector(`#campbell path.${style}`), frame = path.parentNode.viewBox.baseVal;
    return [...path.getAttribute('d').matchAll(/[ML][0-9.-]+ ([0-9.-]+)/g)].some(([, y]) => Number(y) > frame.y);
}"""
"""Whether a part of a line lies below the upper edge of its frame."""
KEYS = "[...document.querySelectorAll('#{} li')].map((item) => item.textContent)"


def reading(value, mode=None):
    return Measurement(kind="frequency", posture=(0.0, 0.0, 0.0), value=value, sigma=0.01 * value, mode=mode)


@pytest.fixture(scope="module")
def unfolded_page(tmp_path_factory):
    rows = (reading(16.3), reading(4.11, "lateral torsion 1"), reading(13.7, "vertical bending 2"), reading(4.81))
    result = explore(lcd_arm(), ExploreOptions(posture=(0, 0, 0)), measured=Campaign(measurements=rows))
    return result.save(tmp_path_factory.mktemp("unfolded"))[0]


@pytest.fixture(scope="module")
def six_page(tmp_path_factory):
    return explore(random_arm(np.random.default_rng(0), 6)).save(tmp_path_factory.mktemp("six"))[0]


def test_readings_without_a_label_go_to_the_lowest_modes_that_no_label_takes(unfolded_page, browser_page):
    """As `ident fit` takes them."""
    with browser_page(unfolded_page, 1280, 900) as opened:
        opened.page.wait_for_function("document.querySelectorAll('#modes tr').length", polling=100)
        rows = opened.page.evaluate(ROWS)
    measured = {row[0]: row[4].split(" ")[0] for row in rows}
    assert measured["lateral torsion 1"] == "4.110"
    assert measured["vertical bending 1"] == "4.810"
    assert measured["vertical bending 2"] == "13.70"
    assert measured["lateral torsion 2"] == "16.30"


def test_the_payload_is_drawn_and_named_where_it_is_carried(unfolded_page, browser_page):
    with browser_page(unfolded_page, 1280, 900) as opened:
        page = opened.page
        page.wait_for_timeout(500)
        assert page.locator("#above rect").count() == 0
        page.locator("#slider-2").fill("7.3")
        page.wait_for_timeout(500)
        assert page.locator("#side rect").count() == page.locator("#above rect").count() == 1
        assert page.evaluate(KEYS.format("arm-key"))[-1] == "glass"


def test_a_key_names_what_lies_within_its_frame_only(unfolded_page, browser_page):
    with browser_page(unfolded_page, 1280, 900) as opened:
        opened.page.wait_for_timeout(1000)
        words = opened.page.evaluate(KEYS.format("campbell-key"))
        within = [
            style
            for style in ("vertical bending", "lateral torsion", "lateral bending", "vertical torsion")
            if opened.page.evaluate(DRAWN, style.replace(" ", "-"))
        ]
    assert within == words[: len(within)]
    assert words[len(within)] == "as given"


@pytest.mark.parametrize("page", ["unfolded_page", "six_page"])
def test_on_paper_it_is_two_sheets(page, request, browser_page):
    with browser_page(request.getfixturevalue(page), 1280, 900) as opened:
        opened.page.wait_for_timeout(1000)
        sheets = re.findall(rb"/Type\s*/Page\b", opened.page.pdf(format="A4"))
    assert len(sheets) == 2
