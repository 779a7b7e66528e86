"""Damping given stiffness: the modes of ratios, the law that is named, correlated errors, and the two stages."""

import json
import re
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from arms import DATA, lcd_arm
from one_program import shown

import ident
from ident.arm.fields import ALPHA
from ident.arm.parts import Spring
from ident.identify.compare import compare_fits
from ident.identify.conditions import bind
from ident.identify.damping import RATIO, ModesOfRows, damped, damping_of, ratios_of
from ident.identify.fit import fit_campaign
from ident.identify.fleet import SourceFile, fleet, robot_of
from ident.identify.predict import ArmModel
from ident.identify.stored import fit_of, fit_state
from ident.identify.unknowns import Unknowns
from ident.identify.validate import validate_fit
from ident.identify.values import OTHER_LAW, Values, remark_on
from ident.measure import Campaign, Measurement, read_campaign
from ident.measure.covariance import Covariance, Group
from ident.report.document import plain
from ident.report.report import text_of
from ident.studies.cure.design import DesignOptions, _checked_text
from ident.studies.motion_options import basis_of
from ident.studies.result_values import read_fit
from ident.studies.stiffness.compare_report import compare_sections
from ident.studies.stiffness.fit_report import fit_sections
from ident.studies.stiffness.fleet_report import fleet_sections
from ident.studies.stiffness.validate_report import validate_sections

NAMES = ("lateral torsion 1", "vertical bending 1", "vertical bending 2", "lateral torsion 2")
POSTURES = tuple((a, -2 * a, a) for a in np.radians([0.0, 30.0, 60.0]).tolist())
JOINTS = ("joint1", "joint2", "joint3")
LAWS = {
    "constant": {f"{j}.loss_{k}": 0.02 for j in JOINTS for k in ("bend", "tors")},
    "by kind": {f"{j}.loss_{k}": x for j in JOINTS for k, x in (("bend", 0.01), ("tors", 0.03))},
    "viscous": {f"{j}.tau_{k}": x for j in JOINTS for k, x in (("bend", 2e-4), ("tors", 2e-3))},
    "falling": {ALPHA: 1.0},
}
TOGETHER = 20
"""Draws of a stiffness that one program takes."""
FAMILY = {"constant": {"loss"}, "by kind": {"loss"}, "viscous": {"tau"}, "falling": {"alpha"}}


def rows_of(values=None, postures=POSTURES, sd=0.05):
    """A row for each mode at each posture."""
    each = [(posture, name) for posture in postures for name in NAMES]
    values = np.full(len(each), 0.01) if values is None else values
    return tuple(
        Measurement(kind=RATIO, posture=p, value=float(z), sigma=float(sd * z), mode=name)
        for (p, name), z in zip(each, values, strict=True)
    )


def model(arm=None):
    """An arm as a fit has it; the conditions are those of some row."""
    arm = lcd_arm() if arm is None else arm
    return ArmModel(arm, bind(arm, Campaign(measurements=(replace(rows_of()[0], kind="frequency"),))))


@cache
def modes():
    return ModesOfRows.of(model(), {}, rows_of(), ())


@cache
def exact(law):
    """Ratios of the poles by a law."""
    return modes().poles(LAWS[law])


def found(values, seed=None, unknowns=Unknowns()):  # noqa: B008
    noise = 0.0 if seed is None else 0.05 * np.random.default_rng(seed).standard_normal(len(values))
    campaign = Campaign(measurements=rows_of(values * (1 + noise)))
    return damping_of(lcd_arm(), model(), campaign, np.zeros(0), {}, unknowns)


