"""Twists of joints: equilibrium found by SciPy of an energy written anew, and campaigns that cannot be."""

from dataclasses import replace

import numpy as np
import pytest
from arms import random_arm
from conformance import agrees
from one_program import shown
from scipy.optimize import root
from scipy.spatial.transform import Rotation

from ident.errors import InputError
from ident.identify.problem import pose
from ident.measure import Campaign, Load, Measurement
from ident.measure.reading import campaign_text, parse_campaign

JOINTS = 3
POSTURE, FORCE = (0.4, -0.9, 1.3), np.array([6.0, -8.0, 3.0])
PULLED = Load(forces=((tuple(FORCE.tolist()), "tip"),))
NAMES = tuple(f"j{i}" for i in range(JOINTS))


def rows(kind, **more):
    return tuple(Measurement(kind=kind, posture=POSTURE, value=1e-3, sigma=1e-5, joint=name, **more) for name in NAMES)


CAMPAIGN = Campaign(measurements=(*rows("twist"), *rows("twist", load=PULLED), *rows("twist_difference", load=PULLED)))


def chain(arm):
    """Offsets, pin axes and springs of the bushings, all along the base axes with nothing turned; and the tip."""
    R, found = np.eye(3), []
    for joint, angle in zip(arm.joints, POSTURE, strict=True):
        axis = R @ joint.axis
        along = np.outer(axis, axis)
        K = float(joint.k_bend) * (np.eye(3) - along) + float(joint.k_tors) * along
        offset = R @ joint.offset
        R = R @ Rotation.from_rotvec(angle * np.asarray(joint.axis)).as_matrix()
        found.append((offset, axis, K))
    return found, R @ arm.points[-1].position


def twists(arm, force):
    """The twists in equilibrium under a force at the tip, from the gradient of the energy by complex steps."""
    links, tip = chain(arm)

    def rotation(v):
        x, y, z = v
        K = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
        t = x * x + y * y + z * z
        s = np.sqrt(t) if t != 0 else 1e-200
        return np.eye(3) + np.sin(s) / s * K + 2 * (np.sin(s / 2) / s) ** 2 * K @ K

    def energy(phi):
        R, p, V = np.eye(3), np.zeros(3), 0.0
        for (offset, _, K), v in zip(links, phi.reshape(-1, 3), strict=True):
            p = p + R @ offset
            R = R @ rotation(v)
            V = V + v @ K @ v / 2
        return V - force @ (p + R @ tip)

    def gradient(phi):
        return np.array([energy(phi + 1e-30j * e).imag / 1e-30 for e in np.eye(len(phi))])

    start = np.full(3 * JOINTS, 1e-4)
    phi = root(gradient, start, tol=1e-14).x.reshape(-1, 3)
    return np.array([v @ axis for v, (_, axis, _) in zip(phi, links, strict=True)])


@pytest.mark.parametrize("seed", range(4))
def test_twists_are_those_of_the_energys_minimum(seed):
    arm = random_arm(np.random.default_rng(seed), JOINTS, gravity=0.0)
    weightless, pulled, difference = shown(arm, CAMPAIGN).reshape(3, JOINTS)
    expected = twists(arm, FORCE)
    assert np.abs(expected).max() > 1e-6
    np.testing.assert_allclose(weightless, 0.0, atol=1e-15)
    what, source = "twists of joints under a force", "energy's minimum by complex steps and MINPACK"
    agrees(pulled, expected, "statics", what, source, rtol=1e-8, atol=1e-12, unit="rad")
    np.testing.assert_allclose(difference, expected, rtol=1e-8, atol=1e-12)


def test_csv_reads_back_equal():
    text = campaign_text(CAMPAIGN)
    assert ",joint," in text.splitlines()[0]
    assert parse_campaign(text.encode(), "c.csv") == CAMPAIGN


@pytest.mark.parametrize(
    ("cells", "said"),
    [
        ("twist,10,,,,,1,mrad,1%", "the joint whose twist was read"),
        ("twist,10,j0,tip,,,1,mrad,1%", "a twist has no point"),
        ("twist,10,j0,,x,,1,mrad,1%", "a twist has no direction"),
        ("twist,10,j0,,,1 kg @ tip,1,mrad,1%", "a twist has no reference_load"),
        ("twist_difference,10,j0,,,,1,mrad,1%", "differs from the load"),
        ("deflection,10,j0,tip,,,1,mm,1%", "a deflection has no joint"),
        ("twist,10,j0,,,,1,mm,1%", "mrad"),
    ],
)
def test_a_row_that_cannot_be_is_refused_with_its_place(cells, said):
    head = "kind,q1 [deg],joint,point,direction,reference_load,value,unit,relative_sigma"
    with pytest.raises(InputError, match=said) as refused:
        parse_campaign(f"{head}\n{cells}\n".encode(), "c.csv")
    assert "c.csv:2" in str(refused.value)


def test_a_joint_that_the_arm_has_not_is_named():
    arm = random_arm(np.random.default_rng(0), JOINTS)
    odd = Campaign(measurements=(replace(CAMPAIGN.measurements[0], joint="j7"),))
    with pytest.raises(InputError, match="'j7'"):
        pose(arm, odd)
