"""The printed fit report: the answer, what limits it, and then the rest."""

import math
from collections.abc import Iterator

import numpy as np

from ident.identify.fit import CampaignFit
from ident.inference.fit import Fit
from ident.inference.information import OPEN_ABOVE, WEAK_ABOVE
from ident.inference.optima import unmet
from ident.inference.parameters import Parameter
from ident.present.text.agreement import agreement, dependence_on_priors, reconciling, what_may_be_wrong
from ident.present.text.assumptions import asked_for_lines, assumption_lines
from ident.present.text.directions import what_is_fixed, what_is_open
from ident.present.text.fit_details import measurements, optima, origins, uncertain_numbers
from ident.present.text.ramps import loop_widths
from ident.present.text.units import MM, in_shown_unit, is_length, unit_of
from ident.present.text.words import correlated_errors, cut, drive_states, in_percent, odd_numbers, paragraphs


def fit_report(fit: CampaignFit) -> str:
    """Return the report of a fit: the values, what limits them, measurements, what the data fix, optima."""
    sections = [
        _heading(fit),
        _answer(fit),
        _limits(fit),
        reconciling(fit.explanations, fit.campaign),
        uncertain_numbers(fit),
        assumption_lines(fit),
        measurements(fit),
        loop_widths(fit),
        what_is_fixed(fit),
        _agreement(fit),
        origins(fit),
        optima(fit),
    ]
    return paragraphs(sections)


def _heading(fit: CampaignFit) -> Iterator[str]:
    yield f"Fit of {fit.arm.name} to {fit.campaign.name}"
    p = "" if math.isnan(fit.p_value) else f", p = {fit.p_value:.2g}"
    p += "" if fit.weights is None else ", with robust weights"
    count, beside, loops = len(fit.information.names), int(fit.problem.parameters.nuisance.sum()), len(fit.loops)
    uncertain = f", {beside - loops} uncertain number{'s' * (beside - loops > 1)}" if beside > loops else ""
    uncertain += f", {loops} loop{'s' * (loops > 1)} of ramps" if loops else ""
    yield (
        f"  {len(fit.campaign)} measurements, {count - beside} unknowns{uncertain};"
        f" chi-squared {fit.chi_squared:.3g} on {fit.degrees_of_freedom} degrees of freedom{p}"
    )
    yield from odd_numbers(fit.arm)
    yield from correlated_errors(fit.campaign)
    yield from drive_states(fit.arm, fit.campaign)


def _answer(fit: CampaignFit) -> Iterator[str]:
    """Yield each value with its interval, or why it has none."""
    yield "Fitted values, with their 95 % intervals"
    items, words = fit.problem.parameters.items, [why_no_interval(fit, i) for i in range(len(fit.best.values))]
    width = max(16, *(len(cut(item.name, 40)) for item in items))
    for item, value, interval, word in zip(items, fit.best.values, fit.interval(), words, strict=True):
        if item.nuisance:
            continue
        shown = word or _either_side(item, float(value), interval)
        number, unit = in_shown_unit(item.name, float(value))
        yield f"  {cut(item.name, 40):{width}s} {number:10.4g} {unit:7s}  {shown}"
        for other in item.paths[1:]:
            yield f"    = {other}"
    meanings = {
        "open": "the data alone leave it open; what is known of it rests on the priors",
        "weak": f"the data alone know it no better than to a factor of {math.exp(WEAK_ABOVE):.2g} (one sd)",
        "withheld": "data and model would support an interval, but the fit is in doubt",
    }
    yield from (f"  {word}: {meaning}" for word, meaning in meanings.items() if word in words)


def why_no_interval(fit: Fit, i: int) -> str:
    """Return in one word why a parameter has no interval; nothing where it has one."""
    known = fit.information
    if known.supported[i] or fit.problem.parameters.nuisance[i]:
        return "" if fit.supported[i] else "withheld"
    return "weak" if known.data_sd[i] < OPEN_ABOVE else "open"


def _either_side(item: Parameter, value: float, interval: np.ndarray) -> str:
    """Write how far an interval reaches to either side, as `-3.7 % +3.9 %`."""
    if item.positive:
        return " ".join(f"{in_percent(float(end) / value - 1):>8s}" for end in interval)
    factor, unit = (MM, "mm") if is_length(item.name) else (1.0, unit_of(item.name))
    return "  ".join(f"{factor * (float(end) - value):+.2g} {unit}" for end in interval)


def _limits(fit: CampaignFit) -> Iterator[str]:
    """Yield what speaks against the answer, what else would fit, and what the data leave open."""
    lines = [
        *_doubts(fit),
        *asked_for_lines(fit),
        *_rivals(fit),
        *what_is_open(fit.information, fit.problem.parameters.items),
    ]
    nothing = "Nothing in the data speaks against them: no doubt, no rival met, no open direction"
    yield "What limits them" if lines else nothing
    yield from lines


def _doubts(fit: CampaignFit) -> Iterator[str]:
    for doubt in fit.doubts:
        yield f"  WARNING: {doubt}"
    if fit.doubts:
        yield "  So no interval is quoted: those that data and model would support are `withheld`."
    if fit.contradictory:
        yield from _explanation(fit)
    for remark in fit.remarks:
        yield f"  REMARK: {remark}"


def _explanation(fit: CampaignFit) -> Iterator[str]:
    yield f"  CONTRADICTION. {dependence_on_priors(fit.cross_predictions)}"
    hint = what_may_be_wrong(fit.cross_predictions)
    if len(fit.blamed) == 1 or fit.exchanges or not hint:
        yield "  Check the values named below, their labels, units and load cases first."
        return
    yield from (f"  {line}" for line in hint)
    yield f"  The values above are a compromise that {_stretch(fit)}"


def _stretch(fit: Fit) -> str:
    items = fit.problem.parameters.items
    ratios = [
        abs(math.log(v / float(p.start))) if p.positive else 0.0 for p, v in zip(items, fit.best.values, strict=True)
    ]
    worst = int(np.argmax(ratios))
    factor = fit.best.values[worst] / float(items[worst].start)
    return f"takes {items[worst].name} to {factor:.2g} times the arm file's value."


def _rivals(fit: Fit) -> Iterator[str]:
    """Yield that other optima fit as well, or nearly."""
    costs = [optimum.score - fit.best.score for optimum in fit.rivals[fit.ties :]]
    if fit.ties:
        yield f"  NOT UNIQUE: {fit.ties + 1} optima fit exactly as well: globally not identifiable. The answer is"
        yield "  the one nearest to the priors' centre; all are listed below."
    if costs:
        others = "another optimum" if len(costs) == 1 else f"{len(costs)} other optima"
        yield f"  WARNING: the data do not rule out {others}: the next costs {min(costs):.2g} more (see below)."
    if fit.rivals:
        expected = unmet(fit.optima)
        if np.isfinite(expected):
            yield f"  By how often each of them was met, {expected:.1f} more like them are expected."
        else:
            yield "  Each was met too seldom to say how many more like them there are: try more starts."
        yield "  Each interval reaches over all that were found; all else here holds about the answer alone."


def _agreement(fit: CampaignFit) -> Iterator[str]:
    if not fit.cross_predictions:
        return
    yield "Do the kinds of measurement agree? Each one, against the others and the priors:"
    yield from agreement(fit.cross_predictions, fit.campaign.measurements)
    parameters = fit.problem.parameters
    if not (parameters.proper | parameters.nuisance).all():
        yield "  Where there is no prior on a stiffness, the default one was taken for this comparison."
