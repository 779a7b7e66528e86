"""Traces: displacement or acceleration by unit, evenly sampled; every mistake with place and remedy."""

import hashlib

import numpy as np
import pytest

from ident.errors import InputError
from ident.measure.trace import parse_trace, read_trace


def parse(text):
    return parse_trace(text.encode(), "trace.csv")


def table(header="time [s],x [mm],z [mm]", times=None, cell="1.5"):
    times = [0.01 * k for k in range(16)] if times is None else times
    columns = header.count(",")
    return "\n".join([header, *(",".join([repr(float(t)), *[cell] * columns]) for t in times)]) + "\n"


def problems(text):
    with pytest.raises(InputError) as caught:
        parse(text)
    return [str(p) for p in caught.value.problems]


def test_a_trace_of_displacement(tmp_path):
    (tmp_path / "trace.csv").write_text(table())
    trace = read_trace(tmp_path / "trace.csv")
    assert (trace.kind, list(trace.values), trace.ignored) == ("displacement", ["x", "z"], ())
    np.testing.assert_allclose(trace.values["z"], np.full(16, 0.0015), rtol=1e-15)
    np.testing.assert_allclose(trace.time, 0.01 * np.arange(16), rtol=1e-15)
    assert trace.interval == pytest.approx(0.01, rel=1e-12)
    assert trace.sha256 == hashlib.sha256(table().encode()).hexdigest()


@pytest.mark.parametrize(
    ("header", "kind", "factor"),
    [
        ("time [s],y [µm]", "displacement", 1e-6),
        ("time [s],Y [m]", "displacement", 1.0),
        ("time [s],y [m/s^2]", "acceleration", 1.0),
        ("time [s],y [mm/s**2]", "acceleration", 1e-3),
        ("time [s],y [g_0]", "acceleration", 9.80665),
    ],
)
def test_the_unit_tells_the_kind(header, kind, factor):
    trace = parse(table(header))
    assert (trace.kind, list(trace.values)) == (kind, ["y"])
    np.testing.assert_allclose(trace.values["y"], np.full(16, 1.5 * factor), rtol=1e-14)


def test_directions_in_their_own_units_and_order():
    trace = parse("trigger,z [m],time [ms],x [mm]\n" + "".join(f"on,0.001,{k},2\n" for k in range(16)))
    assert (list(trace.values), trace.ignored) == (["x", "z"], ("trigger",))
    assert (trace.values["x"][0], trace.values["z"][0]) == pytest.approx((0.002, 0.001), rel=1e-15)


def test_mixed_kinds_are_refused():
    assert problems(table("time [s],x [mm],y [um],z [m/s^2]")) == [
        "trace.csv:1, z: got acceleration in 'm/s^2', expected displacement, as of x; "
        "put displacements and accelerations into two files"
    ]


EITHER = "a length unit such as mm or an acceleration unit such as m/s^2"
BAD_HEADERS = [
    ("time [s],a [mm]", "trace.csv:1: got no direction, expected a column 'x [mm]', or y or z, or in 'm/s^2'; "
     "name the measured directions in the header"),
    ("time [s],x", f"trace.csv:1, x: got no unit, expected {EITHER}, as in 'x [mm]'; "
     "write the unit in square brackets"),
    ("time [s],x [mm/s]", f"trace.csv:1, x: got 'mm/s', expected {EITHER}; correct the unit"),
    ("time [s],x [mm],x [m]", "trace.csv:1, x: got the column twice, expected it once; remove or rename one"),
    ("time [Hz],x [mm]", "trace.csv:1, time: got 'Hz', expected a time unit such as s or ms; correct the unit"),
    ("Tme [s],x [mm]", "trace.csv:1, time: got no such column, expected a column 'time [s]'; rename Tme"),
]  # fmt: skip


@pytest.mark.parametrize(("header", "text"), BAD_HEADERS, ids=[header for header, _ in BAD_HEADERS])
def test_a_bad_header_is_named_once(header, text):
    assert problems(table(header)) == [text]


@pytest.mark.parametrize("cell", ["nan", "inf", "-Infinity"])
def test_what_is_no_finite_number_is_named(cell):
    lines = table().splitlines()
    lines[5] = f"0.04,{cell},1"
    assert problems("\n".join(lines)) == [
        f"trace.csv:6, x: got '{cell}', expected a finite number; give the number or delete the row"
    ]


def with_a_pause(seconds):
    return table(times=[0.01 * k + seconds * (k >= 7) for k in range(20)])


def test_few_uneven_samples_are_refused():
    """Fifty samples are needed to tell a clock that jitters from sampling that does."""
    assert problems(with_a_pause(0.00012)) == [
        "trace.csv, time: got an interval of 0.01012 s before sample 8, from 0.06 s, expected 0.01 s within 1 %, the "
        "median interval; record it again, with the sensor's own clock; if only its times are rounded, write more "
        "digits"
    ]
    (gap,) = problems(with_a_pause(3.0))
    assert gap.endswith("from 0.06 s, expected 0.01 s within 1 %, the median interval; "
                        "cut the recording there, or record it again")  # fmt: skip
    assert parse(with_a_pause(0.0001)).interval == pytest.approx(0.01, rel=1e-3)


def test_times_that_do_not_increase_are_named_and_not_called_uneven():
    times = [0.01 * k for k in range(20)]
    times[9] = times[8]
    assert problems(table(times=times)) == [
        "trace.csv:11, time: got 0.08 s after 0.08 s, expected times that increase; "
        "sort the rows or delete the repeated one"
    ]


def test_too_few_rows():
    assert problems(table(times=[0.1 * k for k in range(15)])) == [
        "trace.csv: got 15 rows, expected at least 16; give a longer recording"
    ]


def test_all_problems_are_told_at_once():
    text = table("time [s],x [mm],y [s],z [m/s^2]", times=[0, 1, 1, 2], cell="?")
    assert [one.split(": got")[0] for one in problems(text)] == [
        "trace.csv:1, y",
        "trace.csv:2, x",
        "trace.csv:2, z",
        "trace.csv:4, time",
        "trace.csv",
        "trace.csv:1, z",
    ]
