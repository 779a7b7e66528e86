"""Thousands of fits and predictions in one process: `python tests/benchmarks/stress.py [--rounds 3000] [--file FILE]`.

Campaigns of changing size on arms of changing numbers; memory and time of each hundred must not grow.
"""

import argparse
import resource
import time
from pathlib import Path

import jax

jax.config.update("jax_enable_x64", True)

import numpy as np
from timing import commit, machine

import ident

DATA = Path(__file__).parents[2] / "data" / "lcd_arm"


def now_held() -> float:
    """Return the memory of this process [MB]."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * resource.getpagesize() / 2**20


def main() -> None:
    """Print memory, CPU time and open files after each tenth of the rounds."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=3000)
    parser.add_argument("--file", type=Path, help="where the lines are written, too")
    options = parser.parse_args()
    file, shipped = ident.read_arm(DATA / "arm.toml"), ident.read_campaign(DATA / "campaign.csv")
    paths = [path for path in file.arm.paths() if path.endswith(("k_bend", "k_tors"))]
    rng, lines = np.random.default_rng(0), [f"{machine()}, commit {commit()}"]
    fit_options = ident.FitOptions(starts=1)
    each, before, doubted = max(options.rounds // 10, 1), time.process_time(), 0
    for number in range(1, options.rounds + 1):
        values = {path: float(file.arm.get(path)) * np.exp(0.05 * rng.standard_normal()) for path in paths}
        arm = file.arm.replace(values)
        rows = [m for m in shipped.measurements if rng.uniform() < 0.9]
        doubted += bool(ident.fit(arm, ident.Campaign(measurements=tuple(rows)), fit_options).doubts)
        ident.predict(arm)
        if number % each == 0:
            took, before = time.process_time() - before, time.process_time()
            opened = len(list(Path("/proc/self/fd").iterdir()))
            lines.append(
                f"{number}: {now_held():.0f} MB, {1e3 * took / each:.0f} ms of CPU a round, {opened} open files, "
                f"{doubted} fits in doubt"
            )
            print(lines[-1], flush=True)
            if options.file:
                options.file.write_text("\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
