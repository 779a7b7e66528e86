"""`ident modal`: files of a hammer test to frequency responses, and the channel table to fill in."""

import re
import signal
import subprocess
import sys
import time
import warnings
from shutil import copy

import h5py
import numpy as np
import pytest
from commands import files
from hammer_files import FOLDER
from reports import assert_one_screen
from results import TIME
from tapped import tapped, write_taps

from ident.cli.running import start

pytestmark = pytest.mark.slow


@pytest.fixture
def folder(tmp_path):
    """One posture of the shipped test."""
    made = tmp_path / "tests"
    made.mkdir()
    for name in ("alpha60_z.unv", "alpha60_y.unv", "arm.toml"):
        copy(FOLDER / name, made)
    lines = (FOLDER / "channels.csv").read_text().splitlines()
    (made / "channels.csv").write_text("\n".join(line for line in lines if "alpha" not in line or "alpha60" in line))
    return made


def test_modal_writes_what_it_says(run, folder, tmp_path):
    code, out, err = run("modal", folder, "--out=new")
    assert (code, err) == (0, "")
    assert "Hammer test at 1 posture: 10 hits accepted, 1 rejected; 7 of 7 modes named" in out
    assert_one_screen(out)
    assert "Next: ident check new/tests.modal.csv --arm " in " ".join(out.split())
    written = [name for name in files(tmp_path) if name.startswith("new")]
    ends = (".covariance.csv", ".csv", ".json", ".modes.png", ".nc", ".png", ".shapes.png")
    assert written == [f"new/tests.modal{end}" for end in ends]
    assert "vertical bending 2" in out
    _, out, _ = run("show", "new/tests.modal.json", "--details")
    assert "Rejected: alpha60_y.unv, hit 2: overload of the force: 250 of a full scale of 250 N" in out
    assert "in the covariance file next to the campaign; ident fit reads it" in " ".join(out.split())


def test_a_missing_library_is_named_once(run, folder, monkeypatch):
    """By its own name."""
    monkeypatch.setitem(sys.modules, "nptdms", None)
    for name in ("a.tdms", "b.tdms"):
        (folder / name).write_bytes(b"TDSm" + bytes(100))
    code, _, err = run("modal", "--init", folder, "--channels", "mine.csv")
    assert (code, err.count("\n")) == (2, 1)
    assert err.endswith(
        "a.tdms: got a file that needs the package npTDMS, expected npTDMS to read it; pip install npTDMS\n"
    )


def test_frequency_responses_alone(run, folder, monkeypatch):
    """A library that a file beside them would need is not missed."""
    monkeypatch.setitem(sys.modules, "nptdms", None)
    (folder / "a.tdms").write_bytes(b"TDSm" + bytes(100))
    code, out, _ = run("modal", folder, "--no-figure", "--no-modes", "--band=2:20", "--strict")
    assert code == 0
    assert "damping" not in out
    assert "RESULT: GOOD. All 3 driving-point and reciprocity checks pass" in out
    assert run("show", "out/tests.modal.json")[1] in out
    code, _, err = run("modal", folder, "--modes", "x=3")
    assert code == 2
    assert "--modes x=3: got 'x', expected the number of a posture" in err


def test_warnings_of_libraries_do_not_reach_the_terminal():
    with warnings.catch_warnings(record=True) as seen:
        warnings.resetwarnings()
        start()
        for kind in (RuntimeWarning, UserWarning, FutureWarning):
            warnings.warn("of a library", kind, stacklevel=1)
    assert not seen


def test_init_writes_a_table_to_fill_in_and_overwrites_none(run, folder):
    code, out, err = run("modal", "--init", folder)
    assert code == 2
    assert "channels.csv: got a file that is there" in err
    code, out, err = run("modal", "--init", folder, "--channels", "mine.csv")
    assert (code, err) == (0, "")
    assert "14 channels to fill in; then: ident modal" in out
    code, out, err = run("modal", folder, "--channels", "mine.csv")
    assert code == 2
    assert "mine.csv:8, q1: got nothing, expected a number; fill the cell" in err


def test_a_reversed_sensor_is_seen(run, folder):
    table = folder / "channels.csv"
    table.write_text(table.read_text().replace("tip,-z,base", "tip,z,base"))
    code, out, _ = run("modal", folder, "--no-figure", "--no-modes", "--strict")
    assert code == 3
    words = " ".join(out.split())
    assert "RESULT: DOUBTFUL. 2 of 3 checks fail, most of all" in words
    assert "(at most 10 %) -> turn the direction of the force or the response" in words


def test_an_amplitude_without_taps_is_refused(run, folder):
    code, out, err = run("modal", folder, "--amplitude=0.5")
    assert (code, out) == (2, "")
    assert "amplitude: got no posture with taps, expected free decays after taps; leave it out: taps are" in err
    code, out, err = run("modal", folder, "--amplitude=0.5", "--no-modes")
    assert (code, out, err.splitlines()[-1]) == (
        2,
        "",
        "ident: --amplitude: got it with --no-modes, expected nothing; leave one of them out",
    )


