"""What a cheap accelerometer on its own clock and a log of the joints tell of the shipped runs, made again."""

import runpy
import shutil

import numpy as np
import pytest
from arms import DATA
from results import assert_comes_back
from scipy.interpolate import make_interp_spline
from source_runs import one_core  # noqa: F401

import ident
from ident.errors import InputError
from ident.vibrate.motion import stroke
from ident.vibrate.simulate import simulate

pytestmark = [pytest.mark.slow, pytest.mark.timeout(900)]  # programs are compiled
HERE = DATA / "lcd_arm"
GRAVITY, NOISE, RATE = 9.80665, 3e-4 * 9.80665, 200.0
"""[m/s^2], [m/s^2/sqrt(Hz)] and samples a second of an accelerometer on a printed board."""
OFFSET, FAST = -1.3, 2e-4
"""Its clock: the motion's is (1 + FAST) t + OFFSET."""
SPEEDS = (10, 13)


def generate():
    return runpy.run_path(str(HERE / "runs" / "generate.py"))


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Accelerations by differences of what `generate.py` simulates, 1.3 s of rest before, and 125 Hz logs."""
    place, spec = tmp_path_factory.mktemp("cheap"), generate()
    shutil.copy(HERE / "arm.toml", place)
    rng = np.random.default_rng(spec["SEED"])
    arm, rows = spec["true_arm"](ident.read_arm(HERE / "arm.toml").arm, rng), ["file,channel,direction,path,group"]
    for speed in SPEEDS:
        motion = stroke(arm.stroke, percent=speed, dwell=2.0)
        response = simulate(arm, motion, method="fast", rate=500.0)
        t, h = np.asarray(response.time), 1 / 500
        moved = np.asarray(response.measured) + np.asarray(response.path)
        felt = (moved[:, 2:] - 2 * moved[:, 1:-1] + moved[:, :-2]).T / h**2
        time = np.arange(0.0, (t[-1] + 1.0 - OFFSET) / (1 + FAST), 1 / RATE)
        at = (1 + FAST) * time + OFFSET
        values = np.where(((at > t[1]) & (at < t[-2]))[:, None], make_interp_spline(t[1:-1], felt, k=3)(at), 0.0)
        values += [0.0, 0.0, GRAVITY] + NOISE * np.sqrt(RATE / 2) * rng.standard_normal(values.shape)
        header = "time [s],x [mm/s^2],y [mm/s^2],z [mm/s^2]"
        record = np.column_stack([time, 1e3 * values])
        np.savetxt(place / f"run{speed}.csv", record, "%.8g", ",", header=header, comments="")
        logged = np.arange(0.0, float(motion.breaks[-1]), 1 / 125)
        angles, names = np.degrees(np.asarray(motion(logged)[0])).T, [joint.name for joint in arm.driven]
        header = ",".join(["time [s]", *(f"{name} [deg]" for name in names)])
        np.savetxt(
            place / f"log{speed}.csv", np.column_stack([logged + 50, angles]), "%.9g", ",", header=header, comments=""
        )
        rows += [f"run{speed}.csv,{way},{way},log{speed}.csv,1" for way in "xyz"]
    (place / "runs.csv").write_text("\n".join(rows) + "\n")
    return place


def test_sources_lie_inside_their_intervals(folder):
    arm = generate()["true_arm"](ident.read_arm(HERE / "arm.toml").arm, np.random.default_rng(generate()["SEED"]))
    result = ident.source(folder / "runs.csv")
    assert not result.doubtful, result.report()
    for row in result.table():
        size = "eccentricity" if row["kind"] == "imbalance" else "error"
        assert abs(row["amplitude"] - float(arm.get(f"{row['drive']}.{size}"))) < 3 * row["sd"]
    assert sum(row["told"] for row in result.table()) >= 3
    for clock in result.runs.clocks.values():
        assert clock.offset == pytest.approx(50 + OFFSET + FAST * clock.middle, abs=5e-3)
        assert clock.rate == pytest.approx(FAST, abs=max(3 * clock.rate_sd, 2e-5))
    assert any("clock found from the motion, delay +48.7" in note for note in result.notes)


def test_triage_of_one_trace_and_one_log_needs_no_table(folder, tmp_path):
    found = ident.triage(folder / "run10.csv", path=folder / "log10.csv")
    exact = ident.triage(HERE / "runs" / "runs.csv", HERE / "arm.toml").table()
    told = {row["follows"] for row in found.table() if row["probability"] > 0.5}
    assert found.table()[0]["follows"] == exact[0]["follows"]
    assert told <= {row["follows"] for row in exact}
    assert set(found.inputs) >= {"arm", "runs", "path"}
    assert "ident source" not in found.report() or "--init" in found.report()
    back = assert_comes_back(found, tmp_path)
    assert ident.rerun(back.path).same
    with pytest.raises(InputError, match="delay: got it without a path"):
        ident.triage(folder / "runs.csv", delay=1.0)


def test_a_trace_is_compared_on_its_own_clock(folder):
    how = {"speed": 10, "method": "fast", "trace": folder / "run10.csv"}
    result = ident.simulate(HERE / "arm.toml", find_clock=True, **how)
    clock = result.simulation.clock
    assert clock.offset == pytest.approx(OFFSET + FAST * clock.middle, abs=5e-3)
    assert "clock of the trace, found from the motion: delay -1.29" in result.report()
    with pytest.raises(InputError, match="find_clock: got it without a trace"):
        ident.simulate(HERE / "arm.toml", find_clock=True)
