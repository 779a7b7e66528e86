"""Values with correlated errors, against generalised least squares by dense algebra and SciPy's normal density."""

import jax.numpy as jnp
import numpy as np
import pytest
from conformance import agrees, counted
from scipy.linalg import block_diag
from scipy.stats import chi2, multivariate_normal

from ident.errors import InputError
from ident.inference.draws import posterior_predictive
from ident.inference.fit import cross_predictions, fit
from ident.inference.identifiability import check
from ident.inference.information import score_tests
from ident.inference.parameters import Parameter, Parameters
from ident.inference.posterior import evaluate, posterior
from ident.inference.problem import InverseProblem, correlation
from ident.inference.sample import Settings, sample
from ident.inference.scrutiny import held_out

RNG = np.random.default_rng(0)
A = RNG.standard_normal((9, 2))
SIGMA = RNG.uniform(0.5, 2.0, 9)
GROUPS = ((1, 3, 4), (8, 5), (6, 2))
PRIOR_SD = np.array([3.0, 2.0])


def model(parameters):
    return jnp.tensordot(A, jnp.stack([parameters["a"], parameters["b"]]), 1)


def random_correlation(rng, n, rho=0.8):
    root = np.sqrt(rho) + rng.standard_normal((n, n)) * (1 - rho)
    R = root @ root.T + 0.05 * np.eye(n)
    return R / np.sqrt(np.outer(np.diag(R), np.diag(R)))


MATRICES = [random_correlation(RNG, len(rows)) for rows in GROUPS]


def dense():
    R = np.eye(9)
    for rows, own in zip(GROUPS, MATRICES, strict=True):
        R[np.ix_(rows, rows)] = own
    return R * np.outer(SIGMA, SIGMA)


COVARIANCE = dense()


def posed(measured, sigma=SIGMA, groups=True, kinds=("x", "x", "y") * 3):
    items = [Parameter((name,), False, 0.1, 0.0, sd) for name, sd in zip("ab", PRIOR_SD, strict=True)]
    R = correlation(list(zip(GROUPS, MATRICES, strict=True)), np.isfinite(sigma)) if groups else None
    return InverseProblem(model, jnp.asarray(measured), jnp.asarray(sigma), Parameters(tuple(items)), kinds, R)


def generalised_least_squares(measured, rows=slice(None)):
    J, C = A[rows], COVARIANCE[rows][:, rows]
    known = np.linalg.inv(J.T @ np.linalg.solve(C, J) + np.diag(PRIOR_SD**-2))
    return known @ J.T @ np.linalg.solve(C, measured[rows]), known


MEASURED = A @ [1.0, -2.0] + np.linalg.cholesky(COVARIANCE) @ RNG.standard_normal(9)


def test_a_fit_is_that_of_generalised_least_squares():
    found, source = fit(posed(MEASURED), starts=2), "generalised least squares, dense"
    best, known = generalised_least_squares(MEASURED)
    agrees(found.best.values, best, "inference", "fit with correlated errors", source, rtol=1e-7, atol=1e-9)
    agrees(
        found.information.covariance,
        known,
        "inference",
        "covariance of a fit with correlated errors",
        source,
        rtol=1e-9,
    )
    off = MEASURED - A @ best
    chi_squared = off @ np.linalg.solve(COVARIANCE, off)
    agrees(
        found.chi_squared, chi_squared, "inference", "chi-squared of a fit with correlated errors", source, rtol=1e-9
    )


def test_values_that_do_not_count_are_taken_out_of_their_group():
    rows = np.array([0, 1, 4, 5, 6, 7])
    sigma = np.where(np.isin(np.arange(9), rows), SIGMA, np.inf)
    best, _ = generalised_least_squares(MEASURED, rows)
    for problem in (posed(MEASURED, sigma), posed(MEASURED).with_sigma(sigma)):
        np.testing.assert_allclose(fit(problem, starts=2).best.values, best, atol=1e-9)
    kept = np.array([kind != "y" for kind in posed(MEASURED).kinds])
    best, _ = generalised_least_squares(MEASURED, np.flatnonzero(kept))
    np.testing.assert_allclose(
        fit(posed(MEASURED, np.where(kept, SIGMA, np.inf)), starts=2).best.values, best, atol=1e-9
    )


