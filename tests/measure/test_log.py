"""Logs: columns in any order and unit, and every mistake with the place, the column and what to do."""

import dataclasses
import hashlib
import math
import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ident.errors import InputError
from ident.measure.log import parse_log, read_log

JOINTS = ("joint1", "joint2")
HEADER = "time [s],joint1 [deg],joint2 [rad]\n"
ROWS = ["0,10,0.1", "0.1,11,0.2", "0.2,12,0.3", "0.3,13,0.4", "0.4,14,0.5"]


def parse(text, joints=JOINTS):
    return parse_log(text.encode(), "log.csv", joints)


def table(rows=ROWS, header=HEADER):
    return header + "\n".join(rows) + "\n"


def problems(text, joints=JOINTS):
    with pytest.raises(InputError) as caught:
        parse(text, joints)
    assert len(str(caught.value).splitlines()) == len(caught.value.problems)
    return [str(p) for p in caught.value.problems]


def test_a_log_is_read_in_si_units():
    text = table()
    log = parse(text)
    np.testing.assert_allclose(log.time, [0.0, 0.1, 0.2, 0.3, 0.4], rtol=1e-15)
    np.testing.assert_allclose(log.angles["joint1"], np.deg2rad([10, 11, 12, 13, 14]), rtol=1e-15)
    np.testing.assert_allclose(log.angles["joint2"], [0.1, 0.2, 0.3, 0.4, 0.5], rtol=1e-15)
    np.testing.assert_array_equal(parse("# 12 May\n# " + text).time, log.time, "a header behind # is one")
    assert (log.path, log.sha256, log.ignored) == ("log.csv", hashlib.sha256(text.encode()).hexdigest(), ())
    with pytest.raises(dataclasses.FrozenInstanceError):
        log.path = "other.csv"


@given(
    order=st.permutations(["Time [ms]", "JOINT1 [mrad]", "joint2 [°]", "speed", "torque [N*m]"]),
    delimiter=st.sampled_from(",;\t"),
)
@settings(max_examples=30)
def test_columns_in_any_order_unit_and_delimiter(order, delimiter):
    numbers = {"Time [ms]": [0, 1.5, 3, 4.5], "JOINT1 [mrad]": [1, 2, 3, 4], "joint2 [°]": [0, 0.25, 0.5, 0.75]}
    cells = [[str(numbers[name][row]) if name in numbers else "x" for name in order] for row in range(4)]
    lines = [delimiter.join(line) for line in [order, *cells]]
    log = parse("# of 3 May\n" + "\n\n# more\n".join(lines))
    np.testing.assert_allclose(log.time, [0, 0.0015, 0.003, 0.0045], rtol=1e-14)
    np.testing.assert_allclose(log.angles["joint1"], [0.001, 0.002, 0.003, 0.004], rtol=1e-14)
    np.testing.assert_allclose(np.rad2deg(log.angles["joint2"]), [0, 0.25, 0.5, 0.75], rtol=1e-14)
    assert list(log.angles) == list(JOINTS)
    assert log.ignored == tuple(name for name in order if name in ("speed", "torque [N*m]"))


def test_decimal_commas():
    log = parse("time [s];joint1 [deg];joint2 [deg]\n0;1;2\n0,5;1,5;2\n1;1;2\n1,5;1;2\n")
    np.testing.assert_allclose(log.time, [0, 0.5, 1, 1.5])
    np.testing.assert_allclose(np.rad2deg(log.angles["joint1"][1]), 1.5)


def test_the_joints_come_in_the_order_asked_for(tmp_path):
    (tmp_path / "log.csv").write_text(table())
    log = read_log(tmp_path / "log.csv", ["joint2", "joint1"])
    assert list(log.angles) == ["joint2", "joint1"]
    assert read_log(tmp_path / "log.csv", ["joint2"]).ignored == ("joint1 [deg]",)


