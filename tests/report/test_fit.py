"""The report of a fit, read as an engineer would: verdict first, then the values, then what bears on them."""

import dataclasses

import jax.numpy as jnp
import numpy as np
import pytest
from figures import fitted, made_up
from reports import assert_one_screen

from ident.inference.information import Direction, information
from ident.inference.parameters import Parameter
from ident.report.report import text_of
from ident.report.words import product, what_is_open
from ident.studies.stiffness.fit_report import fit_sections

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def paper():
    return fitted("table1")


@pytest.fixture(scope="module")
def shipped():
    return fitted("campaign")


def section(report, title):
    return next(part for part in report.details if part.title.startswith(title))


def values(report):
    """Return the table of the fitted values, as a mapping of names to the other cells by head."""
    table = next(part for part in report.answer if getattr(part, "head", ("",))[0] in ("Stiffness", "Unknown"))
    return {row[0]: dict(zip(table.head[1:], row[1:], strict=True)) for row in table.rows}


def findings(report):
    return " | ".join(finding.text for finding in report.findings)


def of(name, *items):
    return tuple(Parameter((each,), True, 1.0, 1.0) for each in (name, *items))


def test_data_that_contradict_each_other_are_not_usable_and_one_screen_says_why(paper):
    report = fit_sections(paper)
    assert report.verdict.word == "NOT USABLE"
    assert "contradict each other (4.1 sigma)" in report.verdict.reason
    assert "3 measurements cannot determine 6 unknowns" in report.verdict.reason
    measured = "Row 7, tip deflection at (0, 0, 0) deg: measured 22.0 mm"
    assert report.answer[0] == f"{measured}, predicted from the other data 31.6 mm."
    assert report.next == "ident plan {campaign}", "no causes were searched for"
    assert {row["95 % interval"] for row in values(report).values()} == {"not determined"}
    assert values(report)["joint1.k_bend"]["fit vs. arm file"] == "x 13, implausible"
    assert_one_screen(text_of(report), files=2)


def test_a_good_fit_says_so_with_its_errors_and_the_assumption_it_rests_on(shipped):
    report = fit_sections(shipped)
    assert report.verdict.word == "GOOD if the base is rigid"
    assert report.verdict.kind == "good"
    assert "All 6 unknowns determined (std. error at most 2.2 %)" in report.verdict.reason
    assert report.remark.startswith(
        "All 20 residuals within 2.2 sigma; the largest is row 18 (line 18 of campaign.csv)."
    )
    (untested,) = report.findings
    assert untested.text == "cannot be tested: the base is rigid (if not, joint1.k_tors +22 %)"
    assert untested.remedy == "measure the foot's motion"
    assert_one_screen(text_of(report), files=2)


def test_each_value_has_its_interval_on_the_screen_and_in_percent(shipped):
    screen = values(fit_sections(shipped))
    table, *_ = section(fit_sections(shipped), "Fitted values").parts
    each = zip(table.rows, shipped.best.values, shipped.interval(), strict=True)
    for (name, value, unit, below, above, *_), best, (low, high) in each:
        assert (value, unit) == (pytest.approx(best), "N m/rad")
        ends = [float(end.removesuffix(" %")) / 100 for end in (below, above)]
        assert best * (1 + ends[0]) == pytest.approx(low, rel=1e-3)
        assert best * (1 + ends[1]) == pytest.approx(high, rel=1e-3)
        shown = [float(end) for end in screen[name]["95 % interval"].split(" to ")]
        np.testing.assert_allclose(shown, [low, high], rtol=5e-3)  # three digits


def test_what_the_data_do_not_determine_is_said_to_lean_on_priors(paper):
    """joint3.k_bend: known to 2.4 % with the priors of the others, to nothing without."""
    origins = section(fit_sections(paper), "Fitted values").parts[0]
    row = next(row for row in origins.rows if row[0] == "joint3.k_bend")
    assert row[-3:] == (0.0, 0.0, 1.0)
    fixed = section(fit_sections(paper), "Determined by the data: 3 of 6").parts[0]
    assert fixed.rows[0] == ("joint3.k_bend", "not reported"), "a fit in doubt gives no width of a combination either"


