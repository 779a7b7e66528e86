"""ROS 2 bags, MCAP files and phones' ZIP files: read to the exact value, refused in one line, nothing executed."""

import csv
import io
import random
import sqlite3
import struct
import sys
import zipfile

import numpy as np
import pytest
import zstandard
from conformance import agrees
from mcap.records import Chunk
from mcap.writer import CompressionType, Writer

import ident
from ident.errors import InputError, LackingError, NoChannelError
from ident.measure import read_log, robot_logs
from ident.measure.recordings import read_recording
from ident.measure.robot_logs import is_binary_log, text_of
from ident.measure.trace import read_trace

JOINTS, IMU = "sensor_msgs/msg/JointState", "sensor_msgs/msg/Imu"
START = 1_700_000_000_123_456_789
STEP = 8_000_000
ROWS = 40
JOINT_COLUMNS = ["joint1 [rad]", "joint1.velocity [rad/s]", "joint1.effort [N*m]"]


# -------- Files of our own making


class Cdr:
    """A message in ROS 2's encoding, by the OMG's rules: each number at a multiple of its size."""

    def __init__(self, order="<"):
        self.order, self.data = order, b""

    def number(self, code, value):
        self.data += b"\0" * (-len(self.data) % struct.calcsize(code)) + struct.pack(self.order + code, value)
        return self

    def text(self, value):
        self.number("I", len(value.encode()) + 1).data += value.encode() + b"\0"
        return self

    def numbers(self, values):
        self.number("I", len(values))
        for value in values:
            self.number("d", value)
        return self

    def header(self, stamp):
        return self.number("i", stamp // 10**9).number("I", stamp % 10**9).text("base")

    def done(self):
        return (b"\0\1\0\0" if self.order == "<" else b"\0\0\0\0") + self.data


def joints(stamp, names, position=(), velocity=(), effort=(), order="<"):
    message = Cdr(order).header(stamp).number("I", len(names))
    for name in names:
        message.text(name)
    return message.numbers(position).numbers(velocity).numbers(effort).done()


def imu(stamp, acceleration, covariance=0.0):
    message = Cdr().header(stamp)
    for value in (0.0, 0.0, 0.0, 1.0, *[0.0] * 9, *[0.0] * 3, *[0.0] * 9, *acceleration, covariance, *[0.0] * 8):
        message.number("d", value)
    return message.done()


def bag(messages, kinds, encoding="cdr"):
    """Return the bytes of a .db3 file of ROS 2's default storage; messages are (topic, received, data)."""
    base = sqlite3.connect(":memory:")
    base.execute("CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, type TEXT, serialization_format TEXT)")
    base.execute("CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, data BLOB)")
    base.execute("CREATE INDEX timestamp_idx ON messages (timestamp ASC)")
    ids = {topic: i for i, topic in enumerate(kinds, 1)}
    base.executemany("INSERT INTO topics VALUES (?, ?, ?, ?)", [(i, t, kinds[t], encoding) for t, i in ids.items()])
    rows = [(ids[topic], received, data) for topic, received, data in messages]
    base.executemany("INSERT INTO messages(topic_id, timestamp, data) VALUES (?, ?, ?)", rows)
    base.commit()
    return base.serialize()


def mcap(messages, kinds, encoding="cdr", definition=b"", **settings):
    settings.setdefault("compression", CompressionType.NONE)
    file = io.BytesIO()
    writer = Writer(file, **settings)
    writer.start("ros2")
    channels = {}
    for topic, kind in kinds.items():
        schema = writer.register_schema(kind, "ros2msg", definition)
        channels[topic] = writer.register_channel(topic, encoding, schema)
    for topic, received, data in messages:
        writer.add_message(channels[topic], received, data, received)
    writer.finish()
    return file.getvalue()


def archive(parts, compression=zipfile.ZIP_DEFLATED):
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", compression) as made:
        for name, text in parts.items():
            made.writestr(name, text)
    return file.getvalue()


STORAGES = {
    "a.db3": bag,
    "unchunked.mcap": lambda *args: mcap(*args, use_chunking=False),
    "chunked.mcap": mcap,
    "lz4.mcap": lambda *args: mcap(*args, compression=CompressionType.LZ4, chunk_size=2000),
    "zstd.mcap": lambda *args: mcap(*args, compression=CompressionType.ZSTD, chunk_size=2000),
}
WRITERS = {
    "a.db3": "SQLite",
    "unchunked.mcap": "mcap's writer",
    "chunked.mcap": "mcap's writer in chunks",
    "lz4.mcap": "mcap's writer, LZ4",
    "zstd.mcap": "mcap's writer, Zstandard",
}
each_storage = pytest.mark.parametrize(("name", "store"), STORAGES.items(), ids=[*STORAGES])
ANGLES = np.random.default_rng(3).normal(size=(ROWS, 2)) / 50
STAMPS = [START + STEP * i for i in range(ROWS)]


def arm_messages(topic="/joint_states", names=("joint1", "joint2")):
    """Received late, in bursts of four."""
    late = [STAMPS[i - i % 4] + 5_000_000 for i in range(ROWS)]
    return [(topic, late[i], joints(STAMPS[i], names, ANGLES[i], 3 * ANGLES[i])) for i in range(ROWS)]


ACCELERATION = np.random.default_rng(4).normal(size=(ROWS, 3))
IMU_MESSAGES = [("/imu", STAMPS[i], imu(STAMPS[i] + 1, ACCELERATION[i])) for i in range(ROWS)]
PHONE = '"Time (s)","Acceleration x (m/s^2)","Acceleration y (m/s^2)"\n0.000000000E0,1.25E-1,9.81E0\n1E-2,NaN,9.80E0\n'
GYRO = '"Time (s)","Gyroscope x (rad/s)"\n0.0E0,1.0E0\n1E-2,2.0E0\n'


def rows_of(data):
    text, remarks = text_of(data, "a")
    return [*csv.reader(io.StringIO(text))], "\n".join(remarks)


def refused(data, kind=InputError):
    assert is_binary_log(data)
    with pytest.raises(kind) as error:
        text_of(data, "a.bag")
    assert len(str(error.value).splitlines()) == 1
    assert str(error.value).startswith("a.bag")
    return str(error.value)


# -------- Bags, to the exact value


@each_storage
def test_joints_are_read_to_the_exact_value_at_the_stamps_of_their_headers(tmp_path, name, store):
    path = tmp_path / name
    path.write_bytes(store(arm_messages(), {"/joint_states": JOINTS}))
    log = read_log(path, ["joint2", "joint1"])
    np.testing.assert_array_equal(log.time, [STEP * i / 10**9 for i in range(ROWS)])
    what, source = "joint angles of a ROS 2 bag", f"CDR of the OMG, {WRITERS[name]}"
    agrees(log.angles["joint2"], ANGLES[:, 1], "formats", what, source, unit="rad")
    np.testing.assert_array_equal(log.angles["joint1"], ANGLES[:, 0])
    assert log.ignored == ("joint1.velocity [rad/s]", "joint2.velocity [rad/s]")
    rows, remarks = rows_of(path.read_bytes())
    assert rows[0] == [
        "time [s]",
        *("joint1 [rad]", "joint1.velocity [rad/s]", "joint2 [rad]", "joint2.velocity [rad/s]"),
    ]
    assert "/joint_states: 40 messages, times are those of header.stamp" in remarks
    assert "by the convention of ROS" in remarks
    assert "time 0 is 1700000000.123456789 s" in remarks


@each_storage
def test_accelerations_are_read_to_the_exact_value(tmp_path, name, store):
    path = tmp_path / name
    path.write_bytes(store(IMU_MESSAGES, {"/imu": IMU}))
    trace, recording = read_trace(path), read_recording(path)
    assert trace.kind == "acceleration"
    for i, axis in enumerate("xyz"):
        what, source = "accelerations of a ROS 2 bag", f"CDR of the OMG, {WRITERS[name]}"
        agrees(trace.values[axis], ACCELERATION[:, i], "formats", what, source, unit="m/s^2")
        np.testing.assert_array_equal(recording.channels[i].values[0], ACCELERATION[:, i])
    assert [each.unit for each in recording.channels] == ["m/s^2"] * 3
    assert recording.channels[0].step == pytest.approx(STEP / 1e9, rel=1e-12)


def test_the_front_door_reads_a_bag(tmp_path):
    (tmp_path / "a.db3").write_bytes(bag(arm_messages(), {"/joint_states": JOINTS}))
    assert len(ident.read_log(tmp_path / "a.db3", ["joint1"]).time) == ROWS
    (tmp_path / "b.mcap").write_bytes(mcap(IMU_MESSAGES, {"/imu": IMU}))
    assert len(ident.read_trace(tmp_path / "b.mcap").time) == ROWS


def test_a_big_endian_message_and_the_effort():
    data = bag([("/j", 5, joints(START, ["joint1"], [1 / 3], [2e-300], [-7.0], order=">"))], {"/j": JOINTS})
    rows, _ = rows_of(data)
    assert rows[0] == ["time [s]", *JOINT_COLUMNS]
    assert [float(cell) for cell in rows[1]] == [0.0, 1 / 3, 2e-300, -7.0]


def test_the_list_of_joints_may_change_and_nan_is_blank():
    nan = float("nan")
    given = [joints(START, ["a", "b"], [1.0, 2.0]), joints(START + 1, ["b"], [3.0]), joints(START + 2, ["a"], [nan])]
    rows, _ = rows_of(bag([("/j", 0, data) for data in given], {"/j": JOINTS}))
    assert rows == [
        ["time [s]", "a [rad]", "b [rad]"],
        ["0.0", "1.0", "2.0"],
        ["1e-09", "", "3.0"],
        ["2e-09", "", ""],
    ]


def test_late_messages_are_sorted_and_zero_stamps_left_out():
    given = [joints(stamp, ["a"], [value]) for stamp, value in ((START + 9, 1.0), (0, 5.0), (START, 2.0))]
    rows, remarks = rows_of(mcap([("/j", 0, data) for data in given], {"/j": JOINTS}))
    assert [row[1] for row in rows[1:]] == ["2.0", "1.0"]
    assert "2 messages, times are those of header.stamp, 1 more without a stamp left out, sorted (1 came out" in remarks


def test_without_any_stamp_times_of_receipt_are_taken_and_said():
    given = [("/j", START + 10 * i, joints(0, ["a"], [float(i)])) for i in range(3)]
    rows, remarks = rows_of(bag(given, {"/j": JOINTS}))
    assert [row[0] for row in rows[1:]] == ["0.0", "1e-08", "2e-08"]
    assert "header.stamp is zero throughout, so times are those of receipt" in remarks


def test_topics_of_different_columns_share_a_table_without_prefix():
    messages = [*arm_messages(), *arm_messages("/gripper", ["finger", "thumb"]), *IMU_MESSAGES]
    rows, remarks = rows_of(bag(messages, {"/joint_states": JOINTS, "/gripper": JOINTS, "/imu": IMU}))
    assert len(rows) == 1 + 3 * ROWS
    assert {"joint1 [rad]", "thumb.velocity [rad/s]", "z [m/s^2]"} < set(rows[0])
    assert [bool(cell) for cell in rows[3]] == [True, *[False] * 8, *[True] * 3]
    assert "begin with the topic" not in remarks


def test_columns_that_two_topics_have_begin_with_the_topic():
    messages = [*arm_messages(), *IMU_MESSAGES, *(("/arm/imu", t, data) for _, t, data in IMU_MESSAGES)]
    rows, remarks = rows_of(mcap(messages, {"/joint_states": JOINTS, "/imu": IMU, "/arm/imu": IMU}))
    assert {"joint1 [rad]", "/imu.x [m/s^2]", "/arm/imu.x [m/s^2]"} < set(rows[0])
    assert "columns of /imu and /arm/imu begin with the topic, as others have the same names" in remarks


def test_other_topics_are_named_and_left():
    kinds = {"/imu": IMU, "/camera": "sensor_msgs/msg/Image"}
    rows, remarks = rows_of(bag([*IMU_MESSAGES, ("/camera", START, b"\0\1\0\0")], kinds))
    assert len(rows) == 1 + ROWS
    assert "not read: /camera (sensor_msgs/msg/Image in cdr)" in remarks


def test_a_sensor_without_accelerometer_has_no_values():
    data = bag([("/imu", 1, imu(START, [1.0, 2.0, 3.0], covariance=-1.0))], {"/imu": IMU})
    assert "no value of joints or accelerations; topics: /imu" in refused(data, NoChannelError)


def test_a_bag_that_was_closed_with_its_log_of_writes_is_read():
    data = bag(IMU_MESSAGES, {"/imu": IMU})
    assert rows_of(data[:18] + b"\2\2" + data[20:]) == rows_of(data)


def test_names_from_a_file_stay_on_their_line(tmp_path):
    names = ["a\nb", "=cmd", "", "x [mm]", 'q"', "joint1"]
    messages = [("/j", t, joints(t, names, [i / 100] * 6)) for i, t in enumerate(STAMPS)]
    path = tmp_path / "a.db3"
    path.write_bytes(bag(messages, {"/j": JOINTS}))
    assert read_log(path, ["joint1"]).angles["joint1"][3] == 0.03
    assert text_of(path.read_bytes(), "a")[0].count("\n") == 1 + ROWS


# -------- Bags that are refused


def test_a_folder_of_a_bag_names_the_file_in_it(tmp_path):
    (tmp_path / "bag").mkdir()
    (tmp_path / "bag" / "bag_0.db3").write_bytes(b"")
    for read in (read_trace, read_recording):
        with pytest.raises(InputError, match=r"this folder is a ROS 2 bag: name .*bag_0\.db3 in it") as error:
            read(tmp_path / "bag")
        assert len(str(error.value).splitlines()) == 1
    (tmp_path / "bag" / "bag_0.db3").unlink()
    with pytest.raises(InputError, match="got a directory"):
        read_trace(tmp_path / "bag")


@each_storage
@pytest.mark.parametrize("share", [0.05, 0.6, 0.97])
def test_a_truncated_bag_is_refused_in_one_line(name, store, share):
    data = store(arm_messages(), {"/joint_states": JOINTS})
    assert "damaged or truncated file" in refused(data[: int(share * len(data))])


def test_messages_that_do_not_fit_are_refused_with_their_place():
    good = joints(START, ["a"], [1.0])
    for bad, said in (
        (joints(START, ["a", "b"], [1.0]), "names and values in numbers of [1, 2], 2 different names"),
        (joints(START, ["a", "a"], [1.0, 2.0]), "in numbers of [2], 1 different names"),
        (joints(START, [], [1.0]), "in numbers of [0, 1], 0 different"),
        (good[:-20], "a message that cannot be read"),
        (zstandard.compress(good), "a message that cannot be read ("),
    ):
        message = refused(bag([("/j", 0, good), ("/j", 1, bad)], {"/j": JOINTS}))
        assert message.startswith("a.bag, message 2 of /j: got ")
        assert said in message


def test_other_encodings_and_other_topics_are_named():
    assert "topics: /imu (sensor_msgs/msg/Imu in ros1)" in refused(mcap(IMU_MESSAGES, {"/imu": IMU}, "ros1"))
    assert "topics: /c (std_msgs/msg/String in cdr)" in refused(bag([("/c", 0, b"")], {"/c": "std_msgs/msg/String"}))
    assert "topics: none" in refused(mcap([], {}), NoChannelError)


def test_another_database_a_view_and_an_endless_one_are_refused():
    base = sqlite3.connect(":memory:")
    base.execute("CREATE TABLE t(x)")
    base.execute("CREATE VIEW topics AS SELECT 1 AS id, '/j' AS name, 'x' AS type, 'cdr' AS serialization_format")
    base.execute(
        "CREATE VIEW messages AS WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n) "
        "SELECT 1 AS topic_id, i AS timestamp, zeroblob(1000000) AS data FROM n"
    )
    assert "another SQLite database" in refused(base.serialize())
    base = sqlite3.connect(":memory:")
    base.execute("CREATE TABLE topics(id, name, type, serialization_format)")
    base.execute("INSERT INTO topics VALUES (1, '/j', 'x', 'cdr')")
    base.execute("CREATE TABLE messages(topic_id, timestamp, data AS (zeroblob(9000)))")
    base.executemany("INSERT INTO messages VALUES (1, ?)", [(i,) for i in range(100)])
    assert "more than its own size in messages" in refused(base.serialize())


def test_a_chunk_that_unpacks_to_too_much_is_refused_unread():
    def bomb(stated, data):
        chunk = Chunk("zstd", data, 0, 0, 0, stated)
        body = struct.pack("<QQQII", 0, 0, stated, 0, 4) + b"zstd" + struct.pack("<Q", len(data)) + data
        assert chunk.uncompressed_size == stated
        return robot_logs.MCAP + b"\1" + struct.pack("<Q", 8) + bytes(8) + b"\6" + struct.pack("<Q", len(body)) + body

    packed = zstandard.compress(bytes(300_000_000))
    assert "too much data when unpacked" in refused(bomb(300_000_000, packed))
    assert "damaged or truncated file" in refused(bomb(1000, packed))


def test_a_table_that_is_far_larger_than_its_file_is_refused(monkeypatch):
    monkeypatch.setattr(robot_logs, "CELLS_MAX", 1000)
    messages = [("/j", 0, joints(START + i, [f"j{i}"], [0.0])) for i in range(40)]
    assert "40 messages and 40 columns, expected at most 1000 cells" in refused(bag(messages, {"/j": JOINTS}))


def test_definitions_in_a_file_are_not_run(tmp_path):
    marker = tmp_path / "marker"
    code = f"open({str(marker)!r}, 'w')"
    definition = f"float64 x\nstring y={code}\nfloat64 z\n  {code}\n'''\n{code}\n'''\n{code}".encode()
    rows, _ = rows_of(mcap(IMU_MESSAGES, {"/imu": IMU}, definition=definition))
    assert len(rows) == 1 + ROWS
    kinds = {"/imu": f"sensor_msgs/msg/Imu'); {code}; ('", "/a": JOINTS}
    assert "no value of joints or accelerations" in refused(mcap(IMU_MESSAGES, kinds, definition=definition))
    assert not marker.exists()


@pytest.mark.parametrize("package", ["rosbags", "mcap", "zstandard", "lz4"])
def test_a_missing_package_is_named(monkeypatch, package):
    data = mcap(IMU_MESSAGES, {"/imu": IMU}, compression=CompressionType.LZ4)
    for name in [name for name in sys.modules if name.partition(".")[0] == package]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, package, None)
    message = refused(data, LackingError)
    expected = f"got a file that needs the package {package}, expected {package} to read it"
    assert message == f"a.bag: {expected}; pip install 'ident-arm[logs]'"


