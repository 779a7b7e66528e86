"""What a fit of the paper's arm takes for granted, on campaigns that are right and on a base that gives."""

import math
from dataclasses import replace

import numpy as np
import pytest
from arms import DATA, lcd_arm
from one_program import shown

from ident.arm.arm import on_soft_base
from ident.identify.assumptions import assumptions
from ident.identify.fit import fit_campaign
from ident.identify.hypotheses import RIGID
from ident.identify.problem import pose
from ident.identify.unknowns import Unknowns
from ident.inference.problem import DISCREPANCY_PREFIX
from ident.measure import Campaign, read_campaign

slow = pytest.mark.slow

CAMPAIGN = DATA / "lcd_arm" / "campaign.csv"
HEIGHT = math.hypot(1.0, 0.12) / 2


def campaign_of(arm, *, noise=0.0, sigma=1.0):
    """The shipped campaign's rows, measured on an arm."""
    rows = read_campaign(CAMPAIGN).measurements
    values = shown(arm, Campaign(measurements=rows))
    z = np.random.default_rng(1).standard_normal(len(rows))
    relative = [0.005 if row.kind == "frequency" else 0.02 for row in rows]
    return Campaign(
        measurements=tuple(
            replace(row, value=value * (1 + noise * part * e), sigma=sigma * part * value)
            for row, value, part, e in zip(rows, values.tolist(), relative, z, strict=True)
        )
    )


@pytest.fixture(scope="module")
def right():
    return fit_campaign(lcd_arm(), campaign_of(lcd_arm(), noise=1.0), starts=1)


@slow
def test_every_joint_and_the_base_are_looked_at(right):
    named = {(item.kind, item.joint) for item in right.assumptions.items}
    joints = ("joint1", "joint2", "joint3")
    of_joints = {(kind, joint) for kind in (*RIGID, "mass", "mass centre") for joint in joints}
    assert named == of_joints | {("base rocks", ""), ("base turns", "")}
    assert right.assumptions.height == pytest.approx(HEIGHT)
    assert right.assumptions.asked_for == ()


@slow
def test_what_is_in_series_with_a_joint_cannot_be_told_apart(right):
    apart = {(item.kind, item.joint): item.test.separable for item in right.assumptions.items}
    assert not apart.pop(("base turns", ""))
    assert not any(apart.pop(("servo gives", joint)) for joint in ("joint1", "joint2", "joint3"))
    assert all(apart.values())


def fitted_with(fit, campaign, unknowns, factor=1.0):
    """A fit, posed with other unknowns; a discrepancy is that all deflections are larger by a factor."""
    posed = pose(fit.fitted_arm, campaign, unknowns)
    down, names = np.array([m.kind == "deflection" for m in campaign]), fit.problem.parameters.names
    by_name = dict(zip(names, fit.jacobian.T, strict=True)) | {DISCREPANCY_PREFIX + "deflection": down * fit.predicted}
    value = dict(zip(names, fit.best.values, strict=True)) | {DISCREPANCY_PREFIX + "deflection": factor}
    own, scale = posed.problem.parameters.names, np.where(down, factor, 1.0)
    values = np.array([value[name] for name in own])
    theta, none = np.asarray(posed.problem.parameters.theta(values)), np.zeros((0, len(own)))
    best = replace(fit.best, values=values, theta=theta, open=none, sd=np.ones(len(own)))
    changed = {"predicted": scale * fit.predicted, "jacobian": scale[:, None] * np.stack([*map(by_name.get, own)], 1)}
    made = replace(fit, problem=posed.problem, optima=(best,), stretch=None, **changed)
    return assumptions(made, posed)


@slow
def test_a_servo_can_be_told_apart_where_its_joint_is_not_fitted(right):
    found = fitted_with(right, right.campaign, Unknowns(fixed=("joint2.k_tors",)))
    apart = {item.joint: item.test.separable for item in found.items if item.kind == "servo gives"}
    assert apart == {"joint1": False, "joint2": True, "joint3": False}


@slow
def test_a_base_that_gives_is_asked_for_and_the_shift_takes_the_stiffnesses_to_the_truth():
    soft = on_soft_base(lcd_arm(), HEIGHT).replace({"base.k_bend": 50 * 7.173e5, "base.k_tors": 1e12})
    fit = fit_campaign(lcd_arm(), campaign_of(soft, sigma=0.1), starts=1)
    first = fit.assumptions.asked_for[0]
    assert (first.kind, first.joint) == ("base rocks", "")
    assert first.test.z * first.test.sd == pytest.approx(0.02, rel=0.1), "the share of joint 1's compliance"
    truth = np.log([float(lcd_arm().get(name)) for name in fit.problem.parameters.names])
    off = truth - fit.best.theta
    assert np.abs(off).max() > 1.5 * fit.information.sd[np.argmax(np.abs(off))]
    moved = first.test.shift * 0.02 / first.test.amount
    np.testing.assert_allclose(moved, off, atol=0.1 * np.abs(off).max())


def test_a_base_that_is_modelled_is_unknown_and_stiff_by_its_prior():
    """That it is not taken for granted any more: `tests/cli/test_fit.py`."""
    parameters = pose(on_soft_base(lcd_arm(), HEIGHT), read_campaign(CAMPAIGN)).problem.parameters
    assert parameters.names[0] == "base.k_bend"
    prior = dict(zip(parameters.names, parameters.column("prior_sd"), strict=True))
    assert (prior["base.k_tors"], prior["joint1.k_tors"]) == (1.5, 1.0)


@slow
def test_a_discrepancy_factor_scales_what_an_assumption_changes(right):
    rows = right.campaign
    high = Campaign(
        measurements=tuple(
            replace(row, value=1.2 * row.value, sigma=1.2 * row.sigma) if row.kind == "deflection" else row
            for row in rows
        )
    )
    unknowns = Unknowns(discrepancy={"deflection": 1e3})
    plain, scaled = (fitted_with(right, data, unknowns, factor) for data, factor in ((rows, 1.0), (high, 1.2)))
    assert any(item.test.separable for item in plain.items)
    for one, other in zip(plain.items, scaled.items, strict=True):
        assert one.test.sd == pytest.approx(other.test.sd, rel=1e-3) or not one.test.separable
