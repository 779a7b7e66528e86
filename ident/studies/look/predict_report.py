"""The report of predictions of an arm at postures: modes, strain energy, static deflection; and its table."""

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ident.measure import DRIVE_STATES
from ident.report.report import Finding, Part, Report, Section, Table, by_head, cut, without_empty_columns
from ident.report.words import MM, counted, degrees, sentence, span, vector_in_words
from ident.studies.basis import changes_in_words, values_in_words
from ident.studies.look.show_report import largest_shares

if TYPE_CHECKING:
    from ident.identify.compliance import ToolCompliance
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
MOTIONS = *(f"{axis} [um]" for axis in "xyz"), *(f"r{axis} [urad]" for axis in "xyz")
WRENCHES = *(f"F{axis} [N]" for axis in "xyz"), *(f"M{axis} [N m]" for axis in "xyz")
UNITS = ("m/N", "m/(N m)"), ("rad/N", "rad/(N m)")
"""Rows and columns of a compliance, displacements and rotations by forces and moments; and its units in SI."""
UM, MRAD = 1e6, 1e3
"""um in a metre, mrad in a radian."""
CAUTIONS = ("WARNING: ", "REMARK: ")
"""Beginnings of remarks that cast doubt on fitted values."""


def predict_sections(
    predictions: Sequence["Prediction"],
    fit: "Values | None" = None,
    posterior: "Values | None" = None,
    changed: Mapping[str, float] | None = None,
) -> Report:
    """Return modes, strain energy, deflection and, where asked for, the compliance at each posture.

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
    tool, many = predictions[0].tool, len(predictions) > FEW
    details = [section for each in predictions for section in _details(each, alone=many or tool is not None)]
    if len(origin) > FEW:
        details.insert(0, Section("Values used", origin))
    peaks = [Section(f"Peaks at {degrees(p.analysis.posture)}", (*_peaks(p.tool),)) for p in predictions if p.tool]
    asked = f"compliance at {tool.point}" if tool else "natural frequencies and static deflection"
    show = _compliances if tool else _overview if many else _each
    return Report(
        f"{cut(first.arm.name, 50)} {where}, load: {first.load}{servo}: {asked}",
        answer=(*origin[:FEW], *show(predictions), *(peaks[0].parts if len(peaks) == 1 else ())),
        findings=(*_findings(predictions), *cautions),
        next="ident resonance {arm}" if first.arm.stroke is not None else "",
        details=(*details, *(each for each in peaks if each.parts and len(peaks) > 1)),
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
    unclear = sum(int(each.analysis.ambiguous.sum()) for each in predictions if not each.tool)
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


def _compliances(predictions: Sequence["Prediction"]) -> Iterator[Part]:
    """Yield the compliance along and about the axes, at few postures, and the largest one along any direction."""
    tools = [(each.analysis, each.tool) for each in predictions if each.tool]
    (first, tool), few, rows = tools[0], len(tools) <= FEW, list[tuple[Any, ...]]()
    for analysis, own in tools[:POSTURES]:
        at = f" at {degrees(analysis.posture)}" if len(tools) > 1 else ""
        for i, axis in enumerate("xyz" if few else ""):
            cells = [_with_band(unit, own.matrix[k, k], own.band[:, k, k]) for k, unit in ((i, UM), (3 + i, MRAD))]
            rows.append((axis + at, *cells[0], *cells[1]))
        value, direction, band = own.largest
        rows.append((f"largest{at}: along ({vector_in_words(direction)})", *_with_band(UM, value, band), "", ""))
    more = f"{len(tools) - POSTURES} more postures: --details" if len(tools) > POSTURES else ""
    heads = "by force [um/N]|.4g", "5 to 95 %", "by moment [mrad/(N m)]|.4g", "moment, 5 to 95 %"
    yield without_empty_columns(by_head((f"along, about ({tool.frame} frame)", *heads), rows, note=more))
    joints, only = first.arm.joints, "Joints only: links count as rigid, so this is a lower bound of compliance."
    hinges = [joint.name for i, joint in enumerate(joints) if not joint.driven and any(j.driven for j in joints[:i])]
    yield f"Joints, and {', '.join(hinges)} for soft links: the rest counts as rigid." if hinges else only
    if first.drives != DRIVE_STATES[0]:
        yield "Servo on: before its integral action, which in time leaves the compliance with brakes."


def _peaks(tool: "ToolCompliance") -> Iterator[Table]:
    """Yield the largest response to a harmonic force along each axis; nothing without damping."""
    if of := tool.response:
        each = zip("xyz", *of.peaks, np.diag(tool.matrix), of.peak_band.T, strict=False)
        rows = [(axis, *_with_band(1, f, b[0]), *_with_band(UM, h, b[1]), h / c) for axis, f, h, c, b in each]
        heads = "peak at [Hz]|.4g", "at, 5 to 95 %", "peak [um/N]|.4g", "peak, 5 to 95 %", "times static|.3g"
        yield without_empty_columns(by_head((f"harmonic force along ({tool.frame} frame)", *heads), rows))


def _with_band(unit: float, value: float, band: np.ndarray) -> tuple[float, str]:
    return unit * value, "" if np.isnan(band).any() else span(*(unit * band))


# -------- Details


def _details(each: "Prediction", *, alone: bool) -> Iterator[Section]:
    """Yield compliance, strain energy of the modes, and the rest of the first screen's tables; everything if alone."""
    analysis = each.analysis
    where = degrees(analysis.posture)
    if each.tool:
        yield _whole(each.tool, where)
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


