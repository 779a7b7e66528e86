"""`ident.compare` from Python: results and their files, report, table and figure."""

import shutil
from functools import partial

import numpy as np
import pytest
from arms import DATA
from reports import assert_one_screen
from results import RESULTS, assert_comes_back, assert_plain

import ident
from ident import InputError
from ident.identify.fit import fit_campaign
from ident.studies.stiffness.compare import CompareOptions, compare
from ident.studies.stiffness.fit import FitOptions, fit

pytestmark = pytest.mark.slow

ARM = DATA / "lcd_arm" / "arm.toml"
FEW = FitOptions(starts=1, no_explain=True)


@pytest.fixture(scope="module")
def before():
    return fit(ARM, DATA / "lcd_arm" / "campaign.csv", FEW)


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
    after = fit(ARM, later, FEW)
    return before.save(folder)[0], after.save(folder)[0]


@pytest.fixture(scope="module")
def result(files):
    return compare(*files)


def test_campaigns_are_fitted_and_compared(result, files, monkeypatch):
    monkeypatch.setattr("ident.identify.fit.fit_campaign", partial(fit_campaign, starts=1))
    later = files[1].with_name("later.csv")
    shutil.copy(ARM, later.parent)
    fitted = compare(ARM.with_name("campaign.csv"), later)
    assert fitted.changed == result.changed
    for row, same in zip(fitted.table(), result.table(), strict=True):
        assert row["ratio"] == pytest.approx(same["ratio"], rel=1e-6)
    assert [source.path for source in fitted.inputs.values()] == [str(ARM.with_name("campaign.csv")), str(later)]


def test_what_it_says(result, files):
    report = result.sections()
    assert_one_screen(result.report(), files=2)
    assert result.report().splitlines()[0] == "LCD transfer arm: campaign, then later"
    assert result.report().splitlines()[2].startswith("RESULT: CHANGED. ")
    assert any("has become softer" in finding.text and "belt" in finding.remedy for finding in report.findings)
    (table,) = report.answer
    assert [row[-1] == "changed" for row in table.rows] == list(result.changed.values())
    assert report.next == f"ident diagnose {files[1].with_name('later.csv')}"
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
    verdict = same.sections().verdict
    assert same.sections().next == f"ident plan {ARM.with_name('campaign.csv')}"
    assert (verdict.word, verdict.reason) == ("NO CHANGE", "T = 0 on 6.0 degrees of freedom, p = 1.")
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


def written(path, draws):
    """A posterior as another program writes it: InferenceData in netCDF."""
    import xarray

    variables = {name: (("chain", "draw"), values[None]) for name, values in draws.items()}
    xarray.Dataset(variables).to_netcdf(path, group="posterior", engine="h5netcdf")
    return path


def test_posteriors_of_others_are_compared_as_independent_ones(result, before, tmp_path):
    """Draws about both fits: the same verdict, since the data tell far more than the prior that they share."""
    paths = []
    for name, own in (("one", result.comparison.first), ("two", result.comparison.second)):
        names = own.problem.parameters.names
        noise = np.random.default_rng(1).multivariate_normal(np.zeros(len(names)), own.information.covariance, 4000)
        logs = np.log(np.asarray(own.best.values)) + noise
        paths.append(written(tmp_path / f"{name}.nc", dict(zip(names, np.exp(logs.T), strict=True))))
    found = compare(*paths)
    assert "INDEPENDENCE ASSUMED" in found.report()
    assert "INDEPENDENCE" not in result.report()
    ours, theirs = (each.comparison.change for each in (found, result))
    assert ours.names == theirs.names
    assert np.abs(ours.change - theirs.change).max() < 0.3 * theirs.sd.max()
    np.testing.assert_allclose(ours.sd, theirs.sd, rtol=0.2)
    assert ours.statistic == pytest.approx(theirs.statistic, rel=0.2)
    assert found.changed == result.changed
    mixed = compare(before, paths[1])
    assert mixed.comparison.independent
    assert mixed.name == "campaign-two.compare"
    assert_comes_back(mixed, tmp_path)


def test_a_posterior_of_others_must_have_stiffnesses(before, tmp_path):
    with pytest.raises(InputError, match="no stiffness that both have"):
        compare(before, written(tmp_path / "other.nc", {"mass": np.ones(50)}))
    with pytest.raises(InputError, match=r"joint1.k_tors: got other values, expected positive numbers"):
        compare(before, written(tmp_path / "negative.nc", {"joint1.k_tors": -np.ones(50)}))


def test_folders_are_compared_file_by_file(files, result, before, tmp_path):
    folders = [tmp_path / name for name in ("before", "after")]
    for folder, robots in zip(folders, ((0, 0, 0), (0, 1)), strict=True):
        folder.mkdir()
        for robot, which in enumerate(robots, 1):
            (folder / f"robot{robot}.fit.json").write_bytes(files[which].read_bytes())
    found = compare(*folders)
    assert [any(each.change.changed) for each in found.comparisons] == [False, True]
    assert found.name == "before-after.compare"
    assert found.unpaired == (str(folders[0] / "robot3.fit.json"),)
    report = found.sections()
    assert report.subject == "Comparison of 2 pairs of campaigns"
    assert report.verdict.word == "1 OF 2 CHANGED"
    table, unpaired = report.answer
    assert [row[2].startswith("CHANGED: ") for row in table.rows] == [False, True]
    assert "robot3.fit.json" in unpaired
    assert len(report.details) == 1 + 2
    assert_one_screen(found.report(), files=3)
    assert len(found.table()) == 2 * len(result.table())
    assert len(found.figures()) == 2
    assert_comes_back(found, tmp_path)
    assert ident.rerun(found.save(tmp_path)[0]).same
    with pytest.raises(InputError, match="two files or two folders"):
        compare(folders[0], before)
    (tmp_path / "empty").mkdir()
    with pytest.raises(InputError, match="no result of one name in both"):
        compare(folders[0], tmp_path / "empty")


def test_other_results_are_refused(before, result):
    with pytest.raises(InputError, match=r"second: got a result of 'compare', expected one of fit, sample or diagnose"):
        compare(before, result)
    with pytest.raises(InputError, match=r"arm.predict.json: got a result of 'predict'"):
        compare(before, RESULTS / "arm.predict.json")
