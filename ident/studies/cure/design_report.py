"""The report of a design or of sensitivities alone, its table, and the changed arm file."""

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from ident.files import write_text
from ident.report.report import Cell, Finding, Report, Section, Table, Verdict, by_head, cut, short_power
from ident.report.words import MM, counted, in_shown_unit, unit_of, value_in_words
from ident.studies.basis import all_findings, assumed_section, motion_section, subject
from ident.studies.cure.design_study import DesignStudy, bound_of, keeps, same, unchanged
from ident.studies.working.sweep_report import change_in_words, mm
from ident.text import one_line
from ident.vibrate.design import Design
from ident.vibrate.simulate import MEASURES
from ident.vibrate.study import DIRECTIONS
from ident.vibrate.sweep import NEARBY, Sensitivities

STRONGEST = 12
"""Sensitivities listed at most."""
UNSURE = "~"
"""Mark of a sensitivity whose sign differs for nearby arms."""
RISE = 0.05
"""Relative increase from which a direction is reported to vibrate more."""
NEAR_LIMIT = 0.5
"""Share of the limit from which such a direction is part of the verdict; assumed."""


def design_sections(study: DesignStudy) -> Report:
    """Return the report of a design, or of sensitivities alone."""
    return _sensitivities_alone(study) if study.design is None else _design(study, study.design)


def risen(before: np.ndarray, after: np.ndarray, limit: float | None) -> list[str]:
    """Name directions that vibrate more after a change [m]; with a limit [m] those that come near it by that."""
    return [
        f"{d} rises by {100 * (b / a - 1):.0f} %, from {mm(a)} to {mm(b)} mm"
        for d, a, b in zip(DIRECTIONS, before, after, strict=True)
        if b > max(a * (1 + RISE), NEAR_LIMIT * (limit or 0.0))
    ]


# -------- Sensitivities


def _sensitivities_alone(study: DesignStudy) -> Report:
    count = len(study.sensitivities.paths)
    every = Section("All sensitivities", (sensitivity_table(study.sensitivities, count, study.draws),))
    return Report(
        f"Sensitivities of {subject(study.basis)}",
        answer=(
            _at_present(study),
            sensitivity_table(study.sensitivities, draws=study.draws, further="are in the result file"),
        ),
        findings=tuple(all_findings(study.basis)),
        next="choose what may change, then: ident design {arm} --change NAME",
        details=(_motion(study), *[every] * (count > STRONGEST), *assumed_section(study.basis)),
    )


def _at_present(study: DesignStudy) -> str:
    sizes = zip(DIRECTIONS, study.sensitivities.amplitude, strict=True)
    each = ", ".join(f"{direction} {mm(size)} mm" for direction, size in sizes)
    return f"Vibration of {study.basis.point}, {study.evaluator.measure}: {each}"


def sensitivity_table(each: Sensitivities, most: int = STRONGEST, draws: int = 0, further: str = "are weaker") -> Table:
    """Return by how many percent the amplitude changes with each number, the strongest first."""
    rows = []
    for i in each.order[:most]:
        row = [each.paths[i], short_power(value_in_words(each.paths[i], each.present[i]))]
        for d in range(len(DIRECTIONS)):
            row.append(f"{each.elasticity[i, d]:+.3f}{UNSURE * bool(each.unsure[i, d])}")
            row += ["{:+.3f} to {:+.3f}".format(*each.band[:, i, d])] if draws else []
        rows.append(tuple(row))
    ways = (part for d in DIRECTIONS for part in (d, *(["5 to 95 %"] if draws else [])))
    strongest = DIRECTIONS[int(np.argmax(each.amplitude))]
    note = f"Sorted by {strongest}, the direction that vibrates most."
    note += f" {UNSURE}: {unsure_words(draws)}." if each.unsure[each.order[:most]].any() else ""
    note += f" {len(each.paths) - most} more {further}." if len(each.paths) > most else ""
    caption = "Sensitivities: percent of amplitude per percent of the number, at the present values"
    return Table(caption, ("Number", "at present", *ways), tuple(rows), note=note)


