"""The report of a check before any fit, and its table."""

import math
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ident.identify.data_checks import row_names
from ident.identify.label_checks import LabelDoubt
from ident.inference.fit import contradiction_in_words
from ident.inference.information import WEAK_ABOVE, chi_squared_in_words
from ident.inference.optima import is_tie
from ident.report.report import Finding, Part, Report, Section, Verdict, by_head, by_row, cut
from ident.report.words import (
    balance,
    counted,
    describe,
    in_read_unit,
    in_words,
    parameter_in_words,
    percent,
    row_in_file,
    scatter,
    sentence,
    unit_of,
    with_tied,
)
from ident.studies.stiffness.warnings import (
    agreement,
    contradiction,
    dependence_on_priors,
    drive_states,
    explanation_section,
    hysteresis,
    kinds_agree,
    leading_explanations,
    odd_numbers,
)

if TYPE_CHECKING:
    from ident.identify.check import CampaignCheck, SpringCheck
    from ident.inference.identifiability import Leverage
    from ident.inference.parameters import Parameter


SLIGHT = 0.05
"""Change, relative to the leading parameter, below which another parameter hardly takes part in a trade-off."""
FEW = 24
"""Largest number of measurements that are all listed; above, only influential and idle ones."""
LISTED = 40
"""Measurements or warnings listed at most."""
MOST = 6
"""Rows with an ambiguous label named at most."""
ENORMOUS = 1e3
"""Factor above which no number is printed."""
WORDS = {"open": "not determined", "not seen": "not measured"}
"""Words of the report for a verdict, where they differ."""


def check_sections(check: "CampaignCheck") -> Report:
    """Return the report of a check."""
    causes = leading_explanations(check.explanations, check.campaign)
    conflict = contradiction(check.cross_predictions, check.campaign)
    name = cut(check.campaign.name or "a campaign", 30)
    words = (WORDS.get(verdict, verdict) for verdict in check.verdicts)
    reasons = (_reason(check, i) for i in range(len(check.items)))
    rows = zip(map(with_tied, check.items), words, reasons, strict=True)
    unknowns = by_head(("Unknown", "verdict", "std. error by the data alone"), rows)
    return Report(
        f"Check of {name} on {cut(check.arm.name, 40)} before any fit: "
        f"{counted(len(check.campaign), 'measurement')}, {counted(len(check.verdicts), 'unknown')}",
        _verdict(check),
        (*conflict, *causes, unknowns),
        tuple(_findings(check, explained=bool(causes))),
        _consistency(check),
        "ident fit {campaign}" if check.verdicts.count("identifiable") else "ident plan {campaign}",
        tuple(_details(check)),
    )


def _verdict(check: "CampaignCheck") -> Verdict:
    """Judge a campaign: READY TO FIT, PARTLY where some unknowns are identifiable, NOT READY for none or conflict."""
    count, fine = len(check.verdicts), check.verdicts.count("identifiable")
    if check.missing.any():
        text = f"The model has no answer for {int(check.missing.sum())} rows at the arm file's values."
        return Verdict("NOT READY", f"{text} The arm has no stable equilibrium there.", "bad")
    known = f"The data alone determine {f'{fine} of' if fine else 'none of the'} {count} unknowns"
    if check.repeats:
        return Verdict("NOT READY", f"The measurements contradict each other. {known}.", "bad")
    if check.contradictory:
        return Verdict("NOT READY", f"{sentence(contradiction_in_words(check.cross_predictions))} {known}.", "bad")
    if check.others and check.others.exact:
        others = counted(len(check.others.exact), "other set")
        return Verdict("NOT READY", f"Not unique: {others} of values would give the same data. {known}.", "bad")
    if not fine:
        return Verdict("NOT READY", f"The data alone determine none of the {count} unknowns.", "bad")
    if fine < count:
        return Verdict(f"PARTLY {fine} OF {count}", f"{known}.", "caution")
    searched = f" in {counted(check.others.starts, 'start')}" if check.others else ""
    known = f"The data determine all {count} unknowns; no second solution was found{searched}."
    return Verdict("READY TO FIT", known, "good")


