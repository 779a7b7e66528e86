"""The fit: exact recovery, all optima, flat valleys, masses, and a model that is no arm."""

import dataclasses
import math
from contextlib import nullcontext
from pathlib import Path

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from arms import lcd_arm
from chains import storey_frequencies, storey_problem
from conformance import agrees
from one_program import shown

from ident.errors import InputError, ModelError
from ident.identify.data_checks import check_values
from ident.identify.fit import fit_campaign
from ident.identify.problem import pose
from ident.identify.unknowns import Unknowns, parameter
from ident.inference.fit import fit
from ident.inference.optima import Optimum, unmet
from ident.inference.parameters import Parameter, Parameters
from ident.inference.priors import Prior
from ident.inference.problem import InverseProblem
from ident.inference.search import evaluate
from ident.measure import Campaign, Measurement, read_campaign

pytestmark = pytest.mark.slow

DATA = Path(__file__).parents[2] / "data" / "lcd_arm"


def exact(campaign, parameters=None):
    """The campaign with the arm's own predictions in place of what was measured; sigma keeps its proportion."""
    arm = lcd_arm()
    values = shown(arm, campaign, parameters)
    return Campaign(
        measurements=tuple(
            Measurement(
                kind=m.kind,
                posture=m.posture,
                value=float(v),
                sigma=m.sigma * float(v) / m.value,
                mode=m.mode,
                point=m.point,
                load=m.load,
            )
            for m, v in zip(campaign, values, strict=True)
        )
    )


def shipped():
    return read_campaign(DATA / "campaign.csv")


def table_1():
    return read_campaign(DATA / "table1.csv")


def started_at(problem, factor):
    """The same problem, its stiffnesses started at these multiples of the arm's."""
    items = tuple(
        parameter(lcd_arm(), *item.paths, start=float(item.start) * f, prior_sd=math.inf)
        for item, f in zip(problem.parameters.items, factor, strict=True)
    )
    return InverseProblem(problem.model, problem.measured, problem.sigma, Parameters(items), problem.kinds)


def test_exact_data_give_all_six_from_any_of_four_starts():
    """Within a factor of ten: all soft, all stiff, soft and stiff by turns, and at random; each with few beside."""
    problem = pose(lcd_arm(), exact(shipped()), Unknowns(prior_sd=math.inf)).problem
    truth = np.asarray(problem.parameters.column("start"))
    turns = (-1.0) ** np.arange(6)
    for powers in (-np.ones(6), np.ones(6), turns, np.random.default_rng(0).uniform(-1, 1, 6)):
        found = fit(started_at(problem, 10**powers), starts=3)
        assert found.best.converged
        assert found.information.rank == 6
        assert np.abs(found.best.values / truth - 1).max() < 1e-6


def test_the_noisy_campaign_gives_all_six_within_three_standard_deviations():
    found = fit_campaign(lcd_arm(), shipped())
    truth = np.log(np.asarray(found.problem.parameters.column("start")))
    assert (np.abs(found.best.theta - truth) < 3 * found.information.sd).all()
    assert (found.information.sd < 0.03).all()
    assert found.information.supported.all()
    assert (found.information.prior_share < 0.001).all()
    assert 0.01 < found.p_value < 0.99


def test_three_consistent_numbers_are_three_directions_of_six_and_contradict_nothing():
    found = fit(pose(lcd_arm(), exact(table_1())).problem)
    assert found.information.rank == 3
    assert len(found.information.trade_offs()) == 3
    assert np.isinf(found.information.data_sd).all()
    assert not found.information.supported.any()
    np.testing.assert_allclose(found.predicted, found.problem.measured, rtol=1e-6)
    assert [each.kind for each in found.cross_predictions] == ["deflection", "frequency"]
    assert max(t.statistic for t in found.cross_predictions) < 0.01
    assert not found.contradictory


