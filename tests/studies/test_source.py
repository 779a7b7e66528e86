"""`ident.source`: from traces of the moving arm to imbalance and transmission error, and to other commands."""

import shutil
from dataclasses import replace

import numpy as np
import pytest
import source_runs
from arms import DATA
from diagnose_small import OPTIONS as SMALL_OPTIONS
from reports import assert_one_screen, too_wide
from results import assert_comes_back, assert_plain
from source_runs import FILE, HEAD, TRUTH, measure, one_core, table  # noqa: F401

import ident
from ident.arm.arm import stiffness_paths
from ident.arm.chain import no_loads
from ident.description.file import read_arm
from ident.errors import InputError
from ident.measure.grade import clipped
from ident.measure.runs import read_runs, write_runs
from ident.studies.basis import assumption_findings
from ident.studies.cause import source_plan
from ident.studies.cause import source_study as source
from ident.studies.cause.run_problem import with_clocks, with_notes
from ident.studies.cause.source_study import _predicted, _refuse_late
from ident.studies.cure.cures import cures
from ident.studies.cure.diagnose import Job
from ident.studies.cure.diagnosis import ResonanceAssessment, stages_of
from ident.studies.result import silent
from ident.studies.saved import files_of
from ident.vibrate.motion import stroke
from ident.vibrate.simulate import simulate
from ident.vibrate.source_causes import WIDTH, Band
from ident.vibrate.sweep import Sensitivities

STATED = HEAD.replace("load", "load,delay [s]")
"""Head of a table that states when the motion starts."""


@pytest.fixture(scope="module")
def true_arm():
    return source_runs.true_arm()


@pytest.fixture(scope="module")
def folder(tmp_path_factory, true_arm):
    place = tmp_path_factory.mktemp("runs")
    shutil.copy(FILE, place)
    for seed, speed in enumerate((12.0, 15.0)):
        measure(place, true_arm, speed, offset=0.01 * (-1) ** seed, seed=seed)
    return place


@pytest.fixture(scope="module")
def result(folder):
    return ident.source(table(folder, (12.0,)))


@pytest.fixture(scope="module")
def asked(folder, true_arm):
    """Of two runs, with the cause of a peak, and a third that is predicted."""
    measure(folder, true_arm, 10.0, seed=7)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(source, "FURTHER", (10.0,))
        return ident.source(table(folder, (12.0, 15.0, 10.0), "three.csv"), hold_out=["run10.csv"], peak=9.0)


@pytest.fixture
def one_further(monkeypatch):
    """Ask for what a single further run would tell, where a test does not look at that."""
    monkeypatch.setattr(source, "FURTHER", (10.0,))


def test_it_finds_what_excites_the_arm(result):
    assert not result.doubtful
    assert result.sections().verdict.word in ("IDENTIFIED", "PARTLY 5 OF 6", "PARTLY 4 OF 6")
    told = [row for row in result.table() if row["told"]]
    assert {(row["drive"], row["kind"]) for row in told} >= {("drive2", "imbalance"), ("drive3", "imbalance")}
    for row in result.table():
        size, phase = ("eccentricity", "phase") if row["kind"] == "imbalance" else ("error", "error_phase")
        expected = TRUTH[f"{row['drive']}.{size}"]
        assert abs(row["amplitude"] - expected) < 4 * row["sd"]
        turned = np.angle(np.exp(1j * (row["phase"] - TRUTH[f"{row['drive']}.{phase}"])))
        assert not row["told"] or abs(turned) < 4 * row["phase_sd"]
    assert result.study.found.explained.min() > 0.9
    strongest = next(row for row in result.table() if row["drive"] == "drive2" and row["kind"] == "imbalance")
    assert strongest["sd"] < 0.02 * strongest["amplitude"]


