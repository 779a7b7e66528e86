"""What was identified, written back and read again."""

import json
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
from one_program import shown
from results import RESULTS
from three_joints import JOINTS, URDF, WITHOUT_MESHES

import ident
from ident.arm.arm import stiffness_paths
from ident.errors import InputError
from ident.measure import Load
from ident.measure.campaign import Measurement
from ident.measure.reading import campaign_text

pytestmark = pytest.mark.slow
OPTIONS = ident.FitOptions(starts=1, no_explain=True)
MORE = replace(
    OPTIONS, free={"a.mass": 0.1}, uncertain={"b.mass": "5%", "load": "1%"}, soft_base=0.25, fix=("base.k_tors",)
)


POSTURES = ((0.1, 0.2, 0.3), (1.0, -0.8, 0.5), (-0.7, 1.2, -0.9), (0.4, -1.9, 0.8))


def robot_in(folder, suffix, text, joints):
    path = folder / f"arm{suffix}"
    path.write_text(text)
    path.with_suffix(".joints.toml").write_text(joints)
    return path


def fitted(path, postures, options):
    """A fit to where a load takes the arm, joints a fifth stiffer, a body 3 % lighter, and its file."""
    load, arm, campaign = Load.parse("10 kg @ elbow"), ident.read_arm(path).arm, path.parent / "campaign.csv"
    rows = [
        Measurement(kind="deflection", posture=posture, value=1e-3, sigma=1e-6, point=point, load=load)
        for posture in postures
        for point in ("elbow", arm.points[-1].name)
    ]
    rows += [
        Measurement(kind="twist", posture=posture, value=1e-3, sigma=1e-6, joint="j2", load=load)
        for posture in postures
    ]
    truth = {name: 1.2 * float(arm.get(name)) for name in stiffness_paths(arm)} | {"b.mass": 0.97 * arm.get("b.mass")}
    values = shown(arm, ident.Campaign(measurements=tuple(rows)), truth).tolist()
    rows = tuple(replace(row, value=value, sigma=0.001 * abs(value)) for row, value in zip(rows, values, strict=True))
    campaign.write_text(campaign_text(ident.Campaign(measurements=rows)))
    result = ident.fit(path, campaign, options)
    (saved,) = result.save(path.parent)
    return result, saved


@pytest.fixture(scope="module")
def urdf(tmp_path_factory):
    path = robot_in(tmp_path_factory.mktemp("urdf"), ".urdf", URDF, f"# bushings\n{JOINTS}")
    return path, *fitted(path, POSTURES[:1], OPTIONS)


@pytest.fixture(scope="module")
def mjcf(tmp_path_factory):
    """A fit of a mass, of one that is uncertain, of a load's scale and of a base that gives."""
    path = robot_in(tmp_path_factory.mktemp("mjcf"), ".xml", WITHOUT_MESHES, JOINTS)
    return path, *fitted(path, POSTURES, MORE)


@pytest.mark.parametrize("name", ["fitted.xml", "fitted.toml"])
def test_masses_and_a_base_that_gives_are_read_again_as_fitted(mjcf, tmp_path, name):
    path, result, saved = mjcf
    again, arm, before = (
        ident.read_arm(ident.export(saved, tmp_path / name)[0]),
        result.fitted_arm,
        ident.read_arm(path),
    )
    assert again.arm.numbers().keys() == arm.numbers().keys()
    for number, value in arm.numbers().items():
        assert float(again.arm.get(number)) == pytest.approx(float(value), rel=1e-11, abs=1e-12)
    pairs = zip(again.arm.joints, arm.joints, strict=True)
    for one, other in ((one, other) for j, k in pairs for one, other in zip(j.link, k.link, strict=True)):
        np.testing.assert_allclose(one.inertia, other.inertia, rtol=1e-9, atol=1e-12)
    masses = [float(each.get("b.mass")) for each in (again.arm, before.arm)]
    inertias = [float(each.get("b.inertia.xx")) for each in (again.arm, before.arm)]
    assert inertias[0] / inertias[1] == pytest.approx(masses[0] / masses[1], rel=1e-9)
    assert abs(masses[0] / masses[1] - 1) > 1e-4
    assert [joint.driven for joint in again.arm.joints] == [False, True, True, True]
    assert [again.origins[f"base.{k}"] for k in ("k_bend", "k_tors")] == ["calibrated", "assumed"]


