"""`ident.fit` from Python: what it gives, that it comes back, and what it refuses."""

import copy
import json
import re
from dataclasses import replace

import numpy as np
import pytest
from arms import DATA, lcd_arm
from results import assert_comes_back, assert_plain

import ident
from ident.identify.assumptions import Assumption, Assumptions
from ident.identify.fit import fit_campaign
from ident.identify.values import Values
from ident.inference.information import ScoreTest
from ident.measure import write_campaign
from ident.studies.basis import values_in_words
from ident.studies.look.example import example
from ident.studies.stiffness.fit import FitOptions, fit
from ident.studies.values import fitted_values

pytestmark = pytest.mark.slow

FILES = ((ident.read_arm, "arm.toml"), (ident.read_campaign, "campaign.csv"))


@pytest.fixture(scope="module")
def table_1():
    return ident.read_campaign(DATA / "lcd_arm" / "table1.csv")


@pytest.fixture(scope="module")
def result(table_1):
    options = FitOptions(starts=1, fix=("joint1.k_bend",), no_explain=True)
    return fit(ident.read_arm(DATA / "lcd_arm" / "arm.toml"), table_1, options)


def test_it_is_the_fit_of_the_campaign(result, table_1):
    direct = fit_campaign(lcd_arm(), table_1, result.options.unknowns, starts=1)
    assert result.name == "table1.fit"
    assert result.parameters == direct.parameters
    assert result.doubts == direct.doubts != ()
    assert not any(result.supported.values())
    np.testing.assert_array_equal(list(result.intervals.values()), direct.interval())
    for path, value in result.parameters.items():
        assert float(result.fitted_arm.get(path)) == value
    assert float(result.fitted_arm.get("joint1.k_bend")) == float(lcd_arm().get("joint1.k_bend"))


def seen(values):
    """What Table 1 measures, of an arm with these numbers."""
    result = ident.predict(lcd_arm(), ident.PredictOptions(set=values, modes=2))
    return [*result.frequencies[0], result.deflections[0]["tip"][2]]


def test_it_says_what_the_data_would_not_notice(result):
    fitted = result.parameters
    assert len(result.trade_offs) == len(fitted) - 3
    for name, change in result.trade_offs.items():
        together = {path: value * 1.01 ** change[path] for path, value in fitted.items()}
        np.testing.assert_allclose(seen(together), seen(fitted), rtol=2e-5)
        alone = {**fitted, name: together[name]}
        assert alone[name] == pytest.approx(1.01 * fitted[name])
        assert not np.allclose(seen(alone), seen(fitted), rtol=2e-5)


def test_its_spreads_and_cross_predictions_are_those_of_the_fit(result):
    for name, (low, high) in result.intervals.items():
        assert 2 * 1.959964 * result.sd[name] == pytest.approx(np.log(high / low))
    assert result.cross_predictions["deflection"].measured == pytest.approx([0.022])


def test_it_comes_back_as_it_was(result, tmp_path):
    saved = assert_comes_back(result, tmp_path)
    assert saved.parameters == result.parameters
    again = saved.fitted
    assert (saved.notes, again.doubts, again.remarks) == ((), result.fit.doubts, result.fit.remarks)
    assert again.campaign == result.fit.campaign
    np.testing.assert_allclose(again.information.covariance, result.fit.information.covariance, rtol=1e-9)
    np.testing.assert_allclose(again.interval(), result.fit.interval(), rtol=1e-9)
    assert again.chi_squared == pytest.approx(result.fit.chi_squared, rel=1e-9)
    assert len(again.assumptions.items) == len(result.assumptions.items) == 17
    for one, other in zip(again.assumptions.items, result.assumptions.items, strict=True):
        np.testing.assert_array_equal(one.test.shift, other.test.shift)
        assert (one.kind, one.joint, one.test.z) == (other.kind, other.joint, other.test.z)


@pytest.fixture(scope="module")
def soft():
    arm, campaign = (ident_file(DATA / "lcd_arm" / name) for ident_file, name in FILES)
    return fit(arm, campaign, FitOptions(starts=1, soft_base=0.5, no_explain=True))


def test_a_soft_base_is_fitted_by_one_option_and_taken_over_only_by_an_arm_on_the_same(soft):
    assert soft.fit.problem.parameters.names[0] == "base.k_bend"
    assert soft.arm.origins["base.k_bend"] == "assumed"
    assert "base rocks" not in soft.report(details=True)
    arm = ident.read_arm(DATA / "lcd_arm" / "arm.toml")
    taken = ident.predict(arm, ident.PredictOptions(soft_base=0.5), fit=soft)
    first = next(m for m in soft.fit.campaign if m.kind == "frequency")
    place = soft.fit.campaign.measurements.index(first)
    assert min(abs(taken.frequencies[0] - soft.fit.predicted[place])) < 1e-6
    with pytest.raises(ident.InputError, match=r"got base\.k_bend, expected LCD transfer arm on such a base"):
        ident.predict(arm, fit=soft)