def test_what_is_not_told_names_the_run_that_would_tell(result):
    hidden = [row for row in result.table() if not row["told"]]
    speed, _ = result.study.next_run
    assert bool(hidden) == bool(result.study.further)
    assert not hidden or f"add a run at {speed:g} %" in result.report(details=True)
    now = [each.sd for each in result.study.found.estimates]
    assert all((sd <= now).all() for sd in result.study.further.values())


def test_clock_and_stiffness_are_found_with_it(result, true_arm):
    found = result.study.found
    assert found.place.clock[0, 0] == pytest.approx(0.01, abs=0.004)
    sd = dict(zip(found.problem.prior.groups, np.sqrt(np.diag(found.covariance)), strict=False))
    for path in stiffness_paths(true_arm):
        assert abs(np.log(result.parameters[path] / float(true_arm.get(path)))) < 4 * sd[path]
    assert sd["joint3.k_bend"] < 0.01  # known to 10 % before


@pytest.mark.slow
@pytest.mark.usefixtures("one_further")
def test_an_uncertain_calibration_widens_amplitudes_not_phases(folder, result):
    """Two sensors, each known to 5 %, see drive 2's imbalance: between 5 % / sqrt(2) and 5 % more, in quadrature.

    What makes a peak is told nevertheless: a trace that its calibration scaled at will would explain itself.
    """
    loose = ident.source(table(folder, (12.0,), "loose.csv"), calibration=5.0, peak=9.0)
    assert (loose.causes[0]["kind"], loose.causes[0]["told"]) == ("imbalance", True)
    before, after = (
        next(row for row in every.table() if (row["drive"], row["kind"]) == ("drive2", "imbalance"))
        for every in (result, loose)
    )
    more = np.sqrt(after["sd"] ** 2 - before["sd"] ** 2) / after["amplitude"]
    assert 0.95 * 0.05 / np.sqrt(2) < more < 1.05 * 0.05
    assert after["phase_sd"] < 1.2 * before["phase_sd"]
    assert abs(after["amplitude"] / before["amplitude"] - 1) < 2 * more
    found, runs = loose.study.found, read_runs(folder / "loose.csv")
    wrong = found.place.calibration + np.array([0.1, 0.0])
    sizes = [
        [np.abs(each.computed).max() for each in _predicted(one, runs, "run12.csv", ["run12.csv"])]
        for one in (found, replace(found, place=found.place._replace(calibration=wrong)))
    ]
    assert np.divide(sizes[1], sizes[0]) == pytest.approx((1 + wrong) / (1 + found.place.calibration), rel=1e-3)


def test_a_clock_that_its_prior_holds_back_counts_as_moved(result):
    """A rate of 0.28 % against one of 0.01 % (sd) beforehand; and a sensor turned by 10 degrees against 2."""
    found, place = result.study.found, result.study.found.place
    assert not result.study.moved
    for change, text in (
        ({"clock": place.clock + np.array([0.0, -2.755e-3])}, "clock of run12.csv would have to be -0.28 % off"),
        ({"tilt": place.tilt + np.deg2rad(10.0)}, "direction of run12.csv y would have to move by"),
    ):
        off = replace(result, study=replace(result.study, found=replace(found, place=place._replace(**change))))
        assert off.doubtful
        assert off.sections().verdict.word == "NOT USABLE"
        assert any(finding.text.startswith(text) for finding in off.sections().findings)


