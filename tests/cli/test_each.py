"""`ident each`: another command for each robot of a folder, done once, whatever becomes of one of them."""

import json
import re
import shutil

import pytest
from arms import DATA

CAMPAIGN = DATA / "lcd_arm" / "campaign.csv"


@pytest.fixture
def robots(tmp_path):
    """Two robots, and a file that is no campaign."""
    folder = tmp_path / "robots"
    folder.mkdir()
    shutil.copy(DATA / "lcd_arm" / "arm.toml", folder)
    for name in ("one", "two"):
        shutil.copy(CAMPAIGN, folder / f"{name}.csv")
    (folder / "broken.csv").write_text("kind,value\n")
    return folder


def done(folder):
    return {path: path.stat().st_mtime_ns for path in (folder / ".done").iterdir()}


def test_each_robot_gets_its_own_files(run, robots):
    code, out, err = run("each", "robots", "--", "fit", "--starts", "1", "--no-figure")
    assert (code, err) == (3, "")
    assert re.search(r"^  broken +2  robots/broken.csv: got only one row,", out, re.MULTILINE)
    assert re.search(r"^  one +0  chi_squared ", out, re.MULTILINE)
    assert re.search(r"^  two +0  chi_squared ", out, re.MULTILINE)
    rows = json.loads((robots.parent / "out" / "robots.fit.json").read_text())
    assert [(row["robot"], row["status"]) for row in rows] == [("broken", 2), ("one", 0), ("two", 0)]
    own = json.loads((robots.parent / "out" / "robots.fit" / "one" / "one.fit.json").read_text())
    assert rows[1]["summary"] == own["summary"]
    assert "arm to two\n" in (robots.parent / "out" / "robots.fit" / "two" / "report.txt").read_text()


def test_what_is_done_is_not_done_again_until_a_file_changes(run, robots):
    words = ("each", "robots", "--quiet", "--", "predict")
    (robots / "broken.csv").unlink()
    assert run(*words)[0] == 0
    folder = robots.parent / "out" / "robots.predict"
    before = done(folder)
    assert len(before) == 2
    assert run(*words)[0] == 0
    assert done(folder) == before
    (folder / "one" / "report.txt").unlink()
    assert run(*words)[0] == 0
    again = done(folder)
    assert sum(again[path] != before[path] for path in before) == 1
    (robots / "two.csv").write_text(CAMPAIGN.read_text() + "# another day\n")
    assert run(*words)[0] == 0
    assert len(done(folder)) == 3


def test_the_name_stands_for_the_robot(run, robots):
    (robots / "broken.csv").unlink()
    (robots / "two.csv").unlink()
    assert run("each", "robots", "--quiet", "--", "fit", "--starts", "1", "--no-figure")[0] == 0
    fitted = "out/robots.fit/{name}/{name}.fit.json"
    code, _, err = run("each", "robots", "--", "predict", "--fit", fitted)
    assert (code, err) == (0, "")
    report = (robots.parent / "out" / "robots.predict" / "one" / "report.txt").read_text()
    assert "one.fit.json" in report


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (("fitt",), "ident: got 'fitt', expected a command for one robot; did you mean fit?"),
        (("compare",), "ident: got 'compare', expected a command for one robot"),
        (("fit", "--startz", "4"), "ident: ident fit: got No such option: --startz"),
        (("fit", "--out=x"), "ident: got --out=x of fit, expected what is each robot's; leave it out"),
    ],
)
def test_words_that_are_no_command_for_a_robot(run, robots, words, expected):
    code, out, err = run("each", "robots", "--", *words)
    assert (code, out) == (2, "")
    assert err.startswith(expected)
    assert len(err.splitlines()) == 1
    assert not (robots.parent / "out").exists()
