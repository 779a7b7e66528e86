"""How long `ident modal` takes from files to labelled modes: `python tests/benchmarks/modal_speed.py [--runs 3]`.

The shipped hammer test without one of its six responses: ten frequency responses by five hits at each of four postures.
Each run is a process of its own, on two cores; the first one compiles, the last ones draw no figure (`labelled`). CPU
seconds are those of the process: beside other work they say more than the clock, and even they are more then.
"""

import argparse
import os
import re
import resource
import shutil
import subprocess
import tempfile
import time
from pathlib import Path

from shell import RUN

ROOT = Path(__file__).parents[2]
HAMMER = ROOT / "data" / "lcd_arm" / "hammer"
LEFT_OUT = "2:+Z acceleration,response"
"""The response that makes twelve functions of ten."""


def folder_of_ten(folder: Path) -> Path:
    """Copy the shipped test without one response."""
    tests = Path(shutil.copytree(HAMMER, folder / "ten", ignore=shutil.ignore_patterns("*.py", "__pycache__")))
    table = tests / "channels.csv"
    table.write_text(table.read_text().replace(LEFT_OUT, LEFT_OUT.replace("response", "ignore")))
    return tests


def run(folder: Path, tests: Path, *more: str) -> tuple[float, float, str]:
    """Run the command; return seconds by the clock and of the processor, and what it says of its time."""
    environment = {**os.environ, "JAX_COMPILATION_CACHE_DIR": str(folder / "cache")}
    line = [*RUN, "modal", str(tests), "--out", str(folder / "out"), *more]
    before, begin = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    done = subprocess.run(line, env=environment, capture_output=True, text=True, check=True)
    spent, after = time.perf_counter() - begin, resource.getrusage(resource.RUSAGE_CHILDREN)
    cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    names = re.search(r"\d+ of \d+ modes have a name", done.stdout)
    said = next((row for row in reversed(done.stderr.splitlines()) if " programs" in row), "")
    return spent, cpu, f"{names[0] if names else 'no modes'}; {said}"


def main() -> None:
    """Print a row for each run."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=3, help="runs with everything compiled")
    given = parser.parse_args()
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[:2])
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        tests = folder_of_ten(folder)
        rows = [("cold", ()), *[("compiled", ())] * given.runs, *[("labelled", ("--no-figure",))] * given.runs]
        for what, more in rows:
            spent, cpu, said = run(folder, tests, *more)
            print(f"{what:9s}{spent:7.2f} s, {cpu:6.2f} CPU s, load {os.getloadavg()[0]:.1f}; {said}", flush=True)


if __name__ == "__main__":
    main()
