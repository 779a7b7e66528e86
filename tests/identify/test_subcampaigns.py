"""Parts of a campaign that a laboratory might have: no traceback, no nan, no start that is lost without a word.

A small form; all 55 parts, several truths each, are tests/benchmarks/subcampaigns.py.
"""

import numpy as np
import pytest
from arms import first_guess_arm, lcd_arm
from campaign_parts import judge, parts, simulated

from ident.identify.problem import pose
from ident.inference.fit import fit
from ident.inference.profile import profile

slow = pytest.mark.slow


def test_there_are_55_parts():
    assert len(parts()) == 55
    assert all(len(part) for part in parts().values())


@slow
@pytest.mark.timeout(600)
def test_a_part_is_judged_without_a_break_and_what_is_shown_holds():
    verdict = judge("all modes and deflections, everywhere", 1.0, 0, 0)
    assert verdict.broken == ""
    assert verdict.lost == 0
    assert verdict.refused == ""
    assert verdict.shown
    assert len(verdict.held) >= len(verdict.shown) - 1
    assert len(verdict.profiled) >= len(verdict.shown) - 1


@slow
def test_where_labels_contradict_the_optimum_its_profile_keeps_to_the_modes_that_it_was_fitted_with():
    arm = first_guess_arm()
    _, campaign = simulated("lateral modes, at 60 deg", 1.0, 0, 0, arm)
    fitted = fit(pose(arm, campaign).problem)
    assert not fitted.end.choice.settled
    (found,) = profile(fitted, ("joint1.k_bend",))
    assert found.converged.all()
    assert np.diff(np.sqrt(np.maximum(found.delta_chi_squared, 0))).max() < 1  # it jumped by 27, to other modes


@slow
def test_no_start_is_lost_where_modes_cross():
    """Of this part 30 of 96 starts stalled where the highest measured mode met the next one."""
    _, campaign = simulated("unlabelled modes, at 60 deg", 1.0, 0, 0)
    found = fit(pose(lcd_arm(), campaign).problem, starts=3)
    assert found.failed == 0
    assert all(optimum.converged for optimum in found.optima)
