"""The check before solving, against closed forms of linear models and power laws, and on the paper's arm."""

import dataclasses
import math
from pathlib import Path

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from arms import lcd_arm
from chains import storey_frequencies, storey_problem
from scipy.stats import binomtest

from ident.errors import InputError
from ident.identify.check import check_campaign
from ident.identify.data_checks import contradictory_repeats
from ident.identify.label_checks import label_doubts
from ident.identify.problem import pose
from ident.identify.unknowns import Unknowns, parameter
from ident.inference.fit import contradicting, cross_predictions, fit
from ident.inference.identifiability import check, consistency, leverage_of
from ident.inference.parameters import Parameter, Parameters
from ident.inference.problem import InverseProblem
from ident.inference.search import evaluate
from ident.measure import Campaign, Measurement, read_campaign

slow = pytest.mark.slow

DATA = Path(__file__).parents[2] / "data" / "lcd_arm"


class Linear(eqx.Module):
    """Values A @ (a, b, ...); a model that is no arm."""

    A: jnp.ndarray

    def __call__(self, parameters):
        return self.A @ jnp.stack([parameters[name] for name in "abcdef"[: self.A.shape[1]]])


def problem_of(model, count, measured, sigma=1.0, kinds=None, *, positive=False, start=0.0, prior_sd=math.inf):
    items = tuple(Parameter((name,), positive, start, start, prior_sd) for name in "abcdef"[:count])
    measured = jnp.asarray(measured, float)
    kinds = tuple(kinds or ("value",) * len(measured))
    return InverseProblem(model, measured, jnp.full(len(measured), sigma), Parameters(items), kinds)


def linear(A, **options):
    A = jnp.asarray(A, float)
    measured = options.pop("measured", [0.0] * len(A))
    return problem_of(Linear(A), A.shape[1], measured, **options)


def frequency(value, mode=None, *, posture=(0.0, 0.0, 0.0), sigma=0.02, where=""):
    return Measurement(kind="frequency", posture=posture, value=value, sigma=sigma, mode=mode, where=where)


def deflection(value, *, where="", note=""):
    return Measurement(
        kind="deflection", posture=(0.0, 0.0, 0.0), value=value, sigma=4e-4, point="tip", where=where, note=note
    )


@pytest.fixture(scope="module")
def paper():
    return check_campaign(lcd_arm(), read_campaign(DATA / "table1.csv"))


@pytest.fixture(scope="module")
def shipped():
    return check_campaign(lcd_arm(), read_campaign(DATA / "campaign.csv"))


# verdicts


@slow
def test_each_verdict_in_closed_form():
    """Columns: seen well, seen little, seen as a sum only (twice), not seen."""
    found = check(linear([[10, 0, 0, 0, 0], [0, 1, 0, 0, 0], [0, 0, 10, 10, 0]]))
    assert found.verdicts == ("identifiable", "weak", "open", "open", "not seen")
    np.testing.assert_allclose(found.data_sd[:, :2], [[0.1, 1.0]] * 9)
    assert np.isinf(found.data_sd[:, 2:]).all()
    assert found.information.rank == 3
    assert [d.weak for d in found.information.directions] == [False, False, True, False, False]
    assert not found.blind
    assert check(linear(np.zeros((3, 5)))).blind


def storeys_as_they_are():
    """A chain of four whose springs start at the truth, so that check looks for others with the same frequencies."""
    truth = np.array([1.2e6, 1.0e6, 0.8e6, 0.9e6])
    problem = storey_problem(truth, width=math.inf)
    return truth, eqx.tree_at(
        lambda p: [item.start for item in p.parameters.items], problem, list(map(np.array, truth))
    )


@slow
def test_other_values_that_give_the_same_data_are_found():
    """A Jacobi matrix of this form has four solutions for one spectrum (as the fit from 60 starts finds)."""
    truth, problem = storeys_as_they_are()
    found = check(problem)
    assert found.verdicts == ("identifiable",) * 4, "near the truth it is"
    assert len(found.others.exact) == 3
    for optimum in found.others.exact:
        values = {f"k{i + 1}": jnp.asarray(k) for i, k in enumerate(optimum.values)}
        np.testing.assert_allclose(storey_frequencies(values), problem.measured, rtol=1e-7)
        assert np.abs(optimum.values / truth - 1).max() > 0.02
    assert found.others.near == ()


