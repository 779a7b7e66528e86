"""`ident simulate`: real runs on short motions, the files that they leave, and bad input."""

import json
import re

import arviz
import numpy as np
import pytest
import xarray
from arms import lcd_arm
from chain_files import chain_file
from commands import ARM, files, posterior

import ident
from ident.measure import read_pulleys, read_trace
from ident.vibrate.motion import stroke
from ident.vibrate.response import belt_tension, peak, rms
from ident.vibrate.settling import settling_time
from ident.vibrate.simulate import simulate

pytestmark = pytest.mark.slow

SHORT = ("--speed=200", "--dwell=0.5", "--rate=100")
NAME = "arm.extend-200"
POINT = (
    '[[point]]\nname = "end"\njoint = "joint1"\nposition = { value = [0.1, 0, 0], unit = "m", origin = "assumed" }\n'
)
BARE = chain_file(1) + POINT
"""An arm without drives, belts and stroke, of one joint, whose equations are compiled soon."""


@pytest.fixture(scope="module")
def direct():
    """The same motion, by the library."""
    motion = stroke(lcd_arm().stroke, percent=200, dwell=0.5)
    return {method: simulate(lcd_arm(), motion, method=method, rate=100) for method in ("fast", "exact")}


def test_csv_netcdf_summary_and_report_agree_with_simulate(run, tmp_path, direct, made):
    code, out, err = run("simulate", ARM, *SHORT, "--at=0.7")
    assert (code, err) == (0, "")
    ends = ("csv", "drives.png", "json", "nc", "png")
    assert files(tmp_path) == [f"out/{NAME}.simulate.{end}" for end in ends]
    response, base = direct["exact"], f"out/{NAME}.simulate"
    vibration = np.asarray(response.vibration)

    trace = read_trace(f"{base}.csv")
    assert (trace.kind, list(trace.values)) == ("displacement", ["x", "y", "z"])
    np.testing.assert_allclose(trace.time, response.time, rtol=1e-9)
    np.testing.assert_allclose(np.stack(list(trace.values.values())), vibration, atol=1e-12)
    assert {"belt1.upper [N]", "joint1.rotation.z [deg]", "joint2 [deg]", "displacement.z [mm]"} <= set(trace.ignored)
    pulleys = read_pulleys(f"{base}.csv", trace)
    np.testing.assert_allclose(pulleys["drive2"], response.pulley[1][1], atol=1e-8)

    with xarray.open_dataset(f"{base}.nc", engine="h5netcdf") as data:
        np.testing.assert_allclose(data["vibration"], vibration, atol=1e-12)
        np.testing.assert_allclose(data["vibration_fast"], direct["fast"].vibration, atol=1e-12)
        np.testing.assert_allclose(data["rotation"], response.phi, atol=1e-12)
        np.testing.assert_allclose(data["tension"], belt_tension(response), rtol=1e-9)
        assert data["tension"].dims == ("span", "belt", "time")
        assert data["moment"].attrs["units"] == "N m"
        assert json.loads(data.attrs["inputs"])["arm"]["sha256"]

    result = json.loads((tmp_path / f"{base}.json").read_text())
    assert result["format"] == ident.SimulateResult.form
    found = {name: [row[name] for row in result["table"]] for name in result["table"][0]}
    assert found["peak"] == pytest.approx(np.asarray(peak(response.vibration)))
    assert found["rms"] == pytest.approx(np.asarray(rms(response.vibration)))
    assert found["residual"] == pytest.approx(np.asarray(peak(response.after(response.motion.arrival))))
    assert found["late_peak"] == pytest.approx(np.asarray(peak(response.after(0.7))))
    settled = [None if not np.isfinite(s) else pytest.approx(s) for s in settling_time(response, 1e-4)]
    assert found["settled"] == settled
    assert result["options"]["at"] == 0.7
    difference = np.abs(vibration - np.asarray(direct["fast"].vibration)).max(1) / np.abs(vibration).max(1)
    assert made[f"{NAME}.simulate"].simulation.difference == pytest.approx(difference, rel=1e-6)

    for direction, size in zip("xyz", np.asarray(peak(response.vibration)), strict=True):
        assert re.search(rf"^  {direction} +{1e3 * size:.4f} ", out, re.M)
    for words in ("Largest: ", "41 assumed numbers", "arm.extend-200"):
        assert words in out


