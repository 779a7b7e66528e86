"""Draws of a robot that the exact model weighs, against chains of emcee."""

from dataclasses import replace

import numpy as np
import pytest
from arms import DATA

from ident.description.file import read_arm
from ident.identify.fit import fit_campaign
from ident.identify.fleet import draws_under
from ident.identify.problem import pose
from ident.identify.sample import sample_campaign
from ident.identify.unknowns import Unknowns
from ident.inference.population import Under, Weights
from ident.inference.priors import Prior
from ident.inference.sample import Settings
from ident.measure import Campaign, read_campaign

pytestmark = pytest.mark.slow
ARM = read_arm(DATA / "lcd_arm" / "arm.toml").arm
FEW = Campaign(measurements=read_campaign(DATA / "lcd_arm" / "campaign.csv").measurements[:4])
"""So few that they leave a direction open."""


UNKNOWNS = Unknowns(fixed=("joint2.k_tors", "joint3.k_tors", "joint3.k_bend"), free={"link2.mass": 0.1})
"""Stiffnesses, and a number that the population knows nothing of."""


def case(width):
    names = [name for name in pose(ARM, FEW, UNKNOWNS).problem.parameters.names if ".k_" in name]
    nominal = np.log([float(ARM.get(name)) for name in names])
    return names, nominal + width / 2 * np.random.default_rng(1).standard_normal(len(names)), np.full(len(names), width)


@pytest.fixture(scope="module")
def weighed():
    _, mean, sd = case(0.1)
    return moments(draws_under(ARM, FEW, UNKNOWNS, Under(mean, 2 * sd, 0.05), seed=2), mean, sd)


def moments(drawn, mean, sd):
    """Return mean and sd under a normal population, and how many draws these are worth."""
    log_weights = -(((drawn.theta - mean) / sd) ** 2).sum(1) / 2 - drawn.log_prior
    weights = np.exp(log_weights - log_weights.max())
    weights /= weights.sum()
    centre = weights @ drawn.theta
    return centre, np.sqrt(weights @ (drawn.theta - centre) ** 2), 1 / (weights**2).sum()


def test_weighed_draws_are_those_of_emcee(weighed):
    names, mean, _ = case(0.1)
    centre, spread, worth = weighed
    assert worth > 500
    priors = {name: Prior.log_normal(float(np.exp(m)), 0.1) for name, m in zip(names, mean, strict=True)}
    fitted = fit_campaign(ARM, FEW, replace(UNKNOWNS, priors=priors), starts=1)
    chains = sample_campaign(fitted, settings=Settings(target_ess=2000.0, seed=3))
    places = [chains.sample.posterior.parameters.names.index(name) for name in names]
    theirs = chains.sample.draws()[:, places]
    assert (np.abs(centre - theirs.mean(0)) < 4 * theirs.std(0) * np.sqrt(1 / 2000 + 1 / worth)).all()
    np.testing.assert_allclose(spread, theirs.std(0), rtol=0.15)


def test_chains_draw_where_weights_do_not(weighed, monkeypatch):
    _, mean, sd = case(0.1)
    monkeypatch.setattr("ident.identify.fleet.weighed", lambda *_: Weights(1.0, 10.0, 0.1))
    drawn = draws_under(ARM, FEW, UNKNOWNS, Under(mean, 2 * sd, 0.05), seed=2)
    assert 1000 <= len(drawn.theta) < 2000
    chains = moments(drawn, mean, sd)
    assert (np.abs(chains[0] - weighed[0]) < 4 * weighed[1] * np.sqrt(1 / weighed[2] + 1 / chains[2])).all()
    np.testing.assert_allclose(chains[1], weighed[1], rtol=0.25)


def test_a_robot_that_is_no_such_robot_has_no_draws():
    """A population so soft that the arm's own values can't be of it."""
    _, mean, sd = case(0.1)
    assert draws_under(ARM, FEW, UNKNOWNS, Under(mean - 8, sd, 0.05), seed=2) is None
