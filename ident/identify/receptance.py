"""Frequency response of a point of an arm: its displacement by a harmonic force at it, along the same axis.

With the mass, damping and stiffness matrices about the loaded equilibrium and the Jacobian J of the point's
displacement along an axis by all coordinates,

    h(w) = J (K + i w C - w^2 M)^-1 J',

which at w = 0 is the static compliance. C is the damping of the vibration at work: dampers, servos, in proportion to
mass, and of loss factors their matrix in time (`ident.arm.structural`).

References:
    Ewins, "Modal Testing", 2nd ed. 2000, chapter 2 (receptance).
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Complex, Float

from ident.programs import AnyArray

EVENLY, NEAR, WITHIN = 300, np.linspace(-4, 4, 21), 65
"""Frequencies of a response: the number of evenly spaced ones; those near a mode, in its half widths; the number about
a peak, whose size they make right to 1e-4."""
UNDAMPED = 1e-6
"""Damping ratio below which a mode counts as undamped: it rings for 100,000 periods; assumed."""


class PointSystem(NamedTuple):
    """Equations of motion about the equilibrium, and the motion of a point, in coordinates of which the stiffness is 1.

    Attributes:
        M: (n, n, *batch) [s^2] mass matrix.
        C: (n, n, *batch) [s] damping matrix, loss factors included.
        J: (n, 6, *batch) [m/sqrt(N m), rad/sqrt(N m)] displacement along three axes, rotation about them.
    """

    M: Float[AnyArray, "n n *batch"]
    C: Float[AnyArray, "n n *batch"]
    J: Float[AnyArray, "n 6 *batch"]

    def at(self, frequency: Float[np.ndarray, "F"]) -> Complex[np.ndarray, "3 F"]:
        """Return the displacement along each axis by a force along it [m/N]."""
        s, J = 2j * np.pi * frequency[:, None, None], self.J[:, :3]
        return np.einsum("nk,fnk->kf", J, np.linalg.solve(np.eye(len(J)) + s * self.C + s * s * self.M, J))

    def modes(self) -> tuple[Float[np.ndarray, "n"], Float[np.ndarray, "n"]]:
        """Return the natural frequencies [rad/s] and the damping ratio of each mode, as if it were alone."""
        squared, Q = np.linalg.eigh(self.M)  # 1 / omega^2
        omega = np.abs(squared) ** -0.5
        return omega, np.einsum("im,ij,jm->m", Q, self.C, Q) * omega / 2

    def is_damped(self, top: float) -> bool:
        """Whether all modes up to a frequency [Hz] are damped; else their peaks have no size."""
        omega, ratio = self.modes()
        return bool((ratio[omega < 2 * np.pi * top] > UNDAMPED).all())

    def grid(self, top: float) -> Float[np.ndarray, "F"]:
        """Return frequencies [Hz] from zero to a highest one: evenly, and denser near the modes."""
        omega, ratio = self.modes()
        near = omega * (1 + ratio * NEAR[:, None]) / (2 * np.pi)
        return np.unique(np.append(np.linspace(0, top, EVENLY), near[(near > 0) & (near < top)]))

    def peaks(self, top: float) -> Float[np.ndarray, "2 3"]:
        """Return frequency [Hz] and size [m/N] of the largest response along each axis, up to a frequency."""
        grid = self.grid(top)
        i = np.abs(self.at(grid)).argmax(1)
        f = np.linspace(grid[np.maximum(i - 1, 0)], grid[np.minimum(i + 1, len(grid) - 1)], WITHIN).ravel()
        size = np.abs(self.at(f))
        return np.stack([f[size.argmax(1)], size.max(1)])


class Receptance(NamedTuple):
    """Size of the frequency response of a point along three axes, each to a force along it.

    Attributes:
        frequency: (F,) [Hz] from zero, denser near the modes.
        size: (3, F) [m/N]
        peaks: (2, 3) frequency [Hz] and size [m/N] of the largest response along each axis.
        band: (2, 3, F) 5 and 95 % quantiles of the size at each frequency; NaN without draws.
        peak_band: (2, 2, 3) those of the peaks.
    """

    frequency: Float[np.ndarray, "F"]
    size: Float[np.ndarray, "3 F"]
    peaks: Float[np.ndarray, "2 3"]
    band: Float[np.ndarray, "2 3 F"]
    peak_band: Float[np.ndarray, "2 2 3"]


def receptance(arm: PointSystem, draws: Sequence[PointSystem], top: float) -> Receptance:
    """Return the response of an arm, with that of draws, up to a frequency [Hz]."""
    f = arm.grid(top)
    each = [(np.abs(one.at(f)), one.peaks(top)) for one in (arm, *draws)]
    (size, peaks), drawn = each[0], (np.stack(x, -1)[..., 1:] for x in zip(*each, strict=True))
    return Receptance(f, size, peaks, *(quantiles(x, x.shape[:-1]) for x in drawn))


def quantiles(x: np.ndarray | None, shape: tuple[int, ...]) -> Float[np.ndarray, "2 *shape"]:
    """Return the 5 and 95 % quantiles over draws, on the last axis; NaN without any."""
    return np.full((2, *shape), np.nan) if x is None or not x.size else np.quantile(x, (0.05, 0.95), axis=-1)
