"""MJCF as an arm, beside MuJoCo's own kinematics of the same file."""

import builtins
import re

import equinox as eqx
import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest
from conformance import agrees
from scipy.linalg import block_diag
from three_joints import JOINTS, MJCF, WITHOUT_MESHES

from ident.arm.chain import at_posture
from ident.arm.mechanics import mass_matrix, straight_positions
from ident.description.file import read_arm
from ident.description.mjcf import NUMBERS, read_mjcf
from ident.description.mjcf_writing import mjcf_with_bushings
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


@eqx.filter_jit
def straight(arm, postures):
    """Points and mass matrix of an arm that gives nowhere."""
    chain = at_posture(arm, postures)
    return straight_positions(chain), mass_matrix(chain, jnp.zeros((3, len(arm.joints), postures.shape[1])))


def test_end_points_and_inertia_are_mujocos_at_any_posture(load):
    postures = np.random.default_rng(0).uniform(-2, 2, (20, 3))
    points, mass = straight(load(), postures.T)
    for n, (end, axes, M) in enumerate(held_by_mujoco(mujoco.MjModel.from_xml_string(WITHOUT_MESHES), postures)):
        agrees(points[:, 0, n], end, "formats", "end point of an MJCF", "MuJoCo", rtol=1e-7, atol=1e-12, unit="m")
        turned = block_diag(*axes)  # a bushing that turns about its pin moves all that the pin moves
        found = turned @ mass[..., n] @ turned.T
        agrees(found, M, "formats", "mass matrix of an MJCF", "MuJoCo", rtol=1e-7, atol=1e-12)


def test_limits_gravity_and_bodies_are_those_of_the_file(load):
    arm = load()
    assert [[body.name for body in joint.link] for joint in arm.joints] == [["a"], ["b", "motor"], ["c"]]
    np.testing.assert_allclose(arm.joints[0].limits, np.radians([-60, 120]))
    assert arm.joints[1].limits == (-np.inf, np.inf)
    assert arm.gravity[2] == -9.80665
    capsule = 1000 * np.pi * 0.03**2 * (0.2 + 4 / 3 * 0.03)
    found, what = arm.joints[1].link[1].mass, "mass of a shape in an MJCF"
    agrees(found, capsule, "formats", what, "volume of a capsule", rtol=1e-12, unit="kg")


def test_the_tip_is_the_only_site_or_the_named_frame(load):
    assert load().points[-1].joint == "j3"
    assert load(tip="motor").points[-1].joint == "j2"
    np.testing.assert_allclose(load(tip="b").points[-1].position, np.zeros(3), atol=1e-12)
    with pytest.raises(InputError, match="did you mean flange"):
        load(tip="flang")


