"""Excel sheets: what a CSV file says, row by row, with the same checks and messages."""

import builtins
import csv
import io
import zipfile

import openpyxl
import pytest
from arms import DATA
from conformance import agrees

from ident.errors import InputError
from ident.measure import read_campaign, read_log, read_trace

CAMPAIGN = DATA / "lcd_arm" / "campaign.csv"


def cell(text):
    try:
        return float(text)
    except ValueError:
        return text or None


def rows_of(text):
    """Rows as a person would type them: comments in the first column, numbers as numbers."""
    lines = text.splitlines()
    return [[line] if line.startswith("#") else list(map(cell, next(csv.reader([line])))) for line in lines]


def sheet(path, rows, further=()):
    book = openpyxl.Workbook()
    for row in rows:
        book.active.append(row)
    for name in further:
        book.create_sheet(name).append(["notes"])
    book.save(path)
    return path


def test_a_sheet_reads_as_its_csv(tmp_path):
    rows = rows_of(CAMPAIGN.read_text())
    assert any("," in str(row[0]) for row in rows if str(row[0]).startswith("#")), "a comment with a comma"
    again = read_campaign(sheet(tmp_path / "mine.xlsx", rows, further=["notes"]))
    plain = read_campaign(CAMPAIGN)
    assert again == plain
    found, expected = ([m.value for m in each] for each in (again, plain))
    agrees(found, expected, "formats", "a campaign in a spreadsheet", "openpyxl's writer, and the same as CSV")
    assert again.name == "mine"
    assert [m.where.rpartition(":")[2] for m in again] == [m.where.rpartition(":")[2] for m in plain]
    assert again.sha256 != plain.sha256


def test_the_hash_is_that_of_the_file(tmp_path):
    import hashlib

    path = sheet(tmp_path / "mine.xlsx", rows_of(CAMPAIGN.read_text()))
    assert read_campaign(path).sha256 == hashlib.sha256(path.read_bytes()).hexdigest()


@pytest.mark.parametrize(
    ("old", "new"),
    [("4.816,Hz", "4.816,mm"), ("4.816,Hz", "-1,Hz"), ("tip,-z,23.49", "tpi,-z,abc"), ("kind,q1", "kin,q1")],
)
def test_a_mistake_has_the_same_message_and_row(tmp_path, old, new):
    text = CAMPAIGN.read_text()
    assert old in text
    (tmp_path / "bad.csv").write_text(text.replace(old, new, 1))
    sheet(tmp_path / "bad.xlsx", rows_of(text.replace(old, new, 1)))
    messages = []
    for name in ("bad.csv", "bad.xlsx"):
        with pytest.raises(InputError) as error:
            read_campaign(tmp_path / name)
        messages.append(str(error.value).replace(name, "bad"))
    assert messages[0] == messages[1]


def test_empty_rows_and_broken_lines_in_cells_keep_the_rows_count(tmp_path):
    rows = rows_of(CAMPAIGN.read_text())
    rows.insert(6, [])
    rows.insert(7, [None, None])
    rows[5].append("note")
    rows[8] += [None] * (len(rows[5]) - 1 - len(rows[8])) + ["two\nlines"]
    campaign = read_campaign(sheet(tmp_path / "gaps.xlsx", rows))
    assert campaign.measurements[0].where.endswith(":9")
    assert campaign.measurements[0].note == "two lines"
    assert len(campaign) == len(read_campaign(CAMPAIGN))


def test_traces_and_logs_are_read_too(tmp_path):
    table = [["time [s]", "x [mm]", "joint1 [deg]"], *([i / 100, i % 7, i / 10] for i in range(50))]
    path = sheet(tmp_path / "both.xlsx", table)
    text = io.StringIO()
    csv.writer(text).writerows(table)
    (tmp_path / "both.csv").write_text(text.getvalue())
    one, other = (read_trace(tmp_path / f"both.{end}") for end in ("xlsx", "csv"))
    assert one.time.tolist() == other.time.tolist()
    logs = [read_log(tmp_path / f"both.{end}", ["joint1"]) for end in ("xlsx", "csv")]
    assert logs[0].angles["joint1"].tolist() == logs[1].angles["joint1"].tolist()
    assert path.exists()


def other_archive(path):
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("a.txt", "text")


def too_large(path):
    with (
        zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive,
        archive.open("a.txt", "w", force_zip64=True) as file,
    ):
        for _ in range(501):
            file.write(bytes(1_000_000))


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (other_archive, "a damaged file, or another archive"),
        (too_large, "501 MB when unpacked"),
        (lambda path: path.write_bytes(b"PK\x03\x04" + bytes(100)), "a damaged file"),
        (lambda path: sheet(path, []), "no row"),
        (
            lambda path: sheet(path, [["kind", "value"], ["frequency", "=1+1"]]),
            r":2: got the formula =1\+1 without its value",
        ),
        (lambda path: sheet(path, [["kind", "value"], ["#N/A", 3]]), ":2: got #N/A, expected a value"),
    ],
)
def test_what_is_no_sheet_is_refused(tmp_path, make, words):
    path = tmp_path / "bad.xlsx"
    make(path)
    with pytest.raises(InputError, match=words) as error:
        read_campaign(path)
    assert len(str(error.value).splitlines()) == 1


def test_without_openpyxl_the_remedy_is_named(tmp_path, monkeypatch):
    path, imported = sheet(tmp_path / "mine.xlsx", [["kind"]]), builtins.__import__

    def without(name, *rest, **more):
        if name == "openpyxl":
            raise ImportError(name)
        return imported(name, *rest, **more)

    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(InputError, match="pip install openpyxl"):
        read_campaign(path)
