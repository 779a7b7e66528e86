"""Postures of the paper's arm that were left out: predicted where the model is right, missed where it is not."""

from dataclasses import replace

import numpy as np
import pytest
from arms import DATA, lcd_arm
from conformance import counted
from scipy.stats import binom

from ident import InputError, read_campaign
from ident.arm.arm import stiffness_paths
from ident.identify.fit import fit_campaign
from ident.identify.problem import pose
from ident.identify.validate import parts_of, validate_fit
from ident.inference.search import evaluate

pytestmark = pytest.mark.slow

CAMPAIGN = read_campaign(DATA / "lcd_arm" / "campaign.csv")
NAMES = stiffness_paths(lcd_arm())


def with_values(values):
    measured = (replace(m, value=float(v)) for m, v in zip(CAMPAIGN.measurements, values, strict=True))
    return replace(CAMPAIGN, measurements=tuple(measured))


def simulated(rng, arm=None):
    """The shipped campaign with other stiffnesses, of the arm or of one that is unlike the model."""
    problem = pose(arm or lcd_arm(), CAMPAIGN).problem
    theta = np.log([float(lcd_arm().get(name)) for name in NAMES]) + 0.2 * rng.standard_normal(len(NAMES))
    return with_values(
        evaluate(problem, theta).predicted + np.asarray(problem.sigma) * rng.standard_normal(len(CAMPAIGN))
    )


def validated(campaign, leave="posture"):
    return validate_fit(fit_campaign(lcd_arm(), campaign, starts=1), leave)


def test_right_campaigns_are_predicted_as_often_as_is_said():
    """Eight truths: no part is missed, and 95 % intervals hold what they should; a wide band, as parts share errors."""
    rng = np.random.default_rng(4)
    found = [validated(simulated(rng)) for _ in range(8)]
    assert not any(each.missed for each in found)
    count = sum(len(each.z) for each in found)
    assert count == 8 * len(CAMPAIGN)
    low, high = binom.ppf([1e-3, 1 - 1e-4], count, 0.95)
    what, source = "postures left out within their intervals", "95 % promised, known arms"
    covered = sum(each.covered for each in found)
    counted(covered, count, low, high, "verdict rates", what, source, expected=0.95 * count)
    assert np.std(np.concatenate([each.z for each in found])) == pytest.approx(1.0, rel=0.25)
    for each in found:
        scopes = {scope.kind: scope for scope in each.scopes}
        assert 0.005 < scopes["frequency"].half < 0.05
        assert 0.02 < scopes["deflection"].half < 0.2


def test_an_arm_that_is_unlike_the_model_is_missed_where_it_was_not_measured():
    """A fifth more mass at the fingers than the arm file says: stiffnesses make up for it, but not at all postures."""
    other = lcd_arm().replace({"link1.com.x": 0.2, "fingers.mass": 1.6 * lcd_arm().get("fingers.mass")})
    assert validated(simulated(np.random.default_rng(1), other)).missed


@pytest.mark.parametrize(
    ("leave", "sizes"), [("posture", [5] * 4), ("kind", [16, 4]), ("row", [1] * 20), ("fraction", [4] * 5)]
)
def test_parts_hold_each_measurement_once(leave, sizes):
    parts = parts_of(CAMPAIGN, leave, seed=3)
    assert sorted(map(len, parts.values())) == sorted(sizes)
    assert sorted(place for places in parts.values() for place in places) == list(range(len(CAMPAIGN)))


def test_a_single_posture_can_not_be_left_out():
    alone = replace(CAMPAIGN, measurements=tuple(m for m in CAMPAIGN if m.posture == CAMPAIGN.postures[0]))
    fit = replace(fit_campaign(lcd_arm(), CAMPAIGN, starts=1), campaign=alone)
    with pytest.raises(InputError, match=r"leave: got posture, of which the campaign has 1, expected two parts"):
        validate_fit(fit, "posture")
