"""How frequency and damping change with amplitude along free decays: a drive's friction stiffens an arm at rest."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from jaxtyping import Complex, Float
from scipy.stats import t

THIRDS = (0.0, math.log(1.5) / 2, math.log(3.0) / 2, 3.0)
"""Ends of three windows with a third of a mode's energy each, in decay times."""
TREND_CHANCE = 1e-3
"""False-alarm probability of a trend of one number by the scatter of the taps; assumed."""
ALIKE = 0.8
"""Correlation of the responses' covariances after any two taps above which all were in one direction; assumed."""


@dataclass(frozen=True)
class AmplitudeTrend:
    """Change of poles with the amplitude of each mode at the response that it moves most.

    Attributes:
        amplitude: (3, m) [m] largest of all taps; means of the first and the last two windows of the decays.
        slope: (m,) [rad/s] complex change of the pole as the amplitude grows by a factor e; zero if not determined.
        without: (B, m) [rad/s] the same without each tap.
        one_way: whether all taps were in one direction.
    """

    amplitude: Float[np.ndarray, "3 m"]
    slope: Complex[np.ndarray, "m"]
    without: Complex[np.ndarray, "B m"]
    one_way: bool

    def pick(self, kept: Sequence[int]) -> "AmplitudeTrend":
        """Return some of the modes."""
        return replace(self, amplitude=self.amplitude[:, kept], slope=self.slope[kept], without=self.without[:, kept])

    def change(
        self,
        poles: Float[np.ndarray, "2 m"],
        amplitude: Float[np.ndarray, "m"],
        slope: Complex[np.ndarray, "m"] | None = None,
    ) -> Float[np.ndarray, "2 m"]:
        """Return the change of frequencies [Hz] and damping ratios from the middle of the decay to an amplitude [m]."""
        frequency, damping = poles
        pole = 2 * np.pi * frequency * (-damping + 1j * np.sqrt(1 - damping**2))
        moved = pole + (self.slope if slope is None else slope) * np.log(amplitude / self.middle)
        size = np.abs(moved)
        change: np.ndarray = np.array([size / (2 * np.pi), -moved.real / size]) - poles
        return change

    def seen(self, poles: Float[np.ndarray, "2 m"]) -> Float[np.ndarray, "2 m"]:
        """Return the difference between both halves of the decay; zero within its scatter over the taps."""
        early, late = self.amplitude[1:]
        apart = self.change(poles, early) - self.change(poles, late)
        ones = np.array([self.change(poles, early, own) - self.change(poles, late, own) for own in self.without])
        variance = (len(ones) - 1) * ones.var(0) * float(t.isf(TREND_CHANCE / 2, len(ones) - 1)) ** 2
        found: np.ndarray = np.where(apart**2 > variance, apart, 0.0)
        return found

    @property
    def middle(self) -> Float[np.ndarray, "m"]:
        """Amplitude [m] to which the modes of the whole decays belong."""
        return np.sqrt(self.amplitude[1] * self.amplitude[2])


def amplitude_trend(
    decays: Sequence[Float[np.ndarray, "O _"]],
    pole: Complex[np.ndarray, "m"],
    shape: Complex[np.ndarray, "O m"],
    moves: Float[np.ndarray, "m"],
    step: float,
) -> AmplitudeTrend:
    """Return how poles change with amplitude, by the phase and size that each mode gains along the decays.

    With fixed poles and shapes, least squares give a mode's amplitude q in three windows, referred to the begin; a pole
    that is off by d changes it as exp(d t). So d is ln(q2 / q1) over the time between the windows' centres, and its
    change from the first two windows to the last two belongs to the amplitude lost between them. Taps count by energy;
    a decay too short for three windows counts as unchanged, which pulls the trend towards zero.

    Args:
        decays: free decays, in standard deviations of their noise.
        pole: [rad/s] as recorded.
        shape: of unit length, in the decays' units.
        moves: [m] largest displacement of a response for a unit of q.
        step: [s] between samples.

    References:
        Feldman, "Non-linear free vibration identification via the Hilbert transform", J. Sound Vib. 208,
        1997 (backbone).
    """
    rows = np.array([[_along(decay, pole, shape, m, step) for m in range(len(pole))] for decay in decays])
    begin, gain, loss = rows[..., 0], rows[..., 1], rows[..., 2:].real
    energy = np.abs(begin) ** 2
    total = energy.sum(0)
    own, rest = energy * gain, np.maximum(total - energy, 1e-300)
    size = np.abs(begin)
    mean = np.exp((energy[..., None] * (np.log(size)[..., None] - loss)).sum(0) / total[:, None]).T
    shared = np.array([decay @ decay.T - decay.shape[1] * np.eye(len(decay)) for decay in decays]).reshape(
        len(decays), -1
    )
    unit = shared / np.linalg.norm(shared, axis=1, keepdims=True)
    one_way = bool((unit @ unit.T).min() > ALIKE)
    return AmplitudeTrend(moves * [size.max(0), *mean], own.sum(0) / total, (own.sum(0) - own) / rest, one_way)


def _along(decay: np.ndarray, pole: np.ndarray, shape: np.ndarray, m: int, step: float) -> list[complex]:
    """Return a mode's amplitude at the begin of a decay, the slope of its pole, and both halves' loss of ln(size)."""
    rate = max(float(-pole[m].real), 1e-3)
    ends = np.minimum(np.array(THIRDS) / (rate * step), decay.shape[1]).astype(int)
    counts = np.diff(ends)
    whole = participations(decay[:, : ends[-1]], pole, shape, step)[m]
    centres = []
    for a, b in pairwise(ends.tolist()):
        time = step * np.arange(a, max(b, a + 1))
        centres.append(float(np.average(time, weights=np.exp(-2 * rate * (time - time[0])))))
    halves = rate * (centres[0] + centres[1]) / 2, rate * (centres[1] + centres[2]) / 2
    if counts.min() * len(decay) < 4 * len(pole):
        return [whole, 0.0, *halves]
    parts = pairwise(ends.tolist())
    q = [participations(decay[:, a:b], pole, shape, step)[m] * np.exp(-pole[m] * a * step) for a, b in parts]
    first, last = np.log(q[1] / q[0]) / (centres[1] - centres[0]), np.log(q[2] / q[1]) / (centres[2] - centres[1])
    return [whole, (first - last) / (halves[1] - halves[0]), *halves]


def participations(
    decay: Float[np.ndarray, "O T"], pole: Complex[np.ndarray, "m"], shape: Complex[np.ndarray, "O m"], step: float
) -> Complex[np.ndarray, "m"]:
    """Return the amplitude of each mode at the begin of a free decay, y(t) = 2 Re sum_m shape_m q_m exp(pole_m t)."""
    time = step * np.arange(decay.shape[1])
    moves = 2 * shape[:, None] * np.exp(pole * time[:, None])
    both = np.concatenate([moves.real, -moves.imag], 2).reshape(decay.size, -1)
    found = np.linalg.lstsq(both, decay.ravel(), rcond=None)[0]
    amplitude: np.ndarray = found[: len(pole)] + 1j * found[len(pole) :]
    return amplitude
