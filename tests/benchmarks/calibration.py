"""Simulation-based calibration of fit and sampler on the paper's arm.

`python tests/benchmarks/calibration.py [--draws 200] [--seed 0] [--resume FILE]`; see tests/sbc.py. Exit code 1 if
ranks or coverage fail.

Two postures, the lowest three frequencies in each and the tip's deflection; sigma 0.5 % and 2 % of the values of
Table 1; log-normal priors of sd 0.3 about Table 1. The frequencies have no labels: in ascending order they exist for
every truth. With labels "the lowest three" are other labels from truth to truth (at 60 deg the lowest two are 1.5 %
apart), and a label's frequency jumps where two modes cross, so that data and density would not be those of one model.
"""

import argparse
import json
import multiprocessing
import os
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict
from functools import cache
from pathlib import Path

import jax

jax.config.update("jax_enable_x64", True)

import equinox as eqx
import jax.monitoring
import jax.numpy as jnp
import numpy as np
from shell import DATA, ROOT
from timing import machine

sys.path.insert(0, str(ROOT / "tests" / "support"))

from sbc import Recovery, recover, report

from ident.description.file import read_arm
from ident.identify.problem import pose
from ident.identify.unknowns import Unknowns
from ident.inference.problem import InverseProblem
from ident.inference.sample import Settings
from ident.inference.search import evaluate
from ident.measure import Campaign, Measurement

ALPHA = (0.0, 60.0)
"""Postures q = alpha (1, -2, 1) [deg]."""
FREQUENCIES = 3
SIGMA = {"frequency": 0.005, "deflection": 0.02}
"""Standard deviation as a fraction of the value that Table 1 gives."""
WIDTH = 0.3
"""Width of the priors."""
STARTS = 12
SETTINGS = Settings(walkers=16, max_steps=400, target_ess=np.inf)
"""Of the sampler: a run of fixed length, about ten autocorrelation times after burn-in."""
EVENT = "/jax/core/compile/backend_compile_duration"


@cache
def problem() -> InverseProblem:
    """Return the problem; its data are those of Table 1 without noise."""
    arm, rows = read_arm(DATA / "arm.toml").arm, []
    for alpha in ALPHA:
        posture = tuple((np.deg2rad(alpha) * np.array([1.0, -2.0, 1.0])).tolist())
        for place in range(FREQUENCIES):  # values that are replaced, but for their order
            rows.append(Measurement(kind="frequency", posture=posture, value=1.0 + place, sigma=1.0))
        rows.append(Measurement(kind="deflection", posture=posture, value=1.0, sigma=1.0, point="tip"))
    posed = pose(arm, Campaign(measurements=tuple(rows)), Unknowns(prior_sd=WIDTH)).problem
    nominal = evaluate(posed).predicted
    sigma = jnp.array([SIGMA[kind] for kind in posed.kinds]) * nominal
    return eqx.tree_at(lambda p: (p.measured, p.sigma), posed, (nominal, sigma))


def one(draw: int, seed: int) -> tuple[Recovery, dict[str, float]]:
    """Recover one truth; return also what it cost."""
    compiled: list[str] = []
    jax.monitoring.register_event_duration_secs_listener(
        lambda event, _, **more: compiled.append(event) if event == EVENT else None
    )
    posed, wall, cpu = problem(), time.perf_counter(), time.process_time()
    found = recover(posed, draw, seed, SETTINGS, starts=STARTS, spread=WIDTH)
    jax.monitoring.clear_event_listeners()
    spent = {"wall": time.perf_counter() - wall, "cpu": time.process_time() - cpu}
    return found, {**spent, "compiled": len(compiled), "process": os.getpid()}


def header(seed: int) -> dict[str, object]:
    """Name what all recoveries in one file share."""
    return {"seed": seed, "walkers": SETTINGS.walkers, "steps": SETTINGS.max_steps, "starts": STARTS, "width": WIDTH}


def read(file: Path | None, seed: int) -> dict[int, tuple[Recovery, dict[str, float]]]:
    """Return what an interrupted run has left, by number; a half-written last line is dropped."""
    if file is None or not file.exists():
        return {}
    text = file.read_text()
    whole = text[: text.rfind("\n") + 1]
    file.write_text(whole)
    lines = [json.loads(line) for line in whole.splitlines()]
    if lines and lines[0] != header(seed):
        sys.exit(f"{file} is of another run: {lines[0]}; this one is {header(seed)}; name another file")
    return {line["found"]["draw"]: (Recovery(**line["found"]), line["cost"]) for line in lines[1:]}


def run(draws: int, seed: int, file: Path | None, processes: int) -> dict[int, tuple[Recovery, dict[str, float]]]:
    """Recover truths that are not in the file yet, and add each to it."""
    done = read(file, seed)
    left = [draw for draw in range(draws) if draw not in done]
    with (
        open(file or os.devnull, "a", encoding="utf-8") as out,
        ProcessPoolExecutor(processes, multiprocessing.get_context("spawn")) as pool,
    ):
        if out.tell() == 0:
            print(json.dumps(header(seed)), file=out, flush=True)
        for running in [pool.submit(one, draw, seed) for draw in left]:
            found, cost = running.result()
            done[found.draw] = found, cost
            print(json.dumps({"found": asdict(found), "cost": cost}), file=out, flush=True)
            if sys.stderr.isatty():
                print(f"\r{len(done)} of {draws}", end="", file=sys.stderr, flush=True)
    return {draw: done[draw] for draw in range(draws)}


def main() -> None:
    """Run, print, judge."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--draws", type=int, default=200, help="truths from the prior (200; 20 for trying)")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--resume", type=Path, metavar="FILE", help="JSON lines to go on with, or to begin")
    parser.add_argument("--processes", type=int, default=2)
    asked = parser.parse_args()
    print(machine())
    begin = time.perf_counter()
    done = run(asked.draws, asked.seed, asked.resume, asked.processes)
    verdict = report(problem().parameters.names, [found for found, _ in done.values()])
    costs = [cost for _, cost in done.values()]
    warm = [cost for i, cost in enumerate(costs) if cost["process"] in {c["process"] for c in costs[:i]}] or costs
    cpu, wall, compiled = (np.array([cost[name] for cost in warm]) for name in ("cpu", "wall", "compiled"))
    print(f"\n{time.perf_counter() - begin:.0f} s in all. When compiled, a truth takes {wall.mean():.1f} s, of CPU")
    print(f"{cpu.mean():.1f} s (median {np.median(cpu):.1f}, largest {cpu.max():.1f}); programs compiled after the")
    print(f"first truth of each process: {compiled.sum():.0f}. Load at the end {os.getloadavg()[0]:.1f}")
    sys.exit(not (verdict.uniform and verdict.covers))


if __name__ == "__main__":
    main()
