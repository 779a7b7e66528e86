import numpy as np
import pytest
from arms import lcd_arm
from matplotlib.backends.backend_agg import FigureCanvasAgg

from ident.errors import InputError
from ident.present.figures.motion import motion_animation, outline, path_figure
from ident.vibrate.motion.stroke import stroke
from ident.vibrate.response.simulate import simulate

MOMENTS = np.linspace(0.2, 0.9, 8)


@pytest.fixture(scope="module")
def moved():
    arm = lcd_arm().replace({"drive2.error": 1e-4})
    response = simulate(arm, stroke(arm.stroke).dwell(0.1), rate=1000.0)
    return arm, response, outline(arm, response, MOMENTS, factor=20.0)


def test_the_end_is_the_responses_end_point(moved):
    _, response, shown = moved
    at = np.searchsorted(np.asarray(response.time), MOMENTS - 1e-9)
    rest = np.asarray(response.path + response.quasi_static)[:, at]
    vibration = np.asarray(response.vibration)[:, at]
    assert shown.time == pytest.approx(MOMENTS)
    np.testing.assert_allclose(shown.rest[:, -1], rest, atol=1e-7)
    np.testing.assert_allclose(shown.drawn[:, -1], rest + 20.0 * vibration, atol=1e-6)


def test_the_rest_is_as_long_as_the_arm(moved):
    _, _, shown = moved
    lengths = np.linalg.norm(np.diff(shown.rest, axis=1), axis=0)
    offsets = [np.linalg.norm(joint.offset) for joint in lcd_arm().joints[1:]]
    assert shown.rest[:, 0] == pytest.approx(np.zeros((3, len(MOMENTS))), abs=1e-12)
    for j, offset in enumerate(offsets):
        assert lengths[j] == pytest.approx(np.full(len(MOMENTS), offset))


def test_figures_say_the_factor(moved):
    _, response, shown = moved
    animation = motion_animation(response, shown)
    animation.to_jshtml()
    for figure in (path_figure(response, shown), animation._fig):
        FigureCanvasAgg(figure).draw()
        side, above = figure.axes
        assert "20 times as large" in "".join(text.get_text() for text in side.get_legend().get_texts())
        assert [axes.texts[0].get_text() for axes in figure.axes] == ["from the side", "from above"]
        assert side.get_aspect() == above.get_aspect() == 1.0


def test_animation_has_a_picture_for_each_moment(moved):
    _, response, shown = moved
    animation = motion_animation(response, shown, fps=10)
    text = animation.to_jshtml(fps=10)
    assert text.count("data:image/png") == len(MOMENTS)
    title = animation._fig.axes[0].get_legend().get_title().get_text()
    assert title == "extension, s-curve, 100 %, 1 times faster than the arm"


@pytest.mark.parametrize(("times", "factor"), [([0.1, 5.0], 1.0), ([], 1.0), ([0.5], 0.0)])
def test_what_cannot_be_drawn_is_refused(moved, times, factor):
    arm, response, _ = moved
    with pytest.raises(InputError):
        outline(arm, response, times, factor=factor)
