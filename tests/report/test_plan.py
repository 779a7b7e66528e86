"""The plan in words, as a figure and as files."""

import csv
import dataclasses
import math
import re

import numpy as np
import pytest
from arms import lcd_arm, loose_arm
from figures import fitted
from reports import assert_one_screen, too_wide

from ident.arm.arm import Arm, Workspace
from ident.errors import InputError
from ident.identify.candidates import main_joints
from ident.identify.plan import PlanSettings, plan_campaign
from ident.measure import read_campaign
from ident.report.document import save
from ident.report.report import text_of
from ident.report.words import degrees
from ident.studies.stiffness.plan_figure import plan_figure
from ident.studies.stiffness.plan_report import plan_sections, write_form

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def plan():
    return plan_campaign(
        loose_arm(), settings=PlanSettings(step=math.radians(45.0), draws=2, count=3, costs={"dial": 1.0})
    )


def texts(figure):
    return [text.get_text() for text in figure.findobj(lambda a: hasattr(a, "get_text")) if text.get_text()]


def test_the_report_says_what_to_do_and_what_it_gives(plan):
    report = plan_sections(plan)
    assert report.subject.endswith("from the prior alone")
    batch, expected = report.answer
    first = plan.experiments[plan.ranked(1)[0]]
    assert batch.rows[0][1] == degrees(first.posture)
    assert batch.rows[0][3:] == (plan.steps[0].cost,)
    every = next(each for each in report.details if each.title.startswith("The batch of")).parts[0]
    assert every.rows[0][3:] == (plan.steps[0].cost, plan.steps[0].nats)
    assert [row[:2] for row in expected.rows] == [(name, "factor 2.7") for name in plan.known.names]
    assert report.details[-1].parts[0].startswith("Sigma (--sigma): 0.5 % of each frequency")
    assert not too_wide(text_of(report, details=True))
    assert_one_screen(text_of(report), files=3)


def test_a_fit_in_doubt_is_said():
    settings = PlanSettings(step=math.radians(90.0), draws=1, count=1)
    doubtful = plan_campaign(lcd_arm(), fitted("table1"), settings=settings)
    report = plan_sections(doubtful)
    assert report.verdict.word == "PROVISIONAL"
    assert "contradict each other" in report.verdict.reason
    assert "If that is resolved, " in report.verdict.reason
    expected = report.answer[1]
    assert expected.head[:3] == ("Expected std. error [% or factor]", "now", "after 1, if resolved")
    assert {row[1] for row in expected.rows} == {"not determined"}


def test_the_ranking_has_each_posture_once_and_falls(plan):
    best = plan.ranked(100)
    assert len({plan.experiments[i].place for i in best}) == len(best) == len(plan.predictions.postures)
    assert (np.diff(plan.per_cost[best]) <= 0).all()
    assert best[0] == plan.steps[0].experiment


def test_the_figure_names_joints_units_and_visits(plan, tmp_path):
    figure = plan_figure(plan)
    words = texts(figure)
    assert {"joint2 [deg]", "joint3 [deg]"} <= set(words)
    assert any("nat/h" in word for word in words)
    numbers = [word for word in words if re.fullmatch(r"\d(, \d)*", word)]
    assert sorted(", ".join(numbers).split(", "))[:3] == ["1", "2", "3"]
    save(figure, tmp_path / "plan.png")
    assert (tmp_path / "plan.png").stat().st_size > 20_000


@pytest.fixture(scope="module")
def shipped():
    return fitted("campaign")


def test_what_was_measured_beside_the_grid_lies_on_the_curve(shipped):
    """The shipped campaign was also at 80 deg, which the steps of 30 deg leave out."""
    plan = plan_campaign(lcd_arm(), shipped, settings=PlanSettings(draws=0, count=1))
    curve, *crosses = plan_figure(plan).axes[0].lines
    assert curve.get_xdata().tolist() == pytest.approx([-90, -60, -30, 0, 30, 60, 80, 90])
    points = dict(zip(curve.get_xdata().round(6).tolist(), curve.get_ydata().tolist(), strict=True))
    marked = {round(float(line.get_xdata()[0]), 6): float(line.get_ydata()[0]) for line in crosses}
    assert sorted(marked) == [0.0, 30.0, 60.0, 80.0]
    assert all(points[angle] == height for angle, height in marked.items())
    candidates = plan_sections(plan).details[0].parts[0]
    assert candidates.startswith("7 postures on the line (1, -2, 1), within the joint limits: ")
    assert "5 distinct postures (4 on the grid, 1 already measured)" in candidates


@pytest.fixture(scope="module")
def listed(shipped):
    """A plan for postures of which one has been measured."""
    postures = ((0.0, 0.0, 0.0), (1.0, -2.0, 1.0), (0.1, -0.2, 0.1))
    arm = dataclasses.replace(lcd_arm(), workspace=Workspace(postures=postures))
    return plan_campaign(arm, shipped, settings=PlanSettings(draws=0, count=1))


