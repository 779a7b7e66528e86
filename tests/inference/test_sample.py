"""The sampler: closed forms, several optima, checkpoints to the bit, what is refused."""

import math
from dataclasses import replace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from chains import linear_problem, storey_problem
from kills import killed_and_alone

from ident.errors import InputError, ModelError
from ident.inference.chains import diagnose
from ident.inference.draws import posterior_predictive, weigh
from ident.inference.fit import fit
from ident.inference.parameters import Parameter, Parameters
from ident.inference.posterior import evaluate, posterior
from ident.inference.problem import InverseProblem
from ident.inference.sample import Settings, sample

pytestmark = pytest.mark.slow

SHORT = Settings(max_steps=500, walkers=12)


def test_density_is_that_of_the_closed_form():
    problem, mean, covariance = linear_problem()
    theta = mean + np.random.default_rng(0).normal(size=(7, 3))
    value = evaluate(posterior(problem), theta, 4).log_density
    off = theta - mean
    exact = -np.einsum("np,pq,nq->n", off, np.linalg.inv(covariance), off) / 2
    np.testing.assert_allclose(value - value[0], exact - exact[0], rtol=1e-9)


def test_linear_gaussian_draws_agree_with_the_closed_form():
    """Means and variances within 4 standard errors, these by the effective sample size."""
    problem, mean, covariance = linear_problem()
    found = fit(problem)
    np.testing.assert_allclose(found.best.theta, mean, rtol=1e-8)
    np.testing.assert_allclose(found.information.covariance, covariance, rtol=1e-8)
    drawn = sample(found, posterior(problem), Settings(target_ess=4000, seed=1))
    (diagnosis,) = drawn.diagnosis
    assert diagnosis.enough(4000)
    draws, sd = drawn.draws(), np.sqrt(np.diag(covariance))
    assert (np.abs(draws.mean(0) - mean) < 4 * sd / np.sqrt(diagnosis.bulk)).all()
    assert (np.abs(draws.var(0) / sd**2 - 1) < 4 * np.sqrt(2 / diagnosis.tail)).all()
    correlation = np.corrcoef(draws.T) - covariance / np.outer(sd, sd)
    assert np.abs(correlation).max() < 4 / math.sqrt(diagnosis.bulk.min())


def test_predictions_carry_parameters_and_noise():
    problem, _, covariance = linear_problem()
    drawn = posterior_predictive(sample(fit(problem), posterior(problem), Settings(target_ess=4000)))
    A = np.stack([np.asarray(problem.predict(jnp.eye(3)[p]) - problem.predict(jnp.zeros(3))) for p in range(3)], 1)
    expected = np.diag(A @ covariance @ A.T)
    np.testing.assert_allclose(drawn.predicted.var(0), expected, rtol=0.15)
    np.testing.assert_allclose(drawn.simulated.var(0), expected + np.asarray(problem.sigma) ** 2, rtol=0.15)


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
    drawn = sample(fit(problem), posterior(problem, ["x"]), Settings(target_ess=1000))
    assert drawn.posterior.parameters.names == ("m", "noise.x")
    scale = np.exp(drawn.draws()[:, 1])
    about = np.std(np.asarray(problem.measured))
    assert scale.mean() == pytest.approx(about, rel=0.03)
    assert scale.std() == pytest.approx(about / math.sqrt(200), rel=0.25)


def test_each_of_a_chains_four_solutions_is_sampled():
    """Four exact frequencies fit four spring sets equally well."""
    problem = storey_problem(np.array([1.2, 0.9, 1.1, 0.8]) * 1e6, sigma=0.0001, width=0.7)
    found = fit(problem, starts=60, seed=3)
    drawn = sample(found, posterior(problem), Settings(target_ess=300))
    assert drawn.basins == (0, 1, 2, 3)
    for basin in drawn.basins:
        sd = np.sqrt(np.diag(_laplace(problem, found.optima[basin].theta, 0.7)))
        assert (np.abs(drawn.draws(basin).mean(0) - found.optima[basin].theta) < 0.5 * sd).all()


