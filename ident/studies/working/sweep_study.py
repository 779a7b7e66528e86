"""The vibration of an arm over numbers that are varied, and over its speed."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from ident.studies.scenario import Basis
from ident.vibrate.sweep import Sweep


@dataclass(frozen=True)
class SweepStudy:
    """What was swept, of what, and what came out.

    Attributes:
        basis: the arm as it was simulated, its motion and draws.
        sweeps: one for each parameter, or a single one of two.
        rate: samples a second.
        elastic_belts: whether belts stretch.
        limit: [m] that the amplitude should not exceed; None for none.
    """

    basis: Basis
    sweeps: tuple[Sweep, ...]
    rate: float
    elastic_belts: bool = False
    limit: float | None = None

    @property
    def measure(self) -> str:
        """Of the vibration."""
        return self.sweeps[0].measure

    @property
    def is_map(self) -> bool:
        """Whether two parameters were varied together."""
        return len(self.sweeps[0].axes) > 1

    @property
    def present(self) -> Float[np.ndarray, "3"]:
        """Amplitudes of the arm as it is [m]."""
        return self.sweeps[0].present

    @property
    def draws(self) -> int:
        """Number of draws."""
        draws = self.sweeps[0].draws
        return 0 if draws is None else draws.shape[-1]
