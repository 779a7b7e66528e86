"""The printed reports of checks before any solving, comparisons, validations and profiles."""

import math
from collections.abc import Iterator, Sequence
from itertools import chain

import numpy as np

from ident.identify.check import CampaignCheck
from ident.identify.compare import Comparison, Validation
from ident.identify.fit import CampaignFit
from ident.identify.problem import LabelDoubt
from ident.inference.change import LEVEL
from ident.inference.identifiability import Leverage
from ident.inference.information import WEAK_ABOVE, Information, holm
from ident.inference.optima import Ending, Optimum, is_tie
from ident.inference.parameters import Parameter
from ident.inference.profile import FLAT, Interval, Profile, threshold
from ident.inference.scrutiny import HeldOut
from ident.measure import Measurement
from ident.present.text.basis import springs_in_words
from ident.present.text.warnings import agreement, dependence_on_priors, ramps_told, reconciling
from ident.present.text.words import (
    balance,
    correlated_errors,
    cut,
    describe,
    drive_states,
    in_read_unit,
    in_shown_unit,
    in_words,
    kept,
    odd_numbers,
    paragraphs,
    parameter_in_words,
    percent,
    priors_in_words,
    spread_in_words,
    unit_of,
)

CORRELATED = 0.9
"""Correlation from which a pair of parameters is named."""
SLIGHT = 0.05
"""Change, relative to the parameter that leads, below which another one hardly takes part in a trade-off."""
FEW = 24
"""Measurements up to which all are listed; beyond, only those that matter or do not."""
LISTED = 40
"""Measurements, or doubts, that are listed at most."""
MOST = 6
"""Rows named, at most, whose label may change."""
ENORMOUS = 1e3
"""Factor beyond which it is no longer told how large."""


def check_report(check: CampaignCheck) -> str:
    """Return the report of a check: verdicts, directions, measurements, mode labels, the data among themselves."""
    sections = [
        _heading(check),
        _verdicts(check),
        _others(check),
        _directions(check),
        springs_in_words(check.springs),
        _measurements(check),
        ramps_told(check.campaign, check.ramps),
        _labels(check),
        _agreement(check),
        reconciling(check.explanations, check.campaign),
    ]
    return paragraphs(sections)


def _heading(check: CampaignCheck) -> Iterator[str]:
    count = len(check.verdicts)
    yield f"Check of {check.campaign.name or 'a campaign'} on {check.arm.name}, before any solving"
    fine = check.verdicts.count("identifiable")
    known = f"{fine} of {count} identifiable by the data alone"
    near = ", but only near these values (see below)" if check.others and check.others.exact else ""
    yield f"  {len(check.campaign)} measurements, {count} unknowns: {known}{near}"
    yield from odd_numbers(check.arm)
    yield from correlated_errors(check.campaign)
    yield from drive_states(check.arm, check.campaign)
    if check.tried > check.answered:
        yield f"  WARNING: the model has no answer at {check.tried - check.answered} of {check.tried} points looked at"
    if check.missing.any():
        yield "  WARNING: nothing can be said, as the model has no answer at the arm file's values for"
        rows = np.flatnonzero(check.missing).tolist()
        yield from (f"    {_row(check, i)}" for i in rows[:5])
        yield from [f"    and {len(rows) - 5} more"] if len(rows) > 5 else []
        yield "  The arm has no stable equilibrium there: raise the stiffnesses, or check loads and masses."
        yield "  Unknown is not fine: no other verdict is given."


def _verdicts(check: CampaignCheck) -> Iterator[str]:
    yield "Parameter            verdict         known by the data alone, within"
    for i, (item, verdict) in enumerate(zip(check.items, check.verdicts, strict=True)):
        yield f"  {item.name:18s} {verdict:15s} {_reason(check, i)}"
        for other in item.paths[1:]:
            yield f"    = {other}"
    if check.information is None:
        return
    limit = math.exp(WEAK_ABOVE)
    yield (
        f"  identifiable: one sd is less than a factor of {limit:.2g} at all {check.tried} points looked at: the"
        " arm file's values and others about them, since one point may mislead. Priors count nothing here."
    )
    if "open" in check.verdicts:
        yield "  open: the data alone leave it open at all these points."