def test_without_prior_three_numbers_fit_exactly_and_no_interval_is_finite():
    problem = pose(lcd_arm(), exact(table_1()), Unknowns(prior_sd=math.inf)).problem
    found = fit(started_at(problem, [1.3, 0.8, 1.1, 0.9, 1.2, 1.0]), starts=4, spread=0.2)
    assert found.best.cost < 1e-12
    assert found.information.rank == 3
    assert np.isinf(found.information.sd).all()
    assert not found.information.supported.any()


def test_the_measured_numbers_of_the_paper_contradict_each_other():
    found = fit_campaign(lcd_arm(), table_1())
    assert found.contradictory
    assert not found.supported.any(), "no interval is quoted from data that contradict each other"
    by_kind = {each.kind: each for each in found.cross_predictions}
    deflection, frequency = by_kind["deflection"], by_kind["frequency"]
    assert deflection.predicted[0] > 0.029, "frequencies alone ask for some 31 mm; 22 were measured"
    frequencies = np.where(np.array(found.problem.kinds) == "frequency", found.problem.sigma, np.inf)
    alone = fit(found.problem.with_sigma(frequencies)).best.cost
    assert deflection.statistic == pytest.approx(found.best.cost - alone, abs=0.01), "the deflection alone can be met"
    assert deflection.degrees_of_freedom == pytest.approx(1, abs=0.03)
    assert deflection.sd == pytest.approx(4.1, abs=0.1)
    assert deflection.z[0] == pytest.approx(-(deflection.statistic**0.5), abs=0.01), "of one value, T is its square"
    assert frequency.degrees_of_freedom == pytest.approx(2, abs=0.03)
    assert frequency.z[0] == pytest.approx(deflection.z[0], abs=0.01)
    assert 0.01 < deflection.wider < 0.02, "with priors twice as wide it would be 2.4 sd: it rests on them"


@pytest.mark.parametrize(
    ("name", "prior"), [("table1", Prior.log_uniform(1e5, 1e6)), ("campaign", Prior.catalogue(2e5, 3e5, 5e5))]
)
def test_a_flat_prior_does_not_switch_the_comparison_of_kinds_off(name, prior):
    campaign = read_campaign(DATA / f"{name}.csv")
    found = fit_campaign(lcd_arm(), campaign, Unknowns(priors={"joint1.k_tors": prior}))
    assert [each.kind for each in found.cross_predictions] == ["deflection", "frequency"]
    assert all(np.isfinite([each.statistic, each.p_value]).all() for each in found.cross_predictions)
    assert found.contradictory == (name == "table1")
    if name == "table1":
        assert found.cross_predictions[0].statistic == pytest.approx(17.2, abs=0.1)


def test_a_mass_and_a_length_may_be_unknown_too():
    truth = {"link2.mass": float(lcd_arm().get("link2.mass")) * 1.05, "joint3.offset.x": 1.01}
    free = {"link2.mass": 0.3, "joint3.offset.x": 0.05}
    problem = pose(lcd_arm(), exact(shipped(), truth), Unknowns(free=free, prior_sd=3.0)).problem
    found = fit(problem, starts=1)
    assert found.chi_squared < 0.1
    assert found.parameters["link2.mass"] == pytest.approx(truth["link2.mass"], rel=0.05)
    assert found.parameters["joint3.offset.x"] == pytest.approx(1.01, abs=0.02)


def typed(*values, sigma=(0.1, 0.1, 1e-4)):
    """The rows of Table 1 with other values in rows 2, 3 and 4 of a file; None leaves one as the arm has it."""
    rows = zip(exact(table_1()), values, sigma, range(2, 5), strict=True)
    changed = (
        dataclasses.replace(m, value=m.value if value is None else value, sigma=sd, where=f"t.csv:{row}")
        for m, value, sd, row in rows
    )
    return pose(lcd_arm(), Campaign(measurements=tuple(changed)))


def test_radians_per_second_taken_for_hertz_are_questioned():
    with pytest.raises(InputError, match=r"1 more like it \(row 3\).*rad/s written as Hz") as error:
        check_values(typed(27.5, 27.5, None))
    assert [p.where for p in error.value.problems] == ["t.csv:2"]


