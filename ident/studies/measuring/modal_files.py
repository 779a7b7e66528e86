"""Modes as a campaign with covariance, and frequency responses as netCDF for other tools."""

import json
import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ident.measure import Campaign, write_campaign
from ident.measure.covariance import covariance_path
from ident.measure.reproducibility import Reproducibility
from ident.modal.ambient import AmbientTest
from ident.report.document import Group, Variable
from ident.studies.measuring.modal_report import place_in_words, reproducibility_in_words

if TYPE_CHECKING:
    from ident.modal.frf import ModalTest


def write_campaign_file(
    campaign: Campaign, head: Mapping[str, Any], path: Path, reproducibility: Reproducibility | None = None
) -> None:
    """Write the campaign, and a companion file with the error correlation between the rows of each posture."""
    comments = [
        f"{head['format']} {head['created']} ident {head['software']['ident']}",
        "Modes of a modal test that have a name. of: pole, the undamped frequency is |pole| / 2 pi.",
        f"The errors of the rows of one group are correlated: see {covariance_path(path).name}.",
        *([f"sigma: {reproducibility_in_words(reproducibility)}."] if reproducibility else []),
    ]
    write_campaign(campaign, path, header_comments=comments)


def modal_groups(tests: Sequence["ModalTest | AmbientTest"], head: Mapping[str, Any]) -> dict[str, Group]:
    """Return mean accelerance, real and imaginary, and coherence of each test, as `test1`, `test2`, ... of the root.

    For an ambient test the singular values of the spectral density.
    """
    data: dict[str, Variable] = {}
    for number, test in enumerate(tests, 1):
        each = _densities(number, test) if isinstance(test, AmbientTest) else _responses(number, test)
        posture = [math.degrees(angle) for angle in test.posture]
        for name, values, unit, coordinates in each:
            data |= {dim: Variable((dim,), list(along)) for dim, along in coordinates.items()}
            data[name] = Variable(tuple(coordinates), values, {"units": unit, "posture_deg": posture})
    return {"/": Group(data, {"format": head["format"], "head": json.dumps(head)})}


_Written = Iterator[tuple[str, Any, str, dict[str, Any]]]
"""Name, values, unit and coordinates."""


def _responses(number: int, test: "ModalTest") -> _Written:
    mean = test.frf.mean
    coordinates = {
        f"response{number}": [place_in_words(place) for place in test.frf.responses],
        f"force{number}": [place_in_words(place) for place in test.frf.references],
        f"frequency{number}": test.frf.frequency,
    }
    yield f"test{number}_real", mean.real, "1/kg", coordinates
    yield f"test{number}_imaginary", mean.imag, "1/kg", coordinates
    yield f"test{number}_coherence", test.coherence, "1", coordinates


def _densities(number: int, test: AmbientTest) -> _Written:
    singular = test.density.singular
    coordinates = {f"value{number}": range(1, len(singular) + 1), f"frequency{number}": test.density.frequency}
    yield f"test{number}_singular", singular, "1/Hz", coordinates
