"""The report of a fit, its table, and the table of its measurements."""

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from ident.arm.fields import ALPHA
from ident.identify.data_checks import row_names
from ident.identify.unknowns import is_damping, is_of_loop
from ident.inference.information import OPEN_ABOVE, WEAK_ABOVE, Information, chi_squared_in_words, half_width
from ident.inference.optima import unmet
from ident.measure import KINDS
from ident.report.report import (
    Cell,
    Finding,
    Report,
    Section,
    Table,
    Verdict,
    by_head,
    by_row,
    cut,
    short_power,
    without_empty_columns,
    written,
)
from ident.report.words import (
    MM,
    SETUP,
    counted,
    describe,
    in_percent,
    in_read_unit,
    in_shown_unit,
    is_length,
    is_stiffness,
    percent,
    priors_in_words,
    read_unit,
    row_in_file,
    scatter,
    sentence,
    shared_unit,
    shares,
    size_in_words,
    unit_of,
    what_is_fixed,
    what_is_open,
    with_tied,
)
from ident.studies.stiffness.warnings import (
    agreement,
    asked_for,
    assumption_section,
    contradiction,
    dependence_on_priors,
    drive_states,
    explanation_section,
    good_if,
    hysteresis,
    kinds_agree,
    leading_explanations,
    odd_numbers,
    untested,
    weighty_assumptions,
    what_may_be_wrong,
)
from ident.units import QUANTITIES

if TYPE_CHECKING:
    from ident.identify.damping import Damping, Law
    from ident.identify.fit import CampaignFit
    from ident.inference.fit import Fit
    from ident.inference.parameters import Parameter

EVERY = 200
"""Largest number of measurements that are all listed."""
FARTHEST = 24
"""Measurements listed of a longer campaign."""
LISTED = 12
"""Optima listed at most."""
ORIGINS = ("data|.0%", "own prior|.0%", "data with other priors|.0%")
"""Sources of information on an unknown."""
FAR_OFF, OWN = 2.5, 0.1
"""Distance from a prior [standard deviations] from which it is doubted; share of the prior below which it is idle."""


def fit_sections(fit: "CampaignFit") -> Report:
    """Return the report of a fit."""
    causes = leading_explanations(fit.explanations, fit.campaign)
    conflict = contradiction(fit.cross_predictions, fit.campaign)
    incomplete = _determined(fit) < len(unknown_places(fit)) or fit.doubts
    following = "ident plan {campaign}" if incomplete else "ident validate {campaign}"
    return Report(
        _subject(fit),
        _verdict(fit),
        (*conflict, *causes, _values_table(fit), *damping_in_words(fit.damping), *weighty_assumptions(fit)),
        tuple(_findings(fit, explained=bool(causes))),
        _residuals(fit),
        "check these causes, then: ident fit {campaign}" if causes else following,
        tuple(_details(fit)),
    )


def _subject(fit: "CampaignFit") -> str:
    items = [item for item in fit.problem.parameters.items if not item.nuisance]
    word = "unknown stiffness" if all(is_stiffness(item.name) for item in items) else "unknown"
    plural = "es" if word.endswith("ss") else "s"
    uncertain = int(fit.problem.parameters.nuisance.sum()) - len(fit.loops)
    ratios = len(fit.damping.rows) if fit.damping else 0
    more = {"uncertain number": uncertain, "hysteresis loop": len(fit.loops), "damping ratio": ratios}
    counts = [counted(len(fit.campaign), "measurement"), f"{len(items)} {word}{plural * (len(items) != 1)}"]
    counts += [counted(count, noun) for noun, count in more.items() if count]
    counts += ["robust weights"] * (fit.weights is not None)
    return f"Fit of {cut(fit.arm.name, 40)} to {cut(fit.campaign.name, 30)}: {', '.join(counts)}"


# -------- Verdict