def test_a_left_out_run_that_is_not_predicted_makes_the_result_doubtful(folder, result):
    """Its clock 0.3 % off, or its speed; it is predicted itself, and noise of twice the vibration is no doubt."""
    record, found = np.loadtxt(folder / "run12.csv", delimiter=",", skiprows=1), result.study.found
    rng = np.random.default_rng(1)
    for name, factor in (("slow", 1.003), ("speed", 1.02)):
        rows = np.column_stack([record[:, 0] * factor, record[:, 1:]])
        np.savetxt(folder / f"{name}.csv", rows, "%.7g", ",", header="time [s],y [mm],z [mm]", comments="")
    names = ("run12.csv", "slow.csv", "speed.csv")
    rows = [f"{name},{way},{way},12,a,\n" for name in names for way in "yz"]
    (folder / "left.csv").write_text(HEAD + "".join(rows))
    runs = read_runs(folder / "left.csv")
    right, slow, speed = (_predicted(found, runs, name, ["run12.csv"]) for name in names)
    loud = [
        replace(each, shown=each.shown + 2 * sd * rng.standard_normal(len(each.shown)), noise=4 * sd**2)
        for each, sd in ((each, each.shown.std()) for each in right)
    ]
    for held in (right, loud):
        assert not replace(result.study, held=tuple(held)).doubtful
    for held, text in ((slow, "its clock or speed looks -0.3 % off"), (speed, "check speed, load")):
        off = replace(result, study=replace(result.study, held=tuple(held)))
        assert off.doubtful
        assert off.sections().verdict.word == "DOUBTFUL"
        assert any(
            finding.text.startswith("left out") and text in finding.remedy for finding in off.sections().findings
        )


def test_it_comes_back_and_fits_a_screen(result, tmp_path):
    assert_plain(assert_comes_back(result, tmp_path).table())
    assert_one_screen(result.report(), files=2)
    assert not too_wide(result.report(details=True))
    assert [path.name for path in result.save_figures(tmp_path)] == ["runs.source.png"]


def test_other_commands_take_its_draws(result, true_arm, tmp_path):
    """The peak of a run is that of the true arm; phases and imbalance count as known."""
    (file,) = result.save(tmp_path)
    simulated = ident.simulate(FILE, posterior=file, speed=12.0, draws=16, rate=200.0)
    assert not simulated.simulation.basis.unknown.phases
    motion = stroke(true_arm.stroke, percent=12.0, dwell=2.0)
    true = simulate(true_arm, motion, loads=no_loads(true_arm), rate=200.0).vibration
    peaks = simulated.draws.sizes.peak[1]
    assert abs(np.abs(true[1]).max() - peaks.mean()) < 4 * peaks.std(ddof=1)
    assert peaks.std(ddof=1) < 0.02 * peaks.mean()
    assert not any("the imbalance" in str(each) for each in assumption_findings(simulated.simulation.basis))


def test_its_file_names_all_that_repeats_it(folder, result, tmp_path):
    (file,) = result.save(tmp_path)
    inputs = ident.load(file).inputs
    assert {"runs's run12.csv", "runs", "arm"} <= set(inputs)
    assert files_of(inputs, folder).paths == {"arm": folder / "arm.toml", "runs": folder / "runs.csv"}


