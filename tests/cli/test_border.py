"""What can't be, or would never end, is refused beforehand: one line that names the file's row or the option."""

import dataclasses
import json
import re
from pathlib import Path

import arviz
import numpy as np
import pytest
from arms import DATA
from chain_files import chain_file
from commands import ARM, posterior
from figures import CAMPAIGN_FIT

import ident
from ident.arm.arm import Arm
from ident.arm.parts import Joint
from ident.studies.values import drawn_values

pytestmark = pytest.mark.slow

FOLDER = DATA / "lcd_arm"
TABLE = FOLDER / "table1.csv"


def refused(run, *arguments):
    """Return the one line by which a command is refused with nothing written."""
    code, out, err = run(*arguments)
    assert (code, out) == (2, ""), err
    assert len(err.splitlines()) == 1
    assert not (Path.cwd() / "out").exists()
    return err


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        (["link1.inertia.xx=-5"], "link1.inertia.xx=-5, expected a value >= 0"),
        (["link1.inertia.xx=1e6"], "link1.inertia: principal moments"),
        (["drive1.ratio=0"], "drive1.ratio=0, expected a value that is not zero"),
        (["drive1.eccentric_mass=1e9"], "drive1.eccentric_mass: 1e+09 kg, expected 0 to"),
        (["stroke.speed=-1"], "stroke.speed=-1, expected a value > 0"),
        (["stroke.folded=0", "stroke.unfolded=0"], "stroke.folded: folded and unfolded at 0 rad"),
        (
            ["bracket.mass=0", "fingers.mass=0", "shaft3.mass=0", "drive3.eccentric_mass=0"],
            "joint3: no mass beyond the bushing",
        ),
        (["joint1.k_bend=1", "joint1.k_bend=2"], "joint1.k_bend twice"),
        (["joint1.k_bend=1e400"], "'1e400', expected a finite number"),
    ],
)
@pytest.mark.parametrize("command", ["predict", "simulate"])
def test_numbers_that_are_set_pass_the_arm_files_own_checks(run, command, changed, words):
    err = refused(run, command, ARM, *(f"--set={each}" for each in changed))
    assert err.startswith("ident: --set")
    assert words in err


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--free=link1.mass:0.1", "--fix=link1.mass"], "--free: got link1.mass fixed and freed, expected one of"),
        (["--tie=joint1.k_bend=joint1.tau_bend"], "--tie: got a tie of joint1.k_bend [N m/rad], joint1.tau_bend [s]"),
        (["--fix=jint1.k_tors"], "--fix: got jint1.k_tors, expected a number of the arm"),
        (["--fix=*.k_bond"], "--fix: got the pattern '*.k_bond'"),
        (["--tie=joint1.k_tors=joint9.k_tors"], "--tie: got joint9.k_tors, expected a number of the arm"),
        (["--tie=joint1.k_tors=joint1.k_tors"], "--tie: got joint1.k_tors twice"),
        (
            ["--tie=joint1.tau_bend=joint2.tau_bend"],
            "--tie: got joint1.tau_bend=joint2.tau_bend, expected at least one",
        ),
        (["--free=foo:0.1"], "--free: got foo, expected a number of the arm"),
        (["--uncertain=foo:5%"], "--uncertain: got foo, expected a number of the arm"),
        (["--prior=link1.mass=log-uniform:1:2"], "--prior: got a prior for link1.mass, which is not fitted"),
        (["--fix=*.k_bend", "--fix=*.k_tors"], "--fix: got no unknown"),
        (["--prior=joint1.k_bend=log-uniform:1:1"], "log-uniform from 1 to 1, expected low < high"),
        (["--prior=joint1.k_bend=catalogue:1:2"], "a factor of 3.6e+05 from the arm's 7.173e+05"),
        (["--prior=joint1.k_bend=log-normal:7e5:1e9"], "a prior width of 1e+09"),
        (["--prior-sd=1e400"], "--prior-sd: got inf, expected a number above 0, at most 100"),
        (["--prior-sd=1e200"], "--prior-sd: got 1e+200"),
        (["--prior-sd=1e-200"], "a prior width of 1e-200, expected a width from 1e-06 to 100"),
        (["--free=link1.com.x:1e200"], "a prior width of 1e+200"),
        (["--discrepancy=deflection:1e200"], "a discrepancy of width 1e+200"),
        (["--starts=100000"], "--starts: got 100000, expected a number from 1 to 10000"),
        (["--out=" + "x" * 300], "no place to write (file name too long)"),
        (["--out=" + "/".join(["x" * 200] * 30)], "no place to write (file name too long)"),
    ],
)
def test_unknowns_and_priors_that_can_not_be(run, options, words):
    assert words in refused(run, "fit", TABLE, *options)


