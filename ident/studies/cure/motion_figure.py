"""A motion along its path: speed, vibration, and the modes it crosses."""

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure

from ident.report.style import GREY, ORANGE, Style, key_below, lines, note, plain, titled
from ident.report.words import MM
from ident.studies.basis import motion_title
from ident.studies.cure.design_figure import AFTER, BEFORE, COLORS, LIMIT
from ident.vibrate.shaping import shapers

if TYPE_CHECKING:
    from ident.studies.cure.motion_study import MotionStudy

MODES: tuple[Style, ...] = ({"color": ORANGE, "linewidth": 1.0}, {"color": ORANGE, "linewidth": 1.0, "linestyle": "--"})
SETTLED: Style = {**LIMIT, "linestyle": "-."}


def motion_figure(motions: "MotionStudy") -> Figure:
    """Draw the speed over the path with the speeds at which pulleys excite modes; below, the vibration over time."""
    scheduling = motions.scheduling
    figure = titled((8.0, 7.0), motion_title("Speed along the path", motions.basis), (0.08, 0.1))
    top, below = figure.subplots(2, 1)
    highest, shown = 0.0, motions.shown
    for candidate, style in ((motions.candidates[0], BEFORE), (shown, AFTER)):
        time = np.linspace(0.0, candidate.motion.arrival, 1001)
        alpha = np.degrees(scheduling.path.alpha(candidate.motion(time)[0]))
        rate = np.abs(np.gradient(alpha, time))
        top.plot(alpha, rate, **style)
        highest = max(highest, float(rate.max()))
    along = np.linspace(scheduling.places[0], scheduling.places[-1], 101)
    for order in scheduling.orders(along):
        for frequencies, style in zip(scheduling.frequencies(along), MODES, strict=True):
            speeds = np.degrees(frequencies / np.maximum(order, 1e-9))
            top.plot(np.degrees(along), np.where(speeds < 1.3 * highest, speeds, np.nan), **style)
    for whole, style in ((motions.before, BEFORE), (motions.after, AFTER)):
        below.plot(whole.time, MM * whole.envelope.max(0), **style)
    limits = [("limit,", motions.limit, LIMIT)] * bool(np.isfinite(motions.limit))
    if motions.wanted.settled is not None:
        limits.append(("settled below", motions.wanted.settled, SETTLED))
    for _, value, style in limits:
        below.axhline(MM * value, **style)
    for axes in (top, below):
        plain(axes, grid=True)
        axes.set_ylim(bottom=0)
    top.set_xlim(np.degrees(along[[0, -1]]))
    top.set(xlabel="alpha along the path [deg]", ylabel="speed of alpha [deg/s]")
    below.set_xlim(left=0)
    below.set(xlabel="time [s]", ylabel="largest vibration over the phases [mm]")
    entries = {"as it is": BEFORE, shown.name: AFTER, "a pulley meets mode 1": MODES[0], "mode 2": MODES[1]}
    entries |= {f"{word} {MM * value:g} mm": style for word, value, style in limits}
    key_below(figure, lines(entries), "fast method; largest of X, Y, Z", columns=len(entries))
    return figure


def shaper_figure(motions: "MotionStudy") -> Figure:
    """Draw the residual vibration of shapers over mode frequency; below, the two lowest frequencies along the path."""
    bands, expected = motions.bands, motions.bands[1, :, -1]
    figure = titled((5.5, 7.0), motion_title("What input shapers leave", motions.basis), (0.08, 0.1))
    top, below = figure.subplots(2, 1, sharex=True)
    frequency = np.linspace(0.75 * bands.min(), 1.1 * bands.max(), 601)
    candidates = {each.name: each for each in motions.candidates if each.kind == "shaper"}
    handles = []
    each = {shaper.name: shaper for shaper in shapers()}
    curves = {name: shaper.residual(frequency, expected[0]) for name, shaper in each.items()}
    curves["ZV x ZV"] = curves["ZV"] * each["ZV"].residual(frequency, expected[1])
    curves["mid-mode ZVD"] = each["ZVD"].residual(frequency, np.sqrt(expected.prod()))
    for (name, left), color in zip(curves.items(), (*COLORS, GREY), strict=False):
        if found := candidates.get(f"{name} shaper"):
            label = f"{name}: {MM * found.left:.2f} mm left"
            handles += top.plot(frequency, 100 * left, color=color, linewidth=1.3, label=label)
    along = np.degrees(np.linspace(motions.scheduling.places[0], motions.scheduling.places[-1], bands.shape[2]))
    for mode, name in enumerate(("mode 1", "mode 2")):
        below.fill_betweenx(along, bands[0, mode], bands[2, mode], color=ORANGE, alpha=0.25, linewidth=0)
        below.plot(bands[1, mode], along, **MODES[mode])
        at = -bands.shape[2] // 4  # where the lines are apart: names stand on their outer sides
        side: tuple[int, str] = ((-6, "right"), (6, "left"))[mode]
        note(below, name, (bands[1, mode, at], along[at]), (side[0], 0), ha=side[1], va="center", fontsize=9)
        for axes in (top, below):
            axes.axvspan(bands[0, mode, -1], bands[2, mode, -1], color=ORANGE, alpha=0.12, linewidth=0)
            axes.axvline(expected[mode], color=GREY, linewidth=0.8, linestyle=":")
    for axes in (top, below):
        plain(axes, grid=True)
    top.set(ylim=(0, 100), ylabel="residual of a mode [%]", xlim=frequency[[0, -1]])
    below.set(xlabel="frequency [Hz]", ylabel="alpha along the path [deg]", ylim=along[[0, -1]])
    spread = f"bands: 5 to 95 % of {len(motions.candidates[0].peaks)} draws; " if motions.basis.draws else ""
    words = f"{spread}dotted: at the arrival, for which\nthe curves are; the shapers follow the posture"
    key_below(figure, handles, words, columns=2)
    return figure
