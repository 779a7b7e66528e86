"""The result files of a diagnosis beside its page: JSON with the main numbers of each stage, and the posterior."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ident.assess.diagnosis import Diagnosis, chosen
from ident.assess.remedies import Remedy
from ident.present.files.document import plain
from ident.present.files.sample import inference_data
from ident.present.text.diagnose import change_words
from ident.vibrate.redesign.binomial import binomial_to_json


def diagnose_document(diagnosis: Diagnosis, head: Mapping[str, Any]) -> dict[str, Any]:
    """Describe a finished diagnosis as plain data, all numbers SI; `head` is its provenance."""
    vibration, fit = diagnosis.vibration, diagnosis.identification.sampled.fitted
    stages: dict[str, Any] = {
        "stiffness": {"doubts": fit.doubts, "rank": fit.information.rank, "count": len(fit.information.names)},
        "resonance": {"crossings": len(diagnosis.resonance.crossings)},
        "vibration": {
            "accepted": vibration.accepted,
            "scatter": vibration.scatter,
            "keeps": binomial_to_json(vibration.keeps),
            "peak": vibration.peak,
        },
        "sensitivities": {
            "paths": diagnosis.sensitivities.paths,
            "elasticity": diagnosis.sensitivities.elasticity,
        },
    }
    if diagnosis.verified is not None:
        stages["remedies"] = {"remedies": [_remedy(remedy) for remedy in diagnosis.remedies]}
        stages["verification"] = {
            "remedy": chosen(diagnosis.verifications),
            "verified": len(diagnosis.verifications),
            "amplitude": diagnosis.verified.amplitude,
            "keeps": binomial_to_json(diagnosis.verified.keeps),
            "holds": diagnosis.verified.holds,
        }
    return plain({**head, "verdict": diagnosis.verdict, "stages": stages})


def _remedy(remedy: Remedy) -> dict[str, Any]:
    return {**vars(remedy), "keeps": binomial_to_json(remedy.keeps)}


def remedy_rows(diagnosis: Diagnosis) -> list[dict[str, Any]]:
    """Return a row for each remedy, the best first: what it changes and what comes of it [SI]."""
    verifications = diagnosis.verifications
    return [
        {
            "rank": rank,
            "kind": remedy.kind,
            "change": change_words(remedy),
            "speed_percent": remedy.percent,
            "amplitude": remedy.largest,
            "probability": remedy.keeps.share,
            "first_frequency": remedy.frequency,
            "deflection": remedy.deflection,
            "change_norm": remedy.change_norm,
            "meets_limit": remedy.meets_limit,
            "verified": verifications[rank - 1].holds if rank <= len(verifications) else None,
        }
        for rank, remedy in enumerate(diagnosis.remedies, 1)
    ]


def write_posterior(diagnosis: Diagnosis, head: Mapping[str, Any], path: Path) -> None:
    """Write the posterior as InferenceData, as `ident sample` does; `head` is the provenance."""
    sampled = diagnosis.identification.sampled
    origin = {**head, "trust": plain(sampled.trust)}
    data = inference_data(sampled, origin)
    data.to_netcdf(str(path), engine="h5netcdf")
