"""The report of predictions of an arm at postures: modes, strain energy, static deflection; and its table."""

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ident.measure import DRIVE_STATES
from ident.report.report import Finding, Part, Report, Section, Table, by_head, cut, without_empty_columns
from ident.report.words import MM, counted, degrees, sentence, span
from ident.studies.basis import changes_in_words, values_in_words
from ident.studies.look.show_report import largest_shares

if TYPE_CHECKING:
    from ident.identify.modal_analysis import ModalAnalysis
    from ident.identify.values import Values
    from ident.studies.look.prediction import Prediction

FEW = 2
"""Number of postures up to which each has its own table on the first screen; above, each has a row."""
MODES, POSTURES = 6, 12
"""Modes and postures on the first screen, at most."""
ACROSS = 6
"""Joints per table of strain-energy shares."""
DEFLECTION = ("static deflection [mm]", "x|.3f", "y|.3f", "z|.3f", "total|.3f")
"""Head of the table of a deflection."""
CAUTIONS = ("WARNING: ", "REMARK: ")
"""Beginnings of remarks that cast doubt on fitted values."""


def predict_sections(
    predictions: Sequence["Prediction"],
    fit: "Values | None" = None,
    posterior: "Values | None" = None,
    changed: Mapping[str, float] | None = None,
) -> Report:
    """Return modes, strain energy and deflection at each posture.

    Args:
        predictions: at each posture.
        fit: fitted values of the arm.
        posterior: source of the bands.
        changed: numbers that were set, by path [SI].
    """
    first = predictions[0].analysis
    where = f"at {degrees(first.posture)}" if len(predictions) == 1 else f"at {len(predictions)} postures"
    servo = "" if first.drives == DRIVE_STATES[0] else f", {first.drives} on"
    origin, cautions = values_used(fit, posterior, changed or {})
    details = [section for each in predictions for section in _details(each, alone=len(predictions) > FEW)]
    if len(origin) > FEW:
        details.insert(0, Section("Values used", origin))
    return Report(
        f"{cut(first.arm.name, 50)} {where}, load: {first.load}{servo}: natural frequencies and static deflection",
        answer=(*origin[:FEW], *(_each(predictions) if len(predictions) <= FEW else _overview(predictions))),
        findings=(*_findings(predictions), *cautions),
        next="ident resonance {arm}" if first.arm.stroke is not None else "",
        details=tuple(details),
    )


def values_used(
    fit: "Values | None", posterior: "Values | None", changed: Mapping[str, float]
) -> tuple[tuple[str, ...], tuple[Finding, ...]]:
    """Return in sentences which values are not the arm file's, and warnings about them."""
    lines = (*values_in_words(fit, posterior), *changes_in_words(changed))
    doubts = tuple(Finding(line.partition(": ")[2]) for line in lines if line.startswith(CAUTIONS))
    return tuple(sentence(line) for line in lines if not line.startswith(CAUTIONS)), doubts


def _findings(predictions: Sequence["Prediction"]) -> Iterator[Finding]:
    for each in predictions:
        analysis = each.analysis
        for name, angle, (low, high) in analysis.beyond_limits():
            limits = f"{math.degrees(low):.4g} to {math.degrees(high):.4g} deg"
            yield Finding(f"{name} at {math.degrees(angle):.4g} deg is outside its limits, {limits}", "check --posture")
        if each.collapsed:
            collapse = f"collapse{'s' * (each.collapsed == 1)} at {degrees(analysis.posture)}"
            text = f"{counted(each.collapsed, 'draw')} of the posterior {collapse}"
            yield Finding(f"{text}: no stable equilibrium; the bands leave them out")
    unclear = sum(int(each.analysis.ambiguous.sum()) for each in predictions)
    if unclear:
        text = f"{counted(unclear, 'mode')} marked (?): nearly as much bending as torsion, or vertical as lateral"
        yield Finding(text, "compare shapes, not names: a small change may rename such a mode")


# -------- First screen


def _each(predictions: Sequence["Prediction"]) -> Iterator[Part]:
    """Yield modes and deflection of each posture."""
    for each in predictions:
        yield _modes(each, degrees(each.analysis.posture) if len(predictions) > 1 else "", MODES)
    rows = [
        (f"{name} at {degrees(each.analysis.posture)}" if len(predictions) > 1 else name, *_moved(moved))
        for each in predictions
        for name, moved in each.analysis.deflection.items()
    ]
    if rows:
        yield by_head(DEFLECTION, rows)


