"""Warnings that the reports of check and fit share: agreement of kinds, loops of ramps, explanations, assumptions."""

import math
from collections.abc import Iterator, Sequence

import numpy as np

from ident.identify.conditions import Ramp
from ident.identify.explanations import MARGIN, SLIP, Change, Explanation, Explanations, Telling
from ident.identify.fit import KINDS, Assumption, Assumptions, CampaignFit, of_kind
from ident.identify.fit import KINDS as ASSUMED
from ident.identify.hypotheses import NUMBER_KINDS
from ident.identify.problem import row_names
from ident.inference.fit import FEW, CrossPrediction, contradicting
from ident.inference.information import RARE, standard_deviations
from ident.measure import Campaign, Measurement
from ident.present.text.words import (
    MM,
    cut,
    describe,
    in_percent,
    in_read_unit,
    is_length,
    percent,
    place_read,
    read_unit,
    three_digits,
    unit_of,
)

# -------- Agreement
# Whether the kinds of measurement agree, in words that the reports of check and fit share.


def agreement(predictions: Sequence[CrossPrediction], measured: Sequence[Measurement]) -> Iterator[str]:
    """Say for each kind how far it is off the others and the prior, and for the values of a small kind as well."""
    for cross in predictions:
        values = "value" if len(cross.rows) == 1 else "values"
        yield (
            f"  {cross.kind.replace('_', ' ')}, {len(cross.rows)} {values}: T {three_digits(cross.statistic)} on"
            f" {cross.degrees_of_freedom:.1f} degrees of freedom, {chance(cross)}"
        )
        for i, row in enumerate(cross.rows if len(cross.rows) <= FEW else ()):
            yield f"    {against(cross, i, measured[row])}"
    yield "  T: how much more the data cost together than each part by itself; priors count as the others'."


def chance(cross: CrossPrediction) -> str:
    """Write how improbable a disagreement is; as standard deviations, too, where these say anything."""
    return f"p = {cross.p_value:.2g}" + (f" ({cross.sd:.1f} sd)" if cross.sd >= 1 else "")


def against(cross: CrossPrediction, i: int, m: Measurement) -> str:
    """Say what the other kinds lead to for the i-th value of a small kind, and what was measured."""
    value, unit = in_read_unit(m.kind, cross.measured[i])
    predicted, _ = in_read_unit(m.kind, cross.predicted[i])
    off = f": {cross.z[i]:+.1f} sd" if cross.z is not None else ""
    return f"{describe(m)}: by the others {predicted:.3g} {unit}, measured {value:.3g}{off}"


def dependence_on_priors(predictions: Sequence[CrossPrediction]) -> str:
    """Say in a word whether a contradiction would stand with wider priors."""
    worst = min(contradicting(predictions), key=lambda cross: cross.p_value)
    word = "hardly depends on" if worst.wider < RARE else "rests on"
    wider = f"{standard_deviations(worst.wider):.1f} sd were they twice as wide"
    return f"It {word} the priors: {worst.sd:.1f} sd, and {wider}."


def what_may_be_wrong(predictions: Sequence[CrossPrediction]) -> tuple[str, ...]:
    """Say where to look when deflections and frequencies contradict each other; nothing for other kinds.

    A mass on a spring deflects by g / omega^2, whatever the spring; a chain adds a factor that masses and lengths give.
    A spring that hardens vibrates about its loaded state: tangent above secant, so that omega^2 times deflection grows.
    """
    kinds = {cross.kind: cross for cross in predictions}
    if not {"frequency", "deflection"} <= set(kinds) or kinds.keys().isdisjoint(
        cross.kind for cross in contradicting(predictions)
    ):
        return ()
    deflection = kinds["deflection"]
    small = bool(np.mean(deflection.measured / deflection.predicted) < 1)
    first = "Deflection times the square of the frequency is nearly fixed by masses and lengths alone,"
    if small:
        return (
            first,
            "and here it is too small: was the deflection measured under less load or mass than the frequency?",
            "Then look at mass centres and lengths. Drives that stiffen under load would make it larger.",
        )
    return (
        first,
        "and here it is too large: was the deflection measured under more load or mass than the frequency?",
        "Then look at mass centres and lengths, and at drives that stiffen under load or stick.",
    )


def reconciling(found: "Explanations | None", campaign: Campaign) -> Iterator[str]:
    """Say what would reconcile a campaign, where that was searched for."""
    if found is None:
        return

    yield from explanations_in_words(found, campaign)


# -------- Assumptions
# What a fit takes for granted, in the printed report.

HEAD = "What this fit takes for granted"


