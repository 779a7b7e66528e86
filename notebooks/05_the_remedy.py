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
# # The remedy
#
# Figures 9 and 10 of the paper, and what follows from them: which change of the arm makes it quieter? As in notebook 04
# the figures themselves are lost to us, and only the paper's words are left. Where our trends disagree, we look for the
# reason, and there is one.
#
# **What all amplitudes here rest on** is assumed, not measured: drives, stroke, and eccentricity (0.5 kg at 8 mm in
# each drive, all in phase), besides lengths and masses. Sizes in mm are proportional to the eccentricity, so limits of
# 0.4 or 0.5 mm are examples. Trends do not depend on it, but on the speeds of the pulleys, as will be seen.
#
# X is along the unfolded arm, Y to the left, Z up. Everything is an extension at 10 % of full speed. Run it in the
# folder `notebooks`.

# %%
from pathlib import Path

import matplotlib
import numpy as np
from matplotlib.figure import Figure

import ident

# %matplotlib inline

style = {"axes.spines.top": False, "axes.spines.right": False, "axes.axisbelow": True, "axes.labelsize": 9}
style |= {"legend.frameon": False, "legend.fontsize": 8, "xtick.labelsize": 8, "ytick.labelsize": 8}
matplotlib.rcParams.update(style)
BLUE, ORANGE, GREEN, PINK, GREY = "#0072B2", "#D55E00", "#009E73", "#CC79A7", "#555555"
TITLE = {"fontsize": 10, "fontweight": "bold", "loc": "left"}

data = Path("..") / "data" / "lcd_arm"
arm_file = ident.read_arm(data / "arm.toml")
arm = arm_file.arm

# %% [markdown]
# ## Figures 9 and 10
#
# Five numbers, each alone over 21 values: torsional stiffness of each joint from 0.4 to 2.5 times what it is, the mass
# centre of the hand bracket over its length, that of the fingers from 1.0 to 2.2 m. In all 106 simulations, in one
# batch of one compiled program. 200 samples a second are enough: the peak of a vibration of 4 Hz is missed by 0.2 % at
# most.

# %%
TORSION = [f"joint{j}.k_tors" for j in (1, 2, 3)]
CENTRES = {"bracket.com.x": (0.0, 0.29), "fingers.com.x": (1.0, 2.2)}
PATHS = (*TORSION, *CENTRES)

vary = dict.fromkeys(TORSION, ("0.4x", "2.5x", 21)) | {path: (*ends, 21) for path, ends in CENTRES.items()}
swept = ident.sweep(arm_file, ident.SweepOptions(speed=10, rate=200.0, vary=vary))
present = swept.present
print("as it is: " + ", ".join(f"{d} {1e3 * a:.3f} mm" for d, a in zip("XYZ", present, strict=True)))

# %% [markdown]
# Figure 9, torsional stiffness, and Figure 10, mass centres:

# %%
swept.figures()[""]

# %% [markdown]
# What the paper says of its own figures: the largest amplitude becomes smaller with a stiffer joint 1, with softer
# joints 2 and 3, and with both mass centres moved in the positive direction. We take that as outwards. It gives no size
# and no direction of vibration. Beside it, each of our curves over its whole range and about the present value (a
# factor of 1.25, or 15 % of the range, either way); less than 5 % counts as flat.

# %%
PAPER = dict(zip(PATHS, ("falls", "rises", "rises", "falls", "falls"), strict=True))


def verdict(shape, path):
    if shape in ("falls", "rises"):
        return "agrees" if shape == PAPER[path] else "opposite"
    return "flat" if shape == "flat" else "in part"


about, whole = {}, {}
print(f"{'':15s}paper      amplitude [mm]            whole range            about the present")
print(f"{'':15s}           first  least  largest  last")
for path, shapes in swept.trends.items():
    for d in "XYZ":
        t, here = shapes[d.lower()]
        whole[path, d], about[path, d] = verdict(t.shape, path), verdict(here.shape, path)
        sizes = "".join(f"{1e3 * a:7.3f}" for a in (t.ends[0], t.least[1], t.largest[1], t.ends[1]))
        words = f"{t.shape:8s} {verdict(t.shape, path):9s}     {here.shape:6s} {verdict(here.shape, path)}"
        print(f"{path:14s} {d} {PAPER[path]:6s} {sizes}   {words}")
assert [about[path, "Y"] for path in PATHS] == ["agrees", "opposite", "opposite", "opposite", "opposite"]

