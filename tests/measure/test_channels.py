"""Channel tables: what a row says, what it must say, and the table to fill in."""

import os
from dataclasses import replace

import numpy as np
import pytest
from hammer_files import FOLDER, generator
from recording_files import dataset, dataset_58

from ident.errors import InputError
from ident.measure.channels import RecordedChannel, read_channels, recordings_of, write_template
from ident.measure.recordings import read_recording
from ident.measure.runs import write_runs
from ident.modal.recorded import sources

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


@pytest.mark.parametrize(
    ("cell", "volts", "unit"),
    [
        ("100 mV/g", 0.1, "g"),
        ("10.2mV/(m/s^2)", 0.0102, "m/s^2"),
        ("2.25 V/N", 2.25, "N"),
        ("5e1 uV / lbf", 5e-5, "lbf"),
    ],
)
def test_a_sensitivity_as_a_certificate_has_it(tmp_path, cell, volts, unit):
    (row,) = table(tmp_path, f"a.uff,1:+Z,response,corner,,,z,,,,{cell},30,").rows
    assert (row.sensitivity, row.unit, row.in_volts) == (pytest.approx(volts, rel=1e-12), unit, True)
    (line,) = lines(tmp_path, f"a.uff,1:+Z,response,corner,,,z,,,kN,{cell},30,")
    assert f"sensitivity: got '{cell}', expected volts for one 'kN', as in the column unit" in line


def test_a_row_may_say_how_many_taps_to_record(tmp_path):
    head = HEAD.replace("load", "load,taps")
    (three, any_number) = table(tmp_path, *(f"{n}.uff,1,force,tip,,,z,,,N,,30,,{n}" for n in ("3", "")), head=head).rows
    assert (three.taps, any_number.taps) == (3, 0)
    for cell in ("2.5", "0", "-1", "some"):
        (line,) = lines(tmp_path, f"a.uff,1,force,tip,,,z,,,N,,30,,{cell}", head=head)
        assert line.startswith(f"channels.csv:2, taps: got '{cell}', expected a")


def test_a_row_without_role_is_left_out_however_little_it_says(tmp_path):
    (row,) = table(tmp_path, "a.uff,1:+Z,,,,,,,,,,,").rows
    assert not row.counts


def test_motors_that_nothing_held_are_refused_as_in_a_campaign(tmp_path):
    (line,) = lines(tmp_path, "a.uff,1:+Z,force,tip,,,z,,,N,,30,,off", head=f"{HEAD},drives")
    assert line == (
        "channels.csv:2, drives: got 'off', expected one of brake, servo; "
        "correct it, or leave the row out if the motors turned freely"
    )


def test_a_channel_of_times_needs_no_posture(tmp_path):
    _, row = table(tmp_path, "a.csv,f,force,tip,,,z,,,N,,30,", "a.csv,t,time,,,,,,,ms,,,").rows
    assert (row.role, row.posture, row.unit) == ("time", (), "ms")


@pytest.mark.parametrize("row", ["a.csv,f,force,tip,,,z,,,N,,0,", "a.csv,f,response,tip,,,z,body,,g,,0,"])
def test_many_equal_rows_are_one_mistake(tmp_path, row):
    assert lines(tmp_path, *[row] * 5_000) == [
        "channels.csv:3, channel: got 'f' of 'a.csv' 5000 times, expected each channel once; keep one row"
    ]


def test_a_pipe_or_a_file_without_end_is_no_channel_table(tmp_path):
    path = tmp_path / "channels.csv"
    os.mkfifo(path)
    with pytest.raises(InputError, match="got a pipe, a device or a socket, expected a readable CSV file"):
        read_channels(path)
    path.unlink()
    with path.open("wb") as file:
        file.truncate(8 * 10**9)
    with pytest.raises(InputError, match="got a file of 8000 MB, expected a readable CSV file of at most 100 MB"):
        read_channels(path)
    with pytest.raises(InputError, match="got a file of 8000 MB, expected a recording of at most 1000 MB"):
        recordings_of(tmp_path)


