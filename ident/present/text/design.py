"""The printed report of a design: what to change, what it brings, what it costs, and whether it stands the test."""

from collections.abc import Iterator

import numpy as np

from ident.assess.design import DesignStudy, bound_of, keeps, same, unchanged
from ident.present.text.basis import assumed_in_words, basis_in_words
from ident.present.text.sweep import change_in_words, mm, present_in_words, simulated_in_words
from ident.present.text.words import MM, cut, in_shown_unit, paragraphs, value_in_words
from ident.vibrate.design import Design
from ident.vibrate.evaluator import BinomialEstimate
from ident.vibrate.study import DIRECTIONS
from ident.vibrate.sweep import NEARBY

# -------- Sensitivity
# The printed table of sensitivities, and the head that it shares with the report of a design.

MOST = 12
"""Sensitivities that a report of a design tells."""
UNSURE = "~"
"""Marks a sensitivity whose sign is another for nearby arms."""


def sensitivity_report(study: DesignStudy) -> str:
    """Return the report without a design: motion, present amplitude, all sensitivities, what is assumed."""
    every = table(study, len(study.sensitivities.paths))
    return paragraphs([heading(study), present(study), every, assumed_in_words(study.basis)])


def heading(study: DesignStudy) -> Iterator[str]:
    """Say what is moved, and by which numbers."""
    yield from simulated_in_words(study.basis, elastic_belts=study.evaluator.elastic_belts, rate=study.evaluator.rate)
    yield from basis_in_words(study.basis, changed_draws=True)


def present(study: DesignStudy) -> Iterator[str]:
    """Tell the amplitudes of the arm as it is."""
    return present_in_words(study.basis, study.evaluator.measure, study.sensitivities.amplitude, study.limit)


def table(study: DesignStudy, most: int = MOST) -> Iterator[str]:
    """Tell by how many percent the amplitude changes with each number, the strongest first."""
    each = study.sensitivities
    way = DIRECTIONS[int(np.argmax(each.amplitude))]
    yield "Sensitivities: percent of amplitude per percent of the number, as the arm is"
    head = (f"{d:>9s} " + (" 5 to 95 %".rjust(16) if study.draws else "") for d in DIRECTIONS)
    yield f"  {'':22s}{'at present':>22s}{''.join(head)}".rstrip()
    for i in each.order[:most]:
        row = f"  {cut(each.paths[i], 22):22s}{value_in_words(each.paths[i], each.present[i]):>22s}"
        for d in range(3):
            row += f"{each.elasticity[i, d]:+9.3f}" + (UNSURE if each.unsure[i, d] else " ")
            row += f"{'{:+.3f} {:+.3f}'.format(*each.band[:, i, d]):>16s}" if study.draws else ""
        yield row.rstrip()
    if len(each.paths) > most:
        yield f"  and {len(each.paths) - most} more, in the .json"
    yield f"  strongest in {way} first, where the arm vibrates most"
    if each.unsure.any():
        yield f"  {UNSURE} {unsure_words(study.draws)}"


def unsure_words(draws: int = 0) -> str:
    """Say what is marked where the sign of a sensitivity is another for nearby arms."""
    if draws:
        return f"its sign is not sure: it is another for more than 5 % of the {draws} draws"
    share = f"{100 * NEARBY:g} %"
    return f"holds nearby only: {share} more or {share} less of the number does the opposite"


# -------- Design

RISE = 0.05
"""Share from which on it is said that a direction vibrates more."""


