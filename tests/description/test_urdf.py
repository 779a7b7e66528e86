import builtins
import re

import jax
import jax.numpy as jnp
import numpy as np
import pinocchio as pin
import pytest
from conformance import agrees
from scipy.linalg import block_diag
from three_joints import JOINTS, URDF, WITH_HAND

from ident.arm.chain import at_posture
from ident.arm.mechanics import mass_matrix, straight_positions
from ident.description.file import read_arm, read_robot
from ident.description.urdf import read_urdf
from ident.errors import InputError

jax.config.update("jax_enable_x64", True)

STIFFNESS = {"j1": (1e5, 2e5), "j2": (3e5, 4e5), "j3": (5e5, 6e5)}


@pytest.fixture
def load(tmp_path):
    def read(text=URDF, **options):
        path = tmp_path / "arm.urdf"
        path.write_text(text)
        return read_urdf(path, **{"stiffness": STIFFNESS} | options)

    return read


@pytest.fixture
def poses(tmp_path):
    """Pose of every URDF frame in the base frame at zero posture, by yourdfpy's own forward kinematics."""
    import yourdfpy

    path = tmp_path / "oracle.urdf"
    path.write_text(URDF)
    robot = yourdfpy.URDF.load(str(path), load_meshes=False)
    return {link.name: robot.get_transform(link.name) for link in robot.robot.links}, robot


def in_base(arm):
    """Origin of every joint in the base frame at zero posture."""
    return np.cumsum([joint.offset for joint in arm.joints], axis=0)


def test_joints_stand_where_forward_kinematics_puts_them(load, poses):
    expected = [poses[0][link][:3, 3] for link in "abc"]
    what, source = "origins of joints in a URDF", "yourdfpy's forward kinematics"
    agrees(in_base(load()), expected, "formats", what, source, rtol=1e-7, atol=1e-12, unit="m")


def test_axes_point_where_forward_kinematics_turns_them(load, poses):
    axes = {"a": [0, 0, 1], "b": [0, 1, 0], "c": [1, 0, 0]}
    expected = [poses[0][link][:3, :3] @ axis for link, axis in axes.items()]
    found, source = [joint.axis for joint in load().joints], "yourdfpy's forward kinematics"
    agrees(found, expected, "formats", "axes of joints in a URDF", source, rtol=1e-7, atol=1e-12)


def test_bodies_have_their_mass_centres_and_inertias_in_the_base_frame(load, poses):
    arm, (frames, robot) = load(), poses
    inertials = {link.name: link.inertial for link in robot.robot.links if link.inertial}
    for joint, origin in zip(arm.joints, in_base(arm), strict=True):
        for body in joint.link:
            inertial = inertials[body.name]
            pose = frames[body.name] @ (np.eye(4) if inertial.origin is None else inertial.origin)
            inertia = pose[:3, :3] @ inertial.inertia @ pose[:3, :3].T
            source = "yourdfpy's forward kinematics"
            what, unit = "mass centres in a URDF", "m"
            agrees(body.com + origin, pose[:3, 3], "formats", what, source, rtol=1e-7, atol=1e-12, unit=unit)
            what, unit = "inertias in a URDF", "kg m^2"
            agrees(body.inertia, inertia, "formats", what, source, rtol=1e-7, atol=1e-12, unit=unit)


def first_frame_by_hand():
    pose = np.eye(4)
    for xyz, rpy in (((0.1, 0, 0.3), (0, 0, 0.4)), ((0, 0.05, 0.2), (0.1, -0.2, 0.3))):
        (cr, cp, cy), (sr, sp, sy) = np.cos(rpy), np.sin(rpy)
        about_x = [[1, 0, 0], [0, cr, -sr], [0, sr, cr]]
        about_y = [[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]]
        about_z = [[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]]
        step = np.eye(4)
        step[:3, :3], step[:3, 3] = np.array(about_z) @ about_y @ about_x, xyz
        pose = pose @ step
    return pose


