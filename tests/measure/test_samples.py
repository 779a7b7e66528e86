"""Files of sensors, phones, loggers and controllers, as they write them: read exactly, or refused in a line."""

from contextlib import suppress
from datetime import UTC, datetime, timedelta

import numpy as np
import pytest
from broken import broken_texts

from ident.errors import InputError
from ident.measure import read_log, read_trace
from ident.measure.recordings import read_recording

RATE, COUNT = 100, 64
NUMBER = np.arange(COUNT)
X, Y, Z = (np.round(9.81 * (axis == 2) + np.sin(0.3 * NUMBER + axis), 6) for axis in range(3))
JOINTS = ("joint1", "joint2", "joint3")
Q = np.round([0.2 + 0.01 * NUMBER, -0.4 + 0.02 * NUMBER, 0.1 - 0.01 * NUMBER], 6)


def rows(*columns, form="%.6f", delimiter=","):
    return "".join(delimiter.join(form % value for value in row) + "\n" for row in zip(*columns, strict=True))


def klipper(head):
    return head + rows(812.5 + NUMBER / RATE, 1e3 * X, 1e3 * Y, 1e3 * Z)


def phyphox(delimiter, mark, name="Acceleration"):
    head = delimiter.join(['"Time (s)"', *(f'"{name} {axis} (m/s^2)"' for axis in "xyz")])
    text = rows(NUMBER / RATE, X, Y, Z, form="%.9E", delimiter=delimiter)
    return head + "\n" + text.replace(".", mark)


def rtde(delimiter, words="actual"):
    head = delimiter.join(["timestamp", *(f"{words}_q_{joint}" for joint in range(3)), "output_int_register_0"])
    return head + "\n" + rows(4_021.0 + NUMBER / RATE, *Q, NUMBER % 2, delimiter=delimiter)


def logger(stamp):
    start = datetime(2026, 5, 1, 12, 0, 0, 250_000, UTC)
    stamps = [stamp(start + timedelta(microseconds=int(1e6 / RATE) * int(k))) for k in NUMBER]
    lines = [f"{t};{x:.6f};{y:.6f};{z:.6f}" for t, x, y, z in zip(stamps, X, Y, Z, strict=True)]
    return "Logger 7\nSerial;12;;\n\nTimestamp;ax;ay;az\n;m/s²;m/s²;m/s²\n" + "\n".join(lines) + "\n"


def since_1970(date, steps):
    """Return a count without the rounding of a float."""
    passed = date - datetime(1970, 1, 1, tzinfo=UTC)
    return (passed.days * 86_400 + passed.seconds) * steps + passed.microseconds * steps // 1_000_000


TRACES = {
    "klipper": klipper("#time,accel_x,accel_y,accel_z\n"),
    "klipper-newer": klipper("##{'errors': 0, 'overflows': 0}\n#time,accel_x,accel_y,accel_z\n"),
    "phyphox": phyphox(",", "."),
    "phyphox-tab": phyphox("\t", "."),
    "phyphox-comma": phyphox(";", ","),
    "phyphox-german": phyphox(";", ",", "Beschleunigung"),
    "phyphox-linear": phyphox(",", ".", "Linear Acceleration"),
    "slash": "t/s;a_x/(m/s^2);a_y/(m/s^2);a_z/(m/s^2)\n" + rows(NUMBER / RATE, X, Y, Z, delimiter=";"),
    "blanks": "time  x   y   z\ns  m/s^2  m/s^2  m/s^2\n" + rows(NUMBER / RATE, X, Y, Z, delimiter="   "),
    "iso": logger(lambda date: date.isoformat(timespec="milliseconds")),
    "date-and-time": logger(lambda date: f"{date:%Y-%m-%d %H:%M:%S.%f}"),
    "ms": logger(lambda date: since_1970(date, 1_000)),
    "us": logger(lambda date: since_1970(date, 1_000_000)),
    "ns": logger(lambda date: since_1970(date, 1_000_000_000)),
    "fractions": logger(lambda date: f"{since_1970(date, 1_000) / 1_000:.3f}"),
}


