"""`ident.simulate` from Python: its inputs as values or files, what it returns, and the file that brings it back."""

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import xarray
from arms import DATA, lcd_arm
from commands import posterior
from reports import assert_one_screen, too_wide
from results import assert_comes_back

from ident import InputError, load, read_arm, read_log, read_trace
from ident.studies.values import drawn_values
from ident.studies.working.simulate import SimulateOptions, SimulateResult, simulate
from ident.vibrate.motion import stroke
from ident.vibrate.simulate import simulate as response

pytestmark = pytest.mark.slow

FILE = read_arm(DATA / "lcd_arm" / "arm.toml")
SHORT = {"speed": 200.0, "dwell": 0.5, "rate": 100.0}
FAST = SimulateOptions(**SHORT, method="fast", at=0.7)


@pytest.fixture(scope="module")
def fast():
    return simulate(FILE, FAST)


@pytest.fixture(scope="module")
def drawn(tmp_path_factory):
    path = tmp_path_factory.mktemp("draws") / "draws.nc"
    posterior(path)
    return simulate(FILE, SimulateOptions(**SHORT, draws=5, limit=20.0), posterior=path)


def test_the_result_has_the_response_in_si(fast):
    direct = response(lcd_arm(), stroke(lcd_arm().stroke, percent=200, dwell=0.5), rate=100)
    np.testing.assert_allclose(fast.vibration, direct.vibration, atol=1e-15)
    np.testing.assert_array_equal(fast.time, direct.time)
    np.testing.assert_allclose(fast.peak, np.abs(direct.vibration).max(1))
    assert fast.draws is None
    assert fast.name == "arm.extend-200.simulate"
    rows = fast.table()
    assert [row["direction"] for row in rows] == ["x", "y", "z"]
    assert [row["peak"] for row in rows] == pytest.approx(fast.peak)
    late = np.abs(fast.vibration[:, fast.time >= 0.7 - 1e-9]).max(1)
    assert [row["late_peak"] for row in rows] == pytest.approx(late)


def test_an_arm_of_python_is_simulated_like_that_of_its_file(fast):
    bare = simulate(lcd_arm(), FAST)
    np.testing.assert_array_equal(bare.vibration, fast.vibration)
    assert bare.name == f"{lcd_arm().name}.extend-200.simulate"


@pytest.mark.parametrize("case", ["fast", "drawn"])
def test_a_saved_result_comes_back_as_it_was(request, tmp_path, case):
    result = request.getfixturevalue(case)
    paths = result.save(tmp_path)
    assert [path.name for path in paths] == [f"{result.name}.{end}" for end in ("csv", "nc", "json")]
    saved = assert_comes_back(result, tmp_path)
    assert saved.arrival == result.arrival
    with xarray.open_dataset(paths[1], engine="h5netcdf") as data:
        np.testing.assert_array_equal(data["vibration"].values.reshape(3, -1), result.vibration)


def test_the_arrays_say_which_file_to_load(fast, tmp_path):
    arrays = fast.save(tmp_path)[1]
    with pytest.raises(InputError, match=r"the arrays of a result .*load arm.extend-200.simulate.json beside it"):
        load(arrays)


@pytest.mark.parametrize("damage", ["cut", "group", "record"])
def test_a_file_that_holds_no_result_is_refused(fast, tmp_path, damage):
    path = fast.save(tmp_path)[1]
    if damage == "cut":
        path.write_bytes(path.read_bytes()[:5000])
    else:
        data = xarray.Dataset({"ident": ("n", np.frombuffer(b'{"format": "ident-x/10"}', np.uint8))})
        data.to_netcdf(path, mode="w", engine="h5netcdf", group="ident" if damage == "record" else None)
    with pytest.raises(InputError, match="expected a result file of ident"):
        load(path)


def test_draws_may_be_a_value_or_a_file(drawn, tmp_path):
    posterior(tmp_path / "draws.nc")
    values = drawn_values(tmp_path / "draws.nc", lcd_arm(), 5)
    again = simulate(FILE, replace(drawn.options, method="fast"), posterior=values)
    np.testing.assert_array_equal(again.draws.vibration, drawn.draws.vibration)
    assert any(section.title.startswith("5 to 95 % of 5 draws") for section in again.sections().details)
    assert_one_screen(again.report(), files=5)
    assert not too_wide(again.report(details=True))
    assert [row["peak_q95"] for row in again.table()] == pytest.approx(
        np.quantile(drawn.draws.sizes.peak, 0.95, axis=1)
    )


def test_path_and_trace_may_be_values_or_files(fast, tmp_path):
    csv = fast.save(tmp_path)[0]
    trace = read_trace(csv)
    options = SimulateOptions(**SHORT, method="fast", band=(2.0, 20.0))
    for given in (trace, csv, str(csv)):
        compared = simulate(FILE, options, trace=given).simulation.comparisons
        assert [comparison.peak_ratio for comparison in compared.values()] == pytest.approx([1, 1, 1], rel=1e-6)
    time = np.linspace(0, 1, 21)
    rows = np.column_stack([time, *(n * 20 * (10 * time**3 - 15 * time**4 + 6 * time**5) for n in (1, -2, 1))])
    header = "time [s],joint1 [deg],joint2 [deg],joint3 [deg]"
    np.savetxt(tmp_path / "teach.csv", rows, header=header, comments="", delimiter=",")
    log = read_log(tmp_path / "teach.csv", ["joint1", "joint2", "joint3"])
    options = SimulateOptions(dwell=0.2, rate=100.0, method="fast")
    one, other = (simulate(FILE, options, path=path) for path in (log, tmp_path / "teach.csv"))
    np.testing.assert_array_equal(one.vibration, other.vibration)
    assert one.name == other.name == "arm.teach.simulate"


