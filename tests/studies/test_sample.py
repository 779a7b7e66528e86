"""`ident.sample` from Python: what it gives, that it goes on and comes back, and what it refuses."""

import json
import warnings
from dataclasses import replace
from functools import partial

import arviz
import numpy as np
import pytest
from arms import DATA, lcd_arm
from reports import assert_one_screen
from results import assert_comes_back, assert_plain

import ident
from ident.errors import InputError
from ident.files import claimed
from ident.identify.sample import sample_campaign
from ident.inference.sample import Settings
from ident.report.report import Table, text_of
from ident.studies.repetition import differences
from ident.studies.stiffness.fit import FitOptions, fit
from ident.studies.stiffness.fit_report import fit_sections
from ident.studies.stiffness.sample import SampleOptions, SampleResult, sample
from ident.studies.stiffness.sample_report import sample_sections
from ident.studies.values import drawn_groups, drawn_values, fitted_values

pytestmark = pytest.mark.slow

FIT = {"starts": 1, "fix": ("joint1.k_bend",), "discrepancy": {"deflection": 0.1}}
SHORT = FIT | {"steps": 500, "walkers": 14}


@pytest.fixture(scope="module")
def table_1():
    return ident.read_campaign(DATA / "lcd_arm" / "table1.csv")


@pytest.fixture(scope="module")
def arm_file():
    return ident.read_arm(DATA / "lcd_arm" / "arm.toml")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Where the checkpoints of the result lie."""
    return tmp_path_factory.mktemp("checkpoints")


@pytest.fixture(scope="module")
def result(arm_file, table_1, folder):
    """Interrupted behind its fourth block, and gone on with."""
    with pytest.raises(KeyboardInterrupt):
        sample(arm_file, table_1, SampleOptions(**SHORT), folder=folder, progress=until(4))
    assert len(list(folder.glob("draws*"))) == 4
    return sample(arm_file, table_1, SampleOptions(**SHORT), folder=folder)


def until(last):
    """Progress that interrupts a chain at a block."""

    def progress(description, total=None):
        def stop(numbers):
            for number in numbers:
                if description == "blocks of steps" and number == last:
                    raise KeyboardInterrupt
                yield number

        return stop

    return progress


@pytest.fixture(scope="module")
def fitted(arm_file, table_1):
    return fit(arm_file, table_1, FitOptions(**FIT, no_explain=True))


@pytest.fixture(scope="module")
def file(result, tmp_path_factory):
    return result.save(tmp_path_factory.mktemp("sample"))[0]


def test_it_is_the_posterior_of_the_fit_whether_or_not_it_was_interrupted(result, fitted):
    direct = sample_campaign(fitted.fit, settings=Settings(walkers=14, max_steps=SHORT["steps"])).sample
    sampled = result.sample.sample
    np.testing.assert_array_equal(sampled.theta, direct.theta)
    assert result.name == "table1.sample"
    assert not result.enough, "so short a chain is none to trust"
    for name, own in zip(direct.posterior.parameters.names, np.exp(sampled.draws()).T, strict=True):
        np.testing.assert_allclose(result.draws[name], own, rtol=1e-12)
        assert result.medians[name] == pytest.approx(np.median(own), rel=1e-12)
        assert result.intervals[name] == pytest.approx(tuple(np.quantile(own, (0.025, 0.975))), rel=1e-12)


def test_it_comes_back_as_it_was(result, tmp_path):
    saved = assert_comes_back(result, tmp_path)
    assert saved.doubts == list(result.doubts)
    assert saved.fitted.parameters == pytest.approx(result.fitted.parameters, rel=1e-12)
    ours, theirs = (each.posterior_draws().by_paths for each in (saved, result))
    for paths, own in theirs.items():
        np.testing.assert_array_equal(ours[paths], own)


def test_its_figures_show_data_and_intervals(result):
    assert list(result.figures()) == ["posterior", "corner", "trace"]
    parameters, predicted = (axes for axes in result.figures()["posterior"].axes if axes.get_xlabel())
    assert predicted.get_xlabel() == "(measured - predicted) / sigma [-]", "as in the figure of the fit"
    medians = [line.get_xdata()[0] for line in predicted.lines if line.get_marker() == "o"]
    drawn, campaign = result.sample.posterior_predictive.predicted, result.sample.fitted.campaign
    expected = [(m.value - np.median(own)) / m.sigma for m, own in zip(campaign, drawn.T, strict=True)]
    np.testing.assert_allclose(medians, expected, rtol=1e-9)
    own = np.array([line.get_xdata() for line in parameters.lines if line.get_linewidth() == 1.2])
    left, right = parameters.get_xlim()
    assert left < own.min() < own.max() < right
    assert (np.log(own[:, 1] / own[:, 0]) > 0.01 * np.log(right / left)).all(), "each interval can be seen"


def test_its_file_is_arviz_inference_data(result, file):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        data = arviz.from_netcdf(file)
    own = result.inference_data
    assert json.loads(data.attrs["format"]) == SampleResult.form
    for group in own.groups():
        for name, variable in own[group].data_vars.items():
            np.testing.assert_array_equal(data[group][name].values, variable.values)
    assert float(arviz.summary(data.posterior, round_to="none")["ess_bulk"].min()) > 50


def test_its_table_has_a_row_for_each_unknown(result):
    rows = result.table()
    assert_plain(rows)
    assert [row["parameter"] for row in rows] == list(result.sample.sample.posterior.parameters.names)
    for row in rows:
        assert row["low_95"] < row["low_50"] < row["median"] < row["high_50"] < row["high_95"]


def test_checkpoints_stay_and_another_run_needs_a_word_to_take_their_place(result, folder, arm_file, table_1):
    assert len(list(folder.glob("draws*"))) == 10
    other = SampleOptions(**SHORT, seed=1)
    with pytest.raises(ident.InputError, match="another seed"):
        sample(arm_file, table_1, other, folder=folder)
    before = {file.read_bytes() for file in folder.glob("draws*")}
    with pytest.raises(KeyboardInterrupt):
        sample(arm_file, table_1, other, folder=folder, restart=True, progress=until(1))
    anew = {file.read_bytes() for file in folder.glob("draws*")}
    assert len(anew) == 1, "begun anew"
    assert not anew & before


def test_posteriors_by_other_seeds_are_the_same_within_their_standard_errors(result, arm_file, table_1):
    """And differ by no less: errors that are said much too large would hide what differs."""
    other = sample(arm_file, table_1, SampleOptions(**SHORT, seed=1))
    assert not list(differences(result.table(), other.table(), result.standard_errors()))
    medians = np.array([[row["median"] for row in run.table()] for run in (result, other)])
    said = np.array([[row["median"] for row in run.standard_errors()] for run in (result, other)])
    assert 0.3 < np.sqrt(np.mean(np.diff(medians, axis=0)[0] ** 2 / (said**2).sum(0))) < 2.5


def test_draws_of_a_result_and_of_its_file_are_the_same(result, file):
    of_file, of_result = (drawn_values(source, lcd_arm(), 40, seed=2) for source in (file, result))
    assert of_file.values.keys() == of_result.values.keys()
    assert (of_result.path, of_file.path) == ("", str(file))
    assert "discrepancy.deflection" in of_result.left_out
    for path, values in of_result.values.items():
        np.testing.assert_array_equal(of_file.values[path], values)
    for one, two in zip(*(drawn_groups(source, lcd_arm(), 20, 30) for source in (file, result)), strict=True):
        np.testing.assert_array_equal(one.values["joint2.k_tors"], two.values["joint2.k_tors"])
    assert drawn_values(of_file, lcd_arm(), 3) is of_file
    assert drawn_groups(of_file, lcd_arm(), 3, 4) == (of_file, None)
    assert drawn_values(None, lcd_arm(), 3) is None


def test_contradictory_data_withhold_every_interval_as_in_a_fit(result, fitted, arm_file, file):
    """Table 1 contradicts itself; a wider factor on its deflection would reconcile it."""
    assert result.doubts == fitted.doubts != ()
    assert result.doubtful
    assert not any(fitted.supported.values())
    report = result.sections()
    assert report.verdict == replace(fit_sections(fitted.fit).verdict, reason=report.verdict.reason)
    assert report.verdict.word == "NOT USABLE"
    assert report.verdict.reason.endswith("No interval is reported. The chains are too short as well.")
    assert intervals(report) == ["not reported"] * len(result.sample.sample.posterior.parameters.names)
    assert not combinations(report)
    assert "--discrepancy deflection:0.2` (20 %)" in report.findings[1].remedy
    assert_one_screen(result.report(), files=5)
    assert "No interval is reported" in result.figures()["posterior"].get_suptitle()
    assert result.document()["summary"]["doubts"] == list(fitted.doubts)
    for source in (result, file):
        assert drawn_values(source, arm_file, 5).remark.startswith(f"the fit is in doubt: {fitted.doubts[0]}")


@pytest.fixture(scope="module")
def settled(result, arm_file, table_1):
    """The posterior as if the model factor had been wide enough."""
    options = FitOptions(starts=1, fix=FIT["fix"], no_explain=True, discrepancy={"deflection": 0.2})
    return replace(result, sample=replace(result.sample, fitted=fit(arm_file, table_1, options).fit))


def test_without_doubt_intervals_are_reported(settled):
    assert settled.doubts == ()
    assert "not reported" not in intervals(settled.sections())
    assert combinations(settled.sections())


def intervals(report):
    """The 95 % intervals of the first screen."""
    table = next(part for part in report.answer if isinstance(part, Table))
    column = table.head.index("95 % interval")
    return [row[column] for row in table.rows]


def combinations(report):
    return [section for section in report.details if section.title.startswith("Combinations")]


def test_its_verdict_follows_the_chains_the_fit_and_the_prior(settled):
    """Of one posterior, with what each rule asks replaced."""

    def judged(posterior, **changes):
        report = sample_sections(replace(posterior, sample=replace(posterior.sample, **changes)))
        assert_one_screen(text_of(report), files=5)
        return report.verdict.word, report

    fine = replace(settled.sample, fitted=replace(settled.sample.fitted, assumptions=None))
    chains, settings = fine.sample.diagnosis[0], replace(fine.sample.settings, target_ess=100.0)
    agreeing = replace(chains, steps=10_000, bulk=np.full_like(chains.bulk, 900.0), rhat=np.full_like(chains.rhat, 1.0))
    word, report = judged(fine)
    assert word == "TOO SHORT"
    assert report.next.startswith("the same command with --steps ")
    enough = {"diagnosis": (agreeing,), "settings": settings}
    word, report = judged(fine, **enough)
    assert word == "PARTLY 2 OF 6"
    assert "R-hat at most 1.0000, 900 effective samples" in report.verdict.reason
    two = replace(fine, fitted=replace(fine.fitted, optima=fine.fitted.optima[:1] * 2))
    word, report = judged(two, **enough | {"diagnosis": (agreeing,) * 2, "basin": (0, 0, 1, 1)})
    assert word == "SEVERAL OPTIMA"
    assert "--weights" in report.findings[0].remedy


def test_a_posterior_of_another_robot_is_refused_unless_forced(result, file):
    other = lcd_arm().replace({"joint2.offset.z": 0.2})
    for source in (result, file):
        for read in (partial(drawn_values, count=4), partial(drawn_groups, count=4, fresh=4)):
            with pytest.raises(ident.InputError, match=r"another robot, .*: joint2\.offset .*`force`") as error:
                read(source, other)
            assert len(str(error.value).splitlines()) == 1
        forced = drawn_values(source, other, 4, options=ident.PredictOptions(force=True))
        assert "another robot" in forced.remark


def test_values_of_a_fit_and_of_its_file_are_the_same(fitted, tmp_path):
    path = fitted.save(tmp_path)[0]
    of_file, of_result = fitted_values(path, lcd_arm()), fitted_values(fitted, lcd_arm())
    assert of_file.medians == of_result.medians
    assert of_file.left_out == of_result.left_out == ("discrepancy.deflection",)
    text = path.read_text()
    for own, words in (("ident-fit/2", "run ident fit again"), ("ident-check/2", "the file that ident fit wrote")):
        path.write_text(text.replace(ident.FitResult.form, own))
        with pytest.raises(ident.InputError, match=f"the format '{own}'.*{words}") as refusal:
            fitted_values(path, lcd_arm())
        assert len(str(refusal.value).splitlines()) == 1


def test_a_posterior_of_an_older_version_is_refused_in_one_line(result, tmp_path):
    path, data = tmp_path / "old.sample.nc", result.inference_data
    data.attrs["format"] = '"ident-sample/1"'
    data.to_netcdf(str(path), engine="h5netcdf")
    for read in (ident.load, lambda path: drawn_values(path, lcd_arm(), 10)):
        with pytest.raises(ident.InputError, match="run ident sample again") as refusal:
            read(path)
        assert len(str(refusal.value).splitlines()) == 1


def test_a_damaged_file_is_refused_in_one_line(file, tmp_path):
    damaged = tmp_path / "campaign.sample.nc"
    whole = file.read_bytes()
    for content in (b"", whole[:1000], whole[: len(whole) // 2], b"{}"):
        damaged.write_bytes(content)
        with pytest.raises(ident.InputError, match="no result to load") as refusal:
            ident.load(damaged)
        assert len(str(refusal.value).splitlines()) == 1


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"ess": 10.0}, "ess: got 10, expected a number from 100"),
        ({"steps": 100}, "steps: got 100, expected a number from 500"),
        ({"ensembles": 2}, "ensembles: got 2, expected a number from 4"),
    ],
)
def test_options_are_checked_when_they_are_made(options, words):
    with pytest.raises(ident.InputError, match=words):
        SampleOptions(**options)


def test_the_library_names_options_in_backticks(table_1):
    with pytest.raises(ident.InputError, match=r"got 6 walkers, .* correct `walkers`"):
        sample(lcd_arm(), table_1, SampleOptions(**FIT, walkers=6))
    with pytest.raises(ident.InputError, match=r"nor a prior that bound .* \(`prior`\), or fix it \(`fix`\)"):
        sample(lcd_arm(), table_1, SampleOptions(**FIT, no_prior=True))


def test_a_folder_in_which_another_run_is_at_work_is_refused_at_once(tmp_path, arm_file, table_1):
    with claimed(tmp_path / "part"), pytest.raises(InputError, match=r"another run .*or choose another folder"):
        sample(arm_file, table_1, folder=tmp_path / "part", restart=True)
