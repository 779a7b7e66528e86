"""`ident.profile` from Python."""

import math

import pytest
from arms import DATA
from results import assert_comes_back, assert_plain

import ident
from ident.studies.stiffness.profile import ProfileOptions, profile

PARAMETERS = ("joint3.k_bend", "joint1.k_tors")


@pytest.fixture(scope="module")
def result():
    options = ProfileOptions(parameter=PARAMETERS, starts=1, no_prior=True, reach=100.0)
    folder = DATA / "lcd_arm"
    return profile(ident.read_arm(folder / "arm.toml"), ident.read_campaign(folder / "table1.csv"), options)


def test_it_gives_an_interval_for_each_parameter(result):
    assert result.name == "table1.profile"
    assert tuple(result.intervals) == PARAMETERS
    low, high = result.intervals["joint3.k_bend"]
    assert 0 < low < result.fit.parameters["joint3.k_bend"] < high < math.inf
    assert result.intervals["joint1.k_tors"][1] == math.inf, "three numbers leave it open above"
    assert not any(result.linear.values()), "the linear interval is open"


def test_it_comes_back_as_it_was(result, tmp_path):
    assert_comes_back(result, tmp_path)


def test_its_table_has_a_row_for_each_parameter(result):
    rows = result.table()
    assert_plain(rows)
    assert {row["parameter"]: (row["low_95"], row["high_95"]) for row in rows} == result.intervals
    assert all(row["linear_high_95"] == math.inf for row in rows)


def test_a_bad_parameter_is_refused_before_the_fit(result):
    for options in (ProfileOptions(parameter=("joint1.kbend",)), ProfileOptions(fix=PARAMETERS, parameter=PARAMETERS)):
        with pytest.raises(ident.InputError, match="which is not fitted"):
            profile(result.arm, result.fit.campaign, options, progress=None)


@pytest.mark.parametrize("reach", [1.0, math.nan, math.inf])
def test_a_reach_that_is_none_is_refused(reach):
    with pytest.raises(ident.InputError, match=r"reach: got .*, expected a number above 1"):
        ProfileOptions(reach=reach)