def unsure_words(draws: int = 0) -> str:
    """Explain the mark of a sensitivity whose sign differs for nearby arms."""
    if draws:
        return f"sign uncertain: it is opposite for more than 5 % of the {draws} draws"
    share = f"{100 * NEARBY:g} %"
    return f"local only: {share} more or {share} less of the number has the opposite effect"


# -------- Design


def _design(study: DesignStudy, design: Design) -> Report:
    verdict = _verdict(study, design)
    tables = () if unchanged(design.best) else (_changes(study, design), _effect(study, design))
    return Report(
        f"Design of {subject(study.basis)}: {counted(len(design.evaluator.variables), 'variable')}",
        verdict,
        tables,
        tuple(_findings(study, design)),
        next=_next(study, design, verdict),
        details=tuple(_details(study, design)),
    )


def _verdict(study: DesignStudy, design: Design) -> Verdict | None:
    """Judge a design by whether the exact equations keep the limit; None without a limit."""
    if design.limit is None:
        return None
    largest, chance, least = design.best.largest, "", design.minimum_change
    if study.verification is not None:  # by the exact equations
        after = study.verification.after
        largest = float(after.amplitude.max())
        if after.exceedance is not None:
            low, high = after.exceedance.interval
            chance = f"; probability of exceeding it {100 * low:.1f} to {100 * high:.1f} %"
    limit, before = f"{MM * design.limit:g} mm", f"before: {mm(design.present.largest)} mm"
    if largest > design.limit:
        miss, quietest = largest - design.limit, design.optima[0]
        share = f"{100 * miss / design.limit:.1f} %"
        reason = f"{mm(largest)} mm exceeds the limit of {limit} by {mm(miss)} mm ({share}; {before})"
        reach = "within reach" if keeps(quietest, design.limit) else "the least within these bounds"
        return Verdict("NOT MET", f"{reason}; {mm(quietest.largest)} mm is {reach}{chance}.", "bad")
    if unchanged(design.best):
        return Verdict("MET", f"{mm(largest)} mm keeps the limit of {limit}: no change is needed{chance}.", "good")
    what = f"it is the change that {'makes exceeding it least probable' if study.draws else 'vibrates least'}"
    if least is not None and np.array_equal(least.changes, design.best.changes):
        what = "it is the least change that keeps it"
    if rises := risen(design.present.amplitude, design.best.amplitude, design.limit):
        what += f", but {' and '.join(rises)}"
    reason = f"{mm(largest)} mm keeps the limit of {limit} ({before}); {what}{chance}."
    return Verdict("MET", reason, "caution" if rises else "good")


def _next(study: DesignStudy, design: Design, verdict: Verdict | None) -> str:
    if verdict is not None and verdict.kind == "bad":
        return "ident design {arm} --sensitivities"
    if unchanged(design.best) or not study.basis.arm_file.path:
        return ""
    return "ident simulate {result}.toml"


def _findings(study: DesignStudy, design: Design) -> Iterator[Finding]:
    """Yield the findings that affect the verdict, most important first."""
    bounds = [
        f"{cut(variable.name, 40)} ({at} bound)"
        for variable, change in zip(design.evaluator.variables, design.best.changes, strict=True)
        if (at := bound_of(study.basis.arm, variable, change))
    ]
    if bounds:
        yield Finding(f"at the end of the allowed range: {', '.join(bounds)}", "widen --change if the design allows it")
    for rise in risen(design.present.amplitude, design.best.amplitude, None) if design.limit is None else ():
        yield Finding(f"{study.evaluator.measure} in {rise}", f"check that this much is acceptable in {rise[0]}")
    if study.starts > 1 and same(design) < 2 and not unchanged(design.best):
        text = f"1 of {study.starts} starts reached the least amplitude: there may be a better design"
        yield Finding(text, "search from more starts (--starts)")
    yield from all_findings(study.basis)
    masses = [path for variable in design.evaluator.variables for path in variable.paths if path.endswith(".mass")]
    if masses:
        kept = f"inertia was kept when {', '.join(masses)} changed"
        text = f"{kept}; in the arm file it follows the mass where there is a shape"
        yield Finding(text, "simulate the changed arm file")


