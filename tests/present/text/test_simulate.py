"""The report of a simulated motion says what the numbers say; figures and summary agree with it."""

import re
from dataclasses import replace

import numpy as np
import pytest
from arms import DATA
from matplotlib.backends.backend_agg import FigureCanvasAgg

from ident.assess.scenario import Basis
from ident.assess.simulate import Simulation
from ident.description.file import read_arm
from ident.identify.binding import loads_of
from ident.identify.values import Values
from ident.measure import Load
from ident.present.figures.vibration import drives_figure, simulate_figure
from ident.present.files.series import simulate_rows
from ident.present.text.simulate import simulate_report
from ident.vibrate.motion import stroke
from ident.vibrate.simulate import simulate
from ident.vibrate.study import Draws, SimulatedMotion, draw, measures, simulate_motion

pytestmark = pytest.mark.slow

FILE = read_arm(DATA / "lcd_arm" / "arm.toml")
MOTION = stroke(FILE.arm.stroke, percent=200, dwell=0.5)


def simulated(arm=FILE.arm, changed=None):
    basis = Basis(FILE, arm, MOTION, 200.0, changed=changed or {})
    return Simulation(basis, simulate_motion(arm, MOTION, method="fast", rate=100), 1e-4)


@pytest.fixture(scope="module")
def plain():
    return simulated()


def test_the_table_has_the_sizes_in_millimetres(plain):
    report = simulate_report(plain)
    sizes = measures(plain.response, 1e-4)
    for i, direction in enumerate("xyz"):
        row = re.search(rf"^  {direction} +([0-9.]+) +([0-9.]+) +([0-9.]+) +([0-9.]+)   +(.*)$", report, re.M)
        peak, when, rms, residual = map(float, row.groups()[:4])
        assert peak == pytest.approx(1e3 * sizes.peak[i], abs=5e-5)
        assert rms == pytest.approx(1e3 * sizes.rms[i], abs=5e-5)
        assert residual == pytest.approx(1e3 * sizes.residual[i], abs=5e-5)
        assert when == pytest.approx(plain.time[np.argmax(np.abs(plain.vibration[i]))])
        settled = f"{sizes.settling[i]:.3f} s" if sizes.settling[i] else "at arrival"
        assert re.fullmatch(r"not in 0\.\d+ s" if np.isinf(sizes.settling[i]) else settled, row[5])
    assert "from (142, -284, 142) deg to (0, 0, 0) deg in 1.578 s, then held for 0.5 s" in report
    assert "pulleys turn up to: drive1 80.5 Hz" in report
    assert "Fast method against exact" not in report


def test_the_largest_vibration_is_told_with_its_posture(plain):
    way, place = np.unravel_index(np.argmax(np.abs(plain.vibration)), plain.vibration.shape)
    posture = np.degrees(np.asarray(plain.response.posture)[:, place])
    size = 1e3 * abs(plain.vibration[way, place])
    words = f"largest: {size:.4f} mm in {'xyz'[way]} at {plain.time[place]:.4g} s, at ({posture[0]:.4g}, "
    assert words in simulate_report(plain)


def test_a_limit_without_draws_is_kept_or_exceeded(plain):
    assert "limit of 1 mm: exceeded in x, y, z" in simulate_report(replace(plain, limit=1e-3))
    assert "limit of 1000 mm: kept in all directions" in simulate_report(replace(plain, limit=1.0))


def test_a_slack_belt_is_told_with_its_time():
    for tension, is_slack in ((5000.0, False), (20.0, True)):
        found = simulated(FILE.arm.replace({"belt1.pretension": tension}), changed={"belt1.pretension": tension})
        report = simulate_report(found)
        assert bool(re.search("SLACK: (upper|lower) span of belt1 from", report)) is is_slack
        assert ("raise the pretension" in report) is is_slack
        assert "Assumed or calibrated: 40 of the 41" in report
        assert f"set: belt1.pretension = {tension:g}" in report
        assert bool(found.slack) is is_slack


def test_bands_and_probability_follow_from_the_draws(plain):
    rng = np.random.default_rng(0)
    values = {"joint1.k_tors": float(FILE.arm.get("joint1.k_tors")) * np.exp(0.1 * rng.normal(size=5))}
    draws = draw(FILE.arm, MOTION, values, rate=100)
    assert isinstance(draws, Draws)
    one = simulate(FILE.arm.replace({"joint1.k_tors": values["joint1.k_tors"][3]}), MOTION, rate=100)
    np.testing.assert_allclose(draws.vibration[:, :, 3], one.vibration, atol=1e-9)
    limit = float(np.median(draws.sizes.peak[1]))
    given = Values("draws.nc", "0" * 64, values, ("discrepancy.deflection",))
    with_bands = replace(plain, basis=replace(plain.basis, posterior=given), draws=draws, limit=limit)
    report = simulate_report(with_bands)
    share = (draws.sizes.peak > limit).mean(1)
    assert f"{share[0]:.0%} in x, {share[1]:.0%} in y, {share[2]:.0%} in z" in report
    low, high = np.quantile(1e3 * draws.sizes.peak[1], (0.05, 0.95))
    assert f"{low:.4f} to {high:.4f}" in report
    rows = simulate_rows(with_bands)
    assert [row["exceedance"] for row in rows] == pytest.approx(share)
    assert [row["peak_q05"] for row in rows] == pytest.approx(np.quantile(draws.sizes.peak, 0.05, axis=1))
    figure = simulate_figure(with_bands)
    assert [text.get_text() for text in figure.legends[0].get_texts()][:2] == [
        "simulated, by the medians of the draws",
        "5 to 95 % of 5 draws",
    ]


def test_what_was_interrupted_before_arrival_has_no_residual(plain):
    motion = MOTION.dwell(0.1)
    early = simulate(FILE.arm, motion, rate=100)
    import equinox as eqx

    keep = 20
    cut = eqx.tree_at(
        lambda r: (r.time, r.y, r.yd, r.path, r.displacement, r.quasi_static),
        early,
        (
            early.time[:keep],
            *(x[:, :keep] for x in (early.y, early.yd, early.path, early.displacement, early.quasi_static)),
        ),
    )
    stopped = replace(plain, study=SimulatedMotion(replace(cut, interrupted=0.19)), at=0.5)
    report = simulate_report(stopped)
    assert "INTERRUPTED: the exact method came to 0.19 s" in report
    assert np.isnan(stopped.sizes.residual).all()
    assert not np.isfinite([row["settling_time"] for row in simulate_rows(stopped)]).any()
    simulate_figure(stopped)


def test_a_load_moves_the_vibration(plain):
    done = simulate_motion(FILE.arm, MOTION, loads=loads_of(FILE.arm, Load.parse("glass")), method="fast", rate=100)
    assert not np.allclose(done.response.vibration, plain.vibration, rtol=1e-2)
    zero = simulate_motion(FILE.arm, MOTION, loads=loads_of(FILE.arm, Load()), method="fast", rate=100)
    np.testing.assert_allclose(zero.response.vibration, plain.vibration, atol=1e-12)


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
