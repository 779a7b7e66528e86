"""Phases of the turning masses that nobody knows, and kinematic errors: which they are, and draws of them."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float

from ident.arm.arm import Arm

GUESSED = ("assumed", "calibrated", "derived", "designed", "")
"""Origins of a phase with which it is not known: it was not seen on this arm."""
KINDS = (("eccentricity", "phase"), ("error", "error_phase"))
"""What excites: amplitude and phase of the imbalance and of the kinematic error."""


@dataclass(frozen=True)
class Unknowns:
    """What nobody knows of the excitation.

    Attributes:
        phases: paths of the phases of imbalance and kinematic error that are not known.
        errors: lowest and highest amplitude [rad] of the kinematic errors that are not known, by path; each between is
            as likely as any other. The arm itself has the highest.
    """

    phases: tuple[str, ...] = ()
    errors: Mapping[str, tuple[float, float]] = field(default_factory=dict)

    @property
    def highest(self) -> dict[str, float]:
        """The highest kinematic errors, by path [rad]."""
        return {path: high for path, (_, high) in self.errors.items()}

    def draws(self, count: int, seed: int = 0) -> dict[str, Float[np.ndarray, "K"]]:
        """Return draws of them, by path [rad]."""
        rng = np.random.default_rng(seed)
        angles = rng.uniform(0.0, 2 * np.pi, (count, len(self.phases)))
        sizes = {path: rng.uniform(low, high, count) for path, (low, high) in self.errors.items()}
        return dict(zip(self.phases, angles.T, strict=True)) | sizes


def unknowns(
    arm: Arm,
    origins: Mapping[str, str],
    given: Collection[str],
    *,
    errors: tuple[float, float] | None = None,
    phases: bool = True,
) -> tuple[Arm, Unknowns]:
    """Return an arm with the largest kinematic errors that may be, and what nobody knows of its excitation.

    Args:
        arm: the arm.
        origins: of its numbers, by path.
        given: numbers that the user has set.
        errors: lowest and highest kinematic error [arc seconds, peak to peak], twice the amplitude; None for the arm's.
        phases: whether phases are unknown.
    """
    bounds: dict[str, tuple[float, float]] = {}
    if errors is not None:
        low, high = np.deg2rad(np.array(errors) / 2 / 3600).tolist()
        bounds = unknown_errors(arm, origins, given, low, high)
        arm = arm.replace({path: end for path, (_, end) in bounds.items()})
    return arm, Unknowns(unknown_phases(arm, origins, given) if phases else (), bounds)


def unknown_phases(arm: Arm, origins: Mapping[str, str], given: Collection[str]) -> tuple[str, ...]:
    """Return the paths of the phases that are not known, of what excites the arm.

    Args:
        arm: the arm.
        origins: of its numbers, by path.
        given: numbers that the user has set.
    """
    sizes = {f"{drive.name}.{phase}": getattr(drive, size) for size, phase in KINDS for drive in arm.drives}
    exciting = [path for path, size in sizes.items() if np.any(np.asarray(size) != 0)]
    return tuple(path for path in exciting if _guessed(path, origins, given))


def unknown_errors(
    arm: Arm, origins: Mapping[str, str], given: Collection[str], low: float, high: float
) -> dict[str, tuple[float, float]]:
    """Return the kinematic errors that are not known, with their bounds [rad], by path; see `unknown_phases`."""
    paths = [f"{drive.name}.error" for drive in arm.drives]
    return {path: (low, high) for path in paths if _guessed(path, origins, given)}


def _guessed(path: str, origins: Mapping[str, str], given: Collection[str]) -> bool:
    return path not in given and origins.get(path, "") in GUESSED
