"""The solver of searches among many data: to minima that are known."""

import numpy as np
import pytest
from conformance import agrees

from ident.inference.problem import Choice
from ident.inference.search import End, descent, together


def of(residuals, jacobian, counted=None):
    """A model without choices, as the solver looks at it."""

    def look(theta, held):
        if counted is not None:
            counted.append(theta)
        r, J = np.asarray(residuals(theta)), np.asarray(jacobian(theta))
        return End(theta, r @ r, 2 * J.T @ r, r, J, Choice(None, True, np.zeros(len(r))))

    return look, lambda end: (end.predicted, end.jacobian)


def minimum(look, weigh, start, held, to_the_end):
    (found,) = together([descent(weigh, start, held, to_the_end)], lambda asked: [look(*each) for each in asked])
    return found


def rosenbrock(x):
    return [10 * (x[1] - x[0] ** 2), 1 - x[0]]


def slope(x):
    return [[-20 * x[0], 10.0], [-1.0, 0.0]]


def test_a_bent_valley_is_followed_to_its_end():
    end, ended = minimum(*of(rosenbrock, slope), np.array([-1.2, 1.0]), None, True)
    assert ended
    agrees(end.theta, [1.0, 1.0], "inference", "minimum of a bent valley", "Rosenbrock 1960", rtol=1e-7, atol=1e-6)


def test_steps_that_lead_upwards_are_damped():
    """Where arctan is flat, whole steps leave for good."""
    look, weigh = of(lambda x: [np.arctan(x[0])], lambda x: [[1 / (1 + x[0] ** 2)]])
    end, ended = minimum(look, weigh, np.array([3.0]), None, True)
    assert ended
    assert abs(end.theta[0]) < 1e-6


def test_a_straight_problem_takes_two_looks():
    rng, looks = np.random.default_rng(0), []
    A, b = rng.standard_normal((50, 3)), rng.standard_normal(50)
    end, ended = minimum(*of(lambda x: A @ x - b, lambda x: A, looks), np.zeros(3), None, True)
    assert ended
    assert len(looks) == 2
    expected, what = np.linalg.lstsq(A, b)[0], "minimum of a straight problem"
    agrees(end.theta, expected, "inference", what, "NumPy's lstsq", rtol=1e-7, atol=1e-10)
    assert end.cost == pytest.approx(((A @ end.theta - b) ** 2).sum(), rel=1e-12)


def test_a_search_ends_on_what_was_computed():
    """Not on what a straight line foresees: cost and predictions are those of a look at the end."""
    look, weigh = of(lambda x: [np.exp(x[0]) - 2.0, 0.3 * x[0]], lambda x: [[np.exp(x[0])], [0.3]])
    end, ended = minimum(look, weigh, np.array([0.66]), None, True)
    there = look(end.theta, None)
    assert ended
    assert end.cost == there.cost
    np.testing.assert_array_equal(end.predicted, there.predicted)
    assert abs(there.gradient) < 1e-5


def test_a_model_without_an_answer_ends_the_search():
    end, ended = minimum(*of(lambda x: [np.nan], lambda x: [[1.0]]), np.zeros(1), None, True)
    assert ended
    assert np.isnan(end.cost)


def test_where_no_step_leads_down_it_stays():
    """A slope of the wrong sign: a last step along its straight line would end where nothing was looked at."""
    look, weigh = of(lambda x: [np.arctan(x[0])], lambda x: [[-1 / (1 + x[0] ** 2)]])
    end, ended = minimum(look, weigh, np.array([3.0]), None, True)
    assert ended
    assert end.cost == look(end.theta, None).cost
    np.testing.assert_allclose(end.theta, 3.0, atol=1e-6)  # rises that are rounding (`LEVEL`) are taken
