"""How often triage is right: `python tests/benchmarks/triage.py [--runs 200] [--seed 0] [--first 0]`.

Each run is a trace of the paper's arm in y or z at 200 Hz: a drive's imbalance or transmission error at 7, 10 or 13 %,
modes rung by a trapezoid at 20, 35 or 50 %, a fixed line (9.5 Hz, 12.5 Hz, or 5 to 25 Hz), or two of them (a drive and
modes at 20 %), with noise of 5 % of the peak, stiffnesses 2 % off each, and a clock up to 20 ms off. Right: told is
what was put in, no more, no less. Exit code 1 unless 95 % of the runs in which everything is told are right.
"""

import argparse
import sys
import time
from collections import Counter
from pathlib import Path

import jax

jax.config.update("jax_enable_x64", True)

sys.path.insert(0, str(Path(__file__).parents[1] / "support"))

from moving_traces import TRUTHS, case, verdict
from timing import commit, machine

from ident.vibrate.triage import triage


def main() -> None:
    """Run, count, judge."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=200)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--first", type=int, default=0)
    options = parser.parse_args()
    print(f"{commit()}; {machine()}; seed {options.seed}")
    counts, seconds = {truth: Counter() for truth in TRUTHS}, 0.0
    for number in range(options.first, options.first + options.runs):
        one = case(number, options.seed)
        start = time.process_time()
        found = triage(one.arm, [one.trace])
        seconds += time.process_time() - start
        outcome = verdict(found, one.truth)
        counts[TRUTHS[number % len(TRUTHS)]][outcome.split(":")[0]] += 1
        if outcome != "right":
            parts = [(f.kind, *f.drives[:1], f"{f.share:.0%}", f"p {f.probability:.2f}") for f in found.findings]
            print(f"{number}: {one.about}; {outcome}; {parts}", flush=True)
    kinds = ("right", "cannot tell", "missed one", "wrong")
    print(f"\n{'truth':16s}" + "".join(f"{kind:>13s}" for kind in kinds))
    for truth, count in counts.items():
        print(f"{' and '.join(truth):16s}" + "".join(f"{count[kind]:13d}" for kind in kinds))
    total = sum(counts.values(), Counter())
    print(f"{'all':16s}" + "".join(f"{total[kind]:13d}" for kind in kinds))
    right = total["right"] / (options.runs - total["cannot tell"])
    print(f"right: {total['right'] / options.runs:.1%} of all, {right:.1%} of those told")
    print(f"{seconds / options.runs:.2f} CPU s a run")
    sys.exit(right < 0.95)


if __name__ == "__main__":
    main()