def assumption_lines(fit: CampaignFit) -> Iterator[str]:
    """Say of each kind of assumption how far it may move a value, and what the data say of it."""
    found = fit.assumptions
    if found is None:
        yield f"{HEAD}: not looked at, as this is no optimum"
        return
    yield f"{HEAD:31s} plausible   would move a value by   what the data say"
    kinds = [kind for kind in KINDS if of_kind(found.items, kind)]
    yield from (f"  {_line(fit, found, of_kind(found.items, kind))}" for kind in kinds)
    yield from _meaning(fit, found, kinds)


def asked_for_lines(fit: CampaignFit) -> Iterator[str]:
    """Say what the data ask for, and what to do."""
    found = fit.assumptions
    if found is None or not found.asked_for:
        return
    first = found.asked_for[0]
    asked = f"the data ask for an assumption to be dropped, most of all: {in_words(first)}"
    if fit.doubts:
        yield f"  REMARK: {asked}. As they are in doubt, a wrong value may be the cause: look for one first."
        return
    yield f"  WARNING: {asked}"
    share = f"{percent(first.test.z * first.test.sd)} +- {percent(first.test.sd)}"
    yield f"  ({share} of {KINDS[first.kind].of} would suit them best)."
    yield "  The intervals hold as far as what is taken for granted does: see there by how much they may be off."
    if first.kind.startswith("base"):
        yield f"  Fit again with --soft-base {found.height:.2g}"


def in_words(item: Assumption) -> str:
    """Name an assumption: `base rocks`, `link of joint2 bends`, `mass of link of joint2`."""
    if item.kind.startswith("mass"):
        return f"{item.kind} of link of {cut(item.joint, 12)}"
    thing, does = item.kind.split(" ")
    return f"{thing} of {cut(item.joint, 12)} {does}" if item.joint else item.kind


def _line(fit: CampaignFit, found: Assumptions, items: tuple[Assumption, ...]) -> str:
    """Write a kind: the joint and the value that it moves most, then what the data say of all joints."""
    known = fit.information
    own = ~fit.problem.parameters.nuisance
    told = known.supported & own if (known.supported & own).any() else own
    moves = [np.where(told, np.nan_to_num(np.abs(item.test.shift) / known.sd), 0.0) for item in items]
    worst = int(np.argmax([move.max() for move in moves]))
    item, which = items[worst], int(np.argmax(moves[worst]))
    value = f"{_move(fit, item, which)} {cut(known.names[which], 14)}" if moves[worst].max() else "nothing"
    return f"{cut(in_words(item), 30):30s} {100 * item.test.amount:4.0f} %   {value:24s} {_said(found, items)}"


def _move(fit: CampaignFit, item: Assumption, which: int) -> str:
    """Write how far a value would move: in its sd, where it has an interval; else in percent or in its unit."""
    shift, parameter = item.test.shift[which], fit.problem.parameters.items[which]
    if fit.supported[which]:
        return f"{shift / fit.information.sd[which]:+.1f} sd"
    if parameter.positive:
        return in_percent(float(np.expm1(shift)))
    factor, unit = (MM, "mm") if is_length(parameter.name) else (1.0, unit_of(parameter.name))
    return f"{factor * shift * float(parameter.scale):+.2g} {unit}"


def _said(found: Assumptions, items: tuple[Assumption, ...]) -> str:
    """Say what the data ask for, of the joint of the largest score."""
    asked = [item for item in found.asked_for if item in items]
    told = [item for item in items if item.test.separable]
    if not told:
        return "cannot be told apart" if any(item.test.seen for item in items) else "do not depend on it"
    first = asked[0] if asked else max(told, key=_score)
    of = f" ({cut(first.joint, 8)})" if first.joint else ""
    word = "ASKED FOR" if asked else "not asked for"
    return f"{word}: z {first.test.z:+.1f}{of}"


def _score(item: Assumption) -> float:
    """Return how strongly the data ask for an amount: for one that can't be negative, upwards only."""
    return item.test.z if item.test.positive else abs(item.test.z)


def _meaning(fit: CampaignFit, found: Assumptions, kinds: Sequence[str]) -> Iterator[str]:
    """Explain the columns: what each amount is a share of, and what the numbers count in."""
    of: dict[str, list[str]] = {}
    for kind in kinds:
        of.setdefault(KINDS[kind].of, []).append(kind)
    shares = "; ".join(f"{', '.join(each)}: {share}" for share, each in of.items())
    origins = "; ".join(dict.fromkeys(part for kind in kinds for part in KINDS[kind].origin.split("; ")))
    signed = not all(parameter.positive for parameter in fit.problem.parameters.items)
    amount = "in percent, or in its unit where it may be negative" if signed else "in percent"
    yield (
        "  A row stands for all its joints: the largest move, in sd of the value's interval or, where it has none,"
        f" {amount}; and the largest z, of the joint in brackets: by how many sd the data ask for more of it. What"
        " gives can't be negative, so that only a z above zero counts there; masses may be off both ways."
    )
    yield f"  Plausible is a share of: {shares}."
    yield f"  Origin of these amounts: {origins}."
    if fit.arm.joints[0].driven:
        yield f"  The base gives {found.height:.2g} m below bushing 1."