def test_the_density_is_that_of_scipy():
    points = RNG.standard_normal((5, 2))
    problem = posed(MEASURED)
    found = evaluate(posterior(problem, ("x",)), np.column_stack([points, 0.3 * np.ones(5)]), 5)
    scale = np.where(np.array(problem.kinds) == "x", np.exp(0.3), 1.0)
    expected = [multivariate_normal(A @ p, COVARIANCE * np.outer(scale, scale)).logpdf(MEASURED) for p in points]
    what, source = "likelihood of correlated errors", "SciPy's multivariate_normal"
    agrees(found.log_likelihood, expected, "inference", what, source, rtol=1e-12)


def test_without_correlation_nothing_changes():
    eyes = [(rows, np.eye(len(rows))) for rows in GROUPS]
    plain = posed(MEASURED, groups=False)
    grouped = InverseProblem(
        model, plain.measured, plain.sigma, plain.parameters, plain.kinds, correlation(eyes, np.ones(9, bool))
    )
    theta = np.array([0.3, -0.2])
    predicted = A @ theta
    for ours, theirs in zip(grouped.weigh(predicted, A, theta), plain.weigh(predicted, A, theta), strict=True):
        np.testing.assert_array_equal(ours, theirs)


def test_what_is_held_out_is_foretold_by_rows_that_are_not_correlated_with_it():
    (found,) = held_out(fit(posed(MEASURED), starts=2), {"some": (3, 0)})
    others = np.array([2, 5, 6, 7, 8])
    best, known = generalised_least_squares(MEASURED, others)
    what, source = "values left out, predicted from the others", "generalised least squares without their groups"
    agrees(found.predicted, A[[3, 0]] @ best, "inference", what, source, rtol=1e-7, atol=1e-8)
    expected = A[[3, 0]] @ known @ A[[3, 0]].T + COVARIANCE[np.ix_([3, 0], [3, 0])]
    np.testing.assert_allclose(found.covariance, expected, rtol=1e-7)
    (found,) = held_out(fit(posed(MEASURED), starts=2), {"a pair": (8, 5)})
    assert found.covariance[0, 1] != pytest.approx((A[8] @ known @ A[5]), abs=0.1)


def test_a_group_is_dropped_whole():
    part = check(posed(MEASURED), points=2).leverage
    white = np.linalg.solve(np.linalg.cholesky(COVARIANCE), A)
    hat = np.linalg.svd(white, full_matrices=False)[0]
    for rows in (*GROUPS, (0,), (7,)):
        own = np.linalg.cholesky(COVARIANCE[np.ix_(rows, rows)])
        J = np.linalg.solve(own, A[list(rows)])
        share = np.trace(J @ np.linalg.inv(white.T @ white) @ J.T)
        what, source = "leverage of a correlated group", "trace of the hat matrix, dense"
        agrees(part.leverage[list(rows)].sum(), share, "inference", what, source, rtol=1e-9)
    assert part.leverage.sum() == pytest.approx((hat**2).sum())


def test_a_score_test_is_that_of_generalised_least_squares():
    d = RNG.standard_normal(9)
    found = fit(posed(MEASURED), starts=2)
    (test,) = score_tests(found, d[None], np.array([1.0]), [False])
    wide = np.column_stack([A, d])
    C, priors = np.linalg.inv(COVARIANCE), np.diag([*PRIOR_SD**-2, 0.0])
    known = np.linalg.inv(wide.T @ C @ wide + priors)
    amount = (known @ wide.T @ C @ MEASURED)[2]
    what, source = "score of a perturbation, correlated errors", "generalised least squares, one column more"
    agrees(test.z, amount / np.sqrt(known[2, 2]), "inference", what, source, rtol=1e-6)


