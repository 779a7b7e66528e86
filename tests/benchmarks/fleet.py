"""How well populations are told from fleets of 20 robots: `python tests/benchmarks/fleet.py [--fleets 100]`.

Robots of four parameters with normal likelihoods, good and poor data mixed; one of them has a parameter off. With
`--eight`: fleets of eight robots of six parameters, healthy and with a factor of 0.6 on one, and who is named there.
"""

import argparse
import sys
from pathlib import Path

import numpy as np
from scipy.stats import binom

sys.path.append(str(Path(__file__).parents[1] / "support"))

from fleets import SPREADS, GaussianFleet, judged_fleet, named

CHANCES = (0.01, 0.02, 0.03, 0.05)
"""Chances of a false alarm in a healthy fleet at which fleets are judged."""


def main() -> None:
    """Print coverage, errors, power and false alarms."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--fleets", type=int, default=100, help="with a fault of 4 combined standard deviations")
    parser.add_argument("--more", type=int, default=40, help="with each other size of fault")
    parser.add_argument("--eight", action="store_true", help="fleets of eight, each kind as many as `--fleets`")
    options = parser.parse_args()
    if options.eight:
        print("robots found, or alarms, per 100 fleets of eight")
        for spread in SPREADS:
            for good in (True, False):
                print(_eight(spread, good, options.fleets), flush=True)
        return
    tried = {off_by: [] for off_by in (4.0, 3.0, 5.0, 6.0, 8.0)}
    for off_by, fleets in tried.items():
        count = options.fleets if off_by == 4.0 else options.more
        fleets += [GaussianFleet.tried(1000 + seed, off_by) for seed in range(count)]
    covered = np.array([each.covered for each in tried[4.0]])
    for word, own in zip(("mean", "spread"), covered.transpose(1, 0, 2), strict=True):
        low, high = binom.ppf([0.005, 0.995], own.size, 0.95)
        print(f"{word}: 95 % intervals hold {own.sum()} of {own.size} truths; 99 % band {low:.0f} to {high:.0f}")
    own, shrunk = (np.mean([getattr(f, name) for f in tried[4.0]]) for name in ("own_error", "shrunk_error"))
    print(f"mean squared error: own {own:.3g}, shrunk {shrunk:.3g}")
    every = [each for fleets in tried.values() for each in fleets]
    healthy = sum(len(each.if_known) - 1 for each in every)
    for chance in CHANCES:
        alarms = sum(each.false_alarms(chance) for each in every)
        fleets = np.mean([each.false_alarms(chance) > 0 for each in every])
        found = {k: np.mean([f.found(chance) for f in v]) for k, v in sorted(tried.items())}
        print(f"{chance:.0%}: {alarms} false alarms of {healthy} robots, in {fleets:.1%} of fleets; {_words(found)}")
        limit = np.quantile(np.concatenate([np.delete(f.if_known, f.faulty) for f in every]), 1 - alarms / healthy)
        found = {k: np.mean([f.if_known[f.faulty] > limit for f in v]) for k, v in sorted(tried.items())}
        print(f"    as many false alarms, by who knows the population: {_words(found)}")


def _eight(kind: str, good: bool, count: int) -> str:
    """Say how often who is named, healthy and with faults, and how often leave-one-out t tests find the fault."""
    rng, healthy, one, two = np.random.default_rng(1000), [], [], []
    for _ in range(count):
        spread, robot, j = (
            SPREADS[kind](rng),
            int(rng.integers(8)),
            5 if "one 20 %" in kind else int(rng.integers(3, 6)),
        )
        healthy.append(judged_fleet(rng, spread, good=good))
        one.append((robot, j, *judged_fleet(rng, spread, [(robot, j)], good)))
        two.append((robot, j, judged_fleet(rng, spread, [(robot, j), ((robot + 1) % 8, j)], good)[0]))
    lines = [f"{kind}, {'good' if good else 'poor and very poor'} data"]
    for chance in CHANCES:
        alarms = np.mean([bool(named(each, chance)) for each, _ in healthy])
        found = np.mean([(r, j) in named(each, chance) for r, j, each, _ in one])
        beside = np.mean([any(other != r for other, _ in named(each, chance)) for r, _, each, _ in one])
        limit = np.quantile([t.min() for _, t in healthy], alarms)
        by_t = np.mean([t[r].min() < limit for r, _, _, t in one])
        both = np.mean([{(r, j), ((r + 1) % 8, j)} <= {*named(each, chance)} for r, j, each in two])
        lines.append(
            f"  {chance:.0%}: healthy fleets {alarms:.1%}, beside a fault {beside:.1%}; found {found:.1%}, by t tests "
            f"with as many alarms {by_t:.1%}; of two alike faults both {both:.1%}"
        )
    return "\n".join(lines)


def _words(found: dict[float, float]) -> str:
    return "found " + ", ".join(f"{off_by:g} sd {share:.0%}" for off_by, share in found.items())


if __name__ == "__main__":
    main()
