"""Natural frequencies that are marked in a spectrum: of an arm held at a posture, or all along a motion."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from ident.arm.arm import Arm
from ident.errors import InputError, Problem
from ident.identify.loads import loads_of
from ident.identify.modal_analysis import modal_analysis
from ident.measure import Load, Log
from ident.vibrate.modal.branches import branches
from ident.vibrate.motion.replay import replay

MODES = 6
"""Modes that are marked."""
POSTURES = 400
"""Samples of a joint path at which the arm is held, at most: frequencies change slowly along it."""

ROUNDING = 1e-9
"""Time [s] by which a trace may reach beyond its path."""

Band = tuple[float, float]


@dataclass(frozen=True)
class MarkedModes:
    """The lowest natural frequencies of an arm.

    Attributes:
        arm: name of the arm.
        load: the load case.
        first: (driven,) [rad] the posture, or the first one of a motion.
        last: (driven,) [rad] the last one; alike where the arm is held.
        frequencies: (K,) [Hz] of each mode at equal steps of time, by its label at the last posture; ascending there.
    """

    arm: str
    load: Load
    first: tuple[float, ...]
    last: tuple[float, ...]
    frequencies: Mapping[str, Float[np.ndarray, "K"]]

    @property
    def bands(self) -> dict[str, Band]:
        """The lowest and the highest frequency [Hz] of each mode, by its label."""
        return {label: (float(along.min()), float(along.max())) for label, along in self.frequencies.items()}

    @property
    def held(self) -> bool:
        """Whether the arm is held at one posture."""
        return all(low == high for low, high in self.bands.values())

    def near(self, frequency: float, within: float, direction: str) -> str | None:
        """Return the mode near a frequency, None for none.

        Of several, one that moves in the direction; of these the one that is near for the longest time, then the
        nearest.

        Args:
            frequency: [Hz]
            within: [Hz] what counts as near.
            direction: `vertical` or `lateral`.
        """
        apart = {label: np.abs(along - frequency) for label, along in self.frequencies.items()}
        near = {label: gap for label, gap in apart.items() if gap.min() <= within}
        rank = {label: (label.startswith(direction), (gap <= within).sum(), -gap.min()) for label, gap in near.items()}
        return max(rank, key=lambda label: rank[label], default=None)


def marked_at(arm: Arm, posture: tuple[float, ...], load: Load) -> MarkedModes:
    """Return the natural frequencies of an arm that is held at a posture [rad].

    Raises:
        InputError: the posture or the load does not fit the arm.
        ModelError: the arm has no stable equilibrium there.
    """
    modes = modal_analysis(arm, posture, load, MODES)
    frequencies = np.asarray(modes.modes.frequency)[:, None]
    return MarkedModes(arm.name, load, posture, posture, dict(zip(map(str, modes.labels), frequencies, strict=True)))


def marked_along(arm: Arm, log: Log, span: tuple[float, float], load: Load) -> MarkedModes:
    """Return the natural frequencies of an arm held at the postures of a joint path, between two of its times [s].

    Raises:
        InputError: the path does not cover that time.
        ModelError: the arm has no stable equilibrium at some posture.
    """
    (start, end), time = span, log.time
    if start < time[0] - ROUNDING or end > time[-1] + ROUNDING:
        got, expected = f"{time[0]:.4g} to {time[-1]:.4g} s", f"the span of the trace, {start:.4g} to {end:.4g} s"
        raise InputError(Problem(log.path, got, expected, "cut the trace to it (`start`, `end`)", "path"))
    at = np.linspace(start, end, min(POSTURES, len(time)))
    angles = np.stack([np.interp(at, time, log.angles[joint.name]) for joint in arm.driven])
    found = branches(arm, replay(at, angles), count=MODES, times=at - at[0], loads=loads_of(arm, load))
    frequencies = {str(found.labels[b]): found.median[b] for b in np.argsort(found.median[:, -1])}
    return MarkedModes(arm.name, load, _posture(angles[:, 0]), _posture(angles[:, -1]), frequencies)


def _posture(angles: Float[np.ndarray, "driven"]) -> tuple[float, ...]:
    return tuple(round(float(angle), 9) for angle in angles)