def test_second_joint_stands_where_rpy_by_hand_puts_it(load):
    pose = first_frame_by_hand()
    expected, what = (pose @ [0.6, 0, 0.1, 1])[:3], "roll, pitch and yaw in a URDF"
    agrees(in_base(load())[1], expected, "formats", what, "by hand", rtol=1e-7, atol=1e-12, unit="m")


def test_fixed_links_move_with_the_link_before_and_the_base_is_left_out(load):
    arm = load()
    assert [[body.name for body in joint.link] for joint in arm.joints] == [["a"], ["b", "motor"], ["c"]]
    assert all(joint.shaft == () and joint.driven for joint in arm.joints)
    assert sum(float(body.mass) for joint in arm.joints for body in joint.link) == pytest.approx(15.5)


def test_stiffness_damping_and_limits_belong_to_their_joint(load):
    arm = load(damping=(0.1, 0.2))
    assert [(joint.k_bend, joint.k_tors) for joint in arm.joints] == list(STIFFNESS.values())
    assert all((joint.tau_bend, joint.tau_tors) == (0.1, 0.2) for joint in arm.joints)
    assert [joint.limits for joint in arm.joints] == [(-1, 2), (-np.inf, np.inf), (-1, 1)]
    assert load(stiffness=(1.0, 2.0)).joints[2].k_tors == 2.0


def test_tip_is_the_end_of_the_chain_or_the_named_link(load, poses):
    arm, (frames, _) = load(), poses
    assert arm.points[-1].joint == "j3"
    np.testing.assert_allclose(in_base(arm)[2] + arm.points[-1].position, frames["tool0"][:3, 3], atol=1e-12)
    np.testing.assert_allclose(load(tip="c").points[-1].position, np.zeros(3), atol=1e-12)
    assert load(tip="motor").points[-1].joint == "j2"


BRANCH = '<joint name="j4" type="revolute"><parent link="b"/><child link="d"/></joint><link name="d"/></robot>'
LOOSE = '<link name="d"/></robot>'

# Each row: what is replaced, by what, and words that the message must contain.
BAD = [
    (
        'type="continuous"',
        'type="prismatic"',
        ("arm.urdf, joint j2", "type prismatic", "revolute, continuous or fixed"),
    ),
    ('type="continuous"', 'type="floating"', ("joint j2", "type floating")),
    ('<axis xyz="0 1 0"/>', '<mimic joint="j1"/>', ("joint j2", "a mimic of j1")),
    ("</robot>", BRANCH, ("a branch into", "j3", "j4", "a serial arm")),
    ("</robot>", LOOSE, ("root links: base, d", "one tree with one root")),
    ('<child link="c"/>', '<child link="cc"/>', ("joint j3", "unknown link cc")),
    ('<child link="c"/>', '<child link="b"/>', ("joint j3", "which another joint carries too")),
    (
        '<child link="tool0"/>',
        '<child link="base"/>',
        ("links that do not hang on tool0: a, b, base", "one tree"),
    ),
    ('<axis xyz="0 1 0"/>', '<axis xyz="0 0 0"/>', ("joint j2", "a direction")),
    ('<axis xyz="0 1 0"/>', '<axis xyz="0 1"/>', ("joint j2", "a direction")),
    ('<axis xyz="0 1 0"/>', '<axis xyz="0 1e300 0"/>', ("joint j2, axis", "finite numbers")),
    ('lower="-1" upper="2"', 'lower="3" upper="2"', ("joint j1", "limits 3, 2")),
    ('<mass value="5"/>', '<mass value="-5"/>', ("link b", "mass -5.0", ">= 0")),
    ('<mass value="5"/>', '<mass value="nan"/>', ("link b, mass", "finite numbers")),
    ('<mass value="5"/>', "", ("link b", "not complete")),
    ('<mass value="5"/>', '<mass value="heavy"/>', ("yourdfpy cannot read", "heavy")),
    ('ixx="0.2" iyy="0.1"', 'ixx="0.9" iyy="0.1"', ("link b", "sum of the other two")),
    ('xyz="0 0.2 0.1"', 'xyz="0 inf 0.1"', ("link b, origin", "finite numbers")),
    ('xyz="0.6 0 0.1"', 'xyz="nan 0 0.1"', ("joint j2, origin", "finite numbers")),
    ('<link name="tool0"/>', "<link/>", ("yourdfpy cannot read",)),
    ('<link name="tool0"/>', '<link name="tool0">', ("arm.urdf:31, column 3", "XML")),
    ('<link name="tool0"/>', '<link name="tool0"/><link name="c"/>', ("two links c", "unique names")),
    ('<link name="tool0"/>', '<link name="a/b"/><link name="a.b"/>', ("the name 'a/b'", "rename one of them")),
    (
        '<mass value="1.5"/>',
        '<mass value="0"/>',
        ("joint j3", "no mass beyond the bushing", "give link c an <inertial>"),
    ),
    ('lower="-1" upper="2"', 'lower="-1" upper="nan"', ("joint j1, limit", "upper='nan'", "finite numbers")),
    ('effort="1" velocity="1"', 'effort="nan" velocity="1"', ("joint j1, limit", "effort='nan'")),
    ('ixx="0.2" iyy="0.1"', 'ixx="0.2" iyy="inf"', ("link b, inertia", "iyy='inf'")),
    ('<link name="tool0"/>', "<link name=''/>", ("a link without a name", "name it")),
]


