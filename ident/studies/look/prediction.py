"""Modes and deflection of an arm at a posture, with their uncertainty from a posterior."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float

from ident.arm.modes import follow
from ident.errors import ModelError
from ident.identify.compliance import TOGETHER, ToolCompliance
from ident.identify.modal_analysis import ModalAnalysis, modal_solution
from ident.identify.receptance import quantiles


@dataclass(frozen=True)
class Prediction:
    """Modes and static deflection at a posture, also for the draws of a posterior.

    A draw's modes are matched to the arm's by shape, with the mass-weighted MAC, not by order.

    Attributes:
        analysis: of the arm itself.
        frequency: (m, D) [Hz] by mode of the arm and draw; None without draws.
        damping_ratio: (m, D) [-]
        deflection: (3, D) [m] by point name.
        collapsed: number of draws without a stable equilibrium; they are left out.
        tool: static compliance at a point; None where it was not asked for.
    """

    analysis: ModalAnalysis
    frequency: Float[np.ndarray, "m D"] | None = None
    damping_ratio: Float[np.ndarray, "m D"] | None = None
    deflection: Mapping[str, Float[np.ndarray, "3 D"]] | None = None
    collapsed: int = 0
    tool: ToolCompliance | None = None

    @cached_property
    def frequency_band(self) -> Float[np.ndarray, "2 m"]:
        """5 and 95 % quantiles of the natural frequencies [Hz]; NaN without draws."""
        return quantiles(self.frequency, (len(self.analysis.labels),))

    @cached_property
    def damping_band(self) -> Float[np.ndarray, "2 m"]:
        """5 and 95 % quantiles of the damping ratios [-]; NaN without draws."""
        return quantiles(self.damping_ratio, (len(self.analysis.labels),))

    @cached_property
    def deflection_band(self) -> dict[str, Float[np.ndarray, "2 3"]]:
        """5 and 95 % quantiles of the static deflection [m] by point name; NaN without draws."""
        draws = self.deflection or {}
        return {name: quantiles(draws.get(name), (3,)) for name in self.analysis.deflection}


def predict_draws(analysis: ModalAnalysis, draws: Mapping[str, Float[np.ndarray, "D"]]) -> Prediction:
    """Return modes and deflection of an arm at a posture, also for draws of some of its numbers.

    Args:
        analysis: of the arm itself, with which the modes of the draws are compared.
        draws: numbers of the arm [SI], by path.

    Raises:
        ModelError: no draw has a stable equilibrium.
    """
    count = len(next(iter(draws.values())))
    own = modal_solution(analysis.arm, analysis.posture, analysis.load, analysis.drives)
    mass, reference = np.asarray(own.M), np.asarray(own.modes.shape)[:, : len(analysis.labels)]
    parts = []
    for start in range(0, count, TOGETHER):
        missing = max(0, start + TOGETHER - count)
        some = {path: np.pad(x[start : start + TOGETHER], (0, missing), mode="edge") for path, x in draws.items()}
        solution = modal_solution(analysis.arm.replace(some), analysis.posture, analysis.load, analysis.drives)
        frequency = np.asarray(solution.modes.frequency)
        stands = np.isfinite(frequency).all(0) & (np.arange(TOGETHER) < count - start)
        solved = solution.modes.shape, solution.ratio, solution.moved
        shape, ratio, moved = (np.asarray(x)[..., stands] for x in solved)
        place = follow(reference, mass, shape[:, :, None])[0][:, 0]
        parts.append([*(np.take_along_axis(x, place, 0) for x in (frequency[:, stands], ratio)), moved])
    frequency, ratio, moved = (np.concatenate(part, -1) for part in zip(*parts, strict=True))
    if not frequency.size:
        raise ModelError(f"{analysis.arm.name} has no stable equilibrium there with any draw of the posterior")
    deflection = {name: moved[:, i] for i, name in enumerate(analysis.deflection)}
    return Prediction(analysis, frequency, ratio, deflection, count - frequency.shape[1])
