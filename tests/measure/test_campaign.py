"""Campaigns: what a good file means, values made in code, and that writing and reading agree."""

import math
import re
from dataclasses import replace
from hashlib import sha256
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ident.errors import InputError
from ident.measure import (
    DRIVE_STATES,
    KINDS,
    Campaign,
    Load,
    Measurement,
    parse_campaign,
    read_campaign,
    write_campaign,
)
from ident.measure.kinds import DIFFERENCES, SHAPES, TWISTS
from ident.measure.load import parse_direction
from ident.measure.reading import COLUMNS, campaign_text

README = Path(__file__).parents[2] / "data" / "README.md"

TABLE = '''\
# made up for this test
kind,q1 [deg],q2 [deg],mode,point,direction,load,reference_load,value,unit,sigma,relative_sigma,note
frequency,0,90.5,Vertical  Bending 1,,,,,4.5,Hz,,0.5%,"first, and ""best"""

# a comment between rows
frequency,0,90.5,,,,glass,,60,rpm,0.6,,
deflection,0,90.5,,tip,,5.5 kg @ tip + glass,,2.5,mm,0.01,,
deflection_difference,0,90.5,,tip,0 0.6 -0.8,20 N -z @ tip,own weight,-3,mm,,0.02,
damping_ratio,0,90.5,,,,,,1.5,%,0.1,,"two
lines"
'''


def parse(text, path="table.csv"):
    return parse_campaign(text.encode(), path)


def european(text, delimiter=";"):
    text = re.sub(r"(\d)\.(\d)", r"\1,\2", re.sub(r",(?! )", "\x00", text))
    return text.replace("\x00", delimiter)


def test_a_file_means_what_it_says():
    campaign = parse(TABLE)
    first, second, third, fourth, fifth = campaign
    posture = (0.0, math.radians(90.5))
    assert all(m.posture == pytest.approx(posture, rel=1e-15) for m in campaign)
    assert (first.kind, first.value, first.mode) == ("frequency", 4.5, "vertical bending 1")
    assert first.sigma == pytest.approx(0.0225)
    assert first.note == 'first, and "best"'
    assert (second.value, second.sigma) == (pytest.approx(1.0), pytest.approx(0.01))
    assert (second.unit, second.mode, second.load) == ("rpm", None, Load(("glass",)))
    assert (third.value, third.point, third.direction) == (pytest.approx(0.0025), "tip", (0, 0, -1))
    assert third.load == Load(("glass",), ((5.5, "tip"),))
    assert (fourth.value, fourth.sigma) == (pytest.approx(-0.003), pytest.approx(6e-5))
    assert fourth.direction == pytest.approx((0, 0.6, -0.8))
    assert fourth.load == Load(forces=(((0.0, 0.0, -20.0), "tip"),))
    assert fourth.reference_load == Load()
    assert (fifth.value, fifth.sigma) == (pytest.approx(0.015), pytest.approx(0.001))
    assert [m.where for m in campaign] == [f"table.csv:{row}" for row in (3, 6, 7, 8, 9)]


def test_a_file_is_known_again(tmp_path):
    path = tmp_path / "second campaign.csv"
    path.write_text(TABLE)
    campaign = read_campaign(path)
    assert (campaign.name, campaign.path) == ("second campaign", str(path))
    assert campaign.sha256 == sha256(TABLE.encode()).hexdigest()


def test_parts_of_a_campaign():
    campaign = parse(TABLE)
    assert len(campaign) == 5
    assert campaign.joints == 2
    assert len(campaign.postures) == 1
    assert len(campaign.of_kind("frequency")) == 2
    assert {m.kind for m in campaign.without("frequency", "deflection")} == {
        "deflection_difference",
        "damping_ratio",
    }


@pytest.mark.parametrize("delimiter", [";", "\t"])
def test_european_files_read_equal(delimiter):
    campaign = parse(european(TABLE, delimiter))
    assert "4,5" in european(TABLE, delimiter)
    assert campaign == parse(TABLE)


@pytest.mark.parametrize(
    "change",
    [
        lambda text: "\ufeff" + text,
        lambda text: text.replace("\n", "\r\n"),
        lambda text: re.sub(r",(?! )", ", ", text),
        lambda text: text.replace("kind,q1 [deg]", "Kind ,Q1[deg]").replace("unit", "UNIT"),
        lambda text: text + ",,,,,,,,,,,,\n\n",
        lambda text: text.replace("0,90.5,", "0,5430,").replace("q2 [deg]", "q2 [arcmin]"),
    ],
    ids=["byte order mark", "crlf", "blanks", "case", "empty rows", "arcmin"],
)
def test_harmless_changes_read_equal(change):
    read, expected = parse(change(TABLE)), parse(TABLE)
    assert [replace(m, posture=(0,)) for m in read] == [replace(m, posture=(0,)) for m in expected]
    for one, other in zip(read, expected, strict=True):
        assert one.posture == pytest.approx(other.posture, rel=1e-15)


