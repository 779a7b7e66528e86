"""The report of a fit, read as an engineer would: the answer first, one word for one thing."""

import dataclasses
import re

import jax.numpy as jnp
import numpy as np
import pytest
from arms import DATA, lcd_arm

from ident.identify.fit import fit_campaign
from ident.identify.unknowns import Unknowns
from ident.inference.information import Direction, information
from ident.inference.parameters import Parameter
from ident.measure import read_campaign
from ident.present.text.fit import fit_report
from ident.present.text.words import product, what_is_open

pytestmark = pytest.mark.slow

HEADS = (
    "Fit of",
    "Fitted values",
    "What limits them",
    "Measurements",
    "What the data fix",
    "Do the kinds",
    "Parameters",
    "Optima",
)


@pytest.fixture(scope="module")
def paper():
    return fit_campaign(lcd_arm(), read_campaign(DATA / "lcd_arm" / "table1.csv"))


@pytest.fixture(scope="module")
def shipped():
    return fit_campaign(lcd_arm(), read_campaign(DATA / "lcd_arm" / "campaign.csv"), starts=4)


def section(report, head):
    return next(part for part in report.split("\n\n") if part.startswith(head))


def of(name, *items):
    return tuple(Parameter((each,), True, 1.0, 1.0) for each in (name, *items))


def test_the_answer_comes_first_then_what_limits_it_then_the_rest(paper):
    report = fit_report(paper)
    places = [report.index(f"{gap}{head}") for head, gap in zip(HEADS, ["", *["\n\n"] * 7], strict=True)]
    assert places == sorted(places)
    assert places[0] == 0


def test_each_value_has_its_interval_in_percent(shipped):
    answer = section(fit_report(shipped), "Fitted values")
    rows = re.findall(r"  (joint\S+) +(\S+) N m/rad +-(\S+) % +\+(\S+) %", answer)
    assert [row[0] for row in rows] == list(shipped.problem.parameters.names)
    for (_, value, below, above), best, (low, high) in zip(rows, shipped.best.values, shipped.interval(), strict=True):
        assert float(value) == pytest.approx(best, rel=1e-3)
        assert best * (1 - float(below) / 100) == pytest.approx(low, rel=1e-3)
        assert best * (1 + float(above) / 100) == pytest.approx(high, rel=1e-3)
    assert "Nothing in the data speaks against them" in fit_report(shipped)


def test_what_is_open_is_said_to_be_told_by_no_data_alone(paper):
    """joint3.k_bend: known to 2.4 % with the priors of the others, to nothing without."""
    report = fit_report(paper)
    assert re.search(r"  joint3.k_bend +2.645e\+04 N m/rad  open\n", report)
    origin = next(line for line in section(report, "Parameters").splitlines() if "joint3.k_bend" in line)
    assert origin.split()[-3:] == ["0%", "0%", "100%"]
    assert section(report, "What the data fix").split("\n")[:2] == [
        "What the data fix: 3 of 6 directions; the fit is in doubt, so none has a width",
        "  joint3.k_bend",
    ]
    assert report.count("open\n") == 6


def test_doubt_withholds_what_the_data_would_support(shipped):
    doubtful = dataclasses.replace(shipped, predicted=shipped.predicted * 1.1)
    answer = section(fit_report(doubtful), "Fitted values")
    assert answer.count("withheld\n") == 6
    assert "WARNING" in section(fit_report(doubtful), "What limits them")


def test_rivals_and_ties_are_told_with_what_they_cost(shipped):
    tie = dataclasses.replace(shipped.best, theta=shipped.best.theta + 0.5)
    rival = dataclasses.replace(tie, cost=tie.cost + 1.25)
    limits = section(fit_report(dataclasses.replace(shipped, optima=(shipped.best, tie, rival))), "What limits them")
    assert "NOT UNIQUE: 2 optima fit exactly as well" in limits
    assert "another optimum: the next costs 1.2 more" in limits
    assert "all else here holds about the answer alone" in limits
    assert "NOT UNIQUE" not in fit_report(dataclasses.replace(shipped, optima=(shipped.best, rival)))


