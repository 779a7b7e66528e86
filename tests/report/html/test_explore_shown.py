"""What the explorer shows beside its numbers: readings at their modes, the payload, its keys, a sheet of paper."""

import re

import numpy as np
import pytest
from arms import lcd_arm, random_arm
from examples import DOCS, ROOT
from numbers_in_text import same_text
from one_program import shown

from ident.measure import Campaign, Load, Measurement
from ident.studies.look.explore import ExploreOptions, explore

pytestmark = pytest.mark.slow

ROWS = "[...document.querySelectorAll('#modes tr')].map((row) => [...row.cells].map((c) => c.textContent.trim()))"
DRAWN = """(style) => {
    const path = document.querySelector(`#campbell path.${style}`), frame = path.parentNode.viewBox.baseVal;
    return [...path.getAttribute('d').matchAll(/[ML][0-9.-]+ ([0-9.-]+)/g)].some(([, y]) => Number(y) > frame.y);
}"""
"""Whether a part of a line lies below the upper edge of its frame."""
KEYS = "[...document.querySelectorAll('#{} li')].map((item) => item.textContent)"

STATIC = DOCS / "static" / "arm.explore.html"
"""The page of the manual; `docs/pictures.py explore` makes it."""


def reading(value, mode=None):
    return Measurement(kind="frequency", posture=(0.0, 0.0, 0.0), value=value, sigma=0.01 * value, mode=mode)


@pytest.fixture(scope="module")
def unfolded_page(browser, tmp_path_factory):
    rows = (reading(16.3), reading(4.11, "lateral torsion 1"), reading(13.7, "vertical bending 2"), reading(4.81))
    result = explore(lcd_arm(), ExploreOptions(posture=(0, 0, 0)), measured=Campaign(measurements=rows))
    return result.save(tmp_path_factory.mktemp("unfolded"))[0]


@pytest.fixture(scope="module")
def six_page(browser, tmp_path_factory):
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


PULLED = Load(masses=((3.5, "tip"),), forces=(((6.0, -8.0, 3.0), "tip"),))
LOADS = ((PULLED, Load()), (Load(("glass",)), Load(masses=((1.0, "tip"),))))


def static_readings(arm):
    """One of each kind that instruments read at rest, under each load, at two postures."""
    q, read = (0.4, -0.9, 1.3), {"point": "tip", "direction": (0.0, 0.6, -0.8)}
    twist = {"joint": arm.joints[1].name}
    return [
        Measurement(kind=kind + end, posture=posture, value=1e-3, sigma=1e-5, load=load, **where, **against)
        for posture in (q, (0.0, 0.0, 0.0))
        for load, reference in LOADS
        for kind, where in (("deflection", read), ("rotation", read), ("twist", twist))
        for end, against in (("", {}), ("_difference", {"reference_load": reference}))
    ]


def test_readings_at_rest_are_those_of_predict(tmp_path, browser_page):
    """Under loads of their own, whatever hangs on the arm on the page."""
    arm = lcd_arm()
    campaign = Campaign(measurements=tuple(static_readings(arm)))
    expected = shown(arm, campaign)
    options = ExploreOptions(load="2 kg @ tip", posture=(0, 0, 0))
    with browser_page(explore(arm, options, measured=campaign).save(tmp_path)[0], 1280, 900) as opened:
        found = opened.page.evaluate("explorer.read()")
        opened.page.wait_for_function("!document.getElementById('read-part').hidden", polling=100)
        rows = opened.page.evaluate(ROWS.replace("#modes", "#read"))
    np.testing.assert_allclose(found, expected, atol=1e-12)
    assert (np.abs(expected) > 1e-5).sum() == 20, "glass twists no upright pin"
    assert len(rows) == len(campaign) / 2
    value = f"{1e3 * expected[len(campaign) // 2]:.3f}"
    pulled = "3.5 kg @ tip + 6 N x @ tip + 8 N -y @ tip + 3 N z @ tip"
    assert rows[0] == [f"deflection of tip along 0 0.6 -0.8under {pulled}", value, value, "1.00 ± 0.01", "mm"]
    assert rows[-1] == ["twist of joint2glass less 1 kg @ tip", "0.000", "0.000", "1.00 ± 0.01", "mrad"]


def test_the_page_of_the_manual_is_as_it_is_written_today(monkeypatch):
    monkeypatch.chdir(ROOT)
    page = explore("data/lcd_arm/arm.toml", measured="data/lcd_arm/campaign.csv").page()
    assert same_text(page, STATIC.read_text(encoding="utf-8"))
    assert STATIC.stat().st_size < 200_000


@pytest.mark.parametrize("size", [(1280, 900), (390, 844)], ids=["desktop", "phone"])
def test_the_page_of_the_manual_opens(browser_page, size):
    """Without a network, and as wide as the screen."""
    with browser_page(STATIC, *size) as opened:
        opened.page.wait_for_function("document.querySelectorAll('#modes tr').length", polling=100)
        assert opened.page.evaluate(ROWS)[0]
        assert not opened.complaints
        assert opened.overhang <= 0
        assert all(address.startswith("file:") for address in opened.requests)
