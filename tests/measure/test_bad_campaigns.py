"""Bad campaign files: each is refused with the place, the column and what to do."""

import re

import pytest

from ident.errors import InputError
from ident.measure import Load, parse_campaign, read_campaign, read_trace


def parse(text):
    return parse_campaign(text.encode(), "table.csv")


def problems(text):
    with pytest.raises(InputError) as caught:
        parse(text)
    return caught.value.problems


HEADER = "kind,q1 [deg],mode,point,direction,load,reference_load,value,unit,sigma,relative_sigma,note\n"
GOOD = "frequency,10,,,,,,4.5,Hz,0.1,,\n"

BAD_ROWS = [
    ("frequency,10,,,,,,4,5,Hz,0.1,,", "", "13 fields.*decimal commas"),
    ("frequency,10,,,,,,4.5,Hz,0.1,", "", "11 fields, so that no cell was read, expected 12"),
    ("frequncy,10,,,,,,4.5,Hz,0.1,,", "kind", "'frequncy'.*write frequency"),
    (",10,,,,,,4.5,Hz,0.1,,", "kind", "got nothing, expected one of frequency"),
    ("frequency,ten,,,,,,4.5,Hz,0.1,,", "q1", "'ten', expected a number"),
    ("frequency,,,,,,,4.5,Hz,0.1,,", "q1", "got nothing, expected a number"),
    ("frequency,nan,,,,,,4.5,Hz,0.1,,", "q1", "'nan', expected a finite number"),
    ("frequency,10,,,,,,,Hz,0.1,,", "value", "nothing"),
    ('frequency,10,,,,,,"4,5",Hz,0.1,,', "value", "'4,5'.*decimal point"),
    ('frequency,10,,,,,,"1.234,5",Hz,0.1,,', "value", "thousands"),
    ("frequency,10,,,,,,1_000,Hz,0.1,,", "value", "'1_000'"),
    ("frequency,10,,,,,,٣,Hz,0.1,,", "value", "expected a number"),
    ("frequency,10,,,,,,inf,Hz,0.1,,", "value", "finite"),
    ("frequency,10,,,,,,1e999,Hz,0.1,,", "value", "finite"),
    ("frequency,10,,,,,,1e308,kHz,0.1,,", "value", "finite"),
    ("frequency,10,,,,,,0,Hz,0.1,,", "value", "above 0"),
    ("frequency,10,,,,,,-4,Hz,0.1,,", "value", "got -4 Hz.*above 0"),
    ("frequency,10,,,,,,4.5,mm,0.1,,", "unit", "'mm', expected a frequency unit"),
    ("frequency,10,,,,,,4.5,1/s,0.1,,", "unit", "ambiguous '1/s'.*write Hz"),
    ("frequency,10,,,,,,4.5,,0.1,,", "unit", "nothing"),
    ("deflection,10,,tip,,,,4.5,mmm,0.1,,", "unit", "'mmm', expected a length unit such as mm; correct"),
    ("damping_ratio,10,,,,,,4.5,mm,0.1,,", "unit", "'mm', expected 1, %"),
    ("damping_ratio,10,,,,,,1.5,,0.1,,", "value", "between 0 and 1"),
    ("damping_ratio,10,,,,,,0,%,0.1,,", "value", "between 0 and 1"),
    ("frequency,10,,,,,,4.5,Hz,,,", "sigma", "nothing.*fill one"),
    ("frequency,10,,,,,,4.5,Hz,0.1,1%,", "sigma", "both"),
    ("frequency,10,,,,,,4.5,Hz,0,,", "sigma", "above 0"),
    ("frequency,10,,,,,,4.5,Hz,-1,,", "sigma", "above 0"),
    ("frequency,10,,,,,,4.5,Hz,nan,,", "sigma", "finite"),
    ("frequency,10,,,,,,4.5,Hz,1%,,", "sigma", "relative_sigma"),
    ("frequency,10,,,,,,4.5,Hz,,5,", "relative_sigma", "'5'.*percent"),
    (
        "frequency,10,,,,,,4.5,Hz,,0.5,",
        "relative_sigma",
        "'0.5', expected a fraction between 0 and 0.2.*write 0.5% if percent is meant",
    ),
    ("frequency,10,,,,,,4.5,Hz,,-1%,", "relative_sigma", "between 0 and 1"),
    ("deflection,10,,tip,,,,0,mm,,1%,", "relative_sigma", "value 0"),
    ("deflection,10,sway,tip,,,,1,mm,0.1,,", "mode", "'sway'.*no mode"),
    ("deflection,10,,,,,,1,mm,0.1,,", "point", "nothing.*name a point"),
    ("frequency,10,,tip,,,,4.5,Hz,0.1,,", "point", "no point"),
    ("frequency,10,,,x,,,4.5,Hz,0.1,,", "direction", "no direction"),
    ("deflection,10,,tip,,,own weight,1,mm,0.1,,", "reference_load", "no reference_load"),
    ("deflection_difference,10,,tip,,,own weight,1,mm,0.1,,", "reference_load", "the load itself"),
    ("deflection_difference,10,,tip,,a + 1 kg @ b,1000 g @ b + a,1,mm,1,,", "reference_load", "itself"),
    ("deflection,10,,tip,up,,,1,mm,0.1,,", "direction", "'up'"),
    ("rotation,10,,tip,,,,1,mrad,0.1,,", "direction", "nothing.*axis that the rotation is about"),
    ("rotation,10,,,y,,,1,mrad,0.1,,", "point", "the point whose body turned"),
    ("rotation,10,,tip,y,,,1,mm,0.1,,", "unit", "'mm', expected an angle unit such as mrad or deg, or mm/m"),
    ("rotation,10,,tip,y,,,1,,0.1,,", "unit", "nothing"),
    ("rotation,10,,tip,y,,own weight,1,mrad,0.1,,", "reference_load", "no reference_load"),
    ("rotation,10,sway,tip,y,,,1,mrad,0.1,,", "mode", "no mode"),
    ("rotation_difference,10,,tip,y,,own weight,1,mrad,0.1,,", "reference_load", "the load itself"),
    ("deflection,10,,tip,0 0 0,,,1,mm,0.1,,", "direction", "zero vector"),
    ("deflection,10,,tip,0 0 nan,,,1,mm,0.1,,", "direction", "finite"),
    ("frequency,10,,,,5 kg tip,,4.5,Hz,0.1,,", "load", "'5 kg tip'.*'5 kg @ tip'"),
    ("frequency,10,,,,5 mm @ tip,,4.5,Hz,0.1,,", "load", "a mass unit"),
    ("frequency,10,,,,20 N @ tip,,4.5,Hz,0.1,,", "load", "a mass unit.*20 N -z @ tip"),
    ("frequency,10,,,,0 kg @ tip,,4.5,Hz,0.1,,", "load", "above 0"),
    ("frequency,10,,,,20 N up @ tip,,4.5,Hz,0.1,,", "load", "x, -z"),
    ("frequency,10,,,,glass + glass,,4.5,Hz,0.1,,", "load", "each payload once"),
    ("frequency,10.0,,,,own weight,,4.50,Hz,,1%,", "", "duplicate of row 2"),
    ('frequency,10,,,,,,4.5,Hz,0.1,,"open', "", "broken row"),
    ('"a\nb",10,,,,,,4.5,Hz,0.1,,', "kind", r"'a\\nb'"),
    (f"{'x' * 500},10,,,,,,4.5,Hz,0.1,,", "kind", "xxx…'"),
]


