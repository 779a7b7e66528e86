"""The report of a cross-validation, and its table."""

from collections.abc import Collection, Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from ident.inference.information import half_width, p_in_words
from ident.report.report import Cell, Finding, Report, Section, Table, Verdict, by_head, cut, without_empty_columns
from ident.report.words import counted, in_read_unit, percent, sentence, some
from ident.studies.stiffness.warnings import drive_states

if TYPE_CHECKING:
    from ident.identify.validate import Validation
    from ident.inference.scrutiny import HeldOut

PARTS = {"posture": "postures", "kind": "kinds of measurement", "row": "rows", "fraction": "fifths"}
"""The left-out parts, in words."""
SMALL = 0.1
"""Share of the largest value of a kind below which a percentage is meaningless."""
FEW, ROWS = 6, 8
"""Largest number of parts on the first screen, and of rows where a part has several."""


def validate_sections(validation: "Validation") -> Report:
    """Return the report of a validation."""
    fit, absolute = validation.fit, _absolute_kinds(validation)
    again = "check these measurements, then: ident fit"
    following = again if validation.missed or fit.doubts else "ident sample" if validation.told else "ident plan"
    return Report(
        f"Cross-validation of {cut(fit.arm.name, 30)} on {cut(fit.campaign.name, 30)}: "
        f"{len(validation.parts)} {PARTS[validation.leave]}, each predicted by a fit to the others",
        _verdict(validation),
        (*scope_table(validation), _parts_table(validation, absolute, few=True), *_ratios(validation)),
        tuple(_findings(validation)),
        next=f"{following} {{campaign}}",
        details=tuple(_details(validation, absolute)),
    )


def _ratios(validation: "Validation") -> Iterator[str]:
    """Yield how well the damping law predicts ratios from other parts; the verdict does not depend on it."""
    measured, predicted, off = validation.ratios.T
    if len(off):
        inside = f"{(np.abs(off) < half_width(0.95)).sum()} of {len(off)}"
        error = percent(float(np.sqrt(np.mean(np.log(measured / predicted) ** 2))))
        yield f"Damping ratios: {inside} lie in the predicted 95 % interval; rms error {error} of the value."


def _verdict(validation: "Validation") -> Verdict:
    """Judge a model by its predictions: VALID, PARTLY where it fails for some parts, NOT VALID, NOT TESTED."""
    fit, parts, told = validation.fit, validation.parts, validation.told
    if not told:
        needed = "the stiffnesses, or the hysteresis loops" if fit.loops else "the stiffnesses"
        return Verdict("NOT TESTED", f"No part can be predicted: without it the data do not determine {needed}.", "bad")
    inside = f"{validation.covered} of {len(validation.z)} values lie in the predicted 95 % interval."
    if validation.missed:
        least = min(part.p_value for part in validation.missed)
        named = some([cut(part.name, 30) for part in validation.missed], FEW)
        return Verdict("NOT VALID", f"Too far from the prediction: {named} ({p_in_words(least)}). {inside}", "bad")
    if fit.doubts:
        return Verdict("NOT VALID", f"{' '.join(map(sentence, fit.doubts))} {inside}", "bad")
    if len(told) < len(parts):
        return Verdict(f"PARTLY {len(told)} OF {len(parts)}", f"{len(told)} parts are predicted. {inside}", "caution")
    least = min(part.p_value for part in told)
    every = f"All {len(parts)} {PARTS[validation.leave]} agree with their prediction (smallest p = {least:.2g})."
    return Verdict("VALID", f"{every} {inside}", "good")


def _absolute_kinds(validation: "Validation") -> set[str]:
    """Return the kinds with a value near zero, which have no percentages."""
    campaign = validation.fit.campaign
    sizes = {kind: [abs(m.value) for m in campaign if m.kind == kind] for kind in {m.kind for m in campaign}}
    return {kind for kind, sizes in sizes.items() if kind != "frequency" and min(sizes) <= SMALL * max(sizes)}


def scope_table(validation: "Validation") -> tuple[Table, ...]:
    """Return the expected prediction error of each kind; empty if none was predicted."""
    absolute = _absolute_kinds(validation)
    rows = []
    for kind in dict.fromkeys(m.kind for m in validation.fit.campaign):
        if scope := validation.scope(kind, relative=kind not in absolute):
            sizes = (_size(kind, absolute, size) for size in (scope.half, scope.seen, scope.expected))
            rows.append((kind.replace("_", " "), *sizes, scope.folds))
    heads = "Expected prediction error (95 %)", "within", "t x rms error", "by the model", "parts|d"
    return (by_head(heads, rows),) if rows else ()


def _size(kind: str, absolute: Collection[str], size: float) -> str:
    """Write an error: in percent of the measured value, or in units for a kind with values near zero."""
    if kind not in absolute:
        return percent(size)
    number, unit = in_read_unit(kind, size)
    return f"{number:.2g} {unit}".strip()


