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
# # The arm, and what Table 1 can tell about it
#
# The paper gives six joint stiffnesses of an arm that carries LCD glass, and the three numbers they were found
# from: two natural frequencies and one static deflection. This notebook asks what three numbers say about six.
#
# Run it in the folder `notebooks`.

# %%
from pathlib import Path

import ident

# %matplotlib inline

data = Path("..") / "data" / "lcd_arm"
arm_file = ident.read_arm(data / "arm.toml")
arm = arm_file.arm

# %% [markdown]
# ## The arm
#
# Three vertical joints. Each is a bushing with a bending stiffness (`k_bend`, the same in two directions) and a
# torsional stiffness about the joint axis (`k_tors`); links and fingers are rigid. Stiffness and damping are the
# paper's. The paper gives no lengths and masses: they are those of an arm of this class, and three of them were
# calibrated so that the paper's stiffnesses give the paper's computed values. The arm file states the origin of
# every number (of a vector as a whole).

# %%
for origin in ("paper", "calibrated", "assumed"):
    paths = [path for path, source in arm_file.origins.items() if source == origin]
    print(f"{origin:10s} {len(paths):3d} numbers, such as {', '.join(paths[:4])}")

# %% [markdown]
# ## Its modes, and Table 1
#
# Table 1 computes 4.80 Hz in bending, 4.12 Hz in torsion, and 26.3 mm at the finger end. So does the model:

# %%
unfolded = ident.predict(arm)
print(unfolded)

# %%
ident.predict(arm, ident.PredictOptions(modes=4)).figures()[""]

# %% [markdown]
# While the hand moves straight, q = alpha (1, -2, 1), the two lowest branches approach each other and cross near 66
# degrees. So a measured frequency belongs to a mode by its shape, not by its rank. The two upper branches do not
# cross: they exchange their shapes, and in between their names are ambiguous.

# %%
straight = tuple((alpha, -2.0 * alpha, alpha) for alpha in range(81))
ident.predict(arm, ident.PredictOptions(posture=straight, modes=4)).frequency_figure()

# %% [markdown]
# ## The fit to the three measured numbers
#
# On the robot the paper measured 4.38 Hz, 4.38 Hz and 22.0 mm. It gives no uncertainties; the campaign file assumes
# 0.5 % and 2 %. Each stiffness has a weak prior: 95 % within a factor of seven of the arm file's value.

# %%
table_1 = ident.fit(arm, ident.read_campaign(data / "table1.csv"))
print(table_1)

# %%
table_1.figures()[""]

# %% [markdown]
# ### Three numbers determine three combinations
#
# The deflection and the bending frequency depend on the three bending stiffnesses, the torsion frequency on the
# three torsional ones. They determine three combinations. In the other three the arm may change without moving a
# measured number: a softer joint 1 in torsion and a stiffer joint 2 give the same 4.38 Hz. There the fit prints the
# prior's choice, not the robot's. Here is such a change: joint 2 twice as stiff in torsion, joint 1 softer to
# compensate.

# %%
fitted = table_1.parameters


def torsion(factor1: float, factor2: float) -> float:
    """Return the torsion frequency [Hz] with other torsional stiffnesses of joints 1 and 2."""
    changed = {"joint1.k_tors": factor1 * fitted["joint1.k_tors"], "joint2.k_tors": factor2 * fitted["joint2.k_tors"]}
    result = ident.predict(arm, ident.PredictOptions(set={**fitted, **changed}, modes=3))
    return result.frequencies[0][result.labels[0].index("lateral torsion 1")]


before = torsion(1.0, 1.0)
low, high = 0.3, 1.0
for _ in range(30):
    middle = (low + high) / 2
    low, high = (middle, high) if torsion(middle, 2.0) < before else (low, middle)

hertz = torsion(middle, 2.0)
print(f"joint 2 twice as stiff in torsion, joint 1 at {middle:.3f} of its stiffness: {hertz:.3f} Hz, as before")
change = 1.1 ** table_1.trade_offs["joint2.k_tors"]["joint1.k_tors"] - 1
print(f"for small changes, from the report: joint 2 by +10 %, joint 1 by {100 * change:+.1f} %")

# %% [markdown]
# ### The three numbers contradict each other
#
# Leave the deflection out: the two frequencies then predict it.

# %%
deflection = table_1.cross_predictions["deflection"]
print(f"predicted from the frequencies and the weak prior: {1e3 * deflection.predicted[0]:.1f} mm")
print(f"measured: {1e3 * deflection.measured[0]:.1f} mm, {abs(deflection.z[0]):.1f} standard deviations apart")

# %% [markdown]
# 31.6 mm against 22.0 mm: noise of 2 % does not explain that. A mass on a spring deflects by g / omega^2, whatever
# the spring. A chain adds a factor of order one that depends on masses and lengths, and only slightly on the
# stiffnesses as long as these stay near Table 1. So 4.38 Hz and 22.0 mm do not belong to one arm with these masses
# and lengths. The paper's own fit misses the frequency by +10 % and the deflection by +20 %. This fit gets within
# two sigma of all three, but only with a joint 1 thirteen times as stiff as the paper's and a joint 3 a quarter as
# stiff. Residuals alone would have hidden the contradiction.
#
# The contradiction amounts to 4.1 standard deviations with a prior that allows a factor of 7 each way. It depends
# on this prior: with one twice as wide, absurd stiffnesses are less absurd, and 2.4 remain.
#
# This is a *model* discrepancy: frequency squared times deflection is too small. Check first the load under which
# the deflection was measured (was it, or the mass, less than when the arm vibrated?), then mass centres and
# lengths. Drives that stiffen under load do not help: the arm vibrates about its loaded state, where the tangent of
# such a spring is steeper than its secant, which makes that product larger.

# %% [markdown]
# ## What would be enough
#
# `campaign.csv` is synthetic: computed with this arm, with noise of 0.5 % on frequencies and 2 % on deflections.
# Four frequencies and the deflection at four postures are twenty numbers. They determine all six stiffnesses
# without the prior, and the kinds agree.

# %%
enough = ident.fit(arm, ident.read_campaign(data / "campaign.csv"))
print(enough)

# %%
enough.figures()[""]

# %% [markdown]
# The arm file's stiffnesses are the true ones here. Was that an easy start? Begin with every stiffness about a
# third off: the same twenty numbers lead to the same place. The remaining error is the noise.

# %%
wrong = arm.replace({name: float(arm.get(name)) * (1.35 if i % 2 else 0.7) for i, name in enumerate(fitted)})
again = ident.fit(wrong, ident.read_campaign(data / "campaign.csv"))
for name, value in again.parameters.items():
    truth = float(arm.get(name))
    print(f"{name}: started at {float(wrong.get(name)) / truth:.2f} of the truth, found {value / truth:.3f}")
