"""Makes campaign.csv: what a campaign on a six-axis arm could have measured, at rest and by hammer, noise included.

python data/six_axis/synthesize.py
"""

import sys
from collections.abc import Iterator
from pathlib import Path

import jax
import numpy as np

from ident.arm.arm import Arm
from ident.description.file import read_arm
from ident.identify.modal_analysis import modal_analysis
from ident.measure import Campaign, Load, Measurement, to_si, write_campaign

HERE = Path(__file__).parent
BENDING = (2.6e4, 1.1e4, 1.5e4, 4.1e3, 5.2e3, 2.5e3)
TORSION = (4.8e3, 7.5e3, 4.1e3, 2.5e3, 1.5e3, 1.9e3)
TRUTH = {f"joint_{n}.k_bend": k for n, k in enumerate(BENDING, 1)}
TRUTH |= {f"joint_{n}.k_tors": k for n, k in enumerate(TORSION, 1)}
"""Stiffnesses [N m/rad] of the arm that is measured: assumed, others than the first guess in arm.joints.toml."""
STATED = [f"{path} = {value:g}" for path, value in TRUTH.items()]
POSTURES = (
    (0, 180, 180, 0, 0, 0),
    (0, 240, 120, 0, 90, 45),
    (30, 210, 90, 60, 180, 0),
    (-45, 150, 240, 90, 120, -60),
    (60, 260, 200, -90, 60, 120),
    (90, 120, 100, 45, 240, 90),
    (-90, 200, 280, 120, 200, 30),
    (15, 280, 260, -45, 150, -120),
)
"""Joint angles [deg]."""
FREQUENCIES = 3
LOADS = ("15 N -z @ tip", "15 N x @ tip", "15 N -z @ bar", "10 N y @ bar")
DIRECTIONS = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}
SIGMA_FREQUENCY, SIGMA_DEFLECTION = 0.005, 0.03
"""Standard deviations: a fraction of a frequency, and mm of a deflection, as of a laser tracker."""
SEED = 20261124
COMMENTS = (
    "SYNTHETIC: computed with ident, not measured on any robot. Made by synthesize.py.",
    "Arm: arm.xml (Kinova Jaco 2), with stiffnesses [N m/rad] that are assumed, and not those of arm.joints.toml:",
    *(f"    {', '.join(STATED[n : n + 3])}" for n in range(0, 12, 3)),
    "In each of eight postures: the lowest three natural frequencies, without labels, and how far a force moves the",
    "tip, or the end of a bar across the hand, in x, y and z, against no force: of a tracker's frame only directions",
    "count.",
    f"Noise: normal, {100 * SIGMA_FREQUENCY:g} % of a frequency, {SIGMA_DEFLECTION:g} mm of a deflection;",
    f"numpy default_rng({SEED}).",
)


def synthesize(arm: Arm, seed: int = SEED) -> Campaign:
    """Return the campaign that an arm gives with this program's noise."""
    return Campaign(measurements=tuple(_rows(arm, np.random.default_rng(seed))))


def _rows(arm: Arm, rng: np.random.Generator) -> Iterator[Measurement]:
    for degrees in POSTURES:
        posture = tuple(to_si(float(angle), "deg", "angle") for angle in degrees)
        bare = modal_analysis(arm, posture, Load(), FREQUENCIES)
        for f in bare.modes.frequency.tolist():
            value = round(f * (1 + SIGMA_FREQUENCY * rng.standard_normal()), 3)
            yield Measurement(kind="frequency", posture=posture, value=value, sigma=round(SIGMA_FREQUENCY * value, 3))
        for text in LOADS:
            load, point = Load.parse(text), text.split("@ ")[1]
            moved = 1e3 * (modal_analysis(arm, posture, load, FREQUENCIES).deflection[point] - bare.deflection[point])
            for direction, true in zip(DIRECTIONS.values(), moved.tolist(), strict=True):
                value = to_si(round(true + SIGMA_DEFLECTION * rng.standard_normal(), 3), "mm", "length")
                sigma, what = to_si(SIGMA_DEFLECTION, "mm", "length"), {"point": point, "load": load}
                kind = "deflection_difference"
                yield Measurement(kind=kind, posture=posture, value=value, sigma=sigma, direction=direction, **what)


def main(folder: Path = HERE) -> None:
    """Write the campaign."""
    arm = read_arm(HERE / "arm.xml").arm.replace(TRUTH)
    write_campaign(synthesize(arm), folder / "campaign.csv", header_comments=COMMENTS)


if __name__ == "__main__":
    jax.config.update("jax_enable_x64", True)
    sys.exit(main())
