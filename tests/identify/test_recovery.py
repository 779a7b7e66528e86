"""Known robots recovered by the shipped campaign's rows: rates within their bands, the same numbers again."""

import numpy as np
import pytest
from arms import DATA
from numpy.testing import assert_allclose
from reports import assert_one_screen
from results import assert_comes_back
from scipy.stats import binom

from ident import InputError
from ident.identify.recovery import CHANGED, FALSE_ALARMS, RIGHT, _levels, recover
from ident.identify.unknowns import Unknowns
from ident.inference.optima import normal_prior_sd
from ident.studies.stiffness.fit import FitOptions, fit
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
    # frequencies apart by many sigmas; and what 83 of 100 wrong rows are, by tests/benchmarks/explanations.py --rows
    for name, rate in (("labels of two modes swapped", 0.95), ("one row 6 sigma off", 0.83)):
        assert recovery.noticed[name][0] >= binom.ppf(5e-4, DRAWS, rate)


def test_the_report_and_its_file(result, tmp_path):
    assert result.sections().verdict.word == "RECOVERED"
    assert_one_screen(result.report(), files=1)
    assert not result.figures()
    assert [row["unknown"] for row in result.table()] == list(result.validation.fit.problem.parameters.names)
    assert_comes_back(result, tmp_path)


def test_the_same_seed_gives_the_same_numbers(result):
    """And another one does not. The bar has a step for each robot."""
    fit, steps = result.validation.fit, []

    def counted(numbers):
        for number in numbers:
            steps.append(number)
            yield number

    one, again = (recover(fit, Unknowns(), 2, 1, progress=progress) for progress in (counted, iter))
    assert (one.rates, one.noticed, one.expected) == (again.rates, again.noticed, again.expected)
    assert steps == [0, 1]
    assert one.rates[0]["bias"] != result.validation.rates[0]["bias"]


def test_without_a_prior_no_robot_can_be_drawn(result):
    with pytest.raises(InputError, match="recover: got no prior"):
        recover(result.validation.fit, Unknowns(prior_sd=float("inf")), 10)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"recover": True, "leave": "row"}, "leave: got it with"),
        ({"truths": "posterior"}, "truths: got it without"),
        ({"draws": 50}, "draws: got it without"),
    ],
)
def test_an_option_of_the_other_is_refused(options, said):
    with pytest.raises(InputError, match=said):
        validate(ARM, CAMPAIGN, ValidateOptions(**options))


def test_how_often_intervals_hold_robots_like_the_fitted_one():
    """Against least squares of 20,000 linear campaigns, where a narrow prior draws all estimates to its centre."""
    found = fit(ARM, CAMPAIGN, FitOptions(starts=1, prior_sd=0.01)).fit
    rng, theta, widths = np.random.default_rng(0), found.best.theta, normal_prior_sd(found.problem)
    truths, J = theta + 0.03 * rng.standard_normal((5, len(theta))), found.problem.scaled(np.asarray(found.jacobian))
    solve, half = np.linalg.pinv(np.vstack([J, np.diag(1 / widths)])), 1.96 * found.information.sd
    held = []
    for truth in truths:
        errors = rng.standard_normal((20_000, len(J)))
        centre = np.broadcast_to((found.problem.parameters.theta_centre - truth) / widths, (20_000, len(theta)))
        off = np.hstack([errors, centre]) @ solve.T  # the estimate's, from J off = errors and off = centre - truth
        held.append((abs(off) < half).mean(0))
    levels = _levels(found, truths)
    assert_allclose(levels, np.mean(held, 0), atol=0.01)
    assert np.abs(levels - 0.95).max() > 0.05
