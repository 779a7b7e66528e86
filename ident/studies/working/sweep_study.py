"""The vibration of an arm over varied numbers, and over its speed."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from ident.studies.scenario import Basis
from ident.vibrate.sweep import Sweep


@dataclass(frozen=True)
class SweepStudy:
    """What was varied, on which arm, and the amplitudes.

    Attributes:
        basis: the simulated arm, its motion and draws.
        sweeps: one for each parameter, or a single one of two.
        rate: sampling rate [Hz].
        elastic_belts: whether belts stretch.
        limit: [m] of the amplitude; None for none.
    """

    basis: Basis
    sweeps: tuple[Sweep, ...]
    rate: float
    elastic_belts: bool = False
    limit: float | None = None

    @property
    def measure(self) -> str:
        """Measure of the vibration."""
        return self.sweeps[0].measure

    @property
    def is_map(self) -> bool:
        """Whether two parameters were varied together."""
        return len(self.sweeps[0].axes) > 1

    @property
    def present(self) -> Float[np.ndarray, "3"]:
        """Amplitudes of the present arm [m]."""
        return self.sweeps[0].present

    @property
    def draws(self) -> int:
        """Number of draws."""
        draws = self.sweeps[0].draws
        return 0 if draws is None else draws.shape[-1]
