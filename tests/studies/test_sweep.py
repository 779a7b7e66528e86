"""`ident.sweep` from Python: ranges as values, what it returns, and the file that brings it back."""

import numpy as np
import pytest
from arms import DATA, first_guess_arm
from commands import posterior
from reports import assert_one_screen, too_wide
from results import assert_comes_back, assert_plain
from swept import axis

from ident.description.file import read_arm
from ident.errors import InputError
from ident.studies import ranges
from ident.studies.options import MEASURES
from ident.studies.working.sweep import SweepOptions, sweep
from ident.vibrate import simulate
from ident.vibrate.evaluator import Evaluator
from ident.vibrate.motion import stroke
from ident.vibrate.sweep import sweep as over

pytestmark = pytest.mark.slow

FILE = read_arm(DATA / "lcd_arm" / "arm.toml")
FIRST = read_arm(DATA / "lcd_arm" / "first_guess.toml")
SHORT = {"speed": 200.0, "dwell": 0.5, "rate": 100.0, "phases": "file"}
K = "joint1.k_tors"
BOTH = SweepOptions(vary={K: ("0.5x", "2x", 3), "fingers.com.x": (1.2, 1.9, 2)}, limit=10.0, **SHORT)


@pytest.fixture(scope="module")
def both():
    return sweep(FIRST, BOTH)


@pytest.fixture(scope="module")
def chart(tmp_path_factory):
    """A map of a stiffness and the speed, with draws."""
    path = tmp_path_factory.mktemp("draws") / "draws.nc"
    posterior(path)
    options = SweepOptions(vary={K: ("0.5x", "2x", 2), "speed": (150, 200, 2)}, grid=True, draws=3, **SHORT)
    return sweep(FIRST, options, posterior=path)


def test_amplitudes_are_those_of_the_library(both):
    evaluator = Evaluator(FIRST.arm, stroke(FIRST.arm.stroke, percent=200, dwell=0.5), (), rate=100.0)
    values = float(FIRST.arm.get(K)) * np.array([0.5, 1.0, 2.0])
    direct = over(evaluator, [axis(FIRST.arm, [K], values, 200.0)])
    assert list(both.sweeps) == [K, "fingers.com.x"]
    np.testing.assert_allclose(both.sweeps[K].amplitude, direct.amplitude, rtol=5e-3, err_msg="but for the step")
    np.testing.assert_allclose(both.sweeps[K].axes[0].values, values)
    np.testing.assert_allclose(both.present, both.sweeps[K].amplitude[:, 1])
    rows = both.table()
    assert len(rows) == 3 * (3 + 2)
    assert_plain(rows)
    (row,) = [r for r in rows if (r["parameter"], r["value"], r["direction"]) == (K, values[2], "y")]
    assert row["amplitude [mm]"] == pytest.approx(1e3 * both.sweeps[K].amplitude[1, 2])
    assert np.isnan(row["q05 [mm]"])


def test_trends_are_in_a_word_what_the_amplitudes_do(both, chart):
    amplitude = both.sweeps[K].amplitude[1]
    whole, about = both.trends[K]["y"]
    assert whole.ends == (amplitude[0], amplitude[-1])
    assert amplitude[2] < 1.05 * amplitude[1] < amplitude[0], "up again by less than counts"
    assert whole.shape == "falls"
    assert whole.least == (both.sweeps[K].axes[0].values[1], amplitude[1])
    assert list(both.trends[K]) == ["x", "y", "z", "largest"]
    assert about is not None
    assert about.span == whole.span, "of three values all are neighbours of the present one"
    assert chart.trends == {}


@pytest.mark.parametrize("name", ["both", "chart"])
def test_it_comes_back_as_it_was(name, request, tmp_path):
    result = request.getfixturevalue(name)
    assert_comes_back(result, tmp_path)
    assert [path.name for path in result.save_figures(tmp_path)] == [f"{result.name}.png"]


