"""`ident.validate` from Python: report, table, figure and file."""

from dataclasses import replace

import numpy as np
import pytest
from arms import DATA
from reports import assert_one_screen
from results import assert_comes_back, assert_plain

from ident import InputError
from ident.studies.stiffness.validate import ValidateOptions, validate
from ident.studies.stiffness.validate_report import validate_sections

pytestmark = pytest.mark.slow

ARM, CAMPAIGN = DATA / "lcd_arm" / "arm.toml", DATA / "lcd_arm" / "campaign.csv"


@pytest.fixture(scope="module")
def result():
    return validate(ARM, CAMPAIGN, ValidateOptions(starts=1))


def test_what_it_says(result):
    report = result.sections()
    assert report.subject.startswith("Cross-validation of LCD transfer arm on campaign: 4 postures, each predicted")
    assert report.verdict.word == "VALID"
    assert_one_screen(result.report(), files=2)
    scopes, parts = report.answer
    assert [row[0] for row in scopes.rows] == ["frequency", "deflection"]
    assert [row[0] for row in parts.rows] == [part.name for part in result.validation.parts]
    joints = report.details[-1].parts[0]
    assert joints.texts[0] == ("joint1", "0", "80")
    assert not result.doubtful
    scope = result.scopes["frequency"]
    assert scope.half == max(scope.seen, scope.expected)
    assert (scope.folds, scope.count) == (4, 16)
    rows = result.table()
    assert sorted(row["row"] for row in rows) == list(range(1, 21))
    assert all(row["off_sd"] == pytest.approx((row["measured"] - row["predicted"]) / row["sd"]) for row in rows)
    assert_plain(rows)


def test_its_file_brings_it_back(result, tmp_path):
    assert_comes_back(result, tmp_path)


def test_the_figure_shows_each_measurement(result):
    (figure,) = result.figures().values()
    (axes,) = figure.axes
    z = result.validation.z
    np.testing.assert_allclose(axes.collections[0].get_offsets()[:, 0], z)
    assert len(axes.get_yticklabels()) == len(z)


def test_contradicting_data_are_not_to_be_trusted(result):
    """One frequency 5 % too high, ten of its standard deviations, by the program of the others."""
    campaign = result.validation.fit.campaign
    first, *others = campaign.measurements
    wrong = replace(campaign, measurements=(replace(first, value=1.05 * first.value), *others))
    contradicted = validate(ARM, wrong, ValidateOptions(starts=1))
    assert contradicted.doubtful
    verdict = contradicted.sections().verdict
    assert verdict.word == "NOT VALID"
    parts = contradicted.validation.missed
    assert contradicted.validation.parts[0] in parts
    assert verdict.reason.startswith(f"Too far from the prediction: {', '.join(part.name for part in parts)} (p ")


def test_a_kind_with_a_value_near_zero_has_its_errors_in_its_unit(result):
    """Of 0.01 mm an error of 0.1 mm is 1000 %, which says nothing."""
    validation = result.validation
    measured = tuple(
        replace(m, value=1e-5) if m.kind == "deflection" and i < 5 else m
        for i, m in enumerate(validation.fit.campaign.measurements)
    )
    fit = replace(validation.fit, campaign=replace(validation.fit.campaign, measurements=measured))
    scopes, parts = validate_sections(replace(validation, fit=fit)).answer
    (frequency, deflection) = scopes.texts
    assert frequency[1].endswith("%")
    assert all(cell.endswith(" mm") for cell in deflection[1:4])
    scope = validation.scope("deflection", relative=False)
    largest = max(m.value for m in validation.fit.campaign if m.kind == "deflection")
    assert 0 < scope.half < 2 * largest * validation.scope("deflection").half
    assert float(deflection[1].split()[0]) == pytest.approx(1e3 * scope.half, rel=0.05)
    assert [row[1] for row in parts.texts] == 4 * ["4 frequency", "1 deflection"]


def test_another_word_is_refused():
    with pytest.raises(InputError, match="did you mean posture"):
        ValidateOptions(leave="postures")
