"""An arm as it is drawn: places against the mechanics, boxes against the inertia that they stand for."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from arms import lcd_arm, random_arm

from ident.arm.arm import Arm
from ident.arm.chain import at_posture
from ident.arm.mechanics import forward_kinematics, point_positions
from ident.arm.parts import Body, Joint, Point
from ident.description.file import ArmFile
from ident.studies.look.arm_view import arm_view, home

jax.config.update("jax_enable_x64", True)


def view_of(arm, posture=None):
    return arm_view(ArmFile(arm, "", "", {}), posture)


@eqx.filter_jit
def straight(arm, posture):
    """The chain, its joints and its points where nothing gives."""
    chain, still = at_posture(arm, posture), jnp.zeros((3, len(arm.joints)))
    return chain, forward_kinematics(chain, still).centre, point_positions(chain, still)


@pytest.mark.parametrize("seed", range(3))
def test_joints_and_points_are_where_the_mechanics_have_them(seed):
    rng = np.random.default_rng(seed)
    arm = random_arm(rng, 2)
    posture = tuple(rng.uniform(-1, 1, len(arm.driven)).tolist())
    view = view_of(arm, posture)
    chain, joints, points = straight(arm, np.array(posture))
    np.testing.assert_allclose(np.stack([hinge.centre for hinge in view.hinges], 1), joints, atol=1e-12)
    np.testing.assert_allclose(np.stack(list(view.points.values()), 1), points, atol=1e-12)
    mass = np.array([solid.mass for solid in view.solids if solid.kind != "payload"])
    centres = np.stack([solid.centre for solid in view.solids if solid.kind != "payload"], 1)
    moments = (np.asarray(chain.moment) + np.asarray(chain.mass) * joints).sum(1)
    np.testing.assert_allclose(centres @ mass, moments, atol=1e-9)


def test_the_box_of_an_inertia_has_that_inertia():
    edges, mass = np.array([0.6, 0.3, 0.1]), 5.0
    inertia = mass / 12 * np.diag((edges**2).sum() - edges**2)
    body = Body("block", mass, (0.3, 0, 0), inertia)
    arm = Arm("block", (Joint("root", k_bend=1e5, k_tors=1e5, link=(body,)),), (Point("end", "root", (0.6, 0, 0)),))
    corners = view_of(arm).solids[0].corners
    np.testing.assert_allclose(np.ptp(corners, axis=1), edges, atol=1e-9)
    np.testing.assert_allclose(corners.mean(1), [0.3, 0, 0], atol=1e-12)


def test_an_arm_that_collapses_is_drawn_all_the_same():
    soft = lcd_arm().replace({"joint1.k_bend": 10.0})
    view = view_of(soft)
    assert view.analysis is None
    assert "no stable equilibrium" in view.failure
    assert "joint1.k_bend" in {odd.path for odd in view.oddities}
    assert len(view.hinges) == 3


def test_an_arm_is_drawn_within_its_limits():
    bounded = Joint("root", k_bend=1e5, k_tors=1e5, limits=(0.5, 1.0))
    assert home(Arm("bounded", (bounded,))) == (0.5,)
    assert home(lcd_arm()) == (0.0, 0.0, 0.0)
