"""The result file of a fit: JSON that says what was fitted, from what, how, and what came out."""

import hashlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ident.arm.arm import Arm
from ident.description.file import ArmFile
from ident.errors import InputError, Problem
from ident.identify.fit import CampaignFit
from ident.identify.values import Values
from ident.measure import Campaign
from ident.present.files.document import check_format, plain, provenance, read_document
from ident.present.text.units import unit_of
from ident.text import one_line, read_bytes

EXPECTED = "a result file of ident fit (.fit.json)"


def fit_document(form: str, fit: CampaignFit, arm_file: ArmFile, options: Mapping[str, Any]) -> dict[str, Any]:
    """Describe a fit as plain data, all numbers SI; infinite and undefined ones become null."""
    known = fit.information
    items = fit.problem.parameters.items
    document = provenance(form, arm_file, fit.campaign, options) | {
        "parameters": [_parameter(fit, i) for i in range(len(items))],
        "covariance": known.covariance,
        "correlation": known.correlation,
        "directions": [{"weights": d.weights, "sd": d.sd, "seen": d.seen, "weak": d.weak} for d in known.directions],
        "rank": known.rank,
        "chi_squared": fit.chi_squared,
        "degrees_of_freedom": fit.degrees_of_freedom,
        "p_value": fit.p_value,
        "measurements": [
            {
                "kind": m.kind,
                "posture": list(m.posture),
                "mode": m.mode,
                "point": m.point,
                "direction": m.direction,
                "load": str(m.load),
                "reference_load": str(m.reference_load),
                "measured": m.value,
                "sigma": m.sigma,
                "predicted": predicted,
                "predicted_sd": sd,
                "note": m.note,
            }
            for m, predicted, sd in zip(fit.campaign, fit.predicted, fit.predicted_sd, strict=True)
        ],
        "cross_predictions": [
            {
                "kind": t.kind,
                "rows": list(t.rows),
                "predicted": t.predicted,
                "z": t.z,
                "statistic": t.statistic,
                "degrees_of_freedom": t.degrees_of_freedom,
                "p_value": t.p_value,
                "p_value_with_wider_priors": t.wider,
            }
            for t in fit.cross_predictions
        ],
        "optima": [
            {"values": o.values, "cost": o.cost, "starts": o.starts, "converged": o.converged} for o in fit.optima
        ],
        "failed_starts": fit.failed,
    }
    return plain(document)


def _parameter(fit: CampaignFit, i: int) -> dict[str, Any]:
    known, item = fit.information, fit.problem.parameters.items[i]
    return {
        "name": item.name,
        "paths": list(item.paths),
        "value": fit.best.values[i],
        "unit": unit_of(item.name),
        "interval_95": list(fit.interval()[i]),
        "data_support_interval": bool(fit.supported[i]),
        "fitted_as": "ln(value)" if item.positive else f"value / {float(item.scale):g}",
        "sd": known.sd[i],
        "sd_by_data_alone": known.data_sd[i],
        "prior_share": known.prior_share[i],
        "prior": {"median": item.centre, "sd": item.prior_sd, "flat_half_width": item.flat},
    }


def parameter_rows(fit: CampaignFit) -> list[dict[str, Any]]:
    """Return a row for each parameter: value, interval [SI] and whether the data support it."""
    documents = (_parameter(fit, i) for i in range(len(fit.problem.parameters.items)))
    return [
        {
            "parameter": one["name"],
            "value": float(one["value"]),
            "unit": one["unit"],
            "low_95": float(one["interval_95"][0]),
            "high_95": float(one["interval_95"][1]),
            "supported": one["data_support_interval"],
        }
        for one in documents
    ]


def read_fit(form: str, path: str | Path, arm: Arm) -> Values:
    """Return the fitted values of a result file of this format.

    Raises:
        InputError: the file is no such result, or has no number of this arm.
    """
    where, document = one_line(str(path)), read_document(path, EXPECTED)
    check_format(document["format"], form, where, EXPECTED)
    try:
        best = {tuple(p["paths"]): np.asarray(float(p["value"])) for p in document["parameters"]}
    except (ValueError, KeyError, TypeError):
        raise InputError(Problem(where, "other contents", EXPECTED, "give the file that ident fit wrote")) from None
    return Values.of_arm(best, arm, where, hashlib.sha256(read_bytes(path, EXPECTED)).hexdigest())


def rows(campaign: Campaign) -> dict[str, list[Any]]:
    """Return what is known of each measurement, as columns."""
    return {
        "kind": [m.kind for m in campaign],
        "row": [m.where for m in campaign],
        "mode": [m.mode or "" for m in campaign],
        "point": [m.point or "" for m in campaign],
        "sigma": [m.sigma for m in campaign],
    }
