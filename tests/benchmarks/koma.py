"""The ambient record of koma's shear frame against its known modes: `python tests/benchmarks/koma.py FOLDER`.

The folder is `examples/data` of a checkout of github.com/knutankv/koma (MIT): displacements of five levels under white
forces, 20 minutes at 12 Hz, with white noise of 0.6 of their standard deviation; and the frame's modes. These,
`omega_n` (|pole|: undamped) and `xi_ref`, are those of the differential equation; the record is that of Newmark's
average acceleration at the record's own step, which is the trapezoidal rule and moves each pole p to
log((1 + p h / 2) / (1 - p h / 2)) / h, and no shape. Both truths are printed, the record's counts.

`--records 100` makes so many further records of the same frame, rule and noise, which tell what such a record permits.
"""

import argparse
import os
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import h5py
import numpy as np
from scipy.signal import detrend, lfilter

import ident
from ident.errors import InputError
from ident.measure.channels import read_channels, recordings_of
from ident.modal.ambient import measured_tests
from ident.modal.frf import Processing
from ident.modal.operational import OperationalModes, operational_modes

RATE, NOISE, LIMIT, NEAR = 12.0, 0.6, 3.0, 0.1
"""Sampling rate [Hz], noise as a share of the responses, standard deviations, and what is the same mode, as a share."""
BANDS = (0.1, 3.0), (0.1, 1.5)
"""[Hz] to a quarter of the rate, as ident seeks modes by itself; and sampled down to what the modes need."""


@dataclass(frozen=True)
class Frame:
    """The frame as koma stores it: poles (m,) [1/s] of its equation, shapes (O, m)."""

    stored: np.ndarray
    shape: np.ndarray

    @property
    def poles(self):
        """Those of a record by the trapezoidal rule."""
        half = self.stored / (2 * RATE)
        return np.log((1 + half) / (1 - half)) * RATE

    def record(self, rng, samples):
        """Displacements (O, T) under white forces by the same rule, with noise; all masses are equal."""
        a, ratio, power = 2 * RATE, -self.stored.real, np.abs(self.stored) ** 2
        shape = self.shape / np.linalg.norm(self.shape, axis=0)
        forces = shape.T @ rng.normal(size=(len(shape), samples))
        below = np.array([a * a + 2 * ratio * a + power, 2 * (power - a * a), a * a - 2 * ratio * a + power])
        moved = shape @ np.array([lfilter([1, 2, 1], own, f) for own, f in zip(below.T, forces, strict=True)])
        moved = detrend(moved)
        return moved + NOISE * moved.std() * rng.normal(size=moved.shape)


def identified(record, band) -> OperationalModes:
    """Return the modes of displacements (O, T), by way of a file and a channel table, as `ident modal` reads them."""
    names = [f"level {len(record) - i}" for i in range(len(record))]
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        with h5py.File(folder / "frame.h5", "w") as file:
            for level, values in zip(names, record, strict=True):
                file[level] = values
        rows = [f"frame.h5,{level},response,{level},x,m,{RATE},0" for level in names]
        text = "\n".join(["file,channel,role,point,direction,unit,rate,q1 [deg]", *rows])
        (folder / "channels.csv").write_text(text + "\n")
        (test,) = measured_tests(
            read_channels(folder / "channels.csv"), recordings_of(folder), Processing(band=tuple(band))
        )
        return operational_modes(test)


def off(modes: OperationalModes, i: int, pole: complex, shape: np.ndarray) -> tuple[float, float, np.ndarray]:
    """Return by how many standard deviations frequency, damping ratio and the parts of a mode's shape are off."""
    count, size = len(modes.frequency), 2 * len(shape)
    reference = np.argmin(np.abs(modes.shape[:, i] - 1))
    apart = modes.shape[:, i] - shape / shape[reference]
    start = 2 * count + i * size
    sd = np.sqrt(np.diag(modes.covariance)[start : start + size].reshape(2, -1))
    parts = np.delete(np.array([apart.real, apart.imag]) / np.where(sd > 0, sd, 1), reference, 1)
    frequency, damping = np.abs(pole) / (2 * np.pi), -pole.real / np.abs(pole)
    sigma = modes.sigma[:, i]
    return (modes.frequency[i] - frequency) / sigma[0], (modes.damping[i] - damping) / sigma[1], parts.ravel()