def _others(check: CampaignCheck) -> Iterator[str]:
    """Yield which other values give the same data, or that none were found."""
    others, items = check.others, check.problem.parameters.items
    if others is None:
        return
    count = len(others.exact)
    if count:
        sets = "another set of values gives" if count == 1 else f"{count} other sets of values give"
        yield f"GLOBALLY NOT IDENTIFIABLE: {sets} the same data; only priors tell them apart"
    else:
        yield "Other values that give the same data: none were found"
    for optimum in (*others.exact, *others.near):
        yield f"  {_cost(optimum)}: {', '.join(map(_changed, items, optimum.values.tolist()))}"
    if others.near:
        yield "  chi-squared: what exact data would cost there; below 3.84 the data hardly rule it out"
    ended = f"{others.ended} of {others.starts} starts ended in an optimum"
    yield f"  {ended}: a search may miss some, so that none was found is no proof."
    yield "  Data as predicted at the arm file's values; priors count nothing."


def _cost(optimum: Optimum) -> str:
    return "chi-squared 0" if is_tie(0.0, optimum.cost) else f"chi-squared {optimum.cost:.2g}"


def _changed(item: Parameter, value: float) -> str:
    start = float(item.start)
    change = f"{value / start:.3g} times" if item.positive and start else f"{value:.4g} {unit_of(item.name)}"
    return kept(f"{item.name} {change}")


def _reason(check: CampaignCheck, i: int) -> str:
    if check.information is None:
        return "-"
    if check.verdicts[i] == "unknown":
        return "the model has no answer at most of the points"
    if check.verdicts[i] == "not seen":
        return "no measurement depends on it"
    sd, fine = check.data_sd[:, i], int(check.supported[:, i].sum())
    here = _within(sd[0]) if np.isfinite(sd[0]) else "nothing of it alone: seen only in combination with others"
    worst = f"; {_within(sd.max())} at worst" if np.isfinite(sd).all() and sd.max() > 1.3 * sd[0] else ""
    lucky = f"; identifiable at {fine} of {check.answered} points" if 0 < fine < check.answered else ""
    return here + worst + lucky


def _within(sd: float) -> str:
    return spread_in_words(sd) if sd < math.log(ENORMOUS) else f"a factor of more than {ENORMOUS:g}"


def _directions(check: CampaignCheck) -> Iterator[str]:
    known = check.information
    if known is None:
        return
    items, count = check.items, len(known.names)
    yield f"What the data see: {known.fixed} of {count} directions"
    trades = known.trade_offs()
    if trades:
        yield "  Null directions, of which they see nothing, or next to nothing:"
    for trade in trades:
        alone = np.count_nonzero(np.abs(trade.change) > SLIGHT) == 1
        fits = "any value fits" if alone else "any trade-off fits"
        yield f"    {balance(trade.change.tolist(), items, SLIGHT)}: {fits} equally well"
        if not alone:
            yield f"      such as {in_words(trade, items)}"
    weak = [d for d in known.directions if d.weak]
    if weak:
        yield "  Near-null directions, of which they see little:"
    for direction in weak:
        yield f"    {balance(direction.weights.tolist(), items)}: known within {_within(direction.sd)} only"
    seen = [d.sd for d in known.directions if not d.open]
    if len(seen) > 1:
        infinite = f" (of all {count}: infinite)" if known.fixed < count else ""
        yield f"  Condition number of the {known.fixed} that are seen: {seen[-1] / seen[0]:.3g}{infinite}"
    yield from _correlations(check, known)


