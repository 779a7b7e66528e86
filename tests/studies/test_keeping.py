"""Draws are simulated until they settle a verdict: which is then as often right as by all of them."""

from dataclasses import dataclass

import numpy as np
import pytest
from arms import lcd_arm
from runs import swing
from scipy.stats import binom

from ident.errors import InputError
from ident.studies.cure.remedies import CONFIDENT, is_settled, keeping, looks
from ident.vibrate.binomial import BinomialEstimate
from ident.vibrate.evaluator import Evaluator

LIMIT, WITHIN, BEYOND = 5e-4, 4e-4, 6e-4


@dataclass(frozen=True)
class Known(Evaluator):
    """Amplitudes that are known: those of the draws are their values, and the arm itself has 3e-4 m."""

    def amplitudes(self, changes, progress=iter):
        own = np.append(3e-4, self.draws["amplitude"])
        return np.broadcast_to(own, (3, len(changes), len(own)))


def kept(values):
    evaluator = Known(lcd_arm(), swing(), (), draws={"amplitude": np.asarray(values)})
    amplitude, keeps = keeping(evaluator, np.zeros(0), LIMIT)
    np.testing.assert_array_equal(amplitude, np.full(3, 3e-4))
    return keeps


def test_draws_are_counted_in_their_order_until_they_settle_it():
    assert kept(np.full(1000, BEYOND)) == BinomialEstimate(0, 19)
    assert kept(np.full(1000, WITHIN)) == BinomialEstimate(159, 159)
    assert kept(np.full(100, WITHIN)) == BinomialEstimate(100, 100)
    assert kept(np.full(7, BEYOND)) == BinomialEstimate(0, 7)
    late = np.where(np.arange(1000) < 800, BEYOND, WITHIN)
    assert kept(late[::-1]) == BinomialEstimate(159, 159), "what comes later is not looked at"
    one_of_twenty = np.where(np.arange(1000) % 20 == 7, BEYOND, WITHIN)
    assert kept(one_of_twenty) == BinomialEstimate(950, 1000)


@pytest.mark.parametrize("draws", [{}, {"amplitude": np.zeros(0)}], ids=["none", "none of a number"])
def test_without_draws_there_is_no_probability(draws):
    evaluator = Known(lcd_arm(), swing(), (), draws=draws)
    with pytest.raises(InputError, match="`evaluator`: got no draws, expected at least one; take a posterior's draws"):
        keeping(evaluator, np.zeros(0), LIMIT)


def test_every_draw_comes_in_once():
    for count in (1, 19, 20, 100, 1000):
        np.testing.assert_array_equal(np.concatenate([np.arange(count)[part] for part in looks(count)]), range(count))


@pytest.mark.parametrize(
    ("probability", "fewer_than"), [(0.9, 260), (0.93, 770), (0.95, 1000), (0.97, 770), (0.99, 250)]
)
def test_a_verdict_is_as_often_favourable_as_by_a_thousand_draws(probability, fewer_than):
    """Exactly, by the distribution of the count over all ways that the looks can go."""
    still, favourable, draws, before = np.ones(1), 0.0, 0.0, 0
    for part in looks(1000):
        here = part.stop
        still = np.convolve(still, binom.pmf(np.arange(here - before + 1), here - before, probability))
        ends = [here == 1000 or is_settled(BinomialEstimate(count, here)) for count in range(here + 1)]
        ended = np.where(ends, still, 0.0)
        favourable += ended[np.arange(here + 1) >= CONFIDENT * here].sum()
        draws += here * ended.sum()
        still, before = still - ended, here
    assert favourable == pytest.approx(binom.sf(949, 1000, probability), abs=3e-3)
    assert draws < fewer_than