def _changes(study: DesignStudy, design: Design) -> Table:
    """Return each changed number, before and after."""
    arm, rows = study.basis.arm, []
    for variable, change in zip(design.evaluator.variables, design.best.changes, strict=True):
        low, high = (change_in_words(variable, end) for end in variable.span(arm))
        at = bound_of(arm, variable, change)
        bounds = f"{low} to {high}{f', at the {at} bound' if at else ''}"
        for k, path in enumerate(variable.paths):
            before, unit = in_shown_unit(path, float(arm.get(path)))
            after, _ = in_shown_unit(path, design.best.values[path])
            own = (change_in_words(variable, change), bounds) if k == 0 else ("the same", "")
            rows.append((path, before, after, unit, *own))
    return by_head(("Changed number", "from|.4g", "to|.4g", "unit", "change", "allowed"), rows)


def _effect(study: DesignStudy, design: Design) -> Table:
    """Return the effect of the change on vibration, first frequency and deflection."""
    before, after, measure = design.present, design.best, study.evaluator.measure
    rows: list[tuple[Cell, ...]] = [
        (f"{measure} in {d} [mm]", mm(a), mm(b), f"{100 * (b / a - 1):+.1f} %" if a else "")
        for d, a, b in zip(DIRECTIONS, before.amplitude, after.amplitude, strict=True)
    ]
    rows.append(("first natural frequency [Hz]", f"{before.frequency:.4f}", f"{after.frequency:.4f}", ""))
    rows.append(("static deflection [mm]", mm(before.deflection), mm(after.deflection), ""))
    if study.draws and design.limit:
        name = f"exceeds {MM * design.limit:g} mm, by {study.draws} draws"
        rows.append((name, f"{100 * before.exceedance:.0f} %", f"{100 * after.exceedance:.0f} %", ""))
    rows.append(("size of change", f"{before.change_norm:.3f}", f"{after.change_norm:.3f}", ""))
    return Table("", ("Effect", "before", "after", "change"), tuple(rows))


# -------- Details


def _details(study: DesignStudy, design: Design) -> Iterator[Section]:
    yield _motion(study)
    required = design.required
    lines = [
        "First natural frequency and deflection: the worse of both ends of the motion.",
        "Size of change: root of the weighted sum of squares of the changes, each relative to the largest allowed.",
    ]
    if required.frequency:
        lines.append(f"Required: a first frequency of at least {required.frequency:g} Hz.")
    if math.isfinite(required.deflection):
        lines.append(f"Required: a static deflection of at most {MM * required.deflection:g} mm.")
    if math.isfinite(required.change_norm):
        lines.append(f"Required: a size of change of at most {required.change_norm:g}.")
    yield Section("Effect of the change", tuple(lines))
    yield _optima(study, design)
    yield from _curve(design)
    yield Section("What the vibration depends on", (sensitivity_table(study.sensitivities, draws=study.draws),))
    yield from _verification(study, design)
    yield from assumed_section(study.basis)


def _motion(study: DesignStudy) -> Section:
    basis, evaluator = study.basis, study.evaluator
    return motion_section(
        basis,
        elastic_belts=evaluator.elastic_belts,
        rate=evaluator.rate,
        method=f"fast. {evaluator.measure.capitalize()}: {MEASURES[evaluator.measure]}",
        more=(f"{_at_present(study)}.",),
        varied=True,
    )


