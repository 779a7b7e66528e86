"""The synthetic hammer test: its generator as a module, and records of a simple oscillator."""

import importlib.util
import sys
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np

FOLDER = Path(__file__).parents[2] / "data" / "lcd_arm" / "hammer"
MODAL = ("ident", "modal", "data/lcd_arm/hammer")
FIT = ("ident", "fit", "out/hammer.modal.csv", "--arm", "data/lcd_arm/hammer/arm.toml")
HAMMER_TEST = (MODAL, FIT)
"""Commands of the manual that `tests/studies/test_modal.py` runs for all."""


@cache
def generator():
    spec = importlib.util.spec_from_file_location("hammer_generator", FOLDER / "generate.py")
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


def only(table, *files):
    """The rows of a channel table that are of some files, each with its own name in place of a pattern."""
    rows = [replace(row, file=name) for name in files for row in table.rows if Path(name).match(row.file)]
    return replace(table, rows=tuple(rows))


def oscillator(time, frequency=6.0, ratio=0.02, mass=10.0, pulse=0.02, peak=100.0):
    """Force [N] and acceleration [m/s^2] of one mass on a spring to a half sine at time 0, by fine steps."""
    from scipy.signal import lsim

    w = 2 * np.pi * frequency
    force = np.where((time > 0) & (time < pulse), peak * np.sin(np.pi * time / pulse), 0.0)
    system = ([[0, 1], [-(w**2), -2 * ratio * w]], [[0], [1 / mass]], [[-(w**2), -2 * ratio * w]], [[1 / mass]])
    return force, lsim(system, force, time - time[0])[1]
