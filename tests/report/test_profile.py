"""Report, result file and figure of profiles: what is open, bounded or in doubt is said, and nothing overlaps."""

import math
from dataclasses import replace

import numpy as np
import pytest
from figures import assert_tidy, boxes, made_up
from reports import assert_one_screen, too_wide, without_number

from ident.inference.optima import Ending
from ident.inference.parameters import Parameter
from ident.inference.profile import Interval, Profile, half_width
from ident.report.report import text_of
from ident.studies.stiffness.profile_figure import profile_figure
from ident.studies.stiffness.profile_report import interval_text, profile_rows, profile_sections

OPEN, CROSSED, MODEL = Ending.OPEN, Ending.CROSSED, Ending.MODEL
LEVELS = (0.5, 0.683, 0.95)


def parabola(item, optimum, *, sd=0.05, endings=(CROSSED, CROSSED), height=1.0, **changes):
    """A made-up profile: a parabola on crossed sides, on open ones an increase to `height` that stays there."""
    below, above = (np.linspace(0, 2.2 * 0.05 if e is CROSSED else math.log(1000), 12) for e in endings)
    sides = [
        (d / 0.05) ** 2 if e is CROSSED else height * np.tanh(d) for d, e in zip((below, above), endings, strict=True)
    ]
    intervals = []
    for level in LEVELS:
        ends = []
        for e, sign, d in ((endings[0], -1, below), (endings[1], 1, above)):
            reach = {CROSSED: 0.05 * half_width(level), OPEN: math.inf, MODEL: d[-1]}[e]
            ends.append(optimum + sign * reach)
        intervals.append(Interval(level, *ends, endings))
    theta = np.concatenate([optimum - below[:0:-1], optimum + above])
    delta = np.concatenate([sides[0][:0:-1], sides[1]])
    regular = Profile(item, optimum, sd, theta, delta, np.ones(len(theta), bool), tuple(intervals), ())
    return replace(regular, **changes)


def made_up_profiles(count, **changes):
    """A made-up fit, and one profile for each of its parameters, of all kinds of ending in turn."""
    result = made_up(count, 8)
    kinds = [(CROSSED, CROSSED), (CROSSED, OPEN), (OPEN, CROSSED), (OPEN, OPEN), (MODEL, CROSSED), (CROSSED, MODEL)]
    items = result.problem.parameters.items
    return result, tuple(
        parabola(item, float(theta), endings=kinds[i % 6], sd=math.inf if i % 3 == 2 else 0.05, **changes)
        for i, (item, theta) in enumerate(zip(items, result.best.theta, strict=True))
    )


def test_the_report_shows_linear_and_profile_intervals_and_every_reason():
    result, profiles = made_up_profiles(6)
    report = profile_sections(result, profiles)
    names = result.information.names
    (table,) = report.answer
    assert [row[0] for row in table.rows] == list(names)
    (levels,), sides = (section.parts for section in report.details[1:])
    assert [row[0] for row in levels.rows] == list(names)
    assert levels.head == ("unknown", "50 %", "68.3 %", "95 %")
    begins = (f"{names[1]} above", f"{names[2]} below", f"{names[3]} below", f"{names[3]} above")
    assert all(line.startswith(f"{word}: ") for line, word in zip(sides, begins, strict=True))
    findings = [finding.text for finding in report.findings]
    assert any(f"no upper bound for {names[1]}, {names[3]}" in text for text in findings)
    assert any("bounded below by the model" in text for text in findings)
    text = text_of(report, details=True)
    assert "closed: the profile has an end there" in text
    assert not without_number(text)
    assert not too_wide(text)
    assert_one_screen(text_of(report), files=2)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"delta_chi_squared": np.linspace(-0.5, 0.0, 23)}, "below the fit's -> fit again with more starts"),
        ({"converged": np.arange(23) != 5}, "did not converge at 1 of"),
        ({"rivals": (math.log(8e5),)}, "another optimum fits about as well outside this interval, at 8.000e5 N m/rad"),
    ],
)
def test_what_is_irregular_is_remarked_on(changes, words):
    result, _ = made_up_profiles(1)
    regular = parabola(Parameter(("j.k_bend",), True, 3e5, 3e5), math.log(3e5))
    assert profile_sections(result, [regular]).findings == ()
    assert profile_sections(result, [regular]).verdict.word == "CONFIRMED"
    (finding,) = profile_sections(result, [replace(regular, **changes)]).findings
    assert words in f"{finding.text} -> {finding.remedy}"


