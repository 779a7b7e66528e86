from dataclasses import replace

import numpy as np
import pytest
from arms import lcd_arm
from figures import HOSTILE, assert_tidy
from matplotlib.backends.backend_agg import FigureCanvasAgg

from ident.arm.arm import Arm
from ident.identify.modal_analysis import modal_analysis
from ident.report.document import save
from ident.studies.look.predict_figure import frequency_figure, mode_figure
from ident.studies.look.prediction import Prediction
from ident.studies.working.path_figure import motion_animation, path_figure
from ident.vibrate.motion import stroke
from ident.vibrate.response import outline
from ident.vibrate.simulate import simulate

pytestmark = pytest.mark.slow

MOTION = (1.0, -2.0, 1.0)


def along_motion(arm, *alpha):
    return [Prediction(modal_analysis(arm, tuple(a * m for m in MOTION), modes=2)) for a in alpha]


def test_modes_are_drawn_in_two_views(tmp_path):
    figure = mode_figure(modal_analysis(lcd_arm(), (0.0, 0.0, 0.0)))
    assert len(figure.axes) == 8
    titles = [a.get_title(loc="left") for a in figure.axes]
    assert titles[0] == "1: lateral torsion 1, 4.12 Hz, from the side"
    assert titles[3] == "2: vertical bending 1, 4.80 Hz, from above"
    length = 2 * np.hypot(1.0, 0.12) + np.hypot(2.79, 0.05)
    assert f"exaggerated to {0.12 * length:.2g} m" in figure.get_suptitle()
    assert all("[m]" in a.get_ylabel() for a in figure.axes)
    assert_tidy(figure)
    save(figure, tmp_path / "modes.png")


def test_branches_cross_along_the_motion():
    figure = frequency_figure(along_motion(lcd_arm(), 0.0, np.radians(80.0)), 0)
    (axes,) = figure.axes
    drawn = {
        round(float(x)): round(float(y), 2)
        for line in axes.lines
        if line.get_marker() == "o" and len(line.get_xdata())
        for x, y in zip(line.get_xdata(), line.get_ydata(), strict=True)
    }
    grey = [line for line in axes.lines if line.get_marker() == "None"]
    low, high = (np.asarray(line.get_ydata()) for line in grey)
    assert drawn[0] == round(high[0], 2)
    assert drawn[80] == round(low[1], 2)
    assert "[Hz]" in axes.get_ylabel()
    assert axes.get_xlabel() == "angle of joint1 [deg], postures from (0, 0, 0) deg to (80, -160, 80) deg"
    assert_tidy(figure)


def test_wide_bands_stand_beside_each_other_in_the_colour_of_their_mode():
    rng = np.random.default_rng(0)
    plain = [each.analysis for each in along_motion(lcd_arm(), 0.0, 0.5)]
    along = [Prediction(each, each.modes.frequency[:, None] * np.exp(0.3 * rng.normal(size=(2, 9)))) for each in plain]
    (axes,) = frequency_figure(along, 0).axes
    (bands,) = axes.collections
    places = [segment[0, 0] for segment in bands.get_segments()]
    assert len(set(np.round(places, 9))) == len(places) == 4
    assert len({tuple(colour) for colour in bands.get_colors()}) == 2
    np.testing.assert_allclose(bands.get_segments()[0][:, 1], along[0].frequency_band[:, 0])


def test_hostile_names_are_drawn_as_they_are(tmp_path):
    arm = Arm(HOSTILE, lcd_arm().joints, lcd_arm().points)
    along = [Prediction(replace(each.analysis, arm=arm)) for each in along_motion(lcd_arm(), 0.0, 0.5)]
    figure = frequency_figure(along, 0)
    assert_tidy(figure)
    save(figure, tmp_path / "frequencies.png")
    analysis = modal_analysis(lcd_arm(), (0.0, 0.0, 0.0), modes=1)
    save(mode_figure(replace(analysis, arm=arm)), tmp_path / "modes.png")


MOMENTS = np.linspace(0.2, 0.9, 3)


@pytest.fixture(scope="module")
def moved():
    arm = lcd_arm().replace({"drive2.error": 1e-4})
    response = simulate(arm, stroke(arm.stroke, percent=200, dwell=0.5), rate=100.0)
    return response, outline(arm, response, MOMENTS, factor=20.0)


def test_figures_say_the_factor_and_an_animation_has_a_picture_for_each_moment(moved):
    response, shown = moved
    animation = motion_animation(response, shown, fps=10)
    text = animation.to_jshtml(fps=10)
    assert text.count("data:image/png") == len(MOMENTS)
    title = animation._fig.axes[0].get_legend().get_title().get_text()
    assert title == "extension, cycloid, 200 %, 3.5 times faster than the arm", "0.35 s ten times a second"
    for figure in (path_figure(response, shown), animation._fig):
        FigureCanvasAgg(figure).draw()
        side, above = figure.axes
        assert "20 times as large" in "".join(text.get_text() for text in side.get_legend().get_texts())
        assert [axes.texts[0].get_text() for axes in figure.axes] == ["from the side", "from above"]
        assert side.get_aspect() == above.get_aspect() == 1.0
