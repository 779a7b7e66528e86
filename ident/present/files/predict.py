"""Predictions as rows."""

import math
from collections.abc import Sequence
from typing import Any

from ident.assess.prediction import Prediction


def predict_rows(predictions: Sequence[Prediction]) -> list[dict[str, Any]]:
    """Return a row for each mode at each posture: angles [deg], load, frequency [Hz], label, damping ratio [-].

    Frequencies and damping ratios have quantiles of 5 and 95 %, NaN without draws.
    """
    return [
        {
            **{joint.name: math.degrees(q) for joint, q in zip(analysis.arm.driven, analysis.posture, strict=True)},
            "load": str(analysis.load),
            "mode": i + 1,
            "frequency": float(analysis.modes.frequency[i]),
            "label": str(label),
            "damping_ratio": float(analysis.damping_ratio[i]),
            "frequency_q05": float(each.frequency_band[0, i]),
            "frequency_q95": float(each.frequency_band[1, i]),
            "damping_q05": float(each.damping_band[0, i]),
            "damping_q95": float(each.damping_band[1, i]),
        }
        for analysis, each in ((each.analysis, each) for each in predictions)
        for i, label in enumerate(analysis.labels)
    ]