def _optima(study: DesignStudy, design: Design) -> Section:
    lines = []
    for each in design.optima:
        pairs = zip(design.evaluator.variables, each.changes, strict=True)
        changes = ", ".join(f"{cut(variable.name, 40)} {change_in_words(variable, size)}" for variable, size in pairs)
        lines.append(f"{mm(each.largest)} mm with {changes}")
    if failed := study.starts - len(design.optima):
        lines.append(f"{counted(failed, 'start')} met no requirement.")
    title = f"Least amplitude: the same from {same(design)} of {counted(study.starts, 'start')}"
    return Section(title, tuple(lines))


def _curve(design: Design) -> Iterator[Section]:
    """Yield the least maximum amplitude over the size of the change, one column a size."""
    if len(design.curve) <= 2:
        return
    rows: list[tuple[Cell, ...]] = [("largest [mm]", *(mm(place.largest) for place in design.curve))]
    for k, variable in enumerate(design.evaluator.variables):
        name = cut(variable.paths[0], 20) + ("..." if len(variable.paths) > 1 else "")
        rows.append((name, *(change_in_words(variable, place.changes[k]) for place in design.curve)))
    head = ("size of change", *(f"{place.change_norm:.3f}" for place in design.curve))
    yield Section("Trade-off: least vibration for each size of change", (Table("", head, tuple(rows)),))


def _verification(study: DesignStudy, design: Design) -> Iterator[Section]:
    if study.verification is None:
        return
    checks = {"before": study.verification.before, "after": study.verification.after}
    rows: list[tuple[Cell, ...]] = [
        (name, *(part for pair in zip(map(mm, check.amplitude), check.difference, strict=True) for part in pair))
        for name, check in checks.items()
    ]
    heads = "arm", *(part for d in DIRECTIONS for part in (f"{d} [mm]", f"fast method in {d}|+z.2%"))
    note = "fast method: its difference from the exact equations, as a share of the largest direction's amplitude."
    parts: list[str | Table] = [by_head(heads, rows, note=note)]
    estimates = {name: check.exceedance for name, check in checks.items()}
    if design.limit is not None and study.basis.posterior:
        limit = f"{MM * design.limit:g} mm"
        counts = [(name, each.share, *each.interval, each.draws) for name, each in estimates.items() if each]
        caption = f"Probability of exceeding {limit}, by draws that the search has not used"
        heads = "arm", "probability|.1%", "95 % interval from|.1%", "to|.1%", "draws|d"
        none = "No fresh draws: the search has used all of the posterior's. Give fewer --draws."
        parts.append(by_head(heads, counts, caption) if counts else none)
    yield Section("Verification by the exact equations of motion", tuple(parts))


# -------- Rows


def design_rows(study: DesignStudy) -> list[dict[str, Any]]:
    """Return a row for each number that may change [SI]; without a design, for each sensitivity.

    For a design: the number at present, at best, and for the minimum change. For sensitivities, the strongest first:
    percent of amplitude per percent of the number in x, y and z; `unsure` names the directions in which the sign
    differs for nearby arms.
    """
    design, known = study.design, study.sensitivities
    if design is None:
        return [
            {"number": known.paths[i], "unit": unit_of(known.paths[i]), "present": float(known.present[i])}
            | dict(zip(DIRECTIONS, map(float, known.elasticity[i]), strict=True))
            | {"unsure": "".join(np.array([*DIRECTIONS])[known.unsure[i]])}
            for i in known.order
        ]
    least = design.minimum_change.values if design.minimum_change else {}
    return [
        {"number": path, "unit": unit_of(path), "present": float(study.basis.arm.get(path))}
        | {"best": design.best.values[path], "minimum_change": least.get(path, math.nan)}
        | {"at_bound": bound_of(study.basis.arm, variable, float(change))}
        for variable, change in zip(design.evaluator.variables, design.best.changes, strict=True)
        for path in variable.paths
    ]


def write_arm(text: str, note: str, path: Path) -> None:
    """Write an arm file completely or not at all, with a note at its top."""
    write_text(path, f"# {one_line(note)}\n{text}")