# %% [markdown]
# Verdict, where words and numbers meet:
#
# | quieter, says the paper, with | X, at present 0.06 mm | Y, at present 0.71 mm | Z, at present 0.19 mm |
# |---|---|---|---|
# | joint 1 stiffer | in part: agrees about here | **agrees** about and above here; largest at 0.69x | flat about here |
# | joint 2 softer | opposite | **opposite** up to 1.2x, agrees above | opposite up to 1.2x, agrees above |
# | joint 3 softer | agrees, by 0.03 mm over all | **opposite** | flat |
# | bracket's mass centre outwards | opposite, by 4 um over all | **opposite** | agrees, 0.19 to 0.17 mm |
# | fingers' mass centre outwards | in part | **opposite** above 1.4 m, agrees below | agrees up to 1.9 m |
#
# Y is the largest, by far and everywhere, so the "largest amplitude" is that in Y (notebook 04 gives a reason to take
# it for the paper's X). There one of five agrees about the present.

# %% [markdown]
# ## Why
#
# Notebook 04 has found what shakes Y: pulleys 1 and 3 hold 4 Hz, and for more than a second, from 5.8 to 7.2 s, the
# lateral torsion mode stands just above them, 5.6 % at 6.7 s. So the suspicion: what a parameter does to Y is what it
# does to that distance. The test: the mode's frequency at that posture for every arm of the sweeps, and the amplitude
# in Y against it.

# %%
DWELL = 6.74  # s, where the frequencies are nearest
PULLEY = 4.0  # Hz, that pulleys 1 and 3 hold


def at_work(arm):
    """Simulate an arm; all with one step, so that one compiled program serves them."""
    return ident.simulate(arm, ident.SimulateOptions(speed=10, rate=200.0, step=0.0125, method="fast"))


simulated = at_work(arm)
posture = np.degrees(simulated.posture[:, np.abs(simulated.time - DWELL).argmin()])


def lateral(arm):
    """Frequency of lateral torsion 1 [Hz] at that posture."""
    modes = ident.predict(arm, ident.PredictOptions(posture=(tuple(posture),), modes=3)).table()
    return next(mode["frequency"] for mode in modes if "lateral" in mode["label"])


mode, size = {}, {}
for path, sweep in swept.sweeps.items():
    mode[path] = np.array([lateral(arm.replace({path: value})) for value in sweep.axes[0].values[::2]])
    size[path] = 1e3 * sweep.amplitude[1, ::2]
as_it_is = lateral(arm)
print(f"as it is: {as_it_is:.2f} Hz; the pulleys: {PULLEY:g} Hz")

# %%
figure = Figure(figsize=(8.0, 4.4), layout="constrained")
panel = figure.subplots()
for path, colour, marker in zip(PATHS, (BLUE, ORANGE, GREEN, PINK, "black"), "os^Dv", strict=True):
    panel.plot(mode[path], size[path], color=colour, marker=marker, markersize=4, linewidth=1.2, label=path)
hollow = {"color": "black", "marker": "o", "markersize": 11, "markerfacecolor": "none", "linestyle": ""}
panel.plot(as_it_is, 1e3 * present[1], label="present", **hollow)
panel.axvline(PULLEY, color=GREY, linewidth=0.8, linestyle=":", label="pulleys 1 and 3")
panel.set_xlabel(f"lateral torsion 1 at {DWELL} s [Hz]")
panel.set_ylabel("peak in Y [mm]")
panel.set_ylim(0)
panel.set_title("One curve for all five, as long as the dwell decides", **TITLE)
figure.legend(loc="outside lower center", ncols=4)
figure

# %%
grid = np.linspace(4.08, 4.30, 12)
same = {}
for path in PATHS:
    order = np.argsort(mode[path])
    same[path] = np.interp(grid, mode[path][order], size[path][order], left=np.nan, right=np.nan)
apart = np.nanmax([np.abs(same[path] / same[TORSION[0]] - 1) for path in PATHS])
falls = 1 - same[TORSION[0]][-1] / same[TORSION[0]][0]
print(f"4.08 to 4.30 Hz: all five within {apart:.0%} of joint 1's curve, which falls by {falls:.0%}")
assert apart < 0.12

