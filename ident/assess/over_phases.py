"""What phases that nobody knows do to the vibration: its worst case, its quantiles, what makes it."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from ident.arm.arm import Arm
from ident.assess.phases import KINDS, Unknowns
from ident.vibrate.response.superposition import Superposition

DRAWS = 1000
"""Draws of phases, which take no simulation."""


@dataclass(frozen=True)
class OverPhases:
    """The vibration over all phases that are not known.

    Attributes:
        peaks: (3, K) [m] peak with each of K draws of these phases.
        envelope: (3, T) [m] the largest magnitude over all of them at each time.
        division: (3, 3) [m] what motion and all that is known, imbalance and kinematic error (first axis) make of the
            largest peak in each direction.
    """

    peaks: Float[np.ndarray, "3 K"]
    envelope: Float[np.ndarray, "3 T"]
    division: Float[np.ndarray, "3 3"]

    @property
    def worst(self) -> Float[np.ndarray, "3"]:
        """The largest peak over all phases in each direction [m]."""
        return self.envelope.max(1)

    @property
    def band(self) -> Float[np.ndarray, "2 3"]:
        """5 and 95 % quantiles of the peak over the phases [m]."""
        return np.quantile(self.peaks, (0.05, 0.95), axis=1)

    def exceeds(self, limit: float) -> tuple[Float[np.ndarray, "3"], float]:
        """Return the share of phases whose peak exceeds a limit [m]: in each direction, and in any."""
        beyond = self.peaks > limit
        return beyond.mean(1), float(beyond.any(0).mean())


def over_phases(whole: Superposition, unknown: Unknowns, count: int = DRAWS) -> OverPhases:
    """Return the vibration over what is not known of the excitation, each phase as likely as any other."""
    return OverPhases(whole.peaks(*_drawn(whole, unknown, count)), whole.envelope, whole.division)


def at_share(arm: Arm, whole: Superposition, unknown: Unknowns, share: float) -> dict[str, float]:
    """Return numbers of an excitation, by path, whose largest peak a share of all that may be does not exceed.

    Args:
        arm: has the highest kinematic errors.
        whole: its vibration.
        unknown: what may be.
        share: of all that may be.
    """
    phases, factors = _drawn(whole, unknown, DRAWS)
    peaks = whole.peaks(phases, factors).max(0)
    chosen = int(np.argsort(peaks)[min(int(np.ceil(share * DRAWS)), DRAWS - 1)])
    sizes = {
        _size(path): float(arm.get(_size(path))) * factors[k, chosen]
        for k, path in enumerate(whole.unknown)
        if _size(path) in unknown.errors
    }
    return sizes | dict(zip(whole.unknown, phases[:, chosen].tolist(), strict=True))


def _drawn(
    whole: Superposition, unknown: Unknowns, count: int
) -> tuple[Float[np.ndarray, "U K"], Float[np.ndarray, "U K"]]:
    """Return draws of the phases of a sum, and of the factors of what they excite."""
    drawn, even = unknown.draws(count), np.ones(count)
    highest = unknown.highest
    factors = [
        drawn[_size(path)] / highest[_size(path)] if highest.get(_size(path)) else even for path in whole.unknown
    ]
    return np.stack([drawn[path] for path in whole.unknown]), np.stack(factors)


def _size(phase: str) -> str:
    """Return the path of what a phase belongs to."""
    drive, _, name = phase.rpartition(".")
    return f"{drive}.{next(size for size, of in KINDS if of == name)}"
