"""Logs of robots and phones as the text of a CSV table: ROS 2 bags (`.db3`, `.mcap`) and ZIP files of phyphox.

A bag gives joints (`sensor_msgs/JointState`) and accelerations (`sensor_msgs/Imu`). Nothing is unpacked to disk, and
nothing in a file is executed: rosbags generates code from message definitions, so only its own are used.
"""

import io
import re
import sqlite3
import zipfile
from collections import Counter
from collections.abc import Iterator
from contextlib import closing
from dataclasses import replace
from itertools import count, pairwise
from pathlib import PurePosixPath
from typing import Any, NamedTuple

from ident.errors import InputError, LackingError, NoChannelError, Problem, refusal, require
from ident.measure.table import csv_text
from ident.text import FILES_MAX, LARGEST_SAMPLES, LARGEST_TEXT, decode, one_line

SQLITE, MCAP, ZIP = b"SQLite format 3\0", b"\x89MCAP0\r\n", b"PK\x03\x04"
"""First bytes of a file of each kind."""
OFFICE = b"[Content_Types].xml"
"""Name of a part of every Excel sheet, which is a ZIP, too."""
KINDS = {SQLITE: "a ROS 2 bag (.db3)", MCAP: "an MCAP file", ZIP: "a ZIP file of phyphox"}


def is_binary_log(data: bytes) -> bool:
    """Whether a file is a ROS 2 bag, an MCAP file or a ZIP other than an Excel sheet, by its content."""
    return data.startswith((SQLITE, MCAP)) or (data.startswith(ZIP) and OFFICE not in data)


def text_of(data: bytes, file: str) -> tuple[str, tuple[str, ...]]:
    """Return a robot's or a phone's file as the text of a CSV table, and remarks in one line each.

    Args:
        data: the bytes of a file that `is_binary_log` accepts.
        file: names it in messages.

    Returns:
        The text: of a bag with a header such as `time [s],joint1 [rad],x [m/s^2]`, a row for each message in the order
        of their stamps, blank cells in the columns of other topics, and numbers that read back exactly.

    Raises:
        NoChannelError: the file has no joints and no accelerations.
        LackingError: a package that reads it is not installed.
        InputError: it is damaged, truncated, too large, or does not say which of its tables is meant.
    """
    try:
        return _phone(data, file) if data.startswith(ZIP) else _bag(data, file)
    except InputError:
        raise
    except Exception as error:  # sqlite3, mcap, rosbags and zipfile let errors of many kinds through
        start, kind = next(each for each in KINDS.items() if data.startswith(each[0]))
        recover = " or try `mcap recover`" if start == MCAP else ""
        remedy = "export it again" if start == ZIP else f"close the recorder before copying{recover}"
        got = f"a damaged or truncated file ({type(error).__name__}: {one_line(str(error))[:80]}".rstrip(": ") + ")"
        raise refusal(file, got, kind, remedy) from None


# -------- Phone
# The one table of a ZIP that has accelerations.

NO_DATA = {"meta", "__MACOSX"}
"""Folders of a ZIP whose tables describe the phone or the archive."""
_ACCELERATION = re.compile(r"\(s\).*m/s(\^2|²)")
"""Units in the header of accelerations over time; names are in the language of the phone."""


def _phone(data: bytes, file: str) -> tuple[str, tuple[str, ...]]:
    tables, remedy = dict[str, str](), "export one sensor alone, or unzip it and name one table"
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        entries, most = archive.infolist(), f"at most {FILES_MAX} of {LARGEST_SAMPLES / 1e6:.0f} MB together"
        size = sum(entry.file_size for entry in entries)
        got, fine = (
            f"{len(entries)} files of {size / 1e6:.0f} MB",
            size <= LARGEST_SAMPLES and len(entries) <= FILES_MAX,
        )
        require(fine, file, got, most, remedy)
        for entry in entries:
            path, where = PurePosixPath(entry.filename), f"{file}/{one_line(entry.filename)}"
            if path.suffix.lower() == ".csv" and not NO_DATA & {*path.parts[:-1]}:
                plain = entry.compress_type in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED) and not entry.flag_bits & 1
                require(plain, where, "a password or an unusual compression", "a plain ZIP", "export it again")
                with archive.open(entry) as part:  # told no size, zipfile unpacks up to 2 GB, whatever the entry states
                    table = decode(part.read(entry.file_size), where, by_instrument=True)
                tables[one_line(entry.filename)] = table
    heads = {name: text.lstrip("\r\n\t ").partition("\n")[0] for name, text in tables.items()}
    names = [name for name, head in heads.items() if len(heads) == 1 or _ACCELERATION.search(head)]
    if not tables:
        raise NoChannelError(Problem(file, "a ZIP file without a CSV table", KINDS[ZIP], "export CSV from phyphox"))
    got = f"{len(tables)} tables, {len(names)} of them with accelerations: {', '.join(names or tables)}"
    require(len(names) == 1, file, got, "one table with accelerations", remedy)
    return tables[names[0]], (f"{names[0]} of the ZIP is read",) * (len(tables) > 1)


