"""Which two values of a linear model were exchanged, against the least squares of every exchange."""

import tracemalloc
from dataclasses import replace
from itertools import combinations

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from conformance import agrees

from ident.inference.fit import fit
from ident.inference.parameters import Parameter, Parameters
from ident.inference.problem import InverseProblem, correlation
from ident.inference.scrutiny import exchanges

COUNT, UNKNOWNS = 12, 3
PAIRS = list(combinations(range(COUNT), 2))


POSTURES = ((0, 3, 5, 6, 9), (1, 2, 4, 7, 11))
"""Rows whose errors have a part in common; two rows are in no group."""


class Linear(eqx.Module):
    """One program for all values."""

    A: np.ndarray

    def __call__(self, p):
        return jnp.asarray(self.A) @ jnp.stack([p[f"p{i}"] for i in range(self.A.shape[1])])


def swap(pair):
    return {pair[0]: pair[1], pair[1]: pair[0]}


@pytest.mark.parametrize(("off", "named"), [(0.0, [(0, 1)]), (3.5, [])])
def test_an_exchange_after_which_a_kind_contradicts_the_others_explains_nothing(off, named):
    """By 3.4 sd: not enough for one value of nine (3.6), enough for one kind of two (3.2)."""
    A = np.ones((9, 1))
    A[1] = 2.0
    measured = 5.0 * A[:, 0]
    measured[[0, 1]] = measured[[1, 0]]
    measured[8] += 0.5 * off
    problem = replace(problem_of(A, measured, np.full(9, 0.5)), kinds=("x",) * 8 + ("y",))
    found = exchanges(fit(problem, starts=1), list(combinations(range(8), 2)), [], swap)
    assert [each.rows for each in found][:1] == named


def common(share, groups=POSTURES, count=COUNT):
    """The correlation of errors of which a share of the variance is common to each group."""
    R = np.eye(count)
    for rows in groups:
        R[np.ix_(rows, rows)] += share * (1 - np.eye(len(rows)))
    return R


def problem_of(A, measured, sigma, R=None, groups=POSTURES):
    items = tuple(Parameter((f"p{i}",), False, 0.0, 0.0, prior_sd=5.0) for i in range(A.shape[1]))
    own = None if R is None else correlation([(g, R[np.ix_(g, g)]) for g in groups], np.ones(len(A), bool))
    kinds = ("value",) * len(A)
    return InverseProblem(Linear(A), jnp.asarray(measured), jnp.asarray(sigma), Parameters(items), kinds, own)


def least(A, measured, sigma, pair, R=None):
    """Chi-squared of the data where data and priors together cost least, by numpy."""
    order = np.arange(len(measured))
    order[list(pair)] = pair[::-1]
    measured, sigma = measured[order], sigma[order]
    R = np.eye(len(A)) if R is None else R[np.ix_(order, order)]
    independent = np.linalg.inv(np.linalg.cholesky(R)) / sigma
    whole = np.vstack([independent @ A, np.eye(A.shape[1]) / 5.0])
    theta = np.linalg.lstsq(whole, np.concatenate([independent @ measured, np.zeros(A.shape[1])]), rcond=None)[0]
    return float(((independent @ (measured - A @ theta)) ** 2).sum())


@pytest.mark.parametrize("share", [0.0, 0.5])
@pytest.mark.parametrize("seed", range(4))
def test_the_exchange_that_was_made_is_found_with_its_chi_squared(seed, share):
    rng, R = np.random.default_rng(seed), common(share)
    A, sigma = rng.normal(size=(COUNT, UNKNOWNS)), rng.uniform(0.01, 0.05, COUNT)
    measured = A @ rng.normal(size=UNKNOWNS) + sigma * (np.linalg.cholesky(R) @ rng.normal(size=COUNT))
    i, j = max(PAIRS, key=lambda pair: abs(measured[pair[0]] - measured[pair[1]]))
    measured[[i, j]], sigma[[i, j]] = measured[[j, i]], sigma[[j, i]]
    found = fit(problem_of(A, measured, sigma, R if share else None), starts=1)
    assert found.improbable
    named = exchanges(found, PAIRS, (), swap)
    assert named[0].rows == (i, j)
    expected, what = least(A, measured, sigma, (i, j), R), "chi-squared with two values swapped back"
    agrees(named[0].chi_squared, expected, "inference", what, "least squares of the swap, NumPy", rtol=1e-6)
    costs = {pair: least(A, measured, sigma, pair, R) for pair in PAIRS}
    assert named[0].rows == min(costs, key=costs.get)
    assert [each.chi_squared for each in named] == sorted(each.chi_squared for each in named)
    assert all(each.chi_squared == pytest.approx(costs[each.rows], rel=1e-6) for each in named)


def test_swapped_values_are_found_as_often_where_errors_have_a_part_in_common():
    """Four postures of four values, two of one posture exchanged: no power is lost beside independent errors."""
    groups = [tuple(range(4 * k, 4 * k + 4)) for k in range(4)]
    rng, first = np.random.default_rng(7), np.random.default_rng(1).normal(size=(16, UNKNOWNS))
    pairs, sigma, named = [pair for g in groups for pair in combinations(g, 2)], np.full(16, 0.05), {0.0: 0, 0.5: 0}
    for _ in range(30):
        truth, noise = rng.normal(size=UNKNOWNS), rng.normal(size=16)
        i, j = min(pairs, key=lambda pair: abs(abs(first[pair[0]] @ truth - first[pair[1]] @ truth) - 0.3))
        for share in named:
            R = common(share, groups, 16)
            measured = first @ truth + sigma * (np.linalg.cholesky(R) @ noise)
            measured[[i, j]] = measured[[j, i]]
            found = fit(problem_of(first, measured, sigma, R, groups), starts=1)
            odd = found.improbable or found.outliers.any()
            best = exchanges(found, pairs, (), swap)[:1] if odd else ()
            named[share] += bool(best and best[0].rows == (i, j))
    assert 7 < named[0.0] < 30, "neither hopeless nor certain"
    assert named[0.5] >= named[0.0]


def test_a_value_that_is_merely_wrong_is_no_exchange():
    rng = np.random.default_rng(9)
    A, sigma = rng.normal(size=(COUNT, UNKNOWNS)), np.full(COUNT, 0.02)
    measured = A @ rng.normal(size=UNKNOWNS) + sigma * rng.normal(size=COUNT)
    measured[3] += 40 * sigma[3]
    found = fit(problem_of(A, measured, sigma), starts=1)
    assert found.outliers.any()
    assert exchanges(found, PAIRS, (), swap) == ()
    assert exchanges(found, [], (), swap) == ()


@pytest.mark.slow
def test_all_pairs_of_a_long_campaign_are_compared_in_little_memory():
    """45000 pairs of 300 values, whose matrices at once took 220 MB."""
    rng = np.random.default_rng(3)
    A, sigma = rng.normal(size=(300, 10)), np.full(300, 0.02)
    measured = A @ rng.normal(size=10) + sigma * rng.normal(size=300)
    measured[[270, 290]] = measured[[290, 270]]
    found, pairs = fit(problem_of(A, measured, sigma), starts=1), list(combinations(range(300), 2))
    tracemalloc.start()
    named = exchanges(found, pairs, (), swap)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert named[0].rows == (270, 290)
    assert peak < 50e6
