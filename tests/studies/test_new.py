"""`ident new`: each template is read, sound and fitted, and the fit finds the stiffnesses that its campaign states."""

import re
import tomllib
from fnmatch import fnmatch

import jax
import numpy as np
import pytest
from arms import DATA, random_arm
from reports import assert_one_screen
from templates import TEMPLATES, made
from three_joints import URDF

import ident
from ident.description.file import parse_arm, read_arm
from ident.description.rewriting import arm_text
from ident.studies.look.new import KINDS, new, new_from_robot

jax.config.update("jax_enable_x64", True)

ROOT = DATA.parent
STATED = re.compile(r"^#.*? ((?:\w+\.k_\w+ = \S+(?:, )?)+)$", re.MULTILINE)
SUPPORTED = {"scara": 4, "six-axis": 7}
"""How many stiffnesses the data support, at least."""
OPTIONS = {"scara": ident.FitOptions(), "six-axis": ident.FitOptions(starts=4, no_explain=True)}
"""Of their fits: the defaults of one of them."""


def stated(campaign):
    """The stiffnesses that a campaign's comments state."""
    lines = STATED.findall(campaign.read_text())
    pairs = [each.split(" = ") for line in lines for each in line.split(", ") if each]
    return {path: float(value) for path, value in pairs}


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_a_template_is_sound_and_its_fit_finds_what_its_campaign_states(kind, tmp_path):
    arm_path, campaign_path = new(kind, tmp_path / "robot").paths
    assert ident.show(arm_path).oddities == ()
    assert set(read_arm(arm_path).origins.values()) == {"assumed", "derived"}
    truth = stated(campaign_path)
    arm = read_arm(arm_path).arm
    assert set(truth) == {path for path in arm.paths() if ".k_" in path}
    assert all(abs(np.log(value / float(arm.get(path)))) > 0.05 for path, value in truth.items())
    result = ident.fit(arm_path, campaign_path, OPTIONS[kind])
    assert not result.short
    assert not result.doubtful
    inside = {path: low <= truth[path] <= high for path, (low, high) in result.intervals.items()}
    assert len(inside) == len(truth)
    assert all(inside.values()), inside
    assert sum(result.supported.values()) >= SUPPORTED[kind]
    assert_one_screen(result.report(), files=2, extra=max(0, len(truth) - 8))


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_the_campaigns_are_those_of_their_arms(kind):
    example, text = made(TEMPLATES / f"{kind}.toml")
    assert text == (TEMPLATES / f"{kind}.csv").read_text()
    assert stated(TEMPLATES / f"{kind}.csv") == dict(example.truth)


def urdf_of(arm):
    """An arm of one body a joint as URDF, its frames turned as those of its joints: not at all."""
    links = "".join(
        f"""<link name="{joint.link[0].name}"><inertial><origin xyz="{vector(joint.link[0].com)}"/>
        <mass value="{float(joint.link[0].mass)!r}"/>
        <inertia {inertia(np.asarray(joint.link[0].inertia))}/></inertial></link>"""
        for joint in arm.joints
    )
    parents = ["pedestal", *(joint.link[0].name for joint in arm.joints)]
    joints = "".join(
        f"""<joint name="{joint.name}" type="revolute"><parent link="{parent}"/><child link="{joint.link[0].name}"/>
        <origin xyz="{vector(joint.offset)}"/><axis xyz="{vector(joint.axis)}"/>
        <limit lower="{joint.limits[0]!r}" upper="{joint.limits[1]!r}" effort="1" velocity="1"/></joint>"""
        for joint, parent in zip(arm.joints, parents, strict=False)
    )
    tool = f'<link name="tool"/><joint name="mount" type="fixed"><parent link="{parents[-1]}"/><child link="tool"/>'
    tool += f'<origin xyz="{vector(arm.points[0].position)}"/></joint>'
    return f'<robot name="copy"><link name="pedestal"/>{links}{joints}{tool}</robot>'


def vector(value):
    return " ".join(repr(float(x)) for x in np.asarray(value))


def inertia(tensor):
    places = {"xx": (0, 0), "yy": (1, 1), "zz": (2, 2), "xy": (0, 1), "xz": (0, 2), "yz": (1, 2)}
    return " ".join(f'i{name}="{float(tensor[place])!r}"' for name, place in places.items())


@pytest.mark.slow
def test_a_six_axis_urdf_becomes_the_same_arm_and_its_campaign_is_that_of_its_file(tmp_path):
    arm = read_arm(TEMPLATES / "six-axis.toml").arm
    urdf = tmp_path / "robot.urdf"
    urdf.write_text(urdf_of(arm))
    arm_path, campaign_path = new_from_robot(urdf, tmp_path / "robot").paths
    again = read_arm(arm_path)
    guessed = [path for path in again.arm.paths() if re.search(r"\.(k|tau|loss)_", path)]
    for path in set(again.arm.paths()) - set(guessed):
        original = path.replace("tip.", "tool.")
        assert float(again.arm.get(path)) == pytest.approx(float(arm.get(original)), rel=1e-11, abs=1e-11), path
        assert again.origins[path] == "derived"
    assert {again.origins[path] for path in guessed} == {"assumed"}
    limits = [[joint.limits for joint in each.joints] for each in (again.arm, arm)]
    np.testing.assert_allclose(*limits, rtol=1e-9)
    assert ident.show(arm_path).oddities == ()
    example, text = made(arm_path)
    assert text == campaign_path.read_text()
    assert stated(campaign_path) == dict(example.truth)
    assert set(example.truth) == {path for path in guessed if ".k_" in path}


def test_what_is_written_is_read_back_as_the_same_arm():
    arm = random_arm(np.random.default_rng(2), 4, undriven=(2,))
    again = parse_arm(arm_text(arm, origin="derived", note='a "quoted" note', head="two\nlines"))
    for path in again.paths():
        assert float(again.get(path)) == pytest.approx(float(arm.get(path)), rel=1e-11), path
    assert [joint.driven for joint in again.joints] == [joint.driven for joint in arm.joints]
    for one, other in zip(again.joints, arm.joints, strict=True):
        np.testing.assert_allclose(one.axis, other.axis, rtol=1e-11)
        for body, original in zip((*one.shaft, *one.link), (*other.shaft, *other.link), strict=True):
            np.testing.assert_allclose(body.inertia, original.inertia, rtol=1e-11)


def test_a_wheel_has_the_templates():
    setup = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["setuptools"]
    patterns = setup["package-data"]["ident"]
    written = [path.relative_to(ROOT / "ident").as_posix() for path in TEMPLATES.iterdir()]
    assert {f"description/templates/{kind}{end}" for kind in KINDS for end in (".toml", ".csv")} == set(written)
    assert all(any(fnmatch(name, pattern) for pattern in patterns) for name in written)


@pytest.mark.slow  # a campaign is simulated on another arm
def test_a_robot_with_a_jaw_and_inertias_that_nobody_filled_in_is_told_so(tmp_path):
    text = re.sub(r"<inertia [^>]*>", '<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/>', URDF)
    (tmp_path / "robot.urdf").write_text(text.replace('"j3"', '"gripper_jaw"'))
    *_, odd, jaw = new_from_robot(tmp_path / "robot.urdf", tmp_path / "new").notes
    assert odd.startswith("robot.urdf: ")
    assert "inertia" in odd
    assert "joint gripper_jaw: counts as a driven joint of the arm; if it is a gripper's" in jaw
    assert jaw.endswith("--tip b")
