"""Score tests and shifts, against fits of linear models in which the amount is a parameter."""

import math

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.stats import kstest, norm

from ident.inference.fit import fit
from ident.inference.parameters import Parameter, Parameters
from ident.inference.problem import InverseProblem
from ident.inference.score import asked_for, score_tests

pytestmark = pytest.mark.slow


class Linear(eqx.Module):
    """Values A @ (a, b, ...)."""

    A: jnp.ndarray

    def __call__(self, parameters):
        return self.A @ jnp.stack([parameters[name] for name in "abcd"[: self.A.shape[1]]])


def fitted(A, measured, sigma, prior_sd, kinds=None):
    count = A.shape[1]
    items = tuple(Parameter((name,), False, 0.0, 0.0, sd) for name, sd in zip("abcd"[:count], prior_sd, strict=True))
    kinds = kinds or ("value",) * len(A)
    problem = InverseProblem(
        Linear(jnp.asarray(A)), jnp.asarray(measured), jnp.asarray(sigma), Parameters(items), kinds
    )
    return fit(problem, starts=1)


@pytest.fixture(scope="module")
def linear():
    rng = np.random.default_rng(5)
    A, d = rng.normal(size=(9, 2)), rng.normal(size=9)
    sigma, measured = rng.uniform(0.5, 2.0, 9), rng.normal(size=9) * 2
    return A, d, sigma, measured


@pytest.mark.parametrize("prior", [(math.inf, math.inf), (0.5, 2.0)])
def test_of_a_linear_model_the_score_is_the_amount_that_fits_best_in_its_own_sd(linear, prior):
    A, d, sigma, measured = linear
    (test,) = score_tests(fitted(A, measured, sigma, prior), d[None], np.array([0.3]), [False])
    whole = fitted(np.column_stack([A, d]), measured, sigma, (*prior, math.inf))
    amount, sd = whole.best.theta[2], whole.information.sd[2]
    assert test.sd == pytest.approx(sd, rel=1e-9)
    assert test.z * test.sd == pytest.approx(amount, rel=1e-7)
    assert test.p_value == pytest.approx(2 * norm.sf(abs(amount / sd)), rel=1e-6)


def test_the_shift_is_how_the_fit_moves_where_the_amount_is_modelled(linear):
    A, d, sigma, measured = linear
    without = fitted(A, measured, sigma, (0.5, 2.0))
    (test,) = score_tests(without, d[None], np.array([0.3]), [False])
    # data from which the amount is taken off are those that the model without it sees
    within = fitted(A, measured - 0.3 * d, sigma, (0.5, 2.0))
    np.testing.assert_allclose(test.shift, within.best.theta - without.best.theta, rtol=1e-7)


def test_what_the_parameters_can_make_up_for_cannot_be_told(linear):
    A, d, sigma, measured = linear
    changes = np.array([A @ [2.0, -1.0], d, np.zeros(9)])
    series, other, nothing = score_tests(fitted(A, measured, sigma, (1.0, 1.0)), changes, np.ones(3), [True] * 3)
    assert (series.separable, other.separable, nothing.separable) == (False, True, False)
    assert (series.seen, nothing.seen) == (True, False)
    assert math.isnan(series.p_value)
    np.testing.assert_allclose(nothing.shift, 0.0)
    (late,) = score_tests(fitted(A[:, :1], measured, sigma, (1.0,)), changes[:1], np.ones(1), [True])
    assert late.separable, "once it is not fitted"


def test_an_amount_that_cannot_be_negative_is_asked_for_above_zero_only(linear):
    A, d, sigma, _ = linear
    for sign in (1, -1):
        found = fitted(A, sign * 3.0 * d, sigma / 10, (1.0, 1.0))
        one, two = score_tests(found, np.array([d, d]), np.ones(2), [True, False])
        assert one.z == two.z
        assert asked_for([two]) == (0,)
        assert asked_for([one]) == ((0,) if sign > 0 else ())


def test_the_amount_that_is_there_is_asked_for_most(linear):
    A, _, sigma, _ = linear
    changes = np.random.default_rng(2).normal(size=(4, 9))
    found = fitted(A, 2.0 * changes[2], sigma / 10, (1.0, 1.0))
    assert asked_for(score_tests(found, changes, np.ones(4), [False] * 4))[0] == 2


def test_kinds_whose_derivatives_are_not_known_do_not_count(linear):
    A, d, sigma, measured = linear
    kinds = ("value",) * 6 + ("other",) * 3
    all_of_them = fitted(A, measured, sigma, (1.0, 1.0), kinds)
    (part,) = score_tests(all_of_them, d[None], np.ones(1), [False], np.array(kinds) == "other")
    Q, _ = np.linalg.qr(np.vstack([A[:6] / sigma[:6, None], np.eye(2)]))
    scaled = np.concatenate([d[:6] / sigma[:6], [0, 0]])
    assert part.sd == pytest.approx(1 / np.linalg.norm(scaled - Q @ (Q.T @ scaled)), rel=1e-9)


def test_its_p_is_uniform_where_all_is_right_and_truths_come_from_the_prior():
    rng = np.random.default_rng(100)
    A, d = rng.normal(size=(8, 2)), rng.normal(size=8)
    chances = []
    for _ in range(300):
        measured = A @ (rng.normal(size=2) * [0.5, 2.0]) + rng.normal(size=8)
        chances.append(score_tests(fitted(A, measured, np.ones(8), (0.5, 2.0)), d[None], np.ones(1), [True])[0].p_value)
    assert kstest(chances, "uniform").pvalue > 0.01