def _reason(check: "CampaignCheck", i: int) -> str:
    if check.information is None:
        return "-"
    if check.verdicts[i] == "unknown":
        return "the model has no answer at most of the points"
    if check.verdicts[i] == "not seen":
        return "no measurement depends on it"
    sd, fine = check.data_sd[:, i], int(check.supported[:, i].sum())
    here = _within(sd[0]) if np.isfinite(sd[0]) else "only in combination with others"
    worse = np.isfinite(sd).all() and sd.max() > 1.3 * sd[0] and sd[0] < math.log(ENORMOUS)
    lucky = f"; identifiable at {fine} of {check.answered} points" if 0 < fine < check.answered else ""
    where = "" if lucky else " on plausible arms"  # the points are the arm file's values and the plausible arms
    worst = f" (at worst {_within(sd.max())}{where})" if worse else ""
    return here + worst + lucky


def _within(sd: float) -> str:
    return f"above factor {ENORMOUS:g}" if sd >= math.log(ENORMOUS) else scatter(sd)


def _consistency(check: "CampaignCheck") -> str:
    """Say in one line whether the data agree."""
    agree = check.consistency
    if agree is None or check.contradictory:
        return ""
    if check.cross_predictions:
        return kinds_agree(check.cross_predictions)
    return "There is one kind of measurement only, so that no other can check it."


def _findings(check: "CampaignCheck", *, explained: bool) -> Iterator[Finding]:
    """Yield the findings that affect the verdict, most important first."""
    measured, names = check.campaign.measurements, row_names(check.campaign)
    yield from odd_numbers(check.arm, check.problem.parameters)
    if check.missing.any():
        rows = ", ".join(names[i] for i in np.flatnonzero(check.missing)[:MOST].tolist())
        text = f"no equilibrium at the postures of rows {rows}"
        yield Finding(text, "raise the stiffnesses, or check loads and masses")
    for i, j in check.repeats:
        values = " and ".join(f"{in_read_unit(m.kind, m.value)[0]:.4g}" for m in (measured[i], measured[j]))
        unit = in_read_unit(measured[i].kind, 0.0)[1]
        rows = f"rows {names[i]} and {names[j]}"
        yield Finding(f"{rows} measured the same and differ: {values} {unit}", "measure it again")
    if check.contradictory and not explained:
        yield Finding(dependence_on_priors(check.cross_predictions), "check values, labels, units and load cases first")
    yield from drive_states(check.arm, check.campaign)
    if check.tried > check.answered:
        yield Finding(f"the model has no answer at {check.tried - check.answered} of {check.tried} points tried")
    part = check.leverage
    if part is not None and part.dominant.any():
        rows = ", ".join(names[i] for i in np.flatnonzero(part.dominant)[:MOST].tolist())
        several = bool(part.dominant.sum() > 1)
        text = f"nothing cross-checks row{'s' * several} {rows}: an error there would go unnoticed"
        yield Finding(text, f"repeat {'them' if several else 'it'}, or add others")
    for number, doubt in enumerate(check.labels[:LISTED]):
        name = names[doubt.row]
        row = f"row {name}" if number else row_in_file(measured[doubt.row], name)
        yield Finding(f"{row}: {'; '.join(_doubt(check, doubt))}", "compare its mode shape first" * doubt.near_draw)


# -------- Details


def _details(check: "CampaignCheck") -> Iterator[Section]:
    meaning = (
        f"identifiable: the std. error is below a factor of {math.exp(WEAK_ABOVE):.2g} at all {check.tried} points "
        "tried (plausible arms): the arm file's values and others about them, since one point may mislead. Priors do "
        "not count. not determined: the data alone do not determine it at any of these points."
    )
    yield Section("What the verdicts mean", (meaning,))
    yield from _others(check)
    yield from _combinations(check)
    yield from springs_in_words(check.springs)
    yield from _measurements(check)
    yield from hysteresis(check.campaign, check.ramps)
    yield from _ambiguous_names(check)
    yield from _agreement(check)
    yield from explanation_section(check.explanations, check.campaign)