@pytest.mark.parametrize(("old", "new", "words"), BAD)
def test_a_urdf_that_is_no_serial_arm_is_refused(load, old, new, words):
    assert old in URDF
    with pytest.raises(InputError) as caught:
        load(URDF.replace(old, new, 1))
    for word in words:
        assert word in str(caught.value)


def by_pinocchio(text, joints, end, postures):
    """End point, axes of the joints and their mass matrix at postures in which all other joints are held at zero."""
    model = pin.buildModelFromXML(text)
    data, ids = model.createData(), [model.getJointId(name) for name in joints]
    for posture in postures:
        q = pin.neutral(model)
        for joint, angle in zip(ids, posture, strict=True):
            turn = [np.cos(angle), np.sin(angle)] if model.joints[joint].nq == 2 else [angle]
            q[model.joints[joint].idx_q : model.joints[joint].idx_q + len(turn)] = turn
        M = pin.crba(model, data, q)
        M = np.triu(M) + np.triu(M, 1).T
        pin.framesForwardKinematics(model, data, q)
        pin.computeJointJacobians(model, data, q)
        places = [model.joints[joint].idx_v for joint in ids]
        axes = [
            pin.getJointJacobian(model, data, joint, pin.LOCAL_WORLD_ALIGNED)[3:, place]
            for joint, place in zip(ids, places, strict=True)
        ]
        yield data.oMf[model.getFrameId(end)].translation.copy(), axes, M[np.ix_(places, places)]


@pytest.mark.parametrize(
    ("text", "tip", "end"),
    [
        (WITH_HAND, None, "hand"),
        (WITH_HAND, "hand", "hand"),
        (WITH_HAND, "tool0", "tool0"),
        (WITH_HAND.replace('type="prismatic"', 'type="continuous"'), None, "hand"),
        (WITH_HAND.replace('type="floating"', 'type="continuous"'), "tool0", "tool0"),
    ],
    ids=["sliding fingers", "named hand", "named flange", "turning fingers", "turning side branch"],
)
def test_what_is_not_on_the_way_to_the_tip_is_held_with_its_mass(load, text, tip, end):
    postures = np.random.default_rng(1).uniform(-2, 2, (20, 3))
    arm = load(text, tip=tip)
    assert [joint.name for joint in arm.joints] == ["j1", "j2", "j3"]
    chain = at_posture(arm, jnp.asarray(postures.T))
    points, mass = straight_positions(chain), mass_matrix(chain, jnp.zeros((3, 3, 20)))
    for n, (place, axes, M) in enumerate(by_pinocchio(text, ["j1", "j2", "j3"], end, postures)):
        turned, source = block_diag(*axes), "Pinocchio's reader"
        what = "end point of a URDF with hand and fingers"
        agrees(points[:, -1, n], place, "formats", what, source, rtol=1e-7, atol=1e-12, unit="m")
        found, what = turned @ mass[..., n] @ turned.T, "mass matrix of a URDF with hand and fingers"
        agrees(found, M, "formats", what, source, rtol=1e-7, atol=1e-12)