@pytest.mark.parametrize("name", ["both", "chart"])
def test_it_fits_one_screen(name, request):
    result = request.getfixturevalue(name)
    assert_one_screen(result.report(), files=3)
    assert not too_wide(result.report(details=True))


def test_the_ranges_of_the_command_line_and_of_python_are_the_same(both):
    texts = [f"{K}=0.5x:2x:3", "fingers.com.x=1.2:1.9:2", "joint2.k_tors", "a.mass=b.mass = 1 : 2x"]
    read = ranges.ranges(texts, "--vary")
    assert read == {**BOTH.vary, "joint2.k_tors": (), "a.mass=b.mass": (1.0, "2x")}
    assert SweepOptions(vary=read).vary == read


def test_a_map_has_a_name_and_bands(chart):
    assert chart.name == f"first_guess.extend-200.{K}-by-speed.sweep"
    (found,) = chart.sweeps.values()
    assert found.draws.shape == (3, 2, 2, 3)
    last = chart.table()[-1]
    assert (last["parameter2"], last["value2"], last["unit2"]) == ("speed", 200.0, "%")
    assert last["q05 [mm]"] < last["q95 [mm]"]


def test_by_default_the_torsional_stiffness_of_every_joint_is_varied_and_an_arm_needs_no_file():
    progress = []

    def shown(description, total=None):
        return lambda numbers: (progress.append(description) or number for number in numbers)

    result = sweep(first_guess_arm(), SweepOptions(**SHORT | {"rate": 50.0, "dwell": 0.0}), progress=shown)
    assert list(result.sweeps) == [f"joint{n}.k_tors" for n in (1, 2, 3)]
    assert all(one.amplitude.shape == (3, 21) for one in result.sweeps.values())
    assert result.name.endswith(".extend-200.joint1.k_tors+joint2.k_tors+joint3.k_tors.sweep")
    assert set(progress) == {"simulations"}


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"vary": {K: (1.0,)}}, rf"`vary` {K}=1: got '1', expected LOW:HIGH or LOW:HIGH:COUNT"),
        ({"vary": {K: ("ax", 2.0)}}, rf"`vary` {K}=ax:2: got 'a', expected a finite number"),
        ({"vary": {K: (1.0, np.inf)}}, "got 'inf', expected a finite number"),
        ({"vary": {f"{K}=": (1.0, 2.0)}}, "got an empty name"),
        ({"grid": True}, "grid: got 0 parameters, expected two"),
        ({"measure": "peek"}, "measure: got 'peek', expected one of peak, rms, residual"),
        ({"limit": 0.0}, "limit: got 0, expected a number above 0"),
        ({"draws": 0}, "draws: got 0, expected a number from 1"),
        ({"set": {"link1.mass": -1.0}}, "set: got link1.mass=-1, expected a value >= 0"),
    ],
)
def test_options_are_checked_when_they_are_made(options, words):
    with pytest.raises(InputError, match=words) as refusal:
        SweepOptions(**options)
    assert len(refusal.value.problems) == 1


@pytest.mark.parametrize(
    ("vary", "words"),
    [
        ({"joint1.k_tor": ()}, r"`vary` joint1.k_tor: got joint1.k_tor, .*did you mean joint1.k_tors\?"),
        ({K: ("2x", "1x", 4)}, rf"`vary` {K}=2x:1x:4: got 719635 to 359817, expected a lower and a higher bound"),
        ({"speed": (4, 5, 1)}, "`vary` speed=4:5:1: got 1 values, expected a whole number from 2 to 500"),
    ],
)
def test_a_range_that_the_arm_cannot_have_is_named(vary, words):
    with pytest.raises(InputError, match=words):
        sweep(FILE, SweepOptions(vary=vary))


def test_the_measures_are_those_of_the_library():
    assert (*MEASURES, "settled") == tuple(simulate.MEASURES), "the last one is what diagnose --settled judges"
