"""Campaigns of many states: predicted part by part, searched among a part first; the same answers as all at once."""

import equinox as eqx
import jax
import jax.numpy as jnp
import large
import numpy as np
import pytest
from arms import lcd_arm
from scipy.optimize import least_squares

from ident.identify.fit import fit_campaign
from ident.identify.padding import LARGE, SEVERAL
from ident.identify.problem import pose
from ident.identify.unknowns import Unknowns
from ident.inference.search import SHORT, evaluate, look
from ident.measure import Campaign, Load, Measurement

pytestmark = pytest.mark.slow

STATES = LARGE + 88
KILOGRAMS = Load.parse("5 kg @ tip")


def measurement(i):
    """One in each state; among them few differences, and some without a label."""
    alpha = np.deg2rad(80.0 * i / STATES)
    at = {"posture": (alpha, -2 * alpha, alpha), "value": 0.01}
    if i % 150 == 11:
        return Measurement(kind="deflection_difference", point="tip", sigma=1e-4, load=KILOGRAMS, **at)
    if i % 150 == 13:
        about = {"direction": (0, 1, 0), "load": KILOGRAMS} | at
        return Measurement(
            kind="rotation_difference" if i % 300 == 13 else "rotation", point="tip", sigma=1e-4, **about
        )
    if i % 5 == 0:
        return Measurement(kind="deflection", point="tip", sigma=5e-4, **at)
    names = {1: "vertical bending 1", 2: "lateral torsion 1", 3: "vertical bending 2"}
    return Measurement(kind="frequency", sigma=0.02, mode=names.get(i % 5), **at)


@eqx.filter_jit
def whole(problem, theta):
    """All values and their derivatives by theta, in one program."""
    return problem.predict(theta), jax.jacfwd(problem.predict)(theta)


@pytest.fixture(scope="module")
def campaign():
    return Campaign(measurements=tuple(measurement(i) for i in range(STATES)))


def unseen(problem):
    """The problem in which no value counts, so that labels alone name modes."""
    return eqx.tree_at(lambda p: p.sigma, problem, np.full(len(problem.kinds), np.inf))


def test_parts_predict_what_the_whole_does(campaign):
    problem = pose(lcd_arm(), campaign, Unknowns(discrepancy={"deflection": 0.1})).problem
    large, start = problem.in_parts, problem.parameters.theta(problem.parameters.column("start"))
    assert len(large.problems) > 3
    assert len({jax.tree.structure(each) for each in large.problems}) == 1, "one program serves all"
    predicted, jacobian = whole(unseen(problem), jnp.asarray(start))
    found = evaluate(problem)
    np.testing.assert_allclose(found.predicted, predicted, rtol=1e-10)
    np.testing.assert_allclose(found.jacobian, jacobian, rtol=1e-8, atol=1e-10)


def test_the_first_part_has_some_of_all_that_was_measured(campaign):
    problem = pose(lcd_arm(), campaign).problem
    first = problem.in_parts.problems[0]
    counts = dict(zip(*np.unique(np.array(first.kinds)[np.isfinite(first.sigma)], return_counts=True), strict=True))
    for kind in set(problem.kinds):
        assert counts[kind] >= min(SEVERAL, problem.kinds.count(kind)), kind


def test_the_fit_of_many_postures_is_that_of_all_rows(monkeypatch):
    """Beside SciPy, to which all rows count at once; what parts predict, and their slope, is the whole's: see above."""
    monkeypatch.setattr("ident.identify.padding.LARGE", 100)
    monkeypatch.setattr("ident.identify.padding.PART", 32)
    measured = large.campaign(lcd_arm(), 128, 128)
    found = fit_campaign(lcd_arm().replace({"joint1.k_tors": 3e5, "joint2.k_bend": 4e5}), measured, starts=1)
    problem = found.problem
    assert len(problem.in_parts.problems) == 4

    def weighed(theta):
        here = look(problem, theta, found.choice.held)
        return problem.weigh(np.asarray(here.predicted), np.asarray(here.jacobian), theta)

    there = least_squares(
        lambda x: weighed(x)[0], found.best.theta + 0.01, jac=lambda x: weighed(x)[1], x_scale="jac", xtol=1e-14
    )
    assert found.best.converged
    assert found.best.cost == pytest.approx(2 * there.cost, abs=10 * SHORT**2)
    assert np.abs((found.best.theta - there.x) / found.best.sd).max() < SHORT
    assert not found.doubts
    sd = np.sqrt(np.diag(np.linalg.inv(there.jac.T @ there.jac)))
    np.testing.assert_allclose(found.best.sd, sd, rtol=SHORT)