@pytest.mark.parametrize("name", TRACES)
def test_a_trace_is_read_as_it_was_written(tmp_path, name):
    path = tmp_path / "file.csv"
    path.write_text(TRACES[name], encoding="utf-8")
    trace = read_trace(path)
    assert trace.kind == "acceleration"
    np.testing.assert_allclose(trace.time - trace.time[0], NUMBER / RATE, rtol=0, atol=1e-9)
    np.testing.assert_allclose([*trace.values.values()], [X, Y, Z], rtol=1e-12)
    if "klipper" in name:
        assert "accel_x, accel_y, accel_z in mm/s^2, as Klipper writes them" in trace.notes[0]
    channels = read_recording(path).channels
    factor = 1e3 if "klipper" in name else 1.0
    np.testing.assert_allclose([c.values[0] / factor for c in channels], [X, Y, Z], rtol=1e-12)
    assert {c.unit for c in channels} <= {"mm/s^2", "m/s^2", "m/s²"}
    assert channels[0].step == pytest.approx(1 / RATE, rel=1e-9)


ISO = logger(lambda date: date.isoformat(timespec="milliseconds"))
ODD = {
    "decimal commas and dates": ISO.replace("12;;", "12").replace(".", ","),
    "a comment at the end": TRACES["slash"] + "# end",
    "a unit that is none": ISO.replace("Timestamp;", "No;Timestamp;")
    .replace(";m/s²;m", "-;;m/s²;m", 1)
    .replace("\n2026", "\n1;2026"),
}


@pytest.mark.parametrize("name", ODD)
def test_everyday_tables_are_read(tmp_path, name):
    (tmp_path / "file.csv").write_text(ODD[name], encoding="utf-8")
    trace = read_trace(tmp_path / "file.csv")
    np.testing.assert_allclose(trace.time - trace.time[0], NUMBER / RATE, rtol=0, atol=1e-9)
    np.testing.assert_allclose([*trace.values.values()], [X, Y, Z], rtol=1e-12)


def test_a_counter_of_ten_digits_is_no_date(tmp_path):
    rows_of = "".join(f"{1_020_000_000 + 5_000 * k},{x:.6f}\n" for k, x in enumerate(X))
    (tmp_path / "file.csv").write_text("time,x [m/s^2]\n" + rows_of)
    with pytest.raises(InputError, match="time: got no unit"):
        read_trace(tmp_path / "file.csv")
    assert read_trace(tmp_path / "file.csv", {"time": "time [us]"}).interval == pytest.approx(0.005)


def test_rows_without_a_value_do_not_count(tmp_path):
    lines = [f"{k / RATE},{x if k < 10 else 'nan'}" for k, x in enumerate(X)]
    (tmp_path / "file.csv").write_text("time [s],x [m/s^2]\n" + "\n".join(lines) + "\n")
    with pytest.raises(InputError, match="got 10 rows, expected at least 16"):
        read_trace(tmp_path / "file.csv")


@pytest.mark.parametrize("delimiter", [" ", ",", "\t"])
def test_a_controllers_log_is_read_by_its_convention(tmp_path, delimiter):
    (tmp_path / "log.txt").write_text(rtde(delimiter))
    log = read_log(tmp_path / "log.txt", JOINTS)
    np.testing.assert_allclose([*log.angles.values()], Q, rtol=1e-12)
    np.testing.assert_allclose(log.time, 4_021 + NUMBER / RATE, rtol=1e-12)
    assert "actual_q_0, actual_q_1, actual_q_2 in rad, as UR's RTDE writes them" in log.notes[0]
    assert "'actual_q_0' as joint1, 'actual_q_1' as joint2, 'actual_q_2' as joint3; the option columns" in log.notes[1]


