"""Tables of runs: slips of the pen in units, times and speeds are refused in one line that names them."""

import shutil
from dataclasses import replace

import numpy as np
import pytest
from arms import DATA

import ident
from ident.arm.multibody import possible_orders
from ident.errors import InputError
from ident.measure.runs import read_runs, runs_of
from ident.studies.cause.run_problem import posed, with_notes
from ident.studies.cause.source_report import too_large
from ident.studies.cause.triage import moving_traces
from ident.vibrate.source_identification import Estimate

ARM = DATA / "lcd_arm" / "arm.toml"
RECORDED = (DATA / "lcd_arm" / "mujoco" / "run7.csv").read_text()
HEAD, TABLE = "file,channel,direction,speed [%]\n", "run7.csv,y,y,7\nrun7.csv,z,z,7\n"


def refused(folder, recorded=RECORDED, rows=TABLE):
    (folder / "run7.csv").write_text(recorded)
    (folder / "runs.csv").write_text(HEAD + rows)
    with pytest.raises(InputError) as error:
        moving_traces(ident.read_arm(ARM).arm, read_runs(folder / "runs.csv"))
    return str(error.value).replace(f"{folder}/", "").splitlines()[0]


def over_time(change):
    """Return the recording with its times [s] changed."""
    rows = np.loadtxt(RECORDED.splitlines()[2:], delimiter=",")
    rows[:, 0] = change(rows[:, 0])
    return "time [s],y [mm],z [mm]\n" + "".join(f"{t:.10g},{y:g},{z:g}\n" for t, y, z in rows)


@pytest.mark.parametrize(("unit", "times"), [("m", 0), ("km/s", 1), ("Mm/s^2", 2)])
def test_a_vibration_that_no_arm_has_is_a_wrong_unit(tmp_path, unit, times):
    """A twentieth of the reach, of links of 1, 1 and 2.79 m; at 25 Hz as a speed and as an acceleration."""
    reach = 2 * np.hypot(1.0, 0.12) + np.hypot(2.79, 0.05)
    bound = f"{0.05 * reach * (2 * np.pi * 25) ** times:.3g} {('m', 'm/s', 'm/s^2')[times]}"
    said = refused(tmp_path, RECORDED.replace("y [mm]", f"y [{unit}]").replace("z [mm]", f"z [{unit}]"))
    assert said.startswith("runs.csv:2, unit: got a vibration of ")
    assert said.endswith(f"in run7.csv y, expected at most {bound} of this arm; check the unit")


@pytest.mark.parametrize(
    ("column", "cell", "complaint"),
    [
        ("point", "tipp", "runs.csv:2, point: got tipp, expected one of "),
        ("trial", "12 g @ drive9 40 mm 0 deg", "runs.csv:2, trial: got drive9, expected one of drive1, drive2, drive3"),
        (
            "load",
            "12 N*m about y @ tip",
            "runs.csv:2, load: got a moment, expected payloads, masses and forces",
        ),
        (
            "trial",  # 0.5 kg at 8 mm are 4000 g mm
            "12 kg @ drive2 40 mm 0 deg",
            "runs.csv:2, trial: got an imbalance of 4.8e+05 g mm on drive2, expected at most 8e+04 g mm; check",
        ),
    ],
)
def test_triage_refuses_what_source_refuses(tmp_path, column, cell, complaint):
    (tmp_path / "run7.csv").write_text(RECORDED)
    (tmp_path / "runs.csv").write_text(f"{HEAD.strip()},group,{column}\nrun7.csv,y,y,7,a,{cell}\n")
    arm, runs = ident.read_arm(ARM).arm, read_runs(tmp_path / "runs.csv")
    for read in (moving_traces, lambda *given: posed(*given, offset=0.05)):
        with pytest.raises(InputError) as error:
            read(arm, runs)
        assert str(error.value).replace(f"{tmp_path}/", "").startswith(complaint)


def test_a_trial_mass_that_balances_is_taken_and_alone_by_triage(tmp_path):
    (tmp_path / "run7.csv").write_text(RECORDED)
    (tmp_path / "runs.csv").write_text(f"{HEAD.strip()},group,trial\nrun7.csv,y,y,7,a,150 g @ drive2 40 mm 0 deg\n")
    assert len(moving_traces(ident.read_arm(ARM).arm, read_runs(tmp_path / "runs.csv"))) == 1