@pytest.mark.slow
@pytest.mark.usefixtures("one_further")
@pytest.mark.timeout(900)
def test_a_diagnosis_takes_what_excites_the_arm_from_runs(folder, result, monkeypatch):
    """Without trust, resonance and slopes, with a limit that is kept: all that follows from the runs, and masses."""
    torsion, ones = tuple(f"joint{n}.k_tors" for n in (1, 2, 3)), np.ones(3)
    slopes = Sensitivities(torsion, ones, ones, np.eye(3), np.zeros((3, 3), bool))
    monkeypatch.setattr("ident.vibrate.sweep.sensitivities", lambda *_: slopes)
    monkeypatch.setattr("ident.studies.cure.diagnosis.assess_trust", lambda *_: ())
    monkeypatch.setattr("ident.studies.cure.diagnosis.assess_resonance", lambda *_: ResonanceAssessment())
    arm, campaign = folder / "arm.toml", DATA / "lcd_arm" / "campaign.csv"
    options = replace(SMALL_OPTIONS, limit=1000.0, starts=1)
    diagnosed = ident.diagnose(arm, campaign, options, runs=table(folder, (12.0,), "one.csv"))
    diagnosis = diagnosed.diagnosis
    assert diagnosis.stages == stages_of(runs=True)[:-2]
    rotors = diagnosis.excited.rotors
    assert rotors
    monkeypatch.setattr("ident.studies.cure.cures.single_remedies", lambda *_: [])
    monkeypatch.setattr("ident.studies.cure.cures.along_path", lambda *_: None)
    (mounted,) = cures(diagnosis.task, 1.0, rotors)
    assert (mounted.kind, mounted.rotors) == ("balance", rotors)
    assert (mounted.amplitude < diagnosis.vibration.amplitude).all()
    assert not diagnosed.doubtful
    basis = diagnosis.task.basis
    assert not basis.unknown.phases
    strongest = basis.draws["drive2.eccentricity"] * float(basis.arm.get("drive2.eccentric_mass"))
    truth = TRUTH["drive2.eccentricity"] * float(read_arm(FILE).arm.get("drive2.eccentric_mass"))
    assert abs(strongest.mean() - truth) < 4 * strongest.std()
    assert set(ident.load(diagnosed.save(folder / "out")[0]).inputs) >= {"campaign", "runs", "runs's run12.csv"}
    report = diagnosed.report(details=True)
    assert "What excites the arm?" in report
    assert "drive2 imbalance" in report
    spoilt = replace(diagnosis.excited.study.found, settled=False)
    excited = replace(diagnosis.excited, study=replace(diagnosis.excited.study, found=spoilt))
    useless = replace(diagnosed, diagnosis=replace(diagnosis, excited=excited))
    assert useless.doubtful
    report = useless.sections()
    assert report.verdict.word == "NOT DECIDED"
    assert "did not settle" in report.verdict.reason
    assert report.next == f"ident source {folder / 'one.csv'} --arm {arm}"


def test_a_diagnosis_is_of_the_contents_of_its_runs(folder, tmp_path):
    """An unfinished one goes on with the same recordings alone, wherever they are; what is wrong comes first."""
    shutil.copytree(folder, tmp_path / "copy")
    campaign, arm = ident.read_campaign(DATA / "lcd_arm" / "campaign.csv"), ident.read_arm(FILE)

    def identity(place):
        runs = read_runs(table(place, (12.0,), "one.csv"))
        return Job(arm, campaign, SMALL_OPTIONS, None, runs, None, silent).identity["runs"]

    assert identity(folder) == identity(tmp_path / "copy")
    record = (tmp_path / "copy" / "run12.csv").read_text()
    (tmp_path / "copy" / "run12.csv").write_text(record.rstrip() + "1\n")
    assert identity(folder) != identity(tmp_path / "copy")
    (folder / "far.csv").write_text(HEAD + "run12.csv,y,y,12,a,crane\n")
    with pytest.raises(InputError, match="crane"):
        ident.diagnose(FILE, campaign, SMALL_OPTIONS, runs=folder / "far.csv", folder=tmp_path / "part")
    assert not (tmp_path / "part").exists()


@pytest.mark.slow
def test_two_runs_predict_a_third(asked):
    assert not asked.doubtful
    assert [each.channel.name for each in asked.study.held] == ["run10.csv y", "run10.csv z"]
    for each in asked.study.held:
        assert each.explained > 0.85
        assert each.ratio == pytest.approx(1.0, abs=0.08)


@pytest.mark.slow
@pytest.mark.usefixtures("one_further")
def test_groups_that_disagree_are_no_result(folder):
    """Runs of different phase groups share the amplitudes: one that is half as large again contradicts the other."""
    record = np.loadtxt(folder / "run15.csv", delimiter=",", skiprows=1)
    record[:, 1:] *= 1.5
    np.savetxt(folder / "run15.5.csv", record, "%.6g", ",", header="time [s],y [mm],z [mm]", comments="")
    rows = [f"run12.csv,{way},{way},12,a,\n" for way in "yz"] + [f"run15.5.csv,{way},{way},15,b,\n" for way in "yz"]
    (folder / "groups.csv").write_text(HEAD + "".join(rows))
    result = ident.source(folder / "groups.csv")
    assert result.sections().verdict.word == "NOT USABLE"
    assert result.study.contradicting


