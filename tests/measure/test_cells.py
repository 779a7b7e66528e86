"""Names from files of others: as cells of a spreadsheet, as words of a command, and as they are printed."""

import csv
import io
import json
import re
import shlex
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

import ident
from ident.measure.channels import read_channels, recordings_of
from ident.measure.table import DELIMITERS, NUMBER, Findings, csv_text, read_records
from ident.text import as_word

RESULTS = Path(__file__).parents[1] / "data" / "results" / "10"
NASTY = st.text("=+-@';,\t\n \"1ax", max_size=12).map(str.strip)
NAMES = [
    "=HYPERLINK(1)",
    "@y",
    "-z",
    "+1+1",
    "'-z",
    "''=x",
    "a;=1+1;b",
    "a, =cmd|' /C calc'!A0",
    "-5",
    "-5e3",
    "'",
    "y",
]


def read_again(text):
    findings = Findings()
    (_, names), *rows = read_records(text, ",", "f", findings)
    assert not findings
    return [dict(zip(names, cells, strict=True)) for _, cells in rows]


def computed(text):
    """Cells below the comments that a spreadsheet program would compute, by whichever delimiter; -z is no sum."""
    text = re.sub("^#.*\n", "", text, flags=re.M)
    tables = (csv.reader(io.StringIO(text, newline=""), delimiter=mark) for mark in DELIMITERS)
    cells = (cell.strip() for table in tables for row in table for cell in row)
    plain = re.compile(rf"{NUMBER}|[+-][xyz]").fullmatch
    return [cell for cell in cells if cell.startswith(("=", "+", "-", "@")) and not plain(cell)]


@given(st.lists(st.tuples(NASTY, NASTY), min_size=1, max_size=4))
def test_any_text_comes_back(pairs):
    rows = [{"file": "f", "a": a, "b": b} for a, b in pairs]
    assert read_again(csv_text(["file", "a", "b"], rows)) == rows


@given(NASTY)
def test_of_no_text_any_part_is_computed(name):
    assert computed(csv_text(["file", "a"], [{"file": "f", "a": name}])) == []


@pytest.mark.parametrize("name", NAMES)
def test_a_name_that_looks_like_a_formula_is_none_and_comes_back_unchanged(name):
    rows = [{"file": "f", "channel": name, "note": name}]
    text = csv_text(["file", "channel", "note"], rows)
    assert read_again(text) == rows
    assert computed(text) == []


@pytest.fixture
def folder(tmp_path):
    """Recordings as somebody hands them over."""
    folder = tmp_path / "my runs; x"
    folder.mkdir()
    for file in ("=1+1.csv", "-b.csv", "line\nbreak\x1b[2J.csv"):
        names = ["time [s]", "=HYPERLINK(1)", "@y", "-z"]
        samples = "".join(f"{i / 100},{i % 7},{i % 5},{i % 3}\n" for i in range(40))
        (folder / file).write_text(",".join(names) + "\n" + samples)
    return folder


@pytest.mark.parametrize(
    ("command", "table", "proposed"), [("modal", "channels.csv", ""), ("source", "runs.csv", "/runs.csv")]
)
def test_init_writes_no_formula_and_proposes_a_command_that_names_one_folder(run, folder, command, table, proposed):
    code, out, err = run(command, folder.name, "--init")
    assert (code, err) == (0, "")
    assert f"then: ident {command} 'my runs; x{proposed}'" in out
    text = (folder / table).read_text()
    assert computed(text) == []
    rows = read_again(text)
    assert {row["file"] for row in rows} == {path.name for path in folder.iterdir()} - {table}
    assert {row["channel"] for row in rows} >= {"=HYPERLINK(1)", "@y", "-z"}


def test_a_filled_in_table_finds_its_channels_again(run, folder):
    """Saved by a spreadsheet program, which keeps the apostrophes as they are."""
    assert run("modal", folder.name, "--init")[0] == 0
    path = folder / "channels.csv"
    filled = {"role": "response", "point": "tip", "direction": "-z", "unit": "g"}
    rows = [row | filled for row in read_again(path.read_text())]
    path.write_text(csv_text(list(rows[0]), [row | {"q1 [deg]": "-0"} for row in rows]))
    found = read_channels(path)
    recordings = recordings_of(folder, found)
    for row in found.rows:
        assert row.channel in recordings[row.file].names


def test_a_line_break_or_an_escape_in_a_name_is_made_visible(run, folder):
    trace = next(path for path in folder.iterdir() if "\n" in path.name)
    trace.write_text(
        trace.read_text().replace("=HYPERLINK(1)", "x [mm]").replace("@y", "y [mm]").replace("-z", "z [mm]")
    )
    for words in (("spectrum", trace), ("spectrum", trace.with_name("none\x1b.csv")), ("fit", trace)):
        code, out, err = run(*words)
        assert code == (0 if words[1] == trace and words[0] == "spectrum" else 2)
        assert "\x1b" not in out + err
        assert "\\x1b" in out + err
        assert "line\nbreak" not in out + err


def test_a_result_of_others_prints_no_escape(run, tmp_path):
    document = json.loads((RESULTS / "campaign.profile.json").read_text())
    document["report"] |= {"subject": "a\x1b[2Jb", "remark": "c\u202ed"}
    document["notes"] = ["e\x1b[2Jf"]
    (tmp_path / "a.profile.json").write_text(json.dumps(document))
    code, out, err = run("show", "a.profile.json")
    assert (code, err) == (0, "")
    assert out.isascii()
    for words in ("a\\x1b[2Jb", "c\\u202ed", "NOTE: e\\x1b[2Jf"):
        assert words in out


@pytest.mark.parametrize("name", ["a b", "-x.csv", "it's", "$(touch executed)", "a;b", "é.csv", "~", "*.csv", "a\nb"])
def test_a_name_is_one_word_of_a_proposed_command(name):
    (word,) = shlex.split(as_word(name))
    assert not word.startswith("-")
    assert word.removeprefix("./") == name.replace("\n", "\\n")


def test_one_place_writes_cells_and_one_quotes_commands():
    root = Path(ident.__file__).parent
    code = {str(path.relative_to(root)): path.read_text() for path in root.rglob("*.py")}
    assert {name for name, text in code.items() if "shlex." in text} == {"text.py"}
    assert {name for name, text in code.items() if re.search(r"csv\.(Dict)?[wW]riter", text)} == {"measure/table.py"}
