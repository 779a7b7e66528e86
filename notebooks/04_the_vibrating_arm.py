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
# # The vibrating arm
#
# Figures 4 to 8 of the paper, with this model. The figures themselves are lost to us: of the measured and computed
# traces only what the text says of them is left. So each section puts our figure beside the paper's words, and ends in
# a verdict: does it agree, and if not, why.
#
# Ours, not the paper's, are all lengths and masses, the ratios of the drives, the stroke, and the mass eccentricities
# (0.5 kg at 8 mm in each drive, all in phase). Amplitudes at low speed are proportional to the last of these. They are
# of the right order by choice and prove nothing; frequencies, times and shapes do not depend on them.
#
# Directions: x along the unfolded arm, the way of the hand; y to the left; z up. The paper shows "X" and "Z", and does
# not say which horizontal direction X is. So all three are shown here.
#
# Run it in the folder `notebooks`.

# %%
from dataclasses import dataclass
from pathlib import Path

import matplotlib
import numpy as np
from IPython.display import HTML
from matplotlib.figure import Figure

import ident

# %matplotlib inline

style = {"axes.spines.top": False, "axes.spines.right": False, "axes.labelsize": 9, "legend.fontsize": 8}
matplotlib.rcParams.update(style | {"legend.frameon": False, "xtick.labelsize": 8, "ytick.labelsize": 8})

data = Path("..") / "data" / "lcd_arm"
arm_file = ident.read_arm(data / "arm.toml")
arm = arm_file.arm
AXES = ("X", "Y", "Z")
BLUE, ORANGE, GREEN, GREY = "#0072B2", "#D55E00", "#009E73", "#555555"

# %% [markdown]
# All strokes are sampled 2400 times, in 960 steps, and all but that at 10 % are followed over 4.2 times their duration:
# so one compiled program serves every speed.


# %%
def duration(arm, percent, profile="s-curve"):
    """Return the time of an extension [s]; the s-curve reaches its limits of speed, acceleration and jerk."""
    numbers = ("folded", "speed", "acceleration", "jerk")
    way, speed, acceleration, jerk = (float(arm.get(f"stroke.{name}")) for name in numbers)
    s_curve = way / speed + speed / acceleration + acceleration / jerk
    cycloid = max(2 * way / speed, np.sqrt(2 * np.pi * way / acceleration))
    return 100 / percent * {"s-curve": s_curve, "cycloid": cycloid}[profile]


def run(arm, percent=100.0, profile="s-curve", seconds=None, method="fast"):
    """Simulate an extension and what follows, on a clock that goes with its duration."""
    T = duration(arm, percent, profile)
    clock = {"dwell": (seconds or 4.2 * T) - T, "rate": 2400 / T, "step": T / 960 if method == "fast" else None}
    result = ident.simulate(arm, ident.SimulateOptions(speed=percent, profile=profile, method=method, **clock))
    assert np.isclose(result.arrival, T)
    return result


def column(result, name):
    """Return a size of the vibration in X, Y and Z."""
    return np.array([row[name] for row in result.table()])


def table(rows, head=AXES):
    print(f"{'':34s}" + "".join(f"{h:>12s}" for h in head))
    for name, values in rows.items():
        print(f"{name:34s}" + "".join(f"{v:12.3g}" for v in values))


low = run(arm, percent=10, seconds=12.0)
time, vibration = low.time, low.vibration
print(f"10 %: arrival after {low.arrival:.2f} s, {time[-1]:.0f} s at {1 / time[1]:.0f} samples a second")

# %% [markdown]
# ## Figure 4: natural frequencies and pulley frequencies at 10 %
#
# The paper: pulley 2 is close to the two lowest natural frequencies in some interval of time, so excessive vibration
# can occur there.

# %%
resonance = ident.resonance(arm, ident.ResonanceOptions(speed=10))
natural, met = resonance.branches, resonance.crossings
resonance.figures()[""]

# %%
for e in sorted(met, key=lambda e: e.start):
    what = "crosses it" if e.crossings else f"nearest {e.relative_distance:.1%}"
    print(
        f"{e.source!s:9s} within 10 % of {e.label!s:18s} {e.start:5.2f} to {e.end:5.2f} s, "
        f"{what:13s} at {e.time:.2f} s, {e.natural:.2f} Hz, {abs(e.rate):.2f} Hz/s, {e.built_up:4.0%} built up"
    )