@pytest.mark.slow
@pytest.mark.usefixtures("one_further")
def test_its_draws_are_a_posterior_for_itself_and_noise_makes_no_doubt(folder, result, tmp_path):
    (file,) = result.save(tmp_path)
    record = np.loadtxt(folder / "run15.csv", delimiter=",", skiprows=1)
    noise = np.random.default_rng(3).standard_normal(record[:, 1:].shape)
    record[:, 1:] += 1.3 * record[:, 1:].std(0) * noise
    np.savetxt(folder / "run15.2.csv", record, "%.6g", ",", header="time [s],y [mm],z [mm]", comments="")
    (folder / "noisy.csv").write_text(HEAD + "".join(f"run15.2.csv,{way},{way},15,a,\n" for way in "yz"))
    noisy = ident.source(folder / "noisy.csv", posterior=file)
    assert not noisy.doubtful
    assert noisy.study.found.explained.max() < 0.5


@pytest.mark.slow
@pytest.mark.usefixtures("one_further")
def test_a_run_under_another_load_is_noticed(folder, true_arm):
    result = ident.source(table(folder, (12.0,), "glass.csv", load="glass"))
    assert result.doubtful
    assert result.sections().verdict.word == "NOT USABLE"
    assert "95 %" not in result.report().partition("Most")[2]


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        (("y,y", "w,y"), "expected one of y, z"),
        (("y,y", "y,up"), "expected x, -z"),
        ((",12,", ",-12,"), "a number above 0"),
        (("run12.csv,z,z,12,a", "run12.csv,z,z,11,a"), "that of"),
        (("a,", "a,crane"), "wrong.csv:2, load: got 'crane'"),
        (("direction", "way"), "the unknown column"),
        ((",12,", ",,"), "neither speed nor path"),
        ((",12,", ",1e9,"), "wrong.csv:2, speed: got '1e9'"),
        (("speed [%]", "speed [rad/s]"), "% of full speed"),
        (("group", "direction"), "the column twice"),
    ],
)
def test_what_is_wrong_in_the_table_is_said(folder, change, complaint):
    text = table(folder, (12.0,), "wrong.csv").read_text()
    (folder / "wrong.csv").write_text(text.replace(*change))
    with pytest.raises(InputError) as refused:
        ident.source(folder / "wrong.csv")
    assert complaint in str(refused.value)


@pytest.mark.parametrize(
    ("spoil", "complaint"),
    [
        (lambda v: np.clip(v, -0.3 * np.abs(v).max(), None), "clipped"),
        (lambda v: np.where(np.arange(len(v)) % 100 < 60, np.nan, v), "times off even ones by 173 ms rms"),
        (lambda v: v[:400], "turns of the fastest pulley"),
        (lambda v: 0 * v + 0.5, "0.5 in all samples"),
    ],
)
def test_what_is_wrong_in_a_record_is_said(folder, spoil, complaint):
    record = np.loadtxt(folder / "run12.csv", delimiter=",", skiprows=1)
    spoilt = spoil(record[:, 1])
    record = np.column_stack([record[: len(spoilt), 0], spoilt, record[: len(spoilt), 2]])
    np.savetxt(folder / "run99.csv", record, "%.6g", ",", header="time [s],y [mm],z [mm]", comments="")
    (folder / "wrong.csv").write_text(STATED + "run99.csv,y,y,12,a,,0\n")
    with pytest.raises(InputError, match=complaint):
        ident.source(folder / "wrong.csv")


