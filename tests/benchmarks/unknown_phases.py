"""Whether a diagnosis is right about how surely a limit is kept: fresh draws by the exact equations.

    ident diagnose data/lcd_arm/campaign.csv --out OUT
    python tests/benchmarks/unknown_phases.py OUT/campaign.diagnose.json [--draws 200] [--seed 7] [--file F]
        [--processes 2]

Stiffnesses are drawn from the diagnosis' posterior, phases and transmission errors as it holds possible. Each draw is
simulated by the exact equations, as the arm is and with the change that is advised. Exit code 1 if the limit is kept
more often, or less, than the diagnosis says, by more than chance explains (Fisher's exact test, 0.1 %). An interrupted
run goes on with `--file`.
"""

import argparse
import hashlib
import sys
from dataclasses import replace
from functools import cache
from pathlib import Path

import jax

jax.config.update("jax_enable_x64", True)

import numpy as np
import resumable
from scipy.stats import fisher_exact
from timing import commit, machine

from ident.identify.values import Draws
from ident.studies.cure.diagnosis import Diagnosis
from ident.studies.cure.remedies import RATE, carried_out
from ident.studies.rerun import rerun
from ident.vibrate.binomial import BinomialEstimate
from ident.vibrate.evaluator import Evaluator
from ident.vibrate.response import peak
from ident.vibrate.simulate import simulate

LEVEL = 0.001


@cache
def diagnosed(path: str) -> Diagnosis:
    """The diagnosis in a file, computed again."""
    diagnosis: Diagnosis = vars(rerun(path).now)["diagnosis"]
    return diagnosis


@cache
def evaluator(path: str, advised: bool, count: int, seed: int) -> tuple[Evaluator, dict[str, np.ndarray]]:
    """What simulates the arm, changed or not, and the numbers of its fresh draws behind those of the arm itself."""
    diagnosis = diagnosed(path)
    task, remedy = diagnosis.task, diagnosis.advised if advised else None
    values = Draws.of_sample(diagnosis.identification.sampled).some(task.basis.arm, count, seed)
    each, change = task.evaluator(), np.zeros(0)
    if remedy:
        _, each, change = carried_out(task, remedy)
    each = replace(each, draws=task.basis.drawn(values, seed))
    return each, each.batch(change[None])


def work(advised: bool, draw: int, path: str, count: int, seed: int) -> float:
    """Return the peak [m] of one draw by the exact equations."""
    each, numbers = evaluator(path, advised, count, seed)
    arm = each.arm.replace({name: column[1 + draw] for name, column in numbers.items()})
    response = simulate(arm, each.motion, loads=each.loads, method="exact", rate=RATE)
    return float(np.max(peak(response.vibration)))


def report(words: str, said: BinomialEstimate, peaks: np.ndarray, limit: float) -> bool:
    """Print what was said and what came out, and tell whether they agree."""
    kept, count = int((peaks <= limit).sum()), len(peaks)
    table = [[said.count, said.draws - said.count], [kept, count - kept]]
    level = float(fisher_exact(table).pvalue)
    low, high = np.quantile(1e3 * peaks, (0.05, 0.95))
    print(
        f"{words}: said {100 * said.share:.3g} % of {said.draws}, exact {100 * kept / count:.3g} % of {count}", end=""
    )
    print(f" (p = {level:.2g}); 5 to 95 % of the exact peaks: {low:.3g} to {high:.3g} mm")
    return level >= LEVEL


def main() -> int:
    """Simulate the draws, and compare."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("result")
    parser.add_argument("--draws", type=int, default=200)
    parser.add_argument("--seed", type=int, default=7)
    parser.add_argument("--file", type=Path)
    parser.add_argument("--processes", type=int, default=1)
    given = parser.parse_args()
    path, diagnosis = str(given.result), diagnosed(str(given.result))
    ways = (False, True) if diagnosis.advised else (False,)
    wanted = [(way, k, path, given.draws, given.seed) for k in range(given.draws) for way in ways]
    header = {"result": hashlib.sha256(Path(path).read_bytes()).hexdigest(), "draws": given.draws, "seed": given.seed}
    done = resumable.run(work, wanted, header, given.file, given.processes)
    print(f"{machine()}, {commit()}; limit {1e3 * diagnosis.task.limit:g} mm")
    said = {False: diagnosis.vibration.keeps, True: diagnosis.verified.keeps if diagnosis.verified else None}
    fine = [
        report(
            "with the change" if way else "as it is",
            said[way],
            np.array([found for key, found in done.items() if key[0] == way]),
            diagnosis.task.limit,
        )
        for way in ways
    ]
    return 0 if all(fine) else 1


if __name__ == "__main__":
    sys.exit(main())