BAD = [
    ('<joint name="j2" limited="false"/>', '<joint name="j2" type="slide"/>', ("joint j2", "type slide", "a hinge")),
    ('<joint name="j2" limited="false"/>', '<joint name="j2" type="ball"/>', ("joint j2", "type ball")),
    ('<joint name="j2" limited="false"/>', "<joint/>", ("body b", "a joint without a name", "name it")),
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


FINGERS = """<body name="flange" pos="0.25 0 0"><site name="tool" pos="0 0 0.1"/>
  <body name="left" pos="0 0.02 0.1" euler="10 0 0"><joint name="left" type="slide" axis="0 1 0" range="0 0.04"/>
    <inertial mass="0.11" pos="0 0.01 0.02" diaginertia="1e-4 2e-4 2e-4"/>
    <body name="pad" pos="0 0 0.05"><geom size="0.01 0.01"/></body></body>
  <body pos="0 -0.02 0.1"><joint name="right" type="slide" axis="0 -1 0" range="0 0.04"/>
    <inertial mass="0.12" pos="0 -0.01 0.02" diaginertia="1e-4 2e-4 2e-4"/></body>
  <body name="ball" pos="0 0 0.3"><joint type="ball"/><geom size="0.02 0.02"/></body></body>"""
FLANGE = '<body name="flange" pos="0.25 0 0"><site name="tool" pos="0 0 0.1"/></body>'
CUBE = '<body name="cube"><freejoint name="loose"/><geom size="0.1 0.1"/></body></worldbody>'
TIES = """</worldbody><tendon><fixed name="both"><joint joint="left" coef="1"/><joint joint="right" coef="1"/></fixed>
  </tendon><equality><joint joint1="right" joint2="left"/><connect body1="pad" body2="flange" anchor="0 0 0"/>
  <weld body1="cube" body2="world"/><tendon tendon1="both"/></equality>"""


def with_fingers(text):
    assert FLANGE in text
    return text.replace(FLANGE, FINGERS).replace("</worldbody>", CUBE).replace("</worldbody>", TIES)


@pytest.mark.parametrize("tip", [None, "tool", "flange", "b"])
def test_what_is_not_on_the_way_to_the_tip_is_held_with_its_mass(load, tip):
    arm, count = load(with_fingers(MJCF).replace('<key qpos="1 2 3"/>', ""), tip=tip), 2 if tip == "b" else 3
    assert [joint.name for joint in arm.joints] == ["j1", "j2", "j3"][:count]
    model = mujoco.MjModel.from_xml_string(with_fingers(WITHOUT_MESHES).replace('<key qpos="1 2 3"/>', ""))
    data, M = mujoco.MjData(model), np.zeros((model.nv, model.nv))
    own = [int(model.joint(name).dofadr[0]) for name in ("j1", "j2", "j3")[:count]]
    postures = np.random.default_rng(0).uniform(-2, 2, (20, 3)) * (np.arange(3) < count)
    points, mass = straight(arm, postures[:, :count].T)
    for n, posture in enumerate(postures):
        for name, angle in zip(("j1", "j2", "j3"), posture, strict=True):
            data.joint(name).qpos = angle
        mujoco.mj_forward(model, data)
        mujoco.mj_fullM(model, data, M)
        end = data.body(tip).xpos if tip in ("flange", "b") else data.site("tool").xpos
        what = "end point of an MJCF with fingers"
        agrees(points[:, -1, n], end, "formats", what, "MuJoCo", rtol=1e-7, atol=1e-12, unit="m")
        turned = block_diag(*data.xaxis[[model.joint(f"j{i + 1}").id for i in range(count)]])
        expected = (M - np.diag(model.dof_armature))[np.ix_(own, own)]
        found, what = turned @ mass[..., n] @ turned.T, "mass matrix of an MJCF with fingers"
        agrees(found, expected, "formats", what, "MuJoCo", rtol=1e-7, atol=1e-12)


def test_what_is_held_is_said_with_its_mass(robot):
    robot.write_text(with_fingers(MJCF).replace('<key qpos="1 2 3"/>', ""))
    pad, ball = (1000 * np.pi * r**2 * (2 * r + 4 / 3 * r) for r in (0.01, 0.02))
    assert [note.removeprefix(f"{robot}, ") for note in read_arm(robot).notes] == [
        "joint loose (free): is held at zero; what is on it is left out",
        f"joints left (slide), right (slide, follows left), of body ball (ball): are held at zero; "
        f"{0.23 + pad + ball:.4g} kg on them move with j3",
    ]


@pytest.mark.parametrize(
    "tie",
    [
        '<joint joint1="j2" joint2="left"/>',
        '<connect body1="pad" body2="a" anchor="0 0 0"/>',
        '<weld site1="tool" site2="elbow"/>',
        '<tendon tendon1="with_arm"/>',
    ],
)
def test_a_constraint_that_ties_the_arm_is_refused(load, tie):
    text = with_fingers(MJCF).replace('<key qpos="1 2 3"/>', "").replace("<equality>", f"<equality>{tie}")
    tendon = '<tendon><fixed name="with_arm"><joint joint="left" coef="1"/><joint joint="j1" coef="1"/></fixed>'
    text = text.replace("<tendon>", tendon, 1).replace('<body name="motor"', '<site name="elbow"/><body name="motor"')
    with pytest.raises(InputError, match="an equality constraint"):
        load(text)


LOCK = """</worldbody><equality><joint joint1="lid" polycoef="0.5 0 0 0 0"/>
  <joint joint1="flap" joint2="lid" polycoef="0.1 2 0 0 0"/>
  <joint joint1="j3" joint2="j1" active="false"/></equality>"""
LIDS = """<body name="flange" pos="0.25 0 0"><site name="tool" pos="0 0 0.1"/>
  <body name="cover" pos="0 0.02 0.1"><joint name="lid" axis="0 1 0"/><geom size="0.02 0.2" pos="0.1 0 0"/></body>
  <body name="wing" pos="0 0.02 0.1"><joint name="flap" axis="1 1 0"/><geom size="0.02 0.2" pos="0.1 0 0"/></body>
  </body>"""


def test_a_locked_joint_is_held_where_it_is_and_what_is_not_active_does_not_count(robot):
    robot.write_text(MJCF.replace(FLANGE, LIDS).replace("</worldbody>", LOCK))
    read = read_arm(robot)
    assert "joints lid (hinge, at 0.5), flap (hinge, follows lid, at 1.1): are held; " in read.notes[0]
    spec = mujoco.MjSpec.from_string(WITHOUT_MESHES.replace(FLANGE, LIDS))
    data = mujoco.MjData(spec.compile())
    data.joint("lid").qpos, data.joint("flap").qpos = 0.5, 1.1
    mujoco.mj_kinematics(data.model, data)
    link = {body.name: np.asarray(body.com) for body in read.arm.joints[2].link}
    for name in ("cover", "wing"):
        expected, what = data.body(name).xipos - data.joint("j3").xanchor, "mass centre on a locked joint of an MJCF"
        agrees(link[name], expected, "formats", what, "MuJoCo", rtol=1e-7, atol=1e-12, unit="m")


def test_a_heavy_link_that_follows_the_arm_is_no_note(robot):
    tied = MJCF.replace(FLANGE, LIDS).replace("</worldbody>", LOCK).replace('joint1="lid"', 'joint1="lid" joint2="j2"')
    robot.write_text(tied.replace('pos="0.1 0 0"/>', 'pos="0.1 0 0" density="9e3"/>'))
    with pytest.raises(InputError, match=r"got .* of .* kg on what turns with another joint, expected a serial arm"):
        read_arm(robot)
    robot.write_text(tied.replace('pos="0.1 0 0"/>', 'pos="0.1 0 0" density="9"/>'))
    assert "follows j2" in read_arm(robot).notes[0]


def test_names_of_composed_models_are_changed_and_that_is_said_once(robot):
    """As dm_control writes them; the same arm, whose bushings are written where they belong."""
    plain = read_arm(robot).arm
    text = re.sub(r'(joint|body|joint1) name="(\w+)"', r'\1 name="my.arm/\2"', MJCF).replace(
        'joint="j1"', 'joint="my.arm/j1"'
    )
    robot.write_text(text.replace('site name="tool"', 'site name="the tool"'))
    beside = robot.with_suffix(".joints.toml")
    beside.write_text(
        re.sub(r'"(j[123])"', r'"my_arm_\1"', JOINTS).replace("[[joint]]", 'tip = "the tool"\n[[joint]]', 1)
    )
    read = read_arm(robot)
    (note,) = read.notes
    assert "my.arm/stand is called my_arm_stand here and 9 more names: letters, digits, _ and - only" in note
    assert [joint.name for joint in read.arm.joints] == ["my_arm_j1", "my_arm_j2", "my_arm_j3"]
    assert list(read.arm.numbers().values()) == list(plain.numbers().values())
    robot.write_text(
        "\n".join(line for line in robot.read_text().splitlines() if "nowhere" not in line).replace(
            ' material="grey"', ""
        )
    )
    model = mujoco.MjModel.from_xml_string(mjcf_with_bushings(str(robot), read.arm, read.arm, []).decode())
    assert [model.joint(n).name for n in range(4)] == [
        "my_arm_j1_tors",
        "my_arm_j1_bend_1",
        "my_arm_j1_bend_2",
        "my.arm/j1",
    ]
    robot.write_text(text.replace('body name="my.arm/a"', 'body name="my_arm_b"'))
    with pytest.raises(InputError, match=r"the name 'my.arm/b', which my_arm_b would stand for here as for another"):
        read_arm(robot)


def test_meshes_of_what_stands_still_or_has_no_mass_need_no_file(load):
    shapes = '<geom type="mesh" mesh="nowhere"/>', '<geom type="mesh" mesh="nowhere" mass="0"/>'
    stand = MJCF.replace('<inertial mass="99" pos="0 0 0" diaginertia="1 1 1"/>', shapes[0])
    stand = stand.replace('<body name="motor"', f'<body name="shown" pos="0 0 1">{shapes[1]}</body><body name="motor"')
    arm, plain = load(stand), load()
    assert list(arm.numbers().values()) == list(plain.numbers().values())


def test_a_body_with_the_name_of_a_joint_or_of_the_end_is_renamed(robot):
    plain = read_arm(robot)
    robot.write_text(MJCF.replace('body name="a"', 'body name="j1"').replace('body name="c"', 'body name="tip"'))
    read = read_arm(robot)
    assert [[body.name for body in joint.link] for joint in read.arm.joints] == [
        ["j1_body"],
        ["b", "motor"],
        ["tip_body"],
    ]
    values = [[float(each.arm.get(path)) for path in each.arm.paths()] for each in (read, plain)]
    assert values[0] == values[1]
    assert [note.partition(", body ")[2].partition(":")[0] for note in read.notes] == ["j1", "tip"]


@pytest.mark.parametrize("given", ['range="30 30"', 'range="0 0" limited="true"'])
def test_equal_limits_are_none_with_a_line_that_says_so(robot, given):
    robot.write_text(MJCF.replace('range="-60 120"', given))
    read = read_arm(robot)
    assert read.arm.joints[0].limits == (-np.inf, np.inf)
    numbers = given.partition('"')[2].partition('"')[0].replace(" ", ", ")
    assert read.notes == (f"{robot}, joint j1: range {numbers}, so that it turns freely here",)


PLACES = [match for match in re.finditer(r'(\w+)="(-?[\d.][\d. e-]*)"', MJCF) if match[1] in NUMBERS]


@pytest.mark.parametrize("bad", ["nan", "inf", "-inf", "1e300"])
@pytest.mark.parametrize("match", PLACES, ids=lambda match: match[0])
def test_a_number_that_is_not_finite_is_refused_wherever_it_stands(load, tmp_path, monkeypatch, capfd, match, bad):
    monkeypatch.chdir(tmp_path)
    words = [bad, *match[2].split()[1:]]
    with pytest.raises(InputError) as caught:
        load(MJCF[: match.start(2)] + " ".join(words) + MJCF[match.end(2) :])
    for problem in caught.value.problems:
        assert problem.expected == "finite numbers" or "MuJoCo can't read" in problem.got
        assert len(str(problem).splitlines()) == 1
    assert capfd.readouterr() == ("", "")
    assert not (tmp_path / "MUJOCO_LOG.TXT").exists()


def test_warnings_of_mujoco_reach_neither_terminal_nor_folder(load, tmp_path, monkeypatch, capfd, recwarn):
    """An armature of no meaning is a motor's, and passed over; MuJoCo warns of it."""
    monkeypatch.chdir(tmp_path)
    for armature in ("nan", "-inf"):
        assert len(load(MJCF.replace('armature="0.1"', f'armature="{armature}"')).joints) == 3
    assert capfd.readouterr() == ("", "")
    assert not recwarn.list
    assert sorted(path.name for path in tmp_path.iterdir()) == ["arm.xml"]


def test_all_bodies_without_mass_or_inertia_are_named_at_once(load):
    bare = re.sub(r"<inertial[^>]*>|<geom [^>]*mesh[^>]*>", "", MJCF)
    with pytest.raises(
        InputError, match="got no mass, or no inertia, on a, c, expected both on every moving body; give each"
    ):
        load(bare)  # the capsule of the motor is on b
    with pytest.raises(InputError, match="got no mass, or no inertia, on c, expected"):
        load(MJCF.replace('diaginertia="0.01 0.02 0.02"', 'diaginertia="0 0 0"'))


def test_an_included_file_is_looked_at_too(load, tmp_path):
    (tmp_path / "more.xml").write_text('<mujoco><worldbody><body name="x" pos="nan 0 0"/></worldbody></mujoco>')
    with pytest.raises(InputError, match='body x, body: got pos="nan 0 0", expected finite numbers'):
        load(MJCF.replace("<worldbody>", '<include file="more.xml"/><worldbody>', 1))


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
    with pytest.raises(InputError, match=r"pip install mujoco"):
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
