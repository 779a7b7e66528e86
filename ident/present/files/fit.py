"""The result file of a fit: JSON that says what was fitted, from what, how, and what came out."""

from collections.abc import Mapping
from typing import Any

from ident.description.file import ArmFile
from ident.identify.fit import CampaignFit
from ident.measure import Campaign
from ident.present.files.document import plain, provenance
from ident.present.text.units import unit_of

FORMAT = "ident-fit/2"


def fit_document(result: CampaignFit, arm_file: ArmFile, options: Mapping[str, Any]) -> dict[str, Any]:
    """Describe a fit as plain data, all numbers SI; infinite and undefined ones become null."""
    fit, known = result.fit, result.fit.information
    items = fit.problem.parameters.items
    document = provenance(FORMAT, arm_file, result.campaign, options) | {
        "parameters": [_parameter(result, i) for i in range(len(items))],
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
            for m, predicted, sd in zip(result.campaign, fit.predicted, fit.predicted_sd, strict=True)
        ],
        "cross_predictions": [
            {"kind": t.kind, "rows": list(t.rows), "predicted": t.predicted, "sd": t.sd, "z": t.z}
            for t in result.cross_predictions
        ],
        "optima": [
            {"values": o.values, "cost": o.cost, "starts": o.starts, "converged": o.converged} for o in fit.optima
        ],
        "failed_starts": fit.failed,
    }
    return plain(document)


def _parameter(result: CampaignFit, i: int) -> dict[str, Any]:
    fit, known, item = result.fit, result.fit.information, result.fit.problem.parameters.items[i]
    return {
        "name": item.name,
        "paths": list(item.paths),
        "value": fit.best.values[i],
        "unit": unit_of(item.name),
        "interval_95": list(fit.interval()[i]),
        "data_support_interval": bool(result.supported[i]),
        "fitted_as": "ln(value)" if item.positive else f"value / {float(item.scale):g}",
        "sd": known.sd[i],
        "sd_by_data_alone": known.data_sd[i],
        "prior_share": known.prior_share[i],
        "prior": {"median": item.centre, "sd": item.prior_sd, "flat_half_width": item.flat},
    }


def parameter_rows(result: CampaignFit) -> list[dict[str, Any]]:
    """Return a row for each parameter: value, interval [SI] and whether the data support it."""
    documents = (_parameter(result, i) for i in range(len(result.fit.problem.parameters.items)))
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


def rows(campaign: Campaign) -> dict[str, list[Any]]:
    """Return what is known of each measurement, as columns."""
    return {
        "kind": [m.kind for m in campaign],
        "row": [m.where for m in campaign],
        "mode": [m.mode or "" for m in campaign],
        "point": [m.point or "" for m in campaign],
        "sigma": [m.sigma for m in campaign],
    }