def test_what_is_held_is_said_with_its_mass(tmp_path):
    path = tmp_path / "arm.urdf"
    path.write_text(WITH_HAND)
    notes = [note.removeprefix(f"{path}, ") for note in read_robot(path).notes]
    assert notes == [
        "joint table (planar): is held at zero; what is on it is left out",
        "joint cable (floating): is held at zero; 0.4 kg on it move with j2",
        "joints slide_l (prismatic), slide_r (prismatic, follows slide_l): are held at zero; "
        "0.25 kg on them move with j3",
    ]
    path.with_suffix(".joints.toml").write_text(JOINTS)
    assert read_arm(path).notes == read_robot(path).notes
    path.write_text(URDF)
    assert read_arm(path).notes == ()


def test_of_two_arms_one_is_named_or_none_is_read(tmp_path):
    """The second arm hangs on the base, and has a joint for each of the first."""
    body, _, end = URDF.partition('<joint name="j1"')
    second = end.replace('name="', 'name="r_').replace('link="', 'link="r_').replace('link="r_stand"', 'link="stand"')
    path = tmp_path / "arm.urdf"
    path.write_text(f'{body}<joint name="j1"{end.replace("</robot>", "")}<joint name="r_j1"{second}')
    with pytest.raises(
        InputError, match=r"a branch into j1, r_j1, expected a serial arm; name .* \(c, r_c\): tip = "
    ) as caught:
        read_robot(path)
    assert "--tip" in str(caught.value)
    path.with_suffix(".joints.toml").write_text(JOINTS.replace("[[joint]]", 'tip = "tool0"\n[[joint]]', 1))
    assert [joint.name for joint in read_arm(path).arm.joints] == ["j1", "j2", "j3"]
    assert read_robot(path, "r_b").joints == ["r_j1", "r_j2"]
    assert read_robot(path, "r_tool0").joints == ["r_j1", "r_j2", "r_j3"]


DRIVE = """<joint name="drive" type="revolute"><parent link="tool0"/><child link="knuckle"/><axis xyz="0 1 0"/>
  <limit lower="0" upper="1" effort="1" velocity="1"/></joint><link name="knuckle"/>
  <joint name="second" type="revolute"><parent link="tool0"/><child link="other"/><mimic joint="drive"/></joint>
  <link name="other"/></robot>"""


def test_a_gripper_whose_joints_follow_one_drive_is_no_further_joint_of_the_arm(load):
    assert [joint.name for joint in load(URDF.replace("</robot>", DRIVE)).joints] == ["j1", "j2", "j3"]


HEAVY = """<joint name="lever" type="revolute"><parent link="c"/><child link="end"/><mimic joint="j2" offset="0.5"/>
  <origin xyz="0 0 0.1"/><axis xyz="0 2 0"/></joint><link name="end"><inertial><origin xyz="0.3 0 0"/>
  <mass value="5"/><inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link></robot>"""


def test_a_joint_that_follows_the_arm_is_held_at_its_offset_or_refused_where_it_is_heavy(load, tmp_path):
    with pytest.raises(InputError, match=r"lever .*: got 5 of 20.5 kg on what turns with another joint"):
        load(URDF.replace("</robot>", HEAVY))
    light = HEAVY.replace('value="5"', 'value="0.05"')
    end, at_zero = (
        load(URDF.replace("</robot>", text)).joints[2].link[-1].com for text in (light, light.replace("0.5", "0"))
    )
    hinge = np.asarray(load(URDF.replace("</robot>", light.replace("0.3 0 0", "0 0 0"))).joints[2].link[-1].com)
    one, other = (np.asarray(com) - hinge for com in (end, at_zero))
    assert np.linalg.norm(one) == pytest.approx(0.3)
    assert one @ other == pytest.approx(0.09 * np.cos(0.5))
    load(URDF.replace("</robot>", light))
    assert "joint lever (revolute, follows j2, at 0.5): is held; 0.05 kg" in read_robot(tmp_path / "arm.urdf").notes[0]