@pytest.mark.parametrize(
    ("command", "words"),
    [
        (["sample", TABLE, "--walkers=100000000"], "--walkers: got 1e+08, expected a number from 2 to 10000"),
        (["sample", TABLE, "--ensembles=1000000"], "--ensembles: got 1e+06"),
        (["sample", TABLE, "--ensembles=100", "--walkers=10000"], "--walkers: got 1000000 in 100 ensembles"),
        (["sample", TABLE, "--ess=1e300"], "--ess: got 1e+300"),
        (["plan", TABLE, "--draws=1000000"], "--draws: got 1e+06"),
        (["plan", TABLE, "--count=1000000"], "--count: got 1e+06"),
        (["plan", TABLE, "--step=1e-6"], "--step: got a step of 1e-06 deg"),
        (["diagnose", TABLE, "--dwell=1e300"], "--dwell: got 1e+300, expected a number from 0 to 3600"),
        (["design", ARM, "--min-frequency=1e9"], "--min-frequency: got 1e+09, expected a number above 0, at most 1000"),
        (["resonance", ARM, "--orders=20000"], "--orders: got 20000, expected at most 1000"),
        (["resonance", ARM, "--orders=" + ",".join(["1"] * 1001)], "--orders: got 1001 of them, expected at most 1000"),
        (["simulate", ARM, "--dwell=nan"], "--dwell: got nan"),
        (["simulate", ARM, "--dwell=3000"], "--dwell: got 3000 s"),
        (["simulate", ARM, "--rate=nan"], "--rate: got nan"),
        (["simulate", ARM, "--rate=1e6"], "--rate: got 1e+06 samples a second"),
        (["simulate", ARM, "--speed=0.002"], "--speed: got a motion of"),
        (["simulate", ARM, "--speed=1e-300"], "--speed: got 1e-300, expected at least 0.001"),
        (["simulate", ARM, "--method=fast", "--step=1e-300"], "--step: got steps of 1e-300 s"),
        (["simulate", ARM, "--method=fast", "--set=drive1.ratio=1e300"], "--set: got drive1.ratio=1e+300"),
        (["simulate", ARM, "--at=nan"], "--at: got nan"),
        (["predict", ARM, "--posture=0,0,1e300"], "--posture: got"),
        (["spectrum", TABLE, "--to=nan"], "--to: got nan, expected a finite number"),
    ],
)
def test_what_would_take_an_hour_or_all_memory_is_refused_by_its_name(run, command, words):
    err = refused(run, *command)
    assert words in err
    assert err.startswith(f"ident: {words.partition(':')[0]}")


def test_steps_that_a_drive_asks_for_are_refused_where_they_would_never_end(run):
    err = refused(run, "simulate", ARM, "--method=fast", "--set=drive1.ratio=1e12")
    assert "as its drives and frequencies ask for" in err