def test_only_the_rows_named_are_trusted():
    posed = typed(27.5, None, 0.26)
    with pytest.raises(InputError, match=r"if it is right all the same, say so \(`trust_values` 4\)") as error:
        check_values(posed, ("2",))
    assert [p.where for p in error.value.problems] == ["t.csv:4"]
    for trusted in (("2", "4"), ("all",)):
        check_values(posed, trusted)
    with pytest.raises(InputError, match=r"trust_values: got '5', expected rows of the campaign \(2 to 4\), or all"):
        check_values(posed, ("5",))


@pytest.mark.parametrize(("sigma", "refused"), [(0.02, True), (0.05, False)])
def test_a_value_is_far_off_only_beyond_its_own_uncertainty(sigma, refused):
    posed = typed(None, None, 0.24, sigma=(0.1, 0.1, sigma))
    with pytest.raises(InputError, match=r"9\.13 times") if refused else nullcontext():
        check_values(posed)


def test_one_mistyped_frequency_is_an_outlier_and_no_interval_is_quoted():
    first, second, *rest = shipped()
    mistyped = dataclasses.replace(second, value=second.value + 1.0, sigma=second.sigma)
    result = fit_campaign(lcd_arm(), Campaign(measurements=(first, mistyped, *rest)), starts=4)
    assert result.outliers[1]
    assert result.p_value < 1e-6
    assert result.doubts
    assert not result.supported.any()


def test_a_posture_beyond_the_limits_is_questioned():
    first, *rest = table_1()
    beyond = dataclasses.replace(first, posture=(30.0, -60.0, 30.0), where="t.csv:2")
    with pytest.raises(InputError, match="limits in the arm file"):
        fit_campaign(lcd_arm(), Campaign(measurements=(beyond, *rest)))


def test_without_prior_the_contradiction_is_still_found_and_the_valley_is_one_optimum():
    result = fit_campaign(lcd_arm(), table_1(), Unknowns(prior_sd=math.inf), starts=8)
    assert result.contradictory
    assert sum(o.cost < result.best.cost + 1e-3 for o in result.optima) == 1


def test_an_arm_that_collapses_is_said_to():
    soft = lcd_arm().replace({f"joint{j}.k_bend": 10.0 for j in (1, 2, 3)})
    with pytest.raises(ModelError, match="no stable equilibrium"):
        fit_campaign(soft, table_1(), Unknowns(prior_sd=0.01), starts=1)


def test_evaluate_predicts_at_the_start():
    problem = pose(lcd_arm(), table_1()).problem
    assert np.asarray(evaluate(problem).predicted) == pytest.approx([4.80, 4.12, 0.0263], rel=1e-3)


def test_the_same_seed_gives_the_same_fit():
    problem = pose(lcd_arm(), table_1()).problem
    first, second = (fit(problem, starts=6, seed=5) for _ in range(2))
    np.testing.assert_array_equal(first.best.theta, second.best.theta)
    assert [o.starts for o in first.optima] == [o.starts for o in second.optima]


def test_a_label_of_no_mode_is_refused_with_its_row_and_the_modes_that_there_are():
    first, *rest = table_1()
    wrong = dataclasses.replace(first, mode="lateral torsion 9", where="c.csv:7")
    with pytest.raises(InputError, match=r"c.csv:7, mode: got 'lateral torsion 9', .*vertical bending 1") as raised:
        check_values(pose(lcd_arm(), Campaign(measurements=(wrong, *rest))))
    assert len(raised.value.problems) == 1


# rival optima


def square_and_itself(p):
    return jnp.stack([p["x"] ** 2, p["x"]])


def two_wells(sd=np.inf, towards=0.5):
    """A model whose square is measured, so that x = 1 and x = -1 fit alike, but for a second value of that sd."""
    return InverseProblem(
        square_and_itself,
        jnp.array([1.0, towards]),
        jnp.array([0.01, sd]),
        Parameters((Parameter(("x",), False, 0.4, 0.0),)),
        ("square", "itself"),
    )


