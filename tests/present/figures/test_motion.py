import numpy as np
import pytest
from arms import lcd_arm
from matplotlib.backends.backend_agg import FigureCanvasAgg

from ident.present.figures.modes import motion_animation, path_figure
from ident.vibrate.motion import stroke
from ident.vibrate.response import outline
from ident.vibrate.simulate import simulate

pytestmark = pytest.mark.slow

MOMENTS = np.linspace(0.2, 0.9, 8)


@pytest.fixture(scope="module")
def moved():
    arm = lcd_arm().replace({"drive2.error": 1e-4})
    response = simulate(arm, stroke(arm.stroke).dwell(0.1), rate=1000.0)
    return arm, response, outline(arm, response, MOMENTS, factor=20.0)


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
    assert title == "extension, cycloid, 100 %, 1 times faster than the arm"
