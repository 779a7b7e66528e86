"""A sampled posterior: its intervals and predictions, its corner plot and its traces."""

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ident.identify.unknowns import is_of_loop
from ident.inference.draws import LEARNED, LEVELS, prior_intervals, quantiles, ratio_to_prior, share_of_prior
from ident.report.report import cut
from ident.report.style import (
    BLUE,
    FILLED,
    GREEN,
    HOLLOW,
    ORANGE,
    PALE,
    PINK,
    Style,
    heading,
    plain,
    ratio_axis,
    rows,
    titled,
)
from ident.report.words import SETUP
from ident.studies.stiffness.fit_figure import DENSE, LETTER, PANEL, ROW, longest_label, measurement_rows
from ident.studies.stiffness.sample_report import of_first

if TYPE_CHECKING:
    from ident.identify.sample import CampaignSample

CORNER_DRAWS = 20000
"""Draws, at most, in the corner plot."""

BAND: Style = {"marker": "", "linestyle": "-", "linewidth": 5.0, "color": PALE}
WIDE: Style = {"marker": "", "linestyle": "-", "linewidth": 1.2, "color": BLUE}
NARROW: Style = {"marker": "", "linestyle": "-", "linewidth": 3.6, "color": BLUE}


def posterior_figure(result: "CampaignSample") -> Figure:
    """Draw posterior against prior, parameter by parameter, and predicted against measured."""
    rows_of_both = len(_shown(result)), min(len(result.fitted.campaign), DENSE)
    arm, campaign = cut(result.fitted.arm.name, 50), cut(result.fitted.campaign.name, 50) or "measurements"
    title = f"Posterior of {arm} given {campaign}{of_first(result)}"
    if result.withheld:
        title += f"\nNo interval is reported: {result.withheld[0].replace('see below', 'see ident fit')}"
    wider = LETTER * max(0, longest_label(result.fitted.campaign.measurements) - 52)
    figure = titled((15.5 + wider, max(rows_of_both) * ROW + PANEL + 0.5), title, (0.1, 0.06), wspace=0.04)
    left, right = figure.subplots(1, 2, width_ratios=(1.15, 1.0))
    _against_prior(left, result)
    _predicted(right, result)
    return figure


def _against_prior(axes: Axes, result: "CampaignSample") -> None:
    """Draw prior and posterior of each parameter relative to the arm file, lengths as exponentials of theta."""
    parameters, shown = result.sample.posterior.parameters, _shown(result)
    proper, share = parameters.proper[shown], share_of_prior(result.sample)[shown]
    prior = ratio_to_prior(parameters, prior_intervals(parameters))[shown]
    own = ratio_to_prior(parameters, np.asarray(parameters.theta(quantiles(result.sample).T)))[shown]
    open_ones = share > LEARNED
    rows(axes, [cut(parameters.names[i], 30) for i in shown])
    left, right, hidden = _frame(own, prior[proper])
    ratio_axis(axes, left, right)
    axes.axvline(1.0, color="black", linewidth=0.8, zorder=1.5)
    for y, (before, levels, unknown) in enumerate(zip(prior, own, open_ones, strict=True)):
        _draw_intervals(axes, y, np.clip(before, left, right), levels, BLUE)
        style = {**(HOLLOW if unknown else FILLED), "markersize": 5}
        axes.plot([levels[2]], [y], linestyle="", zorder=3, **style)
    shares = zip(share, proper, strict=True)
    texts = [f"{100 * share:.0f} % of the prior's width" if proper else "no prior" for share, proper in shares]
    rows(axes.twinx(), texts, side="right")
    axes.set(xlabel="value / centre of its prior [-]")
    beyond = ", goes on beyond the frame" if hidden else ""
    keys: dict[str, Style] = {f"prior, 95 %{beyond}": BAND, "posterior, 95 %": WIDE, "50 %": NARROW}
    keys |= {"median": FILLED, "median, mostly the prior": HOLLOW} if open_ones.any() else {"median": FILLED}
    heading(axes, "Parameters, one by one", keys)


def _draw_intervals(axes: Axes, y: int, band: np.ndarray, levels: np.ndarray, colour: str) -> None:
    """Draw a band, and over it the 95 and 50 % intervals of five quantiles."""
    low, lower, _, upper, high = levels
    axes.plot(band, [y, y], **BAND, solid_capstyle="butt")
    axes.plot([low, high], [y, y], **{**WIDE, "color": colour})
    axes.plot([lower, upper], [y, y], **{**NARROW, "color": colour}, solid_capstyle="butt")


def _shown(result: "CampaignSample") -> list[int]:
    """Return the indices of the drawn unknowns: all but measurement frames and hysteresis widths."""
    names = result.sample.posterior.parameters.names
    return [i for i, name in enumerate(names) if not (name.startswith(SETUP) or is_of_loop(name))]


