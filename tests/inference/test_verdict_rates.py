"""Verdicts by their rates over simulated truths: few alarms where all is right, many where it is not.

A small form; the study, with the paper's arm, is tests/benchmarks/verdicts.py.
"""

import pytest
from campaigns import outcome
from scipy.stats import binom

DRAWS = 60


def rate(outcomes, alarm):
    return sum(alarm in each.alarms for each in outcomes)


@pytest.mark.parametrize("case", ["storeys", "storeys, flat prior", "storeys, catalogue"])
def test_right_campaigns_raise_no_alarm_and_their_intervals_hold(case):
    found = [outcome(case, "none", draw, 0) for draw in range(DRAWS)]
    assert rate(found, "any that withholds") <= binom.ppf(0.999, DRAWS, 2 * 0.0027 + 0.001)
    assert rate(found, "chi-squared small") <= binom.ppf(0.999, DRAWS, 0.001)
    shown, held = sum(len(each.shown) for each in found), sum(len(each.held) for each in found)
    assert shown > DRAWS
    assert held >= binom.ppf(0.001, shown, 0.95)
