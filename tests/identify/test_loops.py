"""Ramps of loads: their loops are found, and stiffnesses are what they would be without friction."""

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from arms import lcd_arm
from conformance import agrees, counted
from scipy.stats import binom

from ident.arm.arm import stiffness_paths
from ident.errors import InputError
from ident.identify.data_checks import check_values
from ident.identify.fit import CampaignFit, fit_campaign
from ident.identify.plan import PlanSettings, plan_campaign
from ident.identify.problem import pose, ramps, ramps_of
from ident.identify.validate import validate_fit
from ident.inference.fit import fit
from ident.inference.search import evaluate
from ident.measure import Campaign, Load, Measurement
from ident.measure.reading import campaign_text, parse_campaign
from ident.studies.stiffness.fit_report import fit_sections
from ident.studies.stiffness.validate_report import validate_sections
from ident.studies.stiffness.warnings import hysteresis

pytestmark = pytest.mark.slow

POSTURES = [(0.0, 0.0, 0.0), (0.5, -1.0, 0.6)]
FORCES = (0.0, 50.0, 100.0, 150.0)
"""[N] of a ramp, up to the largest and back."""
TWIST, DIAL = 1e-5, 2e-5
"""Standard deviations of encoders [rad] and of a dial gauge [m]."""
WIDTHS = {"joint1": 3e-4, "joint2": -1e-4, "joint3": 5e-5}
"""Of the loops in the joints' twists [rad]."""


@cache
def planned() -> tuple[Measurement, ...]:
    """Up and back with a sideways force at the tip, at both postures: encoders of all joints, and a dial gauge."""
    rows = []
    for posture in POSTURES:
        for ramp, forces in (("loading", FORCES), ("unloading", FORCES[::-1])):
            for force in forces:
                load = Load(forces=(((0.0, force, 0.0), "tip"),)) if force else Load()
                own: dict[str, Any] = {"posture": posture, "value": 0.0, "load": load, "ramp": ramp}
                rows += [Measurement(kind="twist", joint=name, sigma=TWIST, **own) for name in WIDTHS]
                rows.append(Measurement(kind="deflection", point="tip", direction=(0, 1, 0), sigma=DIAL, **own))
    return tuple(rows)


def measured(widths: dict[str, float], noise: float = 0.0, seed: int = 0, factors: float = 0.0) -> Campaign:
    """Return what an arm with springs off their file's values would show, with loops so wide; the dial's is zero."""
    rng, problem = np.random.default_rng(seed), pose(lcd_arm(), Campaign(measurements=planned())).problem
    theta, names = np.array(problem.parameters.theta(problem.parameters.column("start"))), problem.parameters.names
    theta[[names.index(path) for path in stiffness_paths(lcd_arm())]] += factors * rng.standard_normal(6)
    exact = np.asarray(evaluate(problem, theta).predicted)
    half = np.array([(-0.5 if m.ramp == "loading" else 0.5) * widths.get(m.joint or "", 0.0) for m in planned()])
    values = exact + half + noise * np.array([m.sigma for m in planned()]) * rng.standard_normal(len(exact))
    return Campaign(measurements=tuple(replace(m, value=float(v)) for m, v in zip(planned(), values, strict=True)))


@cache
def fitted() -> CampaignFit:
    """A fit of loops that were measured with noise."""
    return fit_campaign(lcd_arm(), measured(WIDTHS, 1.0), starts=1)


def test_loops_are_found_and_move_no_stiffness():
    """Exact data: widths to rounding, and the stiffnesses of the arm that has no friction."""
    problem = pose(lcd_arm(), measured(WIDTHS)).problem
    found = fit(problem, starts=1)
    loops = ramps_of(measured(WIDTHS), problem, found.information.sd)
    assert len(loops) == 8
    for loop in loops:
        assert found.parameters[loop.name] == pytest.approx(WIDTHS.get(loop.of.joint or "", 0.0), abs=1e-9)
    arm = lcd_arm()
    told = ~problem.parameters.nuisance & (found.information.data_sd < 0.1)
    assert told.sum() >= 3
    for path, value, known in zip(problem.parameters.names, found.best.values, told, strict=True):
        if known:
            assert value == pytest.approx(float(arm.get(path)), rel=1e-6)
    assert found.chi_squared < 1e-6
    assert not found.doubts


def test_unsaid_loops_are_doubted():
    """The same rows without the column contradict each other, or are improbable."""
    rows = tuple(replace(m, ramp="", repeat=m.ramp) for m in measured(WIDTHS, 1.0))
    posed = pose(lcd_arm(), Campaign(measurements=rows))
    with pytest.raises(InputError, match="measured the same"):
        check_values(posed)
    check_values(posed, ("all",))
    assert fit(posed.problem, starts=1).doubts


def test_widths_are_the_difference_of_both_ways_with_its_standard_deviation():
    """Closed form: the mean of what unloading reads less what loading reads at the same loads, sigma sqrt(2 / n)."""
    found, campaign = fitted(), measured(WIDTHS, 1.0)
    for loop in found.loops:
        own = [campaign.measurements[i] for i in loop.rows]
        means = [np.mean([m.value for m in own if m.ramp == ramp]) for ramp in ("loading", "unloading")]
        source = "difference of the means, sigma sqrt(2 / n)"
        width = means[1] - means[0]
        agrees(loop.width, width, "inference", "widths of hysteresis loops", source, atol=1e-12)
        expected, what = own[0].sigma * np.sqrt(2 / len(FORCES)), "std. errors of hysteresis loops"
        agrees(loop.sd, expected, "inference", what, source, rtol=1e-6)
    assert found.p_value > 0.001
    assert found.degrees_of_freedom == len(campaign) - len(found.loops) - found.information.rank


