"""Comparisons that are kept: they fail where a value is off, and `docs/conformance.md` is made and checked by them."""

import re
import sys
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from conformance import FOLDER, GROUPS, MOVED, agrees, counted, records, states, within

sys.path.append(str(Path(__file__).parents[1] / "docs"))

from conformance_page import COUNT, HEAD, PAGE, README, differences, lines_of, main, page_of, rows_of

TESTS = Path(__file__).parent
LINE = "mechanics", "what it is", "another engine"
VALUES = np.array([[0.0, 1.0], [-200.0, 3.0]])
HELD = {
    "relative": partial(agrees, VALUES, VALUES, *LINE, rtol=1e-3),
    "absolute": partial(agrees, VALUES, VALUES, *LINE, atol=1e-9),
    "of the largest": partial(agrees, VALUES, VALUES, *LINE, largest=1e-12),
    "exact": partial(agrees, VALUES, VALUES, *LINE),
    "a number": partial(agrees, 3.0, 3.0, *LINE, rtol=1e-12),
    "integers": partial(agrees, [1, 2], [1, 2], *LINE, rtol=1e-12),
    "complex": partial(agrees, VALUES + 1j, VALUES + 1j, *LINE, rtol=1e-9),
    "zeros": partial(agrees, 1e-16 * VALUES, 0, *LINE, atol=1e-13),
    "a band": partial(within, 4.2, 4.0, 4.5, *LINE),
    "a rate": partial(counted, 95, 100, 89.5, 99.0, *LINE, expected=95),
    "a rate at its end": partial(counted, 100, 100, 90, 100, *LINE, expected=95),
    "a statement": partial(states, True, *LINE, expected="so", computed="so", rule="as stated"),
}
held = pytest.mark.parametrize("comparison", HELD.values(), ids=HELD)


@pytest.fixture
def folder(monkeypatch, tmp_path):
    """Where records of this test go, and not to those of the run."""
    monkeypatch.setenv(FOLDER, str(tmp_path / "records"))
    return tmp_path / "records"


@held
def test_a_value_moved_by_ten_tolerances_fails(comparison, folder, monkeypatch):
    comparison()
    assert [*records(folder)] == [LINE]
    monkeypatch.setenv(MOVED, "mechanics: something else: another engine")
    comparison()
    monkeypatch.setenv(MOVED, ": ".join(LINE))
    with pytest.raises(AssertionError):
        comparison()


@pytest.mark.parametrize("rule", [{"rtol": 1e-3}, {"atol": 1e-3}, {"largest": 1e-3}, {"rtol": 1e-4, "atol": 1e-5}])
@pytest.mark.parametrize("place", [*np.ndindex(2, 2)])
def test_each_entry_is_held_to_its_own_tolerance(rule, place, folder):
    """As NumPy has it: |a - b| <= atol + rtol |b|."""
    expected = np.array([[1.0, 2.0], [-200.0, 3.0]])
    allowed = rule.get("atol", 0) + rule.get("rtol", 0) * np.abs(expected) + rule.get("largest", 0) * 200
    for times, fine in ((0.99, True), (1.01, False)):
        computed = expected.copy()
        computed[place] += times * allowed[place]
        if fine:
            agrees(computed, expected, *LINE, **rule)
        else:
            with pytest.raises(AssertionError):
                agrees(computed, expected, *LINE, **rule)
    ((kept,),) = records(folder).values()
    assert kept["used"] == pytest.approx(0.99)
    assert (kept["expected"], kept["numbers"]) == (-200.0, 4)
    assert kept["test"].startswith("tests/test_conformance.py::test_each_entry_is_held_to_its_own_tolerance[")


def test_nothing_is_kept_where_no_folder_is_named(monkeypatch, tmp_path):
    monkeypatch.delenv(FOLDER, raising=False)
    monkeypatch.chdir(tmp_path)
    agrees(1.0, 1.0, *LINE)
    assert not [*tmp_path.iterdir()]