def test_ratios_belong_to_the_modes_of_their_labels():
    """The complex stiffness K (1 + i eta) has sin(atan(eta) / 2) in all modes where gravity does not count."""
    hertz, columns = modes().columns()
    assert hertz[:2] == pytest.approx([4.12, 4.80], abs=0.005)  # the paper's Table 1
    total = sum(columns[path] for path in LAWS["constant"])
    assert total == pytest.approx(0.5, rel=0.02)  # gravity holds up a percent of the stiffness
    assert exact("constant") == pytest.approx(0.02 * total, rel=1e-3)
    assert exact("viscous") == pytest.approx(sum(columns[p] * x for p, x in LAWS["viscous"].items()), rel=0.15)
    assert exact("falling") == pytest.approx(1 / (4 * np.pi * hertz), rel=1e-9)


def test_ratios_of_several_stiffnesses_are_those_of_each():
    """More draws than rows: which axis is which."""
    factors = np.linspace(0.8, 1.2, TOGETHER)
    path = "joint2.k_tors"
    stiffness = factors * float(lcd_arm().get(path))
    of = lambda k: ModesOfRows.of(model(), {path: k}, rows_of(), ()).columns()[1]  # noqa: E731
    every = of(stiffness)
    for draw in (0, TOGETHER - 1):
        alone = of(stiffness[draw])
        assert every.keys() == alone.keys()
        for name, column in alone.items():
            np.testing.assert_allclose(every[name][:, draw], column, rtol=1e-9)
    assert abs(every[ALPHA][:, 0] / every[ALPHA][:, -1] - 1).max() > 0.05


def test_damping_is_drawn_for_each_draw_of_a_stiffness(monkeypatch):
    """More draws than are computed at once, of an arm twice as stiff too: the same ratios, half the time or so."""
    monkeypatch.setattr("ident.identify.damping.CHUNK", TOGETHER)
    path, count = "joint2.k_tors", 300
    k = float(lcd_arm().get(path)) * np.where(np.arange(count) % 2, 2.0, 1.0)
    damping = found(exact("viscous"), 0)
    given = damping.given({path: k})
    assert given.keys() == {group for group, x in damping.carried.items() if x}
    tors = next(x for paths, x in given.items() if "joint2.tau_tors" in paths)
    assert len(tors) == count
    assert np.median(tors[::2]) == pytest.approx(2e-3, rel=0.1)
    assert np.median(tors[1::2]) < 0.97 * np.median(tors[::2])
    assert 0.005 < tors[::2].std() / 2e-3 < 0.1


@pytest.mark.parametrize("law", LAWS)
def test_the_data_choose_the_law(law):
    for seed in range(3):
        damping = found(exact(law), seed)
        assert damping.best.family == FAMILY[law]
        assert not damping.rivals
        assert not damping.marked.any()
        assert damping.predicted == pytest.approx(exact(law), rel=0.1)
        assert damping.best.scatter < 0.05


def test_what_is_not_determined_is_not_named():
    rows = rows_of(exact("constant"), sd=1.0)
    damping = damping_of(lcd_arm(), model(), Campaign(measurements=rows), np.zeros(0), {}, Unknowns())
    assert {family for law in (damping.best, *damping.rivals) for family in law.family} == {"loss", "tau", "alpha"}


def test_no_law_is_scatter():
    by_mode = dict(zip(NAMES, (0.005, 0.03, 0.012, 0.02), strict=True))
    damping = found(np.array([by_mode[m.mode] for m in rows_of()]), 0)
    assert 0.3 < damping.best.scatter < 1.5
    measured = damping.drawn(Campaign(measurements=rows_of()[:4]))  # known by their rows at other postures, too
    assert np.median(measured, 1) == pytest.approx(list(by_mode.values()), rel=0.1)
    assert (measured.std(1) < 0.1 * measured.mean(1)).all()
    third = replace(rows_of()[0], mode="lateral torsion 3")
    drawn = damping.drawn(Campaign(measurements=(third, *rows_of()[1:4])))
    low, high = np.quantile(drawn[0], [0.025, 0.975])
    assert high / low > 4