def _correlations(check: CampaignCheck, known: Information) -> Iterator[str]:
    items = check.items
    correlation = np.triu(np.nan_to_num(known.correlation), 1)
    pairs = [tuple(map(int, pair)) for pair in np.argwhere(np.abs(correlation) > CORRELATED)]
    for i, j in sorted(pairs, key=lambda pair: -abs(correlation[pair]))[:10]:
        yield f"  Correlation {correlation[i, j]:+.3f} {_pair(items[i], items[j])}"
    if not pairs and correlation.any():
        i, j = (int(k) for k in np.unravel_index(np.argmax(np.abs(correlation)), correlation.shape))
        yield f"  Largest correlation {correlation[i, j]:+.2f}, {_pair(items[i], items[j])}"


def _pair(one: Parameter, other: Parameter) -> str:
    return f"between {parameter_in_words(one)} and {parameter_in_words(other)}"


def _measurements(check: CampaignCheck) -> Iterator[str]:
    part = check.leverage
    if part is None:
        return
    every = len(check.campaign) <= FEW
    names, share = [item.name for item in check.items], part.share
    yield f"{'Measurements, each with its row in the file':57s}  information  checked  depends most on"
    empty, dominant = part.empty, part.dominant
    rows = np.arange(len(check.campaign)) if every else np.flatnonzero(empty | dominant)
    for i in rows[:LISTED].tolist():
        remark = "carries no information" if empty[i] else _dominates(part, i) if dominant[i] else ""
        most = names[part.sees[i]] if part.sees[i] >= 0 else "nothing"
        numbers = f"{share[i]:13.1%} {1 - min(part.leverage[i], 1):8.0%}"
        yield f"  {cut(_row(check, i), 55):55s}{numbers}  {most}"
        yield from [f"       <-- {remark}"] if remark else []
    if len(rows) > LISTED:
        yield f"  and {len(rows) - LISTED} more that carry nothing or dominate"
    if not every:
        yield f"  The other measurements of {len(check.campaign)} neither dominate nor carry nothing."
    yield "  information: share of all; checked: how much of its message the others would tell without it."
    if dominant.any():
        yield "  What nothing checks is taken on trust: an error in such a value cannot be noticed."


def _dominates(part: Leverage, i: int) -> str:
    lost = f"; without it {', '.join(part.lost[i])} not identifiable" if part.lost[i] else ""
    opened = "; one direction open without it" if part.opened[i] and not part.lost[i] else ""
    return f"dominates{lost or opened}"


def _row(check: CampaignCheck, i: int) -> str:
    m = check.campaign.measurements[i]
    return f"{_number(m, i):>3s}  {describe(m)}"


def _number(m: Measurement, i: int) -> str:
    return m.where.rpartition(":")[2] or str(i + 1)


def _labels(check: CampaignCheck) -> Iterator[str]:
    modal = any(m.kind in ("frequency", "damping_ratio") for m in check.campaign)
    if not modal or check.missing.any():
        return
    yield "Mode labels, at the arm file's values" + ("" if check.labels else ": none is in doubt")
    for doubt in check.labels[:LISTED]:
        yield f"  {_row(check, doubt.row)}: {'; '.join(_doubt(check, doubt))}"
    if len(check.labels) > LISTED:
        yield f"  and {len(check.labels) - LISTED} more"
    yield from _changing(check)


def _changing(check: CampaignCheck) -> Iterator[str]:
    if not check.changing:
        return
    yield "Mode labels, on other arms within the prior: named by a near draw, or no mode's, in these rows"
    rows = sorted(check.changing.items(), key=lambda each: -each[1])
    for i, often in rows[:MOST]:
        m = check.campaign.measurements[i]
        yield f"  row {_number(m, i)}, {m.mode}: on {often:.0%} of the arms that were tried"
    if len(rows) > MOST:
        yield f"  and {len(rows) - MOST} more"
    yield (
        "  There the fit tells modes by their frequencies, too. Where you are not sure of a word, leave it out of the"
        " label (`torsion 2`), or the label out of the row."
    )


