"""Where the starts of a fit end when modes are named: `python tests/benchmarks/labels.py [--starts 96] [--only TEXT]`.

For each part of the shipped campaign that a laboratory might have, and of simulated campaigns on random arms: how many
starts end in an optimum, in one with an open direction, or are lost; how many in the best optimum; its cost. Exit code
1 if a start is lost.
"""

import argparse
import dataclasses
import os
import sys
import time
from collections.abc import Callable

import jax

jax.config.update("jax_enable_x64", True)

import numpy as np
from shell import DATA, ROOT
from timing import machine

sys.path.insert(0, str(ROOT / "tests" / "support"))

from arms import random_arm

from ident.arm.arm import Arm, stiffness_paths
from ident.description.file import read_arm
from ident.identify.modal_analysis import modal_analysis
from ident.identify.problem import pose
from ident.inference.problem import InverseProblem
from ident.inference.search import End, convergence, solve
from ident.measure import Campaign, Measurement, read_campaign

SAME = 1e-4
"""Difference of cost below which two ends are the same optimum."""
POSTURES, MODES, SIGMA = 8, 6, 0.005
"""Of a random arm's campaign; sigma as a fraction of the value."""
ARMS = ((6, 0), (6, 1), (6, 2), (5, 0), (4, 0))
"""Joints and seeds of random arms; what names modes was chosen with the first two in view, the others came after."""

Part = Callable[[Measurement], bool]
PARTS: dict[str, Part] = {
    "all": lambda m: True,
    "frequencies": lambda m: m.kind == "frequency",
    "vertical modes": lambda m: "vertical" in (m.mode or ""),
    "lateral modes": lambda m: "lateral" in (m.mode or ""),
    "only `lateral torsion 1`": lambda m: m.mode == "lateral torsion 1",
    "vertical modes, deflections": lambda m: "vertical" in (m.mode or "") or m.kind == "deflection",
}


def random_case(joints: int, seed: int) -> tuple[Arm, Campaign]:
    """Return an arm as its file might have it, and what a truth near it would show, with the truth's own labels."""
    rng = np.random.default_rng(seed)
    guess = random_arm(rng, joints)
    stiffness = {path: float(guess.get(path)) for path in stiffness_paths(guess)}
    truth = guess.replace({path: k * np.exp(0.4 * rng.normal()) for path, k in stiffness.items()})
    rows = []
    for _ in range(POSTURES):
        posture = tuple(map(float, rng.uniform(-np.pi, np.pi, joints)))
        seen = modal_analysis(truth, posture, modes=MODES)
        for hertz, label in zip(seen.modes.frequency, seen.labels, strict=True):
            value = float(hertz) * (1 + SIGMA * rng.normal())
            rows.append(
                Measurement(kind="frequency", posture=posture, value=value, sigma=SIGMA * value, mode=str(label))
            )
    return guess, Campaign(measurements=tuple(rows))


def unlabelled(campaign: Campaign) -> Campaign:
    """Return the campaign without labels."""
    return Campaign(measurements=tuple(dataclasses.replace(m, mode=None) for m in campaign))


def problems() -> dict[str, InverseProblem]:
    """Return the problems by name."""
    arm, shipped = read_arm(DATA / "arm.toml").arm, read_campaign(DATA / "campaign.csv")
    campaigns = {name: Campaign(measurements=tuple(filter(part, shipped))) for name, part in PARTS.items()}
    campaigns["unlabelled"] = unlabelled(shipped)
    found = {f"paper's arm, {name}": pose(arm, campaign).problem for name, campaign in campaigns.items()}
    for joints, seed in ARMS:
        guess, measured = random_case(joints, seed)
        found[f"{joints} joints, arm {seed}, labels"] = pose(guess, measured).problem
        found[f"{joints} joints, arm {seed}, unlabelled"] = pose(guess, unlabelled(measured)).problem
    return found


def outcome(problem: InverseProblem, end: End) -> str:
    """Return how a start ended."""
    how = convergence(problem, end)
    return "lost" if not how.converged else "open" if len(how.open) else "optimum"


def _score(end: End) -> float:
    return end.score if np.isfinite(end.cost) else np.inf


def row(problem: InverseProblem, starts: int) -> dict[str, float]:
    """Search from the starts of a fit and count how they end."""
    first = problem.parameters.theta(problem.parameters.column("start"))
    noise = np.random.default_rng(0).standard_normal((96, len(first)))[:starts]
    noise[0] = 0
    solve(problem, first)
    begin = time.perf_counter()
    ends: list[End] = []
    for each in noise:
        ends.append(jax.device_get(solve(problem, first + each, min(ends, key=_score, default=None))))
    wall = (time.perf_counter() - begin) / starts
    how = [outcome(problem, end) for end in ends]
    costs = np.array([float(end.cost) for end, each in zip(ends, how, strict=True) if each == "optimum"])
    best = min(costs, default=np.nan)
    counted = {each: float(how.count(each)) for each in ("optimum", "open", "lost")}
    return {**counted, "in the best": float((costs < best + SAME).sum()), "its cost": best, "ms each": 1e3 * wall}


def main() -> None:
    """Run, print, judge."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--starts", type=int, default=96)
    parser.add_argument("--only", default="", help="those whose name has this in it")
    asked = parser.parse_args()
    print(machine())
    lost = 0.0
    print(f"\n{'ends of ' + str(asked.starts) + ' starts':42s} optimum  open  lost  in the best  its cost  ms each")
    for name, problem in problems().items():
        if asked.only in name:
            got = row(problem, asked.starts)
            lost += got["lost"]
            numbers = f"{got['optimum']:7.0f} {got['open']:5.0f} {got['lost']:5.0f} {got['in the best']:12.0f}"
            print(f"{name:42s} {numbers} {got['its cost']:9.2f} {got['ms each']:8.1f}", flush=True)
    print(f"\nload at the end {os.getloadavg()[0]:.1f}")
    sys.exit(lost > 0)


if __name__ == "__main__":
    main()