def test_more_rows_than_a_search_holds_are_refused_at_once(tmp_path):
    rows = "".join(f"a{k}.csv,y,y,7,mm\n" for k in range(20_000))
    (tmp_path / "planned.csv").write_text(f"{HEAD.strip()},unit\n{rows}")
    with pytest.raises(InputError, match="20000 rows with a direction, expected at most 100; leave the direction"):
        ident.plan(ARM, runs=tmp_path / "planned.csv")


@pytest.mark.parametrize(
    ("options", "complaint"),
    [
        ({"orders": tuple(range(1, 400))}, "orders: got 399 multiples, expected at most 12"),
        ({"load": "glass"}, "give it in the column load of the table of runs"),
    ],
)
def test_options_that_do_nothing_or_have_no_end_are_refused(options, complaint):
    with pytest.raises(InputError, match=complaint):
        ident.TriageOptions(**options)
    if "load" in options:
        with pytest.raises(InputError, match=complaint):
            ident.SourceOptions(**options)


def test_milliseconds_called_seconds(tmp_path):
    said = refused(tmp_path, over_time(lambda time: 1e3 * time))
    assert said == (
        "runs.csv:2, channel: got 0.1 samples a second in run7.csv, expected at least 50; "
        "measure again, sampled faster; or are its times in ms? then write time [ms]"
    )
    assert refused(tmp_path, over_time(lambda time: 1e6 * time)).endswith("sampled faster"), "nor would ms be"


def test_a_record_shorter_than_any_vibration(tmp_path):
    for unit, duration in (("us", "4.69e-05"), ("ns", "4.69e-08")):
        assert refused(tmp_path, RECORDED.replace("time [s]", f"time [{unit}]")) == (
            f"runs.csv:2, channel: got {duration} s in run7.csv, expected at least 0.125 s; "
            "record the whole motion, or check the unit of the times"
        )


def test_a_column_of_one_name_with_another_is_neither(tmp_path):
    said = refused(tmp_path, RECORDED.replace("z [mm]", "y [um]"), "run7.csv,y,y,7\n")
    assert said == (
        "runs.csv:2, channel: got 2 channels of one name, in 'mm', 'um', expected samples over time; "
        "give each channel of the file a name of its own"
    )


