"""Lines of what turns during a test, at known speeds: found, taken out of the records, and named."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.fft import next_fast_len
from scipy.optimize import minimize_scalar
from scipy.special import chdtri

from ident.measure.speeds import Speed
from ident.modal.mains import MAINS

MULTIPLES = 10
"""Multiples of a speed at which lines are sought."""
SLIP = 0.01
"""How far a speed may be from what is said, as a share."""
CHANCE = 1e-10
"""Chance of noise alone to stand out so far, at one frequency."""
NARROW, ABOUT = 2.5, 24.0
"""A line is that narrow, and what lies about it that wide to either side, in reciprocals of the duration."""


@dataclass(frozen=True)
class Harmonic:
    """A line of something that turns.

    Attributes:
        name: of what turns.
        multiple: of its speed.
        frequency: [Hz] where the line is.
        share: [-] of the power of the response in which it is strongest.
        response: number of that response.
    """

    name: str
    multiple: int
    frequency: float
    share: float
    response: int

    def __str__(self) -> str:
        return f"{times(self.multiple)}{self.name} at {self.frequency:.4g} Hz"


def times(multiple: int) -> str:
    """Return how often, in words; empty for once."""
    return f"{multiple} x " if multiple > 1 else ""


def without_harmonics(
    record: Float[np.ndarray, "O T"], step: float, speeds: Sequence[Speed], band: tuple[float, float]
) -> tuple[Float[np.ndarray, "O T"], tuple[Harmonic, ...]]:
    """Return a record without the lines of what turns, and the lines that it had.

    At each multiple of a speed within the band, and at the mains, the record's spectrum is searched for a line: power
    that stands out of what lies close about it, where a resonance is smooth. Such a line is a sine of constant
    frequency whose amplitude grows linearly; it is subtracted by least squares, which takes no more of a mode than
    what lies within the reciprocal of the record's duration.

    Args:
        record: responses, without their mean.
        step: [s] between samples.
        speeds: what turns.
        band: [Hz] in which lines are sought.

    References:
        Peeters, Cornelis, Janssens, Van der Auweraer, "Removing disturbing harmonics in operational modal analysis",
        IOMAC 2007.
    """
    lines: list[Harmonic] = []
    spectrum = _Spectrum.of(record, step)
    for name, multiple, nominal, slip in _sought(speeds, band):
        rough = spectrum.line(nominal * (1 - slip), nominal * (1 + slip))
        if rough is None or any(abs(each.frequency - rough) < 2 * spectrum.resolution for each in lines):
            continue
        frequency = _refined(record, step, rough, spectrum.resolution)
        sine = _sine(record, step, frequency)
        share = (sine**2).sum(1) / (record**2).sum(1)
        record = record - sine
        lines.append(Harmonic(name, multiple, frequency, float(share.max()), int(share.argmax())))
    return record, tuple(lines)


def _sought(speeds: Sequence[Speed], band: tuple[float, float]) -> Iterator[tuple[str, int, float, float]]:
    """Yield name, multiple, frequency [Hz] and how far it may be off."""
    for speed in speeds:
        for multiple in range(1, MULTIPLES + 1):
            if band[0] <= multiple * speed.frequency <= band[1]:
                yield speed.name, multiple, multiple * speed.frequency, SLIP
    for line in MAINS:
        if band[0] <= line <= band[1]:
            yield "the mains", 1, line, SLIP / 10


def turning(speeds: Sequence[Speed], frequency: float) -> str:
    """Return what turns at a frequency [Hz], or at a part of it; empty for nothing."""
    pairs = [(speed, multiple) for speed in speeds for multiple in range(1, MULTIPLES + 1)]
    apart = [abs(speed.frequency * multiple / frequency - 1) for speed, multiple in pairs]
    if min(apart, default=1.0) > SLIP:
        return ""
    speed, multiple = pairs[int(np.argmin(apart))]
    return f"{times(multiple)}{speed.name}, which turns at {speed.frequency:.4g} Hz"


@dataclass(frozen=True)
class _Spectrum:
    """Power (O, F) of responses at lines [Hz] closer than the record resolves."""

    frequency: np.ndarray
    power: np.ndarray
    resolution: float

    @classmethod
    def of(cls, record: np.ndarray, step: float) -> "_Spectrum":
        samples = record.shape[1]
        count = next_fast_len(2 * samples, real=True)
        power = np.abs(np.fft.rfft(record * np.hanning(samples), count)) ** 2
        return cls(np.fft.rfftfreq(count, step), power, 1 / (samples * step))

    def line(self, low: float, high: float) -> float | None:
        """Return where the line that stands out most is between two frequencies; None where none does."""
        level = chdtri(2, CHANCE) / chdtri(2, 0.5)
        at = np.flatnonzero((self.frequency >= low) & (self.frequency <= high))
        best = max((int(at[each.argmax()]) for each in self.power[:, at]), key=self._stands_out, default=None)
        return float(self.frequency[best]) if best is not None and self._stands_out(best) > level else None

    def _stands_out(self, i: int) -> float:
        """Return the largest power at a line over the median of what lies about it."""
        apart = np.abs(self.frequency - self.frequency[i]) / self.resolution
        about = (apart > NARROW) & (apart < ABOUT)
        return float((self.power[:, i] / np.median(self.power[:, about], axis=1)).max())


def _refined(record: np.ndarray, step: float, rough: float, resolution: float) -> float:
    """Return the frequency at which a sine takes most of a record."""
    ends = rough - resolution, rough + resolution
    taken = lambda frequency: -float((_sine(record, step, frequency) ** 2).sum())  # noqa: E731
    return float(minimize_scalar(taken, bounds=ends, method="bounded", options={"xatol": 1e-3 * resolution}).x)


def _sine(record: np.ndarray, step: float, frequency: float) -> Float[np.ndarray, "O T"]:
    """Return the sine, of linearly changing amplitude and phase, that is nearest to each response."""
    time = np.linspace(-1.0, 1.0, record.shape[1])
    turn = 2 * np.pi * frequency * step * np.arange(record.shape[1])
    basis = np.array([np.cos(turn), np.sin(turn), time * np.cos(turn), time * np.sin(turn)])
    fitted: np.ndarray = np.linalg.solve(basis @ basis.T, basis @ record.T).T @ basis
    return fitted