def _modes(each: "Prediction", caption: str, most: int) -> Table:
    """Return the modes of a posture, with the two largest shares of strain energy of each."""
    analysis, rows = each.analysis, []
    for i in range(min(most, len(analysis.labels))):
        band = "" if each.frequency is None else span(*each.frequency_band[:, i])
        damping = round(100 * float(analysis.damping_ratio[i]), 2) + 0.0
        frequency = float(analysis.modes.frequency[i])
        rows.append((i + 1, _mode(analysis, i), frequency, band, damping, largest_shares(analysis, i)))
    more = len(analysis.labels) - len(rows)
    heads = "no.|d", "mode", "frequency [Hz]|.4f", "5 to 95 %", "damping [%]|.2f", "largest shares of strain energy"
    return without_empty_columns(by_head(heads, rows, caption, f"{more} more modes: --details" * (more > 0)))


def _mode(analysis: "ModalAnalysis", i: int) -> str:
    return f"{analysis.labels[i]}{' (?)' if analysis.ambiguous[i] else ''}"


def _overview(predictions: Sequence["Prediction"]) -> Iterator[Part]:
    """Yield a row for each posture: its lowest frequencies, and the deflection of the end point."""
    end = list(predictions[0].analysis.deflection)[-1:]
    count = min(MODES, *(len(each.analysis.labels) for each in predictions))
    rows = []
    for analysis in (each.analysis for each in predictions[:POSTURES]):
        size = [MM * float(np.linalg.norm(analysis.deflection[name])) for name in end]
        rows.append((degrees(analysis.posture), *analysis.modes.frequency[:count].tolist(), *size))
    modes = [f"mode {i + 1} [Hz]|.4g" for i in range(count)]
    more = len(predictions) - len(rows)
    heads = "posture", *modes, *(f"{cut(name, 12)} deflection [mm]|.3f" for name in end)
    yield by_head(heads, rows, note=f"{more} more postures: --details" * (more > 0))


def _moved(moved: np.ndarray) -> tuple[float | None, ...]:
    """Return a deflection in mm by direction, and its magnitude."""
    return *((MM * moved).round(3) + 0.0).tolist(), MM * float(np.linalg.norm(moved))


# -------- Details


def _details(each: "Prediction", *, alone: bool) -> Iterator[Section]:
    """Yield the strain energy of the modes, and the rest of the first screen's tables; everything if alone."""
    analysis = each.analysis
    where = degrees(analysis.posture)
    modes = [_modes(each, "", len(analysis.labels))] if alone or len(analysis.labels) > MODES else []
    yield Section(f"Share of each bushing in the strain energy of the modes at {where}", (*modes, *_shares(each)))
    if analysis.deflection and (alone or each.deflection is not None):
        rows = []
        for name, moved in analysis.deflection.items():
            rows.append((name, *_moved(moved)))
            sides = zip(("5 %", "95 %"), each.deflection_band[name], strict=True) if each.deflection else ()
            rows += [(f"{name}, {words}", *_moved(side)[:3], None) for words, side in sides]
        title = f"Static deflection at {where}, from the position with rigid joints"
        yield Section(title, (by_head(DEFLECTION, rows),))


def _shares(each: "Prediction") -> Iterator[Table]:
    """Yield the shares of bending and torsion of each joint [%] by mode, for a few joints at a time."""
    modes, joints = each.analysis.modes, each.analysis.arm.joints
    for k in range(0, len(joints), ACROSS):
        places = range(k, min(k + ACROSS, len(joints)))
        columns = (f"{joints[j].name} {way} [%]|.0f" for j in places for way in ("bend", "tors"))
        rows = (
            (_mode(each.analysis, i), *(100 * float(s[j, i]) for j in places for s in (modes.bend, modes.tors)))
            for i in range(len(each.analysis.labels))
        )
        yield by_head(("mode", *columns), rows)


# -------- Rows


def predict_rows(predictions: Sequence["Prediction"]) -> list[dict[str, Any]]:
    """Return a row for each mode at each posture: angles [deg], load, frequency [Hz], label, damping ratio [-].

    Frequencies and damping ratios have quantiles of 5 and 95 %, NaN without draws.
    """
    return [
        {joint.name: math.degrees(q) for joint, q in zip(analysis.arm.driven, analysis.posture, strict=True)}
        | {"load": str(analysis.load), "mode": i + 1, "frequency": float(analysis.modes.frequency[i])}
        | {"label": str(label), "damping_ratio": float(analysis.damping_ratio[i])}
        | dict(zip(("frequency_q05", "frequency_q95"), each.frequency_band[:, i].tolist(), strict=True))
        | dict(zip(("damping_q05", "damping_q95"), each.damping_band[:, i].tolist(), strict=True))
        for analysis, each in ((each.analysis, each) for each in predictions)
        for i, label in enumerate(analysis.labels)
    ]
