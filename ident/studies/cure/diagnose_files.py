"""The posterior of a diagnosis as a file."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from ident.report.document import plain

if TYPE_CHECKING:
    import xarray

    from ident.studies.cure.diagnosis import Diagnosis
from ident.studies.stiffness.sample_files import groups_of, inference_data


def posterior_groups(diagnosis: "Diagnosis", head: Mapping[str, Any]) -> "dict[str, xarray.Dataset]":
    """Return the posterior as the groups of a file of `ident sample`; `head` is the provenance."""
    sampled = diagnosis.identification.sampled
    return groups_of(inference_data(sampled, {**head, "trust": plain(sampled.trust)}))
