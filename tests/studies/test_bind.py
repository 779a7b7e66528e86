"""Saved results as one page: the order of the way, what counts on the first page, no folder of anybody's computer."""

import json
import math
import os
import re
import shutil
from importlib import util
from io import BytesIO
from pathlib import Path

import pypdfium2
import pytest
from PIL import Image

import ident
from ident.errors import InputError
from ident.report.document import save
from ident.report.handout import FOLDERS, page_of
from ident.report.page import render
from ident.studies.saved import load

STORED = Path(__file__).parents[1] / "data" / "results" / "10"
NAMES = ("campaign.diagnose.json", "hammer.modal.json", "campaign.fit.json", "runs.source.json", "robots.fleet.json")
FILES = [STORED / name for name in NAMES]


@pytest.fixture(scope="module")
def bound():
    return ident.bind(FILES, title="Robot <7>", signed={"Customer": "A & B", "Signature": ""})


def text_of_pdf(path):
    return "\n".join(page.get_textpage().get_text_range() for page in pypdfium2.PdfDocument(path))


def test_results_come_in_the_order_of_the_way_and_the_diagnosis_counts(bound):
    assert [each.study for each in bound.results] == ["modal", "fit", "fleet", "source", "diagnose"]
    assert bound.sections().verdict == load(FILES[0]).sections().verdict
    without = ident.bind(FILES[1:])
    assert without.sections().verdict == load(STORED / "runs.source.json").sections().verdict
    assert [row[0] for row in without.sections().answer[0].rows] == ["Measured", "Stiffness", "Stiffness", "Cause"]
    assert len(ident.bind([FILES[0], FILES[0]]).results) == 1


def test_the_first_page_has_verdict_cause_remedy_and_lines_to_sign(bound):
    page, report = bound.handout(), load(FILES[0]).sections()
    assert page.verdict == report.verdict
    labels = [label for label, _ in page.summary]
    assert labels[:2] == ["Cause", "Remedy"]
    assert labels[-4:] == ["Measured", "Stiffness", "Stiffness", "Cause"]
    html = render(page)
    assert "<h1>Robot &lt;7&gt;</h1>" in html
    assert "<dd>A &amp; B</dd>" in html
    assert html.count("<h2>") == len(FILES) + 2
    detailed = ident.bind(FILES, details=True).handout()
    assert {section.title for section in report.details} <= {section.title for section in detailed.sections}


def test_the_page_and_the_pdf_name_files_but_no_folders(bound, tmp_path):
    html, pdf = ident.hand_over(bound, tmp_path, pdf=True)
    assert [html.name, pdf.name] == ["report.html", "report.pdf"]
    for text in (html.read_text("utf-8"), text_of_pdf(pdf)):
        assert "robot004.csv" in text
        assert "campaign.csv" in text
        for folder in ("/tmp/robots", "data/lcd_arm", "tests/data", str(tmp_path), str(Path.home()) + "/"):
            assert folder not in text, folder
    assert pdf.stat().st_size < 1_000_000


@pytest.mark.parametrize(
    ("text", "name"),
    [
        ("see /home/her/work/a.csv, row 3", "see a.csv, row 3"),
        ("ident fit 'C:\\Users\\Her Name\\a b.csv' --arm x/y/arm.toml", "ident fit 'a b.csv' --arm arm.toml"),
        ("ident fit '/home/her name/a b.csv'", "ident fit 'a b.csv'"),
        (
            "7.2e5 N m/rad, deg/s^2, value / median, 0.5/1.5, and/or",
            "7.2e5 N m/rad, deg/s^2, value / median, 0.5/1.5, and/or",
        ),
    ],
)
def test_folders_go_and_units_stay(text, name):
    assert FOLDERS.sub("", text) == name


def test_a_path_with_spaces_is_known_by_the_inputs_of_its_result(tmp_path):
    record = {**load(STORED / "campaign.fit.json").record}
    record["inputs"] = {"campaign": {"path": "my robots/the big one/a b.csv", "sha256": "0"}}
    report = load(STORED / "campaign.fit.json").sections()
    report = type(report)(**{**vars(report), "next": "ident fit 'my robots/the big one/a b.csv' --out '/home/x y/z'"})
    html = render(page_of(report, record))
    assert "ident fit &#39;a b.csv&#39;" in html
    assert "big one" not in html
    assert "/home" not in html


def test_figures_of_the_same_call_lie_beside_and_older_ones_stay_out(tmp_path):
    from matplotlib.figure import Figure

    result = tmp_path / "campaign.fit.json"
    shutil.copy(STORED / "campaign.fit.json", result)
    for name in ("campaign.fit.png", "campaign.fit.more.png", "campaign.fitted.png"):
        figure = Figure()
        figure.suptitle(f"title of {name}")
        save(figure, tmp_path / name)
    (section,) = ident.bind([result]).handout().sections
    assert [each.alt for each in section.pictures] == ["title of campaign.fit.png", "title of campaign.fit.more.png"]
    long_ago = result.stat().st_mtime - 3600
    os.utime(tmp_path / "campaign.fit.png", (long_ago, long_ago))
    (section,) = ident.bind([result]).handout().sections
    assert [each.alt for each in section.pictures] == ["title of campaign.fit.more.png"]


