"""`ident.motion` from Python: what it recommends, what it writes, and what it says of draws."""

import re
from dataclasses import replace
from functools import partial

import equinox as eqx
import numpy as np
import pytest
from arms import DATA, file_with_limits
from commands import posterior
from knobs import table
from moving_engines import MujocoMoving
from mujoco_arm import BushedTransient, command_at, displacement, equilibrium
from oracles import table_of
from reports import assert_one_screen, too_wide
from results import assert_comes_back, assert_plain
from scipy.interpolate import CubicSpline

import ident
from ident.errors import InputError
from ident.measure import read_log
from ident.studies.cure.motion_study import MotionStudy, Wanted, share_of_motion
from ident.vibrate.motion import stroke
from ident.vibrate.replay import replay
from ident.vibrate.simulate import simulate

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("one_size")]

FILE = DATA / "lcd_arm" / "arm.toml"
FILE_ARM = ident.read_arm(FILE).arm
STROKE = FILE_ARM.stroke
STIFFNESSES = [f"joint{n}.{kind}" for n in (1, 2, 3) for kind in ("k_bend", "k_tors")]
LIMIT = 0.6
FULL = {"time": 6.0, "segments": 4}
"""At full speed, where motions are short."""


@pytest.fixture(scope="module")
def limited(tmp_path_factory):
    """The arm whose joints have the limits of its stroke at full speed, which say no more: one arm for all programs."""
    path = tmp_path_factory.mktemp("limited") / "arm.toml"
    rates = np.array([float(x) for x in (STROKE.speed, STROKE.acceleration, STROKE.jerk)])
    path.write_text(file_with_limits(np.outer(rates, np.abs(STROKE.direction))))
    return path


@pytest.fixture(scope="module")
def result(limited):
    return ident.motion(limited, limit=LIMIT, segments=5)


@pytest.fixture(scope="module")
def quick(limited):
    return ident.motion(limited, speed=100.0, profile="trapezoid", rate=125.0, limit=0.6, **FULL)


def test_the_speed_along_the_path_vibrates_less_in_the_least_time(result):
    as_it_is, *others, found = result.motions.candidates
    assert (as_it_is.kind, found.kind) == ("as it is", "along the path")
    assert result.motions.recommended is found
    assert found.time == result.time < 28.0 < as_it_is.time
    assert 0.9 * LIMIT < 1e3 * result.vibration <= LIMIT < 1e3 * as_it_is.worst
    assert result.vibration == pytest.approx(found.worst, rel=0.02)  # exact equations, worst phases
    slower = next(each for each in others if each.kind == "speed")
    assert 1e3 * slower.worst <= LIMIT
    assert slower.time > as_it_is.time
    assert [each.name for each in others if each.kind == "profile"] == ["s-curve", "trapezoid", "minimum-jerk"]
    assert not result.short
    unmet = replace(result, motions=replace(result.motions, wanted=Wanted(1e-7)))
    assert unmet.short
    assert unmet.sections().verdict.word == "NOT MET"


def test_the_best_knobs_have_the_numbers_to_type_and_keep_both_limits(limited, tmp_path):
    """The motion lasts D / v + T + w: a trapezoid of ramps T over the distance D, averaged over the jerk time w.

    The recommended one is simulated by itself: nowhere above one limit, below the other one in time.
    """
    path = tmp_path / "arm.toml"
    path.write_text(limited.read_text() + "".join(map(table, ("speed", "ramp", "jerk time"))))
    result = ident.motion(path, speed=60.0, limit=0.9, settled=0.4, segments=4, rate=125.0)
    best = next(each for each in result.motions.candidates if each.kind == "best")
    words = re.fullmatch(r"VEL (\d+) %, ACC_T (\d+) ms, JERK_T (\d+) ms", best.typed)
    share, ramp, rise = (float(each) for each in words.groups())
    assert ramp % 4 == rise % 4 == 0
    distance = abs(float(STROKE.folded - STROKE.unfolded))
    took = distance / (share / 100 * float(STROKE.speed)) + ramp / 1e3 + rise / 1e3
    assert best.time == pytest.approx(took, rel=1e-9)
    report = " ".join(result.report().split())
    assert f"Best knobs: {best.typed}." in report
    assert "keeps the limit of 0.9 mm and settles to 0.4 mm within" in report
    advised = result.motions.recommended
    held = advised.motion.dwell(advised.ready - advised.motion.arrival + 2.0)
    run = simulate(FILE_ARM, held, rate=200.0)
    size = np.abs(np.asarray(run.vibration))
    assert 1e3 * size.max() < 0.9 * 1.01  # of the fast method: the limit holds by the exact one
    assert 1e3 * size[:, np.asarray(run.time) > advised.ready].max() < 0.4