def test_a_single_ratio_that_is_off_is_marked_and_does_not_count():
    values = exact("viscous").copy()
    values[5] *= 3
    damping = found(values, 0)
    assert np.flatnonzero(damping.marked).tolist() == [5]
    assert damping.best.family == {"tau"}
    assert damping.predicted[5] == pytest.approx(values[5] / 3, rel=0.1)


def test_errors_of_frequencies_tell_of_those_of_ratios():
    """Against the conditional of the joint normal distribution, row by row."""
    rng = np.random.default_rng(2)
    A = rng.standard_normal((6, 6))
    C = A @ A.T
    sd = np.sqrt(np.diag(C))
    R = C / np.outer(sd, sd)
    group = [{"group": "a", "member": i + 1} for i in range(6)]
    rows = [replace(m, **own) for m, own in zip(rows_of(postures=POSTURES[:1])[:3], group, strict=False)]
    hertz = [replace(m, kind="frequency", value=5.0, sigma=0.1, **own) for m, own in zip(rows, group[3:], strict=True)]
    mixed = (rows[0], hertz[0], rows[1], hertz[1], rows[2], hertz[2])
    covariance = Covariance((Group("a", tuple(map(tuple, R.tolist()))),))
    off = np.array([1.0, -2.0, 0.5])
    ratios = ratios_of(Campaign(measurements=mixed, covariance=covariance), off)
    gain = R[:3, 3:] @ np.linalg.inv(R[3:, 3:])
    relative = 0.05
    assert np.exp(ratios.log) == pytest.approx(0.01 * (1 - relative * gain @ off), rel=1e-12)
    assert ratios.covariance == pytest.approx(relative**2 * (R[:3, :3] - gain @ R[3:, :3]), rel=1e-9)


def test_what_is_named_is_sought_by_itself():
    named = Unknowns(free={"joint1.tau_tors": 1.0, "joint2.tau_tors": 1.0})
    damping = found(exact("viscous"), unknowns=named)
    assert damping.best.groups == (("joint1.tau_tors",), ("joint2.tau_tors",))
    assert damping.best.values == pytest.approx([2e-3, 2e-3], rel=0.05)
    fixed = found(exact("viscous"), unknowns=Unknowns(fixed=tuple(f"{j}.tau_bend" for j in JOINTS)))
    assert not any("tau_bend" in path for path in fixed.best.numbers)
    assert fixed.predicted == pytest.approx(exact("viscous"), rel=0.02)


def shipped(law, seed=0):
    """The shipped campaign with a ratio for each labelled frequency."""
    campaign, rng = read_campaign(DATA / "lcd_arm" / "campaign.csv"), np.random.default_rng(seed)
    rows = [
        replace(m, kind=RATIO, unit="", value=0.01, where=f"c.csv:{40 + i}") for i, m in enumerate(campaign) if m.mode
    ]
    values = ModesOfRows.of(model(), {}, rows, ()).poles(LAWS[law])
    values = values * (1 + 0.05 * rng.standard_normal(len(rows)))
    ratios = [replace(m, value=float(z), sigma=0.05 * float(z)) for m, z in zip(rows, values, strict=True)]
    return campaign, replace(campaign, measurements=(*campaign, *ratios))


