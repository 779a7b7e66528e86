"""`ident.compare` from Python: results and their files, report, table and figure."""

import numpy as np
import pytest
from arms import DATA
from results import assert_comes_back, assert_plain

import ident
from ident import InputError
from ident.studies.compare import CompareOptions, compare
from ident.studies.fit import FitOptions, fit
from ident.studies.predict import predict

pytestmark = pytest.mark.slow

ARM = DATA / "lcd_arm" / "arm.toml"


@pytest.fixture(scope="module")
def before():
    return fit(ARM, DATA / "lcd_arm" / "campaign.csv", FitOptions(starts=1))


@pytest.fixture(scope="module")
def files(before, tmp_path_factory):
    """The shipped campaign, and one in which the torsion's frequencies are 4 % lower."""
    folder = tmp_path_factory.mktemp("compare")
    rows = (DATA / "lcd_arm" / "campaign.csv").read_text().splitlines()
    head = next(row for row in rows if row.startswith("kind,")).split(",")
    value, mode = head.index("value"), head.index("mode")
    for i, row in enumerate(rows):
        cells = row.split(",")
        if len(cells) == len(head) and "torsion 1" in cells[mode]:
            cells[value] = f"{0.96 * float(cells[value]):.6g}"
            rows[i] = ",".join(cells)
    later = folder / "later.csv"
    later.write_text("\n".join(rows) + "\n")
    after = fit(ARM, later, FitOptions(starts=1))
    return before.save(folder)[0], after.save(folder)[0]


@pytest.fixture(scope="module")
def result(files):
    return compare(*files)


def test_what_it_says(result, files):
    report = result.report()
    assert report.startswith("LCD transfer arm: campaign, then later\n")
    assert "CHANGED" in report
    assert "has become softer" in report
    assert result.name == "campaign-later.compare"
    assert [source.path for source in result.inputs.values()] == [str(path) for path in files]
    softer = [row for row in result.table() if row["changed"]]
    assert softer
    assert any(row["parameter"].endswith("k_tors") and row["high_95"] < 1 for row in softer)
    assert result.changed == {row["parameter"]: row["changed"] for row in result.table()}
    assert_plain(result.table())


def test_values_and_files_say_the_same(result, before, files):
    again = compare(before, ident.load(files[1]), CompareOptions())
    assert again.report() == result.report()
    assert again.inputs["first"].path == ""


def test_no_change_where_nothing_has_changed(before):
    same = compare(before, before)
    assert "No change is seen: T = 0 on 6.0 degrees of freedom, p = 1." in same.report()
    assert [row["ratio"] for row in same.table()] == pytest.approx([1.0] * 6, abs=1e-6)


def test_its_file_brings_it_back(result, tmp_path):
    assert_comes_back(result, tmp_path)
    assert ident.rerun(result.save(tmp_path)[0]).same


def test_the_figure_shows_ratios_with_intervals(result):
    (figure,) = result.figures().values()
    (axes,) = figure.axes
    assert axes.get_xlabel() == "ratio after / before [-], with 95 % interval"
    assert [label.get_text() for label in axes.get_yticklabels()] == [row["parameter"] for row in result.table()]
    spans = np.array([segment[:, 0] for part in axes.collections for segment in part.get_segments()])
    assert spans == pytest.approx(np.array([[row["low_95"], row["high_95"]] for row in result.table()]))


def test_other_results_are_refused(before, tmp_path):
    with pytest.raises(InputError, match=r"second: got a result of 'predict', expected one of fit, sample or diagnose"):
        compare(before, predict(ARM))
    (path,) = predict(ARM).save(tmp_path)
    with pytest.raises(InputError, match=r"arm.predict.json: got a result of 'predict'"):
        compare(before, path)