def _verdict(fit: "CampaignFit") -> Verdict:
    """Judge a fit: NOT USABLE in doubt or if nothing is determined, GOOD if everything is, PARTLY between."""
    if refusal := refused(fit):
        return refusal
    count, determined = len(unknown_places(fit)), _determined(fit)
    optima = f"{len(fit.rivals) + 1} optima fit the data, met" if fit.rivals else "one optimum fits, found"
    quality = f"{chi_squared_in_words(fit)}; {optima} in {counted(_starts(fit), 'start')}."
    if not determined:
        of = "the unknown" if count == 1 else f"any of the {count} unknowns"
        return Verdict("NOT USABLE", f"The data alone do not determine {of}; {quality}", "bad")
    items = fit.problem.parameters.items
    errors = [fit.information.sd[i] for i in unknown_places(fit) if _is_determined(fit, i) and items[i].positive]
    known = f"determined{f' (std. error at most {scatter(float(max(errors)))})' if errors else ''}; {quality}"
    if determined < count:
        return Verdict(f"PARTLY {determined} OF {count}", f"{determined} of {count} unknowns {known}", "caution")
    every = f"All {count} unknowns" if count > 1 else "The unknown is"
    return Verdict(good_if(fit), f"{every} {known}", "good")


def refused(fit: "CampaignFit") -> Verdict | None:
    """Return why a fit is not usable: it is in doubt, or the data contradict an assumption; else None."""
    if fit.doubts:
        rank, own = fit.information.rank, len(fit.information.directions)
        odd = odd_numbers(fit.arm, fit.problem.parameters)
        reasons = [f"Check the arm file first: {odd[0].text}."] if odd else []
        reasons += [sentence(doubt) for doubt in fit.doubts]
        if rank < own:
            reasons.append(f"{counted(len(fit.campaign), 'measurement')} cannot determine {counted(own, 'unknown')}.")
        return Verdict("NOT USABLE", f"{' '.join(reasons)} No interval is reported.", "bad")
    asked = asked_for(fit)
    return Verdict("NOT USABLE", sentence(asked.text), "bad") if asked else None


def unknown_places(fit: "CampaignFit") -> list[int]:
    """Return the indices of the unknowns without nuisance parameters, model factors among them."""
    return np.flatnonzero(~fit.problem.parameters.nuisance).tolist()


def _is_determined(fit: "CampaignFit", i: int) -> bool:
    """Whether an unknown has an interval that holds one optimum only."""
    half = half_width(0.95) * fit.information.sd[i]
    single = all(abs(each.theta[i] - fit.best.theta[i]) < half for each in fit.rivals)
    return bool(fit.supported[i]) and single


def _determined(fit: "CampaignFit") -> int:
    return sum(_is_determined(fit, i) for i in unknown_places(fit))


def _starts(fit: "Fit") -> int:
    return sum(optimum.starts for optimum in fit.optima) + fit.failed


def _residuals(fit: "CampaignFit") -> str:
    """Name the largest standardised residual, and whether the kinds of measurement agree."""
    if not fit.farthest_off:
        return ""
    far, count, several = fit.farthest_off[0], len(fit.farthest_off), int(fit.suspicious.sum())
    z, row = abs(fit.standardised[far]), row_in_file(fit.campaign.measurements[far], row_names(fit.campaign)[far])
    within = f"All {count} residuals within {z:.1f} sigma; the largest is {row}."
    if several:
        robust = fit.weights is not None
        which = f"{several} of {count} {'count for less than half' if robust else 'are too large'}"
        within = f"Largest residual: {row}, {z:.1f} sigma; {which}."
    elif math.isnan(z):
        within = f"None of the {count} residuals can be judged: no measurement checks another."
    compared = fit.cross_predictions and not fit.contradictory
    return f"{within} {kinds_agree(fit.cross_predictions)}" if compared else within


