"""Places of accelerometers and hits: known beams of masses, every set of places tried, and the paper's arm."""

from itertools import combinations

import numpy as np
import pytest
from arms import lcd_arm

from ident.errors import InputError
from ident.identify.candidates import (
    _hits,
    _sensors,
    auto_mac,
    coinciding,
    hammer_plan,
    hammer_plans,
    hits_needed,
    with_pins,
)

POSTURE = tuple(np.radians([60.0, -120.0, 60.0]))


def worst(moved, places):
    return np.triu(auto_mac(moved, places), 1).max()


def test_two_places_are_the_best_of_all_pairs():
    """Against the auto-MAC as it is defined, over all pairs."""
    moved = np.random.default_rng(4).normal(size=(9, 3))

    def largest(pair):
        own = moved[list(pair)]
        pairs = combinations(range(3), 2)
        return max((own[:, i] @ own[:, j]) ** 2 / (own[:, i] @ own[:, i]) / (own[:, j] @ own[:, j]) for i, j in pairs)

    best = min(map(largest, combinations(range(9), 2)))
    assert worst(moved, _sensors(moved, 2)) == pytest.approx(best, abs=2e-3)
    three = min(worst(moved, places) for places in combinations(range(9), 3))
    assert worst(moved, _sensors(moved, 3)) == pytest.approx(three, abs=2e-3)


def test_more_places_are_no_worse_and_modes_that_no_place_sees_are_alike():
    moved = np.random.default_rng(5).normal(size=(12, 5))
    each = [worst(moved, _sensors(moved, count)) for count in (2, 4, 6)]
    assert each == sorted(each, reverse=True)
    moved[:4, 0] = 0.0
    assert (auto_mac(moved, range(4))[0] == 1).all()


def test_a_place_is_hit_that_no_mode_leaves_at_rest():
    moved = np.array([[1.0, 0.0], [0.0, 1.0], [0.6, 0.5]])
    assert _hits(moved, two=False) == [2]
    assert _hits(moved[:2], two=False) == [0, 1]


def test_hits_are_as_many_as_tell_shapes_apart():
    """n hits of noise s make a distance d six standard deviations: n = 36 s^2 / d^2."""
    mac = np.array([[1.0, 0.64], [0.64, 1.0]])
    assert hits_needed(mac, 0.3) == 9  # 36 0.09 / 0.36
    assert hits_needed(mac, 0.01) == 5
    assert hits_needed(np.ones((2, 2)), 0.01) == 5


def test_modes_within_their_resonances_coincide():
    assert coinciding(np.array([4.0, 4.1, 9.0]), np.array([0.02, 0.02, 0.02])) == ((0, 1),)
    assert coinciding(np.array([4.0, 4.1, 9.0]), np.array([0.01, 0.01, 0.02])) == ()


@pytest.fixture(scope="module")
def planned():
    arm = with_pins(lcd_arm())
    return {count: hammer_plan(arm, POSTURE, modes=4, sensors=count, noise=0.1, two=False) for count in (2, 4)}


def test_the_papers_close_pair_needs_two_directions(planned):
    plan = planned[4]
    axes = {sensor[-1] for sensor in plan.sensors}
    assert "z" in axes
    assert axes & {"x", "y"}  # the links turn about z
    assert plan.auto_mac[0, 1] < 0.1  # sideways and upwards
    assert not plan.alike
    assert len(plan.hits) == 2  # no place along one axis moves both sideways and upwards


def test_two_channels_do_not_tell_four_modes_of_the_arm_apart(planned):
    assert planned[2].auto_mac[planned[2].most_alike] > planned[4].auto_mac[planned[4].most_alike]


def test_one_channel_is_refused():
    with pytest.raises(InputError, match="two channels"):
        hammer_plans(lcd_arm(), (), 4, 1, 0.1)