@slow
def test_a_rival_that_the_sigmas_would_not_rule_out_is_told_with_its_cost():
    """x^2 and x, the latter so uncertain that the other root costs (0.8 / 0.5)^2, less what a shift saves."""
    items = (Parameter(("x",), False, 0.4, 0.0),)
    two = InverseProblem(
        lambda p: jnp.stack([p["x"] ** 2, p["x"]]), jnp.zeros(2), jnp.array([1e-4, 0.5]), Parameters(items), ("a", "b")
    )
    (rival,) = check(two).others.near
    assert rival.values[0] == pytest.approx(-0.4, abs=1e-3)
    assert rival.cost == pytest.approx(1.6**2, rel=1e-3)
    assert check(two).others.exact == ()


@slow
def test_no_other_values_are_found_for_the_shipped_campaign(shipped):
    assert shipped.others.exact == ()
    assert shipped.others.near == ()
    assert shipped.others.ended > 8


@slow
def test_orthogonal_columns_are_uncorrelated():
    found = check(linear(np.diag([5.0, 5.0, 5.0])))
    assert found.verdicts == ("identifiable",) * 3
    assert found.others.exact == ()
    np.testing.assert_allclose(found.information.correlation, np.eye(3), atol=1e-12)


@slow
def test_a_value_that_is_predicted_only_tells_nothing():
    problem = linear([[10, 0], [0, 10]], kinds=("x", "y"))
    problem = problem.with_sigma(np.array([1.0, np.inf]))
    assert check(problem).verdicts == ("identifiable", "not seen")


@slow
@pytest.mark.parametrize(("width", "verdict"), [(0.4, "weak"), (1e-4, "open")])
def test_a_derivative_that_vanishes_at_the_start_only_does_not_mislead(width, verdict):
    """Half of 100 a^2 at a = 0; and a narrow prior keeps the points where it is still nearly zero: as a fit, open."""
    problem = problem_of(lambda p: jnp.stack([50 * p["a"] ** 2, 10 * p["b"]]), 2, [0.0, 0.0], prior_sd=width)
    found = check(problem)
    assert found.data_sd[0, 0] == np.inf
    assert np.isfinite(found.data_sd[1:, 0]).all()
    assert found.verdicts == (verdict, "identifiable")
    assert found.supported[:, 0].any() == (width == 0.4)


@slow
@pytest.mark.parametrize(("end", "verdict"), [(-0.1, "unknown"), (10.0, "identifiable")])
def test_no_answer_at_the_start_is_unknown_and_never_fine(end, verdict):
    problem = problem_of(lambda p: jnp.stack([10 * p["a"], jnp.where(p["a"] < end, 1.0, jnp.nan)]), 1, [0.0, 1.0])
    found = check(problem)
    assert found.verdicts == (verdict,)
    assert found.missing.tolist() == [False, verdict == "unknown"]
    assert (found.information is None) == (found.leverage is None) == (verdict == "unknown")


@slow
def test_no_answer_at_most_of_the_points_is_unknown_too():
    problem = problem_of(lambda p: jnp.where(jnp.abs(p["a"]) < 1e-3, 10.0, jnp.nan) * p["a"][None], 1, [0.0])
    found = check(problem)
    assert not found.missing.any()
    assert (found.answered, found.tried) == (1, 9)
    assert found.verdicts == ("unknown",)


@slow
def test_the_same_seed_looks_at_the_same_points():
    problem = problem_of(lambda p: 10 * p["a"][None] ** 2, 1, [0.0], start=1.0)
    first, second, other = (check(problem, seed=seed).data_sd for seed in (1, 1, 2))
    np.testing.assert_array_equal(first, second)
    assert (first[1:] != other[1:]).all()


# measurements


def test_leverage_of_a_line_through_the_origin():
    x = np.array([1.0, 2.0, 3.0, 9.0])
    part = leverage_of(10 * x[:, None], ("a",))
    np.testing.assert_allclose(part.leverage, x**2 / (x**2).sum())
    np.testing.assert_allclose(part.share.sum(), 1)
    assert part.sees == (0, 0, 0, 0)
    assert part.opened == (0, 0, 0, 0)
    assert not part.empty[1:].any()


