"""The report of a check, read as an engineer would."""

import dataclasses
import re
from pathlib import Path

import numpy as np
import pytest
from arms import lcd_arm

from ident.arm.modes import Label
from ident.identify.check import check_campaign
from ident.identify.problem import LabelDoubt
from ident.inference.identifiability import OtherSolutions
from ident.inference.optima import Optimum
from ident.inference.parameters import Parameter
from ident.measure import Campaign, read_campaign
from ident.present.text.check import check_report
from ident.present.text.words import balance, parameter_in_words

pytestmark = pytest.mark.slow

DATA = Path(__file__).parents[3] / "data" / "lcd_arm"


@pytest.fixture(scope="module")
def paper():
    return check_campaign(lcd_arm(), read_campaign(DATA / "table1.csv"))


@pytest.fixture(scope="module")
def shipped():
    return check_campaign(lcd_arm(), read_campaign(DATA / "campaign.csv"))


def with_servo(found, rows):
    own = [dataclasses.replace(m, drives="servo" if i in rows else "brake") for i, m in enumerate(found.campaign)]
    return dataclasses.replace(found, campaign=dataclasses.replace(found.campaign, measurements=tuple(own)))


def test_rows_that_a_servo_held_are_named_in_one_warning(shipped):
    assert "servo" not in check_report(shipped)
    first, third = (shipped.campaign.measurements[i].where.rpartition(":")[2] for i in (0, 2))
    report = check_report(with_servo(shipped, {0, 2}))
    (line,) = [line for line in report.splitlines() if "WARNING" in line]
    assert line.endswith(f"brake and servo mixed, fit them apart: servo on in rows {first}, {third}")
    assert report.count(", servo on at (") >= 2, "and where the rows are listed"
    (line,) = [line for line in check_report(with_servo(shipped, range(99))).splitlines() if "WARNING" in line]
    assert line.endswith("servo on in all rows: the model holds the motors, so that k_tors contains the servo")


def measured_rows(report):
    return [line for line in report.splitlines() if re.match(r" +\d+  [a-z].*%", line)]


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
    report = check_report(paper)
    assert "3 measurements, 6 unknowns: 0 of 6 identifiable by the data alone" in report
    assert report.count("nothing of it alone: seen only in combination with others") == 6
    assert "What the data see: 3 of 6 directions" in report
    assert "torsion of joint3 against torsion of joint1: any trade-off fits equally well" in report
    assert "such as joint2.k_tors by +10 % together with joint1.k_tors by -3.4 %" in report
    assert report.count("<-- dominates; one direction open without it") == 3
    assert "deflection tip at (0, 0, 0) deg: by the others 31.6 mm, measured 22: -4.2 sd" in report
    assert "CONTRADICTION" in report
    assert "none is in doubt" in report


def test_the_shipped_campaign(shipped):
    report = check_report(shipped)
    assert "6 of 6 identifiable" in report
    assert "CONTRADICTION" not in report
    assert "WARNING" not in report
    assert "<--" not in report
    assert "Condition number of the 6 that are seen: 4.63" in report
    rows = measured_rows(report)
    assert len(rows) == 20, "each measurement with its row in the file"
    assert sum(float(row[57:].split("%")[0]) for row in rows) == pytest.approx(100, abs=1)


def test_other_values_with_the_same_data_are_listed(shipped):
    assert "Other values that give the same data: none were found" in check_report(shipped)
    assert "no proof" in check_report(shipped)
    start = shipped.problem.parameters.column("start")
    twin = Optimum(start * np.array([2.0, 0.5, 1, 1, 1, 1]), np.log(start), 0.0, 3, True, np.empty((0, 6)), np.ones(6))
    rival = dataclasses.replace(twin, cost=2.34)
    report = check_report(dataclasses.replace(shipped, others=OtherSolutions(16, 14, (twin,), (rival,))))
    assert "6 of 6 identifiable by the data alone, but only near these values" in report
    assert "GLOBALLY NOT IDENTIFIABLE: another set of values gives the same data" in report
    assert "chi-squared 0: joint1.k_bend 2 times, joint2.k_bend 0.5 times, joint3.k_bend 1 times" in report
    assert "chi-squared 2.3: joint1" in report
    assert "14 of 16 starts ended in an optimum" in report


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
    report = check_report(dataclasses.replace(shipped, campaign=twice, leverage=marked))
    assert len(measured_rows(report)) == 2
    assert re.findall("<-- (.*)", report) == ["dominates", "carries no information"]
    assert "The other measurements of 40" in report


def test_doubtful_labels_are_told_with_their_rows(shipped):
    mode, other = Label("lateral", "torsion", 1), Label("vertical", "bending", 1)
    doubts = (LabelDoubt(0, mode, True, (), None), LabelDoubt(1, mode, False, (other,), 0))
    report = check_report(dataclasses.replace(shipped, labels=doubts))
    assert (
        "  7  frequency lateral torsion 1 at (0, 0, 0) deg: its mode, lateral torsion 1, is named by a near" in report
    )
    assert "nearly has the frequency of vertical bending 1: label it" in report
    assert "though row 7, for another mode, is the same" in report


def test_an_arm_that_collapses_gets_no_verdict_but_unknown():
    soft = lcd_arm().replace({"joint1.k_bend": 10.0})
    report = check_report(check_campaign(soft, read_campaign(DATA / "table1.csv")))
    assert "WARNING: nothing can be said" in report
    assert report.count("unknown    ") == 6
    assert "identifiable:" not in report
    assert "What the data see" not in report
