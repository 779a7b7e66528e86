"""Parts of a campaign that a laboratory might have: no traceback, no nan, no start that is lost without a word.

A small form; all 55 parts, several truths each, are tests/benchmarks/subcampaigns.py.
"""

import numpy as np
import pytest
from arms import first_guess_arm, lcd_arm
from campaign_parts import TRUST, judge, parts, simulated

import ident

pytestmark = pytest.mark.slow

PARTS = ("deflections, at 60 deg", "one mode and deflections, everywhere")


def test_there_are_55_parts():
    assert len(parts()) == 55
    assert all(len(part) for part in parts().values())


@pytest.mark.timeout(600)
@pytest.mark.parametrize("part", PARTS)
def test_a_part_is_judged_without_a_break_and_what_is_shown_holds(part):
    verdict = judge(part, 1.0, 0, 0)
    assert verdict.broken == ""
    assert verdict.lost == 0
    assert verdict.refused == ""
    assert len(verdict.held) >= len(verdict.shown) - 1
    assert len(verdict.profiled) >= len(verdict.shown) - 1


def test_where_labels_contradict_the_optimum_its_profile_keeps_to_the_modes_that_it_was_fitted_with():
    arm = first_guess_arm()
    _, campaign = simulated("lateral modes, at 60 deg", 1.0, 0, 0, arm)
    options = ident.ProfileOptions(trust_values=TRUST, parameter=("joint1.k_bend",))
    result = ident.profile(arm, campaign, options)
    assert not result.fit.end.choice.settled
    (found,) = result.profiles
    assert found.converged.all()
    assert np.diff(np.sqrt(np.maximum(found.delta_chi_squared, 0))).max() < 1  # it jumped by 27, to other modes


@pytest.mark.parametrize(
    ("part", "draw", "starts"), [("unlabelled modes, at 60 deg", 0, 3), ("all modes, at 80 deg", 1, 6)]
)
def test_no_start_is_lost_where_modes_cross(part, draw, starts):
    """Of the first part 30 of 96 starts stalled where the highest measured mode met the next one."""
    _, campaign = simulated(part, 1.0, draw, 0)
    fit = ident.fit(lcd_arm(), campaign, ident.FitOptions(trust_values=TRUST, starts=starts, seed=draw)).fit
    assert fit.failed == 0
    assert all(optimum.converged for optimum in fit.optima)
