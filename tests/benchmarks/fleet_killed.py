"""Fleets of which parts are killed over and over: `python tests/benchmarks/fleet_killed.py [--robots 50] [--kills 20]`.

Workers, schedulers and clients on the loopback, each at so many random moments of a fleet of its own; the files must be
those of two processes that nobody disturbs.
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

from clusters import Cluster, Disturbed, Kills, Run
from results import TIME


def files(folder: Path) -> dict[Path, str]:
    """Return the contents of all files by name, but for the time that a result was made."""
    kept = [path for path in folder.rglob("*") if path.is_file() and not path.name.startswith(".")]
    kept = [path for path in kept if not path.parent.name.startswith(".")]
    return {path.relative_to(folder): TIME.sub("", path.read_text()) for path in kept}


def disturbed(kind: str, robots: Path, out: Path, kills: int, seed: int) -> tuple[Kills, int]:
    """Compute a fleet while workers, schedulers or clients are killed, in as many runs as that takes."""
    total = Kills()
    with Cluster(out.with_name(f"{kind}-cluster")) as cluster:
        fleet = Disturbed(cluster, robots, out, random.Random(seed))
        while total.killed < kills:
            times = kills - total.killed
            some = getattr(fleet, f"kill_{kind}")(times)
            total.killed += some.killed
            total.exits += some.exits
            total.said_after = max(total.said_after, some.said_after)
            if total.killed < kills:  # it was done before: once more, from the beginning
                shutil.rmtree(out)
        return total, fleet.leave_alone()


def main() -> None:
    """Print what became of each."""
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
        alone = Run(robots, Path(folder) / "alone", "--workers=2")
        print(f"undisturbed: exit status {alone.end()}", flush=True)
        for kind in ("workers", "schedulers", "clients"):
            before, out = time.monotonic(), Path(folder) / kind
            total, last = disturbed(kind, robots, out, options.kills, options.seed)
            same = "the same to the bit" if files(out) == files(Path(folder) / "alone") else "NOT the same"
            said = f", the client's end at most {total.said_after:.1f} s later" if kind == "schedulers" else ""
            statuses = f"exit statuses {sorted(set(total.exits))}, of the last {last}"
            took = f"{time.monotonic() - before:.0f} s"
            print(f"{kind}: {total.killed} killed{said}; {statuses}; {same} ({took})", flush=True)


if __name__ == "__main__":
    main()
