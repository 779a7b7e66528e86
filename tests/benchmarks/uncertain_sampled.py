"""Uncertain numbers integrated out, beside the same sampled: `python tests/benchmarks/uncertain_sampled.py`.

The shipped campaign, with masses and an offset of the paper's arm that are not exactly known.
"""

import argparse
from unittest.mock import patch

import jax

jax.config.update("jax_enable_x64", True)

from pathlib import Path

import numpy as np
from timing import commit, machine

from ident.description.file import read_arm
from ident.identify.fit import fit_campaign
from ident.identify.unknowns import Unknowns
from ident.inference import sample as sampling
from ident.inference.posterior import posterior
from ident.measure import read_campaign

DATA = Path(__file__).parents[2] / "data" / "lcd_arm"
WIDTHS = {"link1.mass": "3%", "link2.mass": "5%", "bracket.mass": "3%", "joint2.offset.x": "2mm"}


def main() -> None:
    """Print how far means and standard deviations are apart."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--ess", type=float, default=4000.0)
    settings = sampling.Settings(target_ess=parser.parse_args().ess)
    arm, campaign = read_arm(DATA / "arm.toml").arm, read_campaign(DATA / "campaign.csv")
    fit = fit_campaign(arm, campaign, Unknowns(uncertain=WIDTHS), starts=4)
    target = posterior(fit.problem)
    out = sampling.sample(fit, target, settings)
    with patch.object(sampling, "linear_nuisances", lambda fit, seed: ()):
        inside = sampling.sample(fit, target, settings)
    one, other = out.draws(), inside.draws()
    print(f"{machine()}, commit {commit()}")
    print(f"integrated out, with what is not linear [sd]: {out.marginalised}; sampled: {inside.marginalised or 'all'}")
    print(f"means apart [sd]: {np.round((one.mean(0) - other.mean(0)) / other.std(0), 3).tolist()}")
    print(f"ratio of standard deviations: {np.round(one.std(0) / other.std(0), 3).tolist()}")
    for each in (out, inside):
        d = each.diagnosis[0]
        print(
            f"bulk ESS {d.bulk.min():.0f}, R-hat {d.rhat.max():.4f}, {each.settings.walkers} walkers, {d.steps} steps"
        )


if __name__ == "__main__":
    main()
