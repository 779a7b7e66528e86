"""The report of a sweep says what the numbers say; figure and summary agree with it."""

from dataclasses import replace

import numpy as np
import pytest
from arms import DATA
from matplotlib.backends.backend_agg import FigureCanvasAgg
from reports import assert_one_screen
from swept import axis

from ident.description.file import read_arm
from ident.report.report import text_of
from ident.studies.scenario import Basis
from ident.studies.working.sweep_figure import sweep_figure
from ident.studies.working.sweep_report import sweep_sections, write_csv
from ident.studies.working.sweep_study import SweepStudy
from ident.units import stiffness_in
from ident.vibrate.motion import stroke
from ident.vibrate.sweep import Sweep, below, curve

FILE = read_arm(DATA / "lcd_arm" / "arm.toml")
MOTION = stroke(FILE.arm.stroke, percent=10.0, dwell=2.0)
K = "joint1.k_tors"
STIFF = axis(FILE.arm, [K], float(FILE.arm.get(K)) * np.geomspace(0.5, 2, 5), 10.0)
CENTRE = axis(FILE.arm, ["bracket.com.x"], np.linspace(0.0, 0.29, 4), 10.0)
SPEED = axis(FILE.arm, ["speed"], np.array([12.0, 14.0, 18.0]), 10.0)
PRESENT = np.array([0.2, 0.65, 0.1]) * 1e-3
FALLS, DIPS, FLAT = [0.4, 0.3, 0.2, 0.15, 0.1], [1.1, 0.9, 0.65, 0.8, 1.2], [0.1, 0.101, 0.1, 0.102, 0.101]
STIFFNESS = Sweep((STIFF,), "peak", 1e-3 * np.array([FALLS, DIPS, FLAT]), PRESENT)


@pytest.fixture(autouse=True)
def paper_unit():
    with stiffness_in("N mm/deg"):
        yield


def swept(*sweeps, **more):
    return SweepStudy(Basis(FILE, FILE.arm, MOTION, 10.0), sweeps, 500.0, **more)


def drawn(sweep, count=20):
    spread = np.linspace(0.8, 1.2, count)
    return replace(sweep, draws=sweep.amplitude[..., None] * spread)


def test_table_and_trends_of_a_stiffness():
    report = sweep_sections(swept(STIFFNESS))
    assert report.verdict is None
    assert "as the arm is: x 0.2000 mm, y 0.6500 mm, z 0.1000 mm" in report.answer[0]
    named = (f"{K} [N mm/deg]", "6.28e6", "0.6500", "6.28e6", "1.2000", "1.256e7", "has a minimum")
    assert report.answer[1].rows == (named,)
    _, section, _ = report.details
    axis_words, values, trend = section.parts
    assert axis_words.startswith(f"{K} at present: 6.28e6 N mm/deg; 5 values from 3.14e6 N mm/deg to 1.256e7")
    assert values.texts[2] == ("6.28e6", "1", "0.2000", "0.6500", "0.1000", "present")
    assert trend.rows == (
        ("x", "falls", "0.4000", "0.1000", "0.1000", "1.256e7", "0.4000", "3.14e6", "falls"),
        ("y", "has a minimum", "1.1000", "1.2000", "0.6500", "6.28e6", "1.2000", "1.256e7", "minimum at 6.28e6"),
        ("z", "hardly changes", "0.1000", "0.1010", "0.1000", "3.14e6", "0.1020", "8.881e6", "hardly changes"),
    )
    for words in ("less than 5 %", "that in y", "near present: 0.707x to 1.41x"):
        assert words in trend.note
    assert "limit" not in text_of(report, details=True)
    assert_one_screen(text_of(report), files=3)


@pytest.mark.parametrize(
    ("limit", "word", "kept"),
    [(0.9e-3, "OK", "4.441e6 to 9.801e6"), (0.64e-3, "NOT REACHABLE", "nowhere"), (2e-3, "OK", "everywhere")],
)
def test_where_the_limit_is_kept(limit, word, kept):
    report = sweep_sections(swept(STIFFNESS, limit=limit))
    assert report.verdict.word == word
    assert report.answer[1].rows[0][-1] == kept
    assert report.details[1].parts[-1].endswith(f"is kept in all directions: {kept}.")


def test_a_limit_within_reach_is_named_with_its_value():
    worse = replace(STIFFNESS, present=1e-3 * np.array([0.2, 1.0, 0.1]))
    verdict = sweep_sections(swept(worse, limit=0.9e-3)).verdict
    assert verdict.word == "REACHABLE"
    assert f"0.6500 mm with {K} 6.28e6 N mm/deg" in verdict.reason
    values, amplitudes = curve(STIFFNESS)
    assert below(values, amplitudes[-1], 0.9e-3)[0] == pytest.approx(
        [STIFF.values[1], STIFF.values[3] + 0.25 * (STIFF.values[4] - STIFF.values[3])]
    )


def test_bands_and_probability():
    found = drawn(STIFFNESS)
    report = sweep_sections(swept(found, limit=0.651e-3))
    assert report.verdict.word == "MARGINAL", "as it is the arm keeps the limit, half of the draws do not"
    assert "50 % at present" in report.verdict.reason
    _, values, bands, *_ = report.details[1].parts
    low, high = 1e3 * found.band[:, 1, 2]
    assert bands.rows[2][2] == f"{low:.4f} to {high:.4f}"
    assert values.rows[2][-2:] == ("50 %", "present")
    assert found.exceeds(0.651e-3)[2] == 0.5
    assert_one_screen(text_of(report), files=3)


