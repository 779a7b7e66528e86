"""The paper's arm tapped by hand: forces of any shape, place and strength, integrated in time, and recorded by sensors.

The matrices are the model's; their motion is SciPy's (`lsim`), with what ident knows nothing of: hands, filter, mains.
"""

from dataclasses import dataclass
from functools import cache

import h5py
import jax
import numpy as np
from hammer_files import FOLDER, generator
from scipy.signal import lsim, resample_poly

from ident.description.file import read_arm
from ident.measure import Load
from ident.modal.ambient import ambient_tests
from ident.modal.frf import Place, Processing
from ident.modal.recorded import Record, Response
from ident.units import STANDARD_GRAVITY

RATE, FINER = 200.0, 8
"""Sampling rate [Hz], and how much finer the motion is integrated."""
MG = 1e-3 * STANDARD_GRAVITY
"""[m/s^2] of a thousandth of standard gravity."""
POSTURE = (60.0, -120.0, 60.0)
"""[deg] where two modes are 2 % apart."""
MAINS, PICKED_UP = 50.0, 0.02
"""Frequency [Hz] and amplitude [m/s^2] of what the cables pick up."""
STEP = 4 * STANDARD_GRAVITY / 2**16
"""[m/s^2] of 16 bits for +-2 g."""
PLACES = tuple(Place(point, tuple(axis)) for point in ("tip", "elbow") for axis in np.eye(3).tolist())
DIRECTIONS = {"y": (1, 4), "z": (2, 5)}
"""Responses at tip and elbow along whose line a hand taps."""


@dataclass(frozen=True)
class Tapped:
    """State space (A, B, C, D) from forces at the sensors to accelerations there, and the poles within the band."""

    system: tuple[np.ndarray, ...]
    poles: np.ndarray

    @property
    def frequency(self):
        return np.abs(self.poles) / (2 * np.pi)

    @property
    def damping(self):
        return -self.poles.real / np.abs(self.poles)

    def moved(self, forces):
        """Accelerations (O, T) at RATE to forces (O, T FINER) [N], behind an anti-aliasing filter."""
        time = np.arange(forces.shape[1]) / (RATE * FINER)
        return resample_poly(lsim(self.system, forces.T, time)[1].T, 1, FINER, axis=1)

    def record(self, rng, directions="yzyzyz", noise=0.3, gaps=(2.5, 5.0), double=0.3):
        """Accelerations (O, T) [m/s^2] to taps along some directions; noise in mg/sqrt(Hz), gaps [s]."""
        starts = 0.5 + np.cumsum([0.0, *rng.uniform(*gaps, len(directions))])
        forces = np.zeros((6, int(starts[-1] * RATE * FINER)))
        for start, direction in zip(starts, directions, strict=False):
            push = hand(rng, double)
            at = int(start * RATE * FINER)
            forces[:, at : at + len(push)] += np.outer(self.where(rng, direction), push)
        return self.heard(rng, self.moved(forces), noise)

    def where(self, rng, direction):
        """Shares (O,) of a tap at tip or elbow, or between them, up to some 20 degrees off its direction."""
        share = rng.uniform(0, 1) ** 3
        along = np.zeros(6)
        for weight, point in ((1 - share, 0), (share, 3)):
            along[point : point + 3] = weight * 0.15 * rng.standard_normal(3)
            along[DIRECTIONS[direction][point // 3]] += weight * rng.choice([-1, 1])
        return along

    def heard(self, rng, moved, noise):
        """What the sensors give of a motion: noise, mains, 16 bits."""
        time, count = np.arange(moved.shape[1]) / RATE, len(moved)
        line = rng.uniform(0.3, 1, (count, 1)) * np.sin(2 * np.pi * MAINS * time + rng.uniform(0, 6))
        white = noise * MG * np.sqrt(RATE / 2) * rng.standard_normal(moved.shape)
        return STEP * np.round((moved + PICKED_UP * line + white + 0.05) / STEP)


def hand(rng, double):
    """Force [N] of a tap at the fine rate: skewed, 6 to 30 ms long, at times touching twice."""
    pushes = []
    for _ in range(1 + (rng.uniform() < double)):
        share = np.linspace(0, 1, int(rng.uniform(0.006, 0.03) * RATE * FINER))
        shape = share ** rng.uniform(0.8, 2) * (1 - share) ** rng.uniform(0.8, 2)
        pushes += [rng.uniform(20, 80) * shape / shape.max(), np.zeros(int(rng.uniform(0.03, 0.15) * RATE * FINER))]
    return np.concatenate(pushes)


@cache
def tapped(posture=POSTURE, band=(1.0, 50.0)):
    """The arm with the two accelerometers of the hammer test, and its poles within a band [Hz]."""
    matrices = jax.jit(lambda arm: generator()._matrices(arm, np.radians(posture), generator().LOAD))
    M, C, H, outputs, _ = map(np.asarray, matrices(read_arm(FOLDER / "arm.toml").arm))
    n = len(M)
    inverse = np.linalg.inv(M)
    A = np.block([[np.zeros((n, n)), np.eye(n)], [-inverse @ H, -inverse @ C]])
    B = np.vstack([np.zeros_like(outputs.T), inverse @ outputs.T])
    poles = np.linalg.eigvals(A)
    hertz = np.abs(poles) / (2 * np.pi)
    inside = poles[(poles.imag > 0) & (hertz > band[0]) & (hertz < band[1])]
    return Tapped((A, B, outputs @ A[n:], outputs @ inverse @ outputs.T), inside[np.argsort(np.abs(inside))])


def as_record(file, values, posture=POSTURE, excitation="tap", references=None, decay=0.0):
    """Responses (O, T) at the first places as the record of a file."""
    angles, load = tuple(np.radians(posture).tolist()), Load.parse(generator().LOAD)
    pairs = zip(PLACES, values, strict=False)
    responses = tuple(Response(place, row[None], 0, None, str(place)) for place, row in pairs)
    own = tuple(range(len(responses))) if references is None else references
    return Record(file, angles, load, "brake", 1 / RATE, responses, own, (), (), excitation, decay)


def tap_test(*values, **state):
    """The test of one or more records (O, T)."""
    made = [as_record(f"taps{number}.h5", each, **state) for number, each in enumerate(values, 1)]
    (test,) = ambient_tests(made, Processing())
    return test


def write_taps(folder, values, excitation="tap", posture=POSTURE):
    """Write a record as HDF5 with its channel table and the arm beside it."""
    names = [f"{place.point} {axis}" for place, axis in zip(PLACES, "xyzxyz", strict=True)]
    with h5py.File(folder / "taps.h5", "w") as file:
        for name, each in zip(names, values, strict=True):
            file[name] = each.astype(np.float32)
    angles = ",".join(f"{angle:g}" for angle in posture)
    state = f"body,m/s^2,{RATE:g},{angles},{generator().LOAD},{excitation}"
    rows = [f"taps.h5,{name},response,{','.join(name.split())},{state}" for name in names]
    header = "file,channel,role,point,direction,frame,unit,rate,q1 [deg],q2 [deg],q3 [deg],load,excitation"
    (folder / "channels.csv").write_text("\n".join([header, *rows]) + "\n")
    (folder / "arm.toml").write_text((FOLDER / "arm.toml").read_text())
    return folder