@pytest.fixture
def lines(folder):
    """The lines of a page, of each kind one."""
    agrees(4.8004, 4.8, "modal", "frequency", "a formula, |x|", rtol=1e-3, unit="Hz")
    for k in (1.0, 2.0):
        agrees([k, -k], [k, -k], "statics", "deflection", "MuJoCo", atol=1e-9, unit="m")
    counted(95, 100, 90, 99, "verdict rates", "intervals", "95 % promised", expected=95)
    within(4.8, 4.7, 4.9, "modal", "4.38 Hz", "the paper", expected="4.38 Hz", note="differs", differs=True)
    return lines_of(folder)


def test_a_page_says_what_is_in_the_records_and_nothing_is_read_otherwise(lines):
    page = page_of(lines)
    assert not differences(page, lines)
    assert [row[2:4] for row in rows_of(page).values()] == [
        ("4.80", "4.7 to 4.9"),
        ("2.000000 m", "2.000000 m"),
        ("4.800 Hz", "4.800 Hz"),
        ("95 of 100", "95 of 100"),
    ]
    assert "1e-09 absolute; 4 numbers<br>*used < 1 %*" in page
    assert "a formula, \\|x\\|" in page
    assert "3 comparisons of 105 numbers agree; [1 do not]" in page


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("| 4.800 Hz | 4.800 Hz |", "| 4.803 Hz | 4.800 Hz |", ""),
        ("| 4.800 Hz | 4.800 Hz |", "| 4.800 Hz | 4.806 Hz |", "computed 4.800 Hz, on the page 4.806 Hz"),
        ("| 95 of 100 | 95 of 100 |", "| 95 of 100 | 97 of 100 |", ""),
        ("| 95 of 100 | 95 of 100 |", "| 95 of 100 | 85 of 100 |", "computed 95 of 100, on the page 85 of 100"),
        ("0.001 relative", "0.01 relative", "0.001 relative"),
        ("| deflection | MuJoCo |", "| deflection | Pinocchio |", "not on the page: statics: deflection: MuJoCo"),
        ("| deflection | MuJoCo |", "| deflections | MuJoCo |", "no comparison any more: statics: deflections: MuJoCo"),
        ("test_", "tested_", "on the page"),
    ],
)
def test_what_the_page_has_otherwise_is_named(lines, old, new, said):
    page = page_of(lines)
    assert old in page
    found = "\n".join(differences(page.replace(old, new), lines))
    assert said in found
    assert bool(found) == bool(said)


def test_two_tests_of_one_line_are_to_be_told_apart(folder, monkeypatch):
    agrees(1.0, 1.0, *LINE)
    monkeypatch.setenv("PYTEST_CURRENT_TEST", "tests/test_x.py::test_other (call)")
    agrees(1.0, 1.0, *LINE)
    with pytest.raises(SystemExit, match="compared in several tests"):
        lines_of(folder)


def test_a_run_without_records_is_no_page(tmp_path):
    with pytest.raises(SystemExit, match="no records"):
        main(str(tmp_path))


def test_the_page_has_its_counts_and_names_tests_that_there_are():
    rows, page = rows_of(PAGE.read_text(encoding="utf-8")), PAGE.read_text(encoding="utf-8")
    agreeing = [place for place in rows if place[0]]
    assert len(rows) > len(agreeing), "what does not agree has a table of its own"
    counts = dict(re.findall(r"^\| \[([\w ]+)\]\(#[\w-]+\) \| (\d+) \|", page, re.MULTILINE))
    assert [*counts] == [*GROUPS]
    for group in GROUPS:
        assert int(counts[group]) == sum(place[0] == group for place in agreeing) > 0
    assert COUNT.search(README.read_text(encoding="utf-8"))[1] == str(len(agreeing))
    assert f"{len(agreeing)} comparisons of" in page
    for row in rows.values():
        file, name = re.fullmatch(r"`(\S+)` `(\w+)`", row[HEAD.index("test")]).groups()
        assert f"def {name}(" in (TESTS / file).read_text(encoding="utf-8"), row
