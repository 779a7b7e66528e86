"""The sampler: closed forms, several optima, checkpoints to the bit, what is refused."""

import math
import shutil
from dataclasses import replace

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from chains import WIDTHS, linear_problem, storey_problem
from conformance import agrees
from kills import killed_and_alone

from ident.errors import InputError, ModelError
from ident.inference.chains import diagnose
from ident.inference.draws import posterior_predictive, weigh
from ident.inference.fit import fit
from ident.inference.parameters import Parameter, Parameters
from ident.inference.posterior import evaluate, posterior
from ident.inference.problem import InverseProblem
from ident.inference.sample import Settings, sample
from ident.inference.search import evaluate as predictions

pytestmark = pytest.mark.slow

WALKERS = 12
"""Of every ensemble but those of several springs, so that a model is compiled for one size of batch."""
SHORT = Settings(max_steps=500, walkers=WALKERS)
CAMPAIGN = {"campaign": "a"}


class Alone(eqx.Module):
    """One value of one unknown: itself, itself above 0.8 only, one that does not depend on it, or none at all."""

    which: np.ndarray

    def __call__(self, p):
        k = p["k"]
        return jnp.stack([k, jnp.where(k > 0.8, k, jnp.nan), 1 + 0 * k, jnp.nan * k])[self.which][None]


ITSELF, ABOVE, CONSTANT, NOWHERE = map(np.array, range(4))


def alone(which, measured, sigma, **prior):
    """The problem of one of these; its prior has a width of 1 unless another one is said."""
    item = Parameter(("k",), True, 1.0, 1.0, **{"prior_sd": 1.0} | prior)
    return InverseProblem(Alone(which), jnp.array([measured]), jnp.array([sigma]), Parameters((item,)), ("x",))


class Pair(eqx.Module):
    """One value of two unknowns: their product, or the second one."""

    which: np.ndarray

    def __call__(self, p):
        return jnp.stack([p["a"] * p["b"], p["b"]])[self.which][None]


def pair(which, *widths):
    items = tuple(Parameter((name,), True, 1.0, 1.0, sd) for name, sd in zip("ab", widths, strict=True))
    return InverseProblem(Pair(np.array(which)), jnp.array([1.0]), jnp.array([0.1]), Parameters(items), ("x",))


@pytest.fixture(scope="module")
def linear():
    """A linear problem, fitted, with the closed form of its posterior."""
    problem, mean, covariance = linear_problem()
    return fit(problem), posterior(problem), mean, covariance


@pytest.fixture(scope="module")
def drawn(linear):
    found, target, _, _ = linear
    return sample(found, target, Settings(target_ess=4000, seed=1, walkers=WALKERS))


@pytest.fixture(scope="module")
def kept(linear, tmp_path_factory):
    """A short run and the folder of its checkpoints, which no test changes."""
    found, target, _, _ = linear
    folder = tmp_path_factory.mktemp("kept")
    return sample(found, target, SHORT, folder=folder, provenance=CAMPAIGN), folder


def test_density_is_that_of_the_closed_form(linear):
    _, target, mean, covariance = linear
    theta = mean + np.random.default_rng(0).normal(size=(7, 3))
    value = evaluate(target, theta, WALKERS).log_density
    off = theta - mean
    exact = -np.einsum("np,pq,nq->n", off, np.linalg.inv(covariance), off) / 2
    what, source = "posterior density of a linear model", "normal, closed form"
    agrees(value - value[0], exact - exact[0], "inference", what, source, rtol=1e-9)


def test_linear_gaussian_draws_agree_with_the_closed_form(linear, drawn):
    """Means and variances within 4 standard errors, these by the effective sample size."""
    found, _, mean, covariance = linear
    source = "normal, closed form"
    agrees(found.best.theta, mean, "inference", "fit of a linear model with priors", source, rtol=1e-8)
    agrees(
        found.information.covariance,
        covariance,
        "inference",
        "covariance of a linear model with priors",
        source,
        rtol=1e-8,
    )
    (diagnosis,) = drawn.diagnosis
    assert diagnosis.enough(4000)
    draws, sd = drawn.draws(), np.sqrt(np.diag(covariance))
    error = 4 * sd / np.sqrt(diagnosis.bulk)
    what = "means of chains, over 4 Monte Carlo errors"
    agrees(draws.mean(0) / error, mean / error, "inference", what, source, atol=1.0)
    error = 4 * np.sqrt(2 / diagnosis.tail)
    what = "variances of chains, over 4 Monte Carlo errors"
    agrees(draws.var(0) / sd**2 / error, 1 / error, "inference", what, source, atol=1.0)
    correlation = np.corrcoef(draws.T) - covariance / np.outer(sd, sd)
    assert np.abs(correlation).max() < 4 / math.sqrt(diagnosis.bulk.min())


