"""Figures of a sampled posterior (what it says, corner plot, traces), of plans and of fleets."""

import math
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import FixedLocator, FuncFormatter, LogLocator, MaxNLocator, NullFormatter, NullLocator

from ident.identify.candidates import main_joints
from ident.identify.unknowns import is_of_loop
from ident.inference.draws import (
    LEARNED,
    LEVELS,
    combinations,
    prior_intervals,
    prior_spread,
    quantiles,
    ratio_to_prior,
    share_of_prior,
)
from ident.present.figures.fit import DENSE, LETTER, PANEL, ROW, longest_label, measurement_rows
from ident.present.figures.style import (
    BLUE,
    FILLED,
    GREEN,
    GREY,
    HOLLOW,
    ORANGE,
    PALE,
    PALE_BLUE,
    PINK,
    Style,
    colour_bar,
    heading,
    key_below,
    note,
    plain,
    power_of,
    ratio_axis,
    rows,
    set_ticks,
    titled,
)
from ident.present.plan import criterion_in_words, experiment_in_words
from ident.present.report import cut
from ident.present.sample import of_first
from ident.present.words import SETUP, degrees, direction_name, in_shown_unit

if TYPE_CHECKING:
    from ident.identify.compare import CampaignSample
    from ident.identify.fleet import Fleet
    from ident.identify.plan import CampaignPlan
    from ident.inference.population import Population

CORNER_DRAWS = 20000
"""Draws, at most, in the corner plot."""
WIDE_SPAN = 5.0
"""Ratio of the ends of a range from which its axis in the corner plot is logarithmic."""
BAND: Style = {"marker": "", "linestyle": "-", "linewidth": 5.0, "color": PALE}
WIDE: Style = {"marker": "", "linestyle": "-", "linewidth": 1.2, "color": BLUE}
NARROW: Style = {"marker": "", "linestyle": "-", "linewidth": 3.6, "color": BLUE}


def sample_figures(result: "CampaignSample") -> dict[str, Figure]:
    """Return all figures of a sample by name: `posterior`, `corner` and `trace`."""
    return {"posterior": posterior_figure(result), "corner": corner_figure(result), "trace": trace_figure(result)}


def posterior_figure(result: "CampaignSample") -> Figure:
    """Draw posterior against prior, parameter by parameter and in combination, and predicted against measured."""
    items = _shown(result)
    combined = combinations(result.sample) if len(result.fitted.problem.parameters.items) > 1 else []
    left = [len(items) * ROW + PANEL, len(combined) * ROW + PANEL]
    right = min(len(result.fitted.campaign), DENSE) * ROW + PANEL
    arm, campaign = cut(result.fitted.arm.name, 50), cut(result.fitted.campaign.name, 50) or "measurements"
    title = f"Posterior of {arm} given {campaign}{of_first(result)}"
    if result.withheld:
        title += f"\nNo interval is reported: {result.withheld[0].replace('see below', 'see ident fit')}"
    wider = LETTER * max(0, longest_label(result.fitted.campaign.measurements) - 52)
    figure = titled((15.5 + wider, max(sum(left), right) + 0.5), title, (0.1, 0.06), wspace=0.04)
    columns = figure.add_gridspec(1, 2, width_ratios=(1.15, 1.0))
    stacked = columns[0].subgridspec(2, 1, height_ratios=left)
    _against_prior(figure.add_subplot(stacked[0]), result)
    if combined:
        _combinations(figure.add_subplot(stacked[1]), result)
    _predicted(figure.add_subplot(columns[1]), result)
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
    """Return the places of the unknowns that are shown: all but frames of setups and widths of loops."""
    names = result.sample.posterior.parameters.names
    return [i for i, name in enumerate(names) if not (name.startswith(SETUP) or is_of_loop(name))]


def _frame(own: np.ndarray, prior: np.ndarray) -> tuple[float, float, bool]:
    """Return limits with all intervals, and with the priors as far as these stay readable; whether any is cut off."""
    low, high = min(own.min(), 1.0), max(own.max(), 1.0)
    room = high / low  # priors may reach as far beyond the posterior's intervals as these reach
    ends = [*prior.ravel(), low, high]
    left, right = max(min(ends), low / room), min(max(ends), high * room)
    hidden = bool((prior[:, 0] < left).any() or (prior[:, 1] > right).any())
    pad = (right / left) ** 0.04
    return left / pad, right * pad, hidden