def test_without_a_path_it_goes_to_out_under_the_name_of_the_description(mjcf, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    path, _, saved = mjcf
    assert ident.export(saved)[0] == Path("out") / f"{path.stem}.fitted{path.suffix}"


def test_the_comment_and_json_say_what_else_was_fitted(mjcf, tmp_path):
    _, result, saved = mjcf
    text = ident.export(saved, tmp_path / "fitted.xml", posture=(10, 20, 30))[0].read_text()
    assert f"a.mass = {result.parameters['a.mass']:.6g} kg, 95 % interval" in text
    assert "base: a base that gives about a point 0.25 m below j1\n" in text
    assert "springs: tangent to the bushings under the arm's own weight at 10, 20, 30 deg\n" in text
    document = json.loads(ident.export(saved, tmp_path / "fitted.json")[0].read_text())
    assert {"a.mass", "b.mass", "load", "base.k_bend"} <= {row["path"] for row in document["numbers"]}
    assert document["changed"]["j1.offset.z"] == 0.25
    assert document["changed"]["b.inertia.xx"] == pytest.approx(float(result.fitted_arm.get("b.inertia.xx")), rel=1e-12)


def test_what_a_format_has_no_place_for_is_one_line(urdf, mjcf, tmp_path):
    based = replace(urdf[1], options=replace(OPTIONS, soft_base=0.25))
    calls = {
        r"fitted\.urdf: got base.* besides, .*; write \.toml or \.json": (based, "fitted.urdf", None),
        "posture: got a posture for a file without springs": (mjcf[1], "fitted.json", (1, 2, 3)),
        r"posture: got \(1, 2\), expected 3 angles": (mjcf[1], "fitted.xml", (1, 2)),
    }
    for words, (result, name, posture) in calls.items():
        with pytest.raises(InputError, match=words) as caught:
            ident.export(result, tmp_path / name, posture=posture)
        assert "\n" not in str(caught.value)
    assert not list(tmp_path.iterdir())


def test_mjcf_gets_the_fitted_stiffnesses(mjcf, tmp_path):
    _, result, saved = mjcf
    written, _ = ident.export(saved, tmp_path / "fitted.xml")
    model = mujoco.MjModel.from_xml_path(str(written))
    stiffnesses = {path: value for path, value in result.parameters.items() if ".k_" in path}
    assert len(stiffnesses) == 7, "of three joints and the base"
    for path, value in stiffnesses.items():
        name, field = path.split(".")
        hinge = f"{name}_tors" if field == "k_tors" else f"{name}_bend_1"
        assert model.joint(hinge).stiffness == pytest.approx(value, rel=1e-12)
    head = written.read_text().partition("-->")[0]
    for path, value in stiffnesses.items():
        low, high = result.intervals[path]
        end = "\n" if result.supported[path] else ", which the data do not support\n"
        assert f"{path} = {value:.6g} N m/rad, 95 % interval {low:.4g} to {high:.4g}{end}" in head
    assert any(result.supported[path] for path in stiffnesses)
    assert f"arm.xml, SHA-256 {result.arm.sha256}" in head
    assert f"arm.joints.toml, SHA-256 {result.arm.bushings.sha256}" in head


def test_what_has_bushings_gets_no_others(mjcf, tmp_path):
    _, result, saved = mjcf
    written, _ = ident.export(saved, tmp_path / "fitted.xml")
    with pytest.raises(InputError, match=r"fitted\.xml: got the hinge base_tors, expected a robot without bushings"):
        ident.export(result, tmp_path / "twice.xml", arm=written)


def test_urdf_gets_a_comment_and_is_read_again_with_the_fitted_numbers(urdf, tmp_path):
    path, result, saved = urdf
    out = tmp_path / "fitted.urdf"
    assert ident.export(saved, out) == (out, tmp_path / "fitted.joints.toml")
    text = out.read_text()
    start = text.index("<!--\n")
    assert text[:start] + text[text.index("-->\n", start) + 4 :] == path.read_text()
    again = ident.read_arm(out)
    for name, value in result.parameters.items():
        assert float(again.arm.get(name)) == pytest.approx(value, rel=1e-11)
        assert again.origins[name] == "calibrated"
    joints = (tmp_path / "fitted.joints.toml").read_text()
    assert joints.startswith("# bushings\n")
    assert 'unit = "N*m/deg"' in joints


def test_json_has_every_number_with_its_interval(mjcf, tmp_path):
    _, result, _ = mjcf
    (written,) = ident.export(result, tmp_path / "fitted.json")
    document = json.loads(written.read_text())
    assert [row["path"] for row in document["numbers"]] == list(result.parameters)
    for row in document["numbers"]:
        assert row["value"] == result.parameters[row["path"]]
        assert (row["low_95"], row["high_95"]) == result.intervals[row["path"]]
        assert row["supported"] == result.supported[row["path"]]
        assert row["unit"] == ("N m/rad" if ".k_" in row["path"] else "kg" if ".mass" in row["path"] else "-")
    assert document["inputs"]["arm"]["sha256"] == result.arm.sha256


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("fitted.urdf", "expected an arm that was read from URDF"),
        ("fitted.stl", "the ending .stl"),
        ("fitted", "no ending"),
    ],
)
def test_what_can_not_be_written_is_one_line_and_nothing_is(mjcf, tmp_path, name, words):
    with pytest.raises(InputError) as caught:
        ident.export(mjcf[2], tmp_path / name)
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)
    assert not list(tmp_path.iterdir())


def test_the_file_that_was_read_is_not_written(mjcf):
    path, _, saved = mjcf
    before = path.read_bytes()
    with pytest.raises(InputError, match="got the file that was read"):
        ident.export(saved, path)
    assert path.read_bytes() == before


def test_another_result_is_refused(tmp_path):
    with pytest.raises(InputError, match=r"expected a result of ident\.fit or ident\.sample"):
        ident.export(RESULTS / "arm.predict.json", tmp_path / "fitted.xml")


def test_an_arm_that_has_changed_since_is_refused_or_named(mjcf, tmp_path):
    path, result, _ = mjcf
    other = robot_in(tmp_path, ".xml", path.read_text() + "\n", JOINTS)
    written, _ = ident.export(result, tmp_path / "fitted.xml", arm=other)
    assert "in doubt: fitted to another arm file, or to this one before it was changed" in written.read_text()
