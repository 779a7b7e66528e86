"""Kinds of data against each other: closed forms of linear models, priors of any form, and several optima."""

import math
from itertools import pairwise

import conformance
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import quad
from scipy.optimize import minimize_scalar
from scipy.stats import chi2, kstest

from ident.inference.fit import agrees, contradicting, cross_predictions, fit, moment_sd, quadratic_form
from ident.inference.parameters import Parameter, Parameters
from ident.inference.problem import InverseProblem
from ident.inference.search import solve, weighed


class Linear(eqx.Module):
    """Values A @ (a, b, ...)."""

    A: jnp.ndarray

    def __call__(self, parameters):
        return jnp.tensordot(self.A, jnp.stack([parameters[name] for name in "abcdef"[: self.A.shape[1]]]), 1)


def posed(model, count, measured, sigma=1.0, kinds="xy", *, positive=False, start=0.0, **prior):
    items = tuple(Parameter((name,), positive, start, start, **prior) for name in "abcdef"[:count])
    measured = jnp.asarray(measured, float)
    return InverseProblem(model, measured, jnp.full(len(measured), sigma), Parameters(items), tuple(kinds))


def linear(A, measured, **options):
    A = np.asarray(A, float)
    return posed(Linear(jnp.asarray(A)), A.shape[1], measured, **options)


def compared(problem, known=None):
    start = np.asarray(problem.parameters.theta(problem.parameters.column("start")))
    found, _ = cross_predictions(problem, [start if known is None else known])
    return {each.kind: each for each in found}


def test_contradicting_kinds_in_closed_form():
    found = compared(linear([[1], [1], [1]], [3.0, 5.0, 10.0], sigma=0.5, kinds="xxy"))
    x, y = found["x"], found["y"]
    assert (x.rows, y.rows) == ((0, 1), (2,))
    np.testing.assert_allclose(y.predicted, 4)
    expected, source = (10 - 4) / (0.5 * math.sqrt(1 + 1 / 2)), "normal distributions, by hand"
    what = "one kind of data predicted from another"
    conformance.agrees(y.z, expected, "inference", what, source, rtol=1e-7)
    np.testing.assert_allclose(x.z, [(3 - 10) / (0.5 * math.sqrt(2)), (5 - 10) / (0.5 * math.sqrt(2))])
    assert y.statistic == pytest.approx(y.z[0] ** 2), "what is off within x is no matter between x and y"
    assert x.statistic == pytest.approx(y.statistic)
    for each in (x, y):
        assert (each.degrees_of_freedom, each.scale) == pytest.approx((1, 1))
        what, source = "p-value of a contradiction", "SciPy's chi-squared"
        conformance.agrees(each.p_value, chi2.sf(96, 1), "inference", what, source, rtol=1e-6)
        assert each.sd == pytest.approx(math.sqrt(96))
    assert contradicting([x, y]) == (x, y)


@pytest.mark.parametrize(("y", "fine"), [(4.0, True), (5.1, True), (5.2, False), (10.0, False)])
def test_an_optimum_agrees_where_no_kind_contradicts_the_others(y, fine):
    """The mean of 25 is 4 within 0.1; y is off it by 3.14 or 3.43 sd of the difference, 0.35: twice 0.0027 is 3.2."""
    problem = linear(np.ones((26, 1)), [4.0] * 25 + [y], sigma=0.5 * 0.7, kinds="x" * 25 + "y")
    end = solve(problem, problem.parameters.theta_start)
    assert agrees(problem, *weighed(problem, end)) == fine
    assert (not contradicting(list(compared(problem).values()))) == fine


def test_a_prior_is_a_measurement_too():
    """x = a + b, y = a; prior N(0, 2) on each: y given x is N(x 4/9, 4 - 16/9) with sigma 1 on x."""
    assert compared(linear([[1, 1], [1, 0]], [3.0, 0.0], prior_sd=2.0))["y"].z is None, "nothing contradicts"
    found = compared(linear([[1, 1], [1, 0]], [90.0, 0.0], prior_sd=2.0))
    np.testing.assert_allclose(found["y"].predicted, 40)
    what, source = "prediction with priors", "conditional normal, by hand"
    conformance.agrees(found["y"].z, -40 / math.sqrt(1 + 4 - 16 / 9), "inference", what, source, rtol=1e-7)
    np.testing.assert_allclose(found["x"].z, 90 / math.sqrt(1 + 8 - 16 / 5))