def _combinations(axes: Axes, result: "CampaignSample") -> None:
    """Draw the spread of each combination over the draws, and what the prior alone would leave."""
    known, parameters = combinations(result.sample), result.fitted.problem.parameters
    names = parameters.names
    spread = result.sample.draws()[:, : len(names)].std(0)
    rows(axes, [direction_name(direction, names, spread) for direction in known])
    axes.set_xscale("log")
    for y, direction in enumerate(known):
        prior = prior_spread(direction, parameters)
        if np.isfinite(prior):
            axes.plot([direction.sd, prior], [y, y], color=PALE, linewidth=1.2)
            axes.plot([prior], [y], linestyle="", marker="|", markersize=11, color=GREY)
        axes.plot([direction.sd], [y], linestyle="", **(HOLLOW if direction.sd > LEARNED * prior else FILLED))
    left, right = axes.get_xlim()
    ticks = [step for step in (1e-4, 1e-3, 0.01, 0.03, 0.1, 0.3, 1.0, 3.0, 10.0) if left < step < right]
    axes.set_xticks(ticks, [f"{100 * tick:g} %" if tick < 1 else f"factor {np.exp(tick):.2g}" for tick in ticks])
    axes.set_xticks([], minor=True)
    axes.set(xlabel="standard deviation of ln(combination) [-]")
    keys: dict[str, Style] = {"by the posterior": FILLED, "by the prior alone": {"marker": "|", "color": GREY}}
    heading(axes, "Parameters in combination, best known first", keys)


def _predicted(axes: Axes, result: "CampaignSample") -> None:
    """Draw each measured value less the band of its predictions, in standard deviations of the measurement."""
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
    """Draw all pairs of parameters against each other, relative to the centres of their priors."""
    import corner

    parameters, shown = result.sample.posterior.parameters, _shown(result)
    names = [parameters.names[i] for i in shown]
    draws = result.sample.draws()
    draws = draws[np.linspace(0, len(draws) - 1, min(CORNER_DRAWS, len(draws))).astype(int)]
    ratio = ratio_to_prior(parameters, draws.T).T[:, shown]
    size = 1.8 * len(names) + 1.2
    figure = Figure(figsize=(size, size))
    span = np.quantile(ratio, (0.001, 0.999), axis=0).T
    wide = span[:, 1] / span[:, 0] > WIDE_SPAN
    corner.corner(
        ratio,
        fig=figure,
        labels=[_two_lines(name) for name in names],
        range=[tuple(ends) for ends in span],
        axes_scale=["log" if far else "linear" for far in wide],
        truths=[1.0] * len(names),
        truth_color=ORANGE,
        color=BLUE,
        quantiles=(LEVELS[0], LEVELS[-1]),
        plot_datapoints=False,
        fill_contours=True,
        max_n_ticks=3,
        label_kwargs={"fontsize": 9},
    )
    for axes in figure.axes:
        axes.tick_params(labelsize=7)
        for axis in (axes.xaxis, axes.yaxis):
            if axis.get_scale() == "log":
                _few_ticks(axis)
    title = f"Posterior of {cut(result.fitted.arm.name, 40)}{of_first(result)}: values / centre of their priors [-]"
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


def _few_ticks(axis: Axis) -> None:
    """Put a few plain numbers on a logarithmic axis, none on an axis whose ticks stand elsewhere."""
    low, high = axis.get_view_interval()
    axis.set_major_locator(LogLocator(subs=(1.0,) if high / low > 100 else (1.0, 3.0), numticks=12))
    axis.set_minor_locator(NullLocator())
    if not isinstance(axis.get_major_formatter(), NullFormatter):
        axis.set_major_formatter(FuncFormatter(lambda x, _: f"{x:g}"))


def _two_lines(name: str) -> str:
    return cut(name, 30).replace(".", "\n", 1)


# -------- Fleet
# The figure of a fleet: each robot's own and shrunk estimates beside the population, a panel a stiffness.

FLEET_PANEL = (3.9, 2.7)
"""Width and height of a panel [inch]."""
WIDEST = 1.0
"""Standard deviation in theta above which an own estimate is not drawn: its data leave it open."""
MOST = 300
"""Robots that are drawn, of more those that are farthest off, in the order of their names."""


def fleet_figure(fleet: "Fleet") -> Figure:
    """Draw a panel for each stiffness; robots in the order of their names."""
    population = fleet.population
    if population is None:
        return titled((6.0, 1.6), "No population: too few robots could be fitted")
    count = len(fleet.names)
    columns = min(3, count)
    lines = math.ceil(count / columns)
    size = FLEET_PANEL[0] * columns, FLEET_PANEL[1] * lines + 1.1
    figure = titled(size, f"A fleet of {len(fleet.robots)} robots")
    panels = figure.subplots(lines, columns, squeeze=False).ravel()
    for i, axes in enumerate(panels[:count]):
        _panel(axes, fleet, population, i)
    for axes in panels[count:]:
        axes.set_visible(False)
    _fleet_key(figure, "robots from left to right by name; own fits that do not determine a stiffness are not drawn")
    return figure


