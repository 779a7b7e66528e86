"""`ident fit` and `ident check` from the command line."""

import json
from pathlib import Path

import numpy as np
import pytest
from commands import TABLE_1, files

import ident
from ident import __version__

pytestmark = pytest.mark.slow

DATA = Path(__file__).parents[2] / "data" / "lcd_arm"


def test_fit_prints_a_report_and_writes_a_result_and_a_figure(run, tmp_path, shelf):
    """By a command of the manual, whose answer stays on the shelf for its pages."""
    (tmp_path / "data").symlink_to(DATA.parent)
    code, out, _ = shelf.put(TABLE_1, run)
    assert code == 0
    assert "RESULT: NOT USABLE. Deflection and frequency data contradict each other (4.1 sigma)." in out
    assert {path.name for path in tmp_path.iterdir()} == {"data", "out"}
    assert files(tmp_path / "out") == ["table1.fit.json", "table1.fit.png"]
    result = json.loads((tmp_path / "out/table1.fit.json").read_text())
    assert result["format"] == ident.FitResult.form
    assert result["summary"]["rank"] == 3
    assert result["summary"]["p_value"] is None, "undefined is null in JSON"
    assert [row["supported"] for row in result["table"]] == [False] * 6
    assert len(result["inputs"]["campaign"]["sha256"]) == 64
    assert result["software"]["ident"] == __version__
    (best, *_) = result["fit"]["optima"]
    fitted = ident.load(tmp_path / "out/table1.fit.json").fitted
    assert best["sd"] == fitted.best.sd.tolist(), "to the last bit"
    np.testing.assert_allclose(fitted.information.sd, best["sd"], rtol=1e-9)


def test_a_dial_gauge_alone_is_fitted_and_what_it_leaves_open_is_said(run, tmp_path):
    lines = (DATA / "campaign.csv").read_text().splitlines(keepends=True)
    (tmp_path / "dial.csv").write_text("".join(line for line in lines if not line.startswith("frequency")))
    options = (f"--arm={DATA / 'arm.toml'}", "--tie=joint2.k_tors=joint3.k_tors", "--starts=1", "--no-figure")
    code, out, err = run("fit", tmp_path / "dial.csv", *options)
    assert (code, err) == (0, "")
    assert "4 measurements, 5 unknown stiffnesses" in out
    result = json.loads((tmp_path / "out/dial.fit.json").read_text())
    tied = result["summary"]["parameters"]
    assert len(result["table"]) == 5
    assert tied["joint2.k_tors"] == tied["joint3.k_tors"]
    assert "inf" not in out
    assert "nan" not in out


def test_check_prints_a_verdict_for_each_parameter_and_writes_nothing(run, tmp_path):
    code, out, err = run("check", DATA / "table1.csv", "--no-explain")
    assert (code, err) == (0, "")
    assert "RESULT: NOT READY. Deflection and frequency data contradict each other (4.1 sigma)." in out
    assert out.count("not determined  only in combination with others") == 6
    code, out, _ = run("check", DATA / "table1.csv", "--no-explain", "--details", "--strict")
    assert code == 3
    assert "torsion of joint2 against torsion of joint1" in out
    assert files(tmp_path) == []


def test_options_reach_the_fit(run, tmp_path):
    code, out, _ = run(
        "fit",
        DATA / "table1.csv",
        "--fix=joint1.k_bend",
        "--starts=1",
        "--no-figure",
        "--no-prior",
        "--no-explain",
        "--out=results",
        "--details",
    )
    assert code == 0
    assert files(tmp_path) == ["results/table1.fit.json"]
    result = json.loads((tmp_path / "results/table1.fit.json").read_text())
    names = [row["parameter"] for row in result["table"]]
    assert names == ["joint2.k_bend", "joint3.k_bend", "joint1.k_tors", "joint2.k_tors", "joint3.k_tors"]
    assert result["options"]["fix"] == ["joint1.k_bend"]
    assert "Prior: none." in out
    assert ident.load("results/table1.fit.json").report(details=True) == out.partition("wrote ")[0]


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--fix=joint1.kbend"], "did you mean"),
        (["--tie=joint1.k_bend=joint9.k_bend"], "joint9.k_bend"),
        (["--free=link2.mass:heavy"], "'heavy'"),
        (["--free=link7.mass"], "link7.mass"),
        (["--prior-sd=-1"], "--prior-sd: got -1, expected a number above 0"),
        (["--arm=nowhere.toml"], "nowhere.toml"),
    ],
)
def test_bad_options_are_named(run, tmp_path, options, words):
    code, out, err = run("fit", DATA / "table1.csv", *options)
    assert (code, out) == (2, "")
    assert words in err
    assert len(err.splitlines()) == 1
    assert files(tmp_path) == []


def test_a_result_that_cannot_be_written_leaves_the_old_one(run, tmp_path):
    (tmp_path / "out").write_text("a file, where a folder should be")
    code, out, err = run("fit", DATA / "table1.csv", "--starts=1")
    assert (code, out) == (2, ""), "before anything is computed"
    assert "--out" in err
    assert files(tmp_path) == ["out"]


@pytest.mark.skipif(not Path("/proc/self").exists(), reason="no such place here")
def test_a_folder_that_not_even_root_can_make_is_refused_before_anything_is_computed(run):
    code, out, err = run("fit", DATA / "table1.csv", "--out=/proc/x")
    assert (code, out) == (2, "")
    assert err.startswith("ident: /proc: got no place to write (")
    assert err.endswith("expected a folder that can be written; choose another (--out)\n")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("fit", DATA / "arm.toml"), "got an arm description, expected a table as CSV; name the measurements"),
        (("predict", DATA / "campaign.csv"), "got a table, expected an arm description as TOML; name the arm's file"),
    ],
)
def test_a_file_in_the_other_ones_place_is_named(run, arguments, words):
    code, _, err = run(*arguments)
    assert code == 2
    assert words in err
    assert len(err.splitlines()) == 1
