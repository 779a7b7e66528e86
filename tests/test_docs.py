"""The manual: its examples run, its pictures are there, and it is built without a warning and without a network."""

import inspect
import os
import re
import subprocess
import sys
from collections import Counter
from contextlib import redirect_stdout
from io import StringIO
from shutil import copyfile, copytree

import pytest
from commands import TABLE_1
from examples import DOCS, ROOT, examples, pages
from hammer_files import FOLDER as HAMMER
from hammer_files import HAMMER_TEST
from numbers_in_text import same_text
from results import RESULTS

sys.path.append(str(DOCS / "extension"))

from values import MARK, filled

import ident
from ident.cli.command import app
from ident.studies import STUDIES

pytestmark = pytest.mark.slow

PAGES = [page for page in pages() if examples(page)]
PICTURES = DOCS / "pictures"
README = (ROOT / "README.md").read_text(encoding="utf-8")
LARGEST = 120_000
STRICTLY = ("-W", "--keep-going", "-n", "-q")
FROM_ELSEWHERE = re.compile(r"<(?:link|script|img|iframe|source)\b[^>]*(?:src|href)=\"(?:https?:)?//[^\"]*")
SETUP = ("python3 -m venv", "pip install", "python -m pytest")
"""How commands of an installation begin; `.ci/run` has them."""
REDUCED = {
    "simulate": ("--method=fast", "--no-figure"),
    "source": ("--hold-out=run7.csv", "--hold-out=run10.csv", "--no-figure"),
    "balance": ("--speed=200", "--dwell=0.2", "--no-figure"),
}
"""What is added to a command that takes long: the way through it is tested, its numbers are elsewhere."""
READ = ("sample", "sweep", "motion", "design", "variants", "fleet", "--soft-base", "--posterior")
"""Commands, and flags of others, that are read and checked but not computed, as other tests do that."""
MADE = {"ident source data/lcd_arm/runs/runs.csv --arm data/lcd_arm/arm.toml --quiet": "runs.source.json"}
"""Stored results that are put in the place of those of such commands."""
DESCRIBED = ("show",)
"""Commands whose printed answers are compared, though they are no studies."""
STORED = {
    "fleet": "robots.fleet.json",
    "profile": "campaign.profile.json",
    "sample": "campaign.sample.nc",
    "sweep": "arm.extend-200.joint1.k_tors.sweep.json",
}
"""Results that stand for those of functions that take long."""
INSTEAD = {
    'ident.modal_test("data/lcd_arm/hammer")': 'ident.modal_test("few")',
    "ident.fit(result.arm, result.campaign)": 'ident.load("out/hammer.modal.fit.json")',
    'fix="*.k_bend"': 'fix=("joint1.k_bend",)',
}
"""What stands for what takes long: one posture of four, what a command of the page has made already, and the unknowns
of another fit of the page."""


SHELL = [example for page in PAGES for example in examples(page) if example.language == "sh"]
COMMANDS = Counter(tuple(words) for example in SHELL if not example.shown_only for words in example.commands)
"""How often each line stands on all pages."""


@pytest.fixture
def folder(run, tmp_path, monkeypatch):
    (tmp_path / "data").symlink_to(ROOT / "data")
    posture(tmp_path / "few")
    for name, file in STORED.items():
        monkeypatch.setattr(ident, name, standing_for(getattr(ident, name), RESULTS / file))
    return tmp_path


def posture(folder):
    """Make a hammer test of one posture of that of the manual."""
    copytree(HAMMER, folder, ignore=lambda _, names: {name for name in names if "alpha" in name and "60" not in name})
    rows = (folder / "channels.csv").read_text(encoding="utf-8").splitlines(keepends=True)
    kept = [row for row in rows if row.startswith("alpha60") or not row.startswith("alpha")]
    (folder / "channels.csv").write_text("".join(kept), encoding="utf-8")


def standing_for(function, file):
    """What refuses arguments that a function does not take, and returns a stored result."""

    def stored(*given, **named):
        inspect.signature(function).bind(*given, **named)
        return ident.load(file)

    return stored


def on_shelf(words):
    """Whether tests of other files may have run a command, or other pages have it, and it needs shipped files alone."""
    shared = COMMANDS[tuple(words)] > 1 and all("/" not in w or w.startswith("data/") for w in words)
    return shared or tuple(words) in HAMMER_TEST


@pytest.mark.timeout(900)  # programs are compiled, slowly on a machine that others share
@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_examples_run(page, run, folder, shelf, monkeypatch):
    names = {"__name__": "__main__"}
    for example in examples(page):
        if example.shown_only:
            continue
        if example.language == "python":
            with redirect_stdout(StringIO()) as printed:
                exec(compile(reduced(example.text), f"{page}:{example.line}", "exec"), names)
        if example.language == "text":
            assert same_text(printed.getvalue(), example.text)
        for words in example.commands if example.language == "sh" else ():
            made = MADE.get(" ".join(words))
            if made or {*words} & {*READ}:
                assert is_read(words, run, monkeypatch)
            else:
                check(page, words, run, shelf)
            if made:
                (folder / "out").mkdir(exist_ok=True)
                copyfile(RESULTS / made, folder / "out" / made)


def reduced(text):
    for call, other in INSTEAD.items():
        text = text.replace(call, other)
    return text


def is_read(words, run, monkeypatch):
    """Whether a command takes its arguments and flags: it ends where it would set up jax, to compute."""
    reached = []

    def end():
        reached.append(words)
        sys.exit()

    with monkeypatch.context() as patch:
        patch.setattr("ident.cli.running.start", end)
        return run(*words[1:]) == (0, "", "") and bool(reached)


