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


def one_record(folder, gap, noise, alpha=30, force="z", least=0.0, seed=0):
    """Write a hammer test of one posture and force whose five hits are some time [s] apart in one record.

    The arm rings on from each hit to the next, its modes damped by the least ratio or more. Noise [m/s^2] is that of
    the accelerometers, a fifth as many N that of the force.
    """
    from scipy.signal import resample_poly

    from ident.description.file import read_arm

    make, rng = generator(), np.random.default_rng(seed)
    made = make.system(read_arm(FOLDER / "arm.toml").arm, np.deg2rad(alpha) * np.array([1.0, -2.0, 1.0]))
    size = np.abs(made.poles)
    ratio = np.maximum(-made.poles.real / size, least)
    made = replace(made, poles=size * (-ratio + 1j * np.sign(made.poles.imag) * np.sqrt(1 - ratio**2)))
    fine = np.arange(int(make.HITS * gap * make.RATE * make.FINER)) / (make.RATE * make.FINER) - 0.5
    both = 0.0
    for begin in gap * np.arange(make.HITS):
        peak, pulse = make.PEAK * (1 + make.SPREAD * rng.normal()), make.PULSE * (1 + 0.05 * rng.normal())
        answers = made.response(fine - begin, peak, pulse, list(make.FORCES).index(force))
        both = both + np.vstack([peak * make.half_sine(fine - begin, pulse), answers])
    both = resample_poly(both, 1, make.FINER, axis=1)
    both += noise * rng.normal(size=both.shape) * np.array([[0.2], *[[1.0]] * (len(both) - 1)])
    make.write_file(folder / make.name(alpha, force), force, both[:1], both[1:, None])
    rows = [line for line in make.table().splitlines() if not line.startswith("alpha") or f"alpha{alpha:02d}" in line]
    kept = [line for line in rows if not line.startswith("alpha") or "*" in line or make.name(alpha, force) in line]
    (folder / "channels.csv").write_text("\n".join(kept))
    (folder / "arm.toml").write_text(make.arm_text())
    return made