of_2 = [e for e in met if e.source.pulley == 2]
assert {str(e.label) for e in of_2} == {"vertical bending 1", "lateral torsion 1"}
assert all(e.end - e.start < 0.4 for e in of_2)

# %% [markdown]
# Verdict: **agrees in words**. Pulley 2 comes near both lowest frequencies, twice each: while it speeds up, near 2 s,
# and while it slows down, near 8 s. But it *passes*, at some 4 Hz a second, and is within ten percent for a third of a
# second or less. In our arm the longer stay is that of pulleys 1 and 3: at their 4 Hz of steady speed they are close
# below the torsion mode for more than a second. Which of them shakes more is a question for the simulation. Each drive
# alone, the others balanced:

# %%
alone = {}
for j in (1, 2, 3):
    others = {f"drive{i}.eccentricity": 0.0 for i in (1, 2, 3) if i != j}
    alone[f"peak, only drive {j} eccentric [mm]"] = 1e3 * run(arm.replace(others), 10, seconds=12.0).peak
table(alone | {"peak, all three [mm]": 1e3 * low.peak})
assert alone["peak, only drive 2 eccentric [mm]"][2] == max(v[2] for v in alone.values())
assert alone["peak, only drive 3 eccentric [mm]"][1] == max(v[1] for v in alone.values())

# %% [markdown]
# Vertically it is pulley 2, as the paper says. Laterally drive 3, slow but far out, shakes at least as much, by the
# near-resonance of 4 Hz with the torsion mode. The paper's robot, with other speeds, need not share this.

# %% [markdown]
# ## Figures 5 and 6: vibration of the end point at 10 %
#
# The paper: shapes differ in detail between measurement and simulation, but the largest peaks are similar. No number is
# left of either. Ours, over the stroke and the dwell after it:


# %%
figure = Figure(figsize=(8.0, 5.6), layout="constrained")
panels = figure.subplots(3, 1, sharex=True)
for axes, name, trace in zip(panels, AXES, 1e3 * vibration, strict=True):
    axes.plot(time, trace, color=BLUE, linewidth=0.6, label="about the quasi-static position")
    axes.axvline(low.arrival, color=GREY, linewidth=0.8, linestyle=":", label="arrival")
    axes.set_ylabel(f"{name} [mm]")
panels[-1].set_xlabel("time [s]")
panels[0].set_title("Extension at 10 %: vibration of the end point", fontsize=10, fontweight="bold", loc="left")
panels[0].legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2)
figure

# %%
rows = {"peak [mm]": 1e3 * low.peak, "rms [mm]": 1e3 * column(low, "rms")}
when = column(low, "time_of_peak")
table(rows | {"time of the peak [s]": when})
passes = min(e.time for e in of_2 if str(e.label) == "vertical bending 1")
assert 0 < when[2] - passes < 1
assert low.peak[1] > 3 * low.peak[2] > 3 * low.peak[0]

# %% [markdown]
# Verdict: **cannot be judged**, for lack of traces. What can be said: there is a vertical vibration that is largest
# just after pulley 2 has passed the bending mode, and a larger horizontal one across the way of the hand. Along the
# way of the hand there is almost none, ten times less than across it. So if the paper's X shows a vibration worth a
# figure, then its X is likely the direction across the arm, our Y, or its arm is not ours. A measured trace would be
# put beside this one with `ident.simulate(..., trace=...)`.

# %% [markdown]
# ### The arm in motion
#
# The path of the end point, and one second of the strongest lateral vibration in slow motion.

# %%
low.path_figure([0.0, 2.5, 4.0, 5.5, 7.1, 9.7], factor=200)

# %%
HTML(low.animation(np.arange(6.75, 7.5, 0.035), factor=400, fps=9).to_jshtml())

# %% [markdown]
# ## Figure 7: spectra at 10 %
#
# The paper: in X both spectra agree well from 4 to 8 Hz; in Z the measured one has a peak near 9.5 Hz, outside of what
# the drives excite, whose cause was not found.

# %%
spectrum = ident.spectrum(low, arm=arm_file)
spectrum.figures()[""]

