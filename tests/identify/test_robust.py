"""Robust weights: against SciPy's own robust least squares, and what they make of gross errors."""

from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest
from arms import DATA, lcd_arm
from scipy.optimize import least_squares

from ident.identify.fit import fit_campaign, units_of
from ident.identify.predict import vector_of, vectors_of
from ident.inference.fit import fit
from ident.inference.parameters import Parameter, Parameters
from ident.inference.problem import InverseProblem
from ident.inference.scrutiny import FREEDOM, HUBER, robust_weights, weighted
from ident.measure import Campaign, read_campaign

X = np.linspace(-1.0, 1.0, 15)
SIGMA = 0.1


def line(p):
    return p["a"] + p["b"] * jnp.asarray(X).reshape(-1, *(1,) * jnp.ndim(p["a"]))


def problem() -> InverseProblem:
    """A line through fifteen points, three of which are far off; no priors to speak of."""
    y = 0.4 + 1.2 * X + SIGMA * np.random.default_rng(3).standard_normal(15)
    y[[2, 7, 12]] += [1.0, -0.8, 1.5]
    items = tuple(Parameter((name,), False, 0.0, 0.0, 1e6) for name in "ab")
    return InverseProblem(line, jnp.asarray(y), jnp.full(15, SIGMA), Parameters(items), ("x",) * 15)


LOSSES = {
    "huber": lambda z: np.where(z < HUBER**2, z, 2 * HUBER * np.sqrt(z) - HUBER**2),
    "t": lambda z: (FREEDOM + 1) * np.log1p(z / FREEDOM),
}
"""Twice the loss of squared scaled residuals, as SciPy takes it."""


@pytest.mark.parametrize("loss", ["huber", "t"])
def test_the_optimum_is_that_of_the_loss(loss):
    """SciPy's minimum of the sum of losses, from the true values."""
    posed = problem()
    weights = robust_weights(fit(posed, starts=1), np.arange(15), loss)
    found = fit(weighted(posed, weights), starts=1).best.theta

    def cost(theta):
        z = ((theta[0] + theta[1] * X - np.asarray(posed.measured)) / SIGMA) ** 2
        return np.sqrt(LOSSES[loss](z))

    theirs = least_squares(cost, [0.4, 1.2], xtol=1e-12, ftol=1e-12, gtol=1e-12).x
    np.testing.assert_allclose(found, theirs, atol=2e-4)
    assert weights[[2, 7, 12]].max() < 0.2 < np.delete(weights, [2, 7, 12]).min()


@pytest.mark.slow
def test_a_gross_error_is_named_and_hardly_moves_the_answer():
    """One frequency of the shipped campaign 8 % off: least squares moves by sds, the robust fit by less than half."""
    campaign = read_campaign(DATA / "lcd_arm" / "campaign.csv")
    rows = list(campaign.measurements)
    rows[13] = replace(rows[13], value=1.08 * rows[13].value)
    wrong = Campaign(measurements=tuple(rows))
    right, plain = fit_campaign(lcd_arm(), campaign, starts=1), fit_campaign(lcd_arm(), wrong, starts=1)
    robust = fit_campaign(lcd_arm(), wrong, starts=1, robust="t")
    sd = right.information.sd
    assert np.abs((robust.best.theta - right.best.theta) / sd).max() < 0.5
    assert np.abs((plain.best.theta - right.best.theta) / sd).max() > 2
    assert np.flatnonzero(robust.suspicious).tolist() == [13]
    assert np.abs(robust.off[13]) > 10
    assert plain.doubts
    assert not robust.doubts


def test_components_of_a_vector_and_rows_of_a_group_are_one_unit():
    rows = read_campaign(DATA / "lcd_arm" / "campaign.csv").of_kind("deflection").measurements
    along = [replace(rows[0], setup="tracker", direction=d) for d in ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0))]
    campaign = Campaign(measurements=(*rows, *along))
    assert units_of(campaign).tolist() == [0, 1, 2, 3, 4, 4]
    assert vectors_of(campaign).tolist() == [0, 1, 2, 3, 4, 4]
    assert vectors_of(Campaign(measurements=rows)) is None
    assert vector_of(rows[0]) is None
    assert vector_of(replace(along[0], group="a")) == vector_of(along[1]), "rows of a group are judged each by itself"