def which(modes: OperationalModes, pole: complex) -> int | None:
    """Return the number of the found mode that a true one is, None where it is lost."""
    apart = np.abs(2 * np.pi * modes.frequency / np.abs(pole) - 1)
    return int(apart.argmin()) if apart.min() < NEAR else None


def show(frame: Frame, modes: OperationalModes) -> None:
    """Print each mode beside the truth, and whether all are within 3 sd of it."""
    print(
        "frequency [Hz]            off by sd  (stored off by)  damping ratio [%]      sd  (stored)  shape: MAC, most sd"
    )
    lost, poles, motions = 0, list[float](), list[float]()
    for pole, stored, shape in zip(frame.poles, frame.stored, frame.shape.T, strict=True):
        i = which(modes, pole)
        if i is None:
            lost += 1
            print(f"{np.abs(pole) / (2 * np.pi):.4f} is lost")
            continue
        hertz, ratio, parts = off(modes, i, pole, shape)
        plain = off(modes, i, stored, shape)
        found, sigma = modes.shape[:, i], modes.sigma[:, i]
        mac = abs(shape @ found) ** 2 / (shape @ shape * np.vdot(found, found).real)
        poles += [abs(hertz), abs(ratio)]
        motions += np.abs(parts).tolist()
        print(
            f"{modes.frequency[i]:.5f} +- {sigma[0]:.5f}  {hertz:8.2f}  ({plain[0]:7.2f})        "
            f"{100 * modes.damping[i]:.3f} +- {100 * sigma[1]:.3f}  {ratio:8.2f}  ({plain[1]:5.2f})   "
            f"{mac:.4f}, {np.abs(parts).max():.2f} of {len(parts)} parts"
        )
    for name, own in (("frequencies and damping ratios", poles), ("parts of shapes", motions)):
        print(f"{sum(each < LIMIT for each in own)} of {len(own)} {name} within {LIMIT:g} sd, the most {max(own):.2f}")
    print(f"{lost} modes lost")


def repeated(frame: Frame, given: argparse.Namespace, band: Sequence[float], samples: int) -> None:
    """Print how many of fresh records have their modes, within how many standard deviations."""
    errors, complete = [], 0
    for n in range(given.records):
        try:
            modes = identified(frame.record(np.random.default_rng(given.seed + n), samples), band)
        except InputError:
            continue
        pairs = [(which(modes, pole), pole, shape) for pole, shape in zip(frame.poles, frame.shape.T, strict=True)]
        errors += [off(modes, i, pole, shape) for i, pole, shape in pairs if i is not None]
        complete += all(i is not None for i, _, _ in pairs)
    print(f"{given.records} fresh records: {complete} have all {len(frame.poles)} modes")
    parts = np.concatenate([own for _, _, own in errors])
    for name, scaled in (
        ("frequencies", np.array([each[0] for each in errors])),
        ("damping ratios", np.array([each[1] for each in errors])),
        ("parts of shapes", parts),
    ):
        inside = [int((np.abs(scaled) < limit).sum()) for limit in (1.96, LIMIT)]
        print(f"{name:<16} {inside[0]} of {scaled.size} in their 95 % interval, {inside[1]} within {LIMIT:g} sd")


def main() -> None:
    """Read the folder, identify and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--band", type=float, nargs=2)
    parser.add_argument("--records", type=int, default=0)
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    ident.ModalOptions()
    record, omega, ratio, shape = (
        np.load(given.folder / f"{name}.npy") for name in ("data_shearframe", "omega_n", "xi_ref", "phi_ref")
    )
    frame = Frame(omega * (-ratio + 1j * np.sqrt(1 - ratio**2)), shape)
    for band in [given.band] if given.band else BANDS:
        modes = identified(record.T, band)
        print(f"band {band[0]:g} to {band[1]:g} Hz: {modes.blocks} blocks of {modes.decays:.1f} decay times each")
        print(*modes.remarks, sep="\n")
        show(frame, modes)
        if given.records:
            repeated(frame, given, band, len(record))
    print(f"load at the end {os.getloadavg()[0]:.1f}")


if __name__ == "__main__":
    main()