@pytest.mark.parametrize(
    ("changes", "word"),
    [
        ({}, "CONFIRMED"),
        ({"sd": 0.07}, "PARTLY 1 OF 2"),
        ({"rivals": (math.log(8e5),)}, "PARTLY 1 OF 2"),
        ({"delta_chi_squared": np.linspace(-0.5, 0.0, 23)}, "NOT USABLE"),
    ],
)
def test_the_verdict_is_by_the_profiles(changes, word):
    result, _ = made_up_profiles(1)
    regular = parabola(Parameter(("j.k_bend",), True, 3e5, 3e5), math.log(3e5))
    assert profile_sections(result, [regular, replace(regular, **changes)]).verdict.word == word


def test_flat_and_not_flat_are_told_apart():
    result, _ = made_up_profiles(1)
    item = Parameter(("j.k_bend",), True, 3e5, 3e5)
    profiles = [parabola(item, math.log(3e5), endings=(CROSSED, OPEN), height=h) for h in (0.0, 1.2)]
    assert profile_sections(result, profiles).details[-1].parts == (
        "j.k_bend above: chi-squared rises by 0 up to 3.000e8 and stays flat.",
        "j.k_bend above: chi-squared rises by 1.2 up to 3.000e8.",
    )


def test_intervals_are_written_with_their_open_sides():
    item = Parameter(("j.k_bend",), True, 3e5, 3e5)
    texts = [
        interval_text(p, p.widest)
        for p in (
            parabola(item, math.log(3e5), endings=e) for e in ((CROSSED, CROSSED), (CROSSED, OPEN), (OPEN, CROSSED))
        )
    ]
    assert texts == ["2.720e5 to 3.309e5", "above 2.720e5", "below 3.309e5"]
    unknown = parabola(item, 1.0, endings=(OPEN, OPEN))
    assert interval_text(unknown, unknown.widest) == "open"


def test_a_doubtful_fit_has_no_interval_to_quote():
    result, profiles = made_up_profiles(6)
    doubtful = replace(result, predicted=result.predicted + 1e-3)
    assert doubtful.doubts
    assert profile_sections(doubtful, profiles).verdict.word == "NOT USABLE"
    figure = profile_figure(doubtful, profiles)
    assert any("Use no interval" in text.get_text() for text in _key(figure))
    assert_tidy(figure)


def test_an_open_end_is_infinite_in_the_table():
    _, profiles = made_up_profiles(6)
    rows = profile_rows(profiles)
    assert [row["parameter"] for row in rows] == [profile.name for profile in profiles]
    assert rows[1]["low_95"] < rows[1]["value"] < rows[1]["high_95"] == math.inf


@pytest.mark.parametrize("count", [1, 2, 6, 11])
def test_the_figure_has_a_panel_for_each_and_nothing_overlaps(count):
    result, profiles = made_up_profiles(count)
    figure = profile_figure(result, profiles)
    panels = [axes for axes in figure.axes if axes.axison]
    assert len(panels) == count
    assert all("[" in axes.get_xlabel() for axes in panels)
    assert panels[0].get_ylabel().endswith("[-]")
    assert sum(t.get_text() == "open" for a in panels for t in a.texts) == sum(
        e is OPEN for p in profiles for e in p.widest.endings
    )
    assert_tidy(figure)
    assert any("95 %" in text for text, _ in boxes(figure))


def test_a_fall_below_the_optimum_is_drawn_and_said():
    result, profiles = made_up_profiles(2)
    fallen = tuple(
        replace(p, delta_chi_squared=p.delta_chi_squared - 2 * np.exp(-((p.theta - p.theta[-3]) ** 2) / 1e-4))
        for p in profiles
    )
    figure = profile_figure(result, fallen)
    assert figure.axes[0].get_ylim()[0] < fallen[0].delta_chi_squared.min()
    assert any("not the best optimum" in text.get_text() for text in _key(figure))
    assert_tidy(figure)


def test_values_are_physical():
    one = parabola(Parameter(("link.com.x",), False, 0.1, 0.1, 1.0, 0.1), 1.0)
    np.testing.assert_allclose(one.values([1.0, 1.1]), [0.1, 0.11])


def _key(figure):
    return [figure.legends[0].get_title(), *figure.legends[0].get_texts()]