def test_what_tells_nothing_and_what_alone_tells_something():
    J = np.array([[10, 0], [10, 0], [10, 0], [0, 10], [0, 0], [0.1, 0]])
    part = leverage_of(J, ("a", "b"))
    assert part.empty.tolist() == [False, False, False, False, True, True]
    assert part.dominant.tolist() == [False, False, False, True, False, False]
    assert part.opened == (0, 0, 0, 1, 0, 0)
    assert part.lost == ((), (), (), ("b",), (), ())
    assert part.sees == (0, 0, 0, 1, -1, 0)


def test_a_measurement_that_is_needed_although_others_see_the_same():
    """Without the precise one, b is known to 1 / sqrt(2) only: weak."""
    part = leverage_of(np.array([[10, 0], [10, 0], [0, 9], [0, 1], [0, 1.0]]), ("a", "b"))
    assert part.lost == ((), (), ("b",), (), ())
    assert part.opened == (0, 0, 0, 0, 0)
    assert part.leverage[2] == pytest.approx(81 / 83)


def test_many_equal_measurements_each_carry_their_share():
    part = leverage_of(np.ones((1000, 1)), ("a",))
    assert not part.empty.any()
    assert not part.dominant.any()


# the data among themselves


@slow
def test_all_together_in_closed_form():
    problem = linear([[1], [1], [1]], measured=[3.0, 5.0, 10.0], sigma=0.5, kinds=("x", "x", "y"))
    found = consistency(problem)
    assert found.chi_squared == pytest.approx((9 + 1 + 16) / 0.25)
    assert found.degrees_of_freedom == 2
    assert found.p_value == pytest.approx(math.exp(-52), rel=1e-6), "chi-squared of two: exp(-x / 2)"


@slow
def test_a_prior_is_a_measurement_too():
    """x = a + b, y = a; prior N(0, 2) on each."""
    found = consistency(linear([[1, 1], [1, 0]], measured=[9.0, 0.0], kinds=("x", "y"), prior_sd=2.0))
    assert found.degrees_of_freedom == 2
    S = np.array([[4 + 4 + 1, 4], [4, 4 + 1]])
    assert found.chi_squared == pytest.approx(np.array([9, 0]) @ np.linalg.solve(S, [9, 0]))


@slow
def test_without_degrees_of_freedom_nothing_is_tested():
    found = consistency(linear([[1, 0], [0, 1]], measured=[3.0, 7.0], kinds=("x", "y")))
    assert found.degrees_of_freedom == 0
    assert math.isnan(found.p_value)


@slow
def test_powers_are_straight_lines_however_far_the_start():
    """The values k and 1 / k^2, started at 100 times the truth: exact in logarithms, no matter how far."""
    model = lambda p: jnp.stack([p["a"], p["a"] ** -2])  # noqa: E731
    problem = problem_of(model, 1, [2.0, 0.25], sigma=0.01, kinds=("x", "y"), positive=True, start=200.0)
    found = consistency(problem)
    assert found.bend < 1e-6
    assert found.chi_squared < 1e-9


@slow
def test_a_bent_model_makes_the_test_weaker_not_wrong():
    """Exact data of exp(a) and a from a far start: the straight line alone would be off by many sigmas."""
    problem = problem_of(lambda p: jnp.stack([jnp.exp(p["a"]), p["a"]]), 1, [math.e, 1.0], 0.01, kinds=("x", "y"))
    found = consistency(problem)
    straight = (math.e - 2) / (0.01 * math.sqrt(2))
    assert straight > 50
    assert found.chi_squared < 2
    assert found.bend > 1
    assert math.isnan(found.p_value), "no chi-squared where the line is bent"


@slow
def test_a_value_near_zero_is_no_power():
    """Measured and predicted have other signs, so that no logarithm is taken, and nothing is NaN."""
    model = lambda p: jnp.stack([p["a"], p["a"] - 1])  # noqa: E731
    problem = problem_of(model, 1, [1.0, -0.01], sigma=0.02, kinds=("x", "y"), positive=True, start=1.05)
    assert consistency(problem).chi_squared < 1


# the arm


@slow
def test_the_paper_fixes_three_of_six_directions_and_no_parameter(paper):
    assert paper.verdicts == ("open",) * 6
    assert paper.others is None, "where a direction is open there are always others"
    assert paper.information.rank == 3
    assert np.isinf(paper.data_sd).all()
    assert paper.answered == 9
    assert paper.leverage.opened == (1, 1, 1)
    np.testing.assert_allclose(paper.leverage.leverage, 1)


