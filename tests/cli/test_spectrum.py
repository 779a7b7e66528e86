"""`ident spectrum`: real runs, the files that they leave, and bad input."""

import re

import numpy as np
import pytest
from commands import files

pytestmark = pytest.mark.slow


def sine(path, header, amplitude, frequency):
    time = np.arange(1000) / 100
    rows = np.column_stack([time, amplitude * np.sin(2 * np.pi * frequency * time)])
    np.savetxt(path, rows, header=header, comments="", delimiter=",")


def test_spectrum_measures_a_sine_and_sets_acceleration_beside_displacement(run, tmp_path):
    sine(tmp_path / "a.csv", "time [s],x [mm]", 0.4, 5.0)
    sine(tmp_path / "b.csv", "time [s],x [m/s^2]", 0.7, 7.0)
    code, out, err = run("spectrum", "a.csv", "--no-figure")
    assert (code, err) == (0, "")
    assert re.search(r"^  x +5\.000 +\S+ +0\.4000 +\S+$", out, re.M)
    code, out, err = run("spectrum", "a.csv", "--against=b.csv")
    assert (code, err) == (0, "")
    assert "a: a displacement, differentiated twice" in out
    assert re.search(rf"^  x +5\.000 +\S+ +{0.4e-3 * (10 * np.pi) ** 2:.4f}", out, re.M)
    assert re.search(r"^  x +7\.000 +\S+ +0\.7000 +\S+$", out, re.M)
    assert files(tmp_path) == ["a.csv", "b.csv", *(f"out/a.spectrum.{end}" for end in ("json", "png"))]


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--direction=y"], "--direction: got 'y'"),
        (["--window=han"], "did you mean hann"),
        (["--segments=0"], "--segments"),
        (["--upto=0"], "--upto"),
        (["--orders=one"], "'one'"),
        (["--spectrogram", "--segment=9"], "--segment: got 9 s"),
        (["--against=none.csv"], "none.csv: got no such file"),
        (["--posture=0,0,0"], "--posture"),
        (["--from=8", "--to=3"], "--from: got 0 samples up to --to, expected a span within 0 to 9.99 s"),
    ],
)
def test_bad_spectra_are_one_line_and_nothing_is_written(run, tmp_path, options, words):
    sine(tmp_path / "a.csv", "time [s],x [mm]", 0.4, 5.0)
    code, out, err = run("spectrum", "a.csv", *options)
    assert (code, out) == (2, "")
    assert words in err
    assert len(err.splitlines()) == 1
    assert files(tmp_path) == ["a.csv"]


def test_channels_of_any_recording_are_drawn_and_the_next_command_fits_them(run, tmp_path):
    time = np.arange(4000) / 400
    tip, laser = np.sin(2 * np.pi * 5 * time), 0.1 * np.cos(2 * np.pi * 5 * time)
    channels = np.column_stack([time, tip, laser, np.random.default_rng(1).standard_normal(len(time))])
    np.savetxt("log.csv", channels, header="time [s],a/b [g],laser [mm],hammer [N]", comments="", delimiter=",")
    code, out, err = run("spectrum", "log.csv", "--spectrogram")
    assert (code, err) == (0, "")
    assert re.search(r"^  a/b +5\.000 +\S+ +9\.807 +\S+$", out, re.M)
    assert "Not drawn, of another quantity or clock: laser, hammer." in " ".join(out.split())
    assert "Next: ident modal . --init" in out
    assert files(tmp_path) == ["log.csv", *(f"out/log.spectrum.{end}" for end in ("a_b.png", "json", "png"))]
