"""Designs: exact slopes, optima against a dense grid, what must be kept, probabilities, sensitivities."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from arms import lcd_arm
from runs import named
from scipy.stats import binomtest
from swept import axis

from ident.arm.chain import no_loads
from ident.errors import InputError, ModelError
from ident.vibrate.binomial import BinomialEstimate
from ident.vibrate.design import design, verify
from ident.vibrate.design_search import Requirements, Search, are_met, constraints
from ident.vibrate.evaluator import WIDTH, Evaluator
from ident.vibrate.motion import stroke
from ident.vibrate.sweep import FLAT, changeable, sensitivities, sweep
from ident.vibrate.variable import Variable, check

slow = pytest.mark.slow

K1, K2, K3 = (f"joint{j}.k_tors" for j in (1, 2, 3))
STEP = 2e-3


def about(path, low=0.5, high=2.0, weight=1.0):
    """A variable between factors, or differences, of the present value."""
    present = float(lcd_arm().get(path))
    bounds = (present + low, present + high) if ".com." in path else (low * present, high * present)
    return Variable((path,), *bounds, weight)


def short(variables, **options):
    """An evaluator of the paper's way in half a second: the arm is excited hard, and little is computed."""
    motion = named(stroke(lcd_arm().stroke, percent=200, dwell=0.2))
    usual = {"rate": 200.0, "step": STEP, "loads": no_loads(lcd_arm())}  # the program of slopes is that of the studies
    return Evaluator(lcd_arm(), motion, tuple(variables), **(usual | options))


def smooth(variables):
    """The same, measured by its rms, with draws."""
    return short(variables, measure="rms", draws={K1: drawn(2, 0)[K1]})


def drawn(count, seed):
    rng = np.random.default_rng(seed)
    return {path: float(lcd_arm().get(path)) * np.exp(0.1 * rng.normal(size=count)) for path in (K1, K2)}


TWO = (about(K1), about(K2))
LIMIT = 0.9
"""Of the present amplitude."""


@pytest.fixture(scope="module")
def present():
    return float(short(TWO).amplitudes(np.zeros((1, 2)))[:, 0, 0].max())


@pytest.fixture(scope="module")
def found(present):
    return design(short(TWO), limit=LIMIT * present)


def central(function, x, step):
    """Slopes by central differences of two steps, extrapolated."""

    def one(step):
        return np.stack([(function(x + step * e) - function(x - step * e)) / (2 * step) for e in np.eye(len(x))])

    return (4 * one(step / 2) - one(step)) / 3


@slow
def test_slopes_and_sensitivities_are_those_of_differences():
    """For ties, shifts, draws and more variables than are pushed forward together, away from the present."""
    present = {path: float(lcd_arm().get(path)) for path in (K2, K3)}
    tied = Variable((K2, K3), 0.5 * present[K2], 2 * present[K2])
    variables = [about(K1), about("link2.mass"), about("fingers.com.x", -0.1, 0.1), tied]
    assert len(variables) > WIDTH
    trial = smooth(variables)
    x = np.array([0.0, -0.2, 0.02, 0.1])
    pairs = trial.slopes(x), trial.slopes_of_draws(x)
    parts, slopes = (np.concatenate(each, -1) for each in zip(*pairs, strict=True))
    assert parts.shape == (3, 1, 3)
    differences = central(lambda x: trial.amplitudes(x[None])[:, 0], x, 4e-3)
    np.testing.assert_allclose(parts[:, 0], trial.amplitudes(x[None])[:, 0], rtol=1e-9)
    for d in range(3):
        scale = np.abs(slopes[:, d, 0]).max()
        np.testing.assert_allclose(slopes[:, d, 0], differences[:, d], atol=1e-5 * scale)

    arm = trial.changed_arm(x)
    got = sensitivities(replace(trial, arm=arm, variables=()), (K1, "link2.mass", "fingers.com.x"))
    logs = differences[:3] / parts[:, 0] * np.array([1, 1, float(arm.get("fingers.com.x"))])[:, None, None]
    assert got.draws.shape == (3, 3, 2)
    np.testing.assert_allclose(got.elasticity, logs[..., 0], rtol=1e-4, atol=1e-4)
    np.testing.assert_allclose(got.draws, logs[..., 1:], rtol=1e-4, atol=1e-4)
    strongest = np.abs(logs[:, np.argmax(got.amplitude), 0]).argmax()
    assert got.order[0] == strongest


