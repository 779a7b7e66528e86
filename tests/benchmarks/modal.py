"""How often the intervals of identified modes cover the truth: 200 synthetic hammer tests with a close pair.

    python tests/benchmarks/modal.py [--tests 200] [--seed 0]

Each test is another structure of six modes, of which the first two are 2 % apart and one lies beyond the band; six
responses, one reference, five hits, noise of 1 to 5 %, every other test with an exponential window. Counted:
frequencies, damping ratios and shapes whose 95 % interval covers the truth; the sum of chi-squared with the joint
covariance and with its diagonal alone; tests in which another number of modes is found.
"""

import argparse
import sys
from pathlib import Path

import numpy as np
from scipy.stats import binom, chi2

sys.path.insert(0, str(Path(__file__).parents[1] / "support"))
from known_modes import arm_like, hammer_test

from ident.errors import InputError
from ident.modal.estimate import Modes, modes_of

CLOSE = 0.02
QUANTILE = 1.959964


def one_test(seed: int):
    """Return the truth of a test and its modes, None where there are none."""
    rng = np.random.default_rng(seed)
    truth = arm_like(rng, close=CLOSE)
    frf = hammer_test(truth, rng, noise=rng.uniform(0.01, 0.05), decay=0.4 * (seed % 2))
    try:
        return truth, modes_of(frf)
    except InputError:
        return truth, None


def errors(truth, modes: Modes) -> np.ndarray:
    """Return estimate less truth in the order of the covariance."""
    count = len(modes.frequency)
    reference = np.argmin(np.abs(modes.participation - 1), 0)
    shape = truth.shape[:, :count] * truth.references[reference, np.arange(count)]
    apart = (modes.shape - shape).T
    shapes = np.concatenate([apart.real, apart.imag], 1).ravel()
    return np.concatenate([modes.frequency - truth.frequency[:count], modes.damping - truth.damping[:count], shapes])


def covered(name: str, scaled: np.ndarray) -> None:
    """Print how many intervals cover, and between which numbers that has to lie."""
    inside, number = int((np.abs(scaled) < QUANTILE).sum()), scaled.size
    low, high = binom.interval(0.95, number, 0.95)
    print(f"{name:<18} {inside} of {number} cover, {100 * inside / number:.1f} %; {low:.0f} to {high:.0f} expected")


def summed(name: str, squared: np.ndarray, size: int) -> None:
    """Print a sum of chi-squared with the band of its ratio to the degrees of freedom, and how many tests pass."""
    freedom = size * len(squared)
    low, high = chi2.interval(0.95, freedom) / np.array(freedom)
    passing = int((squared < chi2.ppf(0.95, size)).sum())
    ratio = squared.sum() / freedom
    print(
        f"{name:<18} {ratio:.3f} of {freedom}; {low:.3f} to {high:.3f} expected; {passing} of {len(squared)} tests pass"
    )


def main() -> None:
    """Run the tests and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--tests", type=int, default=200)
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    pairs = [one_test(given.seed + n) for n in range(given.tests)]
    right = [(truth, modes) for truth, modes in pairs if modes is not None and len(modes.frequency) == 5]
    print(f"{len(right)} of {len(pairs)} tests have the five modes")
    each = np.array([errors(truth, modes) / np.sqrt(np.diag(modes.covariance)) for truth, modes in right])
    for name, part in (("frequencies", slice(0, 5)), ("damping ratios", slice(5, 10)), ("shapes", slice(10, None))):
        covered(name, each[:, part])
    covered("close pair", each[:, [0, 1, 5, 6]])
    joint = [(errors(t, m), m.covariance) for t, m in right]
    for name, part in (("poles", slice(0, 10)), ("close poles", [0, 1, 5, 6]), ("all", slice(None))):
        blocks = [(e[part], C[part][:, part]) for e, C in joint]
        size = len(blocks[0][0])
        summed(f"{name}, joint", np.array([e @ np.linalg.solve(C, e) for e, C in blocks]), size)
        summed(f"{name}, diagonal", np.array([(e**2 / np.diag(C)).sum() for e, C in blocks]), size)
    ratios = np.array([modes.ratio.value for _, modes in right])
    doubtful = sum(modes.ratio.doubtful for _, modes in right)
    print(f"jackknife ratio    mean {ratios.mean():.3f}, sd {ratios.std():.3f}; doubtful {doubtful}")


if __name__ == "__main__":
    main()