def test_a_measured_acceleration_is_compared_as_acceleration(run, tmp_path, direct, made):
    from ident.vibrate.compare import second_derivative

    time, z = np.asarray(direct["fast"].time), np.asarray(direct["fast"].vibration[2])
    rows = np.column_stack([time, 2 * second_derivative(time, z)])
    np.savetxt(tmp_path / "sensor.csv", rows, header="time [s],z [m/s^2]", comments="", delimiter=",", fmt="%.10g")
    code, out, err = run("simulate", ARM, *SHORT, "--method=fast", "--trace=sensor.csv", "--details")
    assert (code, err) == (0, "")
    assert "[m/s^2]" in out
    comparisons = made[f"{NAME}.simulate"].simulation.comparisons
    assert comparisons["z"].peak_ratio == pytest.approx(0.5, rel=1e-3)
    assert "x" not in comparisons


def test_interrupted_nothing_is_written(run, tmp_path, monkeypatch):
    from ident.vibrate import study

    def interrupted(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr(study, "simulate", interrupted)
    code, out, err = run("simulate", ARM, *SHORT)
    assert (code, out) == (130, "")
    assert "Traceback" not in err
    assert files(tmp_path) == []


def test_fitted_values_ties_and_set_reach_the_arm(tmp_path):
    from ident.studies.values import drawn_values, fitted_values

    document = {
        "format": ident.FitResult.form,
        "options": {"soft_base": None},
        "inputs": {"arm": {"path": "", "sha256": ""}},
        "summary": {
            "parameters": {"joint2.k_tors": 3e5, "joint3.k_tors": 3e5, "discrepancy.deflection": 1.1},
            "doubts": [],
            "scaled": [],
        },
    }
    (tmp_path / "a.fit.json").write_text(json.dumps(document))
    fit = fitted_values(tmp_path / "a.fit.json", lcd_arm())
    assert fit.medians == {"joint2.k_tors": 3e5, "joint3.k_tors": 3e5}
    assert fit.left_out == ("discrepancy.deflection",)
    assert fit.without({"joint3.k_tors": 1.0}).keys() == {"joint2.k_tors"}
    values = posterior(tmp_path / "draws.nc")
    with xarray.open_dataset(tmp_path / "draws.nc", group="posterior", engine="h5netcdf") as data:
        tied = arviz.InferenceData(posterior=data.load())
    tied.posterior["joint2.k_tors"].attrs["paths"] = json.dumps(["joint2.k_tors", "joint3.k_tors"])
    tied.to_netcdf(str(tmp_path / "tied.nc"), engine="h5netcdf")
    drawn = drawn_values(tmp_path / "tied.nc", lcd_arm(), 100, seed=1)
    np.testing.assert_array_equal(drawn.values["joint3.k_tors"], drawn.values["joint2.k_tors"])
    np.testing.assert_array_equal(np.sort(drawn.values["joint3.k_tors"]), np.sort(values["joint2.k_tors"].ravel()))


def log(path, angles):
    time = np.linspace(0, 1, 21)
    way = 10 * time**3 - 15 * time**4 + 6 * time**5
    columns = [time, *(way * angle for angle in angles)]
    header = "time [s],joint1 [deg],joint2 [deg],joint3 [deg]"
    np.savetxt(path, np.column_stack(columns), header=header, comments="", delimiter=",")


def test_an_arm_without_drives_is_shaken_by_its_motion_alone_along_a_logged_path(run, tmp_path):
    (tmp_path / "bare.toml").write_text(BARE)
    time = np.linspace(0, 1, 21)
    way = 20 * (10 * time**3 - 15 * time**4 + 6 * time**5)
    header = "time [s],joint1 [deg]"
    np.savetxt(tmp_path / "teach.csv", np.column_stack([time, way]), header=header, comments="", delimiter=",")
    options = ("--path=teach.csv", "--dwell=0.2", "--method=fast", "--rate=100", "--no-figure", "--details")
    code, out, err = run("simulate", "bare.toml", *options, "--load=0.5 kg @ end", "--set=link1.mass=4")
    assert (code, err) == (0, "")
    assert "to (20) deg in 1 s, then held for 0.2 s" in out
    assert "Load: 0.5 kg @ end" in out
    assert "Set: link1.mass = 4" in out
    assert "no [[drive]]: only the motion itself excites the arm" in out
    assert read_pulleys("out/bare.teach.simulate.csv", read_trace("out/bare.teach.simulate.csv")) == {}


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--speed=0"], "--speed: got 0, expected a number above 0, at most 1000"),
        (["--speed=nan"], "--speed: got nan, expected a number above 0"),
        (["--profile=scurve"], "did you mean s-curve"),
        (["--dwell=-1"], "--dwell: got -1, expected a number from 0 to 3600"),
        (["--method=exakt"], "did you mean exact"),
        (["--rate=0.1"], "--rate: got 0.1"),
        (["--band=8:4"], "--band 8:4"),
        (["--settled=0"], "--settled: got 0"),
        (["--limit=inf"], "--limit: got inf"),
        (["--at=99"], "hold the arm longer (--dwell)"),
        (["--load=glas"], "did you mean glass"),
        (["--set=link2.mas=3"], "link2.mas"),
        (["--set=link2.mass=-3"], "a value >= 0"),
        (["--smoothing=0.1"], "--smoothing"),
        (["--path=far.csv"], "a motion beyond the joint limits: joint1 at 170"),
        (["--path=far.csv", "--retract"], "--retract"),
        (["--trace=nan.csv"], "nan.csv, time: got an interval of 2 s before sample 2"),
        (["--fit=nan.csv"], "nan.csv: got other contents"),
        (["--posterior=nan.csv"], "nan.csv: got other contents"),
        (["--posterior=useless.nc"], "useless.nc: got only discrepancy.deflection"),
        (["--posterior=none.nc"], "none.nc: got no such file"),
    ],
)
def test_bad_simulations_are_one_line_and_nothing_is_written(run, tmp_path, options, words):
    log(tmp_path / "far.csv", (170, 0, 0))
    (tmp_path / "nan.csv").write_text("time [s],x [mm]\n0,1\n1,nan\n" + "".join(f"{t},0\n" for t in range(2, 20)))
    arviz.from_dict(posterior={"discrepancy.deflection": np.ones((2, 3))}).to_netcdf(
        str(tmp_path / "useless.nc"), engine="h5netcdf"
    )
    before = files(tmp_path)
    code, out, err = run("simulate", ARM, *options)
    assert (code, out) == (2, "")
    assert words in err
    assert err.startswith("ident: ")
    assert len(err.splitlines()) == 1
    assert files(tmp_path) == before


def test_an_arm_without_stroke_says_how_to_add_one(run, tmp_path):
    (tmp_path / "bare.toml").write_text(BARE)
    code, out, err = run("simulate", "bare.toml")
    assert (code, out) == (2, "")
    assert "no motion defined" in err
    assert "[stroke]" in err
    assert "--path" in err
    assert files(tmp_path) == ["bare.toml"]


def test_an_arm_that_collapses_is_told(run, tmp_path):
    code, out, err = run("simulate", ARM, *SHORT, "--set=joint1.k_bend=100")
    assert (code, out) == (1, "")
    assert "no stable equilibrium" in err
    assert files(tmp_path) == []
