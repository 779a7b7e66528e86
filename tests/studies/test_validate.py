"""`ident.validate` from Python: report, table, figure and file."""

import numpy as np
import pytest
from arms import DATA
from results import assert_comes_back, assert_plain

from ident import InputError
from ident.studies.validate import ValidateOptions, validate

pytestmark = pytest.mark.slow

ARM, CAMPAIGN = DATA / "lcd_arm" / "arm.toml", DATA / "lcd_arm" / "campaign.csv"


@pytest.fixture(scope="module")
def result():
    return validate(ARM, CAMPAIGN, ValidateOptions(starts=1))


def test_what_it_says(result):
    report = result.report()
    assert report.startswith("Validation of LCD transfer arm by campaign\n  4 postures, each left out in turn")
    assert "NOT to be trusted" not in report
    assert "postures [deg]: joint1 0 to 80" in report
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


def test_the_figure_shows_each_measurement_and_its_quantile(result):
    (figure,) = result.figures().values()
    left, right = figure.axes
    z = result.validation.z
    np.testing.assert_allclose(left.collections[0].get_offsets()[:, 0], z)
    assert len(left.get_yticklabels()) == len(z)
    (line, diagonal) = right.lines
    np.testing.assert_allclose(line.get_ydata(), (np.arange(len(z)) + 0.5) / len(z))
    assert (np.diff(line.get_xdata()) >= 0).all()
    assert list(diagonal.get_xdata()) == [0, 1]


def test_contradicting_data_are_not_to_be_trusted():
    table_1 = validate(ARM, DATA / "lcd_arm" / "table1.csv", ValidateOptions(starts=1, leave="row"))
    assert table_1.doubtful
    assert "NOT to be trusted: too far from the prediction: row 1, row 3" in table_1.report()


def test_another_word_is_refused():
    with pytest.raises(InputError, match="did you mean posture"):
        ValidateOptions(leave="postures")
