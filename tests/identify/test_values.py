"""Values and draws that an arm takes over: which, in what order, and what is refused."""

import json
from dataclasses import replace

import equinox as eqx
import numpy as np
import pytest
from arms import lcd_arm

from ident.arm.arm import Arm
from ident.errors import InputError
from ident.identify.values import OTHER_ARM, Draws, Robot, Values, of_this_robot

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


def fitted():
    """Values of a fit of the torsion of joint 1 and of the mass of link 2."""
    return Values("a.fit.json", "", {K: np.array(1e5), "link2.mass": np.array(37.0)})


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"bracket.mass": 20.0}, "bracket.mass (19.1122 kg there, 20 kg here)"),
        ({"link1.com.x": 0.3}, "link1.com ((0.5, 0, 0.06) m there, (0.3, 0, 0.06) m here)"),
        ({"link2.inertia.xx": 0.2}, "link2.inertia ((0.122833, "),
        ({"joint2.offset.z": 0.2}, "joint2.offset ((1, 0, 0.12) m there, (1, 0, 0.2) m here)"),
        ({"joint3.k_bend": 5e5}, "joint3.k_bend (103705 N m/rad there, 500000 N m/rad here)"),
    ],
)
def test_values_of_another_robot_are_refused_and_what_differs_is_named(changed, words):
    own = Robot.of(lcd_arm().replace(changed))
    with pytest.raises(InputError) as error:
        of_this_robot(fitted(), Robot.of(lcd_arm()), own)
    assert f"a.fit.json: got the values of another robot, {lcd_arm().name}: {words}" in str(error.value)
    assert "(`force`)" in str(error.value)
    assert len(str(error.value).splitlines()) == 1
    assert words in of_this_robot(fitted(), Robot.of(lcd_arm()), own, force=True).remark
    assert not of_this_robot(fitted(), Robot.of(lcd_arm()), own, changed=changed).remark


def test_other_joints_and_axes_are_another_robot():
    arm = lcd_arm()
    fewer = Robot.of(eqx.tree_at(lambda arm: arm.joints, arm, arm.joints[:2]))
    assert next(iter(Robot.of(arm).differences(fewer))) == "joints"
    tilted = Robot.of(eqx.tree_at(lambda arm: arm.joints[1].axis, arm, np.array([0.0, 1.0, 0.0])))
    assert list(Robot.of(arm).differences(tilted)) == ["joint2.axis"]
    undriven = replace(Robot.of(arm), driven=("joint1", "joint2"))
    assert list(Robot.of(arm).differences(undriven)) == ["driven joints"]


def test_what_was_fitted_and_what_belongs_to_the_work_may_differ():
    arm = lcd_arm()
    numbers = {K: 9e4, "link2.mass": 30.0, "tip.position.x": 2.0, "glass.mass": 1.0, "joint1.tau_bend": 0.1}
    inertias = [f"link2.inertia.{end}" for end in ("xx", "yy", "zz")]
    numbers |= {path: float(arm.get(path)) * 30 / 36.395 for path in inertias}
    bare = Arm("bare", arm.replace(numbers).joints, gravity=arm.gravity)
    assert not of_this_robot(fitted(), Robot.of(arm), Robot.of(bare)).remark
    assert of_this_robot(fitted(), Robot.of(arm, "a"), Robot.of(bare, "b")).remark == OTHER_ARM
    assert of_this_robot(fitted(), Robot(sha256="a"), Robot.of(bare, "b")).remark == OTHER_ARM, "an earlier version's"


def test_what_a_file_rounds_is_no_difference():
    own = Robot.of(lcd_arm().replace({"link1.mass": 42.0 * (1 + 3e-7), "link1.com.y": 2e-10}))
    assert not Robot.of(lcd_arm()).differences(own)


def test_a_design_differs_in_what_it_says_but_is_not_undone():
    arm = lcd_arm()
    robot, shaped = Robot.of(arm), Robot.of(arm.replace({"bracket.mass": 15.0, "bracket.inertia.xx": 1.0}))
    words = of_this_robot(fitted(), robot, shaped, designed=["bracket.mass"]).remark
    assert words == "identified before ident design changed bracket.mass; bracket.inertia"
    stiffer = Robot.of(arm.replace({K: 2e5}))
    with pytest.raises(InputError, match=f"other values of what ident design has changed: {K}"):
        of_this_robot(fitted(), robot, stiffer, designed=[K])
    assert not of_this_robot(fitted(), robot, stiffer, designed=[K], changed=[K]).remark
    assert not of_this_robot(fitted(), robot, Robot.of(arm.replace({K: 1e5})), designed=[K]).remark, "as fitted"


def test_a_robot_comes_back_from_its_document():
    robot = Robot.of(lcd_arm(), "a")
    assert Robot.read(json.loads(json.dumps(robot.document)), "a") == robot
