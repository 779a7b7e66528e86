"""Damping ratios against frequencies and deflections: alone they say little of which mode is which."""

from dataclasses import replace

import numpy as np
import pytest
from arms import DATA, lcd_arm

from ident.identify.problem import pose
from ident.identify.unknowns import Unknowns
from ident.inference.fit import contradicting, cross_predictions
from ident.inference.search import evaluate, solve
from ident.measure import Campaign, Measurement, read_campaign

POSTURES = (38.2, 16.2, 2.5)
RELATIVE = {"frequency": 0.005, "deflection": 0.005, "damping_ratio": 0.05}
pytestmark = pytest.mark.slow


def test_damping_ratios_are_compared_at_the_modes_that_all_data_choose():
    """Alone they would lead to stiffnesses where another naming is more probable, and fit no better than with all."""
    rows = _rows()
    problem = pose(lcd_arm(), Campaign(measurements=rows), Unknowns()).problem
    rng = np.random.default_rng(9)
    start = np.asarray(problem.parameters.theta(problem.parameters.column("start")))
    truth = start + rng.standard_normal(len(start)) * np.minimum(problem.parameters.normal_sd, 0.15)
    values = evaluate(problem, truth).predicted
    sigma = np.array([RELATIVE[m.kind] for m in rows]) * values
    values = values + sigma * rng.standard_normal(len(values))
    measured = (replace(m, value=float(v), sigma=float(s)) for m, v, s in zip(rows, values, sigma, strict=True))
    problem = pose(lcd_arm(), Campaign(measurements=tuple(measured)), Unknowns()).problem
    found, _ = cross_predictions(problem, [np.asarray(solve(problem, truth).theta)])
    assert {each.kind for each in found} == set(RELATIVE)
    assert all(each.statistic > 0.1 for each in found)
    assert not contradicting(found)


def _rows():
    own = list(read_campaign(DATA / "lcd_arm" / "campaign.csv"))[:5]
    named = [m for m in own if m.mode]
    ratios = [Measurement(kind="damping_ratio", posture=m.posture, value=0.01, sigma=0.001, mode=m.mode) for m in named]
    angles = np.radians(POSTURES)
    return tuple(replace(m, posture=(a, -2 * a, a)) for a in angles.tolist() for m in (*own, *ratios))
