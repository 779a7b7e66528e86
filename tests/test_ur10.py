"""The shipped real data, and what is said of them."""

import importlib.util
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest

from ident.arm.arm import stiffness_paths
from ident.description.file import read_arm

pytestmark = pytest.mark.slow

UR10 = Path(__file__).parents[1] / "data" / "ur10"


@pytest.fixture(scope="module")
def gravity():
    spec = importlib.util.spec_from_file_location("gravity", UR10 / "gravity.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def case(gravity):
    series, postures, measured = gravity.read()
    arm = read_arm(UR10 / "arm.urdf").arm
    at, moves = gravity.geometry(arm, jnp.asarray(postures), series)
    sag = gravity.sags(arm, jnp.asarray(postures)) / np.array([float(arm.get(path)) for path in stiffness_paths(arm)])
    return series, measured, at, gravity.flat(moves), gravity.flat(sag)


def test_the_arm_stands_where_the_robot_was_but_for_millimetres(gravity, case):
    series, measured, at, _, _ = case
    for name in ("B", "C"):
        own = series == name
        off = gravity.procrustes(at[own], measured[own]) - at[own]
        assert 1e-3 < gravity.rms(off) < 6e-3


def test_what_is_put_in_is_found_beside_any_geometry(gravity, case):
    """Compliances that are twice the guess, on an arm whose geometry is off: only their best combinations are found."""
    *_, moves, sag = case
    rng = np.random.default_rng(0)
    off = sag @ np.full(12, 2.0) + moves @ (1e-3 * rng.standard_normal(moves.shape[1]))
    found = gravity.seen(moves, off, sag)
    best = found.combinations[:4]
    np.testing.assert_allclose(found.value[:4], best @ np.full(12, 2.0), rtol=1e-6)
    assert found.after < 1e-9 < found.before


def test_gravity_says_nothing_of_what_it_does_not_turn(case):
    *_, sag = case
    size = dict(zip(stiffness_paths(read_arm(UR10 / "arm.urdf").arm), np.linalg.norm(sag, axis=0), strict=True))
    for path in ("shoulder_pan_joint.k_tors", "wrist_3_joint.k_tors"):
        assert size[path] < 1e-6 * max(size.values())


def test_origin_and_licence_are_named():
    text = (UR10 / "poses.csv").read_text()
    assert text.startswith("# MEASURED")
    assert "christianlandgraf/ipa-robot-accuracy" in text
    assert "Copyright (c) 2021 Christian Landgraf" in (UR10 / "LICENSE").read_text()