def test_two_solutions_are_weighed_against_each_other():
    """Two frequencies fit two pairs of springs; cost and volume about each say how likely it is, by Laplace."""
    problem = storey_problem(np.array([1.5, 0.6]) * 1e6, sigma=0.001, width=0.4)
    found = fit(problem, starts=30, seed=3)
    drawn = sample(found, posterior(problem), Settings(target_ess=300))
    assert drawn.basins == (0, 1)
    covariance = [_laplace(problem, found.optima[basin].theta, 0.4) for basin in drawn.basins]
    cost = np.array([found.optima[basin].cost for basin in drawn.basins])
    laplace = np.exp(-cost / 2) * np.sqrt([np.linalg.det(known) for known in covariance])
    weights = weigh(drawn)
    np.testing.assert_allclose(weights.share, laplace / laplace.sum(), atol=4 * weights.sd.max())
    assert weights.sd.max() < 0.03
    assert 0.1 < weights.share[0] < 0.99, "else this tests little"


def _laplace(problem, theta, width):
    """The covariance of the normal approximation."""
    J = np.asarray(jax.jacfwd(problem.predict)(jnp.asarray(theta)) / problem.sigma[:, None])
    return np.linalg.inv(J.T @ J + np.eye(len(theta)) / width**2)


def test_optima_without_a_barrier_between_them_are_one_posterior():
    """With frequencies twenty times less exact, two of the four solutions lie in one valley."""
    problem = storey_problem(np.array([1.2, 0.9, 1.1, 0.8]) * 1e6, sigma=0.002, width=0.7)
    found = fit(problem, starts=60, seed=3)
    drawn = sample(found, posterior(problem), Settings(target_ess=300))
    assert len(found.optima) == 4
    assert drawn.basins == (0, 2, 3)
    assert len(drawn.draws(0)) == 2 * len(drawn.draws(2))


def test_a_flat_prior_bounds_the_draws():
    item = Parameter(("k",), True, 1.0, 1.0, 0.01, 1.0, math.log(2))
    problem = InverseProblem(lambda p: p["k"][None], jnp.array([1.0]), jnp.array([1e3]), Parameters((item,)), ("x",))
    drawn = sample(fit(problem), posterior(problem), Settings(target_ess=1000)).draws()[:, 0]
    assert np.abs(drawn).max() < math.log(2) + 0.06
    np.testing.assert_allclose(np.quantile(drawn, (0.25, 0.75)), [-math.log(2) / 2, math.log(2) / 2], atol=0.06)


def test_the_model_may_have_no_answer_somewhere():
    item = Parameter(("k",), True, 1.0, 1.0, 1.0)

    def model(p):
        return jnp.where(p["k"] > 0.8, p["k"], jnp.nan)[None]

    problem = InverseProblem(model, jnp.array([1.0]), jnp.array([0.5]), Parameters((item,)), ("x",))
    drawn = sample(fit(problem), posterior(problem), SHORT)
    assert drawn.draws().min() > math.log(0.8)
    assert np.isfinite(drawn.log_density).all()


def test_too_short_a_chain_says_how_much_is_missing():
    problem, _, _ = linear_problem()
    (diagnosis,) = sample(fit(problem), posterior(problem), SHORT).diagnosis
    assert not diagnosis.enough(1e5)
    expected = (diagnosis.steps - diagnosis.burn_in) * (1e5 / diagnosis.bulk.min() - 1)
    assert diagnosis.more_steps(1e5) == pytest.approx(expected, rel=0.01)


