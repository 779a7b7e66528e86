"""Ambient vibration of the paper's arm with known truth: white forces through the model's own equations of motion."""

from dataclasses import dataclass

import h5py
import jax
import numpy as np
from hammer_files import FOLDER, generator

from ident.description.file import read_arm
from ident.measure import Load
from ident.measure.speeds import parse_speeds
from ident.modal.ambient import ambient_tests
from ident.modal.frf import Place, Processing
from ident.modal.recorded import Record, Response

RATE = 100.0
"""Sampling rate [Hz]."""
NOISE = 0.01
"""Noise of the sensors, as a share of each response's standard deviation."""
POSTURE = (60.0, -120.0, 60.0)
"""[deg] where two modes are 2 % apart."""


@dataclass(frozen=True)
class Shaken:
    """Accelerances (O, O, 2T/2 + 1) of the arm at the lines of a record of twice the duration, and its poles."""

    poles: np.ndarray
    accelerance: np.ndarray
    samples: int

    @property
    def frequency(self):
        return np.abs(self.poles) / (2 * np.pi)

    @property
    def damping(self):
        return -self.poles.real / np.abs(self.poles)

    def record(self, rng, harmonics=()):
        """Accelerations (O, T) at the accelerometers, along the axes of their bodies, with noise, to scale.

        White forces act at the same places; half of a periodic response of twice the duration, so that its end does
        not go on at its beginning; an anti-aliasing filter. Harmonics: frequency [Hz] and largest amplitude, in
        standard deviations.
        """
        forces = np.fft.rfft(rng.normal(size=(self.accelerance.shape[1], 2 * self.samples)))
        moved = np.fft.irfft(np.einsum("oif,if->of", self.accelerance, forces))[:, : self.samples]
        size = moved.std(1, keepdims=True)
        moved /= size
        time = np.arange(self.samples) / RATE
        for frequency, amplitude in harmonics:
            share = amplitude * rng.uniform(0.3, 1.0, len(moved)) * rng.choice([-1, 1], len(moved))
            moved += np.outer(share, np.sin(2 * np.pi * frequency * time + rng.uniform(0, 6)))
        return (moved + NOISE * rng.normal(size=moved.shape)) * (size / size.max())


def shaken(duration, posture=POSTURE, band=(1.0, 28.0)):
    """The arm with the two accelerometers of the hammer test, recorded for a time [s]; truth within a band [Hz]."""
    matrices = jax.jit(lambda arm: generator()._matrices(arm, np.radians(posture), generator().LOAD))
    M, C, H, outputs, _ = map(np.asarray, matrices(read_arm(FOLDER / "arm.toml").arm))
    samples = int(duration * RATE)
    lines = np.fft.rfftfreq(2 * samples, 1 / RATE)
    poles, right = np.linalg.eig(
        np.block([[np.zeros_like(M), np.eye(len(M))], [-np.linalg.solve(M, H), -np.linalg.solve(M, C)]])
    )
    seen = np.hstack([-outputs @ np.linalg.solve(M, H), -outputs @ np.linalg.solve(M, C)]) @ right
    pushed = np.linalg.solve(right, np.vstack([np.zeros_like(outputs.T), np.linalg.solve(M, outputs.T)]))
    direct = outputs @ np.linalg.solve(M, outputs.T)
    s = 2j * np.pi * lines
    accelerance = direct[..., None] + sum(
        np.outer(seen[:, k], pushed[k])[..., None] / (s - pole) for k, pole in enumerate(poles)
    )
    accelerance = accelerance / (1 + (lines / (0.4 * RATE)) ** 16)
    accelerance[..., 0] = 0
    hertz = np.abs(poles) / (2 * np.pi)
    inside = poles[(poles.imag > 0) & (hertz > band[0]) & (hertz < band[1])]
    return Shaken(inside[np.argsort(np.abs(inside))], accelerance, samples)


def as_record(values, speeds="", references=None, posture=POSTURE):
    """Responses of the two accelerometers as a record; of one file."""
    axes = np.eye(3)
    places = [Place(point, tuple(axis.tolist())) for point in ("tip", "elbow") for axis in axes]
    responses = tuple(
        Response(place, each[None], 0, None, str(place)) for place, each in zip(places, values, strict=False)
    )
    load, angles = Load.parse(generator().LOAD), tuple(np.radians(posture).tolist())
    rows = tuple(range(len(responses))) if references is None else references
    return Record("ambient.h5", angles, load, "brake", 1 / RATE, responses, rows, parse_speeds(speeds), ())


def ambient_test(values, speeds="", band=None, **more):
    """The test of one record."""
    (test,) = ambient_tests([as_record(values, speeds, **more)], Processing(band=band))
    return test


def write_folder(folder, values, *, speeds="", posture=POSTURE, roles=("response",) * 6):
    """Write a record as HDF5 with its channel table and the arm beside it."""
    names = [f"{point} {axis}" for point in ("tip", "elbow") for axis in "xyz"]
    with h5py.File(folder / "ambient.h5", "w") as file:
        for name, each in zip(names, values, strict=True):
            file[name] = each.astype(np.float32)
    angles = ",".join(f"{angle:g}" for angle in posture)
    rows = [
        f"ambient.h5,{name},{role},{','.join(name.split())},body,m/s^2,{RATE:g},{angles},{generator().LOAD},{speeds}"
        for name, role in zip(names, roles, strict=True)
    ]
    header = "file,channel,role,point,direction,frame,unit,rate,q1 [deg],q2 [deg],q3 [deg],load,harmonics"
    (folder / "channels.csv").write_text("\n".join([header, *rows]) + "\n")
    (folder / "arm.toml").write_text((FOLDER / "arm.toml").read_text())
    return folder
