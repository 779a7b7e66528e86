import numpy as np
import pytest
from arms import lcd_arm
from figures import HOSTILE, assert_tidy

from ident.arm.arm import Arm
from ident.assess.predict import Prediction, predict_draws
from ident.identify.modal_analysis import modal_analysis
from ident.present.figures.modes import frequency_figure, mode_figure
from ident.present.files.document import save

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
    draws = {f"joint{j}.k_{k}": 3e5 * np.exp(rng.normal(size=9)) for j in (1, 2, 3) for k in ("bend", "tors")}
    along = [predict_draws(each.analysis, draws) for each in along_motion(lcd_arm(), 0.0, 0.5)]
    (axes,) = frequency_figure(along, 0).axes
    (bands,) = axes.collections
    places = [segment[0, 0] for segment in bands.get_segments()]
    assert len(set(np.round(places, 9))) == len(places) == 4
    assert len({tuple(colour) for colour in bands.get_colors()}) == 2
    np.testing.assert_allclose(bands.get_segments()[0][:, 1], along[0].frequency_band[:, 0])


def test_hostile_names_are_drawn_as_they_are(tmp_path):
    arm = Arm(HOSTILE, lcd_arm().joints, lcd_arm().points)
    figure = frequency_figure(along_motion(arm, 0.0, 0.5), 0)
    assert_tidy(figure)
    save(figure, tmp_path / "frequencies.png")
    save(mode_figure(modal_analysis(arm, (0.0, 0.0, 0.0), modes=1)), tmp_path / "modes.png")
