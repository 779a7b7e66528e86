"""Sections of several reports on a fit: agreement of kinds, assumptions, possible causes, hysteresis, odd numbers."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np

from ident.arm.arm import Arm
from ident.arm.plausibility import oddities
from ident.identify.assumptions import Assumption, Assumptions, of_kind
from ident.identify.data_checks import row_names
from ident.identify.explanations import APART, Change, Explanation, Explanations, Telling
from ident.identify.fit import CampaignFit, Loop
from ident.identify.hypotheses import ENTRY_ERRORS, KINDS, MARGIN, SLIP
from ident.identify.problem import Ramp
from ident.inference.fit import FEW, CrossPrediction, contradicting
from ident.inference.information import RARE, sigma_in_words, standard_deviations
from ident.inference.parameters import Parameters
from ident.measure import Campaign, Measurement
from ident.report.report import Cell, Finding, Section, Table, by_head, cut, without_empty_columns
from ident.report.words import (
    MOST_ROWS,
    counted,
    describe,
    in_percent,
    in_read_unit,
    kinds_in_words,
    percent,
    place_read,
    read_unit,
    size_in_words,
    some,
    three_digits,
)
from ident.text import by_key

# -------- Agreement
# Whether the kinds of measurement agree.


def agreement(predictions: Sequence[CrossPrediction], campaign: Campaign, note: str = "") -> Section:
    """Return how far each kind is from the prediction by the others and the prior; each value of a small kind too.

    Args:
        predictions: of each kind; empty for a single kind.
        campaign: the measurements.
        note: a further remark.
    """
    sizes, measured, kinds = [len(places) for places, _ in campaign.correlated], campaign.measurements, []
    for cross in predictions:
        numbers = cross.statistic, cross.degrees_of_freedom, cross.p_value, cross.sd if cross.sd >= 1 else None
        kinds.append((cross.kind.replace("_", " "), len(cross.rows), *numbers))
    meaning = (
        "T: rise of the minimum chi-squared of the joint fit over that of the separate fits; priors count with the "
        "other kinds."
    )
    rows = [
        (describe(measured[row]), unit, value, predicted, None if cross.z is None else float(cross.z[i]))
        for cross in predictions
        for i, row in enumerate(cross.rows if len(cross.rows) <= FEW else ())
        for predicted, value, unit in [against(cross, i, measured[row])]
    ]
    heads = "kind", "values|d", "T|#.3g", "degrees of freedom|.1f", "p|.2g", "sigma|.1f"
    of_values = "value", "unit", "measured|.3g", "predicted from the other kinds|.3g", "difference [sigma]|+.1f"
    tables = [by_head(heads, kinds, note=meaning)] * bool(kinds) + [by_head(of_values, rows)] * bool(rows)
    correlated = f"The errors of {sum(sizes)} measurements are correlated, in {counted(len(sizes), 'group')}."
    notes = [note] * bool(note) + [correlated] * bool(sizes)
    return Section("Agreement between kinds of measurement", (*tables, *notes))


def kinds_agree(predictions: Sequence[CrossPrediction]) -> str:
    """Say in a sentence how well the kinds of measurement agree."""
    largest = max(cross.sd for cross in predictions)
    kinds = kinds_in_words([cross.kind for cross in predictions]).capitalize()
    return f"{kinds} agree within {max(math.ceil(10 * largest), 1) / 10:.1f} sigma."


def against(cross: CrossPrediction, i: int, m: Measurement) -> tuple[float, float, str]:
    """Return the prediction for the i-th value of a small kind by the other kinds, the measured value, and the unit."""
    return (in_read_unit(m.kind, cross.predicted[i])[0], *in_read_unit(m.kind, cross.measured[i]))


def contradiction(predictions: Sequence[CrossPrediction], campaign: Campaign) -> tuple[str, ...]:
    """Say which value of a small kind is farthest from the other kinds' prediction; empty without a contradiction."""
    few = (cross for cross in contradicting(predictions) if len(cross.rows) <= FEW)
    small = [(np.abs(cross.z), cross) for cross in few if cross.z is not None]
    if not small:
        return ()
    single = [pair for pair in small if len(pair[0]) == 1]
    z, cross = max(single or small, key=lambda pair: float(np.max(pair[0])))
    i = int(np.argmax(z))
    m, name = campaign.measurements[cross.rows[i]], row_names(campaign)[cross.rows[i]]
    predicted, value, unit = against(cross, i, m)
    measured, other = (f"{three_digits(each)} {unit}" for each in (value, predicted))
    return (f"Row {name}, {describe(m)}: measured {measured}, predicted from the other data {other}.",)


