"""Modes as rows and as a campaign with covariance, frequency responses as netCDF for other tools."""

import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from ident.assess.identified_modes import IdentifiedModes, Labelled, NamedModes
from ident.measure import Campaign, write_campaign
from ident.measure.covariance import covariance_path
from ident.modal.finished import FinishedTest
from ident.modal.modal_test import ModalTest
from ident.present.text.modal import place_in_words


def modal_rows(
    tests: Sequence[ModalTest],
    identified: Sequence[IdentifiedModes],
    finished: Sequence[FinishedTest],
    named: Sequence[NamedModes],
    campaign: Campaign | None,
) -> list[dict[str, Any]]:
    """Return a row for each mode: posture [deg], load, frequency [Hz], damping ratio [-], sd of both, label."""
    pairs: list[tuple[ModalTest | FinishedTest, Labelled]] = [*zip(tests, identified, strict=False)]
    pairs += zip(finished, named, strict=False)
    return [
        {
            "posture": " ".join(f"{math.degrees(angle) + 0.0:.6g}" for angle in test.posture),
            "load": str(test.load),
            "frequency": float(each.modes.frequency[i]),
            "frequency_sd": float(each.modes.sigma[0, i]),
            "damping_ratio": float(each.modes.damping[i]),
            "damping_ratio_sd": float(each.modes.sigma[1, i]),
            "label": str(label or ""),
            "probability": float(each.labels.probability[i].max(initial=0.0)),
        }
        for test, each in pairs
        for i, label in enumerate(each.labels.given)
    ]


def write_campaign_file(campaign: Campaign, head: Mapping[str, Any], path: Path) -> None:
    """Write the campaign, and beside it how the errors of the rows of a posture are correlated."""
    comments = [
        f"{head['format']} {head['created']} ident {head['software']['ident']}",
        "Modes of a modal test that have a name. of: pole, the undamped frequency is |pole| / 2 pi.",
        f"The errors of the rows of one group are correlated: see {covariance_path(path).name}.",
    ]
    write_campaign(campaign, path, header_comments=comments)


def write_netcdf(tests: Sequence[ModalTest], head: Mapping[str, Any], path: Path) -> None:
    """Write mean accelerance, real and imaginary, and coherence of each test, as `test1`, `test2`, ..."""
    import xarray

    data: dict[str, Any] = {}
    for number, test in enumerate(tests, 1):
        names = (f"response{number}", f"force{number}", f"frequency{number}")
        mean = test.frf.mean
        coordinates = {
            names[0]: [place_in_words(place) for place in test.frf.responses],
            names[1]: [place_in_words(place) for place in test.frf.references],
            names[2]: test.frf.frequency,
        }
        for word, values, unit in (
            ("real", mean.real, "1/kg"),
            ("imaginary", mean.imag, "1/kg"),
            ("coherence", test.coherence, "1"),
        ):
            attributes = {"units": unit, "posture_deg": [math.degrees(angle) for angle in test.posture]}
            data[f"test{number}_{word}"] = xarray.DataArray(values, coordinates, names, attrs=attributes)
    dataset = xarray.Dataset(data, attrs={"format": head["format"], "head": json.dumps(head)})
    dataset.to_netcdf(path, engine="h5netcdf")
