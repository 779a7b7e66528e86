"""What `ident spectrum` says of a file by itself: the first screens of a printer's sensor and of a phone."""

from pathlib import Path

import numpy as np
import pytest
from numbers_in_text import same_text
from reports import assert_one_screen

from ident.studies.working.spectrum import spectrum

SCREENS = Path(__file__).parents[1] / "data" / "screens" / "spectrum"
LSB = 38.3074
"""[mm/s^2] of an ADXL345, as Klipper writes it."""


def printer(path, rng):
    """Lines at 7.31 and 48.7 Hz, gravity along z, in steps of the sensor."""
    time = np.arange(0, 8, 1 / 3193.4)
    x = 800 * np.sin(2 * np.pi * 7.31 * time) + 2500 * np.sin(2 * np.pi * 48.7 * time)
    y, z = 200 * np.sin(2 * np.pi * 7.31 * time + 1), np.full(len(time), 9806.0)
    steps = [LSB * np.round((each + 120 * rng.standard_normal(len(time))) / LSB) for each in (x, y, z)]
    rows = ["#time,accel_x,accel_y,accel_z"]
    rows += [f"{1234.5 + t:.6f},{a:.6f},{b:.6f},{c:.6f}" for t, a, b, c in zip(time, *steps, strict=True)]
    path.write_text("\n".join(rows) + "\n", encoding="utf-8")


def phone(path, rng):
    """A line at 4.87 Hz, one that is clipped, and intervals of their own: 100 +- 5 Hz."""
    time = np.cumsum(1 / rng.uniform(95, 105, 2_000))
    x, y = (size * np.sin(2 * np.pi * 4.87 * time) + 0.02 * rng.standard_normal(len(time)) for size in (0.3, 0.1))
    z = np.clip(0.5 * np.sin(2 * np.pi * 6.1 * time), -0.3, 0.3)
    rows = ['"Time (s)",' + ",".join(f'"Linear Acceleration {axis} (m/s^2)"' for axis in "xyz")]
    rows += [",".join(f"{cell:.9E}" for cell in row) for row in zip(time, x, y, z, strict=True)]
    path.write_text("\n".join(rows) + "\n", encoding="utf-8")


@pytest.mark.parametrize(("write", "name"), [(printer, "raw_data_x"), (phone, "Linear Acceleration")])
def test_the_first_screen_says_what_a_file_holds(write, name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write(Path(f"{name}.csv"), np.random.default_rng(1))
    text = spectrum(f"{name}.csv").report()
    assert_one_screen(text, files=2)
    kept = SCREENS / f"{write.__name__}.txt"
    assert same_text(text, kept.read_text(encoding="utf-8"))
