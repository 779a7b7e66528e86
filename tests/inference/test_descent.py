"""Where Levenberg-Marquardt gets stuck, quasi-Newton steps or a new beginning lead to the optimum."""

import jax.numpy as jnp
import numpy as np
from conformance import agrees

from ident.inference.parameters import Parameter, Parameters
from ident.inference.problem import InverseProblem
from ident.inference.search import convergence, ended, evaluate, solve


def brown_and_dennis(p):
    """Residuals of More, Garbow, Hillstrom (1981), function 16: large, and bent, at the optimum of 85822.2."""
    t = jnp.arange(1, 21) / 5
    return (p["a"] + t * p["b"] - jnp.exp(t)) ** 2 + (p["c"] + p["d"] * jnp.sin(t) - jnp.cos(t)) ** 2


def brown_and_dennis_below_zero(p):
    """The same where a < 0, and no answer elsewhere, so that a search that begins anew finds nothing."""
    return jnp.where(p["a"] < 0, 1.0, jnp.nan) * brown_and_dennis(p)


def step(p):
    """Downhill until a = 2, where the cost jumps to more than it was; an optimum lies beyond."""
    low = p["a"] > 2
    return jnp.stack([jnp.where(low, p["a"] + 3, p["a"]), jnp.where(low, 0.0, 20.0)])


def problem(model, start, values):
    items = tuple(Parameter((name,), False, x, x) for name, x in zip("abcd", start, strict=False))
    return InverseProblem(model, np.zeros(values), np.ones(values), Parameters(items), ("value",) * values)


def test_quasi_newton_steps_end_what_gauss_newton_nears_but_slowly():
    posed = problem(brown_and_dennis_below_zero, (25.0, 5.0, -5.0, -1.0), 20)
    stuck = evaluate(posed, np.array([-11.6, 13.2, -0.40, 0.24]))
    stuck = stuck._replace(cost=np.sum(stuck.predicted**2))
    assert not convergence(posed, stuck).converged
    end, how = ended(posed, stuck)
    assert how.converged
    source, where = "More, Garbow, Hillstrom 1981, function 16", [-11.594, 13.204, -0.4034, 0.2368]
    agrees(end.cost, 85822.2, "inference", "least cost of Brown and Dennis", source, atol=0.05)
    agrees(end.theta, where, "inference", "place of the least cost of Brown and Dennis", source, rtol=1e-7, atol=1e-3)


def test_a_search_that_is_stuck_begins_anew_nearer_to_the_parameters_own_start():
    posed = problem(step, (0.5,), 2)
    stuck = solve(posed, np.array([4.0]))
    assert not convergence(posed, stuck).converged
    end, how = ended(posed, stuck)
    assert how.converged
    np.testing.assert_allclose(end.theta, 0, atol=1e-6)


def test_an_end_that_is_an_optimum_stays_as_it_is():
    posed = problem(lambda p: jnp.stack([p["a"] - 1, p["b"] + 2]), (0.0, 0.0), 2)
    found = solve(posed, np.zeros(2))
    end, how = ended(posed, found)
    assert end is found
    assert how.converged
