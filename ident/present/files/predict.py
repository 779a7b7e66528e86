"""Predictions as rows."""

import math
from collections.abc import Sequence
from typing import Any

from ident.identify.modal_analysis import ModalAnalysis


def predict_rows(analyses: Sequence[ModalAnalysis]) -> list[dict[str, Any]]:
    """Return a row for each mode of each analysis: angles [deg], load, frequency [Hz], label, damping ratio [-]."""
    return [
        {
            **{joint.name: math.degrees(q) for joint, q in zip(analysis.arm.driven, analysis.posture, strict=True)},
            "load": str(analysis.load),
            "mode": i + 1,
            "frequency": float(analysis.modes.frequency[i]),
            "label": str(label),
            "damping_ratio": float(analysis.damping_ratio[i]),
        }
        for analysis in analyses
        for i, label in enumerate(analysis.labels)
    ]