def _others(check: "CampaignCheck") -> Iterator[Section]:
    """Yield the other values that give the same data, or that the search met none."""
    others, items = check.others, check.problem.parameters.items
    if others is None:
        return
    rows = []
    for found in (*others.exact, *others.near):
        cost = "0" if is_tie(0.0, found.cost) else f"{found.cost:.2g}"
        rows.append((", ".join(map(_changed, items, found.values.tolist())), cost))
    note = "chi-squared: of exact data at these values; below 3.84 the data hardly rule them out." * bool(others.near)
    table = [by_head(("values relative to the arm file's", "chi-squared"), rows, note=note)] if rows else []
    text = (
        f"{others.ended} of {others.starts} starts ended in an optimum. The search is not exhaustive: finding none "
        "does not prove uniqueness. Data: as predicted at the arm file's values; priors do not count."
    )
    yield Section("Other values that give the same data" + ("" if rows else ": none found"), (*table, text))


def _changed(item: "Parameter", value: float) -> str:
    start = float(item.start)
    change = f"{value / start:.3g} times" if item.positive and start else f"{value:.4g} {unit_of(item.name)}"
    return f"{item.name} {change}"


def _combinations(check: "CampaignCheck") -> Iterator[Section]:
    known = check.information
    if known is None:
        return
    items, count = check.items, len(known.names)
    rows = []
    for trade in known.trade_offs():
        alone = np.count_nonzero(np.abs(trade.change) > SLIGHT) == 1
        such = "any value fits equally well" if alone else f"not determined, such as {in_words(trade, items)}"
        rows.append((balance(trade.change.tolist(), items, SLIGHT), such))
    rows += [
        (balance(direction.weights.tolist(), items), f"known to {_within(direction.sd)} only")
        for direction in known.directions
        if direction.weak
    ]
    parts: list[Part] = [by_head(("combination", "from these data"), rows)] if rows else []
    seen = [d.sd for d in known.directions if not d.open]
    if len(seen) > 1:
        infinite = f" (of all {count}: infinite)" if known.fixed < count else ""
        parts.append(f"Condition number of the {known.fixed} determined: {seen[-1] / seen[0]:.3g}{infinite}.")
    correlation = np.triu(np.nan_to_num(known.correlation), 1)
    if correlation.any():
        i, j = np.unravel_index(np.argmax(np.abs(correlation)), correlation.shape)
        pair = f"between {parameter_in_words(items[i])} and {parameter_in_words(items[j])}"
        parts.append(f"Largest correlation {correlation[i, j]:+.2f}, {pair}.")
    yield Section(f"Determined by the data: {known.fixed} of {count} combinations", tuple(parts))


def _measurements(check: "CampaignCheck") -> Iterator[Section]:
    part = check.leverage
    if part is None:
        return
    every, measured = len(check.campaign) <= FEW, check.campaign.measurements
    unknowns, names = [item.name for item in check.items], row_names(check.campaign)
    empty, dominant = part.empty, part.dominant
    places = np.arange(len(measured)) if every else np.flatnonzero(empty | dominant)
    rows = []
    for i in places[:LISTED].tolist():
        remark = "carries no information" if empty[i] else _dominates(part, i) if dominant[i] else ""
        most = unknowns[part.sees[i]] if part.sees[i] >= 0 else "nothing"
        shared = 1 - min(part.leverage[i], 1)
        rows.append((names[i], describe(measured[i]), float(part.share[i]), float(shared), most, remark))
    note = (
        "information: share of all. redundancy: share of its information that other measurements also provide "
        "(0 % = cannot be cross-checked)."
    )
    if len(places) > LISTED:
        note += f" {len(places) - LISTED} more carry no information or dominate."
    if not every:
        note += f" The other measurements of {len(measured)} have normal influence."
    heads = "row", "measurement", "information|.1%", "redundancy|.0%", "depends most on", ""
    yield Section("Influence of each measurement", (by_head(heads, rows, note=note),))