def _findings(fit: "CampaignFit", *, explained: bool) -> Iterator[Finding]:
    """Yield the findings that affect the verdict, most important first."""
    yield from odd_numbers(fit.arm, fit.problem.parameters)
    if not fit.doubts:
        yield from [asked] if (asked := asked_for(fit)) else untested(fit)
    if fit.weights is not None and fit.suspicious.any():
        names = np.array(row_names(fit.campaign))[fit.suspicious]
        yield Finding(f"robust weights: rows {', '.join(names[:LISTED])} count for less than half", "check these rows")
    if fit.contradictory and not explained and len(fit.blamed) != 1 and not fit.exchanges:
        yield Finding("the kinds of measurement contradict each other", "check values, labels, units and load cases")
    yield from odd_ratios(fit.damping)
    yield from drive_states(fit.arm, fit.campaign)
    yield from _competing(fit)
    said = {fit.blamed_in_words, *fit.exchanges_in_words} if explained else ()  # among the causes
    yield from (Finding(remark) for remark in fit.remarks if remark not in said)
    if not fit.doubts and (trades := fit.information.trade_offs()):
        known = fit.information
        every = np.isfinite(known.sd).all()
        filler = "the prior fills the rest" if every else "the rest stays where the search stopped"
        text = f"the data do not determine {len(trades)} of {len(known.directions)} combinations; {filler}"
        yield Finding(text, "see ident plan")


def _competing(fit: "Fit") -> Iterator[Finding]:
    """Yield a finding if other optima fit equally well, or nearly."""
    costs = [optimum.score - fit.best.score for optimum in fit.rivals[fit.ties :]]
    if fit.ties:
        text = f"not unique: {fit.ties + 1} optima fit exactly as well; the one nearest to the prior's centre is shown"
        yield Finding(text, "measure what tells them apart (`ident plan`)")
    if costs:
        others = "another optimum" if len(costs) == 1 else f"{len(costs)} other optima"
        yield Finding(f"the data do not rule out {others}: chi-squared is {min(costs):.2g} larger there")
    if fit.rivals:
        expected = unmet(fit.optima)
        text = f"{expected:.1f} more optima like them are expected; intervals reach over all that were found"
        seldom = Finding("the optima were met too seldom to say how many more there are", "try more --starts")
        yield Finding(text) if np.isfinite(expected) else seldom


# -------- Values


def _values_table(fit: "CampaignFit") -> Table:
    """Return each value with its interval, or the reason why it has none."""
    items, own = fit.problem.parameters.items, unknown_places(fit)
    unit = shared_unit(items[i].name for i in own)
    what = "Stiffness" if all(is_stiffness(items[i].name) for i in own) else "Unknown"
    heads = what, f"value{unit}", "95 % interval", "std. error", "arm file", "fit vs. arm file"
    return without_empty_columns(by_head(heads, (_value_row(fit, i, with_unit=not unit) for i in own)))


def _value_row(fit: "CampaignFit", i: int, *, with_unit: bool) -> tuple[Cell, ...]:
    item, value = fit.problem.parameters.items[i], float(fit.best.values[i])
    number, unit = in_shown_unit(item.name, value)
    after = f" {unit}" if with_unit else ""
    word = why_no_interval(fit, i)
    low, high = (in_shown_unit(item.name, float(end))[0] for end in fit.interval()[i])
    digits = "#.3g" if item.positive else "#.4g"
    interval = word or f"{written(low, digits)} to {written(high, digits)}"
    sd = float(fit.information.sd[i])
    error = "" if word else scatter(sd) if item.positive else size_in_words(item, sd)
    return with_tied(item), written(number, "#.4g") + after, interval, error, *_start(item, value)


def _start(item: "Parameter", value: float) -> tuple[str, str]:
    """Write the arm file's value, and how far the fitted value is from it: implausible outside the prior's 95 %."""
    start = float(item.start)
    number = short_power(f"{in_shown_unit(item.name, start)[0]:.4g}")
    if not item.positive or not start:
        return number, ""
    wide = math.isfinite(item.prior_sd) and abs(math.log(value / start)) > half_width(0.95) * item.prior_sd
    ratio = value / start
    change = percent(ratio - 1, "+") if 0.5 < ratio < 2 else f"x {ratio:.2g}"
    return number, f"{change}{', implausible' * bool(wide)}"


def why_no_interval(fit: "Fit", i: int) -> str:
    """Return why a parameter has no interval; empty if it has one."""
    known = fit.information
    if known.supported[i] or fit.problem.parameters.nuisance[i]:
        return "" if fit.supported[i] else "not reported"
    return "weakly determined" if known.data_sd[i] < OPEN_ABOVE else "not determined"


