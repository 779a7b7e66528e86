"""The basis of a simulation: the arm with fitted values, its motion, and the unknown phases of unbalance."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from jaxtyping import Float

from ident.arm.arm import Arm
from ident.arm.chain import Loads
from ident.arm.multibody import exciting_orders
from ident.description.file import ArmFile
from ident.identify.binding import loads_of
from ident.identify.unknowns import is_damping
from ident.identify.values import Values
from ident.measure import OWN_WEIGHT, Load, Log
from ident.vibrate.motion import Motion
from ident.vibrate.response import gear_error
from ident.vibrate.simulate import Superposition

# -------- Phases
# Unknown phases of the imbalances, and transmission errors; draws of them.

UNSEEN_ORIGINS = ("assumed", "calibrated", "derived", "designed", "")
"""Origins with which a phase counts as unknown: not identified on this arm."""
POSTURES = 200
"""Number of postures of a motion for the gears' own error."""
DAMPING = 0.3
"""Standard error of ln(damping) of which a posterior has no draws, one factor for all of an arm: assumed."""
IDENTIFIED = "identified"
"""Origin of a number from a fit or a posterior, or of a set one."""


@dataclass(frozen=True)
class Unknowns:
    """Unknowns of the excitation.

    Attributes:
        phases: paths of the unknown phases of imbalance and transmission error.
        errors: lowest and highest amplitude [rad] of unknown transmission errors, by path, uniform between; the arm
            itself has the highest.
        damping: numbers with an unknown common factor, log-normal, see `DAMPING`, by path [SI].
        count: draws of all these where there is no posterior.
    """

    phases: tuple[str, ...] = ()
    errors: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    damping: Mapping[str, float] = field(default_factory=dict)
    count: int = 0

    @property
    def highest(self) -> dict[str, float]:
        """The highest transmission errors, by path [rad]."""
        return {path: high for path, (_, high) in self.errors.items()}

    def draws(self, count: int, seed: int = 0) -> dict[str, Float[np.ndarray, "K"]]:
        """Return draws of them, by path [SI]."""
        rng = np.random.default_rng(seed)
        angles = rng.uniform(0.0, 2 * np.pi, (count, len(self.phases)))
        sizes = {path: rng.uniform(low, high, count) for path, (low, high) in self.errors.items()}
        factor = np.exp(DAMPING * rng.normal(size=count))
        damping = {path: value * factor for path, value in self.damping.items()}
        return dict(zip(self.phases, angles.T, strict=True)) | sizes | damping


def unknowns(
    arm: Arm,
    origins: Mapping[str, str],
    given: Collection[str],
    *,
    errors: tuple[float, float] | None = None,
    phases: bool = True,
) -> tuple[Arm, Unknowns]:
    """Return an arm with the largest possible transmission errors at order 2, and the unknowns of its excitation.

    The phases are those of imbalance and transmission error of its drives.

    Args:
        arm: the arm.
        origins: of its numbers, by path.
        given: numbers that the user set.
        errors: lowest and highest transmission error [arc seconds, peak to peak], twice the amplitude; None: the arm's.
        phases: whether phases are unknown.
    """
    bounds: dict[str, tuple[float, float]] = {}
    if errors is not None:
        low, high = np.deg2rad(np.array(errors) / 2 / 3600).tolist()
        paths = [f"{drive.name}.error" for drive in arm.drives]
        bounds = {path: (low, high) for path in paths if _guessed(path, origins, given)}
        arm = arm.replace({path: end for path, (_, end) in bounds.items()})
    unknown = (each.phase for each in exciting_orders(arm) if phases and _guessed(each.phase, origins, given))
    return arm, Unknowns(tuple(unknown), bounds)


def _guessed(path: str, origins: Mapping[str, str], given: Collection[str]) -> bool:
    return path not in given and origins.get(path, "") in UNSEEN_ORIGINS


# -------- Basis
# The basis of a simulation: the arm with its fitted values, its motion and its load.