def test_a_clock_beyond_the_offset_is_named_where_its_delay_is_stated_and_found_else(folder):
    """A recorder that starts 0.3 s early is found beyond 50 ms; one 10 ms off is not complained of, and stays."""
    record = np.loadtxt(folder / "run12.csv", delimiter=",", skiprows=1)
    record[:, 0] += 0.3
    np.savetxt(folder / "run12.3.csv", record, "%.6g", ",", header="time [s],y [mm],z [mm]", comments="")
    (folder / "late.csv").write_text(STATED + "".join(f"run12.3.csv,{way},{way},12,a,,0\n" for way in "yz"))
    arm = read_arm(FILE).arm
    with pytest.raises(InputError, match=r"run12.3.csv: got a clock -\d+ ms off the motion's, expected at most 50 ms"):
        _refuse_late(arm, read_runs(folder / "late.csv"), ["run12.3.csv"], 0.05)
    right = read_runs(table(folder, (12.0,), "one.csv"))
    _refuse_late(arm, right, ["run12.csv"], 0.05)
    assert with_clocks(arm, right).clocks == {}
    (folder / "found.csv").write_text(HEAD + "".join(f"run12.3.csv,{way},{way},12,a,\n" for way in "yz"))
    found = with_clocks(arm, read_runs(folder / "found.csv"))
    assert found.clocks["run12.3.csv"].offset == pytest.approx(0.01 - 0.3, abs=0.01)
    assert found.traces[0].time[0] == pytest.approx(right.traces[0].time[0] + 0.01, abs=0.02)
    (note,) = with_notes(arm, found).notes
    assert note.startswith("run12.3.csv: clock found from the motion, delay -0.2")
    assert note.endswith("ppm")


@pytest.mark.parametrize(
    ("unit", "sensitivity", "complaint"),
    [
        ("mm", "", "'mm', as in the file"),
        ("V", "", "'V', as in the file; give its sensitivity"),
        ("m/s^2", "100", "a sensitivity of channel 'y', whose file is in"),
        ("", "", "no unit"),
    ],
)
def test_a_unit_that_the_file_does_not_have_is_refused(folder, unit, sensitivity, complaint):
    text = (folder / "run12.csv").read_text()
    (folder / "volts.csv").write_text(text.replace("y [mm]", f"y [{unit}]" if unit else "y"))
    head, row = (
        "file,channel,direction,speed [%],unit,sensitivity",
        f"volts.csv,y,y,12,{unit and 'm/s^2'},{sensitivity}",
    )
    (folder / "wrong.csv").write_text(f"{head}\n{row}\n")
    with pytest.raises(InputError, match=complaint):
        ident.source(folder / "wrong.csv")


def test_coarse_digits_are_not_taken_for_clipping():
    time = np.arange(0.0, 2.0, 1e-3)
    sine = np.round(20 * np.sin(2 * np.pi * 5 * time))  # forty steps from end to end
    assert clipped(sine) == 0
    assert clipped(np.clip(np.sin(2 * np.pi * 5 * time) + 1e-6 * time, -1.0, 0.5)) > 50


def test_a_table_to_fill_in_names_all_channels(folder, tmp_path):
    shutil.copy(folder / "run12.csv", tmp_path)
    assert write_runs(tmp_path, tmp_path / "runs.csv") == 2
    text = (tmp_path / "runs.csv").read_text()
    assert "run12.csv,y,,,,mm" in text
    with pytest.raises(InputError, match="a file that is there"):
        write_runs(tmp_path, tmp_path / "runs.csv")


def test_triage_names_the_drive_without_anything_identified(folder, tmp_path):
    (folder / "triage.csv").write_text(HEAD + "run12.csv,y,y,12,a,\n")
    found = ident.triage(folder / "triage.csv")
    assert found.sections().verdict.word == "DRIVE"
    assert found.table()[0]["follows"].startswith("drive2 x 1")
    assert found.table()[0]["share"] > 0.5
    assert_plain(assert_comes_back(found, tmp_path).table())
    assert_one_screen(found.report(), files=2)
    assert [path.name for path in found.save_figures(tmp_path)] == ["triage.triage.png"]


