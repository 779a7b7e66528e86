"""Populations of robots against a joint model sampled by NUTS, closed forms, and known truths."""

import numpy as np
import pytest
from conformance import agrees, counted
from fleets import (
    SPREADS,
    GaussianFleet,
    drawn,
    drawn_again,
    gaussian_fleet,
    joint_nuts,
    judged_fleet,
    leave_one_out_t,
    named,
)
from scipy.stats import binom

from ident.inference.population import FALSE_ALARM, Draws, Likelihood, deviations, population

pytestmark = pytest.mark.slow


ROBOTS = 6


@pytest.fixture(scope="module")
def six():
    """Six robots of two parameters, one of them faulty, and their population by normal likelihoods."""
    fleet = gaussian_fleet(np.random.default_rng(5), robots=ROBOTS, parameters=2, faulty=2)
    return fleet, population(fleet.likelihoods, np.zeros(2), np.ones(2), seed=1, steps=6000)


def test_the_joint_model_agrees(six):
    fleet, ours = six
    theirs = joint_nuts(fleet, seed=2)
    assert ours.normal == tuple(range(ROBOTS))
    assert ours.r_hat < 1.02
    assert_close(ours.mean, theirs["mean"])
    assert_close(np.log(ours.sd), np.log(theirs["sd"]))
    assert_close(ours.share[:, None], theirs["share"][:, None])
    spread = theirs["theta"].std(0)
    assert (np.abs(ours.robot_mean - theirs["theta"].mean(0)) < 0.15 * spread).all()
    what, source = "std. errors of each robot of a fleet", "NumPyro's NUTS on the joint model"
    agrees(ours.robot_sd, spread, "inference", what, source, rtol=0.12)
    what, source = "chance that a robot is faulty", "NumPyro's NUTS on the joint model"
    agrees(ours.off, theirs["off"].mean(0), "inference", what, source, rtol=1e-7, atol=0.05)


def assert_close(ours, theirs):
    """Demand equal means and quantiles, within an eighth of a standard deviation: the Monte Carlo error of both."""
    sd = theirs.std(0)
    assert (np.abs(ours.mean(0) - theirs.mean(0)) < 0.125 * sd).all()
    for q in (0.1, 0.5, 0.9):
        assert (np.abs(np.quantile(ours, q, 0) - np.quantile(theirs, q, 0)) < 0.2 * sd).all()


def test_a_normal_approximation_that_is_wrong_is_mended_by_draws():
    """Robots said to be half as sure as they are, and off by their sd: draws from there are weighed by the truth."""
    rng = np.random.default_rng(6)
    fleet = gaussian_fleet(rng, robots=8, parameters=2)
    wrong = tuple(
        Likelihood(each.precision / 4, each.shift / 4 + np.sqrt(np.diag(each.precision)) / 4)
        for each in fleet.likelihoods
    )

    def redraw(which, under):
        return [weighed(drawn_again(wrong[r], under, rng, 4000), wrong[r], fleet.likelihoods[r]) for r in which]

    exact = population(fleet.likelihoods, np.zeros(2), np.ones(2), steps=4000)
    weighted = population(wrong, np.zeros(2), np.ones(2), redraw=redraw, steps=800)
    assert weighted.normal == ()
    assert_close(weighted.mean, exact.mean)
    assert_close(weighted.sd, exact.sd)
    assert np.abs(population(wrong, np.zeros(2), np.ones(2)).mean.mean(0) - exact.mean.mean(0)).max() > 0.02


def weighed(draws, drawn_from, truth):
    """Say of draws by one likelihood what they are worth by another."""
    change = log_likelihood(drawn_from, draws.theta) - log_likelihood(truth, draws.theta)
    return Draws(draws.theta, draws.log_prior + change, truth)


def log_likelihood(of, theta):
    return theta @ of.shift - np.einsum("np,pq,nq->n", theta, of.precision, theta) / 2


def test_a_robot_that_leaves_directions_open_is_drawn_again():
    """As the issue has tried: four directions open, the population's sd a tenth of the interim prior's."""
    rng = np.random.default_rng(4)
    fleet = gaussian_fleet(rng, robots=6, parameters=4, sd=0.1)
    blind = Likelihood(np.zeros((4, 4)), np.zeros(4))
    asked = []

    def redraw(which, under):
        asked.append((which, under.sd.max()))
        return [drawn_again((*fleet.likelihoods, blind)[r], under, rng, 6000) for r in which]

    robots = (*fleet.likelihoods, drawn(blind, np.zeros(4), np.ones(4), rng))
    result = population(robots, np.zeros(4), np.ones(4), redraw=redraw, steps=300)
    assert 6 in asked[0][0], "draws under the interim prior do not do"
    assert asked[0][1] < 1.0, "narrower than the interim prior"
    assert result.normal == ()
    alone = population(robots, np.zeros(4), np.ones(4), steps=300)
    assert 6 in alone.normal, "without a way to draw again, an approximation takes its place"
    np.testing.assert_allclose(alone.robot_mean[6], alone.mean.mean(0), atol=0.05)


