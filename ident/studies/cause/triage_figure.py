"""Order maps of traces, with the causes of their lines."""

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from ident.report.report import cut
from ident.report.style import BLUE, GREEN, ORANGE, PINK, Style, key_below, note
from ident.studies.cause.source_figure import SIZE
from ident.studies.working.spectrogram_figure import amplitude_figure

if TYPE_CHECKING:
    from ident.vibrate.spectra import Spectrogram
    from ident.vibrate.triage import Finding, Triage

LOOK: dict[str, Style] = {
    "drive": {"color": ORANGE, "linestyle": (0, (6, 2))},
    "mode": {"color": GREEN, "linestyle": "-"},
    "kicks": {"color": GREEN, "linestyle": "-"},
    "unexplained": {"color": BLUE, "linestyle": (0, (6, 2, 1.5, 2))},
    "line": {"color": PINK, "linestyle": (0, (1.5, 1.5))},
}
"""Colours and lines by kind; thin for compared tracks, thick for identified causes."""


def triage_figure(
    triage: "Triage",
    spectrogram: "Spectrogram",
    *,
    trace: int = 0,
    title: str = "What vibrates: order map",
    upto: float = 20.0,
    kind: str = "displacement",
) -> Figure:
    """Draw the amplitude of a trace over time and frequency, with tracks of drives, modes and lines.

    Args:
        triage: compared tracks and identified causes.
        spectrogram: of the trace, amplitudes (F, B) [m] or [m/s^2].
        trace: number of the trace.
        title: heading, such as the trace's name and direction.
        upto: [Hz] upper end of the axis.
        kind: `displacement`, drawn in mm, or `acceleration`.
    """
    figure, axes = amplitude_figure(SIZE, spectrogram, title, upto, kind)
    found = {finding.track for finding in triage.findings}
    for number, each in enumerate(triage.hypotheses):
        if each.frequency and (each.kind in ("drive", "mode") or number in found):
            look: Style = {"linewidth": 2.2, "alpha": 1.0} if number in found else {"linewidth": 0.9, "alpha": 0.65}
            axes.plot(triage.time[trace], each.frequency[trace], **LOOK[each.kind], **look)
            _name(axes, triage, number, trace)
    key = []
    for rank, finding in enumerate(triage.findings, start=1):
        if finding.track is not None:
            key.append(Line2D([], [], label=f"{rank}: {_words(finding)}", linewidth=2.2, **LOOK[finding.kind]))
            if finding.trace == trace:
                _mark(axes, triage, finding, rank)
    key_below(figure, key, "\n".join(_notes(triage, spectrogram)), columns=2)
    return figure


def _name(axes: Axes, triage: "Triage", number: int, trace: int) -> None:
    """Write the name of a track: a mode at its end, a drive at its maximum, each a bit lower than the previous one."""
    each, time = triage.hypotheses[number], triage.time[trace]
    track, top = each.frequency[trace], axes.get_ylim()[1]
    left, right = axes.get_xlim()
    if each.drives:
        k = int(np.where((track <= (0.96 - 0.07 * (number % 4)) * top) & (time < right), track, -1.0).argmax())
        text, align = _drives(each.drives[:1]), "center"
    else:
        k = int(np.flatnonzero(time <= right)[-1])
        text, align = cut(triage.labels[trace][each.mode or 0], 24), "right"
    if each.kind != "line" and 0 < track[k] < 0.97 * top:
        box = {"facecolor": "white", "edgecolor": "none", "alpha": 0.7, "pad": 0.5}
        at = (max(float(time[k]), left), float(track[k]))
        note(axes, text, at, (-2, 2), color=LOOK[each.kind]["color"], bbox=box, ha=align, va="bottom")


def _mark(axes: Axes, triage: "Triage", finding: "Finding", rank: int) -> None:
    """Put the number of a finding at its maximum."""
    track = triage.hypotheses[finding.track or 0].frequency[finding.trace]
    frequency = float(np.interp(finding.time, triage.time[finding.trace], track))
    box = {"boxstyle": "circle,pad=0.25", "facecolor": "white", "edgecolor": LOOK[finding.kind]["color"]}
    low, high = axes.get_xlim()
    time = min(max(finding.time, low), high)
    note(axes, f"{rank}", (time, frequency), (0, 0), bbox=box, ha="center", va="center", color="black", zorder=6)


def _words(finding: "Finding") -> str:
    what = f"line at {finding.frequency[0]:.4g} Hz" if finding.kind == "line" else ", ".join(finding.modes)
    what = _drives(finding.drives) if finding.drives else what
    return f"{cut(what, 44)}, {100 * finding.share:.0f} %" + ("" if finding.told else " (cannot tell)")


def _drives(drives: tuple[tuple[str, float], ...]) -> str:
    return " or ".join(name + (f" x {order:.3g}" if order != 1 else "") for name, order in drives)


def _notes(triage: "Triage", spectrogram: "Spectrogram") -> Iterator[str]:
    yield "tracks: drives broken, modes solid; thick and numbered where strongest: what makes the vibration, its share"
    if any(finding.track is None for finding in triage.findings):
        yield f"unexplained: {100 * triage.findings[-1].share:.0f} %"
    yield spectrogram.description()
