"""Motions with less residual vibration: input shapers, and moving averages of the command.

A shaper replaces a command by a sum of delayed copies with amplitudes that add up to one. Two copies half a period
apart cancel each other's vibration; further copies extend this to frequencies near the expected one.

References:
    Singer and Seering, "Preshaping command inputs to reduce system vibration", J. Dyn. Sys. Meas. Control 112, 1990
    (ZV, ZVD). Singhose, Seering, Singer, "Residual vibration reduction using vector diagrams to generate shaped
    inputs", J. Mech. Des. 116, 1994 (EI); Singhose, Porter, Singer, "Shaping for large-scale residual vibration:
    extra-insensitive and multi-hump shapers", Proc. American Control Conference, 1995 (two humps).
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.integrate import cumulative_trapezoid

from ident.vibrate.motion import JOINED, Motion

TOLERATED = 0.05
"""Residual [-] that the extra-insensitive shapers allow, as in the papers."""
FINE = 1e-3
"""Sampling step [s] of a motion before posture-dependent shaping."""


@dataclass(frozen=True)
class Shaper:
    """Impulses for convolution with a command.

    Attributes:
        name: as in the literature.
        cycles: (n,) [-] delays, in damped periods of the mode.
        amplitudes: (n,) [-] adding up to one.
    """

    name: str
    cycles: Float[np.ndarray, "n"]
    amplitudes: Float[np.ndarray, "n"]

    def residual(
        self, frequency: Float[np.ndarray, "*f"] | float, expected: float, damping_ratio: float = 0.0
    ) -> Float[np.ndarray, "*f"]:
        """Return the residual vibration of the impulses, relative to that of a single impulse.

        exp(-zeta w t_n) |sum of A_i exp((zeta w + i w_d) t_i)| of a mode with w = 2 pi f.

        Args:
            frequency: [Hz] natural frequency of the mode.
            expected: [Hz] design frequency of the shaper.
            damping_ratio: [-] of the mode.
        """
        w = 2 * np.pi * np.asarray(frequency, float)[..., None]
        t = self.cycles / expected
        decay = np.exp(damping_ratio * w * (t - t[-1]))
        turn = np.exp(1j * w * np.sqrt(1 - damping_ratio**2) * t)
        return np.asarray(np.abs((self.amplitudes * decay * turn).sum(-1)))


def shapers(damping_ratio: float = 0.0) -> tuple[Shaper, ...]:
    """Return the shapers of the literature for one mode: ZV, MZV, ZVD, EI and two-hump EI.

    Shapers for a damped mode have the undamped amplitudes times K^(2 t), t in periods and K = exp(-pi zeta /
    sqrt(1 - zeta^2)), scaled to a sum of one: exact for ZV, MZV and ZVD; at 2 % damping EI leaves 0.047, not 0.05.
    """
    v = TOLERATED
    x = np.cbrt(v**2 * (np.sqrt(1 - v**2) + 1))
    outer = (3 * x**2 + 2 * x + 3 * v**2) / (16 * x)
    forms: dict[str, tuple[tuple[float, ...], tuple[float, ...]]] = {
        "ZV": ((0, 0.5), (1, 1)),
        "MZV": ((0, 0.375, 0.75), (1, np.sqrt(2), 1)),  # zero vibration with copies 3/8 of a period apart
        "ZVD": ((0, 0.5, 1), (1, 2, 1)),
        "EI": ((0, 0.5, 1), (1 + v, 2 * (1 - v), 1 + v)),
        "2HEI": ((0, 0.5, 1, 1.5), (outer, 0.5 - outer, 0.5 - outer, outer)),
    }
    k = np.exp(-np.pi * damping_ratio / np.sqrt(1 - damping_ratio**2))
    made = []
    for name, (cycles, sizes) in forms.items():
        decayed = np.array(sizes) * k ** (2 * np.array(cycles))
        made.append(Shaper(name, np.array(cycles, float), decayed / decayed.sum()))
    return tuple(made)


# -------- Along the posture


def shaped(
    path: Callable[[np.ndarray], np.ndarray],
    duration: float,
    steps: tuple[tuple[Shaper, Callable[[np.ndarray], np.ndarray]], ...],
) -> tuple[Float[np.ndarray, "T"], Float[np.ndarray, "T"]]:
    """Return a motion along a path convolved with shapers whose periods follow the posture.

    Each shaper delays by cycles of its mode, not by seconds: with psi(t) the cycles since the start, d psi/dt =
    f(alpha), alpha(psi) becomes the sum of A_i alpha(psi - c_i). The path stays. A mode whose frequency changes slowly
    along it has no residual vibration (WKB). At constant frequency this is the shaper of the literature.

    Args:
        path: alpha [rad] at times [s] from 0 to the duration, constant before and after.
        duration: [s]
        steps: shapers, applied in order, each with the frequency [Hz] of its mode as a function of alpha.

    Returns:
        times [s], not equally spaced, and alpha [rad] there.
    """
    time = np.linspace(0.0, duration, 2 + int(duration / FINE))
    alpha = np.asarray(path(time))
    for shaper, frequency in steps:
        cycles = cumulative_trapezoid(frequency(alpha), time, initial=0.0)
        more = int(len(time) * shaper.cycles[-1] / cycles[-1])
        whole = np.linspace(0.0, cycles[-1] + shaper.cycles[-1], len(time) + more)
        delayed = [np.interp(whole - c, cycles, alpha) for c in shaper.cycles]
        alpha = np.tensordot(shaper.amplitudes, np.stack(delayed), 1)
        time = cumulative_trapezoid(1 / frequency(alpha), whole, initial=0.0)
    return time, alpha


# -------- Moving average


def averaged(motion: Motion, window: float) -> Motion:
    """Return the moving average of a motion over the last `window` seconds: (P(t) - P(t - w)) / w for each angle.

    Speed, acceleration and jerk nowhere exceed the motion's; an undamped mode of frequency 1 / window is left at rest.
    The average starts with the motion and ends a window later.

    Args:
        motion: the motion; at rest before its start and after its end.
        window: [s]
    """
    breaks, c = np.asarray(motion.breaks), np.asarray(motion.coefficients)
    start, powers = c[-1, 0], np.arange(len(c), 0, -1)[:, None, None]
    moved = c.copy()
    moved[-1] -= start  # relative to the start, so that the integral does not grow with the time before
    rest = np.zeros((len(c) + 1, 1, c.shape[2]))
    rest[-2, 0] = motion.on_piece(len(breaks) - 2, breaks[-1])[0] - start
    integral = np.concatenate([moved / powers, np.zeros_like(c[:1])])
    lengths = np.diff(breaks)[:, None]
    grown = np.cumsum(sum(part * lengths**k for part, k in zip(integral, range(len(c), -1, -1), strict=True)), 0)
    integral = np.concatenate([integral, rest], 1)
    integral[-1, 1:] = grown
    both = np.sort(np.concatenate([breaks, breaks + window]))
    both = both[np.append(True, np.diff(both) > JOINED)]
    means = (_about(breaks, integral, both[:-1]) - _about(breaks, integral, both[:-1] - window)) / window
    means[-1] += start
    return Motion(motion.name, both, means)


def _about(
    breaks: Float[np.ndarray, " breaks"], c: Float[np.ndarray, "powers breaks driven"], times: Float[np.ndarray, "T"]
) -> Float[np.ndarray, "powers T driven"]:
    """Return the coefficients of piecewise polynomials re-centred at other times, none before the first break."""
    k = np.searchsorted(breaks, times + JOINED, side="right") - 1
    moved = np.where(k[:, None] >= 0, c[:, k], 0.0)
    x = (times - breaks[k])[:, None]
    for done in range(len(c)):  # repeated division by the shifted variable (Horner)
        for power in range(1, len(c) - done):
            moved[power] += moved[power - 1] * x
    return moved