def _frame(own: np.ndarray, prior: np.ndarray) -> tuple[float, float, bool]:
    """Return limits with all intervals, and with priors as far as intervals stay readable; whether any is cut off."""
    low, high = min(own.min(), 1.0), max(own.max(), 1.0)
    room = high / low  # priors may reach beyond the posterior's intervals by as much as these reach
    ends = [*prior.ravel(), low, high]
    left, right = max(min(ends), low / room), min(max(ends), high * room)
    hidden = bool((prior[:, 0] < left).any() or (prior[:, 1] > right).any())
    pad = (right / left) ** 0.04
    return left / pad, right * pad, hidden


def _predicted(axes: Axes, result: "CampaignSample") -> None:
    """Draw each measured value minus its predicted band, in standard deviations of the measurement."""
    campaign, drawn = result.fitted.campaign, result.posterior_predictive
    sigma, measured = np.array([m.sigma for m in campaign]), np.array([m.value for m in campaign])
    bands = np.quantile((measured - drawn.predicted) / sigma, LEVELS, axis=0).T
    noisy = np.quantile((measured - drawn.simulated) / sigma, (LEVELS[0], LEVELS[-1]), axis=0).T
    measurement_rows(axes, campaign.measurements, "measurement [-]")
    axes.axvline(0.0, color="black", linewidth=0.8)
    for y, (ends, levels) in enumerate(zip(noisy, bands, strict=True)):
        colour = BLUE if ends[0] < 0 < ends[1] else ORANGE
        _draw_intervals(axes, y, ends, levels, colour)
        axes.plot([levels[2]], [y], linestyle="", **{**FILLED, "color": colour, "markersize": 4})
    axes.set(xlabel="(measured - predicted) / sigma [-]")
    keys: dict[str, Style] = {"prediction with noise, 95 %": BAND, "prediction, 95 %": WIDE, "50 %": NARROW}
    if ((noisy[:, 0] >= 0) | (noisy[:, 1] <= 0)).any():
        keys["measured value outside the 95 % band"] = {**WIDE, "color": ORANGE}
    heading(axes, "Measured against predicted", keys)


def corner_figure(result: "CampaignSample") -> Figure:
    """Draw all pairs of parameters against each other, as logarithms of their ratios to the centres of their priors."""
    import corner

    parameters, shown = result.sample.posterior.parameters, _shown(result)
    names = [parameters.names[i] for i in shown]
    draws = result.sample.draws()
    draws = draws[np.linspace(0, len(draws) - 1, min(CORNER_DRAWS, len(draws))).astype(int)]
    ratio = np.log(ratio_to_prior(parameters, draws.T).T[:, shown])
    size = 1.8 * len(names) + 1.2
    figure = Figure(figsize=(size, size))
    span = np.quantile(ratio, (0.001, 0.999), axis=0).T
    look: Style = {"color": BLUE, "truth_color": ORANGE, "max_n_ticks": 3, "label_kwargs": {"fontsize": 9}}
    drawn: Style = {"quantiles": (LEVELS[0], LEVELS[-1]), "plot_datapoints": False, "fill_contours": True}
    labels, centre = [_two_lines(name) for name in names], [0.0] * len(names)
    corner.corner(ratio, fig=figure, labels=labels, range=[*map(tuple, span)], truths=centre, **look, **drawn)
    for axes in figure.axes:
        axes.tick_params(labelsize=7)
    title = f"Posterior of {cut(result.fitted.arm.name, 40)}{of_first(result)}: ln(values / centre of their priors) [-]"
    figure.suptitle(title, x=0.98, ha="right", parse_math=False, fontsize=12, fontweight="bold")
    figure.text(0.98, 0.94, "orange: centre of the prior; dashed: 95 % interval", ha="right", fontsize=10)
    return figure


def trace_figure(result: "CampaignSample") -> Figure:
    """Draw one walker of each ensemble over the steps, parameter by parameter."""
    sample = result.sample
    names, draws = sample.posterior.parameters.names, len(sample.theta)
    shown = np.unique(np.linspace(0, draws - 1, min(draws, 2000)).astype(int))
    figure = titled((11, 1.25 * len(names) + 1.0), "One walker of each ensemble", (0.04, 0.04))
    panels = figure.subplots(len(names), 1, sharex=True, squeeze=False)[:, 0]
    for p, (axes, name) in enumerate(zip(panels, names, strict=True)):
        plain(axes)
        axes.set_prop_cycle(color=(BLUE, ORANGE, GREEN, "black", PINK))
        axes.plot(shown * sample.thin, sample.theta[shown, :, 0, p], linewidth=0.6)
        axes.axvspan(0, sample.burn_in * sample.thin, color="#EEEEEE", zorder=0)
        axes.set_ylabel(_two_lines(name), fontsize=8, rotation=0, ha="right", va="center", parse_math=False)
    panels[-1].set(xlabel="step [-]; grey: burn-in, left out; vertical: theta, ln(value) for a stiffness")
    panels[-1].set(xlim=(0, draws * sample.thin))
    return figure


def _two_lines(name: str) -> str:
    return cut(name, 30).replace(".", "\n", 1)