# %% [markdown]
# So it is. (It is largest below 4 Hz, where the pulleys, as they slow down, come to the mode once more.) About the
# present design it does not matter *what* is changed, only what that does to one frequency: stiffer joints raise it,
# mass centres further out lower it, and Y falls as it rises. From this alone follows a sign that the paper's words
# cannot have: stiffening any joint raises the mode, so one resonance cannot ask for a stiffer joint 1 and softer joints
# 2 and 3. Something else must have decided there, and above 4.35 Hz, where our curves part, something else does: the
# largest vibration is no longer that of the dwell.

# %%
PARTS = {"start, to 4.5 s": (0, 4.5), "dwell, to 7.7 s": (4.5, 7.7), "stop and after": (7.7, 99)}
cases = {
    "joint 1 x 0.69": ("joint1.k_tors", 0.69),
    "as it is": ("joint1.k_tors", 1.0),
    "joint 1 x 1.44": ("joint1.k_tors", 1.44),
    "joint 2 x 1.2": ("joint2.k_tors", 1.2),
    "joint 2 x 2.5": ("joint2.k_tors", 2.5),
}
print("peak in Y [mm]  " + "".join(f"{name:>18s}" for name in PARTS) + "     largest at")
time, largest = simulated.time, {}
for name, (path, factor) in cases.items():
    y = np.abs(at_work(arm.replace({path: factor * float(arm.get(path))})).vibration[1])
    largest[name] = [1e3 * y[(time >= a) & (time < b)].max() for a, b in PARTS.values()]
    print(f"{name:16s}" + "".join(f"{p:18.3f}" for p in largest[name]) + f"{time[y.argmax()]:13.2f} s")
assert np.argmax(largest["as it is"]) == 1
assert np.argmax(largest["joint 2 x 2.5"]) == np.argmax(largest["joint 1 x 1.44"]) == 0

# %% [markdown]
# At the start pulley 2 passes the mode, quickly. A stiffer joint 1 lowers that peak too, a stiffer joint 2 raises it.
# So beyond the dwell the trends are others, and which ones are seen depends on which side of some 4.35 Hz the design
# lies.
#
# Which side, is not known. Our arm's lateral frequency is the 4.12 Hz that the paper computed, but it measured 4.38 Hz;
# and the pulleys' 4 Hz hang on the ratio and the stroke that we assume. Two looks at the other side, neither of them
# tuned: all torsional stiffnesses by the one factor that gives the measured frequency (in the mean, 1.13), and the same
# distance by pulleys that turn so much slower. Each number 25 % up and down, mass centres 40 and 100 mm out and in:

# %%
factor = (4.38 / 4.12) ** 2
measured = arm.replace({path: factor * float(arm.get(path)) for path in TORSION})
slow = 4.12 / 4.38


def trends(arm, ratio=1.0):
    """Peaks in Y [mm] as it is, and with each number down and up, at another speed."""
    vary = dict.fromkeys(TORSION, ("0.8x", "1.25x", 2))
    for path, by in zip(CENTRES, (0.04, 0.10), strict=True):
        centre = float(arm.get(path))
        vary[path] = (centre - by, centre + by, 2)
    clock = {"speed": 10 * ratio, "rate": 200 * ratio, "dwell": 2 / ratio}
    result = ident.sweep(arm, ident.SweepOptions(vary=vary, **clock))
    down, up = np.array([1e3 * sweep.amplitude[1] for sweep in result.sweeps.values()]).T
    return 1e3 * result.present[1], down, up


sides = {"10 %, 4.12 Hz": (arm, 1.0), "10 %, 4.38 Hz": (measured, 1.0), f"{10 * slow:.1f} %, 4.12 Hz": (arm, slow)}
signs = {}
print("peak in Y [mm]            as it is" + "".join(f"{path:>21s}" for path in PATHS))
for name, (which, ratio) in sides.items():
    now, down, up = trends(which, ratio)
    goes = ["falls" if b < a else "rises" for a, b in zip(down, up, strict=True)]
    signs[name] = [way == PAPER[path] for path, way in zip(PATHS, goes, strict=True)]
    ways = "".join(f"{f'{a:.3f} -> {b:.3f}':>21s}" for a, b in zip(down, up, strict=True))
    print(f"{name:16s}{now:18.3f}{ways}   {sum(signs[name])} of 5 as in the paper")
assert [sum(agreed) for agreed in signs.values()] == [1, 5, 5]