def _doubt(check: CampaignCheck, doubt: LabelDoubt) -> Iterator[str]:
    if doubt.near_draw:
        yield f"its mode, {doubt.mode}, is named by a near draw: a small change may rename it"
    if doubt.crossing:
        others = " and ".join(map(str, doubt.crossing))
        yield f"no label, and taken for {doubt.mode}, which nearly has the frequency of {others}: label it"
    if doubt.alike is not None:
        other = _number(check.campaign.measurements[doubt.alike], doubt.alike)
        yield f"no label, and taken for {doubt.mode}, though row {other}, for another mode, is the same: label both"


def _agreement(check: CampaignCheck) -> Iterator[str]:
    measured = check.campaign.measurements
    for i, j in check.repeats:
        values = " and ".join(f"{in_read_unit(m.kind, m.value)[0]:.4g}" for m in (measured[i], measured[j]))
        rows = f"rows {_number(measured[i], i)} and {_number(measured[j], j)}"
        unit = in_read_unit(measured[i].kind, 0.0)[1]
        yield f"CONTRADICTION: {rows} measured the same, but say {values} {unit}"
    agree = check.consistency
    if agree is None:
        return
    if not check.cross_predictions:
        yield "Do the kinds of measurement agree? There is one only, or none tells of another."
    else:
        yield "Do the kinds of measurement agree? Each one, against the others and the priors:"
        yield from agreement(check.cross_predictions, measured)
    if not math.isnan(agree.p_value):
        fit = f"chi-squared {agree.chi_squared:.3g} on {agree.degrees_of_freedom} degrees of freedom"
        yield f"  All together, along a straight line: {fit}, p = {agree.p_value:.2g}"
    elif agree.degrees_of_freedom > 0:
        yield "  All together: not to be judged along a straight line, as the data lead too far from the arm file."
    if check.contradictory:
        yield f"  CONTRADICTION. {dependence_on_priors(check.cross_predictions)}"
        yield "  Look at values, labels, units and load cases of these rows first, then at masses and lengths."
        yield "  `ident fit` searches from more starts."


# -------- Compare
# The printed report of a comparison: what has changed, how sure that is, and what to look at.

KINDS = {"k_bend": "bending", "k_tors": "torsion"}
NUMBERS_LISTED = 5
"""Numbers that differ between the arm files that are named."""


def compare_report(comparisons: Sequence[Comparison], unpaired: Sequence[str] = ()) -> str:
    """Return the report: of many pairs an overview; of each a verdict, its stiffnesses, and what to look at."""
    parts = ((_compare_heading(each), _table(each), _advice(each), _remarks(each)) for each in comparisons)
    overview = [_overview(comparisons, unpaired)] if len(comparisons) > 1 or unpaired else []
    return paragraphs([*overview, *chain.from_iterable(parts)])


def _overview(comparisons: Sequence[Comparison], unpaired: Sequence[str]) -> Iterator[str]:
    together = holm([each.change.p_value for each in comparisons])
    yield f"{len(comparisons)} pair{'s' * (len(comparisons) > 1)} of campaigns"
    for each, p in zip(comparisons, together, strict=True):
        change = each.change
        names = [stiffness_words(name) for name, is_so in zip(change.names, change.changed, strict=True) if is_so]
        verdict = f"CHANGED: {', '.join(names) or 'something'}" if p < LEVEL else "no change seen"
        yield f"  {cut(each.name, 50):50s} p = {p:<8.2g} {verdict}"
    yield "  p: chance of so much change anywhere where nothing has changed, by Holm for the number of pairs"
    if unpaired:
        more = len(unpaired) - NUMBERS_LISTED
        named = ", ".join(cut(path, 60) for path in unpaired[:NUMBERS_LISTED]) + (
            f" and {more} more" if more > 0 else ""
        )
        yield f"  in one folder only: {named}"