def test_planned_runs_say_what_they_would_tell(folder, result, tmp_path, monkeypatch):
    """The run that was measured above, planned: as sure as it was, within a factor of two, and told where it told."""
    monkeypatch.setattr(source_plan, "FURTHER", (20.0,))
    monkeypatch.setattr(source_plan, "PARTS", source_plan.PARTS[1:2])
    (tmp_path / "planned.csv").write_text(
        "file,channel,direction,unit,speed [%],group\n" + "".join(f"a.csv,{w},{w},mm,12,a\n" for w in "yz")
    )
    planned = ident.plan(FILE, runs=tmp_path / "planned.csv")
    rows = {(row["drive"], row["kind"]): row for row in planned.table()}
    for row in result.table():
        if row["kind"] == "imbalance":  # of the errors' size the arm's file says nothing
            assert 0.5 < rows[row["drive"], row["kind"]]["sd"] / row["sd"] < 2
    gains = [each.gain for each in planned.plan.further]
    assert gains == sorted(gains, reverse=True)
    assert min(gains) > 0
    assert all((each.sd <= planned.plan.sd).all() for each in planned.plan.further)
    assert_one_screen(planned.report(), files=1)
    assert not too_wide(planned.report(details=True))
    assert_plain(assert_comes_back(planned, tmp_path).table())


@pytest.mark.slow
def test_an_accelerometer_s_noise_is_not_that_of_a_displacement(tmp_path, monkeypatch):
    """A further trace of acceleration takes nothing from what a further displacement would tell.

    No quick test plans a run with an accelerometer, nor one but over the folded half.
    """
    monkeypatch.setattr(source_plan, "FURTHER", (14.0,))
    best = []
    for rows in ("a.csv,y,y,m,12,a\n", "a.csv,y,y,m,12,a\nb.csv,y,y,m/s^2,12,b\n"):
        (tmp_path / "planned.csv").write_text("file,channel,direction,unit,speed [%],group\n" + rows)
        best.append(ident.plan(FILE, runs=tmp_path / "planned.csv").plan.further[0].gain)
    assert best[1] > 0.5 * best[0]


def test_planned_runs_need_a_unit_and_no_campaign(tmp_path):
    (tmp_path / "planned.csv").write_text("file,channel,direction,speed [%]\na.csv,y,y,12\n")
    with pytest.raises(InputError, match="no unit"):
        ident.plan(FILE, runs=tmp_path / "planned.csv")
    with pytest.raises(InputError, match="one of them"):
        ident.plan(FILE, DATA / "lcd_arm" / "campaign.csv", runs=tmp_path / "planned.csv")


@pytest.mark.slow
def test_a_peak_has_a_cause_on_the_first_screen(asked, true_arm, tmp_path):
    """It is what makes more of the band in simulations of the true arm with imbalances, or with errors, alone."""
    energy, motions = {}, [stroke(true_arm.stroke, percent=speed, dwell=1.0) for speed in (12.0, 15.0)]
    for kind, other in (("imbalance", "error"), ("error", "eccentricity")):
        alone = true_arm.replace({f"drive{k}.{other}": 1e-15 for k in (1, 2, 3)})  # none, by the program of the runs
        each = [simulate(alone, motion, loads=no_loads(alone), rate=200.0).measured for motion in motions]
        energy[kind] = sum(np.square(Band(9.0, WIDTH * 9.0, 200.0)(np.asarray(seen)[1:].T)).sum() for seen in each)
    assert asked.causes[0]["kind"] == max(energy, key=energy.get)
    assert asked.causes[0]["told"]
    assert "1. peak at 9 Hz: " in asked.report()
    assert "What makes the peak at 9 Hz?" in asked.report(details=True)
    assert_one_screen(asked.report(), files=2)
    assert not too_wide(asked.report(details=True))
    assert_plain(assert_comes_back(asked, tmp_path).table())
