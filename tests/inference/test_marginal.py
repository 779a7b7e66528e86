"""Discrepancy factors integrated out: against SciPy's quadrature, and against importance sampling of the whole."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from conformance import agrees, within
from scipy.integrate import quad
from scipy.stats import ks_2samp, kstest, norm

from ident.inference.fit import fit
from ident.inference.parameters import Parameter, Parameters
from ident.inference.posterior import Marginal, evaluate, posterior
from ident.inference.problem import InverseProblem, correlation, with_discrepancy
from ident.inference.sample import Settings, sample


def compliant(p):
    """Two frequencies and a deflection of two springs in series, and one value of the other sign."""
    a, b = 1 / p["a"], 1 / p["b"]
    return jnp.stack([(a + b) ** -0.5, (a + 2 * b) ** -0.5, a + b, a - 2 * b])


def without_factors(sigma: float) -> InverseProblem:
    items = tuple(Parameter((name,), True, 1.0, 1.0, 0.5) for name in "ab")
    measured = np.asarray(compliant({"a": 1.3, "b": 0.8})) * np.array([1.1, 1.1, 0.8, 0.8])
    kinds = ("frequency", "frequency", "deflection", "deflection")
    return InverseProblem(
        compliant, jnp.asarray(measured), jnp.asarray(sigma * abs(measured)), Parameters(items), kinds
    )


def problem(sigma: float, width: float) -> InverseProblem:
    return with_discrepancy(without_factors(sigma), {"frequency": width, "deflection": width / 2})


@pytest.mark.parametrize(
    ("sigma", "width", "noise"),
    [(0.002, 0.1, ()), (0.03, 0.3, ("deflection",)), (0.5, 0.1, ()), (0.5, 0.5, ("deflection",))],
)
def test_each_factor_is_integrated_as_scipy_does(sigma, width, noise):
    """The density of the whole posterior, summed over one factor by SciPy while the other is left out."""
    both = posterior(problem(sigma, width), noise)
    names, target = both.parameters.names, Marginal(both)
    assert target.parameters.names == tuple(n for n in names if not n.startswith("discrepancy"))
    rng = np.random.default_rng(3)
    theta = 0.2 * rng.standard_normal((6, len(target.parameters.items)))
    theta[:, :2] += np.log([1.3, 0.8])
    value, at_one, A, B = np.split(target.columns(evaluate(target.itself, theta, 6)), [1, 2, 4], axis=1)
    whole = np.zeros((6, len(names)))
    whole[:, ~target.integrated] = theta
    np.testing.assert_allclose(at_one[:, 0], evaluate(both, whole, 6).log_density, rtol=1e-12)
    for i in range(6):
        gain = sum(_integral(A[i, k], B[i, k], sd) for k, sd in enumerate((width, width / 2)))
        what, source = "density, discrepancies integrated out", "SciPy's quad"
        agrees(value[i, 0], at_one[i, 0] + gain, "inference", what, source, atol=1e-6)


def test_a_factor_is_integrated_among_correlated_errors():
    """By SciPy over the whole posterior; with two factors, which correlated errors tie, both stay unknowns."""
    R, width = np.array([[1.0, 0.6, 0.3], [0.6, 1.0, -0.2], [0.3, -0.2, 1.0]]), 0.3
    own = correlation([((0, 2, 3), R)], np.ones(4, bool))
    plain = eqx.tree_at(lambda p: p.correlation, without_factors(0.05), own, is_leaf=lambda x: x is None)
    whole = posterior(with_discrepancy(plain, {"deflection": width}), ())
    target, theta = Marginal(whole), np.log([[1.3, 0.8], [1.1, 1.0], [1.6, 0.7]])
    assert target.integrated.tolist() == [False, False, True]
    ours = evaluate(target.itself, theta, 3).log_density
    grid = np.linspace(-1.5, 1.5, 4001)
    for theta_i, value in zip(theta, ours, strict=True):
        points = np.column_stack([np.tile(theta_i, (len(grid), 1)), grid])
        log = np.asarray(evaluate(whole, points, len(grid)).log_density)
        expected = log.max() + np.log(np.trapezoid(np.exp(log - log.max()), grid))
        what, source = (
            "density with correlated errors, discrepancies integrated out",
            "the whole posterior, NumPy's trapezoid",
        )
        agrees(value, expected, "inference", what, source, atol=1e-6)
    both = posterior(with_discrepancy(plain, {"deflection": width, "frequency": width}), ())
    assert not Marginal(both).integrated.any()


def _integral(A: float, B: float, sd: float) -> float:
    def log(u):
        return -(A * (np.exp(2 * u) - 1) - 2 * B * (np.exp(u) - 1)) / 2 - u**2 / (2 * sd**2)

    grid = np.linspace(-3.0, 3.0, 60001)
    top = grid[np.argmax(log(grid))]
    peak = log(top)
    near = np.flatnonzero(log(grid) > peak - 60)
    ends = grid[near[0]] - 1e-3, grid[near[-1]] + 1e-3
    area = quad(lambda u: np.exp(log(u) - peak), *ends, points=[top], epsabs=0, epsrel=1e-9, limit=500)[0]
    return peak + np.log(area)


@pytest.mark.parametrize(("sigma", "width"), [(0.01, 0.1), (0.4, 0.4)])
def test_draws_of_the_factors_are_those_of_their_density(sigma, width):
    """Uniform by SciPy's distribution function of each factor given the rest, and of the right log density."""
    target = Marginal(posterior(problem(sigma, width)))
    theta = np.repeat([[0.2, -0.1]], 20000, 0)
    known = target.columns(evaluate(target, theta[:1], 1))
    whole, log_density = target.completed(theta, np.repeat(known, 20000, 0), np.random.default_rng(5))
    np.testing.assert_array_equal(whole[:, :2], theta)
    np.testing.assert_allclose(log_density[:50], evaluate(target.posterior, whole[:50], 50).log_density, rtol=1e-9)
    one = np.array([0.2, -0.1, 0.0, 0.0])
    for place in (2, 3):
        grid = np.linspace(whole[:, place].min() - 0.02, whole[:, place].max() + 0.02, 4001)
        points = np.repeat(one[None], len(grid), 0)
        points[:, place] = grid
        log = evaluate(target.posterior, points, len(grid)).log_density
        below = np.cumsum(np.exp(log - log.max()))
        uniform = np.interp(whole[:, place], grid, below / below[-1])
        what, source = "draws of a discrepancy factor", "its distribution: SciPy's Kolmogorov-Smirnov"
        within(kstest(uniform, "uniform").pvalue, 1e-3, 1.0, "inference", what, source)


