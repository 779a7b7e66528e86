"""Rates of the verdicts of a fit: false alarms on right campaigns, power on wrong ones, coverage of what is shown.

`python tests/benchmarks/verdicts.py [--draws 100] [--seed 0] [--resume FILE] [--processes 2] [--case NAME ...]`

The cases and faults are those of tests/support/campaigns.py: the paper's arm with the shipped campaign's rows, on a
rigid base and on one that gives and is fitted, and a building of four storeys with a log-normal, a flat and a
catalogue's prior. Truths are drawn from the prior that the fit uses. Wrong campaigns are a quarter as many. Exit code 1
if an alarm rings more often than its level allows (99.9 % of the binomial distribution), or too few of the intervals
that are shown hold the truth.
"""

import argparse
import sys
import time
from collections import Counter
from dataclasses import asdict
from pathlib import Path

import jax

jax.config.update("jax_enable_x64", True)

import numpy as np
import resumable
from scipy.stats import binom, kstest
from shell import ROOT
from timing import commit, machine

sys.path.insert(0, str(ROOT / "tests" / "support"))

from campaigns import CASES, FAULTS, Outcome, case, outcome

LEVELS = {
    "kinds": 0.0027,
    "rows": 0.0027,
    "chi-squared large": 0.001,
    "chi-squared small": 0.001,
    "no optimum": None,
    "any that withholds": 2 * 0.0027 + 0.001,
    "assumptions": 0.0027,
}
"""By alarm, how often it may ring where all is right; no optimum has no level of its own, only one with all others."""
BAND = 0.999


def work(case: str, fault: str, draw: int, seed: int) -> dict[str, object]:
    """Fit one campaign."""
    return asdict(outcome(case, fault, draw, seed))


def report(name: str, found: dict[str, list[Outcome]]) -> bool:
    """Print what was found of one case, and tell whether it is as it should be."""
    right, fine = found["none"], True
    n = len(right)
    print(f"\n{name}: {n} right campaigns; the fit missed a better optimum in {sum(o.missed for o in right)}")
    faults = [fault for fault in found if fault != "none"]
    heads = "".join(f"{fault:>12s}" for fault in faults)
    print(f"  {'alarm':20s}{'right':>8s}{'at most':>9s}{heads}")
    for alarm, level in LEVELS.items():
        most, rings = n if level is None else int(binom.ppf(BAND, n, level)), sum(alarm in o.alarms for o in right)
        power = "".join(f"{f'{sum(alarm in o.alarms for o in found[f])}/{len(found[f])}':>12s}" for f in faults)
        print(f"  {alarm:20s}{rings:8d}{most:9d}{power}")
        fine &= rings <= most
    for kind in sorted({kind for o in right for kind in o.p}):
        p = np.array([o.p[kind] for o in right if kind in o.p])
        tenths = " ".join(map(str, np.histogram(p, 10, (0, 1))[0]))
        print(f"  p of {kind:12s} tenths {tenths}   uniform: p = {kstest(p, 'uniform').pvalue:.2g}")
    shown, held = (sum(len(getattr(o, name)) for o in right) for name in ("shown", "held"))
    least = int(binom.ppf(1 - BAND, shown, 0.95))
    print(f"  95 % intervals shown: {shown}; hold the truth: {held} ({held / max(shown, 1):.1%}; at least {least})")
    for fault in [fault for fault in faults if fault in case(name).wrong]:
        counts = {k: sum(len(getattr(o, k)) for o in found[fault]) for k in ("shown", "held", "widened", "scaled")}
        shares = ", ".join(f"{k} {v / max(counts['shown'], 1):.0%}" for k, v in counts.items() if k != "shown")
        first = Counter(o.asked[0] for o in found[fault] if o.asked).most_common(3)
        print(f"  {fault}: {counts['shown']} shown, of which hold the truth: {shares}; most asked for: {first}")
    return fine and held >= least


def main() -> None:
    """Run, print, judge."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--draws", type=int, default=100, help="right campaigns a case (100: some minutes)")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--resume", type=Path, metavar="FILE", help="JSON lines to go on with, or to begin")
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--case", action="append", choices=CASES, help="only this one; may be repeated")
    parser.add_argument("--fault", action="append", choices=FAULTS, help="only this one beside none; may be repeated")
    asked = parser.parse_args()
    faults = {c: [f for f in case(c).faults if f in ("none", *(asked.fault or FAULTS))] for c in asked.case or CASES}
    wrong = max(asked.draws // 4, 1)
    wanted = [(c, f, i) for c in faults for f in faults[c] for i in range(asked.draws if f == "none" else wrong)]
    print(machine(), f"seed {asked.seed}, commit {commit()}", sep="\n")
    begin, seed = time.perf_counter(), asked.seed
    done = resumable.run(work, [(*key, seed) for key in wanted], {"seed": seed}, asked.resume, asked.processes)
    found = {key[:3]: Outcome(**each) for key, each in done.items()}
    verdicts = [report(c, {f: [found[key] for key in wanted if key[:2] == (c, f)] for f in faults[c]}) for c in faults]
    print(f"\n{time.perf_counter() - begin:.0f} s in all")
    sys.exit(not all(verdicts))


if __name__ == "__main__":
    main()
