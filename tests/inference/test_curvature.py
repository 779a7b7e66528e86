"""Where intervals end: on the cost itself where that is no parabola, as closed forms have it."""

import math
from dataclasses import replace

import jax.numpy as jnp
import numpy as np
from conformance import agrees

from ident.inference.fit import fit, with_stretch
from ident.inference.optima import fixed_combinations
from ident.inference.parameters import Parameter, Parameters
from ident.inference.problem import InverseProblem

Z = 1.959963984540054


def itself(p):
    return jnp.stack([p["k"]])


def stiffness(sigma: float, prior_sd: float = math.inf) -> InverseProblem:
    """A stiffness of 1 that was measured as it is: the cost is ((k - 1) / sigma)^2, of ln(k) no parabola."""
    items = (Parameter(("k",), True, 1.0, 1.0, prior_sd),)
    return InverseProblem(itself, jnp.ones(1), jnp.full(1, sigma), Parameters(items), ("deflection",))


def test_a_long_interval_ends_where_the_cost_has_risen_enough():
    found = fit(stiffness(0.3), starts=1)
    what, source = "ends of a long interval", "1 -/+ 0.3 z, closed form"
    agrees(found.interval()[0], [1 - 0.3 * Z, 1 + 0.3 * Z], "inference", what, source, rtol=1e-4)


def test_a_short_one_is_linear_to_the_last_digit():
    found = fit(stiffness(0.05), starts=1)
    np.testing.assert_array_equal(found.stretch, 1.0)
    expected, what = np.exp([-0.05 * Z, 0.05 * Z]), "ends of a short interval"
    agrees(found.interval()[0], expected, "inference", what, "exp(-/+ z sd)", rtol=1e-9)


def test_the_prior_counts():
    """The root of ((k - 1) / sigma)^2 + (ln(k) / sd)^2 = z^2, by bisection."""
    found, ends = fit(stiffness(0.45, prior_sd=0.8), starts=1), []
    for inside, outside in ((1.0, 1e-3), (1.0, 10.0)):
        for _ in range(60):
            middle = (inside + outside) / 2
            rise = ((middle - 1) / 0.45) ** 2 + (math.log(middle) / 0.8) ** 2
            inside, outside = (middle, outside) if rise < Z**2 else (inside, middle)
        ends.append(inside)
    what, source = "ends of an interval with a prior", "bisection of the cost"
    agrees(found.interval()[0], ends, "inference", what, source, rtol=1e-4)


def test_another_level_is_in_proportion():
    found = fit(stiffness(0.3), starts=1)
    halves = np.log(found.interval(0.683)[0]) / np.log(found.interval(0.95)[0])
    np.testing.assert_allclose(halves, 1.0006 / Z, rtol=1e-3)


def wells(p):
    return jnp.stack([(p["a"] ** 2 - 1) / 0.7, 0.3 * (p["a"] + 1)])


def two_wells(start: float) -> InverseProblem:
    """A cost with wells near a = -1 (the deeper one, by 0.34) and a = 1, and a hill of 2.1 between them."""
    items = (Parameter(("a",), False, start, start),)
    return InverseProblem(wells, jnp.zeros(2), jnp.ones(2), Parameters(items), ("value",) * 2)


def test_a_better_optimum_that_is_met_on_the_way_to_an_end_is_the_answer():
    found, better = (fit(two_wells(start), starts=1) for start in (1.0, -1.0))
    np.testing.assert_allclose(found.best.theta, better.best.theta, atol=1e-6)
    assert [optimum.theta[0] > 0 for optimum in found.optima] == [False, True]
    assert found.failed == 0
    np.testing.assert_allclose(found.interval()[0, 0], better.interval()[0, 0], rtol=1e-4)
    assert found.doubts == better.doubts == ()


def test_no_interval_is_quoted_where_the_cost_is_less_elsewhere():
    found = replace(fit(two_wells(-1.0), starts=1), beaten=np.array([-1.1]))
    assert found.doubts == ("a better optimum exists: fit again with more --starts",)
    assert not found.supported.any()
    assert with_stretch(found).doubts == (), "for it is not"


def in_series(prior_sd: float) -> InverseProblem:
    """Two springs in series, of which the common one is known to 1 %: each may be soft where the other is hard."""
    items = tuple(Parameter((name,), True, 1.0, 1.0, prior_sd) for name in "ab")
    return InverseProblem(
        lambda p: jnp.stack([1 / (1 / p["a"] + 1 / p["b"])]),
        jnp.full(1, 0.5),
        jnp.full(1, 0.005),
        Parameters(items),
        ("frequency",),
    )


def test_a_combination_is_as_wide_as_its_profile():
    """a b is known to 1 % only as long as a = b: by the cost over the difference, minimised on a grid."""
    found = fit(in_series(1.0), starts=1)
    (known,) = fixed_combinations(found.problem, found.end, found.information)
    total, unlike = np.arange(-0.1, 3.0, 1e-4), np.linspace(0, 3, 4001)
    cost = [
        (((np.exp(s / 2) / (2 * np.cosh(unlike)) - 0.5) / 0.005) ** 2 + s**2 / 2 + 2 * unlike**2).min() for s in total
    ]
    ends = total[np.flatnonzero(np.array(cost) < Z**2)[[0, -1]]] / math.sqrt(2)
    what, source = "width of a known combination", "cost on a grid, minimised across"
    agrees(known.sd, np.ptp(ends) / (2 * Z), "inference", what, source, rtol=0.05)
    assert known.sd > 10 * found.information.directions[0].sd


def test_a_combination_of_a_linear_model_has_its_linear_width():
    items = tuple(Parameter((name,), False, 0.0, 0.0, 50.0) for name in "ab")
    slope = np.array([[1.0, 1.0], [1.0, 1.1]])
    problem = InverseProblem(
        lambda p: jnp.stack([row[0] * p["a"] + row[1] * p["b"] for row in slope]),
        jnp.array([0.3, 0.2]),
        jnp.array([0.1, 0.2]),
        Parameters(items),
        ("frequency", "frequency"),
    )
    found = fit(problem, starts=1)
    covariance = found.information.covariance
    for each, direction in zip(
        fixed_combinations(problem, found.end, found.information), found.information.directions, strict=True
    ):
        np.testing.assert_array_equal(each.weights, direction.weights)
        np.testing.assert_allclose(each.sd, math.sqrt(each.weights @ covariance @ each.weights), rtol=1e-5)


def test_a_combination_that_is_hardly_more_than_one_parameter_is_that_one():
    problem = replace(in_series(1.0), model=lambda p: jnp.stack([0.5 * p["a"] * p["b"] ** 0.04]))
    found = fit(problem, starts=1)
    (known,) = fixed_combinations(found.problem, found.end, found.information)
    np.testing.assert_array_equal(known.weights, [1.0, 0.0])
    assert known.sd > 3 * found.information.directions[0].sd, "b is known to its prior's factor only, and takes a along"
    np.testing.assert_allclose(known.sd, found.information.sd[0], rtol=0.05)