# %%
bands = {"1 to 3.5 Hz": (1.0, 3.5), "3.5 to 8.5 Hz": (3.5, 8.5), "9 to 10 Hz": (9.0, 10.0), "8.5 to 20 Hz": (8.5, 20.0)}
power = {name: np.square(list(spectrum.band_rms(*band).values())) for name, band in bands.items()}
whole = np.square(list(spectrum.band_rms(1.0, 20.0).values()))
table({f"share of power, {name} [%]": 100 * part / whole for name, part in power.items()})
for direction in "xyz":
    largest = spectrum.peaks(direction, low=1.0, high=20.0, count=3)
    lines = ", ".join(f"{line.frequency:.2f} Hz {1e3 * line.amplitude:.3f} mm" for line in largest)
    print(f"{direction.upper()}, largest lines: {lines}")
assert (power["3.5 to 8.5 Hz"] / whole > 0.8).all()
assert (power["9 to 10 Hz"] < 1e-4 * power["3.5 to 8.5 Hz"]).all()

# %% [markdown]
# Hann window over all 12 s, so 0.08 Hz between the lines. The bands are half a hertz wider than the paper's 4 to 8 Hz,
# because pulleys that hold 4 Hz and 8 Hz for four seconds stand on its very ends.
#
# Verdict: **agrees**. Nearly all of the vibration lies where the paper says. **Agrees too** in what is missing: as the
# paper's simulation, ours has nothing near 9.5 Hz. Notebook 04b looks for the reason.
#
# What a single spectrum hides, a spectrogram shows: pulley lines that come, stay and go, and the mode that rings on.

# %%
options = ident.SpectrumOptions(direction=("y",), spectrogram=True, segment=1.5, upto=12.0)
figure = ident.spectrum(low, options).figures()["y"]
figure.suptitle("Y at 10 %", fontsize=12, fontweight="bold")
axes = figure.axes[0]
for i, line in enumerate((":", "--")):
    axes.plot(natural.time, natural.median[i], color="black", linestyle=line, label=str(natural.labels[i]))
axes.legend(loc="upper right")
figure

# %% [markdown]
# ## Figure 8: full speed
#
# The paper: about 1 mm at most during the operation, about 0.1 mm at the stacking stage, around 4 s.

# %%
full = run(arm, percent=100)
rows = {
    "peak [mm]": 1e3 * full.peak,
    "peak after arrival [mm]": 1e3 * column(full, "residual"),
    "peak after 3.8 s [mm]": 1e3 * np.abs(full.vibration[:, full.time > 3.8]).max(1),
    "settling to 0.1 mm after arrival [s]": column(full, "settling_time"),
}
table(rows)
print(f"stroke of {full.arrival:.2f} s, followed for {full.time[-1]:.2f} s; inf: not settled by then")
assert 10 < 1e3 * full.peak.max() < 20

# %% [markdown]
# **Differs**: more than ten times the paper's 1 mm. The reason is the stroke that we assume, 120 deg/s, 600 deg/s^2 and
# 6000 deg/s^3: one second for 1.6 m. The paper's arm stacks around 4 s, so its stroke may well take nearly that long.
# Two ways to a slower stroke: the s-curve at a lower speed override, and a cycloid with a lower limit of acceleration.


# %%
@dataclass
class Tried:
    profile: str
    duration: float
    peak: np.ndarray
    after: np.ndarray
    hand: float


def tried(arm, percent=100.0, profile="s-curve"):
    result = run(arm, percent, profile)
    hand = np.abs(np.diff(result.path[0], 2)).max() / result.time[1] ** 2
    return Tried(profile, result.arrival, result.peak, column(result, "residual"), float(hand))


strokes = [tried(arm, percent) for percent in (100, 70, 50, 35, 25)]
for limit in (600, 140, 70, 35):
    strokes.append(tried(arm.replace({"stroke.acceleration": np.radians(limit)}), profile="cycloid"))

print(f"way of the hand: {np.ptp(full.path[0]):.2f} m")
print("profile   duration  hand's largest     peak [mm]               after arrival [mm]")
print("               [s]  acc. [m/s^2]      X      Y      Z         X      Y      Z")
for s in strokes:
    sizes = "   ".join("".join(f"{1e3 * v:7.2f}" for v in part) for part in (s.peak, s.after))
    print(f"{s.profile:8s} {s.duration:9.2f} {s.hand:13.2f} {sizes}")