NEAT = "sort the rows or delete the repeated one"
FIX = "write a plain number such as 12.5 or 1e-3"
BAD_ROWS = [
    ("0.5,,0.5", "log.csv:8, joint1: got nothing, expected a number; fill the cell"),
    ("0.5,nan,0.5", "log.csv:8, joint1: got 'nan', expected a finite number; give the number or delete the row"),
    ("0.5,15,-inf", "log.csv:8, joint2: got '-inf', expected a finite number; give the number or delete the row"),
    ("0.5,15,1e999", "log.csv:8, joint2: got '1e999', expected a finite number; correct the number"),
    ("0.5,x,0.5", f"log.csv:8, joint1: got 'x', expected a number; {FIX}"),
    (",15,0.5", "log.csv:8, time: got nothing, expected a number; fill the cell"),
    ("0.4,15,0.5", f"log.csv:8, time: got 0.4 s after 0.4 s, expected times that increase; {NEAT}"),
    ("0.35,15,0.5", f"log.csv:8, time: got 0.35 s after 0.4 s, expected times that increase; {NEAT}"),
    (
        "0.5,15",
        "log.csv:8: got 2 fields, so that no cell was read, expected 3, as in the header; "
        "quote text that contains the delimiter, and keep a delimiter for every empty cell",
    ),
    (
        "0,5,15,0.5",
        "log.csv:8: got 4 fields, so that no cell was read, expected 3, as in the header; if these are decimal commas, "
        "write decimal points or separate the columns by semicolons",
    ),
    (
        "0.5,15,11",
        "log.csv:8, joint2: got a jump of 10.5 rad within 0.1 s, 105 rad/s, expected at most 100 rad/s; "
        "check the units in 'joint2 [rad]' and 'time [s]', or remove the outlier",
    ),
    (
        "0.5,15,63",
        "log.csv:8, joint2: got 63 rad, expected at most ten turns, 62.8 rad; "
        "if the angles are in degrees, write 'joint2 [deg]' in the header",
    ),
]


@pytest.mark.parametrize(("row", "text"), BAD_ROWS, ids=[row for row, _ in BAD_ROWS])
def test_a_bad_row_is_named(row, text):
    assert problems("# comment\n" + table([*ROWS, row])) == [text]


def test_what_is_just_within_the_bounds_is_read():
    parse(table([*ROWS, "0.5,15,10.4"]))
    parse(table(["0,0,62.8", "1,0,62.8", "3,0,-62.8", "5,0,62"]))


NO_UNIT = "expected an angle unit such as deg or rad, as in 'joint1 [deg]'; write the unit in square brackets"
BAD_HEADERS = [
    ("time,joint1 [deg],joint2 [rad]", "log.csv:1, time: got no unit, expected a time unit such as s or ms, "
     "as in 'time [s]'; write the unit in square brackets"),
    ("time [deg],joint1 [deg],joint2 [rad]",
     "log.csv:1, time: got 'deg', expected a time unit such as s or ms; correct the unit"),
    ("u [s],joint1 [deg],joint2 [rad]", "log.csv:1, time: got no such column, expected a column 'time [s]'; "
     "say which of u [s] it is (`columns`)"),
    ("tim [s],joint1 [deg],joint2 [rad]", "log.csv:1, time: got no such column, expected a column 'time [s]'; "
     "rename tim"),
    ("time [s],joint1,joint2 [rad]", f"log.csv:1, joint1: got no unit, {NO_UNIT}"),
    ("time [s],joint1 [],joint2 [rad]", f"log.csv:1, joint1: got no unit, {NO_UNIT}"),
    ("time [s],joint1 [mm],joint2 [rad]",
     "log.csv:1, joint1: got 'mm', expected an angle unit such as deg or rad; correct the unit"),
    ("time [s],joint1 [degs/],joint2 [rad]",
     "log.csv:1, joint1: got 'degs/', expected an angle unit such as deg or rad; correct the unit"),
    ("time [s],joint1 [deg/s],joint2 [rad]",
     "log.csv:1, joint1: got 'deg/s', expected an angle unit such as deg or rad; correct the unit"),
    ("time [s],jiont1 [deg],joint2 [rad]", "log.csv:1, joint1: got no such column, expected a column 'joint1 [deg]'; "
     "rename jiont1"),
    ("time [s],elbow [deg],joint2 [rad]", "log.csv:1, joint1: got no such column, expected a column 'joint1 [deg]'; "
     "say which of elbow [deg] it is (`columns`)"),
    ("time [s],joint2 [deg],joint2 [rad],joint1 [deg]", "log.csv:1, joint2: got the column twice, expected it once; "
     "remove or rename one"),
]  # fmt: skip


