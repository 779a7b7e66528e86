"""Simulation-based calibration of a model with a closed form; that of the arm is tests/benchmarks/calibration.py."""

import numpy as np
import pytest
from chains import linear_problem
from sbc import L, Recovery, judge, recover

from ident.inference.sample import Settings

pytestmark = pytest.mark.slow

PROBLEM, _, _ = linear_problem()
SETTINGS = Settings(walkers=6, max_steps=50, target_ess=np.inf)
"""A linear model's starting points are draws of its posterior already, so that one block is enough."""


def recoveries(truths: int, noise: float) -> list[Recovery]:
    return [recover(PROBLEM, draw, 0, SETTINGS, starts=1, spread=1.0, noise=noise, longer=1) for draw in range(truths)]


def test_right_sigmas_are_calibrated():
    found = judge(recoveries(24, 1.0))
    assert found.uniform
    assert found.covers


def test_data_four_times_as_scattered_as_their_sigmas_are_not():
    assert not judge(recoveries(10, 4.0)).covers


@pytest.mark.parametrize(("tilt", "uniform"), [(1.0, True), (0.6, False), (1.6, False)])
def test_ranks_that_lean_to_a_side_are_told(tilt, uniform):
    """200 ranks of one parameter, u^tilt of uniform u."""
    u = np.random.default_rng(1).uniform(size=(200, 3)) ** [1.0, 1.0, tilt]
    few = [
        Recovery(i, [], np.floor((L + 1) * x).astype(int).tolist(), x.tolist(), 1, 1, [1.0], False, False, 1.0, 1.0, 1)
        for i, x in enumerate(u)
    ]
    found = judge(few)
    assert found.bins == 20
    assert found.uniform == uniform