def design_report(study: DesignStudy) -> str:
    """Return the report: motion, sensitivities, changes, what they bring, optima, trade-off, verification."""
    design = study.design
    if design is None:
        raise ValueError("no design to report")
    sections = [
        heading(study),
        present(study),
        table(study),
        _changes(study, design),
        _effect(study, design),
        _optima(study, design),
        _curve(design),
        _minimum_change(study, design),
        _verification(study, design),
        assumed_in_words(study.basis),
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


def proposes_least(design: Design) -> bool:
    """Tell whether the least change that keeps the limit is what is proposed."""
    least = design.minimum_change
    return least is not None and bool(np.array_equal(least.changes, design.best.changes))


def rises(study: DesignStudy, design: Design) -> Iterator[str]:
    """Say in which directions the arm vibrates more after the change."""
    for d, a, b in zip(DIRECTIONS, design.present.amplitude, design.best.amplitude, strict=True):
        if b > a * (1 + RISE):
            yield f"{study.evaluator.measure} in {d} rises by {b / a - 1:.0%}, from {mm(a)} to {mm(b)} mm"


def _changes(study: DesignStudy, design: Design) -> Iterator[str]:
    arm = study.basis.arm
    if study.draws and design.limit:
        share = f"{MM * design.limit:g} mm by {study.draws} draws"
        yield f"Design: least probability of exceeding {share}, from the least largest amplitude on"
    elif proposes_least(design):
        yield f"Design: the least change within the bounds that keeps {MM * (design.limit or 0):g} mm"
        if unchanged(design.best):
            yield "  none is needed: the arm as it is keeps it"
            return
    else:
        yield "Design: the change within the bounds by which the largest amplitude is least"
    yield f"  {'':24s}{'from':>12s}{'to':>12s}  {'unit':10s}{'change':>10s}  bounds"
    for variable, change in zip(design.evaluator.variables, design.best.changes, strict=True):
        low, high = (change_in_words(variable, end) for end in variable.span(arm))
        at = bound_of(arm, variable, change)
        bounds = f"{low} to {high}" + (f", at the {at}" if at else "")
        for k, path in enumerate(variable.paths):
            words = f"{change_in_words(variable, change):>10s}  {bounds}" if k == 0 else f"{'the same':>10s}"
            (before, unit), (after, _) = (
                in_shown_unit(path, end) for end in (float(arm.get(path)), design.best.values[path])
            )
            yield f"  {cut(path, 24):24s}{before:12.4g}{after:12.4g}  {unit:10s}{words}"
    masses = [path for variable in design.evaluator.variables for path in variable.paths if path.endswith(".mass")]
    if masses:
        yield f"  {', '.join(masses)}: inertia was kept; in the arm file it follows the mass where there is a shape"
    if not design.settled:
        yield "  The search over the phases did NOT settle: amplitudes hold for the worst phases, but a smaller change"
        yield "  may do. Search from more starts (`starts`), or within narrower bounds (`change`)"
    if words := verdict(design):
        yield f"  {words}" + (" (the arm itself; for the draws, see below)" if study.draws else "")


def _effect(study: DesignStudy, design: Design) -> Iterator[str]:
    before, after, limit = design.present, design.best, design.limit
    yield f"  {'':34s}{'before':>10s}{'after':>10s}"
    for d, a, b in zip(DIRECTIONS, before.amplitude, after.amplitude, strict=True):
        yield f"  {f'{study.evaluator.measure} in {d} [mm]':34s}{mm(a):>10s}{mm(b):>10s}{b / a - 1:+8.1%}"
    yield from (f"  NOTE: {words}" for words in rises(study, design))
    yield f"  {'first natural frequency [Hz]':34s}{before.frequency:10.4f}{after.frequency:10.4f}"
    yield f"  {'static deflection [mm]':34s}{MM * before.deflection:10.4f}{MM * after.deflection:10.4f}"
    if study.draws and limit:
        name = f"exceeds {MM * limit:g} mm, by {study.draws} draws"
        yield f"  {name:34s}{before.exceedance:10.0%}{after.exceedance:10.0%}"
    yield f"  {'change norm':34s}{before.change_norm:10.3f}{after.change_norm:10.3f}"
    yield "  frequency and deflection: the worse of both ends of the motion"
    yield "  change norm: root of the weighted sum of squares of the changes, each as a share of the widest allowed"
    required = design.required
    if required.frequency:
        yield f"  required: a first frequency of at least {required.frequency:g} Hz"
    if np.isfinite(required.deflection):
        yield f"  required: a static deflection of at most {MM * required.deflection:g} mm"
    if np.isfinite(required.change_norm):
        yield f"  required: a change norm of at most {required.change_norm:g}"


def _optima(study: DesignStudy, design: Design) -> Iterator[str]:
    plural = "s" if study.starts > 1 else ""
    yield f"Optima: {same(design)} of {study.starts} start{plural} led to the same least amplitude"
    for place in design.optima:
        pairs = zip(design.evaluator.variables, place.changes, strict=True)
        changes = ", ".join(f"{cut(variable.name, 40)} {change_in_words(variable, size)}" for variable, size in pairs)
        yield f"  {mm(place.largest)} mm with {changes}"
    if failed := study.starts - len(design.optima):
        yield f"  {failed} led to nothing that meets the requirements"


def _curve(design: Design) -> Iterator[str]:
    if len(design.curve) <= 2:
        return
    variables = design.evaluator.variables
    yield "Trade-off: least largest amplitude by how much is changed"
    names = [cut(variable.paths[0], 20) + ("..." if len(variable.paths) > 1 else "") for variable in variables]
    widths = [max(len(name), 9) + 2 for name in names]
    yield f"  {'change norm':>11s}{'largest [mm]':>14s}" + "".join(map(str.rjust, names, widths))
    for place in design.curve:
        row = zip(variables, place.changes, widths, strict=True)
        words = "".join(f"{change_in_words(variable, change):>{width}s}" for variable, change, width in row)
        yield f"  {place.change_norm:11.3f}{mm(place.largest):>14s}{words}"


def _minimum_change(study: DesignStudy, design: Design) -> Iterator[str]:
    if design.limit is None or study.draws or proposes_least(design):
        return
    title, place = f"Minimum change that keeps {MM * design.limit:g} mm", design.minimum_change
    if place is None:
        yield f"{title}: none within these bounds"
    elif unchanged(place):
        yield f"{title}: none is needed"
    else:
        yield f"{title}: change norm {place.change_norm:.3f}, {mm(place.largest)} mm"
        for variable, change in zip(design.evaluator.variables, place.changes, strict=True):
            for path in variable.paths:
                words = f"{change_in_words(variable, change):>12s}  {value_in_words(path, place.values[path])}"
                yield f"  {cut(path, 24):24s}{words}"


def _verification(study: DesignStudy, design: Design) -> Iterator[str]:
    if study.verification is None:
        return
    before, after = study.verification.before, study.verification.after
    yield "Verification by the exact equations of motion (difference of the fast method as a share of the largest)"
    for name, check in (("before", before), ("after", after)):
        ways = zip(DIRECTIONS, check.amplitude, check.difference, strict=True)
        yield f"  {name + ':':8s}" + ", ".join(f"{d} {mm(size)} mm ({share:+.2%})" for d, size, share in ways)
    if design.limit is not None:
        largest = after.amplitude.max()
        words = "kept" if largest <= design.limit else f"exceeded by {mm(largest - design.limit)} mm"
        yield f"  limit of {MM * design.limit:g} mm after the change: {words}"
        yield from _fresh(design.limit, before.exceedance, after.exceedance) if study.basis.posterior else ()


def _fresh(limit: float, before: BinomialEstimate | None, after: BinomialEstimate | None) -> Iterator[str]:
    if before is None or after is None:
        yield "  no fresh draws: the posterior has none but those of the search; give fewer --draws"
        return
    yield f"  probability of exceeding {MM * limit:g} mm by {after.draws} fresh draws, with its 95 % interval:"
    for name, estimate in (("before", before), ("after", after)):
        low, high = estimate.interval
        yield f"    {name + ':':8s}{estimate.share:.1%} ({low:.1%} to {high:.1%})"
