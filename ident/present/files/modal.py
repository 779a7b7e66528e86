"""Frequency responses as rows, and as netCDF for other tools."""

import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ident.modal.modal_test import ModalTest
from ident.present.text.modal import place_in_words


def modal_rows(tests: Sequence[ModalTest]) -> list[dict[str, Any]]:
    """Return a row for each response and force: posture [deg], load, hits, coherence [-], accelerance [1/kg]."""
    return [
        {
            "posture": " ".join(f"{math.degrees(angle) + 0.0:.6g}" for angle in test.posture),
            "load": str(test.load),
            "response": place_in_words(response),
            "force": place_in_words(force),
            "hits": len(test.frf.hits),
            "coherence": float(np.median(test.coherence[o, i])),
            "largest": float(np.abs(test.frf.mean[o, i]).max()),
        }
        for test in tests
        for o, response in enumerate(test.frf.responses)
        for i, force in enumerate(test.frf.references)
    ]


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
