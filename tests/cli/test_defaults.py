"""`ident.toml` beside the campaign: command line before file before default."""

import json
import shutil

import pytest
from commands import ARM, files

pytestmark = pytest.mark.slow

CAMPAIGN = ARM.parent / "table1.csv"
GOOD = """
starts = 1
no-figure = true
no-explain = true
out = "results"
arm = "robot.toml"
method = "fast"  # of other commands
[fit]
prior-sd = 0.5
trust-values = ["5", "6"]
[predict]
posture = "30,-60,30"
"""


@pytest.fixture
def folder(tmp_path):
    inner = tmp_path / "my"
    inner.mkdir()
    shutil.copy(ARM, inner / "robot.toml")
    shutil.copy(CAMPAIGN, inner / "campaign.csv")
    (inner / "ident.toml").write_text(GOOD)
    return inner


def options(folder):
    return json.loads((folder / "results" / "campaign.fit.json").read_text())["options"]


def test_the_file_is_taken_and_the_result_records_the_values(run, folder):
    code, out, err = run("fit", "my/campaign.csv")
    assert (code, err) == (0, "")
    assert out.startswith("defaults from my/ident.toml: ")
    assert 'prior-sd = 0.5, trust-values = ["5", "6"]' in out.replace("\n    ", " ")
    assert files(folder / "results") == ["campaign.fit.json"]
    recorded = options(folder)
    assert (recorded["starts"], recorded["prior_sd"], recorded["trust_values"]) == (1, 0.5, ["5", "6"])
    code, out, _ = run("rerun", "my/results/campaign.fit.json")
    assert code == 0
    assert "defaults" not in out


def test_the_command_line_comes_first(run, folder):
    code, *_ = run("fit", "my/campaign.csv", "--prior-sd=1", "--trust-values=7", "--out=my/results")
    assert code == 0
    recorded = options(folder)
    assert (recorded["starts"], recorded["prior_sd"], recorded["trust_values"]) == (1, 1.0, ["7"])


def test_what_insists_is_no_default(run, folder):
    (folder / "ident.toml").write_text("force = true")
    code, _, err = run("fit", "my/campaign.csv", "--no-figure")
    assert code == 2
    assert "force" in err


def test_it_lies_beside_the_arm_where_there_is_no_campaign(run, folder):
    code, out, _ = run("predict", "my/robot.toml")
    assert code == 0
    assert "(30, -60, 30) deg" in out
    code, out, _ = run("predict", "my/robot.toml", "--posture=0,0,0", "--quiet", "--json")
    assert json.loads(out)["options"]["posture"] == [[0.0, 0.0, 0.0]]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (
            "start = 4",
            "start: got unknown key 'start', expected a flag of a command, without its dashes; did you mean starts?",
        ),
        ("[fit]\nposture = '1,2,3'", "fit.posture: got unknown key"),
        ("[fitt]\nstarts = 1", "fitt: got unknown key"),
        ("[rerun]\nout = 'x'", "rerun: got unknown key"),
        ("prior-sd = 'a'", "prior-sd: got 'a', expected a number"),
        ("seed = 1.5", "seed: got '1.5', expected a whole number"),
        ("no-prior = 3", "no-prior: got '3', expected true or false"),
        ("starts = true", "starts: got 'True', expected a whole number"),
        ("starts = [1, 2]", "expected a whole number"),
        ("json = true", "unknown key 'json'"),
        ("starts = ", "ident.toml: got invalid value"),
        ("starts = 0", "--starts: got 0"),
        ("fit = 5", "fit: got '5', expected a table of the command's flags"),
        ("[[fit]]\nstarts = 1", "expected a table of the command's flags"),
        ("[fit]\nfix = {a = 1}", "fix: got '{'a': 1}', expected text in quotes"),
        ("[fit.fix]\na = 1", "fix: got '{'a': 1}', expected text in quotes"),
        ("prior-sd = 1" + "0" * 400, "prior-sd: got '10000"),
        ("[fleet]\nrobust = 't'", "fleet.robust: got unknown key 'robust'"),
    ],
)
def test_what_is_wrong_in_it_is_one_line(run, folder, text, words):
    (folder / "ident.toml").write_text(text)
    before = files(folder)
    code, out, err = run("fit", "my/campaign.csv", "--arm=my/robot.toml")
    assert (code, err.count("\n")) == (2, 1)
    assert out == "" or out.startswith("defaults from")
    assert words in err
    assert files(folder) == before
