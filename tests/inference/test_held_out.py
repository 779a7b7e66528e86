"""Values that were left out, predicted by the others: closed forms on a linear model."""

import jax.numpy as jnp
import numpy as np
import pytest
from conformance import agrees
from scipy.stats import chi2

from ident.inference.fit import fit
from ident.inference.parameters import Parameter, Parameters
from ident.inference.problem import InverseProblem
from ident.inference.scrutiny import held_out

NAMES = ("a", "b")
PRIOR, SIGMA = 0.7, 0.1
A = np.array([[1.0, 0.2], [0.3, -1.0], [0.5, 0.5], [-1.0, 0.4], [0.8, 0.9]])
Y = np.array([0.1, -0.2, 0.15, 0.0, 0.4])


def problem(prior=PRIOR):
    def model(p):
        return jnp.asarray(A) @ jnp.stack([jnp.log(p[name]) for name in NAMES])

    items = tuple(Parameter((name,), True, 1.0, 1.0, prior) for name in NAMES)
    return InverseProblem(model, Y, np.full(len(Y), SIGMA), Parameters(items), ("x",) * len(Y))


@pytest.mark.parametrize("places", [[2], [0, 1], [1, 2, 4]])
def test_a_group_is_predicted_by_the_least_squares_of_the_others(places):
    (part,) = held_out(fit(problem(), starts=1), {"left": places})
    kept = np.setdiff1d(np.arange(len(Y)), places)
    F = A[kept].T @ A[kept] / SIGMA**2 + np.eye(2) / PRIOR**2
    theta = np.linalg.solve(F, A[kept].T @ Y[kept] / SIGMA**2)
    covariance = A[places] @ np.linalg.inv(F) @ A[places].T + SIGMA**2 * np.eye(len(places))
    off = Y[places] - A[places] @ theta
    assert part.told
    source = "least squares of the others, NumPy"
    agrees(part.off, off, "inference", "errors of values left out", source, atol=1e-7)
    agrees(part.covariance, covariance, "inference", "covariance of values left out", source, rtol=1e-6)
    p_value, what = chi2.sf(off @ np.linalg.solve(covariance, off), len(places)), "p-value of values left out"
    agrees(part.p_value, p_value, "inference", what, "SciPy's chi-squared", rtol=1e-5)


def test_what_the_others_leave_open_is_not_told():
    (part,) = held_out(fit(problem(np.inf), starts=1), {"left": [0, 1, 2, 3]})
    assert not part.told
    assert np.isnan(part.p_value)


def test_groups_are_predicted_one_by_one_and_their_progress_is_shown():
    seen = []

    def shown(numbers):
        for number in numbers:
            seen.append(number)
            yield number

    parts = held_out(fit(problem(), starts=1), {"first": [0], "second": [1, 2]}, shown)
    assert [part.name for part in parts] == ["first", "second"]
    assert [part.places.tolist() for part in parts] == [[0], [1, 2]]
    assert seen == [0, 1]
