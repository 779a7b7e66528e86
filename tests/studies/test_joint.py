"""`ident.joint`: logs of the KR300 against plain least squares, and what is wrong with a log, in one line."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from joint_logs import Truth, joint_log
from reports import assert_one_screen, too_wide
from results import assert_comes_back, assert_plain

import ident
from ident.errors import InputError
from ident.measure.joint_log import read_joint_log

KR300 = Path(__file__).parents[2] / "data" / "kr300"
LOGS = [KR300 / f"{name}.csv" for name in "abc"]
INERTIA = {"axis1": 609.0, "axis2": 843.9, "axis3": 751.3}
HEAD = "time [s],joint1.motor [deg],joint1.link [deg],joint1.torque [N*m]"


@pytest.fixture(scope="module")
def result():
    return ident.joint(LOGS, inertia=INERTIA)


def number(result, joint, quantity):
    return next(row for row in result.table() if (row["joint"], row["quantity"]) == (joint, quantity))


def plain_least_squares(axis):
    """Stiffness, Coulomb friction, delay: no shift, no instruments, derivatives by differences, a moving average."""
    parts, sides = [], []
    for log, path in enumerate(LOGS):
        lines = [line for line in path.read_text().splitlines() if not line.startswith("#")]
        table = np.array([line.split(",") for line in lines[1:]], float)
        column = dict(zip(lines[0].split(","), table.T, strict=True))
        motor, link = (np.radians(column[f"axis{axis}.{name} [deg]"]) for name in ("motor", "link"))
        smooth = lambda x: np.convolve(x, np.hanning(13) / np.hanning(13).sum(), "same")  # noqa: E731
        speed = np.gradient(smooth(motor), 0.004)
        torque = smooth(column[f"axis{axis}.torque [N*m]"]) - INERTIA[f"axis{axis}"] * np.gradient(speed, 0.004)
        moving = (np.abs(speed) > 0.05 * np.abs(speed).max()) & (np.abs(column["time [s]"] - 5) < 4.8)
        zeros = [np.full(len(motor), float(each == log)) for each in range(3)]
        rows = [torque, np.sign(speed), speed, np.sin(motor), np.cos(motor), *zeros]
        parts.append(np.stack(rows, axis=1)[moving])
        sides.append(smooth(link - motor)[moving])
    torque, sign, speed, *_ = np.linalg.lstsq(np.concatenate(parts), np.concatenate(sides), rcond=None)[0]
    return -1 / torque, -sign / torque, -speed


@pytest.mark.parametrize("axis", [1, 2, 3])
def test_plain_least_squares_gives_the_same(result, axis):
    for quantity, expected in zip(("stiffness", "coulomb", "delay"), plain_least_squares(axis), strict=True):
        row = number(result, f"axis{axis}", quantity)
        assert row["low"] < expected < row["high"]
        assert row["value"] == pytest.approx(expected, abs=0.5 * (row["high"] - row["value"]))


def test_what_is_said_of_the_kr300(result, tmp_path):
    """Of the authors' 4.58e6, 7.52e6 and 4.10e6 N m/rad the second is within, the others are below."""
    text = result.report(details=True)
    assert result.sections().verdict.word == "LOGS DISAGREE"
    assert result.doubtful
    assert not number(result, "axis1", "stiffness")["told"]
    second, third = (number(result, name, "stiffness") for name in ("axis2", "axis3"))
    assert second["low"] < 7.52e6 < second["high"]
    assert third["told"]
    assert third["low"] > 4.10e6
    assert "without delay" in text
    assert_one_screen(result.report(), files=2)
    assert not too_wide(text)
    assert_plain(result.table())
    assert_comes_back(result, tmp_path)


def test_alone_finds_one_delay_of_three_axes():
    """Which share a clock: the friction that each torque tells by itself makes three delays one."""
    found = ident.joint(LOGS, inertia=INERTIA, alone=True)
    for axis in (1, 2, 3):
        row = number(found, f"axis{axis}", "delay")
        assert row["low"] < 3.0e-3 < row["high"]
        assert row["value"] == pytest.approx(3.0e-3, rel=0.03)


def written(path, log, *, ratio=1.0, torque=1.0):
    """Write a log as a controller may, with the motor at its own shaft."""
    columns = log.columns["joint"]
    lines = [HEAD.replace("[deg]", "[rad]")]
    for i, time in enumerate(log.time):
        numbers = (time, columns["motor"][i] * ratio, columns["link"][i], torque * columns["torque"][i] / ratio)
        lines.append(",".join(f"{x:.12g}" for x in numbers))
    path.write_text("\n".join(lines) + "\n")
    return path


def test_a_motor_at_its_shaft_is_the_same_joint(tmp_path):
    """Also where it turns by more than a joint can."""
    log = joint_log(Truth())
    path = written(tmp_path / "shaft.csv", log, ratio=128.0)
    at_shaft = ident.joint(path, ratio="128", inertia={"joint1": 30 / 128**2})
    at_joint = ident.joint(written(tmp_path / "joint.csv", log), inertia="30")
    for one, other in zip(at_shaft.table(), at_joint.table(), strict=True):
        assert one["told"] == other["told"]
        assert one["value"] == pytest.approx(other["value"], rel=1e-5, nan_ok=True)
    assert [path.name for path in at_joint.save_figures(tmp_path)] == ["joint.joint.png"]


def test_a_torque_counted_the_other_way_is_told(tmp_path):
    result = ident.joint(written(tmp_path / "log.csv", joint_log(Truth()), torque=-1.0), inertia="30")
    text = result.report()
    assert not any(row["told"] for row in result.table())
    assert "comes out below 0" in text
    assert "varies too little" not in text