def _compare_heading(comparison: Comparison) -> Iterator[str]:
    change = comparison.change
    before, after = (cut(name, 30) for name in comparison.names)
    arms = [f"{cut(fit.arm.name, 40)}: " for fit in comparison.fits[:1]]
    yield f"{''.join(arms)}{before}, then {after}"
    if comparison.independent:
        yield "  INDEPENDENCE ASSUMED: the measurements are not at hand, so what both have in common, such as a"
        yield "  prior, counts twice; logarithms of the stiffnesses are taken as normal"
    else:
        counts = " and ".join(str(len(fit.campaign)) for fit in comparison.fits)
        yield f"  {counts} measurements fitted together, {len(change.names)} changes free"
    test = f"T = {round(change.statistic, 6):.3g} on {change.mean:.1f} degrees of freedom, p = {change.p_value:.2g}"
    if not change.seen:
        yield f"  No change is seen: {test}."
    elif change.changed.any():
        named = (name for name, changed in zip(change.names, change.changed, strict=True) if changed)
        yield f"  CHANGED: {', '.join(map(stiffness_words, named))} ({test})."
    else:
        yield f"  CHANGED, but the data do not tell which stiffness for itself ({test})."
    alone = [name for name, p in zip(change.names, change.alone, strict=True) if p > LEVEL]
    if change.seen and alone:
        yield f"  One change alone would explain it: {' or '.join(map(stiffness_words, alone))}."


def stiffness_words(name: str) -> str:
    """Say which stiffness a path names: `joint2 in torsion`."""
    joint, _, field = name.rpartition(".")
    return f"{cut(joint, 24)} in {KINDS[field]}" if field in KINDS else cut(name, 30)


def _table(comparison: Comparison) -> Iterator[str]:
    change = comparison.change
    columns = f"{'change':>9s}   {'95 % interval':19s}{'p':>8s}"
    yield f"{f'Stiffness [{in_shown_unit(change.names[0], 1.0)[1]}]':20s}{'before':>12s}{'after':>12s}{columns}"
    for i, name in enumerate(change.names):
        before, after = (f"{in_shown_unit(name, float(part[i]))[0]:.4g}" for part in (change.first, change.second))
        verdict = "open" if change.open[i] else "<--" if change.changed[i] else ""
        low, high = map(ratio_words, change.interval[i])
        row = f"{ratio_words(change.change[i]):>9s}   {f'{low} to {high}':19s}{change.p_values[i]:8.2g}"
        yield f"  {cut(name, 18):18s}{before:>12s}{after:>12s}{row}   {verdict}".rstrip()
    yield "  p: chance of so large a change of one where nothing has changed (Holm); <-- changed for itself;"
    together = "" if comparison.independent else " All values by both campaigns together."
    yield f"  open: told by the prior of the change, a factor of e.{together}"


def ratio_words(log: float) -> str:
    """Write a change of a logarithm in percent, or as a factor where it is large: `-12 %`, `x 2.5`."""
    ratio = float(np.exp(log))
    return f"{100 * (ratio - 1):+.1f} %" if 0.5 < ratio < 2 else f"x {ratio:.3g}"


def _advice(comparison: Comparison) -> Iterator[str]:
    change = comparison.change
    changed = np.flatnonzero(change.changed)
    if not len(changed):
        return
    yield "What to look at"
    for i in changed:
        name = stiffness_words(change.names[i])
        if change.change[i] < 0:
            yield f"  {name} has become softer: bolts, bearing, gear or belt of that joint; a crack"
        else:
            yield f"  {name} has become stiffer: was something exchanged or tightened there, does something rub?"
    if len(changed) == len(change.names) > 1 and len(set(np.sign(change.change[changed]))) == 1:
        yield "  All have changed the same way: look first for another payload, mass or base, or another calibration."


