"""`ident new`: files, next steps, what is refused."""

import errno
import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from commands import ARM, files
from three_joints import WITH_HAND

from ident.measure import Campaign
from ident.studies.look.example import Example

URDF = "<robot name='one'><link name='base'/><link name='a'/></robot>"


def test_files_are_written_and_the_next_steps_said(run, tmp_path):
    code, out, err = run("new", "scara", "my_robot")
    assert (code, err) == (0, "")
    assert files(tmp_path) == ["my_robot/arm.toml", "my_robot/campaign.csv"]
    assert "ident fit my_robot/campaign.csv" in out
    assert "EXAMPLE NUMBERS" in (tmp_path / "my_robot" / "arm.toml").read_text()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("skara", "robot"), "kind: got 'skara', expected one of scara, six-axis; did you mean scara?"),
        (("scara",), "got no folder, expected the folder to make"),
        (("scara", "full"), "full: got a folder that has files in it"),
        (("scara", "full/file"), "full/file: got a file"),
        (("scara", "robot", "--urdf=robot.urdf"), "got a kind and --robot"),
        (("robot", "--urdf=none.urdf"), "none.urdf: got no such file"),
        (("robot", "--urdf=robot.urdf"), "root links: a, base"),
        (("scara", "robot", "--tip=tool"), "--tip: got a tip without --robot"),
        (
            ("robot", "--robot=arm.urdf", "--tip=tol0"),
            "arm.urdf: got the tip 'tol0', expected a moving link of this robot",
        ),
        (("robot", "--robot=arm.urdf", "--tip=finger_l"), "arm.urdf, joint slide_l: got type prismatic"),
    ],
)
def test_what_cannot_be_made_is_one_line_and_nothing_is_written(run, tmp_path, arguments, words):
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "file").write_text("mine")
    (tmp_path / "robot.urdf").write_text(URDF)
    (tmp_path / "arm.urdf").write_text(WITH_HAND)
    before = files(tmp_path)
    code, out, err = run("new", *arguments)
    assert (code, out) == (2, "")
    assert words in err
    assert len(err.splitlines()) == 1
    assert files(tmp_path) == before


def test_what_a_robot_description_says_otherwise_is_said(run, tmp_path, monkeypatch):
    """Where the campaign is simulated, is tested in tests/studies/test_new.py."""
    monkeypatch.setattr("ident.studies.look.example.example", lambda arm: Example(Campaign(), {}))
    (tmp_path / "arm.urdf").write_text(WITH_HAND.replace('lower="-1" upper="2"', 'lower="0" upper="0"'))
    code, out, err = run("new", "robot", "--robot=arm.urdf", "--tip=hand")
    assert (code, err) == (0, "")
    held = "arm.urdf, joint cable (floating): is held at zero; 0.4 kg on it move with j2"
    free = "arm.urdf, joint j1: limits 0, 0, so that it turns freely here"
    assert f"NOTE: {held}" in " ".join(out.split())
    assert f"NOTE: {free}" in " ".join(out.split())
    text = (tmp_path / "robot" / "arm.toml").read_text()
    assert f"# {held}" in text
    assert f"# {free}" in text
    code, out, err = run("new", "again", "--robot=arm.urdf", "--json")
    assert len(json.loads(out)["notes"]) == 4


def test_a_template_needs_neither_jax_nor_numpy(tmp_path):
    program = "import sys; from ident.studies.look.new import new; new('scara', 'robot'); print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", program], cwd=tmp_path, capture_output=True, text=True, check=True)
    assert not {"numpy", "jax", "pydantic"} & set(done.stdout.split())


@pytest.mark.parametrize("command", [("new", "scara", "robot"), ("show", ARM)])
def test_where_the_last_file_can_not_be_moved_to_its_place_there_is_none(run, tmp_path, monkeypatch, command):
    move, moved = os.replace, []

    def failing(source, target):
        if not Path(target).absolute().is_relative_to(tmp_path):  # a program that was compiled is kept meanwhile
            return move(source, target)
        moved.append(target)
        if len(moved) == 2:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return move(source, target)

    monkeypatch.setattr(os, "replace", failing)
    code, _, err = run(*command)
    assert (code, err.count("\n")) == (2, 1)
    assert "got no space left on device, expected a file to write" in err
    assert list(tmp_path.iterdir()) == []