# -------- Details


def _details(fit: "CampaignFit") -> Iterator[Section]:
    yield _values_section(fit)
    if fit.contradictory:
        words = dependence_on_priors(fit.cross_predictions), what_may_be_wrong(fit.cross_predictions)
        yield Section("Contradiction", tuple(filter(None, words)))
    yield from explanation_section(fit.explanations, fit.campaign)
    yield from _uncertain_numbers(fit)
    yield assumption_section(fit)
    yield _measurements(fit)
    yield from damping_section(fit.damping)
    yield from hysteresis(fit.campaign, fit.loops)
    yield what_is_fixed(fit)
    if trades := what_is_open(fit.information, fit.problem.parameters.items):
        yield trades
    if fit.cross_predictions or fit.campaign.correlated:
        parameters = fit.problem.parameters
        flat = fit.cross_predictions and not (parameters.proper | parameters.nuisance).all()
        note = "Where there is no prior on a stiffness, the default one was taken for this comparison."
        yield agreement(fit.cross_predictions, fit.campaign, note * bool(flat))
    yield _optima(fit)


# -------- Damping

TRENDS = {"loss": "does not change with frequency", "tau": "grows with frequency", "alpha": "falls with frequency"}
"""How the damping ratio of a law depends on frequency."""
LAW_WORDS = {"loss": "constant (hysteretic)", "tau": "viscous", "alpha": "falling (mass-proportional)"}
MUCH, LAWLESS = 0.1, 0.3
"""Scatter of ln(ratio) that is worth mentioning, and from which no law is named; assumed."""


def damping_in_words(damping: "Damping | None") -> Iterator[str]:
    """Yield the fitted damping and its law in one line."""
    if damping is None:
        return
    best, hertz, ratio, numbers = damping.best, damping.frequency, 100 * damping.predicted, _law_words(damping.best)
    if best.scatter > LAWLESS:
        measured = 100 * np.exp(damping.ratios.log)
        factor = f"modes scatter by a factor of {math.exp(best.scatter):.2g}"
        yield f"Damping: {measured.min():.2g} to {measured.max():.2g} % by no law; {factor}."
        return
    size = f"{ratio.min():.2g} to {ratio.max():.2g} %"
    if best.family == {"loss"} and np.ptp(ratio) < MUCH * ratio.mean():
        size = f"{ratio.mean():.2g} % in all modes"
    elif "loss" not in best.family and len(numbers) < 2:
        ends = int(np.nanargmin(hertz)), int(np.nanargmax(hertz))
        size = " and ".join(f"{ratio[i]:.2g} % at {hertz[i]:.3g} Hz" for i in ends)
    if damping.rivals:
        names = [LAW_WORDS[next(iter(law.family))] for law in (best, *damping.rivals) if len(law.family) == 1]
        law = f"; {' and '.join(dict.fromkeys(names))} laws cannot be told apart"
    else:
        trend = " and ".join(TRENDS[word] for word in TRENDS if word in best.family) or "follows the servos"
        law = f"; it {trend}" if len(best.family) == 1 else ", a sum of laws"
        law += f" ({', '.join(numbers)})" if len(numbers) == 2 else ""
    yield f"Damping: {size}{law}{f', within {percent(best.scatter)} from mode to mode' * (best.scatter > MUCH)}."


def odd_ratios(damping: "Damping | None") -> Iterator[Finding]:
    """Yield outlying ratios under a law that fits the others."""
    if damping is None or not damping.marked.any():
        return
    names, measured = row_names(damping.rows), np.exp(damping.ratios.log)
    for i in np.flatnonzero(damping.marked).tolist():
        times = f"{measured[i] / damping.predicted[i]:.2g} times what the others say"
        yield Finding(f"damping ratio of row {names[i]} is {times} and does not count", "check value, unit and label")