@pytest.mark.slow
def test_no_ratio_moves_a_stiffness():
    campaign, more = shipped("constant")
    alone, both = fit_campaign(lcd_arm(), campaign), fit_campaign(lcd_arm(), more)
    np.testing.assert_array_equal(both.best.theta, alone.best.theta)
    np.testing.assert_array_equal(both.interval(), alone.interval())
    assert (both.doubts, both.chi_squared, both.optima[0].starts) == ((), alone.chi_squared, alone.optima[0].starts)
    text = text_of(fit_sections(both))
    assert "Damping: 0.9" in text.replace("1 %", "0.99 %")
    assert "does not change with frequency" in text
    taken = Values.of_fit(both, lcd_arm())
    assert taken.values["joint2.loss_tors"] == pytest.approx(0.02, rel=0.1)
    assert (float(taken.values["joint2.tau_tors"]), taken.remark) == (0.0, "")
    again = fit_of(lcd_arm(), more, Unknowns(), json.loads(json.dumps(plain(fit_state(both), str))))
    assert again.damping.best.values == pytest.approx(both.damping.best.values, rel=1e-6)
    _, viscous = shipped("viscous")
    taken = Values.of_fit(fit_campaign(lcd_arm(), viscous), lcd_arm()).values
    assert taken["joint2.tau_tors"] == pytest.approx(2e-3, rel=0.1)
    assert not any("loss" in path for path in taken)
    _, falling = shipped("falling")
    taken = Values.of_fit(fit_campaign(lcd_arm(), falling), lcd_arm())
    assert taken.values[ALPHA] == pytest.approx(1.0, rel=0.1)
    assert (float(taken.values["joint2.tau_tors"]), taken.remark) == (0.0, "")


def test_each_ratio_is_predicted_from_those_of_other_postures():
    parts = [[i for i, m in enumerate(rows_of()) if m.posture == posture] for posture in POSTURES]
    off = []
    for seed in range(10):
        damping = found(exact("viscous"), seed)
        measured, predicted, z = damping.left_out(parts).T
        np.testing.assert_array_equal(measured, np.exp(damping.ratios.log))
        assert predicted == pytest.approx(exact("viscous"), rel=0.2)
        off.append(z)
    assert 0.7 < np.std(off) < 1.3
    values = exact("viscous").copy()
    values[5] *= 3
    assert found(values, 0).left_out(parts)[5, 2] > 5
    assert not len(found(values, 0).left_out([range(12)])), "nothing is left to predict them from"
    wrong = found(values, 0)
    assert list(np.flatnonzero(wrong.marked)) == [5]
    own = [row for row in range(12) if row != 5]
    np.testing.assert_allclose(wrong.left_out(parts)[own, 1], exact("viscous")[own], rtol=0.2)  # it does not count


@pytest.mark.slow
def test_damping_has_lines_of_its_own_and_no_part_in_verdicts():
    """Of ratios that grow from 1 to 1.5 %, with another scatter; postures are predicted whatever they do."""
    campaign, more = shipped("constant")
    _, later = shipped("constant", 1)
    later = [replace(m, value=1.5 * m.value, sigma=1.5 * m.sigma) if m.kind == RATIO else m for m in later]
    alone, one, other = (fit_campaign(lcd_arm(), c) for c in (campaign, more, Campaign(measurements=tuple(later))))
    without, both = (compare_sections([compare_fits(a, b)]) for a, b in ((alone, alone), (one, other)))
    assert (without.verdict, without.answer[0]) == (both.verdict, both.answer[0])
    (line,) = both.answer[1:]
    assert without.answer[1:] == ()
    assert line.startswith("Damping: 0.9")
    assert "in all modes; it does not change with frequency. Then 1." in line
    assert "In 16 modes of both the ratio differs by +" in line
    assert line.endswith(": it has changed.")
    count, change, sd = compare_fits(one, other).damping
    assert (count, change, sd) == (16, pytest.approx(np.log(1.5), abs=3 * sd), pytest.approx(0.05 * 8**-0.5, rel=0.05))
    (same,) = compare_sections([compare_fits(one, one)]).answer[1:]
    assert same.endswith(": no change.")
    odd = replace(one, damping=replace(one.damping, marked=np.arange(16) == 3))
    assert compare_fits(odd, one).damping[0] == 15, "what does not count in the fit does not here"

    plain_, scattered = validate_fit(alone), validate_fit(one)
    wild = replace(one.damping, ratios=one.damping.ratios._replace(log=one.damping.ratios.log + np.tile([0.0, 2.0], 8)))
    contradicted = validate_fit(replace(one, damping=wild))
    reports = [validate_sections(each) for each in (plain_, scattered, contradicted)]
    assert len({report.verdict for report in reports}) == 1
    assert [len(report.answer) for report in reports] == [2, 3, 3]
    assert re.match(
        r"Damping ratios: 1[456] of 16 lie in the predicted 95 % interval; rms error \d", reports[1].answer[2]
    )

    robots = [robot_of(each, f"robot{i}", SourceFile(), SourceFile()) for i, each in enumerate((one, one, other))]
    bare = [replace(robot, damping_ratio=0.0) for robot in robots]
    said, silent = (fleet_sections(fleet(each)) for each in (robots, bare))
    assert said.verdict == silent.verdict
    assert said.answer[:-1] == silent.answer
    assert re.search(r"median 0.9\d* %, spread 2\d % \(3 robots\)", said.answer[-1].replace("1 %", "0.99 %"))


