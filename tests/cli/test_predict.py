"""`ident predict` from the command line, and what `ident export` refuses."""

from pathlib import Path

import pytest
from commands import files

DATA = Path(__file__).parents[2] / "data" / "lcd_arm"


def test_predict_prints_modes_and_deflection(run, tmp_path):
    code, out, _ = run("predict", DATA / "arm.toml", "--posture=0,0,0")
    assert code == 0
    assert files(tmp_path) == []
    for text in ("4.12", "lateral torsion 1", "4.80", "vertical bending 1", "26.3"):
        assert text in out


def test_predict_prints_the_compliance_at_the_tool(run, tmp_path):
    code, out, _ = run("predict", DATA / "arm.toml", "--posture=0,0,0", "--tool")
    assert code == 0
    assert files(tmp_path) == []
    for text in ("compliance at tip", "[um/N]", "[mrad/(N m)]", "largest: along", "Joints only: links count as rigid"):
        assert text in out
    for text in ("peak at [Hz]", "peak [um/N]", "times static"):
        assert text in out


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--posture=0,0"], "--posture: got 2 joint angles, expected 3"),
        (["--posture=a,b,c"], "--posture a,b,c: got 'a'"),
        (["--load=glas"], "--load: got 'glas'"),
        (["--set=link2.mas=3"], "link2.mas"),
        (["--set=link2.mass"], "--set link2.mass: got no NAME=VALUE"),
        (["--fit=none.json"], "none.json: got no such file"),
        (["--posterior=none.nc"], "none.nc: got no such file"),
        (["--frame=tool"], "--frame: got 'tool', expected none without --tool"),
        (["--tool", "--frame=tol"], "--frame: got 'tol', expected one of base, tool"),
        (["--tool", "--point=tipp"], "--point: got 'tipp', expected one of tip"),
        (["--set=link2.mass=-3"], "--set: got link2.mass=-3, expected a value >= 0"),
    ],
)
def test_bad_predictions_are_named(run, tmp_path, options, words):
    code, out, err = run("predict", DATA / "arm.toml", *options)
    assert (code, out) == (2, "")
    assert err.startswith("ident: ")
    assert words in err
    assert len(err.splitlines()) == 1
    assert files(tmp_path) == []


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("none.fit.json", "--out=fitted.xml"), "none.fit.json: got no such file"),
        (("arm.toml", "--out=fitted.xml"), "arm.toml"),
        (("other.json", "--out=fitted.xml"), "other.json"),
    ],
)
def test_what_is_no_result_is_not_exported(run, tmp_path, arguments, words):
    (tmp_path / "arm.toml").write_text('format = "ident-arm/1"')
    (tmp_path / "other.json").write_text('{"format": "ident-export/1"}')
    before = files(tmp_path)
    code, out, err = run("export", *arguments)
    assert (code, out) == (2, "")
    assert words in err
    assert len(err.splitlines()) == 1
    assert files(tmp_path) == before