def damping_section(damping: "Damping | None") -> Iterator[Section]:
    """Yield each measured ratio next to the law's, and the laws that were compared."""
    if damping is None:
        return
    measured, law = 100 * np.exp(damping.ratios.log), 100 * damping.predicted
    marks = ["does not count" * bool(odd) for odd in damping.marked]
    columns = map(describe, damping.rows), damping.frequency, measured, law, measured / law, marks
    note = "given stiffness: no ratio moves a stiffness. measured: as expected given the errors of the frequencies."
    heads = "row", "measurement", "mode [Hz]|.3f", "measured [%]|.3g", "law [%]|.3g", "ratio|.2f", ""
    ratios = by_head(heads, zip(row_names(damping.rows), *columns, strict=True), note=note)
    yield Section("Damping ratios", (ratios,))
    laws = [(", ".join(_law_words(law)), law.bic - damping.best.bic, law.scatter) for law in damping.laws]
    note = (
        "BIC: less is better; a difference below 6 does not tell laws apart, and a sum of laws must be better by as "
        "much. scatter: of ln(ratio) from mode to mode, which the law does not explain."
    )
    yield Section("Laws of damping", (by_head(("law", "BIC|+.1f", "scatter|.3f"), laws, note=note),))


def _law_words(law: "Law") -> list[str]:
    """Write the positive numbers of a law: `loss factor in bending 0.02`."""
    each = zip(law.groups, law.values, strict=True)
    return [f"{_number_words(group)} {x:.3g} {unit_of(group[0])}".removesuffix(" -") for group, x in each if x > 0]


def _number_words(group: tuple[str, ...]) -> str:
    """Name a number of a law: `loss factor in bending`."""
    joints, kinds = ({path.split(".")[i] for path in group} for i in (0, -1))
    if group == (ALPHA,):
        return "alpha"
    what = "loss factor" if "loss" in group[0] else "tau"
    where = (
        {"bend": " in bending", "tors": " in torsion"}.get(group[0].rpartition("_")[2], "") if len(kinds) == 1 else ""
    )
    return f"{next(iter(joints))}: {what}{where}" if len(joints) == 1 else f"{what}{where}"


def _values_section(fit: "CampaignFit") -> Section:
    """Return each value with its relative interval ends, and the source of the information."""
    known, items, rows, own = fit.information, fit.problem.parameters.items, [], unknown_places(fit)
    for i in own:
        item, value = items[i], float(fit.best.values[i])
        ends = ("", "") if why_no_interval(fit, i) else (_end(item, value, end) for end in fit.interval()[i])
        ratio = value / float(item.start) if item.start else None
        rows.append((item.name, *in_shown_unit(item.name, value), *ends, ratio, *shares(known, i)))
    meaning = (
        "not determined: the data alone do not determine it; the value leans on the prior. weakly determined: known by "
        f"the data alone to no better than a factor of {math.exp(WEAK_ABOVE):.2g} (std. error). not reported: data and "
        "model would give an interval, but the fit is in doubt."
    )
    heads = "unknown", "value|.5g", "unit", "low end", "high end", "value / arm file|.3g", *ORIGINS
    table = by_head(heads, rows, note=meaning * any(why_no_interval(fit, i) for i in own))
    title = "Fitted values, and where the information comes from"
    return Section(title, (without_empty_columns(table), *_about_values(fit)))


def _end(item: "Parameter", value: float, end: float) -> str:
    """Write the distance from a value to one end of its interval, as `-3.7 %`."""
    if item.positive:
        return in_percent(float(end) / value - 1)
    factor, unit = (MM, "mm") if is_length(item.name) else (1.0, unit_of(item.name))
    return f"{factor * (float(end) - value):+.2g} {unit}"


