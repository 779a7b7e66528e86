"""What a channel is worth by itself, against closed forms; and files without directions."""

import numpy as np
import pytest
from arms import DATA

from ident.errors import InputError
from ident.measure.grade import clipped, grade, resolution
from ident.measure.signals import read_signals
from ident.measure.trace import NoDirectionError, read_trace

STEP = 1 / 400
TIME = STEP * np.arange(8_000)


@pytest.mark.parametrize("line", [0.0, 5.0])
def test_the_noise_floor_is_the_density_of_the_noise_whatever_lines_there_are(line):
    """White noise of variance s^2 has the density 2 s^2 / rate."""
    rng, sd = np.random.default_rng(3), 0.02
    values = 9.81 + line * np.sin(2 * np.pi * 7.3 * TIME) + sd * rng.standard_normal(len(TIME))
    assert grade("x", "acceleration", values, STEP).noise == pytest.approx(sd * np.sqrt(2 / 400), rel=0.05)


@pytest.mark.parametrize("step", [0.0383, 1e-6, 4.0])
def test_the_resolution_is_the_step_of_the_numbers(step):
    rng = np.random.default_rng(4)
    whole = np.round(30 * np.sin(2 * np.pi * 5 * TIME) + 2 * rng.standard_normal(len(TIME)))
    assert resolution(np.array([float(f"{value:.9g}") for value in step * whole])) == pytest.approx(step, rel=1e-6)
    assert np.isnan(resolution(step * rng.standard_normal(len(TIME))))
    assert np.isnan(resolution(np.sin(2 * np.pi * TIME)))  # repeats, but by no step
    assert np.isnan(resolution(np.ones(100)))


def test_a_sine_beyond_the_range_is_clipped_for_as_long_as_it_is_there():
    """Above half of its amplitude a sine is for a third of its period: 400 / 3 / 5 samples."""
    sine = np.sin(2 * np.pi * 5 * TIME + 0.1)
    assert clipped(np.minimum(sine, 0.5)) == pytest.approx(400 / 3 / 5, abs=1)
    assert clipped(sine) == 0


def test_the_band_ends_where_the_recording_the_rate_a_phone_or_resampling_ends_it():
    assert grade("x", "acceleration", np.sin(TIME), STEP).band == pytest.approx((2 / 20, 400 / 2.56))
    assert grade("x", "acceleration", np.sin(TIME), STEP, (1.0, 35.0)).band == (1.0, 35.0)


def written(path, header, columns):
    rows = "\n".join(",".join(f"{cell:.9g}" for cell in row) for row in np.transpose(columns))
    path.write_text(f"{header}\n{rows}\n", encoding="utf-8")
    return path


def test_a_file_without_directions_is_read_by_its_channels(tmp_path):
    sine = np.sin(2 * np.pi * 5 * TIME)
    path = written(tmp_path / "log.csv", "time [s],tip [g],laser [mm],base [g]", [TIME, sine, 3 * sine, 2 * sine])
    with pytest.raises(NoDirectionError):
        read_trace(path)
    drawn, other = read_signals(path)
    assert (drawn.kind, list(drawn.values), other.kind, list(other.values)) == (
        *("acceleration", ["tip", "base"]),
        *("displacement", ["laser"]),
    )
    np.testing.assert_allclose(drawn.values["base"], 2 * 9.80665 * sine, atol=1e-6)
    np.testing.assert_allclose(other.values["laser"], 0.003 * sine, atol=1e-9)
    assert [each.name for each in drawn.grades] == ["tip", "base"]


def test_of_triggered_blocks_the_first_is_read_and_the_force_stands_alone():
    drawn, force = read_signals(DATA / "lcd_arm" / "hammer" / "alpha00_y.unv")
    assert drawn.kind == "acceleration"
    assert force.kind == "N"
    assert "read: the first of 5 blocks" in drawn.notes


def test_a_file_that_is_neither_is_refused_as_a_trace(tmp_path):
    (tmp_path / "a.csv").write_text("point,value\ntip,1\n")
    with pytest.raises(InputError, match=r"a\.csv"):
        read_signals(tmp_path / "a.csv")
    path = written(tmp_path / "b.csv", "time [s],x [mm],y [m/s^2]", [TIME[:20], TIME[:20], TIME[:20]])
    with pytest.raises(InputError, match=r"b\.csv:1, y: got acceleration"):
        read_signals(path)


def test_clipping_is_seen_before_values_are_resampled(tmp_path):
    time = np.cumsum(1 / np.random.default_rng(5).uniform(95, 105, 2_000))
    values = np.minimum(np.sin(2 * np.pi * 3 * time), 0.6)
    (trace,) = read_signals(written(tmp_path / "p.csv", "t/s,Linear Acceleration x (m/s^2)", [time, values]))
    assert any("clipped, up to" in note for note in trace.notes)
    (own,) = trace.grades
    assert own.band == (1.0, trace.band)
    assert 20 < trace.band < 40
    assert np.isnan([own.resolution, own.clipped]).all()
