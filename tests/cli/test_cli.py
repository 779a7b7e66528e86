"""The command line on good input and on bad: exit codes, one line that says what is wrong, nothing written."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from commands import files

from ident import __version__

DATA = Path(__file__).parents[2] / "data" / "lcd_arm"
HEADER = "kind,q1 [deg],q2 [deg],q3 [deg],mode,point,value,unit,relative_sigma"
ROW = "frequency,0,0,0,,,4.38,Hz,0.5%"


def test_sample_goes_on_where_it_was_and_writes_draws_and_figures(run, tmp_path):
    import arviz

    options = ("--starts=1", "--discrepancy=frequency:0.1", "--discrepancy=deflection:0.1", "--fix=joint1.k_bend")
    code, out, err = run("sample", DATA / "table1.csv", *options, "--steps=500", "--no-figure")
    assert code == 0, err
    assert "TOO SHORT" in out
    assert "the same command with more --steps goes on from there" in out
    first = arviz.from_netcdf(tmp_path / "out/table1.sample.nc")
    code, out, _ = run("sample", DATA / "table1.csv", *options, "--steps=600", "--ess=100")
    assert code == 0
    assert "discrepancy.deflection" in out
    assert {"out/table1.sample.corner.png", "out/table1.sample.posterior.png", "out/table1.sample.trace.png"} <= set(
        files(tmp_path)
    )
    data = arviz.from_netcdf(tmp_path / "out/table1.sample.nc")
    assert json.loads(data.attrs["format"]) == "ident-sample/1"
    assert len(json.loads(data.attrs["inputs"])["campaign"]["sha256"]) == 64
    assert data.observed_data["data"].values.tolist() == pytest.approx([4.38, 4.38, 0.022])
    assert set(data.sample_stats["ensemble"].values) == {0, 1, 2, 3}
    draws = data.posterior["joint2.k_tors"]
    assert draws.sizes["draw"] > first.posterior.sizes["draw"]


def test_sample_refuses_the_checkpoints_of_another_run(run, tmp_path):
    short = ("--starts=1", "--steps=500", "--no-figure", "--fix=joint1.k_bend", "--discrepancy=deflection:0.1")
    assert run("sample", DATA / "table1.csv", *short)[0] == 0
    before = {path: (tmp_path / path).read_bytes() for path in files(tmp_path)}
    code, out, err = run("sample", DATA / "table1.csv", *short, "--seed=1")
    assert (code, out) == (2, "")
    assert "a run with another seed" in err
    assert len(err.splitlines()) == 1
    assert {path: (tmp_path / path).read_bytes() for path in files(tmp_path)} == before
    assert run("sample", DATA / "table1.csv", *short, "--seed=1", "--restart")[0] == 0


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--prior=joint1.k_tors=cataloge:1:2"], "log-uniform:LOW:HIGH"),
        (["--prior=joint1.k_tor=log-uniform:1e5:2e5"], "did you mean joint1.k_tors"),
        (["--prior=joint1.k_tors"], "a name, = and what it is given"),
        (["--discrepancy=deflection:0.1", "--discrepancy=deflection:0.2"], "deflection twice"),
        (["--noise=frequenzy"], "did you mean frequency"),
        (["--discrepancy=deflection:-1"], "width > 0"),
        (["--no-prior"], "nor a prior that bound"),
        (["--walkers=6"], "at least 12 for 6 unknowns"),
    ],
)
def test_bad_options_of_sample_are_named(run, tmp_path, options, words):
    code, out, err = run("sample", DATA / "table1.csv", "--starts=1", *options)
    assert (code, out) == (2, "")
    assert words in err
    assert len(err.splitlines()) == 1
    assert files(tmp_path) == []


def test_a_prior_that_excludes_the_data_is_named(run, tmp_path):
    code, out, err = run("sample", DATA / "campaign.csv", "--starts=1", "--prior=joint3.k_bend=log-uniform:2e5:3e5")
    assert (code, out) == (2, "")
    assert "a prior of joint3.k_bend that excludes the data" in err
    assert len(err.splitlines()) == 1
    assert files(tmp_path) == []


def test_version_and_help(run):
    assert run("--version")[:2] == (0, __version__ + "\n")
    code, out, _ = run("fit", "--help")
    assert code == 0
    assert "--no-prior" in out


def test_python_m_ident_is_the_same_program(tmp_path):
    environment = {k: v for k, v in os.environ.items() if k != "PYTHONPATH"}
    command = [sys.executable, "-m", "ident", "fit", str(tmp_path / "none.csv")]
    done = subprocess.run(command, capture_output=True, text=True, cwd=tmp_path, env=environment, timeout=120)
    assert done.returncode == 2
    assert done.stdout == ""
    assert done.stderr.startswith(f"ident: {tmp_path / 'none.csv'}: got no such file")
    assert "Traceback" not in done.stderr


BAD_CAMPAIGNS = {
    "missing column": ([HEADER.replace(",unit", ""), ROW.replace(",Hz", "")], "unit"),
    "unknown unit": ([HEADER, ROW.replace("Hz", "Hx")], "c.csv:2, unit"),
    "unknown kind": ([HEADER, ROW.replace("frequency", "frequence")], "c.csv:2, kind"),
    "not a number": ([HEADER, ROW.replace("4.38", "4.3.8")], "c.csv:2, value"),
    "NaN": ([HEADER, ROW.replace("4.38", "nan")], "c.csv:2, value"),
    "zero sigma": ([HEADER, ROW.replace("0.5%", "0")], "c.csv:2, relative_sigma"),
    "short posture": ([HEADER.replace(",q3 [deg]", ""), ROW.replace("0,0,0", "0,0")], "c.csv:2, posture"),
    "unknown point": ([HEADER, "deflection,0,0,0,,nose,22,mm,2%"], "c.csv:2, point"),
    "duplicate row": ([HEADER, ROW, ROW], "c.csv:3"),
    "rad/s as Hz": ([HEADER, ROW.replace("4.38", "27.52")], "c.csv:2, value"),
    "unknown label": ([HEADER, ROW.replace(",,,4.38", ",wobble,,4.38")], "c.csv:2, mode"),
    "decimal commas between commas": ([HEADER, ROW.replace("4.38", "4,38")], "c.csv:2"),
    "empty": ([], "c.csv"),
    "header only": ([HEADER], "c.csv"),
}


@pytest.mark.parametrize("case", BAD_CAMPAIGNS)
def test_a_bad_campaign_is_one_clear_line_and_nothing_is_written(run, tmp_path, case):
    lines, place = BAD_CAMPAIGNS[case]
    path = tmp_path / "c.csv"
    path.write_text("".join(line + "\n" for line in lines))
    code, out, err = run("fit", path, "--arm", DATA / "arm.toml")
    assert code == 2
    assert out == ""
    assert f"{tmp_path}/{place}" in err or place in err
    assert all(line.startswith("ident: ") for line in err.splitlines())
    assert "expected" in err
    assert files(tmp_path) == ["c.csv"]


def test_european_spreadsheets_are_read(run, tmp_path):
    path = tmp_path / "c.csv"
    text = "\n".join([HEADER, ROW, ROW.replace("4.38", "4.41")]).replace(",", ";").replace(".", ",")
    path.write_bytes(b"\xef\xbb\xbf" + text.encode() + b"\r\n")
    code, out, _ = run("fit", path, "--arm", DATA / "arm.toml", "--no-figure", "--starts=1")
    assert code == 0
    assert "4.41" in out


def test_latin_1_is_refused(run, tmp_path):
    path = tmp_path / "c.csv"
    path.write_bytes((HEADER + ",note\n" + ROW + ",Größe\n").encode("latin-1"))
    code, _, err = run("fit", path, "--arm", DATA / "arm.toml")
    assert code == 2
    assert "UTF-8" in err


BAD_ARMS = {
    "negative mass": ("value = 42.0", "value = -42.0", "mass"),
    "no mass": (
        'mass = { value = 20.0, unit = "kg", origin = "assumed"',
        '# = { value = 20.0, unit = "kg", x = "y"',
        "mass",
    ),
    "not TOML": ("[[joint]]", "[[joint", "arm.toml"),
    "unknown key": ("k_bend", "k_bent", "k_bend"),
    "infinite": ("12.52e6", "inf", "k_bend"),
}


@pytest.mark.parametrize("case", BAD_ARMS)
def test_a_bad_arm_is_one_clear_line_and_nothing_is_written(run, tmp_path, case):
    old, new, word = BAD_ARMS[case]
    text = (DATA / "arm.toml").read_text()
    assert old in text
    arm = tmp_path / "arm.toml"
    arm.write_text(text.replace(old, new, 1))
    code, out, err = run("fit", DATA / "table1.csv", "--arm", arm)
    assert (code, out) == (2, "")
    assert word in err
    assert all(line.startswith(f"ident: {arm}") for line in err.splitlines())
    assert files(tmp_path) == ["arm.toml"]


PLANNED = ["out/table1.plan.csv", "out/table1.plan.json", "out/table1.plan.png"]


def test_plan_says_what_to_measure_next(run, tmp_path):
    options = ["--step=90", "--load=glass", "--count=2", "--draws=1", "--starts=2"]
    code, out, _ = run("plan", DATA / "table1.csv", *options)
    assert code == 0
    assert "The batch of 2" in out
    assert "in doubt" in out
    assert files(tmp_path) == PLANNED
    document = json.loads((tmp_path / "out/table1.plan.json").read_text())
    assert document["options"]["load"] == ["glass"]
    assert len(document["batch"]) == 2
    form = tmp_path / "out/table1.plan.csv"
    filled = form.read_text().replace(",,Hz", ",4.2,Hz")
    assert filled != form.read_text()
    form.write_text(filled)
    code, _, err = run("plan", DATA / "table1.csv", *options)
    assert code == 2
    assert "a form that has been filled in" in err
    assert form.read_text() == filled


def test_plan_starts_from_nothing_and_ends_at_a_target(run, tmp_path):
    options = ["--step=90", "--draws=0", "--target=5", "--criterion=a", "--no-figure", "--cost=dial=0"]
    code, out, _ = run("plan", "--arm", DATA / "arm.toml", "--count=9", *options)
    assert code == 0
    assert "the prior alone" in out
    assert "The batch of 2" in out
    assert files(tmp_path) == ["out/arm.plan.csv", "out/arm.plan.json"]


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--criterion=joint1.kbend"], "did you mean joint1.k_bend"),
        (["--criterion=e"], "d, a, or a parameter's name"),
        (["--step=0"], "a step above 0"),
        (["--step=nan"], "a step above 0"),
        (["--target=-1"], "--target"),
        (["--load=glas"], "glass"),
        (["--sigma=frequency"], "--sigma frequency"),
        (["--sigma=frequency=-1"], "above 0"),
        (["--cost=hammer=cheap"], "'cheap'"),
        (["--cost=hamer=3"], "did you mean hammer"),
        (["--arm=nowhere.toml"], "nowhere.toml"),
    ],
)
def test_bad_plans_are_one_line_and_nothing_is_written(run, tmp_path, options, words):
    code, out, err = run("plan", DATA / "table1.csv", "--draws=0", "--starts=1", *options)
    assert (code, out) == (2, "")
    assert words in err
    assert len(err.splitlines()) == 1
    assert files(tmp_path) == []


def test_a_plan_needs_an_arm(run, tmp_path):
    code, out, err = run("plan")
    assert (code, out) == (2, "")
    assert err == "ident: got neither campaign nor arm, expected one of them; as ident plan --arm arm.toml\n"