@pytest.mark.parametrize("ending", ["png", "jpg"])
def test_a_logo_is_written_again_without_what_else_its_file_says(tmp_path, ending):
    logo, exif = tmp_path / f"logo.{ending}", Image.Exif()
    exif[0x010E] = "secret words"
    exif[0x0112] = 6  # turned, as a phone says it
    Image.new("RGB", (4000, 2000), "red").save(logo, exif=exif, icc_profile=b"her monitor")
    assert b"secret words" in logo.read_bytes()
    bound = ident.bind(FILES[:1], logo=logo)
    with Image.open(BytesIO(bound.logo.png), formats=("PNG",)) as image:
        assert image.size == (400, 800)
        assert "icc_profile" not in image.info
    assert b"secret" not in bound.logo.png
    assert bound.logo.alt == "Logo"
    assert 'class="logo"' in render(bound.handout())


@pytest.mark.parametrize("content", [b"GIF89a", b"", b"\x89PNG\r\n\x1a\n" + bytes(40), b"<svg></svg>"])
def test_a_logo_that_is_no_image_is_one_line(tmp_path, content):
    (tmp_path / "logo.png").write_bytes(content)
    with pytest.raises(InputError, match=r"logo.png: got no readable image, expected a PNG or JPEG image; name"):
        ident.bind(FILES[:1], logo=tmp_path / "logo.png")


def test_no_result_is_one_line():
    with pytest.raises(InputError, match="results: got none, expected at least one saved result"):
        ident.bind([])


def test_files_that_are_no_results_have_a_line_each_and_nothing_is_written(run, tmp_path):
    (tmp_path / "words.json").write_text("words")
    code, _, err = run("bind", FILES[0], tmp_path / "words.json", tmp_path / "none.json", "--pdf")
    assert code == 2
    lines = err.strip().splitlines()
    assert len(lines) == 2
    assert "words.json" in lines[0]
    assert "none.json" in lines[1]
    assert not (tmp_path / "out").exists()


def test_the_command(run, tmp_path):
    code, out, _ = run("bind", *FILES[:3], "--title=Report 7", "--customer=ACME", "--serial=4711", "--pdf")
    assert code == 0
    assert out.startswith("Report 7\nRESULT: ")
    assert "wrote out/report.html\nwrote out/report.pdf" in out
    text = text_of_pdf(tmp_path / "out" / "report.pdf")
    assert re.search(r"Customer\s+ACME", text)
    assert re.search(r"Serial number\s+4711", text)
    assert "Date, signature" in text


def test_without_the_package_a_pdf_is_one_line(run, tmp_path, monkeypatch):
    found = util.find_spec
    monkeypatch.setattr("ident.studies.handout.find_spec", lambda name: None if name == "fpdf" else found(name))
    for words in (("bind", FILES[0], "--pdf"), ("predict", "none.toml", "--pdf")):
        code, _, err = run(*words)
        assert code == 2
        assert "pip install 'ident-arm[pdf]'" in err
        assert len(err.strip().splitlines()) == 1
    assert not list((tmp_path / "out").glob("report*"))


def test_a_page_of_a_command_is_its_report_with_all_details(run, tmp_path):
    arm = Path(__file__).parents[2] / "data" / "lcd_arm" / "arm.toml"
    code, out, _ = run("predict", arm, "--posture=0,0,0", "--page", "--pdf", "--out", tmp_path / "to")
    assert code == 0
    assert [path.name for path in sorted((tmp_path / "to").glob("[!.]*"))] == ["arm.predict.html", "arm.predict.pdf"]
    assert out.count("wrote ") == 2
    html = (tmp_path / "to" / "arm.predict.html").read_text("utf-8")
    assert "lateral torsion 1" in html
    assert html.count("<figure>") == 1
    assert str(arm.parent) not in html
    assert str(arm.parent) not in text_of_pdf(tmp_path / "to" / "arm.predict.pdf")
    assert run("explore", arm, "--page")[0] == 2, "it is a page"


def test_a_page_that_fails_costs_no_result(run, tmp_path):
    """A letter without a font is found when the page is drawn; a font that is none before anything is computed."""
    trace = tmp_path / "\u4e2d.csv"
    trace.write_text("time [s],x [mm]\n" + "".join(f"{k / 100},{math.sin(k)}\n" for k in range(200)))
    code, _, err = run("spectrum", trace, "--pdf", "--font", trace)
    assert code == 2
    assert ".csv: got no readable font" in err
    assert not (tmp_path / "out").exists()
    code, _, err = run("spectrum", trace, "--page", "--font", trace)
    assert (code, "font: got a font without a PDF" in err) == (2, True)
    code, _, err = run("spectrum", trace, "--pdf")
    assert (code, "U+4E2D" in err) == (2, True)
    assert sorted(path.suffix for path in (tmp_path / "out").glob("*.*") if path.name[0] != ".") == [".json", ".png"]


@pytest.mark.parametrize("missing", ["created", "options", "software", "report", "inputs"])
def test_a_file_that_lacks_a_part_is_one_line(tmp_path, missing):
    record = json.loads(FILES[2].read_text())
    del record[missing]
    (tmp_path / "campaign.fit.json").write_text(json.dumps(record))
    with pytest.raises(InputError, match=r"campaign.fit.json: got other contents, expected a result of ident fit"):
        ident.bind([tmp_path / "campaign.fit.json"])