def test_an_interval_reaches_over_all_optima_that_the_data_do_not_rule_out():
    """About x = -1, 0.5 above the best one, as far as the cost rises by 1.96^2 - 0.5 there."""
    found = fit(two_wells(sd=2.0))
    assert [round(float(optimum.values[0])) for optimum in found.optima] == [1, -1]
    assert found.optima[1].cost - found.best.cost == pytest.approx(0.5, abs=1e-3)
    assert len(found.rivals) == 1
    assert found.ties == 0
    low, high = found.interval()[0]
    half = math.sqrt(1.959964**2 - 0.5) * 0.005
    what, source = "interval over two optima", "1.96^2 less the difference of costs, by hand"
    agrees([low, high], [-1 - half, 1 + 1.96 * 0.005], "inference", what, source, atol=1e-4)


def test_an_optimum_that_the_data_rule_out_widens_no_interval():
    found = fit(two_wells(sd=0.3))
    assert len(found.optima) == 2
    assert found.rivals == ()
    np.testing.assert_allclose(found.interval()[0], [1 - 0.0098, 1 + 0.0098], atol=1e-3)


def met(*starts, cost=0.0):
    return [
        Optimum(np.zeros(1), np.full(1, float(i)), cost, n, True, np.empty((0, 1)), np.ones(1))
        for i, n in enumerate(starts)
    ]


def test_how_many_rivals_were_not_met_is_estimated_by_how_often_each_was():
    """Boender & Rinnooy Kan 1987: w (n - 1) / (n - w - 2) in all."""
    assert unmet(met(3)) == 0.0
    what, source = "optima that the search has not met", "Boender and Rinnooy Kan 1987"
    expected = [2 * 15 / 12 - 2, 4 * 45 / 40 - 4]
    agrees([unmet(met(14, 2)), unmet(met(40, 3, 2, 1))], expected, "inference", what, source, rtol=1e-6)
    assert unmet(met(1, 2, 1)) == math.inf
    far = dataclasses.replace(met(1)[0], cost=50.0)
    assert unmet([*met(14), far]) == 0.0, "what the data rule out does not count"


def test_where_a_rival_was_met_the_search_goes_on_until_all_are_listed():
    """A chain of four has four exact solutions: a Jacobi matrix of this form is not fixed by its spectrum alone.

    Of 4 seeds, 16 starts alone miss one of them in about half.
    """
    truth = np.array([1.2e6, 1.0e6, 0.8e6, 0.9e6])
    problem = storey_problem(truth, 0.002, math.inf)
    every = [fit(problem, seed=seed) for seed in range(4)]
    assert all(unmet(each.optima) < 0.5 for each in every)
    assert min(sum(o.starts for o in each.optima) for each in every) > 16
    complete = [each for each in every if each.ties == 3]
    assert len(complete) >= 3
    for found in complete:
        perfect = [optimum for optimum in found.optima if optimum.cost < 1e-12]
        assert len(perfect) == 4
        assert any(np.allclose(optimum.values, truth, rtol=1e-6) for optimum in perfect)
    for optimum in perfect:
        values = {f"k{i + 1}": jnp.asarray(v) for i, v in enumerate(optimum.values)}
        np.testing.assert_allclose(storey_frequencies(values), problem.measured, rtol=1e-7)


@pytest.mark.parametrize("seed", range(2))
def test_exact_ties_are_ordered_by_a_rule_whatever_start_found_them_first(seed):
    """Both are as far from the centre: the lesser one comes first."""
    found = fit(two_wells(), seed=seed)
    assert found.ties == 1
    assert found.best.values[0] == pytest.approx(-1.0)
    nearer = eqx.tree_at(lambda p: p.parameters.items[0].centre, two_wells(), np.array(0.2))
    assert fit(nearer, seed=seed).best.values[0] == pytest.approx(1.0), "now the one nearer to the centre"