def test_what_the_others_leave_open_is_not_tested():
    assert compared(linear([[1, 0], [0, 1]], [3.0, 7.0])) == {}


def test_one_kind_alone_is_not_tested():
    problem = linear([[1], [1]], [3.0, 7.0], kinds="xx")
    assert compared(problem) == {}
    assert not fit(problem).contradictory


@pytest.mark.parametrize(("rows", "freedom"), [(4, 2), (2, 1), (1, 0)])
def test_without_prior_the_degrees_of_freedom_are_those_of_the_ranks(rows, freedom):
    """rank(k) + rank(others) - rank(all), of two values of the kind and `rows` others of three unknowns."""
    A = np.random.default_rng(3).standard_normal((2 + rows, 3))
    own = np.arange(len(A)) < 2
    rank = np.linalg.matrix_rank
    assert rank(A[own]) + rank(A[~own]) - rank(A) == freedom
    scale, found = quadratic_form(A, np.full(3, np.inf), own)
    assert (scale, found) == pytest.approx((1, freedom))


def campaign(rng, draw_prior, widths):
    """Three kinds on five unknowns, of which each kind sees some, one of them badly; truths from the prior."""
    scale = np.array([5, 3, 1, 0.3, 0.05])
    A = np.random.default_rng(7).standard_normal((8, 5)) * scale
    A[:3, 3:] = 0
    truth = widths * draw_prior(rng)
    return A, A @ truth + rng.standard_normal(8), "xxxyyyzz"


def least(A, b):
    return float(np.sum((b - A @ np.linalg.lstsq(A, b, rcond=None)[0]) ** 2))


def test_truths_from_the_prior_give_uniform_p_values():
    """1000 linear campaigns; the minima by least squares, so that only the distribution is ident's."""
    rng, widths = np.random.default_rng(11), np.ones(5)
    p = {kind: [] for kind in "xyz"}
    for _ in range(1000):
        A, b, kinds = campaign(rng, lambda rng: rng.standard_normal(5), widths)
        for kind in p:
            own = np.array([k == kind for k in kinds])

            def minimum(rows, width, A=A, b=b):
                return least(np.vstack([A[rows], np.eye(5) / width]), np.append(b[rows], np.zeros(5)))

            T = minimum(own | True, 1.0) - minimum(~own, 1.0) - minimum(own, 10.0)
            scale, freedom = quadratic_form(A, widths, own)
            p[kind].append(chi2.sf(T / scale, freedom))
    for kind, values in p.items():
        what, source = f"p-values of right campaigns, kind {kind}", "uniform: SciPy's Kolmogorov-Smirnov"
        conformance.within(kstest(values, "uniform").pvalue, 1e-3, 1.0, "verdict rates", what, source)


def test_the_statistic_is_that_of_the_minima():
    A, b, kinds = campaign(np.random.default_rng(2), lambda rng: rng.standard_normal(5), np.ones(5))
    found = compared(linear(A, b, kinds=kinds, prior_sd=1.0))
    for kind, each in found.items():
        own = np.array([k == kind for k in kinds])
        parts = [
            least(np.vstack([A[rows], np.eye(5) / width]), np.append(b[rows], np.zeros(5)))
            for rows, width in ((own | True, 1.0), (~own, 1.0), (own, 10.0))
        ]
        what, source = "statistic of kinds against each other", "three least squares, NumPy"
        expected = parts[0] - parts[1] - parts[2]
        conformance.agrees(each.statistic, expected, "inference", what, source, rtol=1e-6)


