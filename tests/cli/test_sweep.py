"""`ident sweep`: real runs on a short motion, the files that they leave, and bad input."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest
from arms import lcd_arm
from commands import ARM, files

from ident.vibrate.motion import stroke
from ident.vibrate.simulate import superposition

pytestmark = pytest.mark.slow

SHORT = ("--speed=200", "--dwell=0.5", "--rate=100")
K = "joint1.k_tors"
PHASES = tuple(f"{drive.name}.phase" for drive in lcd_arm().drives)
NAME = f"out/arm.extend-200.{K}+fingers.com.x.sweep"
VARY = (f"--vary={K}=0.5x:2x:3", "--vary=fingers.com.x=1.2:1.9:2")


def rows(path):
    with open(path) as file:
        return list(csv.DictReader(line for line in file if not line.startswith("#")))


def table(path, parameter):
    """Amplitudes by value and direction [mm]."""
    own = (row for row in rows(path) if row["parameter"] == parameter)
    return {(float(row["value"]), row["direction"]): float(row["amplitude [mm]"]) for row in own}


def test_table_summary_and_report_agree_with_simulate(run, tmp_path, made):
    code, out, err = run("sweep", ARM, *SHORT, *VARY, "--limit=10", "--details")
    assert (code, err) == (0, "")
    assert files(tmp_path) == [f"{NAME}.{end}" for end in ("csv", "json", "png")]
    present = float(lcd_arm().get(K))
    motion = stroke(lcd_arm().stroke, percent=200, dwell=0.5)
    expected = 1e3 * superposition(lcd_arm().replace({K: 2 * present}), motion, PHASES, rate=100).worst

    result = json.loads((tmp_path / f"{NAME}.json").read_text())
    stiffness, centre = made[Path(NAME).name].study.sweeps
    (axis,) = stiffness.axes
    assert (axis.paths, axis.present) == ((K,), pytest.approx(present))
    assert axis.values == pytest.approx([0.5 * present, present, 2 * present])
    sizes = 1e3 * stiffness.amplitude
    np.testing.assert_allclose(sizes[:, 2], expected, rtol=5e-3, err_msg="but for the step of the fast method")
    np.testing.assert_allclose(sizes[:, 1], 1e3 * np.array(result["summary"]["present"]))
    np.testing.assert_allclose([row["amplitude [mm]"] for row in result["table"][:3]], sizes[:, 0])
    assert np.shape(centre.amplitude) == (3, 2)
    assert result["options"]["vary"] == {K: ["0.5x", "2x", 3], "fingers.com.x": [1.2, 1.9, 2]}
    assert result["inputs"]["arm"]["sha256"]

    read = table(f"{NAME}.csv", K)
    for d, direction in enumerate("xyz"):
        for k, value in enumerate(axis.values):
            found = next(size for (at, way), size in read.items() if way == direction and np.isclose(at, value))
            assert found == pytest.approx(sizes[d, k])
        assert f"{sizes[d, 2]:.4f}" in out
    assert {r["unit"] for r in rows(f"{NAME}.csv")} == {"N m/rad", "m"}
    assert {r["q05 [mm]"] for r in rows(f"{NAME}.csv")} == {""}
    for words in ("[N m/rad]", "3.5982e5", "present", "torsional stiffness of joint1", "41 assumed numbers"):
        assert words in out


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--vary=joint1.k_tor"], "--vary joint1.k_tor: got joint1.k_tor"),
        (["--vary=joint1.k_tor"], "did you mean joint1.k_tors?"),
        (["--vary=sped"], "did you mean speed?"),
        (["--vary=link1.mass=50:40"], "--vary link1.mass=50:40: got 50 to 40"),
        (["--vary=link1.mass=nan:40"], "expected a finite number"),
        (["--vary=link1.mass=1:inf"], "expected a finite number"),
        (["--vary=link1.mass=0:40"], "bounds above 0"),
        (["--vary=link1.mass=x:2x"], "got '', expected a finite number"),
        (["--vary=link1.mass=40"], "got '40', expected LOW:HIGH"),
        (["--vary=link1.mass=1:2:3:4"], "expected LOW:HIGH"),
        (["--vary=link1.mass="], "no PATH=LOW:HIGH"),
        (["--vary=1:2"], "no PATH=LOW:HIGH"),
        (["--vary==1:2"], "an empty name"),
        (["--vary=link1.mass=1:2:1"], "got 1 values"),
        (["--vary=link1.mass=1:2:2.5"], "got 2.5 values, expected a whole number"),
        (["--vary=link1.mass=1:2:1e9"], "got 1000000000 values"),
        (["--vary=link1.mass", "--limit=0"], "--limit: got 0"),
        (["--vary=link1.mass", "--measure=peek"], "--measure: got 'peek', expected one of peak, rms, residual"),
        (["--vary=link1.mass", "--measure=residual", "--dwell=0"], "hold the arm (--dwell)"),
        (["--vary=link1.mass", "--rate=nan"], "--rate: got nan"),
        (["--grid"], "--grid: got 0 parameters, expected two"),
        (["--vary=link1.mass", "--grid"], "--grid: got 1 parameter, expected two; name two numbers (--vary), or drop"),
        (["--vary=link1.mass", "--vary=speed", "--vary=link2.mass", "--grid"], "--grid: got 3 parameters"),
        (["--vary=link1.mass=1:2:200", "--vary=speed=4:5:200", "--grid"], "--grid: got 200 x 200 = 40000 points"),
        (["--vary=link1.mass", "--vary=link1.mass=1:2"], "--vary: got link1.mass twice"),
        (["--vary=link1.mass=link1.mass"], "--vary: got link1.mass twice"),
        (["--vary=speed=link1.mass"], "--vary speed=link1.mass: got the speed with others"),
        (["--vary=fingers.com.x=link1.mass"], "a coordinate with other numbers"),
        (["--vary=bracket.com.x=0:0.3"], "within the body"),
        (["--vary=speed=4:2000"], "at most 100 %"),
        (["--vary=speed", "--path=far.csv"], "a motion beyond the joint limits: joint1 at 170"),
        (
            ["--vary=link1.mass", "--set=link1.mass=0"],
            "--vary link1.mass: got 0 at present, expected a number above 0; "
            "it is changed by a factor: set it first (--set)",
        ),
        (["--vary=link1.mass", "--speed=0"], "--speed: got 0, expected a number above 0, at most 1000"),
    ],
)
def test_bad_sweeps_are_one_line_and_nothing_is_written(run, tmp_path, options, words):
    rows = "".join(f"{t},{170 * t},0,0\n" for t in (0, 0.25, 0.5, 0.75, 1))
    (tmp_path / "far.csv").write_text("time [s],joint1 [deg],joint2 [deg],joint3 [deg]\n" + rows)
    code, out, err = run("sweep", ARM, *options)
    assert (code, out) == (2, "")
    assert words in err
    assert err.startswith("ident: ")
    assert len(err.splitlines()) == 1
    assert files(tmp_path) == ["far.csv"]


def test_a_collapse_is_told_with_its_value_and_nothing_is_written_over(run, tmp_path):
    old = tmp_path / "out" / "arm.extend-200.joint1.k_bend.sweep.csv"
    old.parent.mkdir()
    old.write_text("old")
    code, out, err = run("sweep", ARM, *SHORT, "--vary=joint1.k_bend=1:10:2")
    assert (code, out) == (1, "")
    assert "the arm collapses at joint1.k_bend = 1: no stable equilibrium; narrow the range" in err
    assert old.read_text() == "old"
    assert files(tmp_path) == ["out/arm.extend-200.joint1.k_bend.sweep.csv"]
