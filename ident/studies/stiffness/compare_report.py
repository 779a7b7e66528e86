"""The report of a comparison of two campaigns, and its table."""

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ident.identify.fit import CampaignFit
from ident.inference.change import LEVEL
from ident.inference.information import half_width, holm, p_in_words
from ident.report.report import (
    Finding,
    Report,
    Section,
    Table,
    Verdict,
    by_head,
    by_row,
    cut,
    with_remedy,
    without_empty_columns,
)
from ident.report.words import counted, in_shown_unit, percent, sentence, some, unit_of
from ident.studies.stiffness.fit_report import damping_in_words
from ident.text import as_word

if TYPE_CHECKING:
    from ident.identify.compare import Comparison
    from ident.inference.change import Change

KINDS = {"k_bend": "bending", "k_tors": "torsion"}
NUMBERS_LISTED = 5
"""Differing numbers of the two arm files named at most."""
PAIRS = 8
"""Pairs without a change on the first screen, at most."""


def compare_sections(comparisons: Sequence["Comparison"], unpaired: Sequence[str] = ()) -> Report:
    """Return the report: for one pair verdict, stiffnesses and checks; for several an overview first."""
    if len(comparisons) == 1 and not unpaired:
        (one,) = comparisons
        subject = f"{_campaigns(one)}\n  {_counts(one)}"
        notes = Section("How to read it", (_meaning(one),))
        return Report(subject, _verdict(one), _answer(one), tuple(_findings(one)), next=_next(one), details=(notes,))
    return _overview(comparisons, unpaired)


def _next(comparison: "Comparison") -> str:
    """Return the next step: for a changed arm check its limit, else find smaller changes."""
    after = comparison.second
    if not isinstance(after, CampaignFit):
        return "ident fit CAMPAIGN"
    path = as_word(after.campaign.path or "CAMPAIGN").replace("{", "{{").replace("}", "}}")
    return f"ident diagnose {path}" if comparison.change.seen and after.arm.stroke else f"ident plan {path}"


def _campaigns(comparison: "Comparison") -> str:
    before, after = (cut(name, 30) for name in comparison.names)
    arm = f"{cut(comparison.fits[0].arm.name, 40)}: " if comparison.fits else ""
    return f"{arm}{before}, then {after}"


def _counts(comparison: "Comparison") -> str:
    if comparison.independent:
        count = len(comparison.change.names)
        return f"{count} stiffness{'es' * (count != 1)} compared"
    counts = " and ".join(str(len(fit.campaign)) for fit in comparison.fits)
    return f"{counts} measurements fitted together, {counted(len(comparison.change.names), 'change')} free"


def _verdict(comparison: "Comparison") -> Verdict:
    """Judge a pair: CHANGED where free changes lower chi-squared by more than chance, else NO CHANGE."""
    change = comparison.change
    test = f"T = {round(change.statistic, 6):.3g} on {change.mean:.1f} degrees of freedom, {p_in_words(change.p_value)}"
    if not change.seen:
        return Verdict("NO CHANGE", f"{test}.", "good")
    reason = f"{', '.join(_changed(comparison)) or 'The data do not show which stiffness'} ({test})."
    if alone := [stiffness_words(name) for name, p in zip(change.names, change.alone, strict=True) if p > LEVEL]:
        reason += f" One change alone would explain it: {' or '.join(alone)}."
    return Verdict("CHANGED", reason, "caution")


def _changed(comparison: "Comparison") -> list[str]:
    change = comparison.change
    return [stiffness_words(name) for name, is_so in zip(change.names, change.changed, strict=True) if is_so]


def stiffness_words(name: str) -> str:
    """Name the stiffness of a path: `joint2 in torsion`."""
    joint, _, field = name.rpartition(".")
    return f"{cut(joint, 24)} in {KINDS[field]}" if field in KINDS else cut(name, 30)


def _table(comparison: "Comparison") -> Table:
    change = comparison.change
    size, unit = in_shown_unit(change.names[0], 1.0)
    ratios, intervals = map(ratio_words, change.change), (" to ".join(map(ratio_words, x)) for x in change.interval)
    verdicts = np.where(change.open, "not determined", np.where(change.changed, "changed", "")).tolist()
    values = (size * change.first).tolist(), (size * change.second).tolist()
    rows = zip(change.names, *values, ratios, intervals, change.p_values.tolist(), verdicts, strict=True)
    heads = f"Stiffness [{unit}]", "before|.4g", "after|.4g", "change", "95 % interval", "p|.2g", ""
    return without_empty_columns(by_head(heads, rows))


def _answer(comparison: "Comparison") -> tuple[Table | str, ...]:
    """Return the stiffnesses, then the damping law of both campaigns and whether damping changed."""
    if (found := comparison.damping) is None:
        return (_table(comparison),)
    count, change, half = found[0], found[1], half_width(1 - LEVEL) * found[2]
    words = (text.removeprefix("Damping: ") for fit in comparison.fits for text in damping_in_words(fit.damping))
    ends = f"{ratio_words(change - half)} to {ratio_words(change + half)}"
    verdict = "it has changed" if abs(change) > half else "no change"
    more = f" In {counted(count, 'mode')} of both the ratio differs by {ratio_words(change)} ({ends}): {verdict}."
    return _table(comparison), f"Damping: {' Then '.join(words)}{more if count else ''}"


