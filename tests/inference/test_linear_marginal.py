"""Nuisances integrated out: against dense covariances by SciPy, and against the same nuisances sampled."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from conformance import agrees
from scipy.stats import multivariate_normal

from ident.inference.fit import fit
from ident.inference.parameters import Parameter, Parameters
from ident.inference.posterior import evaluate, linear_marginal, posterior
from ident.inference.problem import InverseProblem
from ident.inference.sample import Settings, sample

J = np.array([[1.0, 0.3, 0.5], [0.2, 1.0, -0.7], [0.7, 0.7, 0.2], [1.0, -0.5, 1.0], [-0.3, 0.8, 0.6]])
MEASURED = np.array([0.3, -0.2, 0.6, 0.4, -0.1])
SIGMA = np.array([0.1, 0.2, 0.1, 0.3, 0.2])
BENT = np.array([0.5, -1.0, 0.2, 1.0, 0.3])
WIDTH = 0.4
CENTRE = 0.3
FEW = Settings(target_ess=400.0)


class Bending(eqx.Module):
    """Values in straight lines of all unknowns, but for how much they bend with the last one."""

    bend: np.ndarray

    def __call__(self, p):
        x = jnp.stack([p["a"], p["b"], p["c"], self.bend * p["c"] ** 2])
        return jnp.tensordot(jnp.asarray(np.column_stack([J, BENT])), x, 1)


def posed(bend: float = 0.0) -> InverseProblem:
    """Two unknowns and a nuisance in straight lines, or one that bends away from its line."""
    items = (
        Parameter(("a",), False, 0.0, 0.0, 2.0),
        Parameter(("b",), False, 0.0, 0.0, 2.0),
        Parameter(("c",), False, CENTRE, CENTRE, 1.0, WIDTH, nuisance=True),
    )
    values = jnp.asarray(MEASURED), jnp.asarray(SIGMA)
    return InverseProblem(Bending(np.array(bend)), *values, Parameters(items), ("x",) * 5)


def test_the_density_is_that_of_the_dense_covariance():
    """C + G P G' with its log-determinant, by SciPy's multivariate normal."""
    problem = posed()
    target = linear_marginal(posterior(problem), fit(problem, starts=1).best, ("c",))
    theta = np.random.default_rng(1).standard_normal((7, 2))
    at = evaluate(target, theta, 7)
    covariance = np.diag(SIGMA**2) + WIDTH**2 * np.outer(J[:, 2], J[:, 2])
    dense = [multivariate_normal(J @ [a, b, CENTRE], covariance).logpdf(MEASURED) for a, b in theta]
    what, source = "likelihood, nuisance integrated out", "SciPy's multivariate_normal, C + G P G'"
    agrees(at.log_likelihood, dense, "inference", what, source, rtol=1e-10)
    prior = multivariate_normal([0.0, 0.0], 4.0 * np.eye(2)).logpdf(theta)
    np.testing.assert_allclose(at.log_density, dense + prior, rtol=1e-10)


def test_the_nuisance_is_drawn_as_the_whole_posterior_has_it():
    """Mean and variance given the rest, and the density of what was drawn, by that of the whole posterior."""
    problem = posed()
    whole = posterior(problem)
    target = linear_marginal(whole, fit(problem, starts=1).best, ("c",))
    theta = np.array([[0.4, -0.3]])
    known = target.columns(evaluate(target, theta, 1))
    drawn, log_density = target.completed(
        np.repeat(theta, 20000, 0), np.repeat(known, 20000, 0), np.random.default_rng(2)
    )
    weight = (J[:, 2] / SIGMA**2) @ J[:, 2] + WIDTH**-2
    mean = ((J[:, 2] / SIGMA**2) @ (MEASURED - J[:, :2] @ theta[0]) + CENTRE / WIDTH**2) / weight
    c = WIDTH * drawn[:, 2]
    what, source = "mean of a nuisance drawn again", "conditional normal, 4 std. errors"
    agrees(c.mean(), mean, "inference", what, source, atol=4 * (weight * 20000) ** -0.5)
    assert c.var() * weight == pytest.approx(1.0, abs=4 * (2 / 20000) ** 0.5)
    np.testing.assert_allclose(log_density[:5], evaluate(whole, drawn[:5], 5).log_density, rtol=1e-9)


def test_a_straight_nuisance_is_integrated_out_and_agrees_with_least_squares():
    """Means and covariances of all three by the normal equations, within the chains' own Monte Carlo errors."""
    problem = posed()
    found = sample(fit(problem, starts=1), posterior(problem), FEW)
    assert found.marginalised == {"c": pytest.approx(0.0, abs=1e-9)}
    rows = np.vstack([J * [1, 1, WIDTH] / SIGMA[:, None], np.diag([0.5, 0.5, 1.0])])
    right = np.concatenate([MEASURED / SIGMA, [0.0, 0.0, CENTRE / WIDTH]])
    covariance = np.linalg.inv(rows.T @ rows)
    mean, sd = covariance @ rows.T @ right, np.sqrt(np.diag(covariance))
    draws, ess = found.draws(), found.diagnosis[0].bulk
    what, source = "means of draws, over 4 Monte Carlo errors", "normal equations, NumPy"
    error = 4 * sd / np.sqrt(ess)
    agrees(draws.mean(0) / error, mean / error, "inference", what, source, atol=1.0)
    np.testing.assert_allclose(draws.std(0) / sd, 1.0, atol=4 * (2 * ess.min()) ** -0.5)


@pytest.mark.slow
def test_a_nuisance_that_bends_is_sampled():
    """And its means and deviations are those of the whole posterior by quadrature over all three."""
    problem = posed(bend=0.7)
    best = fit(problem, starts=4)
    found = sample(best, posterior(problem), FEW)
    assert not found.marginalised
    axes = [np.linspace(-1.5, 1.5, 61), np.linspace(-1.5, 1.5, 61), np.linspace(-4.0, 4.0, 61)]
    grid = np.stack(np.meshgrid(*axes, indexing="ij")).reshape(3, -1).T
    weight = np.exp(evaluate(posterior(problem), grid, len(grid)).log_density)
    mean = weight @ grid / weight.sum()
    spread = np.sqrt(weight @ (grid - mean) ** 2 / weight.sum())
    draws, ess = found.draws(), found.diagnosis[0].bulk
    assert (np.abs(draws.mean(0) - mean) < 4 * spread / np.sqrt(ess)).all()
    np.testing.assert_allclose(draws.std(0) / spread, 1.0, atol=6 * (2 * ess.min()) ** -0.5)
