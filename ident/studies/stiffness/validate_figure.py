"""Measured values of each posture against predictions from the other postures."""

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ident.report.report import cut
from ident.report.style import BLUE, GREY, ORANGE, PALE_BLUE, Style, key_below, lines, rows, titled
from ident.studies.stiffness.fit_figure import LETTER

if TYPE_CHECKING:
    from ident.identify.validate import Validation
MOST, PART = 60, 44
"""Largest number of rows; of more measurements those with the largest errors. Longest name of a part [characters]."""


def validate_figure(validation: "Validation") -> Figure:
    """Draw the distance of each measurement from its prediction, in standard errors of the prediction."""
    told = validation.told
    count = sum(len(part.places) for part in told)
    height = max(3.6, 0.24 * min(count, MOST) + 1.8)
    title = f"Each part of {cut(validation.fit.campaign.name, 30)}, predicted from the rest"
    wider = LETTER * max(0, max((len(cut(part.name, PART)) for part in told), default=0) - 22)
    figure = titled((8.0 + wider, height), title)
    _off(figure.subplots(), validation)
    entries: dict[str, Style] = {
        "measured less predicted": {"color": BLUE, "marker": "o", "linestyle": ""},
        "95 % interval of the prediction": {"color": PALE_BLUE, "alpha": 0.5, "linewidth": 6},
    }
    if validation.missed:
        entries["part too far from its prediction"] = {"color": ORANGE, "marker": "o", "linestyle": ""}
    farthest = f"; the {MOST} of {count} farthest off" if count > MOST else ""
    key_below(figure, lines(entries), f"std. errors: noise, and what the other data leave undetermined{farthest}")
    return figure


def _off(axes: Axes, validation: "Validation") -> None:
    """Draw a row for each measurement, part by part; of many, those with the largest errors."""
    campaign, missed = validation.fit.campaign.measurements, {part.name for part in validation.missed}
    every = [(part, campaign[place]) for part in validation.told for place in part.places]
    shown = np.sort(np.argsort(-np.abs(validation.z))[:MOST]).tolist()
    off = validation.z[shown]
    names = [f"{cut(p.name, PART)}  {cut(m.mode or m.point or m.joint or m.kind, 22)}" for p, m in every]
    colours = [ORANGE if every[i][0].name in missed else BLUE for i in shown]
    axes.axvspan(-1.96, 1.96, color=PALE_BLUE, alpha=0.5, linewidth=0)
    axes.axvline(0, color=GREY, linewidth=0.8)
    axes.scatter(off, np.arange(len(off)), c=colours or BLUE, s=26, zorder=3)
    reach = max(3.0, 1.1 * float(np.abs(off).max(initial=0.0)))
    axes.set(xlim=(-reach, reach), xlabel="measured less predicted [std. errors]")
    rows(axes, [names[i] for i in shown])
