"""Moves of walkers: each leaves a distribution of known form as it is, and ensembles know nothing of each other."""

import emcee
import numpy as np
import pytest
from emcee.moves import DEMove, StretchMove

from ident.inference.sample import Apart, Independent, InReciprocals

POSITIVE = np.array([True, True, False])
SD = np.array([0.5, 0.9, 0.7])
ROOT = np.array([[1.0, 0.0, 0.0], [0.6, 0.8, 0.0], [-0.3, 0.5, 0.8]]) * SD[:, None]


def log_density(theta):
    return -(np.linalg.solve(ROOT, theta.T) ** 2).sum(0) / 2


@pytest.mark.parametrize(
    ("move", "walkers"),
    [
        (InReciprocals(DEMove(), POSITIVE), 1500),
        (InReciprocals(StretchMove(), POSITIVE), 6000),
        (Independent(np.array([0.05, -0.1, 0.1]), 1.2 * ROOT @ ROOT.T, POSITIVE), 6000),
    ],
    ids=["differences in reciprocals", "stretches in reciprocals", "independent"],
)
def test_a_move_keeps_a_normal_distribution(move, walkers):
    """From so many exact draws on: moments stay within 4 standard errors; a factor forgotten moves the mean by 0.3 sd.

    Differences cost the square of the number of walkers; 4 standard errors of 1500 are 0.1 sd.
    """
    rng = np.random.default_rng(1)
    start = rng.standard_normal((walkers, 3)) @ ROOT.T
    sampler = emcee.EnsembleSampler(walkers, 3, log_density, vectorize=True, moves=move)
    state = emcee.State(start, random_state=np.random.RandomState(2).get_state())
    end = sampler.run_mcmc(state, 15, skip_initial_state_check=True).coords
    assert 0.1 < sampler.acceptance_fraction.mean() < 0.9
    covariance = ROOT @ ROOT.T
    assert np.abs(end.mean(0) / SD).max() < 4 / np.sqrt(walkers)
    assert np.abs((np.cov(end.T) - covariance) / np.outer(SD, SD)).max() < 4 * np.sqrt(2 / walkers)


def test_ensembles_side_by_side_know_nothing_of_each_other():
    """Two ensembles a thousand apart stay where they are, and each mixes as it does alone.

    Of 24000 draws some 800 are independent, so that 0.1 is four standard errors of a deviation.
    """
    rng = np.random.default_rng(3)
    near = rng.standard_normal((40, 3)) @ ROOT.T
    centre = np.repeat([0.0, 1000.0], 40)[:, None]

    def both(points):
        return np.maximum(log_density(points), log_density(points - 1000.0))

    moves = [(Apart([DEMove(), DEMove()]), 0.5), (Apart([StretchMove(), StretchMove()]), 0.5)]
    sampler = emcee.EnsembleSampler(80, 3, both, vectorize=True, moves=moves)
    start = emcee.State(np.tile(near, (2, 1)) + centre, random_state=np.random.RandomState(4).get_state())
    sampler.run_mcmc(start, 800, skip_initial_state_check=True)
    off = sampler.get_chain()[200:] - centre
    for own in np.split(off, 2, axis=1):
        np.testing.assert_allclose(own.reshape(-1, 3).std(0), np.sqrt(np.diag(ROOT @ ROOT.T)), rtol=0.1)
    assert sampler.acceptance_fraction.min() > 0.1
