"""How often the intervals of identified modes cover the truth: `python tests/benchmarks/modal.py [--tests 200]`.

Each test is another structure of six modes, of which the first two are 2 % apart and one lies beyond the band; six
responses, or one, one reference, five hits, noise of 1 to 5 %, every other test with an exponential window. Counted:
frequencies, damping ratios and shapes whose 95 % interval covers the truth; the squared distance in the joint
covariance (Hotelling's, as the scatter of the hits scales it), and in its diagonal alone; tests in which another number
of modes is found. From one response the close frequencies' errors go together: their difference shows what the
diagonal alone says wrongly.
"""

import argparse
import sys
from pathlib import Path

import numpy as np
from scipy.stats import binom, f, t

sys.path.insert(0, str(Path(__file__).parents[1] / "support"))
from known_modes import arm_like, hammer_test

from ident.errors import InputError
from ident.modal.modes import Modes, modes_of

CLOSE = 0.02
QUANTILE = 1.959964


def one_test(seed: int, responses: int):
    """Return the truth of a test and its modes, None where there are none."""
    rng = np.random.default_rng(seed)
    truth = arm_like(rng, outputs=responses, close=CLOSE)
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
    print(f"{name:<22} {inside} of {number} cover, {100 * inside / number:.1f} %; {low:.0f} to {high:.0f} expected")


def summed(name: str, squared: np.ndarray, size: int, freedom: int) -> None:
    """Print the mean squared distance of one number, and how many tests are within their 95 % limit.

    Scaled by a variance with `freedom` degrees of freedom, widened by Student's t, it is F distributed.
    """
    widened = (t.isf(0.025, freedom) / QUANTILE) ** 2
    law = f(size, freedom)
    mean, sd = law.mean() / widened, law.std() / widened / len(squared) ** 0.5
    passing = int((squared / size * widened < law.ppf(0.95)).sum())
    expected = binom.interval(0.95, len(squared), 0.95)
    print(
        f"{name:<22} {squared.mean() / size:.3f}, {mean - 1.96 * sd:.3f} to {mean + 1.96 * sd:.3f} expected; "
        f"{passing} of {len(squared)} tests within 95 %, {expected[0]:.0f} to {expected[1]:.0f} expected"
    )


def report(given: argparse.Namespace, responses: int) -> None:
    """Run the tests with so many responses and print."""
    pairs = [one_test(given.seed + n, responses) for n in range(given.tests)]
    right = [(truth, modes) for truth, modes in pairs if modes is not None and len(modes.frequency) == 5]
    print(f"{responses} responses: {len(right)} of {len(pairs)} tests have the five modes")
    joint = [(errors(truth, modes), modes.covariance) for truth, modes in right]
    each = np.array([e / np.sqrt(np.diag(C)) for e, C in joint])
    for name, part in (("frequencies", slice(0, 5)), ("damping ratios", slice(5, 10)), ("shapes", slice(10, None))):
        covered(name, each[:, part])
    covered("close pair", each[:, [0, 1, 5, 6]])
    freedom = right[0][1].ratio.freedom
    for name, part in (("poles", slice(0, 10)), ("close poles", [0, 1, 5, 6]), ("all", slice(None))):
        blocks = [(e[part], C[part][:, part]) for e, C in joint]
        size = len(blocks[0][0])
        summed(f"{name}, joint", np.array([e @ np.linalg.solve(C, e) for e, C in blocks]), size, freedom)
        summed(f"{name}, diagonal", np.array([(e**2 / np.diag(C)).sum() for e, C in blocks]), size, freedom)
    apart = np.array([e[1] - e[0] for e, _ in joint])
    variance = np.array([[C[0, 0] + C[1, 1] - 2 * C[0, 1], C[0, 0] + C[1, 1]] for _, C in joint])
    for name, own in zip(("joint", "diagonal"), variance.T, strict=True):
        summed(f"close gap, {name}", apart**2 / own, 1, freedom)
    correlation = np.array([C[0, 1] / np.sqrt(C[0, 0] * C[1, 1]) for _, C in joint])
    print(f"close frequencies      correlation {np.median(correlation):.2f}, least {correlation.min():.2f}")
    ratios = np.array([modes.ratio.value for _, modes in right])
    doubtful = sum(modes.ratio.doubtful for _, modes in right)
    print(f"jackknife ratio        mean {ratios.mean():.3f}, sd {ratios.std():.3f}; doubtful {doubtful}")


def main() -> None:
    """Run both kinds of test."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--tests", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1000)
    given = parser.parse_args()
    for responses in (6, 1):
        report(given, responses)


if __name__ == "__main__":
    main()