@pytest.mark.parametrize("joints", [25, 300])
def test_an_arm_of_too_many_joints_is_refused_before_anything_is_compiled(run, tmp_path, joints):
    path = tmp_path / "arm.toml"
    path.write_text(chain_file(joints))
    assert f"arm.toml: got {joints} joints, expected at most 24" in refused(run, "predict", path)
    arm = Arm("chain", [Joint(f"j{n}", k_bend=1e6, k_tors=1e6) for n in range(joints)])
    with pytest.raises(ident.InputError, match=rf"^arm: got {joints} joints"):
        ident.predict(arm)


@pytest.fixture(scope="module")
def fitted():
    """A fit to the shipped campaign, as a stored file says it, of the arm file as it is today."""
    document = json.loads(CAMPAIGN_FIT.read_text())
    document["inputs"]["arm"]["sha256"] = ident.read_arm(ARM).sha256
    return document


def written(path, document, **parameters):
    document = json.loads(json.dumps(document))
    document["summary"]["parameters"] |= parameters
    path.write_text(json.dumps(document))
    return path


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("joint1.k_bend", -1.0, "joint1.k_bend: got -1, expected a value > 0"),
        ("joint1.k_bend", 0, "joint1.k_bend: got 0, expected a value > 0"),
        ("joint1.k_bend", 1e-30, "joint1.k_bend: got 1e-30 N m/rad, expected a value of the order of 7.173e+05"),
        ("link1.mass", -3.0, "link1.mass: got -3, expected a value >= 0"),
        ("link1.inertia.xx", 1e9, "link1.inertia: principal moments"),
        ("joint1.k_bend", True, "other contents"),
        ("joint1.k_bend", "7e5", "other contents"),
        ("joint1.k_bend", 10**400, "other contents"),
        ("joint1.k_bend", [7e5], "other contents"),
    ],
)
def test_a_fit_of_impossible_numbers_is_a_bad_file(run, tmp_path, fitted, name, value, words):
    path = written(tmp_path / "bad.fit.json", fitted, **{name: value})
    err = refused(run, "predict", ARM, f"--fit={path}")
    assert "bad.fit.json" in err
    assert words in err