# %%
figure = Figure(figsize=(8.0, 4.0), layout="constrained")
left, right = figure.subplots(1, 2, sharex=True)
for axes, field, goal in ((left, "peak", 1.0), (right, "after", 0.1)):
    for profile, marker in (("s-curve", "o"), ("cycloid", "s")):
        some = [s for s in strokes if s.profile == profile]
        for i, colour in enumerate((BLUE, ORANGE, GREEN)):
            sizes = [1e3 * getattr(s, field)[i] for s in some]
            style = {"color": colour, "marker": marker, "markersize": 4, "linestyle": "-" if marker == "o" else "--"}
            axes.loglog([s.duration for s in some], sizes, linewidth=1.0, **style)
    axes.axhline(goal, color=GREY, linewidth=0.8, linestyle=":")
    axes.set_xticks([1, 2, 3, 4], ["1", "2", "3", "4"])
    axes.minorticks_off()
    axes.set_yticks([0.01, 0.1, 1, 10], ["0.01", "0.1", "1", "10"])
    axes.set_autoscale_on(False)
    axes.set_xlabel("duration of the stroke [s]")
    axes.set_ylabel("largest vibration [mm]")
left.set_title("During the stroke", fontsize=10, fontweight="bold", loc="left")
right.set_title("After arrival", fontsize=10, fontweight="bold", loc="left")
for name, colour in zip(AXES, (BLUE, ORANGE, GREEN), strict=True):
    left.plot([], [], color=colour, label=name)
for name, marker, line in (("s-curve", "o", "-"), ("cycloid", "s", "--")):
    left.plot([], [], color="black", marker=marker, markersize=4, linestyle=line, label=name)
left.plot([], [], color=GREY, linestyle=":", linewidth=0.8, label="the paper's 1 mm and 0.1 mm")
figure.legend(loc="outside lower center", ncols=6)
figure

# %%
slow = [s for s in strokes if 3.5 < s.duration < 4.0]
assert len(slow) == 2
assert all(0.8 < 1e3 * s.peak.max() < 1.3 and 1e3 * s.after.max() < 0.4 for s in slow)
balanced = {f"drive{j}.eccentricity": 0.0 for j in (1, 2, 3)}
smooth = arm.replace({"stroke.acceleration": np.radians(35), **balanced})
calm = tried(smooth, profile="cycloid")
rows = {f"slowest cycloid, peak{w} [mm]": 1e3 * s.peak for w, s in (("", slow[1]), (", balanced", calm))}
rows |= {f"  after arrival{w} [mm]": 1e3 * s.after for w, s in (("", slow[1]), (", balanced", calm))}
table(rows)
assert calm.peak.max() < 0.5 * slow[1].peak.max()
assert 1e3 * calm.after.max() < 0.1
bending = natural.damping_ratio[[str(n) for n in natural.labels].index("vertical bending 1"), -1]
decay = 1 / (2 * np.pi * 4.8 * bending)
print(f"bending mode, unfolded: damping ratio {bending:.2%}, its vibration falls to a third in {1.1 * decay:.0f} s")
assert decay > 8

# %% [markdown]
# Verdict: **differs, and the assumed stroke is the reason; with a stroke of just under 4 s it agrees in the peak**:
# about 1 mm at most, whichever profile. The arm lags behind the acceleration a of its hand by about a / omega^2, a
# millimetre for each m/s^2 at these frequencies. A stroke of one second needs 20 m/s^2, one of nearly four 1 m/s^2.
# Of what is left then, more than half is the eccentricities' doing, as the balanced arm shows.
#
# After arrival our slow strokes keep some 0.3 mm, the paper's 0.1 mm is less. Two things decide. The pulleys pass the
# lowest modes while they slow down, just before arrival: balanced drives would leave less than 0.1 mm. And nothing
# takes away what is left: with the paper's 0.02 % in bending the vertical vibration needs ten seconds to fall to a
# third. 0.1 mm at the stacking stage can only be had by not exciting it, or with more damping than the paper's.
#
# What cannot be had together: pulleys at 4 to 8 Hz at a tenth of the speed *and* a stroke of nearly 4 s at full speed,
# as long as the override slows the whole stroke in proportion and the ratios are 120. Were full speed limited by a
# lower acceleration, which the teaching mode never reaches, both would be true. The paper does not tell; the shipped
# arm keeps the teaching mode right.