def stiffness_figure(fleet: "Fleet", population: "Population", i: int) -> Figure:
    """Draw one stiffness of all robots."""
    figure = titled((6.4, 3.6), "")
    _panel(figure.subplots(), fleet, population, i)
    _fleet_key(figure, "")
    return figure


def _fleet_key(figure: Figure, words: str) -> None:
    handles: list[Artist] = [
        Patch(color=PALE_BLUE, alpha=0.5, linewidth=0, label="95 % of healthy robots"),
        Line2D([], [], color=PALE, marker="_", linestyle="", markersize=8, label="own fit, 95 %"),
        Line2D([], [], color=BLUE, marker="o", linestyle="", markersize=4, label="shrunk, 95 %"),
        Line2D([], [], color=ORANGE, marker="o", linestyle="", markersize=4, label="stands out"),
    ]
    key_below(figure, handles, words)


def _panel(axes: Axes, fleet: "Fleet", population: "Population", i: int) -> None:
    """Draw one stiffness of all members, of many of those that are farthest off."""
    least = fleet.deviations.p.min(1) if fleet.deviations else np.zeros(0)
    shown = np.sort(np.argsort(least, kind="stable")[:MOST])
    scale, unit = in_shown_unit(fleet.names[i], 1.0)
    size, unit = power_of(float(np.exp(population.next_mean[i])) * scale, unit)
    scale /= size
    x = np.arange(len(shown))
    robots = [fleet.robots[fleet.members[r]] for r in shown]
    own, own_sd = (np.array([getattr(robot, name)[i] for robot in robots]) for name in ("theta", "sd"))
    shrunk, sd = population.robot_mean[shown, i], population.robot_sd[shown, i]
    middle, spread = population.next_mean[i], population.next_sd[i]
    axes.axhspan(*np.exp([middle - 1.96 * spread, middle + 1.96 * spread]) * scale, color=PALE_BLUE, alpha=0.5, lw=0)
    axes.axhline(np.exp(middle) * scale, color=GREY, linewidth=0.8)
    drawn = own_sd < WIDEST
    low, high = (np.exp(own + sign * 1.96 * own_sd)[drawn] * scale for sign in (-1, 1))
    axes.vlines(x[drawn] - 0.2, low, high, color=PALE, linewidth=1.2)
    axes.scatter(x[drawn] - 0.2, np.exp(own[drawn]) * scale, color=PALE, marker="_", s=20)
    off = np.array([i in fleet.standing_out.get(int(r), ()) for r in shown])
    for which, colour in ((~off, BLUE), (off, ORANGE)):
        low, high = (np.exp(shrunk + sign * 1.96 * sd)[which] * scale for sign in (-1, 1))
        axes.vlines(x[which], low, high, color=colour, linewidth=1.4)
        axes.scatter(x[which], np.exp(shrunk[which]) * scale, color=colour, s=10, zorder=3)
    for place in np.flatnonzero(off)[:5]:
        note(axes, cut(robots[place].name, 12), (x[place], np.exp(shrunk[place]) * scale), (4, 3))
    # population and shrunk intervals lie within the frame, own ones may be cut
    bottom = min(float((shrunk - 2 * sd).min()), middle - 3 * spread)
    top = max(float((shrunk + 2 * sd).max()), middle + 3 * spread)
    room = 0.05 * (top - bottom)
    axes.set_ylim(*np.exp((bottom - room, top + room)) * scale)
    axes.set(xlim=(-1, len(shown)))
    axes.set_xticks([])
    axes.set_title(f"{cut(fleet.names[i], 24)} [{unit}]", fontsize=9, parse_math=False)
    plain(axes)


# -------- Plan
# The figure of a plan: gain over posture, and the expected std. errors.

COLOURS = (BLUE, ORANGE, GREEN, PINK, "#E69F00", "#56B4E9", "#000000")
"""Okabe and Ito's, one for each joint or other part."""
LISTED = 24
"""Listed postures up to which each has a bar of its own."""
DASHES = {"k_bend": "-", "k_tors": (0, (5, 2))}
BADGE: Style = {"marker": "s", "markersize": 10, "markerfacecolor": "white", "color": "black"}
"""A chosen posture."""
CROSS: Style = {"marker": "x", "markersize": 8, "markeredgewidth": 2.2, "color": ORANGE}
"""A posture that was measured before."""


