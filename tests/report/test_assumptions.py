"""What the report says of modelling assumptions: what the data contradict, and what they cannot test."""

from dataclasses import replace

import numpy as np
import pytest
from figures import fitted

from ident.identify.assumptions import Assumption, Assumptions
from ident.identify.hypotheses import KINDS, RIGID, SOFT
from ident.inference.information import ScoreTest
from ident.inference.parameters import Parameter, Parameters
from ident.report.report import text_of
from ident.studies.stiffness.fit_report import fit_sections
from ident.studies.stiffness.warnings import asked_for, assumption_section

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def fit():
    return fitted("campaign")


def scored(z, *, seen=True, apart=0.5, positive=True, shift=0.0, sd=0.02):
    return ScoreTest(0.1, positive, np.array([shift, 0, 0, 0, 0, 0]), seen, apart, z, sd)


def taking(fit, *items):
    return replace(fit, assumptions=Assumptions(items, 0.5))


def rows(fit, *items):
    return assumption_section(taking(fit, *items)).parts[0].rows


def asking(fit):
    sd = fit.information.sd[0]
    return (
        Assumption("base rocks", "", scored(6.0, shift=2.5 * sd)),
        Assumption("link bends", "joint1", scored(1.0)),
        Assumption("link bends", "joint2", scored(4.5)),
    )


def test_what_the_data_contradict_is_named_with_how_much_and_what_to_do(fit):
    found = rows(fit, *asking(fit))
    assert found[0] == ("base rocks", "10 % of joint 1", "+2.5 std. errors", "joint1.k_bend", "YES (z = 6.0)")
    assert found[1][0] == "link of joint2 bends"
    assert found[1][-1] == "YES (z = 4.5)"
    finding = asked_for(taking(fit, *asking(fit)))
    assert "base rocks (z = 6.0; 12 % +- 2 % of joint 1's bending compliance would fit best)" in finding.text
    assert finding.remedy == "fit again with --soft-base 0.5"


def test_what_the_data_contradict_makes_the_fit_not_usable_but_hides_no_interval(fit):
    report = fit_sections(taking(fit, *asking(fit)))
    assert report.verdict.word == "NOT USABLE"
    assert "base rocks" in report.verdict.reason
    assert report.findings[0].remedy == "fit again with --soft-base 0.5"
    assert "not reported" not in text_of(report)


def test_a_shift_is_in_sd_only_for_an_interval_that_is_reported(fit):
    """In doubt, a value moves by so many percent; of what the data leave open nothing is said beside what they know."""
    shift = 2.5 * fit.information.sd[0]
    doubtful = replace(fit, predicted=fit.predicted * 1.1)
    assert rows(doubtful, asking(fit)[0])[0][2:4] == (f"+{100 * np.expm1(shift):.2g} %", "joint1.k_bend")
    assert "one may be the cause" in asked_for(taking(doubtful, *asking(fit))).remedy
    known = replace(fit.information, data_sd=np.where(np.arange(6) == 0, np.inf, fit.information.data_sd))
    test = replace(scored(1.0), shift=np.array([9.0, 0.0, 0, 0, 0, 0.1 * fit.information.sd[5]]))
    row = rows(replace(fit, information=known), Assumption("base rocks", "", test))[0]
    assert row[2:4] == ("+0.1 std. errors", "joint3.k_tors")


def test_a_length_moves_by_millimetres(fit):
    x = Parameter(("link3.com.x",), False, 0.3, 0.3, 0.1, scale=0.1)
    unknowns = Parameters((x, *fit.problem.parameters.items[1:]))
    names = tuple(item.name for item in unknowns.items)
    known = replace(fit.information, names=names)
    doubtful = replace(
        fit, problem=replace(fit.problem, parameters=unknowns), information=known, predicted=fit.predicted * 1.1
    )
    assert rows(doubtful, Assumption("base rocks", "", scored(1.0, shift=0.02)))[0][2:4] == ("+2 mm", "link3.com.x")


def test_the_columns_are_explained_with_every_share_and_its_origin(fit):
    kinds = (*SOFT, *RIGID, "mass", "mass centre")
    given = taking(fit, *(Assumption(kind, "joint1", scored(1.0)) for kind in kinds))
    text = " ".join(part for part in assumption_section(given).parts if isinstance(part, str))
    for kind in kinds:
        assert KINDS[kind].of in text
        assert all(part in text for part in KINDS[kind].origin.split("; "))


def test_what_the_data_do_not_contradict_and_what_they_cannot_test(fit):
    found = rows(
        fit,
        Assumption("base rocks", "", scored(-6.0)),
        Assumption("base turns", "", scored(6.0, apart=1e-14)),
        Assumption("link twists", "joint1", scored(np.nan, seen=False, apart=0.0)),
        Assumption("mass", "joint1", scored(-1.2, positive=False)),
    )
    mass = "no sign (z = -1.2)"
    assert [row[-1] for row in found] == ["no sign (z = -6.0)", "cannot be tested", "does not affect these data", mass]


def test_a_good_fit_names_the_rigid_part_that_its_data_cannot_test(fit):
    sd = fit.information.sd[0]
    heavy, light = (scored(0.0, apart=0.0, shift=size * sd) for size in (2.0, 0.5))
    assert fit_sections(taking(fit, Assumption("base turns", "", heavy))).verdict.word == "GOOD if the base is rigid"
    assert fit_sections(taking(fit, Assumption("base turns", "", light))).verdict.word == "GOOD"
    assert not fit_sections(taking(fit, Assumption("base turns", "", light))).findings
    both = (Assumption("base turns", "", heavy), Assumption("link bends", "joint1", heavy))
    report = fit_sections(taking(fit, *both))
    assert report.verdict.word == "GOOD if the base is rigid and the links are rigid"
    change = f"joint1.k_bend {100 * np.expm1(2.0 * sd):+.2g} %"
    assert [each.text.partition(" (if not, ")[2] for each in report.findings] == [f"{change})"] * 2
    assert [each.remedy for each in report.findings] == [
        "measure the foot's motion",
        "measure deflections along the link",
    ]
    assert [row[3] for row in report.answer[1].rows] == [change.removeprefix("joint1.k_bend ")] * 2


def test_a_row_speaks_of_one_joint_the_one_with_evidence_or_else_the_one_that_moves_a_value_most(fit):
    sd = fit.information.sd[0]
    calm = [Assumption("link bends", f"joint{i}", scored(z, shift=i * sd)) for i, z in ((1, 1.0), (2, -0.5))]
    assert rows(fit, *calm)[0] == (
        "link of joint2 bends",
        "10 % of its joint",
        "+2.0 std. errors",
        "joint1.k_bend",
        "no sign (z = -0.5)",
    )
    asked = Assumption("link bends", "joint3", scored(6.0, shift=0.1 * sd))
    row = rows(fit, *calm, asked)[0]
    assert (row[0], row[2], row[-1]) == ("link of joint3 bends", "+0.1 std. errors", "YES (z = 6.0)")


def test_no_optimum_no_test(fit):
    assert assumption_section(replace(fit, assumptions=None)).parts == (
        "Not tested, as the search has not ended in an optimum.",
    )
