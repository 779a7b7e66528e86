"""Fleets of which parts are killed over and over: `python tests/benchmarks/fleet_killed.py [--robots 50] [--kills 20]`.

Workers, schedulers and clients on the loopback, each at so many random moments of a fleet of its own; the files must be
those of two processes that nobody disturbs. Exit status 1 unless all are, and each run ends as it should.
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

FAILED, LOST = 3, 1
"""Exit statuses where a robot failed, and where the scheduler was lost."""
EXITS = {"workers": {FAILED}, "schedulers": {LOST, FAILED}, "clients": {FAILED}}
"""What runs may end with that were not killed themselves: some are done before anything is killed."""
SAID = 30.0
"""Time [s] within which a lost scheduler is said."""


def files(folder: Path) -> dict[Path, str]:
    """Return the contents of all files by name, but for the time that a result was made."""
    kept = [path for path in folder.rglob("*") if path.is_file() and not path.name.startswith(".")]
    kept = [path for path in kept if not path.parent.name.startswith(".")]
    return {path.relative_to(folder): TIME.sub("", path.read_text("latin-1")) for path in kept}


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


def wrong(kind: str, total: Kills, last: int, same: bool, kills: int) -> list[str]:
    """Return what is not as it should be."""
    lost = total.exits.count(LOST)
    checks = {
        f"{total.killed} of {kills} were killed": total.killed == kills,
        "files that are NOT the same": same,
        f"exit statuses {sorted(set(total.exits))}": set(total.exits) <= EXITS[kind],
        f"{lost} lost schedulers were said": kind != "schedulers" or lost == kills,
        f"said after {total.said_after:.1f} s": total.said_after < SAID,
        f"the last run ended with {last}": last == FAILED,
    }
    return [words for words, holds in checks.items() if not holds]


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
        alone = Run(robots, Path(folder) / "alone", "--workers=2")
        status = alone.end()
        print(f"undisturbed: exit status {status}", flush=True)
        found = [] if status == FAILED else [f"undisturbed: exit status {status}"]
        for kind in ("workers", "schedulers", "clients"):
            before, out = time.monotonic(), Path(folder) / kind
            total, last = disturbed(kind, robots, out, options.kills, options.seed)
            same = files(out) == files(Path(folder) / "alone")
            said = f", the client's end at most {total.said_after:.1f} s later" if kind == "schedulers" else ""
            statuses = f"exit statuses {sorted(set(total.exits))}, of the last {last}"
            took = f"{time.monotonic() - before:.0f} s"
            bits = "the same to the bit" if same else "NOT the same"
            print(f"{kind}: {total.killed} killed{said}; {statuses}; {bits} ({took})", flush=True)
            found += [f"{kind}: {words}" for words in wrong(kind, total, last, same, options.kills)]
    print("\n".join(["WRONG", *found]) if found else "all as it should be")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
