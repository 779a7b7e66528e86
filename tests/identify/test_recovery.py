"""Known robots recovered by the shipped campaign's rows: rates within their bands, the same numbers again."""

import pytest
from arms import DATA
from reports import assert_one_screen
from results import assert_comes_back
from scipy.stats import binom

from ident import InputError
from ident.identify.recovery import CHANGED, FALSE_ALARMS, RIGHT, recover
from ident.identify.unknowns import Unknowns
from ident.studies.stiffness.validate import ValidateOptions, validate

pytestmark = pytest.mark.slow

ARM, CAMPAIGN = DATA / "lcd_arm" / "arm.toml", DATA / "lcd_arm" / "campaign.csv"
DRAWS = 12


@pytest.fixture(scope="module")
def result():
    return validate(ARM, CAMPAIGN, ValidateOptions(starts=1, recover=True, draws=DRAWS))


def test_rates_are_those_of_right_intervals(result):
    """99.9 % bands: 95 % of intervals, the levels of the alarms, and the chances of the linear problem."""
    recovery = result.validation
    assert not recovery.missed
    for row in recovery.rates:
        assert row["held"] >= binom.ppf(5e-4, row["intervals"], 0.95)
        assert row["intervals"] >= DRAWS - recovery.noticed[RIGHT][0]
        assert abs(row["bias"]) < 4 * row["standard_error"]
        assert row["standard_error"] < 0.03
    assert recovery.noticed[RIGHT][0] <= binom.ppf(0.999, DRAWS, FALSE_ALARMS)
    seen, of = recovery.noticed[CHANGED]
    assert of == DRAWS
    low, high = binom.ppf([5e-4, 1 - 5e-4], of, recovery.expected / of)
    assert low <= seen <= high
    assert [of for _, of in recovery.noticed.values()][2:] == [DRAWS] * 3
    assert recovery.noticed["labels of two modes swapped"][0] >= 10  # frequencies apart by many sigmas
    assert (
        recovery.noticed["one row 6 sigma off"][0] >= 10
    )  # tests/benchmarks/explanations.py --rows: 0.93 by leverages


def test_the_report_and_its_file(result, tmp_path):
    assert result.sections().verdict.word == "RECOVERED"
    assert_one_screen(result.report(), files=1)
    assert not result.figures()
    assert [row["unknown"] for row in result.table()] == list(result.validation.fit.problem.parameters.names)
    assert_comes_back(result, tmp_path)


def test_the_same_seed_gives_the_same_numbers(result):
    """And another one does not. Steps of the bar: two robots, a change and three faults of each."""
    fit, steps = result.validation.fit, []

    def counted(numbers):
        for number in numbers:
            steps.append(number)
            yield number

    one, again = (recover(fit, Unknowns(), 2, 1, progress) for progress in (counted, iter))
    assert (one.rates, one.noticed, one.expected) == (again.rates, again.noticed, again.expected)
    assert steps == list(range(10))
    assert one.rates[0]["bias"] != result.validation.rates[0]["bias"]


def test_without_a_prior_no_robot_can_be_drawn(result):
    with pytest.raises(InputError, match="recover: got no prior"):
        recover(result.validation.fit, Unknowns(prior_sd=float("inf")), 10)