@pytest.mark.parametrize(("row", "column", "words"), BAD_ROWS, ids=[row[:60] for row, *_ in BAD_ROWS])
def test_a_bad_row_is_named(row, column, words):
    (problem,) = problems(HEADER + GOOD + "# comment\n" + row + "\n")
    assert (problem.where, problem.column) == ("table.csv:4", column)
    assert re.search(words, str(problem))
    assert len(str(problem).splitlines()) == 1
    assert len(str(problem)) < 400


def test_a_repeated_measurement_is_no_duplicate():
    rows = ["frequency,10,sway,,,,,4.5,Hz,0.1,,", "frequency,10,sway,,,,,4.6,Hz,0.1,,", GOOD]
    assert len(parse(HEADER + "\n".join(rows))) == 3


def test_a_duplicate_is_one_whatever_its_unit_sigma_and_note():
    (problem,) = problems(HEADER + GOOD + "frequency,10,,,,,,4500,mHz,9,,again\n")
    assert (problem.where, problem.got) == ("table.csv:3", "a duplicate of row 2")


def test_a_large_share_is_taken_where_percent_is_written():
    assert parse(HEADER + "frequency,10,,,,,,4.5,Hz,,50%,\n").measurements[0].sigma == pytest.approx(2.25)


def test_a_trace_is_named_as_one():
    (problem,) = problems("Time [s],y [mm]\n0,1\n0.1,2\n")
    assert problem.got == "a trace (a column time)"
    assert "`ident modal`" in problem.remedy