def test_what_is_changeable():
    assert {K1, "joint3.tau_bend", "drive1.eccentricity"} <= set(changeable(lcd_arm()))
    assert not any(path.startswith("glass") for path in changeable(lcd_arm()))


@slow
def test_the_best_beats_every_point_of_a_grid_and_those_about_it(found):
    best = found.optima[0]

    def swept(ends, count):
        axes = [axis(lcd_arm(), v.paths, np.geomspace(*each, count), 100.0) for v, each in zip(TWO, ends, strict=True)]
        return sweep(short(()), axes).amplitude.max(0)

    grid = swept([(v.low, v.high) for v in TWO], 7)
    beside = [(max(v.low, 0.8 * best.values[v.name]), min(v.high, 1.2 * best.values[v.name])) for v in TWO]
    dense = swept(beside, 5)
    assert grid.shape == (7, 7)
    assert dense.shape == (5, 5)
    assert best.largest <= min(grid.min(), dense.min()) * (1 + 1e-6)
    assert best.largest < dense.max() * 0.999, "the amplitude changes about it"


@slow
def test_starts_curve_and_present_are_no_quieter_than_the_best(found, present):
    assert found.present.largest == pytest.approx(present)
    assert found.present.change_norm == 0
    assert len(found.optima) == 3
    assert all(place.largest >= found.optima[0].largest for place in found.optima)
    sizes, amounts = ([getattr(place, name) for place in found.curve] for name in ("largest", "change_norm"))
    assert amounts == sorted(amounts)
    assert all(b <= a * (1 + 1e-6) for a, b in pairwise(sizes)), "more change, less amplitude"
    for place in found.optima:
        assert all(v.low * (1 - 1e-9) <= place.values[v.name] <= v.high * (1 + 1e-9) for v in TWO)


@slow
def test_the_cheapest_keeps_the_limit_and_changes_less(found, present):
    cheapest = found.minimum_change
    assert cheapest is found.best, "it is what is proposed"
    assert cheapest.largest <= LIMIT * present
    assert cheapest.largest == pytest.approx(LIMIT * present, rel=3e-3), "no more than asked for"
    assert 0 < cheapest.change_norm < found.optima[0].change_norm


@slow
def test_a_requirement_is_met_and_costs_amplitude(found):
    less = design(short(TWO), required=Requirements(change_norm=0.2), starts=1, curve=False)
    assert less.best.change_norm == pytest.approx(0.2, rel=1e-6)
    assert less.best.largest > found.optima[0].largest


@slow
def test_slopes_of_frequency_and_deflection_and_of_the_log_odds():
    trial = replace(smooth((about(K1), about("joint1.k_bend"))), draws=drawn(2, 1))
    search = Search(trial, Requirements())
    u = np.array([0.2, -0.1])
    limit = search.objective.largest(u)
    frequency, deflection = search.objective.end_state(u)[0]
    for share, met in ((0.999, True), (1.001, False)):
        for required in (Requirements(frequency=share * frequency), Requirements(deflection=deflection / share)):
            assert are_met(constraints(search.objective, required), u) == met
    for function in (search.objective.end_state, lambda u: search.objective.log_odds(u, limit)):
        slopes = np.atleast_2d(function(u)[1])
        differences = central(lambda u: np.atleast_1d(function(u)[0]), u, 1e-3).T  # noqa: B023
        np.testing.assert_allclose(slopes, differences, rtol=1e-5, atol=1e-5 * np.abs(slopes).max())


@slow
def test_signs_are_unsure_where_a_tenth_more_or_less_does_the_opposite():
    """Against arms that are made one by one; and with draws, by their share."""
    paths = (K1, K2, "link2.mass", "fingers.com.x", "drive2.ratio", "drive2.eccentricity")
    trial = short(())
    got = sensitivities(trial, paths)

    def peaks(path, factor):
        arm = lcd_arm().replace({path: float(lcd_arm().get(path)) * factor})
        return replace(trial, arm=arm).amplitudes(np.zeros((1, 0)))[:, 0, 0]

    for path, slope, unsure in zip(paths, got.elasticity, got.unsure, strict=True):
        less, now, more = (peaks(path, factor) for factor in (0.9, 1.0, 1.1))
        steps = np.array([more / now - 1, 1 - less / now])
        against = (np.abs(steps) >= FLAT) & (steps * slope < 0)
        assert unsure.tolist() == against.any(0).tolist(), path
    assert got.unsure.any()
    assert not got.unsure[-1].any()  # what turns off its axis makes all of the vibration
    assert not got.unsure.all()
    drawn_signs = sensitivities(replace(trial, draws=drawn(2, 5)), paths[:2])
    low, high = drawn_signs.band
    assert drawn_signs.unsure.tolist() == (low * high < 0).tolist()


