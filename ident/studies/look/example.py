"""An example campaign of an arm: simulated measurements."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from ident.arm.arm import Arm, stiffness_paths
from ident.identify.modal_analysis import modal_analysis
from ident.measure import Campaign, Load, Measurement
from ident.studies.look.arm_view import EXAMPLE_MODES, EXAMPLE_POSTURES, SIGMA_DIAL, SIGMA_READ, home
from ident.units import to_si

FACTORS = (1.25, 0.8, 1.15, 0.85, 1.1, 0.9)
"""Ratios of the true stiffnesses to those of the arm file: bending of each joint in turn, then torsion."""
SIGMA = 0.005
"""Standard deviation of a frequency as a fraction of its value."""
SHARE = 0.1
"""Test mass as a share of the arm's mass, in whole kilograms."""
SEED = 1
WIDEST = math.radians(90)
"""Largest joint angle of the campaign."""


@dataclass(frozen=True)
class Example:
    """A simulated campaign, and the truth behind it.

    Attributes:
        campaign: the measurements with noise.
        truth: [N m/rad] the true stiffnesses of the simulation, by path.
    """

    campaign: Campaign
    truth: Mapping[str, float]

    @property
    def comments(self) -> tuple[str, ...]:
        """Comment lines of the file."""
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

    In each of some postures: the lowest natural frequencies, named as two accelerometers would identify them where the
    name is clear, and the deflection of the end point under a test mass.
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
        bare, loaded = (modal_analysis(arm, posture, each, EXAMPLE_MODES) for each in (Load(), load))
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
    from scipy.stats import qmc  # slow to import, and seldom needed

    yield home(arm)
    bounds = [(max(low, -WIDEST), min(high, WIDEST)) for low, high in (joint.limits for joint in arm.driven)]
    low, high = np.degrees(bounds).T
    for share in qmc.Halton(len(bounds), scramble=False).random(EXAMPLE_POSTURES)[1:]:
        yield tuple(to_si(float(angle), "deg", "angle") for angle in np.round(low + share * (high - low)))
