"""What an arm does at a posture with draws of its numbers, and an example campaign that could be measured on it."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float

from ident.arm.arm import Arm, stiffness_paths
from ident.arm.modes import follow
from ident.assess.show import home
from ident.errors import ModelError
from ident.identify.modal_analysis import ModalAnalysis, modal_analysis, modal_solution
from ident.measure import Campaign, Load, Measurement
from ident.units import to_si

# -------- Example
# A campaign as it could have been measured on an arm, simulated from stated stiffnesses: an example to begin with.

POSTURES, MODES = 6, 4
"""Postures of the campaign, and frequencies in each."""
FACTORS = (1.25, 0.8, 1.15, 0.85, 1.1, 0.9)
"""What the stated stiffnesses are, over those of the arm's file: bending of each joint in turn, then torsion."""
SIGMA = 0.005
"""Standard deviation of a frequency as a fraction of its value."""
SIGMA_DIAL, SIGMA_READ = 0.001, 0.01
"""Standard deviation of a dial gauge: in mm, or as a fraction of what it reads, whichever is more."""
SHARE = 0.1
"""Test mass as a share of the arm's mass, in whole kilograms."""
SEED = 1
WIDEST = math.radians(90)
"""Angle of a pin up to which the arm is measured."""


@dataclass(frozen=True)
class Example:
    """A simulated campaign, and the truth behind it.

    Attributes:
        campaign: what was measured, noise included.
        truth: [N m/rad] the stiffnesses that it was simulated with, by path.
    """

    campaign: Campaign
    truth: Mapping[str, float]

    @property
    def comments(self) -> tuple[str, ...]:
        """What the file says of itself."""
        stated = [f"{path} = {value:g}" for path, value in self.truth.items()]
        return (
            "EXAMPLE NUMBERS, simulated by ident and not measured on any robot. Replace the rows by your own.",
            "",
            "One row a number. q1, q2, ...: angles of the pins. A frequency has the name of its mode, or none where",
            "one can't tell; a deflection has its point, its direction and what hangs on the arm. Then value, unit and",
            "standard deviation. What to measure is said by `ident plan campaign.csv`, what it tells by `ident check`.",
            "",
            "Simulated with these stiffnesses [N m/rad], which are not those of arm.toml; a fit should find them:",
            *(f"    {', '.join(stated[i : i + 3])}" for i in range(0, len(stated), 3)),
            f"Noise: normal, {100 * SIGMA:g} % of a frequency; {SIGMA_DIAL:g} mm of a deflection, "
            f"{100 * SIGMA_READ:g} % of one above {SIGMA_DIAL / SIGMA_READ:g} mm; numpy default_rng({SEED}).",
        )


def example(arm: Arm) -> Example:
    """Return a campaign on an arm whose stiffnesses differ from those of its file by `FACTORS`.

    In each of some postures: the lowest natural frequencies, named as two accelerometers would tell them where the name
    is clear, and by how much a test mass lowers the end point.
    """
    paths = stiffness_paths(arm)
    factors = [FACTORS[i % len(FACTORS)] for i in range(len(paths))]
    truth = {path: float(f"{factor * float(arm.get(path)):.3g}") for path, factor in zip(paths, factors, strict=True)}
    return Example(Campaign(measurements=tuple(_measured(arm.replace(truth)))), truth)


def _measured(arm: Arm) -> Iterator[Measurement]:
    rng, point = np.random.default_rng(SEED), arm.points[-1].name
    test_mass = max(1, round(SHARE * sum(float(body.mass) for body in arm.bodies)))
    load = Load.parse(f"{test_mass} kg @ {point}")
    for posture in _postures(arm):
        bare, loaded = (modal_analysis(arm, posture, each, MODES) for each in (Load(), load))
        for label, f, unclear in zip(bare.labels, bare.modes.frequency.tolist(), bare.ambiguous, strict=True):
            value = round(f * (1 + SIGMA * rng.standard_normal()), 3)
            mode = None if unclear else str(label)
            sigma = round(SIGMA * value, 3)
            yield Measurement(kind="frequency", posture=posture, value=value, sigma=sigma, mode=mode)
        down = 1e3 * float(bare.deflection[point][2] - loaded.deflection[point][2])
        sigma = max(SIGMA_DIAL, SIGMA_READ * down)
        value, sigma = (to_si(round(each, 4), "mm", "length") for each in (down + sigma * rng.standard_normal(), sigma))
        kind = "deflection_difference"
        yield Measurement(kind=kind, posture=posture, value=value, sigma=sigma, point=point, load=load)


