"""Score tests and shifts, against fits of linear models in which the amount is a parameter, or a value may be off."""

import math
from dataclasses import replace

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from conformance import agrees, counted
from scipy.stats import binom, chi2, norm

from ident.inference.fit import fit
from ident.inference.information import asked_for, blamed, farthest, row_tests, score_tests
from ident.inference.parameters import Parameter, Parameters
from ident.inference.problem import InverseProblem, correlation


class Linear(eqx.Module):
    """Values A @ (a, b, ...)."""

    A: jnp.ndarray

    def __call__(self, parameters):
        return self.A @ jnp.stack([parameters[name] for name in "abcd"[: self.A.shape[1]]])


MOST = 3
"""Unknowns of every fit: what is missing is filled up with some that nothing depends on, so that one program does."""


def fitted(A, measured, sigma, prior_sd):
    """Fit nine values, as of all tests here that search."""
    more = MOST - A.shape[1]
    A, prior_sd = np.column_stack([A, np.zeros((len(A), more))]), (*prior_sd, *[1.0] * more)
    items = tuple(Parameter((name,), False, 0.0, 0.0, sd) for name, sd in zip("abc", prior_sd, strict=True))
    problem = InverseProblem(
        Linear(jnp.asarray(A)), jnp.asarray(measured), jnp.asarray(sigma), Parameters(items), ("value",) * len(A)
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
    what, source = "score of a perturbation", "the fit with it as an unknown"
    agrees(test.z * test.sd, amount, "inference", what, source, rtol=1e-7)
    p_value, what = 2 * norm.sf(abs(amount / sd)), "p-value of a perturbation"
    agrees(test.p_value, p_value, "inference", what, "SciPy's normal distribution", rtol=1e-6)


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
        assert one.p_value == pytest.approx(norm.sf(one.z), rel=1e-9)
        assert two.p_value == pytest.approx(2 * norm.sf(abs(two.z)), rel=1e-9)
        assert asked_for([two]) == (0,)
        assert asked_for([one]) == ((0,) if sign > 0 else ())


def test_the_amount_that_is_there_is_asked_for_most(linear):
    A, _, sigma, _ = linear
    changes = np.random.default_rng(2).normal(size=(4, 9))
    found = fitted(A, 2.0 * changes[2], sigma / 10, (1.0, 1.0))
    assert asked_for(score_tests(found, changes, np.ones(4), [False] * 4))[0] == 2


def test_kinds_whose_derivatives_are_not_known_do_not_count(linear):
    A, d, sigma, measured = linear
    found = fitted(A, measured, sigma, (1.0, 1.0))
    (part,) = score_tests(found, d[None], np.ones(1), [False], np.arange(9) >= 6)
    Q, _ = np.linalg.qr(np.vstack([A[:6] / sigma[:6, None], np.eye(2)]))
    scaled = np.concatenate([d[:6] / sigma[:6], [0, 0]])
    assert part.sd == pytest.approx(1 / np.linalg.norm(scaled - Q @ (Q.T @ scaled)), rel=1e-9)


COUNT = 12
GROUPED = (1, 3, 4, 9)
"""Values with correlated errors; of the vector, one is among them."""
VECTOR = (4, 5, 6)


def rows_of(prior_sd, correlated=False, vector=False, left_out=()):
    """Return a linear problem of a few rows, without a search: what `row_tests` needs, and its dense covariance."""
    rng = np.random.default_rng(11)
    A, sigma = rng.normal(size=(COUNT, len(prior_sd))), rng.uniform(0.5, 2.0, COUNT)
    sigma[list(left_out)] = np.inf
    root, R = rng.normal(size=(4, 4)) + 1.0, np.eye(COUNT)
    own = root @ root.T + 0.2 * np.eye(4)
    own /= np.sqrt(np.outer(np.diag(own), np.diag(own)))
    if correlated:
        R[np.ix_(GROUPED, GROUPED)] = own
    known = correlation([(GROUPED, own)], np.isfinite(sigma)) if correlated else None
    names = "abcd"[: len(prior_sd)]
    items = tuple(Parameter((name,), False, 0.0, 0.0, sd) for name, sd in zip(names, prior_sd, strict=True))
    vectors = np.array([VECTOR[0] if i in VECTOR else i for i in range(COUNT)]) if vector else None
    problem = InverseProblem(
        Linear(A), rng.normal(size=COUNT) * 3, sigma, Parameters(items), ("value",) * COUNT, known, vectors
    )
    return problem, A, R


def at_best(problem, A):
    """Return residuals and slope at the optimum of a linear problem, by dense algebra."""
    zero = np.zeros(A.shape[1])
    residuals, slope = problem.weigh(A @ zero, A, zero)
    step = np.linalg.lstsq(slope, -residuals, rcond=None)[0]
    return problem.weigh(A @ step, A, step)


def least_cost(problem, A, R, shifted=()):
    """Return the least sum of squares of data and priors by normal equations, with values that may be off by anything.

    Nothing of the code that is tested is in it: C^-1 is inverted whole, a shifted value has a column of its own.
    """
    kept = np.isfinite(problem.sigma)
    C = R[np.ix_(kept, kept)] * np.outer(problem.sigma[kept], problem.sigma[kept])
    J = np.column_stack([A, np.eye(len(A))[:, list(shifted)]])[kept]
    prior = np.append(np.asarray(problem.parameters.column("prior_sd")) ** -2.0, np.zeros(len(shifted)))
    weight, y = np.linalg.inv(C), problem.measured[kept]
    best = np.linalg.solve(J.T @ weight @ J + np.diag(prior), J.T @ weight @ y)
    off = y - J @ best
    return off @ weight @ off + best @ (prior * best), best


@pytest.mark.parametrize("prior", [(math.inf, math.inf, math.inf), (0.5, 2.0, math.inf)], ids=["no prior", "priors"])
@pytest.mark.parametrize("correlated", [False, True], ids=["independent", "correlated"])
@pytest.mark.parametrize("left_out", [(), (3, 7)], ids=["all", "some left out"])
def test_of_a_linear_model_a_rows_score_is_what_a_column_for_its_shift_takes_off_the_cost(prior, correlated, left_out):
    problem, A, R = rows_of(prior, correlated, left_out=left_out)
    tests = row_tests(problem, *at_best(problem, A))
    whole, _ = least_cost(problem, A, R)
    for i in range(COUNT):
        if i in left_out:
            assert np.isnan(tests.z[i])
            assert not tests.unchecked[i]
            continue
        less, best = least_cost(problem, A, R, (i,))
        what, source = "score of a row that may be off", "normal equations with a column for it"
        agrees(tests.z[i] ** 2, whole - less, "inference", what, source, rtol=1e-9)
        assert np.sign(tests.z[i]) == -np.sign(best[-1]), "predicted - measured"
        assert tests.chance[i] == pytest.approx(2 * norm.sf(abs(tests.z[i])), rel=1e-9)
    assert tests.tested == COUNT - len(left_out)


@pytest.mark.parametrize("correlated", [False, True], ids=["independent", "correlated"])
@pytest.mark.parametrize("left_out", [(), (5,)], ids=["all", "a component left out"])
def test_a_vector_is_judged_by_the_chi_squared_of_all_its_components(correlated, left_out):
    problem, A, R = rows_of((0.5, 2.0, math.inf), correlated, vector=True, left_out=left_out)
    tests = row_tests(problem, *at_best(problem, A))
    own = [i for i in VECTOR if i not in left_out]
    gain = least_cost(problem, A, R)[0] - least_cost(problem, A, R, own)[0]
    what, source = "chance of a vector that is off", "SciPy's chi-squared of its components"
    agrees(tests.chance[own], chi2.sf(gain, len(own)), "inference", what, source, rtol=1e-8)
    assert tests.tested == COUNT - len(left_out) - len(own) + 1
    alone = least_cost(problem, A, R)[0] - least_cost(problem, A, R, (0,))[0]
    assert tests.z[0] ** 2 == pytest.approx(alone, rel=1e-9)
    far = replace(problem, measured=problem.measured + 50.0 * np.isin(np.arange(COUNT), own[:1]))
    found = row_tests(far, *at_best(far, A)).outliers
    assert found[own].all(), "all components of a vector that is off"
    assert not found[list(left_out)].any()


def test_false_alarms_keep_their_level_and_a_wrong_row_is_noticed_as_often_as_its_leverage_says():
    """Leverages up to 0.9, where residual / sigma of a row that is 6 sigma off would pass in nearly all campaigns."""
    rng, draws = np.random.default_rng(3), 100
    A = rng.normal(size=(20, 6)) * np.geomspace(1.0, 12.0, 20)[:, None]
    items = tuple(Parameter((name,), False, 0.0, 0.0, 1.0) for name in "abcdef")
    problem = InverseProblem(Linear(A), np.zeros(20), np.ones(20), Parameters(items), ("value",) * 20)
    slope = np.vstack([A, np.eye(6)])
    basis, _ = np.linalg.qr(slope)
    h = (basis[:20] ** 2).sum(1)
    assert h.max() > 0.85

    def outliers(wrong=None):
        errors = rng.normal(size=26)
        errors[:20] += 6.0 * (np.arange(20) == wrong)
        return row_tests(problem, errors - basis @ (basis.T @ errors), slope).outliers

    alarms = sum(outliers().any() for _ in range(1000))
    band = binom.ppf(0.0005, 1000, 0.0014), binom.ppf(0.9995, 1000, 0.0027)
    what, source = "right campaigns with a row called wrong", "level promised, 0.14 to 0.27 %"
    counted(alarms, 1000, *band, "verdict rates", what, source, expected=2.7)
    said = norm.cdf(6 * np.sqrt(1 - h) - farthest(20))
    found = np.array([sum(outliers(i)[i] for _ in range(draws)) for i in range(20)])
    least, most = binom.ppf(2.5e-5, draws, said), binom.ppf(1 - 2.5e-5, draws, said + 0.005)
    assert (least <= found).all()
    assert (found <= most).all(), "the further limits of Holm's are a little lower"
    what, source = "a row of average leverage, 6 sigma off, noticed", "normal distribution and leverage"
    i = int(np.abs(h - h.mean()).argmin())
    counted(found[i], draws, least[i], most[i], "verdict rates", what, source, expected=draws * said[i])
    assert abs(found.mean() / draws - said.mean()) < 0.02
    by_sigma = norm.cdf((6 * (1 - h) - farthest(20)) / np.sqrt(1 - h))
    assert by_sigma.mean() < said.mean() - 0.1, "what residual / sigma would notice"


def test_a_row_that_nothing_else_measures_cannot_be_checked():
    problem, A, _ = rows_of((math.inf, math.inf))
    A = np.where(np.arange(COUNT)[:, None] == 2, [0.0, 1.0], A * [1.0, 0.0])
    measured = A @ [1.0, 2.0] + 1e3 * (np.arange(COUNT) == 2)
    problem = replace(problem, model=Linear(A), measured=measured)
    tests = row_tests(problem, *at_best(problem, A))
    assert np.flatnonzero(tests.unchecked).tolist() == [2]
    assert np.isnan(tests.z[2])
    assert not tests.outliers.any()
    assert tests.tested == COUNT - 1
    known = Parameter(("b",), False, 0.0, 0.0, 1.0)
    told = replace(problem, parameters=Parameters((problem.parameters.items[0], known)))
    tests = row_tests(told, *at_best(told, A))
    assert not tests.unchecked.any(), "a prior of the size of the row's error tells as well"
    assert np.flatnonzero(tests.outliers).tolist() == [2]


def test_what_a_wrong_row_pulls_along_is_not_blamed_and_what_cannot_be_told_apart_is():
    problem, A, _ = rows_of((1e3, 1e3, 1e3))
    exact = replace(problem, sigma=np.ones(COUNT), measured=A @ [1.0, -1.0, 0.5])
    far = replace(exact, measured=exact.measured + 60.0 * (np.arange(COUNT) == 6))
    residuals, slope = at_best(far, A)
    assert row_tests(far, residuals, slope).outliers.sum() > 1
    assert blamed(far, residuals, slope) == ((6,),)
    both = replace(exact, measured=exact.measured + 60.0 * np.isin(np.arange(COUNT), [2, 6]))
    assert blamed(both, *at_best(both, A)) == (), "no single one explains the other"
    A = np.where(np.isin(np.arange(COUNT), [2, 6])[:, None], [0.0, 0.0, 1.0], A * [1.0, 1.0, 0.0])
    pair = replace(exact, model=Linear(A), measured=A @ [1.0, -1.0, 0.5] + 60.0 * (np.arange(COUNT) == 6))
    assert blamed(pair, *at_best(pair, A)) == ((2,), (6,))
