"""The printed report of a check before any solving."""

import math
from collections.abc import Iterator

import numpy as np

from ident.identify.check import CampaignCheck
from ident.identify.label_checks import LabelDoubt
from ident.inference.information import WEAK_ABOVE, Information
from ident.inference.leverage import Leverage
from ident.inference.optima import Optimum, is_tie
from ident.inference.parameters import Parameter
from ident.measure import Measurement
from ident.present.text.agreement import agreement, dependence_on_priors, reconciling
from ident.present.text.directions import in_words, spread_in_words
from ident.present.text.ramps import ramps_told
from ident.present.text.springs import springs_in_words
from ident.present.text.units import in_read_unit, unit_of
from ident.present.text.words import (
    balance,
    correlated_errors,
    cut,
    describe,
    drive_states,
    kept,
    odd_numbers,
    paragraphs,
    parameter_in_words,
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