@dataclass(frozen=True)
class Basis:
    """An arm with its motion, and the sources of its numbers.

    Attributes:
        arm_file: the arm as in its file.
        arm: the simulated arm: with fitted values, or medians of the draws, and the set numbers.
        motion: commanded joint angles.
        percent: [%] of full speed, or of the speed of a given path.
        load: the load case.
        log: the joint path, if one is replayed.
        fit: fitted values of the arm.
        posterior: draws of a posterior.
        changed: numbers that were set, by path [SI].
        name: base name of files: arm, motion, percent.
        unknown: unknowns of the excitation, drawn together with the posterior.
    """

    arm_file: ArmFile
    arm: Arm
    motion: Motion
    percent: float
    load: Load = OWN_WEIGHT
    log: Log | None = None
    fit: Values | None = None
    posterior: Values | None = None
    changed: Mapping[str, float] = field(default_factory=dict)
    name: str = ""
    unknown: Unknowns = field(default_factory=Unknowns)

    @cached_property
    def loads(self) -> Loads:
        """The load case in the form of the mechanics."""
        return loads_of(self.arm, self.load)

    @cached_property
    def draws(self) -> Mapping[str, Float[np.ndarray, "D"]]:
        """Draws [SI] of the numbers not set and of the unknowns, by path; empty without a posterior, or a `count`."""
        return self.drawn(self.posterior, count=self.unknown.count)

    def drawn(self, posterior: Values | None, seed: int = 0, count: int = 0) -> Mapping[str, Float[np.ndarray, "D"]]:
        """Return draws of a posterior for the numbers that were not set, and as many of the unknowns; else `count`."""
        values = posterior.without(self.changed) if posterior else {}
        count = len(next(iter(values.values()))) if values else count
        return {**self.unknown.draws(count, seed), **values} if count else {}

    def with_unknown_damping(self, count: int) -> "Basis":
        """Return the same with `count` draws of a common factor of the damping, unless the posterior has damping."""
        own = {} if self.posterior and any(map(is_damping, self.posterior.values)) else self.arm.numbers()
        damping = {path: float(x) for path, x in own.items() if is_damping(path) and path not in self.changed}
        return replace(self, unknown=replace(self.unknown, damping=damping, count=count))

    @cached_property
    def gear_error(self) -> float:
        """Largest displacement [m] of the end point along the motion from transmission errors, at rest or any speed."""
        start, end = map(float, np.asarray(self.motion.breaks)[[0, -1]])
        return float(gear_error(self.arm, self.motion(np.linspace(start, end, POSTURES))[0]).max())

    @property
    def origins(self) -> dict[str, str]:
        """Source of each of the arm's numbers, by path: `identified` if from a result or set."""
        taken = [path for values in (self.fit, self.posterior) if values for path in values.values]
        return {**self.arm_file.origins, **dict.fromkeys((*taken, *self.changed), IDENTIFIED)}

    @property
    def sources(self) -> dict[str, Any]:
        """Inputs from files, each with `path` and `sha256`, by name; None for inputs that were not given."""
        return {"arm": self.arm_file, "fit": self.fit, "posterior": self.posterior, "path": self.log}

    @property
    def point(self) -> str:
        """Name of the end point."""
        return self.arm.points[-1].name


# -------- Over phases
# Effect of unknown phases on the vibration: worst case, quantiles, contributions.

DRAWS = 1000
"""Draws of phases; they need no simulation."""


@dataclass(frozen=True)
class OverPhases:
    """The vibration over all unknown phases.

    Attributes:
        peaks: (3, K) [m] peak with each of K draws of these phases.
        envelope: (3, T) [m] the largest magnitude over all of them at each time.
        division: (3, 3) [m] contributions of motion and all known sources, of imbalance, and of transmission error
            (first axis) to the largest peak in each direction.
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
    """Return the vibration over the unknown excitation, with uniform phases."""
    return OverPhases(whole.peaks(*_drawn(whole, unknown, count)), whole.envelope, whole.division)


def at_share(arm: Arm, whole: Superposition, unknown: Unknowns, share: float) -> dict[str, float]:
    """Return numbers of an excitation, by path, whose largest peak is the given quantile over the unknowns.

    Args:
        arm: with the highest transmission errors.
        whole: its vibration.
        unknown: the unknowns of the excitation.
        share: of all possible excitations.
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
    """Return draws of the phases of a sum, and of the factors of their responses."""
    drawn, highest = unknown.draws(count), unknown.highest
    factors = [
        drawn[size] / highest[size] if highest.get(size) else np.ones(count) for size in map(_size, whole.unknown)
    ]
    return np.stack([drawn[path] for path in whole.unknown]), np.stack(factors)


def _size(phase: str) -> str:
    """Return the path of the transmission error at order 2 with this phase; for another phase the path of no error."""
    return phase.removesuffix("_phase")