def plan_figure(plan: "CampaignPlan") -> Figure:
    """Draw gain per hour over posture with the chosen experiments, and the standard deviations after each of them."""
    title = f"What to measure next on {cut(plan.arm.name, 50)}"
    figure = titled((13.0, 6.2), title, (0.12, 0.08), wspace=0.03)
    left, right = figure.subplots(1, 2, width_ratios=(1.25, 1.0))
    _gain_over_posture(figure, left, plan)
    _sd_over_experiments(right, plan)
    return figure


def _gain_over_posture(figure: Figure, axes: Axes, plan: "CampaignPlan") -> None:
    gain, postures, workspace = 60 * plan.gain_over_grid, plan.grid.postures, plan.arm.workspace
    scattered = plan.grid.sampled or bool(workspace.postures)
    listed = bool(workspace.postures) and len(postures) <= LISTED
    shown = main_joints(postures, gain) if workspace.line is None else [int(np.flatnonzero(workspace.line)[0])]
    names = [plan.arm.driven[i].name for i in shown]
    angles = np.rad2deg(postures[:, shown])
    plain(axes)
    if listed:
        places = _bars(axes, plan, gain)
    elif len(shown) == 1:
        places = _curve(axes, plan, angles[:, 0], gain, shown[0])
    else:
        drawn = _map(axes, angles, gain, sampled=scattered)
        colour_bar(figure, axes, drawn, _gain_label(plan)).outline.set_visible(False)
        axes.set_ylabel(f"{cut(names[1], 30)} [deg]", fontsize=10, parse_math=False)
        places = {i: tuple(np.rad2deg(q[shown])) for i, q in enumerate(plan.predictions.postures)}
    if not listed:
        axes.set_xlabel(f"{cut(names[0], 30)} [deg]", fontsize=10, parse_math=False)
        for axis, of_joint in zip((axes.xaxis, axes.yaxis), angles.T, strict=False):
            axis.set_major_locator(FixedLocator(_ticks(of_joint).tolist()) if not scattered else MaxNLocator(9))
    _mark(axes, plan, places)
    entries: dict[str, Any] = {"chosen, in this order; from 2 on for what is not yet known then": BADGE}
    if plan.measured.any():
        entries["measured before"] = CROSS
    others = [] if listed else [joint.name for i, joint in enumerate(plan.arm.driven) if i not in shown]
    where = "at any angle" if scattered else "at the best angle"
    rest = f"; {', '.join(cut(name, 20) for name in others)} {where}" if others else ""
    if workspace.line is not None:
        rest = f" on the line ({', '.join(f'{share:g}' for share in workspace.line)})"
    heading(axes, f"Gain of a first experiment over posture{rest}", entries)


def _curve(axes: Axes, plan: "CampaignPlan", angles: np.ndarray, gain: np.ndarray, joint: int) -> dict[int, Any]:
    """Draw the gain over one joint's angle, also through measured postures beside the grid; return where each is."""
    heights = 60 * plan.best_gain
    places = {
        i: (math.degrees(q[joint]), height)
        for i, (q, height) in enumerate(zip(plan.predictions.postures, heights, strict=True))
    }
    line = plan.arm.workspace.line
    on_line = [
        line is None or np.allclose(q, q[joint] / line[joint] * np.array(line)) for q in plan.predictions.postures
    ]
    beside = [i for i in range(len(heights)) if i not in plan.grid.seen and on_line[i]]
    x = np.append(angles, [places[i][0] for i in beside])
    y = np.append(gain, heights[beside])
    order = np.argsort(x)
    axes.plot(x[order], y[order], color=BLUE, marker="o", markersize=4)
    axes.set(ylabel=_gain_label(plan), ylim=(0, 1.12 * float(np.nanmax(y))))
    return places


def _bars(axes: Axes, plan: "CampaignPlan", gain: np.ndarray) -> dict[int, Any]:
    """Draw a bar for each listed posture; return where the bars of those that show different things end."""
    rows(axes, [degrees(posture) for posture in plan.grid.postures])
    axes.barh(range(len(gain)), np.nan_to_num(gain), height=0.5, color=PALE_BLUE)
    axes.set(xlim=(0, 1.15 * float(np.nanmax(gain))), xlabel=_gain_label(plan))
    first = {int(place): row for row, place in reversed(list(enumerate(plan.grid.seen)))}
    return {place: (float(gain[row]), row) for place, row in first.items() if place < len(plan.best_gain)}


def _gain_label(plan: "CampaignPlan") -> str:
    words, unit = criterion_in_words(plan)
    return f"expected gain per hour [{unit}/h]: {cut(words, 60)}"