def dependence_on_priors(predictions: Sequence[CrossPrediction]) -> str:
    """Say in one word whether a contradiction would persist with wider priors."""
    worst = min(contradicting(predictions), key=lambda cross: cross.p_value)
    word = "hardly depends on" if worst.wider < RARE else "rests on"
    wider = f"{sigma_in_words(standard_deviations(worst.wider))} with priors twice as wide"
    return f"The contradiction {word} the priors: {sigma_in_words(worst.sd)}, and {wider}."


def what_may_be_wrong(predictions: Sequence[CrossPrediction]) -> str:
    """Say where to look when deflections and frequencies contradict each other; empty for other kinds.

    A mass on a spring deflects by g / omega^2, for any stiffness; a chain adds a factor of its masses and lengths.
    A hardening spring vibrates about its loaded state: tangent above secant, so that omega^2 times deflection grows.
    """
    kinds = {cross.kind: cross for cross in predictions}
    if not {"frequency", "deflection"} <= set(kinds) or not contradicting(predictions):
        return ""
    deflection = kinds["deflection"]
    if np.mean(deflection.measured / deflection.predicted) < 1:
        word, load, drives = "small", "less", "; drives that stiffen under load would make it larger, not smaller"
    else:
        word, load, drives = "large", "more", ", and whether drives stiffen under load or stick"
    return (
        "Masses and lengths alone nearly fix the deflection times the square of the frequency, and here it is too "
        f"{word}: check whether the deflection was measured under {load} load or mass than the frequency. Then check "
        f"mass centres and lengths{drives}."
    )


# -------- Odd numbers


def odd_numbers(arm: Arm, unknowns: Parameters | None = None) -> tuple[Finding, ...]:
    """Return implausible numbers of an arm: a wrong arm file is the commonest cause of a wrong stiffness."""
    odd = oddities(arm, free=None if unknowns is None else unknowns.paths)
    more = [f"{len(odd) - MOST_ROWS} more numbers look wrong"] if len(odd) > MOST_ROWS else []
    return tuple(Finding(f"arm file: {each}", "correct it, see `ident show`") for each in (*odd[:MOST_ROWS], *more))


def drive_states(arm: Arm, campaign: Campaign) -> tuple[Finding, ...]:
    """Warn of rows measured with the servo on, if the arm file describes no servo."""
    own = [name for name, m in zip(row_names(campaign), campaign, strict=True) if m.drives == "servo"]
    if arm.servos or not own:
        return ()
    if len(own) == len(campaign):
        text = "the servos were on in all rows and the arm file describes none: each k_tors includes its servo"
        return (Finding(text, "describe them ([[servo]]), or measure with the brakes on"),)
    rows = f"row{'s' * (len(own) > 1)} {some(own)}"
    return (Finding(f"rows with brakes and with servos are mixed: the servo was on in {rows}", "fit them separately"),)


# -------- Assumptions
# The assumptions of a fit, and how far they may shift its values.

TITLE = "Sensitivity to modelling assumptions"
GIVING = {
    **dict.fromkeys(("base rocks", "base turns"), "the base is rigid"),
    **dict.fromkeys(("link bends", "link twists"), "the links are rigid"),
}
"""Rigid base and links that a fit assumes, by the kind of neglected compliance."""
SOFT = {"gives": "is soft"}
"""Words of the report for a compliant servo."""
UNTESTABLE = "cannot be tested"
"""Evidence on an assumption whose violation is hidden by other values of the unknowns."""
LEAST_SHIFT = 1.0
"""Shift, in standard errors, from which an assumption matters more than the noise."""


