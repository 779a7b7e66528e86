"""`ident fit` as a user meets it: a new process, without and with the compilation cache."""

import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).parents[2]
DATA = ROOT / "data" / "lcd_arm"
STAGES = """
import time; t = [time.perf_counter()]
from ident.cli import running; running.start()
import jax, equinox as eqx
from pathlib import Path
from ident.description.file import read_arm; from ident.measure import read_campaign
from ident.inference import fit, least_squares; from ident.identify.build_problem import build_problem
from ident.jit import SMALL_KERNELS
t.append(time.perf_counter())
problem = build_problem(read_arm("ARM").arm, read_campaign("CAMPAIGN"))
start = problem.parameters.theta(problem.parameters.column("start"))
t.append(time.perf_counter())
asked = problem, start, problem.unheld(), least_squares.UNTIL_ANEW, least_squares.WHOLE
lowered = eqx.filter_jit(least_squares.search.__wrapped__, **SMALL_KERNELS).lower(*asked)
t.append(time.perf_counter())
program = lowered.compile()
t.append(time.perf_counter())
jax.block_until_ready(program(*asked))
t.append(time.perf_counter())
import ident.present.figures.fit
t.append(time.perf_counter())
names = "imports", "read and bind", "trace and lower", "compile or load", "one start", "import matplotlib"
print(", ".join(f"{n} {b - a:.2f}" for n, a, b in zip(names, t, t[1:])))
"""


def run_quietly(line: list[str], environment: dict[str, str]) -> "subprocess.CompletedProcess[str]":
    return subprocess.run(line, env=environment, cwd=ROOT, capture_output=True, text=True, check=False)


def timed(line: list[str], environment: dict[str, str]) -> float:
    """Return how long a command that must succeed takes [s]."""
    begin = time.perf_counter()
    done = run_quietly(line, environment)
    spent = time.perf_counter() - begin
    if done.returncode:
        sys.exit(done.stderr)
    return spent


def command() -> None:
    """`ident fit` from the shell, the first time and the next."""
    print("\n`ident fit` from the shell [s], and the stages of one start in a process of its own")
    with tempfile.TemporaryDirectory() as folder:
        caches = [{**os.environ, "JAX_COMPILATION_CACHE_DIR": str(Path(folder) / name)} for name in ("shell", "stages")]
        line = [sys.executable, "-m", "ident", "fit", str(DATA / "table1.csv"), "--out", folder]
        script = STAGES.replace("ARM", str(DATA / "arm.toml")).replace("CAMPAIGN", str(DATA / "table1.csv"))
        for run, times in (("first", 1), ("next", 5)):
            spent = sorted(timed(line, caches[0]) for _ in range(times))
            shown = run_quietly([sys.executable, "-c", script], caches[1])
            what = f"{spent[0]:.2f}" + (f" to {spent[-1]:.2f}" if times > 1 else "")
            print(f"  {run:6s}{what:14s}{shown.stdout.strip() or shown.stderr[-300:]}")
