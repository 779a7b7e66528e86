"""The result file of predictions: modes and static deflection at each posture."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

from ident.assess.prediction import Prediction
from ident.description.file import ArmFile
from ident.present.files.document import plain, provenance


def predict_document(
    form: str, predictions: Sequence[Prediction], arm_file: ArmFile, options: Mapping[str, Any]
) -> dict[str, Any]:
    """Describe modal analyses as plain data, all numbers SI."""
    document = provenance(form, arm_file, None, options) | {
        "postures": [
            {
                "posture": list(analysis.posture),
                "load": str(analysis.load),
                "modes": [
                    {
                        "label": str(label),
                        "ambiguous": analysis.ambiguous[i],
                        "frequency": analysis.modes.frequency[i],
                        "frequency_band": each.frequency_band[:, i],
                        "damping_ratio": analysis.damping_ratio[i],
                        "damping_band": each.damping_band[:, i],
                        "bending_share": analysis.modes.bend[:, i],
                        "torsion_share": analysis.modes.tors[:, i],
                    }
                    for i, label in enumerate(analysis.labels)
                ],
                "deflection": analysis.deflection,
                "deflection_band": each.deflection_band,
                "collapsed_draws": each.collapsed,
            }
            for analysis, each in ((each.analysis, each) for each in predictions)
        ]
    }
    return plain(document)


def mode_rows(predictions: Sequence[Prediction]) -> list[dict[str, Any]]:
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
