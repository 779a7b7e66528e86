"""`ident sweep`: real runs on a short motion, the files that they leave, and bad input."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest
from arms import lcd_arm
from commands import ARM, files, posterior

from ident.vibrate.motion import stroke
from ident.vibrate.simulate import amplitude, simulate, superposition

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


def test_a_map_of_a_number_and_the_speed(run, tmp_path, made):
    options = ("--vary=speed=150:200:2", f"--vary={K}=0.5x:2x:2", "--grid", "--measure=rms", "--details")
    code, out, err = run("sweep", ARM, *SHORT, *options)
    assert (code, err) == (0, "")
    name = f"out/arm.extend-200.speed-by-{K}.sweep"
    assert files(tmp_path) == [f"{name}.{end}" for end in ("csv", "json", "png")]
    (found,) = made[Path(name).name].study.sweeps
    assert np.shape(found.amplitude) == (3, 2, 2)
    motion = stroke(lcd_arm().stroke, percent=200, dwell=0.5)
    single = simulate(lcd_arm().replace({K: 2 * float(lcd_arm().get(K))}), motion, rate=100 * 200 / 150)
    expected = amplitude("rms", motion, 100 * 200 / 150)(single.vibration)
    np.testing.assert_allclose(found.amplitude[:, 1, 1], expected, rtol=5e-3)
    last = rows(f"{name}.csv")[-1]
    assert (last["parameter"], last["value"], last["unit"], last["parameter2"]) == ("speed", "200", "%", K)
    assert float(last["amplitude [mm]"]) == pytest.approx(1e3 * found.amplitude[2, 1, 1])
    assert "pauses included" in out
    assert "For each speed: least and largest" in out
    assert "the mean over the unknown imbalance phases" in " ".join(out.split())


def test_draws_give_bands_and_the_probability_of_exceeding(run, tmp_path, made):
    values = posterior(tmp_path / "draws.nc")
    options = (f"--vary={K}=0.5x:2x:2", "--posterior=draws.nc", "--draws=3", "--limit=20", "--details")
    code, out, err = run("sweep", ARM, *SHORT, *options)
    assert (code, err) == (0, "")
    assert "5 to 95 %" in out
    assert "3 draws of the posterior of 2 numbers" in out
    name = f"out/arm.extend-200.{K}.sweep"
    study = made[Path(name).name].study
    (found,) = study.sweeps
    low, high = found.band
    assert study.draws == 3
    assert (high > low).all()
    assert len(found.exceeds(study.limit)) == 2
    for share in found.exceeds(study.limit):
        assert f" {100 * share:.0f} %" in out
    assert found.axes[0].present == pytest.approx(np.median(values[K].ravel()[[4, 12, 20]]))
    first = rows(f"{name}.csv")[0]
    assert float(first["q05 [mm]"]) == pytest.approx(1e3 * low[0, 0])
    assert float(first["q95 [mm]"]) == pytest.approx(1e3 * high[0, 0])


def test_other_parameters_are_other_files_and_an_arm_without_drives_is_told(run, tmp_path):
    log = "time [s],joint1 [deg],joint2 [deg],joint3 [deg]\n"
    way = ((t, 10 * t**3 - 15 * t**4 + 6 * t**5) for t in np.linspace(0, 1, 21))
    (tmp_path / "teach.csv").write_text(log + "".join(f"{t},{20 * s},{-40 * s},{20 * s}\n" for t, s in way))
    (tmp_path / "bare.toml").write_text(ARM.read_text().split("[[drive]]")[0])
    options = ("--path=teach.csv", "--dwell=0.2", "--rate=100", "--no-figure")
    for vary in ("link1.mass=0.9x:1.1x:2", "link2.mass=0.9x:1.1x:2"):
        code, out, err = run("sweep", "bare.toml", *options, f"--vary={vary}")
        assert (code, err) == (0, "")
        assert "no [[drive]]: only the motion itself excites the arm" in out
    names = [f"out/bare.teach.link{n}.mass.sweep.{end}" for n in (1, 2) for end in ("csv", "json")]
    assert files(tmp_path) == ["bare.toml", *names, "teach.csv"]


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