# %% [markdown]
# **With the lateral frequency where it was measured, all five trends in Y are those of the paper**; with pulleys 6 %
# slower likewise. That does not show that this is the paper's reason. Its own model had 4.12 Hz, and its drives are
# unknown to us. It does show that the paper's guideline and our trends are no contradiction: one holds clear of the
# dwell, the other near it; and that the sign of a trend is no property of the arm alone. Whoever takes advice on
# stiffness from here, or from there, should know the pulley speeds and the frequency to a few percent first. Clear of
# the dwell "softer joints 2 and 3" is right but weak, a few percent of Y for 20 % of stiffness; near it, it is the way
# into the resonance.

# %% [markdown]
# ## The redesign
#
# The three torsional stiffnesses together, each between half and twice what it is, for a limit of 0.4 mm. The change
# norm is the size of the change: 1 for one stiffness doubled.

# %%
LIMIT = 0.4  # mm
change = dict.fromkeys(TORSION, ("0.5x", "2x"))
options = ident.DesignOptions(speed=10, dwell=2.0, rate=200.0, change=change, limit=LIMIT, starts=2)
redesign = ident.design(arm_file, options).study.design
best, least = redesign.best, redesign.minimum_change

print("                     largest          factor of joint       change   first      deflection")
print("                    X, Y, Z [mm]     1      2      3          norm   frequency")


def tell(name, place):
    sizes = " ".join(f"{1e3 * a:.3f}" for a in place.amplitude)
    factors = "".join(f"{f:7.3f}" for f in np.exp(place.changes))
    standing = f"{place.frequency:9.2f} Hz{1e3 * place.deflection:10.2f} mm"
    print(f"{name:15s}{sizes:>18s}{factors}{place.change_norm:9.2f}{standing}")


tell("present", redesign.present)
tell("minimum change", least)
tell("best", best)
assert 1e3 * least.largest <= LIMIT * 1.001
assert 0.25e-3 < best.largest < 0.28e-3
assert (np.sign(best.changes) == [1, -1, -1]).all()

# %%
figure = Figure(figsize=(8.0, 3.8), layout="constrained")
left, right = figure.subplots(1, 2)
norm = [place.change_norm for place in redesign.curve]
for d, (name, colour) in enumerate(zip("XYZ", (BLUE, ORANGE, GREEN), strict=True)):
    sizes = [1e3 * place.amplitude[d] for place in redesign.curve]
    left.plot(norm, sizes, "o-", color=colour, markersize=4, linewidth=1.2, label=name)
left.axhline(LIMIT, color=GREY, linewidth=0.8, linestyle=":", label="limit")
left.plot(least.change_norm, 1e3 * least.largest, "s", color="black", markersize=6, label="minimum change for 0.4 mm")
left.plot(0, 1e3 * redesign.present.largest, label="present", **hollow | {"markersize": 10})
left.set_ylabel("peak [mm]")
left.set_ylim(0)
left.set_title("What a change buys", **TITLE)
for j, colour in enumerate(("#000000", "#777777", "#BBBBBB")):
    factors = np.exp([place.changes[j] for place in redesign.curve])
    right.plot(norm, factors, "o-", color=colour, markersize=4, label=f"joint {j + 1}")
right.set_ylabel("torsional stiffness / present")
right.set_title("What is changed", **TITLE)
for panel in (left, right):
    panel.set_xlabel("change norm [-]")
figure.legend(loc="outside lower center", ncols=5)
figure

# %% [markdown]
# The best design brings 0.71 mm to 0.26 mm, with joint 1 at its bound of 2x, joint 2 at 0.74x and joint 3 as good as it
# is. The least change that meets 0.4 mm: joint 1 at 1.32x, joint 2 at 0.89x, joint 3 at 0.95x. The lowest frequency
# rises from 4.12 to 4.42 or 4.76 Hz. The deflection stays at 26.3 mm: it is largest on the unfolded arm, whose weight
# loads no torsion.
#
# Stiffer joint 1, softer joints 2 and 3: **that is the paper's guideline**, though a softer joint 2 or 3 alone does
# harm at present. The curve shows how both go together. The first step is away from the resonance, with all stiffnesses
# up; then the start of the stroke decides, and joints 2 and 3 are worth softening.
#
# The paper's second group, mass centres, after either design and as it is:

# %%
designs = {"as it is": {}, "minimum change": least.values, "best": best.values}
print("peak in Y [mm], mass centre in -> out    " + "".join(f"{path:>18s}" for path in CENTRES))
for name, values in designs.items():
    now, inwards, outwards = trends(arm.replace(values))
    ways = "".join(f"{f'{a:.3f} -> {b:.3f}':>18s}" for a, b in zip(inwards[3:], outwards[3:], strict=True))
    print(f"{name:24s}{now:17.3f}{ways}")

