"""Makes a synthetic fleet: robots of one design, a CSV file each; of 200 five are faulty.

Frequencies have no labels: on a faulty robot modes may be mixed as they are on none of the design.

python data/fleet/generate.py FOLDER [--robots 200] [--faulty 5] [--seed 20261123]
"""

import argparse
import json
import shutil
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import jax
import numpy as np

from ident.arm.arm import Arm, stiffness_paths
from ident.description.file import read_arm
from ident.measure import Campaign, write_campaign

HERE = Path(__file__).parent
DESIGN = HERE.parent / "lcd_arm"
sys.path.append(str(DESIGN))

from synthesize import synthesize  # noqa: E402

SPREAD = {"k_bend": 0.06, "k_tors": 0.1}
"""Standard deviation of ln(stiffness) from robot to robot: assumed."""
WORN = 0.6
"""Factor on one torsional stiffness of a faulty robot: assumed, as of a loose bolt."""
ROBOTS, FAULTY, SEED = 200, 5, 20261123


def generate(folder: str | Path, robots: int = ROBOTS, faulty: int = FAULTY, seed: int = SEED) -> dict[str, str]:
    """Write arm.toml and a campaign for each robot into a folder, and return which robots are faulty, and where.

    Args:
        folder: where they go; it is made.
        robots: number of them.
        faulty: number of those of which one torsional stiffness is low.
        seed: of stiffnesses and noise.
    """
    jax.config.update("jax_enable_x64", True)
    folder, rng = Path(folder), np.random.default_rng(seed)
    folder.mkdir(parents=True, exist_ok=True)
    shutil.copy(DESIGN / "arm.toml", folder / "arm.toml")
    design = read_arm(folder / "arm.toml").arm
    torsional = [path for path in stiffness_paths(design) if path.endswith("k_tors")]
    worn = {int(robot): str(rng.choice(torsional)) for robot in rng.choice(robots, faulty, replace=False)}
    digits = max(3, len(str(robots)))
    names = [f"robot{robot + 1:0{digits}d}" for robot in range(robots)]
    for robot, name in enumerate(names):
        arm = _one(design, rng, worn.get(robot))
        campaign = synthesize(arm, int(rng.integers(2**31)))
        campaign = Campaign(measurements=tuple(replace(m, mode=None) for m in campaign))
        comments = ("SYNTHETIC: computed with ident, not measured on any robot. Made by data/fleet/generate.py.",)
        write_campaign(campaign, folder / f"{name}.csv", header_comments=comments, relative_sigma=True)
    return {names[robot]: path for robot, path in sorted(worn.items())}


def _one(design: Arm, rng: np.random.Generator, worn: str | None) -> Arm:
    """Return a robot of this design, with stiffnesses of its own."""
    paths = stiffness_paths(design)
    normal = rng.standard_normal(len(paths))
    ratio = {path: np.exp(SPREAD[path.rpartition(".")[2]] * z) for path, z in zip(paths, normal, strict=True)}
    if worn:
        ratio[worn] *= WORN
    return design.replace({path: float(design.get(path) * factor) for path, factor in ratio.items()})


def main(words: Sequence[str] | None = None) -> None:
    """Generate a fleet, and print which robots are faulty."""
    parser = argparse.ArgumentParser(description="Make a synthetic fleet.")
    parser.add_argument("folder")
    for name, default in (("robots", ROBOTS), ("faulty", FAULTY), ("seed", SEED)):
        parser.add_argument(f"--{name}", type=int, default=default)
    options = parser.parse_args(words)
    print(json.dumps(generate(options.folder, options.robots, options.faulty, options.seed), indent=1))


if __name__ == "__main__":
    main()