def test_the_figure_shows_the_knobs_where_they_are_recommended(limited, tmp_path, monkeypatch):
    monkeypatch.setattr(MotionStudy, "recommended", property(lambda study: study.best_knobs))
    path = tmp_path / "arm.toml"
    path.write_text(limited.read_text() + "".join(map(table, ("speed", "ramp", "jerk time"))))
    result = ident.motion(path, speed=60.0, limit=0.9, segments=4, rate=125.0)
    best, along = result.motions.best_knobs, result.motions.candidates[-1]
    assert best.time != pytest.approx(along.time, abs=0.1)
    figure = result.figures()[""]
    above, below = (axes.lines[1] for axes in figure.axes)
    assert below.get_xdata()[-1] == pytest.approx(best.time + result.options.dwell, abs=0.02)
    assert below.get_ydata().max() == pytest.approx(1e3 * best.worst, rel=1e-9)
    speed = np.degrees(np.abs(np.asarray(best.motion(np.linspace(0.0, best.time, 1001))[1])).max(1))[0]
    assert above.get_ydata().max() == pytest.approx(speed / abs(float(STROKE.direction[0])), rel=0.01)
    assert "best knobs" in [text.get_text() for text in figure.legends[0].get_texts()]


def test_known_phases_are_no_matter_of_the_motion(result):
    scheduling = result.motions.scheduling
    known = replace(scheduling, evaluator=replace(scheduling.evaluator, unknown=()))
    share = share_of_motion(known, result.motions.basis.motion)
    assert share == pytest.approx(result.motions.share_of_motion, rel=1e-9)
    assert share < 0.05


def test_a_time_out_of_reach_is_refused(result):
    with pytest.raises(InputError, match="time: got 10 s, expected at least"):
        result.motions.scheduling.least_vibration(10.0)


def test_it_comes_back_and_fits_a_screen(result, tmp_path):
    assert_plain(assert_comes_back(result, tmp_path).table())
    assert_one_screen(result.report(), files=3)
    assert "* beyond the arm file's limit of jerk: not recommended." in result.report()
    assert not too_wide(result.report(details=True))
    assert [path.name for path in result.save_figures(tmp_path)] == ["arm.extend-10.motion.png"]


def test_the_joint_path_that_is_written_is_the_motion(quick, tmp_path):
    csv = next(path for path in quick.save(tmp_path) if path.suffix == ".csv")
    log, study = read_log(csv, ["joint1", "joint2", "joint3"]), quick.motions
    angles = np.stack(list(log.angles.values()))
    np.testing.assert_allclose(angles, np.asarray(study.schedule.motion(log.time)[0]), atol=1e-9)
    again = study.scheduling.vibration(replay(log.time, angles))
    assert float(again.worst.max()) == pytest.approx(study.candidates[-1].worst, rel=0.01)


