"""Verdicts by their rates over simulated truths: few alarms where all is right, many where it is not.

A small form; the study, with the paper's arm, is tests/benchmarks/verdicts.py.
"""

from functools import cache

import pytest
from campaigns import outcome
from conformance import counted
from scipy.stats import binom

pytestmark = pytest.mark.slow

DRAWS = 30
WRONG = 6
ARMS = 6
ALARMS = {"kinds": "kinds of data", "any that withholds": "any alarm"}


@cache
def wrong_storeys(fault):
    return [outcome("storeys", fault, draw, 0) for draw in range(WRONG)]


def alarms_of(outcomes, alarm):
    return sum(alarm in each.alarms for each in outcomes)


@pytest.mark.parametrize("case", ["storeys", "storeys, flat prior"])
def test_right_campaigns_raise_no_alarm_and_their_intervals_hold(case):
    found = [outcome(case, "none", draw, 0) for draw in range(DRAWS)]
    level = 2 * 0.0027 + 0.001
    what, source = f"right campaigns of {case} with an alarm", "level promised"
    alarms, most = alarms_of(found, "any that withholds"), binom.ppf(0.999, DRAWS, level)
    counted(alarms, DRAWS, 0, most, "verdict rates", what, source, expected=DRAWS * level)
    assert alarms_of(found, "chi-squared small") <= binom.ppf(0.999, DRAWS, 0.001)
    shown, held = sum(len(each.shown) for each in found), sum(len(each.held) for each in found)
    assert shown > 2 * DRAWS
    what, source = f"intervals of {case} that hold the truth", "95 % promised"
    counted(held, shown, binom.ppf(0.001, shown, 0.95), shown, "verdict rates", what, source, expected=0.95 * shown)
    assert sum(p < 0.5 for each in found for p in each.p.values()) >= binom.ppf(0.001, 3 * DRAWS, 0.5)


@pytest.mark.parametrize(
    ("fault", "alarm", "least"),
    [("swapped", "kinds", 6), ("swapped", "any that withholds", 6), ("outliers", "any that withholds", 3)],
)
def test_wrong_campaigns_are_noticed(fault, alarm, least):
    what, source = f"campaigns with {fault} rows noticed, by {ALARMS[alarm]}", "known mistakes"
    found = alarms_of(wrong_storeys(fault), alarm)
    counted(found, WRONG, least, WRONG, "verdict rates", what, source, expected=f"at least {least} of {WRONG}")


def test_sigmas_ten_times_too_large_are_remarked():
    found = [outcome("storeys, flat prior", "copied", draw, 0) for draw in range(WRONG)]
    assert alarms_of(found, "chi-squared small") >= 5
    assert alarms_of(found, "any that withholds") == 0


@pytest.mark.timeout(600)  # a dozen fits of the arm, on a machine that others share
def test_a_base_that_gives_is_noticed_and_the_stated_shift_covers_it_while_right_campaigns_raise_no_alarm():
    right = [outcome("paper", "none", draw, 0) for draw in range(ARMS)]
    assert alarms_of(right, "assumptions") <= binom.ppf(0.999, len(right), 0.0027)
    wrong = [outcome("paper", "base 10", draw, 0) for draw in range(ARMS)]
    shown, held, widened = (sum(len(getattr(each, name)) for each in wrong) for name in ("shown", "held", "widened"))
    assert alarms_of(wrong, "assumptions") >= 1
    assert shown > 12
    assert held < binom.ppf(0.001, shown, 0.95), "as if it were rigid"
    assert widened >= 0.9 * shown
