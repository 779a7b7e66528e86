"""Which two values of a linear model were exchanged, against the least squares of every exchange."""

import tracemalloc
from itertools import combinations

import jax.numpy as jnp
import numpy as np
import pytest

from ident.inference.exchange import exchanges
from ident.inference.fit import fit
from ident.inference.parameters import Parameter, Parameters
from ident.inference.problem import InverseProblem

COUNT, UNKNOWNS = 12, 3
PAIRS = list(combinations(range(COUNT), 2))


def problem_of(A, measured, sigma):
    items = tuple(Parameter((f"p{i}",), False, 0.0, 0.0, prior_sd=5.0) for i in range(A.shape[1]))
    model = lambda p: jnp.asarray(A) @ jnp.stack([p[f"p{i}"] for i in range(A.shape[1])])  # noqa: E731
    return InverseProblem(model, jnp.asarray(measured), jnp.asarray(sigma), Parameters(items), ("value",) * len(A))


def least(A, measured, sigma, pair):
    """Chi-squared of the data where data and priors together cost least, by numpy."""
    order = np.arange(len(measured))
    order[list(pair)] = pair[::-1]
    measured, sigma = measured[order], sigma[order]
    whole = np.vstack([A / sigma[:, None], np.eye(A.shape[1]) / 5.0])
    theta = np.linalg.lstsq(whole, np.concatenate([measured / sigma, np.zeros(A.shape[1])]), rcond=None)[0]
    return float((((measured - A @ theta) / sigma) ** 2).sum())


@pytest.mark.parametrize("seed", range(4))
def test_the_exchange_that_was_made_is_found_with_its_chi_squared(seed):
    rng = np.random.default_rng(seed)
    A, sigma = rng.normal(size=(COUNT, UNKNOWNS)), rng.uniform(0.01, 0.05, COUNT)
    measured = A @ rng.normal(size=UNKNOWNS) + sigma * rng.normal(size=COUNT)
    i, j = max(PAIRS, key=lambda pair: abs(measured[pair[0]] - measured[pair[1]]))
    measured[[i, j]], sigma[[i, j]] = measured[[j, i]], sigma[[j, i]]
    found = fit(problem_of(A, measured, sigma), starts=1)
    assert found.improbable
    named = exchanges(found, PAIRS)
    assert named[0].rows == (i, j)
    assert named[0].chi_squared == pytest.approx(least(A, measured, sigma, (i, j)), rel=1e-6)
    costs = {pair: least(A, measured, sigma, pair) for pair in PAIRS}
    assert named[0].rows == min(costs, key=costs.get)
    assert [each.chi_squared for each in named] == sorted(each.chi_squared for each in named)
    assert all(each.chi_squared == pytest.approx(costs[each.rows], rel=1e-6) for each in named)


def test_a_value_that_is_merely_wrong_is_no_exchange():
    rng = np.random.default_rng(9)
    A, sigma = rng.normal(size=(COUNT, UNKNOWNS)), np.full(COUNT, 0.02)
    measured = A @ rng.normal(size=UNKNOWNS) + sigma * rng.normal(size=COUNT)
    measured[3] += 40 * sigma[3]
    found = fit(problem_of(A, measured, sigma), starts=1)
    assert found.outliers.any()
    assert exchanges(found, PAIRS) == ()
    assert exchanges(found, []) == ()


def test_all_pairs_of_a_long_campaign_are_compared_in_little_memory():
    """45000 pairs of 300 values, whose matrices at once took 220 MB."""
    rng = np.random.default_rng(3)
    A, sigma = rng.normal(size=(300, 10)), np.full(300, 0.02)
    measured = A @ rng.normal(size=10) + sigma * rng.normal(size=300)
    measured[[270, 290]] = measured[[290, 270]]
    found, pairs = fit(problem_of(A, measured, sigma), starts=1), list(combinations(range(300), 2))
    tracemalloc.start()
    named = exchanges(found, pairs)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert named[0].rows == (270, 290)
    assert peak < 50e6