def assumption_section(fit: CampaignFit) -> Section:
    """Return how far each kind of assumption may shift a value, and the evidence against it in the data."""
    found = fit.assumptions
    if found is None:
        return Section(TITLE, ("Not tested, as the search has not ended in an optimum.",))
    kinds = [kind for kind in KINDS if of_kind(found.items, kind)]
    rows = (_assumption_row(fit, of_kind(found.items, kind)) for kind in kinds)
    heads = "assumption dropped", "assumed error", "shift", "of", "evidence in the data"
    return Section(TITLE, (by_head(heads, rows), *_meaning(fit, found, kinds)))


def weighty_assumptions(fit: CampaignFit) -> tuple[Table, ...]:
    """Return a table of the assumptions that shift a reported value by more than its standard error, or nothing."""
    found = fit.assumptions
    if found is None or fit.doubts:
        return ()
    heavy = []
    for kind in KINDS:
        if items := of_kind(found.items, kind):
            _, which, moved = _most_moved(fit, items)
            if moved >= LEAST_SHIFT and fit.supported[which]:
                heavy.append((moved, _assumption_row(fit, items, in_errors=False)))
    heavy.sort(key=lambda pair: (pair[1][-1] != UNTESTABLE, -pair[0]))  # untestable assumptions first
    rows = [(what, size, of, shift, evidence) for _, (what, size, shift, of, evidence) in heavy[:MOST_ROWS]]
    note = f"{len(heavy) - len(rows)} more: --details" if len(heavy) > len(rows) else ""
    heads = "Not modelled, if present", "assumed size", "would shift", "by", "evidence in the data"
    return (by_head(heads, rows, note=note),) if rows else ()


def good_if(fit: CampaignFit) -> str:
    """Return GOOD, and the untested rigid parts whose compliance would shift a value by more than its error."""
    rigid = " and ".join(_untested(fit))
    return f"GOOD if {rigid}" if rigid else "GOOD"


def untested(fit: CampaignFit) -> Iterator[Finding]:
    """Yield for each of those parts how far it may shift the most affected value, and how to find out."""
    for assumed, (item, which) in _untested(fit).items():
        moved = f"{fit.information.names[which]} {_move(fit, item, which, in_errors=False)}"
        yield Finding(f"cannot be tested: {assumed} (if not, {moved})", KINDS[item.kind].check)


def _untested(fit: CampaignFit) -> dict[str, tuple[Assumption, int]]:
    """Return by rigid part the compliance that shifts a value most, and that value."""
    items = [each for each in (fit.assumptions.items if fit.assumptions else ()) if each.kind in GIVING]
    rigid = by_key((GIVING[each.kind], each) for each in items if each.test.seen and not each.test.separable)
    worst = {assumed: _most_moved(fit, own) for assumed, own in rigid.items()}
    return {assumed: (item, which) for assumed, (item, which, moved) in worst.items() if moved >= LEAST_SHIFT}


def asked_for(fit: CampaignFit) -> Finding | None:
    """Return the assumption that the data contradict most, with what to do; None without a contradiction."""
    found = fit.assumptions
    if found is None or not found.asked_for:
        return None
    first = found.asked_for[0]
    share = f"{percent(first.test.z * first.test.sd)} +- {percent(first.test.sd)} of {KINDS[first.kind].of}"
    text = f"the data contradict an assumption: {in_words(first)} (z = {first.test.z:.1f}; {share} would fit best)"
    if fit.doubts:
        return Finding(text, "look for a wrong value first: one may be the cause")
    base = first.kind.startswith("base")
    return Finding(text, f"fit again with --soft-base {found.height:.2g}" if base else "model it, or measure it")


def in_words(item: Assumption) -> str:
    """Name an assumption: `base rocks`, `link of joint2 bends`, `mass of link of joint2`."""
    if item.kind.startswith("mass"):
        return f"{item.kind} of link of {cut(item.joint, 12)}"
    thing, does = item.kind.split(" ")
    return f"{thing} of {cut(item.joint, 12)} {SOFT.get(does, does)}" if item.joint else item.kind


def _most_moved(fit: CampaignFit, items: Sequence[Assumption]) -> tuple[Assumption, int, float]:
    """Return the assumption of a kind that shifts a value most, that value, and the shift in standard errors."""
    known = fit.information
    own = ~fit.problem.parameters.nuisance
    counted = known.supported & own if (known.supported & own).any() else own
    moves = [np.where(counted, np.nan_to_num(np.abs(item.test.shift) / known.sd), 0.0) for item in items]
    worst = int(np.argmax([move.max() for move in moves]))
    return items[worst], int(np.argmax(moves[worst])), float(moves[worst].max())


