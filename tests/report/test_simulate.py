"""The report of a simulated motion says what the numbers say; figures and summary agree with it."""

import re
from dataclasses import replace

import numpy as np
import pytest
from arms import DATA
from matplotlib.backends.backend_agg import FigureCanvasAgg
from reports import assert_one_screen

from ident.description.file import read_arm
from ident.identify.values import Values
from ident.report.report import text_of
from ident.report.words import percent
from ident.studies.scenario import Basis, OverPhases
from ident.studies.working.simulate_figure import drives_figure, simulate_figure
from ident.studies.working.simulate_files import simulate_groups
from ident.studies.working.simulate_report import simulate_rows, simulate_sections
from ident.studies.working.simulation import Simulation
from ident.vibrate.binomial import share_of_variance
from ident.vibrate.motion import stroke
from ident.vibrate.simulate import simulate
from ident.vibrate.study import Draws, Sizes, draw, measures, simulate_motion

pytestmark = pytest.mark.slow

FILE = read_arm(DATA / "lcd_arm" / "arm.toml")
MOTION = stroke(FILE.arm.stroke, percent=200, dwell=0.5)


def simulated(arm=FILE.arm, changed=None):
    basis = Basis(FILE, arm, MOTION, 200.0, changed=changed or {})
    return Simulation(basis, *simulate_motion(arm, MOTION, method="fast", rate=100), 1e-4)


@pytest.fixture(scope="module")
def plain():
    return simulated()


def test_the_table_has_the_sizes_in_millimetres(plain):
    report = simulate_sections(plain)
    sizes = measures(plain.response, 1e-4)
    for i, (direction, peak, when, rms, residual, settled) in enumerate(report.answer[0].rows):
        assert direction == "xyz"[i]
        assert float(peak) == pytest.approx(1e3 * sizes.peak[i], abs=5e-5)
        assert float(rms) == pytest.approx(1e3 * sizes.rms[i], abs=5e-5)
        assert float(residual) == pytest.approx(1e3 * sizes.residual[i], abs=5e-5)
        assert float(when) == pytest.approx(plain.time[np.argmax(np.abs(plain.vibration[i]))])
        assert settled == "-", "held for half a second, which does not show how it decays"
        assert np.isnan(sizes.settled[i])
    motion = report.details[0].parts
    assert motion[0] == "From (142, -284, 142) deg to (0, 0, 0) deg in 1.578 s, then held for 0.5 s."
    assert "drive1 80.5 Hz" in motion[1]
    assert "Fast method against exact" not in [section.title for section in report.details]
    assert report.verdict is None, "without a limit nothing is judged"
    assert_one_screen(text_of(report), files=5)


def test_the_largest_vibration_is_told_with_its_posture(plain):
    way, place = np.unravel_index(np.argmax(np.abs(plain.vibration)), plain.vibration.shape)
    posture = np.degrees(np.asarray(plain.response.posture)[:, place])
    size = 1e3 * abs(plain.vibration[way, place])
    words = f"Largest: {size:.4f} mm in {'xyz'[way]} at {plain.time[place]:.4g} s, at ({posture[0]:.4g}, "
    assert simulate_sections(plain).remark.startswith(words)


def test_a_limit_is_judged_with_phases_and_draws(plain):
    peak = float(plain.sizes.peak.max())
    peaks = np.outer(plain.sizes.peak, [0.9, 1.1])
    phases = OverPhases(peaks, peaks, np.zeros((3, 3)))

    def judged(limit, **more):
        return simulate_sections(replace(plain, limit=limit, **more)).verdict

    assert judged(0.9 * peak).word == judged(0.9 * peak, phases=phases).word == "NOT OK"
    assert judged(1.05 * peak).word == "OK"
    unsure = judged(1.05 * peak, phases=phases)
    assert unsure.word == "MARGINAL"
    assert "50 % of random phases exceed it" in unsure.reason
    assert judged(1.2 * peak, phases=phases).word == "OK"


def test_a_slack_belt_is_told_with_its_time():
    for tension, is_slack in ((5000.0, False), (20.0, True)):
        found = simulated(FILE.arm.replace({"belt1.pretension": tension}), changed={"belt1.pretension": tension})
        report = simulate_sections(found)
        text = " ".join(finding.text for finding in report.findings)
        assert bool(re.search("belt1 goes slack: its (upper|lower) span from", text)) is is_slack
        assert ("raise the pretension" in report.findings[0].remedy) is is_slack
        assert "amplitudes rest on 40 assumed numbers (drives, belts, stroke)" in text
        assert f"Set: belt1.pretension = {tension:g} N." in report.details[0].parts
        assert bool(found.slack) is is_slack


