"""The figure of a validation: how far each measurement is off its prediction, and whether quantiles are right."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from ident.identify.validate import Validation
from ident.present.figures.style import BLUE, GREY, ORANGE, PALE_BLUE, key_below, plain, rows, titled
from ident.present.text.words import cut

VALIDATE_WIDTH, VALIDATE_ROW = 10.0, 0.24
"""Width of the figure and height of a row [inch]."""
LEAST = 3.6
"""Least height [inch]."""
MOST = 60
"""Measurements that are drawn as rows: of more, those that are farthest off."""


def validate_figure(validation: Validation) -> Figure:
    """Draw how far each measurement lies from its prediction, and observed against predicted quantiles."""
    told = validation.told
    count = sum(len(part.places) for part in told)
    height = max(LEAST, VALIDATE_ROW * min(count, MOST) + 1.8)
    figure = titled(
        (VALIDATE_WIDTH, height), f"Each part of {cut(validation.fit.campaign.name, 30)}, predicted by the others"
    )
    left, right = figure.subplots(1, 2, width_ratios=(1.5, 1.0))
    _off(left, validation)
    _quantiles(right, validation.z)
    handles = [
        Line2D([], [], color=BLUE, marker="o", linestyle="", label="measured less predicted"),
        Line2D([], [], color=PALE_BLUE, alpha=0.5, linewidth=6, label="95 % of right predictions"),
    ]
    if validation.missed:
        handles.append(Line2D([], [], color=ORANGE, marker="o", linestyle="", label="of a part too far off"))
    farthest = f"; left: the {MOST} of {count} that are farthest off" if count > MOST else ""
    key_below(figure, handles, f"standard deviations: noise, and what the others leave open{farthest}")
    return figure


def _off(axes: Axes, validation: Validation) -> None:
    """Draw a row for each measurement, part by part; of many, those that are farthest off."""
    campaign, missed = validation.fit.campaign.measurements, {part.name for part in validation.missed}
    z, names, colours = [], [], []
    for part in validation.told:
        for place, value in zip(part.places, part.off / part.sd, strict=True):
            m = campaign[place]
            z.append(value)
            names.append(f"{cut(part.name, 22)}  {cut(m.mode or m.point or m.joint or m.kind, 22)}")
            colours.append(ORANGE if part.name in missed else BLUE)
    shown = np.sort(np.argsort(-np.abs(z))[:MOST])
    off, names, colours = np.array(z)[shown], [names[i] for i in shown], [colours[i] for i in shown]
    axes.axvspan(-1.96, 1.96, color=PALE_BLUE, alpha=0.5, linewidth=0)
    axes.axvline(0, color=GREY, linewidth=0.8)
    axes.scatter(off, np.arange(len(off)), c=colours or BLUE, s=26, zorder=3)
    reach = max(3.0, 1.1 * float(np.abs(off).max(initial=0.0)))
    axes.set_xlim(-reach, reach)
    axes.set_xlabel("off [standard deviations]", fontsize=9)
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
    axes.set_xlim(0, 1)
    axes.set_ylim(0, 1)
    axes.set_xlabel("predicted quantile [-]", fontsize=9)
    axes.set_ylabel("share of measurements below [-]", fontsize=9)
    plain(axes)