@given(st.permutations(range(10)))
@settings(max_examples=30)
def test_columns_in_any_order_read_equal(order):
    rows = [
        ["kind", "q1 [deg]", "q2 [rad]", "mode", "point", "direction", "load", "value", "unit", "sigma"],
        ["frequency", "10", "0.5", "sway", "", "", "glass", "4.5", "Hz", "0.1"],
        ["deflection", "10", "0.5", "", "tip", "x", "", "2.5", "mm", "0.1"],
    ]
    shuffled = "\n".join(",".join(row[column] for column in order) for row in rows)
    assert parse(shuffled) == parse("\n".join(map(",".join, rows)))


def test_every_column_and_kind_is_in_the_readme():
    section = README.read_text().partition("## Campaign CSV")[2].partition("\n## ")[0]
    rows = [line.split("|")[1].strip() for line in section.splitlines() if line.startswith("| `")]
    assert [name for name in COLUMNS if f"`{name}`" not in rows] == []
    assert [name for name in KINDS if f"`{name}`" not in rows] == []
    documented = {row.strip("`") for row in rows[: len(COLUMNS) + 1] if "q1" not in row}
    assert documented == set(COLUMNS)


def test_the_readmes_example_reads():
    section = README.read_text().partition("## Campaign CSV")[2].partition("\n## ")[0]
    example = [line[4:] for line in section.splitlines() if line.startswith("    ")]
    assert {m.kind for m in parse("\n".join(example))} == set(KINDS) - {"deflection"}


@pytest.mark.parametrize(
    ("text", "canonical"),
    [
        ("", "own weight"),
        (" Own Weight ", "own weight"),
        ("glass", "glass"),
        ("5 kg @ tip", "5 kg @ tip"),
        ("5000g@tip  +  glass", "glass + 5 kg @ tip"),
        ("1 kg @ tip + 2 kg @ tip", "3 kg @ tip"),
        ("20 N -z @ tip", "20 N -z @ tip"),
        ("0.02 kN +x @ tip", "20 N x @ tip"),
        ("10 N 0 0.6 -0.8 @ tip", "6 N y @ tip + 8 N -z @ tip"),
        ("20 N z @ tip + 20 N -z @ tip", "own weight"),
    ],
)
def test_loads(text, canonical):
    load = Load.parse(text)
    assert str(load) == canonical
    assert Load.parse(str(load)) == load
    assert bool(load) == (canonical != "own weight")


@pytest.mark.parametrize("text", ["x", "+x", "X", "2 0 0"])
def test_directions(text):
    assert parse_direction(text) == (1.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("change", "column"),
    [
        ({"kind": "speed"}, "kind"),
        ({"value": -1.0}, "value"),
        ({"value": math.nan}, "value"),
        ({"sigma": 0.0}, "sigma"),
        ({"posture": ()}, "posture"),
        ({"posture": (math.inf,)}, "posture"),
        ({"point": "tip"}, "point"),
        ({"drives": "locked"}, "drives"),
        ({"kind": "deflection"}, "point"),
        ({"reference_load": Load(("glass",))}, "reference_load"),
    ],
)
def test_a_measurement_is_checked_when_made(change, column):
    with pytest.raises(InputError) as caught:
        Measurement(**{"kind": "frequency", "posture": (0.1,), "value": 1.0, "sigma": 0.1} | change)
    assert [problem.column for problem in caught.value.problems] == [column]


def test_postures_of_a_campaign_have_the_same_length():
    measurement = Measurement(kind="frequency", posture=(0.1,), value=1.0, sigma=0.1)
    with pytest.raises(InputError, match="2 joint angles, expected 1"):
        Campaign(measurements=(measurement, replace(measurement, posture=(0.1, 0.2))))


SIZES = st.floats(1e-9, 1e9)
NAMES = st.from_regex(r"[A-Za-z][A-Za-z0-9_-]{0,8}", fullmatch=True)
VECTORS = st.tuples(*[st.floats(-1, 1).map(lambda x: x if abs(x) > 1e-6 else 0.0)] * 3).filter(any)
LOADS = st.builds(
    Load,
    st.lists(NAMES.filter(lambda name: name.lower() != "own"), max_size=2, unique=True).map(tuple),
    st.lists(st.tuples(SIZES, NAMES), max_size=2).map(tuple),
    st.lists(st.tuples(VECTORS, NAMES), max_size=2).map(tuple),
)
TEXTS = st.text(st.characters(exclude_categories=("Cs",), exclude_characters="\0"), max_size=20)


