"""Ramps of loads: their loops are found, and stiffnesses are what they would be without friction."""

from dataclasses import replace
from functools import cache
from typing import Any

import jax
import numpy as np
import pytest
from arms import lcd_arm
from one_program import predicted, shown
from scipy.stats import binom

from ident.arm.arm import stiffness_paths
from ident.errors import InputError
from ident.identify.compare import validate_fit
from ident.identify.fit import fit_campaign
from ident.identify.plan import PlanSettings, plan_campaign
from ident.identify.problem import pose, ramps
from ident.measure import Campaign, Load, Measurement
from ident.measure.reading import format_campaign, parse_campaign
from ident.present.fit import fit_sections
from ident.present.validate import validate_sections
from ident.present.warnings import expected_hysteresis, hysteresis
from ident.programs import jit

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
    arm, rng = lcd_arm(), np.random.default_rng(seed)
    off = factors * rng.standard_normal(6)
    true = arm.replace({p: float(arm.get(p)) * np.exp(x) for p, x in zip(stiffness_paths(arm), off, strict=True)})
    exact = shown(true, Campaign(measurements=planned()))
    half = np.array([(-0.5 if m.ramp == "loading" else 0.5) * widths.get(m.joint or "", 0.0) for m in planned()])
    values = exact + half + noise * np.array([m.sigma for m in planned()]) * rng.standard_normal(len(exact))
    return Campaign(measurements=tuple(replace(m, value=float(v)) for m, v in zip(planned(), values, strict=True)))


def test_loops_are_found_and_move_no_stiffness():
    """Exact data: widths to rounding, and the stiffnesses of the arm that has no friction."""
    fit = fit_campaign(lcd_arm(), measured(WIDTHS), starts=1)
    found = {(loop.of.posture, loop.of.joint): loop.width for loop in fit.loops}
    assert len(found) == 8
    for (_, joint), width in found.items():
        assert width == pytest.approx(WIDTHS.get(joint, 0.0), abs=1e-9)
    arm = lcd_arm()
    told = ~fit.problem.parameters.nuisance & (fit.information.data_sd < 0.1)
    assert told.sum() >= 3
    for path, value, known in zip(fit.problem.parameters.names, fit.best.values, told, strict=True):
        if known:
            assert value == pytest.approx(float(arm.get(path)), rel=1e-6)
    assert fit.chi_squared < 1e-6
    assert not fit.doubts


def test_unsaid_loops_are_doubted():
    """The same rows without the column contradict each other, or are improbable."""
    rows = tuple(replace(m, ramp="", repeat=m.ramp) for m in measured(WIDTHS, 1.0))
    with pytest.raises(InputError, match="measured the same"):
        fit_campaign(lcd_arm(), Campaign(measurements=rows), starts=1)
    assert fit_campaign(lcd_arm(), Campaign(measurements=rows), starts=1, trusted=("all",)).doubts


def test_widths_are_the_difference_of_both_ways_with_its_standard_deviation():
    """Closed form: the mean of what unloading reads less what loading reads at the same loads, sigma sqrt(2 / n)."""
    campaign = measured(WIDTHS, 1.0)
    fit = fit_campaign(lcd_arm(), campaign, starts=1)
    for loop in fit.loops:
        own = [campaign.measurements[i] for i in loop.rows]
        means = [np.mean([m.value for m in own if m.ramp == ramp]) for ramp in ("loading", "unloading")]
        assert loop.width == pytest.approx(means[1] - means[0], abs=1e-12)
        assert loop.sd == pytest.approx(own[0].sigma * np.sqrt(2 / len(FORCES)), rel=1e-6)
    assert fit.p_value > 0.001
    assert fit.degrees_of_freedom == len(campaign) - len(fit.loops) - fit.information.rank


def test_intervals_hold_the_truth():
    """Of widths, over eight simulated campaigns; as few as happens to 95 % intervals once in 1000 times."""
    held = []
    for seed in range(8):
        fit = fit_campaign(lcd_arm(), measured(WIDTHS, 1.0, seed, 0.1), starts=1)
        held += [abs(loop.width - WIDTHS.get(loop.of.joint or "", 0.0)) < 1.96 * loop.sd for loop in fit.loops]
    assert len(held) == 64
    assert sum(held) >= binom.ppf(0.001, len(held), 0.95)