BAD_HEADERS = [
    ("kind,q1,value,unit,sigma", "q1", "no unit.*square brackets"),
    ("kind,q1 [],value,unit,sigma", "q1", "no unit"),
    ("kind,q1 [mm],value,unit,sigma", "q1", "'mm', expected an angle unit"),
    ("kind,q2 [deg],value,unit,sigma", "q1", "without a gap"),
    ("knd,q1 [deg],value,unit,sigma", "knd", "'knd'.*write kind"),
    ("kind,q1 [deg],value,unit,relative sigma", "relative sigma", "write relative_sigma"),
    ("kind,q1 [deg],value,units,sigma", "units", "write unit"),
    ("kind,q1 [deg],value,unit,wibble", "wibble", "unknown column 'wibble'"),
    ("kind,q1 [deg],value,unit,", "", "without a name"),
    ("kind,kind,q1 [deg],value,unit,sigma", "kind", "twice"),
    ("kind,q1 [deg],Q1 [rad],value,unit,sigma", "q1", "twice"),
    ("q1 [deg],value,unit,sigma", "kind", "no such column"),
    ("kind,value,unit,sigma", "q1", "no such column"),
    ("kind,q1 [deg],unit,sigma", "value", "no such column"),
    ("kind,q1 [deg],value,sigma", "unit", "no such column"),
    ("kind,q1 [deg],value,unit", "sigma", "sigma or relative_sigma"),
]


@pytest.mark.parametrize(("header", "column", "words"), BAD_HEADERS, ids=[head for head, *_ in BAD_HEADERS])
def test_a_bad_header_is_named_once(header, column, words):
    row = ",".join("1" for _ in header.split(","))
    found = [p for p in problems(f"# comment\n{header}\n{row}\n") if p.where == "table.csv:2"]
    assert any(p.column == column and re.search(words, str(p)) for p in found)
    assert all(p.column != column or p in found for p in problems(f"# comment\n{header}\n{row}\n"))


def test_a_header_problem_does_not_hide_or_multiply_the_rows():
    text = "kind,q1 [deg],pont,value,unit,sigma\ndeflection,1,tip,2,mm,1\ndeflection,x,tip,2,mm,1\n"
    assert [(p.where, p.column) for p in problems(text)] == [("table.csv:1", "pont"), ("table.csv:3", "q1")]


def test_all_problems_are_told_at_once():
    found = problems(HEADER + "frequency,x,,,,,,y,z,0,,\n" + GOOD + "deflection,1,sway,,up,5 tip,a + a,1,mm,,,\n")
    assert [(p.where, p.column) for p in found if p.where.endswith(":2")] == [
        ("table.csv:2", column) for column in ("value", "sigma", "unit", "q1")
    ]
    assert {p.column for p in found if p.where.endswith(":4")} == {
        "mode",
        "point",
        "direction",
        "load",
        "reference_load",
        "sigma",
    }