def test_a_gap_is_cut_out_and_an_uneven_clock_resampled(tmp_path):
    """From a gap of 3 s on, and with sampling that jitters by 3 ms: what was done is said."""
    (tmp_path / "runs.csv").write_text(HEAD + "run7.csv,y,y,7\n")
    (tmp_path / "run7.csv").write_text(over_time(lambda time: time + 3 * (np.arange(len(time)) >= 998)))
    cut = read_runs(tmp_path / "runs.csv")
    assert cut.traces[0].time[0] == pytest.approx(13.08, abs=0.011)
    assert "read from 13.08 to" in cut.notes[0]
    jitter = np.random.default_rng(2).uniform(0, 0.003, 10_000)
    (tmp_path / "run7.csv").write_text(over_time(lambda time: time + jitter[: len(time)]))
    assert "times off even ones by 0.874 ms rms" in read_runs(tmp_path / "runs.csv").notes[0]
    said = refused(tmp_path, over_time(lambda time: time + 3 * (np.arange(len(time)) // 1000)))
    assert "got gaps and a drifting clock that leave 21 % of it in one piece, expected at least 50 %" in said


@pytest.mark.parametrize(
    ("speed", "common"),
    [
        (7, ""),
        (70, "9.41 of its 46.9 s are within the motion, which takes 4.51 s"),
        (2.5, "46.9 of its 46.9 s are within the motion, which takes 126 s"),
    ],
)
def test_a_trace_much_longer_or_shorter_than_its_motion_is_said(tmp_path, speed, common):
    (tmp_path / "run7.csv").write_text(RECORDED)
    (tmp_path / "runs.csv").write_text(HEAD + f"run7.csv,y,y,{speed}\nrun7.csv,z,z,{speed}\n")
    noted = with_notes(ident.read_arm(ARM).arm, read_runs(tmp_path / "runs.csv")).notes
    assert list(noted) == [f"{tmp_path}/runs.csv:2, run7.csv: {common}: check speed, path and delay"] * bool(common)


def test_what_was_mended_in_the_log_of_a_run_is_said(tmp_path):
    (tmp_path / "run7.csv").write_text(RECORDED)
    (tmp_path / "runs.csv").write_text("file,channel,direction,path\nrun7.csv,y,y,log.csv\n")
    time = np.arange(0, 40, 0.02)
    turn = 60 * (time / 40 - np.sin(2 * np.pi * time / 40) / (2 * np.pi))
    late = 1e-3 * (np.random.default_rng(0).random(len(time)) < 0.5)
    header = "time [s],joint1 [deg],joint2 [deg],joint3 [deg]"
    rows = np.column_stack([time + late, 20 + turn, -40 - turn, 20 + turn])
    np.savetxt(tmp_path / "log.csv", rows, "%.6f", ",", header=header, comments="")
    (note,) = with_notes(ident.read_arm(ARM).arm, read_runs(tmp_path / "runs.csv")).notes
    assert note.endswith("log.csv, time: up to 0.56 ms off even steps of 20 ms, which were taken instead")


def test_speeds_beside_the_percent(tmp_path):
    said = refused(tmp_path, rows="run7.csv,y,y,700\n")
    assert said == "runs.csv:2, speed: got '700', expected a number above 0, at most 200 % of full speed; correct it"
    assert "turns of the fastest pulley in common with the motion at speed 0.07 %" in refused(
        tmp_path, rows="run7.csv,y,y,0.07\n"
    )


def test_sources_larger_than_any_drive_has_are_a_finding():
    sources = possible_orders(ident.read_arm(ARM).arm)
    imbalance, error = (next(each for each in sources if each.of_error == kind) for kind in (False, True))
    plausible = [(imbalance, 49.0), (error, 299.0)]
    absurd = [(imbalance, 51.0), (error, 301.0)]  # 602 arc seconds peak to peak
    known = lambda pairs: (Estimate(source, size, 1.0, (0.0,), (0.1,)) for source, size in pairs)  # noqa: E731
    assert not list(too_large(known(plausible)))
    assert [each.text.split(", no drive")[0] for each in too_large(known(absurd))] == [
        "drive1 imbalance: 51 mm of eccentricity",
        f"drive1 error, order {error.order:g}: 602 arcsec p-p",
    ]


def test_the_arm_is_named_where_it_does_not_lie_beside_the_runs(tmp_path, run):
    shutil.copy(DATA / "lcd_arm" / "mujoco" / "run7.csv", tmp_path)
    _, out, err = run("source", ".", "--init")
    assert "then: ident source runs.csv --arm ARM" in out + err
    (tmp_path / "runs.csv").write_text(HEAD + TABLE)
    for command in ("source", "triage"):
        code, _, err = run(command, "runs.csv")
        assert (code, err) == (
            2,
            "ident: arm.toml: got no such file, expected the arm of these runs; name it (--arm)\n",
        )
    shutil.copy(ARM, tmp_path)
    (tmp_path / "runs.csv").unlink()
    _, out, err = run("source", ".", "--init")
    assert "--arm" not in out + err


def test_one_trace_and_one_log_are_runs_as_a_table_says_them(tmp_path):
    """Of each column of the trace; without a table nothing states the delay."""
    (tmp_path / "run7.csv").write_text(RECORDED)
    (tmp_path / "runs.csv").write_text(
        "file,channel,direction,path,delay [s]\n" + "".join(f"run7.csv,{way},{way},log.csv,0.5\n" for way in "yz")
    )
    time = np.arange(0, 40, 0.02)
    rows = np.column_stack([time + 7, *(20 - 20 * np.cos(2 * np.pi * time / 40) for _ in range(3))])
    header = "time [s],joint1 [deg],joint2 [deg],joint3 [deg]"
    np.savetxt(tmp_path / "log.csv", rows, "%.6f", ",", header=header, comments="")
    trace, log = ident.read_trace(tmp_path / "run7.csv"), ident.read_log(tmp_path / "log.csv", ["joint1"])
    stated, runs = read_runs(tmp_path / "runs.csv"), runs_of(trace, log, 0.5)
    for own, other in zip(runs.traces, stated.traces, strict=True):
        assert replace(own.row, where="") == replace(other.row, where="")
        assert own.derivative == other.derivative == 0
        np.testing.assert_allclose(own.time, other.time, atol=1e-9)
        np.testing.assert_allclose(own.values, other.values, rtol=1e-9)
    assert (runs.files["log.csv"], runs.name) == (stated.files["log.csv"], "run7")
    assert {each.row.delay for each in runs_of(trace, log).traces} == {None}
    still = replace(trace, values={"y": np.zeros(len(trace.time))})
    with pytest.raises(InputError, match=r"run7.csv, y: got 0 in all samples"):
        runs_of(still, log)
