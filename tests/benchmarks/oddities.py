"""How often `ident show` sees a mistake in an arm file, and how often it warns of a sound arm.

python tests/benchmarks/oddities.py
"""

import argparse
import sys
from pathlib import Path

import jax
import numpy as np

HERE = Path(__file__).parent
sys.path.append(str(HERE.parent / "support"))

from mistakes import KINDS, found, sound

from ident.arm.plausibility import oddities
from ident.description.file import read_arm

TEMPLATES = HERE.parents[1] / "ident" / "description" / "templates"
ARMS = [HERE.parents[1] / "data" / "lcd_arm" / "arm.toml", TEMPLATES / "scara.toml", TEMPLATES / "six-axis.toml"]
SOUND = 300


def main() -> None:
    """Print a row for each kind of mistake, and the rate of false warnings."""
    argparse.ArgumentParser(description=__doc__).parse_args()
    arms = [read_arm(path) for path in ARMS]
    print(f"{'mistake':44s} {'made':>6s} {'seen':>6s} {'named':>6s}")
    for kind, (fields, factor) in KINDS.items():
        made, seen, named = np.sum([found(each.arm, each.extents, fields, factor) for each in arms], 0)
        print(f"{kind:44s} {made:6d} {seen / made:6.0%} {named / made:6.0%}")
    rng = np.random.default_rng(4)
    for path, each in zip(ARMS, arms, strict=True):
        warned = [oddities(sound(each.arm, rng), each.extents) for _ in range(SOUND)]
        print(f"sound arms near {path.stem}: {sum(map(bool, warned))} of {SOUND} warned of")


if __name__ == "__main__":
    jax.config.update("jax_enable_x64", True)
    main()
