"""What has changed between two fits: closed forms on linear models, and how often it is said where nothing has."""

import jax.numpy as jnp
import numpy as np
import pytest
from chains import Linear
from conformance import agrees
from scipy.stats import gamma, kstest

from ident.inference.change import LEVEL, WIDE, change, moments, power
from ident.inference.fit import fit
from ident.inference.parameters import Parameter, Parameters
from ident.inference.problem import InverseProblem

NAMES = ("a", "b", "c")
PRIOR = 0.8


def problem(matrix, values, sigma=0.1, names=NAMES):
    """Values that are linear in theta, the logarithm of each parameter."""
    model = Linear(jnp.asarray(matrix, float), names, logarithms=True)
    items = tuple(Parameter((name,), True, 1.0, 1.0, PRIOR) for name in names)
    return InverseProblem(model, values, np.full(len(values), sigma), Parameters(items), ("x",) * len(values))


def fits(matrices, values, sigma=0.1):
    return [fit(problem(A, y, sigma), starts=1) for A, y in zip(matrices, values, strict=True)]


@pytest.fixture(scope="module")
def matrices():
    rng = np.random.default_rng(3)
    return rng.standard_normal((5, 3)), rng.standard_normal((2, 3))


def closed(matrices, values, sigma=0.1):
    """The joint least squares of mean and changes, written out: estimate, covariance, least cost with and without."""
    A, B = (np.asarray(M) / sigma for M in matrices)
    y = np.concatenate([np.asarray(v) / sigma for v in values] + [np.zeros(6)])
    eye, none = np.eye(3), np.zeros((3, 3))
    rows = np.block([[A, -A / 2], [B, B / 2], [eye / PRIOR, none], [none, eye / WIDE]])
    found = np.linalg.lstsq(rows, y)[0]
    still = rows[:, :3]
    alike = np.linalg.lstsq(still, y)[0]
    T = np.sum((still @ alike - y) ** 2) - np.sum((rows @ found - y) ** 2)
    return found, np.linalg.inv(rows.T @ rows)[3:, 3:], T


def test_changes_are_those_of_the_joint_least_squares(matrices):
    values = [np.array([0.3, -0.1, 0.2, 0.5, 0.0]), np.array([0.6, -0.4])]
    found = change(*fits(matrices, values), NAMES)
    joint, covariance, T = closed(matrices, values)
    source = "joint least squares, written out"
    agrees(found.change, joint[3:], "inference", "changes between two fits", source, atol=1e-6)
    agrees(found.covariance, covariance, "inference", "covariance of changes", source, rtol=1e-6)
    agrees(found.statistic, T, "inference", "chi-squared of a change", source, rtol=1e-6)
    assert np.log(found.second / found.first) == pytest.approx(found.change, abs=1e-9)
    assert np.log(found.first * found.second) / 2 == pytest.approx(joint[:3], abs=1e-6)
    assert found.mean == pytest.approx(3 - np.trace(covariance) / WIDE**2, rel=1e-6)


def test_a_parameter_that_does_not_change_is_shared(matrices):
    """Known not to change, b is told by both data sets, as if it were one parameter of both."""
    values = [np.array([0.3, -0.1, 0.2, 0.5, 0.0]), np.array([0.6, -0.4])]
    found = change(*fits(matrices, values), ("a", "c"))
    A, B = matrices[0] / 0.1, matrices[1] / 0.1
    keep = [0, 2]
    eye = np.eye(3)
    rows = np.block(
        [[A, -A[:, keep] / 2], [B, B[:, keep] / 2], [eye / PRIOR, np.zeros((3, 2))], [np.zeros((2, 3)), np.eye(2)]]
    )
    y = np.concatenate([values[0] / 0.1, values[1] / 0.1, np.zeros(5)])
    what, source = "changes with a shared parameter", "joint least squares, NumPy"
    agrees(found.change, np.linalg.lstsq(rows, y)[0][3:], "inference", what, source, atol=1e-6)


@pytest.mark.slow
def test_where_nothing_has_changed_it_is_seldom_said_and_a_change_is_found(matrices):
    """Rates over 30 simulated pairs, truths from the prior: p of 20 uniform, and one change of each of 10."""
    rng, both = np.random.default_rng(11), (matrices[0], 2 * matrices[0])
    p, changed, single = [], [], []
    for k in range(30):
        theta, real = PRIOR * rng.standard_normal(3), k % 3 == 2
        moved = theta + (np.array([0.0, 0.0, 0.6]) if real else 0.0)
        values = [A @ t + 0.1 * rng.standard_normal(len(A)) for A, t in zip(both, (theta, moved), strict=True)]
        found = change(*fits(both, values), NAMES)
        (changed if real else p).append(found.changed if real else found.p_value)
        if not real:
            single.append(found.change / found.under_none)
    assert kstest(p, "uniform").pvalue > 0.01
    assert np.std(single) == pytest.approx(1.0, rel=0.3)
    share = np.mean(changed, axis=0)
    assert share[2] > 0.9
    assert (share[:2] < 0.25).all()


def test_the_one_change_that_explains_all_is_told_from_those_that_do_not(matrices):
    rng = np.random.default_rng(2)
    moved = np.array([0.1, -0.2, 0.7])
    both = (matrices[0], matrices[0])
    values = [A @ t + 0.1 * rng.standard_normal(5) for A, t in zip(both, (moved * [1, 1, 0], moved), strict=True)]
    found = change(*fits(both, values), NAMES)
    assert found.alone[2] > 0.05
    assert (found.alone[:2] < 1e-3).all()


def test_data_that_see_nothing_tell_no_change():
    blind = np.zeros((2, 3))
    found = change(*fits((blind, blind), [np.zeros(2), np.full(2, 0.05)]), NAMES)
    assert found.p_value == 1.0
    assert found.open.all()
    assert not found.changed.any()


@pytest.mark.parametrize("scale", [1e4, 300.0, 20.0, 0.5])
def test_the_power_is_the_share_of_simulated_changes_that_are_seen(scale):
    """Scores g of a linear problem drawn with the change d: T = g' (S + I)^-1 g, against the limit of its moments."""
    rng = np.random.default_rng(5)
    A = rng.standard_normal((6, 3))
    seen, d = scale * A.T @ A, np.array([0.0, 1.2 / np.sqrt(scale), 0.0])
    g = rng.multivariate_normal(seen @ d, seen, 40_000)
    T = np.einsum("ni,ni->n", g, np.linalg.solve(seen + np.eye(3) / WIDE**2, g.T).T)
    mean, variance = moments(seen)
    share = np.mean(gamma.isf(LEVEL, mean**2 / variance, scale=variance / mean) < T)
    assert 0.1 < share < 0.95
    assert power(seen, d) == pytest.approx(share, abs=0.01 if scale > 10 else 0.03)
    assert power(seen, 0 * d) == pytest.approx(LEVEL, abs=1e-9)


def test_data_that_see_nothing_have_no_power():
    assert power(np.zeros((2, 2)), np.ones(2)) == 0.0