def test_intervals_hold_the_truth():
    """Of widths, over eight simulated campaigns; as few as happens to 95 % intervals once in 1000 times."""
    held = []
    for seed in range(8):
        campaign = measured(WIDTHS, 1.0, seed, 0.1)
        found = fit(pose(lcd_arm(), campaign).problem, starts=1)
        for loop in ramps_of(campaign, found.problem, found.information.sd):
            off = found.parameters[loop.name] - WIDTHS.get(loop.of.joint or "", 0.0)
            held.append(abs(off) < 1.96 * loop.sd)
    assert len(held) == 64
    what, source, count = "widths of hysteresis loops within their intervals", "95 % promised", len(held)
    least = binom.ppf(0.001, count, 0.95)
    counted(sum(held), count, least, count, "verdict rates", what, source, expected=0.95 * count)


def test_the_derivatives_are_those_of_finite_differences():
    problem = pose(lcd_arm(), measured(WIDTHS)).problem
    theta = np.asarray(problem.parameters.theta(problem.parameters.column("start")))
    theta = theta + 0.1 * np.random.default_rng(1).standard_normal(len(theta))
    exact = evaluate(problem, theta).jacobian
    for i, direction in enumerate(1e-4 * np.eye(len(theta))):
        ends = [np.asarray(evaluate(problem, theta + way * direction).predicted) for way in (-1, 1)]
        np.testing.assert_allclose(exact[:, i], (ends[1] - ends[0]) / 2e-4, rtol=1e-5, atol=1e-10)


def test_one_way_alone_tells_slopes_and_no_width():
    """The stiffnesses are those of rows that are all off by an unknown number; the report says so."""
    campaign = measured({})
    problem = pose(lcd_arm(), campaign).problem
    loading = np.array([m.ramp == "loading" for m in campaign])
    problem = problem.with_sigma(np.where(loading, np.asarray(problem.sigma), np.inf))
    found = fit(problem, starts=1)
    assert found.best.values[3] == pytest.approx(float(lcd_arm().get("joint1.k_tors")), rel=1e-4)
    assert all(loop.sd > 1e-5 for loop in ramps_of(campaign, problem, found.information.sd))
    one_way = replace(campaign, measurements=tuple(m for m in campaign if m.ramp == "loading"))
    (section,) = hysteresis(one_way, ramps(pose(lcd_arm(), one_way)))
    assert "only loading" in section.parts[1]


def test_the_report_says_each_width():
    (section,) = hysteresis(fitted().campaign, fitted().loops)
    assert section.parts[0].rows[0][:2] == ("twist joint1 at (0, 0, 0) deg", "0.295 +- 0.0071 mrad")
    assert fit_sections(fitted()).subject.endswith("8 hysteresis loops")


def test_before_a_fit_it_is_said_how_well_each_width_will_be_told():
    """By the closed form above; of one way alone the width is no more than how far its rows are off together."""
    campaign = measured(WIDTHS, 1.0)
    found = ramps(pose(lcd_arm(), campaign))
    assert [len(ramp.rows) for ramp in found] == 8 * [2 * len(FORCES)]
    for ramp in found:
        assert ramp.sd == pytest.approx(ramp.of.sigma * np.sqrt(2 / len(FORCES)), rel=1e-6)
    (section,) = hysteresis(campaign, found)
    assert section.parts[0].rows[0] == ("twist joint1 at (0, 0, 0) deg", "0.0071 mrad", 8)
    assert len(section.parts) == 1
    one_way = replace(campaign, measurements=tuple(m for m in campaign if m.ramp == "loading"))
    alone = [replace(ramp, rows=tuple(range(len(FORCES)))) for ramp in found]
    (section,) = hysteresis(one_way, alone)
    assert "only loading" in section.parts[1]


def test_a_loop_that_is_left_out_whole_is_not_predicted():
    whole, parts = validate_fit(fitted(), "posture"), validate_fit(fitted(), "fraction")
    assert not whole.told
    assert len(parts.told) == len(parts.parts)
    assert parts.covered >= binom.ppf(0.001, len(fitted().campaign), 0.95)
    report = validate_sections(whole)
    assert report.verdict.word == "NOT TESTED"
    assert report.findings[-1].text.startswith("8 hysteresis loops")
    assert report.findings[-1].remedy == "try --leave row"


def test_a_plan_goes_on_from_ramps():
    plan = plan_campaign(lcd_arm(), fitted(), settings=PlanSettings(step=np.pi / 2, draws=2, count=1))
    assert not any(name.startswith("loop:") for name in plan.known.names)


def test_ramps_are_written_and_read_back():
    campaign = measured(WIDTHS)
    assert parse_campaign(campaign_text(campaign).encode(), "c.csv") == campaign


@pytest.mark.parametrize(
    ("row", "message"),
    [
        ("twist,0,0,0,,,joint1,up,1,mrad,0.1", "one of loading, unloading"),
        ("twist,0,0,0,,,joint1,loadng,1,mrad,0.1", "write loading"),
        ("frequency,0,0,0,,,,loading,4,Hz,0.1", "a frequency has no ramp"),
    ],
)
def test_what_can_be_no_ramp_is_refused(row, message):
    head = "kind,q1 [deg],q2 [deg],q3 [deg],point,direction,joint,ramp,value,unit,sigma"
    with pytest.raises(InputError, match=message):
        parse_campaign(f"{head}\n{row}\n".encode(), "c.csv")