def ratio_words(log: float) -> str:
    """Write a change of a logarithm in percent, or as a factor if large: `-12 %`, `x 2.5`."""
    ratio = float(np.exp(log))
    return f"{100 * (ratio - 1):+.1f} %" if 0.5 < ratio < 2 else f"x {ratio:.3g}"


def _meaning(comparison: "Comparison") -> str:
    together = "" if comparison.independent else " All values are fitted to both campaigns together."
    return (
        "T: fall of the minimum chi-squared when all changes are free; p: probability of a larger one if nothing has "
        "changed. In the table p is that of so large a change of one stiffness (Holm); changed: p below "
        f"{percent(LEVEL)}. not determined: the value leans on the prior of the change, a factor of e.{together}"
    )


def _findings(comparison: "Comparison") -> Iterator[Finding]:
    """Yield what could mimic a change, then what to check, most important first."""
    change = comparison.change
    if comparison.independent:
        yield Finding(
            "INDEPENDENCE ASSUMED: the measurements are not available, so what both have in common, such as a prior, "
            "counts twice; logarithms of the stiffnesses are taken as normal"
        )
    before, after = (cut(name, 30) for name in comparison.names)
    names = (before, after) if before != after else (f"{before} (before)", f"{after} (after)")
    for which, fit in zip(names, (comparison.first, comparison.second), strict=True):
        if isinstance(fit, CampaignFit) and fit.doubts:
            yield Finding(f"{which}: {' '.join(map(sentence, fit.doubts))}", "see `ident fit`")
    if comparison.unlike:
        text = f"the arm files differ in {some(comparison.unlike, NUMBERS_LISTED)}: a change may come from there"
        yield Finding(text, "fit both with one arm file")
    changed = np.flatnonzero(change.changed)
    if len(changed) == len(change.names) > 1 and len(set(np.sign(change.change[changed]))) == 1:
        look = "look first for another payload, mass or base, or another calibration"
        yield Finding("all stiffnesses have changed the same way", look)
    for i in changed:
        become, look = "softer", "check bolts, bearing, gear and belt there; look for a crack"
        if change.change[i] >= 0:
            become, look = "stiffer", "was something exchanged or tightened there, does something rub?"
        yield Finding(f"{stiffness_words(change.names[i])} has become {become}", look)
    if comparison.priors_differ:
        yield Finding("the fits have different priors: those of the first count")


# -------- Several pairs


def _overview(comparisons: Sequence["Comparison"], unpaired: Sequence[str]) -> Report:
    together = holm([each.change.p_value for each in comparisons])
    rows = []
    for each, p in zip(comparisons, together, strict=True):
        said = f"CHANGED: {', '.join(_changed(each)) or 'not clear which stiffness'}" if p < LEVEL else "no change"
        rows.append((cut(each.name, 50), float(p), said))
    count, changed = len(rows), int((together < LEVEL).sum())
    alike = [i for i in range(count) if together[i] >= LEVEL]
    shown = [i for i in range(count) if i not in alike[PAIRS:]]
    word, least = f"{changed} OF {count} CHANGED" if changed else "NO CHANGE", float(together.min())
    verdict = Verdict(word, f"Smallest p of {counted(count, 'pair')}: {least:.2g}.", "caution" if changed else "good")
    named = some([cut(path, 60) for path in unpaired], NUMBERS_LISTED)
    heads = "Pair", "p|.2g", ""
    note = "p: probability of so much change anywhere in the pair if nothing has changed (Holm, over all pairs)."
    every = Section("All pairs", (by_head(heads, rows, note=note),))
    alone = [f"In one folder only: {named}"] if unpaired else []
    return Report(
        f"Comparison of {counted(count, 'pair')} of campaigns",
        verdict,
        (by_head(heads, (rows[i] for i in shown)), *alone),
        next=_next(comparisons[int(np.argmin(together))]),
        details=(every, *map(_pair, comparisons)),
    )


def _pair(comparison: "Comparison") -> Section:
    """Return the section of one of several pairs: verdict, stiffnesses, checks."""
    verdict, findings = _verdict(comparison), map(with_remedy, _findings(comparison))
    words = f"{_counts(comparison)}. {verdict.word}: {verdict.reason}"
    return Section(_campaigns(comparison), (words, *_answer(comparison), *findings, _meaning(comparison)))


# -------- Rows


def compare_rows(comparisons: Sequence["Comparison"], unpaired: Sequence[str] = ()) -> list[dict[str, Any]]:
    """Return a row for each stiffness: both values [SI], their ratio with its 95 % interval, p, and the verdict."""
    several = len(comparisons) > 1
    return [({"campaigns": each.name} if several else {}) | row for each in comparisons for row in _rows(each.change)]


def _rows(change: "Change") -> list[dict[str, Any]]:
    low, high = np.exp(change.interval).T
    units, values = map(unit_of, change.names), {"before": change.first, "after": change.second}
    ratio = {"ratio": np.exp(change.change), "low_95": low, "high_95": high, "p": change.p_values}
    return by_row(parameter=change.names, unit=units, **values, **ratio, changed=change.changed, open=change.open)
