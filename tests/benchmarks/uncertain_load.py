"""Coverage with a load cell that is off: `python tests/benchmarks/uncertain_load.py [--campaigns 200]`.

Absolute deflections of the paper's arm under 40 kg, whose loads are all off by a common factor of 1 % (one sd), fitted
with that scale uncertain and with the loads taken as exact.
"""

import argparse

import jax

jax.config.update("jax_enable_x64", True)

from dataclasses import replace
from pathlib import Path

import jax.numpy as jnp
import numpy as np
from scipy.stats import binom
from timing import commit, machine

from ident.description.file import read_arm
from ident.identify.fit import fit_campaign
from ident.identify.problem import pose
from ident.identify.unknowns import Unknowns
from ident.inference.information import half_width
from ident.measure import Campaign, Load, Measurement

DATA = Path(__file__).parents[2] / "data" / "lcd_arm"
LOAD = Load(masses=((40.0, "tip"),), forces=(((0.0, 400.0, 0.0), "tip"),))
POSTURES = np.radians([(0, 0, 0), (30, -60, 30), (60, -120, 60), (80, -160, 80), (-40, 20, 60), (10, 70, -50)])
SIGMA, SCALE = 3e-5, 0.01
"""Noise [m] of each deflection, and standard deviation of ln(common factor) of the loads."""
WAYS = {"marginalised": Unknowns(uncertain={"load": "1%"}), "ignored": Unknowns()}


def main() -> None:
    """Print how often each stiffness is in its interval."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--campaigns", type=int, default=200)
    options = parser.parse_args()
    arm, rng = read_arm(DATA / "arm.toml").arm, np.random.default_rng(0)
    inside: dict[str, list[np.ndarray]] = {way: [] for way in WAYS}
    for _ in range(options.campaigns):
        campaign, truth = measured(arm, rng)
        for way, unknowns in WAYS.items():
            fit = fit_campaign(arm, campaign, unknowns, starts=2)
            off, sd = fit.best.theta[: len(truth)] - truth, fit.information.sd[: len(truth)]
            inside[way].append(np.abs(off) < half_width(0.95) * sd)
    print(f"{machine()}, commit {commit()}")
    for way, each in inside.items():
        held = np.array(each)
        low, high = binom.ppf([0.005, 0.995], len(held), 0.95)
        print(f"{way}: of {len(held)}, for each stiffness {held.sum(0).tolist()}; 99 % band {low:.0f} to {high:.0f}")


def measured(arm, rng) -> tuple[Campaign, np.ndarray]:
    """Return a campaign of true stiffnesses near the arm's, and their logarithms."""
    rows = tuple(
        Measurement(kind="deflection", posture=tuple(q), value=0.0, sigma=SIGMA, point="tip", direction=d, load=LOAD)
        for q in POSTURES.tolist()
        for d in ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    )
    problem = pose(arm, Campaign(measurements=rows), WAYS["marginalised"]).problem
    theta = np.asarray(problem.parameters.theta(problem.parameters.column("start")))
    theta = theta + np.append(rng.normal(0, 0.1, len(theta) - 1), rng.normal(0, SCALE))
    values = np.asarray(problem.predict(jnp.asarray(theta))) + SIGMA * rng.standard_normal(len(rows))
    return Campaign(measurements=tuple(replace(m, value=float(v)) for m, v in zip(rows, values, strict=True))), theta[
        :-1
    ]


if __name__ == "__main__":
    main()
