"""Where intervals end: on the cost itself where that is no parabola, as closed forms have it."""

import math
from dataclasses import replace

import jax.numpy as jnp
import numpy as np

from ident.inference.fit import fit, with_stretch
from ident.inference.parameters import Parameter, Parameters
from ident.inference.problem import InverseProblem

Z = 1.959963984540054


def stiffness(sigma: float, prior_sd: float = math.inf) -> InverseProblem:
    """A stiffness of 1 that was measured as it is: the cost is ((k - 1) / sigma)^2, of ln(k) no parabola."""
    items = (Parameter(("k",), True, 1.0, 1.0, prior_sd),)
    return InverseProblem(
        lambda p: jnp.stack([p["k"]]), jnp.ones(1), jnp.full(1, sigma), Parameters(items), ("deflection",)
    )


def test_a_long_interval_ends_where_the_cost_has_risen_enough():
    found = fit(stiffness(0.3), starts=1)
    np.testing.assert_allclose(found.interval()[0], [1 - 0.3 * Z, 1 + 0.3 * Z], rtol=1e-4)


def test_a_short_one_is_linear_to_the_last_digit():
    found = fit(stiffness(0.05), starts=1)
    np.testing.assert_array_equal(found.stretch, 1.0)
    np.testing.assert_allclose(found.interval()[0], np.exp([-0.05 * Z, 0.05 * Z]), rtol=1e-9)


def test_the_prior_counts():
    """The root of ((k - 1) / sigma)^2 + (ln(k) / sd)^2 = z^2, by bisection."""
    found, ends = fit(stiffness(0.45, prior_sd=0.8), starts=1), []
    for inside, outside in ((1.0, 1e-3), (1.0, 10.0)):
        for _ in range(60):
            middle = (inside + outside) / 2
            rise = ((middle - 1) / 0.45) ** 2 + (math.log(middle) / 0.8) ** 2
            inside, outside = (middle, outside) if rise < Z**2 else (inside, middle)
        ends.append(inside)
    np.testing.assert_allclose(found.interval()[0], ends, rtol=1e-4)


def test_another_level_is_in_proportion():
    found = fit(stiffness(0.3), starts=1)
    halves = np.log(found.interval(0.683)[0]) / np.log(found.interval(0.95)[0])
    np.testing.assert_allclose(halves, 1.0006 / Z, rtol=1e-3)


def two_wells(start: float) -> InverseProblem:
    """A cost with wells near a = -1 (the deeper one, by 0.34) and a = 1, and a hill of 2.1 between them."""
    items = (Parameter(("a",), False, start, start),)
    return InverseProblem(
        lambda p: jnp.stack([(p["a"] ** 2 - 1) / 0.7, 0.3 * (p["a"] + 1)]),
        jnp.zeros(2),
        jnp.ones(2),
        Parameters(items),
        ("value",) * 2,
    )


def test_a_better_optimum_that_is_met_on_the_way_to_an_end_is_the_answer():
    found, better = (fit(two_wells(start), starts=1) for start in (1.0, -1.0))
    np.testing.assert_allclose(found.best.theta, better.best.theta, atol=1e-6)
    assert [optimum.theta[0] > 0 for optimum in found.optima] == [False, True]
    assert found.failed == 0
    np.testing.assert_allclose(found.interval()[0, 0], better.interval()[0, 0], rtol=1e-4)
    assert found.doubts == better.doubts == ()


def test_no_interval_is_quoted_where_the_cost_is_less_elsewhere():
    found = replace(fit(two_wells(-1.0), starts=1), beaten=np.array([-1.1]))
    assert found.doubts == ("the cost is less elsewhere, so there is a better optimum: fit again with more starts",)
    assert not found.supported.any()
    assert with_stretch(found).doubts == (), "for it is not"
