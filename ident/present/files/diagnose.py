"""The remedies of a diagnosis as rows, and its posterior as a file."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from ident.assess.diagnosis import Diagnosis
from ident.present.files.document import plain
from ident.present.files.sample import groups_of, inference_data
from ident.present.text.remedy_words import change_words

if TYPE_CHECKING:
    import xarray


def diagnose_rows(diagnosis: Diagnosis) -> list[dict[str, Any]]:
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


def posterior_groups(diagnosis: Diagnosis, head: Mapping[str, Any]) -> "dict[str, xarray.Dataset]":
    """Return the posterior as the groups of a file of `ident sample`; `head` is the provenance."""
    sampled = diagnosis.identification.sampled
    return groups_of(inference_data(sampled, {**head, "trust": plain(sampled.trust)}))