def test_a_longer_run_begins_with_the_shorter_one(tmp_path):
    problem, _, _ = linear_problem()
    found, target = fit(problem), posterior(problem)
    short = sample(found, target, replace(SHORT, target_ess=1e9, max_steps=200), folder=tmp_path)
    long = sample(found, target, replace(SHORT, target_ess=1e9, max_steps=300), folder=tmp_path)
    alone = sample(found, target, replace(SHORT, target_ess=1e9, max_steps=300, threads=2))
    assert len(short.theta) == 200
    np.testing.assert_array_equal(long.theta[:200], short.theta)
    np.testing.assert_array_equal(long.theta, alone.theta)
    np.testing.assert_array_equal(long.acceptance, alone.acceptance)


def test_a_long_run_keeps_every_second_step_then_every_fourth(tmp_path):
    """As many draws as are wanted at most, the same that a run without bound has, and no more of them on disk."""
    problem, _, _ = linear_problem()
    found, target = fit(problem), posterior(problem)
    long = replace(SHORT, target_ess=1e9, max_steps=400)
    whole = sample(found, target, long)
    most = 134 * 4 * 12
    bounded = sample(found, target, replace(long, most_draws=most), folder=tmp_path)
    assert (whole.thin, bounded.thin) == (1, 4)
    np.testing.assert_array_equal(bounded.theta, whole.theta[3::4])
    np.testing.assert_array_equal(bounded.acceptance, whole.acceptance)
    assert [d.steps for d in bounded.diagnosis] == [400]
    (diagnosis,) = bounded.diagnosis
    assert 4 <= diagnosis.tau.max() < 6, "in steps, though every fourth is kept"
    assert len(bounded.draws()) == (100 - diagnosis.burn_in // 4) * 4 * 12
    size = sum(file.stat().st_size for file in tmp_path.glob("draws*.item"))
    assert 100 * 4 * 12 * 4 * 8 <= size < 1.5 * most * 4 * 8
    again = sample(found, target, replace(long, most_draws=most, max_steps=450), folder=tmp_path)
    np.testing.assert_array_equal(again.theta[:100], bounded.theta)


def test_killed_at_three_moments_the_chain_is_the_same_to_the_bit(tmp_path):
    """Kill -9, start again, over and over; twenty moments are tests/benchmarks/killed.py."""
    killed, alone = killed_and_alone(tmp_path, 3, seed=4)
    np.testing.assert_array_equal(killed, alone)


def test_a_broken_last_block_is_drawn_again(tmp_path):
    problem, _, _ = linear_problem()
    whole = sample(fit(problem), posterior(problem), SHORT, folder=tmp_path)
    last = sorted(tmp_path.glob("draws*.item"))[-1]
    last.write_bytes(last.read_bytes()[:100])
    again = sample(fit(problem), posterior(problem), SHORT, folder=tmp_path)
    np.testing.assert_array_equal(again.theta, whole.theta)


@pytest.mark.parametrize("change", ["data", "seed", "provenance"])
def test_checkpoints_of_another_run_are_refused_and_left_alone(tmp_path, change):
    problem, _, _ = linear_problem()
    sample(fit(problem), posterior(problem), SHORT, folder=tmp_path, provenance={"campaign": "a"})
    before = {file.name: file.read_bytes() for file in tmp_path.iterdir()}
    other = eqx.tree_at(lambda p: p.measured, problem, problem.measured + 1) if change == "data" else problem
    settings = replace(SHORT, seed=1) if change == "seed" else SHORT
    word = {"data": "set of numbers", "seed": "another seed", "provenance": "another campaign"}[change]
    with pytest.raises(InputError, match=word):
        sample(
            fit(other),
            posterior(other),
            settings,
            folder=tmp_path,
            provenance={"campaign": "b" if change == "provenance" else "a"},
        )
    assert {file.name: file.read_bytes() for file in tmp_path.iterdir()} == before


def test_checkpoints_of_other_ties_are_refused(tmp_path):
    def tied(*paths):
        item = Parameter(paths, True, 1.0, 1.0, 1.0)
        return InverseProblem(
            lambda p: sum(p.values())[None], jnp.array([1.0]), jnp.array([0.5]), Parameters((item,)), ("x",)
        )

    alone, both = tied("a"), tied("a", "b")
    sample(fit(alone), posterior(alone), SHORT, folder=tmp_path)
    with pytest.raises(InputError, match="another set of unknowns"):
        sample(fit(both), posterior(both), SHORT, folder=tmp_path)


def test_a_product_that_is_known_and_one_prior_bound_both_factors():
    items = tuple(Parameter((name,), True, 1.0, 1.0, sd) for name, sd in (("a", math.inf), ("b", 0.3)))
    problem = InverseProblem(
        lambda p: (p["a"] * p["b"])[None], jnp.array([1.0]), jnp.array([0.1]), Parameters(items), ("x",)
    )
    draws = sample(fit(problem), posterior(problem), Settings(target_ess=1000)).draws()
    assert draws[:, 0].std() == pytest.approx(math.hypot(0.3, 0.1), rel=0.15)


def test_a_folder_that_cannot_be_written_is_one_clear_line(tmp_path):
    problem, _, _ = linear_problem()
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="file to write"):
        sample(fit(problem), posterior(problem), SHORT, folder=tmp_path / "file" / "folder")


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        (Settings(walkers=4), "at least 6 for 3 unknowns"),
        (Settings(walkers=7), "even number"),
        (Settings(ensembles=2), "at least 4"),
        (Settings(max_steps=10), "at least 50"),
    ],
)
def test_settings_that_cannot_work(settings, words):
    problem, _, _ = linear_problem()
    with pytest.raises(InputError, match=words):
        sample(fit(problem), posterior(problem), settings)