@st.composite
def measurements(draw):
    kind = draw(st.sampled_from(sorted(KINDS)))
    value = draw(st.floats(1e-6, 0.999) if kind == "damping_ratio" else SIZES)
    fields = {"kind": kind, "value": value, "sigma": value * draw(st.floats(2e-6, 2)), "load": draw(LOADS)}
    fields |= {"resolution": value * draw(st.just(0.0) | st.floats(1e-6, 2)), "repeat": draw(TEXTS)}
    fields |= {"posture": draw(st.tuples(*[st.floats(-7, 7)] * 2)), "note": draw(TEXTS)}
    if kind in ("frequency", "damping_ratio"):
        return Measurement(mode=draw(st.none() | TEXTS), drives=draw(st.sampled_from(DRIVE_STATES)), **fields)
    if kind in SHAPES:
        places = {"point": draw(NAMES), "reference_point": draw(NAMES) + "0"}
        ways = {"direction": draw(VECTORS), "reference_direction": draw(VECTORS)}
        return Measurement(mode=draw(NAMES), of=draw(st.sampled_from((None, "pole"))), **places, **ways, **fields)
    reference = {"reference_load": Load(("reference",))} if kind in DIFFERENCES else {}
    if kind in TWISTS:
        return Measurement(joint=draw(NAMES), **reference, **fields)
    return Measurement(point=draw(NAMES), direction=draw(VECTORS), **reference, **fields)


@given(st.lists(measurements(), min_size=1, max_size=5, unique_by=lambda m: m.value), st.booleans())
@settings(max_examples=50)
def test_what_is_written_reads_back_equal(made, relative):
    text = campaign_text(Campaign(measurements=tuple(made)), relative_sigma=relative)
    read = parse(text)
    for one, other in zip(made, read, strict=True):
        same = {"value": 0.5 if one.value < 1 else 1.0, "sigma": 1.0, "resolution": 0.0, "posture": (0.0,)}
        assert replace(one, **same) == replace(other, **same)
        assert other.value == pytest.approx(one.value, rel=1e-15, abs=0)
        assert other.sigma == pytest.approx(one.sigma, rel=2e-15, abs=0)
        assert other.resolution == pytest.approx(one.resolution, rel=2e-15, abs=0)
        assert other.posture == pytest.approx(one.posture, rel=1e-15, abs=1e-300)


def test_writing_is_whole_or_not_at_all(tmp_path):
    path = tmp_path / "campaign.csv"
    campaign = parse(TABLE)
    write_campaign(campaign, path, header_comments=["origin: made up", "two\nlines"])
    assert path.read_text().startswith("# origin: made up\n# two\n# lines\nkind,q1 [deg],q2 [deg],")
    assert [m.load for m in read_campaign(path)] == [m.load for m in campaign]
    before = path.read_bytes()
    for bad in (Campaign(), Campaign(measurements=campaign.measurements * 2)):
        with pytest.raises(InputError):
            write_campaign(bad, path)
    assert path.read_bytes() == before
    assert [file.name for file in tmp_path.iterdir()] == ["campaign.csv"]
    with pytest.raises(InputError, match="a file to write"):
        write_campaign(campaign, tmp_path / "absent" / "campaign.csv")


def test_what_a_frequency_is_reads_in_any_case_and_is_written_back():
    text = "kind,q1 [deg],of,value,unit,sigma\nfrequency,1,Acceleration  Peak,4,Hz,1\nfrequency,1,undamped,5,Hz,1\n"
    read = parse_campaign(text.encode(), "a.csv")
    assert [m.of for m in read] == ["acceleration peak", None]
    assert parse_campaign(campaign_text(read).encode(), "b.csv") == read
    assert ",of," not in campaign_text(Campaign(measurements=read.measurements[1:]))


def test_postures_that_look_like_radians_are_asked_about():
    head = "kind,q1 [{0}],q2 [{0}],value,unit,sigma\n"
    rows = "frequency,30,-60,4.5,Hz,0.1\nfrequency,0.52,-1.05,4.4,Hz,0.1\nfrequency,0.79,-1.57,4.4,Hz,0.1\n"
    note = "table.csv: angles of 0.52 -1.05 deg (and 1 more): if they are radians, convert them"
    assert parse(head.format("deg") + rows).notes == (note,)
    assert parse(head.format("rad") + rows).notes == ()
    rng = np.random.default_rng(0)
    campaigns = [read_campaign(path) for path in (README.parent / "lcd_arm").glob("campaign.csv")]
    assert [campaign.notes for campaign in campaigns] == [()]
    near_zero = "".join(f"frequency,{a:.2f},{b:.2f},4.5,Hz,0.1\n" for a, b in rng.normal(0, 0.02, (9, 2)))
    assert parse(head.format("deg") + near_zero).notes == ()
