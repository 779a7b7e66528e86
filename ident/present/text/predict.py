"""The printed modal analysis of an arm at one posture: modes and static deflection."""

import math
from collections.abc import Iterator, Sequence

import numpy as np

from ident.identify.modal_analysis import ModalAnalysis
from ident.present.text.words import degrees, paragraphs


def predict_report(analyses: Sequence[ModalAnalysis]) -> str:
    """Return the modes with label, damping and strain-energy shares, and the deflection of the named points."""
    return "\n".join(paragraphs([_heading(each), _modes(each), _deflections(each)]) for each in analyses)


def _heading(analysis: ModalAnalysis) -> Iterator[str]:
    yield f"{analysis.arm.name} at {degrees(analysis.posture)}, load: {analysis.load}"
    for name, angle, (low, high) in analysis.beyond_limits():
        limits = f"{math.degrees(low):.4g} to {math.degrees(high):.4g} deg"
        yield f"  WARNING: {name} at {math.degrees(angle):.4g} deg is outside its limits, {limits}"


def _modes(analysis: ModalAnalysis) -> Iterator[str]:
    modes, names = analysis.modes, [joint.name for joint in analysis.arm.joints]
    width = max(11, *(len(name) + 1 for name in names))
    yield "Natural frequencies about the static equilibrium, and where the strain energy of each mode sits [%]"
    yield f"{'':47s}" + "".join(f"{name:>{width}s}" for name in names)
    halves = f"{'bend tors':>{width}s}" * len(names)
    yield "  mode  frequency [Hz]  label                 damping" + halves
    for i, label in enumerate(analysis.labels):
        shares = "".join(
            f"{f'{100 * b:4.0f} {100 * t:4.0f}':>{width}s}"
            for b, t in zip(modes.bend[:, i], modes.tors[:, i], strict=True)
        )
        name = f"{label}{' (?)' if analysis.ambiguous[i] else ''}"
        damping = f"{100 * analysis.damping_ratio[i]:.2f} %"
        yield f"  {i + 1:4d}  {modes.frequency[i]:14.4f}  {name:22s}{damping:>7s}" + shares
    if analysis.ambiguous.any():
        yield "  (?) nearly as much bending as torsion, or vertical as lateral: a small change may rename the mode"


def _deflections(analysis: ModalAnalysis) -> Iterator[str]:
    if not analysis.deflection:
        return
    yield "Static deflection [mm], from where the arm would be with rigid joints"
    yield "  point                       x          y          z      total"
    for name, moved in analysis.deflection.items():
        x, y, z = 1e3 * moved + 0.0
        yield f"  {name:18s} {x:10.3f} {y:10.3f} {z:10.3f} {1e3 * np.linalg.norm(moved):10.3f}"
