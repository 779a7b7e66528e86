"""Fleets of which parts are killed over and over: `python tests/benchmarks/fleet_killed.py [--robots 50] [--kills 20]`.

Workers, and the whole command, each at so many random moments of a fleet of its own; the files must be those of one
process that nobody disturbs. Exit status 1 unless all are, and each run ends as it should.
"""

import argparse
import random
import runpy
import shutil
import sys
import tempfile
import time
from pathlib import Path

TESTS = Path(__file__).parents[1]
sys.path.append(str(TESTS / "support"))

from killing import Disturbed, Kills, Run, files

FAILED = 3
"""Exit status where a robot failed."""


def disturbed(kind: str, robots: Path, out: Path, kills: int, seed: int) -> tuple[Kills, int]:
    """Compute a fleet while workers or clients are killed, in as many runs as that takes."""
    total, fleet = Kills(), Disturbed(robots, out, random.Random(seed))
    while total.killed < kills:
        some = getattr(fleet, f"kill_{kind}")(kills - total.killed)
        total.killed += some.killed
        total.exits += some.exits
        if total.killed < kills:  # it was done before: once more, from the beginning
            shutil.rmtree(out)
    return total, fleet.leave_alone()


def main() -> int:
    """Print what became of each, and return the exit status."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--robots", type=int, default=50)
    parser.add_argument("--kills", type=int, default=20)
    parser.add_argument("--seed", type=int, default=9, help="of the moments")
    options = parser.parse_args()
    generate = runpy.run_path(str(TESTS.parent / "data" / "fleet" / "generate.py"))["generate"]
    with tempfile.TemporaryDirectory() as folder:
        robots = Path(folder) / "robots"
        generate(robots, options.robots, 1, seed=1)
        (robots / "broken.csv").write_text("kind,value\n")
        alone = Run(robots, Path(folder) / "alone")
        status = alone.end()
        print(f"undisturbed: exit status {status}", flush=True)
        wrong = [] if status == FAILED else [f"undisturbed: exit status {status}"]
        for kind in ("workers", "clients"):
            before, out = time.monotonic(), Path(folder) / kind
            total, last = disturbed(kind, robots, out, options.kills, options.seed)
            same = files(out) == files(Path(folder) / "alone")
            statuses = sorted({*total.exits, last})
            bits = "the same to the bit" if same else "NOT the same"
            took = time.monotonic() - before
            print(f"{kind}: {total.killed} killed; exit statuses {statuses}; {bits} ({took:.0f} s)", flush=True)
            wrong += [] if same and statuses == [FAILED] else [kind]
    print("\n".join(["WRONG", *wrong]) if wrong else "all as it should be")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
