"""Coverage with shapes as data: `python tests/benchmarks/shapes.py [--campaigns 200]`.

Campaigns of the paper's arm in two postures, the second one near a crossing of its two lowest modes: four frequencies
of each, to 0.5 %, and their shapes at the tip and at a point of the last link, to 2 % of the reference's motion.
"""

import argparse
import sys
from dataclasses import replace
from pathlib import Path

import jax

jax.config.update("jax_enable_x64", True)

import numpy as np
from scipy.stats import binom, chi2
from timing import commit, machine

sys.path.insert(0, str(Path(__file__).parents[1] / "support"))
from known_shapes import CROSSING, SKEW, rows, with_elbow

from ident.identify.problem import pose
from ident.inference.search import evaluate, solve
from ident.measure import Campaign

SD = 0.02


def main() -> None:
    """Print how often intervals, and all values together, hold the truth."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--campaigns", type=int, default=200)
    options = parser.parse_args()
    arm, rng = with_elbow(), np.random.default_rng(0)
    known = tuple(replace(m, sigma=SD) if m.kind == "shape" else m for q in (SKEW, CROSSING) for m in rows(arm, q))
    problem = pose(arm, Campaign(measurements=known)).problem
    truth = np.asarray(problem.parameters.theta(problem.parameters.column("start")))
    predicted, sigma = np.asarray(evaluate(problem).predicted), np.array([m.sigma for m in known])
    table = []
    for _ in range(options.campaigns):
        values = predicted + sigma * rng.standard_normal(len(sigma))
        table.append(one(arm, tuple(replace(m, value=float(v)) for m, v in zip(known, values, strict=True)), truth))
    off, joint, p = np.array([each[:-2] for each in table]), *np.array([each[-2:] for each in table]).T
    print(f"{machine()}, commit {commit()}")
    for word, own in (("intervals", abs(off) < 1.959964), ("together", joint < 1), ("chi-squared", p > 0.05)):
        low, high = binom.interval(0.95, own.size, 0.95)
        print(f"{word} {own.sum()} of {own.size}; 95 % band {low:.0f} to {high:.0f}")
    jacobian = np.asarray(evaluate(problem).jacobian) / sigma[:, None]
    frequencies = np.array([m.kind == "frequency" for m in known])
    for way, J in (("frequencies alone", jacobian[frequencies]), ("with shapes", jacobian)):
        sd = np.sqrt(np.diag(np.linalg.inv(J.T @ J + np.eye(len(truth)))))
        print(f"{way}: sd of theta {np.array2string(sd, precision=4)}")


def one(arm, measurements, truth: np.ndarray) -> list[float]:
    """Return errors in sd, the joint distance over its 95 % limit, and the chance of a larger chi-squared.

    The search begins at the truth, about which the priors lie: how one is found from afar is another question.
    """
    problem = pose(arm, Campaign(measurements=measurements)).problem
    end = solve(problem, truth)
    theta = np.asarray(end.theta)
    residuals, slope = problem.weigh(np.asarray(end.predicted), np.asarray(end.jacobian), theta)
    covariance = np.linalg.inv(slope.T @ slope)
    sd, off = np.sqrt(np.diag(covariance)), theta - truth
    joint = float(off @ np.linalg.solve(covariance, off)) / chi2.ppf(0.95, len(off))
    data = residuals[: len(measurements)]
    return [*(off / sd), joint, float(chi2.sf(data @ data, len(data) - len(off)))]


if __name__ == "__main__":
    main()