def _remarks(comparison: Comparison) -> Iterator[str]:
    remarks = [
        f"WARNING: {which}: {doubt.replace('see below', 'see ident fit')}"
        for which, fit in zip(_told_apart(comparison), (comparison.first, comparison.second), strict=True)
        if isinstance(fit, CampaignFit)
        for doubt in fit.doubts
    ]
    if comparison.unlike:
        more = len(comparison.unlike) - NUMBERS_LISTED
        named = ", ".join(comparison.unlike[:NUMBERS_LISTED]) + (f" and {more} more" if more > 0 else "")
        remarks.append(f"WARNING: the arm files differ in {named}: a change may come from there")
    if comparison.priors_differ:
        remarks.append("the fits have other priors: those of the first count")
    if remarks:
        yield "Remarks"
        yield from (f"  {remark}" for remark in remarks)


def _told_apart(comparison: Comparison) -> tuple[str, str]:
    """Return the campaigns' names; where they have one name, which of the two it is."""
    before, after = (cut(name, 30) for name in comparison.names)
    return (before, after) if before != after else (f"{before} (before)", f"{after} (after)")


def level_words() -> str:
    """Say from which chance on a change counts."""
    return f"{LEVEL:.0%}"


# -------- Profile
# The printed report of profiles: intervals beside those of the linear approximation, and why each side ends.

SIDES = ("below", "above")


def profile_report(fit: CampaignFit, profiles: Sequence[Profile]) -> str:
    """Return the report of profiles: both kinds of interval, the nested ones, and remarks on what is not regular."""
    sections = [
        _profile_heading(fit, profiles),
        _profile_table(fit, profiles),
        _nested(profiles),
        _profile_remarks(profiles),
    ]
    return paragraphs(sections)


def _profile_heading(fit: CampaignFit, profiles: Sequence[Profile]) -> Iterator[str]:
    level = profiles[0].widest.level
    count = len(fit.problem.parameters.items)
    yield f"Profiles of the fit of {fit.arm.name} to {fit.campaign.name}"
    yield f"  {len(fit.campaign)} measurements, {count} unknowns, least cost {fit.best.cost:.4g}"
    yield f"  Each parameter is moved and all others are fitted again. {level_in_words(level)}: delta"
    yield f"  chi-squared is {threshold(level):.3g}, with one degree of freedom. Data and priors count, as in the fit."
    for prior in priors_in_words(fit.problem.parameters.items):
        yield f"  prior: {prior}"
    yield from drive_states(fit.arm, fit.campaign)
    for doubt in fit.doubts:
        yield f"  WARNING: {doubt.replace('see below', 'see ident fit')}"
    if fit.doubts:
        yield "  So the profiles show the shape of the cost; no interval below is to be quoted."


def _profile_table(fit: CampaignFit, profiles: Sequence[Profile]) -> Iterator[str]:
    level = level_in_words(profiles[0].widest.level)
    yield (f"{'Parameters':18s} {'fitted':>10s}  {f'{level}, linear':22s} {f'{level}, profile':22s} profile/linear")
    for profile in profiles:
        value, _ = in_shown_unit(profile.name, float(profile.values([profile.optimum])[0]))
        mark = "" if profile.linear else " <--"
        yield (
            f"  {profile.name:16s} {value:10.5g}  {interval_text(profile, profile.linear_interval):22s}"
            f" {interval_text(profile, profile.widest):22s} {_halves(profile)}{mark}"
        )
        for other in profile.item.paths[1:]:
            yield f"    = {other}"
    units = {in_shown_unit(profile.name, 1.0)[1]: profile.name for profile in profiles}
    each = ", ".join(f"{in_shown_unit(profile.name, 1.0)[1]} of {profile.name}" for profile in profiles)
    yield f"  in {next(iter(units)) if len(units) == 1 else each}"
    yield "  profile/linear: halves of the interval below and above the fitted value; <-- more than 20 % off"
    if any(0.0 in profile.halves for profile in profiles):
        yield "  only: closed by the profile only, the linear interval is open"


