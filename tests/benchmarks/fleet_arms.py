"""How well a population of arms is told: `python tests/benchmarks/fleet_arms.py [--fleets 100] [--chains 3]`.

Fleets of 20 arms of the shipped design, half of them measured in one posture only (four frequencies and a deflection)
and half in four: by normal approximations, by draws that the model weighs, and, some of them, by chains of emcee.
"""

import argparse
import sys
import time
from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import jax

jax.config.update("jax_enable_x64", True)

import numpy as np
from scipy.stats import binom
from shell import ROOT
from timing import commit, machine

DESIGN = ROOT / "data" / "lcd_arm"
sys.path.append(str(DESIGN))

from synthesize import synthesize

from ident.arm.fields import field_of
from ident.description.file import read_arm
from ident.identify.fit import fit_campaign
from ident.identify.fleet import Robot, SourceFile, draws_under, fleet, robot_of
from ident.identify.problem import pose
from ident.identify.unknowns import Unknowns
from ident.inference.population import Draws, Population, Under
from ident.measure import Campaign

ROBOTS, ONE_POSTURE = 20, 5
SPREAD = {"k_bend": 0.06, "k_tors": 0.1}
"""Standard deviation of ln(stiffness) from robot to robot, as data/fleet/generate.py has it."""
ARM = read_arm(DESIGN / "arm.toml").arm


def made(rng: np.random.Generator) -> tuple[list[Campaign], np.ndarray, np.ndarray]:
    """Return the campaigns of a fleet, and mean and spread of its population in theta."""
    like = Campaign(measurements=tuple(replace(m, mode=None) for m in synthesize(ARM, 1)))
    problem = pose(ARM, like, Unknowns()).problem
    mean = np.asarray(problem.parameters.theta(problem.parameters.column("start")))
    sd = np.array([SPREAD[field_of(name).name] for name in problem.parameters.names])
    theta = mean[:, None] + sd[:, None] * rng.standard_normal((len(mean), ROBOTS))
    values = np.asarray(PREDICT(problem, theta))
    values = values + np.array([m.sigma for m in like])[:, None] * rng.standard_normal(values.shape)
    rows = [tuple(replace(m, value=float(v)) for m, v in zip(like, each, strict=True)) for each in values.T]
    return [Campaign(measurements=own[: ONE_POSTURE if r % 2 else None]) for r, own in enumerate(rows)], mean, sd


PREDICT = jax.jit(lambda problem, theta: problem.predict(theta))


def fitted(campaigns: list[Campaign]) -> list[Robot]:
    """Fit all robots."""
    same = SourceFile("arm.toml", "the same")
    fits = (fit_campaign(ARM, campaign) for campaign in campaigns)
    return [robot_of(fit, f"{r:02d}", SourceFile(), same) for r, fit in enumerate(fits)]


def inferred(robots: list[Robot], redraw, seed: int) -> Population:
    """Infer the population."""
    return fleet(robots, seed=seed, redraw=redraw).population


def drawn(
    campaigns: list[Campaign], seed: int, chains: bool, which: Sequence[Robot], under: Under
) -> list[Draws | None]:
    """Draw robots under a population."""
    return [draws_under(ARM, campaigns[int(robot.name)], Unknowns(), under, seed, chains=chains) for robot in which]


def covered(population: Population, mean: np.ndarray, sd: np.ndarray) -> np.ndarray:
    """Tell which 95 % intervals of means and spreads hold the truth, (2, P)."""
    low, high = (np.quantile([population.mean, population.sd], q, 1) for q in (0.025, 0.975))
    return (low < (mean, sd)) & ((mean, sd) < high)


def main() -> None:
    """Print coverage by each way, how far weights can be trusted, and how far chains are from them."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--fleets", type=int, default=100)
    parser.add_argument("--chains", type=int, default=3, help="fleets that are sampled by emcee as well")
    parser.add_argument("--seed", type=int, default=1000)
    options = parser.parse_args()
    print(f"{machine()}, commit {commit()}")
    ways: dict[str, list[np.ndarray]] = {"normal": [], "weighed": [], "chains": []}
    trust, normal, before = [], 0, time.process_time()
    for number in range(options.fleets):
        seed = options.seed + number
        campaigns, *truth = made(np.random.default_rng(seed))
        robots = fitted(campaigns)
        ways["normal"].append(covered(inferred(robots, None, seed), *truth))
        ours = inferred(robots, partial(drawn, campaigns, seed, False), seed)
        ways["weighed"].append(covered(ours, *truth))
        trust += [(each.k, each.effective) for each in ours.trusted]
        normal += len(ours.normal)
        if number < options.chains:
            theirs = inferred(robots, partial(drawn, campaigns, seed, True), seed)
            ways["chains"].append(covered(theirs, *truth))
            _compare(number, ours, theirs)
        if number % 10 == 9:
            print(f"{number + 1} fleets, {time.process_time() - before:.0f} CPU s", flush=True)
            _print(ways)
    k, effective = np.array(trust).T
    print(
        f"weights: Pareto k at most {k.max():.2f}, effective draws at least {effective.min():.0f}; {normal} by normal"
    )


def _compare(number: int, ours: Population, theirs: Population) -> None:
    unit = theirs.mean.std(0)
    mean = np.abs(ours.mean.mean(0) - theirs.mean.mean(0)) / unit
    log_sd = np.abs(np.log(ours.sd).mean(0) - np.log(theirs.sd).mean(0)) / np.log(theirs.sd).std(0)
    sizes = [round(each.effective) for each in theirs.trusted]
    print(
        f"fleet {number + 1}: weighed from chains, in sd of the chains: means {mean.max():.2f}, spreads "
        f"{log_sd.max():.2f}; effective draws of the chains {min(sizes, default=0)} to {max(sizes, default=0)}, "
        f"{len(theirs.normal)} robots by normal approximation",
        flush=True,
    )


def _print(ways: dict[str, list[np.ndarray]]) -> None:
    for way, found in ((way, found) for way, found in ways.items() if found):
        for word, own in zip(("mean", "spread"), np.array(found).transpose(1, 0, 2), strict=True):
            low, high = binom.ppf([0.005, 0.995], own.size, 0.95)
            print(f"  {way}: {word} in its 95 % interval {own.sum()} of {own.size}; 99 % band {low:.0f} to {high:.0f}")


if __name__ == "__main__":
    main()
