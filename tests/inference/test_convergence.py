"""When a search has ended: the next step in standard deviations, and directions that are open."""

import jax.numpy as jnp
import numpy as np
import pytest
from conformance import agrees

from ident.errors import InputError
from ident.inference.fit import fit
from ident.inference.information import RARE, farthest, rare, standard_deviations
from ident.inference.parameters import Parameter, Parameters
from ident.inference.problem import InverseProblem
from ident.inference.search import OPTIMUM_STEP, convergence, evaluate


def problem(model, measured, sigma=1.0, *, names="a", start=1.0, kinds=None, **prior):
    items = tuple(Parameter((name,), True, start, start, **prior) for name in names)
    measured = jnp.asarray(measured, float)
    kinds = kinds or ("value",) * len(measured)
    return InverseProblem(model, measured, jnp.full(len(measured), sigma), Parameters(items), kinds)


def twice(p):
    return jnp.stack([p["a"], p["a"]])


def at(posed, theta):
    """How a search would have ended there."""
    theta = np.asarray(theta, float)
    end = evaluate(posed, theta)
    residuals, _ = posed.weigh(np.asarray(end.predicted), np.asarray(end.jacobian), theta)
    return convergence(posed, end._replace(cost=residuals @ residuals))


@pytest.mark.parametrize("sigma", [1e-6, 1.0])
@pytest.mark.parametrize("off", [1e-6, 1e-4, 1e-2, 1.0])
def test_the_step_is_the_distance_to_the_optimum_in_standard_deviations(off, sigma):
    """Two values of one parameter that are 60 sd apart: sd = a sigma / sqrt(2) in theta, however large the cost."""
    posed = problem(twice, [1 - 30 * sigma, 1 + 30 * sigma], sigma)
    sd = sigma / np.sqrt(2)
    found = at(posed, [np.log1p(off * sd)])
    what, source = "step to the optimum in std. errors", "distance, by hand"
    agrees(found.step, off, "inference", what, source, rtol=1e-2)
    assert found.converged == (off < OPTIMUM_STEP)
    assert len(found.open) == 0


def test_what_no_value_depends_on_is_open():
    found = at(problem(lambda p: p["a"][None], [1.0], names="ab"), [0.0, 0.7])
    assert found.converged
    np.testing.assert_allclose(np.abs(found.open), [[0, 1]], atol=1e-12)


def test_a_direction_in_which_the_cost_still_falls_over_several_e_folds_is_open():
    """y = 1 + 1 / b, measured 0.9: the cost falls for ever as b grows, by less and less."""
    posed = problem(lambda p: jnp.stack([p["a"], 1 + 1 / p["b"]]), [1.0, 0.9], 0.1, names="ab")
    found = at(posed, [0.0, 5.0])
    assert found.converged
    np.testing.assert_allclose(np.abs(found.open), [[0, 1]], atol=1e-12)
    near = at(posed, [0.0, 1.0])
    assert not near.converged, "where the data still see b, the search has not ended"
    answer = fit(posed, starts=1)
    assert answer.best.converged
    assert len(answer.best.open) == 1
    assert not answer.supported[1]


def test_a_slope_towards_an_optimum_is_not_open():
    """y = ln(b) / 4, measured 0: known to several e-folds only, but the cost rises beyond."""
    posed = problem(lambda p: (jnp.log(p["b"]) / 4)[None], [0.0], names="b")
    found = at(posed, [2.0])
    assert found.step == pytest.approx(0.5)
    assert not found.converged


def test_holms_correction():
    """Of four chances, RARE / 4, RARE / 3, RARE / 2 are compared in turn, until one is larger."""
    assert rare([]).tolist() == []
    assert rare([RARE / 1.1]).tolist() == [True]
    assert rare([RARE * 1.1]).tolist() == [False]
    assert rare([0.5, RARE / 4.1, RARE / 1.9, RARE / 3.1]).tolist() == [False, True, False, True]
    assert rare([RARE / 1.1, RARE / 4.1, RARE / 2.1, RARE / 3.1]).tolist() == [True] * 4
    assert rare([RARE / 1.1, RARE / 3.9, RARE / 2.1, RARE / 3.1]).tolist() == [False] * 4


def test_the_limit_for_a_single_row_grows_with_their_number():
    assert farthest(1) == pytest.approx(3)
    what, source = "limit for the largest of 20 and of 1000 rows", "normal quantiles, Bonferroni"
    agrees([farthest(20), farthest(1000)], [3.82, 4.70], "inference", what, source, atol=0.01)
    assert standard_deviations(RARE) == pytest.approx(3)
    assert standard_deviations(0.0) == np.inf


def straight(p):
    return p["a"] * jnp.ones(6)


@pytest.mark.parametrize(
    ("off", "doubt"),
    [
        ([0.0, 0.1, -0.2, 0.2, 0.1, -0.1], None),
        (
            [0.0, 0.1, -0.2, 9.0, 0.1, -0.1],
            "1 of 6 measurements lie too far from the fit (standardised residual above 3.5)",
        ),
        ([2.9, -2.9, 2.9, -2.9, 2.9, -2.9], "chi-squared is too large for these sigmas (p = "),
    ],
)
def test_a_generic_fit_says_its_doubts_and_withholds(off, doubt):
    found = fit(problem(straight, 50 + np.array(off)))
    assert found.supported.all() == (doubt is None)
    assert bool(found.doubts) == (doubt is not None)
    assert doubt is None or any(each.startswith(doubt) for each in found.doubts)


def test_contradicting_kinds_of_a_generic_model_are_told():
    found = fit(problem(straight, [50, 50, 50, 60, 60, 60], kinds=("x",) * 3 + ("y",) * 3))
    assert found.contradictory
    assert any("contradict each other" in doubt for doubt in found.doubts)
    assert not found.supported.any()


def test_so_small_a_chi_squared_is_remarked_but_withholds_nothing():
    found = fit(problem(straight, 50 + 1e-3 * np.arange(6)))
    assert any("sigmas are too large, or rows copied" in remark for remark in found.remarks)
    assert found.supported.all()
    assert fit(problem(straight, 50 + np.array([0.5, -1.0, 0.7, -0.3, 1.1, -0.6]))).remarks == ()


@pytest.mark.parametrize(
    ("measured", "sigma", "words"),
    [
        ([1.0, np.nan], 1.0, "value 2, `measured`: got nan, expected a finite number; leave that value out"),
        ([np.inf, 1.0], 1.0, "value 1, `measured`: got inf"),
        ([1.0], np.nan, "value 1, `sigma`: got nan, expected a number > 0"),
        ([1.0], 0.0, "value 1, `sigma`: got 0, expected a number > 0"),
    ],
)
def test_data_that_cannot_be_are_named(measured, sigma, words):
    with pytest.raises(InputError) as error:
        problem(lambda p: p["a"] * jnp.ones(len(measured)), measured, sigma)
    assert str(error.value).startswith(words)
    assert len(str(error.value).splitlines()) == 1
