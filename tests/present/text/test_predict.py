import numpy as np
import pytest
from arms import lcd_arm, random_arm, two_equal_arm
from reports import too_wide

from ident.arm.arm import Arm
from ident.assess.predict import Prediction
from ident.errors import InputError, ModelError
from ident.identify.modal_analysis import modal_analysis
from ident.measure import Load
from ident.present.text.predict import predict_report

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


def test_report_shows_modes_shares_and_deflections():
    report = predict_report([Prediction(modal_analysis(lcd_arm(), UNFOLDED, Load(), 4))])
    assert report.startswith("LCD transfer arm at (0, 0, 0) deg, load: own weight\n")
    assert "4.8000  vertical bending 1     0.30 %    44    0    35    0    21    0" in report
    assert "-26.300" in report
    assert "WARNING" not in report


def test_report_warns_of_joint_limits():
    limit = np.radians(150.0)
    assert "WARNING" not in predict_report([Prediction(modal_analysis(lcd_arm(), (limit, 0.0, 0.0), Load(), 1))])
    report = predict_report([Prediction(modal_analysis(lcd_arm(), (0.0, 0.0, np.radians(-160.0)), Load(), 1))])
    assert "WARNING: joint3 at -160 deg is outside its limits, -150 to 150 deg" in report


@pytest.mark.parametrize("arm", [two_equal_arm(), random_arm(np.random.default_rng(3), 2)], ids=["equal", "random"])
def test_any_arm_is_reported_in_straight_columns(arm):
    report = predict_report([Prediction(modal_analysis(arm, (0.3,) * len(arm.driven), Load(), 99))])
    rows = [line for line in report.splitlines() if line[2:6].strip().isdigit()]
    assert len(rows) == 3 * len(arm.joints)
    assert len({len(row) for row in rows}) == 1


def test_many_joints_have_their_shares_in_a_table_below():
    arm = random_arm(np.random.default_rng(3), 7)
    analysis = modal_analysis(arm, (0.0,) * 7, Load(), 3)
    report = predict_report([Prediction(analysis)])
    assert not too_wide(report)
    rows = [line.split() for line in report.splitlines() if line.startswith("     2")]
    assert [len(row) for row in rows][1:] == [1 + 2 * 7], "its own row, beside that with the frequency"
    expected = np.stack([analysis.modes.bend[:, 1], analysis.modes.tors[:, 1]], 1).ravel()
    np.testing.assert_allclose(np.array(rows[1][1:], float), 100 * expected, atol=0.51)
