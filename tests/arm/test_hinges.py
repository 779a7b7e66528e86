"""An arm that is cut at hinges is the arm that it was, as long as they stay at rest."""

import numpy as np
import pytest
from arms import lcd_arm, posture_of, random_arm
from conformance import agrees
from equinox import filter_jit
from potential import potential_energy

from ident.arm.arm import MOST_JOINTS, Arm, on_soft_base
from ident.arm.chain import at_posture
from ident.arm.hinges import cut
from ident.arm.mechanics import mass_matrix, point_positions
from ident.arm.parts import Body, Joint, Payload

ARMS = [random_arm(np.random.default_rng(8), 4, undriven=(2,)), on_soft_base(lcd_arm(), 0.5)]


@filter_jit
def seen(arm, posture, phi):
    """Mass matrix, potential less that at rest, and where the points are."""
    chain = at_posture(arm, posture)
    energy = potential_energy(chain, phi) - potential_energy(chain, 0 * phi)
    return mass_matrix(chain, phi), energy, point_positions(chain, phi)


@pytest.mark.slow
@pytest.mark.parametrize("arm", ARMS, ids=lambda arm: arm.name)
def test_with_its_hinges_at_rest_it_is_the_same_arm(arm):
    rng, pieces = np.random.default_rng(0), cut(arm)
    posture = posture_of(arm, rng)
    n, own_places = len(pieces.arm.joints), list(pieces.own)
    phi = rng.normal(size=(3, len(arm.joints))) * 0.3
    wide = np.zeros((3, n))
    wide[:, own_places] = phi
    rows = np.ravel([[3 * place + a for a in range(3)] for place in own_places])
    mass, change, places = zip(seen(arm, posture, phi), seen(pieces.arm, posture, wide), strict=True)
    source = "the arm that is not cut"
    what = "mass matrix of an arm with flexible links at rest"
    agrees(np.asarray(mass[1])[np.ix_(rows, rows)], mass[0], "mechanics", what, source, rtol=1e-11, atol=1e-12)
    assert float(change[1]) == pytest.approx(float(change[0]), rel=1e-11)
    np.testing.assert_allclose(places[1], places[0], atol=1e-13)


def test_it_is_cut_under_its_foot_and_in_the_middle_of_each_link():
    pieces = cut(lcd_arm())
    assert [hinge.link for hinge in pieces.hinges] == [False, True, True, True]
    straight = np.cumsum([np.asarray(joint.offset) for joint in pieces.arm.joints], 0)
    ends = np.array([[0, 0, 0], [1.0, 0, 0.12], [2.0, 0, 0.24], [4.79, 0, 0.29]])
    middles = straight[[hinge.place for hinge in pieces.hinges if hinge.link]]
    what = "hinges in the middle of each link"
    agrees(middles, (ends[:-1] + ends[1:]) / 2, "mechanics", what, "by hand", atol=1e-12, unit="m")
    np.testing.assert_allclose(straight[0], [0, 0, -np.hypot(1.0, 0.12) / 2], atol=1e-12)


def test_where_a_bushing_without_a_pin_is_already_there_is_no_further_hinge():
    assert [hinge.link for hinge in cut(on_soft_base(lcd_arm(), 0.5)).hinges] == [True, True, True]
    arm = random_arm(np.random.default_rng(8), 4, undriven=(2,))
    assert [hinge.beside for hinge in cut(arm).hinges] == [1, 1, 5], "base, link 1, the last one"


def test_a_last_joint_that_carries_nothing_but_a_payload_has_no_link_to_cut():
    springs = {"k_bend": 1.0, "k_tors": 1.0}
    first = Joint("first", link=(Body("b", 2.0, com=(0.2, 0, 0)),), **springs)
    bare = (first, Joint("last", offset=(0.5, 0, 0), **springs))
    pieces = cut(Arm("bare", bare, payloads=(Payload("last", Body("load", 1.0)),)))
    assert [hinge.beside for hinge in pieces.hinges] == [1, 1], "the base, and the first link"
    np.testing.assert_array_equal(pieces.link_end(pieces.own[-1]), np.zeros(3))


def test_the_largest_arm_may_be_cut():
    arm = random_arm(np.random.default_rng(0), MOST_JOINTS)
    assert len(cut(arm).arm.joints) == 2 * MOST_JOINTS + 1
