"""The result file of a check: verdicts, what the data leave open, and doubts on the data themselves."""

from collections.abc import Mapping
from typing import Any

from ident.description.file import ArmFile
from ident.identify.check import CampaignCheck
from ident.present.files.document import plain, provenance


def check_document(form: str, check: CampaignCheck, arm_file: ArmFile, options: Mapping[str, Any]) -> dict[str, Any]:
    """Describe a check as plain data; infinite and undefined numbers become null."""
    known, part = check.information, check.leverage
    document = provenance(form, arm_file, check.campaign, options) | {
        "parameters": verdict_rows(check),
        "rank": known.rank if known else None,
        "directions": [{"weights": d.weights, "sd": d.sd} for d in known.directions] if known else [],
        "leverage": part.leverage if part else None,
        "doubtful_labels": [
            {"row": doubt.row, "mode": str(doubt.mode), "near_draw": doubt.near_draw} for doubt in check.labels
        ],
        "contradictory_repeats": check.repeats,
        "contradictory": check.contradictory,
    }
    return plain(document)


def verdict_rows(check: CampaignCheck) -> list[dict[str, Any]]:
    """Return a row for each parameter: verdict, and standard deviations of theta by the data alone [-].

    NaN where the model has no answer.
    """
    sd = check.data_sd
    return [
        {
            "parameter": name,
            "verdict": verdict,
            "data_sd": float(sd[0, i]) if len(sd) else float("nan"),
            "worst_data_sd": float(sd[:, i].max()) if len(sd) else float("nan"),
        }
        for i, (name, verdict) in enumerate(zip(check.problem.parameters.names, check.verdicts, strict=True))
    ]