def _map(axes: Axes, angles: np.ndarray, gain: np.ndarray, *, sampled: bool) -> Any:
    if sampled:
        order = np.argsort(gain)
        return axes.scatter(angles[order, 0], angles[order, 1], c=gain[order], cmap="viridis", s=22, linewidths=0)
    x, y = (np.unique(angles[:, k].round(6)) for k in (0, 1))
    table = np.full((len(y), len(x)), np.nan)
    for (a, b), value in zip(angles.round(6), gain, strict=True):
        i, j = np.searchsorted(y, b), np.searchsorted(x, a)
        table[i, j] = np.fmax(table[i, j], value)
    return axes.pcolormesh(_edges(x), _edges(y), table, cmap="viridis")


def _edges(centres: np.ndarray) -> np.ndarray:
    """Return the borders of cells about the centres."""
    half = np.diff(centres) / 2 if len(centres) > 1 else np.array([5.0])
    return np.array([centres[0] - half[0], *(centres[:-1] + half), centres[-1] + half[-1]])


def _ticks(angles: np.ndarray) -> np.ndarray:
    """Return angles of the grid, zero among them if it is one, few enough to be read."""
    values = np.unique(angles.round(6))
    every = -(-len(values) // 13)
    return values[int(np.argmin(np.abs(values))) % every :: every]


def _mark(axes: Axes, plan: "CampaignPlan", places: dict[int, Any]) -> None:
    """Mark postures that were measured, and number the chosen ones beside; several numbers share a place."""
    for i in set(np.flatnonzero(plan.measured).tolist()) & set(places):
        axes.plot(*places[i], linestyle="", zorder=3, clip_on=False, **CROSS)
    numbers: dict[tuple[float, float], list[str]] = {}
    for number, experiment in enumerate(plan.batch, 1):
        if experiment.place not in places:  # measured before, but not listed
            continue
        x, y = places[experiment.place]
        numbers.setdefault((round(float(x), 3), round(float(y), 6)), []).append(str(number))
    for place, texts in numbers.items():
        box = {"boxstyle": "round,pad=0.25", "facecolor": "white", "edgecolor": "black"}
        look: Style = {"ha": "center", "va": "center", "color": "black", "fontsize": 9, "fontweight": "bold"}
        note(axes, ", ".join(texts), place, (13, 13), **look, bbox=box, zorder=4)


def _sd_over_experiments(axes: Axes, plan: "CampaignPlan") -> None:
    """Draw the standard deviations of theta at the best estimate, now and after each experiment."""
    sd, experiments = 100 * plan.sd, range(len(plan.steps) + 1)
    parts = list(dict.fromkeys(name.split(".")[0] for name in plan.known.sought))
    entries: dict[str, Any] = {}
    for i, name in enumerate(plan.known.sought):
        colour = COLOURS[parts.index(name.split(".")[0]) % len(COLOURS)]
        style: Style = {"color": colour, "linestyle": DASHES.get(name.rpartition(".")[2], ":"), "linewidth": 1.8}
        axes.plot(experiments, sd[:, i], marker="o", markersize=4, **style)
        entries[cut(name, 28)] = style
    axes.set_yscale("log")
    axes.set(ylabel="std. error of ln(value) x 100, at the best estimate")
    top, bottom = sd.max() * 1.3, min(sd.min() * 0.7, 4.0)
    axes.set(ylim=(bottom, top))
    if bottom < 5.0 < top:
        axes.axhline(5.0, color=GREY, linewidth=0.9, zorder=1)
        place: dict[str, Any] = {"ha": "right", "va": "bottom", "transform": axes.get_yaxis_transform()}
        axes.text(0.995, 5.0, "5 %", color=GREY, fontsize=8, **place)
    steps = (1.0, 2.0, 5.0) if top > 10 * bottom else (1.0, 1.2, 1.5, 2.0, 3.0, 5.0, 7.0)
    set_ticks(axes.yaxis, LogLocator(subs=steps, numticks=12), "{:.4g}".format)
    axes.set(xlim=(-0.15, len(plan.steps) + 0.15))
    labels = ["now"] + [
        f"{i}: {cut(experiment_in_words(experiment), 34)}\n{cut(degrees(experiment.posture), 34)}"
        for i, experiment in enumerate(plan.batch, 1)
    ]
    slanted: Style = {"rotation": 30, "ha": "right"} if len(labels) > 3 else {}
    axes.set_xticks(list(experiments), labels, parse_math=False, rotation_mode="anchor", **slanted)
    plain(axes)
    heading(axes, "Expected std. errors", entries, columns=3)
