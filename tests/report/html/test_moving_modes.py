"""The first modes as a picture that moves: shapes as the model has them, no motion for who wants none."""

from xml.etree import ElementTree

import numpy as np
import pytest
from arms import DATA

from ident.description.file import read_arm
from ident.studies.look.arm_view import arm_view
from ident.studies.look.moving_modes import moving_modes

SVG = "{http://www.w3.org/2000/svg}"


@pytest.fixture(scope="module")
def view():
    return arm_view(read_arm(DATA / "lcd_arm" / "arm.toml"))


def points(text):
    return np.array([pair.split(",") for pair in text.split()], float)


def test_each_mode_swings_between_its_own_ends(view):
    root = ElementTree.fromstring(moving_modes(view))
    rest, moved = view.analysis.outline
    for i, group in enumerate(root.findall(f"{SVG}g")):
        name, seen = (text.text for text in group.findall(f"{SVG}text"))
        assert f"{view.analysis.modes.frequency[i]:.2f} Hz, {view.analysis.labels[i]}" in name
        still, moving = group.findall(f"{SVG}polyline")
        middle = points(still.get("points"))
        up, down, again = map(points, moving[0].get("values").split(";"))
        np.testing.assert_allclose((up + down) / 2, middle, atol=0.11)
        assert (up == again).all()
        assert seen.endswith(", exaggerated, slowed down")
        shown = [0, 1] if seen.startswith("from above,") else [0, 2]
        size = np.ptp(middle[:, 0]) / np.ptp(rest[0])
        expected = moved[shown, :, i] / np.linalg.norm(moved[:, :, i], axis=0).max()
        swing = (up - down).T / 2 * [[1], [-1]] / size
        largest = np.abs(swing).max()
        np.testing.assert_allclose(swing / largest, expected / np.abs(expected).max(), atol=0.01)


@pytest.mark.parametrize("reduced", ["reduce", "no-preference"])
def test_who_wants_no_motion_sees_none(view, browser, tmp_path, reduced):
    path = tmp_path / "modes.svg"
    path.write_text(moving_modes(view), "utf-8")
    page = browser.new_page(reduced_motion=reduced)
    page.goto(path.as_uri())
    page.wait_for_timeout(100)
    first = page.screenshot()
    page.wait_for_timeout(500)
    assert (page.screenshot() == first) == (reduced == "reduce")
    page.close()
