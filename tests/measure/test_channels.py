"""Channel tables: what a row says, what it must say, and the table to fill in."""

import numpy as np
import pytest
from hammer_files import FOLDER, generator

from ident.errors import InputError
from ident.measure.channel_template import recordings_of, write_template
from ident.measure.channels import read_channels

HEAD = "file,channel,role,point,joint,position [mm],direction,frame,quantity,unit,sensitivity,q1 [deg],load"


def table(tmp_path, *rows, head=HEAD):
    (tmp_path / "channels.csv").write_text("\n".join([head, *rows]) + "\n")
    return read_channels(tmp_path / "channels.csv")


def lines(tmp_path, *rows, head=HEAD):
    with pytest.raises(InputError) as caught:
        table(tmp_path, *rows, head=head)
    return [str(problem).replace(f"{tmp_path}/", "") for problem in caught.value.problems]


def test_a_row_in_si(tmp_path):
    (row,) = table(tmp_path, "a*.uff,1:+Z,response,corner,joint3,145 500 80,0 0 -2,body,,g_0,0.01,30,0.2 kg @ tip").rows
    assert (row.file, row.channel, row.role, row.point, row.frame) == ("a*.uff", "1:+Z", "response", "corner", "body")
    assert (row.joint, row.direction, row.unit, row.sensitivity) == ("joint3", (0, 0, -1), "g_0", 0.01)
    np.testing.assert_allclose([*row.position, *row.posture], [0.145, 0.5, 0.08, np.pi / 6], rtol=1e-12)
    assert str(row.load) == "0.2 kg @ tip"


def test_a_row_without_role_is_left_out_however_little_it_says(tmp_path):
    (row,) = table(tmp_path, "a.uff,1:+Z,,,,,,,,,,,").rows
    assert not row.counts


@pytest.mark.parametrize(
    ("row", "words"),
    [
        (
            "a.uff,f,hammer,tip,,,z,,,N,,0,",
            "channels.csv:2, role: got 'hammer', expected one of force, response, reference, time,",
        ),
        ("a.uff,f,force,,,,z,,,N,,0,", "channels.csv:2, point: got nothing, expected a point of the arm, of a force"),
        ("a.uff,f,force,tip,,,,,,N,,0,", "channels.csv:2, direction: got nothing, expected x, -z, ..."),
        ("a.uff,f,force,tip,,,z,,,N,,,", "channels.csv:2, q1: got nothing, expected a number"),
        ("a.uff,f,force,tip,,,z,,length,N,,0,", "quantity: got 'length', expected one of force, of a force"),
        ("a.uff,f,force,tip,,,z,arm,,N,,0,", "frame: got 'arm', expected one of base, body"),
        ("a.uff,f,force,tip,joint3,,z,,,N,,0,", "position: got one of joint and position, expected both, or neither"),
        ("a.uff,f,force,tip,joint3,1 2,z,,,N,,0,", "position: got '1 2', expected three numbers"),
        ("a.uff,f,force,tip,,,z,,,N,-1,0,", "sensitivity: got '-1', expected a number above 0"),
        (",f,force,tip,,,z,,,N,,0,", "file: got nothing, expected the file's name"),
        ("a.uff,f,force,tip,,,up,,,N,,0,", "direction: got 'up', expected x, -z, ..."),
        ("a.uff,f,force,tip,,,z,,,N,,0", "got 12 fields"),
    ],
)
def test_a_row_that_is_wrong_has_one_line(tmp_path, row, words):
    (line,) = lines(tmp_path, row)
    assert words in line


def test_a_header_that_is_wrong(tmp_path):
    first, *others = lines(tmp_path, "", "x", head="file,chanel,role,point,direction,unit,q1")
    assert first.startswith("channels.csv:1: got the unknown column 'chanel', expected one of file, channel,")
    assert (
        others[0]
        == "channels.csv:1, q1: got no unit, expected a unit, as in 'q1 [deg]'; write the unit in square brackets"
    )
    assert others[1].startswith("channels.csv:1, channel: got no such column")


@pytest.mark.parametrize(("angles", "missing"), [("q1,q2,q4", ["q3"]), ("q1,q5,q3", ["q2", "q4"]), ("q2", ["q1"])])
def test_a_joint_angle_that_is_left_out_is_named(tmp_path, angles, missing):
    angles = ",".join(f"{name} [deg]" for name in angles.split(","))
    found = lines(tmp_path, "x", head=f"file,channel,role,point,direction,unit,{angles}")
    assert [line.partition(":1, ")[2].partition(":")[0] for line in found] == missing
    assert all("got no such column" in line for line in found)


def test_the_shipped_table_names_every_channel_of_every_file():
    rows = read_channels(FOLDER / "channels.csv").rows
    assert sum(row.role == "force" for row in rows) == 8
    assert sum(row.role == "response" for row in rows) == 4 * 6
    assert {row.decay for row in rows} == {0.0, 0.3}


def test_the_table_to_fill_in_has_what_the_files_say_and_no_more(tmp_path):
    made = generator()
    made.write_file(tmp_path / "hits.unv", "z", np.ones((2, 50)), np.ones((6, 2, 50)))
    assert write_template(tmp_path, tmp_path / "channels.csv", 3) == 7
    text = (tmp_path / "channels.csv").read_text()
    assert "hits.unv,1:-Z force,force,,,,N,,,,,,,,2 x 50 samples at 200 Hz" in text
    assert "hits.unv,2:+Y acceleration,response,,,,m/s^2,,,,,,,,2 x 50 samples at 200 Hz" in text
    assert list(recordings_of(tmp_path)) == ["hits.unv"], "the table is no recording"
    with pytest.raises(InputError, match="got nothing, expected a point of the arm, of a force"):
        read_channels(tmp_path / "channels.csv")
    with pytest.raises(InputError, match="got a file that is there, expected none"):
        write_template(tmp_path, tmp_path / "channels.csv", 3)


def test_a_folder_without_recordings(tmp_path):
    with pytest.raises(InputError, match="a folder without recordings"):
        recordings_of(tmp_path)
    with pytest.raises(InputError, match="no such folder"):
        recordings_of(tmp_path / "none")
