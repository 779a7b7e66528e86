"""Curved springs in words: what a campaign can tell of them, and where vibration passes T1."""

import math
from collections.abc import Iterator, Sequence

from ident.identify.curved import SpringCheck
from ident.vibrate.response.curved import Passage


def springs_in_words(springs: Sequence[SpringCheck]) -> Iterator[str]:
    """Say of each spring whether the data can tell it from a straight one, and how it is loaded meanwhile."""
    if not springs:
        return
    yield "Curved springs: can the data tell them from straight ones? Data as predicted at the arm file's values"
    for each in springs:
        told = "yes" if each.told else "NO"
        cost = "no arm with a straight one stands" if math.isnan(each.chi_squared) else _cost(each)
        yield f"  {each.spring}: {told}, {cost}"
        yield f"    load {_loads(each)}"
        if each.unloaded:
            yield "    WARNING: next to no load wherever modes were measured: frequencies see K1 alone"
        if not each.told:
            yield "    fix its numbers, or measure under loads on both sides of T1"


def passages_in_words(passages: Sequence[Passage]) -> Iterator[str]:
    """Warn of springs whose load passes T1 in a motion."""
    for each in passages:
        yield (
            f"  WARNING: the load of {each.spring} passes T1 = {each.torque1:.3g} N m: it goes from {each.low:.3g} to"
            f" {each.high:.3g} N m, so that its stiffness changes within the motion"
        )


def _cost(check: SpringCheck) -> str:
    return f"a straight one would cost a chi-squared of {check.chi_squared:.2g}"


def _loads(check: SpringCheck) -> str:
    parts = [("at rest", check.at_rest), ("where modes were measured", check.vibrating)]
    given = [f"{low:.3g} to {high:.3g} N m {what}" for what, (low, high) in parts if not math.isnan(high)]
    limit = "" if math.isnan(check.torque1) else f"; T1 = {check.torque1:.3g} N m"
    return ", ".join(given) + limit