# %% [markdown]
# ## How far is the fast path from the exact one?
#
# The fast method linearises about the moving, sagging arm; the exact one does not. Both, at both speeds:

# %%
for percent, fast in ((10, low), (100, full)):
    exact = run(arm, percent, seconds=120 / percent, method="exact")
    apart = np.abs(exact.vibration - fast.vibration[:, : len(exact.time)]).max(1)
    relative = apart / exact.peak
    row = ", ".join(f"{a} {1e6 * d:.2f} um" for a, d in zip(AXES, apart, strict=True))
    print(f"{percent:3d} %: largest difference {row}: at most {relative.max():.2%} of the peak")
    assert relative.max() < 0.0015

# %% [markdown]
# About a thousandth of the peak or less, at both speeds: far below what any assumption about masses is worth. So the
# fast path is used throughout.

# %% [markdown]
# ## What the fit leaves open
#
# The campaign of notebook 01 (synthetic) leaves each stiffness known within some percent. Forty draws from that fit,
# normal in ln k with the fit's covariance, through the same stroke:

# %%
fit = ident.fit(arm_file, ident.read_campaign(data / "campaign.csv"))
names, covariance = fit.fit.information.names, fit.fit.information.covariance
centre = np.log([fit.parameters[name] for name in names])
draws = np.exp(np.random.default_rng(4).multivariate_normal(centre, covariance, 40))
drawn_arms = [arm.replace(dict(zip(names, draw, strict=True))) for draw in draws]
every = np.stack([run(drawn, 10, seconds=12.0).vibration for drawn in drawn_arms], -1)

# %%
sizes = 1e3 * np.abs(every).max(1)
low_end, middle, high_end = np.percentile(sizes, (5, 50, 95), axis=1)
table({"peak, 5 % [mm]": low_end, "peak, median [mm]": middle, "peak, 95 % [mm]": high_end})
window = round(0.5 / time[1])
blocks = 1e3 * np.abs(every[:, : len(time) // window * window]).reshape(3, -1, window, 40).max(2)
middles = time[window // 2 :: window][: blocks.shape[1]]
figure = Figure(figsize=(8.0, 3.6), layout="constrained")
panels = figure.subplots(1, 2, sharex=True)
for axes, i in zip(panels, (1, 2), strict=True):
    bottom, _, top = np.percentile(blocks[i], (5, 50, 95), axis=1)
    axes.fill_between(middles, bottom, top, color=BLUE, alpha=0.3, linewidth=0, label="5 to 95 % of the draws")
    axes.plot(middles, np.median(blocks[i], 1), color=BLUE, linewidth=1.2, label="median")
    axes.set_xlabel("time [s]")
    axes.set_ylabel(f"{AXES[i]}: largest in each half second [mm]")
    axes.set_ylim(0, None)
panels[0].set_title("Vibration at 10 %, by the fitted stiffnesses", fontsize=10, fontweight="bold", loc="left")
panels[1].legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2)
figure

# %%
spread = (high_end - low_end) / 2 / middle
sd = fit.fit.information.sd
words = ", ".join(f"{a} {s:.1%}" for a, s in zip(AXES, spread, strict=True))
print(f"half of the 90 % band, relative to the median: {words}")
print(f"standard deviation of the stiffnesses: {sd.min():.1%} to {sd.max():.1%}")
assert spread.max() < 0.1
late = np.percentile(1e3 * np.abs(every[2][time > low.arrival]).max(0), (5, 95))
print(f"vertical vibration left after arrival: {late[0]:.3f} to {late[1]:.3f} mm")
assert late[1] > 2 * late[0]

# %% [markdown]
# With a campaign like this one the stiffnesses leave the largest vibration open by a few percent only. What is left
# after arrival is another matter: it is a sum of what two passings and the stop leave behind, and a percent of the
# frequency decides how these add up. So a residual vibration is to be quoted with its band, never as one number.
#
# All this is no promise on the robot's amplitude: the eccentricities enter in proportion and nobody has measured them,
# and the campaign was computed with this very model.
