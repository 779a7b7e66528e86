"""Predictions of what was left out, as rows."""

from typing import Any

from ident.identify.validate import Validation


def validate_rows(validation: Validation) -> list[dict[str, Any]]:
    """Return a row for each measurement: the part it belongs to, value, prediction and standard deviation [SI]."""
    campaign = validation.fit.campaign.measurements
    return [
        {
            "part": part.name,
            "row": int(place) + 1,
            "kind": campaign[place].kind,
            "measured": float(part.measured[i]),
            "predicted": float(part.predicted[i]),
            "sd": float(part.sd[i]),
            "off_sd": float(part.off[i] / part.sd[i]),
        }
        for part in validation.parts
        for i, place in enumerate(part.places)
    ]
