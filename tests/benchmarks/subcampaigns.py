"""Every part of the shipped campaign that a laboratory might have, through check, fit, profile and the sampler.

`python tests/benchmarks/subcampaigns.py [--draws 4] [--seed 0] [--sample] [--resume FILE] [--processes 2]`

55 parts (tests/support/subcampaigns.py): kinds, postures, families of modes, without labels. For each some truths from
the prior with sigmas that are right, one with sigmas ten times too large and one with sigmas ten times too small; with
`--sample` one short run of the sampler. Exit code 1 if anything breaks, prints nan, loses a start, or if fewer of the
intervals that are shown hold the truth than the 99.9 % limit of the binomial distribution allows.
"""

import argparse
import sys
import time
from collections import Counter
from dataclasses import asdict
from pathlib import Path

import jax

jax.config.update("jax_enable_x64", True)

import resumable
from scipy.stats import binom
from shell import ROOT
from timing import commit, machine

sys.path.insert(0, str(ROOT / "tests" / "support"))

from campaign_parts import Verdict, judge, parts, sampled

FACTORS = (1.0, 10.0, 0.1)
BAND = 0.999


def work(what: str, part: str, factor: float, draw: int, seed: int) -> dict[str, object]:
    """Judge one simulated campaign, or sample it."""
    return asdict((judge if what == "judge" else sampled)(part, factor, draw, seed))


def covered(found: list[Verdict], what: str) -> bool:
    """Print how many of the intervals shown hold the truth, and tell whether they are enough."""
    shown, held = sum(len(v.shown) for v in found), sum(len(getattr(v, what)) for v in found)
    least = int(binom.ppf(1 - BAND, shown, 0.95))
    print(
        f"  {what:9s} {held} of {shown} intervals shown hold the truth ({held / max(shown, 1):.1%}; at least {least})"
    )
    return held >= least


def report(found: list[Verdict], factor: float) -> bool:
    """Print what was found of the campaigns whose sigmas are off by a factor, and tell whether it is right."""
    print(f"\nsigmas {factor:g} times the true ones: {len(found)} campaigns")
    broken, lost = [v for v in found if v.broken], [v for v in found if v.lost]
    refused = Counter(v.refused.partition(": got")[2][:60] for v in found if v.refused)
    print(f"  broken {len(broken)}; starts lost in {len(lost)}; truth fits better in {sum(v.missed for v in found)}")
    print(f"  refused {sum(refused.values())}: {dict(refused)}" if refused else "  refused none")
    doubts = Counter(doubt for v in found for doubt in v.doubts)
    print(f"  several optima in {sum(v.optima > 1 for v in found)}; doubts {dict(doubts)}")
    for v in (*broken, *lost):
        print(f"    {v.part}, draw {v.draw}: lost {v.lost} {v.broken.strip()[-300:]}")
    enough = [covered(found, what) for what in ("held", "profiled")]
    return not broken and (factor != 1.0 or (not lost and all(enough)))


def main() -> None:
    """Run, print, judge."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--draws", type=int, default=4, help="truths for each part with sigmas that are right")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--sample", action="store_true", help="once each through the sampler, too")
    parser.add_argument("--resume", type=Path, metavar="FILE", help="JSON lines to go on with, or to begin")
    parser.add_argument("--processes", type=int, default=2)
    asked = parser.parse_args()
    seed, begin = asked.seed, time.perf_counter()
    wanted = [("judge", p, f, i, seed) for f in FACTORS for p in parts() for i in range(asked.draws if f == 1 else 1)]
    wanted += [("sample", p, 1.0, 0, seed) for p in parts()] if asked.sample else []
    print(machine(), f"seed {seed}, commit {commit()}", sep="\n")
    done = resumable.run(work, wanted, {"seed": seed}, asked.resume, asked.processes)
    verdicts = {key: Verdict(**found) for key, found in done.items()}
    fine = [report([v for k, v in verdicts.items() if k[0] == "judge" and v.factor == f], f) for f in FACTORS]
    drawn = [v for key, v in verdicts.items() if key[0] == "sample"]
    if drawn:
        broken = [v for v in drawn if v.broken]
        print(f"\nsampled: {len(drawn)}, broken {len(broken)}, refused {sum(bool(v.refused) for v in drawn)}")
        for v in broken:
            print(f"    {v.part}: {v.broken.strip()[-300:]}")
        fine.append(covered(drawn, "held") and not broken)
    print(f"\n{time.perf_counter() - begin:.0f} s in all")
    sys.exit(not all(fine))


if __name__ == "__main__":
    main()