def test_of_draws_that_never_do_the_normal_approximation_is_taken(six):
    fleet, exact = six
    rng, asked = np.random.default_rng(8), []

    def redraw(which, under):
        asked.append(which)
        return [
            None if r == 1 else drawn_again(fleet.likelihoods[r], under, rng, 150 if r == 0 else 2000) for r in which
        ]

    result = population(fleet.likelihoods, np.zeros(2), np.ones(2), redraw=redraw, steps=400)
    assert asked == [[*range(ROBOTS)], [0, 1], [0, 1]]
    assert result.normal == (0, 1)
    assert len(result.trusted) == ROBOTS - 2
    assert result.log_likelihood_variance < 1
    assert_close(result.mean, exact.mean)


def test_small_rates(fleets):
    """Spread and mean cover truth, shrinkage pays, faults are found: 12 fleets; the study is benchmarks/fleet.py."""
    covered = np.array([each.covered for each in fleets]).ravel()
    low, high = binom.ppf([0.0005, 0.9995], len(covered), 0.95)
    what, source = "means and spreads of fleets within their intervals", "95 % promised, known fleets"
    counted(covered.sum(), len(covered), low, high, "verdict rates", what, source, expected=0.95 * len(covered))
    assert sum(each.shrunk_error for each in fleets) < 0.8 * sum(each.own_error for each in fleets)
    assert sum(each.found() for each in fleets) >= 8
    assert sum(each.false_alarms() for each in fleets) <= 2


@pytest.fixture(scope="module")
def fleets():
    return [GaussianFleet.tried(seed, steps=300) for seed in range(12)]


@pytest.mark.parametrize("good", [True, False])
def test_a_fault_is_named_and_nothing_else(good):
    """Fleets of eight, healthy and with a factor of 0.6 on one; the study is `benchmarks/fleet.py --eight`."""
    rng, count = np.random.default_rng(38), 60
    alarms, found, beside, tests, by_t = 0, 0, 0, [], []
    for _ in range(count):
        spread, place = SPREADS["as data/fleet"](rng), (int(rng.integers(8)), int(rng.integers(3, 6)))
        healthy, t = judged_fleet(rng, spread, good=good)
        alarms += bool(named(healthy, FALSE_ALARM))
        tests.append(t.min())
        faulty, t = judged_fleet(rng, spread, [place], good)
        found += place in named(faulty, FALSE_ALARM)
        beside += any(r != place[0] for r, _ in named(faulty, FALSE_ALARM))
        by_t.append(t[place[0]].min())
    most, what = binom.ppf(0.999, count, FALSE_ALARM), "healthy fleets with an alarm"
    what += ", good data" if good else ", rough data"
    counted(alarms, count, 0, most, "verdict rates", what, "level promised", expected=FALSE_ALARM * count)
    assert beside <= binom.ppf(0.999, count, FALSE_ALARM)
    assert found >= (28 if good else 16)
    assert found > (np.array(by_t) < np.quantile(tests, 0.05)).sum()


def test_p_values_of_healthy_robots_are_uniform():
    rng = np.random.default_rng(39)
    p = np.concatenate([judged_fleet(rng, SPREADS["3 to 15 %"](rng))[0].p.ravel() for _ in range(40)])
    for level in (0.02, 0.1, 0.5, 0.9):
        low, high = binom.ppf([0.0005, 0.9995], len(p), level)
        assert low * 0.9 <= (p < level).sum() <= high * 1.1, level


def test_without_errors_of_data_and_one_parameter_it_is_the_t_test():
    """Of twelve values known exactly; the prior of the spread, wide for one parameter, counts little."""
    values = np.random.default_rng(40).normal(0.3, 0.1, 12)
    values[4] = -0.3
    robots = [Likelihood(np.array([[1e12]]), np.array([1e12 * x])) for x in values]
    judged = deviations(robots, np.zeros(1), np.ones(1), 0.0)
    others = np.delete(values, 4)
    np.testing.assert_allclose(judged.difference[4], values[4] - others.mean(), rtol=0.01)
    expected, what = leave_one_out_t(values[:, None])[4], "p-value of a robot that stands out"
    agrees(judged.p[4], expected, "inference", what, "Student's t, leave one out", rtol=0.35)
    assert judged.named == ()
    judged = deviations(robots, np.zeros(1), np.ones(1))
    assert judged.named == ((4, 0),)
    rest = leave_one_out_t(others[:, None])[:, 0]
    np.testing.assert_allclose(np.delete(judged.p[:, 0], 4), rest, rtol=0.35, atol=0.02)


def test_what_stands_out_does_not_widen_the_population():
    """Seven robots within 8 %, one 0.3 lower, of which the mixture alone is not sure."""
    values = np.append(np.random.default_rng(41).normal(0.0, 0.08, 7), -0.3)[:, None]
    robots = tuple(Likelihood(np.array([[1e4]]), 1e4 * x) for x in values)
    off = np.arange(8)[:, None] == 7
    known, unknown = (population(robots, np.zeros(1), np.ones(1), off=each, steps=400) for each in (off, None))
    assert known.off[7, 0] == 1.0
    assert known.off[:7].max() < 0.1
    assert np.median(known.sd) < 0.8 * np.median(unknown.sd)


def test_data_that_say_nothing_are_not_judged():
    fleet = gaussian_fleet(np.random.default_rng(42), robots=6, parameters=2, sd=0.1)
    blind = Likelihood(np.diag([0.0, 900.0]), np.array([0.0, 900.0 * fleet.mean[1]]))
    judged = deviations([*fleet.likelihoods, blind], np.zeros(2), np.ones(2))
    assert judged.p[6, 0] == 1.0
    assert judged.p[6, 1] < 1.0
    assert np.isfinite(judged.sd).all()
