"""The printed report of a comparison: what has changed, how sure that is, and what to look at."""

from collections.abc import Iterator, Sequence
from itertools import chain

import numpy as np

from ident.identify.compare import Comparison
from ident.identify.fit import CampaignFit
from ident.inference.change import LEVEL
from ident.inference.verdicts import holm
from ident.present.text.units import in_shown_unit
from ident.present.text.words import cut, paragraphs

KINDS = {"k_bend": "bending", "k_tors": "torsion"}
NUMBERS_LISTED = 5
"""Numbers that differ between the arm files that are named."""


def compare_report(comparisons: Sequence[Comparison], unpaired: Sequence[str] = ()) -> str:
    """Return the report: of many pairs an overview; of each a verdict, its stiffnesses, and what to look at."""
    parts = ((_compare_heading(each), _table(each), _advice(each), _remarks(each)) for each in comparisons)
    overview = [_overview(comparisons, unpaired)] if len(comparisons) > 1 or unpaired else []
    return paragraphs([*overview, *chain.from_iterable(parts)])


def _overview(comparisons: Sequence[Comparison], unpaired: Sequence[str]) -> Iterator[str]:
    together = holm([each.change.p_value for each in comparisons])
    yield f"{len(comparisons)} pair{'s' * (len(comparisons) > 1)} of campaigns"
    for each, p in zip(comparisons, together, strict=True):
        change = each.change
        names = [stiffness_words(name) for name, is_so in zip(change.names, change.changed, strict=True) if is_so]
        verdict = f"CHANGED: {', '.join(names) or 'something'}" if p < LEVEL else "no change seen"
        yield f"  {cut(each.name, 50):50s} p = {p:<8.2g} {verdict}"
    yield "  p: chance of so much change anywhere where nothing has changed, by Holm for the number of pairs"
    if unpaired:
        more = len(unpaired) - NUMBERS_LISTED
        named = ", ".join(cut(path, 60) for path in unpaired[:NUMBERS_LISTED]) + (
            f" and {more} more" if more > 0 else ""
        )
        yield f"  in one folder only: {named}"


def _compare_heading(comparison: Comparison) -> Iterator[str]:
    change = comparison.change
    before, after = (cut(name, 30) for name in comparison.names)
    arms = [f"{cut(fit.arm.name, 40)}: " for fit in comparison.fits[:1]]
    yield f"{''.join(arms)}{before}, then {after}"
    if comparison.independent:
        yield "  INDEPENDENCE ASSUMED: the measurements are not at hand, so what both have in common, such as a"
        yield "  prior, counts twice; logarithms of the stiffnesses are taken as normal"
    else:
        counts = " and ".join(str(len(fit.campaign)) for fit in comparison.fits)
        yield f"  {counts} measurements fitted together, {len(change.names)} changes free"
    test = f"T = {round(change.statistic, 6):.3g} on {change.mean:.1f} degrees of freedom, p = {change.p_value:.2g}"
    if not change.seen:
        yield f"  No change is seen: {test}."
    elif change.changed.any():
        named = (name for name, changed in zip(change.names, change.changed, strict=True) if changed)
        yield f"  CHANGED: {', '.join(map(stiffness_words, named))} ({test})."
    else:
        yield f"  CHANGED, but the data do not tell which stiffness for itself ({test})."
    alone = [name for name, p in zip(change.names, change.alone, strict=True) if p > LEVEL]
    if change.seen and alone:
        yield f"  One change alone would explain it: {' or '.join(map(stiffness_words, alone))}."


def stiffness_words(name: str) -> str:
    """Say which stiffness a path names: `joint2 in torsion`."""
    joint, _, field = name.rpartition(".")
    return f"{cut(joint, 24)} in {KINDS[field]}" if field in KINDS else cut(name, 30)


def _table(comparison: Comparison) -> Iterator[str]:
    change = comparison.change
    columns = f"{'change':>9s}   {'95 % interval':19s}{'p':>8s}"
    yield f"{f'Stiffness [{in_shown_unit(change.names[0], 1.0)[1]}]':20s}{'before':>12s}{'after':>12s}{columns}"
    for i, name in enumerate(change.names):
        before, after = (f"{in_shown_unit(name, float(part[i]))[0]:.4g}" for part in (change.first, change.second))
        verdict = "open" if change.open[i] else "<--" if change.changed[i] else ""
        low, high = map(ratio_words, change.interval[i])
        row = f"{ratio_words(change.change[i]):>9s}   {f'{low} to {high}':19s}{change.p_values[i]:8.2g}"
        yield f"  {cut(name, 18):18s}{before:>12s}{after:>12s}{row}   {verdict}".rstrip()
    yield "  p: chance of so large a change of one where nothing has changed (Holm); <-- changed for itself;"
    together = "" if comparison.independent else " All values by both campaigns together."
    yield f"  open: told by the prior of the change, a factor of e.{together}"


def ratio_words(log: float) -> str:
    """Write a change of a logarithm in percent, or as a factor where it is large: `-12 %`, `x 2.5`."""
    ratio = float(np.exp(log))
    return f"{100 * (ratio - 1):+.1f} %" if 0.5 < ratio < 2 else f"x {ratio:.3g}"


def _advice(comparison: Comparison) -> Iterator[str]:
    change = comparison.change
    changed = np.flatnonzero(change.changed)
    if not len(changed):
        return
    yield "What to look at"
    for i in changed:
        name = stiffness_words(change.names[i])
        if change.change[i] < 0:
            yield f"  {name} has become softer: bolts, bearing, gear or belt of that joint; a crack"
        else:
            yield f"  {name} has become stiffer: was something exchanged or tightened there, does something rub?"
    if len(changed) == len(change.names) > 1 and len(set(np.sign(change.change[changed]))) == 1:
        yield "  All have changed the same way: look first for another payload, mass or base, or another calibration."


def _remarks(comparison: Comparison) -> Iterator[str]:
    remarks = [
        f"WARNING: {which}: {doubt.replace('see below', 'see ident fit')}"
        for which, fit in zip(_told_apart(comparison), (comparison.first, comparison.second), strict=True)
        if isinstance(fit, CampaignFit)
        for doubt in fit.doubts
    ]
    if comparison.unlike:
        more = len(comparison.unlike) - NUMBERS_LISTED
        named = ", ".join(comparison.unlike[:NUMBERS_LISTED]) + (f" and {more} more" if more > 0 else "")
        remarks.append(f"WARNING: the arm files differ in {named}: a change may come from there")
    if comparison.priors_differ:
        remarks.append("the fits have other priors: those of the first count")
    if remarks:
        yield "Remarks"
        yield from (f"  {remark}" for remark in remarks)


def _told_apart(comparison: Comparison) -> tuple[str, str]:
    """Return the campaigns' names; where they have one name, which of the two it is."""
    before, after = (cut(name, 30) for name in comparison.names)
    return (before, after) if before != after else (f"{before} (before)", f"{after} (after)")


def level_words() -> str:
    """Say from which chance on a change counts."""
    return f"{LEVEL:.0%}"
