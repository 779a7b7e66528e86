"""`ident profile` from the command line."""

import json
from pathlib import Path

import pytest
from commands import files

from ident.cli import running

pytestmark = pytest.mark.slow

DATA = Path(__file__).parents[2] / "data" / "lcd_arm"


def test_profile_prints_both_intervals_and_writes_a_result_and_a_figure(run, tmp_path, made):
    options = ("--starts=1", "--parameter=joint3.k_bend", "--parameter=joint1.k_tors", "--reach=100")
    code, out, err = run("profile", DATA / "table1.csv", *options)
    assert (code, err) == (0, "")
    assert "95 % by profile" in out
    assert "RESULT: NOT USABLE" in out, "the paper's three numbers contradict each other"
    assert files(tmp_path) == ["out/table1.profile.json", "out/table1.profile.png"]
    result = json.loads((tmp_path / "out/table1.profile.json").read_text())
    assert [row["parameter"] for row in result["table"]] == ["joint3.k_bend", "joint1.k_tors"]
    assert result["options"]["reach"] == 100
    assert len(result["inputs"]["campaign"]["sha256"]) == 64
    for profile in made["table1.profile"].profiles:
        lows = [interval.low for interval in profile.intervals]
        assert len(lows) == 3
        assert lows == sorted(lows, reverse=True)


def test_an_interrupted_profile_leaves_nothing(run, tmp_path, monkeypatch):
    def interrupted(description, total=None):
        def stop(numbers):
            if description == "profiles":
                raise KeyboardInterrupt
            return iter(numbers)

        return stop

    monkeypatch.setattr(running, "progress", interrupted)
    code, out, err = run("profile", DATA / "table1.csv", "--starts=1")
    assert code not in (0, 2)
    assert out == ""
    assert "Traceback" not in err
    assert files(tmp_path) == []


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--parameter=joint1.kbend"], "did you mean joint1.k_bend"),
        (["--parameter=joint1.k_bend", "--fix=joint1.k_bend"], "joint1.k_bend, which is not fitted"),
        (["--reach=1"], "--reach: got 1, expected a number above 1"),
        (["--reach=nan"], "--reach: got nan"),
    ],
)
def test_bad_options_of_profile_are_named(run, tmp_path, options, words):
    code, out, err = run("profile", DATA / "table1.csv", *options)
    assert (code, out) == (2, "")
    assert words in err
    assert len(err.splitlines()) == 1
    assert files(tmp_path) == []
