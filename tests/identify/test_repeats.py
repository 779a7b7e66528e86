"""Repeated readings of a coarse display: what they share, averaging does not reduce."""

from dataclasses import fields, replace

import numpy as np
import pytest
from arms import lcd_arm
from conformance import agrees, counted
from scipy.stats import binom

from ident.errors import InputError
from ident.identify.conditions import shared_error
from ident.identify.data_checks import Expected, _of_all, far_off
from ident.identify.fit import CampaignFit
from ident.identify.problem import pose
from ident.inference.fit import fit
from ident.inference.search import evaluate
from ident.measure import Campaign, parse_campaign

HEADER = "kind,q1 [deg],q2 [deg],q3 [deg],mode,value,unit,sigma,resolution,repeat\n"


def hits(count, resolution="0.01", repeat=str):
    rows = [f"frequency,0,0,0,lateral torsion 1,4.38,Hz,0.002,{resolution},{repeat(i)}" for i in range(count)]
    return parse_campaign((HEADER + "\n".join(rows)).encode(), "hits.csv")


def sd_of_mean(sigma):
    return np.sum(np.asarray(sigma) ** -2.0) ** -0.5


@pytest.mark.parametrize("count", [1, 5, 500])
def test_equal_hits_are_no_surer_than_the_display(count):
    sigma = pose(lcd_arm(), hits(count)).problem.sigma
    expected, what = np.hypot(0.002 / np.sqrt(count), 0.01 / np.sqrt(12)), "std. error of rounded readings"
    source = "uniform rounding, step / sqrt(12)"
    agrees(sd_of_mean(sigma), expected, "inference", what, source, rtol=1e-12, unit="Hz")


def test_without_a_resolution_they_count_as_they_did():
    sigma = pose(lcd_arm(), hits(5, resolution="")).problem.sigma
    assert np.asarray(sigma).tolist() == [0.002] * 5


@pytest.mark.slow
def test_equal_hits_are_no_sign_of_large_sigmas_where_a_display_has_rounded_them():
    for resolution, remarked in (("0.01", False), ("", True)):
        arm, campaign = lcd_arm(), hits(40, resolution=resolution)
        value = float(evaluate(pose(arm, campaign).problem).predicted[0])
        campaign = Campaign(measurements=tuple(replace(m, value=value) for m in campaign))
        plain = fit(pose(arm, campaign).problem, starts=1)
        found = CampaignFit(**{f.name: getattr(plain, f.name) for f in fields(plain)}, arm=arm, campaign=campaign)
        assert found.degrees_of_freedom == 39
        assert any("sigmas are too large" in remark for remark in found.remarks) == remarked


def test_equal_hits_that_nothing_tells_apart_are_duplicates():
    with pytest.raises(InputError, match=r"a duplicate of row 2.*tell readings apart by a column repeat"):
        hits(2, repeat=lambda i: "")


@pytest.mark.parametrize(("cell", "words"), [("0", "a resolution above 0"), ("1%", "resolution in the value's unit")])
def test_a_resolution_that_is_none(cell, words):
    with pytest.raises(InputError, match=words):
        hits(1, resolution=cell)


def test_intervals_hold_the_truth_as_often_as_they_say():
    """Of 4000 truths, each seen in six ways, each way five times on a display that is coarse beside the noise."""
    rng, truths, step, noise = np.random.default_rng(0), 4000, 1.0, 0.005
    slope = np.array([1.0, 1.7, 0.9, 1.4, 1.1, 0.8])
    order, truth = np.repeat(np.arange(6), 5), rng.uniform(50, 100, truths)
    shown = np.round((truth[:, None] * slope[order] + noise * rng.standard_normal((truths, 30))) / step) * step

    def covered(resolution):
        weight = shared_error(order, np.full(30, noise), np.full(30, resolution)) ** -2.0
        information = (weight * slope[order] ** 2).sum()
        fitted = (shown * weight * slope[order]).sum(1) / information
        return int((np.abs(fitted - truth) < 1.96 * information**-0.5).sum())

    low, high = binom.ppf([0.0005, 0.9995], truths, 0.95)
    what, source = "rounded readings within their intervals", "95 % promised, 4000 truths"
    counted(covered(step), truths, low, high, "verdict rates", what, source, expected=0.95 * truths)
    assert covered(0.0) < 0.1 * truths, "as if all readings were independent, intervals are far too short"


def test_readings_without_a_label_are_said_to_count_as_modes():
    """Two readings of three modes count as six modes: where these are far off, the message says which it took."""
    rows = [f"frequency,0,0,0,,{value},Hz,0.02,," for value in (4.38, 4.41, 5.07, 5.1, 14.8, 14.9)]
    campaign = parse_campaign((HEADER + "\n".join(rows)).encode(), "twice.csv")
    predicted = np.full(6, 16.1)
    problem = _of_all([*far_off(3, campaign, Expected(predicted, *np.zeros((3, 6))))], campaign)
    assert problem.where == "twice.csv:5"
    assert "taken as number 4 of 6 modes without a label there: label repeats, or" in problem.remedy


def test_a_missing_column_of_angles_is_one_line():
    lines = [HEADER.replace(",q3 [deg]", ""), *(f"frequency,0,0,,{value},Hz,0.02,,\n" for value in (4.38, 5.07, 14.8))]
    with pytest.raises(InputError) as refused:
        pose(lcd_arm(), parse_campaign("".join(lines).encode(), "c.csv"))
    (problem,) = refused.value.problems
    assert (problem.where, problem.got) == ("c.csv:2", "2 joint angles")