def _assumption_row(fit: CampaignFit, items: tuple[Assumption, ...], *, in_errors: bool = True) -> tuple[Cell, ...]:
    """Return a kind by one joint: the one that the data call for, else the one that shifts a value most."""
    asked = [item for item in (fit.assumptions.asked_for if fit.assumptions else ()) if item in items]
    item, which, moved = _most_moved(fit, asked[:1] or items)
    shift, name = _move(fit, item, which, in_errors=in_errors), cut(fit.information.names[which], 22)
    owner, _, field = KINDS[item.kind].of.partition("'s ")
    whose = f" of {owner}" if field.endswith("compliance") else " of its length" if field == "length" else ""
    size = f"{100 * item.test.amount:.0f} %{whose}"
    return in_words(item), size, *((shift, name) if moved else ("none", "")), _evidence(item, asked=bool(asked))


def _move(fit: CampaignFit, item: Assumption, which: int, *, in_errors: bool) -> str:
    """Write the shift of a value: in percent or its unit, or in standard errors if it has an interval."""
    shift, parameter = item.test.shift[which], fit.problem.parameters.items[which]
    if in_errors and fit.supported[which]:
        return f"{shift / fit.information.sd[which]:+.1f} std. errors"
    return in_percent(float(np.expm1(shift))) if parameter.positive else size_in_words(parameter, shift, "+")


def _evidence(item: Assumption, *, asked: bool) -> str:
    """Write the evidence in the data against an assumption."""
    if not item.test.separable:
        return UNTESTABLE if item.test.seen else "does not affect these data"
    return f"{'YES' if asked else 'no sign'} (z = {item.test.z:.1f})"


def _meaning(fit: CampaignFit, found: Assumptions, kinds: Sequence[str]) -> Iterator[str]:
    """Yield what each assumed error is a share of, and its source."""
    of = by_key((KINDS[kind].of, kind) for kind in kinds)
    shares = "; ".join(f"{', '.join(each)}: {share}" for share, each in of.items()).replace("gives", "is soft")
    origins = "; ".join(dict.fromkeys(part for kind in kinds for part in KINDS[kind].origin.split("; ")))
    height = f" The base is taken to rock about a point {found.height:.2g} m below bushing 1."
    yield (
        "The joint of each row: the one with evidence, else the one that moves a value most. Shift: of that value, in "
        "std. errors, or in percent where it has no interval. z: test statistic; a compliance cannot be "
        "negative, so only z > 0 counts."
    )
    yield f"Assumed error as a share of: {shares}. Origin: {origins}.{height * bool(fit.arm.joints[0].driven)}"


# -------- Explanations
# Possible causes of doubtful data.

LISTED = 10
"""Explanations that are listed at most."""
LEADING = 3
"""Explanations on the first screen, and the number listed if none fits."""
ROWS = 6
"""Rows that an explanation names, at most."""


def leading_explanations(found: Explanations | None, campaign: Campaign) -> tuple[Table, ...]:
    """Return the most probable causes with their checks, and measurements to tell them apart; maybe nothing."""
    if found is None or not found.fitting:
        return ()
    leading = found.fitting[:LEADING]
    rows = [(str(number), _causes(item, campaign), _check(item, campaign)) for number, item in enumerate(leading, 1)]
    several = "Each of these would explain the data" if len(leading) > 1 else "This would explain the data"
    several += " (+- std. error)" * any("+-" in row[1] for row in rows)
    tables = Table("", ("", several, "what to do"), tuple(rows)), *discriminating(found.telling, len(leading))
    return tuple(replace(table, brief=True) for table in tables)