def test_the_share_of_damping_is_that_of_its_draws(plain):
    rng = np.random.default_rng(0)
    own, other = rng.normal(size=(2, 200))
    values = {"joint1.loss_tors": np.exp(own), "joint2.loss_tors": np.exp(own), "joint1.k_tors": np.exp(other)}
    peak = np.exp(-own + 0.5 * other) * np.array([[1.0], [2.0], [3.0]])
    settling = np.where(other > 1, np.inf, np.exp(other)) * np.ones((3, 1))
    draws = Draws(values, np.zeros((3, 1, 200)), Sizes(peak, peak, peak, settling, peak))
    assert share_of_variance(values, peak[0]) == pytest.approx(1.0, abs=0.05)
    assert share_of_variance({"": values["joint1.loss_tors"]}, peak[0]) == pytest.approx(
        0.8, abs=0.06
    )  # 1 / (1 + .5^2)
    report = simulate_sections(replace(plain, draws=draws))
    (bands,) = (section for section in report.details if section.title.startswith("5 to 95 % of"))
    said = re.fullmatch(r".* for (\S+) % of the variance of the peak in z, and for (\S+) % of .*", bands.parts[-1])
    assert float(said[1]) == pytest.approx(80, abs=6)
    assert float(said[2]) < 5


def test_bands_and_probability_follow_from_the_draws(plain):
    rng = np.random.default_rng(0)
    values = {"joint1.k_tors": float(FILE.arm.get("joint1.k_tors")) * np.exp(0.1 * rng.normal(size=5))}
    draws = draw(FILE.arm, MOTION, values, rate=100, measure=lambda response: measures(response, 1e-4))
    assert isinstance(draws, Draws)
    one = simulate(FILE.arm.replace({"joint1.k_tors": values["joint1.k_tors"][3]}), MOTION, rate=100)
    np.testing.assert_allclose(draws.vibration[:, :, 3], one.vibration, atol=1e-9)
    limit = float(np.median(draws.sizes.peak[1]))
    given = Values("draws.nc", "0" * 64, values, ("discrepancy.deflection",))
    with_bands = replace(plain, basis=replace(plain.basis, posterior=given), draws=draws, limit=limit)
    report = simulate_sections(with_bands)
    share = (draws.sizes.peak > limit).mean(1)
    (bands,) = (section for section in report.details if section.title.startswith("5 to 95 % of 5 draws"))
    words = ", ".join(f"{percent(part)} in {direction}" for part, direction in zip(share, "xyz", strict=True))
    assert words in bands.parts[1]
    assert len(bands.parts) == 2, "no damping among the draws"
    assert report.verdict.word == "MARGINAL"
    low, high = np.quantile(1e3 * draws.sizes.peak[1], (0.05, 0.95))
    assert bands.parts[0].rows[1][1] == report.answer[0].rows[1][3] == f"{low:.4f} to {high:.4f}"
    rows = simulate_rows(with_bands)
    assert [row["exceedance"] for row in rows] == pytest.approx(share)
    assert [row["peak_q05"] for row in rows] == pytest.approx(np.quantile(draws.sizes.peak, 0.05, axis=1))
    assert "Not used, as the arm has no such number: discrepancy.deflection" in text_of(report, details=True)
    arrays = simulate_groups(with_bands, {})["/"].variables
    assert arrays["vibration_draws"].dims == ("draw", "direction", "time")
    np.testing.assert_array_equal(arrays["vibration_draws"].values[3], draws.vibration[:, :, 3])
    drawn = arrays["parameter_draws"].values[:, arrays["parameter"].values.index("joint1.k_tors")]
    np.testing.assert_array_equal(drawn, draws.values["joint1.k_tors"])
    figure = simulate_figure(with_bands)
    assert [text.get_text() for text in figure.legends[0].get_texts()][:2] == [
        "simulated, by the medians of the draws",
        "5 to 95 % of 5 draws",
    ]


def test_figures_name_units_and_lines(plain):
    figure = simulate_figure(replace(plain, at=0.7))
    assert [axes.get_ylabel() for axes in figure.axes] == [f"{d}: vibration\n[mm]" for d in "XYZ"]
    assert figure.axes[-1].get_xlabel() == "time [s]"
    time, values = figure.axes[1].lines[0].get_data()
    np.testing.assert_allclose(values, 1e3 * plain.vibration[1])
    np.testing.assert_allclose(time, plain.time)
    assert [text.get_text() for text in figure.axes[0].texts] == ["arrival", "late peak from 0.7 s on"]
    second = drives_figure(plain)
    assert [axes.get_ylabel().split("[")[-1] for axes in second.axes] == ["deg]", "deg]", "deg]", "N]", "Hz]"]
    names = [text.get_text() for text in second.axes[-1].get_legend().get_texts()]
    assert names == ["drive1, drive3", "drive2"]
    for drawn in (figure, second):
        FigureCanvasAgg(drawn).draw()