def _whole(tool: "ToolCompliance", where: str) -> Section:
    """Return all numbers of a compliance, and their quantiles."""
    heads = f"axes: {tool.frame}", *(f"{wrench}|.4g" for wrench in WRENCHES)
    sides = [("", tool.matrix), *zip(("5 %", "95 %"), tool.band, strict=True)][: 1 if tool.draws is None else 3]
    rows = [[(name, *row) for name, row in zip(MOTIONS, UM * matrix, strict=True)] for _, matrix in sides]
    tables = (by_head(heads, own, side) for own, (side, _) in zip(rows, sides, strict=True))
    return Section(f"Compliance at {tool.point} at {where}: motion per 1 N or 1 N m", tuple(tables))


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

    Frequencies and damping ratios have quantiles of 5 and 95 %, NaN without draws. Where the compliance was asked for
    there is a row for each of its numbers instead: motion and wrench, the number [SI], quantiles.
    """
    if predictions[0].tool:
        return [row for each in predictions if each.tool for row in _compliance_rows(each.analysis, each.tool)]
    return [
        _held(analysis)
        | {"mode": i + 1, "frequency": float(analysis.modes.frequency[i])}
        | {"label": str(label), "damping_ratio": float(analysis.damping_ratio[i])}
        | dict(zip(("frequency_q05", "frequency_q95"), each.frequency_band[:, i].tolist(), strict=True))
        | dict(zip(("damping_q05", "damping_q95"), each.damping_band[:, i].tolist(), strict=True))
        for analysis, each in ((each.analysis, each) for each in predictions)
        for i, label in enumerate(analysis.labels)
    ]


def _held(analysis: "ModalAnalysis") -> dict[str, Any]:
    angles = {joint.name: math.degrees(q) for joint, q in zip(analysis.arm.driven, analysis.posture, strict=True)}
    return angles | {"load": str(analysis.load)}


def _compliance_rows(analysis: "ModalAnalysis", tool: "ToolCompliance") -> Iterator[dict[str, Any]]:
    own = _held(analysis) | {"drives": analysis.drives, "point": tool.point, "frame": tool.frame}
    for (i, motion), (j, wrench) in itertools.product(enumerate(MOTIONS), enumerate(WRENCHES)):
        numbers = dict(zip(("compliance_q05", "compliance_q95"), tool.band[:, i, j].tolist(), strict=True))
        names = {"motion": motion.split()[0], "wrench": wrench.split()[0], "unit": UNITS[i // 3][j // 3]}
        yield own | names | {"compliance": float(tool.matrix[i, j])} | numbers