def _dominates(part: "Leverage", i: int) -> str:
    lost = f"; without it {', '.join(part.lost[i])} not identifiable" if part.lost[i] else ""
    return f"dominates{lost or '; one combination not determined without it' * bool(part.opened[i])}"


def _ambiguous_names(check: "CampaignCheck") -> Iterator[Section]:
    measured, names = check.campaign.measurements, row_names(check.campaign)
    if changing := sorted(check.changing.items(), key=lambda each: -each[1]):
        rows = ((names[i], str(measured[i].mode), f"{percent(often)} of the arms") for i, often in changing[:MOST])
        note = f"{len(changing) - MOST} more. " if len(changing) > MOST else ""
        note += (
            "The fit matches these modes by frequency as well. If you are not sure of a word, leave it out of the "
            "label (`torsion 2`), or leave the label out."
        )
        title = "Mode names that become ambiguous for other stiffnesses within the prior"
        yield Section(title, (by_head(("row", "mode", "ambiguous on"), rows, note=note),))


def _doubt(check: "CampaignCheck", doubt: LabelDoubt) -> Iterator[str]:
    if doubt.near_draw:
        yield f"{doubt.mode} is a borderline name: a small change of the arm may rename the mode"
    if doubt.crossing:
        others = " and ".join(map(str, doubt.crossing))
        yield f"no label, and taken for {doubt.mode}, which nearly has the frequency of {others}: label it"
    if doubt.alike is not None:
        other = row_names(check.campaign)[doubt.alike]
        yield f"no label, and taken for {doubt.mode}, although row {other}, for another mode, is equal: label both"


def springs_in_words(springs: Sequence["SpringCheck"]) -> Iterator[Section]:
    """Yield whether the data can tell each spring from a linear one, and its load in the measurements."""
    lines = []
    for each in springs:
        cost = f"a linear one would fit with a chi-squared of {each.chi_squared:.2g}"
        cost = "with a linear one the arm has no equilibrium" if math.isnan(each.chi_squared) else cost
        parts = {"at rest": each.at_rest, "where modes were measured": each.vibrating}
        loads = [f"{low:.3g} to {high:.3g} N m {what}" for what, (low, high) in parts.items() if not math.isnan(high)]
        limit = "" if math.isnan(each.torque1) else f"; T1 = {each.torque1:.3g} N m"
        lines.append(f"{each.spring}: {'yes' if each.told else 'NO'}, {cost}. Load {', '.join(loads)}{limit}.")
        lines += ["Hardly loaded wherever modes were measured: frequencies depend on K1 alone."] * each.unloaded
        lines += [] if each.told else ["Fix its numbers, or measure under loads on both sides of T1."]
    if lines:
        title = "Curved springs: can the data (as predicted at the arm file's values) tell them from linear ones?"
        yield Section(title, tuple(lines))


def _agreement(check: "CampaignCheck") -> Iterator[Section]:
    agree = check.consistency
    if agree is None:
        return
    note = "Overall consistency cannot be tested by linearisation (start values too far off): see `ident fit`."
    if not math.isnan(agree.p_value) or not agree.degrees_of_freedom > 0:
        note = f"All together, by linearisation: {chi_squared_in_words(agree)}."
    yield agreement(check.cross_predictions, check.campaign, note)


# -------- Rows


def check_rows(check: "CampaignCheck") -> list[dict[str, Any]]:
    """Return a row for each parameter: verdict, and standard deviations of theta from the data alone [-].

    NaN where the model has no solution.
    """
    sd = check.data_sd if len(check.data_sd) else np.full((1, len(check.items)), math.nan)
    names = [item.name for item in check.items]
    return by_row(parameter=names, verdict=check.verdicts, data_sd=sd[0], worst_data_sd=sd.max(0))
