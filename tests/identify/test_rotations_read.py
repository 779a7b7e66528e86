"""Rotations that are read: the linear theory of stiff joints, SciPy's rotations, and differences of the model."""

from dataclasses import replace
from functools import cache

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from arms import random_arm
from conformance import agrees
from scipy.spatial.transform import Rotation

from ident.errors import InputError
from ident.identify.conditions import bind
from ident.identify.predict import predict
from ident.measure import Campaign, Load, Measurement

JOINTS, ARMS = 3, 20
POSTURE, FORCE = (0.4, -0.9, 1.3), np.array([60.0, -80.0, 30.0])
PULLED = Load(forces=((tuple(FORCE.tolist()), "tip"),))
STIFF = 1e3


def rows(kind, **more):
    """About, or along, x, y and z."""
    one = Measurement(kind=kind, posture=POSTURE, value=0.01, sigma=1e-4, point="tip", direction=(1, 0, 0), **more)
    return tuple(replace(one, direction=tuple(map(float, axis))) for axis in np.eye(3))


CAMPAIGN = Campaign(
    measurements=(
        *rows("rotation"),
        *rows("rotation", load=PULLED),
        *rows("rotation_difference", load=PULLED),
        *rows("deflection_difference", load=PULLED),
    )
)


@cache
def arms():
    rng = np.random.default_rng(19)
    return [random_arm(rng, JOINTS, gravity=9.8) for _ in range(ARMS)]


def scaled(arm, factor):
    """The arm with stiffnesses times a factor."""
    numbers = lambda arm: [k for joint in arm.joints for k in (joint.k_bend, joint.k_tors)]  # noqa: E731
    return eqx.tree_at(numbers, arm, replace_fn=lambda k: k * factor)


@cache
def program():
    """Predictions and their derivative by the first joint's bending stiffness, of all arms."""
    conditions = bind(arms()[0], CAMPAIGN)

    def both(arm, factor):
        arm = scaled(arm, factor)
        k = arm.joints[0].k_bend
        return jax.jvp(lambda k: predict(arm, {"j0.k_bend": k}, conditions), (k,), (k,))

    return jax.jit(jax.vmap(both, (0, None)))


def predicted(factor):
    stacked = jax.tree.map(lambda *leaves: jnp.stack(leaves), *arms())
    values, slopes = program()(stacked, factor)
    return np.array(values).reshape(ARMS, 4, 3), np.array(slopes).reshape(ARMS, 4, 3)


def linear(arm):
    """Rotation and displacement of the tip under the force: the sum of K^-1 (r x F), and of that turn times r."""
    R, p, springs = np.eye(3), np.zeros(3), []
    for joint, angle in zip(arm.joints, POSTURE, strict=True):
        p, axis = p + R @ joint.offset, R @ joint.axis
        across = np.eye(3) - np.outer(axis, axis)
        springs.append((p, float(joint.k_bend) * across + float(joint.k_tors) * np.outer(axis, axis)))
        R = R @ Rotation.from_rotvec(angle * np.asarray(joint.axis)).as_matrix()
    tip = p + R @ arm.points[-1].position
    turns = [(np.linalg.solve(K, np.cross(tip - centre, FORCE)), tip - centre) for centre, K in springs]
    return sum(turn for turn, _ in turns), sum(np.cross(turn, lever) for turn, lever in turns)


def test_stiff_joints_turn_as_the_linear_theory_has_it():
    values, _ = predicted(STIFF)
    for arm, found in zip(arms(), values, strict=True):
        turn, way = linear(scaled(arm, STIFF))
        source = "linear theory, sum of K^-1 (r x F)"
        agrees(found[2], turn, "statics", "rotation under a force, stiff joints", source, largest=1e-5, unit="rad")
        agrees(found[3], way, "statics", "displacement under a force, stiff joints", source, largest=1e-5, unit="m")


def test_a_difference_is_the_turn_from_one_load_case_to_the_other():
    values, _ = predicted(0.1)
    alone, loaded, between = (Rotation.from_rotvec(values[:, i]) for i in range(3))
    found, what = (between * alone).as_matrix(), "rotation from one load case to the other"
    agrees(found, loaded.as_matrix(), "statics", what, "SciPy's Rotation", atol=1e-13)
    apart = np.abs(values[:, 1] - values[:, 0] - values[:, 2]).max()
    assert apart > 1e-7, "the difference of two rotation vectors would be another one"


def test_a_derivative_is_that_of_differences():
    conditions, arm, step = bind(arms()[0], CAMPAIGN), arms()[0], 1e-4
    by_k = jax.jit(lambda k: predict(arm, {"j0.k_bend": k}, conditions))
    k = float(arm.get("j0.k_bend"))
    ahead = [np.asarray(by_k(k * (1 + n * step)) - by_k(k * (1 - n * step))) for n in (1, 2)]
    expected = (8 * ahead[0] - ahead[1]) / (12 * step)
    slope = predicted(1.0)[1][0].ravel()
    agrees(slope, expected, "statics", "slopes of rotations", "differences of order 4", largest=1e-8)


@pytest.mark.parametrize("kind", ["rotation", "rotation_difference"])
def test_a_rotation_needs_its_axis(kind):
    with pytest.raises(InputError, match="axis that the rotation is about"):
        Measurement(kind=kind, posture=POSTURE, value=0.01, sigma=1e-4, point="tip", load=PULLED)
