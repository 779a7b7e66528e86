"""Bushings written into MJCF, as MuJoCo finds them there."""

import re

import equinox as eqx
import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest
from conformance import agrees
from equinox import filter_jit
from scipy.linalg import eigh
from three_joints import JOINTS, WITHOUT_MESHES

from ident.arm.arm import on_soft_base, stiffness_paths
from ident.arm.chain import at_posture
from ident.arm.mechanics import equilibrium, point_positions
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


def written(robot, arm, comment=("hello",), posture=None):
    path = robot.parent / "fitted.xml"
    path.write_bytes(mjcf_with_bushings(str(robot), read_arm(robot).arm, arm, list(comment), posture))
    return mujoco.MjModel.from_xml_path(str(path))


def in_mujoco(model, posture):
    """Natural frequencies about the equilibrium, with the pins held, and the largest angle of a hinge there."""
    return about_equilibrium(model, posture)[:2]


def about_equilibrium(model, posture):
    """The same, and where the tool is."""
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
            for e in np.eye(len(free))
        ]
        return np.stack(rows, 1) / h

    x = np.zeros(len(free))
    for _ in range(5):
        x -= np.linalg.solve(hessian(x), moments(x))
    H, M = hessian(x), np.zeros((model.nv, model.nv))
    moments(x)
    mujoco.mj_fullM(model, data, M)
    hertz = np.sqrt(eigh((H + H.T) / 2, M[np.ix_(free, free)], eigvals_only=True)) / (2 * np.pi)
    return hertz, np.abs(x).max(), data.site("tool").xpos.copy()


@filter_jit
def about(arm, posture):
    """The equations about the equilibrium, and where the points are there."""
    chain = at_posture(arm, posture)
    return linearize(chain), point_positions(chain, equilibrium(chain))


def in_ident(arm, posture):
    at = about(arm, np.asarray(posture))[0]
    return np.sqrt(eigh(np.asarray(at.H), np.asarray(at.M), eigvals_only=True)) / (2 * np.pi)


def stiffer(arm, factor):
    return arm.replace({path: factor * float(arm.get(path)) for path in stiffness_paths(arm)})


def test_without_weight_mujocos_frequencies_are_idents(robot):
    arm = read_arm(robot).arm
    model, floating = written(robot, arm), eqx.tree_at(lambda arm: arm.gravity, arm, jnp.zeros(3))
    model.opt.gravity[:] = 0
    for posture in POSTURES:
        expected, what = in_mujoco(model, posture)[0], "frequencies of bushings written as MJCF"
        agrees(in_ident(floating, posture), expected, "formats", what, "MuJoCo's hinges", rtol=9.9e-10, unit="Hz")


def test_a_rigid_direction_has_no_hinge(robot):
    bushings = robot.parent / "arm.joints.toml"
    lines = re.sub(r"tau_.*\n", "", bushings.read_text()).splitlines()
    lines[3] = lines[7] = 'k_bend = "rigid"'
    bushings.write_text("\n".join(['k_tors = "rigid"' if "8e4" in line else line for line in lines]))
    arm = read_arm(robot).arm
    assert arm.degrees_of_freedom == 4
    model, floating = written(robot, arm), eqx.tree_at(lambda arm: arm.gravity, arm, jnp.zeros(3))
    assert model.nv == 4 + 3
    assert model.key_qpos.tolist() == [[0, 1, 2, 0, 0, 0, 3]]
    model.opt.gravity[:] = 0
    for posture in POSTURES:
        np.testing.assert_allclose(in_mujoco(model, posture)[0], in_ident(floating, posture)[:4], rtol=1e-9)
    with pytest.raises(InputError, match="and j1 rigid"):
        written(robot, arm, posture=(0.0, 0.0, 0.0))


CHANGES = {
    "a.mass": 8.0,
    "motor.com.y": 0.02,
    "c.inertia.zz": 0.025,
    "j1.offset.x": 0.12,
    "j2.offset.z": 0.02,
    "j3.offset.y": 0.43,
}


