"""Makes campaign.csv: what a campaign on the arm of arm.toml could have measured, noise included; and after_a_year.csv.

python data/lcd_arm/synthesize.py
"""

import sys
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np

from ident.arm.arm import Arm
from ident.arm.chain import at_posture
from ident.arm.mechanics import deflection, equilibrium
from ident.arm.modes import Modes, mode_labels, modes
from ident.description.file import read_arm
from ident.measure import KINDS, Campaign, Measurement, to_si, write_campaign

HERE = Path(__file__).parent
ALPHA = (0.0, 30.0, 60.0, 80.0)
"""Postures q = alpha (1, -2, 1) [deg], which move the hand straight where links are equal."""
FREQUENCIES = 4
SIGMA = {"frequency": 0.005, "deflection": 0.02}
"""Standard deviation as a fraction of the value."""
DECIMALS = {"frequency": 3, "deflection": 2}
"""Decimals that are written [Hz, mm]."""
SEED, LATER = 20261121, 20261123
WORN = {"joint2.k_tors": 0.88}
"""What has changed in the later campaign: assumed, for an example of `ident compare`."""
COMMENTS = (
    "SYNTHETIC: computed with ident, not measured on any robot.",
    "Arm: arm.toml, so the joint stiffnesses of the paper's Table 1{but}. Made by synthesize.py.",
    "Postures q = alpha (1, -2, 1), alpha = 0, 30, 60, 80 deg: the lowest four natural frequencies, labelled as",
    "two accelerometers would tell them, and the tip's deflection downwards under the arm's own weight.",
    "Noise: normal, 0.5 % of each frequency and 2 % of each deflection, numpy default_rng({seed}).",
)


def synthesize(arm: Arm, seed: int = SEED) -> Campaign:
    """Return the campaign that the arm gives with this program's noise."""
    postures = [tuple(to_si(alpha * turn + 0.0, "deg", "angle") for turn in (1.0, -2.0, 1.0)) for alpha in ALPHA]
    noise = np.random.default_rng(seed).standard_normal((len(ALPHA), FREQUENCIES + 1))
    rows = []
    for posture, z in zip(postures, noise.tolist(), strict=True):
        shapes, down = _exact(arm, jnp.asarray(posture))
        for label, f, part in zip(mode_labels(shapes), shapes.frequency.tolist(), z[:-1], strict=True):
            rows.append(_measured("frequency", "Hz", posture, f, part, mode=str(label)))
        rows.append(_measured("deflection", "mm", posture, 1000 * float(down), z[-1], point="tip"))
    return Campaign(measurements=tuple(rows))


@jax.jit
def _exact(arm: Arm, posture: jax.Array) -> tuple[Modes, jax.Array]:
    """Return the lowest modes and the downward deflection [m]."""
    chain = at_posture(arm, posture)
    return modes(chain, FREQUENCIES), -deflection(chain, equilibrium(chain))[2, -1]


def _measured(kind: str, unit: str, posture: tuple[float, ...], true: float, z: float, **what: str) -> Measurement:
    """Return a true value, in the unit, as it is read off with noise."""
    value = to_si(round(true * (1 + SIGMA[kind] * z), DECIMALS[kind]), unit, KINDS[kind])
    return Measurement(kind=kind, posture=posture, value=value, sigma=SIGMA[kind] * value, **what)


def main(folder: Path = HERE) -> None:
    """Write both campaigns."""
    arm = read_arm(HERE / "arm.toml").arm
    worn = arm.replace({path: factor * arm.get(path) for path, factor in WORN.items()})
    but = "".join(f", but {path} x {factor:g}" for path, factor in WORN.items())
    for name, each, seed, words in (("campaign.csv", arm, SEED, ""), ("after_a_year.csv", worn, LATER, but)):
        comments = [line.format(but=words, seed=seed) for line in COMMENTS]
        write_campaign(synthesize(each, seed), folder / name, header_comments=comments, relative_sigma=True)


if __name__ == "__main__":
    jax.config.update("jax_enable_x64", True)
    sys.exit(main())