@pytest.mark.parametrize(
    ("row", "column", "words"),
    [
        ("frequency;1,5;1.5;Hz;0,1", "value", "decimal comma throughout"),
        ("frequency;1,5;1.234,5;Hz;0,1", "value", "thousands"),
        ("frequency;1,5;1,234,567;Hz;0,1", "value", "a number"),
    ],
)
def test_decimal_marks_are_not_mixed(row, column, words):
    (problem,) = problems(f"kind;q1 [deg];value;unit;sigma\nfrequency;1,5;2,5;Hz;0,1\n{row}\n")
    assert (problem.where, problem.column) == ("table.csv:3", column)
    assert re.search(words, str(problem))


def test_a_load_has_the_files_decimal_mark():
    row = "frequency;1,5;2,5 kg @ tip + 0,5 N 0,6 0 -0,8 @ p1-5;2,5;Hz;1"
    (measurement,) = parse(f"kind;q1 [deg];load;value;unit;sigma\n{row}\n")
    assert measurement.load == Load.parse("2.5 kg @ tip + 0.5 N 0.6 0 -0.8 @ p1-5")


@pytest.mark.parametrize(
    ("data", "where", "words"),
    [
        (b"", "bad.csv", "no row"),
        (b"# only\n\n# comments\n", "bad.csv", "no row"),
        (HEADER.encode(), "bad.csv", "only one row"),
        (HEADER.encode() + "# Härte\n".encode("latin-1"), "bad.csv:2", "0xe4.*save the file as UTF-8"),
        (HEADER.encode("utf-16"), "bad.csv", "UTF-16"),
        (b"PK\x03\x04\0\0", "bad.csv", "binary"),
    ],
    ids=["empty", "comments", "header", "latin-1", "utf-16", "binary"],
)
def test_a_file_that_is_no_table(data, where, words):
    with pytest.raises(InputError, match=words) as caught:
        parse_campaign(data, "bad.csv")
    assert [problem.where for problem in caught.value.problems] == [where]


@pytest.mark.parametrize("name", ["absent.csv", ".", "nul\0.csv", "absent/campaign.csv", "a\nb.csv"])
def test_a_path_that_cannot_be_read(tmp_path, name):
    with pytest.raises(InputError, match="a readable CSV file") as caught:
        read_campaign(f"{tmp_path}/{name}")
    assert len(str(caught.value).splitlines()) == 1
    assert ("got a directory" in str(caught.value)) == (name == ".")


@pytest.mark.parametrize(
    ("name", "kind"),
    [("a.UFF", r"a universal file \(UFF\)"), ("a.ods", "a spreadsheet"), ("a.toml", "an arm description")],
)
@pytest.mark.parametrize("read", [read_campaign, read_trace])
def test_a_file_of_another_kind_is_named(name, kind, read, tmp_path):
    with pytest.raises(InputError, match=f"got {kind}, expected a table as CSV; (export it|name the meas)") as error:
        read(tmp_path / name)
    assert len(str(error.value).splitlines()) == 1


@pytest.mark.parametrize(
    ("row", "words"),
    [
        ("frequency,10,dampd,4.5,Hz,0.1", "'dampd', expected one of undamped, pole, .*write damped"),
        ("frequency,10,peak,4.5,Hz,0.1", "'peak', expected one of .*displacement peak, acceleration peak"),
        ("damping_ratio,10,pole,4.5,%,0.1", "'pole', expected nothing, since a damping_ratio has no of"),
    ],
)
def test_what_a_frequency_is_has_a_known_word(row, words):
    (problem,) = problems(f"kind,q1 [deg],of,value,unit,sigma\n{row}\n")
    assert (problem.where, problem.column) == ("table.csv:2", "of")
    assert re.search(words, str(problem))


def test_what_held_the_motors_has_a_known_word():
    found = problems("kind,q1 [deg],drives,value,unit,sigma\nfrequency,10,brakes,4.5,Hz,0.1\nfrequency,10,off,5,Hz,1\n")
    assert [str(problem) for problem in found] == [
        "table.csv:2, drives: got 'brakes', expected one of brake, servo; write brake",
        "table.csv:3, drives: got 'off', expected one of brake, servo; "
        "correct it, or leave the row out if the motors turned freely",
    ]
