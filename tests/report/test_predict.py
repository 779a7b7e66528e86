from dataclasses import replace

import equinox as eqx
import numpy as np
import pytest
from arms import lcd_arm, random_arm
from reports import assert_one_screen, too_wide

from ident.arm.arm import Arm
from ident.errors import InputError, ModelError
from ident.identify.modal_analysis import modal_analysis
from ident.measure import Load
from ident.report.report import text_of
from ident.studies.look.predict_report import predict_sections
from ident.studies.look.prediction import Prediction

pytestmark = pytest.mark.slow

UNFOLDED = (0.0, 0.0, 0.0)


def test_table_1_of_the_paper():
    found = modal_analysis(lcd_arm(), UNFOLDED, Load(), 6)
    by_label = dict(zip(map(str, found.labels), found.modes.frequency, strict=True))
    assert by_label["vertical bending 1"] == pytest.approx(4.80, abs=0.005)
    assert by_label["lateral torsion 1"] == pytest.approx(4.12, abs=0.005)
    assert found.deflection["tip"][2] == pytest.approx(-0.0263, abs=5e-5)
    np.testing.assert_allclose(found.modes.bend.sum(0) + found.modes.tors.sum(0), 1)
    assert not found.ambiguous.any()
    assert list(found.beyond_limits()) == []


def test_damping_is_the_strain_energy_mean_of_the_bushings():
    """Light damping: ratio = (omega / 2) sum of shares times tau."""
    found = modal_analysis(lcd_arm(), UNFOLDED, Load(), 3)
    omega = 2 * np.pi * found.modes.frequency
    expected = omega / 2 * (found.modes.bend.sum(0) * 2e-4 + found.modes.tors.sum(0) * 2e-3)
    np.testing.assert_allclose(found.damping_ratio, expected, rtol=0.02)


@pytest.mark.parametrize(("asked", "given"), [(1, 1), (4, 4), (9, 9), (50, 9)])
def test_as_many_modes_as_asked_for_or_as_there_are(asked, given):
    found = modal_analysis(lcd_arm(), UNFOLDED, Load(), asked)
    assert found.modes.frequency.shape == found.damping_ratio.shape == found.ambiguous.shape == (given,)
    assert found.modes.shape.shape == (9, given)
    assert found.modes.motion.shape == (3, 1, given)
    assert len(found.labels) == given


def test_load_lowers_frequencies_and_the_tip():
    bare, loaded = (modal_analysis(lcd_arm(), UNFOLDED, Load.parse(load), 2) for load in ("", "glass + 5 kg @ tip"))
    assert (loaded.modes.frequency < bare.modes.frequency).all()
    assert loaded.deflection["tip"][2] < bare.deflection["tip"][2] - 0.005


@pytest.mark.parametrize(
    ("posture", "load", "word"),
    [
        ((0.0,), "", "got 1 joint angle, expected 3"),
        ((0.0,) * 4, "", "got 4 joint angles, expected 3"),
        ((0.0, 0.0, float("nan")), "", "finite"),
        (UNFOLDED, "glas", "glass"),
        (UNFOLDED, "5 kg @ top", "tip"),
    ],
)
def test_what_does_not_fit_the_arm_is_refused(posture, load, word):
    with pytest.raises(InputError, match=word) as error:
        modal_analysis(lcd_arm(), posture, Load.parse(load), 6)
    assert len(str(error.value).splitlines()) == 1


def test_an_arm_without_points_is_refused():
    with pytest.raises(InputError, match="no point"):
        modal_analysis(Arm("bare", lcd_arm().joints), UNFOLDED, Load(), 6)


def test_an_arm_that_collapses_is_told():
    soft = lcd_arm().replace({"joint1.k_bend": 100.0})
    with pytest.raises(ModelError, match="no stable equilibrium at"):
        modal_analysis(soft, UNFOLDED, Load(), 6)


def said(posture, modes):
    return predict_sections([Prediction(modal_analysis(lcd_arm(), posture, Load(), modes))])


def test_modes_shares_and_deflections_are_reported():
    report = said(UNFOLDED, 4)
    assert report.subject.startswith("LCD transfer arm at (0, 0, 0) deg, load: own weight")
    assert report.verdict is None
    modes, deflection = report.answer
    assert modes.texts[1] == ("2", "vertical bending 1", "4.8000", "0.30", "joint1.k_bend 44 %, joint2.k_bend 35 %")
    assert deflection.texts[0][3] == "-26.300"
    ((shares,),) = (section.parts for section in report.details)
    assert shares.texts[1] == ("vertical bending 1", "44", "0", "35", "0", "21", "0")
    assert not report.findings
    assert_one_screen(text_of(report))


def test_joint_limits_are_warned_of():
    assert not said((np.radians(150.0), 0.0, 0.0), 1).findings
    (finding,) = said((0.0, 0.0, np.radians(-160.0)), 1).findings
    assert finding.text == "joint3 at -160 deg is outside its limits, -150 to 150 deg"


@pytest.mark.parametrize("unclear", [False, True])
def test_of_many_modes_the_lowest_are_on_the_first_screen_and_all_in_the_details(unclear):
    found = modal_analysis(lcd_arm(), (0.3,) * 3, Load(), 99)
    report = predict_sections([Prediction(replace(found, ambiguous=np.full(9, unclear)))])
    assert len(report.answer[0].rows) == 6
    assert {len(table.rows) for table in report.details[0].parts} == {9}
    assert ("(?)" in text_of(report)) is unclear
    assert_one_screen(text_of(report))
    assert not too_wide(text_of(report, details=True))


def test_many_joints_have_their_shares_in_tables_of_their_own():
    rng = np.random.default_rng(3)
    found, arm = modal_analysis(lcd_arm(), UNFOLDED, Load(), 3), random_arm(rng, 7)
    bend, tors = rng.dirichlet(np.ones(14), size=3).T.reshape(2, 7, 3)
    modes = eqx.tree_at(lambda m: (m.bend, m.tors), found.modes, (bend, tors))
    report = predict_sections([Prediction(replace(found, arm=arm, posture=(0.0,) * 7, modes=modes))])
    assert not too_wide(text_of(report, details=True))
    first, second = report.details[0].parts
    assert (len(first.head), len(second.head)) == (1 + 2 * 6, 1 + 2)
    expected = np.stack([bend[:, 1], tors[:, 1]], 1).ravel()
    np.testing.assert_allclose([*first.rows[1][1:], *second.rows[1][1:]], 100 * expected)


def test_many_postures_have_a_row_each():
    postures = [(0.0, 0.0, 0.1 * i) for i in range(20)]
    predictions = [Prediction(modal_analysis(lcd_arm(), posture, Load(), 4)) for posture in postures]
    report = predict_sections(predictions)
    (table,) = report.answer
    assert table.rows[3][1:5] == tuple(predictions[3].analysis.modes.frequency.tolist())
    assert_one_screen(text_of(report))
    assert sum(section.title.startswith("Static deflection") for section in report.details) == 20