def test_all_optima_are_listed_or_it_is_said_how_many(shipped):
    def listed(count):
        others = [dataclasses.replace(shipped.best, cost=100.0 + i) for i in range(count - 1)]
        return section(fit_report(dataclasses.replace(shipped, optima=(shipped.best, *others))), "Optima")

    assert listed(6).count("\n  other ") == 5
    assert "first" not in listed(6)
    assert listed(20).count("\n  other ") == 11
    assert "20 found" in listed(20)
    assert "the first 12 of them" in listed(20)


def test_a_chance_near_one_is_no_number_of_standard_deviations(shipped):
    agreement = section(fit_report(shipped), "Do the kinds")
    assert "p = 0.99\n" in agreement
    assert "0.0 sd" not in agreement


def test_a_factor_of_a_small_exponent_is_shown_where_its_own_spread_matters():
    direction = Direction(np.array([0.998, 0.06]), 0.01)
    assert product(direction, of("a", "b"), np.array([0.01, 2.0])) == "a^1.00 * b^0.06".replace(" * ", " *\u00a0")
    assert product(direction, of("a", "b"), np.array([0.01, 0.04])) == "a"
    assert "b^0.06" in product(direction, of("a", "b"), np.array([0.01, np.inf])), "no prior: it may be anything"


def test_a_direction_that_is_seen_by_rounding_is_open():
    """The second one is known to a factor of e^20."""
    known = information(np.diag([10.0, 0.05]), np.ones(2), ("a", "b"))
    assert known.rank == 2
    assert known.fixed == 1
    assert "b by +10 %: the data would not notice" in "".join(what_is_open(known, of("a", "b")))
    assert list(known.open) == [False, True]
    np.testing.assert_allclose(known.data_share, [1 - 1 / 101, 0.0025 / 1.0025], rtol=1e-9)


def test_the_data_s_share_is_what_they_tell_alone():
    """Only the sum is measured: each alone is told by the data with the prior of the other."""
    known = information(np.array([[10.0, 10.0]]), np.array([1.0, 0.1]), ("a", "b"))
    assert list(known.data_share) == [0.0, 0.0]
    variance = np.linalg.inv(np.array([[101.0, 100.0], [100.0, 200.0]]))[0, 0]
    assert known.prior_share[0] == pytest.approx(variance)
    assert known.prior_share[0] < 0.02


def test_a_length_has_its_interval_in_mm():
    freed = fit_campaign(
        lcd_arm(), read_campaign(DATA / "lcd_arm" / "campaign.csv"), Unknowns(free={"joint3.offset.x": 0.02}), starts=1
    )
    row = next(line for line in fit_report(freed).splitlines() if line.startswith("  joint3.offset.x"))
    assert re.search(r" m  +(-\S+ mm  \+\S+ mm|weak|open)$", row)


def test_without_a_prior_what_is_open_is_told_by_nothing():
    loose = information(np.array([[1.0, 1.0]]), np.full(2, np.inf), ("a", "b"))
    assert not jnp.isfinite(loose.sd).any()
    assert list(loose.data_share) == [0.0, 0.0]
    assert "left where the search stopped" in next(what_is_open(loose, of("a", "b")))


def test_a_campaign_that_mixes_drive_states_is_named(shipped):
    assert "servo" not in section(fit_report(shipped), "Fit of")
    first, *others = shipped.campaign.measurements
    mixed = dataclasses.replace(shipped.campaign, measurements=(dataclasses.replace(first, drives="servo"), *others))
    heading = section(fit_report(dataclasses.replace(shipped, campaign=mixed)), "Fit of")
    assert f"mixed, fit them apart: servo on in row {first.where.rpartition(':')[2]}" in heading