def test_what_the_data_ask_for_counts_as_a_doubt_that_withholds_nothing(soft):
    assert (soft.doubts, soft.doubtful) == ((), False)
    test = ScoreTest(0.1, True, np.zeros(len(soft.parameters)), True, 0.5, 6.0, 0.02)
    asking = replace(soft.fit, assumptions=Assumptions((Assumption("link bends", "joint1", test),), 0.5))
    asked = replace(soft, fit=asking)
    assert asked.doubtful
    assert asked.doubts == ()
    assert asked.supported == soft.supported
    assert any(asked.supported.values())


def test_an_option_of_a_base_needs_an_arm_on_a_rigid_one(soft):
    with pytest.raises(ident.InputError, match="whose first joint base is undriven"):
        ident.predict(soft.arm, ident.PredictOptions(soft_base=0.7))
    with pytest.raises(ident.InputError, match="soft_base"):
        FitOptions(soft_base=0.0)


def test_its_table_has_a_row_for_each_parameter(result):
    rows = result.table()
    assert_plain(rows)
    assert {row["parameter"]: row["value"] for row in rows} == result.parameters
    assert {row["parameter"]: (row["low_95"], row["high_95"]) for row in rows} == result.intervals


def test_an_arm_of_python_and_options_as_keywords_and_patterns_will_do(result, table_1, tmp_path):
    shown = []

    def progress(description, total=None):
        return lambda numbers: (shown.append((description, number)) or number for number in numbers)

    other = fit(lcd_arm(), table_1, starts=1, fix="joint1.k_b*", no_explain=True, progress=progress)
    assert shown == [("starts", 1)]
    assert other.options == replace(result.options, fix=("joint1.k_b*",))
    assert other.report().replace("'joint1.k_b*'", "joint1.k_bend") == result.report()
    assert other.arm.path == ""
    assert_comes_back(other, tmp_path)


def test_its_measurements_are_a_table(result, table_1, tmp_path):
    rows = result.measurements
    assert_plain(rows)
    assert [(row["row"], row["kind"], row["place"]) for row in rows] == [
        ("5", "frequency", "vertical bending 1"),
        ("6", "frequency", "lateral torsion 1"),
        ("7", "deflection", "tip"),
    ]
    first, second, down = seen(result.parameters)
    assert sorted(row["predicted"] for row in rows[:2]) == pytest.approx([first, second], rel=1e-6)
    assert rows[2]["predicted"] == pytest.approx(-down, rel=1e-6)
    for row, m in zip(rows, table_1, strict=True):
        assert (row["measured"], row["sigma"], row["unit"]) == (m.value, m.sigma, "m" if m.point else "Hz")
        assert row["residual"] == pytest.approx((m.value - row["predicted"]) / m.sigma, rel=1e-9)
    assert json.loads(result.save(tmp_path)[0].read_text())["measurements"] == rows
    assert [row["too_far_off"] for row in rows] == result.fit.suspicious.tolist()


def test_who_takes_over_a_fit_learns_what_speaks_against_it(result, tmp_path):
    file, own = result.save(tmp_path)[0], ident.read_arm(DATA / "lcd_arm" / "arm.toml")
    (tmp_path / "arm.toml").write_text((DATA / "lcd_arm" / "arm.toml").read_text() + "# changed\n")
    for fitted in (result, file):
        remark = fitted_values(fitted, own).remark
        assert remark.startswith("the fit is in doubt: deflection and frequency data contradict each other (")
        other = fitted_values(fitted, ident.read_arm(tmp_path / "arm.toml")).remark
        assert other == f"{remark}; fitted to another arm file, or to this one before it was changed"
    assert remark in " ".join(ident.predict(own, fit=file).report(details=True).split())


@pytest.fixture
def heavier(tmp_path):
    """The arm file with another bracket: another robot."""
    text = (DATA / "lcd_arm" / "arm.toml").read_text()
    changed = text.replace("mass = { value = 19.1122", "mass = { value = 20")
    assert changed != text
    (tmp_path / "heavier.toml").write_text(changed)
    return tmp_path / "heavier.toml"


