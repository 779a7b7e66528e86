"""Stiff arms give as linear joint compliance says: the sum over the bushings of J' C J w, with J by cross products."""

import jax.numpy as jnp
import numpy as np
import pytest
from arms import posture_of, random_arm, without_gravity
from conformance import agrees
from one_program import shown

from ident.measure import Campaign, Load, Measurement

STIFFER = 1e3
AXES = np.eye(3)


def turned(axis: np.ndarray, angle: float) -> np.ndarray:
    """Rotation matrix about an axis by Rodrigues' formula."""
    x, y, z = axis
    K = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * K + (1 - np.cos(angle)) * K @ K


def compliant(arm, posture, point, force, moment, stiffer: float) -> tuple[np.ndarray, np.ndarray]:
    """Deflection [m] of a point and turn [rad] of its body under a wrench there, to first order."""
    place = next(i for i, joint in enumerate(arm.joints) if joint.name == point.joint)
    at, R, bushings = np.zeros(3), np.eye(3), []
    for joint, angle in zip(arm.joints[: place + 1], posture, strict=False):
        at = at + R @ np.asarray(joint.offset)
        bushings.append((at, R @ np.asarray(joint.axis), float(joint.k_bend), float(joint.k_tors)))
        R = R @ turned(np.asarray(joint.axis), float(angle))
    tip = at + R @ np.asarray(point.position)
    move, turn = np.zeros(3), np.zeros(3)
    for p, a, k_bend, k_tors in bushings:
        m = np.cross(tip - p, force) + moment
        phi = (a @ m) * a / (stiffer * k_tors) + (m - (a @ m) * a) / (stiffer * k_bend)
        move, turn = move + np.cross(phi, tip - p), turn + phi
    return move, turn


@pytest.mark.parametrize("seed", range(3))
def test_it_is_the_limit_of_stiff_joints(seed):
    rng = np.random.default_rng(seed)
    arm = without_gravity(random_arm(rng, 6))
    posture, point = posture_of(arm, rng), arm.points[-1]
    force, moment = rng.normal(size=3) * 100, rng.normal(size=3) * 30
    load = Load(forces=((tuple(force), point.name),), moments=((tuple(moment), point.name),))
    rows = tuple(
        Measurement(
            kind=kind,
            posture=tuple(map(float, posture)),
            value=1e-3,
            sigma=1e-6,
            point=point.name,
            direction=tuple(axis),
            load=load,
        )
        for kind in ("deflection", "rotation")
        for axis in AXES
    )
    stiffness = {f"{joint.name}.{k}": getattr(joint, k) for joint in arm.joints for k in ("k_bend", "k_tors")}

    def off(stiffer: float) -> float:
        """By how much the model is off linear compliance, as a share of the displacement."""
        stiff = arm.replace({path: jnp.asarray(stiffer * k) for path, k in stiffness.items()})
        found = shown(stiff, Campaign(measurements=rows))
        linear = np.concatenate(compliant(arm, posture, point, force, moment, stiffer))
        return float(np.linalg.norm(found - linear) / np.linalg.norm(linear))

    first, second = off(STIFFER), off(10 * STIFFER)
    what, source = "displacement under a wrench, as joints get stiffer", "sum of J' C J w over the bushings"
    agrees(first, 0, "statics", what, source, atol=1e-4)
    assert second < 0.11 * first + 1e-10  # what is left is of the first order in the compliance
