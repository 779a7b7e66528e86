"""How often intervals of ambient tests cover the truth: `python tests/benchmarks/ambient.py [--records 200]`.

Each record is the paper's arm at a posture where two modes are 2 % apart, shaken by other white forces for half an
hour, with a pulley whose speed lies 3 % beside a mode (another one in each record) and whose double is heard too; the
speed that is said is up to 0.5 % off. Counted: frequencies and damping ratios whose 95 % interval covers the truth, of
all modes that were found; their squared distance in the joint covariance; harmonics that were named, or taken for
modes; modes that were taken for harmonics; modes that are none.
"""

import argparse
import sys
from pathlib import Path

import numpy as np
from scipy.stats import f

sys.path.insert(0, str(Path(__file__).parents[1] / "support"))
from ambient_records import ambient_test, shaken
from modal import covered

import ident
from ident.errors import InputError
from ident.modal.operational import LEAST_DAMPED, operational_modes

BESIDE = 0.03
NEAR = 0.05
"""How far a found mode is from a true one at most, as a share."""


def one_record(arm, seed):
    """Return the test, its modes, None where there are none, and the speed of the pulley [Hz]."""
    rng = np.random.default_rng(seed)
    speed = arm.frequency[seed % 5] * (1 + BESIDE * rng.choice([-1, 1]))
    record = arm.record(rng, [(speed, rng.uniform(0.1, 0.6)), (2 * speed, 0.1)])
    test = ambient_test(record, f"{speed * (1 + rng.uniform(-0.005, 0.005)):.6g} Hz @ pulley 1", (1.0, 28.0))
    try:
        return test, operational_modes(test), speed
    except InputError as error:
        print("record", seed, error)
        return test, None, speed


def matched(arm, modes):
    """Return for each found mode the number of the true one, -1 where it is none."""
    found = 2 * np.pi * modes.frequency * (-modes.damping + 1j * np.sqrt(1 - modes.damping**2))
    apart = np.abs(found[:, None] - arm.poles) / np.abs(arm.poles)
    nearest = apart.argmin(1)
    return [int(j) if apart[i, j] < NEAR and nearest.tolist().count(j) == 1 else -1 for i, j in enumerate(nearest)]


def count(arm, results):
    """Print what came out."""
    errors, squared, sizes = [[] for _ in arm.poles], [], []
    named = taken = false_lines = lost = none = 0
    for test, modes, speed in results:
        named += any(abs(line.frequency / speed - 1) < 1e-3 for line in test.harmonics)
        false_lines += sum(min(abs(line.frequency / speed - k) for k in (1, 2)) > 1e-3 for line in test.harmonics)
        taken += int((np.abs(modes.frequency / speed - 1) < 1e-3).sum())
        pairs = matched(arm, modes)
        none += pairs.count(-1)
        for pole in modes.rejected:
            own = min(abs(pole.frequency / speed - k) for k in (1, 2)) < 1e-3
            lost += pole.damping < LEAST_DAMPED and not own
        right = [(i, j) for i, j in enumerate(pairs) if j >= 0]
        off = np.array([(modes.frequency[i] - arm.frequency[j], modes.damping[i] - arm.damping[j]) for i, j in right])
        for (i, j), own in zip(right, off, strict=True):
            errors[j].append(own / modes.sigma[:, i])
        at = [i for i, _ in right] + [len(modes.frequency) + i for i, _ in right]
        vector = off.T.ravel()
        squared.append(vector @ np.linalg.solve(modes.covariance[np.ix_(at, at)], vector))
        sizes.append((len(vector), modes.blocks - 1))
    for name, some in (("all", range(len(errors))), ("below 5 %", np.flatnonzero(arm.damping < 0.05))):
        own = np.concatenate([np.array(errors[j]) for j in some if errors[j]])
        print(f"modes damped by: {name}")
        covered("  frequencies", own[:, 0])
        covered("  damping ratios", own[:, 1])
    for hertz, ratio, own in zip(arm.frequency, arm.damping, errors, strict=True):
        scaled = np.array(own).reshape(-1, 2)
        inside = (np.abs(scaled) < 1.96).mean(0) if len(own) else np.full(2, np.nan)
        shares = f"frequency {inside[0]:.3f}, damping {inside[1]:.3f}"
        print(f"  {hertz:7.3f} Hz, {100 * ratio:5.2f} %: found {len(own)}, {shares}")
    within = sum(d / n < f(n, m).ppf(0.95) for d, (n, m) in zip(squared, sizes, strict=True))
    mean = np.mean([d / n for d, (n, _) in zip(squared, sizes, strict=True)])
    print(f"joint covariance       {mean:.3f} squared distance over its size; {within} of {len(results)} within 95 %")
    print(f"harmonics              {named} of {len(results)} named, {taken} taken for modes; {false_lines} false lines")
    print(f"modes                  {lost} taken for harmonics; {none} found that are none")


def main():
    """Run the records and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--records", type=int, default=200)
    parser.add_argument("--seed", type=int, default=5000)
    parser.add_argument("--duration", type=float, default=1800.0)
    given = parser.parse_args()
    ident.ModalOptions()
    arm = shaken(given.duration)
    results = [one_record(arm, given.seed + n) for n in range(given.records)]
    found = [each for each in results if each[1] is not None]
    print(f"{len(found)} of {len(results)} records have modes")
    count(arm, found)


if __name__ == "__main__":
    main()
