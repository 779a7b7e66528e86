"""Bushings written into MJCF, as MuJoCo finds them there."""

import equinox as eqx
import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest
from scipy.linalg import eigh
from three_joints import JOINTS, WITHOUT_MESHES

from ident.arm.arm import stiffness_paths
from ident.arm.chain import at_posture
from ident.arm.modes import linearize
from ident.description.file import read_arm
from ident.description.mjcf_writing import mjcf_with_bushings
from ident.errors import InputError

jax.config.update("jax_enable_x64", True)
POSTURES = np.random.default_rng(3).uniform(-1, 1, (5, 3))
EIGHTH_ORDER = {1: 4 / 5, 2: -1 / 5, 3: 4 / 105, 4: -1 / 280}
"""Weights of the central difference that is exact for polynomials of degree eight."""


@pytest.fixture
def robot(tmp_path):
    (tmp_path / "arm.xml").write_text(WITHOUT_MESHES)
    (tmp_path / "arm.joints.toml").write_text(JOINTS)
    return tmp_path / "arm.xml"


def written(robot, arm, comment=("hello",)):
    path = robot.parent / "fitted.xml"
    path.write_bytes(mjcf_with_bushings(str(robot), arm, list(comment)))
    return mujoco.MjModel.from_xml_path(str(path))


def in_mujoco(model, posture):
    """Natural frequencies about the equilibrium, with the pins held, and the largest angle of a hinge there."""
    data = mujoco.MjData(model)
    pins = [int(model.joint(f"j{n}").qposadr[0]) for n in (1, 2, 3)]
    free = [n for n in range(model.nv) if n not in pins]

    def moments(x):
        data.qpos[pins], data.qpos[free], data.qvel[:] = posture, x, 0
        mujoco.mj_forward(model, data)
        return (data.qfrc_bias - data.qfrc_passive)[free]

    def hessian(x, h=0.01):
        rows = [
            sum(w * (moments(x + n * h * e) - moments(x - n * h * e)) for n, w in EIGHTH_ORDER.items())
            for e in np.eye(9)
        ]
        return np.stack(rows, 1) / h

    x = np.zeros(9)
    for _ in range(5):
        x -= np.linalg.solve(hessian(x), moments(x))
    H, M = hessian(x), np.zeros((model.nv, model.nv))
    moments(x)
    mujoco.mj_fullM(model, data, M)
    return np.sqrt(eigh((H + H.T) / 2, M[np.ix_(free, free)], eigvals_only=True)) / (2 * np.pi), np.abs(x).max()


def in_ident(arm, posture):
    at = linearize(at_posture(arm, jnp.asarray(posture)))
    return np.sqrt(eigh(np.asarray(at.H), np.asarray(at.M), eigvals_only=True)) / (2 * np.pi)


def stiffer(arm, factor):
    return arm.replace({path: factor * float(arm.get(path)) for path in stiffness_paths(arm)})


def test_without_weight_mujocos_frequencies_are_idents(robot):
    arm = read_arm(robot).arm
    model, floating = written(robot, arm), eqx.tree_at(lambda arm: arm.gravity, arm, jnp.zeros(3))
    model.opt.gravity[:] = 0
    for posture in POSTURES:
        np.testing.assert_allclose(in_mujoco(model, posture)[0], in_ident(floating, posture), rtol=1e-9)


@pytest.mark.parametrize("factor", [1, 10, 100])
def test_under_weight_they_differ_by_less_than_the_angle_by_which_a_bushing_gives(robot, factor):
    arm = stiffer(read_arm(robot).arm, factor)
    model = written(robot, arm)
    for posture in POSTURES:
        frequency, angle = in_mujoco(model, posture)
        assert 1e-4 / factor < angle < 1e-3 / factor
        np.testing.assert_allclose(frequency, in_ident(arm, posture), rtol=0.3 * angle)


def test_hinges_have_stiffness_and_damping_and_nothing_of_the_defaults(robot):
    arm = read_arm(robot).arm
    model = written(robot, arm)
    assert [model.joint(n).name for n in range(4)] == ["j1_tors", "j1_bend_1", "j1_bend_2", "j1"]
    assert model.joint("j1_tors").stiffness == pytest.approx(1e5)
    assert model.joint("j1_tors").damping == pytest.approx(1e-3 * 1e5)
    assert model.joint("j2_bend_2").stiffness == pytest.approx(2e5)
    bushings = [n for n in range(model.nv) if n % 4 != 3]
    assert not model.dof_armature[bushings].any()
    assert (model.dof_damping[bushings] > 0).sum() == 1
    assert model.actuator_trnid[0, 0] == model.joint("j1").id
    np.testing.assert_array_equal(model.key_qpos[0], [0, 0, 0, 1, 0, 0, 0, 2, 0, 0, 0, 3])


def test_the_comment_stands_before_the_model_and_dashes_do_not_end_it(robot):
    written(robot, read_arm(robot).arm, ("a -- b --- c", "-->"))
    text = (robot.parent / "fitted.xml").read_text()
    assert text.startswith("<!--\n  a - - b - - - c\n  - ->\n-->\n<mujoco")


def test_included_files_are_written_in_their_places(robot):
    text, start, end = WITHOUT_MESHES, WITHOUT_MESHES.index("<worldbody>"), WITHOUT_MESHES.index("<actuator>")
    (robot.parent / "body.xml").write_text(f"<mujoco>{text[start:end]}</mujoco>")
    robot.write_text(f'{text[:start]}<include file="body.xml"/>{text[end:]}')
    arm = read_arm(robot).arm
    assert written(robot, arm).nv == 12
    assert "include" not in (robot.parent / "fitted.xml").read_text()


def test_a_joint_that_is_no_element_is_named(robot):
    arm = read_arm(robot).arm
    robot.write_text(WITHOUT_MESHES.replace('name="j2"', 'name="k2"').replace("<actuator>", "<!-- j2 --><actuator>"))
    with pytest.raises(InputError, match=r"arm\.xml, joint j2"):
        written(robot, arm)
