"""One search: what comes back belongs to the point where it ended."""

import jax.numpy as jnp
import numpy as np
import pytest
from conformance import agrees

from ident.inference.levenberg_marquardt import LEAST_STEP
from ident.inference.parameters import Parameter, Parameters
from ident.inference.problem import InverseProblem
from ident.inference.search import TO_THE_END, Row, convergence, evaluate, searched, solve


def curved(p):
    """Rosenbrock's residuals: many steps along a curved valley."""
    return jnp.stack([10 * (p["b"] - p["a"] ** 2), 1 - p["a"]])


def root(p):
    """No answer below zero."""
    return jnp.stack([jnp.where(p["a"] > 0, jnp.sqrt(jnp.abs(p["a"])), jnp.nan), p["b"]])


def problem(model, measured=(0.0, 0.0), sigma=1.0):
    items = tuple(Parameter((name,), False, 0.0, 0.0) for name in "ab")
    return InverseProblem(
        model, jnp.asarray(measured), jnp.full(len(measured), sigma), Parameters(items), ("value",) * len(measured)
    )


@pytest.mark.parametrize(
    ("model", "measured", "start"),
    [
        (curved, (0.0, 0.0), (-1.2, 1.0)),
        (curved, (0.0, 0.0), (1.0, 1.0)),
        (curved, (3.0, -2.0), (5.0, -4.0)),
        (root, (0.1, 2.0), (4.0, 0.0)),
    ],
)
def test_prediction_jacobian_cost_and_gradient_are_those_of_the_end(model, measured, start):
    posed = problem(model, measured)
    end = solve(posed, np.array(start))
    there = evaluate(posed, end.theta)
    np.testing.assert_array_equal(there.theta, end.theta)
    np.testing.assert_array_equal(there.predicted, end.predicted)
    np.testing.assert_array_equal(there.jacobian, end.jacobian)
    residuals = np.asarray(end.predicted) - measured
    assert float(end.cost) == pytest.approx(residuals @ residuals, rel=1e-12, abs=1e-300)
    np.testing.assert_allclose(end.gradient, 2 * np.asarray(end.jacobian).T @ residuals, atol=1e-12)
    assert convergence(posed, end).step < 1e-6
    assert float(end.cost) < LEAST_STEP**2


@pytest.mark.parametrize(("stiff", "soft", "away", "irreducible"), [(100, 0.1, 0.005, 100.0), (100, 0.1, 0.1, 1e4)])
def test_a_weak_direction_is_followed_to_its_end_under_a_large_cost(stiff, soft, away, irreducible):
    """A linear model whose cost hardly falls on the way, as that of contradictory data."""

    def model(p):
        return jnp.stack([stiff * (p["a"] - 1), soft * p["b"] - away, 0 * p["a"] + irreducible])

    posed = problem(model, (0.0, 0.0, 0.0))
    end, ended = searched(posed, np.array([-1.0, -1.0]), None, TO_THE_END)
    assert ended
    np.testing.assert_allclose(end.theta, [1.0, away / soft], rtol=0, atol=1e-6)


def test_a_start_without_answer_has_no_cost():
    end = solve(problem(root), np.array([-1.0, 0.0]))
    assert np.isnan(end.cost)
    np.testing.assert_array_equal(end.theta, [-1.0, 0.0])


def straight(p):
    return jnp.stack([2 * p["a"] + p["b"], p["a"] - p["b"]])


def test_a_combination_is_held_where_it_should_be():
    """Of a linear model with a + 2 b held at 1: by Lagrange's equations."""
    posed, weights = problem(straight, (0.5, 3.0)), np.array([1.0, 2.0])
    end, ended = searched(
        posed, np.array([5.0, -4.0]), None, TO_THE_END, row=Row(weights, np.array(1.0), np.array(1e-6))
    )
    A = np.array([[2.0, 1.0], [1.0, -1.0]])
    both = np.block([[A.T @ A, weights[:, None]], [weights, 0.0]])
    expected = np.linalg.solve(both, np.append(A.T @ [0.5, 3.0], 1.0))[:2]
    assert ended
    what, source = "minimum with a combination held", "Lagrange's equations, NumPy"
    agrees(end.theta, expected, "inference", what, source, rtol=1e-7, atol=1e-7)
