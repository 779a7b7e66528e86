"""`ident resonance`: real runs, the files that they leave, and bad input."""

import json

import numpy as np
import pytest
from arms import lcd_arm
from commands import ARM, files

from ident.vibrate.branches import branches
from ident.vibrate.motion import stroke

pytestmark = pytest.mark.slow

BASE = "arm.extend-10.resonance"


def test_report_and_result_agree_with_the_library(run, tmp_path, made):
    code, out, err = run("resonance", ARM)
    assert (code, err) == (0, "")
    assert files(tmp_path) == [f"out/{BASE}.json", f"out/{BASE}.png"]
    written = json.loads((tmp_path / "out" / f"{BASE}.json").read_text())
    found = branches(lcd_arm(), stroke(lcd_arm().stroke, percent=10))
    loaded = made[BASE]
    assert loaded.branches.labels == found.labels
    np.testing.assert_allclose(loaded.branches.median, found.median, rtol=1e-9)
    assert written["options"]["margin"] == 10.0
    assert written["table"] == loaded.table()
    assert len(written["table"]) == 4
    assert "Pulley 2 (drive2) crosses lateral torsion 1 at 13.61 s" in out


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--margin=-5"], "margin"),
        (["--orders=1.5"], "--orders 1.5"),
        (["--speed=0"], "--speed"),
        (["--profile=scurve"], "did you mean s-curve"),
        (["--smoothing=1"], "--smoothing"),
        (["--set=drive1.ratio=0"], "ratio"),
    ],
)
def test_bad_input_is_one_line_and_nothing_is_written(run, tmp_path, options, words):
    code, out, err = run("resonance", ARM, *options)
    assert (code, out) == (2, "")
    assert words in err
    assert err.count("\n") == 1
    assert files(tmp_path) == []
