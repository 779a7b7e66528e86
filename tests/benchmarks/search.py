"""How often the search of a fit misses an optimum that fits as well as its best: `python tests/benchmarks/search.py`.

Chains of springs whose stiffnesses several sets of values explain. For each of many seeds: the search of `fit`, and its
first 16 starts alone. All optima that any search has met count as those that there are.
"""

import argparse
import sys
import time
from pathlib import Path

import jax
import numpy as np

sys.path.append(str(Path(__file__).parents[1] / "support"))
jax.config.update("jax_enable_x64", True)

from chains import storey_problem

from ident.inference.fit import FIT_SPREAD, FIT_STARTS, fit
from ident.inference.optima import Optimum, distinct, rivals
from ident.inference.problem import InverseProblem
from ident.inference.search import convergence, solve

SEEDS = 100
CHAINS = {
    "three springs": (1.0e6, 3.0e6, 0.4e6),
    "four springs": (1.2e6, 1.0e6, 0.8e6, 0.9e6),
    "five springs": (2.0e6, 0.5e6, 1.0e6, 1.5e6, 0.7e6),
}
NEAR = 1e-2
"""Distance in theta within which two optima are one."""


def main() -> None:
    """Print for each chain how many of its optima are missed, and what the search costs."""
    argparse.ArgumentParser(description=__doc__).parse_args()
    print("chain          optima  missed by 16 starts  missed by fit  starts of fit  s a fit")
    for name, truth in CHAINS.items():
        problem = storey_problem(np.array(truth), width=np.inf)
        few, whole, tried, seconds = [], [], [], []
        for seed in range(SEEDS):
            few.append(near(first_starts(problem, seed)))
            start = time.perf_counter()
            found = fit(problem, seed=seed).optima
            seconds.append(time.perf_counter() - start)
            whole.append(near(found))
            tried.append(sum(optimum.starts for optimum in found))
        known: list[np.ndarray] = []
        for theta in (theta for found in (*few, *whole) for theta in found):
            if not met(theta, known):
                known.append(theta)
        missed = [np.mean([not all(met(theta, found) for theta in known) for found in each]) for each in (few, whole)]
        numbers = f"{missed[0]:20.0%} {missed[1]:14.0%} {np.mean(tried):14.0f} {np.median(seconds):8.2f}"
        print(f"{name:14s} {len(known):6d} {numbers}", flush=True)


def first_starts(problem: InverseProblem, seed: int) -> tuple[Optimum, ...]:
    """Return the optima that the first starts of a fit lead to."""
    first = problem.parameters.theta(problem.parameters.column("start"))
    noise = np.random.default_rng(seed).standard_normal((FIT_STARTS, len(first))) * FIT_SPREAD
    noise[0] = 0
    ends = [jax.device_get(solve(problem, first + step)) for step in noise]
    return distinct(problem, [(end, convergence(problem, end)) for end in ends if np.isfinite(end.cost)])


def near(optima: tuple[Optimum, ...]) -> list[np.ndarray]:
    """Return where the best optimum and its rivals are."""
    return [optimum.theta for optimum in (optima[0], *rivals(optima)) if optimum.converged]


def met(theta: np.ndarray, found: list[np.ndarray]) -> bool:
    """Tell whether an optimum is among those that were found."""
    return any(np.abs(theta - other).max() < NEAR for other in found)


if __name__ == "__main__":
    main()
