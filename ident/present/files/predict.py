"""The result file of predictions: modes and static deflection at each posture."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

from ident.description.file import ArmFile
from ident.identify.modal_analysis import ModalAnalysis
from ident.present.files.document import plain, provenance


def predict_document(
    form: str, analyses: Sequence[ModalAnalysis], arm_file: ArmFile, options: Mapping[str, Any]
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
                        "damping_ratio": analysis.damping_ratio[i],
                        "bending_share": analysis.modes.bend[:, i],
                        "torsion_share": analysis.modes.tors[:, i],
                    }
                    for i, label in enumerate(analysis.labels)
                ],
                "deflection": analysis.deflection,
            }
            for analysis in analyses
        ]
    }
    return plain(document)


def mode_rows(analyses: Sequence[ModalAnalysis]) -> list[dict[str, Any]]:
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