ROWS = [[0.004 * i, 10 * np.sin(i / 80), 10 * np.sin(i / 80) - 0.01, 50 * np.cos(i / 80)] for i in range(1000)]


def refused(tmp_path, head=HEAD, change=lambda rows: rows, **options):
    path = tmp_path / "log.csv"
    lines = [",".join(f"{x:.9g}" for x in row) for row in change([[*row] for row in ROWS])]
    path.write_text("\n".join([head, *lines]) + "\n")
    with pytest.raises(InputError) as caught:
        ident.joint(path, **options)
    return str(caught.value)


def set_column(index, value):
    return lambda rows: [[*row[:index], value, *row[index + 1 :]] for row in rows]


@pytest.mark.parametrize(
    ("head", "change", "said"),
    [
        (HEAD.replace("link", "links"), None, "log.csv:1, joint1.link: got no such column"),
        (HEAD.replace("torque", "torques"), None, "log.csv:1, joint1.torque: got no such column"),
        (HEAD.replace("joint1.", ""), None, "log.csv:1: got no joint, expected columns as 'joint1.motor [deg]'"),
        (HEAD.replace("[N*m]", "[N]"), None, "log.csv:1, joint1.torque: got "),
        (HEAD.replace(" [N*m]", ""), None, "log.csv:1, joint1.torque: got no unit"),
        (
            HEAD,
            lambda rows: [row for i, row in enumerate(rows) if i % 100 < 60],
            "gaps and a drifting clock that leave",
        ),
        (HEAD, set_column(1, 3.0), "joint1.motor: got one value throughout, expected a joint that moves"),
        (HEAD, set_column(3, 7.0), "joint1.torque: got one value throughout, expected a torque that varies"),
        (
            HEAD,
            lambda rows: [[*row[:3], 1e-300 * row[3]] for row in rows],
            "joint1.torque: got a range of 1e-298 N*m, expected a torque that varies",
        ),
        (
            HEAD.replace("[deg]", "[rad]"),
            lambda rows: [[row[0], row[1], 10 * row[2], *row[3:]] for row in rows],
            "a range of 200 rad",
        ),
        (
            HEAD,
            lambda rows: [[*row[:2], row[1], row[3]] for row in rows],
            "joint1.link: got the motor's angle throughout",
        ),
        (HEAD, lambda rows: [[row[0], -row[1], *row[2:]] for row in rows], "joint1.motor: got -1 times the link's"),
        (HEAD, lambda rows: [[row[0], 121 * row[1], *row[2:]] for row in rows], "joint1.motor: got 121 times the link"),
        (HEAD, lambda rows: rows[:60], "samples in which joint1 moves, expected at least 100"),
        (HEAD, lambda rows: [[*row, 0.0] for row in rows], "log.csv:2: got 5 fields, so that no cell was read (also"),
    ],
    ids=[
        "link",
        "torque",
        "joint",
        "quantity",
        "unit",
        "gap",
        "still",
        "constant",
        "tiny",
        "radians",
        "same",
        "sign",
        "ratio",
        "short",
        "misfit",
    ],
)
def test_bad_logs_are_one_line(tmp_path, head, change, said):
    text = refused(tmp_path, head, change or (lambda rows: rows))
    assert said in text
    assert len(text.splitlines()) == 1


def test_a_torque_that_is_zero_while_the_joint_moves_tells_nothing(tmp_path):
    rows = [[*row[:3], 50.0 * (i < 20)] for i, row in enumerate(ROWS)]
    (tmp_path / "log.csv").write_text("\n".join([HEAD, *(",".join(f"{x:.9g}" for x in row) for row in rows)]))
    assert "CANNOT TELL" in ident.joint(tmp_path / "log.csv").report()


def test_bad_options_are_one_line(tmp_path):
    assert "ratio: got joint2, expected one of joint1" in refused(tmp_path, ratio={"joint2": 3.0})
    assert "inertia: got 0, expected a number above 0" in refused(tmp_path, inertia={"": 0.0})
    assert "got it beside `locked`" in refused(tmp_path, alone=True, locked=True)
    assert "expected none, for the link is `locked`" in refused(tmp_path, locked=True)
    assert "for `upto` 1e-06 Hz, expected at least" in refused(tmp_path, upto=1e-6)
    with pytest.raises(InputError, match=r"a\.csv again, expected each log once"):
        ident.joint([LOGS[0], LOGS[0]])
    with pytest.raises(InputError, match="got other columns, expected those of"):
        ident.joint([LOGS[0], written(tmp_path / "other.csv", joint_log(Truth(), duration=3.0))])


def test_the_command_ends_with_2_and_writes_nothing(tmp_path):
    (tmp_path / "log.csv").write_text(HEAD.replace("link", "links") + "\n" + "0,1,2,3\n0.1,1,2,3\n" * 10)
    command = [sys.executable, "-m", "ident", "joint", "log.csv"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 2
    assert "joint1.link: got no such column" in done.stderr
    assert "Traceback" not in done.stderr
    assert not (tmp_path / "out").exists()


def test_the_logs_are_a_part_of_the_authors(tmp_path):
    log = read_joint_log(LOGS[0])
    assert list(log.columns) == ["axis1", "axis2", "axis3"]
    assert len(log.time) == 2501
    assert "Copyright (c) 2021 Jonas Weigand" in (KR300 / "LICENSE").read_text()
    assert sum(path.stat().st_size for path in KR300.iterdir()) < 1_000_000