def test_names_with_slashes_are_changed_and_that_is_said_once(load, tmp_path):
    slashed = re.sub(r'(name|link)="(?!three)', r'\1="my.arm/', URDF)
    arm = load(slashed, stiffness=(1e5, 2e5), tip="my.arm/tool0")
    assert list(arm.numbers().values()) == list(load(stiffness=(1e5, 2e5), tip="tool0").numbers().values())
    load(slashed, stiffness=(1e5, 2e5))
    (note,) = read_robot(tmp_path / "arm.urdf").notes
    assert "my.arm/base is called my_arm_base here and " in note


def test_a_link_with_the_name_of_a_joint_or_of_the_end_is_renamed(load, tmp_path):
    text = URDF.replace('name="a"', 'name="j2"').replace('link="a"', 'link="j2"')
    text = text.replace('name="c"', 'name="tip"').replace('link="c"', 'link="tip"')
    plain, arm = load(), load(text)
    assert [[body.name for body in joint.link] for joint in arm.joints] == [["j2_link"], ["b", "motor"], ["tip_link"]]
    assert [float(arm.get(path)) for path in arm.paths()] == [float(plain.get(path)) for path in plain.paths()]
    notes = read_robot(tmp_path / "arm.urdf").notes
    assert [note.partition(", link ")[2] for note in notes] == [
        "j2: called j2_link here, as a joint has that name",
        "tip: called tip_link here, as the end point has that name",
    ]


@pytest.mark.parametrize(
    ("limit", "words"),
    [
        ('<limit lower="0" upper="0" effort="1" velocity="1"/>', "limits 0, 0"),
        ('<limit lower="1.5" upper="1.5" effort="1" velocity="1"/>', "limits 1.5, 1.5"),
        ('<limit effort="1" velocity="1"/>', "no limits"),
        ("", "no limits"),
    ],
)
def test_equal_limits_are_none_with_a_line_that_says_so(load, tmp_path, limit, words):
    given = '<limit lower="-1" upper="2" effort="1" velocity="1"/>'
    assert given in URDF
    assert load(URDF.replace(given, limit)).joints[0].limits == (-np.inf, np.inf)
    path = tmp_path / "arm.urdf"
    assert read_robot(path).notes == (f"{path}, joint j1: {words}, so that it turns freely here",)


def test_limits_beyond_all_angles_are_none(load):
    arm = load(URDF.replace('lower="-1" upper="2"', 'lower="-1e16" upper="1e16"'))
    assert arm.joints[0].limits == (-np.inf, np.inf)


def without_inertials(text):
    return re.sub(r"<inertial>.*?</inertial>", "", text, flags=re.DOTALL)


def test_all_links_without_mass_are_named_at_once(load):
    with pytest.raises(InputError) as caught:
        load(without_inertials(URDF))
    (problem,) = caught.value.problems
    assert problem.where.endswith("arm.urdf, joints j1, j2, j3")
    assert problem.got == "no mass on the bushings"
    assert problem.remedy == "give link a, link b, link c an <inertial> with <mass> and <inertia>"


def test_all_incomplete_inertials_are_named_at_once(load):
    with pytest.raises(InputError) as caught:
        load(re.sub(r"<mass[^>]*>", "", URDF))
    assert [problem.where.rpartition(", ")[2] for problem in caught.value.problems] == [
        "link a",
        "link b",
        "link motor",
        "link c",
    ]


def test_an_inertia_of_zero_is_told_as_such(load):
    text = re.sub(r'<origin xyz="0.1 0 0" rpy="0 0 1"/><mass', "<mass", URDF)
    with pytest.raises(InputError) as caught:
        load(text.replace('ixx="0.01" iyy="0.02" izz="0.02"', 'ixx="0" iyy="0" izz="0"'))
    (problem,) = caught.value.problems
    assert problem.got == "a rotation that moves no mass"
    assert problem.remedy == "give c an inertia that is not zero about any axis"