def _postures(arm: Arm) -> Iterator[tuple[float, ...]]:
    """Yield `home`, and postures spread evenly between the limits (Halton, 1960), in whole degrees."""
    from scipy.stats import qmc  # long to import, and seldom needed

    yield home(arm)
    bounds = [(max(low, -WIDEST), min(high, WIDEST)) for low, high in (joint.limits for joint in arm.driven)]
    low, high = np.degrees(bounds).T
    for share in qmc.Halton(len(bounds), scramble=False).random(POSTURES)[1:]:
        yield tuple(to_si(float(angle), "deg", "angle") for angle in np.round(low + share * (high - low)))


# -------- Prediction
# What an arm does at a posture, and how far a posterior leaves that open.

TOGETHER = 64
"""Draws that are solved at a time: always as many, for one compiled program."""
LEVELS = (0.05, 0.95)
"""Quantiles of a band."""


@dataclass(frozen=True)
class Prediction:
    """Modes and static deflection at a posture, and the same by the draws of a posterior.

    A draw's modes are those whose shapes are most like the arm's own, by mass-weighted MAC, not those of their order.

    Attributes:
        analysis: of the arm itself.
        frequency: (m, D) [Hz] by mode of the arm and draw; None without draws.
        damping_ratio: (m, D) [-]
        deflection: (3, D) [m] by point name.
        collapsed: number of draws without a stable equilibrium, which are left out.
    """

    analysis: ModalAnalysis
    frequency: Float[np.ndarray, "m D"] | None = None
    damping_ratio: Float[np.ndarray, "m D"] | None = None
    deflection: Mapping[str, Float[np.ndarray, "3 D"]] | None = None
    collapsed: int = 0

    @cached_property
    def frequency_band(self) -> Float[np.ndarray, "2 m"]:
        """5 and 95 % quantiles of the natural frequencies [Hz]; NaN without draws."""
        return _band(self.frequency, len(self.analysis.labels))

    @cached_property
    def damping_band(self) -> Float[np.ndarray, "2 m"]:
        """5 and 95 % quantiles of the damping ratios [-]; NaN without draws."""
        return _band(self.damping_ratio, len(self.analysis.labels))

    @cached_property
    def deflection_band(self) -> dict[str, Float[np.ndarray, "2 3"]]:
        """5 and 95 % quantiles of the static deflection [m] by point name; NaN without draws."""
        draws = self.deflection or {}
        return {name: _band(draws.get(name), 3) for name in self.analysis.deflection}


def predict_draws(analysis: ModalAnalysis, draws: Mapping[str, Float[np.ndarray, "D"]]) -> Prediction:
    """Return what an arm does at a posture, by draws of some of its numbers as well.

    Args:
        analysis: of the arm itself, with which the modes of the draws are compared.
        draws: numbers of the arm [SI], by path.

    Raises:
        ModelError: there is no stable equilibrium with any draw.
    """
    count = len(next(iter(draws.values())))
    own = modal_solution(analysis.arm, analysis.posture, analysis.load, analysis.drives)
    mass, reference = np.asarray(own.M), np.asarray(own.modes.shape)[:, : len(analysis.labels)]
    parts = []
    for start in range(0, count, TOGETHER):
        some = {path: _padded(values[start : start + TOGETHER]) for path, values in draws.items()}
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


def _padded(values: Float[np.ndarray, "n"]) -> Float[np.ndarray, "TOGETHER"]:
    return np.pad(values, (0, TOGETHER - len(values)), mode="edge")


def _band(draws: np.ndarray | None, rows: int) -> Float[np.ndarray, "2 rows"]:
    if draws is None:
        return np.full((2, rows), np.nan)
    return np.quantile(draws, LEVELS, axis=1)
