"""How well populations are told from fleets of 20 robots: `python tests/benchmarks/fleet.py [--fleets 100]`.

Robots of four parameters with normal likelihoods, good and poor data mixed; one of them has a parameter off.
"""

import argparse
import sys
from pathlib import Path

import numpy as np
from scipy.stats import binom

sys.path.append(str(Path(__file__).parents[1] / "support"))

from fleets import LIKELY, GaussianFleet

THRESHOLDS = (0.1, 0.2, LIKELY, 0.5)
"""Probabilities from which a robot could be said to stand out."""


def main() -> None:
    """Print coverage, errors, power and false alarms."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--fleets", type=int, default=100, help="with a fault of 4 combined standard deviations")
    parser.add_argument("--more", type=int, default=40, help="with each other size of fault")
    options = parser.parse_args()
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
    for threshold in THRESHOLDS:
        alarms = np.concatenate([np.delete(each.any_off, each.faulty) for each in every]) > threshold
        found = {k: np.mean([f.any_off[f.faulty] > threshold for f in v]) for k, v in sorted(tried.items())}
        print(
            f"from {threshold:.0%}: false alarms {alarms.mean():.2%} of {alarms.size} healthy robots; {_words(found)}"
        )
        limit = np.quantile(np.concatenate([np.delete(f.if_known, f.faulty) for f in every]), 1 - alarms.mean())
        found = {k: np.mean([f.if_known[f.faulty] > limit for f in v]) for k, v in sorted(tried.items())}
        print(f"    as many false alarms, by who knows the population: {_words(found)}")


def _words(found: dict[float, float]) -> str:
    return "found " + ", ".join(f"{off_by:g} sd {share:.0%}" for off_by, share in found.items())


if __name__ == "__main__":
    main()