@pytest.mark.parametrize(("header", "text"), BAD_HEADERS, ids=[header for header, _ in BAD_HEADERS])
def test_a_bad_header_is_named_once(header, text):
    columns = header.count(",") + 1
    rows = [",".join([str(0.1 * k), *["0"] * (columns - 1)]) for k in range(5)]
    assert problems(table(rows, header + "\n")) == [text]


def test_degrees_marked_as_radians_are_caught():
    rows = [f"{0.1 * k:.1f},{10 * k},0" for k in range(10)]
    (text,) = problems(table(rows, "time [s],joint1 [rad],joint2 [rad]\n"))
    assert text.startswith("log.csv:9, joint1: got 70 rad, expected at most ten turns")
    parse(table(rows))


def test_seconds_marked_as_milliseconds_are_caught():
    rows = [f"{0.1 * k:.1f},{10 * k},0" for k in range(10)]
    (text,) = problems(table(rows, "time [ms],joint1 [deg],joint2 [rad]\n"))
    assert text.startswith("log.csv:3, joint1: got a jump of 0.1745 rad within 0.0001 s, 1745 rad/s")


def test_all_problems_are_told_at_once():
    text = table(["0,a,1", "0,2", "1,3,x", "0.5,4,900"], "time [s],joint1 [deg],joint2 [rad]\n")
    assert [one.split(": got")[0] for one in problems(text, ("joint1", "joint2", "joint3"))] == [
        "log.csv:1, joint3",
        "log.csv:3",
        "log.csv:2, joint1",
        "log.csv:4, joint2",
        "log.csv:5, time",
        "log.csv:5, joint2",
    ]


def test_a_column_of_bad_cells_is_one_mistake():
    rows = [f"{k},n/a,0" for k in range(900)]
    assert problems(table(rows)) == [
        f"log.csv:2, joint1: got 'n/a' (also rows 3, 4, 5, 6 and 895 more), expected a number; {FIX}"
    ]
    rows = [f"{k // 2},{k},{k}" for k in range(6)]
    assert problems(table(rows, HEADER.replace("[rad]", "[deg]"))) == [
        "log.csv:3, time: got 0 s after 0 s (also rows 5, 7), expected times that increase; "
        "sort the rows or delete the repeated one"
    ]


@pytest.mark.parametrize(
    ("times", "row"),
    [((-1e300, 0, 1, 2, 3), 3), ((0, 1, 2, 3, 1e300), 6), ((0, 1e-300, 1, 2, 3), 3), ((0, 1e30, 2e30, 3e30, 4e30), 3)],
)
def test_steps_of_time_that_no_recording_has(times, row):
    rows = [f"{time!r},0,{i},0\n" for i, time in enumerate(times)]
    text = "time [s],joint1 [deg],joint2 [deg],joint3 [deg]\n" + "".join(rows)
    with pytest.raises(InputError) as caught:
        parse_log(text.encode(), "path.csv", ["joint1", "joint2", "joint3"])
    first = str(caught.value).splitlines()[0]
    assert first.startswith(f"path.csv:{row}, time: got ")
    assert "expected steps from 1e-09 to 1e+09 s" in first


@pytest.mark.parametrize("rows", [1, 3])
def test_too_few_rows(rows):
    got = f"{rows} row{'s' if rows > 1 else ''}"
    assert problems(table(ROWS[:rows])) == [f"log.csv: got {got}, expected at least 4; give a longer recording"]
    assert len(parse(table(ROWS[:4])).time) == 4


@pytest.mark.parametrize(("text", "got"), [("", "no row"), ("# nothing\n", "no row"), (HEADER, "only one row")])
def test_a_file_that_is_no_table(text, got):
    assert problems(text) == [f"log.csv: got {got}, expected a header and a row for each time; check the file"]


