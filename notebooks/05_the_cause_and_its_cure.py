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
# # The cause and its cure
#
# The paper looks for the cause of the vibration and names mass eccentricities. It measured none, and left a peak near
# 9.5 Hz in the vertical spectrum unexplained. Its Figures 5 to 7 compare measured and computed traces. Here such traces
# lead to the cause, and the cause to a cure.
#
# The traces are **synthetic**. MuJoCo, not ident, moves an arm near that of `arm.toml`: its stiffnesses differ by a
# draw of the fit of notebook 01, its drives have transmission errors, all phases are drawn. Recorders add noise and
# have clocks of their own (`data/lcd_arm/mujoco/make.py`). ident knows the file and the traces at 7, 10 and 13 % of
# full speed. Run it in the folder `notebooks`.

# %%
from pathlib import Path

import matplotlib
import numpy as np
from matplotlib.figure import Figure

import ident

# %matplotlib inline

style = {"axes.spines.top": False, "axes.spines.right": False, "axes.labelsize": 9, "legend.frameon": False}
matplotlib.rcParams.update(style)
BLUE, ORANGE, GREY = "#0072B2", "#D55E00", "#BBBBBB"
PEAK, LIMIT = 9.5, 0.4  # Hz, mm
data = Path("..") / "data" / "lcd_arm"
arm_file = ident.read_arm(data / "arm.toml")

# %% [markdown]
# ## The cause
#
# Imbalance and transmission error of each drive, found together with stiffness, damping and clocks. The run at 8 % is
# left out, to be predicted. `peak` asks for the cause of a peak at 9.5 Hz.

# %%
options = ident.SourceOptions(hold_out=("run8.csv",), peak=PEAK)
source = ident.source(data / "mujoco" / "runs.csv", arm_file, options)
print(source.report())

# %% [markdown]
# The true numbers, which ident has not seen:

# %%
lines = (data / "mujoco" / "truth.csv").read_text(encoding="utf-8").splitlines()[2:]
true = arm_file.arm.replace({path: float(value) for path, value in (line.split(",") for line in lines)})
print("                          estimate off   std. error   phase off   std. error")
for row in source.table():
    name, imbalance = row["drive"], row["kind"] == "imbalance"
    size, phase = ("eccentricity", "phase") if imbalance else ("error", "error_phase")
    right = float(true.get(f"{name}.{size}"))
    off = row["amplitude"] / right - 1, np.angle(np.exp(1j * (row["phase"] - float(true.get(f"{name}.{phase}")))))
    sd = row["sd"] / right, row["phase_sd"]
    cells = f"{100 * off[0]:12.2f} %{100 * sd[0]:11.2f} %{np.degrees(off[1]):8.1f} deg{np.degrees(sd[1]):9.1f} deg"
    print(f"{name} {row['kind']:19s}{cells}")
    assert abs(off[0]) < 4 * sd[0]
    assert abs(off[1]) < 4 * sd[1]
print("stiffness: off in the file, and as identified")
for path, value in source.parameters.items():
    if path.rpartition(".")[2] in ("k_bend", "k_tors"):
        off = [100 * (float(number) / float(true.get(path)) - 1) for number in (arm_file.arm.get(path), value)]
        print(f"{path}{off[0]:12.1f} %{off[1]:12.1f} %")

# %% [markdown]
# ## Figures 5 and 6: a run that was not used
#
# Its clock is the only thing that is fitted to it.

# %%
figure = Figure(figsize=(8.0, 4.6), layout="constrained")
panels = figure.subplots(2, 1, sharex=True)
for axes, held in zip(panels, source.study.held, strict=True):
    axes.plot(held.channel.time, 1e3 * held.shown, color=GREY, linewidth=1.2, label="measured")
    axes.plot(held.channel.time, 1e3 * held.computed, color=BLUE, linewidth=0.6, label="predicted")
    axes.set_ylabel(f"{held.channel.name[-1]} [mm]")
    axes.set_title(f"{100 * held.explained:.0f} % of the mean square is predicted", loc="left", fontsize=10)
    assert held.explained > 0.9
panels[-1].set_xlabel("time [s]")
panels[0].legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2)
figure

# %% [markdown]
# ## Figure 7: spectra at 10 %, and the peak
#
# The paper's unexplained peak is marked. The third mode of the folded arm lies there:

# %%
folded = np.degrees(float(arm_file.arm.get("stroke.folded")))
posture = (folded, -2 * folded, folded)
lowest = ident.predict(arm_file, ident.PredictOptions(posture=(posture,), modes=3)).table()
third = max(mode["frequency"] for mode in lowest)
print(f"third natural frequency, folded: {third:.2f} Hz")

