"""Priors and model discrepancy: densities, distribution functions, what is refused."""

import math
from itertools import pairwise

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from arms import lcd_arm
from conformance import agrees
from scipy.integrate import quad

from ident.errors import InputError
from ident.identify.unknowns import Unknowns, parameter, stiffness_parameters
from ident.inference.fit import fit
from ident.inference.parameters import Parameter, Parameters
from ident.inference.priors import CATALOGUE_TOLERANCE, Prior
from ident.inference.problem import InverseProblem, with_discrepancy

PATH = "joint1.k_tors"
FORMS = [Prior.log_normal(2e5, 0.7), Prior.log_uniform(1e5, 4e5), Prior.catalogue(1e5, 1.5e5, 1.8e5)]


def value(p):
    return jnp.stack([p[PATH]])


def single(prior):
    return Parameters((parameter(lcd_arm(), PATH, prior=prior),))


@pytest.mark.parametrize("prior", FORMS, ids=str)
def test_density_integrates_to_one_and_from_uniform_inverts_its_integral(prior):
    parameters = single(prior)
    low, high = math.log(prior.low) - 8 * prior.sd, math.log(prior.high) + 8 * prior.sd
    edges = [low, math.log(prior.low), math.log(prior.high), high]

    log_prior = jax.jit(parameters.log_prior)

    def density(x):
        return math.exp(log_prior(np.array([x])))

    def below(x):
        ends = [min(edge, x) for edge in edges]
        return sum(quad(density, a, b, epsabs=1e-12)[0] for a, b in pairwise(ends) if b > a)

    what, source = "area of a prior, all forms", "SciPy's quad"
    agrees(below(high), 1, "inference", what, source, atol=1e-9)
    for u in (0.003, 0.2, 0.5, 0.81, 0.999):
        found, what = below(float(parameters.from_uniform(jnp.array([u]))[0])), "inverse distribution of priors"
        agrees(found, u, "inference", what, "SciPy's quad", atol=1e-8)


@pytest.mark.parametrize("prior", FORMS, ids=str)
def test_residuals_and_slopes_are_those_of_the_density(prior):
    parameters = single(prior)
    for x in (math.log(prior.low) - 0.3, math.log(prior.low * prior.high) / 2, math.log(prior.high) + 0.02):
        theta = jnp.array([x])
        residual, slope = parameters.prior_residuals(theta)
        top = float(parameters.log_prior(jnp.log(jnp.array([math.sqrt(prior.low * prior.high)]))))
        assert float(residual[0]) ** 2 / 2 == pytest.approx(top - float(parameters.log_prior(theta)), abs=1e-9)
        gradient = jax.grad(lambda t: -parameters.log_prior(t))(theta)[0]
        assert float(residual[0] * slope[0]) == pytest.approx(float(gradient), abs=1e-9)


def test_a_flat_prior_leaves_a_fit_within_it_alone_and_holds_one_that_would_leave_it():
    inside, outside = (
        fit(InverseProblem(value, jnp.array([measured]), jnp.array([0.01 * measured]), single(FORMS[1]), ("k",)))
        for measured in (2.5e5, 8e5)
    )
    assert inside.best.values[0] == pytest.approx(2.5e5, rel=1e-9)
    assert inside.information.prior_share[0] == 0
    assert 4e5 < outside.best.values[0] < 6e5
    assert outside.information.prior_share[0] == 0, "an edge is one-sided: it says nothing of the curvature"


def test_a_batch_is_each_alone():
    parameters = stiffness_parameters(lcd_arm(), Unknowns(priors={PATH: FORMS[2]}))
    u = jnp.asarray(np.random.default_rng(0).uniform(size=(6, 5)))
    from_uniform, log_prior = jax.jit(parameters.from_uniform), jax.jit(parameters.log_prior)
    theta = from_uniform(u)
    for i in range(5):
        np.testing.assert_allclose(theta[:, i], from_uniform(u[:, i]), rtol=1e-14)
        np.testing.assert_allclose(log_prior(theta)[i], log_prior(theta[:, i]), rtol=1e-14)


def test_what_the_command_line_takes():
    assert Prior.parse("log-normal:2e5:0.7") == FORMS[0]
    assert Prior.parse("log-uniform:1e5:4e5") == FORMS[1]
    assert Prior.parse("catalogue:1e5:1.5e5:1.8e5") == Prior(1e5, 1.8e5, CATALOGUE_TOLERANCE)


@pytest.mark.parametrize(
    "text",
    ["", "log-normal:1", "log-uniform:a:b", "uniform:1:2", "log-uniform:2:1", "log-normal:1:0", "catalogue:nan:1"],
)
def test_refused(text):
    with pytest.raises(InputError, match=r"log-normal:MEDIAN:SD"):
        Prior.parse(text)


def test_refused_for_parameters_that_are_not_fitted_or_may_be_negative():
    with pytest.raises(InputError, match=r"did you mean joint1\.k_tors"):
        stiffness_parameters(lcd_arm(), Unknowns(priors={"joint1.k_tor": FORMS[0]}))
    with pytest.raises(InputError, match="may be negative"):
        parameter(lcd_arm(), "joint2.offset.x", prior=FORMS[0])


def linear(kinds=("a", "a", "b")):
    """Three values proportional to one parameter, of which the third contradicts the first two by 20 %."""
    item = Parameter(("k",), True, 1.0, 1.0)
    measured = jnp.array([2.0, 2.0, 2.4])
    return InverseProblem(lambda p: p["k"] * jnp.full(3, 2.0), measured, 0.01 * measured, Parameters((item,)), kinds)


def test_a_discrepancy_takes_up_a_contradiction():
    plain, free = fit(linear()), fit(with_discrepancy(linear(), {"b": 1.0}))
    assert plain.p_value < 1e-10
    assert free.parameters["discrepancy.b"] == pytest.approx(1.2, rel=1e-3)
    assert free.chi_squared < 1e-4


@pytest.mark.parametrize(
    ("widths", "words"), [({"c": 0.1}, "kind that was measured"), ({"b": math.inf}, "a width from 1e-06")]
)
def test_discrepancies_that_are_refused(widths, words):
    with pytest.raises(InputError, match=words):
        with_discrepancy(linear(), widths)


def test_no_discrepancy_is_no_change():
    problem = linear()
    assert with_discrepancy(problem, {}) is problem