@pytest.mark.parametrize(("sd", "flat"), [(0.7, 0.0), (0.01, 1.2), (0.1, 0.3), (1.0, 1.0)])
def test_a_prior_has_the_standard_deviation_of_its_density(sd, flat):
    parameters = Parameters((Parameter(("k",), True, 2.0, 2.0, sd, 1.0, flat),))

    log_prior = jax.jit(parameters.log_prior)

    def moment(power):
        def density(x):
            return x**power * math.exp(log_prior(np.array([math.log(2.0) + x])))

        edges = [0.0, flat, flat + 12 * sd]
        return 2 * sum(quad(density, a, b, epsabs=1e-13)[0] for a, b in pairwise(edges) if b > a)

    assert moment(0) == pytest.approx(1, rel=1e-6)
    expected, what = math.sqrt(moment(2)), "std. deviation of a flat-topped prior"
    conformance.agrees(moment_sd(parameters)[0], expected, "inference", what, "SciPy's quad", rtol=1e-6)


def test_without_prior_there_is_no_standard_deviation():
    assert np.isinf(moment_sd(Parameters((Parameter(("k",), True, 2.0, 2.0),))))


def test_flat_priors_raise_rather_too_few_alarms():
    """1000 truths uniform where the prior is flat: T by least squares with the normal prior of that variance."""
    rng, widths = np.random.default_rng(5), np.ones(5)
    alarms = {0.05: 0, 0.003: 0}
    for _ in range(1000):
        A, b, kinds = campaign(rng, lambda rng: rng.uniform(-math.sqrt(3), math.sqrt(3), 5), widths)
        own = np.array([k == "z" for k in kinds])
        parts = [
            least(np.vstack([A[rows], np.eye(5) / width]), np.append(b[rows], np.zeros(5)))
            for rows, width in ((own | True, 1.0), (~own, 1.0), (own, 10.0))
        ]
        scale, freedom = quadratic_form(A, widths, own)
        p = chi2.sf((parts[0] - parts[1] - parts[2]) / scale, freedom)
        for level in alarms:
            alarms[level] += p < level
    for level, most in ((0.05, 70), (0.003, 9)):
        what, source = f"alarms at {level:g}, truths from flat priors", "promised level, 1000 campaigns"
        conformance.counted(alarms[level], 1000, 0, most, "verdict rates", what, source, expected=1000 * level)


def test_a_power_is_followed_however_far_the_start():
    """The values k and 1 / k^2, started at 100 times the truth."""
    model = lambda p: jnp.stack([p["a"], p["a"] ** -2])  # noqa: E731
    y = compared(posed(model, 1, [2.0, 0.30], sigma=0.01, positive=True, start=200.0))["y"]
    np.testing.assert_allclose(y.predicted, 0.25)
    assert y.z[0] == pytest.approx(0.05 / math.hypot(0.01, 0.25 * 2 * 0.01 / 2), rel=0.1), "a line, nearly"


def test_a_better_optimum_that_a_part_leads_to_is_taken():
    """y = 10 (a^2 - 1)^2 holds the search at the wrong sign, where x = a alone leads to the right one."""
    model = lambda p: jnp.stack([p["a"], 10 * (p["a"] ** 2 - 1) ** 2])  # noqa: E731
    cost = lambda a: (a + 1) ** 2 + 100 * (a**2 - 1) ** 4  # noqa: E731
    held = minimize_scalar(cost, bounds=(0.2, 1.0), options={"xatol": 1e-9}).x
    problem, wrong = posed(model, 1, [-1.0, 0.0], sigma=0.3, start=held), np.array([held])
    assert float(solve(problem, wrong).theta[0]) == pytest.approx(wrong[0], abs=1e-3)
    _, theta = cross_predictions(problem, [wrong])
    assert theta[0] == pytest.approx(-1, abs=1e-3)
    found = fit(problem, starts=1)
    assert found.best.theta[0] == pytest.approx(-1, abs=1e-3)
    assert len(found.optima) == 2


def test_a_contradiction_says_what_wider_priors_leave_of_it():
    """x = a + b, y = a: 9 against 0, and so does the prior on b alone contradict them."""
    found = compared(linear([[1, 1], [1, 0]], [9.0, 0.0], sigma=0.1, prior_sd=2.0))
    y = found["y"]
    assert y.wider > 3 * y.p_value
    far = compared(linear([[1], [1]], [9.0, 0.0], sigma=0.1, prior_sd=20.0))["y"]
    assert far.wider < 1e-100