def _parts_table(validation: "Validation", absolute: Collection[str], *, few: bool = False) -> Table:
    """Return each part with its errors; on the first screen those with the largest errors."""
    missed = {part.name for part in validation.missed}
    parts, caption = validation.parts, ""
    most = max(1, ROWS // (1 + len(absolute))) if absolute else FEW
    if few and len(parts) > most:
        order = sorted(range(len(parts)), key=lambda i: (np.nan_to_num(parts[i].p_value, nan=2.0), i))[:most]
        parts, caption = tuple(parts[i] for i in sorted(order)), f"The {most} of {len(parts)} parts predicted worst"
    rows = [row for part in parts for row in _part_rows(validation, part, absolute, part.name in missed)]
    heads = "Left out", "values", "rms error", "largest", "expected rms", "p|.2g", ""
    return without_empty_columns(by_head(heads, rows, caption))


def _part_rows(
    validation: "Validation", part: "HeldOut", absolute: Collection[str], is_missed: bool
) -> Iterator[tuple[Cell, ...]]:
    """Yield the relative errors of a part, and absolute errors for each kind with values near zero."""
    if not part.told:
        why = "not determined by the rest" if part.ended else "no optimum without it"
        yield cut(part.name, 40), str(len(part.places)), "-", "-", "-", None, why
        return
    kinds = np.array([validation.fit.campaign.measurements[place].kind for place in part.places])
    own = [kind for kind in dict.fromkeys(kinds.tolist()) if kind in absolute]
    groups = [("", ~np.isin(kinds, own))] * (not np.isin(kinds, own).all()) + [(kind, kinds == kind) for kind in own]
    for number, (kind, chosen) in enumerate(groups):
        size = np.ones(len(kinds)) if kind else np.where(part.measured == 0, np.nan, np.abs(part.measured))
        off, sd = (np.abs(part.off) / size)[chosen], (part.sd / size)[chosen]
        errors = (np.sqrt(np.nanmean(off**2)), np.nanmax(off), np.sqrt(np.nanmean(sd**2)))
        others = kind or ", ".join(dict.fromkeys(kinds[chosen].tolist())) if own else ""
        yield (
            "" if number else cut(part.name, 40),
            f"{chosen.sum()} {others.replace('_', ' ')}".rstrip(),
            *(_size(kind, absolute, float(error)) for error in errors),
            "" if number else part.p_value,
            "too far off" * (is_missed and not number),
        )


def _findings(validation: "Validation") -> Iterator[Finding]:
    """Yield the findings that affect the verdict, most important first."""
    fit, parts = validation.fit, validation.parts
    if validation.missed and fit.doubts:
        yield Finding(" ".join(map(sentence, fit.doubts)), "see `ident fit`")
    yield from drive_states(fit.arm, fit.campaign)
    untold = len(parts) - len(validation.told)
    if untold and not fit.loops:
        yield Finding(f"{untold} of {counted(len(parts), 'part')} cannot be predicted from the others", "measure more")
    if fit.loops:
        text = f"{counted(len(fit.loops), 'hysteresis loop')}: the width is taken from the other rows of the loop"
        alone = f"; where none remain, the part is not predicted ({untold} of {len(parts)})" if untold else ""
        yield Finding(text + alone, "try --leave row" if untold and validation.leave != "row" else "")


# -------- Details


def _details(validation: "Validation", absolute: Collection[str]) -> Iterator[Section]:
    note = (
        "rms error, largest: measured less predicted, relative to the measured value. expected rms: by the std. errors "
        "of the prediction, of noise and of what the other data leave undetermined. p: probability of errors as large, "
        "all values of the part together."
    )
    if absolute:
        kinds = ", ".join(sorted(absolute)).replace("_", " ")
        note += f" In the unit, not in percent: {kinds}, of which a value is below {percent(SMALL)} of the largest."
    shown = _parts_table(validation, absolute, few=True)
    every = (_parts_table(validation, absolute),) if shown.caption else ()
    yield Section("Each part, predicted from the rest", (*every, note))
    if validation.scopes:
        meaning = (
            "95 % of measurements like these, where it was not measured, are expected within the larger of two spans. "
            "observed: t quantile of as many parts times the rms error. expected: 1.96 times the expected rms."
        )
        yield Section("Expected prediction error", (meaning,))
    campaign = validation.fit.campaign
    angles = np.degrees(np.array([m.posture for m in campaign]))
    names = [joint.name for joint in validation.fit.arm.driven]
    rows = zip(names, angles.min(0).tolist(), angles.max(0).tolist(), strict=True)
    table = by_head(("joint", "from [deg]|.4g", "to [deg]|.4g"), rows)
    covered = [f"Loads: {', '.join(dict.fromkeys(cut(str(m.load), 30) for m in campaign))}."]
    if frequencies := [m.value for m in campaign if m.kind == "frequency"]:
        covered.append(f"Frequencies: {min(frequencies):.3g} to {max(frequencies):.3g} Hz.")
    yield Section("Valid within the range measured, no further", (table, *covered))


# -------- Rows


def validate_rows(validation: "Validation") -> list[dict[str, Any]]:
    """Return a row for each measurement: its part, value, prediction and standard deviation [SI]."""
    campaign = validation.fit.campaign.measurements
    return [
        {"part": part.name, "row": int(place) + 1, "kind": campaign[place].kind, "measured": float(part.measured[i])}
        | {"predicted": float(part.predicted[i]), "sd": float(part.sd[i]), "off_sd": float(part.off[i] / part.sd[i])}
        for part in validation.parts
        for i, place in enumerate(part.places)
    ]
