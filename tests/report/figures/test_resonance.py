from dataclasses import replace

import numpy as np
import pytest
from arms import DATA, first_guess_arm
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.text import Annotation
from reports import assert_one_screen, too_wide

from ident.description.file import read_arm
from ident.report.report import text_of
from ident.studies.scenario import Basis
from ident.studies.working.resonance_figure import resonance_figure
from ident.studies.working.resonance_report import (
    grouped,
    passage,
    resonance_rows,
    resonance_sections,
    same_lines,
    sources_words,
)
from ident.vibrate.branches import branches
from ident.vibrate.motion import stroke
from ident.vibrate.resonance import Source, excitation, resonance_crossings

FILE = read_arm(DATA / "lcd_arm" / "first_guess.toml")
MOTION = stroke(first_guess_arm().stroke, percent=10)
TIMES = np.linspace(0, float(MOTION.breaks[-1]), 401)


@pytest.fixture(scope="module")
def plain():
    found, driven = branches(first_guess_arm(), MOTION, times=TIMES), excitation(first_guess_arm(), MOTION, times=TIMES)
    return found, driven, resonance_crossings(found, driven)


@pytest.fixture(scope="module")
def with_sets(plain):
    """Draws of torsional stiffnesses: as if they moved the lateral branches alone, and these by a factor."""
    found, driven, _ = plain
    lateral = np.array([str(label).startswith("lateral") for label in found.labels])
    factors = np.where(lateral[:, None, None], np.linspace(0.9, 1.1, 5), 1.0)
    ratio = np.repeat(found.damping_ratio[..., None], 5, -1)
    found = replace(found, frequency=found.frequency[..., None] * factors, damping_ratio=ratio)
    return found, driven, resonance_crossings(found, driven)


def written(axes):
    return [text for text in axes.texts if isinstance(text, Annotation)]


def test_every_branch_pulley_and_crossing_is_named(plain):
    found, driven, met = plain
    upper, lower = resonance_figure(found, driven, met, title="extension").axes
    words = [text.get_text() for text in written(upper)]
    assert set(map(str, found.labels)) <= set(words)
    assert "pulley 2" in words
    assert "pulleys 1 and 3" in words
    numbers = [word for word in words if word.isdigit()]
    assert sorted(map(int, numbers)) == list(range(1, len(grouped(met)) + 1))
    assert [text.get_text() for text in written(lower)] == ["q1, q3", "q2"]


def test_lines_are_the_frequencies(plain):
    found, driven, met = plain
    upper, _ = resonance_figure(found, driven, met).axes
    broken = [line for line in upper.lines if line.get_linestyle() != "-" and line.get_linestyle() != "None"]
    assert [line.get_ydata().max() for line in broken] == pytest.approx([4.0, 8.0], rel=1e-3)
    solid = [line for line in upper.lines if line.get_linestyle() == "-"]
    assert solid[0].get_ydata() == pytest.approx(found.median[0])


def test_names_at_the_line_ends_do_not_overlap(plain):
    found, driven, met = plain
    figure = resonance_figure(found, driven, met)
    FigureCanvasAgg(figure).draw()
    renderer, (upper, _) = figure.canvas.get_renderer(), figure.axes
    ends = [text.get_window_extent(renderer) for text in written(upper) if text.get_text() in map(str, found.labels)]
    ends = [end for end in ends if end.x0 > upper.bbox.x1]
    assert len(ends) == len(found.labels)
    assert not any(a.overlaps(b) for i, a in enumerate(ends) for b in ends[i + 1 :])
    assert all(end.x1 <= figure.bbox.x1 for end in ends)


def test_sets_have_bands(plain, with_sets):
    counts = [len(resonance_figure(*drawn).axes[0].collections) - len(drawn[2]) for drawn in (plain, with_sets)]
    assert counts == [0, 3]


def sections(found, driven, met):
    return resonance_sections(Basis(FILE, first_guess_arm(), MOTION, 10.0), found, driven, met)


def test_report_names_drive_mode_time_and_posture(plain):
    report = sections(*plain)
    first = grouped(plain[2])[0][0]
    assert first.source.drive == "drive2"
    assert report.verdict.word == "RESONANCE"
    assert "Pulley 2 (drive2) crosses vertical bending 1 at 2.06 s, 6.22 Hz" in report.verdict.reason
    (table,) = report.answer
    assert table.rows[0][:3] == ("1", "pulley 2", "vertical bending 1")
    assert ("pulleys 1 and 3", "5.6 %") in [(row[1], row[5]) for row in table.rows]
    _, crossings, branches, *_ = report.details
    assert crossings.parts[0].rows[0][2] == "(72.49, -145, 72.49)"
    assert "passes too fast" in [row[5] for row in crossings.parts[0].rows]
    assert "lateral torsion 2" in [row[1] for row in branches.parts[1].rows], "called so until then"
    text = text_of(report, details=True)
    assert "draws" not in text
    assert not too_wide(text)
    assert_one_screen(text_of(report), files=2)


def test_report_of_sets_tells_the_probability(with_sets):
    report = sections(*with_sets)
    assert "near in 100 % of 5 draws" in report.verdict.reason
    assert "5 to 95 % of 5 draws" in text_of(report, details=True)
    assert_one_screen(text_of(report), files=2)


def test_report_without_a_crossing_says_so(plain):
    found, driven, met = plain
    report = sections(found, driven, ())
    assert report.verdict.word == "CLEAR"
    assert report.answer == ()
    near = tuple(crossing for crossing in met if not crossing.crossings)
    assert sections(found, driven, near).verdict.word == "NEAR"


def test_the_words_follow_the_share_that_builds_up(plain):
    crossing = next(e for e in plain[2] if e.crossings)
    steady = 1 / (2 * crossing.damping_ratio)
    words = [passage(replace(crossing, magnification=share * steady)) for share in (0.95, 0.6, 0.2)]
    assert words == ["builds up fully", "builds up in part", "passes too fast"]
    assert passage(replace(crossing, crossings=())) == "does not cross"


def test_rows_are_numbered_as_in_the_report(plain):
    _, _, met = plain
    rows = resonance_rows(met)
    assert [row["drive"] for row in rows] == [crossing.source.drive for crossing in met]
    assert [row["number"] for row in rows] == sorted(row["number"] for row in rows)
    assert [row["natural"] for row in rows] == [crossing.natural for crossing in met]


def test_pulleys_that_turn_alike_are_one_line():
    driven = excitation(first_guess_arm(), MOTION, times=TIMES, orders=(1, 2))
    names = [sources_words([driven.sources[i] for i in group]) for group in same_lines(driven)]
    assert names == ["pulleys 1 and 3", "pulley 2, pulleys 1 and 3 x 2", "pulley 2 x 2"]
    assert sources_words([Source("d", "j", n, 2) for n in (1, 2, 4)]) == "pulleys 1, 2 and 4 x 2"
