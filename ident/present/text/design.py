"""The printed report of a design: what to change, what it brings, what it costs, and whether it stands the test."""

from collections.abc import Iterator

import numpy as np

from ident.assess.design import (
    DesignStudy,
    bound_of,
    change_in_words,
    keeps,
    same,
)
from ident.present.text.sensitivity import assumptions, heading, mm, present, table
from ident.present.text.units import MM, NMM, is_stiffness, nmm_per_deg, unit_of, value_in_words
from ident.present.text.words import cut, paragraphs
from ident.vibrate.redesign.design import Design, Place
from ident.vibrate.redesign.variable import Variable
from ident.vibrate.redesign.verify import Check
from ident.vibrate.response.study import DIRECTIONS


def design_report(designing: DesignStudy) -> str:
    """Return the report: motion, sensitivities, changes, what they bring, optima, trade-off, verification."""
    design = designing.design
    if design is None:
        raise ValueError("no design to report")
    sections = [
        heading(designing),
        present(designing),
        table(designing),
        _changes(designing, design),
        _effect(designing, design),
        _optima(designing, design),
        _curve(design),
        _cheapest(design),
        _verification(designing, design),
        assumptions(designing),
    ]
    return paragraphs(sections)


def verdict(design: Design) -> str:
    """Say whether the limit is reached, or by how much it is missed; empty without one."""
    limit, best = design.limit, design.optima[0]
    if limit is None:
        return ""
    if keeps(best, limit):
        return f"the limit of {MM * limit:g} mm can be kept: {mm(best.largest)} mm at best"
    miss = best.largest - limit
    return (
        f"the limit of {MM * limit:g} mm was MISSED by {mm(miss)} mm ({miss / limit:.1%}): "
        f"{mm(best.largest)} mm at best within these bounds"
    )


def _changes(designing: DesignStudy, design: Design) -> Iterator[str]:
    if designing.draws and design.limit:
        share = f"{MM * design.limit:g} mm by {designing.draws} draws"
        yield f"Design: least probability of exceeding {share}, from the least largest amplitude on"
    else:
        yield "Design: the change within the bounds by which the largest amplitude is least"
    yield f"  {'':24s}{'from':>12s}{'to':>12s}  {'unit':10s}{'change':>10s}  bounds"
    for variable, change in zip(design.evaluator.variables, design.best.changes, strict=True):
        low, high = (change_in_words(variable, end) for end in variable.span(designing.arm))
        at = bound_of(designing.arm, variable, change)
        bounds = f"{low} to {high}" + (f", at the {at}" if at else "")
        for k, path in enumerate(variable.paths):
            told = f"{change_in_words(variable, change):>10s}  {bounds}" if k == 0 else f"{'the same':>10s}"
            ends = float(designing.arm.get(path)), design.best.values[path]
            yield f"  {cut(path, 24):24s}{ends[0]:12.4g}{ends[1]:12.4g}  {unit_of(path):10s}{told}"
            if is_stiffness(path):
                before, after = (nmm_per_deg(end) for end in ends)
                yield f"  {'':24s}{before:12.4g}{after:12.4g}  {NMM}"
    masses = [path for variable in design.evaluator.variables for path in variable.paths if path.endswith(".mass")]
    if masses:
        yield f"  {', '.join(masses)}: inertia was kept; in the arm file it follows the mass where there is a shape"
    if words := verdict(design):
        yield f"  {words}" + (" (the arm itself; for the draws, see below)" if designing.draws else "")


def _effect(designing: DesignStudy, design: Design) -> Iterator[str]:
    before, after, limit = design.present, design.best, design.limit
    yield f"  {'':34s}{'before':>10s}{'after':>10s}"
    for d, a, b in zip(DIRECTIONS, before.amplitude, after.amplitude, strict=True):
        yield f"  {f'{designing.trial.measure} in {d} [mm]':34s}{mm(a):>10s}{mm(b):>10s}{b / a - 1:+8.1%}"
    yield f"  {'first natural frequency [Hz]':34s}{before.frequency:10.4f}{after.frequency:10.4f}"
    yield f"  {'static deflection [mm]':34s}{MM * before.deflection:10.4f}{MM * after.deflection:10.4f}"
    if designing.draws and limit:
        name = f"exceeds {MM * limit:g} mm, by {designing.draws} draws"
        yield f"  {name:34s}{before.exceedance:10.0%}{after.exceedance:10.0%}"
    yield f"  {'amount of change':34s}{before.change_norm:10.3f}{after.change_norm:10.3f}"
    yield "  frequency and deflection: the worse of both ends of the motion"
    yield "  amount: root of the weighted sum of squares of the changes, each as a share of the widest allowed"
    required = design.required
    if required.frequency:
        yield f"  required: a first frequency of at least {required.frequency:g} Hz"
    if np.isfinite(required.deflection):
        yield f"  required: a static deflection of at most {MM * required.deflection:g} mm"
    if np.isfinite(required.change_norm):
        yield f"  required: an amount of change of at most {required.change_norm:g}"