@pytest.mark.parametrize(
    "change",
    [
        lambda text: re.sub(r'("joint1.k_bend": [0-9.]+)', r"\1, \1", text, count=1),
        lambda text: text.replace('"options": {', '"options": [], "were": {', 1),
        lambda text: text.replace('"options": {', '"options": "none", "were": {', 1),
        lambda text: '{"format": ' + "[" * 100_000,
        lambda text: text[: len(text) // 2],
    ],
    ids=["a name twice", "options a list", "options a text", "deep", "half"],
)
def test_a_fit_of_other_contents_is_a_bad_file(run, tmp_path, fitted, change):
    text = json.dumps(fitted)
    changed = change(text)
    assert changed != text
    (tmp_path / "bad.fit.json").write_text(changed)
    assert "other contents" in refused(run, "predict", ARM, f"--fit={tmp_path / 'bad.fit.json'}")


def test_a_fit_of_another_arm_is_taken_with_a_remark(run, tmp_path, fitted):
    same = written(tmp_path / "same.fit.json", fitted)
    assert "another arm file" not in run("predict", ARM, f"--fit={same}")[1]
    (tmp_path / "heavier.toml").write_text(ARM.read_text() + "# heavier\n")
    code, out, _ = run("predict", tmp_path / "heavier.toml", f"--fit={same}")
    assert code == 0
    assert "fitted to another arm file" in " ".join(out.split())


def drawn(path, sha256="", **values):
    """Write a posterior as ident sample does, of an arm whose file has this hash."""
    posterior(path.with_suffix(".plain.nc"), **values)
    data = arviz.from_netcdf(str(path.with_suffix(".plain.nc")))
    data.attrs |= {"format": json.dumps(ident.SampleResult.form), "inputs": json.dumps({"arm": {"sha256": sha256}})}
    data.to_netcdf(str(path), engine="h5netcdf")
    return path


def test_a_posterior_of_another_arm_is_taken_with_a_remark(tmp_path):
    arm = ident.read_arm(ARM)
    own, other = (drawn(tmp_path / f"{name}.nc", of) for name, of in (("own", arm.sha256), ("other", "f" * 64)))
    assert "another arm file" not in drawn_values(own, arm, 5).remark
    assert "fitted to another arm file" in drawn_values(other, arm, 5).remark


@pytest.mark.parametrize(("value", "words"), [(-1.0, "got -1"), (np.nan, "not finite"), (1e-30, "of the order of")])
def test_a_posterior_of_impossible_draws_is_a_bad_file(run, tmp_path, value, words):
    path = tmp_path / "bad.nc"
    posterior(path, **{"joint3.k_bend": np.full((2, 12), value)})
    err = refused(run, "predict", ARM, f"--posterior={path}")
    assert "bad.nc, joint3.k_bend" in err
    assert words in err


def test_a_posterior_that_claims_more_than_the_memory_holds_is_refused(run, tmp_path):
    import h5netcdf

    with h5netcdf.File(tmp_path / "huge.nc", "w") as file:
        group = file.create_group("posterior")
        group.dimensions = {"chain": 4, "draw": 2**38}
        group.create_variable("joint1.k_bend", ("chain", "draw"), float, chunks=(1, 2**20))
    assert (tmp_path / "huge.nc").stat().st_size < 1e6
    assert "huge.nc" in refused(run, "predict", ARM, f"--posterior={tmp_path / 'huge.nc'}")


def test_a_file_where_the_checkpoints_go_is_refused(run, tmp_path):
    (tmp_path / "kept").mkdir()
    (tmp_path / "kept" / "table1.sample.part").write_text("")
    code, _, err = run("sample", TABLE, "--out=kept", "--starts=1")
    assert code == 2
    assert len(err.splitlines()) == 1
    assert "table1.sample.part" in err


def test_an_arm_with_a_massless_middle_joint_is_refused(run):
    """Turning it one way and the next joint back about the line between them moves no mass: M is singular."""
    words = ("mass", "inertia.xx", "inertia.yy", "inertia.zz")
    none = [f"--set={part}.{word}=0" for part in ("link2", "shaft2") for word in words]
    err = refused(run, "predict", ARM, *none, "--set=drive2.eccentric_mass=0")
    assert "joint2: no mass on the bushing, expected inertia on every bushing" in err


@pytest.mark.parametrize("sharp", ["1e-12", "9e-7"])
def test_a_sigma_that_no_instrument_has_is_refused_by_its_row(run, tmp_path, sharp):
    (tmp_path / "sharp.csv").write_text(TABLE.read_text().replace("0.5%", sharp))
    code, out, err = run("fit", tmp_path / "sharp.csv", f"--arm={ARM}")
    assert (code, out) == (2, "")
    assert [line.split(",")[0][-12:] for line in err.splitlines()] == ["/sharp.csv:5", "/sharp.csv:6"]
    assert "expected a standard deviation of 1e-06 of the value, or more" in err


def test_a_mode_label_of_thousands_of_digits_is_no_label(run, tmp_path):
    text = TABLE.read_text().replace("vertical bending 1", "vertical bending " + "1" * 5000, 1)
    (tmp_path / "digits.csv").write_text(text)
    assert "vertical bending 111" in refused(run, "check", tmp_path / "digits.csv", f"--arm={ARM}")


def test_a_result_of_no_numbers_is_none():
    result = ident.predict(ARM)
    analysis = result.predictions[0].analysis
    bad = dataclasses.replace(analysis, deflection={name: at * np.nan for name, at in analysis.deflection.items()})
    with pytest.raises(ident.ModelError, match=r"no predict: its deflections are beyond all numbers"):
        dataclasses.replace(result, predictions=(dataclasses.replace(result.predictions[0], analysis=bad),))