@pytest.mark.parametrize(
    "text",
    [
        '<robot xmlns:xacro="http://www.ros.org/wiki/xacro" name="r"><xacro:include filename="x"/></robot>',
        '<robot name="r"><xacro:arm/></robot>',
        URDF.replace('value="5"', 'value="${mass}"'),
        URDF.replace("package://nowhere", "$(find nowhere)"),
    ],
)
@pytest.mark.parametrize("name", ["arm.urdf.xacro", "arm.xacro", "robot.urdf"])
def test_macros_are_to_be_expanded(tmp_path, text, name):
    (tmp_path / name).write_text(text)
    made = {"robot.urdf": "expanded.urdf"}.get(name, "arm.urdf")
    for read in (read_arm, lambda path: read_urdf(path, stiffness=(1, 1))):
        with pytest.raises(InputError) as caught:
            read(tmp_path / name)
        (problem,) = caught.value.problems
        assert (problem.got, problem.remedy) == ("a xacro file", f"expand it: xacro {tmp_path / name} > {made}")


def test_an_expanded_file_may_keep_the_name_space_and_infinite_efforts(load):
    text = URDF.replace("<robot ", '<robot xmlns:xacro="http://www.ros.org/wiki/xacro" ').replace(
        'effort="1"', 'effort="inf"'
    )
    assert len(load(text).joints) == 3


def test_another_format_is_refused(load):
    with pytest.raises(InputError, match=r"arm\.urdf:1: got <sdf>, expected <robot>"):
        load("<sdf/>")


def test_a_robot_of_too_many_joints_is_refused(load):
    joint = (
        '<joint name="s{n}" type="revolute"><parent link="{before}"/><child link="t{n}"/></joint><link name="t{n}"/>'
    )
    more = "".join(joint.format(n=n, before=f"t{n - 1}" if n else "tool0") for n in range(300))
    with pytest.raises(InputError, match=r"urdf: got 30\d joints, expected at most 24"):
        load(URDF.replace("</robot>", f"{more}</robot>"))


def test_a_robot_without_moving_joints_is_refused(load):
    with pytest.raises(InputError, match="no moving joint"):
        load('<robot name="r"><link name="a"/></robot>')


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"stiffness": {"j1": (1, 1), "j2": (1, 1)}}, "joint j3: got no stiffness"),
        ({"stiffness": STIFFNESS | {"J3": (1, 1)}}, "stiffness of J3: got no such joint"),
        ({"stiffness": STIFFNESS | {"j3": (1, 0)}}, "joint j3: got stiffness"),
        ({"stiffness": (1, float("nan"))}, "two numbers > 0"),
        ({"stiffness": (1, 2, 3)}, "two numbers > 0"),
        ({"damping": (0, -1)}, "two numbers >= 0"),
        ({"tip": "tool1"}, "did you mean tool0"),
        ({"tip": "base"}, "a moving link"),
    ],
)
def test_values_that_do_not_fit_the_robot_are_refused(load, options, words):
    with pytest.raises(InputError, match=words):
        load(**options)


def test_every_missing_stiffness_is_named(load):
    with pytest.raises(InputError) as caught:
        load(stiffness={})
    assert [problem.where for problem in caught.value.problems] == ["joint j1", "joint j2", "joint j3"]


def test_without_yourdfpy_the_remedy_is_named(load, monkeypatch):
    original = builtins.__import__

    def without(name, *args, **kwargs):
        if name == "yourdfpy":
            raise ImportError(name)
        return original(name, *args, **kwargs)

    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(InputError, match=r"pip install yourdfpy"):
        load()


def test_an_absent_file_is_refused(tmp_path):
    with pytest.raises(InputError, match="no such file"):
        read_urdf(tmp_path / "none.urdf", stiffness=(1, 1))