# -------- Explanations
# What would reconcile data that are in doubt, in the printed reports of fit and check.

LISTED, OTHERS = 10, 3
"""Explanations that fit, and that do not, which are listed at most."""
ROWS = 6
"""Rows that one names, at most."""
CHECKS = {
    "mass": "weigh it",
    "payload": "weigh it",
    "mass centre": "balance it",
    "length": "measure it",
    "loads": "check the load cell or the scales",
    "scale": "check the calibration and the unit",
    "clock": "check the sampling rate",
    "value": "measure it again",
    "exchange": "measure both again",
    "on": "ask what hung there",
    "off": "ask what hung there",
    "soft base": "a dial gauge on the foot; `--soft-base`",
    "spring": "deflections under several loads",
    "link bends": "deflections along the link",
    "link twists": "rotations along the link",
    "servo gives": "twists with brakes and with servos on",
}


def explanations_in_words(found: Explanations, campaign: Campaign) -> Iterator[str]:
    """Say what would reconcile a campaign, most probable first, and what would tell the leading ones apart."""
    yield f"What would reconcile them (sum of squares {three_digits(found.cost)} as it is{_labels(found.said)})"
    if not found.items:
        yield f"  Nothing that was tried is more probable than the data as they are, by {MARGIN:g} in left + off by^2."
        return
    yield "    left   off by     what would have to be otherwise"
    fitting = found.fitting
    for number, item in enumerate(fitting[:LISTED], 1):
        yield f"  {_explanation_line(item, campaign, f'({number}) ')}"
    if len(fitting) > LISTED:
        yield f"  and {len(fitting) - LISTED} less probable"
    if not fitting:
        yield "  Nothing that was tried does, by itself or in pairs; nearest to it come"
        others = [item for item in found.items if not item.fits][:OTHERS]
        yield from (f"  {_explanation_line(item, campaign, '')}" for item in others)
    yield (
        "  left: sum of squares of data and priors with about the least change that suffices; off by: in standard"
        " deviations of what is plausible, squared and added for their order"
        f" ({_widths(found)}all assumed), a slip counting as {SLIP:g}. Listed is what lowers left + off by^2 by"
        f" {MARGIN:g} at least against the data as they are."
    )
    if any(item.linear for item in found.items):
        yield "  ~: estimated along a straight line from the fit."
    yield from _telling(found.telling)


def _labels(said: float) -> str:
    """Say what labels add to a sum of squares, where that matters."""
    return f", and {three_digits(said)} against the labels" if said > MARGIN else ""


def _explanation_line(item: Explanation, campaign: Campaign, head: str) -> str:
    words = " and ".join(_words(change, campaign) for change in item.changes)
    slip = all(change.off == SLIP for change in item.changes)
    off = "a slip" if slip else f"{item.off:.1f} sd" if item.off < 100 else "absurd"
    left = f"{'~' if item.linear else ''}{three_digits(item.cost)}"
    return f"{left:>6s}   {off:8s}   {head}{words}: {CHECKS[item.changes[0].kind]}"


def _words(change: Change, campaign: Campaign) -> str:
    """Say what would have to be otherwise, and by how much."""
    rows, of = _rows(change.rows, campaign), cut(change.of, 24)
    match change.kind:
        case "value":
            m = campaign.measurements[change.rows[0]]
            value, unit = in_read_unit(m.kind, change.amount)
            sd, _ = in_read_unit(m.kind, change.sd)
            was, _ = in_read_unit(m.kind, m.value)
            return f"{rows}, {describe(m)}: {value:.3g} +- {sd:.1g} {unit} instead of {was:.4g}"
        case "exchange":
            return f"{rows} exchanged"
        case "on" | "off":
            return f"{of} was {change.kind} in {rows}"
        case "soft base":
            return "a base that gives, rocking and turning"
        case "scale" | "clock":
            return f"every {of.replace('_', ' ')} read as {_amount(change)} of what it is"
        case "mass centre":
            return f"mass centre of the link of {of} {_amount(change)} of its length further out"
        case "length":
            return f"length of the link of {of} {_amount(change)}"
        case "mass" | "payload":
            return f"mass of {of} {_amount(change)}"
        case "loads":
            return f"all masses and forces that were hung on {_amount(change)}"
        case "spring":
            every = of in ("bending", "torsion")
            name = f"all joints' {of}" if every else " ".join(of.rsplit(".", 1))
            return f"{name}: torque {_amount(change)} above the straight line at the largest load"
        case _:
            joint, (thing, does) = of, change.kind.split(" ")
            return f"{thing} of {joint} {does}: {_amount(change)} of {ASSUMED[change.kind].of}"