def explanation_section(found: Explanations | None, campaign: Campaign) -> tuple[Section, ...]:
    """Return possible causes, most probable first, and measurements that tell the leading ones apart."""
    if found is None:
        return ()
    labels = f", and {three_digits(found.said)} for the labels" if found.said > MARGIN else ""
    title = f"Possible causes of the contradiction (chi-squared {three_digits(found.cost)} as it is{labels})"
    if not found.items:
        none = f"No single cause that was tried lowers chi-squared left + implausibility by {MARGIN:g}."
        return (Section(title, (none,)),)
    fitting = found.fitting
    listed = fitting[:LISTED] or [item for item in found.items if not item.fits][:LEADING]
    rows = []
    for number, item in enumerate(listed, 1):
        slip = all(change.off == SLIP for change in item.changes)
        off = "entry error" if slip else f"{item.off:.1f} sigma" if item.off < 100 else "absurd"
        left = f"{'~' * item.linear}{three_digits(item.cost)}"
        rows.append((str(number) if fitting else "-", left, off, _causes(item, campaign), _check(item, campaign)))
    note = (
        "chi2 left: sum of squares of data and priors with the smallest change that suffices. Implausibility: size of "
        "the change in standard deviations of what is plausible (all assumed); an entry error counts as "
        f"{SLIP:g}. Ranked by chi2 left + implausibility^2, which must fall by {MARGIN:g} or more. A value that may "
        "be wrong is held weakly near the one measured, so it lies between that and the prediction from the other data."
        f"{' ~: estimated by linearisation.' * any(item.linear for item in found.items)}"
    )
    above = ["Nothing that was tried explains the data, alone or in pairs; these come nearest:"] * (not fitting)
    table = by_head(("no.", "chi2 left", "implausibility", "possible cause", "what to do"), rows, note=note)
    return (Section(title, (*above, table, *discriminating(found.telling, LISTED))),)


def _check(item: Explanation, campaign: Campaign) -> str:
    """Return the check of a cause: swap labels back or look at the shapes; repeat measurements."""
    first = item.changes[0]
    values = first.kind == "exchange" and _swapped(first, campaign) == "values"
    check = KINDS[first.kind].check if first.kind in KINDS else ENTRY_ERRORS[first.kind]
    return "swap them, or measure both again" if values else check


def _swapped(change: Change, campaign: Campaign) -> str:
    return "labels" if all(campaign.measurements[i].mode for i in change.rows) else "values"


def _causes(item: Explanation, campaign: Campaign) -> str:
    return " and ".join(_words(change, campaign) for change in item.changes)


def _words(change: Change, campaign: Campaign) -> str:
    """Write the change that a cause assumes, and its size."""
    names, of = row_names(campaign), cut(change.of, 24)
    rows = f"row{'s' * (len(change.rows) > 1)} {some([names[i] for i in change.rows], ROWS)}"
    rows = "all rows" if len(change.rows) == len(campaign) else rows
    match change.kind:
        case "value":
            m = campaign.measurements[change.rows[0]]
            (value, unit), (sd, _), (was, _) = (in_read_unit(m.kind, x) for x in (change.amount, change.sd, m.value))
            return f"{rows}: {_quantity(m)} is {_to_its_sd(value, sd)} {unit}, not {was:.4g} {unit}"
        case "exchange":
            return f"the {_swapped(change, campaign)} of {rows} are swapped"
        case "on" | "off":
            return f"{of} was {change.kind} in {rows}"
        case "soft base":
            return "the base is not rigid: it rocks and turns"
        case "scale" | "clock":
            return f"every {of.replace('_', ' ')} was read as {_amount(change)} of its true value"
        case "mass centre":
            return f"mass centre of the link of {of}: {_amount(change)} of its length further out"
        case "length":
            return f"length of the link of {of}: {_amount(change)}"
        case "mass" | "payload":
            return f"mass of {of}: {_amount(change)}"
        case "loads":
            return f"all masses and forces that were hung on: {_amount(change)}"
        case "spring":
            every = of in ("bending", "torsion")
            name = f"all joints' {of}" if every else " ".join(of.rsplit(".", 1))
            return f"{name}: torque {_amount(change)} above a linear spring's at the largest load"
        case _:
            joint, (thing, does) = of, change.kind.split(" ")
            return f"{thing} of {joint} {SOFT.get(does, does)}: {_amount(change)} of {KINDS[change.kind].of}"


def _to_its_sd(value: float, sd: float) -> str:
    """Write a value with as many digits as two of its standard deviation support: `30.6 +- 3.0`."""
    decimals = max(1 - math.floor(math.log10(sd)), 0) if 0 < sd < math.inf else 3
    return f"{value:.{decimals}f} +- {sd:.{decimals}f}"


