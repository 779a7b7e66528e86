"""`ident.predict` from Python."""

import numpy as np
import pytest
from arms import DATA, lcd_arm
from reports import assert_one_screen
from results import assert_comes_back, assert_plain

import ident
from ident.arm.arm import stiffness_paths
from ident.identify.modal_analysis import modal_analysis
from ident.identify.values import Values
from ident.report.report import Table
from ident.studies.look.predict import PredictOptions, predict

ARM = DATA / "lcd_arm" / "arm.toml"


@pytest.fixture(scope="module")
def result():
    options = PredictOptions(posture=((0, 0, 0), (30.0, -60.0, 30.0)), load="glass", modes=4, set={"link2.mass": 40.0})
    return predict(ident.read_arm(ARM), options)


def test_it_analyses_every_posture(result):
    arm = lcd_arm().replace({"link2.mass": 40.0})
    direct = modal_analysis(arm, tuple(np.radians([30.0, -60.0, 30.0])), ident.Load.parse("glass"), 4)
    np.testing.assert_array_equal(result.frequencies[1], direct.modes.frequency)
    np.testing.assert_array_equal(result.deflections[1]["tip"], direct.deflection["tip"])
    assert result.labels[1] == tuple(map(str, direct.labels))
    assert result.name == "arm.predict"
    said = result.sections()
    assert "at 2 postures, load: glass" in said.subject
    assert [table.rows[0][2] for table in said.answer if isinstance(table, Table)][:2] == [
        frequencies[0] for frequencies in result.frequencies
    ]
    assert_one_screen(result.report())


def test_postures_in_radians_next_to_degrees_are_asked_about(result):
    assert result.notes == ()
    small = ((0.52, -1.05, 0.52), (30.0, -60.0, 30.0), (0.35, -0.7, 0.35), (1.0, -2.0, 1.0), (0.5, -0.25, 0.05))
    asked = predict(ident.read_arm(ARM), PredictOptions(posture=small, load="glass", modes=4))
    assert asked.notes == ("angles of 0.52 -1.05 0.52 deg (and 1 more): if they are radians, convert them",)


def test_without_options_all_angles_are_zero():
    (analysis,) = predict(lcd_arm()).analyses
    assert analysis.posture == (0.0, 0.0, 0.0)
    assert len(analysis.labels) == 6


@pytest.fixture(scope="module")
def drawn():
    """Of all stiffnesses, as where modes are named: one program serves both."""
    rng = np.random.default_rng(0)
    values = {path: lcd_arm().get(path) * np.exp(0.1 * rng.normal(size=8)) for path in stiffness_paths(lcd_arm())}
    return Values("", "", {path: np.asarray(own) for path, own in values.items()})


def test_a_posterior_gives_medians_and_bands(drawn, tmp_path):
    result = predict(lcd_arm(), PredictOptions(modes=3), posterior=drawn)
    own = predict(lcd_arm(), PredictOptions(modes=3, set=drawn.medians))
    np.testing.assert_array_equal(result.frequencies[0], own.frequencies[0])
    low, high = result.predictions[0].frequency_band
    assert np.all((low <= result.frequencies[0]) & (result.frequencies[0] <= high))
    assert np.isnan(own.predictions[0].frequency_band).all()
    assert "8 draws of the posterior of 6 numbers" in result.report()
    assert result.sections().answer[-2].head[3] == "5 to 95 %"
    assert_one_screen(result.report())
    assert result.table()[0]["frequency_q05"] == low[0]
    assert_comes_back(result, tmp_path)


def test_a_compliance_has_its_screen_bands_table_file_and_picture(drawn, tmp_path):
    result = predict(lcd_arm(), PredictOptions(tool=True, frame="tool"), posterior=drawn)
    (tool,) = (each.tool for each in result.predictions)
    report = result.report()
    assert "compliance at tip" in report
    assert "Joints only: links count as rigid, so this is a lower bound of compliance." in report
    assert f"{1e6 * tool.largest[0]:.4g}" in report
    assert_one_screen(report)
    assert "Fx [N]" in result.report(details=True)
    rows = result.table()
    assert_plain(rows)
    assert len(rows) == 36
    (lateral,) = (row for row in rows if (row["motion"], row["wrench"]) == ("y", "Mz"))
    assert lateral["compliance"] == tool.matrix[1, 5]
    assert lateral["compliance_q05"] < lateral["compliance"] < lateral["compliance_q95"]
    assert (lateral["unit"], lateral["frame"], lateral["point"]) == ("m/(N m)", "tool", "tip")
    assert_comes_back(result, tmp_path)
    figure = result.figures()["predict"]
    assert f"{1e6 * tool.largest[0]:.4g} um/N" in figure.get_suptitle()
    curves = figure.axes[2]
    np.testing.assert_allclose(curves.lines[2].get_ydata(), 1e6 * tool.response.size[2])
    assert len(curves.collections) == 3