@pytest.mark.parametrize(
    ("row", "words"),
    [
        (
            "a.uff,f,hammer,tip,,,z,,,N,,0,",
            "channels.csv:2, role: got 'hammer', expected one of force, response, reference, time,",
        ),
        ("a.uff,f,force,,,,z,,,N,,0,", "channels.csv:2, point: got nothing, expected a point of the arm for a force"),
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
    assert (
        first == "channels.csv:1, q1: got no unit, expected an angle unit such as deg or rad, as in 'q1 [deg]'; "
        "write the unit in square brackets"
    )
    assert others[0].startswith("channels.csv:1: got the unknown column 'chanel', expected one of file, channel,")
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
    with pytest.raises(InputError, match="got nothing, expected a point of the arm for a force"):
        read_channels(tmp_path / "channels.csv")
    with pytest.raises(InputError, match="got a file that is there, expected none"):
        write_template(tmp_path, tmp_path / "channels.csv", 3)


UNITS = [
    "m/s2",
    "mm/s2",
    "in/s2",
    "m/s/s",
    "ms-2",
    "g",
    "g's",
    "G",
    "Newtons",
    "lbf",
    "LB",
    "V",
    "mV",
    "mV/g",
    "EU",
    "",
]


@pytest.mark.parametrize("unit", UNITS)
def test_the_table_to_fill_in_has_units_that_the_program_takes(tmp_path, unit):
    rows = "".join(f"{k / 100},{k % 7}\n" for k in range(40))
    (tmp_path / "a.csv").write_text(f"time [s],z [{unit}]\n" + rows)
    write_template(tmp_path, tmp_path / "channels.csv", 1)
    text = (tmp_path / "channels.csv").read_text()
    force = unit in ("Newtons", "lbf", "LB")
    filled = text.replace(f"a.csv,z,,,,,{unit},", f"a.csv,z,{'force' if force else 'response'},tip,z,,{unit},")
    if unit in ("V", "mV", "mV/g", "EU", ""):
        assert "a.csv,z,,,,,,,,," in text
        assert (f"in '{unit}': write unit and sensitivity" in text) == bool(unit)
        return
    assert filled != text
    head, row = filled.splitlines()[-2:]
    cells = dict(zip(head.split(","), row.split(","), strict=True)) | {"q1 [deg]": "0"}
    other = {**cells, "channel": "other", "role": "response" if force else "force", "unit": "m/s^2" if force else "N"}
    both = "\n".join(",".join(each.values()) for each in (cells, other | {"point": "tip", "direction": "z"}))
    (tmp_path / "channels.csv").write_text(f"{head}\n{both}\n")
    (tmp_path / "a.csv").write_text(
        f"time [s],z [{unit}],other\n" + "".join(f"{k / 100},{k % 7},{k % 5}\n" for k in range(40))
    )
    (source,) = sources(read_channels(tmp_path / "channels.csv"), {"a.csv": read_recording(tmp_path / "a.csv")})
    factor = {"mm/s2": 1e-3, "in/s2": 0.0254, "lbf": 4.4482216152605, "LB": 4.4482216152605}
    expected = factor.get(unit, 9.80665 if unit[0] in "gG" else 1.0) * (np.arange(40) % 7)
    np.testing.assert_allclose(source.force[0] if force else source.responses[0].values[0], expected, rtol=1e-12)
    assert bool(source.remarks) == (unit in ("g", "g's", "G", "LB"))


def test_the_table_to_fill_in_says_what_cannot_be_used(tmp_path):
    (tmp_path / "a.csv").write_text("frequency [Hz],acceleration [g/N]\n" + "".join(f"{k},{k % 7}\n" for k in range(9)))
    write_template(tmp_path, tmp_path / "channels.csv", 1)
    row = (tmp_path / "channels.csv").read_text().splitlines()[-1]
    assert row.startswith("a.csv,acceleration,,")
    assert "not to be used: values over frequency without an imaginary part; export the real" in row


def test_two_channels_of_one_name_have_no_row_to_fill_in(tmp_path):
    rows = "".join(f"{k},{k % 7},{k % 5},{k % 3}\n" for k in range(9))
    (tmp_path / "a.csv").write_text("time [s],a [N],a [mm],b [mm]\n" + rows)
    flaw, remedy = "2 channels of one name, in 'N', 'mm'", "give each channel of the file a name of its own"
    for write in (lambda path: write_template(tmp_path, path, 1), lambda path: write_runs(tmp_path, path)):
        with pytest.raises(InputError) as caught:
            write(tmp_path / "channels.csv")
        assert str(caught.value) == f"{tmp_path}/a.csv, a: got {flaw}, expected a name for each channel; {remedy}"
        assert not (tmp_path / "channels.csv").exists()
    named = table(tmp_path, "a.csv,b,force,tip,,,z,,,N,1,0,", "a.csv,a,response,tip,,,z,,,mm,,0,")
    with pytest.raises(InputError, match=f"channels.csv:3, channel: got 'a' of 'a.csv': {flaw}, expected .*; {remedy}"):
        sources(named, recordings_of(tmp_path, named))


def test_the_unit_of_a_channel_needs_no_column(tmp_path):
    """Finished modes have none, and files mostly say theirs."""
    (row,) = table(tmp_path, "a.uff,1:+Z,response,tip,z,30", head="file,channel,role,point,direction,q1 [deg]").rows
    assert (row.unit, row.counts) == ("", True)


@pytest.mark.parametrize("delimiter", [",", ";", "\t"])
@pytest.mark.parametrize("mark", ["", "\ufeff"])
def test_a_channel_table_is_no_recording_however_it_is_saved(tmp_path, delimiter, mark):
    (tmp_path / "t.csv").write_text(mark + "# of a test\n\n" + HEAD.replace(",", delimiter) + "\n", encoding="utf-8")
    (tmp_path / "a.csv").write_text("time [s],f [N]\n0,1\n1,2\n")
    assert list(recordings_of(tmp_path)) == ["a.csv"]


def test_a_folder_without_recordings(tmp_path):
    with pytest.raises(InputError, match="a folder without recordings"):
        recordings_of(tmp_path)
    with pytest.raises(InputError, match="no such folder"):
        recordings_of(tmp_path / "none")


def test_what_the_table_does_not_name_is_not_read(tmp_path):
    """Nodes, spectra and damaged files beside the records: passed over, and listed where a table is to be written."""
    made = generator()
    made.write_file(tmp_path / "hits.unv", "z", np.ones((2, 50)), np.ones((6, 2, 50)))
    (tmp_path / "nodes.unv").write_text(dataset(15, "1 0 0 0 0.0 0.0 0.0"))
    (tmp_path / "spectra.unv").write_text(3 * dataset_58(np.ones(9), function=2))
    assert write_template(tmp_path, tmp_path / "channels.csv", 3) == 7
    assert "# Passed over: spectra.unv, 3 functions of kind auto-spectrum.\n" in (tmp_path / "channels.csv").read_text()
    (tmp_path / "damaged.unv").write_text("    -1\n")
    shipped = read_channels(FOLDER / "channels.csv")
    table = replace(shipped, rows=(replace(shipped.rows[0], file="hits.unv"),))
    found = recordings_of(tmp_path, table)
    assert {name: len(each.channels) for name, each in found.items()} == {
        "damaged.unv": 0, "hits.unv": 7, "nodes.unv": 0, "spectra.unv": 0
    }  # fmt: skip
    named = replace(table, rows=(*table.rows, replace(table.rows[0], file="spec*.unv")))
    with pytest.raises(InputError, match=r"spectra.unv: got 3 functions of kind auto-spectrum, expected samples over"):
        recordings_of(tmp_path, named)
    for name in ("hits.unv", "damaged.unv"):
        (tmp_path / name).unlink()
    with pytest.raises(InputError, match=r"spectra.unv: got 3 functions of kind auto-spectrum"):
        recordings_of(tmp_path)
    (tmp_path / "spectra.unv").unlink()
    with pytest.raises(InputError, match="got nodes and no channel"):
        recordings_of(tmp_path)


@pytest.mark.parametrize(("sensitivity", "expected"), [(100.0, "leave the cell empty"), (None, "correct one of them")])
def test_a_file_in_one_motion_unit_and_a_table_in_another_contradict_each_other(sensitivity, expected):
    """A displacement is no acceleration, whatever the sensitivity."""
    channel = RecordedChannel(where="runs.csv:2", file="a.csv", channel="y", unit="g_0", sensitivity=sensitivity)
    with pytest.raises(InputError, match=f"runs.csv:2, .*{expected}"):
        channel.scale("mm", ("length", "velocity", "acceleration"), "a motion", "mm")
