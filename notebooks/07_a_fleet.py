# ---
# jupyter:
#   jupytext:
#     formats: ipynb,py:percent
#     text_representation:
#       extension: .py
#       format_name: percent
#   kernelspec:
#     display_name: Python 3
#     language: python
#     name: python3
# ---

# %% [markdown]
# # A fleet of two hundred robots
#
# Two hundred robots of one design, sixteen frequencies and four deflections each. How do their stiffnesses spread,
# which robot is faulty, and what does the fleet say about the next robot before it is measured?
#
# **All measurements in this notebook are synthetic** (`data/fleet/generate.py`): a spread of 6 % in bending and 10
# % in torsion, and five robots with one torsional stiffness 40 % lower, as from a loose bolt. So the truth is
# known.
#
# Run it in the folder `notebooks`.

# %%
import runpy
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

import ident

# %matplotlib inline

folder = TemporaryDirectory()
robots = Path(folder.name) / "robots"
generate = runpy.run_path(str(Path("..") / "data" / "fleet" / "generate.py"))["generate"]
faulty = generate(robots)
faulty

# %% [markdown]
# ## From files to a population
#
# Each robot is fitted under a wide prior. The likelihoods, with the prior divided out, determine the population. A
# second call would reuse the fits in `folder`.

# %%
options = ident.FleetOptions(starts=4)
result = ident.fleet(robots, options=options, folder=Path(folder.name) / "fits")
print(result.report().replace(f"{folder.name}/", ""))

# %% [markdown]
# ## Who was found
#
# A robot stands out if a stiffness differs so much from the others' that the chance is below 3 % in a healthy
# fleet. Here a loose bolt lowers a stiffness by five times the spread of healthy robots. A robot that was weak
# before is found at once; one that was strong looks like a weak one.

# %%
for name, changes in result.standing_out.items():
    words = ", ".join(f"{stiffness} {100 * change:+.0f} %" for stiffness, change in changes.items())
    print(f"{name}: {words}; {'faulty in ' + faulty[name] if name in faulty else 'false alarm'}")
print("missed:", [name for name in faulty if name not in result.standing_out] or "none")

# %%
figure = result.figures()[""]
figure

# %% [markdown]
# ## The first of them alone
#
# `ident fit` on its own data has no objections. The robot stands out only in comparison with the others.

# %%
first = next(iter(result.standing_out))
own = ident.fit(robots / "arm.toml", robots / f"{first}.csv", ident.FitOptions(starts=2))
print(own.doubts or "no objections to this fit")
figure = own.figures()[""]
figure

# %% [markdown]
# ## Is the population right?
#
# The true spread and the inferred one, without the five.

# %%
made_with = {"k_bend": 0.06, "k_tors": 0.10}
population = result.fleet.population
for name, draws in zip(result.fleet.names, population.sd.T, strict=True):
    low, high = np.quantile(draws, [0.025, 0.975])
    made = made_with[name.rpartition(".")[2]]
    print(f"{name}: spread {np.median(draws):.3f}, 95 % {low:.3f} to {high:.3f}; made with {made}")

# %% [markdown]
# ## The next robot
#
# One tap test: the four lowest frequencies at one posture, six unknown stiffnesses. With the fleet's prior, each is
# known at least as well as the robots are alike, and some better.

# %%
campaign = ident.read_campaign(robots / "robot200.csv")
tap = ident.Campaign(measurements=tuple(m for m in campaign if m.kind == "frequency")[:4])
fit = ident.fit(robots / "arm.toml", tap, ident.FitOptions(starts=2, prior=dict(result.priors)))
print(f"{'sd of ln(stiffness)':22s}{'before':>9s}{'after the tap':>15s}")
for name, before in zip(result.fleet.names, population.next_sd, strict=True):
    print(f"{name:22s}{before:9.3f}{fit.sd[name]:15.3f}")
folder.cleanup()
figure = fit.figures()[""]
figure