def test_predictions_carry_parameters_and_noise(linear, drawn):
    found, _, _, covariance = linear
    A, predictive = np.asarray(found.problem.model.A) * WIDTHS, posterior_predictive(drawn)
    expected = np.diag(A @ covariance @ A.T)
    what, source = "variance of predictions of a chain", "J P J', closed form"
    agrees(predictive.predicted.var(0), expected, "inference", what, source, rtol=0.15)
    np.testing.assert_allclose(predictive.simulated.var(0), expected + np.asarray(found.problem.sigma) ** 2, rtol=0.15)


def test_an_unknown_noise_scale_is_found():
    """100 values of one unknown mean, three times as scattered as their sigma says."""
    rng = np.random.default_rng(2)
    item = Parameter(("m",), False, 0.0, 0.0, 1.0, 100.0)
    problem = InverseProblem(
        lambda p: jnp.broadcast_to(p["m"], (100, *jnp.shape(p["m"]))),
        jnp.asarray(3.0 * rng.standard_normal(100)),
        jnp.ones(100),
        Parameters((item,)),
        ("x",) * 100,
    )
    drawn = sample(fit(problem), posterior(problem, ["x"]), Settings(target_ess=400))
    assert drawn.posterior.parameters.names == ("m", "noise.x")
    scale = np.exp(drawn.draws()[:, 1])
    about = np.std(np.asarray(problem.measured))
    what, source = "scale of the noise, sampled", "std. deviation of 100 values"
    agrees(scale.mean(), about, "inference", what, source, rtol=0.03)
    assert scale.std() == pytest.approx(about / math.sqrt(200), rel=0.25)


def test_each_of_a_chains_four_solutions_is_sampled():
    """Four exact frequencies fit four spring sets equally well."""
    problem = storey_problem(np.array([1.2, 0.9, 1.1, 0.8]) * 1e6, sigma=0.0001, width=0.7)
    found = fit(problem, starts=30, seed=3)
    drawn = sample(found, posterior(problem), Settings(target_ess=100))
    assert drawn.basins == (0, 1, 2, 3)
    for basin in drawn.basins:
        sd = np.sqrt(np.diag(_laplace(problem, found.optima[basin].theta, 0.7)))
        assert (np.abs(drawn.draws(basin).mean(0) - found.optima[basin].theta) < 0.5 * sd).all()


def _laplace(problem, theta, width):
    """The covariance of the normal approximation."""
    J = np.asarray(predictions(problem, theta).jacobian) / np.asarray(problem.sigma)[:, None]
    return np.linalg.inv(J.T @ J + np.eye(len(theta)) / width**2)


def four_wells(p):
    return ((p["x"] ** 2 - 1) ** 2)[None]


@pytest.fixture(scope="module")
def wells():
    """Draws about four solutions, two of either sign: between those of a sign the cost rises by 1, about 0 by 576."""
    item = Parameter(("x",), False, 0.8, 0.8, 1.0)
    problem = InverseProblem(four_wells, jnp.array([0.04]), jnp.array([0.04]), Parameters((item,)), ("x",))
    return sample(fit(problem, starts=30), posterior(problem), Settings(target_ess=300, walkers=WALKERS))


def test_optima_without_a_barrier_between_them_are_one_posterior(wells):
    sides = [bool(optimum.theta[0] > 0) for optimum in wells.fit.optima]
    assert len(sides) == 4
    assert wells.basins == tuple(sorted(sides.index(side) for side in (True, False)))
    assert wells.basin == tuple(sides.index(sides[started]) for started in wells.started)
    for basin in wells.basins:
        own = wells.draws(basin)[:, 0]
        assert (np.sign(own) == np.sign(wells.fit.optima[basin].theta[0])).all()
        assert 0.1 < (np.abs(own) > 1).mean() < 0.9, "they go from one to the other"


