"""What a fit takes for granted, in the printed report."""

from collections.abc import Iterator, Sequence

import numpy as np

from ident.identify.assumptions import KINDS, Assumption, Assumptions, of_kind
from ident.identify.fit import CampaignFit
from ident.present.text.units import MM, is_length, unit_of
from ident.present.text.words import cut, in_percent, percent

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