# -------- Phones


def test_the_acceleration_of_a_phone_is_chosen_as_it_stands():
    parts = {
        "Accelerometer.csv": PHONE,
        "Gyroscope.csv": GYRO,
        "meta/device.csv": "property,value",
        "meta/time.csv": "",
    }
    data = archive(parts)
    assert is_binary_log(data)
    assert text_of(data, "a") == (PHONE, ("Accelerometer.csv of the ZIP is read",))
    assert text_of(archive({"my test/Raw Data.csv": PHONE, "__MACOSX/._Raw Data.csv": "x"}), "a") == (PHONE, ())
    assert text_of(archive({"Gyroscope.csv": GYRO}, zipfile.ZIP_STORED), "a") == (GYRO, ())


@pytest.mark.parametrize("name", ["Linear Acceleration x", "Lineare Beschleunigung x", "Accélération linéaire x"])
def test_what_the_phone_has_filtered_is_said(tmp_path, name):
    text = f'"Time (s)";"{name} (m/s²)"\n' + "".join(f"{0.01 * k:.2f};1.5E{k % 2}\n" for k in range(400))
    for file, data in (("a.zip", archive({"Raw Data.csv": text.encode()})), ("a.csv", text.encode())):
        (tmp_path / file).write_bytes(data)
        trace = read_trace(tmp_path / file)
        assert (
            f"{tmp_path / file}: the phone has filtered linear acceleration: do not trust it below 1 Hz" in trace.notes
        )
        assert trace.grades[0].band[0] == 1.0
        assert read_trace(tmp_path / file, {f"{name}": "x"}).grades[0].band[0] == 1.0, "under another name, too"


