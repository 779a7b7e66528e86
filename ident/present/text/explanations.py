"""What would reconcile data that are in doubt, in the printed reports of fit and check."""

import math
from collections.abc import Iterator, Sequence

from ident.identify.alternatives import NUMBER_KINDS
from ident.identify.assumptions import KINDS as ASSUMED
from ident.identify.data_checks import row_names
from ident.identify.explanations import MARGIN, SLIP, Change, Explanation, Explanations
from ident.identify.telling import Telling
from ident.measure import Campaign
from ident.present.text.units import in_read_unit
from ident.present.text.words import cut, describe, percent, three_digits

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