def _optima(designing: DesignStudy, design: Design) -> Iterator[str]:
    count, found = same(design), len(design.optima)
    plural = "s" if designing.starts > 1 else ""
    yield f"Optima: {count} of {designing.starts} start{plural} led to the same least amplitude"
    for place in design.optima:
        yield f"  {mm(place.largest)} mm with {_told(design, place)}"
    if found < designing.starts:
        yield f"  {designing.starts - found} led to nothing that meets the requirements"


def _curve(design: Design) -> Iterator[str]:
    if len(design.curve) <= 2:
        return
    yield "Trade-off: least largest amplitude by how much is changed"
    names = [cut(variable.paths[0], 20) + ("..." if len(variable.paths) > 1 else "") for variable in _variables(design)]
    widths = [max(len(name), 9) + 2 for name in names]
    yield f"  {'amount':>8s}{'largest [mm]':>14s}" + "".join(f"{n:>{w}s}" for n, w in zip(names, widths, strict=True))
    for place in design.curve:
        row = zip(_variables(design), place.changes, widths, strict=True)
        words = "".join(f"{change_in_words(variable, change):>{width}s}" for variable, change, width in row)
        yield f"  {place.change_norm:8.3f}{mm(place.largest):>14s}{words}"


def _cheapest(design: Design) -> Iterator[str]:
    if design.limit is None:
        return
    limit, place = f"{MM * design.limit:g} mm", design.minimum_change
    if place is None:
        yield f"Cheapest change that keeps {limit}: none was found"
    elif place.change_norm == 0:
        yield f"Cheapest change that keeps {limit}: none is needed"
    else:
        yield f"Cheapest change that keeps {limit}: amount {place.change_norm:.3f}, {mm(place.largest)} mm"
        for variable, change in zip(_variables(design), place.changes, strict=True):
            for path in variable.paths:
                words = f"{change_in_words(variable, change):>12s}  {_both(path, place.values[path])}"
                yield f"  {cut(path, 24):24s}{words}"


def _verification(designing: DesignStudy, design: Design) -> Iterator[str]:
    if designing.verification is None:
        return
    before, after = designing.verification.before, designing.verification.after
    yield "Verification by the exact equations of motion (difference of the fast method as a share of the largest)"
    for name, check in (("before", before), ("after", after)):
        ways = zip(DIRECTIONS, check.amplitude, check.difference, strict=True)
        yield f"  {name + ':':8s}" + ", ".join(f"{d} {mm(size)} mm ({share:+.2%})" for d, size, share in ways)
    if design.limit is not None:
        largest = after.amplitude.max()
        words = "kept" if largest <= design.limit else f"exceeded by {mm(largest - design.limit)} mm"
        yield f"  limit of {MM * design.limit:g} mm after the change: {words}"
    if designing.posterior and design.limit is not None:
        yield from _fresh(designing, design.limit, before, after)


def _fresh(designing: DesignStudy, limit: float, before: Check, after: Check) -> Iterator[str]:
    if before.exceedance is None or after.exceedance is None:
        yield "  no fresh draws: the posterior has none but those of the search; give fewer --draws"
        return
    yield f"  probability of exceeding {MM * limit:g} mm by {designing.fresh} fresh draws, with its 95 % interval:"
    for name, found in (("before", before.exceedance), ("after", after.exceedance)):
        low, high = found.interval
        yield f"    {name + ':':8s}{found.share:.1%} ({low:.1%} to {high:.1%})"


def _variables(design: Design) -> tuple[Variable, ...]:
    return design.evaluator.variables


def _told(design: Design, place: Place) -> str:
    pairs = zip(_variables(design), place.changes, strict=True)
    return ", ".join(f"{cut(variable.name, 40)} {change_in_words(variable, change)}" for variable, change in pairs)


def _both(path: str, value: float) -> str:
    """Write a value in SI, and in N mm/deg if it is a stiffness."""
    plain = f"{value:.4g} {unit_of(path)}".removesuffix(" -")
    words = value_in_words(path, value)
    return plain if words == plain else f"{plain} = {words}"
