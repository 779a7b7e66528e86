"""MJCF as an arm, beside MuJoCo's own kinematics of the same file."""

import builtins

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest
from scipy.linalg import block_diag
from three_joints import JOINTS, MJCF, WITHOUT_MESHES

from ident.arm.chain import at_posture
from ident.arm.mechanics import mass_matrix, straight_positions
from ident.description.file import read_arm
from ident.description.mjcf import read_mjcf
from ident.errors import InputError

jax.config.update("jax_enable_x64", True)


@pytest.fixture
def load(tmp_path):
    def read(text=MJCF, **options):
        path = tmp_path / "arm.xml"
        path.write_text(text)
        return read_mjcf(path, **{"stiffness": (2e5, 1e5)} | options)

    return read


@pytest.fixture
def robot(tmp_path):
    (tmp_path / "arm.xml").write_text(MJCF)
    (tmp_path / "arm.joints.toml").write_text(JOINTS)
    return tmp_path / "arm.xml"


def held_by_mujoco(model, postures):
    """End point, axes of the hinges and mass matrix of each posture, without what the motors' rotors add."""
    data, M = mujoco.MjData(model), np.zeros((3, 3))
    for posture in postures:
        data.qpos[:] = posture
        mujoco.mj_forward(model, data)
        mujoco.mj_fullM(model, data, M)
        yield data.site("tool").xpos.copy(), data.xaxis.copy(), M - np.diag(model.dof_armature)


def test_end_points_and_inertia_are_mujocos_at_any_posture(load):
    postures = np.random.default_rng(0).uniform(-2, 2, (20, 3))
    chain = at_posture(load(), jnp.asarray(postures.T))
    points, mass = straight_positions(chain), mass_matrix(chain, jnp.zeros((3, 3, 20)))
    for n, (end, axes, M) in enumerate(held_by_mujoco(mujoco.MjModel.from_xml_string(WITHOUT_MESHES), postures)):
        np.testing.assert_allclose(points[:, 0, n], end, atol=1e-12)
        turned = block_diag(*axes)  # a bushing that turns about its pin moves all that the pin moves
        np.testing.assert_allclose(turned @ mass[..., n] @ turned.T, M, atol=1e-12)


def test_limits_gravity_and_bodies_are_those_of_the_file(load):
    arm = load()
    assert [[body.name for body in joint.link] for joint in arm.joints] == [["a"], ["b", "motor"], ["c"]]
    np.testing.assert_allclose(arm.joints[0].limits, np.radians([-60, 120]))
    assert arm.joints[1].limits == (-np.inf, np.inf)
    assert arm.gravity[2] == -9.80665
    capsule = 1000 * np.pi * 0.03**2 * (0.2 + 4 / 3 * 0.03)
    assert float(arm.joints[1].link[1].mass) == pytest.approx(capsule, rel=1e-12)


def test_the_tip_is_the_only_site_or_the_named_frame(load):
    assert load().points[-1].joint == "j3"
    assert load(tip="motor").points[-1].joint == "j2"
    np.testing.assert_allclose(load(tip="b").points[-1].position, np.zeros(3), atol=1e-12)
    with pytest.raises(InputError, match="did you mean flange"):
        load(tip="flang")


BAD = [
    ('<joint name="j2" limited="false"/>', '<joint name="j2" type="slide"/>', ("joint j2", "type slide", "a hinge")),
    ('<joint name="j2" limited="false"/>', '<joint name="j2" type="ball"/>', ("joint j2", "type ball")),
    ('<joint name="j2" limited="false"/>', "<joint/>", ("body b", "the joint name ''", "rename it")),
    ('body name="a"', 'body name="robot/a"', ("the body name 'robot/a'", "rename it")),
    ("</worldbody>", '</worldbody><equality><joint joint1="j1" joint2="j2"/></equality>', ("an equality constraint",)),
    ('mass="5"', 'mass="-5"', ("body b", "mass -5")),
    ('mass="5"', 'mass="heavy"', ("arm.xml", "MuJoCo can't read", "inertial")),
    ('mass="5"', 'mass="nan"', ("arm.xml", "nan")),
    ("</mujoco>", "", ("arm.xml", "XML")),
    ('<mujoco model="three">', '<mujoco model="three"><include file="none.xml"/>', ("arm.xml", "none.xml")),
    ('range="-60 120"', 'range="60 -120"', ("joint j1", "range 60, -120", "lower <= upper")),
]


