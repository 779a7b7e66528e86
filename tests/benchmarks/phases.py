"""What unknown phases of the turning masses do to the vibration: `python tests/benchmarks/phases.py [ARM] [--draws N]`.

Simulates the stroke at 10 % by the fast method with random phases: of the arm as it is, and with
joint 1 stiffer in torsion by 57 %.
"""

import argparse
from pathlib import Path

import jax
import numpy as np

from ident.arm.arm import Arm
from ident.description.file import read_arm
from ident.vibrate.motion import Motion, stroke
from ident.vibrate.simulate import simulate

ARM = Path(__file__).parents[2] / "data" / "lcd_arm" / "arm.toml"
REMEDY, LIMIT = {"joint1.k_tors": 1.57}, 5e-4
"""Factors of that remedy, and the limit [m] that it is to keep."""
TOGETHER, RATE = 50, 250.0
"""Sets of phases that are simulated at a time, and samples a second."""


def peaks(arm: Arm, motion: Motion, phases: np.ndarray) -> np.ndarray:
    """Return the largest vibration (3, sets) [m] for each set of phases (drives, sets) [rad]."""
    found = []
    for start in range(0, phases.shape[1], TOGETHER):
        some = dict(zip((f"{d.name}.phase" for d in arm.drives), phases[:, start : start + TOGETHER], strict=True))
        response = simulate(arm.replace(some), motion, rate=RATE)
        vibration = np.asarray(response.vibration)
        found.append(np.abs(vibration).max(vibration.shape.index(len(np.asarray(response.time)))))
    return np.concatenate(found, 1)


def main() -> None:
    """Print the range of the largest vibration over the phases."""
    jax.config.update("jax_enable_x64", True)
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("arm", nargs="?", type=Path, default=ARM)
    parser.add_argument("--draws", type=int, default=200)
    asked = parser.parse_args()
    arm = read_arm(asked.arm).arm
    phases = np.random.default_rng(0).uniform(0.0, 2 * np.pi, (len(arm.drives), asked.draws))
    motion = stroke(arm.stroke, percent=10)
    remedied = arm.replace({path: factor * arm.get(path) for path, factor in REMEDY.items()})
    for name, one in (("as it is", arm), ("with the remedy", remedied)):
        own, over = peaks(one, motion, phases[:, :1] * 0), peaks(one, motion, phases)
        kept = (over.max(0) < LIMIT).mean()
        for d, direction in enumerate("xyz"):
            span = f"{1e3 * over[d].min():.4f} to {1e3 * over[d].max():.4f}"
            print(f"{name:16s} {direction}: {1e3 * own[d, 0]:.4f} mm, over {asked.draws} random phases {span} mm")
        print(f"{name:16s} {1e3 * LIMIT:g} mm are kept by {kept:.1%} of the phases")


if __name__ == "__main__":
    main()
