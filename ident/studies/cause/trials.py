"""Masses that were added to drives for runs: how they act, whether as stated, and the words for it."""

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Complex, Float
from scipy.stats import chi2

from ident.report.report import Section, by_head

CONTRADICTED = 0.01
"""Probability below which a trial mass does not act as stated, or trial masses contradict each other; assumed."""
NEAR = 0.05
"""Deviation of a trial mass's factor that counts as none: the correction would leave this share; assumed."""
TOLD_WITHIN = 0.25
"""Half width of a trial mass's 95 % region above which acting as stated verifies nothing: this share of the imbalance
could remain; assumed."""


@dataclass(frozen=True)
class Tried:
    """Effect of a mass that was added to a drive for a run: a trial mass, or a mounted correction.

    Attributes:
        run: its name.
        drive: name of the drive.
        stated: [kg m] its imbalance in the table of runs.
        factor: of its effect: 1 if table and model are right.
        draws: (D,) of the factor.
    """

    run: str
    drive: str
    stated: complex
    factor: complex
    draws: Complex[np.ndarray, "D"]

    @property
    def sd(self) -> tuple[float, float]:
        """Standard deviation of the factor's magnitude [-], and of its angle [rad]."""
        off = self.draws / self.factor
        return float(abs(self.factor) * off.real.std()), float(off.imag.std())

    @property
    def chance(self) -> float:
        """Probability of such a deviation of the factor from 1 by chance."""
        off = np.array([self.factor.real - 1, self.factor.imag])
        return float(chi2.sf(off @ np.linalg.solve(self._covariance, off), 2))

    @cached_property
    def _covariance(self) -> Float[np.ndarray, "2 2"]:
        """Covariance of the factor's real and imaginary part; regular for two draws, too."""
        return np.cov(self.draws.real, self.draws.imag, bias=True) + 1e-12 * np.eye(2)

    @property
    def spread(self) -> float:
        """Largest standard deviation of the factor over all directions in the complex plane."""
        return float(np.sqrt(np.linalg.eigvalsh(self._covariance)[-1]))

    @property
    def too_light(self) -> float:
        """Factor by which it is too light to show within `TOLD_WITHIN` how it acts: the error falls with its mass."""
        return self.spread * float(np.sqrt(chi2.isf(0.05, 2))) / TOLD_WITHIN

    @property
    def told(self) -> bool:
        """Whether it is informative: it does not act as stated, or it does within `TOLD_WITHIN`."""
        return self.chance <= CONTRADICTED or self.too_light < 1

    @property
    def right(self) -> bool:
        """Whether it demonstrably acts as stated."""
        return self.told and (abs(self.factor - 1) < NEAR or self.chance > CONTRADICTED)


# -------- Words


def acting(tried: Tried) -> str:
    """Say how a mass acts: `as 1.02 of it, 60 deg further`."""
    return f"as {abs(tried.factor):.2f} of it, {turned(tried.factor)}"


def turned(factor: complex) -> str:
    """Say by which angle a factor turns a mass: `60 deg further`."""
    turn = float(np.degrees(np.angle(factor)))
    return f"{abs(turn):.0f} deg {'further' if turn > 0 else 'back'}"


def tried_section(every: Iterable[Tried]) -> Section:
    """Return the effects of masses that were added for runs."""
    rows = []
    for each in every:
        at, turn, turn_sd = (float(np.degrees(x)) for x in (np.angle(each.stated), np.angle(each.factor), each.sd[1]))
        acts = (abs(each.factor), each.sd[0], turn, turn_sd, each.chance)
        rows.append((each.run, each.drive, 1e6 * abs(each.stated), at, *acts))
    of_mass = "stated [g mm]|.0f", "at [deg]|.0f", "acts as|.3f", "error|.3f", "turned [deg]|+.1f", "error [deg]|.1f"
    return Section("Masses that were added for runs", (by_head(("Run", "drive", *of_mass, "p that 1|.2g"), rows),))