def with_changes(arm, changes=CHANGES):
    assert changes.keys() <= set(arm.paths())
    return arm.replace(changes)


def test_masses_mass_centres_inertias_and_offsets_are_written(robot):
    """A capsule's mass is its shape's, and the joint of one body stands in a frame."""
    arm = with_changes(read_arm(robot).arm)
    model, floating = written(robot, arm), eqx.tree_at(lambda arm: arm.gravity, arm, jnp.zeros(3))
    model.opt.gravity[:] = 0
    changed = in_ident(eqx.tree_at(lambda arm: arm.gravity, read_arm(robot).arm, jnp.zeros(3)), POSTURES[0])
    assert np.abs(in_ident(floating, POSTURES[0]) / changed - 1).min() > 1e-3
    for posture in POSTURES:
        np.testing.assert_allclose(in_mujoco(model, posture)[0], in_ident(floating, posture), rtol=1e-9)


@pytest.mark.parametrize("changes", [{}, CHANGES | {"base.offset.x": 0.2, "pedestal.mass": 3.0}])
def test_a_base_that_gives_is_hinges_about_the_whole_arm(robot, changes):
    arm = with_changes(on_soft_base(read_arm(robot).arm, 0.25), {"base.k_bend": 4e5, **changes})
    model, floating = written(robot, arm), eqx.tree_at(lambda arm: arm.gravity, arm, jnp.zeros(3))
    assert [model.joint(n).name for n in range(3)] == ["base_tors", "base_bend_1", "base_bend_2"]
    np.testing.assert_array_equal(model.key_qpos[0], [0, 0, 0, 0, 0, 0, 1, 0, 0, 0, 2, 0, 0, 0, 3])
    model.opt.gravity[:] = 0
    for posture in POSTURES[:2]:
        np.testing.assert_allclose(in_mujoco(model, posture)[0], in_ident(floating, posture), rtol=1e-9)


@pytest.mark.parametrize("based", [False, True])
def test_at_one_posture_it_is_exact_under_weight(robot, based):
    arm = read_arm(robot).arm
    arm = on_soft_base(arm, 0.25) if based else arm
    posture = POSTURES[0]
    model = written(robot, arm, posture=tuple(posture))
    hertz, angle, tool = about_equilibrium(model, posture)
    assert angle > 3e-4
    base, source = "on a soft base" if based else "on a rigid base", "MuJoCo's tangent springs"
    what = f"frequencies under weight, written as MJCF, {base}"
    agrees(in_ident(arm, posture), hertz, "formats", what, source, rtol=9.9e-9, unit="Hz")
    (tip,) = (n for n, point in enumerate(arm.points) if point.name == "tip")
    np.testing.assert_allclose(tool, np.asarray(about(arm, np.asarray(posture))[1])[:, tip], atol=1e-11)
    apart = in_mujoco(written(robot, arm), posture)[0] / in_ident(arm, posture) - 1
    assert np.abs(apart).max() > 1e-5


@pytest.mark.parametrize("factor", [1, 10, 100])
def test_under_weight_they_differ_by_less_than_the_angle_by_which_a_bushing_gives(robot, factor):
    arm = stiffer(read_arm(robot).arm, factor)
    model = written(robot, arm)
    for posture in POSTURES:
        frequency, angle = in_mujoco(model, posture)
        assert 1e-4 / factor < angle < 1e-3 / factor
        expected, what = in_ident(arm, posture), "frequencies of plain springs in MJCF under weight"
        agrees(frequency, expected, "formats", what, "ident, within 0.3 of the bushing's angle", rtol=0.3 * angle)


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