def test_a_fit_of_another_robot_is_refused_unless_forced(result, tmp_path, heavier, run):
    file = result.save(tmp_path)[0]
    assert json.loads(file.read_text())["robot"]["name"] == "LCD transfer arm"
    words = "got the values of another robot, LCD transfer arm: bracket.mass (19.1122 kg there, 20 kg here)"
    for fitted in (result, file):
        with pytest.raises(ident.InputError) as error:
            ident.predict(heavier, fit=fitted)
        assert words in str(error.value)
        forced = ident.predict(heavier, ident.PredictOptions(force=True), fit=fitted)
        assert words.removeprefix("got ") in " ".join(forced.report().split())
        assert ident.predict(heavier, ident.PredictOptions(set={"bracket.mass": 19.0}), fit=fitted)
    for command in ("simulate", "resonance", "sweep", "design", "predict", "explore"):
        more = ["--change=bracket.mass"] * (command == "design")
        code, out, err = run(command, str(heavier), "--fit", str(file), *more)
        assert (code, out) == (2, "")
        assert words in err
        assert "or insist (--force)" in err
        assert len(err.splitlines()) == 1
    assert not (tmp_path / "out").exists()
    code, out, _ = run("predict", str(heavier), "--fit", str(file), "--force", "--json")
    assert code == 0
    assert json.loads(out)["options"]["force"]


def test_export_into_another_robot_is_refused_unless_forced(result, tmp_path, heavier, run):
    file = result.save(tmp_path)[0]
    words = ("export", str(file), "--arm", str(heavier), "--out", "fitted.toml")
    code, out, err = run(*words)
    assert (code, out, len(err.splitlines())) == (2, "", 1)
    assert "bracket.mass (19.1122 kg there, 20 kg here)" in err
    assert "or insist (--force)" in err
    assert not (tmp_path / "fitted.toml").exists()
    assert run(*words, "--force")[0] == 0
    assert float(ident.read_arm(tmp_path / "fitted.toml").arm.get("bracket.mass")) == 20


def test_values_of_another_base_are_refused(result, tmp_path):
    file, height = result.save(tmp_path)[0], ident.PredictOptions(soft_base=0.5)
    for fitted in (result, file):
        with pytest.raises(ident.InputError, match="fitted on a rigid base, expected a base") as error:
            ident.predict(ident.read_arm(DATA / "lcd_arm" / "arm.toml"), height, fit=fitted)
        assert len(str(error.value).splitlines()) == 1


def test_a_fit_and_a_posterior_that_exclude_each_other_are_named():
    fitted = Values("", "", {"joint1.k_bend": np.array(5.0), "joint2.k_bend": np.array(5.0)})
    draws = Values("", "", {"joint1.k_bend": np.array([4.0, 6.0]), "joint2.k_bend": np.array([6.0, 7.0])})
    assert fitted.outside(draws) == ("joint2.k_bend",)
    assert any("exclude each other: joint2.k_bend" in line for line in values_in_words(fitted, draws))


def test_what_is_neither_a_fit_nor_a_posterior_is_refused(result):
    for given in ({"fit": 3.0}, {"posterior": result}):
        with pytest.raises(
            ident.InputError, match=f"^{next(iter(given))}: got a .*expected a result of ident"
        ) as refusal:
            ident.predict(lcd_arm(), **given)
        assert len(str(refusal.value).splitlines()) == 1