def test_another_engine_confirms_what_is_proposed(result):
    """MuJoCo's equations, integrated by MuJoCo, about the equilibria that MuJoCo has of the arm held there.

    With hinges in series for bushings (`MujocoTransient`) the peak was 1.1 % off, by the weight of eccentric masses,
    which 121 equilibria sample too coarsely, 0.2 % more; half the step changes 1e-7. Bushings and equilibria of
    centred masses are 2e-6 off.
    """
    study = result.motions
    motion = study.schedule.motion.dwell(2.0)
    arm = study.basis.arm.replace(study.after.worst_phases())
    table, end = table_of(motion), float(motion.breaks[-1]) - 5e-3
    found = BushedTransient(arm, table, end).run(1e-3, every=4)
    centred = MujocoMoving(arm.replace({f"{drive.name}.eccentricity": 0.0 for drive in arm.drives}))
    some = np.linspace(0.0, found.time[-1], 121)
    still = [np.array([[1.0], [0.0], [0.0]]) * command_at(table, t) for t in some]
    rest = np.stack([equilibrium(centred, each) for each in still], 1)
    sagging = CubicSpline(some, displacement(centred, table, some, rest), axis=1)(found.time)
    peak = np.abs(found.displacement - sagging).max()
    assert peak == pytest.approx(result.vibration, rel=1e-4)
    assert peak < 1e-3 * result.options.limit


def test_along_a_given_path_joints_keep_their_limits(limited, quick, run, tmp_path, monkeypatch):
    """The stroke's own path, logged, with its limits on the joints.

    That the search finds there what it finds along the stroke is tested in `tests/studies/test_remedies.py`.
    """
    log, searched = tmp_path / "path.csv", []
    motion = stroke(STROKE, percent=100.0)
    time = np.arange(0.0, motion.arrival, 0.01)
    columns = np.column_stack([time, *np.degrees(motion(time)[0])])
    np.savetxt(log, columns, "%.10g", ",", header="time [s],joint1 [deg],joint2 [deg],joint3 [deg]", comments="")

    def found(basis, scheduling, **asked):
        searched.append(scheduling)
        return replace(quick.motions, basis=basis, scheduling=scheduling, wanted=asked["wanted"])

    monkeypatch.setattr("ident.studies.cure.motion_study.motions", found)
    result = ident.motion(limited, path=log, limit=0.75, **FULL)
    given = ("--path", log, "--limit", "0.75", "--time", FULL["time"], "--segments", FULL["segments"])
    code, out, _ = run("motion", limited, *given, "--no-figure")
    assert (code, out.partition("Next:")[0]) == (0, result.report().partition("Next:")[0]), "a command does the same"
    (search, _), own, any_speed = searched, quick.motions.scheduling, np.full(FULL["segments"] - 1, np.inf)
    fastest = search.schedule(any_speed)
    assert fastest.duration == pytest.approx(own.schedule(any_speed).duration, rel=0.02)
    for schedule in (fastest, search.in_time(fastest, FULL["time"])):
        q, qd, _ = (np.asarray(part) for part in schedule.motion(np.arange(0.0, schedule.duration, 1e-3)))
        np.testing.assert_allclose(q, np.array([1, -2, 1])[:, None] * q[0], atol=1e-6)
        assert (np.abs(qd).max(1) <= search.path.limits[0] * (1 + 1e-6)).all()
    assert str(log) not in result.report().split("Next:")[1]
    assert_one_screen(result.report(), files=3)
    assert not too_wide(result.report(details=True))


def test_it_is_no_faster_than_the_limits_allow(result):
    path, motion = result.motions.basis.arm.stroke, result.motions.schedule.motion
    time = np.arange(0.0, motion.arrival, 4e-4)
    _, qd, qdd = (np.asarray(part)[0] for part in motion(time))
    assert np.abs(qd).max() <= 0.1 * float(path.speed) * (1 + 1e-9)
    assert np.abs(qdd).max() <= float(path.acceleration)
    assert np.abs(np.diff(qdd)).max() / 4e-4 <= float(path.jerk) * (1 + 1e-6)
    assert motion.arrival > stroke(path, percent=10.0, profile="trapezoid").arrival


def left_by_the_motion(arm, motion, loads):
    """Vibration after the arrival by the exact equations, drives centred: what the motion itself makes [m]."""
    centred = arm.replace({f"{drive.name}.eccentricity": 0.0 for drive in arm.drives})
    response = simulate(centred, motion.dwell(0.5), loads=loads, method="exact", rate=250.0)
    return float(np.abs(response.vibration)[:, np.asarray(response.time) >= motion.arrival].max())


