"""What a fit takes for granted, in the printed report."""

from collections.abc import Iterator

import numpy as np

from ident.identify.assumptions import KINDS, Assumption, Assumptions, of_kind
from ident.identify.fit import CampaignFit
from ident.present.text.words import cut

HEAD = "What this fit takes for granted"


def assumption_lines(fit: CampaignFit) -> Iterator[str]:
    """Say of each kind of assumption how far it may move a value, and what the data say of it."""
    found = fit.assumptions
    if found is None:
        yield f"{HEAD}: not looked at, as this is no optimum"
        return
    yield f"{HEAD}      plausible   would move a value by      what the data say"
    for kind in KINDS:
        if items := of_kind(found.items, kind):
            yield f"  {_line(fit, found, items)}"
    yield "  Plausible: a share of the compliance of joint 1 or the link's joint, of mass or of the link's"
    rigid = fit.arm.joints[0].driven
    base = f" The base gives {found.height:.2g} m below bushing 1." if rigid else ""
    yield f"  length; all assumed.{base} sd: of the value's interval."
    if found.asked_for and fit.doubts:
        yield "  What is asked for rests on data that are in doubt: mend these first."
    elif asked := found.asked_for:
        first = asked[0]
        yield f"  WARNING: the data ask for an assumption to be dropped, most of all: {in_words(first)}"
        yield f"  ({100 * first.test.z * first.test.sd:.2g} % +- {100 * first.test.sd:.2g} % would suit them best)"
        if first.kind.startswith("base"):
            yield f"  Fit again with --soft-base {found.height:.2g}"


def in_words(item: Assumption) -> str:
    """Name an assumption: `base rocks`, `link of joint2 bends`, `mass of link of joint2`."""
    if item.kind.startswith("mass"):
        return f"{item.kind} of link of {cut(item.joint, 12)}"
    thing, does = item.kind.split(" ")
    return f"{thing} of {cut(item.joint, 12)} {does}" if item.joint else item.kind


def _line(fit: CampaignFit, found: Assumptions, items: tuple[Assumption, ...]) -> str:
    sd = fit.information.sd
    moves = [np.nan_to_num(np.abs(item.test.shift) / sd) for item in items]
    worst = int(np.argmax([move.max() for move in moves]))
    item, which = items[worst], int(np.argmax(moves[worst]))
    value = f"{item.test.shift[which] / sd[which]:+.1f} sd {cut(fit.information.names[which], 16)}"
    if not moves[worst].max():
        value = "nothing"
    return f"{cut(in_words(item), 30):30s} {100 * item.test.amount:6.0f} %   {value:26s} {_said(found, items)}"


def _said(found: Assumptions, items: tuple[Assumption, ...]) -> str:
    asked = [item for item in found.asked_for if item in items]
    told = [item.test for item in items if item.test.separable]
    if asked:
        where = f" ({cut(asked[0].joint, 8)})" if asked[0].joint else ""
        return f"ASKED FOR: z {asked[0].test.z:+.1f}{where}"
    if not told:
        return "cannot be told apart" if any(item.test.seen for item in items) else "do not depend on it"
    z = [test.z if test.positive else abs(test.z) for test in told]
    return f"not asked for, z {max(z):+.1f}" if told[0].positive else f"not asked for, |z| {max(z):.1f}"