def test_solutions_are_weighed_against_each_other(wells):
    """Against the posterior on a grid."""
    x = np.linspace(-2.5, 2.5, 20001)
    density = np.exp(-((((x**2 - 1) ** 2 - 0.04) / 0.04) ** 2 + (x - 0.8) ** 2) / 2)
    exact = np.array([density[np.sign(x) == np.sign(wells.fit.optima[basin].theta[0])].sum() for basin in wells.basins])
    weights = weigh(wells)
    what, source, least = "weights of separated optima", "posterior on a grid", float(4 * weights.sd.max())
    agrees(weights.share, exact / exact.sum(), "inference", what, source, rtol=1e-7, atol=least)
    assert weights.sd.max() < 0.03
    assert 0.1 < weights.share[0] < 0.99, "else this tests little"


def test_a_flat_prior_bounds_the_draws():
    problem = alone(ITSELF, 1.0, 1e3, prior_sd=0.01, flat=math.log(2))
    settings = Settings(target_ess=1000, walkers=WALKERS)
    draws = sample(fit(problem), posterior(problem), settings).draws()[:, 0]
    assert np.abs(draws).max() < math.log(2) + 0.06
    np.testing.assert_allclose(np.quantile(draws, (0.25, 0.75)), [-math.log(2) / 2, math.log(2) / 2], atol=0.06)


def test_the_model_may_have_no_answer_somewhere():
    problem = alone(ABOVE, 1.0, 0.5)
    found = sample(fit(problem), posterior(problem), SHORT)
    assert found.draws().min() > math.log(0.8)
    assert np.isfinite(found.log_density).all()


def test_too_short_a_chain_says_how_much_is_missing(kept):
    (diagnosis,) = kept[0].diagnosis
    assert not diagnosis.enough(1e5)
    expected = (diagnosis.steps - diagnosis.burn_in) * (1e5 / diagnosis.bulk.min() - 1)
    assert diagnosis.more_steps(1e5) == pytest.approx(expected, rel=0.01)


LONG = replace(SHORT, target_ess=1e9, max_steps=400)


@pytest.fixture(scope="module")
def whole(linear):
    """A run of 400 steps that keeps them all, with two threads."""
    found, target, _, _ = linear
    return sample(found, target, replace(LONG, threads=2))


def test_a_longer_run_begins_with_the_shorter_one(linear, whole, tmp_path):
    found, target, _, _ = linear
    short = sample(found, target, replace(LONG, max_steps=200), folder=tmp_path)
    longer = sample(found, target, LONG, folder=tmp_path)
    assert len(short.theta) == 200
    np.testing.assert_array_equal(longer.theta[:200], short.theta)
    np.testing.assert_array_equal(longer.theta, whole.theta)
    np.testing.assert_array_equal(longer.acceptance, whole.acceptance)