def test_listed_postures_have_a_bar_each_and_what_was_measured_elsewhere_none(listed):
    axes = plan_figure(listed).axes[0]
    assert len(axes.lines) == 1, "one of the four that were measured is listed"
    assert [t.get_text() for t in axes.get_yticklabels()] == [degrees(posture) for posture in listed.grid.postures]
    np.testing.assert_allclose([bar.get_width() for bar in axes.patches], 60 * listed.gain_over_grid)
    assert len([text for text in axes.texts if text.get_text()[0] in "12"]) >= 1


def test_a_span_of_two_factors_says_factor_once(plan):
    cells = [row[-1] for row in plan_sections(plan).answer[1].rows]
    assert not any(re.search(r"factor \S+ to factor", cell) for cell in cells)


def test_joints_that_do_not_matter_are_not_drawn(plan):
    assert np.isfinite(plan.gain_over_grid).all()
    assert main_joints(plan.grid.postures, plan.gain_over_grid) == [1, 2]


def test_a_sampled_grid_and_a_single_joint_are_drawn(plan, tmp_path):
    sampled = dataclasses.replace(plan, grid=dataclasses.replace(plan.grid, sampled=True))
    assert "a sample of the grid" in plan_sections(sampled).details[0].parts[0]
    save(plan_figure(sampled), tmp_path / "sampled.png")
    arm = loose_arm()
    last = arm.joints[-1]
    points = [point for point in arm.points if point.joint == last.name]
    single = Arm("single", (last,), tuple(points))
    alone = plan_campaign(single, settings=PlanSettings(step=math.radians(45.0), draws=0, count=2, modes=2))
    assert len(alone.predictions.postures) == 1, "about a vertical axis nothing changes"
    assert "joint3 [deg]" in texts(plan_figure(alone))


def test_the_form_is_refused_empty_and_read_when_filled_in(plan, tmp_path):
    write_form(plan, tmp_path / "form.csv")
    with pytest.raises(InputError, match="value"):
        read_campaign(tmp_path / "form.csv")
    lines = (tmp_path / "form.csv").read_text().splitlines()
    comments, table = [line for line in lines if line.startswith("#")], [line for line in lines if line[0] != "#"]
    rows = list(csv.DictReader(table))
    for row in rows:
        row["value"] = re.match(r"expected ([0-9.e+-]+) ", row["note"])[1]
    with (tmp_path / "filled.csv").open("w", newline="") as file:
        writer = csv.DictWriter(file, rows[0])
        writer.writeheader()
        writer.writerows(rows)
    assert comments
    filled, expected = read_campaign(tmp_path / "filled.csv"), plan.campaign()
    assert [m.kind for m in filled] == [m.kind for m in expected]
    np.testing.assert_allclose([m.value for m in filled], [m.value for m in expected], rtol=1e-3)
    np.testing.assert_allclose([m.sigma for m in filled], [m.sigma for m in expected], rtol=2e-3)


def test_rows_of_before_are_replaced_and_angles_are_what_one_types(shipped, listed, tmp_path):
    """0.1 rad is 5.7295... deg: written to 0.001 deg, but exactly where joint 3 would be beyond its limit."""
    last = lcd_arm().joints[-1]
    fields = {field.name: getattr(last, field.name) for field in dataclasses.fields(last)}
    joints = (*lcd_arm().joints[:-1], type(last)(**{**fields, "limits": (-0.1, 0.1)}))
    workspace = Workspace(postures=((0.1, -0.2, 0.1),))
    arm = dataclasses.replace(listed.arm, joints=joints, stroke=None, workspace=workspace)
    first = dataclasses.replace(listed.steps[0], experiment=place_of(listed, (0.1, -0.2, 0.1)))
    new = dataclasses.replace(listed, arm=arm, steps=(first,))
    assert "add it, then: ident fit {campaign}" in plan_sections(new).next
    write_form(new, tmp_path / "new.csv")
    cells = [row[f"q{joint} [deg]"] for row in rows_of(tmp_path / "new.csv")[:1] for joint in (1, 2, 3)]
    assert cells == ["5.73", "-11.459", "5.729577951"]
    again = dataclasses.replace(lcd_arm(), workspace=Workspace(postures=shipped.campaign.postures))
    repeat = plan_campaign(again, shipped, settings=PlanSettings(draws=4, count=2))
    assert "replace rows as noted" in plan_sections(repeat).next
    write_form(repeat, tmp_path / "repeat.csv")
    notes = [row["note"] for row in rows_of(tmp_path / "repeat.csv")]
    assert any(re.search(r"; replace campaign\.csv:\d+: enter the mean of 2 readings", note) for note in notes)
    spans = [row[-1].removesuffix(" %").split(" to ") for row in plan_sections(repeat).answer[1].rows]
    assert {len(end.lstrip("0.").replace(".", "")) for ends in spans if len(ends) == 2 for end in ends} == {2}


def place_of(plan, posture):
    return next(i for i, each in enumerate(plan.experiments) if each.posture == posture and each.hammer)


def rows_of(path):
    return list(csv.DictReader(line for line in path.read_text().splitlines() if line[0] != "#"))
