"""The shipped arm and campaigns are what they say, and the programs that made them make them again."""

import importlib.util
from itertools import islice, pairwise
from pathlib import Path

import numpy as np
import pytest
from scipy.interpolate import make_interp_spline
from scipy.stats import binom

import ident
from ident.arm.belts import belt_mismatches
from ident.description.file import parse_arm, read_arm, update_file
from ident.measure import read_campaign

pytestmark = pytest.mark.slow

LCD = Path(__file__).parents[1] / "data" / "lcd_arm"
SIX = LCD.parent / "six_axis"


def program(name, folder=LCD):
    spec = importlib.util.spec_from_file_location(name, folder / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_shipped_arm_gives_table_1_to_every_printed_digit():
    found = program("calibrate").predict((LCD / "arm.toml").read_text())
    assert f"{found['vertical bending 1 [Hz]']:.2f}" == "4.80"
    assert f"{found['lateral torsion 1 [Hz]']:.2f}" == "4.12"
    assert f"{found['tip down [mm]']:.1f}" == "26.3"
    assert list(found)[:2] == ["lateral torsion 1 [Hz]", "vertical bending 1 [Hz]"]


def test_only_the_solved_numbers_are_called_calibrated():
    origins = read_arm(LCD / "arm.toml").origins
    calibrated = {path for path, origin in origins.items() if origin == "calibrated"}
    masses = {"link2.mass", "bracket.mass", "fingers.mass"}
    drives = {f"drive{j}.{number}" for j in (1, 2, 3) for number in ("ratio", "eccentricity")}
    assert calibrated == masses | drives | {"stroke.folded", "stroke.speed"}
    assert set(origins.values()) == {"paper", "assumed", "calibrated", "derived"}


@pytest.mark.parametrize(("name", "wrong"), [("arm.toml", set()), ("first_guess.toml", {"Figure 4", "belts can run"})])
def test_figure_4_and_belts_that_can_run_come_out_of_the_arm_and_not_of_the_first_guess(name, wrong):
    """Figures 8 to 10 take simulations: `tests/test_paper.py` has them, and notebook 06 has 9 and 10 of the guess."""
    every = list(islice(program("calibrate_drives").statements(read_arm(LCD / name).arm), 4))
    assert every[-1][0] == "belts can run"
    assert {what.partition(":")[0] for what, _, holds in every if not holds} == wrong


def test_calibrating_the_drives_finds_them_from_another_start():
    drives, text = program("calibrate_drives"), (LCD / "arm.toml").read_text()
    other = {"drive1.ratio": 100.0, "stroke.speed": 1.0, "drive3.eccentricity": 0.001, "stroke.folded": 1.0}
    found = parse_arm(drives.calibrate(update_file(text, other, origin="assumed")))
    wanted = parse_arm(text)
    assert all(float(found.get(path)) == pytest.approx(float(wanted.get(path))) for path in other)


def test_the_hand_of_the_shipped_arm_moves_straight_and_its_belts_run():
    arm_file = read_arm(LCD / "arm.toml")
    arm = arm_file.arm
    assert belt_mismatches(arm.replace({"belt1.stiffness": 1e15, "belt2.stiffness": 1e15})) == ()
    assert float(arm.get("joint2.offset.x")) == float(arm.get("joint3.offset.x"))


def test_calibration_from_the_nominal_numbers_finds_the_shipped_arm():
    calibrate = program("calibrate")
    text = (LCD / "arm.toml").read_text()
    assert calibrate.calibrate(calibrate.revise(text, calibrate.NOMINAL)) == text
    assert calibrate.main(check=True) == 0


def test_synthesize_reproduces_the_shipped_campaigns(tmp_path):
    program("synthesize").main(tmp_path)
    for name in ("campaign.csv", "after_a_year.csv"):
        assert (tmp_path / name).read_bytes() == (LCD / name).read_bytes()


def test_the_shipped_campaign_is_four_frequencies_and_a_deflection_at_four_postures():
    campaign = read_campaign(LCD / "campaign.csv")
    assert len(campaign.postures) == 4
    assert len(campaign.of_kind("frequency")) == 16
    assert len(campaign.of_kind("deflection")) == 4
    assert all(m.mode for m in campaign.of_kind("frequency"))
    assert campaign.measurements[0].mode == "lateral torsion 1"
    assert campaign.measurements[15].mode == "vertical bending 1", "the two lowest branches have crossed"
    assert [m.sigma / m.value for m in campaign.of_kind("frequency")] == pytest.approx([0.005] * 16)
    assert [m.sigma / m.value for m in campaign.of_kind("deflection")] == pytest.approx([0.02] * 4)


def test_table_1_has_the_measured_values_of_the_paper():
    campaign = read_campaign(LCD / "table1.csv")
    assert [(m.mode or m.point, m.value) for m in campaign] == [
        ("vertical bending 1", 4.38),
        ("lateral torsion 1", 4.38),
        ("tip", pytest.approx(0.022)),
    ]
    assert {m.note for m in campaign} == {"paper, Table 1 (measured)"}
    assert campaign.joints == len(read_arm(LCD / "arm.toml").arm.driven)


def test_the_six_axis_campaign_is_made_again_and_says_what_it_is(tmp_path):
    program("synthesize", SIX).main(tmp_path)
    text = (SIX / "campaign.csv").read_text()
    assert (tmp_path / "campaign.csv").read_text() == text
    assert text.startswith("# SYNTHETIC")
    assert set(read_arm(SIX / "arm.xml").origins.values()) == {"assumed", "derived"}


def test_the_six_axis_arm_is_oblique_and_has_its_licence():
    axes = [joint.axis for joint in read_arm(SIX / "arm.xml").arm.joints]
    cosines = [abs(float(a @ b)) for a, b in pairwise(axes)]
    assert cosines[3:] == pytest.approx([0.5, 0.5], abs=1e-5)
    assert "BSD 3-Clause" in (SIX / "arm.xml").read_text()
    assert "Redistribution and use" in (SIX / "LICENSE").read_text()


def test_mujoco_moves_the_arm_whose_numbers_the_runs_of_notebook_05_name():
    """The truth is made again; of the run at 13 %, what MuJoCo leaves is the noise."""
    make = program("make", LCD / "mujoco")
    rows = [line.split(",") for line in (LCD / "mujoco" / "truth.csv").read_text().splitlines()[2:]]
    arm_file = read_arm(LCD / "arm.toml")
    true = make.true_arm(arm_file, np.random.default_rng(make.SEED))
    assert {path: pytest.approx(float(value), rel=1e-4, abs=1e-9) for path, value in rows} == {
        path: float(true.get(path)) for path, _ in rows
    }
    others = [path for path in true.paths() if path not in dict(rows)]
    assert all(np.array_equal(true.get(path), arm_file.arm.get(path)) for path in others)
    at, vibration = make.Moved(true, make.stroke(true.stroke, percent=13, dwell=2.0)).vibration({})
    time, *measured = np.loadtxt(LCD / "mujoco" / "run13.csv", delimiter=",", skiprows=2, unpack=True)
    for way, trace in zip(1e3 * vibration[1:], measured, strict=True):
        curve, peak = make_interp_spline(at, way, k=5), np.abs(way).max()
        clocks = np.linspace(-make.OFFSET, make.OFFSET, 81)
        left = min(float(np.std(trace - curve(time + clock))) for clock in clocks)
        assert 0.9 < left / (make.NOISE * peak) < 1.15


def test_a_fit_of_the_six_axis_campaign_finds_what_it_was_made_with():
    truth = program("synthesize", SIX).TRUTH
    result = ident.fit(SIX / "arm.xml", SIX / "campaign.csv")
    assert not result.doubts
    assert all(result.supported.values())
    held = [low <= truth[path] <= high for path, (low, high) in result.intervals.items()]
    assert sum(held) >= binom.ppf(0.001, 12, 0.95)
    off = [abs(np.log(result.parameters[path] / value)) / result.sd[path] for path, value in truth.items()]
    assert max(off) < 3