@pytest.mark.slow
def test_poles_have_the_damping_that_was_measured():
    """Frequencies of the poles of an arm that loses 3 % in all modes; by the file it is up to 9 %, and moves poles."""
    lossy = {path: 3 * x for path, x in LAWS["constant"].items()}
    arm = damped(lcd_arm(), lossy)
    campaign = read_campaign(DATA / "lcd_arm" / "campaign.csv")
    rows = [replace(m, of="pole") if m.kind == "frequency" else m for m in campaign]
    values = shown(arm, Campaign(measurements=tuple(rows)))
    true = [replace(m, value=float(v), sigma=m.sigma * float(v) / m.value) for m, v in zip(rows, values, strict=True)]
    ratios = [replace(m, kind=RATIO, of=None, unit="", value=0.01) for m in true if m.mode]
    values = ModesOfRows.of(model(arm), {}, ratios, ()).poles(lossy)
    ratios = [replace(m, value=float(z), sigma=0.02 * float(z)) for m, z in zip(ratios, values, strict=True)]
    fit = fit_campaign(lcd_arm(), Campaign(measurements=(*true, *ratios)), Unknowns(prior_sd=np.inf))
    start = np.array([float(lcd_arm().get(name)) for name in fit.problem.parameters.names])
    assert fit.poles.numbers
    assert np.log(fit.best.values / start) == pytest.approx(0, abs=2e-4)


@pytest.mark.slow
def test_a_saved_fit_hands_on_the_law_of_its_damping(tmp_path):
    """That it hands none on is said where an arm has no place for it: where a spring is no straight line."""
    for law in ("constant", "falling"):
        result = ident.fit(DATA / "lcd_arm" / "arm.toml", shipped(law)[1])
        saved, *_ = result.save(tmp_path / law)
        taken, read = result.values_of(lcd_arm())[0], read_fit(saved, lcd_arm())[0]
        assert (read.values, read.remark) == (taken.values, taken.remark)
        assert ("joint1.loss_bend" in read.values, ALPHA in read.values) == (law == "constant", law == "falling")
        assert not read.remark
        written = ident.read_arm(ident.export(result, tmp_path / f"{law}.toml")[0]).arm
        values = {path: float(value) for path, value in taken.values.items()}
        assert {path: float(written.get(path)) for path in values} == pytest.approx(values, rel=1e-9)
        text = ident.export(result, tmp_path / f"{law}.json")[0].read_text()
        assert '"path": "joint2.tau_tors",\n   "value": 0.0,\n   "unit": "s",\n   "low_95": null' in text
        basis = basis_of(ident.read_arm(DATA / "lcd_arm" / "arm.toml"), DesignOptions(), fit=taken)
        assert _checked_text(basis, ()), "design can write it"
    curved = Spring("spring1", "joint1", "torsion", ratio2=1.5, ratio3=2.0, torque1=100.0, torque2=1e4)
    damping = found(exact("constant"))
    assert damping.carried
    assert not replace(damping, arm=replace(lcd_arm(), springs=(curved,))).carried
    assert remark_on((), damping=False) == OTHER_LAW
