"""The printed predictions of an arm at postures: modes and static deflection."""

import math
from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from ident.assess.predict import Prediction
from ident.identify.modal_analysis import ModalAnalysis
from ident.identify.values import Values
from ident.measure import DRIVE_STATES
from ident.present.text.basis import changes_in_words, values_in_words
from ident.present.text.words import WIDTH, degrees, paragraphs, span


def predict_report(
    predictions: Sequence[Prediction],
    *,
    fit: Values | None = None,
    posterior: Values | None = None,
    changed: Mapping[str, float] | None = None,
) -> str:
    """Return, posture by posture, modes with label, damping and strain-energy shares, and the points' deflection.

    Args:
        predictions: at each posture.
        fit: fitted values that the arm has taken over.
        posterior: draws that the bands are from.
        changed: numbers that were set, by path [SI].
    """
    origin = [*values_in_words(fit, posterior), *changes_in_words(changed or {})]
    return "\n".join(paragraphs([[*_heading(each), *origin], _modes(each), _deflections(each)]) for each in predictions)


def _heading(prediction: Prediction) -> Iterator[str]:
    analysis = prediction.analysis
    servo = "" if analysis.drives == DRIVE_STATES[0] else f", {analysis.drives} on"
    yield f"{analysis.arm.name} at {degrees(analysis.posture)}, load: {analysis.load}{servo}"
    for name, angle, (low, high) in analysis.beyond_limits():
        limits = f"{math.degrees(low):.4g} to {math.degrees(high):.4g} deg"
        yield f"  WARNING: {name} at {math.degrees(angle):.4g} deg is outside its limits, {limits}"
    if prediction.collapsed:
        yield f"  WARNING: {prediction.collapsed} draws have no stable equilibrium here, and are left out of the bands"


def _modes(prediction: Prediction) -> Iterator[str]:
    analysis = prediction.analysis
    modes, names = analysis.modes, [joint.name for joint in analysis.arm.joints]
    width, drawn = max(11, *(len(name) + 1 for name in names)), prediction.frequency is not None
    band = f"{'5 to 95 %':>17s}" if drawn else ""
    yield "Natural frequencies about the static equilibrium, and where the strain energy of each mode sits [%]"
    shares = _shares(analysis, width)
    beside = 47 + len(band) + width * len(names) <= WIDTH
    yield from [f"{'':{41 + len(band)}s}{shares[0]}"] if beside else []
    yield f"  mode    f [Hz]{band}  label                 damping{shares[1] if beside else ''}"
    for i, label in enumerate(analysis.labels):
        name = f"{label}{' (?)' if analysis.ambiguous[i] else ''}"
        damping = f"{round(100 * float(analysis.damping_ratio[i]), 2) + 0.0:.2f} %"
        within = f"{span(*prediction.frequency_band[:, i]):>17s}" if drawn else ""
        numbers = f"{modes.frequency[i]:9.4f}{within}  {name:22s}{damping:>7s}"
        yield f"  {i + 1:4d} {numbers}{shares[i + 2] if beside else ''}"
    if not beside:
        modes_column = ["", "mode", *(str(i + 1) for i in range(len(analysis.labels)))]
        yield from (f"  {mode:>4s}{line}" for mode, line in zip(modes_column, shares, strict=True))
    if analysis.ambiguous.any():
        yield "  (?) nearly as much bending as torsion, or vertical as lateral: a small change may rename the mode"


def _shares(analysis: ModalAnalysis, width: int) -> list[str]:
    """Return head and rows of the strain energy's shares [%], so many columns for each joint."""
    modes, names = analysis.modes, [joint.name for joint in analysis.arm.joints]
    rows = [zip(modes.bend[:, i], modes.tors[:, i], strict=True) for i in range(len(analysis.labels))]
    return [
        "".join(f"{name:>{width}s}" for name in names),
        f"{'bend tors':>{width}s}" * len(names),
        *("".join(f"{f'{100 * b:4.0f} {100 * t:4.0f}':>{width}s}" for b, t in row) for row in rows),
    ]


def _deflections(prediction: Prediction) -> Iterator[str]:
    if not prediction.analysis.deflection:
        return
    yield "Static deflection [mm], from where the arm would be with rigid joints"
    yield "  point                       x          y          z      total"
    for name, moved in prediction.analysis.deflection.items():
        yield f"  {name:18s}{_row(1e3 * moved)} {1e3 * np.linalg.norm(moved):10.3f}"
        if prediction.deflection is not None:
            for words, side in zip(("5 %", "95 %"), prediction.deflection_band[name], strict=True):
                yield f"    {words:16s}{_row(1e3 * side)}"


def _row(moved: np.ndarray) -> str:
    return "".join(f" {value:10.3f}" for value in moved.round(3) + 0.0)
