"""Postures predicted from the others against what was measured there."""

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from ident.report.report import cut
from ident.report.style import (
    BLUE,
    GREY,
    ORANGE,
    PALE_BLUE,
    key_below,
    plain,
    rows,
    titled,
)
from ident.studies.stiffness.fit_figure import LETTER

if TYPE_CHECKING:
    from ident.identify.compare import Validation
MOST, PART = 60, 44
"""Measurements that are drawn as rows, of more those that are farthest off; and letters of a part's name."""


def validate_figure(validation: "Validation") -> Figure:
    """Draw how far each measurement lies from its prediction, and observed against predicted quantiles."""
    told = validation.told
    count = sum(len(part.places) for part in told)
    height = max(3.6, 0.24 * min(count, MOST) + 1.8)
    title = f"Each part of {cut(validation.fit.campaign.name, 30)}, predicted from the rest"
    wider = LETTER * max(0, max((len(cut(part.name, PART)) for part in told), default=0) - 22)
    figure = titled((10.0 + wider, height), title)
    left, right = figure.subplots(1, 2, width_ratios=(1.5, 1.0))
    _off(left, validation)
    _quantiles(right, validation.z)
    handles = [
        Line2D([], [], color=BLUE, marker="o", linestyle="", label="measured less predicted"),
        Line2D([], [], color=PALE_BLUE, alpha=0.5, linewidth=6, label="95 % interval of the prediction"),
    ]
    if validation.missed:
        handles.append(Line2D([], [], color=ORANGE, marker="o", linestyle="", label="part too far from its prediction"))
    farthest = f"; left: the {MOST} of {count} farthest off" if count > MOST else ""
    key_below(figure, handles, f"std. errors: noise, and what the other data leave undetermined{farthest}")
    return figure


def _off(axes: Axes, validation: "Validation") -> None:
    """Draw a row for each measurement, part by part; of many, those that are farthest off."""
    campaign, missed = validation.fit.campaign.measurements, {part.name for part in validation.missed}
    z, names, colours = [], [], []
    for part in validation.told:
        for place, value in zip(part.places, part.off / part.sd, strict=True):
            m = campaign[place]
            z.append(value)
            names.append(f"{cut(part.name, PART)}  {cut(m.mode or m.point or m.joint or m.kind, 22)}")
            colours.append(ORANGE if part.name in missed else BLUE)
    shown = np.sort(np.argsort(-np.abs(z))[:MOST])
    off, names, colours = np.array(z)[shown], [names[i] for i in shown], [colours[i] for i in shown]
    axes.axvspan(-1.96, 1.96, color=PALE_BLUE, alpha=0.5, linewidth=0)
    axes.axvline(0, color=GREY, linewidth=0.8)
    axes.scatter(off, np.arange(len(off)), c=colours or BLUE, s=26, zorder=3)
    reach = max(3.0, 1.1 * float(np.abs(off).max(initial=0.0)))
    axes.set(xlim=(-reach, reach), xlabel="measured less predicted [std. errors]")
    rows(axes, names)


def _quantiles(axes: Axes, z: np.ndarray) -> None:
    """Draw the share of measurements below each predicted quantile, with where right predictions lie point by point."""
    from scipy.special import ndtr
    from scipy.stats import beta

    count = len(z)
    if count:
        order = np.arange(1, count + 1)
        predicted = np.sort(ndtr(z))
        low, high = (beta.ppf(q, order, count + 1 - order) for q in (0.025, 0.975))
        observed = (order - 0.5) / count
        axes.fill_betweenx(observed, low, high, color=PALE_BLUE, alpha=0.5, linewidth=0)
        axes.plot(predicted, observed, color=BLUE, marker="o", markersize=3.5, linewidth=1.0)
    axes.plot([0, 1], [0, 1], color=GREY, linewidth=0.8)
    axes.set(xlim=(0, 1), ylim=(0, 1), xlabel="predicted quantile [-]", ylabel="share of measurements below [-]")
    plain(axes)