@pytest.mark.slow
def test_a_posterior_with_factors_agrees_with_importance_sampling_of_the_whole():
    """Draws of all four unknowns, factors among them, against a wide normal's draws weighed by the whole density."""
    posed = problem(0.02, 0.1)
    found, target = fit(posed), posterior(posed)
    drawn = sample(found, target, Settings(target_ess=4000, seed=2))
    assert all(d.enough(4000) for d in drawn.diagnosis)
    assert drawn.posterior.parameters.names == ("a", "b", "discrepancy.frequency", "discrepancy.deflection")
    rng = np.random.default_rng(0)
    root = 1.3 * np.linalg.cholesky(found.information.covariance)
    points = found.best.theta + rng.standard_normal((200000, 4)) @ root.T
    log_proposal = norm.logpdf(np.linalg.solve(root, (points - found.best.theta).T)).sum(0)
    log_weight = evaluate(target, points, 20000).log_density - log_proposal
    weight = np.exp(log_weight - log_weight.max())
    weight /= weight.sum()
    assert 1 / (weight**2).sum() > 20000, "else this compares with little"
    own, effective = drawn.draws(), drawn.diagnosis[0].bulk.min()
    for p in range(4):
        mean = weight @ points[:, p]
        sd = np.sqrt(weight @ (points[:, p] - mean) ** 2)
        assert abs(own[:, p].mean() - mean) < 4 * sd / np.sqrt(effective)
        assert own[:, p].std() == pytest.approx(sd, rel=4 / np.sqrt(effective))
    resampled = points[rng.choice(len(points), 4000, p=weight)]
    log = evaluate(target, resampled, 4000).log_density
    some = rng.choice(drawn.log_density[drawn.burn_in :].ravel(), 4000)
    assert ks_2samp(log, some).pvalue > 1e-3


def test_the_model_may_have_no_answer_and_no_factor_is_drawn_there():
    posed = problem(0.02, 0.1)

    def model(p):
        return jnp.where(p["a"] > 0.5, compliant({k: p[k] for k in "ab"}), jnp.nan)

    nowhere = eqx.tree_at(lambda q: q.model.model, posed, model)
    target = Marginal(posterior(nowhere))
    value = target.columns(evaluate(target, np.array([[0.0, 0.0], [-2.0, 0.0]]), 2))
    assert np.isfinite(value[0]).all()
    assert value[1, 0] == -np.inf
