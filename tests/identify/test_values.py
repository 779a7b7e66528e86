"""Values and draws that an arm takes over: which, in what order, and what is refused."""

import numpy as np
import pytest
from arms import lcd_arm

from ident.errors import InputError
from ident.identify.values import Draws, Values

K = "joint1.k_tors"


@pytest.fixture
def draws():
    rng = np.random.default_rng(0)
    return Draws({(K, "joint2.k_tors"): 1e5 * np.exp(rng.normal(size=100)), ("noise.frequency",): rng.normal(size=100)})


def test_ties_are_spelled_out_and_what_the_arm_has_not_is_left_out(draws):
    values = draws.some(lcd_arm(), 7)
    assert set(values.values) == {K, "joint2.k_tors"}
    assert values.left_out == ("noise.frequency",)
    np.testing.assert_array_equal(values.values[K], values.values["joint2.k_tors"])
    assert values.medians[K] == np.median(values.values[K])
    assert values.without({K: 1.0}).keys() == {"joint2.k_tors"}


def test_the_inertia_of_an_uncertain_mass_goes_with_it():
    """That of a mass that was freed does not."""
    arm, drawn = lcd_arm(), np.array([30.0, 40.0])
    factor = drawn / float(arm.get("link2.mass"))
    scaled = Draws({("link2.mass",): drawn}, scaled=("link2",)).some(arm, 2).values
    for end in ("xx", "yy", "zz"):
        path = f"link2.inertia.{end}"
        np.testing.assert_allclose(scaled[path], factor * float(arm.get(path)), rtol=1e-14)
    assert set(Draws({("link2.mass",): drawn}).some(arm, 2).values) == {"link2.mass"}


def test_draws_are_spread_evenly_or_chosen_at_random(draws):
    every = draws.by_paths[K, "joint2.k_tors"]
    np.testing.assert_array_equal(draws.some(lcd_arm(), 10).values[K], every[5::10])
    np.testing.assert_array_equal(draws.some(lcd_arm(), 1000, seed=3).values[K], every)
    some = draws.some(lcd_arm(), 30, seed=3).values[K]
    assert len(np.unique(some)) == 30
    assert not np.array_equal(some, draws.some(lcd_arm(), 30, seed=4).values[K])
    mixed = draws.some(lcd_arm(), 1000).shuffled(1).values[K]
    assert not np.array_equal(mixed, every)
    np.testing.assert_array_equal(np.sort(mixed), np.sort(every))


def test_two_groups_of_draws_have_none_in_common(draws):
    few, others = draws.two_groups(lcd_arm(), 16, 30, seed=1)
    np.testing.assert_array_equal(few.values[K], draws.some(lcd_arm(), 16).values[K])
    one, two = few.values[K], others.values[K]
    assert (len(one), len(two), len(np.intersect1d(one, two))) == (16, 30, 0)
    assert np.isin(np.concatenate([one, two]), draws.by_paths[K, "joint2.k_tors"]).all()
    np.testing.assert_array_equal(two, draws.two_groups(lcd_arm(), 16, 30, seed=1)[1].values[K])
    assert len(draws.two_groups(lcd_arm(), 16, 1000)[1].values[K]) == 84, "what is left"
    assert draws.two_groups(lcd_arm(), 100, 1000)[1] is None


@pytest.mark.parametrize(
    ("by_paths", "words"),
    [
        ({}, "no variable"),
        ({("other.k",): 1.0}, "got only other.k, expected numbers of"),
        ({(K,): np.inf}, "a value that is not finite"),
    ],
)
def test_values_of_no_number_of_the_arm_are_refused(by_paths, words):
    with pytest.raises(InputError, match=words):
        Values.of_arm(by_paths, lcd_arm(), "a.fit.json")