def test_a_long_run_keeps_every_second_step_then_every_fourth(linear, whole, tmp_path):
    """As many draws as are wanted at most, the same that a run without bound has, and no more of them on disk."""
    found, target, _, _ = linear
    most = 134 * 4 * 12
    bounded = sample(found, target, replace(LONG, most_draws=most), folder=tmp_path)
    assert (whole.thin, bounded.thin) == (1, 4)
    np.testing.assert_array_equal(bounded.theta, whole.theta[3::4])
    np.testing.assert_array_equal(bounded.acceptance, whole.acceptance)
    assert [d.steps for d in bounded.diagnosis] == [400]
    (diagnosis,) = bounded.diagnosis
    assert 4 <= diagnosis.tau.max() < 6, "in steps, though every fourth is kept"
    assert len(bounded.draws()) == (100 - diagnosis.burn_in // 4) * 4 * 12
    size = sum(file.stat().st_size for file in tmp_path.glob("draws*.item"))
    assert 100 * 4 * 12 * 4 * 8 <= size < 1.5 * most * 4 * 8
    again = sample(found, target, replace(LONG, most_draws=most, max_steps=450), folder=tmp_path)
    np.testing.assert_array_equal(again.theta[:100], bounded.theta)


def test_killed_twice_the_chain_is_the_same_to_the_bit(tmp_path):
    """Kill -9, start again; twenty moments are tests/benchmarks/killed.py."""
    killed, alone = killed_and_alone(tmp_path, 2, seed=4)
    np.testing.assert_array_equal(killed, alone)


def test_a_broken_last_block_is_drawn_again(linear, kept, tmp_path):
    found, target, _, _ = linear
    before, folder = kept
    shutil.copytree(folder, tmp_path / "broken")
    last = sorted(tmp_path.glob("broken/draws*.item"))[-1]
    last.write_bytes(last.read_bytes()[:100])
    again = sample(found, target, SHORT, folder=tmp_path / "broken", provenance=CAMPAIGN)
    np.testing.assert_array_equal(again.theta, before.theta)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ("data", "set of numbers"),
        ("ties", "another set of unknowns"),
        ("seed", "another seed"),
        ("provenance", "another campaign"),
    ],
)
def test_checkpoints_of_another_run_are_refused_and_left_alone(linear, kept, change, words):
    found, problem, folder = linear[0], linear[0].problem, kept[1]
    before = {file.name: file.read_bytes() for file in folder.iterdir()}
    if change == "data":
        problem = eqx.tree_at(lambda p: p.measured, problem, problem.measured + 1)
    if change == "ties":
        first, *others = problem.parameters.items
        tied = Parameter(("a", "d"), False, first.start, first.centre, first.prior_sd, first.scale)
        problem = replace(problem, parameters=Parameters((tied, *others)))
    settings = replace(SHORT, seed=1) if change == "seed" else SHORT
    provenance = {"campaign": "b"} if change == "provenance" else CAMPAIGN
    with pytest.raises(InputError, match=words):
        sample(found, posterior(problem), settings, folder=folder, provenance=provenance)
    assert {file.name: file.read_bytes() for file in folder.iterdir()} == before


def test_a_product_that_is_known_and_one_prior_bound_both_factors():
    problem = pair(0, math.inf, 0.3)
    draws = sample(fit(problem), posterior(problem), Settings(target_ess=1000)).draws()
    assert draws[:, 0].std() == pytest.approx(math.hypot(0.3, 0.1), rel=0.15)


def test_a_folder_that_cannot_be_written_is_one_clear_line(linear, tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="file to write"):
        sample(linear[0], linear[1], SHORT, folder=tmp_path / "file" / "folder")


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        (Settings(walkers=4), "at least 6 for 3 unknowns"),
        (Settings(walkers=7), "even number"),
        (Settings(ensembles=2), "at least 4"),
        (Settings(max_steps=10), "at least 50"),
    ],
)
def test_settings_that_cannot_work(linear, settings, words):
    with pytest.raises(InputError, match=words):
        sample(linear[0], linear[1], settings)


def test_what_neither_data_nor_prior_bound_is_refused():
    problem = pair(1, math.inf, 1.0)
    with pytest.raises(InputError, match="nor a prior that bound a,"):
        sample(fit(problem), posterior(problem), SHORT)


@pytest.mark.parametrize(
    ("problem", "words"),
    [
        (alone(CONSTANT, 1.0, 1.0), "no measurement that depends on any of the unknowns"),
        (
            alone(ITSELF, 9.0, 0.1, prior_sd=0.01, flat=math.log(2)),
            r"a prior of k that excludes the data: they pull it to \d",
        ),
    ],
    ids=["data that say nothing", "a prior that excludes the data"],
)
def test_problems_that_have_no_posterior_are_refused(problem, words):
    with pytest.raises(InputError, match=words):
        sample(fit(problem), posterior(problem), SHORT)


def test_noise_of_a_kind_that_was_not_measured_is_refused(linear):
    with pytest.raises(InputError, match="the noise of z"):
        posterior(linear[0].problem, ["z"])


def test_a_model_without_answer_about_the_optimum_is_said():
    found = fit(alone(ITSELF, 1.0, 0.5))
    with pytest.raises(ModelError, match="no answer about the optimum"):
        sample(found, posterior(alone(NOWHERE, 1.0, 0.5)), SHORT)


def test_a_walker_that_never_moved_makes_the_chain_too_short():
    theta = np.random.default_rng(0).normal(size=(500, 4, 6, 1))
    theta[:, 0, 0] = 0.0
    found = diagnose(theta)
    assert found.tau[0] == 500
    assert not found.enough(10)