# %%
found, computed = source.study.found, {}
figure = Figure(figsize=(8.0, 4.6), layout="constrained")
panels = figure.subplots(2, 1, sharex=True)
at_10 = [k for k, channel in enumerate(found.problem.channels) if "run10" in channel.name]
for axes, k in zip(panels, at_10, strict=True):
    channel, shown = found.problem.channels[k], found.shown[k]
    frequency = np.fft.rfftfreq(len(shown), channel.time[1] - channel.time[0])
    window = np.hanning(len(shown))
    for trace, colour, name in ((shown, GREY, "measured"), (shown - found.residual[k], BLUE, "computed")):
        amplitude = 1e6 * np.abs(np.fft.rfft(window * trace)) * 2 / window.sum()
        axes.semilogy(frequency, amplitude, color=colour, linewidth=1.0, label=name)
    computed[channel.name[-1]] = amplitude
    axes.axvline(PEAK, color=ORANGE, linewidth=1.0, linestyle="--", label=f"{PEAK} Hz")
    axes.set(xlim=(2, 18), ylim=(0.02, None), ylabel=f"{channel.name[-1]}: amplitude [um]")
panels[0].legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=3)
panels[-1].set_xlabel("frequency [Hz]")
figure

# %%
near, most = (computed["z"][(frequency > low) & (frequency < high)].max() for low, high in ((9, 10), (3.5, 8.5)))
print(f"computed in Z at 10 %, 9 to 10 Hz: {near:.2f} um at most, 3.5 to 8.5 Hz: {most:.1f} um")
assert near < 0.05 * most

# %% [markdown]
# Nothing excites that mode at 10 %: while the arm is folded the pulleys hardly turn, and the motion is smooth.
# Transmission errors draw a line near 14 Hz instead, which the paper does not mention. At 13 % pulley 2 passes 9.5 Hz,
# so these runs do have a peak there. Which cause makes it?

# %%
for cause in source.causes:
    print(f"{cause['kind']:10s} probability {cause['evidence']:.2f} by evidence, {cause['held_out']:.2f} by prediction")
assert source.causes[0]["kind"] == "imbalance"

# %% [markdown]
# Imbalance of drive 2: right, for these runs. In the paper's run at 10 % no pulley turns so fast, so its peak is not
# made by imbalance. Runs at two speeds, and the same question, would tell more: orders of a drive move with the
# speed, a flexible finger and a fixed frequency stay. A hammer shows the finger on the standing arm.

# %% [markdown]
# ## The cure
#
# The cheapest remedy changes neither motion nor parts: masses in the holes of pulley 2, chosen on the arm as it was
# identified.

# %%
mounting = ident.BalanceOptions(speed=10, radius={"drive2": 90.0}, holes={"drive2": 12})
balance = ident.balance(source, mounting)
print(balance.report())
masses = [row for row in balance.table() if row["mass"] > 0]

# %% [markdown]
# These masses are mounted on the true arm, and MuJoCo moves it again. The head of its file says what was mounted.

# %%
traces = {}
for name in ("as_it_is", "balanced"):
    file = data / "mujoco" / f"{name}.csv"
    time, *way = np.loadtxt(file, delimiter=",", skiprows=2, unpack=True)
    traces[name] = time, np.array(way)
mounted = file.read_text(encoding="utf-8").splitlines()[0].partition("Mounted: ")[2].split(" + ")
print(f"mounted: {', '.join(mounted)}")
for row, body in zip(masses, mounted, strict=True):
    mass, place = body.split(" g @ ")
    assert place == f"{row['drive']} hole {row['hole']:.0f}"
    assert abs(float(mass) - 1e3 * row["mass"]) < 0.1
before, after = (np.abs(way).max() for _, way in traces.values())
low, high = balance.left[1:]
print(f"largest vibration of the true arm: {before:.3f} mm before, {after:.3f} mm after: {100 * after / before:.1f} %")
print(f"predicted: {100 * balance.left[0]:.1f} % ({100 * low:.1f} to {100 * high:.1f} %)")
assert after < LIMIT < before
assert abs(after / before - balance.left[0]) < 0.03

# %%
figure = Figure(figsize=(8.0, 4.6), layout="constrained")
panels = figure.subplots(2, 1, sharex=True, sharey=True)
for axes, (name, (time, way)) in zip(panels, traces.items(), strict=True):
    axes.plot(time, way[0], color=BLUE, linewidth=0.6, label="sideways (Y)")
    axes.plot(time, way[1], color=GREY, linewidth=0.6, label="vertical (Z)")
    for side in (-LIMIT, LIMIT):
        axes.axhline(side, color=ORANGE, linewidth=1.0, linestyle="--")
    axes.set_ylabel("[mm]")
    axes.set_title(f"True arm at 10 %, {name.replace('_', ' ')}: {np.abs(way).max():.2f} mm", loc="left", fontsize=10)
panels[0].legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2)
panels[-1].set_xlabel("time [s]")
figure

# %% [markdown]
# The prediction holds on an arm that ident has never seen, by equations that are not its own. What is left is
# transmission error, which no mass changes; notebook 08 compares other cures. A real robot differs from this one by
# more than stiffnesses, phases and clocks: leave a run out, as here, and mount a trial mass first (`ident balance`).