@pytest.mark.parametrize(("old", "new", "words"), BAD)
def test_a_model_that_is_no_serial_arm_is_refused_in_one_line(load, old, new, words):
    assert old in MJCF
    with pytest.raises(InputError) as caught:
        load(MJCF.replace(old, new, 1))
    assert "\n" not in str(caught.value)
    for word in words:
        assert word in str(caught.value)


def test_two_arms_in_one_file_are_refused(load):
    other = '<body><joint name="k1"/><geom size="0.1 0.1"/></body></worldbody>'
    with pytest.raises(InputError, match="a branch into j1, k1, expected a serial arm; name what the arm ends with"):
        load(MJCF.replace("</worldbody>", other))


def test_a_model_that_does_not_move_is_refused(load):
    with pytest.raises(InputError, match="no moving joint"):
        load("<mujoco><worldbody><body/></worldbody></mujoco>")


def test_without_mujoco_the_remedy_is_named(load, monkeypatch):
    original = builtins.__import__

    def without(name, *args, **kwargs):
        if name == "mujoco":
            raise ImportError(name)
        return original(name, *args, **kwargs)

    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(InputError, match=r"pip install 'ident\[mjcf\]'"):
        load()


def test_an_absent_file_is_refused(tmp_path):
    with pytest.raises(InputError, match="no such file"):
        read_mjcf(tmp_path / "none.xml", stiffness=(1, 1))


def test_bushings_are_read_from_the_file_beside_with_their_origin(robot):
    read = read_arm(robot)
    arm = read.arm
    assert float(arm.joints[0].k_bend) == pytest.approx(2000 * 180 / np.pi)
    assert [float(joint.tau_tors) for joint in arm.joints] == [1e-3, 0, 0]
    assert [point.name for point in arm.points] == ["elbow", "tip"]
    origins = ("j1.k_bend", "j1.tau_tors", "j1.tau_bend", "elbow.position.z", "a.mass", "j1.offset.x", "tip.position.x")
    expected = ["datasheet", "measured", "assumed", "measured", "derived", "derived", "derived"]
    assert [read.origins[path] for path in origins] == expected
    assert read.bushings.path == str(robot.with_suffix(".joints.toml"))


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('name = "j3"', 'name = "J3"', (":12", "no such joint in", "did you mean j3?")),
        ('name = "j3"', 'name = "J3"', (":1:", "no joint j3", "all joints of")),
        ('name = "j3"', 'name = "j2"', (":12", "'j2' again", "unique names")),
        ("k_bend = { value = 5e4", "k_bent = { value = 5e4", (":13", "k_bent", "did you mean k_bend?")),
        ("value = 5e4", "value = -5e4", (":13", "-50000.0", "> 0")),
        ('"N*m/deg"', '"N*m"', (":4", "N*m/rad")),
        ('joint = "j2"', 'joint = "j4"', (":17", "one of j1, j2, j3")),
        ("ident-joints/1", "ident-arm/1", (":1", "ident-joints/1")),
        ('format = "ident-joints/1"', 'format = "ident-joints/1"\ntip = "tol"', ("arm.xml", "did you mean tool?")),
    ],
)
def test_bushings_that_do_not_fit_the_robot_are_refused(robot, old, new, words):
    assert old in JOINTS
    robot.with_suffix(".joints.toml").write_text(JOINTS.replace(old, new, 1))
    with pytest.raises(InputError) as caught:
        read_arm(robot)
    for word in words:
        assert word in str(caught.value)


def test_a_robot_without_bushings_names_the_file_that_is_missing(robot):
    robot.with_suffix(".joints.toml").unlink()
    with pytest.raises(InputError, match=r"got no stiffness of its joints, expected arm\.joints\.toml beside it"):
        read_arm(robot)


@pytest.mark.parametrize(("text", "words"), [("<sdf/>", "got <sdf>, expected <robot> or <mujoco>"), ("<robot>", "XML")])
def test_other_xml_is_refused(tmp_path, text, words):
    (tmp_path / "arm.xml").write_text(text)
    with pytest.raises(InputError, match=words):
        read_arm(tmp_path / "arm.xml")