def test_a_name_makes_no_folder(result, tmp_path):
    named = replace(result, fit=replace(result.fit, campaign=replace(result.fit.campaign, name="../a/b")))
    assert [path.name for path in named.save(tmp_path)] == [".._a_b.fit.json"]


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("ident-fit/10", "ident-fit/4", "run ident fit again"),
        ("ident-fit/10", "ident-fit/11", "update ident"),
        ("ident-fit/10", "ident-feat/10", "give the file that ident wrote"),
        ('"report"', '"record"', "other contents"),
        ('"no_prior": ', '"no_prayer": ', "got the option no_prayer.*update ident"),
        ('"summary"', '"somery"', "other contents"),
    ],
)
def test_a_damaged_or_other_file_is_refused_in_one_line(result, tmp_path, old, new, words):
    (path,) = result.save(tmp_path)
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new))
    with pytest.raises(ident.InputError, match=words) as refusal:
        assert ident.load(path).options
    assert len(str(refusal.value).splitlines()) == 1
    path.write_text(text[: len(text) // 2])
    with pytest.raises(ident.InputError, match="other contents"):
        ident.load(path)


def test_a_damaged_fit_is_refused_where_it_is_made_again_and_a_moved_one_is_said(result, tmp_path):
    (path,) = result.save(tmp_path)
    document = json.loads(path.read_text())
    path.write_text(json.dumps({**document, "fit": {**document["fit"], "optima": []}}))
    with pytest.raises(ident.InputError, match=r"table1.fit.json: got other contents"):
        assert ident.load(path).fitted
    predicted = [1.001 * value for value in document["fit"]["predicted"]]
    path.write_text(json.dumps({**document, "fit": {**document["fit"], "predicted": predicted}}))
    saved = ident.load(path)
    assert saved.fitted.parameters == result.parameters
    assert saved.notes == ("table1.fit.json: its predictions, evaluated again, differ by 0.001",)


@pytest.mark.parametrize(
    "inputs",
    [None, {"arm": "x"}, {"arm": {}}, {"arm": {"path": 5, "sha256": ""}}, {"arm": {"path": "a\0", "sha256": ""}}],
)
def test_damaged_inputs_are_refused_in_one_line(result, tmp_path, inputs):
    (path,) = result.save(tmp_path)
    path.write_text(json.dumps({**json.loads(path.read_text()), "inputs": inputs}))
    with pytest.raises(ident.InputError, match="other contents"):
        ident.load(path)


def test_a_part_of_a_campaign_and_one_of_no_file_are_kept_as_they_were(table_1, result, tmp_path):
    more = tmp_path / "more.csv"
    more.write_text((DATA / "lcd_arm" / "table1.csv").read_text() + "deflection,0,0,30,,tip,-z,20.0,mm,2%,\n")
    whole = ident.read_campaign(more)
    part = replace(whole, measurements=whole.measurements[:-1])
    assert part.measurements == table_1.measurements != whole.measurements
    for number, campaign in enumerate((part, ident.Campaign(name="own", measurements=table_1.measurements))):
        first = fit(DATA / "lcd_arm" / "arm.toml", campaign, result.options)
        saved = ident.load(first.save(tmp_path / str(number))[0])
        assert copy.deepcopy(saved).fitted.parameters == pytest.approx(first.parameters, rel=1e-9)
        assert saved.fitted.campaign == campaign
        assert ident.rerun(saved.path).same


def test_a_fit_is_made_again_where_its_inputs_are_gone(result, tmp_path):
    for name in ("arm.toml", "table1.csv"):
        (tmp_path / name).write_bytes((DATA / "lcd_arm" / name).read_bytes())
    first = fit(tmp_path / "arm.toml", tmp_path / "table1.csv", result.options)
    (path,) = first.save(tmp_path / "out")
    (tmp_path / "arm.toml").unlink()
    (tmp_path / "table1.csv").write_text("changed")
    assert ident.load(path).fitted.parameters == first.parameters
    again = ident.rerun(path)
    assert again.same
    words = "is not as it was: repeated from its text in the result"
    assert again.notes == tuple(f"{tmp_path / name} {words}" for name in ("arm.toml", "table1.csv"))


def test_options_are_checked_when_they_are_made():
    for options, words in (({"starts": 0}, "starts"), ({"prior_sd": -1.0}, "prior_sd"), ({"seed": -1}, "seed")):
        with pytest.raises(ident.InputError, match=f"{words}: got {next(iter(options.values())):g}"):
            FitOptions(**options)


def test_a_file_of_another_ending_is_refused(result, tmp_path):
    with pytest.raises(ident.InputError, match=r"the ending \.txt, expected a file \*\.json"):
        result.save(tmp_path / "my.txt")
    assert not list(tmp_path.iterdir())
    assert result.save(tmp_path / "my.json") == (tmp_path / "my.json",)


def test_an_arm_of_torsion_springs_alone_is_fitted_and_comes_back(tmp_path):
    """As published identifications of six-axis arms have it: rigid across every axis."""
    for name in ("arm.xml", "arm.joints.toml"):
        text = (DATA / "six_axis" / name).read_text()
        (tmp_path / name).write_text(re.sub("k_bend = .*", 'k_bend = "rigid"', text))
    arm = ident.read_arm(tmp_path / "arm.xml")
    made = example(arm.arm)
    write_campaign(made.campaign, tmp_path / "made.csv")
    result = fit(arm, ident.read_campaign(tmp_path / "made.csv"), FitOptions(starts=1, no_explain=True))
    assert set(result.parameters) == set(made.truth) == {f"joint_{n}.k_tors" for n in range(1, 7)}
    errors = zip(result.intervals.values(), made.truth.values(), strict=True)
    assert sum(low <= true <= high for (low, high), true in errors) >= 5
    assert_comes_back(result, tmp_path)
    again = ident.load(tmp_path / f"{result.name}.json").fitted
    assert again.parameters == pytest.approx(result.parameters, rel=1e-9)