def test_the_peaks_of_a_compliance_are_on_its_screen_and_in_its_summary(drawn):
    """Of each posture in the details where there are several."""
    result = predict(lcd_arm(), PredictOptions(tool=True), posterior=drawn)
    (tool,), (peaks,) = (each.tool for each in result.predictions), result.summary["peaks"]
    lateral = result.sections().answer[-1].rows[1]
    assert lateral[0] == "y"
    assert lateral[1] == peaks["frequency"][1]
    assert lateral[3] == 1e6 * peaks["size"][1]
    assert lateral[5] == peaks["size"][1] / tool.matrix[1, 1]
    for name in ("frequency", "size"):
        low, high = peaks[f"{name}_band"]
        assert np.all((low < peaks[name]) & (peaks[name] < high))
    assert predict(lcd_arm()).summary["peaks"] == ()
    several = predict(lcd_arm(), PredictOptions(posture=((0.0, 0, 0), (30, -60, 30)), tool=True))
    assert "Peaks at (30, -60, 30) deg" in several.report(details=True)
    assert "peak at [Hz]" not in several.report()


def test_a_compliance_at_many_postures_has_a_row_for_each():
    many = tuple((angle, -2.0 * angle, angle) for angle in (0.0, 30.0, 60.0))
    (table, words) = predict(lcd_arm(), PredictOptions(posture=many, tool=True)).sections().answer
    assert len(table.rows) == 3
    assert table.rows[1][0].startswith("largest at (30, -60, 30) deg: along (")
    assert words.startswith("Joints only")


def test_what_is_set_is_not_drawn(drawn):
    both = PredictOptions(set=dict.fromkeys(stiffness_paths(lcd_arm()), 5e4))
    with pytest.raises(ident.InputError, match="set: got every number of the posterior"):
        predict(lcd_arm(), both, posterior=drawn)


def test_one_draw_makes_no_band():
    single = Values("", "", {"joint1.k_tors": np.array([3e5])})
    with pytest.raises(ident.InputError, match="posterior: got one draw, expected two at least, for a band"):
        predict(lcd_arm(), posterior=single)


def test_a_fit_gives_its_values():
    fitted = Values("", "", {"joint1.k_tors": np.asarray(5e4)})
    result = predict(lcd_arm(), fit=fitted)
    np.testing.assert_array_equal(
        result.frequencies[0], predict(lcd_arm(), PredictOptions(set={"joint1.k_tors": 5e4})).frequencies[0]
    )
    assert "itted values of 1 number" in result.report()


def test_it_comes_back_as_it_was(result, tmp_path):
    assert_comes_back(result, tmp_path)


def test_its_table_has_a_row_for_each_mode(result):
    rows = result.table()
    assert_plain(rows)
    assert [row["mode"] for row in rows] == [1, 2, 3, 4] * 2
    assert [row["frequency"] for row in rows] == np.concatenate(result.frequencies).tolist()
    assert rows[4]["joint2"] == pytest.approx(-60.0)


def test_it_draws_the_modes_at_every_posture(result, tmp_path):
    assert [path.name for path in result.save_figures(tmp_path)] == ["arm.predict.png", "arm.predict.2.png"]
    titles = [figure.get_suptitle() for figure in result.figures().values()]
    assert "at (0, 0, 0) deg" in titles[0]
    assert "at (30, -60, 30) deg" in titles[1]


def test_it_draws_frequencies_against_the_first_joint_that_turns():
    result = predict(lcd_arm(), PredictOptions(posture=((5.0, 0.0, 0.0), (5.0, -10.0, 3.0)), modes=2))
    lowest = result.frequency_figure().axes[0].lines[0]
    np.testing.assert_allclose(lowest.get_xdata(), [0.0, -10.0])
    np.testing.assert_array_equal(lowest.get_ydata(), [each[0] for each in result.frequencies])
    assert result.frequency_figure("joint3").axes[0].get_xlabel().startswith("angle of joint3 [deg]")
    with pytest.raises(ident.InputError, match="joint: got 'joint4', expected one of joint1, joint2, joint3; did you"):
        result.frequency_figure("joint4")


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"modes": 0}, "modes: got 0, expected a number from 1"),
        ({"draws": 1}, "draws: got 1, expected a number from 2"),
        ({"set": {"link2.mass": -3.0}}, "set: got link2.mass=-3, expected a value >= 0"),
        ({"set": {"joint1.k_bend": -3.0}}, "set: got joint1.k_bend=-3"),
        ({"posture": (("30", "-60", "30"),)}, "postures, each of several angles"),
        ({"posture": (30.0, -60.0, 30.0)}, "as \\(\\(30, -60, 30\\),\\)"),
    ],
)
def test_bad_options_are_refused(options, words):
    with pytest.raises(ident.InputError, match=words):
        PredictOptions(**options)


def test_what_may_be_negative_may_be_set():
    assert PredictOptions(set={"link2.com.x": -0.1}).set == {"link2.com.x": -0.1}
