"""Calibrates arm.toml: with the stiffnesses of Table 1 the unfolded arm gives the values computed in Table 1.

    python data/lcd_arm/calibrate.py            write the calibrated numbers into arm.toml
    python data/lcd_arm/calibrate.py --check    exit 0 if arm.toml is calibrated, 1 if not

Three numbers that the paper does not give are solved for, as many as it gives results.
"""

import sys
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
from scipy.optimize import root

from ident.arm.arm import Arm
from ident.arm.chain import at_posture
from ident.arm.mechanics import deflection, equilibrium
from ident.arm.modes import Modes, mode_labels, modes
from ident.description.file import parse_arm, update_file

ARM = Path(__file__).with_name("arm.toml")
NOMINAL = {"link2.mass": 32.0, "bracket.mass": 20.0, "fingers.mass": 12.0}
"""The numbers that are solved for [kg], where the search starts; both links are 1 m long."""
TARGET = {"vertical bending 1 [Hz]": 4.80, "lateral torsion 1 [Hz]": 4.12, "tip down [mm]": 26.3}
"""Computed values of Table 1."""
LAST_DIGIT = np.array([0.01, 0.01, 0.1])
DIGITS = 6
"""Significant digits that are kept of a calibrated number."""


@jax.jit
def _unfolded(arm: Arm) -> tuple[Modes, jax.Array]:
    chain = at_posture(arm, jnp.zeros(3))
    return modes(chain, 6), deflection(chain, equilibrium(chain))


def predict(text: str) -> dict[str, float]:
    """Return frequencies [Hz] by label and the tip's deflection [mm], unfolded under own weight."""
    shapes, moved = _unfolded(parse_arm(text))
    names = [f"{label} [Hz]" for label in mode_labels(shapes)]
    frequencies = dict(zip(names, map(float, shapes.frequency), strict=True))
    return frequencies | {"tip down [mm]": -1000 * float(moved[2, -1])}


def errors(text: str) -> np.ndarray:
    """Return prediction minus target in units of the last digit that Table 1 prints, (3,)."""
    found = predict(text)
    return np.array([found[name] - value for name, value in TARGET.items()]) / LAST_DIGIT


def is_calibrated(text: str) -> bool:
    """Tell whether the arm meets Table 1 with a margin of a thousand in the last digit."""
    return bool(np.all(np.abs(errors(text)) < 1e-3))


def calibrate(text: str) -> str:
    """Return the arm file's text with the calibrated numbers; the same text if it is calibrated already."""
    if is_calibrated(text):
        return text

    def scaled(scale: np.ndarray, digits: int) -> str:
        return revise(text, {path: value * s for (path, value), s in zip(NOMINAL.items(), scale, strict=True)}, digits)

    solution = root(lambda scale: errors(scaled(scale, 12)), np.ones(3), tol=1e-10)
    return scaled(solution.x, DIGITS)


def revise(text: str, values: dict[str, float], digits: int = DIGITS) -> str:
    """Return the arm file's text with other values of these fields, rounded to so many digits, as calibrated ones."""
    return update_file(text, {path: float(f"{v:.{digits}g}") for path, v in values.items()}, origin="calibrated")


def main(check: bool) -> int:
    """Calibrate the file, or check that it is calibrated; return the exit code."""
    text = ARM.read_text(encoding="utf-8")
    if check:
        return 0 if is_calibrated(text) else 1
    after = calibrate(text)
    ARM.write_text(after, encoding="utf-8")
    old, new = predict(text), predict(after)
    print(f"{'':24}{'before':>12}{'after':>12}{'Table 1':>10}")
    for name in new:
        print(f"{name:24}{old.get(name, float('nan')):12.5f}{new[name]:12.5f}{TARGET.get(name, ''):>10}")
    for path in NOMINAL:
        print(f"{path:24}{parse_arm(text).get(path):12.7g}{parse_arm(after).get(path):12.7g}")
    return 0 if is_calibrated(after) else 1


if __name__ == "__main__":
    jax.config.update("jax_enable_x64", True)
    sys.exit(main(check="--check" in sys.argv[1:]))
