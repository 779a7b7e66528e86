"""The printed report of a validation: how well each part is predicted by the others, and how far to trust that."""

from collections.abc import Iterator

import numpy as np

from ident.identify.validate import Validation
from ident.inference.held_out import HeldOut
from ident.present.text.words import cut, drive_states, paragraphs, percent

PARTS = {"posture": "postures", "kind": "kinds of measurement", "row": "rows", "fraction": "fifths"}
"""What is left out at a time, in words."""


def validate_report(validation: Validation) -> str:
    """Return the report: a verdict, each part with its prediction, the scope, and what it does not reach."""
    return paragraphs([_validate_heading(validation), _parts(validation), _scopes(validation), _limits(validation)])


def _validate_heading(validation: Validation) -> Iterator[str]:
    fit, parts = validation.fit, validation.parts
    yield f"Validation of {cut(fit.arm.name, 30)} by {cut(fit.campaign.name, 30)}"
    yield f"  {len(parts)} {PARTS[validation.leave]}, each left out in turn and predicted by a fit to the others"
    if fit.loops:
        count = len(fit.loops)
        yield f"  Loops of ramps: {count}. What is left out is predicted at the width that the other rows of its loop"
        yield "  tell; where none stays, nothing tells it, and the part is not predicted: try --leave row"
    z = validation.z
    if not len(z):
        needed = "the stiffnesses, or the loops" if fit.loops else "the stiffnesses"
        yield f"  NOTHING is predicted: what is left out is needed to tell {needed}. Measure more."
        return
    yield f"  {validation.covered} of {len(z)} measurements lie in the 95 % interval of their prediction"
    if validation.missed:
        named = ", ".join(cut(part.name, 30) for part in validation.missed)
        yield f"  NOT to be trusted: too far from the prediction: {named}"
    yield from drive_states(fit.arm, fit.campaign)
    for doubt in fit.doubts:
        yield f"  WARNING: {doubt.replace('see below', 'see ident fit')}"


def _parts(validation: Validation) -> Iterator[str]:
    yield f"{'Left out':34s}{'rows':>5s}{'rms off':>10s}{'largest':>10s}{'expected':>10s}{'p':>9s}"
    missed = {part.name for part in validation.missed}
    for part in validation.parts:
        yield _validate_row(part, part.name in missed)
    yield "  off: measured less predicted, as a share of the measured value; expected: rms by the model's own"
    yield "  standard deviations, of noise and what the others leave open; p: chance of so far off, together"


def _validate_row(part: HeldOut, missed: bool) -> str:
    row = f"  {cut(part.name, 32):32s}{len(part.places):5d}"
    if not part.told:
        return f"{row}   {'no optimum without it' if not part.ended else 'not told by the others'}"
    size = np.where(part.measured == 0, np.nan, np.abs(part.measured))
    off, sd = np.abs(part.off) / size, part.sd / size
    numbers = (np.sqrt(np.nanmean(off**2)), np.nanmax(off), np.sqrt(np.nanmean(sd**2)))
    cells = "".join(f"{percent(float(number)):>10s}" for number in numbers)
    return f"{row}{cells}{part.p_value:9.2g}{'   <--' if missed else ''}"


def _scopes(validation: Validation) -> Iterator[str]:
    if not validation.scopes:
        return
    yield "What was not measured: 95 % of measurements like these will lie within the larger of two spans"
    for scope in validation.scopes:
        kind, parts = scope.kind.replace("_", " "), f"{scope.folds} part{'s' * (scope.folds > 1)}"
        why = f"seen {percent(scope.seen)} in {parts}, expected {percent(scope.expected)}"
        yield f"  {kind:24s}within {percent(scope.half):8s} ({why})"


def _limits(validation: Validation) -> Iterator[str]:
    campaign = validation.fit.campaign
    yield "Within what was measured, and no further"
    angles = np.degrees(np.array([m.posture for m in campaign]))
    joints = (cut(joint.name, 16) for joint in validation.fit.arm.driven)
    ends = zip(joints, angles.min(0), angles.max(0), strict=True)
    spans = (f"{joint} {low:.4g} to {high:.4g}" for joint, low, high in ends)
    yield f"  postures [deg]: {', '.join(spans)}"
    yield f"  loads: {', '.join(dict.fromkeys(cut(str(m.load), 30) for m in campaign))}"
    frequencies = [m.value for m in campaign if m.kind == "frequency"]
    if frequencies:
        yield f"  frequencies: {min(frequencies):.3g} to {max(frequencies):.3g} Hz"