def test_a_present_value_out_of_range_is_told():
    speed = Sweep((SPEED,), "rms", 1e-3 * np.array([[1, 2, 3], [3, 2, 1], [1, 2, 1.0]]), PRESENT)
    report = sweep_sections(swept(speed))
    motion, section, _ = report.details
    assert "pauses included" in motion.parts[1]
    assert "from 12 % to 18 %" in section.parts[0]
    trend = section.parts[-1]
    assert "The present value is out of range." in trend.note
    assert [row[1] for row in trend.rows] == ["rises", "falls", "has a maximum", "has a minimum"]


def test_a_map_names_its_best_point():
    sizes = 1e-3 * np.arange(1.0, 61.0).reshape(3, 5, 4)[:, ::-1]
    found = drawn(Sweep((STIFF, CENTRE), "peak", sizes, PRESENT))
    report = sweep_sections(swept(found, limit=50e-3))
    _, extremes, kept = report.answer
    assert extremes.rows[-1] == ("largest", "41.0000", "1.256e7", "0", "60.0000", "3.14e6", "0.29")
    assert "kept at 10 of 20 points" in kept
    assert "Least probability of exceeding it: 0 %, at joint1.k_tors 1.256e7 N mm/deg, bracket.com.x 0 m" in kept
    assert np.shape(found.band) == (2, 3, 5, 4)
    assert_one_screen(text_of(report), files=3)


def test_the_table_is_long(tmp_path):
    centre = Sweep((CENTRE,), "peak", np.full((3, 4), 1e-3), PRESENT)
    both = swept(drawn(STIFFNESS), drawn(centre))
    head = {"format": "ident-sweep/3", "created": "now", "software": {"ident": "0.1.0"}}
    write_csv(both, head, tmp_path / "a.csv")
    lines = (tmp_path / "a.csv").read_text().splitlines()
    assert lines[0] == "# ident-sweep/3 now ident 0.1.0"
    assert lines[4] == "parameter,value,unit,direction,amplitude [mm],q05 [mm],q95 [mm]"
    assert lines[5] == "joint1.k_tors,179908.7477,N m/rad,x,0.4,0.328,0.472"
    assert len(lines) == 5 + 3 * (5 + 4)
    assert lines[-1].split(",")[:5] == ["bracket.com.x", "0.29", "m", "z", "1"]
    write_csv(swept(STIFFNESS), head, tmp_path / "b.csv")
    assert (tmp_path / "b.csv").read_text().splitlines()[5] == "joint1.k_tors,179908.7477,N m/rad,x,0.4,,"


def test_the_figure_has_the_numbers_in_their_units():
    centre = Sweep((CENTRE,), "peak", np.full((3, 4), 1e-3), PRESENT)
    figure = sweep_figure(swept(drawn(STIFFNESS), drawn(centre), limit=1e-3))
    first, second = figure.axes[:2]
    assert first.get_xlabel() == "joint1.k_tors, torsional stiffness of joint1 [10⁶ N mm/deg]"
    assert second.get_xlabel() == "bracket.com.x, mass centre of bracket, x [m]"
    lines = [line for line in first.lines if len(line.get_xdata()) == 5]
    np.testing.assert_allclose(lines[1].get_xdata(), 6.28e6 * np.geomspace(0.5, 2, 5))
    np.testing.assert_allclose(lines[1].get_ydata(), DIPS)
    FigureCanvasAgg(figure).draw()
    assert "6" in [text.get_text() for text in first.get_xticklabels()]
    names = [text.get_text() for text in figure.legends[0].get_texts()]
    assert names == ["X", "Y", "Z", "present", "5 to 95 % of 20 draws", "limit, 1 mm"]
    far = sweep_figure(swept(STIFFNESS, limit=1.0))
    assert "the limit of 1000 mm lies far above" in far.legends[0].get_title().get_text()


def test_the_map_is_turned_the_right_way():
    sizes = 1e-3 * np.arange(1.0, 61.0).reshape(3, 5, 4)
    figure = sweep_figure(swept(Sweep((STIFF, CENTRE), "peak", sizes, PRESENT), limit=50e-3))
    axes = figure.axes[0]
    assert axes.get_xlabel().startswith("joint1.k_tors")
    assert axes.get_ylabel().startswith("bracket.com.x")
    marks = {line.get_marker(): (line.get_xdata()[0], line.get_ydata()[0]) for line in axes.lines}
    assert marks["o"] == pytest.approx((6.28e6, 0.145))
    assert marks["s"] == pytest.approx((3.14e6, 0.0))
    names = [text.get_text() for text in figure.legends[0].get_texts()]
    assert names == ["present, 0.65 mm", "least, 41 mm", "limit, 50 mm"]
    FigureCanvasAgg(figure).draw()
    flat = sweep_figure(swept(Sweep((STIFF, CENTRE), "peak", np.full((3, 5, 4), 1e-3), PRESENT)))
    FigureCanvasAgg(flat).draw()