def test_the_derivatives_are_those_of_finite_differences():
    problem = pose(lcd_arm(), measured(WIDTHS)).problem
    theta = np.asarray(problem.parameters.theta(problem.parameters.column("start")))
    theta = theta + 0.1 * np.random.default_rng(1).standard_normal(len(theta))
    exact = jit(jax.jacfwd(problem.predict))(theta)
    for i, direction in enumerate(1e-4 * np.eye(len(theta))):
        ends = [np.asarray(predicted(problem, theta + way * direction)) for way in (-1, 1)]
        np.testing.assert_allclose(exact[:, i], (ends[1] - ends[0]) / 2e-4, rtol=1e-5, atol=1e-10)


def test_one_way_alone_tells_slopes_and_no_width():
    """The stiffnesses are those of rows that are all off by an unknown number; the report says so."""
    rows = tuple(m for m in measured({}) if m.ramp == "loading")
    fit = fit_campaign(lcd_arm(), Campaign(measurements=rows), starts=1)
    assert fit.best.values[3] == pytest.approx(float(lcd_arm().get("joint1.k_tors")), rel=1e-4)
    assert all(loop.sd > 1e-5 for loop in fit.loops)
    (section,) = hysteresis(fit)
    assert "only loading" in section.parts[1]


def test_the_report_says_each_width():
    fit = fit_campaign(lcd_arm(), measured(WIDTHS, 1.0), starts=1)
    (section,) = hysteresis(fit)
    assert section.parts[0].rows[0][:2] == ("twist joint1 at (0, 0, 0) deg", "0.295 +- 0.0071 mrad")
    assert fit_sections(fit).subject.endswith("8 hysteresis loops")


def test_before_a_fit_it_is_said_how_well_each_width_will_be_told():
    """By the closed form above; of one way alone the width is no more than how far its rows are off together."""
    campaign = measured(WIDTHS, 1.0)
    found = ramps(pose(lcd_arm(), campaign))
    assert [len(ramp.rows) for ramp in found] == 8 * [2 * len(FORCES)]
    for ramp in found:
        assert ramp.sd == pytest.approx(ramp.of.sigma * np.sqrt(2 / len(FORCES)), rel=1e-6)
    (section,) = expected_hysteresis(campaign, found)
    assert section.parts[0].rows[0] == ("twist joint1 at (0, 0, 0) deg", "0.0071 mrad", 8)
    assert len(section.parts) == 1
    one_way = replace(campaign, measurements=tuple(m for m in campaign if m.ramp == "loading"))
    (section,) = expected_hysteresis(one_way, ramps(pose(lcd_arm(), one_way)))
    assert "only loading" in section.parts[1]


def test_a_loop_that_is_left_out_whole_is_not_predicted():
    fit = fit_campaign(lcd_arm(), measured(WIDTHS, 1.0), starts=1)
    whole, parts = validate_fit(fit, "posture"), validate_fit(fit, "fraction")
    assert not whole.told
    assert len(parts.told) == len(parts.parts)
    assert parts.covered >= binom.ppf(0.001, len(fit.campaign), 0.95)
    report = validate_sections(whole)
    assert report.verdict.word == "NOT TESTED"
    assert report.findings[-1].text.startswith("8 hysteresis loops")
    assert report.findings[-1].remedy == "try --leave row"


def test_a_plan_goes_on_from_ramps():
    fit = fit_campaign(lcd_arm(), measured(WIDTHS, 1.0), starts=1)
    plan = plan_campaign(lcd_arm(), fit, settings=PlanSettings(step=np.pi / 2, draws=2, count=1))
    assert not any(name.startswith("loop:") for name in plan.known.names)


def test_ramps_are_written_and_read_back():
    campaign = measured(WIDTHS)
    assert parse_campaign(format_campaign(campaign).encode(), "c.csv") == campaign


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