def _quantity(m: Measurement) -> str:
    """Name the quantity of a row, without posture and load, which its number identifies."""
    if m.kind == "frequency":
        return m.mode or "the frequency"
    return f"the {m.kind.replace('_', ' ')} of {m.mode or m.point or m.joint or 'the arm'}"


def _amount(change: Change) -> str:
    kind = KINDS.get(change.kind)
    if kind is not None and kind.factor:
        spread = f" +- {percent(change.sd)}" if change.sd < 1 else ""
        return f"x {change.amount:.3g}{spread}"
    return f"{percent(change.amount, '+')} +- {percent(change.sd)}"


def discriminating(found: Sequence[Telling], leading: int) -> tuple[Table, ...]:
    """Return measurements that tell causes apart, with the prediction of each cause; empty if none does.

    Args:
        found: the measurements.
        leading: number of causes shown.
    """
    if not found:
        return ()
    numbers = [number for number in found[0].numbers if number <= leading]
    rows = []
    for each in found:
        m, which = each.measurement, {1.0: "lowest ", 2.0: "second "}.get(each.place, "")
        (sigma, unit), factor = in_read_unit(m.kind, m.sigma), in_read_unit(m.kind, 1.0)[0]
        causes = zip(each.numbers, factor * np.array(each.predicted), factor * np.array(each.sd), strict=True)
        cells = [f"{x:.3g} +- {sd:.1g}" if math.isfinite(x) else "-" for number, x, sd in causes if number <= leading]
        rows.append((f"{which}{describe(m)} [{unit}]", *cells, f"+- {sigma:.1g}"))
    note = "+-: std. error. No load unless one is named."
    if len(found) > 1 and not any(_tells_all(each, leading) for each in found):
        note += f" No single one separates all causes: measure {'both' if len(found) == 2 else 'all'}."
    heads = "To tell them apart, measure", *(f"if {number}" for number in numbers), "measured to"
    return (by_head(heads, rows, note=note),)


def _tells_all(each: Telling, leading: int) -> bool:
    """Whether a measurement separates every pair of the causes shown."""
    shown = [(x, sd) for number, x, sd in zip(each.numbers, each.predicted, each.sd, strict=True) if number <= leading]
    sigma, pairs = each.measurement.sigma, combinations(shown, 2)
    return all(abs(x - other) >= APART * math.hypot(sd, of_other, sigma) for (x, sd), (other, of_other) in pairs)


# -------- Hysteresis
# Load ramps and the widths of their hysteresis loops.


def hysteresis(campaign: Campaign, ramps: Sequence[Ramp]) -> tuple[Section, ...]:
    """Return the width of the hysteresis loop of each load ramp, or, before a fit, how well the fit will know it."""
    if not ramps:
        return ()
    rows = []
    for ramp in ramps:
        size, unit = read_unit(ramp.name)
        known, share = f"{ramp.sd / size:.2g} {unit}" if math.isfinite(ramp.sd) else "not determined", ""
        if isinstance(ramp, Loop) and math.isfinite(ramp.sd):
            known = f"{ramp.width / size:.3g} +- {known}"
            share = f"{100 * abs(ramp.width) / ramp.largest:.2g} %" if ramp.largest else ""
        rows.append((place_read(ramp.of), known, share, len(ramp.rows)))
    fitted = isinstance(ramps[0], Loop)
    what = "unloading - loading" if fitted else "std. error of unloading - loading"
    note = "Friction and play: the width determines no stiffness; the mean of loading and unloading does."
    note += "" if fitted else " Std. errors by the data alone, at the arm file's values."
    ways = [(ramp, {campaign.measurements[i].ramp for i in ramp.rows}) for ramp in ramps]
    one_way = (
        f"{place_read(ramp.of)}: only {own.pop()}, so these rows determine slopes, not the zero reading."
        for ramp, own in ways
        if len(own) == 1
    )
    table = without_empty_columns(by_head(("loop", what, "of largest", "rows"), rows, note=note))
    return (Section("Hysteresis of loading ramps", (table, *one_way)),)