def test_a_file_that_cannot_be_read(tmp_path):
    with pytest.raises(InputError, match="expected a readable CSV file"):
        read_log(tmp_path / "absent.csv", JOINTS)


def test_numbers_too_large_for_their_unit():
    (text,) = problems(table([*ROWS, "1e308,15,0.6"], "time [min],joint1 [deg],joint2 [rad]\n"))
    assert text == "log.csv:7, time: got '1e308', expected a finite number; correct the number or its unit"
    assert math.isfinite(parse(table()).time[-1])


# -------- Logs that no joint can follow
# Each made of one smooth path, written wrongly as controllers and loggers do, and next to its right twin.

H = 0.008


def path_at(time, seed=0, size=40.0):
    """Two joints [deg] that start and end at rest."""
    rng = np.random.default_rng(seed)
    share = np.clip(np.asarray(time) / 12.0, 0, 1)
    rise = share - np.sin(2 * np.pi * share) / (2 * np.pi)
    return np.outer(rng.uniform(0.5, 1.0, 2) * (1, -1), size * rise) + rng.uniform(15, 60, (2, 1))


def written(time, degrees, *, digits=4, time_digits=6):
    rows = (
        f"{t:.{time_digits}f}," + ",".join(f"{q:.{digits}f}" for q in each)
        for t, each in zip(time, degrees.T, strict=True)
    )
    return table(list(rows), HEADER.replace("[rad]", "[deg]"))


EVEN = np.arange(0, 12.4, H)