# %% [markdown]
# As it is, outwards harms. After either design neither way helps by itself: start and dwell are balanced, and what
# lowers one peak raises the other. So the paper's order, torsion first, mass centres second, is ours too: after the
# first there is little left for the second alone. What both give together `ident diagnose` tries.

# %% [markdown]
# ## All of it in one command
#
#     ident diagnose data/lcd_arm/campaign.csv
#
# goes from the measurements to the advice: posterior of the stiffnesses, resonances, vibration against a limit, what it
# depends on, remedies (torsion, mass centres, both, another speed) judged by the posterior's draws, and a proof by the
# exact equations and by draws that nothing was chosen by. For the shipped campaign, which is synthetic, and a limit of
# 0.5 mm it answers: too much, 0.71 mm; make joint 1 stiffer in torsion by 1.16 and leave the others within 2 %, which
# brings 0.47 mm, and 98 % of the fresh draws, as many as settle it, keep the limit. The same story with what is at hand
# here, the fit in place of the posterior, and joint 1 alone:

# %%
fit = ident.fit(arm_file, ident.read_campaign(data / "campaign.csv"))
REMEDY, ALLOWED = 1.15, 0.5
stiffer = fit.fitted_arm.replace({"joint1.k_tors": REMEDY * fit.parameters["joint1.k_tors"]})
both = [1e3 * at_work(one).vibration[1] for one in (fit.fitted_arm, stiffer)]
before, after = (np.abs(trace).max() for trace in both)
print(f"peak in Y: {before:.2f} mm as fitted, {after:.2f} mm with joint 1 {REMEDY} times as stiff in torsion")
assert before > ALLOWED > after

# %%
picture = Figure(figsize=(12.0, 3.7), dpi=100, layout="constrained")
first, second, third = picture.subplots(1, 3, width_ratios=(1, 1.25, 1.25))
names = list(fit.intervals)
ratio = np.array([100 * (np.array(fit.intervals[name]) / fit.parameters[name] - 1) for name in names])
first.hlines(range(len(names)), ratio[:, 0], ratio[:, 1], color=BLUE, linewidth=5, alpha=0.35)
first.plot(np.zeros(len(names)), range(len(names)), "o", color=BLUE, markersize=5)
kinds = {"k_bend": "bending", "k_tors": "torsion"}
first.set_ylim(len(names) - 0.4, -0.6)
first.set_yticks(range(len(names)), [f"joint {name[5]}, {kinds[name.split('.')[1]]}" for name in names])
first.tick_params(axis="y", length=0)
first.grid(axis="y", color="#EEEEEE", linewidth=0.8)
first.spines["left"].set_visible(False)
first.set_xlabel("95 % interval about the fitted stiffness [%]")
first.set_title("1  Fit: how stiff is each joint?", fontsize=10, fontweight="bold", loc="left")
titles = (f"2  At work: {before:.2f} mm, too much", f"3  Joint 1 stiffer by 15 %: {after:.2f} mm")
for panel, trace, title in zip((second, third), both, titles, strict=True):
    panel.axvspan(5.76, 7.16, color="#EEEEEE", zorder=0)
    panel.plot(time, trace, color=BLUE, linewidth=0.7)
    for side in (-1, 1):
        panel.axhline(side * ALLOWED, color=ORANGE, linewidth=1.2, linestyle="--")
    panel.text(0.1, ALLOWED + 0.03, f"limit {ALLOWED:g} mm", fontsize=8, color=ORANGE)
    panel.set_xlim(time[0], time[-1])
    panel.set_ylim(-0.95, 0.85)
    panel.set_xlabel("time [s]")
    panel.set_title(title, fontsize=10, fontweight="bold", loc="left")
second.set_ylabel("sideways vibration of the finger end [mm]")
second.text(6.46, -0.93, "pulleys 1 and 3\nnear resonance", fontsize=8, color=GREY, ha="center")
picture

# %% [markdown]
# This is the picture of the README. Which stiffness, how sure, how far it shakes, what cures it: the first panel rests
# on measurements (here synthetic ones), the other two on assumed drives, stroke and eccentricity as well. For a real
# robot put those of its data sheets into the arm file, and compare one measured trace (`ident simulate --trace`) before
# anything is bought.
