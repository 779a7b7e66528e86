"""Derivatives by what is taken for granted, against the model with stiff bushings, and with other numbers, in place."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from arms import random_arm

from ident.arm.hinges import cut
from ident.identify.assumptions import slopes
from ident.identify.conditions import bind
from ident.identify.predict import predict
from ident.measure import Campaign, Load, Measurement

pytestmark = pytest.mark.slow

predicted = eqx.filter_jit(predict)
LABELLED = (0.7, 0.2, -0.5)
NAMES = ("base", "link 1", "link 2", "link 3")


def measurement(kind, posture, value=1.0, **more):
    return Measurement(kind=kind, posture=posture, value=value, sigma=0.01 * value, **more)


def of_any_arm():
    """Random axes, bodies and gravity, loads, differences of deflections, and labels."""
    arm, loaded = (
        random_arm(np.random.default_rng(3), 3, gravity=9.8),
        Load.parse("glass + 3 kg @ tip + 40 N x @ elbow"),
    )
    rows = []
    for posture in ((0.3, -0.7, 1.1), (-1.0, 0.4, 0.2)):
        rows += [
            measurement("frequency", posture, 10.0 * n, load=load) for n in range(1, 5) for load in (loaded, Load())
        ]
        rows += [measurement("deflection", posture, point="tip", direction=(0.6, 0.0, 0.8), load=loaded)]
        rows += [
            measurement(
                "deflection_difference", posture, point="elbow", direction=(0, 1, 0), load=loaded, reference_load=Load()
            )
        ]
        turned = {"point": "tip", "direction": (0.6, 0.0, 0.8), "load": loaded}
        rows += [measurement(kind, posture, **turned) for kind in ("rotation", "rotation_difference")]
    rows += [measurement("frequency", LABELLED, mode=mode) for mode in ("vertical 1", "torsion 1", "bending 2")]
    return arm, Campaign(measurements=tuple(rows))


@pytest.fixture(scope="module")
def case():
    """An arm, its pieces, the conditions, and the slopes."""
    arm, campaign = of_any_arm()
    conditions, pieces = bind(arm, campaign), cut(arm)
    return arm, pieces, conditions, jax.device_get(slopes(arm, pieces, conditions))


def test_it_predicts_what_the_model_predicts(case):
    arm, _, conditions, found = case
    np.testing.assert_allclose(found.predicted, predicted(arm, {}, conditions), rtol=1e-11)


@eqx.filter_jit
def with_bushings(pieces, compliance, conditions):
    """Predict with bushings of these compliances (H, 2) at the hinges."""
    joints = list(pieces.arm.joints)
    for hinge, (across, about) in zip(pieces.hinges, 1 / compliance, strict=True):
        joints[hinge.place] = eqx.tree_at(lambda j: (j.k_bend, j.k_tors), joints[hinge.place], (across, about))
    return predict(eqx.tree_at(lambda arm: arm.joints, pieces.arm, tuple(joints)), {}, conditions)


@pytest.mark.parametrize("place", range(4), ids=NAMES)
@pytest.mark.parametrize("kind", ["bending", "torsion"])
def test_a_compliance_is_that_of_a_stiff_bushing_there(case, kind, place):
    _, pieces, conditions, found = case
    way, small = np.zeros((4, 2)), 2e-10
    way[place, int(kind == "torsion")] = 1.0
    # others a hundred times stiffer still; differences of the second order, as the model bends
    values = [
        np.asarray(with_bushings(pieces, jnp.asarray(2e-12 + way * small * step), conditions)) for step in (0, 1, 2)
    ]
    difference = (4 * values[1] - 3 * values[0] - values[2]) / (2 * small)
    expected = np.asarray(getattr(found, kind)[place])
    rounding = 1e-14 * np.abs(values[0]).max() / small
    assert np.abs(difference - expected).max() < 1e-5 * np.abs(expected).max() + rounding


@pytest.mark.parametrize("joint", range(3))
@pytest.mark.parametrize("kind", ["mass", "centre", "servo"])
def test_a_number_has_the_derivative_of_the_model(case, kind, joint):
    arm, _, conditions, found = case
    own, small = arm.joints[joint], 1e-4
    ends = [*(each.offset for each in arm.joints[1:]), arm.points[-1].position]

    def other(x):
        link = own.link
        if kind == "mass":
            link = tuple(replace_body(b, b.mass * (1 + x), b.com, b.inertia * (1 + x)) for b in link)
        if kind == "centre":
            link = tuple(replace_body(b, b.mass, b.com + x * ends[joint], b.inertia) for b in link)
        stiff = own.k_tors / (1 + x) if kind == "servo" else own.k_tors
        changed = eqx.tree_at(lambda j: (j.link, j.k_tors), own, (link, stiff))
        return np.asarray(predicted(eqx.tree_at(lambda a: a.joints[joint], arm, changed), {}, conditions))

    difference = (8 * (other(small) - other(-small)) - other(2 * small) + other(-2 * small)) / (12 * small)
    expected = np.asarray(getattr(found, kind)[joint])
    assert np.abs(difference - expected).max() < 1e-7 * np.abs(expected).max()


def replace_body(body, mass, com, inertia):
    return eqx.tree_at(lambda b: (b.mass, b.com, b.inertia), body, (mass, com, inertia))