@pytest.mark.parametrize("more", [{"dwell": 0.0}, {"rate": 37.0, "dwell": 0.5, "at": 2.07}])
def test_what_no_sample_shows_is_not_told(more):
    """Held for no time, the arm has arrived after the last sample; so it is with a time behind that."""
    result = simulate(FILE, SimulateOptions(speed=200.0, method="fast", **more))
    late = "residual" if "at" not in more else "late_peak"
    assert np.isnan([row[late] for row in result.table()]).all()
    assert not re.search(r"\bnan\b", result.report(details=True))


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"settled": 0.0}, "settled: got 0, expected a number above 0"),
        ({"limit": float("inf")}, "limit: got inf, expected a number above 0"),
        ({"draws": 0}, "draws: got 0, expected a number from 1"),
        ({"set": {"link2.mass": -3.0}}, "set: got link2.mass=-3, expected a value >= 0"),
        (
            {"at": 99.0, "method": "fast"},
            "at: got 99 s, expected a time from 0 to 3.578 s; hold the arm longer (`dwell`)",
        ),
        ({"method": "exakt"}, "method: got 'exakt'"),
        ({"smoothing": 0.1}, "smoothing: got it without `path`"),
    ],
)
def test_options_that_cannot_be_are_refused_in_one_line(options, words):
    with pytest.raises(InputError) as error:
        simulate(FILE, SimulateOptions(speed=200.0, **options))
    assert words in str(error.value)
    assert len(str(error.value).splitlines()) == 1


def test_the_options_are_recorded(fast, tmp_path):
    document = json.loads(Path(fast.save(tmp_path)[2]).read_text())
    assert document["format"] == SimulateResult.form
    assert document["options"] | {"at": 0.7, "speed": 200.0, "band": [4.0, 8.0]} == document["options"]


def test_what_the_arm_does_over_time_is_at_hand(fast):
    assert fast.arrival == pytest.approx(fast.time[-1] - 0.5, abs=0.01)
    assert np.degrees(fast.posture[:, [0, -1]]) == pytest.approx(np.array([[142, 0], [-284, 0], [142, 0]]), abs=1e-9)
    lengths, angle = np.array([1.0, 1.0, 2.79]), np.cumsum(fast.posture, axis=0)
    assert fast.path[0] == pytest.approx(lengths @ np.cos(angle), abs=1e-9)
    assert fast.path[1] == pytest.approx(lengths @ np.sin(angle), abs=1e-9)
    assert np.ptp(fast.path[2]) < 1e-9
    turns = np.degrees(np.gradient(fast.posture[1], fast.time)) * float(fast.arm.get("drive2.ratio")) / 360
    assert fast.pulleys["drive2"] == pytest.approx(np.abs(turns), abs=0.05 * np.abs(turns).max())
    assert list(fast.pulleys) == ["drive1", "drive2", "drive3"]


def test_the_arm_is_drawn_at_work(fast):
    figure = fast.path_figure([0.0, 0.3], factor=5.0)
    legend = figure.axes[0].get_legend()
    assert any(text.get_text().endswith("vibration 5 times as large") for text in legend.get_texts())
    title = legend.get_title().get_text()
    assert title.endswith("the arm at 0.0, 0.3 s")
    page = fast.animation([0.1, 0.2, 0.3], fps=5.0).to_jshtml()
    assert page.count("data:image/png;base64") == 3
    with pytest.raises(InputError, match="moments outside the response"):
        fast.path_figure([99.0])


def test_a_shorter_step_brings_the_same():
    whole, half = (simulate(FILE, SimulateOptions(**SHORT, method="fast", step=step)) for step in (None, 5e-4))
    assert np.abs(half.vibration - whole.vibration).max() > 0
    np.testing.assert_allclose(half.peak, whole.peak, rtol=1e-3)
    with pytest.raises(InputError, match="step: got it with another method"):
        SimulateOptions(step=5e-4)


def test_the_next_command_computes_the_same_motion():
    """Without a limit at other speeds, beyond one with the speeds that keep it."""
    more = {"profile": "cycloid", "phases": "file", "errors": (30.0, 60.0), "method": "fast"}
    sweep, motion = (simulate(FILE, SimulateOptions(**SHORT, **more, limit=x)).sections() for x in (None, 1e-6))
    arm = DATA / "lcd_arm" / "arm.toml"
    same = "--speed 200 --profile cycloid --dwell 0.5 --phases file --errors 30:60"
    assert sweep.next == f"ident sweep {arm} --vary speed {same}"
    assert motion.next == f"ident motion {arm} --limit 1e-06 {same}"
    assert "--phases" not in simulate(FILE, replace(FAST, limit=1e-6)).sections().next
    assert not simulate(FILE, replace(FAST, limit=1e3)).sections().next, "nothing is left to do"