def held(seed):
    fine = np.arange(0, 12.4, H / 4)
    return written(fine, path_at(EVEN[np.minimum(np.arange(len(fine)) // 4, len(EVEN) - 1)], seed))


def in_bursts(seed):
    number = np.arange(len(EVEN))
    return written(10 * H * (number // 10 + 1) + 2e-4 * (number % 10), path_at(EVEN, seed))


def slow_encoder(seed):
    return written(np.arange(0, 12.4, H / 4), path_at(np.arange(0, 12.4, H / 4), seed, size=3.0), digits=2)


def encoder(seed):
    return written(EVEN, np.round(path_at(EVEN, seed) / 0.011) * 0.011)


def true_uneven(seed):
    time = EVEN + np.random.default_rng(seed).uniform(0, 0.7 * H, len(EVEN))
    return written(time, path_at(time, seed))


def slight_jitter(seed):
    return written(EVEN + 1e-6 * np.random.default_rng(seed).standard_normal(len(EVEN)), path_at(EVEN, seed))


def standing_rows_dropped(seed):
    time = EVEN[(EVEN < 12.0) | (EVEN > 12.35)]
    return written(time, path_at(time, seed))


def dwells(seed):
    time = np.minimum(EVEN, 4.0) + np.maximum(EVEN - 7.0, 0.0)
    return written(EVEN, path_at(time, seed))


def planned_by_place(seed):
    """Equal lengths of a path, at the times of a smooth speed, as a planner writes them."""
    share = np.linspace(0, 1, 120)
    return written(4 * np.arccos(1 - 2 * share), np.outer([50, -80], share) + np.array([[seed], [80]]))


def dwell_at_points(seed):
    """A list of points, the arm held at each for as long as it moves."""
    points = np.repeat(np.random.default_rng(seed).uniform(-150, 150, (2, 20)), 2, axis=1)
    return written(np.arange(40.0), points)


@pytest.mark.parametrize(
    ("make", "note"),
    [
        (held, "log.csv: angles repeat; 1 row of 4 is new, and was read"),
        (in_bursts, "log.csv, time: up to 75 ms off even steps of 8 ms, which were taken instead"),
    ],
)
def test_held_angles_and_times_of_arrival_are_mended(make, note):
    """The path is that of the controller, but for the time at which the bursts are counted to begin."""
    for seed in range(4):
        log = parse(make(seed))
        (said,) = log.notes
        assert re.sub(r"up to \d+ ms", "up to 75 ms", said).replace("7.998 ms", "8 ms") == note
        late = np.polyfit(EVEN[: len(log.time)], log.time - EVEN[: len(log.time)], 0)[0]
        expected = np.deg2rad(path_at(log.time - late, seed))
        np.testing.assert_allclose([*log.angles.values()], expected, atol=2e-3)


@pytest.mark.parametrize(
    "twin",
    [
        *(slow_encoder, encoder, true_uneven, slight_jitter, standing_rows_dropped, dwells),
        *(planned_by_place, dwell_at_points),
    ],
    ids=lambda each: each.__name__,
)
def test_a_right_log_is_left_as_it_is(twin):
    """Sets of six: no line, and every number as in the file."""
    for seed in range(6):
        text = twin(seed)
        rows, log = np.loadtxt(text.splitlines()[1:], delimiter=","), parse(text)
        assert log.notes == ()
        np.testing.assert_array_equal(log.time, rows[:, 0])
        np.testing.assert_allclose(np.rad2deg([*log.angles.values()]), rows[:, 1:].T, atol=1e-9)


@pytest.mark.parametrize("lost", [0.0, 0.01])
def test_late_times_are_taken_as_even_ones(lost):
    """Late by 0.3 ms of 8, half of them; rows may be missing."""
    rng = np.random.default_rng(3)
    late, kept = 3e-4 * (rng.random(len(EVEN)) < 0.5), rng.random(len(EVEN)) >= lost
    log = parse(written((EVEN + late)[kept], path_at(EVEN)[:, kept]))
    (note,) = log.notes
    assert re.fullmatch(r"log\.csv, time: up to 0\.1\d ms off even steps of 8 ms, which were taken instead", note)
    np.testing.assert_allclose(log.time - log.time[0], EVEN[kept], atol=2e-4)
    assert np.diff(log.time).min() == pytest.approx(H, abs=1e-6)


def test_a_clock_in_whole_milliseconds_is_taken_as_even():
    time = np.arange(0, 12.4, 1 / 128)
    log = parse(written(time, path_at(time), time_digits=3))
    assert log.notes == ("log.csv, time: up to 0.5 ms off even steps of 7.812 ms, which were taken instead",)
    np.testing.assert_allclose(log.time, time, atol=1e-4)


def test_a_wrapped_angle_is_unwrapped():
    whole = path_at(EVEN) + np.array([[140], [-40]])
    log = parse(written(EVEN, (whole + 180) % 360 - 180))
    (note,) = log.notes
    row = 2 + int(np.argmax(whole[0] >= 180))
    assert note == f"log.csv:{row}, joint1: jumps by a whole turn were undone, 1 in all"
    np.testing.assert_allclose(np.rad2deg(log.angles["joint1"]), whole[0], atol=1e-4)
    np.testing.assert_allclose(np.rad2deg(log.angles["joint2"]), whole[1], atol=1e-4)
    turning = parse(written(np.arange(8.0), np.outer([360, 1], np.arange(8) % 2)))
    np.testing.assert_allclose(np.rad2deg(turning.angles["joint1"]), 360 * (np.arange(8) % 2))


def test_small_degrees_are_asked_about():
    ask = "log.csv:1: no angle beyond {} deg; for radians write 'joint1 [rad]'"
    assert parse(written(EVEN, np.radians(path_at(EVEN)))).notes == (
        ask.format(f"{np.radians(abs(path_at(EVEN)).max()):.3g}"),
    )
    assert parse(written(EVEN, path_at(EVEN))).notes == ()
    assert parse(written(EVEN, np.radians(path_at(EVEN))).replace("[deg]", "[rad]")).notes == ()
    assert parse(written(EVEN, 0 * path_at(EVEN))).notes == ()


def test_a_gap_while_the_arm_moves_is_noted():
    kept = (EVEN < 5) | (EVEN > 6)
    (note,) = parse(written(EVEN[kept], path_at(EVEN)[:, kept])).notes
    assert note == "log.csv: no row from 4.992 to 6.008 s while the arm moves, 1 such in all; bridged"