def test_bad_files_are_refused_all_at_once(run, folder):
    for name in ("alpha60_z.unv", "alpha60_y.unv"):
        data = (folder / name).read_bytes()
        (folder / name).write_bytes(data[:-1000])
    code, out, err = run("modal", folder)
    assert (code, out) == (2, "")
    assert err.count("damaged or truncated file") == 2


def test_taps_without_a_force_go_the_same_way(run, tmp_path):
    """From a record of six taps by hand to a campaign that a fit reads; no other test names modes of taps."""
    made = tmp_path / "taps"
    made.mkdir()
    write_taps(made, tapped().record(np.random.default_rng(5)))
    code, out, err = run("modal", made, "--out=new", "--amplitude=0.7")
    assert (code, err) == (0, "")
    assert_one_screen(out)
    assert out.startswith("Tap test at 1 posture: free decays after 6 taps, without a force; ")
    for name, hertz in (("lateral torsion 1", "5.6"), ("vertical bending 1", "5.77"), ("vertical bending 2", "14.98")):
        assert re.search(rf"{name} +{re.escape(hertz)}", out)
    code, out, _ = run("check", "new/taps.modal.csv", "--arm", made / "arm.toml")
    assert code == 0
    table = (made / "channels.csv").read_text()
    (made / "channels.csv").write_text(table.replace(",tap\n", ",knock\n"))
    code, _, err = run("modal", made, "--out=newer")
    assert code == 2
    assert "excitation: got 'knock', expected one of ambient, tap, release" in err


@pytest.fixture
def sheet(folder, tmp_path):
    """The table of the posture, with five hits for each place, and its recordings to come."""
    made = tmp_path / "sheet" / "tests"
    made.mkdir(parents=True)
    copy(folder / "arm.toml", made)
    lines = [line for line in (folder / "channels.csv").read_text().splitlines() if not line.startswith("#")]
    (made / "channels.csv").write_text("\n".join(f"{line},{5 if i else 'taps'}" for i, line in enumerate(lines)))
    return made


INTERRUPTIBLE = """import runpy, signal
signal.signal(signal.SIGINT, signal.default_int_handler)
runpy.run_module("ident", run_name="__main__")"""
"""Runs the program; tests in the background of a shell ignore Ctrl-C, and what they start inherits that."""


def watching(folder, out):
    """`ident modal --watch` as a process."""
    line = [sys.executable, "-c", INTERRUPTIBLE, "modal", str(folder), "--watch", "--no-figure", f"--out={out}"]
    return subprocess.Popen(line, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def copy_slowly(source, to, parts=5, pause=0.4):
    data = source.read_bytes()
    with to.open("wb") as file:
        for i in range(parts):
            file.write(data[i * len(data) // parts : (i + 1) * len(data) // parts])
            file.flush()
            time.sleep(pause)


def test_a_watched_test_ends_as_modal_afterwards(run, folder, sheet, tmp_path):
    """To the bit, but for the time of writing."""
    process = watching(sheet, tmp_path / "a")
    for name in ("alpha60_y.unv", "alpha60_z.unv"):
        copy_slowly(folder / name, sheet / name)
    out, err = process.communicate(timeout=300)
    assert (process.returncode, "Traceback" in err) == (0, False)
    assert "alpha60_y.unv, hit 2 rejected: overload of the force" in out
    assert "alpha60_z.unv: hits at tip -z accepted: 5 of 5, coherence 0.99" in out
    assert "done: nothing is left to record" in out
    assert run("modal", sheet, "--no-figure", f"--out={tmp_path / 'b'}")[0] == 0
    names = files(tmp_path / "a")
    assert (
        names == files(tmp_path / "b") == [f"tests.modal{end}" for end in (".covariance.csv", ".csv", ".json", ".nc")]
    )
    for name in names[:3]:
        one, other = (TIME.sub("", (tmp_path / each / name).read_text()).replace(f"/{each}/", "/OUT/") for each in "ab")
        assert one == other, name
    one, other = (h5py.File(tmp_path / each / names[3]) for each in "ab")
    assert one.keys() == other.keys()
    assert all(one[key][()].tobytes() == other[key][()].tobytes() for key in one if one[key].dtype.kind == "f")


def test_a_stopped_watch_loses_nothing(folder, sheet, tmp_path):
    process = watching(sheet, tmp_path / "a")
    copy(folder / "alpha60_z.unv", sheet)
    said = iter(process.stdout.readline, "")
    assert any("alpha60_z.unv: hits at tip -z accepted: 5 of 5" in line for line in said)
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=60)
    assert (process.returncode, "Traceback" in err) == (130, False)
    assert "stopped, 1 of 2 names of the table without a good recording; the same command goes on" in out
    assert not (tmp_path / "a").exists()
    process = watching(sheet, tmp_path / "a")
    copy(folder / "alpha60_y.unv", sheet)
    assert "done: nothing is left to record" in process.communicate(timeout=300)[0]
    assert process.returncode == 0


def test_what_cannot_be_watched_is_refused(run, tmp_path):
    for place, words in ((tmp_path / "none", "no such folder"), (tmp_path, "channels.csv")):
        code, out, err = run("modal", place, "--watch")
        assert (code, out, err.count("\n")) == (2, "", 1)
        assert words in err
