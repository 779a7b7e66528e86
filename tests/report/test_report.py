"""A report as text: the order of its first screen, tables that fit a terminal, what is left for the details."""

import math

import pytest
from reports import too_wide

from ident.inference.parameters import Parameter
from ident.report.report import (
    Finding,
    Report,
    Section,
    Table,
    Verdict,
    folded,
    html_of,
    kept,
    short_power,
    table_lines,
    text_of,
    written,
)
from ident.report.words import with_tied

TABLE = Table("", ("Stiffness", "value [N m/rad]"), (("joint1.k_bend", 7.157e5), ("joint2.k_bend", None)), ("", ".4g"))


def whole(findings=5):
    return Report(
        "Fit of arm to campaign",
        Verdict("NOT USABLE", "The data contradict each other (4.1 sigma). " * 3, "bad"),
        (TABLE,),
        tuple(Finding(f"finding {i}", "mend it") for i in range(1, findings + 1)),
        "All residuals are small.",
        "ident plan campaign.csv",
        (Section("More", ("A paragraph.", TABLE)),),
    )


def test_a_first_screen_says_in_order_what_verdict_answer_residual_findings_next():
    lines = text_of(whole()).splitlines()
    marks = ("Fit of", "RESULT: NOT USABLE.", "Stiffness", "All residuals", "1. finding 1", "3. finding 3", "Next:")
    places = [next(i for i, line in enumerate(lines) if mark in line) for mark in marks]
    assert places == sorted(places)
    assert lines[2].startswith("        "), "the reason goes on under itself"
    assert lines[-1] == "Next: ident plan campaign.csv     More: 2 more findings with --details"


def test_details_have_all_findings_and_sections():
    text = text_of(whole(), details=True)
    assert "5. finding 5 -> mend it" in text
    assert text.index("\n\nMore\n  A paragraph.\n") > text.index("Next:")
    assert "--details" not in text


def test_a_report_without_details_offers_none():
    assert text_of(Report("Written.")) == "Written.\n"


def test_the_verdict_is_coloured_where_that_is_asked():
    assert "\x1b[1;31mNOT USABLE\x1b[0m. The data" in text_of(whole(), colour=True)
    assert "\x1b" not in text_of(whole())


def test_programs_get_verdict_reasons_and_the_next_command():
    judged = whole(1).judged
    assert judged["verdict"] == "NOT USABLE"
    assert judged["reasons"][1:] == ["finding 1"]
    assert judged["next"] == "ident plan campaign.csv"
    assert Report("Written.").judged == {"verdict": None, "reasons": [], "next": None}


def test_a_notebook_shows_the_first_screen_and_nothing_that_a_file_slipped_in():
    table = Table("", ("<b>", "value"), (("<script>alert(1)</script>", 1.0),), ("", ".2f"))
    html = html_of(Report("Fit of <arm>", answer=(table,)))
    assert "<p>Fit of &lt;arm&gt;</p>" in html
    assert "<script" not in html
    assert "<td>1.00</td>" in html


def test_numbers_are_set_to_the_right_under_their_head_and_words_to_the_left():
    assert list(table_lines(TABLE)) == [
        "Stiffness      value [N m/rad]",
        "joint1.k_bend          7.157e5",
        "joint2.k_bend                -",
    ]


@pytest.mark.parametrize("width", [100, 80, 60])
def test_no_row_leaves_the_terminal_whatever_its_words(width):
    rows = tuple((f"a name of many letters {i} " * 3, "words " * 12, 1e5 * i, f"{i} of 12") for i in range(3))
    table = Table(
        "Caption " * 20, ("what", "why", "a long name of a number [N m/rad]", "count"), rows, ("", "", ".4g", "")
    )
    lines = list(table_lines(table, width))
    assert max(map(len, lines)) <= width
    assert "…" in "".join(lines)
    assert all("of 12" in line for line in lines[-3:]), "numbers are never cut"


def test_details_cut_nothing_but_go_on_below():
    table = Table("", ("row", "what"), (("1", "measured " * 20 + "at (0, 0) deg"), ("2", "short")))
    lines = list(table_lines(table, 60, wrap=True))
    assert "…" not in "".join(lines)
    assert lines[-2].strip().endswith("at (0, 0) deg")
    assert lines[-1] == "2    short"
    assert max(map(len, lines)) <= 60


def test_a_head_wider_than_its_numbers_is_broken_only_where_space_is_short():
    rows = tuple((f"row {i}", "w" * 60, 1.0) for i in range(2))
    head = ("row", "words", "predicted from the other kinds [Hz]")
    assert len(list(table_lines(Table("", head, rows)))) > 3
    assert len(list(table_lines(Table("", head, tuple((a, "w", c) for a, _, c in rows))))) == 3


def test_a_head_has_two_lines_where_these_fit_and_tied_numbers_are_not_cut():
    """The fit with damping: names of three tied numbers, and a unit in each row."""
    tied = Parameter(tuple(f"joint{n}.tau_bend" for n in (1, 2, 3)), True, 2e-4, 2e-4)
    two = Parameter(("joint1.k_bend", "joint2.k_bend"), True, 1e5, 1e5)
    assert with_tied(two) == "joint1.k_bend (and joint2.k_bend)"
    head = ("Unknown", "value", "95 % interval", "std. error", "arm file", "fit vs. arm file")
    row = (with_tied(tied), "0.0002029 s", "0.000189 to 0.000217", "3.5 %", "0.0002", "x 0.057")
    lines = list(table_lines(Table("", head, (row, ("joint1.k_bend", "7.154e5 N m/rad", *row[2:])))))
    assert len(lines) == 4
    assert max(map(len, lines)) <= 100
    assert "joint1.tau_bend (3 tied)" in lines[2]


def test_control_characters_of_a_file_are_shown_and_break_no_line():
    lines = list(table_lines(Table("", ("name", "value"), (("a\nb\x1b[2J", "1"),))))
    assert len(lines) == 2
    assert "\x1b" not in lines[1]


@pytest.mark.parametrize(
    ("cell", "form", "text"),
    [
        (7.157e5, ".4g", "7.157e5"),
        (3.5e-5, ".2g", "3.5e-5"),
        (math.nan, ".2f", "-"),
        (None, "", "-"),
        ("x", ".2f", "x"),
    ],
)
def test_a_cell_as_it_is_written(cell, form, text):
    assert written(cell, form) == text
    assert short_power("1e+00 to 2e-10") == "1e0 to 2e-10"


def test_a_table_whose_rows_do_not_fit_its_head_is_refused():
    with pytest.raises(ValueError, match="cells under"):
        Table("", ("a", "b"), (("1",),))
    with pytest.raises(ValueError, match="strong rows"):
        Table("", ("a",), (("1",),), strong=(1,))


def test_a_long_line_is_folded_but_not_where_it_is_kept_together():
    first, *rest = folded("  known to 1 %: " + " ".join(kept("* a^0.5") for _ in range(30)), hang="      ").split("\n")
    assert first.startswith("  known to 1 %: * a^0.5 * a")
    assert all(line.startswith("      * a^0.5") for line in rest)
    assert not too_wide("\n".join([first, *rest]))
    assert folded(f"  a  b  {kept('c d')}") == "  a  b  c d"


def test_the_next_command_is_one_line_to_copy_however_long():
    command = "ident simulate arm.toml --load 'glass + 0.2 kg @ tip' " + " ".join(
        f"--set link{k}.mass=30" for k in range(9)
    )
    lines = text_of(Report("a subject", None, next=command, details=(Section("more", ("words",)),))).splitlines()
    assert lines[-2:] == [f"Next: {command}", "More: --details"]
