"""`ident.plan` from Python: what it gives, that it comes back, and what it refuses."""

import math
from dataclasses import replace

import numpy as np
import pytest
from arms import DATA, lcd_arm
from reports import assert_one_screen
from results import assert_comes_back, assert_plain

import ident
from ident.identify.plan import PlanSettings, plan_campaign
from ident.measure import Load
from ident.studies.stiffness.plan import PlanOptions, plan

COARSE = {"step": 90.0, "draws": 1, "count": 2}


@pytest.fixture(scope="module")
def arm_file():
    return ident.read_arm(DATA / "lcd_arm" / "arm.toml")


@pytest.fixture(scope="module")
def table_1():
    return ident.read_campaign(DATA / "lcd_arm" / "table1.csv")


@pytest.fixture(scope="module")
def measured(arm_file, table_1):
    return plan(arm_file, table_1, PlanOptions(**COARSE, starts=1, load=("glass",), cost={"dial": 1.0}, criterion="a"))


def test_options_are_in_the_units_of_the_command_line():
    settings = PlanOptions(**COARSE, target=5.0, load=("glass",)).settings
    assert settings.step == pytest.approx(math.pi / 2)
    assert settings.target == pytest.approx(math.log(1.05))
    assert settings.loads == (Load(), Load.parse("glass"))


def test_it_is_the_plan_of_the_arm(arm_file):
    result = plan(arm_file, options=PlanOptions(**COARSE))
    direct = plan_campaign(lcd_arm(), settings=PlanSettings(step=math.radians(90.0), draws=1, count=2))
    np.testing.assert_array_equal(result.plan.sd, direct.sd)
    assert [step.experiment for step in result.plan.steps] == [step.experiment for step in direct.steps]
    assert result.name == "arm.plan"
    assert result.cost == sum(step.cost for step in direct.steps)
    assert result.campaign == direct.campaign()
    for name, own in zip(direct.parameters.names, direct.sd.T, strict=True):
        assert result.sd[name] == tuple(own)
        assert own[0] > own[-1]
    for name, own in zip(direct.parameters.names, direct.steps[-1].sd.T, strict=True):
        assert (result.sd[name][-1], *result.sd_at_draws[name]) == tuple(own)


def test_an_arm_that_was_made_in_python_will_do(arm_file):
    result = plan(lcd_arm(), options=PlanOptions(**COARSE))
    assert result.sections().answer == plan(arm_file, options=PlanOptions(**COARSE)).sections().answer
    assert result.name == f"{lcd_arm().name}.plan"


def test_what_is_measured_already_counts(measured, table_1):
    assert measured.name == "table1.plan"
    assert measured.plan.fit.campaign == table_1
    assert measured.plan.instruments.costs["dial"] == 1.0
    report = measured.sections()
    assert "mean variance" in report.details[0].parts[0]
    assert report.verdict.word == "PROVISIONAL"
    assert report.next.startswith("check the causes, fill in out/table1.plan.csv, add it, then: ident fit ")
    assert_one_screen(measured.report(), files=3)


def test_it_comes_back_as_it_was(measured, arm_file, tmp_path):
    assert assert_comes_back(measured, tmp_path).cost == measured.cost
    assert_comes_back(plan(arm_file, options=PlanOptions(**COARSE)), tmp_path)


def test_its_files_are_a_document_and_a_campaign_to_fill_in(measured, tmp_path):
    written = measured.save(tmp_path)
    assert [path.name for path in written] == ["table1.plan.json", "table1.plan.csv"]
    rows = [line for line in written[1].read_text().splitlines() if line[0] != "#"]
    assert len(rows) == 1 + len(measured.campaign.measurements)
    assert rows[0].split(",")[4] == "mode"


def test_a_form_that_was_filled_in_gets_a_number(measured, tmp_path):
    _, form = measured.save(tmp_path)
    empty, filled = form.read_text(), form.read_text().replace(",,Hz", ",4.2,Hz")
    for number in (1, 2):
        form.write_text(filled)
        measured.save(tmp_path)
        assert form.read_text() == empty
        assert form.with_name(f"{form.stem}.{number}.csv").read_text() == filled


def test_an_empty_batch_has_no_form(arm_file, tmp_path):
    result = plan(arm_file, options=PlanOptions(**{**COARSE, "draws": 0}, target=1e4))
    assert [path.name for path in result.save(tmp_path)] == ["arm.plan.json"]
    assert result.table() == []
    assert result.sections().subject.startswith("Plan of 0 experiments")
    assert result.sections().verdict.word == "TARGET REACHED"
    assert set(result.sd_at_draws.values()) == {()}


def test_its_table_has_a_row_for_each_experiment(measured):
    rows = measured.table()
    assert_plain(rows)
    assert [row["step"] for row in rows] == [1, 2]
    assert {"joint1 [deg]", "joint2 [deg]", "joint3 [deg]", "minutes", "nats"} <= rows[0].keys()
    assert sum(row["minutes"] for row in rows) == measured.cost


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"count": 0}, "count: got 0, expected a number from 1"),
        ({"target": -1.0}, "target: got -1"),
        ({"modes": 0}, "modes: got 0"),
        ({"draws": -1}, "draws: got -1"),
    ],
)
def test_options_are_checked_when_they_are_made(options, words):
    with pytest.raises(ident.InputError, match=words):
        PlanOptions(**options)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"cost": {"gauge": 1.0}}, "one of posture"),
        ({"sigma": {"frequencies": 0.1}}, "did you mean frequency"),
        ({"load": ("glas",)}, "glass"),
        ({"criterion": "e"}, "d, a, or a parameter's name"),
        ({"step": 0.0}, "a number above 0, at most 360"),
    ],
)
def test_what_the_arm_does_not_have_is_refused_in_one_line(arm_file, options, words):
    with pytest.raises(ident.InputError, match=words) as refusal:
        plan(arm_file, options=PlanOptions(**{**COARSE, **options}))
    assert len(str(refusal.value).splitlines()) == 1


def test_the_next_command_poses_the_same_problem(measured):
    assert measured.sections().next.endswith("table1.csv")
    fixed = replace(measured, options=PlanOptions(**COARSE, fix=("joint1.k_bend",)))
    assert fixed.sections().next.endswith("table1.csv --fix joint1.k_bend")
