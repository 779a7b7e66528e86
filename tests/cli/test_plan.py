"""`ident plan` through the command line."""

import json

import pytest
from arms import DATA
from commands import files

pytestmark = pytest.mark.slow

DATA = DATA / "lcd_arm"


PLANNED = ["out/table1.plan.csv", "out/table1.plan.json", "out/table1.plan.png"]


def test_plan_says_what_to_measure_next(run, tmp_path):
    options = ["--step=90", "--load=glass", "--count=2", "--draws=1", "--starts=1"]
    code, out, _ = run("plan", DATA / "table1.csv", *options)
    assert code == 0
    assert out.startswith("Plan of 2 experiments")
    assert "PROVISIONAL" in out
    assert files(tmp_path) == PLANNED
    document = json.loads((tmp_path / "out/table1.plan.json").read_text())
    assert document["options"]["load"] == ["glass"]
    assert [row["step"] for row in document["table"]] == [1, 2]
    form = tmp_path / "out/table1.plan.csv"
    filled = form.read_text().replace(",,Hz", ",4.2,Hz")
    assert filled != form.read_text()
    form.write_text(filled)
    code, out, _ = run("plan", DATA / "table1.csv", *options)
    assert code == 0
    assert "kept what was there as out/table1.plan.1.*: not known to be as ident wrote it" in out
    assert form.with_name("table1.plan.1.csv").read_text() == filled
    assert files(tmp_path) == sorted([*PLANNED, *(name.replace(".plan", ".plan.1") for name in PLANNED)])


def test_plan_starts_from_nothing_and_ends_at_a_target(run, tmp_path):
    options = ["--step=90", "--draws=1", "--target=5", "--criterion=a", "--no-figure", "--cost=dial=0"]
    code, out, _ = run("plan", "--arm", DATA / "arm.toml", "--count=9", *options)
    assert code == 0
    assert "Plan of 2 experiments" in out
    assert "the prior alone" in out
    assert files(tmp_path) == ["out/arm.plan.csv", "out/arm.plan.json"]


def test_a_sheet_is_written_and_a_table_that_was_filled_in_is_kept(run, tmp_path):
    options = ["--step=90", "--draws=0", "--count=2", "--no-figure", "--sheet=tap", "--sensor-mass=20"]
    code, out, _ = run("plan", "--arm", DATA / "hammer/arm.toml", *options)
    assert code == 0
    assert "measure by out/arm.plan.sheet/sheet.html, then: ident modal out/arm.plan.sheet" in out
    sheet = [f"out/arm.plan.sheet/{name}" for name in ("arm.toml", "channels.csv", "sheet.html")]
    assert files(tmp_path) == sorted(["out/arm.plan.csv", "out/arm.plan.json", *sheet])
    table = tmp_path / sheet[1]
    text = table.read_text()
    first = text.splitlines()[2].split(",")
    assert (first[0], first[1], first[2], first[-2], first[-1]) == ("p1_tap1*", "1", "response", "tap", "5")
    assert "0.02 kg @ " in text
    table.write_text(text.replace("response", "reference"))
    code, out, _ = run("plan", "--arm", DATA / "hammer/arm.toml", *options)
    assert code == 0
    assert "kept what was there as out/arm.plan.1.*" in out
    assert (tmp_path / "out/arm.plan.1.sheet/channels.csv").read_text() == text.replace("response", "reference")
    assert table.read_text() == text


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--criterion=joint1.kbend"], "did you mean joint1.k_bend"),
        (["--criterion=e"], "d, a, or a parameter's name"),
        (["--step=0"], "--step: got 0, expected a number above 0, at most 360"),
        (["--step=nan"], "--step: got nan, expected a number above 0"),
        (["--target=-1"], "--target"),
        (["--load=glas"], "glass"),
        (["--sigma=frequency"], "--sigma frequency"),
        (["--sigma=frequency=-1"], "above 0"),
        (["--cost=hammer=cheap"], "'cheap'"),
        (["--cost=hamer=3"], "did you mean hammer"),
        (["--arm=nowhere.toml"], "nowhere.toml"),
        (["--sheet=ambient"], "--sheet: got 'ambient', expected one of hammer, tap"),
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