@slow
def test_the_shipped_campaign_identifies_all_six(shipped):
    assert shipped.verdicts == ("identifiable",) * 6
    assert (shipped.data_sd < 0.05).all()
    assert shipped.leverage.leverage.sum() == pytest.approx(6)
    assert not shipped.leverage.dominant.any()
    assert not shipped.contradictory
    assert 0.01 < shipped.consistency.p_value < 0.999
    doubts = [(doubt.row, str(doubt.mode), doubt.near_draw) for doubt in shipped.labels]
    assert doubts == [(12, "lateral torsion 2", True)], "half of its strain energy is bending"


@slow
def test_check_and_fit_agree_on_the_contradiction_of_the_paper(paper):
    assert paper.contradictory
    for mine, full in zip(paper.cross_predictions, fit(paper.problem).cross_predictions, strict=True):
        assert mine.kind == full.kind
        assert mine.statistic == pytest.approx(full.statistic, rel=1e-6)
        np.testing.assert_allclose(mine.predicted, full.predicted, rtol=1e-6)


@slow
def test_wrong_stiffnesses_in_the_arm_file_are_no_contradiction(shipped):
    """Starts off by 50 % (one sd each): the paper's contradiction would be plain, false alarms are rare."""
    problem, alarms = shipped.problem, 0
    for seed in range(20):
        factor = np.exp(0.4 * np.random.default_rng(seed).standard_normal(6))
        items = tuple(
            parameter(lcd_arm(), *item.paths, start=float(item.start) * f, prior_sd=1.0)
            for item, f in zip(problem.parameters.items, factor, strict=True)
        )
        off = InverseProblem(problem.model, problem.measured, problem.sigma, Parameters(items), problem.kinds)
        start = np.asarray(off.parameters.theta(off.parameters.column("start")))
        alarms += bool(contradicting(cross_predictions(off, [start])[0]))
    assert alarms <= 1


@slow
def test_an_arm_that_collapses_is_unknown():
    soft = lcd_arm().replace({"joint1.k_bend": 10.0})
    found = check_campaign(soft, read_campaign(DATA / "table1.csv"))
    assert found.verdicts == ("unknown",) * 6
    assert found.missing.all()
    assert found.consistency is None
    assert np.isnan(np.asarray(evaluate(found.problem).predicted)).all()


@slow
def test_a_campaign_without_any_information_is_refused():
    bent = tuple(f"joint{j}.k_bend" for j in (1, 2, 3))
    with pytest.raises(InputError, match="no measurement that depends on any of the unknowns") as error:
        check_campaign(lcd_arm(), Campaign(measurements=(deflection(0.0263),)), Unknowns(fixed=bent))
    assert len(str(error.value).splitlines()) == 1


@slow
def test_contradictory_repeats_name_both_rows():
    first = deflection(0.0263, where="c.csv:2")
    agreeing = deflection(0.0270, where="c.csv:3", note="again")
    third = deflection(0.0290, where="c.csv:9")
    assert list(contradictory_repeats(Campaign(measurements=(first, agreeing)))) == []
    campaign = Campaign(measurements=(first, agreeing, third))
    assert list(contradictory_repeats(campaign)) == [(0, 2)], "the pair that is farthest apart"
    with pytest.raises(InputError, match=r"c.csv:9, value: got .* from row 2") as error:
        check_campaign(lcd_arm(), campaign)
    assert len(str(error.value).splitlines()) == 1
    assert check_campaign(lcd_arm(), campaign, trusted=("9",)).repeats == ((0, 2),)
    fourth = deflection(0.0230, where="c.csv:12")
    with pytest.raises(InputError, match=r"c.csv:12, value: got .* from row"):
        check_campaign(lcd_arm(), Campaign(measurements=(first, agreeing, third, fourth)), trusted=("9",))


def test_right_repeats_are_rarely_taken_to_contradict_each_other():
    rng, trials, repeats = np.random.default_rng(0), 400, 12
    alarms = 0
    for _ in range(trials):
        values = 0.0263 + 1e-4 * rng.normal(size=repeats)
        own = tuple(dataclasses.replace(deflection(value), sigma=1e-4) for value in values)
        alarms += bool(list(contradictory_repeats(Campaign(measurements=own))))
    assert binomtest(alarms, trials, 0.0027).pvalue > 1e-3
    wrong = dataclasses.replace(own[0], value=0.0263 + 1e-3)
    assert list(contradictory_repeats(Campaign(measurements=(*own, wrong))))