def test_some_determined_is_partly(shipped):
    weak = dataclasses.replace(
        shipped.information, data_sd=np.where(np.arange(6) == 2, 0.6, shipped.information.data_sd)
    )
    report = fit_sections(dataclasses.replace(shipped, information=weak))
    assert report.verdict.word == "PARTLY 5 OF 6"
    assert values(report)["joint3.k_bend"]["95 % interval"] == "weakly determined"


def test_doubt_reports_no_interval(shipped):
    report = fit_sections(dataclasses.replace(shipped, predicted=shipped.predicted * 1.1))
    assert report.verdict.word == "NOT USABLE"
    assert {row["95 % interval"] for row in values(report).values()} == {"not reported"}


def test_competing_optima_are_findings_and_what_they_leave_open_is_not_determined(shipped):
    tie = dataclasses.replace(shipped.best, theta=shipped.best.theta + 0.5)
    rival = dataclasses.replace(tie, cost=tie.cost + 1.25)
    report = fit_sections(dataclasses.replace(shipped, optima=(shipped.best, tie, rival)))
    assert report.verdict.word == "NOT USABLE"
    assert "3 optima fit the data" in report.verdict.reason
    assert "not unique: 2 optima fit exactly as well" in findings(report)
    assert "another optimum: chi-squared is 1.2 larger there" in findings(report)
    alone = fit_sections(dataclasses.replace(shipped, optima=(shipped.best, rival)))
    assert "not unique" not in findings(alone)


def test_all_optima_are_listed_or_it_is_said_how_many(shipped):
    def listed(count):
        others = [dataclasses.replace(shipped.best, cost=100.0 + i) for i in range(count - 1)]
        return section(fit_sections(dataclasses.replace(shipped, optima=(shipped.best, *others))), "Optima")

    assert len(listed(6).parts[0].rows) == 6
    assert "first" not in listed(6).title
    assert len(listed(20).parts[0].rows) == 12
    assert listed(20).title.startswith("Optima: 20 found")
    assert listed(20).title.endswith("the first 12 of them")


def test_a_chance_near_one_is_no_number_of_standard_deviations(shipped):
    table = section(fit_sections(shipped), "Agreement").parts[0]
    assert [row[-1] for row in table.rows] == [None, None]


def test_a_factor_of_a_small_exponent_is_shown_where_its_own_spread_matters():
    direction = Direction(np.array([0.998, 0.06]), 0.01)
    assert product(direction, of("a", "b"), np.array([0.01, 2.0])) == "a^1.00 * b^0.06".replace(" * ", " *\u00a0")
    assert product(direction, of("a", "b"), np.array([0.01, 0.04])) == "a"
    assert "b^0.06" in product(direction, of("a", "b"), np.array([0.01, np.inf])), "no prior: it may be anything"


def test_a_combination_that_is_seen_by_rounding_is_not_determined():
    """The second one is known to a factor of e^20."""
    known = information(np.diag([10.0, 0.05]), np.ones(2), ("a", "b"))
    assert known.rank == 2
    assert known.fixed == 1
    assert what_is_open(known, of("a", "b")).parts == ("b by +10 % would not show in the data",)
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
    report = fit_sections(made_up(6, 20))
    table = section(report, "Fitted values").parts[0]
    (row,) = (dict(zip(table.head, row, strict=True)) for row in table.rows if row[0].endswith(".offset.z"))
    assert row["unit"] == "m"
    assert row["low end"].endswith(" mm")
    (shown,) = (row for name, row in values(report).items() if name.endswith(".offset.z"))
    assert shown["value"].endswith(" m"), "units differ, so each row has its own"


def test_without_a_prior_what_is_not_determined_stays_where_the_search_stopped():
    loose = information(np.array([[1.0, 1.0]]), np.full(2, np.inf), ("a", "b"))
    assert not jnp.isfinite(loose.sd).any()
    assert list(loose.data_share) == [0.0, 0.0]
    assert "stay where the search stopped" in what_is_open(loose, of("a", "b")).title


def test_a_campaign_that_mixes_drive_states_is_named(shipped):
    assert "servo" not in findings(fit_sections(shipped))
    first, *others = shipped.campaign.measurements
    mixed = dataclasses.replace(shipped.campaign, measurements=(dataclasses.replace(first, drives="servo"), *others))
    report = fit_sections(dataclasses.replace(shipped, campaign=mixed))
    assert f"the servo was on in row {first.where.rpartition(':')[2]}" in findings(report)