def check(page, words, run, shelf):
    """Run a command, and compare its answer with the one that its page shows."""
    if words[0] != "ident":
        assert " ".join(words).startswith(SETUP), words
        return
    less = REDUCED.get(words[1], ())
    code, out, err = shelf.run(words, run, *less) if on_shelf(words) else run(*words[1:], *less)
    assert code == 0, err
    shown = PICTURES / f"{words[1]}.txt"
    first = next(each for example in examples(page) for each in example.commands if each[:2] == words[:2])
    if page.stem == words[1] and words == first and words[1] in {*STUDIES, *DESCRIBED} - set(REDUCED):
        assert same_text(out, shown.read_text(encoding="utf-8"))


def test_what_one_has_leads_to_a_command(run, folder, monkeypatch):
    """The table of README: each of its commands is understood."""
    typed = re.findall(r"`(ident [^`]*)`", "\n".join(re.findall(r"^\|.*", README, re.MULTILINE)))
    assert len(typed) > 6
    for command in typed:
        assert is_read(command.split(), run, monkeypatch), command


def test_readme_is_short_and_has_the_numbers_that_are_printed():
    """Those of *Too much* and *Cured*, by `ident motion` and `ident diagnose`; 90 lines are what one reads, assumed."""
    assert len(README.splitlines()) <= 90
    printed = "".join((PICTURES / f"{name}.txt").read_text(encoding="utf-8") for name in ("motion", "diagnose"))
    (story,) = re.findall(r"Too much: .*?no part", README, re.DOTALL)
    numbers = re.findall(r"[\d.]+ (?:mm|s)\b", story)
    assert len(numbers) == 6
    assert all(number in printed for number in numbers)


def test_a_command_that_is_not_understood_is_told(run, folder, monkeypatch):
    assert is_read(["ident", "sweep", "data/lcd_arm/arm.toml", "--vary", "speed=4:20:17"], run, monkeypatch)
    assert not is_read(["ident", "sweep", "data/lcd_arm/arm.toml", "--vary", "speed=4:20:many"], run, monkeypatch)
    assert not is_read(["ident", "sweep", "data/lcd_arm/arm.toml", "--varied", "speed"], run, monkeypatch)
    with pytest.raises(TypeError):
        ident.sweep("data/lcd_arm/arm.toml", varied="speed")


def test_commands_that_other_tests_run_for_the_pages_stand_there():
    assert {*HAMMER_TEST, TABLE_1} <= {*COMMANDS}
    assert on_shelf(TABLE_1)


def test_what_is_only_shown_says_why():
    comments = sum(page.read_text(encoding="utf-8").count("shown only") for page in PAGES)
    assert comments == sum(example.shown_only for page in PAGES for example in examples(page))


def test_every_command_has_a_page_with_its_help_and_options():
    names = {path.stem for path in (DOCS / "commands").glob("*.md")} - {"index"}
    assert names == {command.name for command in app.registered_commands}
    for name in names:
        text = (DOCS / "commands" / f"{name}.md").read_text(encoding="utf-8")
        assert f"```{{command-help}} {name}\n" in text
        assert name not in STUDIES or f"```{{options}} {name}\n" in text


def test_pictures_are_small_and_shown():
    shown = {name for page in pages() for name in re.findall(r"pictures/([\w.]+)", page.read_text(encoding="utf-8"))}
    assert shown == {path.name for path in PICTURES.iterdir()}
    assert all(path.stat().st_size < LARGEST for path in PICTURES.iterdir())


@pytest.fixture(scope="module")
def manual(tmp_path_factory):
    """The manual as HTML, built anew."""
    out = tmp_path_factory.mktemp("manual")
    command = [sys.executable, "-m", "sphinx", *STRICTLY, "-d", out / "tree", DOCS, out / "html"]
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    done = subprocess.run(command, capture_output=True, text=True, env=environment, check=False)
    assert done.returncode == 0, done.stderr
    return out / "html"


def test_the_manual_needs_no_network(manual):
    written = list(manual.rglob("*.html"))
    assert len(written) > 30
    for page in written:
        text = page.read_text(encoding="utf-8")
        assert not FROM_ELSEWHERE.findall(text), page
    for style in manual.rglob("*.css"):
        assert not re.findall(r"url\([\"']?(?:https?:)?//|@import", style.read_text(encoding="utf-8")), style


def test_the_manual_in_a_browser(manual, browser_page):
    for page in sorted(manual.rglob("*.html")):
        with browser_page(page, 1300, 900) as opened:
            assert not opened.complaints, page
            assert not opened.broken_images, page
            assert all(address.startswith("file:") for address in opened.requests), page
            assert opened.overhang <= 0, page


def test_pages_show_the_numbers_that_the_manual_computes():
    """As the manual is built they are put in their places; who reads the page as it is sees the same."""
    pages = [page for page in DOCS.glob("*.md") if MARK.search(page.read_text(encoding="utf-8"))]
    assert {page.name for page in pages} == {"assumptions.md"}
    for page in pages:
        text = page.read_text(encoding="utf-8")
        assert filled(MARK.sub(r"\1 none \4", text)) == text, "it does not come from the page"
        assert "| 22 | -0.277 % |" in text
        assert "| 100 | -0.050 % |" in text


def test_the_texts_are_compared():
    assert same_text("a 1.00 mm,  b", "a 1.01 mm, b")
    assert not same_text("a 1.00 mm", "a 1.1 mm")
    assert not same_text("a 1 mm", "b 1 mm")
    assert not same_text("joint1.k_bend", "joint2.k_bend")