def test_at_full_speed_shapers_leave_less_after_the_arrival(quick):
    """And the time that was asked for is kept. Measured by the exact equations, of what the motion as it is leaves,
    1.50 mm: ZV 36 %, MZV 26 %, ZVD 21 %, EI 25 %, 2HEI 20 % (for more than one period), ZV x ZV 27 %, mid-mode ZVD 6 %.
    """
    study = quick.motions
    now, *others = study.candidates
    assert quick.time == others[-1].time == pytest.approx(FULL["time"], rel=1e-6)
    assert study.share_of_motion > 0.5
    assert_one_screen(quick.report(), files=4)
    assert "2HEI shaper" not in quick.report()
    assert "2HEI shaper" in quick.report(details=True)
    period = 1 / study.bands[1, 0, -1]
    arm = study.basis.arm
    each = {other.name: other for other in others if other.kind == "shaper" and other.time <= now.time + period}
    assert list(each) == [f"{name} shaper" for name in ("ZV", "MZV", "ZVD", "EI", "ZV x ZV", "mid-mode ZVD")]
    best = each["mid-mode ZVD shaper"].motion
    left_by = partial(left_by_the_motion, loads=study.scheduling.evaluator.loads)
    before = left_by(arm, now.motion)
    assert left_by(arm, each["ZV x ZV shaper"].motion) < 0.4 * before
    assert left_by(arm, best) < 0.2 * before
    rng = np.random.default_rng(1)
    off = arm.replace({path: float(arm.get(path)) * np.exp(0.03 * rng.normal()) for path in STIFFNESSES})  # by 3 %
    assert left_by(off, best) < 0.2 * left_by(off, now.motion)


def test_draws_judge_and_fresh_ones_verify(limited, tmp_path):
    posterior(tmp_path / "draws.nc")
    motion = {"speed": 100.0, "profile": "trapezoid"} | FULL
    result = ident.motion(limited, posterior=tmp_path / "draws.nc", draws=4, fresh=16, **motion)
    kept = result.motions.verification.keeps
    assert (kept.draws, result.keeps) == (16, kept.share)
    assert all(len(each.peaks) == 4 for each in result.motions.candidates)
    *others, found = result.motions.candidates
    few = replace(found, peaks=np.ones(4), verification=replace(result.motions.verification, keeps=None))
    alone = replace(result, motions=replace(result.motions, candidates=(*others, few)))
    assert alone.keeps is None
    assert not alone.motions.met(few)  # without fresh draws those that it was judged by count


def test_an_arm_without_drives_that_excite_has_nothing_to_choose():
    balanced = {f"drive{k}.eccentricity": 0.0 for k in (1, 2, 3)}
    with pytest.raises(InputError, match=r"no drive that excites, expected .*eccentricity"):
        ident.motion(FILE, set=balanced)
    arm = ident.read_arm(FILE).arm
    with pytest.raises(InputError, match="no drive that excites"):
        ident.motion(eqx.tree_at(lambda arm: (arm.drives, arm.belts), arm, ((), ())))


def test_a_motion_on_which_a_belt_goes_slack_is_not_confirmed(limited):
    """Of known phases, so that each motion has one peak."""
    motion = {"speed": 100.0, "profile": "trapezoid", "phases": "file", "set": {"belt1.pretension": 0.0}} | FULL
    result = ident.motion(limited, limit=0.75, **motion)
    assert {each.peaks.shape for each in result.motions.candidates} == {(1,)}
    assert "belt1" in result.motions.verification.slack
    assert result.motions.recommended is None
    assert "belt1 go slack: not confirmed" in result.report()


def test_a_path_that_starts_moving_is_refused(tmp_path):
    time = np.linspace(0.0, 10.0, 51)
    columns = np.column_stack([time, 100 - 4 * time, 8 * time - 200, 100 - 4 * time])
    head = "time [s],joint1 [deg],joint2 [deg],joint3 [deg]"
    np.savetxt(tmp_path / "path.csv", columns, "%.10g", ",", header=head, comments="")
    with pytest.raises(InputError, match="a motion from rest without such jumps"):
        ident.motion(FILE, path=tmp_path / "path.csv")
