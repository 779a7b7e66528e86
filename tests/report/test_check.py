"""The report of a check, read as an engineer would."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from arms import lcd_arm
from reports import assert_one_screen

from ident.arm.modes import Label
from ident.identify.check import check_campaign
from ident.identify.label_checks import LabelDoubt
from ident.inference.identifiability import OtherSolutions
from ident.inference.optima import Optimum
from ident.inference.parameters import Parameter
from ident.measure import Campaign, read_campaign
from ident.report.report import text_of
from ident.report.words import balance, parameter_in_words
from ident.studies.stiffness.check_report import check_sections

pytestmark = pytest.mark.slow

DATA = Path(__file__).parents[2] / "data" / "lcd_arm"


@pytest.fixture(scope="module")
def paper():
    return check_campaign(lcd_arm(), read_campaign(DATA / "table1.csv"))


@pytest.fixture(scope="module")
def shipped():
    return check_campaign(lcd_arm(), read_campaign(DATA / "campaign.csv"))


def with_servo(found, rows):
    own = [dataclasses.replace(m, drives="servo" if i in rows else "brake") for i, m in enumerate(found.campaign)]
    return dataclasses.replace(found, campaign=dataclasses.replace(found.campaign, measurements=tuple(own)))


def section(report, title):
    return next(part for part in report.details if part.title.startswith(title))


def findings(report):
    return " | ".join(finding.text for finding in report.findings)


def test_rows_with_a_servo_on_are_named_in_one_finding(shipped):
    assert "servo" not in findings(check_sections(shipped))
    first, third = (shipped.campaign.measurements[i].where.rpartition(":")[2] for i in (0, 2))
    report = check_sections(with_servo(shipped, {0, 2}))
    assert f"the servo was on in rows {first}, {third}" in findings(report)
    rows = section(report, "Influence").parts[0].rows
    assert [", servo on, at (" in row[1] for row in rows[:4]] == [True, False, True, False]
    assert "the servos were on in all rows" in findings(check_sections(with_servo(shipped, range(99))))


def unknown(*paths):
    return Parameter(paths, True, 1.0, 1.0)


def test_parameters_in_physical_words():
    assert parameter_in_words(unknown("joint2.k_tors")) == "torsion of joint2"
    assert parameter_in_words(unknown("link2.mass")) == "mass of link2"
    assert parameter_in_words(unknown("joint2.offset.x")) == "joint2.offset.x"
    assert parameter_in_words(unknown("stiffness")) == "stiffness"
    assert parameter_in_words(unknown("discrepancy.damping_ratio")) == "model factor of every damping ratio"
    assert parameter_in_words(unknown("joint2.k_tors", "joint3.k_tors")) == "torsion of joint2 (and what is tied to it)"


@pytest.mark.parametrize(
    ("weights", "text"),
    [
        ([0.7, -0.7, 0.0], "torsion of joint2 against torsion of joint3"),
        ([-0.6, 0.8, 0.1], "torsion of joint3 against torsion of joint2"),
        ([0.7, 0.7, 0.0], "torsion of joint2 and torsion of joint3 together"),
        ([0.0, 0.0, -1.0], "bending of joint1"),
        ([0.8, 0.4, -0.5], "torsion of joint2 and torsion of joint3 against bending of joint1"),
    ],
)
def test_a_direction_in_physical_words(weights, text):
    items = [unknown("joint2.k_tors"), unknown("joint3.k_tors"), unknown("joint1.k_bend")]
    assert balance(weights, items) == text


def test_the_paper(paper):
    report = check_sections(paper)
    assert report.verdict.word == "NOT READY"
    assert "Deflection and frequency data contradict each other (4.1 sigma)" in report.verdict.reason
    assert "determine none of the 6 unknowns" in report.verdict.reason
    assert report.answer[0].endswith("measured 22.0 mm, predicted from the other data 31.6 mm.")
    assert [row[1:] for row in report.answer[-1].rows] == [("not determined", "only in combination with others")] * 6
    combinations = section(report, "Determined by the data: 3 of 6").parts[0].rows
    like = "not determined, such as joint2.k_tors by +10 % together with joint1.k_tors by -3.4 %"
    assert ("torsion of joint2 against torsion of joint1", like) in combinations
    influence = section(report, "Influence").parts[0].rows
    assert [row[-1] for row in influence] == ["dominates; one combination not determined without it"] * 3
    assert_one_screen(text_of(report))


def test_the_shipped_campaign(shipped):
    report = check_sections(shipped)
    assert report.verdict.word == "READY TO FIT"
    assert report.next == "ident fit {campaign}"
    assert section(report, "Determined by the data").parts[0] == "Condition number of the 6 determined: 4.63."
    rows = section(report, "Influence").parts[0].rows
    assert len(rows) == 20, "each measurement with its row in the file"
    assert sum(row[2] for row in rows) == pytest.approx(1)
    assert not any(row[-1] for row in rows)
    assert_one_screen(text_of(report))


def test_other_values_with_the_same_data_are_listed(shipped):
    none = section(check_sections(shipped), "Other values that give the same data: none found")
    assert "not exhaustive" in none.parts[0]
    start = shipped.problem.parameters.column("start")
    twin = Optimum(start * np.array([2.0, 0.5, 1, 1, 1, 1]), np.log(start), 0.0, 3, True, np.empty((0, 6)), np.ones(6))
    rival = dataclasses.replace(twin, cost=2.34)
    report = check_sections(dataclasses.replace(shipped, others=OtherSolutions(16, 14, (twin,), (rival,))))
    assert report.verdict.word == "NOT READY"
    assert "Not unique: 1 other set of values would give the same data" in report.verdict.reason
    table, text = section(report, "Other values").parts
    assert table.rows[0][0].startswith("joint1.k_bend 2 times, joint2.k_bend 0.5 times, joint3.k_bend 1 times")
    assert [row[1] for row in table.rows] == ["0", "2.3"]
    assert text.startswith("14 of 16 starts ended in an optimum")


def test_a_long_campaign_lists_what_matters_only(shipped):
    part = shipped.leverage
    leverage = part.leverage.copy()
    leverage[4], leverage[7] = 0.95, 0.0
    marked = dataclasses.replace(part, leverage=leverage)
    twice = Campaign(measurements=shipped.campaign.measurements * 2)
    marked = dataclasses.replace(
        marked,
        leverage=np.concatenate([leverage, part.leverage]),
        sees=part.sees * 2,
        opened=part.opened * 2,
        lost=part.lost * 2,
    )
    report = check_sections(dataclasses.replace(shipped, campaign=twice, leverage=marked))
    table = section(report, "Influence").parts[0]
    assert [row[-1] for row in table.rows] == ["dominates", "carries no information"]
    assert "The other measurements of 40" in table.note
    (alone,) = [each for each in report.findings if "nothing cross-checks row" in each.text]
    assert "row " in alone.text
    assert alone.remedy == "repeat it, or add others"


def test_doubtful_labels_are_findings_with_their_rows(shipped):
    mode, other = Label("lateral", "torsion", 1), Label("vertical", "bending", 1)
    doubts = (LabelDoubt(0, mode, True, (), None), LabelDoubt(1, mode, False, (other,), 0))
    report = check_sections(dataclasses.replace(shipped, labels=doubts))
    assert "row 7 (line 7 of campaign.csv): lateral torsion 1 is a borderline name" in findings(report)
    assert "nearly has the frequency of vertical bending 1: label it" in findings(report)
    assert "although row 7, for another mode, is equal" in findings(report)


def test_repeated_measurements_that_differ_are_not_ready(shipped):
    report = check_sections(dataclasses.replace(shipped, repeats=((0, 1),)))
    assert report.verdict.word == "NOT READY"
    assert report.findings[0].text == "rows 7 and 8 measured the same and differ: 4.124 and 4.816 Hz"


def test_an_arm_that_collapses_gets_no_verdict_but_unknown():
    soft = lcd_arm().replace({"joint1.k_bend": 10.0})
    report = check_sections(check_campaign(soft, read_campaign(DATA / "table1.csv")))
    assert report.verdict.word == "NOT READY"
    assert "no stable equilibrium" in report.verdict.reason
    assert "no equilibrium at the postures of rows 5, 6, 7" in findings(report)
    assert [row[1] for row in report.answer[-1].rows] == ["unknown"] * 6
    assert not [part for part in report.details if part.title.startswith("Determined")]