def _amount(change: Change) -> str:
    kind = NUMBER_KINDS.get(change.kind)
    if kind is not None and kind.factor:
        spread = f" +- {percent(change.sd)}" if change.sd < 1 else ""
        return f"x {change.amount:.3g}{spread}"
    return f"{percent(change.amount, '+')} +- {percent(change.sd)}"


def _rows(rows: Sequence[int], campaign: Campaign) -> str:
    if len(rows) == len(campaign):
        return "all rows"
    names = [row_names(campaign)[i] for i in rows[:ROWS]]
    more = f" and {len(rows) - ROWS} more" if len(rows) > ROWS else ""
    return f"row{'s' * (len(rows) > 1)} {', '.join(names)}{more}"


def _widths(found: Explanations) -> str:
    """Name the plausible widths of what is listed."""
    kinds = dict.fromkeys(change.kind for item in found.items for change in item.changes)
    widths = {kind: NUMBER_KINDS[kind].plausible for kind in kinds if kind in NUMBER_KINDS}
    widths |= {kind: ASSUMED[kind].plausible for kind in kinds if kind in ASSUMED}
    return ", ".join(f"{kind} {percent(width)}" for kind, width in widths.items()) + "; " * bool(widths)


def _telling(found: Sequence[Telling]) -> Iterator[str]:
    if not found:
        return
    yield "  What to measure to tell the first ones apart, and what each predicts"
    for each in found:
        m = each.measurement
        sigma, unit = in_read_unit(m.kind, m.sigma)
        values = [in_read_unit(m.kind, value)[0] for value in each.predicted]
        sds = [in_read_unit(m.kind, sd)[0] for sd in each.sd]
        said = ", ".join(
            f"({i}) {value:.3g} +- {sd:.1g}" if math.isfinite(value) else f"({i}) no answer"
            for i, value, sd in zip(each.numbers, values, sds, strict=True)
        )
        which = {1.0: "lowest ", 2.0: "second "}.get(each.place, "")
        yield f"    {which}{describe(m)}: {said} {unit} (measured to {sigma:.1g})"


# -------- Ramps
# Ramps of loads and the widths of their loops, in words.


def loop_widths(fit: CampaignFit) -> Iterator[str]:
    """Yield for each ramp of loads how wide its loop is."""
    if not fit.loops:
        return
    yield f"{'Loops of ramps':54s}unloading - loading  of largest  rows"
    for loop in fit.loops:
        size, unit = read_unit(loop.name)
        width = f"{loop.width / size:9.3g} +- {loop.sd / size:.2g} {unit}" if np.isfinite(loop.sd) else "not told"
        share = f"{100 * abs(loop.width) / loop.largest:.2g} %" if loop.largest and np.isfinite(loop.sd) else "-"
        yield f"  {cut(place_read(loop.of), 44):44s} {width:>26s} {share:>11s} {len(loop.rows):5d}"
        yield from _one_way(fit.campaign, loop)
    yield "  Friction and play: no stiffness follows from the width; rows of both ways tell stiffness by their middle."


def ramps_told(campaign: Campaign, ramps: Sequence[Ramp]) -> Iterator[str]:
    """Yield for each ramp of loads how well the width of its loop will be told."""
    if not ramps:
        return
    yield f"{'Loops of ramps':54s}{'width known within':>18s}  rows"
    for ramp in ramps:
        size, unit = read_unit(ramp.name)
        within = f"{ramp.sd / size:.2g} {unit}" if np.isfinite(ramp.sd) else "not told"
        yield f"  {cut(place_read(ramp.of), 52):52s}{within:>18s} {len(ramp.rows):5d}"
        yield from _one_way(campaign, ramp)
    yield "  within: one sd by the data alone, at the arm file's values. `ident fit` finds the widths."


def _one_way(campaign: Campaign, ramp: Ramp) -> Iterator[str]:
    ways = {campaign.measurements[i].ramp for i in ramp.rows}
    if len(ways) == 1:
        yield f"    <-- only {ways.pop()}: its rows tell how readings change with the load, not where they begin"