def test_draws_and_the_data_they_predict_have_the_correlation():
    fitted = fit(posed(MEASURED), starts=2)
    drawn = sample(fitted, posterior(fitted.problem), Settings(target_ess=4000.0, seed=1))
    best, known = generalised_least_squares(MEASURED)
    theta = drawn.draws()
    np.testing.assert_allclose(theta.mean(0), best, atol=0.1 * np.sqrt(np.diag(known)).min())
    np.testing.assert_allclose(np.cov(theta.T), known, rtol=0.1, atol=0.05 * np.diag(known).max())
    simulated = posterior_predictive(drawn, count=4000).simulated
    whole = A @ known @ A.T + COVARIANCE
    what, source = "covariance of predicted data", "J P J' + C"
    agrees(np.cov(simulated.T), whole, "inference", what, source, rtol=1e-7, atol=float(0.1 * np.diag(whole).max()))


def test_kinds_are_compared_without_what_ties_them():
    """The chi-squared of two kinds against each other has its law, though groups go across them."""
    rng, root = np.random.default_rng(3), np.linalg.cholesky(COVARIANCE)
    p = []
    for _ in range(12):
        found = fit(posed(A @ rng.normal(0, PRIOR_SD) + root @ rng.standard_normal(9)), starts=2)
        crosses, _ = cross_predictions(found.problem, [found.best.theta])
        p += [cross.p_value for cross in crosses]
    assert np.mean(np.array(p) < 0.05) < 0.2


def test_rates():
    """Strongly correlated errors: intervals hold the truth by their covariance, and do not by its diagonal."""
    R = block_diag(*[np.full((5, 5), 0.9) + 0.1 * np.eye(5)] * 2)
    J = np.column_stack([np.ones(10), np.repeat([1.0, -1.0], 5)])
    groups = [(range(k, k + 5), R[:5, :5]) for k in (0, 5)]
    rng, root, inside = np.random.default_rng(7), np.linalg.cholesky(R), []
    items = [Parameter((name,), False, 0.0, 0.0, 10.0) for name in "ab"]

    def straight(p):
        return jnp.tensordot(J, jnp.stack([p["a"], p["b"]]), 1)

    for _ in range(50):
        truth = rng.standard_normal(2)
        measured, own = J @ truth + root @ rng.standard_normal(10), []
        for given in (correlation(groups, np.ones(10, bool)), None):
            problem = InverseProblem(
                straight, jnp.asarray(measured), jnp.ones(10), Parameters(tuple(items)), ("x",) * 10, given
            )
            found = fit(problem, starts=1)
            off = found.best.values - truth
            own.append(off @ np.linalg.solve(found.information.covariance, off) < chi2.ppf(0.95, 2))
        inside.append(own)
    whole, diagonal = np.mean(inside, 0)
    what, source = "regions of correlated errors that hold the truth", "95 % promised, known truths"
    counted(round(50 * whole), 50, 0.88 * 50, 0.99 * 50, "verdict rates", what, source, expected=47.5)
    assert diagonal < 0.6


def test_errors_that_can_not_be_so_correlated_are_refused():
    R = np.array([[1.0, 0.9, -0.9], [0.9, 1.0, 0.9], [-0.9, 0.9, 1.0]])
    with pytest.raises(InputError, match="errors that can't be so correlated"):
        correlation([((0, 1, 2), R)], np.ones(3, bool))


def test_an_error_that_others_of_its_group_fix_is_refused():
    """A sum of two others but for a hundred thousandth: no pair of them is correlated that much."""
    L = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [np.sqrt(0.5), np.sqrt(0.5), 1e-5]])
    R = L @ L.T
    correlation([((0, 1, 2), R + np.diag([0.0, 0.0, 1e-6]))], np.ones(3, bool))
    with pytest.raises(InputError, match=r"fix to 1e-05 of its standard deviation, expected at least 0.0001"):
        correlation([((0, 1, 2), R)], np.ones(3, bool))