def test_other_postures_modes_and_values_without_label_are_no_repeats():
    apart = (
        frequency(4.0),
        frequency(5.0),
        frequency(4.0, "lateral torsion 1"),
        frequency(5.0, "vertical bending 1"),
        frequency(6.0, "vertical bending 1", posture=(0.0, 0.1, 0.0)),
        deflection(0.02),
        dataclasses.replace(deflection(0.03), direction=(0.0, 0.0, 1.0)),
    )
    assert list(contradictory_repeats(Campaign(measurements=apart))) == []
    again = frequency(4.5, "vertical bending 1")
    assert list(contradictory_repeats(Campaign(measurements=(*apart, again)))) == [(3, 7)]


# mode labels


@slow
def test_modes_that_nearly_cross_and_one_mode_measured_twice_are_noticed():
    """In one campaign. At (0, 0, 0) the modes are 4.12 and 4.80 Hz: two values of 4.11 Hz are one mode."""
    folded, other = np.radians([[60.0, -120.0, 60.0], [61.0, -120.0, 60.0]]).tolist()
    rows = (
        frequency(5.65, posture=tuple(folded), sigma=0.01),
        frequency(5.74, posture=tuple(folded), sigma=0.01),
        frequency(5.65, "lateral torsion 1", posture=tuple(other), sigma=0.01),
        frequency(4.10),
        frequency(4.12),
        frequency(4.12, posture=(0.1, 0.0, 0.0)),
        frequency(4.80, posture=(0.1, 0.0, 0.0)),
    )
    *crossing, one, again = label_doubts(pose(lcd_arm(), Campaign(measurements=rows)))
    assert [d.row for d in crossing] == [0, 1]
    assert [str(d.mode) for d in crossing] == ["lateral torsion 1", "vertical bending 1"]
    assert [[str(n) for n in d.crossing] for d in crossing] == [["vertical bending 1"], ["lateral torsion 1"]]
    assert all(d.alike is None and not d.near_draw for d in crossing)
    assert [(d.row, d.alike) for d in (one, again)] == [(3, 4), (4, 3)]


@slow
def test_two_rows_with_one_label_may_be_a_wrong_label():
    """Rather than a wrong value; and both are told in the unit that they were written in."""
    campaign = read_campaign(DATA / "campaign.csv")
    rows = list(campaign.measurements)
    rows[6] = dataclasses.replace(rows[6], mode=rows[5].mode)
    wrong = dataclasses.replace(campaign, measurements=tuple(rows))
    with pytest.raises(InputError) as refused:
        check_campaign(lcd_arm(), wrong)
    (problem,) = refused.value.problems
    assert problem.got == "5.058 Hz, 18 sd from row 12, which has the label 'lateral torsion 1', too"
    assert problem.remedy.startswith("correct one of the labels, drop the wrong one")
    assert problem.column == ""
    rows = list(campaign.measurements)
    rows[4] = dataclasses.replace(rows[4], value=10 * rows[4].value)
    with pytest.raises(
        InputError, match=r"got 265.8 mm, 10.1 times what the arm file predicts, expected about 26.3 mm"
    ):
        check_campaign(lcd_arm(), dataclasses.replace(campaign, measurements=tuple(rows)))
    rows[4] = dataclasses.replace(rows[4], unit="by eye")
    with pytest.raises(InputError, match=r"got 0.2658 m, 10.1 times"):
        check_campaign(lcd_arm(), dataclasses.replace(campaign, measurements=tuple(rows)))


@slow
def test_a_wrong_length_is_named_before_the_rows_that_it_makes_implausible():
    wrong = lcd_arm().replace({"joint2.offset.x": 1000.0})
    with pytest.raises(InputError) as refused:
        check_campaign(wrong, read_campaign(DATA / "campaign.csv"))
    first, *rows, rest = refused.value.problems
    assert (first.where, first.column, first.got) == ("arm file", "joint2.offset", "1000 m")
    assert "`ident show`" in first.remedy
    assert len(rows) == 3
    assert all("what the arm file predicts" in row.got for row in rows)
    assert rest.got.endswith(" more rows in doubt")