def test_the_user_says_which_of_two_angles_counts(tmp_path):
    actual, target = rtde(" ").splitlines(), rtde(" ", "target").splitlines()
    lines = [f"{a} {' '.join(b.split()[1:4])}" for a, b in zip(actual, target, strict=True)]
    (tmp_path / "log.txt").write_text("\n".join(lines) + "\n")
    with pytest.raises(InputError) as refused:
        read_log(tmp_path / "log.txt", JOINTS)
    assert (
        str(refused.value)
        .splitlines()[0]
        .endswith(
            "joint1: got 'actual_q_0' and 'target_q_0', expected one column that is joint1; name one (`columns`), as "
            "actual_q_0=joint1"
        )
    )
    columns = {f"target_q_{k}": f"joint{k + 1}" for k in range(3)}
    np.testing.assert_allclose([*read_log(tmp_path / "log.txt", JOINTS, columns).angles.values()], Q, rtol=1e-12)


def test_columns_name_what_a_file_does_not(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text("tick,A1,A2,A3\n" + rows(10 * NUMBER, *np.rad2deg(Q), form="%.9f"))
    columns = {"tick": "time [ms]", "A1": "joint1 [deg]", "A2": "joint2 [deg]", "A3": "joint3 [deg]"}
    log = read_log(path, JOINTS, columns)
    np.testing.assert_allclose([*log.angles.values()], Q, rtol=1e-8)
    np.testing.assert_allclose(log.time, NUMBER / RATE, rtol=1e-12, atol=1e-12)
    with pytest.raises(InputError, match="time: got no such column"):
        read_log(path, JOINTS)


def test_columns_shorter_than_others_have_their_own_clock(tmp_path):
    slow = ["" if k % 4 else f"{k / 7:.6f}" for k in NUMBER]
    short = [f"{x:.6f}" if k < 40 else "NaN" for k, x in enumerate(X)]
    lines = [f"{k / RATE:.3f},{a},{b}" for k, a, b in zip(NUMBER, short, slow, strict=True)]
    (tmp_path / "a.csv").write_text("time [s],a [g],b [mm]\n" + "\n".join(lines) + "\n")
    a, b = read_recording(tmp_path / "a.csv").channels
    assert (a.step, a.values.shape, b.step, b.values.shape) == (0.01, (1, 40), 0.04, (1, 16))
    np.testing.assert_allclose(a.values[0], X[:40])


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("time,ax,ay\n" + rows(NUMBER / RATE, X, Y), "time: got no unit, expected a time unit such as s or ms"),
        (TRACES["slash"].replace("t/s", "t/kg"), "time: got no such column"),
        (TRACES["klipper"].replace("accel_y", "accel_x"), "expected one column that is x; name one"),
        (TRACES["iso"].replace("2026-05-01T12:00:00.300", "2026-15-01T12:00:00.300"), "got '2026-15-01T12:00:00.3"),
        (TRACES["ms"].replace("1777636800300", "1777636800x00"), "got '1777636800x00', expected a number"),
        (TRACES["blanks"].replace("\n0.020000", "\n0.02x000"), "expected a number"),
    ],
)
def test_what_is_not_said_is_asked_for_in_one_line(tmp_path, text, line):
    (tmp_path / "file.csv").write_text(text, encoding="utf-8")
    with pytest.raises(InputError) as refused:
        read_trace(tmp_path / "file.csv")
    assert line in str(refused.value)
    assert all(each.remedy and each.expected for each in refused.value.problems)


@pytest.mark.parametrize("name", [*TRACES, "rtde"])
def test_damaged_files_are_read_or_refused(tmp_path, name):
    """Fifteen mutations of each: no other error than one of inputs."""
    text = TRACES.get(name, rtde(" "))
    for number, broken in enumerate(broken_texts(np.random.default_rng(7), text, 15)):
        path = tmp_path / f"{number}.csv"
        path.write_bytes(broken)
        for read in (read_trace, lambda file: read_log(file, JOINTS), read_recording):
            with suppress(InputError):
                read(path)