def test_a_trace_in_a_zip_is_read_from_end_to_end(tmp_path):
    lines = [f"{STEP * i / 1e9},{float(ACCELERATION[i, 0])!r}\n" for i in range(ROWS)]
    (tmp_path / "a.zip").write_bytes(archive({"a.csv": "time [s],x [m/s^2]\n" + "".join(lines)}))
    for values in (
        read_trace(tmp_path / "a.zip").values["x"],
        read_recording(tmp_path / "a.zip").channels[0].values[0],
    ):
        agrees(values, ACCELERATION[:, 0], "formats", "a trace in a ZIP", "Python's zipfile", unit="m/s^2")
    assert [path.name for path in tmp_path.iterdir()] == ["a.zip"]


def test_zip_files_that_are_refused(monkeypatch):
    two = archive({"a.csv": PHONE, "b.csv": PHONE, "c.csv": GYRO})
    assert "3 tables, 2 of them with accelerations: a.csv, b.csv" in refused(two)
    assert "2 tables, 0 of them with accelerations: a.csv, b.csv" in refused(archive({"a.csv": GYRO, "b.csv": GYRO}))
    assert "a ZIP file without a CSV table" in refused(archive({"meta/a.csv": PHONE, "b.txt": ""}), NoChannelError)
    assert "unusual compression" in refused(archive({"a.csv": PHONE}, zipfile.ZIP_BZIP2))
    locked = bytearray(archive({"a.csv": PHONE}))
    locked[locked.index(b"PK\1\2") + 8] |= 1
    assert refused(bytes(locked)).startswith("a.bag/a.csv: got a password")
    data = archive({"a.csv": PHONE})
    assert "a ZIP file of phyphox; export it again" in refused(data[: len(data) // 2])
    assert "1001 files of 0 MB" in refused(archive({f"{i}.txt": "" for i in range(1001)}))
    monkeypatch.setattr(robot_logs, "LARGEST_SAMPLES", 100)
    assert "1 files of 0 MB, expected at most" in refused(data)


def test_an_excel_sheet_and_a_text_are_no_logs():
    assert not is_binary_log(archive({"[Content_Types].xml": "", "a.csv": PHONE}))
    assert not is_binary_log(PHONE.encode())
    assert not is_binary_log(b"")


# -------- Mutations


def mutated(data, random):
    data = bytearray(data)
    for _ in range(random.choice([1, 1, 3, 20])):
        at, kind = random.randrange(len(data)), random.randrange(4)
        if kind == 0:
            data[at] = random.randrange(256)
        elif kind == 1:
            data[at : at + 4] = random.choice([b"\xff" * 4, b"\0" * 4, b"\x7f\xff\xff\xff"])
        elif kind == 2:
            del data[at : at + random.randrange(1, 40)]
        else:
            data[at:at] = data[at : at + random.randrange(1, 40)]
    return bytes(data)


BOTH = ([*arm_messages()[:8], *IMU_MESSAGES[:8]], {"/joint_states": JOINTS, "/imu": IMU})
MADE = {name: store(*BOTH) for name, store in STORAGES.items()}
MADE["a.zip"] = archive({"Accelerometer.csv": PHONE, "Gyroscope.csv": GYRO, "meta/device.csv": "a,b"})


@pytest.mark.parametrize("name", MADE)
def test_a_mutated_file_is_read_or_refused_in_one_line(name):
    chance, refusals = random.Random(name), list[str]()
    for _ in range(100):
        data = mutated(MADE[name], chance)
        try:
            text, remarks = text_of(data, name) if is_binary_log(data) else ("", ())
        except InputError as error:
            refusals.append(str(error))
        else:
            assert isinstance(text, str)
            assert all(len(line.splitlines()) == 1 for line in remarks)
    assert len(refusals) > 20
    assert all(len(line.splitlines()) == 1 and line.startswith(name) for line in refusals)