def test_held_fingers_and_renamed_bodies_are_written_where_they_were(robot):
    """A body that is called as a joint gets its mass, keyframes keep the fingers' numbers, what is read is the arm."""
    hand = '<body name="grip"><joint name="grip" type="slide"/><geom size="0.02 0.02"/></body><body name="flange"'
    text = WITHOUT_MESHES.replace('body name="a"', 'body name="j1"').replace('<body name="flange"', hand)
    robot.write_text(text.replace('qpos="1 2 3"', 'qpos="1 2 3 0.04" qvel="4 5 6 7"'))
    arm = read_arm(robot).arm.replace({"j1_body.mass": 7.7, "j3.k_bend": 6e4})
    model = written(robot, arm)
    assert model.body("j1").mass[0] == 7.7
    own = [int(model.joint(name).qposadr[0]) for name in ("j1", "j2", "j3", "grip")]
    assert model.key_qpos[0][own].tolist() == [1, 2, 3, 0.04]
    assert model.key_qvel[0][own].tolist() == [4, 5, 6, 7]
    assert np.count_nonzero(model.key_qpos) == 4
    fitted = robot.parent / "fitted.xml"
    fitted.with_suffix(".joints.toml").write_text(JOINTS)
    again = read_arm(fitted)
    assert again.arm.joints[0].link[0].name == "j1_body"
    assert len(again.notes) == 2
    np.testing.assert_allclose(again.arm.get("j1_body.mass"), 7.7)
    np.testing.assert_allclose(again.arm.get("grip.mass"), arm.get("grip.mass"))


def test_the_comment_stands_before_the_model_and_dashes_do_not_end_it(robot):
    written(robot, read_arm(robot).arm, ("a -- b --- c", "-->"))
    text = (robot.parent / "fitted.xml").read_text()
    assert text.startswith("<!--\n  a - - b - - - c\n  - ->\n-->\n<mujoco")


def test_loss_factors_that_mujoco_has_not_are_said_in_a_line(robot):
    beside = robot.parent / "arm.joints.toml"
    alpha = 'alpha = { value = 0.5, unit = "1/s", origin = "measured" }'
    ratio = f'[damping]\nratio = {{ value = 0.01, origin = "measured" }}\n{alpha}\n\n'
    beside.write_text(JOINTS.replace("[[joint]]", f"{ratio}[[joint]]", 1))
    written(robot, read_arm(robot).arm)
    said = "  Not in this file: the loss factors of"
    (line,) = (line for line in (robot.parent / "fitted.xml").read_text().splitlines() if line.startswith(said))
    assert line.endswith(" and damping.alpha. MuJoCo has none.")
    beside.write_text(JOINTS)
    written(robot, read_arm(robot).arm)
    assert said not in (robot.parent / "fitted.xml").read_text()


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
        mjcf_with_bushings(str(robot), arm, arm, [])


@pytest.mark.parametrize(
    ("old", "new", "changes", "words"),
    [
        (
            '<compiler angle="degree"',
            '<compiler inertiafromgeom="true" angle="degree"',
            CHANGES,
            "compiler: got masses",
        ),
        ('<joint name="j3"', '<body name="d"/><joint name="j3"', {}, "joint j3: got a <frame> with more in it"),
        ('<body name="stand"', '<body name="pedestal"', None, "got a body pedestal"),
    ],
)
def test_what_has_no_place_there_is_named(robot, old, new, changes, words):
    robot.write_text(WITHOUT_MESHES.replace(old, new))
    before = read_arm(robot).arm
    arm = on_soft_base(before, 0.25) if changes is None else with_changes(before, changes)
    with pytest.raises(InputError, match=words) as caught:
        mjcf_with_bushings(str(robot), before, arm, [])
    assert "\n" not in str(caught.value)


def test_tangent_springs_have_nothing_of_the_defaults(robot):
    defaults = '<tendon damping="3" frictionloss="2" armature="0.1" range="-0.01 0.01" limited="true"/>'
    robot.write_text(WITHOUT_MESHES.replace("<default>", f"<default>{defaults}"))
    model = written(robot, read_arm(robot).arm, posture=(0.1, 0.2, 0.3))
    assert model.ntendon == 9
    for none in (model.tendon_damping, model.tendon_frictionloss, model.tendon_armature, model.tendon_limited):
        assert not none.any()