# -------- Bag
# Messages of a bag as rows of one table.

JOINTS, IMU = "sensor_msgs/msg/JointState", "sensor_msgs/msg/Imu"
FIELDS = {"position": " [rad]", "velocity": ".velocity [rad/s]", "effort": ".effort [N*m]"}
"""Fields of each joint, and what its name gets in the header: the units are a convention of ROS."""
CONVENTION = "joints are in rad, rad/s and N*m by the convention of ROS; sliding joints would be in m, m/s and N"
CELLS_MAX = 100_000_000
"""Cells of a table, blank ones too: 12 channels at 1 kHz for two hours."""
TIME = "time [s]"


class Message(NamedTuple):
    """A message as its bag stores it, received at a time [ns]."""

    topic: str
    kind: str
    encoding: str
    received: int
    data: bytes


class Row(NamedTuple):
    """What a message says: at its header's stamp [ns], received at a time [ns]; values by column, none of them NaN."""

    stamp: int
    received: int
    columns: tuple[str, ...]
    values: tuple[float, ...]


def _bag(data: bytes, file: str) -> tuple[str, tuple[str, ...]]:
    topics, others = dict[str, list[Row]](), dict[str, None]()
    layouts = dict[tuple[str, ...], tuple[str, ...]]()
    try:
        from rosbags.typesys import Stores, get_typestore

        store = get_typestore(Stores.ROS2_HUMBLE)
        for message in (_mcap_messages if data.startswith(MCAP) else _sqlite_messages)(data, file):
            topic = one_line(message.topic)
            if message.kind not in (JOINTS, IMU) or message.encoding != "cdr":
                others[one_line(f"{topic} ({message.kind} in {message.encoding})")] = None
                continue
            rows = topics.setdefault(topic, [])
            row = _row(message, store, f"{file}, message {len(rows) + 1} of {topic}")
            rows.append(row._replace(columns=layouts.setdefault(row.columns, row.columns)))  # few tuples for many rows
    except ImportError as error:
        package = (error.name or "rosbags").partition(".")[0]
        got, remedy = f"a file that needs the package {package}", "pip install 'ident-arm[logs]'"
        raise LackingError(Problem(file, got, f"{package} to read it", remedy)) from None
    if not any(layouts):
        got = f"no value of joints or accelerations; topics: {', '.join([*topics, *others]) or 'none'}"
        raise NoChannelError(Problem(file, got, f"messages {JOINTS} or {IMU} in cdr", "record such a topic"))
    text, remarks = _table(topics, file)
    return text, (*remarks, *([f"not read: {', '.join(others)}"] if others else []))


def _row(message: Message, store: Any, where: str) -> Row:
    """Return the values of a message."""
    try:
        content = store.deserialize_cdr(message.data, message.kind)
    except Exception as error:
        got, remedy = f"a message that cannot be read ({type(error).__name__})", "record it again, without compression"
        raise refusal(where, got, f"{message.kind} in cdr", remedy) from None
    cells = dict[str, float]()
    if message.kind == IMU and content.linear_acceleration_covariance[0] != -1:  # -1: the sensor has no accelerometer
        cells = {f"{axis} [m/s^2]": getattr(content.linear_acceleration, axis) for axis in "xyz"}
    if message.kind == JOINTS:
        fields = {unit: getattr(content, field).tolist() for field, unit in FIELDS.items()}
        counts, different = {len(content.name), *map(len, filter(None, fields.values()))}, len({*content.name})
        got = f"names and values in numbers of {sorted(counts)}, {different} different names"
        require(counts == {different}, where, got, "a name and a value for each joint", "correct the driver")
        named = enumerate(map(one_line, content.name))
        cells = {name + unit: values[i] for i, name in named for unit, values in fields.items() if values}
    numbers = {name: value for name, value in cells.items() if value == value}
    stamp = content.header.stamp.sec * 10**9 + content.header.stamp.nanosec
    return Row(stamp, message.received, tuple(numbers), tuple(numbers.values()))


def _on_one_clock(rows: list[Row]) -> tuple[list[Row], str]:
    """Return the rows of a topic in the order of their times, and what these are."""
    stamped, clock = [row for row in rows if row.stamp], "times are those of header.stamp"
    if not stamped:
        stamped = [row._replace(stamp=row.received) for row in rows]
        clock = "header.stamp is zero throughout, so times are those of receipt, which jitter"
    if lost := len(rows) - len(stamped):
        clock += f", {lost} more without a stamp left out"
    if late := sum(after.stamp < before.stamp for before, after in pairwise(stamped)):
        clock += f", sorted ({late} came out of order)"
    return sorted(stamped, key=lambda row: row.stamp), f"{len(stamped)} messages, {clock}"