def _measurements(fit: "CampaignFit") -> Section:
    """Return each measurement next to its prediction; for many, the ones with the largest residuals."""
    count, off, z, many = len(fit.campaign), fit.off, fit.standardised, len(fit.campaign) > EVERY
    shown = sorted(fit.farthest_off[:FARTHEST]) if many else range(count)
    outliers, unchecked, names = fit.suspicious, fit.row_tests.unchecked, row_names(fit.campaign)
    rows = []
    for i in shown:
        m = fit.campaign.measurements[i]
        measured, unit = in_read_unit(m.kind, m.value)
        predicted, _ = in_read_unit(m.kind, float(fit.predicted[i]))
        weight = "" if fit.weights is None else f" (weight {fit.weights[i]:.2g})"
        mark = f"outlier{weight}" if outliers[i] else "unchecked" if unchecked[i] else ""
        rows.append((names[i], describe(m), unit, measured, predicted, -float(off[i]), -float(z[i]), mark))
    limit = f"Outlier limit for {fit.row_tests.tested} values: {fit.row_tests.limit:.1f} sigma"
    limit += "; vectors are judged as a whole." if fit.problem.vectors is not None else "."
    if fit.weights is not None:
        limit = f"Robust weights: {int(outliers.sum())} of {count} values count for less than half."
    note = (
        "off: measured less predicted, in sigma. z: the same in its own standard deviation, which is smaller because "
        f"the fit follows the value; values are judged by z. {limit}"
    )
    if unchecked.any():
        note += " unchecked: no other measurement depends on the same, so that an error would go unnoticed."
    title = f"Measurements: the {FARTHEST} of {count} farthest from the fit" if many else "Measurements"
    heads = "row", "measurement", "unit", "measured|.4g", "predicted|.4g", "off [sigma]|.2f", "z|.2f", ""
    return Section(title, (by_head(heads, rows, note=note), *([_by_kind(fit)] if many else [])))


def _by_kind(fit: "CampaignFit") -> Table:
    """Return the size of the residuals for each kind."""
    kinds, outliers = np.array([m.kind for m in fit.campaign]), fit.suspicious
    rows = []
    for kind in dict.fromkeys(kinds.tolist()):
        z = -fit.off[kinds == kind]
        far = int(outliers[kinds == kind].sum())
        rows.append((kind.replace("_", " "), len(z), float(z.mean()), float(np.sqrt((z**2).mean())), far))
    heads = "kind", "values|d", "mean [sigma]|+.2f", "rms [sigma]|.2f", "outliers|d"
    return by_head(heads, rows, "Residuals by kind; all are in the result file")


def _uncertain_numbers(fit: "CampaignFit") -> Iterator[Section]:
    """Yield for each uncertain number its fitted value, and what knowing it would gain."""
    parameters, known = fit.problem.parameters, fit.information
    places = [i for i, item in enumerate(parameters.items) if item.nuisance and not is_of_loop(item.name)]
    if not places:
        return
    rows, advice = [], []
    for i in places:
        item, off = parameters.items[i], float(parameters.prior_residuals(fit.best.theta)[0][i])
        size, _ = read_unit(item.name)
        said, now = (_known_to(item, float(sd)) for sd in (item.prior_sd, known.sd[i]))
        shift = f"{off:+.1f} sigma" if np.isfinite(item.prior_sd) else "-"
        rows.append((item.name, float(item.start) / size, said, fit.best.values[i] / size, shift, now, _cost(fit, i)))
        if words := _advice(item, known, i, off):
            advice.append(f"{item.name}: {words}")
    note = "widens most: how much wider an interval is than it would be if this number were known exactly."
    if any(item.name.startswith(SETUP) for item in parameters.items):
        note += " setup: place [mm] and further turn [mrad] of its frame; what was free was found from the data first."
    heads = "number", "given|.4g", "within", "fitted|.4g", "shift", "known to", "widens most"
    yield Section("Numbers that are not exactly known", (by_head(heads, rows, note=note), *advice))


def _known_to(item: "Parameter", sd: float) -> str:
    if not np.isfinite(sd):
        return "free"
    return f"{100 * sd:.2g} %" if item.positive else size_in_words(item, sd)


def _cost(fit: "CampaignFit", i: int) -> str:
    """Name the unknown whose interval a number widens most."""
    known, own = fit.information, ~fit.problem.parameters.nuisance
    shared = np.where(own, np.nan_to_num(known.correlation[i]), 0.0)
    worst = int(np.argmax(np.abs(shared)))
    wider = (1 - shared[worst] ** 2) ** -0.5 - 1
    return f"{known.names[worst]} by {100 * wider:.2g} %" if wider >= 0.01 else "hardly anything"


