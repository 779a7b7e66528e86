"""Report, result file and figure of profiles: what is open, bounded or in doubt is said, and nothing overlaps."""

import math
from dataclasses import replace

import numpy as np
import pytest
from figures import assert_tidy, boxes, made_up

from ident.inference.optima import Ending
from ident.inference.parameters import Parameter
from ident.inference.profile import Interval, Profile, half_width
from ident.present.figures.fit import profile_figure
from ident.present.files.check import profile_rows
from ident.present.text.check import interval_text, profile_report, remarks

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
    report = profile_report(result, profiles)
    lines = report.splitlines()
    for name in result.information.names:
        assert sum(line.startswith(f"  {name[:16]}") for line in lines) >= 2
    assert "95 %, linear" in report
    assert "95 %, profile" in report
    assert "50 %" in report
    assert "68.3 %" in report
    assert "open above, too little tells it on this side" in report
    assert "open below, too little tells it on this side" in report
    assert "bounded below by the model" in report
    assert "only: closed by the profile only" in report
    assert "nan" not in report
    assert "inf" not in report


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"delta_chi_squared": np.linspace(-0.5, 0.0, 23)}, "not the best optimum; fit again with more starts"),
        ({"converged": np.arange(23) != 5}, "did not converge at 1 of"),
        ({"rivals": (math.log(8e5),)}, "another optimum fits about as well outside this interval, at 8e+05"),
    ],
)
def test_what_is_irregular_is_remarked_on(changes, words):
    item = Parameter(("j.k_bend",), True, 3e5, 3e5)
    regular = parabola(item, math.log(3e5))
    assert list(remarks(regular)) == []
    assert any(words in line for line in remarks(replace(regular, **changes)))


def test_flat_and_not_flat_are_told_apart():
    item = Parameter(("j.k_bend",), True, 3e5, 3e5)
    flat, rising = (parabola(item, math.log(3e5), endings=(CROSSED, OPEN), height=h) for h in (0.0, 1.2))
    assert "flat: nothing tells it on this side (as far as 3e+08 delta chi-squared stays zero)" in next(remarks(flat))
    assert "too little tells it on this side (as far as 3e+08 delta chi-squared reaches 1.2 of 3.84)" in next(
        remarks(rising)
    )


def test_intervals_are_written_with_their_open_sides():
    item = Parameter(("j.k_bend",), True, 3e5, 3e5)
    texts = [
        interval_text(p, p.widest)
        for p in (
            parabola(item, math.log(3e5), endings=e) for e in ((CROSSED, CROSSED), (CROSSED, OPEN), (OPEN, CROSSED))
        )
    ]
    assert texts == ["2.72e+05 to 3.309e+05", "above 2.72e+05", "below 3.309e+05"]
    unknown = parabola(item, 1.0, endings=(OPEN, OPEN))
    assert interval_text(unknown, unknown.widest) == "open"


def test_a_doubtful_fit_has_no_interval_to_quote():
    result, profiles = made_up_profiles(6)
    doubtful = replace(result, predicted=result.predicted + 1e-3)
    assert doubtful.doubts
    assert "no interval below is to be quoted" in profile_report(doubtful, profiles)
    figure = profile_figure(doubtful, profiles)
    assert any("No interval is to be quoted" in text.get_text() for text in _key(figure))
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