def _table(topics: dict[str, list[Row]], file: str) -> tuple[str, list[str]]:
    """Return the rows of all topics as text, and remarks; columns that several topics have begin with the topic."""
    rows, remarks, columns = list[tuple[str, Row]](), list[str](), list[str]()
    own = {topic: {name: None for row in topics[topic] for name in row.columns} for topic in topics}
    owners = Counter(name.rpartition(" [")[0] for names in own.values() for name in names)
    shared = [topic for topic in topics if any(owners[name.rpartition(" [")[0]] > 1 for name in own[topic])]
    for topic in topics:
        prefix, (ordered, clock) = f"{topic}." if topic in shared else "", _on_one_clock(topics[topic])
        columns += [prefix + name for name in own[topic]]
        rows += [(prefix, row) for row in ordered]
        remarks.append(f"{topic}: {clock}")
    got, most = f"{len(rows)} messages and {len(columns)} columns", f"at most {CELLS_MAX} cells"
    require(len(rows) * (len(columns) + 1) <= CELLS_MAX, file, got, most, "keep the topics of interest alone")
    rows.sort(key=lambda each: each[1].stamp)
    start = rows[0][1].stamp
    remarks.append(f"time 0 is {start // 10**9}.{start % 10**9:09d} s of the log's clock")
    if shared:
        remarks.append(f"columns of {' and '.join(shared)} begin with the topic, as others have the same names")
    if any(name.endswith(unit) for name in columns for unit in FIELDS.values()):
        remarks.append(CONVENTION)
    cells = (
        {TIME: repr((row.stamp - start) / 10**9)}
        | {prefix + name: repr(value) for name, value in zip(row.columns, row.values, strict=True)}
        for prefix, row in rows
    )
    return csv_text([TIME, *columns], cells), remarks


def _sqlite_messages(data: bytes, file: str) -> Iterator[Message]:
    """Yield the messages of a bag of ROS 2's SQLite storage, which is opened in memory and only read."""
    left, calls = len(data), count(1)

    def read(query: str) -> Iterator[tuple[Any, ...]]:
        nonlocal left
        for row in base.execute(query):
            left -= sum(len(cell) if isinstance(cell, bytes | str) else 1 for cell in row)
            require(left >= 0, file, "more than its own size in messages", KINDS[SQLITE], "record it again")
            yield row

    with closing(sqlite3.connect(":memory:")) as base:
        # Bytes 18 and 19 may say that late writes lie in a file next to it, with which SQLite opens nothing in memory.
        base.deserialize(data[:18] + b"\1\1" + data[20:])
        for setting in ("trusted_schema=OFF", "cell_size_check=ON", "query_only=ON"):
            base.execute(f"PRAGMA {setting}")
        base.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, len(data))
        base.set_progress_handler(lambda: next(calls) > 10 + len(data) // 100, 10_000)  # pages in a circle have no end
        tables = {name for (name,) in read("SELECT name FROM sqlite_master WHERE type = 'table' AND rootpage > 0")}
        expected = f"{KINDS[SQLITE]} with the tables topics and messages"
        require({"topics", "messages"} <= tables, file, "another SQLite database", expected, "name the bag's .db3 file")
        rows = read("SELECT id, name, type, serialization_format FROM topics")
        topics = {key: (str(topic), str(kind), str(encoding)) for key, topic, kind, encoding in rows}
        for topic, received, content in read("SELECT topic_id, timestamp, data FROM messages"):
            yield Message(*topics[topic], received, content)


def _mcap_messages(data: bytes, file: str) -> Iterator[Message]:
    """Yield the messages of an MCAP file."""
    import mcap.records as mcap
    from mcap.stream_reader import StreamReader, breakup_chunk

    left, schemas, channels = LARGEST_SAMPLES, dict[int, str](), dict[int, tuple[str, str, str]]()
    reader = StreamReader(io.BytesIO(data), emit_chunks=True, validate_crcs=True, record_size_limit=len(data))
    for record in reader.records:
        records = [record]
        if isinstance(record, mcap.Chunk):
            left -= record.uncompressed_size
            fine, got = record.uncompressed_size <= LARGEST_TEXT and left >= 0, "too much data when unpacked"
            most = f"chunks of {LARGEST_TEXT / 1e6:.0f} MB, together {LARGEST_SAMPLES / 1e6:.0f} MB, at most"
            require(fine, file, got, most, "keep the topics of interest alone")
            unpacked = _unpacked(record.data, record.compression, record.uncompressed_size)
            records = breakup_chunk(replace(record, compression="", data=unpacked), validate_crc=True)
        for each in records:
            if isinstance(each, mcap.Schema):
                schemas[each.id] = each.name
            elif isinstance(each, mcap.Channel):
                channels[each.id] = each.topic, schemas.get(each.schema_id, "no type"), each.message_encoding
            elif isinstance(each, mcap.Message):
                yield Message(*channels[each.channel_id], each.log_time, each.data)


def _unpacked(data: bytes, compression: str, size: int) -> bytes:
    """Return the data of a chunk, to its stated size at most: the reader of mcap would not stop there."""
    import lz4.frame
    import zstandard

    if compression == "zstd":
        return zstandard.ZstdDecompressor().stream_reader(data).read(size)
    return lz4.frame.LZ4FrameDecompressor().decompress(data, max_length=size) if compression == "lz4" else data