def _halves(profile: Profile) -> str:
    return " ".join(_half(half, ending) for half, ending in zip(profile.halves, profile.widest.endings, strict=True))


def _half(half: float, ending: Ending) -> str:
    if ending is Ending.OPEN:
        return "  open"
    return f"{half:6.2f}" if half else "  only"


def _nested(profiles: Sequence[Profile]) -> Iterator[str]:
    levels = [interval.level for interval in profiles[0].intervals]
    if len(levels) > 1:
        yield "At all levels     " + "".join(f"{level_in_words(level):24s}" for level in levels).rstrip()
        for profile in profiles:
            cells = "".join(f"{interval_text(profile, interval):24s}" for interval in profile.intervals)
            yield f"  {profile.name:16s}{cells}".rstrip()


def _profile_remarks(profiles: Sequence[Profile]) -> Iterator[str]:
    lines = [line for profile in profiles for line in remarks(profile)]
    if lines:
        yield "Remarks"
        yield from (f"  {line}" for line in lines)


def remarks(profile: Profile) -> Iterator[str]:
    """Say in words what is not regular about a profile: open sides, bounds, other optima, doubts on the search."""
    for side in (0, 1):
        yield from _side(profile, side)
    if profile.beaten:
        yield (
            f"{profile.name}: WARNING, on the way the cost fell {profile.beaten:.3g} below the fit's, which is not the"
            " best optimum; fit again with more starts (--starts)"
        )
    inside = profile.converged_inside
    if not inside.all():
        lost = f"{(~inside).sum()} of {len(inside)} points"
        yield f"{profile.name}: the search did not converge at {lost}; the profile may lie lower there"
    if profile.rivals:
        places = ", ".join(f"{value:.4g}" for value in profile.values(profile.rivals))
        yield f"{profile.name}: another optimum fits about as well outside this interval, at {places}"


def _side(profile: Profile, side: int) -> Iterator[str]:
    ending, theta = profile.widest.endings[side], (profile.widest.low, profile.widest.high)[side]
    need = threshold(profile.widest.level)
    if ending is Ending.MODEL:
        (value,) = profile.values([theta])
        yield f"{profile.name}: bounded {SIDES[side]} by the model, which has no answer beyond {value:.4g}"
    elif ending is Ending.OPEN:
        last = (0, -1)[side]
        (value,) = profile.values(profile.theta[[last]])
        delta = profile.delta_chi_squared[last]
        reason = "flat: nothing tells it" if profile.flat[side] else "too little tells it"
        reached = "stays zero" if delta < FLAT else f"reaches {delta:.2g} of {need:.3g}"
        there = f"as far as {value:.3g} delta chi-squared {reached}"
        yield f"{profile.name}: open {SIDES[side]}, {reason} on this side ({there})"


def interval_text(profile: Profile, interval: Interval) -> str:
    """Write an interval: two numbers, one where a side is open, or `open`."""
    ends = profile.values([interval.low, interval.high])
    low, high = (f"{in_shown_unit(profile.name, float(value))[0]:.4g}" for value in ends)
    below, above = (ending is Ending.OPEN for ending in interval.endings)
    if below or above:
        return "open" if below and above else f"below {high}" if below else f"above {low}"
    return f"{low} to {high}"


def level_in_words(level: float) -> str:
    """Write a level as `95 %`."""
    return f"{100 * level:.4g} %"


# -------- Validate
# The printed report of a validation: how well each part is predicted by the others, and how far to trust that.

PARTS = {"posture": "postures", "kind": "kinds of measurement", "row": "rows", "fraction": "fifths"}
"""What is left out at a time, in words."""


def validate_report(validation: Validation) -> str:
    """Return the report: a verdict, each part with its prediction, the scope, and what it does not reach."""
    return paragraphs([_validate_heading(validation), _parts(validation), _scopes(validation), _limits(validation)])


