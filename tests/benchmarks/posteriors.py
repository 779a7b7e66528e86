"""How long the hard posteriors take, on two threads: `python tests/benchmarks/posteriors.py [table1 deflections six]`.

table1: README's example, three numbers for six stiffnesses and two discrepancies. deflections: the shipped campaign's
four deflections alone. six: twelve stiffnesses of a random six-axis arm by four frequencies and a deflection at each of
twenty postures. Each is sampled until 2000 effective samples, by chains that can be trusted; the fit is made before.
"""

import argparse
import sys
import time
from pathlib import Path

import jax

jax.config.update("jax_enable_x64", True)
sys.path.insert(0, str(Path(__file__).parents[1] / "support"))

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from arms import DATA, posture_of, random_arm
from timing import machine

from ident.description.file import read_arm
from ident.identify.problem import pose
from ident.identify.unknowns import Unknowns
from ident.inference.fit import fit
from ident.inference.posterior import posterior
from ident.inference.problem import InverseProblem
from ident.inference.sample import Settings, sample
from ident.inference.search import evaluate
from ident.measure import Campaign, Measurement, read_campaign

LCD = DATA / "lcd_arm"
POSTURES, FREQUENCIES, SPREAD = 20, 4, 0.3


def table1() -> InverseProblem:
    """README's example."""
    discrepant = Unknowns(discrepancy={"frequency": 0.1, "deflection": 0.1})
    return pose(read_arm(LCD / "arm.toml").arm, read_campaign(LCD / "table1.csv"), discrepant).problem


def deflections() -> InverseProblem:
    """The shipped campaign by a dial gauge alone."""
    rows = tuple(m for m in read_campaign(LCD / "campaign.csv") if m.kind == "deflection")
    return pose(read_arm(LCD / "arm.toml").arm, Campaign(measurements=rows)).problem


def six() -> InverseProblem:
    """A random six-axis arm whose stiffnesses are 30 % off, by 0.5 % of each frequency and 2 % of each deflection."""
    rng = np.random.default_rng(0)
    arm, rows = random_arm(rng, 6), []
    for _ in range(POSTURES):
        posture = tuple(np.asarray(posture_of(arm, rng)).tolist())
        like = {"posture": posture, "sigma": 1.0}
        rows += [Measurement(kind="frequency", value=1.0 + i, **like) for i in range(FREQUENCIES)]
        rows.append(Measurement(kind="deflection", value=1.0, point="tip", direction=(0, 0, -1.0), **like))
    posed = pose(arm, Campaign(measurements=tuple(rows))).problem
    start = np.asarray(posed.parameters.theta(posed.parameters.column("start")))
    exact = np.asarray(evaluate(posed, jnp.asarray(start + SPREAD * rng.standard_normal(len(start)))).predicted)
    bent = np.array(posed.kinds) == "deflection"
    sigma = np.where(bent, 0.02 * np.abs(exact) + 2e-5, 0.005 * exact)
    data = exact + sigma * rng.standard_normal(len(sigma))
    return eqx.tree_at(lambda p: (p.measured, p.sigma), posed, (jnp.asarray(data), jnp.asarray(sigma)))


def main() -> None:
    """Sample each, and print what it took."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", default=["table1", "deflections", "six"])
    names = parser.parse_args().names
    print(machine())
    print(f"{'':14s}  wall s   CPU s   steps   tau     ESS    R-hat  accepted  enough")
    for name in names:
        problem = {"table1": table1, "deflections": deflections, "six": six}[name]()
        found = fit(problem)
        wall, cpu = time.perf_counter(), time.process_time()
        drawn = sample(found, posterior(problem), Settings(threads=2))
        wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
        for d in drawn.diagnosis:
            print(
                f"  {name:12s}{wall:8.1f}{cpu:8.1f}{d.steps:8d}{d.tau.max():6.0f}{d.bulk.min():8.0f}{d.rhat.max():9.4f}"
                f"{drawn.acceptance.mean():10.0%}  {d.enough(drawn.settings.target_ess)}"
            )


if __name__ == "__main__":
    main()
