"""The picture of an arm: to scale, nothing off the paper, names as they are."""

from dataclasses import replace

import jax
import numpy as np
import pytest
from arms import DATA
from chain_files import chain_file
from figures import HOSTILE
from matplotlib.backends.backend_agg import FigureCanvasAgg

from ident.arm.arm import Arm
from ident.description.file import ArmFile, parse_arm, read_arm
from ident.report.report import text_of
from ident.studies.look.arm_view import arm_view
from ident.studies.look.show_figure import Mark, fitting, show_figure, spread
from ident.studies.look.show_report import show_sections

jax.config.update("jax_enable_x64", True)

pytestmark = pytest.mark.slow

TEMPLATES = DATA.parent / "ident" / "description" / "templates"
ARMS = [DATA / "lcd_arm" / "arm.toml", TEMPLATES / "scara.toml", TEMPLATES / "six-axis.toml"]


def inside(figure):
    """Whether all that is written lies within the picture."""
    renderer = FigureCanvasAgg(figure).get_renderer()
    figure.draw_without_rendering()
    texts = [*figure.texts, *(text for axes in figure.axes for text in (*axes.texts, axes.title))]
    boxes = [text.get_window_extent(renderer) for text in texts if text.get_text()]
    return all(
        b.x0 >= -2 and b.y0 >= -2 and b.x1 <= figure.bbox.width + 2 and b.y1 <= figure.bbox.height + 2 for b in boxes
    )


def without_points(arm_file):
    """An arm without modes, which would take long to compile."""
    return replace(arm_file, arm=replace(arm_file.arm, points=()))


@pytest.mark.parametrize("path", ARMS, ids=lambda path: path.stem)
def test_an_arm_is_drawn_to_scale_and_within_the_picture(path):
    """One with its modes, the others without."""
    arm_file = read_arm(path)
    figure = show_figure(arm_view(arm_file if path == ARMS[0] else without_points(arm_file)))
    assert inside(figure)
    scales = []
    for axes in figure.axes[:2]:
        origin, corner = axes.transData.transform([(0.0, 0.0), (1.0, 1.0)])
        scales += list(corner - origin)
    np.testing.assert_allclose(scales, scales[0], rtol=1e-9)


def test_hostile_names_are_drawn_as_they_are():
    drawn = arm_view(read_arm(ARMS[0]))
    arm = drawn.arm
    view = replace(drawn, arm_file=ArmFile(Arm(HOSTILE, arm.joints, arm.points, arm.payloads), "", "", {}))
    assert inside(show_figure(view))
    assert max(map(len, text_of(show_sections(view), details=True).splitlines())) <= 100


@pytest.mark.parametrize("turned", [False, True])
def test_an_arm_of_many_joints_is_named_as_far_as_there_is_room(turned):
    text = chain_file(24)
    arm = parse_arm(text.replace("[100, 0, 0]", "[0, 0, 100]").replace("[50, 0, 0]", "[0, 0, 50]") if turned else text)
    figure = show_figure(arm_view(without_points(ArmFile(arm, "", "", {}))))
    assert inside(figure)
    words = {text.get_text() for axes in figure.axes for text in axes.texts}
    assert len({word for word in words if word.startswith("link")}) >= 20


def test_labels_keep_their_order_and_distance():
    places = np.random.default_rng(5).uniform(0, 3, 20).tolist()
    found = spread(places, 0.2, -1.0, 4.0)
    assert (np.diff(found[np.argsort(places)]) >= 0.2 - 1e-12).all()
    np.testing.assert_allclose(spread([0.0, 1.0, 2.0], 0.5, -1, 3), [0.0, 1.0, 2.0])
    np.testing.assert_allclose(spread([1.0, 1.0], 0.5, -1, 3), [0.75, 1.25])
    np.testing.assert_allclose(spread([3.0, 2.9], 0.5, -1, 3), [3.0, 2.5])
    np.testing.assert_allclose(spread([0.5] * 5, 0.25, 0.0, 1.0), [0.0, 0.25, 0.5, 0.75, 1.0])
    assert spread([], 0.5, 0.0, 1.0).size == 0


def test_odd_ones_are_named_first():
    marks = [Mark(str(i), np.zeros(2), odd=i in (3, 7)) for i in range(10)]
    assert [mark.words for mark in fitting(marks, 1.0, 0.5)] == ["0", "3", "7"]