def _validate_heading(validation: Validation) -> Iterator[str]:
    fit, parts = validation.fit, validation.parts
    yield f"Validation of {cut(fit.arm.name, 30)} by {cut(fit.campaign.name, 30)}"
    yield f"  {len(parts)} {PARTS[validation.leave]}, each left out in turn and predicted by a fit to the others"
    if fit.loops:
        count = len(fit.loops)
        yield f"  Loops of ramps: {count}. What is left out is predicted at the width that the other rows of its loop"
        yield "  tell; where none stays, nothing tells it, and the part is not predicted: try --leave row"
    z = validation.z
    if not len(z):
        needed = "the stiffnesses, or the loops" if fit.loops else "the stiffnesses"
        yield f"  NOTHING is predicted: what is left out is needed to tell {needed}. Measure more."
        return
    yield f"  {validation.covered} of {len(z)} measurements lie in the 95 % interval of their prediction"
    if validation.missed:
        named = ", ".join(cut(part.name, 30) for part in validation.missed)
        yield f"  NOT to be trusted: too far from the prediction: {named}"
    yield from drive_states(fit.arm, fit.campaign)
    for doubt in fit.doubts:
        yield f"  WARNING: {doubt.replace('see below', 'see ident fit')}"


def _parts(validation: Validation) -> Iterator[str]:
    yield f"{'Left out':34s}{'rows':>5s}{'rms off':>10s}{'largest':>10s}{'expected':>10s}{'p':>9s}"
    missed = {part.name for part in validation.missed}
    for part in validation.parts:
        yield _validate_row(part, part.name in missed)
    yield "  off: measured less predicted, as a share of the measured value; expected: rms by the model's own"
    yield "  standard deviations, of noise and what the others leave open; p: chance of so far off, together"


def _validate_row(part: HeldOut, missed: bool) -> str:
    row = f"  {cut(part.name, 32):32s}{len(part.places):5d}"
    if not part.told:
        return f"{row}   {'no optimum without it' if not part.ended else 'not told by the others'}"
    size = np.where(part.measured == 0, np.nan, np.abs(part.measured))
    off, sd = np.abs(part.off) / size, part.sd / size
    numbers = (np.sqrt(np.nanmean(off**2)), np.nanmax(off), np.sqrt(np.nanmean(sd**2)))
    cells = "".join(f"{percent(float(number)):>10s}" for number in numbers)
    return f"{row}{cells}{part.p_value:9.2g}{'   <--' if missed else ''}"


def _scopes(validation: Validation) -> Iterator[str]:
    if not validation.scopes:
        return
    yield "What was not measured: 95 % of measurements like these will lie within the larger of two spans"
    for scope in validation.scopes:
        kind, parts = scope.kind.replace("_", " "), f"{scope.folds} part{'s' * (scope.folds > 1)}"
        why = f"seen {percent(scope.seen)} in {parts}, expected {percent(scope.expected)}"
        yield f"  {kind:24s}within {percent(scope.half):8s} ({why})"


def _limits(validation: Validation) -> Iterator[str]:
    campaign = validation.fit.campaign
    yield "Within what was measured, and no further"
    angles = np.degrees(np.array([m.posture for m in campaign]))
    joints = (cut(joint.name, 16) for joint in validation.fit.arm.driven)
    ends = zip(joints, angles.min(0), angles.max(0), strict=True)
    spans = (f"{joint} {low:.4g} to {high:.4g}" for joint, low, high in ends)
    yield f"  postures [deg]: {', '.join(spans)}"
    yield f"  loads: {', '.join(dict.fromkeys(cut(str(m.load), 30) for m in campaign))}"
    frequencies = [m.value for m in campaign if m.kind == "frequency"]
    if frequencies:
        yield f"  frequencies: {min(frequencies):.3g} to {max(frequencies):.3g} Hz"
