"""Coverage with correlated errors: `python tests/benchmarks/correlated.py [--campaigns 200]`.

Campaigns like the shipped one on the paper's arm whose errors share nine tenths of their variance within each posture,
fitted with that correlation and with its diagonal alone.
"""

import argparse
from dataclasses import replace
from pathlib import Path

import jax

jax.config.update("jax_enable_x64", True)

import numpy as np
from scipy.stats import binom, chi2
from timing import commit, machine

from ident.description.file import read_arm
from ident.identify.fit import fit_campaign
from ident.identify.problem import pose
from ident.identify.unknowns import Unknowns
from ident.measure import Campaign, read_campaign
from ident.measure.covariance import Covariance, Group

DATA = Path(__file__).parents[2] / "data" / "lcd_arm"
SHARED = 0.9
"""Correlation of the errors of a posture."""


def main() -> None:
    """Print how often intervals, and all values together, hold the truth."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--campaigns", type=int, default=200)
    options = parser.parse_args()
    arm, shipped = read_arm(DATA / "arm.toml").arm, read_campaign(DATA / "campaign.csv")
    like, root = grouped(shipped)
    problem = pose(arm, like, Unknowns()).problem
    truth = np.asarray(problem.parameters.theta(problem.parameters.column("start")))
    predicted, sigma = np.asarray(problem.predict(truth)), np.array([m.sigma for m in like])
    rng, found = np.random.default_rng(0), {"covariance": [], "diagonal": []}
    for _ in range(options.campaigns):
        values = predicted + sigma * (root @ rng.standard_normal(len(sigma)))
        rows = tuple(replace(m, value=float(v)) for m, v in zip(like, values, strict=True))
        alone = tuple(replace(m, group="", member=0) for m in rows)
        ways = Campaign(measurements=rows, covariance=like.covariance), Campaign(measurements=alone)
        for way, campaign in zip(found, ways, strict=True):
            known = fit_campaign(arm, campaign, starts=2)
            off = known.best.theta - truth
            inside = np.abs(off) < 1.96 * known.information.sd
            joint = off @ np.linalg.solve(known.information.covariance, off)
            found[way].append([*inside, joint < chi2.ppf(0.95, len(off)), known.p_value > 0.05])
    print(f"{machine()}, commit {commit()}")
    for way, each in found.items():
        each = np.array(each)
        for word, own in (("intervals", each[:, :-2]), ("together", each[:, -2]), ("chi-squared", each[:, -1])):
            low, high = binom.ppf([0.005, 0.995], own.size, 0.95)
            print(f"{way}: {word} {own.sum()} of {own.size}; 99 % band {low:.0f} to {high:.0f}")


def grouped(campaign: Campaign) -> tuple[Campaign, np.ndarray]:
    """Return a campaign whose rows of a posture are a group, and the root of their correlation."""
    postures, count = list(campaign.postures), {}
    rows = []
    for m in campaign:
        count[m.posture] = count.get(m.posture, 0) + 1
        rows.append(replace(m, group=str(postures.index(m.posture)), member=count[m.posture]))
    sizes = [count[posture] for posture in postures]
    matrices = [np.full((n, n), SHARED) + (1 - SHARED) * np.eye(n) for n in sizes]
    groups = tuple(Group(str(i), tuple(map(tuple, R.tolist()))) for i, R in enumerate(matrices))
    same = np.array([[a.group == b.group for b in rows] for a in rows])
    whole = np.where(np.eye(len(rows), dtype=bool), 1.0, np.where(same, SHARED, 0.0))
    return Campaign(measurements=tuple(rows), covariance=Covariance(groups)), np.linalg.cholesky(whole)


if __name__ == "__main__":
    main()
