"""`ident.resonance` from Python: what it returns, its inputs as values or files, and the file that brings it back."""

import numpy as np
import pytest
from arms import DATA, lcd_arm
from commands import posterior
from reports import assert_one_screen, too_wide
from results import assert_comes_back

from ident import InputError, read_arm
from ident.studies.working.resonance import ResonanceOptions, resonance
from ident.vibrate.branches import branches
from ident.vibrate.motion import stroke

pytestmark = pytest.mark.slow

FILE = read_arm(DATA / "lcd_arm" / "arm.toml")


@pytest.fixture(scope="module")
def plain():
    return resonance(FILE)


@pytest.fixture(scope="module")
def drawn(tmp_path_factory):
    path = tmp_path_factory.mktemp("draws") / "draws.nc"
    posterior(path)
    return resonance(FILE, ResonanceOptions(draws=4, margin=5.0), posterior=path)


def test_the_result_has_the_numbers_of_the_library(plain):
    direct = branches(lcd_arm(), stroke(lcd_arm().stroke, percent=10))
    np.testing.assert_array_equal(plain.branches.frequency, direct.frequency)
    assert plain.name == "arm.extend-10.resonance"
    rows = plain.table()
    assert len(rows) == len(plain.crossings)
    assert [row["time"] for row in rows] == [crossing.time for crossing in plain.crossings]
    first = rows[0]
    assert (first["number"], first["drive"], first["label"]) == (1, "drive2", "lateral torsion 1")
    assert first["time"] == pytest.approx(13.607, abs=5e-3)
    groups = max(row["number"] for row in rows)
    meet = len({row["number"] for row in rows if row["distance"] == 0})
    assert (groups, meet) == (4, 4)
    verdict = plain.sections().verdict
    assert verdict.word == "RESONANCE"
    assert "Total: 4 crossings." in verdict.reason
    assert_one_screen(plain.report(), files=2)


@pytest.mark.parametrize("case", ["plain", "drawn"])
def test_a_saved_result_comes_back_as_it_was(request, tmp_path, case):
    result = request.getfixturevalue(case)
    (path,) = result.save(tmp_path)
    assert path == tmp_path / "arm.extend-10.resonance.json"
    assert_comes_back(result, tmp_path)


def test_draws_give_each_crossing_a_probability(drawn):
    assert "% of 4 draws" in drawn.report(details=True)
    assert_one_screen(drawn.report(), files=2)
    assert not too_wide(drawn.report(details=True))
    assert all(0 < row["probability"] <= 1 for row in drawn.table())


def test_the_options_reach_the_library():
    result = resonance(FILE, ResonanceOptions(orders=(2,), margin=3.0, speed=20.0))
    assert {source.order for source in result.excitation.sources} == {2}
    assert result.excitation.frequency.max() == pytest.approx(32.0, rel=1e-3)
    assert min(crossing.margin for crossing in result.crossings) == pytest.approx(0.03)
    assert "within 3 % of the natural frequency" in result.report(details=True)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"margin": 0.0}, "margin: got 0, expected a number above 0"),
        ({"margin": 100.0}, "margin: got 100, expected a number below 100"),
        ({"count": 0}, "count: got 0, expected a number from 1"),
        ({"orders": (0,)}, "orders: got 0, expected whole numbers from 1"),
        ({"profile": "scurve"}, "did you mean s-curve"),
    ],
)
def test_options_that_cannot_be_are_refused_in_one_line(options, words):
    with pytest.raises(InputError) as error:
        resonance(FILE, ResonanceOptions(**options))
    assert words in str(error.value)
    assert len(str(error.value).splitlines()) == 1