def test_what_neither_data_nor_prior_bound_is_refused():
    items = tuple(Parameter((name,), True, 1.0, 1.0, sd) for name, sd in (("a", math.inf), ("b", 1.0)))
    problem = InverseProblem(lambda p: p["b"][None], jnp.array([1.0]), jnp.array([0.1]), Parameters(items), ("x",))
    with pytest.raises(InputError, match="nor a prior that bound a,"):
        sample(fit(problem), posterior(problem), SHORT)


def test_data_that_say_nothing_are_refused():
    item = Parameter(("k",), True, 1.0, 1.0, 1.0)
    problem = InverseProblem(lambda p: 1 + 0 * p["k"][None], jnp.ones(1), jnp.ones(1), Parameters((item,)), ("x",))
    with pytest.raises(InputError, match="no measurement that depends on any of the unknowns"):
        sample(fit(problem), posterior(problem), SHORT)


def test_a_prior_that_excludes_the_data_is_refused():
    item = Parameter(("k",), True, 1.0, 1.0, 0.01, 1.0, math.log(2))
    problem = InverseProblem(lambda p: p["k"][None], jnp.array([9.0]), jnp.array([0.1]), Parameters((item,)), ("x",))
    with pytest.raises(InputError, match=r"a prior of k that excludes the data: they pull it to \d"):
        sample(fit(problem), posterior(problem), SHORT)


def test_noise_of_a_kind_that_was_not_measured_is_refused():
    with pytest.raises(InputError, match="the noise of z"):
        posterior(linear_problem()[0], ["z"])


def test_a_model_without_answer_about_the_optimum_is_said():
    item = Parameter(("k",), True, 1.0, 1.0, 1.0)
    problem = InverseProblem(lambda p: p["k"][None], jnp.array([1.0]), jnp.array([0.5]), Parameters((item,)), ("x",))
    found = fit(problem)
    nowhere = eqx.tree_at(lambda p: p.model, problem, lambda p: jnp.nan * p["k"][None])
    with pytest.raises(ModelError, match="no answer about the optimum"):
        sample(found, posterior(nowhere), SHORT)


def test_a_walker_that_never_moved_makes_the_chain_too_short():
    theta = np.random.default_rng(0).normal(size=(500, 4, 6, 1))
    theta[:, 0, 0] = 0.0
    found = diagnose(theta)
    assert found.tau[0] == 500
    assert not found.enough(10)
