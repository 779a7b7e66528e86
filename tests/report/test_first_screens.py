"""First screens of every command, on shipped data and on the examples of `ident new`: stored reports, rendered.

`tests/data/screens/make.py` has stored them, with the further lines that the command printed: files it wrote.
"""

import json
import re
from dataclasses import replace
from pathlib import Path

import pytest
from numbers_in_text import same_text
from reports import SCREEN, assert_one_screen, too_wide, without_number

from ident.report.document import report_of
from ident.report.report import MOST, Report, Table, table_lines, text_of

SCREENS = sorted((Path(__file__).parents[1] / "data" / "screens").glob("*/*.json"))
PICTURES = Path(__file__).parents[2] / "docs" / "pictures"
COMMANDS = (
    *("fit", "check", "profile", "sample", "validate", "plan", "compare", "predict", "resonance", "simulate"),
    *("spectrum", "sweep", "design", "diagnose", "explore", "fleet", "new", "show", "export", "rerun"),
)
NO_VERDICT = {"predict", "spectrum", "variants", "explore", "export", "new"}
"""What judges nothing, see docs/answers.md; simulate and sweep only do with a limit."""
UNKNOWNS = 8
"""Unknowns that a first screen has room for; each further one has a line of its own."""
NARROW = 80
each_screen = pytest.mark.parametrize("path", SCREENS, ids=lambda path: f"{path.parent.name}-{path.stem}")


def read(path):
    """Return a command, what it reported, and the lines it printed besides."""
    stored = json.loads(path.read_text(encoding="utf-8"))
    return stored["command"].split()[1], stored["report"] and report_of(stored["report"]), stored["further"]


def lines_more(command, report):
    """Lines beyond 25: each unknown above 8, each mode of `modal`, each robot that stands out."""
    tables = [part for part in report.answer if isinstance(part, Table)]
    unknowns = [sum(bool(re.match(r"\w+\.\w+", str(row[0]))) for row in table.rows) for table in tables]
    more = max(0, max(unknowns, default=0) - UNKNOWNS)
    more += len(tables[0].rows) if command == "modal" else 0
    return more + sum(len(table.rows) for table in tables if table.head[0] == "Stands out")


@each_screen
def test_it_is_one_screen_that_begins_with_the_verdict(path):
    command, report, further = read(path)
    text = text_of(report) if report else ""
    assert_one_screen(text + "\n".join(further), extra=lines_more(command, report) if report else 0)
    assert not without_number(text)
    assert "…" not in text, "a cell is cut"
    if report:
        judged = command not in NO_VERDICT and not (command in ("simulate", "sweep") and "limit" not in text)
        assert bool(report.verdict) == judged
        begins = [line for line in text.splitlines()[:3] if line.startswith("RESULT: ")]
        assert len(begins) == judged


@each_screen
def test_a_narrow_terminal_reads_it_too(path):
    _, report, _ = read(path)
    assert not report or not too_wide(text_of(report, width=NARROW), NARROW)


@each_screen
def test_the_cells_of_its_tables_do_not_touch(path):
    _, report, _ = read(path)
    for table in [part for part in report.answer if isinstance(part, Table)] if report else []:
        body = list(table_lines(replace(table, caption="", note="")))[-len(table.rows) or None :]
        for line, cells in zip(body, table.texts, strict=True):
            assert len(re.split(" {2,}", line.strip())) == sum(bool(cell.strip()) for cell in cells), line


@pytest.mark.parametrize(
    "command", [name for name in (*COMMANDS, "modal", "joint") if (PICTURES / f"{name}.txt").exists()]
)
def test_it_is_what_the_manual_shows(command):
    """The manual's answers are compared with the commands' in the slow tier, so that no stored screen grows old."""
    printed = (PICTURES / f"{command}.txt").read_text(encoding="utf-8")
    same = [read(path) for path in SCREENS if path.parent.name == "lcd_arm" and path.stem.endswith(f".{command}")]
    assert any(same_text("\n".join([text_of(report), *further]), printed) for _, report, further in same)


def test_every_command_is_there_for_each_arm():
    there = {arm: set() for arm in ("lcd_arm", "scara", "six-axis")}
    for path in SCREENS:
        there[path.parent.name].add(read(path)[0])
    assert there == {"lcd_arm": {*COMMANDS, "modal", "joint"}, "scara": {*COMMANDS}, "six-axis": {*COMMANDS}}


def test_a_screen_too_long_is_found():
    assert SCREEN == 25
    assert MOST == 3
    with pytest.raises(AssertionError, match="26 lines"):
        assert_one_screen("line\n" * 26)
    table = Table("", ("Stands out", "value"), (("robot1", "1"), ("robot2", "2")))
    assert lines_more("fleet", Report("", answer=(table,))) == 2
    unknowns = Table("", ("Unknown", "value"), tuple((f"joint{i}.k_bend", "1") for i in range(12)))
    assert lines_more("fit", Report("", answer=(unknowns, unknowns))) == 4
    assert lines_more("modal", Report("", answer=(unknowns,))) == 16