@pytest.fixture(scope="module")
def uncertain(found, present):
    limit = np.sqrt(found.optima[0].largest * present)
    return design(short(TWO, draws=drawn(2, 2)), limit=float(limit), starts=1, curve=False)


@slow
def test_a_design_is_verified_by_fresh_draws_and_the_exact_method(uncertain):
    trial, place, limit = uncertain.evaluator, uncertain.best, uncertain.limit
    fresh = drawn(12, 3)
    checked = verify(trial, place, limit, fresh)
    changes = np.stack([0 * place.changes, place.changes])
    expected = replace(trial, draws=fresh).amplitudes(changes)[:, :, 1:].max(0) > limit
    for one, above in zip((checked.before, checked.after), expected, strict=True):
        assert (one.exceedance.count, one.exceedance.draws) == (above.sum(), 12)
        assert np.abs(one.difference).max() < 0.02
        assert one.vibration.shape == (3, len(one.time))
        np.testing.assert_allclose(one.amplitude, np.abs(one.vibration).max(1))
    assert checked.after.exceedance.share < checked.before.exceedance.share
    assert uncertain.best.exceedance <= uncertain.present.exceedance


def test_the_interval_of_a_probability_is_clopper_and_pearsons():
    none = BinomialEstimate(0, 100)
    assert none.interval == (0.0, pytest.approx(1 - 0.025 ** (1 / 100)))
    some = BinomialEstimate(7, 50)
    low, high = some.interval
    assert binomtest(7, 50, low, alternative="greater").pvalue == pytest.approx(0.025)
    assert binomtest(7, 50, high, alternative="less").pvalue == pytest.approx(0.025)


@pytest.mark.parametrize(
    ("variable", "words"),
    [
        (Variable(("joint1.k_tor",), 1e5, 1e6), "did you mean joint1.k_tors"),
        (about(K1, 1.2, 2.0), "bounds about the present"),
        (about(K1, 2.0, 0.5), "a lower and a higher bound"),
        (about(K1, -1.0, 2.0), "bounds above 0"),
        (about(K1, 0.5, np.inf), "a lower and a higher bound"),
        (about(K1, weight=0.0), "a weight above 0"),
        (Variable((K1, "fingers.com.x"), 1e5, 1e6), "numbers of one kind"),
        (Variable(("fingers.com.x",), 0.0, 3.0), "within the body"),
    ],
)
def test_bounds_that_cannot_be_are_refused(variable, words):
    with pytest.raises(InputError, match=words):
        check(lcd_arm(), variable, {"fingers": np.array([[0.4, -0.3, -0.1], [2.0, 0.3, 0.1]])})


@pytest.mark.parametrize(
    ("variables", "options", "words"),
    [
        ((), {}, "nothing to change"),
        ((about(K1), about(K1)), {}, "twice"),
        (TWO, {"limit": 0.0}, "a number above 0"),
        (TWO, {"required": Requirements(change_norm=-1.0)}, "a number above 0"),
        (TWO, {"required": Requirements(frequency=-1.0)}, "a frequency"),
    ],
)
def test_questions_that_cannot_be_asked_are_refused(variables, options, words):
    with pytest.raises(InputError, match=words):
        design(short(variables), **options)


@slow
def test_what_cannot_be_reached_says_what_can():
    with pytest.raises(ModelError, match=r"the first frequency reaches \d"):
        design(short(TWO), required=Requirements(frequency=50.0), starts=1, curve=False)


@slow
@pytest.mark.parametrize("short_of", [1e-3, 1e-5])
def test_what_can_hardly_be_reached_is_not_refused(short_of):
    """The corner of the bounds alone, where both are stiffest, is that stiff."""
    trial = short(TWO)
    highest = float(trial.end_states(trial.bounds[1:]).frequency[0])
    search = Search(trial, Requirements(frequency=highest * (1 - short_of)))
    assert search.can_be_met(seed=0)
    assert not replace(search, required=Requirements(frequency=highest * (1 + short_of))).can_be_met(seed=0)


@slow
def test_an_arm_that_collapses_within_the_bounds_is_named():
    with pytest.raises(ModelError, match=r"collapses at joint1.k_bend = "):
        short([about("joint1.k_bend", 1e-4, 2.0)]).amplitudes(np.array([[0.0], [np.log(1e-4)]]))