def _advice(item: "Parameter", known: Information, i: int, off: float) -> str:
    """Say whether the data contradict the prior of a number, or improve on it."""
    if np.isfinite(item.prior_sd) and abs(off) > FAR_OFF:
        return "the data contradict the given value: either it is wrong, or something else is (masses, loads, labels)"
    if np.isfinite(item.prior_sd) and known.prior_share[i] < OWN:
        return f"the data alone determine it: it may as well be an unknown (`free` {known.names[i]})"
    return ""


def _about_values(fit: "CampaignFit") -> Iterator[str]:
    """Yield chi-squared, the priors, the source of the damping, and the largest correlation."""
    known, items = fit.information, fit.problem.parameters.items
    yield sentence(chi_squared_in_words(fit))
    yield from priors_in_words([items[i] for i in unknown_places(fit)])
    if not fit.damping and not any(is_damping(item.name) for item in items):
        times = [float(tau) for j in fit.arm.joints for tau in (j.tau_bend, j.tau_tors) if tau is not None]
        span = f"{min(times):.2g} to {max(times):.2g} s"
        yield f"Damping was not fitted; the arm file's is {span} times the stiffness."
    correlation = np.triu(np.nan_to_num(known.correlation), 1)
    one, other = np.unravel_index(np.argmax(np.abs(correlation)), correlation.shape)
    if correlation[one, other]:
        names = f"{known.names[one]} and {known.names[other]}"
        yield f"Largest correlation: {correlation[one, other]:+.2f} between {names}."


def _optima(fit: "Fit") -> Section:
    """Return the optima, the best one first."""
    failed = f"; {fit.failed} starts reached none" if fit.failed else ""
    first = f"; the first {LISTED} of them" if len(fit.optima) > LISTED else ""
    rows = []
    for i, optimum in enumerate(fit.optima[:LISTED]):
        note = "undetermined" * bool(len(optimum.open)) if optimum.converged else "not converged"
        values = " ".join(short_power(f"{value:.4g}") for value in optimum.values)
        name = "other" if i else "answer"
        rows.append((name, optimum.score, round(optimum.said, 3) + 0.0, optimum.starts, note, values))
    note = "score: chi-squared of data and priors plus label cost."
    if fit.best.converged and len(fit.best.open):
        count = f"{len(fit.best.open)} of {len(fit.best.theta)} combinations"
        note += f" Along {count} the score stays flat, or still falls, over several e-folds."
    heads = "optimum", "score|#.4g", "label cost|.3g", "starts|d", "", "values [SI], in the order of the unknowns"
    title = f"Optima: {len(fit.optima)} found from {counted(_starts(fit), 'start')}{failed}{first}"
    return Section(title, (by_head(heads, rows, note=note),))


# -------- Rows


def fit_rows(fit: "CampaignFit") -> list[dict[str, Any]]:
    """Return a row for each parameter: value, standard error and interval [SI], and whether the data support it."""
    parameters, value, (low, high) = fit.problem.parameters, fit.best.values, fit.interval().T
    error = fit.information.sd * np.where(parameters.positive, value, parameters.column("scale"))
    own = {"value": value, "unit": map(unit_of, parameters.names), "std_error": error, "low_95": low, "high_95": high}
    return by_row(parameter=parameters.names, **own, supported=fit.supported)


def measurement_rows(fit: "CampaignFit") -> list[dict[str, Any]]:
    """Return a row for each measurement: description, measured, predicted and sigma [SI], and residual [-].

    `residual` is (measured - predicted) / sigma [-], as in reports; `too_far_off` marks the outliers of the report.
    Angles are in degrees.
    """
    names = row_names(fit.campaign)
    return [
        {"row": names[i], "kind": m.kind, "posture": " ".join(f"{math.degrees(q) + 0.0:.10g}" for q in m.posture)}
        | {"load": str(m.load), "place": m.mode or m.point or m.joint or "", "unit": QUANTITIES[KINDS[m.kind]].si}
        | {"measured": m.value, "predicted": float(fit.predicted[i]), "sigma": m.sigma}
        | {"residual": -float(fit.off[i]), "too_far_off": bool(far)}
        for i, (m, far) in enumerate(zip(fit.campaign, fit.suspicious, strict=True))
    ]
